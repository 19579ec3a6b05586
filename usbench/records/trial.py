"""A trial as its folder has it: written, read back, checked against one schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from annotated_types import Ge, Le
from pandas.api.types import is_numeric_dtype
from pydantic import ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from usbench.anchors import Anchors
from usbench.atomic import atomic_file
from usbench.ceilings import ceiling
from usbench.checks import misfit
from usbench.records.checksums import KEY, check, damaged, of_state
from usbench.records.configuration import LARGEST_COUNT, TrialConfig
from usbench.records.folder import EPISODES, EVALUATIONS, TRIAL, no_trial
from usbench.records.journal import UNREADABLE, read_rows, told

SCHEMA = 1
STRICT = ConfigDict(
    strict=True, allow_inf_nan=False, extra="ignore", validate_by_name=True, serialize_by_alias=True
)

# How a trial stands.
Status = Literal["running", "interrupted", "failed", "finished"]
Count = Annotated[int, Ge(0), Le(LARGEST_COUNT)]
Means = Mapping[str, float]
MEASURED = ("return", "final_distance_mm", "final_sin_angle", "is_success")
# Of each line of a record file; what reads the records computes with these.
NUMBERS = {
    EPISODES: ("step", *MEASURED),
    EVALUATIONS: ("step", *MEASURED, "checkpoint", "deterministic", "eval_episode"),
}
# Of each line too, though it need be no number: the goal may not have been reached.
TO_GOAL = "steps_to_goal"
# The hyperparameter of this package's value-based agents by which they explore.
EXPLORATION = "exploration_final_eps"
# None that leads elsewhere.
RecordFile = Annotated[str, StringConstraints(pattern=r"^(episodes|evaluations)\.jsonl$")]
# No markup: pages show it.
Version = Annotated[str, StringConstraints(pattern=r"^[\w.+!-]*$")]


@dataclass(frozen=True, config=STRICT)
class Frames:
    """What identifies the frames of a trial: a hash of all of them, and from how many poses they are."""

    digest: str
    poses: Count = 0


# The reason of a trial whose network has weights that are no numbers.
DIVERGED = "the training diverged: its network has weights that are no numbers; try a smaller learning rate"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Trial:
    """One trial as its `trial.json` tells it; the attributes are the keys of that file unless said otherwise.

    Attributes:
        folder: Where it is; not in the file.
        status: How it stands.
        reason: Why it ended before its end, in a sentence; None if it did not.
        config: Its configuration.
        anchors: The exact returns of its setting, from which scores follow.
        evaluation_points: Training steps at which the agent is evaluated; `checkpoints` in the file.
        n_evaluation_episodes: Episodes at each of them; `evaluation_episodes` in the file.
        references: Means over the evaluation episodes of the reference policies "random" and "optimal".
        timings: CPU seconds by name, `training_s` and `total_s` among them; wall time in earlier versions.
        frames: What identifies its frames; None before they are prepared.
        explores: Whether sampled actions of its agent are exploration, once it is finished.
        versions: Versions of Python and of packages, by name.
        platform: The machine in words.
        started: When it began, in ISO format.
        code: Checksum of the module of its algorithm's class; "" in trials of earlier versions.
        checksums: SHA-256 of its record files, by name, once it is finished.
    """

    folder: Path = Field(exclude=True)
    status: Status
    config: TrialConfig
    anchors: Anchors
    reason: str | None = None
    evaluation_points: tuple[Count, ...] = Field(
        default=(), validation_alias="checkpoints", serialization_alias="checkpoints"
    )
    n_evaluation_episodes: Count = Field(
        default=0, validation_alias="evaluation_episodes", serialization_alias="evaluation_episodes"
    )
    references: Mapping[str, Means] = Field(default_factory=dict)
    timings: Mapping[str, float] = Field(default_factory=dict)
    frames: Frames | None = None
    explores: bool = False
    versions: Mapping[Version, Version] = Field(default_factory=dict)
    platform: str = ""
    started: str = ""
    code: str = ""
    checksums: Mapping[RecordFile, str] = Field(default_factory=dict)

    @classmethod
    def find(cls, folder: Path) -> Trial | None:
        """Return the trial in `folder`, None if none has begun there.

        Raises:
            ValueError: If its `trial.json` is damaged, or not one that this version reads.
        """
        path = folder / TRIAL
        try:
            content = json.loads(path.read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            return None
        except UNREADABLE as error:
            raise ValueError(f"{path} is not a trial record: {told(error)}.") from error
        if not isinstance(content, dict):
            raise ValueError(
                f"{path} is not a trial record: it holds {type(content).__name__}, not an object."
            )
        if content.get("schema", SCHEMA) != SCHEMA:
            raise ValueError(f"{path} has schema {content['schema']!r}; this version reads schema {SCHEMA}.")
        # Trials of earlier versions have none.
        if content.pop(KEY, None) not in (None, of_state(content)):
            raise damaged(path)
        if "config" not in content:  # of a trial that was killed in its first moment
            return None
        try:
            return _ADAPTER.validate_json(json.dumps({**content, "folder": str(folder)}))
        except ValidationError as error:
            raise ValueError(f"{path} is not a trial record: {misfit(error)}.") from None

    @classmethod
    def read(cls, folder: Path) -> Trial:
        """Return the trial in `folder`; errors are those of `find`.

        Raises:
            ConfigurationError: If there is no trial.
        """
        trial = cls.find(folder)
        if trial is None:
            raise no_trial(folder)
        return trial

    def write(self) -> None:
        """Write `trial.json`, whole or not at all."""
        content = {"schema": SCHEMA, **json.loads(_ADAPTER.dump_json(self, fallback=str))}
        content[KEY] = of_state(content)
        with atomic_file(self.folder / TRIAL) as file:
            file.write(json.dumps(content, indent=2, sort_keys=True).encode() + b"\n")

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.folder.name

    @property
    def title(self) -> str:
        """Algorithm, task, noise and seed in words."""
        return self.config.title

    @property
    def samples_to_explore(self) -> bool:
        """Whether its agent's sampled actions are exploration, also where only a hyperparameter tells."""
        return self.explores or EXPLORATION in self.config.hyperparameters

    @property
    def ceiling(self) -> float | None:
        """Best score of any policy that is told what its agent is; None where it is not known."""
        config = self.config
        return ceiling(config.task, config.environment.get("senses", ()), config.noise)

    def episodes(self) -> pd.DataFrame:
        """Return its training episodes, one row each, with their `normalized_score`; empty if there are none.

        Raises:
            ValueError: If the file is damaged.
        """
        return self._table(EPISODES)

    def evaluations(self) -> pd.DataFrame:
        """Return the episodes of all its evaluations; else as `episodes`."""
        return self._table(EVALUATIONS)

    def last_evaluation(self, *, deterministic: bool) -> pd.DataFrame:
        """Return the episodes of the last evaluation, with greedy actions if `deterministic`, else sampled.

        Raises:
            ValueError: If the trial has no such evaluation, or their file is damaged.
        """
        rows = self.evaluations()
        if rows.empty:
            raise ValueError(f"{self.folder} has no evaluations.")
        last = rows[rows["checkpoint"] == rows["checkpoint"].max()]
        if deterministic not in set(last["deterministic"]):
            kind = "greedy" if deterministic else "sampled"
            raise ValueError(f"the last evaluation of {self.folder} has no episodes with {kind} actions.")
        return last[last["deterministic"] == deterministic]

    def final_score(self) -> float:
        """Return the mean score of the last evaluation with greedy actions.

        Raises:
            ValueError: If the trial has no such evaluation, or their file is damaged.
        """
        return float(self.last_evaluation(deterministic=True)["normalized_score"].mean())

    def _table(self, name: str) -> pd.DataFrame:
        check(self.folder, self.checksums)
        damaged = f"{self.folder / name} is damaged"
        try:
            rows = _frame(read_rows(self.folder / name))
        except OverflowError as error:
            raise ValueError(f"{damaged}: a line of it has a number beyond 64 bits.") from error
        if not len(rows):
            return rows
        for key in NUMBERS[name]:
            if key not in rows or not _are_numbers(rows[key]):
                raise ValueError(f"{damaged}: a line of it has no number {key!r}.")
        if (rows["final_sin_angle"].abs() > 1 + 1e-9).any():
            raise ValueError(f"{damaged}: a line of it has no 'final_sin_angle' in [-1, 1].")
        if TO_GOAL not in rows:
            raise ValueError(f"{damaged}: no line of it has {TO_GOAL!r}.")
        if not _are_numbers(rows[TO_GOAL].dropna().infer_objects()):
            raise ValueError(f"{damaged}: a line of it has a {TO_GOAL!r} that is neither a number nor null.")
        return rows.assign(normalized_score=self.anchors.score(rows["return"]))


