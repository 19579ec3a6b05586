"""Algorithms of Stable-Baselines3 whose values of a rollout are computed at its end, in one batch.

Policy and value are separate networks here, and acting needs the policy alone. The weights do not change
during a rollout, so that the values are the same as step by step, at a fraction of the time.
"""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer, RolloutBuffer
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from torch import nn

from usbench.agents.policies import ConvPolicy, SeparatePolicy

# So that a long rollout needs no more memory than an update.
OBSERVATIONS_AT_ONCE = 256


class ValuesAtEndBuffer(RolloutBuffer):
    """SB3's rollout, which asks its `policy`, if it has one, for all values when it is complete."""

    policy: SeparatePolicy | None = None

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray[Any, Any]) -> None:
        """Fills `values`, then `advantages` and `returns`, all `(n_steps, n_envs)`."""
        if self.policy is not None:
            self.values[:] = self._values(self.policy).reshape(self.values.shape)
        super().compute_returns_and_advantage(last_values, dones)

    @torch.no_grad()
    def _values(self, policy: SeparatePolicy) -> np.ndarray[Any, Any]:
        return torch.cat([policy.predict_values(seen) for _, seen in self._parts()]).cpu().numpy()

    def _parts(self) -> Iterator[tuple[slice, Any]]:
        """Yields all observations in parts, with the place of each part where all are in one row."""
        for start in range(0, self.values.size, OBSERVATIONS_AT_ONCE):
            part = slice(start, start + OBSERVATIONS_AT_ONCE)
            seen: Any = self.observations
            if isinstance(seen, dict):
                yield part, {name: self._part(array, part) for name, array in seen.items()}
            else:
                yield part, self._part(seen, part)

    def _part(self, observations: np.ndarray[Any, Any], part: slice) -> torch.Tensor:
        """Some rows of an array `(n_steps, n_envs, ...)`."""
        return self.to_torch(observations.reshape(-1, *observations.shape[2:])[part], copy=False)


class ValuesAtEndDictBuffer(ValuesAtEndBuffer, DictRolloutBuffer):
    """The same for observations that are dictionaries."""


class ValuesAtEnd(OnPolicyAlgorithm):
    """An on-policy algorithm that acts with the policy alone, where that is a `SeparatePolicy`."""

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "CnnPolicy": ConvPolicy,
        "MlpPolicy": SeparatePolicy,
        "MultiInputPolicy": SeparatePolicy,
    }

    def _setup_model(self) -> None:
        if self.rollout_buffer_class is None:
            is_dict = isinstance(self.observation_space, spaces.Dict)
            self.rollout_buffer_class = ValuesAtEndDictBuffer if is_dict else ValuesAtEndBuffer
        super()._setup_model()
        if isinstance(self.policy, SeparatePolicy) and isinstance(self.rollout_buffer, ValuesAtEndBuffer):
            self.policy.values_at_end = True
            self.rollout_buffer.policy = self.policy


class A2C(ValuesAtEnd, stable_baselines3.A2C):
    """Stable-Baselines3's A2C."""


class PPO(ValuesAtEnd, stable_baselines3.PPO):
    """Stable-Baselines3's PPO."""


class TRPO(ValuesAtEnd, sb3_contrib.TRPO):
    """SB3-Contrib's TRPO, with the gradients of all parameters at once."""

    policy: SeparatePolicy

    def _compute_actor_grad(
        self, kl_div: torch.Tensor, policy_objective: torch.Tensor
    ) -> tuple[list[nn.Parameter], torch.Tensor, torch.Tensor, list[tuple[int, ...]]]:
        """As in SB3-Contrib, which goes back through the network twice for each parameter."""
        parameters = self.policy.policy_parameters()
        of_objective = torch.autograd.grad(policy_objective, parameters, retain_graph=True)
        of_divergence = torch.autograd.grad(kl_div, parameters, create_graph=True)
        objective, divergence = (
            torch.cat([part.reshape(-1) for part in parts]) for parts in (of_objective, of_divergence)
        )
        return parameters, objective, divergence, [part.shape for part in parameters]
