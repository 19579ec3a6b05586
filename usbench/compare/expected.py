"""How long trials will take, by finished ones: those of a folder, else those that come with the package."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from usbench import records
from usbench.records import Trial, TrialConfig
from usbench.results import published, tables


@dataclass(frozen=True)
class Expected:
    """How many seconds trials will take.

    Attributes:
        seconds: The seconds.
        published: Whether the published trials tell, which were trained on other machines.
    """

    seconds: float
    published: bool = False


def trials(missing: Sequence[TrialConfig], out: Path, jobs: int) -> Expected | None:
    """Return how long trials will take, `jobs` at a time; None if no record tells.

    Finished trials of the same algorithms and steps tell that `out` holds; else the published trials do.
    Agents that do not learn take no time to speak of.
    """
    keys = [(config.algo, config.steps) for config in missing if config.steps]
    known = _finished(out)
    if all(key in known for key in keys):
        return Expected(_side_by_side([known[key] for key in keys], jobs))
    return by_published(keys, jobs)


def by_published(keys: Sequence[tuple[str, int]], jobs: int) -> Expected | None:
    """Return how long trials will take by the published ones; None if these do not tell.

    `keys` are algorithm and steps of each. Training takes as long per step as theirs, and a trial as long
    beside its training.
    """
    table = tables.read(published.folder()).trials
    table = table[(table["status"] == "finished") & (table["steps"] > 0)]
    table = table.assign(
        step_s=table["training_s"] / table["steps"], rest_s=table["total_s"] - table["training_s"]
    )
    means = table.groupby("algo")[["step_s", "rest_s"]].mean()
    if not all(algo in means.index for algo, _ in keys):
        return None
    seconds = [steps * means.loc[algo, "step_s"] + means.loc[algo, "rest_s"] for algo, steps in keys]
    return Expected(_side_by_side(seconds, jobs), published=True)


def _side_by_side(seconds: Sequence[float], jobs: int) -> float:
    """Return how long trials take, `jobs` at a time: no less than the longest, since none is split."""
    return float(max(sum(seconds) / jobs, max(seconds, default=0)))


def _finished(out: Path) -> dict[tuple[str, int], float]:
    """Return the mean seconds of the finished trials in `out`, by algorithm and steps."""
    seconds: dict[tuple[str, int], list[float]] = {}
    for folder in records.trial_folders(out):
        with contextlib.suppress(ValueError):
            trial = Trial.find(folder)
            if trial is not None and trial.status == "finished" and "total_s" in trial.timings:
                key = trial.config.algo, trial.config.steps
                seconds.setdefault(key, []).append(trial.timings["total_s"])
    return {key: sum(each) / len(each) for key, each in seconds.items()}
