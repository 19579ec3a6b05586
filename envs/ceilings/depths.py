"""What is known of the focus and of how deep the object lies, beside a belief about all else.

Whoever has seen the object once knows how deep it lies, and before, every depth is as likely. Rewards are a
sum of one part of position and angle and one of the focus, so that values stay exact although both are kept
apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from usbench.envs.ceilings.hypotheses import Ints
from usbench.envs.pose import Move, Pose
from usbench.envs.task import Task
from usbench.envs.tasks.phantom_distribution import PhantomDistribution

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Depths:
    """What is known of the focus and of the object's depth, a column each.

    The first `n_known` columns are pairs of a focus and a depth, the depths of a focus together; the others
    are foci with an object that was never seen.

    Attributes:
        focus_mm: Where the focus may be.
        depth_mm: Where objects may lie; one where the task keeps the focus and depths do not matter.
        rewards: The focus's part of the reward, (n_columns,).
        following: The column after each action, (n_actions, n_columns).
        displaced: The column after each displacement, (n_displacements, n_columns).
        starts: How often an episode begins with each focus, (n_foci,).
    """

    focus_mm: tuple[int, ...]
    depth_mm: tuple[int, ...]
    rewards: Floats
    following: Ints
    displaced: Ints
    starts: Floats

    @classmethod
    def of(cls, task: Task, phantoms: PhantomDistribution) -> Depths:
        """Return them for a task."""
        focus_mm = tuple(sorted({pose.focal_depth_mm for pose in task.states}))
        depth_mm = phantoms.depth_mm if task.moves_focus else focus_mm
        one = task.states[0]

        def at(depth: int) -> Pose:
            return replace(one, focal_depth_mm=depth)

        rewards = np.array([[task.reward(at(f), at(d), "normalized") for d in depth_mm] for f in focus_mm])

        def after(moves: Sequence[Move]) -> Ints:
            foci = [
                [focus_mm.index(at(f).moved(move, task.limits).focal_depth_mm) for f in focus_mm]
                for move in moves
            ]
            pairs = np.array(foci)[:, :, np.newaxis] * len(depth_mm) + np.arange(len(depth_mm))
            unseen = rewards.size + np.array(foci)
            return np.concatenate([pairs.reshape(len(moves), -1), unseen], axis=1)

        begun = [pose.focal_depth_mm for pose in task.starts]
        return cls(
            focus_mm,
            depth_mm,
            np.concatenate([rewards.ravel(), rewards.mean(axis=1)]),
            after([action.move for action in task.actions]),
            after(task.displacements),
            np.array([begun.count(f) for f in focus_mm]) / len(begun),
        )

    @property
    def n_depths(self) -> int:
        """How many depths objects may have."""
        return len(self.depth_mm)

    @property
    def n_known(self) -> int:
        """How many columns are pairs of a focus and a depth."""
        return len(self.focus_mm) * len(self.depth_mm)

    @property
    def n_columns(self) -> int:
        """How many columns there are."""
        return self.n_known + len(self.focus_mm)

    def column(self, focus_mm: int, depth_mm: int | None) -> int:
        """Return the column of a focus and the object's depth, None where it is not known."""
        focus = self.focus_mm.index(focus_mm)
        if depth_mm is None:
            return self.n_known + focus
        place = self.depth_mm.index(depth_mm) if self.n_depths > 1 else 0
        return focus * self.n_depths + place


def focus_held(task: Task, depth_mm: int) -> Task:
    """Return the task with the focus held at a depth."""

    def at_depth(poses: Sequence[Pose]) -> tuple[Pose, ...]:
        return tuple(dict.fromkeys(replace(pose, focal_depth_mm=depth_mm) for pose in poses))

    return replace(
        task,
        states=at_depth(task.states),
        starts=at_depth(task.starts),
        limits=replace(task.limits, focal_depth_mm=(depth_mm, depth_mm)),
    )
