"""The small record of a comparison: two tables from which the leaderboard and every figure are made.

`trials.csv` has one row per trial, finished or not. `curves.csv` has the means over episodes of the finished
ones, one row per kind of episode and training step: evaluations at every evaluation point, with sampled
actions ("drawn" in the table) and with greedy ones, and training in fiftieths of the budget. `trained` is how
many steps the agent had learned from by then: whole rollouts. Both open with `pandas.read_csv`.
"""

import hashlib
import json
import reprlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd

from usbench import records
from usbench.atomic import atomic_file
from usbench.records import EXPLORATION, ConfigurationError, Trial, TrialConfig
from usbench.records.journal import UNREADABLE
from usbench.records.trial import Status
from usbench.tasks import check_installed, row_of
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


def collect(
    runs: Path,
    planned: Collection[TrialConfig] = (),
    damaged: Callable[[str], None] | None = None,
    names: Collection[str] | None = None,
) -> Results:
    """Read the trials in the folder `runs`.

    Args:
        runs: Folder of trial folders.
        planned: The trials that were asked for: only these count, and those without a record are rows of
            status "missing". Without it, every trial in the folder counts.
        damaged: Told, in a sentence, of each trial whose record is broken, or whose task is not installed,
            which is then left out. Without it, such a trial is an error.
        names: The folders that are read, where none is planned; None for all.

    Raises:
        ConfigurationError: If the task of a trial is not installed.
        FileNotFoundError: If there is no such folder.
        ValueError: If a record is broken, or two folders hold the same trial.
    """
    records.existing(runs)
    places: list[tuple[TrialConfig | None, Path]] = [(own, runs / own.folder_name) for own in _once(planned)]
    rows, finished, curves = [], {}, {}
    folders = [one for one in records.trial_folders(runs) if names is None or one.name in names]
    for config, folder in places or [(None, folder) for folder in folders]:
        try:
            trial = _found(folder)
        except ValueError as error:
            if damaged is None:
                raise
            damaged(str(error))
            continue
        if known := config or (trial and trial.config):
            rows.append(_row(known, trial))
        if trial and trial.status == "finished":
            finished[trial.name] = trial
    trials = pd.DataFrame(rows, columns=list(TRIAL_COLUMNS))
    twice = trials[trials.duplicated(["configuration", "seed"], keep=False)]
    if not twice.empty:
        raise ValueError(f"{' and '.join(twice['trial'].head(2))} are the same trial: remove one of them.")
    trials = trials.sort_values(ORDER, ignore_index=True)
    for name in [name for name in trials["trial"] if name in finished]:
        try:
            curves[name] = _curves(finished[name])
        except ValueError as error:
            if damaged is None:
                raise
            damaged(str(error))
            trials = trials[trials["trial"] != name]
    found = list(curves.values())
    return Results(
        _typed(trials, TRIAL_COLUMNS),
        _typed(pd.concat(found) if found else pd.DataFrame(columns=list(CURVE_COLUMNS)), CURVE_COLUMNS),
    )


