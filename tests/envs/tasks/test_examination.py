"""The examination with three degrees of freedom, and the one that the agent ends itself."""

import gymnasium as gym
import numpy as np
import pytest

from usbench.envs.oracle import policy, returns
from usbench.envs.pose import Pose
from usbench.envs.tasks.examination import EXAMINATION, EXAMINATION_STOP, ExaminationEnv, ExaminationStopEnv

TARGET = Pose(0, 50, 0)
STOP = 7


def test_rewards_worked_out_by_hand():
    cases = [
        (Pose(-15, 30, 30), "normalized", -(0.75 + 0.4 + 0.5)),
        (Pose(5, 90, 180), "normalized", -(0.25 + 0.8)),
        (Pose(10, 45, 330), "paper", -(10 + 5 + 0.5)),
        (Pose(0, 50, 180), "normalized", 0),
    ]
    for pose, kind, expected in cases:
        assert EXAMINATION.reward(pose, TARGET, kind) == pytest.approx(expected, abs=1e-12)


def test_success_needs_all_three():
    assert EXAMINATION.is_success(TARGET, TARGET) and EXAMINATION.is_success(Pose(0, 50, 180), TARGET)
    for pose in (Pose(5, 50, 0), Pose(0, 55, 0), Pose(0, 50, 15)):
        assert not EXAMINATION.is_success(pose, TARGET)
    assert EXAMINATION.distance_mm(Pose(-10, 30, 45), TARGET) == 30


def test_actions_move_one_coordinate_each(coded):
    env = ExaminationEnv()
    moves = [(0, 0, 0), (-5, 0, 0), (5, 0, 0), (0, -5, 0), (0, 5, 0), (0, 0, -15), (0, 0, 15)]
    for action, (x_mm, depth_mm, angle_deg) in enumerate(moves):
        env.reset(options={"x_mm": 5, "focal_depth_mm": 30, "angle_deg": 60})
        info = env.step(action)[4]
        found = info["x_mm"], info["focal_depth_mm"], info["angle_deg"]
        assert found == (5 + x_mm, 30 + depth_mm, 60 + angle_deg)


def test_every_state_is_a_start_and_the_goal_can_be_reached_from_each():
    assert len(EXAMINATION.states) == 9 * 18 * 24 == len(set(EXAMINATION.starts))
    farthest = max(
        abs(pose.x_mm) // 5
        + abs(pose.focal_depth_mm - 50) // 5
        + min(pose.angle_deg % 180, -pose.angle_deg % 180) // 15
        for pose in EXAMINATION.starts
    )
    assert farthest == 4 + 9 + 6 < EXAMINATION.n_steps


def test_the_optimum_of_a_start_worked_out_by_hand():
    # 5 mm beside, 10 mm too deep, 15 degrees off: the largest term goes first.
    lateral, axial, sine = 0.25, 0.1, np.sin(np.radians(15))
    expected = -((lateral + 2 * axial) + 2 * axial + axial)
    assert sine > lateral
    assert policy("exam").value(0, (5, 60, 15)) == pytest.approx(expected)


def test_the_oracle_earns_its_value_in_the_environment(coded):
    best = policy("exam", 0.0)
    env = gym.make("usbench/Examination-v0")
    for start in EXAMINATION.starts[::331]:
        options = {"x_mm": start.x_mm, "focal_depth_mm": start.focal_depth_mm, "angle_deg": start.angle_deg}
        _, info = env.reset(options=options)
        earned, truncated, step = 0.0, False, 0
        while not truncated:
            action = best.action(step, (info["x_mm"], info["focal_depth_mm"], info["angle_deg"]))
            _, reward, _, truncated, info = env.step(action)
            earned, step = earned + reward, step + 1
        assert step == 24
        assert info["is_success"]
        assert earned == pytest.approx(best.value(0, start), abs=1e-9)


def test_stopping_ends_the_episode_with_the_reward_of_all_steps_left(coded):
    env = ExaminationStopEnv()
    env.reset(options={"x_mm": 10, "focal_depth_mm": 40, "angle_deg": 30})
    pose_reward = -(0.5 + 0.2 + 0.5)
    _, reward, terminated, truncated, _ = env.step(0)
    assert (reward, terminated, truncated) == (pytest.approx(pose_reward), False, False)
    _, reward, terminated, truncated, info = env.step(STOP)
    assert (reward, terminated, truncated) == (pytest.approx(23 * pose_reward), True, False)
    assert info["x_mm"] == 10 and info["noise"] == {}


def test_the_probe_does_not_slip_after_the_stop_and_the_stream_goes_on_as_ever(coded):
    stopped, going_on = ExaminationStopEnv(noise=1.0), ExaminationStopEnv(noise=1.0)
    for env, action in ((stopped, STOP), (going_on, 0)):
        env.reset(seed=5)
        env.step(action)
    assert stopped.reset()[1] == going_on.reset()[1]
    _, info = stopped.reset(seed=6)
    assert stopped.step(STOP)[4] == info


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_at_the_goal_a_stop_is_worth_as_much_as_holding_still(noise):
    # Rewards come before the slip, and one move undoes it: at the goal, noise costs nothing.
    assert returns("exam-stop", noise).optimal == pytest.approx(returns("exam", noise).optimal)
    best = policy("exam-stop", noise)
    at = EXAMINATION.indices
    assert best.best[0, at[TARGET], STOP] and best.best[0, at[TARGET], 0]
    assert not best.best[0, at[Pose(5, 50, 0)], STOP]
    # The first of equally good actions.
    assert best.action(0, TARGET) == 0


def test_where_every_state_is_a_start_a_random_hand_earns_what_an_idle_one_does():
    # Moves and slips keep an even distribution over all states even.
    found = returns("exam", 0.25)
    assert found.random == pytest.approx(found.stay)
    lateral, axial = (
        np.mean(np.abs(np.arange(-20, 21, 5))) / 20,
        np.mean(np.abs(np.arange(5, 91, 5) - 50)) / 50,
    )
    sine = np.mean(np.abs(np.sin(np.radians(np.arange(0, 360, 15)))))
    assert found.stay == pytest.approx(-24 * (lateral + axial + sine))


def test_a_random_hand_that_can_stop_worked_out_by_simulation(coded):
    env = gym.make("usbench/ExaminationStop-v0", noise=0.25)
    env.reset(seed=0)
    hand = np.random.default_rng(1)
    earned = []
    for _ in range(1_500):
        env.reset()
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, _ = env.step(int(hand.integers(8)))
            total, over = total + reward, terminated or truncated
        earned.append(total)
    error = np.std(earned, ddof=1) / np.sqrt(len(earned))
    assert abs(np.mean(earned) - returns("exam-stop", 0.25).random) < 4 * error


def test_the_stop_is_not_one_of_the_other_tasks_actions():
    assert [action.name for action in EXAMINATION_STOP.actions][STOP] == "stop"
    assert not EXAMINATION.stops
    with pytest.raises(ValueError, match="action must be a whole number from 0 to 6, not 7"):
        env = ExaminationEnv()
        env.step(STOP)


@pytest.mark.parametrize(("step", "cost"), [(0, 24 * 0.25), (22, 2 * 0.25)])
def test_a_stop_5_mm_off_costs_the_rewards_of_the_steps_left(step, cost):
    # The best action goes to the goal and costs nothing from there on.
    costs = policy("exam-stop").costs[step, EXAMINATION.indices[Pose(5, 50, 0)]]
    assert costs[STOP] == pytest.approx(cost)
    assert costs[1] == 0
