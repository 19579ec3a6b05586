"""Time is CPU time, and evaluations are no part of training, also after a kill."""

import time

import pytest
import trials
from state_files import read_state

from usbench.trials import runner, stopwatch
from usbench.trials.evaluation import Evaluator


@pytest.fixture
def hundred(monkeypatch):
    """A clock that stands still, but for 100 s in whatever plays evaluation episodes."""
    clock, play = [0.0], Evaluator.play
    monkeypatch.setattr(time, "process_time", lambda: clock[0])

    def slow(self, *args, **kwargs):
        clock[0] += 100.0
        return play(self, *args, **kwargs)

    monkeypatch.setattr(Evaluator, "play", slow)


def test_evaluations_are_no_training_before_and_after_a_kill(hundred, often, tmp_path):
    whole = runner.run_trial(trials.config("vpg"), tmp_path / "whole").folder
    # Three evaluation points, with sampled and greedy actions each; both reference policies once.
    wanted = {"training_s": 0, "evaluation_s": 600, "total_s": 800}
    found = read_state(whole)["timings"]
    assert {name: found[name] for name in wanted} == wanted
    folder = trials.ended(tmp_path / "killed")
    trials.go_on(folder)
    found = read_state(folder)["timings"]
    assert {name: found[name] for name in wanted} == wanted


def test_a_stopwatch_counts_cpu_seconds_and_no_others(monkeypatch):
    cpu, wall = [0.0], [0.0]
    monkeypatch.setattr(time, "process_time", lambda: cpu[0])
    for name in ("perf_counter", "monotonic", "time"):
        monkeypatch.setattr(time, name, lambda: wall[0])
    watch = stopwatch.Stopwatch()
    with watch.timed("a"):
        cpu[0], wall[0] = 2.0, 50.0
        assert watch.seconds() == {"a": 2.0}
    assert watch.seconds() == {"a": 2.0}
