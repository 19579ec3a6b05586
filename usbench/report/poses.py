"""Poses on a page: what is seen in each, and the most alike of those that need different actions."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from usbench.envs.frames import frame_store
from usbench.envs.guidance import GuidanceEnv
from usbench.envs.task import Task
from usbench.figures import look_alikes, state_map
from usbench.report import pictures
from usbench.report.pictures import Picture
from usbench.setting import Setting

PAIRS = 6
# Correlation with a frame that needs another action, from which on a pose counts as a look-alike.
ALIKE = 0.95


@dataclass(frozen=True)
class Pair:
    """Two poses with similar frames where no action is best in both."""

    names: tuple[str, str]
    actions: tuple[str, str]
    frames: tuple[Picture, Picture]
    correlation: float


@dataclass(frozen=True)
class Poses:
    """What is seen in the states of a task.

    Attributes:
        task: Whose states they are.
        frames: (n_states, height, width, 1) uint8.
        digest: Of the frames, as trials record it.
        alike: Whether a state is a look-alike, (n_states,).
    """

    task: Task
    frames: npt.NDArray[np.uint8]
    digest: str
    alike: npt.NDArray[np.bool_]


def silence(setting: Setting) -> str:
    """Return why there is no map of actions in a setting, as the end of a sentence; empty if there is one."""
    if setting.row.phantoms:
        return "every phantom shows another frame in the same pose."
    if len(state_map.coordinates(setting.guidance)) > 1:
        return "a map has two dimensions, and the poses of this task have more."
    if setting.anatomy is not None:
        return "maps are made for the task's own phantom, not for a custom anatomy."
    own = Setting(task=setting.task)
    if (setting.probe, setting.imaging) != (own.probe, own.imaging):
        return "maps are made for the task's own probe and imaging, and this trial has others."
    return ""


def look(setting: Setting) -> Poses:
    """Return what is seen in the states of a setting; frames that are not on disk are simulated."""
    env = setting.plain_env()
    assert isinstance(env, GuidanceEnv)
    store = frame_store(env.phantom, env.probe, env.imaging)
    store.prepare(env.task.states)
    frames = np.stack([store.frame(pose) for pose in env.task.states])[..., np.newaxis]
    most = np.where(look_alikes.conflicts(env.task), look_alikes.similarity(frames), -1.0).max(axis=1)
    return Poses(env.task, frames, store.digest(env.task.states), most > ALIKE)


def pairs(poses: Poses) -> list[Pair]:
    """Return the pairs of poses that are most alike."""
    frames = {state_map.name(poses.task, state): frame for state, frame in enumerate(poses.frames)}
    return [
        Pair(
            (row.pose, row.other),
            (row.action, row.other_action),
            (pictures.from_frame(frames[row.pose]), pictures.from_frame(frames[row.other])),
            row.correlation,
        )
        for row in look_alikes.most_alike(poses.task, poses.frames, PAIRS).itertuples()
    ]


def overview(known: Mapping[str, Poses]) -> Picture:
    """Return the map of the optimum and of how alike poses are, a panel for each task."""
    return pictures.from_figure(look_alikes.draw({poses.task: poses.frames for poses in known.values()}))
