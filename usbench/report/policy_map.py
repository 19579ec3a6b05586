"""What trained agents do in every pose, beside the optimum. Agents are opened here, which takes torch."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from usbench import suite
from usbench.envs import oracle
from usbench.envs.task import Task
from usbench.figures import state_map, style
from usbench.setting import Setting
from usbench.trials import model_loading

Actions = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


def greedy_actions(trial: Path) -> Actions:
    """Return the most probable action of a trial's agent in every state of its task, (n_states,).

    The agent sees what it sees at the start of an episode: the same frame in its whole stack.

    Raises:
        ConfigurationError: If there is no model that can be opened; one sentence says why.
    """
    torch.set_num_threads(1)  # as in training: the bits do not depend on the machine
    loaded = model_loading.load_agent(trial)
    task = suite.TASKS[loaded.config.task].guidance
    env = Setting.recorded(loaded.config).make_env()
    starts = [env.reset(options=asdict(pose)) for pose in task.states]
    env.close()
    seen = (
        [{**info, "step": 0} for _, info in starts]
        if getattr(loaded.agent, "sees_state", False)
        else np.stack([observation for observation, _ in starts])
    )
    first = np.ones(len(starts), dtype=bool)
    actions, _ = loaded.agent.predict(seen, episode_start=first, deterministic=True)
    return np.asarray(actions, dtype=np.int64)


def costs(task: Task, noise: float) -> Floats:
    """Return what every first action costs, (n_states, n_actions): return lost against the best action.

    Expected over an episode that begins in the state and goes on with the best actions; 0 for the best.
    """
    return np.asarray(oracle.policy(task, noise).costs[0])


def is_best(task: Task, noise: float, actions: Actions) -> npt.NDArray[np.bool_]:
    """Return where an action of (n_states,) is as good as the best one."""
    return np.asarray(oracle.policy(task, noise).best[0][np.arange(len(actions)), actions])


def draw(task: Task, noise: float, actions: Actions) -> Figure:
    """Draw the actions (n_states,) on the return that each costs; a cross in the corner where it costs any.

    A dashed line goes round the poses where episodes start.
    """
    cost = costs(task, noise)
    figure, axes = style.panels(1, 1, width=4.0, height=4.1)
    axis = axes[0, 0]
    own = cost[np.arange(len(actions)), actions]
    image = state_map.draw(axis, task, actions, own, vmin=0.0, vmax=float(cost.max()))
    key = state_map.coordinate(task)
    places = np.array([(pose.x_mm, getattr(pose, key)) for pose in task.states], dtype=float)
    step = np.array([np.diff(np.unique(column)).min() for column in places.T])
    wrong = places[~is_best(task, noise, actions)] + 0.34 * step
    axis.plot(*wrong.T, "x", color="#d55e00", markersize=4, markeredgewidth=1.3)
    starts = np.array([(pose.x_mm, getattr(pose, key)) for pose in task.starts], dtype=float)
    low, high = starts.min(axis=0) - step / 2, starts.max(axis=0) + step / 2
    axis.add_patch(Rectangle(tuple(low), *(high - low), fill=False, linestyle="--", linewidth=1.2))
    axis.set_title("")
    figure.colorbar(image, ax=axis, label="return that the action costs")
    return figure
