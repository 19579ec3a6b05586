"""Gymnasium's vectors as Stable-Baselines3 takes them: what its own vector of single environments gives."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from usbench import make_env, make_vec_env
from usbench.agents import zoo
from usbench.agents.vec_env import SB3VecEnv, infos_after


def vector(task="pp", num_envs=3, **kwargs):
    return SB3VecEnv(make_vec_env(task, num_envs, autoreset_mode="SameStep", **kwargs))


def plain(observation):
    """A dictionary of any kind as a plain one."""
    return dict(observation) if isinstance(observation, dict) else observation


def test_a_stop_in_the_last_step_is_no_truncation(quick):
    """As SB3's DummyVecEnv tells it: nothing follows a terminal state, also where time is up as well."""
    told = []
    for env in (vector("exam-stop", 1), DummyVecEnv([lambda: make_env("exam-stop")])):
        env.reset()
        for step in range(24):
            _, _, dones, infos = env.step(np.array([7 if step == 23 else 0]))
        told.append((bool(dones[0]), infos[0]["TimeLimit.truncated"]))
    assert told == [(True, False)] * 2


@pytest.mark.parametrize("task", ["pp", "exam-stop", "pp-tracked"])
def test_steps_are_those_of_sb3s_own_vector(task, quick):
    ours, theirs = vector(task, noise=0.5), DummyVecEnv([lambda: make_env(task, noise=0.5)] * 3)
    for env in (ours, theirs):
        env.seed(4)
        # Some alike, some not.
        env.set_options([{}, {"x_mm": 5}, {"x_mm": 5}])
    assert data_equivalence(plain(ours.reset()), plain(theirs.reset()), exact=True)
    generator, n_ends = np.random.default_rng(0), 0
    for _ in range(40):
        assert ours.reset_infos == theirs.reset_infos
        actions = generator.integers(ours.action_space.n, size=3)
        one, other = ours.step(actions), theirs.step(actions)
        assert data_equivalence(plain(one[0]), plain(other[0]), exact=True)
        assert data_equivalence(one[1:3], other[1:3], exact=True)
        assert data_equivalence(one[3], other[3], exact=True)
        n_ends += one[2].sum()
    assert n_ends >= 3
    # Seeds and options are of one reset.
    poses = ours.get_attr("pose")
    ours.reset()
    assert ours.get_attr("pose") != poses


def test_infos_after_a_step_are_those_of_its_observations(quick):
    env = VecMonitor(vector("pp-tracked"))
    env.reset()
    for _ in range(17):
        observations, _, dones, infos = env.step(np.ones(3, int))
        after = infos_after(env, dones, infos)
        x_mm = np.array([info["x_mm"] for info in after])
        np.testing.assert_allclose(20 * observations["senses"][:, -3], x_mm, atol=1e-5)
        assert [info["phantom"] for info in after] == [one.phantom.seed for one in env.get_attr("unwrapped")]


def test_attributes_and_pictures(quick):
    env = vector(render_mode="rgb_array")
    env.reset()
    assert env.render_mode == "rgb_array" and len(env.get_images()) == 3
    assert env.render().ndim == 3
    env.set_attr("is_watched", False, indices=[1])
    assert env.get_attr("is_watched") == [True, False, True]
    assert len(env.env_method("state_rewards", indices=0)[0]) == 216
    assert env.env_is_wrapped(Monitor) == [False] * 3
    with pytest.raises(AttributeError):
        env.get_attr("nothing")
    env.close()
    assert env.env.unwrapped.closed and vector().get_images() == [None] * 3


@pytest.mark.parametrize("algo", ["ppo", "dqn"])
def test_an_algorithm_learns_on_it_and_episodes_are_told_of(algo, quick):
    env = VecMonitor(vector(num_envs=4))
    agent = zoo.make(algo, env, 0, zoo.hyperparameters(algo, "pp"))
    agent.learn(512)
    assert agent.num_timesteps == 512
    assert {episode["l"] for episode in agent.ep_info_buffer} == {16}
    if algo == "dqn":  # its replay buffer holds frames by number
        batch = agent.replay_buffer.sample(8)
        assert batch.observations.shape == (8, 90, 40, 4)
        assert len(agent.replay_buffer.state()["frames"]) <= 216


def test_the_same_seed_learns_the_same_bits_in_step_as_one_after_the_other(quick):
    weights = []
    for env in (vector(num_envs=4), DummyVecEnv([lambda: make_env("pp")] * 4)):
        agent = zoo.make("a2c", env, 0, zoo.hyperparameters("a2c", "pp"))
        agent.learn(128)
        weights.append([value.numpy().tobytes() for value in agent.policy.state_dict().values()])
    assert weights[0] == weights[1]


def test_refuses_what_sb3_could_not_learn_from():
    with pytest.raises(ValueError, match="autoreset_mode must be 'SameStep' .* not 'NextStep'"):
        SB3VecEnv(make_vec_env("pp", 2))
    with pytest.raises(TypeError, match="env must be a gymnasium.vector.VectorEnv, not"):
        SB3VecEnv(gym.make("CartPole-v1"))
