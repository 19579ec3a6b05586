"""The largest scores that what an agent is told allows, as `make ceilings` found them."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from functools import cache
from importlib.resources import files

TABLE = "ceilings.csv"
# Tasks with the poses, starts and phantoms for which the table was made.
TASKS = ("pp-random", "pp-tracked")
ACTIONS = "actions"


def ceiling(task: str, senses: Iterable[str]) -> float | None:
    """Return the best score of any policy that is told `senses`, without noise; None where it is not known.

    It is that of ideal eyes and a perfect memory, which knows its own actions. Agents that see a few frames
    have less.
    """
    if task not in TASKS:
        return None
    return _table().get(frozenset(senses) - {ACTIONS})


@cache
def _table() -> dict[frozenset[str], float]:
    """Return the scores of policies that remember all, by what they are told."""
    with (files("usbench") / TABLE).open(encoding="utf-8") as file:
        return {
            frozenset(row["senses"].split()): float(row["ideal_eyes"])
            for row in csv.DictReader(file)
            if row["n_frames"] == "all"
        }
