"""The search: defaults first, the same candidates after a kill, a table that says what was tried."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import pytest

from usbench import records, suite
from usbench.agents import zoo
from usbench.agents.hyperparameters import check
from usbench.agents.search_space import SPACES, Choice, Log
from usbench.cli.output import sweep_output
from usbench.compare import plan, search, sweep
from usbench.trials import runner
from usbench.trials.configuration import resolve


class Quiet:
    def frames(self, done, total):
        pass

    def started(self, n_missing, n_finished, expected_s):
        pass

    def ended(self, outcome):
        pass

    def retried(self, config):
        pass


class Stopping(Quiet):
    """Ctrl-C when so many trials have ended."""

    def __init__(self, n_trials):
        self.left = n_trials

    def ended(self, outcome):
        self.left -= 1
        if not self.left:
            raise KeyboardInterrupt


def settings(steps=32, **changes):
    values = {"noise": 0.25, "seeds": 1, "steps": steps, **changes}
    return search.settings_of(values.pop("algo", "a2c"), values.pop("tasks", ["pp"]), **values)


def run(out, n_candidates, progress=None, n_finalists=0, **changes):
    executor = {"executor": lambda: ThreadPoolExecutor(1)}
    return search.run(settings(**changes), n_candidates, out, progress or Quiet(), n_finalists, **executor)


def rows(path, part=0):
    text = path.read_text().split("\n## ")[part]
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    return [dict(zip(lines[0], line, strict=True)) for line in lines[2:]]


@pytest.mark.parametrize("algo", SPACES)
def test_space_holds_the_defaults_and_only_values_in_range(algo):
    defaults = zoo.hyperparameters(algo, "pp")
    for name, space in SPACES[algo].items():
        match space:
            case Log(low, high):
                assert check(name, low) == low < defaults[name] < high == check(name, high)
            case Choice(values):
                assert defaults[name] in values
                assert [check(name, value) for value in values] == list(values)


def test_every_algorithm_that_learns_has_a_space():
    assert set(SPACES) == {algo for algo, row in zoo.ZOO.items() if row.learns}


@pytest.mark.parametrize("algo", [algo for algo in SPACES if "batch_size" in SPACES[algo]])
def test_batches_divide_every_rollout_of_the_space(algo):
    rollouts = SPACES[algo].get("n_steps", Choice((max(SPACES[algo]["batch_size"].values),)))
    assert min(rollouts.values) % max(SPACES[algo]["batch_size"].values) == 0


def test_search_tries_the_defaults_first_and_ranks_what_it_tried(quick, tmp_path):
    path = run(tmp_path, 3)
    table = rows(path)
    assert sorted(row["candidate"] for row in table) == ["0", "1", "2"]
    scores = [float(row["score"]) for row in table]
    assert scores == sorted(scores, reverse=True)
    first = next(row for row in table if row["candidate"] == "0")
    assert float(first["gamma"]) == zoo.hyperparameters("a2c", "pp")["gamma"]
    trials = records.load(path.parent)
    assert set(trials["seed"]) == {1000} and set(trials["noise"]) == {0.25}
    assert trials["checkpoint"].max() == 32
    greedy = trials[trials["deterministic"] & (trials["checkpoint"] == 32)]
    best = greedy.groupby("trial")["normalized_score"].mean().max()
    assert scores[0] == pytest.approx(best, abs=5e-3)


def test_every_batch_is_counted_from_one(capsys):
    with sweep_output.SweepBars() as bars:
        for _ in range(2):
            bars.started(1, 0, None)
            bars.ended(sweep.Outcome(resolve("a2c", "pp", steps=32), None))
    counts = [line.split()[0] for line in capsys.readouterr().err.splitlines() if line.startswith("[")]
    assert counts == ["[1/1]", "[1/1]"]


def test_search_that_was_stopped_ends_as_one_that_was_not(quick, tmp_path):
    whole = run(tmp_path / "whole", 4)
    for n_trials in (1, 2):
        with pytest.raises(KeyboardInterrupt):
            run(tmp_path / "stopped", 4, Stopping(n_trials))
    again = run(tmp_path / "stopped", 4)
    assert again.read_bytes() == whole.read_bytes()
    assert len(rows(again)) == 4


def test_finalists_are_the_best_and_are_judged_on_both_tasks_with_other_seeds(quick, tmp_path, monkeypatch):
    short = {name: dataclasses.replace(suite.TASKS[name], steps=48) for name in suite.PAPER}
    monkeypatch.setattr(suite, "TASKS", {**suite.TASKS, **short})
    before = run(tmp_path, 3).read_text()
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, 3, Stopping(3), n_finalists=2)
    path = run(tmp_path, 3, n_finalists=2)
    assert path.read_text().startswith(before)
    table, finals = rows(path), rows(path, 1)
    assert {row["candidate"] for row in finals} == {row["candidate"] for row in table[:2]}
    assert float(finals[0]["score"]) >= float(finals[1]["score"])
    for row in finals:
        assert float(row["score"]) == pytest.approx((float(row["fp"]) + float(row["pp"])) / 2, abs=2e-3)
    trials = records.load(path.parent)
    again = trials[trials["seed"] >= search.FINAL_SEED]
    assert set(again["seed"]) == {1100, 1101} and set(again["task"]) == {"fp", "pp"}
    assert again["checkpoint"].max() == 48


def test_failed_candidate_is_in_the_table(quick, tmp_path, monkeypatch):
    real = runner.run_trial

    def broken(config, out):
        if config.hyperparameters["n_steps"] == 64:
            raise OSError(28, "No space left on device")
        return real(config, out)

    monkeypatch.setattr(runner, "run_trial", broken)
    table = rows(run(tmp_path, 3))
    failed = [row for row in table if row["score"] == "failed"]
    assert {row["n_steps"] for row in failed} == {"64"} and table[-1] in failed


def test_search_and_comparison_share_no_seed():
    configs = plan.plan(["a2c"], ["pp"], [0.0], 1000, 64)
    assert max(config.seed for config in configs) < search.FIRST_SEED


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"algo": "pop"}, "'ppo'"),
        ({"algo": "oracle"}, "search space"),
        ({"tasks": ["ppp"]}, "'pp'"),
        ({"noise": 2}, "noise.*2"),
        ({"seeds": 0}, "seeds.*0"),
        ({"steps": -1}, "steps.*-1"),
        ({"tasks": ["pp-random"]}, "must not choose hyperparameters: search on pp"),
    ],
)
def test_unusable_settings_are_refused(changes, said):
    with pytest.raises(records.ConfigurationError, match=said):
        settings(**changes)


def test_finalists_of_a_search_on_other_tasks_are_refused(tmp_path):
    with pytest.raises(records.ConfigurationError, match="no final of a search on exam"):
        run(tmp_path, 1, n_finalists=1, tasks=["exam"])
    assert not list(tmp_path.iterdir())


def test_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(records.ConfigurationError, match="choose another folder"):
        run(tmp_path / "file", 1)
