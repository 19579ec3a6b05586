"""The trials that a comparison of algorithms takes."""

from collections.abc import Sequence
from typing import Any

from usbench.checks import whole_number
from usbench.records import ConfigurationError, TrialConfig
from usbench.trials.configuration import resolve

# In every comparison, whatever else is asked for. They do not learn, so that one trial of each is enough.
REFERENCE_POLICIES = ("random", "stay", "oracle")


def plan(
    algos: Sequence[str], tasks: Sequence[str], noises: Sequence[Any], n_seeds: Any, steps: Any = None
) -> list[TrialConfig]:
    """Return the trials of all algorithms on all tasks with all noises and the seeds 0 to `n_seeds` - 1.

    Seeds come first: a comparison that is stopped has done the same for every algorithm.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    learners = [algo for algo in algos if algo not in REFERENCE_POLICIES]
    cells = [(task, noise) for task in tasks for noise in noises]
    planned = [resolve(algo, task, noise=noise) for algo in REFERENCE_POLICIES for task, noise in cells] + [
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
