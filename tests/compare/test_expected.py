"""How long trials will take: what is told before the first one has ended."""

import shutil

import pytest

from usbench.compare import expected
from usbench.compare.expected import End, Expected
from usbench.results import sources, tables
from usbench.trials.configuration import resolve
from usbench.trials.resume_files import ResumeFiles


@pytest.fixture
def two_of_ppo(tmp_path, monkeypatch):
    """Let two trials of PPO be the published ones: 10 ms and 20 ms per step, 5 s and 15 s beside them."""
    table = tables.read(sources.published()).trials
    rows = table[(table["algo"] == "ppo") & (table["status"] == "finished")].head(2)
    rows = rows.assign(steps=[1000, 4000], training_s=[10.0, 80.0], total_s=[15.0, 95.0])
    for name in (tables.TRIALS, tables.CURVES):
        shutil.copy(sources.published() / name, tmp_path / name)
    rows.to_csv(tmp_path / tables.TRIALS, index=False)
    monkeypatch.setattr(sources, "published", lambda: tmp_path)


@pytest.mark.usefixtures("two_of_ppo")
def test_before_the_first_trial_the_published_ones_tell_how_long(tmp_path):
    # 2000 steps of 15 ms each, and 10 s beside them.
    assert expected.by_published([("ppo", 2000)]) == {("ppo", 2000): pytest.approx(30 + 10)}
    assert expected.by_published([("ppo", 1000)]) == {("ppo", 1000): pytest.approx(15 + 10)}
    assert expected.by_published([("ppo", 64), ("mine:LongPPO", 64)]) is None
    learner, reference = resolve("ppo", "pp", steps=2000), resolve("stay", "pp")
    told = expected.trials([reference, learner], tmp_path / "runs", 1)
    assert told.each == {reference.folder_name: 0.0, learner.folder_name: pytest.approx(40)}
    assert told.told and told.published


@pytest.mark.usefixtures("two_of_ppo")
def test_a_stopped_trial_is_expected_to_take_what_is_left_of_it(tmp_path):
    fresh, stopped, played = (resolve("ppo", "pp", seed=seed, steps=2000) for seed in range(3))
    for config, steps in ((stopped, (500, 1500)), (played, (2000,))):
        (tmp_path / config.folder_name).mkdir()
        files = ResumeFiles(tmp_path / config.folder_name, 0.0)
        for step in steps:
            files.write(step, {})
    told = expected.trials([fresh, stopped, played], tmp_path, 1)
    assert list(told.each.values()) == pytest.approx([40, 10, 0])


def test_own_algorithms_of_which_no_record_tells_are_taken_for_equal(tmp_path):
    configs = [resolve("stable_baselines3:PPO", "pp", seed=seed, steps=64) for seed in (0, 1)]
    told = expected.trials(configs, tmp_path, 1)
    assert not told.told and list(told.each.values()) == [1.0, 1.0]


def test_trials_run_side_by_side_and_none_is_split():
    assert Expected(dict.fromkeys("abcd", 40.0), 2).seconds == 80
    assert Expected({"a": 40.0}, 16).seconds == 40
    assert Expected({"a": 40.0, "b": 10.0}, 2).seconds == 40
    assert Expected({"a": 40.0}, 2, later=60.0).seconds == 50


def left(each, jobs, *ends, **others):
    """What is left when the trials `ends`, name and second, have ended."""
    return Expected(each, jobs, **others).left([End(*end) for end in ends])


def test_time_left_is_by_what_was_expected_until_a_learner_has_ended_then_by_what_it_took():
    each = {"stay": 0.0, "quick": 100.0, "slow": 300.0, "last": 200.0}
    assert left(each, 1, ("stay", 5)) == 600
    # It took twice as long as was expected, and so will the others.
    assert left(each, 1, ("stay", 5), ("quick", 205)) == pytest.approx(1000)
    assert left(each, 1, ("stay", 0), ("quick", 100), ("slow", 400), ("last", 600)) == 0
    assert left({"a": 100.0}, 1, ("a", 50), later=300.0) == pytest.approx(150)


def test_time_left_counts_what_runs_since_it_began():
    each = dict.fromkeys("abcd", 3600.0)
    assert left(each, 4, ("a", 3600)) == 0
    # `c` began when `a` had ended, and `d`, which takes 3650 s, when `b` had.
    assert left(each, 2, ("a", 3600), ("b", 3700)) == pytest.approx(3650)
    # None is split: the long one has only begun.
    long = {**dict.fromkeys("abcd", 600.0), "long": 36_000.0}
    assert left(long, 2, ("a", 600), ("b", 600), ("c", 1200)) == pytest.approx(36_000)


def test_what_failed_tells_no_time():
    each = dict.fromkeys("abcdefghij", 3600.0)
    assert left(each, 1, ("a", 3, False)) == pytest.approx(9 * 3600)
    assert left(each, 1, ("a", 3, False), ("b", 7203)) == pytest.approx(8 * 7200)


def test_nobody_knows_how_long_own_algorithms_take_before_the_first_has_ended():
    each = {"stay": 0.0, "a": 1.0, "b": 1.0}
    assert left(each, 1, told=False) is None and left(each, 1, ("stay", 5), told=False) is None
    assert left(each, 1, ("stay", 5), ("a", 35), told=False) == pytest.approx(30)


def test_a_trial_that_ends_before_its_turn_began_with_the_last_end_before_its_own():
    # Another process took b and c: d ended second. It took as long as expected, as b and c will.
    each = {"a": 10.0, "b": 10.0, "c": 10.0, "d": 10.0}
    assert left(each, 1, ("a", 10), ("d", 20)) == pytest.approx(10 + 10 - 10)
