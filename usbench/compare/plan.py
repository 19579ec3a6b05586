"""A comparison of algorithms: the trials that it takes, and what is written from their records alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from usbench.checks import whole_number
from usbench.figures import comparison
from usbench.records import ConfigurationError, TrialConfig
from usbench.results import leaderboard, scores, tables
from usbench.results.tables import Results
from usbench.trials.configuration import resolve

# In every comparison, whatever else is asked for. They do not learn, so that one trial of each is enough.
FLOOR_AND_CEILING = ("random", "stay", "oracle")


def plan(
    algos: Sequence[str], tasks: Sequence[str], noises: Sequence[Any], n_seeds: Any, steps: Any = None
) -> list[TrialConfig]:
    """Return the trials of all algorithms on all tasks with all noises and the seeds 0 to `n_seeds` - 1.

    Seeds come first: a comparison that is stopped has done the same for every algorithm.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    learners = [algo for algo in algos if algo not in FLOOR_AND_CEILING]
    cells = [(task, noise) for task in tasks for noise in noises]
    planned = [resolve(algo, task, noise=noise) for algo in FLOOR_AND_CEILING for task, noise in cells] + [
        resolve(algo, task, noise=noise, seed=seed, steps=steps)
        for seed in range(positive("seeds", n_seeds))
        for task, noise in cells
        for algo in learners
    ]
    return list({config.folder_name: config for config in planned}.values())


def positive(name: str, value: Any) -> int:
    """Return `value` as a whole number of at least 1; ConfigurationError if it is none."""
    try:
        return whole_number(name, value, low=1)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(str(error)) from error


def prepare(path: Path) -> Path:
    """Return the folder for the tables and figures beside the leaderboard `path`, made if need be.

    Raises:
        ConfigurationError: If nothing can be written there; better before hours of trials than after.
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        folder = leaderboard.files(path)
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            f"the leaderboard {str(path)!r} cannot be written ({error.strerror}): "
            "choose another with --leaderboard."
        ) from error
    return folder


def gather(runs: Path) -> tuple[Results, pd.DataFrame]:
    """Return the results of all trials in `runs` that can be compared, and the rows of the others.

    Those have another environment than their task's own: a user's phantom, another reward.

    Raises:
        ConfigurationError: If there is no trial.
        FileNotFoundError: If there is no such folder.
        ValueError: If a record is broken.
    """
    known = tables.collect(runs)
    if known.trials.empty:
        raise ConfigurationError(
            f"there is no trial in {str(runs)!r}: usbench run and usbench compare make some."
        )
    own = {task: tables.digest(resolve("stay", task).environment) for task in set(known.trials["task"])}
    fits = scores.environments(known.trials) == known.trials["task"].map(own)
    chosen = known.trials[fits]
    return Results(chosen, known.curves[known.curves["trial"].isin(chosen["trial"])]), known.trials[~fits]


def report(planned: Sequence[TrialConfig], out: Path, path: Path) -> list[Path]:
    """Write leaderboard, scores, tables and figures from the records in `out`; return where they are.

    Only the planned trials count; those without a finished record are named in the leaderboard.
    """
    folder = prepare(path)
    known = tables.collect(out, planned)
    tables.write(known, folder)
    return [*leaderboard.write(folder, path), *comparison.write(known, folder)]
