"""The states of a task as a map: position across, the other coordinate of the pose upwards."""

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from usbench.coordinates import BY_NAME
from usbench.envs.task import Task


def coordinates(task: Task) -> list[str]:
    """Return which coordinates vary beside the position."""
    _, *others = task.coordinates
    return [key for key in others if len({getattr(pose, key) for pose in task.states}) > 1]


def coordinate(task: Task) -> str:
    """Return the only coordinate that varies beside the position, `focal_depth_mm` for example."""
    varying = coordinates(task)
    if len(varying) != 1:
        raise ValueError(f"task {task.name!r} has no flat map: {', '.join(varying) or 'nothing'} varies.")
    return varying[0]


def name(task: Task, state: int) -> str:
    """Return a state in words, as "x 5 mm, 15 degrees"."""
    pose = task.states[state]
    shown = [task.coordinates[0], *coordinates(task)]
    return ", ".join(BY_NAME[key].value.format(getattr(pose, key)) for key in shown)


def draw(
    axis: Axes,
    task: Task,
    actions: npt.NDArray[np.integer],
    shades: npt.NDArray[np.floating],
    *,
    vmin: float,
    vmax: float,
) -> Any:
    """Draw an arrow for the action in every state on its shade.

    Args:
        axis: Where to.
        task: Whose states.
        actions: (n_states,).
        shades: (n_states,), from `vmin` (white) to `vmax` (dark).
        vmin: See `shades`.
        vmax: See `shades`.

    Returns:
        What a colour bar is made from.
    """
    key = coordinate(task)
    x = np.array([pose.x_mm for pose in task.states])
    y = np.array([getattr(pose, key) for pose in task.states])
    columns, rows = np.unique(x), np.unique(y)
    grid = np.full((len(rows), len(columns)), np.nan)
    grid[np.searchsorted(rows, y), np.searchsorted(columns, x)] = shades
    image = axis.pcolormesh(columns, rows, grid, cmap="Blues", vmin=vmin, vmax=vmax)
    colors = np.where(np.asarray(shades) > (vmin + vmax) / 2, "white", "black")
    steps = np.array([_direction(task, key, int(action)) for action in actions])
    moves = steps.any(axis=1)
    # All as long on paper: 0.7 of a row, whose height limits arrows upwards and downwards.
    length = 0.7 / len(rows)
    axis.quiver(
        x[moves], y[moves], *steps[moves].T,
        angles="xy", units="height", scale_units="height", scale=1 / length, pivot="mid", width=0.13 * length,
        color=colors[moves],
    )  # fmt: skip
    axis.scatter(x[~moves], y[~moves], s=16, color=colors[~moves], zorder=3)
    axis.set(title=task.title, xlabel=BY_NAME["x_mm"].label, ylabel=BY_NAME[key].label)
    if key == "focal_depth_mm":
        axis.invert_yaxis()
    else:
        axis.set_yticks(range(0, 360, 45))
    axis.grid(visible=False)
    return image


def _direction(task: Task, key: str, action: int) -> tuple[int, int]:
    """Return where an action goes on the map: (-1, 0 or 1, -1, 0 or 1)."""
    move = task.actions[action].move
    return int(np.sign(move.x_mm)), int(np.sign(getattr(move, key)))
