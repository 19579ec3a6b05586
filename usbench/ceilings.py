"""The largest scores that what an agent is told allows, as `make ceilings` found them."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from functools import cache
from importlib.resources import files

from usbench.tasks import row_of
from usbench.words import network_apart

TABLE = "ceilings.csv"
# Tasks with the poses, starts and phantoms for which the table was made.
TASKS = ("fp-random", "pp-random", "pp-tracked", "exam-random", "exam-tracked")
ACTIONS = "actions"
# Algorithms of this package that learn from knowledge of the simulator, and are not ranked, with what is said
# of them.
TAUGHT = {"distilled": "practical ceiling, not ranked", "belief": "classical, not ranked"}


def ceiling(task: str, senses: Iterable[str] | None = None, noise: float = 0.0) -> float | None:
    """Return the best score of any policy that is told `senses`; None where it is not known.

    Without `senses`, of what the task tells by default.

    It is that of ideal eyes and a perfect memory, which knows its own actions. Agents that see a few frames
    have less.
    """
    if task not in TASKS:
        return None
    told = row_of(task).senses if senses is None else senses
    return _table().get((task, frozenset(told) - {ACTIONS}, float(noise)))


def bound(task: str, senses: Iterable[str] | None = None, noise: float = 0.0) -> float | None:
    """Return a score that no policy exceeds that is told `senses`; None where none is known.

    It is the ceiling where that is known, else the least ceiling of those who are told all this and more:
    whoever is told less cannot score more.
    """
    if task not in TASKS:
        return None
    told = frozenset(row_of(task).senses if senses is None else senses) - {ACTIONS}
    more = [
        score
        for (name, known, at), score in _table().items()
        if (name, at) == (task, float(noise)) and told <= known
    ]
    return min(more, default=None)


def taught(algo: str) -> str:
    """Return what is said of an algorithm ("name", "name+network") that is not ranked; "" of one that is."""
    return TAUGHT.get(network_apart(algo)[0], "")


@cache
def _table() -> dict[tuple[str, frozenset[str], float], float]:
    """Return the scores of policies that remember all, by task, what they are told, and noise."""
    with (files("usbench") / TABLE).open(encoding="utf-8") as file:
        return {
            (task, frozenset(row["senses"].split()), float(row["noise"])): float(row["ideal_eyes"])
            for row in csv.DictReader(file)
            if row["n_frames"] == "all"
            for task in row["tasks"].split()
        }
