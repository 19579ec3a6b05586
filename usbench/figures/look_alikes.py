"""Poses that look alike and need different actions: where an agent that sees one frame may err."""

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from usbench.envs import oracle
from usbench.envs.task import Task
from usbench.figures import state_map, style

Floats = npt.NDArray[np.float64]


def similarity(frames: npt.NDArray[np.uint8]) -> Floats:
    """Return the correlation of every frame with every other, (n, n), from frames (n, height, width)."""
    return np.asarray(np.corrcoef(frames.reshape(len(frames), -1)))


def conflicts(task: Task) -> npt.NDArray[np.bool_]:
    """Return whether no action is best in both of two states, (n_states, n_states)."""
    best = oracle.policy(task).best[0].astype(int)
    return np.asarray(best @ best.T == 0)


def most_alike(task: Task, frames: npt.NDArray[np.uint8], count: int) -> pd.DataFrame:
    """Return the `count` pairs of states with the most similar `frames` that need different actions.

    Columns: `pose`, `other`, `correlation`, `action`, `other_action`.
    """
    found = np.triu(np.where(conflicts(task), similarity(frames), -1.0), 1)
    order = np.argsort(-found, axis=None, kind="stable")[:count]
    best = oracle.policy(task).best[0]

    def names(state: int) -> str:
        return " or ".join(
            action.name for action, good in zip(task.actions, best[state], strict=True) if good
        )

    return pd.DataFrame(
        {
            "pose": state_map.name(task, i),
            "other": state_map.name(task, j),
            "correlation": found[i, j],
            "action": names(i),
            "other_action": names(j),
        }
        for i, j in (divmod(int(pair), len(task.states)) for pair in order)
    )


def draw(frames: dict[Task, npt.NDArray[np.uint8]]) -> Figure:
    """Draw the states of each task: its best action, and how alike the most alike frame of another one is."""
    figure, axes = style.panels(1, len(frames), height=4.2)
    for axis, (task, own) in zip(axes[0], frames.items(), strict=True):
        alike = np.where(conflicts(task), similarity(own), -1.0).max(axis=1)
        image = state_map.draw(axis, task, oracle.policy(task).actions[0], alike, vmin=0.5, vmax=1.0)
    figure.colorbar(
        image, ax=axes[0], label="correlation with the most similar frame\nthat needs another action"
    )
    return figure
