"""The search for hyperparameters by the protocol: as many candidates, trials and steps for every row.

Candidates are drawn at random, each row's by itself, and pruned by successive halving: every rung trains
those that are left with more steps than the rung before, and keeps the best by their mean score.
"""

import json
import math
import tempfile
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from usbench.agents.zoo import WINNERS, winners
from usbench.atomic import atomic_file
from usbench.checks import unknown
from usbench.compare import sweep
from usbench.compare.expected import Expected, by_published
from usbench.compare.protocol import Protocol
from usbench.compare.search_record import Place, SearchRecord
from usbench.records import ConfigurationError, TrialConfig
from usbench.records.lock import locked
from usbench.trials.configuration import resolve


@dataclass(frozen=True)
class Winner:
    """What a search has found: hyperparameters, and their mean score in the last rung."""

    row: str
    candidate: int
    score: float
    hyperparameters: Mapping[str, Any]


class Progress(sweep.Progress, typing.Protocol):
    """What a search tells while it runs."""

    def rung(self, number: int, n_rungs: int, scores: Mapping[int, float | None]) -> None:
        """Rung `number` of 1 to `n_rungs` begins; each candidate has its score in the rung before, if any."""


def check_row(protocol: Protocol, row: str) -> str:
    """Return `row`; ConfigurationError if the protocol does not search it."""
    if row not in protocol.search.rows:
        refused = unknown("row of the search", row, protocol.search.rows)
        raise ConfigurationError(f"{refused} For other algorithms docs/submit.md says how to choose them.")
    return row


def run(row: str, protocol: Protocol, folder: Path, out: Path, progress: Progress, **kwargs: Any) -> Winner:
    """Run what is missing of a row's search; return the winner, which the table of algorithms takes over.

    Killed at any time and started again, a search ends with the same winner; of its trials only those that
    were in progress are lost, and with their folders in `out` not even these. Two searches of a row at once
    record no trial twice; with the same `out`, one waits for the trials that the other runs.

    Args:
        row: A row of the protocol's search.
        protocol: The protocol.
        folder: Where the record of the search is, `<row>.jsonl`.
        out: Folder for trials.
        progress: Who is told.
        kwargs: Go to the sweep.

    Raises:
        ConfigurationError: If the record is of another protocol or space, or a folder or the table of winners
            cannot be written.
        KeyboardInterrupt: After the running trials have kept their state.
        RuntimeError: If trials have failed for another reason than a training that diverged.
        ValueError: If records are damaged.
    """
    record = SearchRecord(folder, check_row(protocol, row), protocol)
    if protocol.is_of_the_package:
        _check_writable()
    record.check_writable()
    left: Sequence[int] = range(protocol.search.candidates)
    scores: dict[int, float] = {}
    for number, rung in enumerate(protocol.search.rungs):
        told = {candidate: scores.get(candidate) for candidate in left}
        progress.rung(number + 1, len(protocol.search.rungs), told)
        planned = plan(record, protocol, number, left)
        _run_rung(record, planned, protocol, out, progress, **kwargs)
        scores = mean_scores(record, number)
        left = best(scores)[: rung.keep]
    winner = Winner(row, left[0], scores[left[0]], record.candidates[left[0]])
    if not math.isfinite(winner.score):
        raise RuntimeError(f"no candidate of {row} has a score: the training of each of them diverged.")
    if protocol.is_of_the_package:
        _hand_over(winner, protocol)
    return winner


def plan(
    record: SearchRecord, protocol: Protocol, number: int, left: Sequence[int]
) -> dict[Place, TrialConfig]:
    """Return the trials of a rung with the candidates that are left, by their places."""
    search = protocol.search
    rung = search.rungs[number]
    return {
        Place(number, candidate, task, noise, seed): resolve(
            record.row,
            task,
            noise=noise,
            seed=protocol.pools.check("search", seed),
            steps=rung.steps,
            overrides=record.candidates[candidate],
        )
        for candidate in left
        for seed in rung.seeds
        for noise in search.noises
        for task in search.tasks
    }


def mean_scores(record: SearchRecord, number: int) -> dict[int, float]:
    """Return each candidate's mean score over a rung's trials; minus infinity where one of them diverged."""
    found: dict[int, list[float]] = {}
    for place, one in record.trials.items():
        if place.rung == number:
            score = float("-inf") if one["score"] is None else float(one["score"])
            found.setdefault(place.candidate, []).append(score)
    return {candidate: sum(each) / len(each) for candidate, each in found.items()}


