"""Vanilla policy gradient as Spinning Up writes it: python -m plain.spinning_up pp 16064, in benchmarks/."""

import sys
from typing import Any

import gymnasium as gym
import numpy as np
import scipy.signal
import torch
from plain.environment import make_env
from plain.network import trunk
from torch import nn
from torch.distributions import Categorical
from torch.nn import functional
from torch.optim import Adam


def network(shape: tuple[int, int, int], n_outputs: int) -> nn.Sequential:
    """The network from images of `shape` (channels, height, width) to `n_outputs`."""
    n_channels, height, width = shape
    return trunk(n_channels).append(nn.Linear(32 * (height // 4) * (width // 4), n_outputs))


def discounted(values: Any, discount: float) -> Any:
    """Sums of all that follows, discounted."""
    return scipy.signal.lfilter([1], [1, -discount], values[::-1])[::-1]


class VPG:
    """A policy and a value network, an optimizer each (Achiam 2018)."""

    def __init__(
        self,
        env: gym.Env[Any, Any],
        seed: int,
        *,
        learning_rate: float,
        value_learning_rate: float,
        n_steps: int,
        gamma: float,
        gae_lambda: float,
        n_value_steps: int,
        initial_value: float,
        adam_beta1: float,
    ) -> None:
        """Builds the networks and starts the first episode."""
        torch.manual_seed(seed)
        self.env, self.n_steps, self.n_value_steps = env, n_steps, n_value_steps
        self.gamma, self.gae_lambda = gamma, gae_lambda
        self.policy = network(env.observation_space.shape, env.action_space.n)
        self.value = network(env.observation_space.shape, 1)
        self.value[-1].bias.data += initial_value
        # Stable-Baselines3's epsilon, for the same steps.
        adam = {"betas": (adam_beta1, 0.999), "eps": 1e-5}
        self.policy_optimizer = Adam(self.policy.parameters(), learning_rate, **adam)
        self.value_optimizer = Adam(self.value.parameters(), value_learning_rate, **adam)
        self.num_timesteps = 0
        self.observations = np.zeros((n_steps, *env.observation_space.shape), np.float32)
        self.actions, self.rewards, self.values, self.advantages, self.returns = np.zeros((5, n_steps))
        self.observation, _ = env.reset(seed=seed)

    def learn(self, total_timesteps: int) -> None:
        """Learns for `total_timesteps` steps, rounded up to whole updates."""
        end = self.num_timesteps + total_timesteps
        while self.num_timesteps < end:
            self.collect()
            self.train()

    @torch.no_grad()
    def predict(self, images: Any, **_: Any) -> tuple[Any, None]:
        """The most probable action for each of the images, and no state."""
        self.policy.eval()
        return self.policy(torch.as_tensor(images)).argmax(dim=1).numpy(), None

    @torch.no_grad()
    def collect(self) -> None:
        """Makes `n_steps` steps; where an episode is cut, the value stands for what is to come."""
        self.policy.eval()
        self.value.eval()
        start = 0
        for step in range(self.n_steps):
            images = torch.as_tensor(self.observation)[None]
            action = Categorical(logits=self.policy(images)).sample().item()
            self.observations[step], self.actions[step] = self.observation, action
            self.values[step] = self.value(images).item()
            self.observation, self.rewards[step], terminated, truncated, _ = self.env.step(action)
            if terminated or truncated or step == self.n_steps - 1:
                images = torch.as_tensor(self.observation)[None]
                self.finish_path(slice(start, step + 1), 0.0 if terminated else self.value(images).item())
                start = step + 1
            if terminated or truncated:
                self.observation, _ = self.env.reset()
        self.num_timesteps += self.n_steps

    def finish_path(self, path: slice, last_value: float) -> None:
        """Advantages by GAE(lambda) and rewards-to-go of the steps in `path`."""
        rewards = np.append(self.rewards[path], last_value)
        values = np.append(self.values[path], last_value)
        deltas = rewards[:-1] + self.gamma * values[1:] - values[:-1]
        self.advantages[path] = discounted(deltas, self.gamma * self.gae_lambda)
        self.returns[path] = discounted(rewards, self.gamma)[:-1]

    def train(self) -> None:
        """One step of the policy, then `n_value_steps` of the value."""
        self.policy.train()
        self.value.train()
        observations, actions = torch.as_tensor(self.observations), torch.as_tensor(self.actions)
        advantages = torch.as_tensor(self.advantages, dtype=torch.float32)
        returns = torch.as_tensor(self.returns, dtype=torch.float32)
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)

        self.policy_optimizer.zero_grad()
        log_prob = Categorical(logits=self.policy(observations)).log_prob(actions)
        (-log_prob * advantages).mean().backward()
        self.policy_optimizer.step()
        for _ in range(self.n_value_steps):
            self.value_optimizer.zero_grad()
            functional.mse_loss(self.value(observations).squeeze(-1), returns).backward()
            self.value_optimizer.step()


if __name__ == "__main__":
    from usbench.agents.zoo import hyperparameters

    task, steps = sys.argv[1:]
    VPG(make_env(task), 0, **hyperparameters("vpg", task)).learn(int(steps))
