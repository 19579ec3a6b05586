"""The tasks of the benchmark, and what follows from their rows: environments, episodes, evaluation points."""

import reprlib
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium.envs.registration import load_env_creator

from usbench.checks import ConfigurationError, unknown
from usbench.coordinates import POSE
from usbench.envs.pose import Move, Pose
from usbench.envs.task import Task as GuidanceTask
from usbench.envs.tasks.phantom_distribution import FIRST_HELD_OUT
from usbench.registration import register_row
from usbench.tasks import GROUP, PAPER, Row, check_installed, rows
from usbench.words import in_one_line

# Evaluation seeds have 64 bits and training seeds 32 (SB3's `seed`): the two never meet.
EVALUATION_ENTROPY = 20_190_000

__all__ = [
    "PAPER",
    "TASKS",
    "EvaluationEpisode",
    "Task",
    "check_installed",
    "evaluation_episodes",
    "evaluation_points",
]


@dataclass(frozen=True, kw_only=True)
class Task(Row):
    """A row of the table, and the task that its environment sets.

    Attributes:
        guidance: Title, actions, starts, noise and reward of the environment.
    """

    guidance: GuidanceTask

    @property
    def is_guided(self) -> bool:
        """Whether `usbench guide` shows it: its keys move only the probe, not the settings."""
        return self.guidance.coordinates == POSE


@dataclass(frozen=True)
class EvaluationEpisode:
    """One entry of the fixed evaluation list: its number, the environment's seed, start pose and phantom.

    The phantom is None where the environment has but one.
    """

    number: int
    seed: int
    start: Pose
    phantom: int | None = None

    @property
    def options(self) -> dict[str, int]:
        """Start pose and phantom as `reset` takes them."""
        return asdict(self.start) | ({} if self.phantom is None else {"phantom": self.phantom})

    @property
    def phantom_index(self) -> int:
        """Place of its phantom among those of the evaluation, 0 where the environment has but one."""
        return 0 if self.phantom is None else self.phantom - FIRST_HELD_OUT


def guidance_of(name: str, row: Row) -> GuidanceTask:
    """Register a row's environment, unless it is known, and return the task that it sets.

    Raises:
        ConfigurationError: If they do not fit each other, as may be in another package.
    """
    register_row(row)
    try:
        environment: Any = load_env_creator(row.entry_point)
        task, told = environment.task, environment.default_senses
    except Exception as error:  # of a stranger's module, which may raise anything
        raise ConfigurationError(
            f"the environment {row.entry_point!r} of the task {name!r} cannot be used "
            f"({in_one_line(error, with_type=True)}): mend its package, or uninstall it."
        ) from error
    if not isinstance(task, GuidanceTask):
        raise ConfigurationError(
            f"the environment of the task {name!r} must have a `usbench.envs.task.Task` as its `task`, not "
            f"{reprlib.repr(task)}."
        )
    if row.n_steps != task.n_steps:
        raise ConfigurationError(
            f"the row of the task {name!r} must have the {task.n_steps} steps of its environment, not "
            f"n_steps={row.n_steps}."
        )
    if {*row.senses} != {*told}:
        raise ConfigurationError(
            f"the row of the task {name!r} must have the senses of its environment, {told!r}, not "
            f"{row.senses!r}."
        )
    if task.actions[0].move != Move():
        raise ConfigurationError(f"the first action of the task {name!r} must move nothing.")
    return task


TASKS: Mapping[str, Task] = MappingProxyType(
    {name: Task(**asdict(row), guidance=guidance_of(name, row)) for name, row in rows().items()}
)


def unknown_task(task: object, allowed: Collection[str] = TASKS) -> ValueError:
    """Return the error for a `task` that is not one of `allowed`; where it is a place, what names a task."""
    error = unknown("task", task, allowed)
    if not isinstance(task, str) or not set(task) & set(".:/"):
        return error
    if known := [name for name in allowed if TASKS[name].env_id == task]:
        return ValueError(f"{task!r} is the Gymnasium id of the task {known[0]!r}: give that name.")
    return ValueError(
        f"{str(error).removesuffix('.')}; a task of your own is named by an entry point of the group "
        f"{GROUP!r} in an installed package, not by its file or class (docs/extending.md)."
    )


def name_of(env_id: object, task: str) -> str:
    """Return the name of the version of `task` whose environment is `env_id`, or `task` where none is.

    A name stands for the latest version of its task: trials of an earlier one are found by their environment.
    """
    versions = [name for name in TASKS if name.startswith(f"{task}-v")]
    return next((name for name in versions if TASKS[name].env_id == env_id), task)


def evaluation_episodes(task: str) -> tuple[EvaluationEpisode, ...]:
    """Return the fixed evaluation list of a task: its starts, `repeats` times, with phantoms taking turns."""
    if task not in TASKS:
        raise unknown_task(task)
    row = TASKS[task]
    known = row.guidance.starts
    if row.drawn_starts:
        order = np.random.default_rng(EVALUATION_ENTROPY).permutation(len(known))
        known = tuple(known[k] for k in order[: row.drawn_starts])
    starts = [start for start in known for _ in range(row.repeats)]
    seeds = np.random.SeedSequence(EVALUATION_ENTROPY).generate_state(len(starts), np.uint64)
    held_out: list[int | None] = [FIRST_HELD_OUT + k for k in range(row.phantoms)]
    phantoms = held_out or [None]
    return tuple(
        EvaluationEpisode(number, int(seed), start, phantoms[number % len(phantoms)])
        for number, (seed, start) in enumerate(zip(seeds, starts, strict=True))
    )


def evaluation_points(task: str, steps: int) -> tuple[int, ...]:
    """Return the training steps at which a trial of `steps` steps is evaluated, first 0 and last `steps`.

    Raises:
        ValueError: If there is no such task.
    """
    if task not in TASKS:
        raise unknown_task(task)
    count = TASKS[task].checkpoints
    return tuple(sorted({steps * k // count for k in range(count + 1)}))
