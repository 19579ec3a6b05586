"""What a student has seen, and what its teacher said of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces

from usbench.agents.value_based.n_step_buffer import NStepFrameBuffer


class AdviceBuffer(NStepFrameBuffer):
    """Observations, a byte per pixel and every frame once, with the costs of all actions."""

    def __init__(self, buffer_size: int, observation_space: Any, action_space: Any, **kwargs: Any) -> None:
        """Takes SB3's arguments; actions are discrete."""
        assert isinstance(action_space, spaces.Discrete)
        super().__init__(buffer_size, observation_space, action_space, **kwargs)
        self.costs = np.zeros((self.buffer_size, self.n_envs, int(action_space.n)), np.float32)

    def note(self, costs: npt.NDArray[np.float32]) -> None:
        """Keeps the costs `(n_envs, n_actions)` of the observations that are added next."""
        self.costs[self.pos] = costs

    def advice(self, batch_size: int) -> tuple[Any, torch.Tensor]:
        """Observations of random steps, and the costs `(batch_size, n_actions)` of the actions there."""
        steps = np.random.randint(0, self.size(), batch_size)
        envs = np.random.randint(0, self.n_envs, batch_size)
        numbers = torch.as_tensor(self.observations[steps, envs])
        return self._observations(numbers), torch.as_tensor(self.costs[steps, envs], device=self.device)

    def state(self) -> dict[str, Any]:
        """As that of `NStepFrameBuffer`, with the costs."""
        return {**super().state(), "costs": self.costs[: self.size()]}

    def put_back(self, state: dict[str, Any]) -> None:
        """Fills the new, empty buffer with what `state` gave."""
        super().put_back(state)
        self.costs[: self.size()] = state["costs"]
