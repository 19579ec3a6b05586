"""What every algorithm sees, of many environments in step: `observation/wrappers.py` for vectors."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from usbench.envs.observation.senses import Observation, batch, parts, whole, with_image
from usbench.envs.observation.wrappers import (
    MEAN,
    STD,
    grey_levels,
    normalized,
    normalized_space,
    stacked_space,
)

Flags = npt.NDArray[np.bool_]
Step = tuple[Observation, npt.NDArray[Any], Flags, Flags, dict[str, Any]]
VectorEnv = gym.vector.VectorEnv[Observation, npt.NDArray[Any], npt.NDArray[Any]]
if TYPE_CHECKING:
    VectorWrapper = gym.vector.VectorWrapper[
        Observation, npt.NDArray[Any], Observation, npt.NDArray[Any], npt.NDArray[Any]
    ]
else:  # before Gymnasium 1.4 the class takes no types
    VectorWrapper = gym.vector.VectorWrapper


class VectorImageStack(VectorWrapper):
    """Show the last `n_frames` images of each environment as channels of one: `ImageStack` for vectors.

    Args:
        env: A vector of environments with (height, width, channels) uint8 images, or dictionaries of `image`
            and `senses`, in any autoreset mode.
        n_frames: How many images, at least 1.
    """

    def __init__(self, env: VectorEnv, n_frames: int = 4) -> None:
        """Check the arguments and set the observation spaces."""
        super().__init__(env)
        self.single_observation_space = stacked_space(
            "VectorImageStack", env.single_observation_space, n_frames
        )
        self.n_frames = int(n_frames)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self._mode = env.metadata["autoreset_mode"]
        self._stacks: dict[str, npt.NDArray[Any]] = {}
        self._ended = np.zeros(env.num_envs, np.bool_)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset the environments; the stacks of those that are reset are their first image repeated."""
        everywhere = np.ones(self.num_envs, np.bool_)
        begins = (options or {}).get("reset_mask", everywhere)
        # A copy: vectors of Gymnasium take the mask out of what they are given.
        observations, infos = self.env.reset(seed=seed, options=None if options is None else dict(options))
        self._begin(begins, parts(observations))
        return self._shown(), infos

    def step(self, actions: npt.NDArray[Any]) -> Step:
        """Step the environments; their images become the last channels of the stacks.

        Args:
            actions: One for each environment, (num_envs,) integers.

        Returns:
            Observations whose images are stacks (num_envs, height_px, width_px, n_frames), and the rest of
            Gymnasium's tuple as the environments gave it.
        """
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        seen, ended = parts(observations), terminations | truncations
        last = dict(seen)
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            final = parts(batch(infos["final_obs"][ended]))
            for name, values in seen.items():
                last[name] = values.copy()
                last[name][ended] = final[name]
        for name, values in last.items():
            self._stacks[name] = np.concatenate(
                [self._stacks[name][..., values.shape[-1] :], values], axis=-1
            )
        if self._mode is AutoresetMode.SAME_STEP:
            for i in np.flatnonzero(ended):
                infos["final_obs"][i] = whole({name: own[i].copy() for name, own in self._stacks.items()})
        begun = {AutoresetMode.NEXT_STEP: self._ended, AutoresetMode.SAME_STEP: ended}.get(self._mode)
        if begun is not None:
            self._begin(begun, seen)
        self._ended = ended
        return self._shown(), rewards, terminations, truncations, infos

    def _begin(self, which: Flags, seen: dict[str, npt.NDArray[Any]]) -> None:
        if not self._stacks:
            self._stacks = {
                name: np.zeros((*values.shape[:-1], self.n_frames * values.shape[-1]), values.dtype)
                for name, values in seen.items()
            }
        for name, values in seen.items():
            self._stacks[name][which] = np.tile(values[which], self.n_frames)
        self._ended[which] = False

    def _shown(self) -> Observation:
        return whole({name: values.copy() for name, values in self._stacks.items()})


class VectorNormalizeImage(VectorWrapper):
    """Show (pixel - mean) / std as float32, final observations too: `NormalizeImage` for vectors.

    Args:
        env: A vector of environments with (height, width, channels) uint8 images, or dictionaries that hold
            an `image`, in any autoreset mode.
        mean: Grey level that becomes 0.
        std: Grey levels that become 1, positive.
    """

    def __init__(self, env: VectorEnv, mean: float = MEAN, std: float = STD) -> None:
        """Check the arguments and set the observation spaces."""
        super().__init__(env)
        self.mean, self.std = grey_levels(mean, std)
        self._normalized = partial(normalized, mean=self.mean, std=self.std)
        self.single_observation_space = normalized_space(
            "VectorNormalizeImage", env.single_observation_space, self._normalized
        )
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset the environments and normalize their images."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return with_image(observations, self._normalized), infos

    def step(self, actions: npt.NDArray[Any]) -> Step:
        """Step the environments, with actions (num_envs,); images become float32 of the same shape."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        for i in np.flatnonzero(infos.get("_final_obs", ())):
            infos["final_obs"][i] = with_image(infos["final_obs"][i], self._normalized)
        return with_image(observations, self._normalized), rewards, terminations, truncations, infos
