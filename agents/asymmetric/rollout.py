"""Rollouts that hold the full state of every step beside its observation."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.buffers import RolloutBuffer

from usbench.agents.asymmetric.policy import AsymmetricPolicy, Known
from usbench.agents.asymmetric.truth import SIZE
from usbench.agents.on_policy import ValuesAtEndBuffer, ValuesAtEndDictBuffer
from usbench.agents.policies import SeparatePolicy


class StateBuffer(ValuesAtEndBuffer):
    """A rollout whose samples are `Known`, and whose values are those of the states.

    Attributes:
        states: The state at the beginning of each step, `(n_steps, n_envs, SIZE)`, flattened by `get`.
    """

    states: npt.NDArray[np.float32]

    def reset(self) -> None:
        """Forgets everything."""
        self.states = np.zeros((self.buffer_size, self.n_envs, SIZE), np.float32)
        super().reset()

    def add_step(self, states: npt.NDArray[np.float32], *step: Any) -> None:
        """Adds a step: states `(n_envs, SIZE)`, then what SB3's `add` takes."""
        self.states[self.pos] = states
        self.add(*step)

    def get(self, batch_size: int | None = None) -> Any:
        """As in SB3; the first call flattens steps and environments into one axis."""
        if not self.generator_ready:
            self.states = self.swap_and_flatten(self.states)
        return super().get(batch_size)

    def _values(self, policy: SeparatePolicy) -> npt.NDArray[np.float32]:
        assert isinstance(policy, AsymmetricPolicy)
        with torch.no_grad():
            return policy.values(self.to_torch(self.states.reshape(-1, SIZE))).cpu().numpy()

    def _get_samples(self, batch_inds: npt.NDArray[np.intp], env: Any = None) -> Any:
        samples: Any = super()._get_samples(batch_inds, env)
        states = self.to_torch(self.states[batch_inds])
        return samples._replace(observations=Known(samples.observations, states))


class StateDictBuffer(StateBuffer, ValuesAtEndDictBuffer):
    """The same for observations that are dictionaries."""


def buffer_class(is_dict: bool) -> type[RolloutBuffer]:
    """The class for observations that are dictionaries, or not."""
    return StateDictBuffer if is_dict else StateBuffer