def best(scores: Mapping[int, float]) -> list[int]:
    """Return the candidates, best first; the first drawn goes before where two are equal."""
    return sorted(scores, key=lambda candidate: (-scores[candidate], candidate))


def _run_rung(
    record: SearchRecord,
    planned: Mapping[Place, TrialConfig],
    protocol: Protocol,
    out: Path,
    progress: Progress,
    **kwargs: Any,
) -> None:
    for place, config in planned.items():
        record.add(place, config, out)  # what ended, and was not recorded before a kill
    missing = {place: config for place, config in planned.items() if place not in record.trials}
    if not missing:
        return
    recording = _Recording(record, missing, protocol, out, progress)
    outcomes = sweep.run(list(missing.values()), out, recording, evaluates_on_the_way=False, **kwargs)
    reasons = {outcome.config.folder_name: outcome.reason for outcome in outcomes}
    failed = [(place, config) for place, config in missing.items() if place not in record.trials]
    if failed:
        place, config = failed[0]
        raise RuntimeError(
            f"{len(failed)} of {len(missing)} trials failed, as {config.title}, candidate {place.candidate}: "
            f"{reasons[config.folder_name]}; the same command tries them again."
        )


class _Recording:
    """A sweep's progress that records every trial when it ends, and knows what the search still takes."""

    def __init__(
        self,
        record: SearchRecord,
        missing: Mapping[Place, TrialConfig],
        protocol: Protocol,
        out: Path,
        progress: Progress,
    ) -> None:
        self._record, self._protocol, self._out = record, protocol, out
        self._places = {config.folder_name: place for place, config in missing.items()}
        self._progress = progress
        self.frames, self.retried = progress.frames, progress.retried

    def started(self, n_finished: int, expected: Expected) -> None:
        """Tell how long the whole search of the row still takes, later rungs included."""
        self._progress.started(len(self._record.trials), self._with_later_rungs(expected))

    def ended(self, outcome: sweep.Outcome) -> None:
        """Record the trial, and tell."""
        place = self._places[outcome.config.folder_name]
        self._record.add(place, outcome.config, self._out)
        self._progress.ended(replace(outcome, note=f"candidate {place.candidate}"))

    def _with_later_rungs(self, expected: Expected) -> Expected:
        """Return how long the trials of this rung and of those after it take that are not recorded.

        Those that are recorded tell; before the first one, the published trials do.
        """
        row, rungs, per_step = self._record.row, self._protocol.search.rungs, self._record.seconds_per_step()
        kinds = [(row, rung.steps) for rung in rungs]
        known = by_published(kinds) if per_step is None else {kind: kind[1] * per_step for kind in kinds}
        if known is None:
            return replace(expected, told=False)
        each = [known[kind] for kind in kinds]
        n_trials = self._protocol.search.n_trials()
        this = next(iter(self._places.values())).rung
        later = sum(n * seconds for n, seconds in zip(n_trials[this + 1 :], each[this + 1 :], strict=True))
        return replace(
            expected,
            each=dict.fromkeys(expected.each, each[this]),
            later=later,
            told=True,
            published=per_step is None,
        )


def _hand_over(winner: Winner, protocol: Protocol) -> None:
    """Write the winner where the table of algorithms reads it."""
    own = {
        "protocol": protocol.digest,
        "candidate": winner.candidate,
        "score": round(winner.score, 4),
        "hyperparameters": dict(winner.hyperparameters),
    }
    try:
        # Another search may end at the same moment.
        with locked(WINNERS), atomic_file(WINNERS) as file:
            chosen = {**winners(), winner.row: own}
            file.write(json.dumps(chosen, indent=2, sort_keys=True).encode() + b"\n")
    except OSError as error:
        raise _unwritable(error) from error


def _check_writable() -> None:
    """Refuse a table of winners that cannot be written, before days of trials rather than after."""
    try:
        with locked(WINNERS), tempfile.TemporaryFile(dir=WINNERS.parent):
            pass
    except OSError as error:
        raise _unwritable(error) from error


def _unwritable(error: OSError) -> ConfigurationError:
    return ConfigurationError(
        f"the table of winners {str(WINNERS)!r} cannot be written ({error.strerror}): install usbench where "
        "it can be, or search by a protocol of your own."
    )
