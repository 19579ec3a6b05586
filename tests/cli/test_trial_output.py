"""What stands in the terminal when a trial has ended."""

import pytest

from usbench.cli.output import trial_output
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


@pytest.mark.parametrize(("algo", "steps", "said"), [
    ("vpg", 128, ""),
    ("vpg", 100, "The last 36 of 100 steps were not learned from: an update takes 64."),
    ("dqn", 500, "Nothing was learned in 500 steps: learning starts after 500."),
    ("dqn", 508, ""),
    ("stay", None, ""),
])  # fmt: skip
def test_steps_that_are_not_learned_from_are_told(algo, steps, said):
    config = resolve(algo, "pp", steps=steps)
    assert trial_output.not_learned(config) == said
