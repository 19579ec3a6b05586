"""What an agent may have before it: every pose of the probe with every place of the object, and what is seen.

Ideal eyes see how much of the object lies behind every pixel, within the slice of tissue that makes a frame,
and nothing else: no speckle by which one phantom is told from another, and no blur. The object's size is the
paper's and known, so that a ceiling for these eyes is an upper bound where sizes are drawn too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from usbench.anchors import Anchors
from usbench.envs import oracle
from usbench.envs.bmode import DEFAULT_IMAGING
from usbench.envs.observation import senses as sensing
from usbench.envs.phantom import ObjectOfInterest
from usbench.envs.pose import Move, Pose, cos_deg, sin_deg
from usbench.envs.probe import DEFAULT_ARRAY
from usbench.envs.task import Task
from usbench.envs.tasks.phantom_distribution import PhantomDistribution

Ints = npt.NDArray[np.int64]
Picture = npt.NDArray[np.float32]
_ROUNDING_MM = 1e-6  # mirrored pictures are the same to the bit


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """All pairs of a pose and an object that an episode may have; their number is n_states * n_targets.

    Hypothesis h is the state h // n_targets with the target h % n_targets.

    Attributes:
        task: The task.
        targets: The objects' poses, one of several that show the same.
        seen: Which frames look alike: a number for every hypothesis, (n_states, n_targets).
    """

    task: Task
    targets: tuple[Pose, ...]
    seen: Ints

    @cached_property
    def places(self) -> dict[tuple[int, int], int]:
        """The number of each target by its position in mm and its angle in degrees."""
        return {(target.x_mm, target.angle_deg): k for k, target in enumerate(self.targets)}

    @cached_property
    def rewards(self) -> npt.NDArray[np.float64]:
        """The normalised reward of being there, (n_hypotheses,)."""
        return np.array(
            [
                [self.task.reward(pose, target, "normalized") for target in self.targets]
                for pose in self.task.states
            ]
        ).ravel()

    @cached_property
    def following(self) -> Ints:
        """The hypothesis after every action, (n_hypotheses, n_actions), without noise."""
        return self._moved([action.move for action in self.task.actions])

    @cached_property
    def displaced(self) -> Ints:
        """The hypothesis after each of the task's displacements, (n_hypotheses, n_displacements)."""
        return self._moved([*self.task.displacements])

    @cached_property
    def starts(self) -> Ints:
        """The hypotheses with which an episode may begin, (n_starts * n_targets,), all as likely."""
        places = np.array([self.task.indices[pose] for pose in self.task.starts])
        return np.asarray((places[:, np.newaxis] * len(self.targets) + np.arange(len(self.targets))).ravel())

    def _moved(self, moves: Sequence[Move]) -> Ints:
        """Return the hypothesis after each of the moves, (n_hypotheses, n_moves)."""
        task, n = self.task, len(self.targets)
        after = np.array(
            [[task.indices[pose.moved(move, task.limits)] for move in moves] for pose in task.states]
        )
        every = after[:, np.newaxis, :] * n + np.arange(n)[np.newaxis, :, np.newaxis]
        return np.asarray(every.reshape(-1, len(moves)), dtype=np.int64)

    @cached_property
    def shows(self) -> npt.NDArray[np.bool_]:
        """Whether what is seen is of the object without any doubt, (n_states, n_targets)."""
        relations, pairs = _relations(self.task, self.targets)
        shown = np.array([thickness_mm(*pair).any() for pair in pairs])
        without_doubt = np.ones(int(self.seen.max()) + 1, np.bool_)
        np.logical_and.at(without_doubt, self.seen, shown[relations])
        return without_doubt[self.seen]

    def told(self, senses: Sequence[str]) -> Ints:
        """Return what the senses of the pose tell: a number for every hypothesis, (n_hypotheses,)."""
        known = sensing.checked(senses, self.task)
        values = np.array([known.values(pose, None) for pose in self.task.states])
        values = values.reshape(len(self.task.states), -1).round(6)
        _, numbers = np.unique(values, axis=0, return_inverse=True)
        return np.repeat(numbers.ravel().astype(np.int64), len(self.targets))

    def observed(self, senses: Sequence[str]) -> Ints:
        """Return frame and senses together as a number for every hypothesis, (n_hypotheses,)."""
        both = self.seen.ravel() * len(self.seen.ravel()) + self.told(senses)
        return np.asarray(np.unique(both, return_inverse=True)[1].ravel(), dtype=np.int64)

    @cached_property
    def anchors(self) -> Anchors:
        """Mean returns over the starts and targets, between which scores are measured."""
        found = [oracle.returns(self.task, target=target, starts=self.task.starts) for target in self.targets]
        return Anchors.mean(found)


