"""The small record of a comparison: two tables from which the leaderboard and every figure are made.

`trials.csv` has one row per trial, finished or not. `curves.csv` has the means over episodes of the finished
ones, one row per kind of episode and training step: evaluations at every evaluation point, with sampled
actions ("drawn" in the table) and with greedy ones, and training in fiftieths of the budget. `trained` is how
many steps the agent had learned from by then: whole rollouts. Both open with `pandas.read_csv`.
"""

import json
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd

from usbench.atomic import atomic_file
from usbench.records import TrialConfig
from usbench.records.journal import UNREADABLE
from usbench.records.trial import Status
from usbench.tasks import rows
from usbench.words import in_one_line

TRIALS, CURVES = "trials.csv", "curves.csv"
ORDER = ["task", "noise", "algo", "configuration", "seed"]
MISSING = "missing"
STATUSES = (*get_args(Status), MISSING)
TRAINING, SAMPLED, GREEDY = "training", "drawn", "greedy"
TRAINING_PARTS = 50
DECIMALS = 5

TRIAL_COLUMNS: Mapping[str, type] = {
    "trial": str,
    "task": str,
    "noise": float,
    "algo": str,
    "seed": int,
    "steps": int,
    "configuration": str,
    "status": str,
    "reason": str,
    "settings": str,
    "optimal": float,
    "random": float,
    "stay": float,
    "training_s": float,
    "total_s": float,
    "versions": str,
    "frames": str,
}
MEANS = (
    "return",
    "normalized_score",
    "final_distance_mm",
    "abs_sin_angle",
    "plane_error_deg",
    "success_rate",
    "reached_rate",
    "steps_to_goal",
)
CURVE_COLUMNS: Mapping[str, type] = {
    "trial": str,
    "kind": str,
    "step": int,
    "episodes": int,
    "trained": int,
    **dict.fromkeys(MEANS, float),
}


@dataclass(frozen=True)
class Results:
    """The two tables, with the columns TRIAL_COLUMNS and CURVE_COLUMNS."""

    trials: pd.DataFrame
    curves: pd.DataFrame

    def of(self, trials: pd.DataFrame) -> "Results":
        """Return the results of some of its trials alone, which are rows of its table."""
        return Results(trials, self.curves[self.curves["trial"].isin(trials["trial"])])


def write(results: Results, folder: Path) -> list[Path]:
    """Write the two tables into `folder`, made if need be, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    # Last what says that both are there.
    for name, table in ((CURVES, results.curves), (TRIALS, results.trials)):
        with atomic_file(folder / name) as file:
            file.write(table.to_csv(index=False, lineterminator="\n").encode())
    return [folder / TRIALS, folder / CURVES]


def read(folder: Path) -> Results:
    """Read what `write` wrote.

    Raises:
        FileNotFoundError: If `folder` does not hold the two tables.
        ValueError: If a table lacks a column or holds something else than it should, as a trial twice, or the
            curves lack the greedy evaluations of a finished trial.
    """
    results = Results(_read(folder / TRIALS, TRIAL_COLUMNS), _read(folder / CURVES, CURVE_COLUMNS))
    for name in results.trials.loc[results.trials["trial"].duplicated(), "trial"]:
        raise ValueError(f"{folder / TRIALS} is not a table of results: {name} is there twice.")
    evaluated = set(results.curves.loc[results.curves["kind"] == GREEDY, "trial"])
    for trial in results.trials.itertuples():
        if reason := _misfit(trial.task, trial.status, trial.settings):
            raise ValueError(f"{folder / TRIALS} is not a table of results: {trial.trial} has {reason}.")
        if trial.status == "finished" and trial.trial not in evaluated:
            raise ValueError(
                f"{folder / CURVES} does not belong to {TRIALS} beside it: {trial.trial} is finished, but "
                "has no greedy evaluation there."
            )
    return results


def _misfit(task: str, status: str, settings: str) -> str:
    """Return which of these a trial cannot have, in words; "" if it can have all."""
    if task not in rows():
        return f"the task {task!r}, which no installed package brings"
    if status not in STATUSES:
        return f"the status {status!r}, not one of {', '.join(STATUSES)}"
    try:
        n_frames(settings), senses(settings)
    except (*UNREADABLE, AttributeError, TypeError):
        return f"settings that no trial has, {reprlib.repr(settings)}"
    return ""


def _read(path: Path, columns: Mapping[str, type]) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype=str, keep_default_na=False)
        return typed(table[list(columns)], columns)
    except FileNotFoundError:
        raise FileNotFoundError(
            f"there is no {path.name} in {str(path.parent)!r}: usbench compare writes it there."
        ) from None
    except (KeyError, ValueError) as error:
        reason = in_one_line(error)
        raise ValueError(f"{path} is not a table of results: {reason}") from error


def typed(table: pd.DataFrame, columns: Mapping[str, type]) -> pd.DataFrame:
    """Return the table with the type of each column, whether it holds values or their text."""
    typed = table.reset_index(drop=True).replace({"": np.nan}) if len(table) else table
    for name, kind in columns.items():
        values = typed[name].fillna("") if kind is str else typed[name]
        typed = typed.assign(**{name: values.astype(kind)})
    # A noise is no measurement: it belongs to the name of a cell.
    return typed.round({name: DECIMALS for name in columns if name != "noise"})


def n_frames(settings: str) -> int:
    """Return how many frames one observation has, from the settings of a trial."""
    return int(json.loads(settings).get("n_frames", TrialConfig.n_frames))


def senses(settings: str) -> tuple[str, ...]:
    """Return what the agent is told beside the frames, from the settings of a trial."""
    return tuple(json.loads(settings).get("senses", "").split())
