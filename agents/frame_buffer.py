"""A replay buffer for image stacks that keeps every different frame once: some MB instead of GB."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecNormalize

TRANSITIONS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class FrameReplayBuffer(ReplayBuffer):
    """SB3's replay buffer of `(height, width, channels)` observations, stored as the numbers of their frames.

    A stack of four float32 frames of 90 x 40 pixels takes 57.6 kB, and each transition has two of them,
    although a fixed phantom shows only a few hundred frames in all. Here a transition holds eight numbers.
    Sampled observations have the same bits as those that were added. Frames are never dropped: memory grows
    with the number of different frames, not with the number of steps.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Box,
        action_space: spaces.Space[Any],
        device: torch.device | str = "auto",
        n_envs: int = 1,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments; `optimize_memory_usage` has no effect here."""
        height, width, channels = observation_space.shape
        numbers = spaces.Box(0, np.iinfo(np.int32).max, (channels,), np.int32)
        super().__init__(buffer_size, numbers, action_space, device, n_envs, **kwargs)
        self._numbers: dict[bytes, int] = {}
        self._frames = np.empty((256, height, width), observation_space.dtype)

    def add(
        self,
        obs: npt.NDArray[Any],
        next_obs: npt.NDArray[Any],
        action: npt.NDArray[Any],
        reward: npt.NDArray[Any],
        done: npt.NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        """Adds a transition of each environment, as SB3 does."""
        super().add(self._numbered(obs), self._numbered(next_obs), action, reward, done, infos)

    def state(self) -> dict[str, Any]:
        """The contents of the buffer: views of each array's filled part, and every different frame once."""
        arrays = {name: getattr(self, name)[: self.size()] for name in TRANSITIONS}
        return {"pos": self.pos, "full": self.full, "frames": self._frames[: len(self._numbers)], **arrays}

    def put_back(self, state: dict[str, Any]) -> None:
        """Fills the new, empty buffer with what `state` gave.

        Raises:
            ValueError: `state` comes from a buffer of another size.
        """
        self.pos, self.full = state["pos"], state["full"]
        for frame in state["frames"]:
            self._number(frame)
        for name in TRANSITIONS:
            getattr(self, name)[: self.size()] = state[name]

    def _get_samples(
        self, batch_inds: npt.NDArray[np.intp], env: VecNormalize | None = None
    ) -> ReplayBufferSamples:
        samples = super()._get_samples(batch_inds, env)
        return samples._replace(
            observations=self._stacked(samples.observations),
            next_observations=self._stacked(samples.next_observations),
        )

    def _numbered(self, stacks: npt.NDArray[Any]) -> npt.NDArray[np.int32]:
        """The numbers `(n, channels)` of the frames in stacks `(n, height, width, channels)`."""
        frames = np.moveaxis(stacks, -1, 1)
        return np.array([[self._number(frame) for frame in stack] for stack in frames], np.int32)

    def _number(self, frame: npt.NDArray[Any]) -> int:
        key = frame.tobytes()
        if key not in self._numbers:
            number = self._numbers[key] = len(self._numbers)
            if number == len(self._frames):
                self._frames = np.concatenate([self._frames, np.empty_like(self._frames)])
            self._frames[number] = frame
        return self._numbers[key]

    def _stacked(self, numbers: torch.Tensor) -> torch.Tensor:
        """The stacks `(n, height, width, channels)` of the frames with these numbers `(n, channels)`."""
        frames = self._frames[numbers.cpu().numpy()]
        return torch.as_tensor(np.moveaxis(frames, 1, -1), device=self.device)
