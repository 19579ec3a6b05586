"""What stands in the terminal while many trials run."""

import pytest

from usbench.cli.output import sweep_output
from usbench.compare.expected import Expected
from usbench.compare.sweep import Outcome
from usbench.trials.configuration import resolve


@pytest.fixture
def clock(monkeypatch):
    """Let the time be `clock.now`, in seconds."""

    class Clock:
        now = 0.0

    monkeypatch.setattr(sweep_output.time, "monotonic", lambda: Clock.now)
    return Clock


@pytest.mark.parametrize(
    ("told", "said"),
    [
        (
            Expected({"a": 7200.0}, 1, published=True),
            "1 trial to run, 3 finished already, about 2.0 h as in the",
        ),
        (Expected({"a": 600.0, "b": 600.0}, 2), "2 trials to run, 3 finished already, about 10 min"),
        (Expected({"a": 1.0}, 1, told=False), "1 trial to run, 3 finished already, no record tells how long"),
        (Expected({}, 1), "0 trials to run, 3 finished already"),
    ],
)
def test_the_first_line_says_how_long_and_whose_time_it_is(capsys, told, said):
    with sweep_output.SweepBars() as bars:
        bars.started(3, told)
    assert capsys.readouterr().err.startswith(said)


def test_lines_count_what_ended_and_say_how_long_it_goes_on(capsys, clock):
    stay, *learners = resolve("stay", "pp"), *(resolve("a2c", "pp", seed=n, steps=32) for n in (0, 1))
    seconds = {stay.folder_name: 0.0} | {config.folder_name: 600.0 for config in learners}
    with sweep_output.SweepBars() as bars:
        bars.started(0, Expected(seconds, 1))
        for clock.now, config in zip((5, 1205, 2400), (stay, *learners), strict=True):
            bars.ended(Outcome(config, None))
    lines = capsys.readouterr().err.splitlines()[1:]
    assert [line.split()[0] for line in lines] == ["[1/3]", "[2/3]", "[3/3]"]
    # After the reference it is what was expected; the first learner took twice as long.
    assert [line.partition("finished")[2] for line in lines] == [*[", about 20 min left"] * 2, ""]


def test_every_batch_is_counted_from_one(capsys):
    config = resolve("a2c", "pp", steps=32)
    with sweep_output.SweepBars() as bars:
        for _ in range(2):
            bars.started(0, Expected({config.folder_name: 60.0}, 1))
            bars.ended(Outcome(config, None))
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("[")]
    assert told == [f"[1/1] {config.title}: finished"] * 2


def test_a_search_says_which_candidates_go_on_and_whose_trial_has_ended(capsys):
    config = resolve("a2c", "pp", steps=32)
    with sweep_output.SweepBars() as bars:
        bars.rung(1, 2, {0: None, 1: None})
        bars.started(0, Expected({config.folder_name: 60.0}, 1))
        bars.ended(Outcome(config, None, "candidate 1"))
        bars.rung(2, 2, {1: 0.6789})
    first, _, ended, second = capsys.readouterr().err.splitlines()
    assert first == "rung 1 of 2: candidates 0, 1" and second == "rung 2 of 2: candidate 1 (0.679)"
    assert ended == f"[1/1] {config.title}, candidate 1: finished"


def test_a_damaged_trial_is_told_and_not_counted(capsys):
    config, damaged = resolve("stay", "pp"), resolve("random", "pp")
    with sweep_output.SweepBars() as bars:
        bars.started(0, Expected({config.folder_name: 0.0}, 1))
        bars.ended(Outcome(damaged, "trial.json is damaged"))
        bars.ended(Outcome(config, "no disk"))
    first, second, third = capsys.readouterr().err.splitlines()
    assert first.startswith("1 trial to run") and second == f"{damaged.title}: damaged"
    assert third == f"[1/1] {config.title}: failed"
