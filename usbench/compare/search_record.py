"""What a search has done, as one file of JSON lines per row: small, committed, and enough to go on from.

The first line says what was searched: protocol, space, candidates. Each further line is one trial that has
ended. Trials' own folders are not needed to go on.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from usbench import records
from usbench.agents.search_space import SPACES, candidates
from usbench.agents.zoo import hyperparameters
from usbench.compare.protocol import Protocol
from usbench.records import ConfigurationError, Trial, TrialConfig
from usbench.records.journal import append_all, cut_torn_line, read_rows
from usbench.records.lock import locked

# What a training that diverges fails with, the last as PyTorch's distributions say it; anything else is the
# machine's, or a defect.
DIVERGED = (records.DIVERGED, "FloatingPointError", "but found invalid values")
_FOLDER = "folder of the records"
# Of each trial, beside its place.
RECORDED = ("steps", "score", "training_s", "trial")


@dataclass(frozen=True)
class Place:
    """Which trial of a search: rung, candidate and cell."""

    rung: int
    candidate: int
    task: str
    noise: float
    seed: int


class SearchRecord:
    """The record of one row's search, on disk.

    Attributes:
        path: Its file.
        row: Name of the row.
        candidates: Their hyperparameters, as drawn.
        trials: The recorded trials by their place: `score` (None where training diverged), `training_s`.
    """

    def __init__(self, folder: Path, row: str, protocol: Protocol) -> None:
        """Open the record of `row` in `folder`, or begin it with the first trial.

        Raises:
            ConfigurationError: If it was begun under another protocol or with another search space.
            ValueError: If it is damaged.
        """
        self.path, self.row = folder / f"{row}.jsonl", row
        self.candidates = candidates(row, protocol.search.candidates)
        self._head = _head(row, protocol)
        self.trials = self._read()

    def add(self, place: Place, config: TrialConfig, out: Path) -> None:
        """Record a trial in `out` if it has ended: finished, or diverged.

        Where another process has recorded it meanwhile, what that one has recorded stays.

        Raises:
            ConfigurationError: If the record cannot be written.
            ValueError: If the trial's records are damaged, or this record is.
        """
        if place in self.trials:
            return
        trial = Trial.find(out / config.folder_name)
        if trial is None or trial.status not in ("finished", "failed"):
            return
        score = None
        if trial.status == "finished":
            score = round(trial.final_score(), 6)
        elif not any(told in str(trial.reason) for told in DIVERGED):
            return
        told = {
            "steps": config.steps,
            "score": score,
            "training_s": round(trial.timings.get("training_s", 0.0), 1),
            "trial": trial.name,
        }
        self._append(place, told)

    def check_writable(self) -> None:
        """Raise ConfigurationError if its folder cannot be written."""
        records.check_writable(self.path.parent, _FOLDER)

    def seconds_per_step(self) -> float | None:
        """Return what a training step has taken so far; None before the first trial."""
        steps = sum(one["steps"] for one in self.trials.values())
        return sum(one["training_s"] for one in self.trials.values()) / steps if steps else None

    def _append(self, place: Place, told: dict[str, Any]) -> None:
        """Add a trial, unless another process has added it, and take over what others have added."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with locked(self.path):
                self.trials = self._read()
                if place in self.trials:
                    return
                cut_torn_line(self.path)
                begun = self.path.is_file() and self.path.stat().st_size
                one = {**vars(place), **told}
                append_all(self.path, [one] if begun else [self._head, one])
        except OSError as error:
            raise records.unwritable(self.path.parent, error, _FOLDER) from error
        self.trials[place] = told

    def _read(self) -> dict[Place, dict[str, Any]]:
        """Return the trials on the disk, by their place; errors are those of `__init__`."""
        rows = read_rows(self.path)
        if rows:
            self._check(rows[0])
        try:
            return {_place(one): {name: one[name] for name in RECORDED} for one in rows[1:]}
        except KeyError as error:
            raise ValueError(f"{str(self.path)!r} is damaged: a trial has no {error}.") from error
        except TypeError as error:
            raise ValueError(f"{str(self.path)!r} is damaged: {error}.") from error

    def _check(self, head: Mapping[str, Any]) -> None:
        """Raise ConfigurationError unless the record was begun with the same head."""
        for name, what in (
            ("protocol", "under another protocol"),
            ("space", "with another search space"),
            ("fixed", "with other values of what is not searched"),
            ("candidates", "with other candidates"),
        ):
            if head.get(name) != self._head[name]:
                raise ConfigurationError(
                    f"the search in {str(self.path)!r} was begun {what}: put that back to go on, or move the "
                    "file away to search anew."
                )


def _head(row: str, protocol: Protocol) -> dict[str, Any]:
    space = SPACES[row]
    fixed = {
        task: {name: value for name, value in hyperparameters(row, task).items() if name not in space}
        for task in protocol.search.tasks
    }
    head = {
        "row": row,
        "protocol": protocol.digest,
        "space": {name: f"{one}" for name, one in space.items()},
        "fixed": fixed,
        "candidates": candidates(row, protocol.search.candidates),
    }
    # As it is read back: lists for tuples.
    return json.loads(json.dumps(head))  # type: ignore[no-any-return]


def _place(one: Mapping[str, Any]) -> Place:
    return Place(*(one[name] for name in ("rung", "candidate", "task", "noise", "seed")))
