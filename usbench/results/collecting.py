"""Trials become tables: one row of a trial's settings and end, and the means over its episodes."""

import json
import reprlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from usbench import records
from usbench.records import EXPLORATION, ConfigurationError, Trial, TrialConfig
from usbench.records.configuration import digest
from usbench.results.tables import (
    CURVE_COLUMNS,
    GREEDY,
    MISSING,
    ORDER,
    SAMPLED,
    TRAINING,
    TRAINING_PARTS,
    TRIAL_COLUMNS,
    Results,
    typed,
)
from usbench.tasks import check_installed, row_of


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
            if known := config or (trial and trial.config):
                rows.append(_row(known, trial))
        except ValueError as error:
            if damaged is None:
                raise
            damaged(str(error))
            continue
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
        typed(trials, TRIAL_COLUMNS),
        typed(pd.concat(found) if found else pd.DataFrame(columns=list(CURVE_COLUMNS)), CURVE_COLUMNS),
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
    if not isinstance(told, list | tuple) or not all(isinstance(sense, str) for sense in told):
        raise ValueError(f"senses must be names, not {reprlib.repr(told)}.")
    # First: no hyperparameter hides what else was set.
    own = {key: value for key, value in config.get("hyperparameters", {}).items() if key != "senses"}
    flat = own | flat | {"environment": digest(environment)}
    if told:
        flat["senses"] = " ".join(told)
    if explores and EXPLORATION not in flat:
        flat["explores"] = True
    return json.dumps(flat, sort_keys=True, default=str)


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
