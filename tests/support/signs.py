"""A trivial environment with images, and what the tests of the learning agent ask of a model."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
from torch import nn

from usbench.agents.vpg import VPG


class Signs(gym.Env[np.ndarray, int]):
    """A bright half of the image says which of two actions is right: reward 1 for it, else 0."""

    action_space = gym.spaces.Discrete(2)

    def __init__(self, n_steps: int = 8, dtype: type = np.float32) -> None:
        low, high = (0, 255) if dtype is np.uint8 else (-3.0, 3.0)
        self.observation_space = gym.spaces.Box(low, high, (8, 8, 1), dtype)
        self.dtype, self.n_steps = dtype, n_steps

    def _image(self) -> np.ndarray:
        self.right = int(self.np_random.integers(2))
        bright = np.arange(8)[:, None, None] // 4 == self.right
        image = np.where(bright, 1.0, -1.0) + self.np_random.normal(0, 0.3, (8, 8, 1))
        return (
            (image * 40 + 120).clip(0, 255).astype(np.uint8)
            if self.dtype is np.uint8
            else image.astype(np.float32)
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.step_number = 0
        return self._image(), self._truth()

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        reward = float(int(action) == self.right)
        self.step_number += 1
        return self._image(), reward, False, self.step_number == self.n_steps, self._truth()

    def _truth(self) -> dict[str, int]:
        return {"x_mm": 20 * self.right}


def clone(module: nn.Module) -> dict[str, torch.Tensor]:
    return {name: tensor.clone() for name, tensor in module.state_dict().items()}


def changed(before: dict[str, torch.Tensor], module: nn.Module) -> set[str]:
    return {name for name, tensor in module.state_dict().items() if not torch.equal(tensor, before[name])}


def flat(model: VPG) -> torch.Tensor:
    return torch.cat([tensor.double().flatten() for tensor in model.policy.state_dict().values()])
