"""The table of agents that learn on new phantoms in every episode, with the budget that this takes.

It is not of the protocol, which was written before there were such tasks with a budget of their own: those
have 100 000 steps (docs/tasks.md), where the grid gives `fp-random` and `pp-random` 16 064.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from usbench.agents.hyperparameters import as_set
from usbench.ceilings import bound, ceiling
from usbench.records import TrialConfig
from usbench.results import tables, text
from usbench.results.agents import changed_hyperparameters, has_envs
from usbench.tasks import row_of

NAME = "unseen-phantoms"
STEPS = 100_000
ABOUT = (
    "Agents that learn on new phantoms in every episode and are tested on unseen phantoms: with any "
    "number of steps on tasks whose budget is 100 000, and with more than the task's budget on "
    "`fp-random` and `pp-random`. Agents may see any number of frames, and may be told what their task tells "
    "and their own last actions: the tables of the cells say what each learned with, and the ceiling, the "
    "score of the best policy that is told the same and remembers everything (≤: that of a policy that is "
    "told more). Never averaged with the grid; not of the protocol."
)
COLUMNS = ("ceiling", "learned with")
NOTHING = "nothing"


def has(task: str, steps: int) -> bool:
    """Return whether a trial is of this table.

    All are on tasks whose budget is the table's, and those on other tasks with new phantoms that had more
    steps than their task's budget.
    """
    row = row_of(task)
    return row.phantoms > 0 and (row.steps >= STEPS or steps > row.steps)


def columns(row: Mapping[str, Any], settings: Mapping[str, str]) -> list[str]:
    """Return `COLUMNS` of a row of scores in words, by the settings of each configuration.

    An agent that does not learn is not told anything through its observations, so that it has dashes.
    """
    if row["steps"] == 0:
        return [text.DASH] * len(COLUMNS)
    own = settings[row["configuration"]]
    senses = tables.senses(own)
    return [
        _ceiling(row["task"], senses, row["noise"]),
        f"told {', '.join(senses) or NOTHING}; {text.frames(tables.n_frames(own))}; {row['steps']} steps",
    ]


def _ceiling(task: str, senses: Iterable[str], noise: float) -> str:
    """Return the ceiling in words: exact, or as a bound; a dash where neither is known."""
    exact, most = ceiling(task, senses, noise), bound(task, senses, noise)
    if exact is not None:
        return text.number(exact, 3)
    return text.DASH if most is None else f"≤ {text.number(most, 3)}"


def commands(trials: pd.DataFrame) -> list[str]:
    """Return the commands that make single trials, as those of this table, those that differ in seeds as one.

    Trials with another number of environments, or of versions with other hyperparameters, are left out.
    """
    own = trials[trials["steps"] > 0]
    can_be_told = (
        has_envs(one) and None not in changed_hyperparameters(one).values() for _, one in own.iterrows()
    )
    own = own[pd.Series(can_be_told, index=own.index, dtype=bool)]
    cells = ["task", "noise", "algo", "steps", "settings"]
    return [_command(rows.iloc[0], rows["seed"]) for _, rows in own.groupby(cells)]


def _command(trial: pd.Series, seeds: Iterable[int]) -> str:
    """Return the command that makes the trials of some seeds, `trial` one of them."""
    task, settings = trial["task"], trial["settings"]
    options = f" --noise {text.exact(trial['noise'])}" if trial["noise"] else ""
    told, frames = tables.senses(settings), tables.n_frames(settings)
    if frames != TrialConfig.n_frames:
        options += f" --n-frames {frames}"
    if told != row_of(task).senses:
        options += f" --senses {' '.join(told)}".rstrip()
    if changed := changed_hyperparameters(trial):
        options += f" --set {' '.join(as_set(changed))}"
    command = f"usbench run --algo {trial['algo']} --task {task} --steps {trial['steps']}{options} --seed"
    first, *others = map(str, sorted(seeds))
    return (
        f"for seed in {' '.join([first, *others])}; do {command} $seed; done"
        if others
        else f"{command} {first}"
    )
