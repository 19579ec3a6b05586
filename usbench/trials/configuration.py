"""From what a user asks for to the full configuration of a trial, checked."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from usbench.agents import zoo
from usbench.checks import as_configuration_error, check_seed, whole_number
from usbench.records import TrialConfig
from usbench.records.configuration import LARGEST_COUNT, MAX_ENVS
from usbench.setting import Setting, check_arguments
from usbench.trials import knowledge

# What `resolve` takes beside names of algorithm and task: values of its own, and those of a setting.
OWN = ("seed", "steps", "n_envs", "preset", "overrides")
# The fewest rows and columns that every network of this package takes.
LEAST_PX = 8

# What is recorded with a trial, since its bits depend on them.
PACKAGES = (
    "usbench",
    "gymnasium",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
)


@cache
def versions(packages: tuple[str, ...] = PACKAGES) -> Mapping[str, str]:
    """Return the versions of Python and of packages, "none" for one that is not installed."""
    found = {"python": platform.python_version()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def resolve(
    algo: str,
    task: str,
    *,
    seed: int = 0,
    steps: int | None = None,
    n_envs: int | None = None,
    preset: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    **setting: Any,
) -> TrialConfig:
    """Return the full configuration of a trial: every default filled in, every value checked.

    `n_envs` environments learn in step, by default as many as the algorithm's row says, or fewer where so
    many cannot share the steps: see `zoo.usual_envs`. `setting` holds other attributes of a `Setting` than
    its task: `noise`, `probe` and so on.

    Raises:
        ConfigurationError: If a name is unknown or a value is not allowed; one sentence says which.
    """
    with as_configuration_error():
        # Names first: they are cheap to check.
        check_arguments(setting, OWN)
        entry = zoo.entry(algo)
        met = Setting(task=task, **setting)
        if entry.needs:
            knowledge.NEEDS[entry.needs](met)
        if entry.policy is not None:
            _check_stack(met)
        hyperparameters = zoo.hyperparameters(algo, task, preset=preset, overrides=overrides or {})
        # Nothing is forgotten over the task's whole budget.
        if "buffer_size" in hyperparameters and "buffer_size" not in (overrides or {}):
            hyperparameters["buffer_size"] = max(int(hyperparameters["buffer_size"]), met.row.steps)
        seed = check_seed(seed)
        steps = whole_number("steps", met.row.steps if steps is None else steps, low=1)
        if steps > LARGEST_COUNT:
            raise ValueError(f"steps must be at most {LARGEST_COUNT}, not {steps}.")
        n_envs = _n_envs(n_envs, entry, steps, zoo.rollout_steps(algo, hyperparameters))
    return TrialConfig(
        task=task,
        algo=algo,
        noise=met.noise,
        seed=seed,
        n_frames=met.n_frames,
        steps=steps if entry.learns else 0,
        hyperparameters=hyperparameters,
        environment=met.record(),
        n_envs=n_envs,
    )


def _n_envs(asked: int | None, entry: zoo.Entry, steps: int, rollout: int) -> int:
    """Return how many environments learn in step; ValueError unless they share steps and rollout evenly.

    Each of them takes two steps of a rollout or more.
    """
    if asked is None:
        return zoo.usual_envs(entry, steps, rollout)
    n_envs = whole_number("n_envs", asked, 1, MAX_ENVS)
    if n_envs > 1 and entry.policy is None:
        raise ValueError(f"n_envs must be 1 for an agent that is not Stable-Baselines3's, not {n_envs}.")
    if steps % n_envs:
        raise ValueError(f"steps must be a multiple of n_envs ({n_envs}), not {steps}.")
    if rollout % n_envs:
        raise ValueError(f"n_steps must be a multiple of n_envs ({n_envs}), not {rollout}.")
    if n_envs == rollout:
        raise ValueError(f"n_envs must be less than n_steps ({rollout}), not {n_envs}.")
    return n_envs


def _check_stack(setting: Setting) -> None:
    """Raise ValueError if a frame is too small, or a stack has as many frames as it has rows or columns.

    Our networks take the smallest axis for that of the frames.
    """
    n_pixels = min(setting.imaging.height_px, setting.imaging.width_px)
    if n_pixels < LEAST_PX:
        raise ValueError(f"height_px and width_px must be at least {LEAST_PX} for an agent, not {n_pixels}.")
    if setting.n_frames >= n_pixels:
        raise ValueError(
            f"n_frames must be a whole number in [1, {n_pixels - 1}], below the rows and the columns of a "
            f"frame, not {setting.n_frames}."
        )
