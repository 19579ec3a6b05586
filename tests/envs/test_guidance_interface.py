"""Both environments as Gymnasium, SB3 and other processes meet them."""

import hashlib
import importlib.util
import os
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
from usbench.envs.phantom import Phantom
from usbench.envs.pose import Pose
from usbench.envs.probe import LinearArray
from usbench.envs.tasks.focal_point import FocalPointEnv
from usbench.envs.tasks.probe_plane import ProbePlaneEnv

IDS = ("usbench/FocalPoint-v0", "usbench/ProbePlane-v0")
ENVS = (FocalPointEnv, ProbePlaneEnv)
TARGET = Pose(0, 50, 0)


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


def test_an_observation_is_the_callers_own(kept_frames):
    kept_frames([TARGET])
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
observation, info = env.reset(seed=4, options={"focal_depth_mm": 50})
for action in (1, 1, 4):
    observation, reward, _, _, info = env.step(action)
    digest.update(observation.tobytes() + repr((float(reward), sorted(info.items()))).encode())
print(digest.hexdigest())
"""


@pytest.mark.parametrize("env_id", [pytest.param(IDS[0], marks=pytest.mark.slow), IDS[1]])
def test_another_process_gives_the_same_bytes(env_id, tmp_path):
    # With a cache of its own, so that it simulates the frames again.
    there = subprocess.run(
        [sys.executable, "-P", "-c", ROLLOUT, env_id],
        env={**os.environ, "USBENCH_CACHE": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    env, digest = gym.make(env_id, noise=0.5), hashlib.sha256()
    env.reset(seed=4, options={"focal_depth_mm": 50})
    for action in (1, 1, 4):
        observation, reward, _, _, info = env.step(action)
        digest.update(observation.tobytes() + repr((float(reward), sorted(info.items()))).encode())
    assert there == digest.hexdigest()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vector_environments_give_what_single_ones_give(mode, kept_frames):
    kept_frames([TARGET, Pose(0, 50, -15)])
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
