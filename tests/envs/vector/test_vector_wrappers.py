"""What every algorithm sees of many environments in step: that of single ones, in every autoreset mode."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from usbench import make_env, make_vec_env
from usbench.envs.vector.wrappers import VectorImageStack, VectorNormalizeImage


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("task", ["pp", "exam-stop"])
def test_vectors_show_what_single_environments_show(task, mode, coded):
    ours = make_vec_env(task, 3, autoreset_mode=mode, noise=0.5, n_frames=3)
    theirs = SyncVectorEnv([lambda: make_env(task, noise=0.5, n_frames=3)] * 3, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.action_space == theirs.action_space and ours.metadata == theirs.metadata
    ours.action_space.seed(0)
    assert data_equivalence(ours.reset(seed=2), theirs.reset(seed=2), exact=True)
    n_ends = 0
    for _ in range(40):
        actions = ours.action_space.sample()
        one, other = ours.step(actions), theirs.step(actions)
        assert data_equivalence(one, other, exact=True)
        done = one[2] | one[3]
        n_ends += done.sum()
        if done.any() and mode is AutoresetMode.DISABLED:
            # Not after every end: the stacks of the others stay.
            one, other = (env.reset(options={"reset_mask": done}) for env in (ours, theirs))
            assert data_equivalence(one, other, exact=True)
    assert n_ends >= 6


def test_stacks_of_gymnasiums_own_vectors_go_on_beside_a_reset(coded):
    """`SyncVectorEnv` takes the mask out of the options that it is given."""
    make = lambda: gym.make("usbench/ProbePlane-v0")  # noqa: E731
    env = VectorImageStack(SyncVectorEnv([make] * 2, autoreset_mode=AutoresetMode.DISABLED), 3)
    env.reset(seed=0)
    before, *_ = env.step([1, 1])
    options = {"reset_mask": np.array([True, False])}
    after, _ = env.reset(options=options)
    assert np.array_equal(after[1][..., -1], before[1][..., -1])
    assert np.array_equal(after[1], before[1]) and not np.array_equal(after[0], before[0])
    assert list(options) == ["reset_mask"]


def test_observations_are_the_callers_own(coded):
    env = make_vec_env("pp", 2, autoreset_mode="SameStep")
    first, _ = env.reset(seed=0)
    kept = first.copy()
    seen, *_ = env.step([1, 3])
    assert np.array_equal(first, kept)
    seen[...] = 0
    assert env.step([0, 0])[0].any() and env.observation_space.contains(env.step([0, 0])[0])


def test_gymnasiums_own_wrappers_go_around_it(coded):
    env = gym.wrappers.vector.RecordEpisodeStatistics(make_vec_env("pp", 2, autoreset_mode="SameStep"))
    env.reset(seed=0)
    total = 0.0
    for _ in range(16):
        _, rewards, _, truncations, infos = env.step([0, 0])
        total += rewards
    assert truncations.all()
    np.testing.assert_allclose(infos["episode"]["r"], total)
    assert (infos["episode"]["l"] == 16).all()


def test_refuses_what_make_env_refuses():
    with pytest.raises(ValueError, match="unknown task 'pq'"):
        make_vec_env("pq", 2)
    with pytest.raises(ValueError, match="num_envs must be a whole number from 1, not 0"):
        make_vec_env("pp", 0)
    with pytest.raises(ValueError, match="n_frames must be a whole number"):
        make_vec_env("pp", 2, n_frames=0)
    with pytest.raises(ValueError, match="unknown autoreset_mode 'Never'"):
        make_vec_env("pp", 2, autoreset_mode="Never")
    plain = gym.make_vec("usbench/ProbePlane-v0", 2)
    with pytest.raises(ValueError, match="n_frames must be a whole number from 1, not 0"):
        VectorImageStack(plain, 0)
    with pytest.raises(ValueError, match="std must be a positive number, not 0"):
        VectorNormalizeImage(plain, std=0)
    with pytest.raises(ValueError, match="mean and std must make finite 32-bit .*, not 46.5 and 1e-50"):
        VectorNormalizeImage(plain, std=1e-50)
    with pytest.raises(TypeError, match="VectorImageStack needs .height, width, channels. uint8 images"):
        VectorImageStack(gym.make_vec("CartPole-v1", 2))
