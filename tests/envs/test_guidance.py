"""Both environments: what an episode does, its random numbers, and the habits of Gymnasium and SB3."""

import dataclasses
import hashlib
import importlib.util
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import usbench
from usbench.envs.bmode import Imaging
from usbench.envs.focal_point import FOCAL_POINT, FocalPointEnv
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Move, Pose
from usbench.envs.probe import LinearArray
from usbench.envs.probe_plane import PROBE_PLANE, ProbePlaneEnv

IDS = ("usbench/FocalPoint-v0", "usbench/ProbePlane-v0")
ENVS = (FocalPointEnv, ProbePlaneEnv)
TARGET = Pose(0, 50, 0)


class CodedFrames:
    """Stands in for the simulator: the frame tells the pose from which it was taken."""

    def frame(self, pose):
        frame = np.zeros((90, 40), np.uint8)
        frame[0, :3] = pose.x_mm + 20, pose.focal_depth_mm, pose.angle_deg // 2
        return frame


@pytest.fixture
def coded(monkeypatch):
    monkeypatch.setattr("usbench.envs.guidance.frame_store", lambda *_: CodedFrames())


def chi_square(counts):
    return np.sum((counts - np.mean(counts)) ** 2) / np.mean(counts)


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


# Random numbers


@pytest.mark.parametrize("env_class", ENVS)
def test_every_start_and_only_those_equally_often(env_class, coded):
    env = env_class()
    env.reset(seed=3)
    n_episodes = 200 * len(env.task.starts)
    starts = []
    for _ in range(n_episodes):
        env.reset()
        starts.append(env.pose)
    counts = [starts.count(pose) for pose in env.task.starts]
    assert sum(counts) == n_episodes
    # 0.1 % points of chi-square with 8 and 27 degrees of freedom.
    assert chi_square(counts) < {9: 26.1, 28: 55.5}[len(counts)]


@pytest.mark.parametrize("env_class", ENVS)
@pytest.mark.parametrize("noise", [0.0, 0.25, 0.5, 1.0])
def test_noise_comes_as_often_as_asked_and_in_every_direction(env_class, noise, coded):
    env, n_steps = env_class(noise=noise), 4_000
    env.reset(seed=11)
    displaced = []
    for _ in range(n_steps):
        env.reset(options={"x_mm": 0, "angle_deg": 90})
        displaced.append(env.step(0)[4]["noise"])
    drawn = [Move(**noise) for noise in displaced if noise]
    assert abs(len(drawn) - n_steps * noise) <= 3.3 * np.sqrt(n_steps * noise * (1 - noise))
    assert set(drawn) <= set(env.task.displacements)
    if drawn:
        counts = [drawn.count(displacement) for displacement in env.task.displacements]
        assert chi_square(counts) < 16.3  # 0.1 % point of 3 degrees of freedom


def test_the_displacements_are_those_of_the_specification():
    assert {move.x_mm for move in FOCAL_POINT.displacements} == {-10, -5, 5, 10}
    assert {(move.x_mm, move.angle_deg) for move in PROBE_PLANE.displacements} == {
        (-5, 0),
        (5, 0),
        (0, -15),
        (0, 15),
    }


def test_noise_against_the_border_moves_nothing_and_says_so(coded):
    env = FocalPointEnv(noise=1.0)
    env.reset(seed=0)
    for _ in range(100):
        env.reset(options={"x_mm": 20})
        displaced = env.step(0)[4]["noise"]["x_mm"]
        assert displaced in (0, -5, -10) and env.pose.x_mm == 20 + displaced


@pytest.mark.parametrize("env_class", ENVS)
def test_the_stream_depends_neither_on_actions_nor_on_noise_nor_on_options(env_class, coded):
    envs = [env_class(noise=noise) for noise in (0.0, 0.5, 0.5)]
    hands = [np.random.default_rng(seed) for seed in (1, 2, 3)]
    for env in envs:
        env.reset(seed=7)
    for _ in range(20):
        for env, hand in zip(envs, hands, strict=True):
            for _ in range(16):
                env.step(int(hand.integers(5)))
        states = [env.np_random.bit_generator.state for env in envs]
        assert states[0] == states[1] == states[2]
        envs[0].reset()
        envs[1].reset()
        envs[2].reset(options={"x_mm": 5})
        assert envs[0].pose == envs[1].pose
        assert envs[2].pose == dataclasses.replace(envs[0].pose, x_mm=5)


def test_resets_without_a_seed_continue_the_stream(coded):
    env = ProbePlaneEnv()

    def starts(seed):
        env.reset(seed=seed)
        poses = [env.pose]
        for _ in range(10):
            env.reset()
            poses.append(env.pose)
        return poses

    assert len(set(starts(1))) > 3
    assert starts(1) == starts(1) != starts(2)


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
        ({"phantom": 0}, TypeError, "phantom must be of type Phantom, not 0"),
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


