"""Exact symmetries of a task: other observations and actions that mean the same.

Where every episode draws its tissue, the object is symmetric about its plane and its axis, as the beam is
in elevation. So, where objects are drawn evenly on both sides of every axis, three changes of the scene leave
an episode what it was, but for speckle:

* elevation reflected: both angles are negated. The picture stays, the two rotations swap.
* the probe turned about: its angle grows by 180 degrees. The picture is mirrored, every action stays.
* the probe turned about and x negated: the picture stays, left and right swap.

Each undoes itself, and their order does not matter: together they make eight symmetries.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt

from usbench.envs.observation.senses import ACTIONS, Senses
from usbench.envs.pose import Move, Pose
from usbench.envs.task import Task
from usbench.envs.tasks.phantom_distribution import PhantomDistribution


@dataclass(frozen=True)
class Symmetries:
    """The symmetries of a task for an agent with some senses, as arrays; the first changes nothing.

    Attributes:
        mirrored: Whether left and right of the picture swap, (n,) bool.
        sources: From which of an observation's senses each sense comes, (n, size) integers.
        signs: What that sense is multiplied by, (n, size) of -1 and 1.
        actions: What each action becomes, (n, n_actions) integers.
        coordinates: Which senses are coordinates of the probe, (size,) bool; the others are the last action.
    """

    mirrored: npt.NDArray[np.bool_]
    sources: npt.NDArray[np.int64]
    signs: npt.NDArray[np.float32]
    actions: npt.NDArray[np.int64]
    coordinates: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.mirrored)


@dataclass(frozen=True)
class _Change:
    """A symmetry as it acts on poses: signs of x and angle, and an angle that is added."""

    x: int
    angle: int
    turn_deg: int

    @property
    def mirrors(self) -> bool:
        """Whether the picture is mirrored: the turned probe shows so, and negated x shows it back."""
        return (self.turn_deg == 180) != (self.x == -1)

    def pose(self, pose: Pose) -> Pose:
        """Return the pose that takes the place of `pose`."""
        angle = (self.angle * pose.angle_deg + self.turn_deg) % 360
        return replace(pose, x_mm=self.x * pose.x_mm, angle_deg=angle)

    def move(self, move: Move) -> Move:
        """Return the move that takes the place of `move`."""
        return replace(move, x_mm=self.x * move.x_mm, angle_deg=self.angle * move.angle_deg)


# Elevation reflected or not, turned about or not, turned about with x negated or not.
_ALL = tuple(
    _Change(x=-1 if negated else 1, angle=-1 if reflected else 1, turn_deg=180 * (turned != negated))
    for negated, turned, reflected in product((False, True), repeat=3)
)


def symmetries(senses: Senses, phantoms: PhantomDistribution | None) -> Symmetries:
    """Return the symmetries of the senses' task, each once.

    They are those that lead from its poses to its poses, from its actions and slips to its own, and from the
    objects that are drawn to objects that are drawn as often.

    Args:
        senses: What the agent is told beside the frames.
        phantoms: What every episode draws its tissue from. None where it draws none: then the symmetry that
            changes nothing is the only one.
    """
    task = senses.task
    found = []
    for change in _ALL[:1] if phantoms is None else _ALL:
        if _keeps(change, task) and (phantoms is None or _keeps_objects(change, phantoms)):
            becomes = _actions(change, task)
            found.append((change.mirrors, *_on_senses(change, senses, becomes), becomes))
    # Where a probe never turns, some are the same for the agent.
    different = [one for place, one in enumerate(found) if one not in found[:place]]
    mirrored, sources, signs, actions = zip(*different, strict=True)
    n_actions = len(task.actions) if ACTIONS in senses.names else 0
    return Symmetries(
        mirrored=np.array(mirrored),
        sources=np.array(sources, np.int64),
        signs=np.array(signs, np.float32),
        actions=np.array(actions, np.int64),
        coordinates=np.arange(senses.size) < senses.size - n_actions,
    )


def _keeps(change: _Change, task: Task) -> bool:
    """Return whether poses, actions and slips of the task become such of the task, slips as probable."""
    moves = {action.move for action in task.actions}
    slips = Counter(task.displacements)
    return (
        {change.pose(pose) for pose in task.states} <= task.indices.keys()
        and {change.move(move) for move in moves} <= moves
        and Counter(change.move(move) for move in slips.elements()) == slips
    )


def _keeps_objects(change: _Change, phantoms: PhantomDistribution) -> bool:
    """Return whether objects are drawn as often where the change puts them; turned about, one is the same."""
    x, angle = Counter(phantoms.x_mm), Counter(angle_deg % 180 for angle_deg in phantoms.angle_deg)
    return (
        Counter(change.x * x_mm for x_mm in x.elements()) == x
        and Counter(change.angle * angle_deg % 180 for angle_deg in angle.elements()) == angle
    )


def _actions(change: _Change, task: Task) -> list[int]:
    """Return what each action becomes; one that does not move the probe stays."""
    moves = [action.move for action in task.actions]
    return [
        number if change.move(move) == move else moves.index(change.move(move))
        for number, move in enumerate(moves)
    ]


def _on_senses(change: _Change, senses: Senses, actions: list[int]) -> tuple[list[int], list[int]]:
    """Return from where each sense comes, and with which sign."""
    sines = change.angle * (-1 if change.turn_deg else 1)
    by_name = {"position": [change.x], "focus": [1], "heading": [sines, -1 if change.turn_deg else 1]}
    signs = [sign for name in senses.names if name != ACTIONS for sign in by_name[name]]
    sources = list(range(len(signs)))
    if ACTIONS in senses.names:
        # The changes undo themselves: the action that became this one is the one that this one becomes.
        sources += [len(signs) + action for action in actions]
        signs += [1] * len(actions)
    return sources, signs
