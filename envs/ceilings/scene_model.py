"""What a classical agent knows of a task: what looks alike, what senses tell, what the oracle does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.checks import probability
from usbench.envs import oracle
from usbench.envs.ceilings import hypotheses
from usbench.envs.ceilings.hypotheses import Hypotheses, Ints
from usbench.envs.observation import senses as sensing
from usbench.envs.task import Task
from usbench.envs.tasks.phantom_distribution import PhantomDistribution


@dataclass(frozen=True, eq=False)
class SceneModel:
    """A task with a tracked probe, as sets of poses that look alike and places where the object may be.

    Attributes:
        task: The task.
        phantoms: What its phantoms are drawn from.
        senses: What the agent is told, its last action among it or not.
        noise: Probability of a displacement after each action.

    Raises:
        ValueError: If the task moves the focus, or its senses do not tell the pose.
    """

    task: Task
    phantoms: PhantomDistribution
    senses: tuple[str, ...]
    noise: float = 0.0

    def __post_init__(self) -> None:
        """Check that the pose is told."""
        object.__setattr__(self, "noise", probability("noise", self.noise))
        if self.task.moves_focus:
            raise ValueError(
                f"a classical agent does not know how frames change with the focus, which the task "
                f"{self.task.name!r} moves."
            )
        sensing.check_pose_told(self.senses, self.task, "a classical agent")

    @cached_property
    def looks(self) -> Ints:
        """How the object looks to ideal eyes, a number for each place and pose, (n_states, n_targets)."""
        return self._known.seen

    @property
    def n_looks(self) -> int:
        """How many different looks there are."""
        return int(self.looks.max()) + 1

    @cached_property
    def is_best(self) -> npt.NDArray[np.float32]:
        """1 for the oracle's actions at each pose and place, else 0, (n_states, n_targets, n_actions)."""
        policies = [oracle.policy(self.task, self.noise, target=one) for one in self._known.targets]
        return np.stack([policy.best[0] for policy in policies], axis=1).astype(np.float32)

    def look(self, infos: Sequence[Mapping[str, Any]]) -> Ints:
        """Return how the object looks where `infos` say, (n,): the truth, for training."""
        states = [self.task.indices[self.task.pose(one)] for one in infos]
        targets = [self._known.places[one["target_x_mm"], one["target_angle_deg"] % 180] for one in infos]
        return self.looks[states, targets]

    def states(self, senses: npt.NDArray[np.float32]) -> Ints:
        """Return the numbers (n,) of the poses that stacked senses (n, size) tell last."""
        own = senses[:, -self._senses.size :][:, np.newaxis, : self._told.shape[1]]
        return np.asarray(np.abs(self._told - own).sum(axis=2).argmin(axis=1), dtype=np.int64)

    @cached_property
    def _known(self) -> Hypotheses:
        return hypotheses.of_distribution(self.task, self.phantoms)

    @cached_property
    def _senses(self) -> sensing.Senses:
        return sensing.checked(self.senses, self.task)

    @cached_property
    def _told(self) -> npt.NDArray[np.float32]:
        """What the senses tell of each pose, without the last action, (n_states, size)."""
        pose = sensing.checked((name for name in self.senses if name != sensing.ACTIONS), self.task)
        return np.stack([pose.values(state, None) for state in self.task.states])


@lru_cache(maxsize=1)
def scene_model(
    task: Task, phantoms: PhantomDistribution, senses: tuple[str, ...], noise: float
) -> SceneModel:
    """Return a model, the last one again where it is the same: all that it computes is kept."""
    return SceneModel(task, phantoms, senses, noise)
