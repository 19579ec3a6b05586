"""What stands in the terminal when a trial has ended."""

import dataclasses
import errno
import io
import json
import logging
import re
import shlex
import sys

import pytest

from usbench import cli, records
from usbench.cli.output import trial_bars, trial_output
from usbench.trials import runner
from usbench.trials.configuration import resolve


@pytest.mark.parametrize(("task", "shown"), [
    ("pp", ["agent", "return", "normalised\nscore", "final\ndistance", "plane\nerror", "success\nrate"]),
    ("fp", ["agent", "return", "normalised\nscore", "final\ndistance", "success\nrate"]),
    ("setup", ["agent", "return", "normalised\nscore", "success\nrate"]),
])  # fmt: skip
def test_trial_table_has_the_columns_that_say_something_of_the_task(quick, trial_on, task, shown):
    table = trial_output.trial_table(trial_on(task))
    assert [column.header for column in table.columns] == shown
    names = ["vpg, sampled", "vpg, greedy", "random", "optimal"]
    assert list(table.columns[0].cells) == names
    assert list(table.columns[2].cells)[2:] == ["0.00", "1.00"]


@pytest.mark.parametrize(("distance", "shown"), [(0.449, "0.4 mm"), (0.45001, "0.5 mm"), (-0.04, "0.0 mm")])
def test_numbers_are_rounded_once_and_never_minus_zero(quick, trial_on, monkeypatch, distance, shown):
    folder, means = trial_on("fp"), records.means
    monkeypatch.setattr(records, "means", lambda rows: {**means(rows), "final_distance_mm": distance})
    table = trial_output.trial_table(folder)
    assert list(table.columns[3].cells)[:2] == [shown, shown]


@pytest.mark.parametrize("width", ["80", "40"])
def test_a_long_name_folds_and_numbers_stay_whole(quick, tmp_path, monkeypatch, capsys, width):
    name = "ProximalPolicyOptimizationWithAnotherNetwork"
    (tmp_path / "folding.py").write_text(f"from stable_baselines3 import PPO\nclass {name}(PPO):\n    pass\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", width)
    try:
        argv = ["run", "--algo", f"folding:{name}", "--task", "pp", "--steps", "512", "--quiet"]
        assert cli.main(argv) == 0
    finally:
        sys.modules.pop("folding", None)
    out = capsys.readouterr().out
    assert "…" not in out
    # Five numbers in each of the four rows.
    assert len(re.findall(r"-?\d+\.\d\d │ +-?\d\.\d\d │ +\d+\.\d mm │ +\d+\.\d deg │ +\d+%", out)) == 4
    told = out.partition("trial folder:")[0]
    assert max(map(len, told.splitlines())) <= max(int(width), trial_output.NARROWEST)
    words = " ".join(told.split())
    assert "success rate: share of the episodes whose last pose is the goal" in words
    assert "Nothing was learned in 512 steps: the first update comes after 2048 (n_steps)." in words
    # The guide runs no code of a trial's algorithm.
    assert out.splitlines()[-1].strip().startswith("usbench report ")


def test_exploration_is_no_row_of_scores(quick, tmp_path):
    folder = runner.run_trial(resolve("dqn", "pp", steps=32), tmp_path).folder
    assert list(trial_output.trial_table(folder).columns[0].cells) == ["dqn, greedy", "random", "optimal"]
    assert trial_output.legend(folder)[-1].startswith("dqn samples actions only to explore")


@pytest.mark.parametrize(("algo", "steps", "said"), [
    ("vpg", 128, ""),
    ("vpg", 63, "Nothing was learned in 63 steps: the first update comes after 64 (n_steps)."),
    ("stable_baselines3:PPO", 512,
     "Nothing was learned in 512 steps: the first update comes after 2048 (n_steps)."),
    ("stable_baselines3:PPO", 4096, ""),
    ("stable_baselines3:DQN", 100, "Nothing was learned in 100 steps: learning starts after 100."),
    ("vpg", 100, "The last 36 of 100 steps were not learned from: an update takes 64."),
    ("dqn", 500, "Nothing was learned in 500 steps: learning starts after 500."),
    ("dqn", 508, ""),
    ("stay", None, ""),
])  # fmt: skip
def test_steps_that_are_not_learned_from_are_told(algo, steps, said):
    config = resolve(algo, "pp", steps=steps)
    assert trial_output.not_learned(config) == said


