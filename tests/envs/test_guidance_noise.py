"""Both environments: starts and displacements come as often as they should, and from one stream."""

import dataclasses

import numpy as np
import pytest

from usbench.envs.pose import Move
from usbench.envs.tasks.focal_point import FOCAL_POINT, FocalPointEnv
from usbench.envs.tasks.probe_plane import PROBE_PLANE, ProbePlaneEnv

ENVS = (FocalPointEnv, ProbePlaneEnv)


def chi_square(counts):
    return np.sum((counts - np.mean(counts)) ** 2) / np.mean(counts)


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
