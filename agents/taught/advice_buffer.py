"""What a student has seen, and what its teacher said of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from usbench.agents.value_based.n_step_buffer import NStepFrameBuffer


class AdviceBuffer(NStepFrameBuffer):
    """Observations, a byte per pixel and every frame once, with what was told of each."""

    def __init__(
        self,
        buffer_size: int,
        observation_space: Any,
        action_space: Any,
        *,
        n_values: int | None = None,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments; `n_values` numbers are told of each observation, default: one per action."""
        super().__init__(buffer_size, observation_space, action_space, **kwargs)
        n_values = int(action_space.n) if n_values is None else n_values
        self.told = np.zeros((self.buffer_size, self.n_envs, n_values), np.float32)

    def note(self, told: npt.NDArray[Any]) -> None:
        """Keeps what is told `(n_envs, n_values)` of the observations that are added next."""
        self.told[self.pos] = told

    def advice(self, batch_size: int) -> tuple[Any, torch.Tensor]:
        """Observations of random steps, and what was told of them `(batch_size, n_values)`."""
        steps = np.random.randint(0, self.size(), batch_size)
        envs = np.random.randint(0, self.n_envs, batch_size)
        numbers = torch.as_tensor(self.observations[steps, envs])
        return self._observations(numbers), torch.as_tensor(self.told[steps, envs], device=self.device)

    def state(self) -> dict[str, Any]:
        """As that of `NStepFrameBuffer`, with what was told."""
        return {**super().state(), "told": self.told[: self.size()]}

    def put_back(self, state: dict[str, Any]) -> None:
        """Fills the new, empty buffer with what `state` gave."""
        super().put_back(state)
        self.told[: self.size()] = state["told"]
