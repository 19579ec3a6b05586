"""Both environments: what an episode does, step by step, and what is refused."""

import gymnasium as gym
import numpy as np
import pytest
from coded import CodedFrames

from usbench.envs.phantom import Phantom
from usbench.envs.pose import Move, Pose
from usbench.envs.tasks.focal_point import FOCAL_POINT, FocalPointEnv
from usbench.envs.tasks.probe_plane import PROBE_PLANE, ProbePlaneEnv

IDS = ("usbench/FocalPoint-v0", "usbench/ProbePlane-v0")
ENVS = (FocalPointEnv, ProbePlaneEnv)
TARGET = Pose(0, 50, 0)


# What an episode does


def test_rewards_worked_out_by_hand():
    cases = [
        (FOCAL_POINT, Pose(-15, 30, 0), "normalized", -(0.75 + 0.4)),
        (FOCAL_POINT, Pose(-15, 30, 0), "paper", -35),
        (FOCAL_POINT, Pose(0, 90, 0), "normalized", -0.8),
        (PROBE_PLANE, Pose(10, 50, 30), "normalized", -1.0),
        (PROBE_PLANE, Pose(10, 50, 330), "paper", -10.5),
        (PROBE_PLANE, Pose(0, 50, 270), "normalized", -1.0),
    ]
    for task, pose, kind, expected in cases:
        assert task.reward(pose, TARGET, kind) == pytest.approx(expected, abs=1e-12)


def test_success_is_the_object_from_either_side():
    assert PROBE_PLANE.is_success(Pose(0, 50, 0), TARGET) and PROBE_PLANE.is_success(Pose(0, 50, 180), TARGET)
    assert PROBE_PLANE.reward(Pose(0, 50, 180), TARGET, "normalized") == 0
    assert not PROBE_PLANE.is_success(Pose(0, 50, 15), TARGET)
    assert not PROBE_PLANE.is_success(Pose(5, 50, 0), TARGET)
    assert FOCAL_POINT.is_success(Pose(0, 50, 0), TARGET)
    assert not FOCAL_POINT.is_success(Pose(0, 45, 0), TARGET)
    assert FOCAL_POINT.distance_mm(Pose(-10, 35, 0), TARGET) == 25
    assert PROBE_PLANE.distance_mm(Pose(-10, 50, 45), TARGET) == 10


def test_rewards_are_relative_to_the_object():
    target = Pose(5, 40, 30)
    assert PROBE_PLANE.reward(Pose(5, 40, 210), target, "normalized") == 0
    assert FOCAL_POINT.reward(Pose(5, 45, 0), target, "paper") == -5


@pytest.mark.parametrize(
    ("env_class", "moves"),
    [
        (FocalPointEnv, [(0, 0, 0), (-5, 0, 0), (5, 0, 0), (0, -5, 0), (0, 5, 0)]),
        (ProbePlaneEnv, [(0, 0, 0), (-5, 0, 0), (5, 0, 0), (0, 0, -15), (0, 0, 15)]),
    ],
)
def test_actions_move_the_probe_as_specified(env_class, moves, coded):
    env = env_class()
    for action, (x_mm, focal_depth_mm, angle_deg) in enumerate(moves):
        env.reset(options={"x_mm": 0, "focal_depth_mm": 50, "angle_deg": 0})
        env.step(action)
        assert env.pose == Pose(x_mm, 50 + focal_depth_mm, angle_deg)


def test_the_tables_hold_162_and_216_states_closed_under_every_move():
    for task, n_states, n_starts in ((FOCAL_POINT, 162, 9), (PROBE_PLANE, 216, 28)):
        states = set(task.states)
        assert len(states) == n_states and len(set(task.starts)) == n_starts
        assert set(task.starts) <= states
        moves = [action.move for action in task.actions] + list(task.displacements)
        reached, frontier = set(task.starts), set(task.starts)
        while frontier:
            frontier = {pose.moved(move) for pose in frontier for move in moves} - reached
            reached |= frontier
        assert reached == states


@pytest.mark.parametrize("env_class", ENVS)
def test_order_in_a_step_is_action_reward_noise_observation(env_class, coded):
    env, hand = env_class(noise=1.0), np.random.default_rng(5)
    env.reset(seed=5)
    for _ in range(300):
        action, before = int(hand.integers(5)), env.pose
        observation, reward, terminated, truncated, info = env.step(action)
        acted = before.moved(env.task.actions[action].move)
        assert reward == env.task.reward(acted, TARGET, "normalized")
        assert env.pose == acted.moved(Move(**info["noise"]))
        assert [info[name] for name in ("x_mm", "focal_depth_mm", "angle_deg")] == [*vars(env.pose).values()]
        np.testing.assert_array_equal(observation[:, :, 0], CodedFrames().frame(env.pose))
        assert info["distance_mm"] == env.task.distance_mm(env.pose, TARGET)
        assert info["sin_angle"] == pytest.approx(np.sin(np.radians(env.pose.angle_deg)), abs=1e-12)
        assert info["is_success"] == env.task.is_success(env.pose, TARGET)
        assert not terminated and not truncated


