"""How long trials will take: what is told before the first one has ended."""

import shutil

import pytest

from usbench.cli.output import sweep_output
from usbench.compare import expected
from usbench.compare.expected import Expected
from usbench.results import published, tables
from usbench.trials.configuration import resolve


@pytest.fixture
def two_of_ppo(tmp_path, monkeypatch):
    """Let two trials of PPO be the published ones: 10 ms and 20 ms per step, 5 s and 15 s beside them."""
    table = tables.read(published.folder()).trials
    rows = table[(table["algo"] == "ppo") & (table["status"] == "finished")].head(2)
    rows = rows.assign(steps=[1000, 4000], training_s=[10.0, 80.0], total_s=[15.0, 95.0])
    for name in (tables.TRIALS, tables.CURVES):
        shutil.copy(published.folder() / name, tmp_path / name)
    rows.to_csv(tmp_path / tables.TRIALS, index=False)
    monkeypatch.setattr(published, "folder", lambda: tmp_path)


@pytest.mark.usefixtures("two_of_ppo")
def test_before_the_first_trial_the_published_ones_tell_how_long(tmp_path):
    # 2000 steps of 15 ms each, and 10 s beside them.
    whole = expected.by_published([("ppo", 2000)] * 4, 2)
    assert whole == Expected(pytest.approx(2 * (30 + 10)), published=True)
    assert expected.by_published([("ppo", 1000)] * 4, 2).seconds == pytest.approx(2 * (15 + 10))
    # A trial cannot be split.
    assert expected.by_published([("ppo", 2000)], 16).seconds == pytest.approx(30 + 10)
    assert expected.by_published([("ppo", 64), ("mine:LongPPO", 64)], 2) is None
    config = resolve("ppo", "pp", steps=64)
    no_trials = tmp_path / "runs"
    assert expected.trials([config], no_trials, 1) == expected.by_published([("ppo", config.steps)], 1)


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (Expected(7200.0, published=True), "about 2 h 0 min as in the published trials"),
        (Expected(600.0), "about 10 min"),
        (None, "no record tells how long"),
    ],
)
def test_the_line_says_whose_time_it_is(capsys, told, said):
    with sweep_output.SweepBars() as bars:
        bars.started(2, 0, told)
    assert capsys.readouterr().err.splitlines()[0] == f"2 trials to run, 0 finished already, {said}"
