"""Observation wrappers: the last few frames as channels of one image, and pixels as normalized floats."""

from __future__ import annotations

from collections import deque
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from usbench.checks import number, positive, whole_number

# Mean and standard deviation of the pixels in all frames of both tasks, held to them by a slow test.
MEAN, STD = 46.5, 52.9


class ImageStack(
    gym.Wrapper[npt.NDArray[np.uint8], int, npt.NDArray[np.uint8], int], gym.utils.RecordConstructorArgs
):
    """Show the last `n_frames` images as channels of one, oldest first; after a reset the first is repeated.

    Gymnasium's own stack adds a leading axis, which Stable-Baselines3 does not take for an image, and
    Stable-Baselines3's `VecFrameStack` starts an episode with black frames.

    Args:
        env: An environment with (height, width, channels) uint8 images.
        n_frames: How many images, at least 1.
    """

    def __init__(self, env: gym.Env[npt.NDArray[np.uint8], int], n_frames: int = 4) -> None:
        """Check the arguments and set the observation space."""
        gym.utils.RecordConstructorArgs.__init__(self, n_frames=n_frames)
        gym.Wrapper.__init__(self, env)
        space = _image_space("ImageStack", env)
        self.n_frames = whole_number("n_frames", n_frames, low=1)
        low, high = (np.tile(bound, self.n_frames) for bound in (space.low, space.high))
        self.observation_space = gym.spaces.Box(low, high, dtype=np.uint8)
        self._frames: deque[npt.NDArray[np.uint8]] = deque(maxlen=self.n_frames)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.uint8], dict[str, Any]]:
        """Reset the environment; the stack is its first image `n_frames` times."""
        frame, info = self.env.reset(seed=seed, options=options)
        self._frames.extend([frame] * self.n_frames)
        return self._stack(), info

    def step(self, action: int) -> tuple[npt.NDArray[np.uint8], Any, bool, bool, dict[str, Any]]:
        """Step the environment; its image becomes the last channels of the stack."""
        frame, reward, terminated, truncated, info = self.env.step(action)
        self._frames.append(frame)
        return self._stack(), reward, terminated, truncated, info

    def _stack(self) -> npt.NDArray[np.uint8]:
        # A new array every time: replay and rollout buffers may keep the old one.
        return np.concatenate(self._frames, axis=2)


class NormalizeImage(
    gym.ObservationWrapper[npt.NDArray[np.float32], int, npt.NDArray[np.uint8]],
    gym.utils.RecordConstructorArgs,
):
    """Show (pixel - mean) / std as float32, in the image's own shape.

    Fixed numbers, not running ones: the same frame looks the same to every algorithm at every time.

    Args:
        env: An environment with (height, width, channels) uint8 images.
        mean: Grey level that becomes 0.
        std: Grey levels that become 1, positive.
    """

    def __init__(
        self, env: gym.Env[npt.NDArray[np.uint8], int], mean: float = MEAN, std: float = STD
    ) -> None:
        """Check the arguments and set the observation space."""
        gym.utils.RecordConstructorArgs.__init__(self, mean=mean, std=std)
        gym.ObservationWrapper.__init__(self, env)
        self.mean, self.std = np.float32(number("mean", mean)), np.float32(positive("std", std))
        space = _image_space("NormalizeImage", env)
        self.observation_space = gym.spaces.Box(
            self.observation(space.low), self.observation(space.high), dtype=np.float32
        )

    def observation(self, observation: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Return the image as normalized float32."""
        image: npt.NDArray[np.float32] = np.subtract(observation, self.mean, dtype=np.float32)
        image /= self.std
        return image


def _image_space(wrapper: str, env: gym.Env[npt.NDArray[np.uint8], int]) -> gym.spaces.Box:
    space = env.observation_space
    if not isinstance(space, gym.spaces.Box) or space.dtype != np.uint8 or len(space.shape) != 3:
        raise TypeError(f"{wrapper} needs (height, width, channels) uint8 images, not {space}.")
    return space