def test_a_class_of_another_module_collects_its_steps_in_every_environment():
    config = resolve("stable_baselines3:PPO", "pp", steps=16_064, n_envs=8)
    assert trial_output.not_learned(config).endswith("the first update comes after 16384 (n_steps).")


def test_hyperparameters_count_the_steps_of_all_environments():
    config = resolve("stable_baselines3:PPO", "pp", steps=128, n_envs=4)
    config = dataclasses.replace(config, hyperparameters={"n_steps": 64})  # of an `Entry` elsewhere
    assert trial_output.not_learned(config) == ""


def test_a_line_in_a_pipe_says_how_long_the_training_goes_on(monkeypatch, capsys):
    clock = iter([100.0, 130.0, 400.0])
    monkeypatch.setattr(trial_bars.time, "monotonic", lambda: next(clock))
    bars = trial_bars.Bars()
    bars.evaluated(0, -19.9, 0.05)
    bars.training(16, 1016, -19.0, 0.1)  # at 100 s
    bars.training(116, 1016, -18.0, 0.2)
    bars.evaluated(116, -18.0, 0.2)  # at 130 s: 100 steps in 30 s, 900 to go
    bars.training(1016, 1016, -5.0, 0.9)
    bars.evaluated(1016, -5.0, 0.9)
    first, second, last = capsys.readouterr().err.splitlines()
    assert first.endswith("score 0.05") and last.endswith("score 0.90")
    assert second.endswith("score 0.20, about 4 min to go")


@pytest.mark.parametrize("error", [OSError(errno.EIO, "gone"), BrokenPipeError(errno.EPIPE, "gone")])
def test_progress_that_cannot_be_written_ends_no_training(monkeypatch, error):
    class Closed(io.StringIO):
        def isatty(self):
            return True

        def write(self, _):
            raise error

    monkeypatch.setattr(sys, "stderr", Closed())
    bars = trial_bars.Bars()
    bars.frames(1, 2)
    bars.training(16, 1016, -19.0, 0.1)
    bars.evaluated(16, -18.0, 0.2)
    bars.stopping()
    bars.close()
    with cli._telling(quiet=False):
        logging.getLogger("usbench.waiting").info("Simulating 16 frames: some seconds.")


def test_how_long_it_will_take_stands_before_the_training(quick, tmp_path, capsys):
    argv = ["run", "--algo", "dqn", "--task", "pp", "--steps", "160", "--out", str(tmp_path)]
    assert cli.main(argv) == 0
    told = capsys.readouterr().err
    some = r"(about \d+ (s|min)|less than 10 s)"
    expected = re.search(rf"evaluations: {some} \({some} of CPU time\), estimated", told)
    assert told.index("160 training steps") < expected.start() < told.index("step 0: evaluation return")


def test_a_trial_ends_with_the_next_two_commands(finished, capsys):
    trial_output.print_trial(finished, {})
    *_, first, second = capsys.readouterr().out.splitlines()
    assert first.split(None, 1) == ["next:", f"usbench watch {finished}"]
    assert second.strip() == f"usbench guide {finished}"
    spaced = finished.parent / "my trial"
    finished.rename(spaced)
    trial_output.print_trial(spaced, {})
    for line in capsys.readouterr().out.splitlines()[-2:]:
        assert shlex.split(line)[-1] == str(spaced)


def test_what_the_guide_would_refuse_is_shown_in_a_report(quick, tmp_path, capsys):
    folder = runner.run_trial(resolve("random", "pp"), tmp_path).folder
    trial_output.print_trial(folder, {})
    assert capsys.readouterr().out.splitlines()[-1].strip() == f"usbench report {folder}"


def test_the_set_of_training_phantoms_is_told_before_and_after(quick, tmp_path, capsys):
    argv = ["run", "--algo", "vpg", "--task", "pp-random", "--n-phantoms", "3", "--steps", "64"]
    assert cli.main([*argv, "--out", str(tmp_path)]) == 0
    (record,) = tmp_path.glob("*/trial.json")
    phantoms = json.loads(record.read_text())["config"]["environment"]["phantoms"]
    words = f"3 training phantoms (set {phantoms['digest']})"
    captured = capsys.readouterr()
    assert f"64 training steps on {words};" in captured.err
    assert f"Trained on {words}; none of them is in the evaluation." in " ".join(captured.out.split())