class TrialError(RuntimeError):
    """A trial that broke off; the message says where its records are and why."""


def _frame(lines: list[dict[str, Any]]) -> pd.DataFrame:
    """Return lines as a table; OverflowError where a whole number is beyond 64 bits, in any pandas."""
    rows = pd.DataFrame(lines)
    for name in [name for name in rows if rows[name].dtype.kind == "O"]:
        if any(isinstance(value, int) and abs(value) >= 2**63 for value in rows[name]):
            raise OverflowError(name)
    return rows


def _are_numbers(values: pd.Series) -> bool:
    """Return whether all are finite numbers; so are none at all."""
    return values.empty or (is_numeric_dtype(values) and bool(np.isfinite(values).all()))


_ADAPTER = TypeAdapter(Trial)


def means(evaluations: pd.DataFrame) -> dict[str, float]:
    """Return the means over evaluation episodes: return, distance, angle between the planes, success.

    The object looks the same from both sides, so the angle is counted modulo 180 degrees.
    """
    error_deg = np.degrees(np.arcsin(np.abs(evaluations["final_sin_angle"])))
    return {
        "return": float(evaluations["return"].mean()),
        "final_distance_mm": float(evaluations["final_distance_mm"].mean()),
        "plane_error_deg": float(error_deg.mean()),
        "success_rate": float(evaluations["is_success"].mean()),
    }
