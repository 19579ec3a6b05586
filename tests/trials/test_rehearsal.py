"""How long a trial will take is told before it starts, and telling it changes nothing."""

import time

import pytest
import trials

from usbench import suite
from usbench.setting import Setting
from usbench.trials import callback, rehearsal, runner


class Told(callback.Silent):
    """Keeps what was told, and whether that was before anything else of training and evaluation."""

    def __init__(self):
        self.order, self.seconds = [], None

    def expected(self, wall_s, cpu_s):
        self.order.append("expected")
        self.seconds = wall_s
        assert cpu_s > 0

    def evaluated(self, *_):
        self.order.append("evaluated")


@pytest.mark.parametrize(("algo", "steps"), [("vpg", 320), ("dqn", 132), ("double_dqn", 96)])
def test_a_rehearsed_trial_is_told_of_first_and_has_the_same_bits(quick, tmp_path, algo, steps):
    config, told = trials.config(algo, steps=steps), Told()
    plain = runner.run_trial(config, tmp_path / "plain").folder
    start = time.perf_counter()
    rehearsed = runner.run_trial(config, tmp_path / "rehearsed", progress=told, rehearse=True).folder
    whole = time.perf_counter() - start
    assert told.order[0] == "expected" and told.order.count("expected") == 1
    # About: a busy machine may change its pace by a factor.
    assert whole / 20 < told.seconds < 20 * whole
    assert trials.bits(rehearsed) == trials.bits(plain)


def test_a_trial_that_goes_on_is_not_rehearsed(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(rehearsal, "FEWEST_UPDATES", 1)
    monkeypatch.setenv("USBENCH_CHECKPOINT_SECONDS", "0")
    config, told = trials.config("vpg", steps=64), Told()
    with pytest.raises(trials.Killed):
        runner.run_trial(config, tmp_path, progress=trials.Until(trials.ENDED_AT))
    runner.run_trial(config, tmp_path, progress=told, rehearse=True)
    assert "expected" not in told.order and "evaluated" in told.order


def expected(config):
    setting = Setting.recorded(config)
    return rehearsal.expected(config, setting, suite.evaluation_episodes(config.task), 3)


@pytest.mark.parametrize(("algo", "steps"), [("vpg", 64), ("stay", None), ("random", None)])
def test_short_trials_and_agents_that_learn_nothing_are_not_rehearsed(quick, algo, steps):
    assert expected(trials.config(algo, steps=steps)) is None


def test_what_is_expected_grows_with_the_steps_and_the_evaluations(quick, monkeypatch):
    # A clock that goes on by a second at every look, whatever the machine does.
    clock = iter(range(1_000_000))
    monkeypatch.setattr(rehearsal.Seconds, "now", lambda: rehearsal.Seconds(tick := next(clock), 2 * tick))
    monkeypatch.setattr(rehearsal, "LARGEST_SHARE", 0.0)
    # A look as the rollout before and that after an update begin: 16 steps in a second. Evaluation: a second
    # for 4 episodes, each played 2 times at 3 points.
    n_episodes = len(suite.evaluation_episodes("pp"))
    for steps in (320, 640):
        wall_s = steps / 16 + 2 * 3 * n_episodes / rehearsal.N_EPISODES
        assert expected(trials.config("vpg", steps=steps)) == pytest.approx((wall_s, 2 * wall_s))


def test_a_first_update_that_compiles_for_long_does_not_count():
    pace = rehearsal._Pace(steps=100_000)
    # The first update takes 60 s, the others one each.
    for step, second in enumerate((0.0, 60.0, 61.0, 62.0, 63.0)):
        pace.num_timesteps = 10 * step
        pace._noted.append((rehearsal.Seconds(second, second), pace.num_timesteps))
        assert pace._on_step() == (second < 63)
    assert pace.seconds_per_step == (0.1, 0.1)


def test_no_trial_ends_because_its_rehearsal_does(quick, tmp_path, monkeypatch, caplog):
    def broken(*_):
        raise ValueError("no rehearsal\nhere")

    monkeypatch.setattr(rehearsal, "expected", broken)
    told = Told()
    runner.run_trial(trials.config("vpg"), tmp_path, progress=told, rehearse=True)
    assert "expected" not in told.order and told.order
    assert "how long it will take is not known: no rehearsal here" in caplog.text
