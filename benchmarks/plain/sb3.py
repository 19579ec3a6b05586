"""Stable-Baselines3 as its users write it: python -m plain.sb3 ppo pp 16064, in benchmarks/."""

import sys
from collections.abc import Mapping
from typing import Any

from gymnasium import spaces
from plain.environment import make_env
from plain.network import RunningNorm, trunk
from sb3_contrib import QRDQN, TRPO, RecurrentPPO
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn


class Trunk(BaseFeaturesExtractor):
    """The network up to its last layer."""

    def __init__(self, observation_space: spaces.Box, norm: type[nn.BatchNorm2d] = RunningNorm) -> None:
        """Builds it for observations (channels, height, width)."""
        n_channels, height, width = observation_space.shape
        super().__init__(observation_space, 32 * (height // 4) * (width // 4))
        self.layers = trunk(n_channels, norm)

    def forward(self, observations: Any) -> Any:
        """Features (n, features_dim)."""
        return self.layers(observations)


class ProjectedTrunk(Trunk):
    """The network up to the LSTM."""

    def __init__(self, observation_space: spaces.Box) -> None:
        """Builds it."""
        super().__init__(observation_space)
        self.layers.append(nn.Linear(self.features_dim, 64)).append(nn.Tanh())
        self._features_dim = 64


Q: dict[str, Any] = {"features_extractor_class": Trunk, "net_arch": []}
ACTOR_CRITIC = {**Q, "share_features_extractor": False}
MODELS = {
    "a2c": (A2C, "MlpPolicy", {**ACTOR_CRITIC, "features_extractor_kwargs": {"norm": nn.BatchNorm2d}}),
    "ppo": (PPO, "MlpPolicy", ACTOR_CRITIC),
    "dqn": (DQN, "MlpPolicy", Q),
    "qrdqn": (QRDQN, "MlpPolicy", {**Q, "n_quantiles": 50}),
    "trpo": (TRPO, "MlpPolicy", ACTOR_CRITIC),
    "recurrent_ppo": (
        RecurrentPPO,
        "MlpLstmPolicy",
        {**ACTOR_CRITIC, "features_extractor_class": ProjectedTrunk, "lstm_hidden_size": 64},
    ),
}


def make(algo: str, task: str, hyperparameters: Mapping[str, Any], seed: int = 0) -> BaseAlgorithm:
    """The model of `algo` on one environment."""
    cls, policy, policy_kwargs = MODELS[algo]
    env = make_vec_env(lambda: make_env(task), n_envs=1)
    return cls(policy, env, policy_kwargs=policy_kwargs, seed=seed, device="cpu", **hyperparameters)


if __name__ == "__main__":
    from usbench.agents.zoo import hyperparameters

    algo, task, steps = sys.argv[1:]
    make(algo, task, hyperparameters(algo, task)).learn(int(steps))