def _found(folder: Path) -> Trial | None:
    """Return the trial in `folder`, None if none has begun there.

    Raises:
        ConfigurationError: If its task is not installed.
        ValueError: If its record is broken.
    """
    trial = Trial.find(folder)
    if trial is not None:
        try:
            check_installed(trial.config.task)
        except ConfigurationError as error:
            raise ConfigurationError(f"the trial {str(folder)!r} cannot be shown: {error}") from error
    return trial


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
        ValueError: If a table lacks a column or holds something else than it should, or the curves lack the
            greedy evaluations of a finished trial.
    """
    results = Results(_read(folder / TRIALS, TRIAL_COLUMNS), _read(folder / CURVES, CURVE_COLUMNS))
    evaluated = set(results.curves.loc[results.curves["kind"] == GREEDY, "trial"])
    for trial in results.trials.itertuples():
        if reason := _misfit(trial.status, trial.settings):
            raise ValueError(f"{folder / TRIALS} is not a table of results: {trial.trial} has {reason}.")
        if trial.status == "finished" and trial.trial not in evaluated:
            raise ValueError(
                f"{folder / CURVES} does not belong to {TRIALS} beside it: {trial.trial} is finished, but "
                "has no greedy evaluation there."
            )
    return results


def _misfit(status: str, settings: str) -> str:
    """Return which of these a trial cannot have, in words; "" if it can have both."""
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
        return _typed(table[list(columns)], columns)
    except FileNotFoundError:
        raise FileNotFoundError(
            f"there is no {path.name} in {str(path.parent)!r}: usbench compare writes it there."
        ) from None
    except (KeyError, ValueError) as error:
        reason = in_one_line(error)
        raise ValueError(f"{path} is not a table of results: {reason}") from error


def _typed(table: pd.DataFrame, columns: Mapping[str, type]) -> pd.DataFrame:
    """Return the table with the type of each column, whether it holds values or their text."""
    typed = table.reset_index(drop=True).replace({"": np.nan}) if len(table) else table
    for name, kind in columns.items():
        values = typed[name].fillna("") if kind is str else typed[name]
        typed = typed.assign(**{name: values.astype(kind)})
    # A noise is no measurement: it belongs to the name of a cell.
    return typed.round({name: DECIMALS for name in columns if name != "noise"})


def _once(planned: Collection[TrialConfig]) -> list[TrialConfig]:
    return list({config.folder_name: config for config in planned}.values())


def _row(config: TrialConfig, trial: Trial | None) -> dict[str, Any]:
    """Return the row of a trial, None for one without a record; what is not known is NaN or empty."""
    plain = records.identity(asdict(config if trial is None else trial.config))
    anchors, timings, versions = (
        ({}, {}, {}) if trial is None else (asdict(trial.anchors), trial.timings, trial.versions)
    )
    return {
        "trial": config.folder_name if trial is None else trial.name,
        **{key: plain[key] for key in ("task", "noise", "algo", "seed", "steps")},
        "configuration": digest({key: value for key, value in plain.items() if key != "seed"}),
        "status": MISSING if trial is None else trial.status,
        "reason": " ".join(((trial.reason if trial else None) or "").split()),
        "settings": _settings(plain, explores=trial is not None and trial.explores),
        **{key: anchors.get(key, np.nan) for key in ("optimal", "random", "stay")},
        **{key: timings.get(key, np.nan) for key in ("training_s", "total_s")},
        "versions": ", ".join(f"{package} {versions[package]}" for package in sorted(versions)),
        "frames": trial.frames.digest[:16] if trial and trial.frames else "",
    }


def _settings(config: Mapping[str, Any], *, explores: bool) -> str:
    """Return what a configuration sets beside its cell, as flat JSON; the environment as a digest.

    What the agent is told is no part of that digest: agents that are told more meet the same environment.
    Senses stand there only where there are some, and that the agent explores only where no hyperparameter
    tells: settings that are known keep their text.
    """
    cell = ("task", "noise", "algo", "seed", "steps", "hyperparameters", "environment")
    flat = {key: value for key, value in config.items() if key not in cell}
    environment = dict(config.get("environment", {}))
    told = environment.pop("senses", ())
    # First: no hyperparameter hides what else was set.
    own = {key: value for key, value in config.get("hyperparameters", {}).items() if key != "senses"}
    flat = own | flat | {"environment": digest(environment)}
    if told:
        flat["senses"] = " ".join(told)
    if explores and EXPLORATION not in flat:
        flat["explores"] = True
    return json.dumps(flat, sort_keys=True, default=str)


def n_frames(settings: str) -> int:
    """Return how many frames one observation has, from the settings of a trial."""
    return int(json.loads(settings).get("n_frames", TrialConfig.n_frames))


def senses(settings: str) -> tuple[str, ...]:
    """Return what the agent is told beside the frames, from the settings of a trial."""
    return tuple(json.loads(settings).get("senses", "").split())


def digest(value: Mapping[str, Any]) -> str:
    """Return a short name of a configuration or a part of one."""
    canonical = json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(canonical.encode()).hexdigest()[:8]


def _curves(trial: Trial) -> pd.DataFrame:
    """Return the rows of a finished trial: every kind of episode, every step.

    Raises:
        ValueError: If the evaluation after the last step is not there, or its evaluations are out of order.
    """
    evaluations, steps = trial.evaluations(), trial.config.steps
    if evaluations.empty or evaluations["checkpoint"].max() != steps:
        raise ValueError(f"{trial.name} is finished, but its evaluation at step {steps} is missing.")
    if not trained_grows(evaluations):
        raise ValueError(f"{trial.folder} is damaged: the training steps of its evaluations do not grow.")
    kinds = evaluations["deterministic"].map({False: SAMPLED, True: GREEDY})
    longest = row_of(trial.config.task).n_steps
    parts = [_means(evaluations, kinds, evaluations["checkpoint"], evaluations["step"], longest)]
    episodes = trial.episodes()
    if not episodes.empty:
        part = -(-episodes["step"] * TRAINING_PARTS // steps)
        kinds, step = pd.Series(TRAINING, index=episodes.index), part * steps // TRAINING_PARTS
        parts.append(_means(episodes, kinds, step, step, longest))
    curves = pd.concat(parts, ignore_index=True)
    curves.insert(0, "trial", trial.name)
    return curves.sort_values(["kind", "step"])


def trained_grows(evaluations: pd.DataFrame) -> bool:
    """Return whether all episodes of an evaluation took place at one training step, later ones at later."""
    steps = evaluations.groupby("checkpoint")["step"].agg(["min", "max"])
    return bool((steps["min"] == steps["max"]).all() and (steps["min"].diff().dropna() > 0).all())


def _means(
    episodes: pd.DataFrame, kind: pd.Series, step: pd.Series, trained: pd.Series, longest: int
) -> pd.DataFrame:
    """Return the means over episodes of one kind and step.

    An episode that never reaches the goal counts with the `longest` there is in `steps_to_goal`: a mean over
    those that did would praise an agent that rarely does, and one that stops at once. The object looks the
    same from both sides, so that the angle is counted modulo 180 degrees.
    """
    sine = episodes["final_sin_angle"].abs()
    to_goal = episodes["steps_to_goal"].astype(float)
    values = pd.DataFrame(
        {
            "kind": kind,
            "step": step,
            "trained": trained,
            "return": episodes["return"],
            "normalized_score": episodes["normalized_score"],
            "final_distance_mm": episodes["final_distance_mm"],
            "abs_sin_angle": sine,
            "plane_error_deg": np.degrees(np.arcsin(sine)),
            "success_rate": episodes["is_success"].astype(float),
            "reached_rate": to_goal.notna().astype(float),
            "steps_to_goal": to_goal.fillna(longest),
        }
    )
    groups = values.groupby(["kind", "step"])
    means = groups.mean()
    means.insert(0, "episodes", groups.size())
    return means.reset_index()
