"""Vectors of environments as Stable-Baselines3 takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import DictInfoToList
from stable_baselines3.common import env_util
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn


class SB3VecEnv(VecEnv):
    """A Gymnasium vector environment as a `VecEnv` of Stable-Baselines3.

    Its steps give what SB3's `DummyVecEnv` gives: the first observation of the next episode where one has
    ended, and in that environment's info `terminal_observation` and `TimeLimit.truncated`. Around it, SB3's
    `VecMonitor` adds the return and the length of each episode.

    Args:
        env: A vector of environments that are reset in the same step, with the environments as `envs`.

    Attributes:
        env: The vector of environments.
        rewards: What the last step earned, (num_envs,), as the environments gave it; SB3 takes float32.

    Raises:
        TypeError: If `env` is no Gymnasium vector environment.
        ValueError: If it resets environments at another time.
    """

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        """Check how the environments are reset."""
        if not isinstance(env, gym.vector.VectorEnv):
            raise TypeError(f"env must be a gymnasium.vector.VectorEnv, not {env!r}.")
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"autoreset_mode must be {AutoresetMode.SAME_STEP.value!r} for Stable-Baselines3, not "
                f"{getattr(mode, 'value', mode)!r}."
            )
        self.env = env
        self._listed = DictInfoToList(env)
        self._actions: npt.NDArray[Any] = np.empty(0)
        self.rewards: npt.NDArray[np.float64] = np.zeros(env.num_envs)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> VecEnvObs:
        """Begin an episode everywhere, with the seeds of `seed` and the options of `set_options`, once."""
        observations: VecEnvObs | None = None
        for options in self._different_options():
            mask = np.array([own == options for own in self._options])
            masked = {**options, "reset_mask": mask}
            observations, infos = self._listed.reset(
                seed=self._seeds,  # type: ignore[arg-type]
                options=(options or None) if mask.all() else masked,
            )
            for i in np.flatnonzero(mask):
                self.reset_infos[i] = _plain(infos[i])
        self._reset_seeds()
        self._reset_options()
        assert observations is not None
        return observations

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step all environments; the arrays and infos are the caller's own."""
        observations, self.rewards, terminations, truncations, listed = self._listed.step(self._actions)
        infos = [_plain(info) for info in listed]
        for i in np.flatnonzero(terminations | truncations):
            final, last = infos[i].pop("final_info"), infos[i].pop("final_obs")
            self.reset_infos[i], infos[i] = infos[i], {**final, "terminal_observation": last}
        for info, truncated in zip(infos, truncations & ~terminations, strict=True):
            info["TimeLimit.truncated"] = bool(truncated)
        return observations, self.rewards.astype(np.float32), terminations | truncations, infos

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def get_images(self) -> Sequence[npt.NDArray[Any] | None]:
        """Return a picture of every environment, None of each without a render mode."""
        pictures = None if self.render_mode is None else self.env.render()
        return pictures or [None] * self.num_envs  # type: ignore[return-value]

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the environments."""
        return [env.get_wrapper_attr(attr_name) for env in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the environments."""
        for env in self._chosen(indices):
            env.set_wrapper_attr(attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the environments."""
        return [one(*method_args, **method_kwargs) for one in self.get_attr(method_name, indices)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return which environments have a wrapper of that class."""
        return [env_util.is_wrapped(env, wrapper_class) for env in self._chosen(indices)]

    def _chosen(self, indices: VecEnvIndices) -> list[gym.Env[Any, Any]]:
        envs: Sequence[gym.Env[Any, Any]] = self.env.unwrapped.envs  # type: ignore[attr-defined]
        return [envs[i] for i in self._get_indices(indices)]

    def _different_options(self) -> list[dict[str, Any]]:
        """Return the options of the next reset, each that several environments share once."""
        return [own for i, own in enumerate(self._options) if own not in self._options[:i]]


def infos_after(
    env: VecEnv, dones: npt.NDArray[np.bool_], infos: Sequence[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return the infos of the observations that a step of `env` gave.

    SB3 gives those of the step: where an episode has ended, its last one. The observation is the first of
    the next episode there, and so is the info that is returned.
    """
    begun = env.unwrapped.reset_infos
    return [begun[k] if done else info for k, (done, info) in enumerate(zip(dones, infos, strict=True))]


def _plain(info: dict[str, Any]) -> dict[str, Any]:
    """Return an info with Python's numbers in place of NumPy's, as a single environment gives them."""
    return {
        name: _plain(value)
        if isinstance(value, dict)
        else value.item()
        if isinstance(value, np.generic)
        else value
        for name, value in info.items()
    }
