"""Trials read from a folder, and the episodes of all of them as one table."""

from pathlib import Path
from typing import Literal

import pandas as pd

from usbench.records.folder import EPISODES, EVALUATIONS, existing, trial_folders
from usbench.records.trial import NUMBERS, TO_GOAL, Trial

# What of a trial's configuration each row of a table tells.
CELL = ("task", "noise", "algo", "seed")


def load_trial(folder: str | Path) -> Trial:
    """Return the trial in `folder`; errors are those of `Trial.read`."""
    return Trial.read(Path(folder))


def load_trials(runs: str | Path = "runs") -> list[Trial]:
    """Return the trials in `runs`, a folder of them or a trial itself; earlier attempts are left out.

    Raises:
        FileNotFoundError: If there is no such folder.
        ValueError: If a record is damaged.
    """
    folders = trial_folders(existing(Path(runs)))
    return [trial for folder in folders if (trial := Trial.find(folder)) is not None]


def load(
    runs: str | Path = "runs", table: Literal["evaluations", "episodes"] = "evaluations"
) -> pd.DataFrame:
    """Read the episodes of every trial in `runs` into one table, one row per episode.

    Columns of the trial (`trial`, `task`, `noise`, `algo`, `seed`, `status`) come first, then the record's
    own keys, then `normalized_score`: (return - random) / (optimal - random). Without episodes there are the
    columns that every trial has, and no row.

    Raises:
        ValueError: If `table` is unknown or a record is damaged.
        FileNotFoundError: If `runs` does not exist.
    """
    if table not in ("evaluations", "episodes"):
        raise ValueError(f"table must be one of evaluations, episodes, not {table!r}.")
    parts = []
    for trial in load_trials(runs):
        rows = trial.evaluations() if table == "evaluations" else trial.episodes()
        if rows.empty:
            continue
        cell = {key: getattr(trial.config, key) for key in CELL}
        ahead = {"trial": trial.name, **cell, "status": trial.status}
        rows = rows.drop(columns=ahead.keys(), errors="ignore")
        for column, value in reversed(ahead.items()):
            rows.insert(0, column, value)
        parts.append(rows)
    if not parts:
        own = NUMBERS[EVALUATIONS if table == "evaluations" else EPISODES]
        return pd.DataFrame(columns=["trial", *CELL, "status", *own, TO_GOAL, "normalized_score"])
    return pd.concat(parts, ignore_index=True)