def of_distribution(task: Task, phantoms: PhantomDistribution) -> Hypotheses:
    """Return the hypotheses of a task whose phantoms are drawn.

    Objects that are turned by 180 degrees are the same, and so are objects of other depths where the focus
    stays: an agent sees how deep an object lies.

    Args:
        task: The task, which moves the probe and turns it, with the focus where it is.
        phantoms: What its phantoms are drawn from.

    Raises:
        ValueError: If the task moves the focus, which ideal eyes do not see, or places of the object are not
            equally probable.
    """
    each = Counter(product(phantoms.x_mm, (angle % 180 for angle in phantoms.angle_deg)))
    if len(set(each.values())) > 1:
        raise ValueError(
            "places and planes (angles modulo 180 degrees) of the object must be equally probable, not "
            f"x_mm {phantoms.x_mm} and angle_deg {phantoms.angle_deg}."
        )
    if len({pose.focal_depth_mm for pose in task.states}) > 1:
        raise ValueError(f"the task {task.name!r} moves the focus, which ideal eyes do not see.")
    depth = task.states[0].focal_depth_mm
    angles = sorted({angle % 180 for angle in phantoms.angle_deg})
    targets = tuple(Pose(x_mm, depth, angle) for x_mm in dict.fromkeys(phantoms.x_mm) for angle in angles)
    relations, pairs = _relations(task, targets)
    pictures = np.array([thickness_mm(*pair) for pair in pairs])
    same = np.unique(pictures, axis=0, return_inverse=True)[1].ravel().astype(np.int64)
    return Hypotheses(task, targets, same[relations])


def _relations(task: Task, targets: Sequence[Pose]) -> tuple[Ints, list[tuple[Pose, Pose]]]:
    """Return a number for how probe and object lie to each other, (n_states, n_targets), and a pair of each.

    The picture depends on that alone: pairs are of a target and a pose.
    """
    number_of: dict[tuple[int, int, int], int] = {}
    pairs: list[tuple[Pose, Pose]] = []
    numbers = np.zeros((len(task.states), len(targets)), dtype=np.int64)
    for (i, pose), (j, target) in product(enumerate(task.states), enumerate(targets)):
        relation = (target.x_mm - pose.x_mm, target.angle_deg, pose.angle_deg)
        if relation not in number_of:
            number_of[relation] = len(pairs)
            pairs.append((target, pose))
        numbers[i, j] = number_of[relation]
    return numbers, pairs


def thickness_mm(target: Pose, pose: Pose) -> Picture:
    """Return how much of the object at `target` lies behind each pixel from `pose`, (n_pixels,) mm.

    Counted is what lies in the slice that makes a frame: up to half of its thickness from the image plane.
    Object, array and imaging are the paper's.
    """
    array, imaging = DEFAULT_ARRAY, DEFAULT_IMAGING
    ooi = ObjectOfInterest(target.x_mm, target.focal_depth_mm, target.angle_deg)
    pixel_mm, half_mm = imaging.pixel_size * 1e3, array.slice_thickness * 1e3 / 2
    u = (np.arange(imaging.width_px) + 0.5 - imaging.width_px / 2) * pixel_mm
    z = (np.arange(imaging.height_px) + 0.5) * pixel_mm
    total = np.zeros((len(z), len(u)))
    for ball in ooi.balls:
        x, y, depth = ball.center_mm[0] - pose.x_mm, ball.center_mm[1], ball.center_mm[2]
        along = cos_deg(pose.angle_deg) * x + sin_deg(pose.angle_deg) * y
        across = cos_deg(pose.angle_deg) * y - sin_deg(pose.angle_deg) * x
        squared = ball.radius_mm**2 - np.square(u - along) - np.square(z[:, np.newaxis] - depth)
        half_chord = np.sqrt(np.maximum(squared, 0.0))
        first, last = np.maximum(across - half_chord, -half_mm), np.minimum(across + half_chord, half_mm)
        total += np.maximum(last - first, 0.0)
    return np.asarray(np.rint(total.ravel() / _ROUNDING_MM) * _ROUNDING_MM, dtype=np.float32)
