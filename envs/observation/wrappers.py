"""Observation wrappers: the last few frames as channels of one image, and pixels as normalized floats."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from usbench.checks import number, positive, whole_number
from usbench.envs.observation.senses import IMAGE, SENSES, Observation, parts, whole, with_image

# Mean and standard deviation of the pixels in all frames of both tasks, held to them by a slow test.
MEAN, STD = 46.5, 52.9


class ImageStack(gym.Wrapper[Observation, int, Observation, int], gym.utils.RecordConstructorArgs):
    """Show the last `n_frames` images as channels of one, oldest first; after a reset the first is repeated.

    Senses are stacked likewise, those of the oldest image first: what a move did to the picture tells more
    than the picture. Gymnasium's own stack adds a leading axis, which Stable-Baselines3 does not take for an
    image, and Stable-Baselines3's `VecFrameStack` starts an episode with black frames.

    Args:
        env: An environment with (height, width, channels) uint8 images, or dictionaries of `image` and
            `senses` (size,).
        n_frames: How many images, at least 1.
    """

    def __init__(self, env: gym.Env[Observation, int], n_frames: int = 4) -> None:
        """Check the arguments and set the observation space."""
        gym.utils.RecordConstructorArgs.__init__(self, n_frames=n_frames)
        gym.Wrapper.__init__(self, env)
        self.observation_space = stacked_space("ImageStack", env.observation_space, n_frames)
        self.n_frames = int(n_frames)
        self._last: deque[dict[str, npt.NDArray[Any]]] = deque(maxlen=self.n_frames)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset the environment; the stack is its first observation `n_frames` times."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._last.extend([parts(observation)] * self.n_frames)
        return self._stack(), info

    def step(self, action: int) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Step the environment; its image becomes the last channels of the stack."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._last.append(parts(observation))
        return self._stack(), reward, terminated, truncated, info

    def _stack(self) -> Observation:
        # New arrays every time: replay and rollout buffers may keep the old ones.
        return whole(
            {name: np.concatenate([one[name] for one in self._last], axis=-1) for name in self._last[0]}
        )


class NormalizeImage(gym.ObservationWrapper[Observation, int, Observation], gym.utils.RecordConstructorArgs):
    """Show (pixel - mean) / std as float32, in the image's own shape; senses stay as they are.

    Fixed numbers, not running ones: the same frame looks the same to every algorithm at every time.

    Args:
        env: An environment with (height, width, channels) uint8 images, or dictionaries that hold an `image`.
        mean: Grey level that becomes 0.
        std: Grey levels that become 1, positive.
    """

    def __init__(self, env: gym.Env[Observation, int], mean: float = MEAN, std: float = STD) -> None:
        """Check the arguments and set the observation space."""
        gym.utils.RecordConstructorArgs.__init__(self, mean=mean, std=std)
        gym.ObservationWrapper.__init__(self, env)
        self.mean, self.std = grey_levels(mean, std)
        self._normalized = partial(normalized, mean=self.mean, std=self.std)
        self.observation_space = normalized_space("NormalizeImage", env.observation_space, self._normalized)

    def observation(self, observation: Observation) -> Observation:
        """Return the observation, its image as normalized float32."""
        return with_image(observation, self._normalized)


def normalized(pixels: npt.NDArray[Any], mean: np.float32, std: np.float32) -> npt.NDArray[np.float32]:
    """Return grey levels, of any shape, in units of `std` above `mean`."""
    image: npt.NDArray[np.float32] = np.subtract(pixels, mean, dtype=np.float32)
    image /= std
    return image


def grey_levels(mean: float, std: float) -> tuple[np.float32, np.float32]:
    """Return the grey levels that become 0 and 1 in the precision of normalised pixels.

    Raises:
        TypeError: If one is not a number.
        ValueError: If one is not finite, `std` is not positive, or a pixel would not be finite with them.
    """
    with np.errstate(all="ignore"):
        shift, scale = np.float32(number("mean", mean)), np.float32(positive("std", std))
        ends = (np.array([0, 255], np.float32) - shift) / scale
    if not np.isfinite([shift, scale, *ends]).all():
        raise ValueError(
            "mean and std must make finite 32-bit numbers of the grey levels 0 to 255, not "
            f"{float(mean):g} and {float(std):g}."
        )
    return shift, scale


def stacked_space(wrapper: str, space: gym.Space[Any], n_frames: int) -> gym.Space[Any]:
    """Return the space of `n_frames` observations stacked along their last axis.

    Raises:
        TypeError: If there is no image in the space, or `n_frames` is not a number.
        ValueError: If `n_frames` is not a whole number from 1.
    """
    known: dict[str, Any] = {IMAGE: image_space(wrapper, space)}
    if isinstance(space, gym.spaces.Dict):
        known[SENSES] = space[SENSES]
    n = whole_number("n_frames", n_frames, low=1)
    stacked: dict[str, gym.Space[Any]] = {
        name: gym.spaces.Box(np.tile(one.low, n), np.tile(one.high, n), dtype=one.dtype.type)
        for name, one in known.items()
    }
    return gym.spaces.Dict(stacked) if SENSES in stacked else stacked[IMAGE]


def normalized_space(
    wrapper: str, space: gym.Space[Any], normalized: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]
) -> gym.Space[Any]:
    """Return the space of observations whose images are normalised as float32, or raise TypeError."""
    own = image_space(wrapper, space)
    image = gym.spaces.Box(normalized(own.low), normalized(own.high), dtype=np.float32)
    return gym.spaces.Dict({**space.spaces, IMAGE: image}) if isinstance(space, gym.spaces.Dict) else image


def image_space(wrapper: str, space: gym.Space[Any]) -> gym.spaces.Box:
    """Return the space of the images if they are (height, width, channels) uint8, or raise TypeError."""
    if isinstance(space, gym.spaces.Dict) and IMAGE in space.spaces:
        space = space[IMAGE]
    if not isinstance(space, gym.spaces.Box) or space.dtype != np.uint8 or len(space.shape) != 3:
        raise TypeError(f"{wrapper} needs (height, width, channels) uint8 images, not {space}.")
    return space
