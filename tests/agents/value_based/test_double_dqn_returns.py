"""Returns of several steps at the border of two learnings."""

import numpy as np
import pytest
from signs import Signs
from stable_baselines3.common.vec_env import DummyVecEnv

from usbench.agents.value_based.double_dqn import DoubleDQN


class Numbered(Signs):
    """Its k-th episode pays 100 k + 1, 100 k + 2, and so on; as `terminal`, episodes end by themselves."""

    def __init__(self, terminal=False):
        super().__init__(n_steps=16)
        self.terminal, self.episode = terminal, 0

    def reset(self, *, seed=None, options=None):
        self.episode += 1
        return super().reset(seed=seed)

    def step(self, action):
        image, _, _, ends, info = super().step(action)
        reward = float(100 * self.episode + self.step_number)
        return image, reward, ends and self.terminal, ends and not self.terminal, info


def numbered(n_envs=1, terminal=False):
    """An agent that only collects, whose returns are sums of three rewards."""
    env = DummyVecEnv([lambda: Numbered(terminal)] * n_envs)
    silent = {"learning_starts": 10**6, "buffer_size": 200, "train_freq": 1}
    return DoubleDQN("MlpPolicy", env, seed=0, gamma=1.0, return_steps=3, **silent)


def stopping_at(n_steps):
    """A callback that ends the rollout in which the agent makes so many steps."""
    return lambda seen, _: seen["self"].num_timesteps < n_steps


@pytest.mark.parametrize("n_envs", [1, 2])
@pytest.mark.parametrize("resets", [True, False])
@pytest.mark.parametrize("is_stopped", [True, False])
def test_returns_do_not_run_from_one_learning_into_the_next(n_envs, resets, is_stopped):
    agent = numbered(n_envs)
    agent.learn(20 * n_envs, callback=stopping_at(20 * n_envs) if is_stopped else None)
    agent.learn(20 * n_envs, reset_num_timesteps=resets)
    buffer, n = agent.replay_buffer, agent.replay_buffer.pos
    last = 18 if is_stopped else 19  # the step in which the callback ends the learning is not kept
    batch = buffer._get_samples(np.full(100, last))
    if resets or is_stopped:
        assert set(batch.rewards.flatten().tolist()) == {float(200 + last - 15)}
        assert set(batch.discounts.flatten().tolist()) == {1.0} and batch.dones.sum() == 0
        assert buffer.timeouts[:n].sum() == 3 * n_envs
        np.testing.assert_array_equal(buffer.rewards[last + 1], 301)
    else:  # the episode goes on, and so do its returns
        assert set(batch.rewards.flatten().tolist()) == {204.0 + 205.0 + 206.0}
        assert buffer.timeouts[:n].sum() == 2 * n_envs


def test_an_episode_that_was_over_before_the_next_learning_stays_terminal():
    agent = numbered(terminal=True).learn(16)
    agent.learn(4)
    batch = agent.replay_buffer._get_samples(np.array([15]))
    assert (batch.rewards.item(), batch.dones.item()) == (116.0, 1.0)
