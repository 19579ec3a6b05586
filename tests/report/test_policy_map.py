"""What agents do in every pose: costs from theory, actions as the agent itself takes them."""

import math
from dataclasses import asdict

import numpy as np
import pytest

from usbench.envs import oracle
from usbench.envs.pose import Pose
from usbench.envs.tasks.focal_point import FOCAL_POINT
from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.report import policy_map
from usbench.setting import make_env
from usbench.trials import model_loading


def test_a_step_away_from_the_goal_costs_what_it_is_away():
    # The step back ends at the goal again, where the reward is 0.
    cost = policy_map.costs(PROBE_PLANE, 0.0)[PROBE_PLANE.indices[Pose(0, 50, 0)]]
    sine = math.sin(math.radians(15))
    np.testing.assert_allclose(cost, [0, 5 / 20, 5 / 20, sine, sine], atol=1e-12)


def test_standing_still_costs_a_step():
    # Down 8 times from 10 mm deep gives -(35 + 30 + ... + 5 + 0) / 50. One step still comes first with
    # -40 / 50, one up with -45 / 50 and -40 / 50, one aside with -5 / 20 - 40 / 50 and, back, -40 / 50.
    cost = policy_map.costs(FOCAL_POINT, 0.0)[FOCAL_POINT.indices[Pose(0, 10, 0)]]
    names = [action.name for action in FOCAL_POINT.actions]
    assert dict(zip(names, cost, strict=True)) == pytest.approx(
        {"stay": 0.8, "left": 1.85, "right": 1.85, "up": 1.7, "down": 0.0}
    )


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("task", [FOCAL_POINT, PROBE_PLANE], ids=lambda task: task.name)
def test_only_the_best_actions_cost_nothing(task, noise):
    cost = policy_map.costs(task, noise)
    best = oracle.policy(task, noise).best[0]
    assert (cost[best] == 0).all() and (cost[~best] > 1e-9).all()
    assert policy_map.is_best(task, noise, oracle.policy(task, noise).actions[0]).all()


def test_actions_are_those_that_the_agent_takes_after_a_reset(finished):
    actions = policy_map.greedy_actions(finished)
    assert actions.shape == (len(PROBE_PLANE.states),)
    agent, env = model_loading.load_agent(finished).agent, make_env("pp")
    for state in (0, 100, 215):
        observation, _ = env.reset(options=asdict(PROBE_PLANE.states[state]))
        assert actions[state] == agent.predict(observation, deterministic=True)[0]


def test_crosses_stand_where_an_action_costs_return():
    actions = oracle.policy(PROBE_PLANE).actions[0].astype(int)
    away = PROBE_PLANE.indices[Pose(0, 50, 0)]
    actions[away] = 1
    axis = policy_map.draw(PROBE_PLANE, 0.0, actions).axes[0]
    (crosses,) = [line for line in axis.lines if line.get_marker() == "x"]
    assert len(crosses.get_xdata()) == 1
    assert abs(crosses.get_xdata()[0] - 0) < 2.5 and abs(crosses.get_ydata()[0] - 0) < 7.5
