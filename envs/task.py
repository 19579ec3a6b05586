"""What is particular to a task: actions, starts, noise and reward; and the checks of what users choose."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

from usbench.checks import unknown
from usbench.envs.pose import LIMITS, Limits, Move, Pose, coordinates

REWARDS = ("normalized", "paper")
# Computed from the frame alone: see `image_reward.py`.
IMAGE = "image"


@dataclass(frozen=True)
class Action:
    """What an action is called and how it moves the probe."""

    name: str
    move: Move


@dataclass(frozen=True)
class Task:
    """All that is particular to a task; a literal constant in the task's own module.

    Attributes:
        name: Short name, used on the command line and in records.
        title: Name for people.
        actions: Meaning of the actions 0, 1, ...
        starts: Poses from which an episode starts, one of them uniformly.
        displacements: What noise does to the probe, one of them uniformly.
        states: All poses that can be reached from the starts.
        reward: (pose, target, kind) -> reward of being at `pose`, `kind` one of `REWARDS`; a pure function.
        is_success: (pose, target) -> whether an episode that ends at `pose` succeeded.
        distance_mm: (pose, target) -> what is left to go, in mm.
        n_steps: Length of an episode.
        limits: Where the probe can be.
        stops: Whether the last action ends the episode; it earns the pose's reward for every step left.
        rewards: Kinds of reward that there are.
        reward_from_frames: Whether reward and success follow from frames: its environment computes them, and
            `reward` and `is_success` raise.
    """

    name: str
    title: str
    actions: tuple[Action, ...]
    starts: tuple[Pose, ...]
    displacements: tuple[Move, ...]
    states: tuple[Pose, ...]
    reward: Callable[[Pose, Pose, str], float]
    is_success: Callable[[Pose, Pose], bool]
    distance_mm: Callable[[Pose, Pose], float]
    n_steps: int = 16
    limits: Limits = LIMITS
    stops: bool = False
    rewards: tuple[str, ...] = (*REWARDS, IMAGE)
    reward_from_frames: bool = False

    def __post_init__(self) -> None:
        """Check what there must be, and that every start is a state; lists become tuples.

        Raises:
            ValueError: If that is not so.
        """
        for name in ("actions", "states", "starts", "displacements"):
            if not getattr(self, name):
                raise ValueError(f"the task {self.name!r} must have {name}.")
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for start in self.starts:
            self.index(start)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of a pose's coordinates, in their order."""
        return coordinates(self.states[0])

    def pose(self, values: Mapping[str, int]) -> Pose:
        """Return the pose whose coordinates `values` holds by name, as `info` does."""
        return type(self.states[0])(**{name: values[name] for name in self.coordinates})

    @property
    def stay(self) -> int:
        """The action that moves nothing."""
        return [action.move for action in self.actions].index(Move())

    @property
    def moves_focus(self) -> bool:
        """Whether an action changes the focal depth."""
        return any(action.move.focal_depth_mm for action in self.actions)

    @cached_property
    def indices(self) -> dict[Pose, int]:
        """The place of every pose in `states`."""
        return {pose: index for index, pose in enumerate(self.states)}

    def index(self, pose: Pose) -> int:
        """Return where a pose stands in `states`; ValueError if the task cannot reach it."""
        index = self.indices.get(pose)
        if index is None:
            raise ValueError(f"pose must be one that task {self.name!r} can reach, not {pose}.")
        return index


def check_reward(reward: object, task: Task, kinds: Collection[str] = (*REWARDS, IMAGE)) -> str:
    """Return the reward if it is one of `kinds` that the task has, or raise ValueError with the closest."""
    allowed = [kind for kind in task.rewards if kind in kinds]
    if not isinstance(reward, str) or reward not in allowed:
        if len(task.rewards) == 1:
            raise ValueError(
                f"the task {task.name!r} has the reward {task.rewards[0]!r} alone, not {reward!r}."
            )
        raise unknown("reward", reward, allowed)
    return reward
