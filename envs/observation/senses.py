"""What an agent may be told beside the frame: what a tracked probe or the hand that holds it knows.

A probe in practice is tracked (by a marker, an inertial unit or a robot's encoder), and a hand knows what it
did last. None of the senses tells anything about the object: truth about it is in `info` alone.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from usbench.checks import unknown
from usbench.coordinates import BY_NAME, COORDINATES
from usbench.envs.pose import Pose, cos_deg, sin_deg
from usbench.envs.task import Task

# The last action, one-hot; zeros after a reset.
ACTIONS = "actions"
# In this order they stand in an observation.
NAMES = (*(one.sense for one in COORDINATES if one.sense), ACTIONS)
# Names of the two parts of an observation with senses.
IMAGE, SENSES = "image", "senses"
Observation = npt.NDArray[Any] | dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Senses:
    """The senses of an agent in a task; no names stand for frames alone.

    Attributes:
        task: The task.
        names: Any of `available(task)`, in the order of `NAMES`.
    """

    task: Task
    names: tuple[str, ...]

    @property
    def size(self) -> int:
        """How many numbers the senses are."""
        sizes = {one.sense: 1 if one.period is None else 2 for one in COORDINATES}
        return sum(len(self.task.actions) if name == ACTIONS else sizes[name] for name in self.names)

    def values(self, pose: Pose, action: int | None) -> npt.NDArray[np.float32]:
        """Return what they tell at `pose` after `action` (None after a reset), (size,) in [-1, 1].

        A coordinate is divided by the largest magnitude that the task's limits allow: x by 20 mm, the focal
        depth by the deepest, 90 mm in tasks that move the probe. The heading is the sine and the cosine of
        the probe's angle.
        """
        told: list[float] = []
        for one in COORDINATES:
            if one.sense not in self.names:
                continue
            value = getattr(pose, one.name)
            if one.period is None:
                told.append(value / max(map(abs, getattr(self.task.limits, one.name))))
            else:
                told += [sin_deg(value), cos_deg(value)]
        if ACTIONS in self.names:
            told += [float(action == number) for number in range(len(self.task.actions))]
        return np.array(told, dtype=np.float32)

    def space(self, image: gym.spaces.Box) -> gym.Space[Any]:
        """Return the space of observations with `image`: `image` itself where there are no senses."""
        if not self.names:
            return image
        senses = gym.spaces.Box(-1.0, 1.0, (self.size,), np.float32)
        return gym.spaces.Dict({IMAGE: image, SENSES: senses})


def available(task: Task) -> tuple[str, ...]:
    """Return the senses that a task has: of the coordinates that change in it, and the actions."""
    changing = {
        BY_NAME[name].sense for name in task.coordinates if len({getattr(p, name) for p in task.states}) > 1
    }
    return tuple(name for name in NAMES if name in changing or name == ACTIONS)


def checked(names: Iterable[str], task: Task) -> Senses:
    """Return the senses called `names`.

    Raises:
        TypeError: If `names` is one string, or no sequence.
        ValueError: If a sense is unknown, or the task does not have it.
    """
    if isinstance(names, str):
        raise TypeError(f"senses must be a sequence of names, as ({names!r},), not one string.")
    if not isinstance(names, Iterable):
        raise TypeError(f"senses must be a sequence of names, not {reprlib.repr(names)}.")
    asked, has = tuple(names), available(task)
    for name in asked:
        if name not in NAMES:
            raise unknown("sense", name, NAMES)
        if name not in has:
            raise ValueError(
                f"the task {task.name!r} has no sense {name!r}, since it does not change there: allowed are "
                f"{', '.join(map(repr, has))}."
            )
    return Senses(task, tuple(name for name in NAMES if name in asked))


def check_pose_told(names: Sequence[str], task: Task, who: str) -> None:
    """Raise ValueError unless the senses `names` tell the whole pose of the probe, which `who` needs."""
    needed = [name for name in available(task) if name != ACTIONS]
    if not set(needed) <= set(names):
        raise ValueError(
            f"{who} of the task {task.name!r} needs the senses {', '.join(map(repr, needed))}, not "
            f"{', '.join(map(repr, names)) or 'none'}."
        )


def parts(observation: Observation) -> dict[str, npt.NDArray[Any]]:
    """Return an observation as a dictionary, as it is where there are senses.

    Its `image` is (height_px, width_px, n_frames), its `senses` are (n_frames * size,).
    """
    return observation if isinstance(observation, dict) else {IMAGE: observation}


def whole(known: dict[str, npt.NDArray[Any]]) -> Observation:
    """Return the observation that has these parts: the image itself where there is nothing else."""
    return known if SENSES in known else known[IMAGE]


def with_image(
    observation: Observation, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
) -> Observation:
    """Return the observation with its image changed."""
    if isinstance(observation, dict):
        return {**observation, IMAGE: change(observation[IMAGE])}
    return change(observation)


def batch(observations: Sequence[Observation]) -> Observation:
    """Return observations of one space as one, with a leading axis (n, ...)."""
    every = [parts(one) for one in observations]
    return whole({name: np.stack([one[name] for one in every]) for name in every[0]})


def equal(one: Observation, other: Observation) -> bool:
    """Return whether two observations are the same."""
    first, second = parts(one), parts(other)
    return first.keys() == second.keys() and all(np.array_equal(first[name], second[name]) for name in first)