# Gymnasium, SB3, processes


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasium_and_sb3_check_the_environment_without_a_warning(env_id, coded):
    from stable_baselines3.common.env_checker import check_env as sb3_check_env

    # Warnings are errors in this suite.
    check_env(gym.make(env_id, render_mode="rgb_array", noise=0.25).unwrapped)
    sb3_check_env(gym.make(env_id, noise=0.25))


def test_the_configuration_reaches_the_environment(coded):
    phantom, probe, imaging = Phantom(seed=5), LinearArray(), Imaging()
    env = gym.make(IDS[1], noise=0.5, reward="paper", phantom=phantom, probe=probe, imaging=imaging).unwrapped
    assert (env.noise, env.reward, env.phantom, env.probe, env.imaging) == (
        0.5,
        "paper",
        phantom,
        probe,
        imaging,
    )
    env.reset(options={"x_mm": 15, "angle_deg": 0})
    assert env.step(1)[1] == -10


def test_an_observation_is_the_callers_own():
    env = FocalPointEnv()
    observation, _ = env.reset(options={"x_mm": 0, "focal_depth_mm": 50, "angle_deg": 0})
    kept = observation.copy()
    observation[...] = 0
    np.testing.assert_array_equal(env.step(0)[0], kept)
    assert kept.shape == (90, 40, 1) and kept.dtype == np.uint8 and np.ptp(kept) > 100


ROLLOUT = """
import hashlib, sys
import gymnasium as gym, usbench
env = gym.make(sys.argv[1], noise=0.5)
env.action_space.seed(0)
digest = hashlib.sha256()
observation, info = env.reset(seed=4)
for action in (1, 1, 3):
    observation, reward, _, _, info = env.step(action)
    digest.update(observation.tobytes() + repr((float(reward), sorted(info.items()))).encode())
print(digest.hexdigest())
"""


@pytest.mark.parametrize("env_id", IDS)
def test_another_process_gives_the_same_bytes(env_id):
    command = [sys.executable, "-P", "-c", ROLLOUT, env_id]
    there = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    env, digest = gym.make(env_id, noise=0.5), hashlib.sha256()
    env.reset(seed=4)
    for action in (1, 1, 3):
        observation, reward, _, _, info = env.step(action)
        digest.update(observation.tobytes() + repr((float(reward), sorted(info.items()))).encode())
    assert there == digest.hexdigest()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments_give_what_single_ones_give(mode):
    # One start pose for all, so that there are few frames to simulate.
    start = {"x_mm": 0, "focal_depth_mm": 50, "angle_deg": 0}
    vector = gym.make_vec(IDS[1], num_envs=2, vectorization_mode=mode)
    single = gym.make(IDS[1])
    try:
        vector.reset(seed=9, options=start)
        observations, rewards, *_ = vector.step(np.array([3, 0]))
        single.reset(seed=9, options=start)
        observation, reward, *_ = single.step(3)
        np.testing.assert_array_equal(observations[0], observation)
        assert rewards[0] == reward < rewards[1] == 0
        assert observations.shape == (2, 90, 40, 1)
    finally:
        vector.close()


def test_a_pickled_environment_goes_on_where_it_was(coded):
    env = ProbePlaneEnv(noise=0.5)
    env.reset(seed=6)
    env.step(1)
    pickled = pickle.dumps(env)
    assert len(pickled) < 50_000  # the generator, but neither frames nor scatterers
    twin = pickle.loads(pickled)
    for action in (2, 3, 4, 0, 1):
        observation, *rest = env.step(action)
        twin_observation, *twin_rest = twin.step(action)
        np.testing.assert_array_equal(observation, twin_observation)
        assert rest == twin_rest
    env.reset()
    twin.reset()
    assert env.pose == twin.pose


@pytest.mark.parametrize("env_class", ENVS)
def test_docstrings_have_the_fixed_headings(env_class):
    headings = [line.strip("# ") for line in env_class.__doc__.splitlines() if line.strip().startswith("## ")]
    assert headings == [
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Episode End",
        "Arguments",
    ]


def test_importing_usbench_registers_the_ids_without_the_simulator_or_torch():
    code = "import sys, usbench, gymnasium; print('torch' in sys.modules, 'usbench.envs' in sys.modules)"
    result = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "False"]
    assert usbench.__version__
    assert all(isinstance(gym.spec(env_id).entry_point, str) for env_id in IDS)


def test_the_folder_refuses_another_name():
    folder = Path(__file__).parents[2] / "envs" / "__init__.py"
    spec = importlib.util.spec_from_file_location("envs", folder)
    with pytest.raises(ImportError, match="usbench.envs and cannot be imported as 'envs'"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
