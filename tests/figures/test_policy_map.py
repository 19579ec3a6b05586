"""Maps of actions: what an action loses follows from theory, and crosses stand where it loses anything."""

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.quiver import Quiver

from usbench.envs import oracle
from usbench.envs.pose import Pose
from usbench.envs.tasks.examination import EXAMINATION
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.figures import policy_map, state_map


def costs(task, noise, pose):
    """What every action loses in a pose, (n_actions,)."""
    plan, state = oracle.policy(task, noise), task.indices[pose]
    actions = np.zeros(len(task.states), np.int64)
    return [policy_map.lost(plan, actions + number)[state] for number in range(len(task.actions))]


def test_a_step_away_from_the_goal_costs_what_it_is_away():
    # The step back ends at the goal again, where the reward is 0.
    cost = costs(PROBE_PLANE, 0.0, Pose(0, 50, 0))
    sine = math.sin(math.radians(15))
    np.testing.assert_allclose(cost, [0, 5 / 20, 5 / 20, sine, sine], atol=1e-12)


def test_standing_still_costs_a_step():
    # Down 8 times from 10 mm deep gives -(35 + 30 + ... + 5 + 0) / 50. One step still comes first with
    # -40 / 50, one up with -45 / 50 and -40 / 50, one aside with -5 / 20 - 40 / 50 and, back, -40 / 50.
    cost = costs(FOCAL_POINT, 0.0, Pose(0, 10, 0))
    names = [action.name for action in FOCAL_POINT.actions]
    assert dict(zip(names, cost, strict=True)) == pytest.approx(
        {"stay": 0.8, "left": 1.85, "right": 1.85, "up": 1.7, "down": 0.0}
    )


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("task", [FOCAL_POINT, PROBE_PLANE], ids=lambda task: task.name)
def test_only_the_best_actions_cost_nothing(task, noise):
    plan = oracle.policy(task, noise)
    assert (policy_map.lost(plan, plan.actions[0]) == 0).all()
    for action, best in enumerate(plan.best[0].T):
        lost = policy_map.lost(plan, np.full(len(task.states), action))
        assert (lost[best] == 0).all() and (lost[~best] > 1e-9).all()


def test_crosses_stand_where_an_action_costs_return():
    actions = oracle.policy(PROBE_PLANE).actions[0].astype(int)
    away = PROBE_PLANE.indices[Pose(0, 50, 0)]
    actions[away] = 1
    axis = policy_map.draw(oracle.policy(PROBE_PLANE), actions).axes[0]
    (crosses,) = [line for line in axis.lines if line.get_marker() == "x"]
    assert len(crosses.get_xdata()) == 1
    assert abs(crosses.get_xdata()[0] - 0) < 2.5 and abs(crosses.get_ydata()[0] - 0) < 7.5


def test_arrows_are_all_as_long_on_paper():
    plan = oracle.policy(PROBE_PLANE)
    figure = policy_map.draw(plan, plan.actions[0].astype(int))
    FigureCanvasAgg(figure).draw()
    (arrows,) = (drawn for drawn in figure.axes[0].collections if isinstance(drawn, Quiver))
    # Longer than wide, whatever its direction.
    lengths = [np.ptp(path.vertices, axis=0).max() for path in arrows.get_paths()]
    assert len(lengths) > 100 and lengths == pytest.approx([lengths[0]] * len(lengths))


def test_a_task_with_two_coordinates_beside_the_position_has_no_flat_map():
    with pytest.raises(ValueError, match="task 'exam' has no flat map: focal_depth_mm, angle_deg varies"):
        state_map.coordinate(EXAMINATION)
