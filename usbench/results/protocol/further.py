"""The tables apart from the grid: other frames, another network, a longer training, unseen phantoms.

What a trial is of follows from its settings alone, so that trials of all tables may lie in one folder.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import pandas as pd

from usbench import seed_pools
from usbench.records import TrialConfig
from usbench.results import text
from usbench.results.protocol import unseen
from usbench.results.tables import Results, n_frames
from usbench.tasks import row_of
from usbench.words import network_apart

GRID = "grid"


class _Table(NamedTuple):
    """What the trials of a table have in common."""

    n_frames: int
    network: str
    budgets: int
    tasks: frozenset[str]
    noises: frozenset[float]


def split(known: Results) -> dict[str, Results]:
    """Return the results of each table that has any, by its name: the grid first, then the further tables."""
    found = tables_of(known.trials)
    return (
        {name: known.of(trials) for name, trials in found.items()}
        if len(found) > 1
        else dict.fromkeys(found, known)
    )


def tables_of(trials: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the trials of each table that has any, by its name: the grid first, then the further tables.

    Whatever is of no further table is of the grid. A reference policy has neither network nor budget, so that
    it is in every table with its frames and its cell, and not in the grid where only a further table has
    learners in its cell. On tasks whose trials are all of `unseen`, it is there alone.
    """
    learned = trials["steps"] > 0
    of = pd.Series([_table_of(row) for row in trials.to_dict("records")], index=trials.index, dtype=object)
    names = set(of[learned]) | ({unseen.NAME} & set(of))
    if len(names) < 2:
        return {next(iter(names), GRID): trials}
    cells = pd.Series(list(zip(trials["task"], trials["noise"], strict=True)), index=trials.index)
    frames = trials["settings"].map(n_frames)
    elsewhere = set(cells[learned & (of != GRID)]) - set(cells[learned & (of == GRID)])
    found = {GRID: trials[(of == GRID) & (learned | ~cells.isin(elsewhere))]} if GRID in names else {}
    for name, wanted in _frames_of_references().items():
        if name in names:
            own = of == name
            beside = ~learned & (frames == wanted) & cells.isin(set(cells[own]))
            found[name] = trials[own | beside]
    return found


def first(known: Results) -> Results:
    """Return the results of the grid alone; where there are none, those of the first further table."""
    return next(iter(split(known).values()))


def names() -> tuple[str, ...]:
    """Return the names of the further tables that differ from the grid by more than their tasks."""
    return tuple(_frames_of_references())


def grid_cells() -> frozenset[tuple[str, float]]:
    """Return the cells of the grid, each a task and a noise."""
    known = _default()
    return frozenset((task, noise) for task in known.tasks for noise in known.noises)


def frames_of(task: str, noise: float) -> frozenset[int]:
    """Return how many frames one observation may have in a cell: as in the grid or a further table."""
    own = [table for table in _further().values() if task in table.tasks and noise in table.noises]
    return frozenset(table.n_frames for table in (_default(), *own))


def n_seeds(name: str) -> int:
    """Return with how many seeds a comparison trains each agent of a further table."""
    (seeds,) = (one["seeds"] for one in seed_pools.protocol()["comparison"]["extras"] if one["name"] == name)
    return int(seeds)


def describe(name: str) -> str:
    """Return in sentences how a further table differs from the grid."""
    if name == unseen.NAME:
        return unseen.ABOUT
    table, default = _further()[name], _default()
    parts = []
    if table.n_frames != default.n_frames:
        parts.append(f"{text.frames(table.n_frames)} in one observation in place of {default.n_frames}")
    if table.network:
        parts.append(f"the {table.network} network in place of the paper's")
    if table.budgets != 1:
        parts.append(f"{table.budgets} times the training steps")
    return f"As the grid, with {' and '.join(parts)}; never averaged with it."


def _table_of(trial: Mapping[str, Any]) -> str:
    """Return the name of the table that a trial is of."""
    if unseen.has(trial["task"], trial["steps"]):
        return unseen.NAME
    frames, network = n_frames(trial["settings"]), network_apart(trial["algo"])[1]
    if trial["steps"] == 0:
        elsewhere = frames in {table.n_frames for table in _further().values()} - {_default().n_frames}
        return "" if elsewhere else GRID
    what = (frames, network, trial["steps"] / row_of(trial["task"]).steps)
    for name, table in _further().items():
        if table[:3] == what and trial["task"] in table.tasks and trial["noise"] in table.noises:
            return name
    return GRID


def _frames_of_references() -> dict[str, int]:
    """Return the frames with which reference policies are in each further table; they look at none."""
    return {name: table.n_frames for name, table in _further().items()} | {unseen.NAME: _default().n_frames}


def _default() -> _Table:
    known = seed_pools.protocol()["comparison"]
    return _Table(TrialConfig.n_frames, "", 1, frozenset(known["tasks"]), frozenset(known["noises"]))


@cache
def _further() -> dict[str, _Table]:
    """Return the tables of the protocol whose trials differ from the grid's by more than their task."""
    default = _default()
    tables = {
        extra["name"]: _Table(
            extra.get("n_frames", default.n_frames),
            extra.get("network", default.network),
            extra.get("budgets", default.budgets),
            frozenset(extra.get("tasks", default.tasks)),
            frozenset(extra["noises"]),
        )
        for extra in seed_pools.protocol()["comparison"]["extras"]
    }
    return {name: table for name, table in tables.items() if table[:3] != default[:3]}
