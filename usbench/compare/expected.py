"""How long trials will take, by finished ones: those of a folder, else those that come with the package."""

import contextlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from usbench import records
from usbench.records import Trial, TrialConfig
from usbench.results import sources, tables
from usbench.trials.resume_files import ResumeFiles

# Algorithm and training steps, on which it depends most how long a trial takes.
Kind = tuple[str, int]


class End(NamedTuple):
    """The end of a trial: its folder's name, when in seconds of the sweep, and whether it is finished."""

    name: str
    at_s: float
    finished: bool = True


@dataclass(frozen=True)
class Expected:
    """How many seconds trials will take.

    Attributes:
        each: Seconds of each trial by the name of its folder, in the order in which they run. Where
            `told` is False, all that learn have the same.
        jobs: Trials that run at a time.
        later: Seconds of trials that come after these.
        told: Whether finished trials tell.
        published: Whether the published trials tell, which were trained on other machines.
    """

    each: Mapping[str, float]
    jobs: int
    later: float = 0.0
    told: bool = True
    published: bool = False

    @property
    def seconds(self) -> float:
        """How long all take: no less than the longest, since none is split."""
        together = (sum(self.each.values()) + self.later) / self.jobs
        return max([together, *self.each.values()])

    def left(self, ends: Sequence[End]) -> float | None:
        """Return how many seconds it goes on after the last of `ends`; None if nothing tells yet.

        Those that learned tell how much longer trials take than was expected: one starts when another ends.
        One that ended before its turn, as where another process took those before it, began with the last
        end before its own.
        """
        waiting = list(self.each)
        starts = {name: 0.0 for name in waiting[: self.jobs]}
        del waiting[: self.jobs]
        now = 0.0
        for end in ends:
            if end.name in waiting:
                starts[end.name] = now
                waiting.remove(end.name)
            now = end.at_s
            if waiting:
                starts[waiting.pop(0)] = now
        learned = [end for end in ends if end.finished and self.each[end.name]]
        if not (learned or self.told):
            return None
        took = sum(end.at_s - starts.get(end.name, 0.0) for end in learned)
        longer = took / sum(self.each[end.name] for end in learned) if learned else 1.0
        gone = {end.name for end in ends}
        rest = [
            max(longer * seconds - (now - starts.get(name, now)), 0.0)
            for name, seconds in self.each.items()
            if name not in gone
        ]
        return max([(sum(rest) + longer * self.later) / self.jobs, *rest])


def trials(missing: Sequence[TrialConfig], out: Path, jobs: int) -> Expected:
    """Return how long trials will take, `jobs` at a time.

    Finished trials of the same algorithms and steps tell that `out` holds; else the published trials do.
    Agents that do not learn take no time to speak of, and a trial that was stopped goes on where it was.
    """
    kinds = {(config.algo, config.steps) for config in missing if config.steps}
    known: Mapping[Kind, float] | None = _finished(out)
    own = kinds <= set(known or {})
    if not own:
        known = by_published(kinds)
    each = {}
    for config in missing:
        whole = 1.0 if known is None or not config.steps else known[config.algo, config.steps]
        each[config.folder_name] = whole * _share_left(config, out)
    return Expected(each, jobs, told=known is not None, published=not own and known is not None)


def by_published(kinds: Collection[Kind]) -> dict[Kind, float] | None:
    """Return how many seconds trials take by the published ones; None if these do not tell of each.

    Training takes as long per step as theirs, and a trial as long beside its training.
    """
    table = tables.read(sources.published()).trials
    table = table[(table["status"] == "finished") & (table["steps"] > 0)]
    table = table.assign(
        step_s=table["training_s"] / table["steps"], rest_s=table["total_s"] - table["training_s"]
    )
    means = table.groupby("algo")[["step_s", "rest_s"]].mean()
    if not all(algo in means.index for algo, _ in kinds):
        return None
    return {
        (algo, steps): steps * float(means.loc[algo, "step_s"]) + float(means.loc[algo, "rest_s"])
        for algo, steps in kinds
    }


def _share_left(config: TrialConfig, out: Path) -> float:
    """Return how much of its training a trial has still to do, from 0 to 1."""
    if not config.steps:
        return 0.0
    return max(1 - ResumeFiles(out / config.folder_name, 0.0).step() / config.steps, 0.0)


def _finished(out: Path) -> dict[Kind, float]:
    """Return the mean seconds of the finished trials in `out`."""
    seconds: dict[Kind, list[float]] = {}
    for folder in records.trial_folders(out):
        with contextlib.suppress(ValueError):
            trial = Trial.find(folder)
            if trial is not None and trial.status == "finished" and "total_s" in trial.timings:
                key = trial.config.algo, trial.config.steps
                seconds.setdefault(key, []).append(trial.timings["total_s"])
    return {key: sum(each) / len(each) for key, each in seconds.items()}
