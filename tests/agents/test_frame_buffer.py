"""The buffer of frames against SB3's own: the same samples, in a fraction of the memory."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from usbench.agents.frame_buffer import FrameReplayBuffer

STACKS = spaces.Box(-3, 3, (9, 4, 4), np.float32)
ACTIONS = spaces.Discrete(5)


def filled(buffer, n, n_envs=1, n_frames=6):
    generator = np.random.default_rng(0)
    frames = generator.uniform(-3, 3, (n_frames, 9, 4)).astype(np.float32)
    for _ in range(n):
        stacks = np.moveaxis(frames[generator.integers(n_frames, size=(2, n_envs, 4))], 2, -1)
        action, reward = generator.integers(5, size=n_envs), generator.normal(size=n_envs)
        truncated = generator.random(n_envs) < 0.2
        infos = [{"TimeLimit.truncated": bool(one)} for one in truncated]
        buffer.add(*stacks, action, reward, truncated | (generator.random(n_envs) < 0.1), infos)
    return buffer


def sampled(buffer, seed=1):
    np.random.seed(seed)
    return buffer.sample(32)


@pytest.mark.parametrize(("n", "n_envs"), [(20, 1), (70, 1), (40, 3)])
def test_samples_have_the_bits_of_sb3s_buffer(n, n_envs):
    ours, theirs = (
        filled(kind(50, STACKS, ACTIONS, "cpu", n_envs=n_envs), n, n_envs)
        for kind in (FrameReplayBuffer, ReplayBuffer)
    )
    for one, other in zip(sampled(ours)[:5], sampled(theirs)[:5], strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one.numpy(), other.numpy())


def test_frames_are_kept_once_and_however_many_there_are():
    few = filled(FrameReplayBuffer(2000, STACKS, ACTIONS, "cpu"), 1000)
    many = filled(FrameReplayBuffer(2000, STACKS, ACTIONS, "cpu"), 1000, n_frames=700)
    assert (len(few._frames.arrays), len(many._frames.arrays)) == (6, 700)
    theirs = filled(ReplayBuffer(2000, STACKS, ACTIONS, "cpu"), 1000, n_frames=700)
    np.testing.assert_array_equal(sampled(many).observations, sampled(theirs).observations)


def test_frames_that_no_transition_has_any_more_are_dropped():
    ours, theirs = (
        filled(kind(50, STACKS, ACTIONS, "cpu"), 520, n_frames=100_000)
        for kind in (FrameReplayBuffer, ReplayBuffer)
    )
    # Eight frames of each of the 50 transitions when it was full last, and of the 20 since then.
    assert 550 < len(ours._frames.arrays) <= 560
    for one, other in zip(sampled(ours)[:5], sampled(theirs)[:5], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_trials_transitions_take_a_few_megabytes():
    buffer = FrameReplayBuffer(16_064, spaces.Box(-3, 3, (90, 40, 4), np.float32), ACTIONS, "cpu")
    arrays = [value for value in vars(buffer).values() if isinstance(value, np.ndarray)]
    arrays.append(buffer._frames.arrays)
    # SB3's takes 2 * 16 064 * 57.6 kB = 1.85 GB.
    assert sum(array.nbytes for array in arrays) < 6e6


def test_pickled_buffer_goes_on_with_the_same_frames():
    buffer = filled(FrameReplayBuffer(50, STACKS, ACTIONS, "cpu"), 30)
    again = pickle.loads(pickle.dumps(buffer))
    for one in (buffer, again):
        filled(one, 10)
    np.testing.assert_array_equal(sampled(buffer).observations, sampled(again).observations)
    assert len(again._frames.arrays) == 6


@pytest.mark.parametrize("n", [0, 30, 70])
def test_buffer_put_back_from_its_state_goes_on_as_it_did(n):
    buffer = filled(FrameReplayBuffer(50, STACKS, ACTIONS, "cpu"), n)
    again = FrameReplayBuffer(50, STACKS, ACTIONS, "cpu")
    again.put_back(buffer.state())
    for one in (buffer, again):
        filled(one, 10)
    assert (buffer.pos, buffer.full) == (again.pos, again.full)
    for one, other in zip(sampled(buffer)[:5], sampled(again)[:5], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(buffer._frames.arrays, again._frames.arrays)


def test_normalised_observations_are_refused():
    class Images(gym.Env):
        observation_space, action_space = STACKS, ACTIONS

    env = VecNormalize(DummyVecEnv([Images]))
    buffer = filled(FrameReplayBuffer(50, STACKS, ACTIONS, "cpu"), 20)
    with pytest.raises(ValueError, match=r"no VecNormalize that changes observations \(norm_obs=True\)"):
        buffer.sample(4, env=env)
    buffer.sample(4, env=VecNormalize(DummyVecEnv([Images]), norm_obs=False))


@pytest.mark.parametrize(("size", "n_steps"), [(50, 40), (10, 12)])
def test_state_of_another_buffer_is_refused(size, n_steps):
    state = filled(FrameReplayBuffer(size, STACKS, ACTIONS, "cpu"), n_steps).state()
    kept = min(size, n_steps)
    with pytest.raises(ValueError, match=f"must fit a buffer of 20 steps, not be one of {kept} steps"):
        FrameReplayBuffer(20, STACKS, ACTIONS, "cpu").put_back(state)


@pytest.mark.parametrize("kwargs", [{}, {"handle_timeout_termination": False}])
def test_refuses_to_save_memory_as_sb3_does(kwargs):
    with pytest.raises(ValueError, match="^optimize_memory_usage must be False with a FrameReplayBuffer"):
        FrameReplayBuffer(8, STACKS, ACTIONS, optimize_memory_usage=True, **kwargs)
