"""What an agent does in every pose as a map, beside what the best policy would do."""

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from usbench.envs import oracle
from usbench.figures import state_map, style

Actions = npt.NDArray[np.int64]


def lost(plan: oracle.Policy, actions: Actions) -> npt.NDArray[np.float64]:
    """Return the return that every first action loses against the best one, (n_states,) as `actions`.

    It is expected over an episode that begins in the state and goes on with the best actions of `plan`; 0 for
    an action as good as the best.
    """
    return np.asarray(plan.costs[0][np.arange(len(actions)), actions])


def draw(plan: oracle.Policy, actions: Actions) -> Figure:
    """Draw the actions (n_states,) on the return that each loses; a cross in the corner where it loses any.

    A dashed line goes round the poses where episodes start.
    """
    task, own = plan.task, lost(plan, actions)
    figure, axes = style.panels(1, 1, width=4.0, height=4.1)
    axis = axes[0, 0]
    image = state_map.draw(axis, task, actions, own, vmin=0.0, vmax=float(plan.costs[0].max()))
    key = state_map.coordinate(task)
    places = np.array([(pose.x_mm, getattr(pose, key)) for pose in task.states], dtype=float)
    step = np.array([np.diff(np.unique(column)).min() for column in places.T])
    wrong = places[own > 0] + 0.34 * step
    axis.plot(*wrong.T, "x", color="#d55e00", markersize=4, markeredgewidth=1.3)
    starts = np.array([(pose.x_mm, getattr(pose, key)) for pose in task.starts], dtype=float)
    low, high = starts.min(axis=0) - step / 2, starts.max(axis=0) + step / 2
    axis.add_patch(Rectangle(tuple(low), *(high - low), fill=False, linestyle="--", linewidth=1.2))
    axis.set_title("")
    figure.colorbar(image, ax=axis, label="return that the action costs")
    return figure