def test_the_truth_is_in_info_under_the_specified_keys(coded):
    keys = {"x_mm", "focal_depth_mm", "angle_deg", "distance_mm", "sin_angle", "noise", "is_success"}
    env = FocalPointEnv()
    assert set(env.reset()[1]) == set(env.step(0)[4]) == keys


@pytest.mark.parametrize("env_id", IDS)
def test_an_episode_is_truncated_after_16_steps(env_id, coded):
    env = gym.make(env_id)
    assert env.spec.max_episode_steps == env.unwrapped.task.n_steps == 16
    env.reset(seed=0)
    flags = [env.step(0)[2:4] for _ in range(16)]
    assert flags == [(False, False)] * 15 + [(False, True)]


def test_ten_thousand_steps_stay_on_the_grid(coded):
    for env_class in ENVS:
        env, hand = env_class(noise=0.5), np.random.default_rng(0)
        env.reset(seed=0)
        states = set(env.task.states)
        visited = set()
        for _ in range(10_000):
            env.step(int(hand.integers(5)))
            visited.add(env.pose)
        assert visited <= states
        assert len(visited) > 0.9 * len(states)


# Resetting to a pose, and what is refused


def test_reset_starts_from_any_part_of_a_pose(coded):
    env = ProbePlaneEnv()
    env.reset(seed=0, options={"x_mm": -20, "focal_depth_mm": 35, "angle_deg": -90})
    assert env.pose == Pose(-20, 35, 270)
    _, info = env.reset(options={"angle_deg": np.int64(10)})
    assert env.pose.angle_deg == info["angle_deg"] == 10
    assert env.pose.x_mm in range(-15, 16, 5) and env.pose.focal_depth_mm == 50
    env.reset(options={})
    assert env.pose in PROBE_PLANE.starts


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"x": 5}, ValueError, "unknown option 'x'.*allowed are 'x_mm', 'focal_depth_mm', 'angle_deg'"),
        ({"angle": 5}, ValueError, "unknown option 'angle' .did you mean 'angle_deg'"),
        ({"x_mm": 25}, ValueError, r"x_mm must be in \[-20, 20\], not 25"),
        ({"focal_depth_mm": 4}, ValueError, r"focal_depth_mm must be in \[5, 90\], not 4"),
        ({"x_mm": 2.5}, ValueError, "x_mm must be a whole number, not 2.5"),
        ({"angle_deg": "90"}, TypeError, "angle_deg must be a whole number, not '90'"),
        ({"angle_deg": None}, TypeError, "angle_deg must be a whole number, not None"),
        ([5], TypeError, "options must be a dict"),
    ],
)
def test_bad_reset_options_are_refused(options, error, message, coded):
    with pytest.raises(error, match=message):
        FocalPointEnv().reset(options=options)


def test_a_refused_reset_changes_nothing(coded):
    env = FocalPointEnv(noise=0.5)
    env.reset(seed=0)
    pose, stream = env.pose, env.np_random.bit_generator.state
    with pytest.raises(ValueError, match="x_mm must be in"):
        env.reset(seed=99, options={"x_mm": 1000})
    assert (env.pose, env.np_random_seed) == (pose, 0)
    assert env.np_random.bit_generator.state == stream


@pytest.mark.parametrize("action", [-1, 5, 1.0, True, "1", None, np.array([1]), np.bool_(True)])
def test_bad_actions_are_refused(action, coded):
    env = FocalPointEnv()
    env.reset(seed=0)
    before = env.pose
    with pytest.raises(ValueError, match="action must be a whole number from 0 to 4, not"):
        env.step(action)
    assert env.pose == before


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"noise": -0.1}, ValueError, r"noise must be a probability in \[0, 1\], not -0.1"),
        ({"noise": "0.5"}, TypeError, r"noise must be a probability in \[0, 1\], not '0.5'"),
        ({"reward": "normalised"}, ValueError, "unknown reward 'normalised' .did you mean 'normalized'"),
        ({"phantom": 0}, TypeError, "phantom must be of type Phantom or Anatomy, not 0"),
        ({"probe": Phantom()}, TypeError, "probe must be of type LinearArray"),
        ({"imaging": {}}, TypeError, "imaging must be of type Imaging, not {}"),
        ({"render_mode": "human"}, ValueError, "unknown render_mode 'human'.*'rgb_array'"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        ProbePlaneEnv(**arguments)


def test_a_step_before_the_first_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        FocalPointEnv().step(0)
