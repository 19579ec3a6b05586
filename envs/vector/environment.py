"""A vector of guidance environments: one call steps all of them and makes their frames on all cores."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from usbench.checks import whole_number
from usbench.envs import frames
from usbench.envs.guidance import GuidanceEnv, Moved
from usbench.envs.observation.senses import Observation, batch
from usbench.envs.phantom import keep_scatterers
from usbench.envs.vector import arguments

Flags = npt.NDArray[np.bool_]
Step = tuple[Observation, npt.NDArray[np.float64], Flags, Flags, dict[str, Any]]


class GuidanceVectorEnv(gym.vector.VectorEnv[Observation, npt.NDArray[np.int64], npt.NDArray[Any]]):
    """Environments of one class and configuration in step, as `gym.make_vec` gives them.

    Observations, rewards and infos have the bits of Gymnasium's `SyncVectorEnv` with the same seeds and
    actions; the frames that are missing after a step are simulated together.

    Args:
        env_class: A subclass of `GuidanceEnv`, with its own `step` and `reset` as they are there.
        num_envs: How many environments, at least 1.
        autoreset_mode: When an environment whose episode has ended is reset: with the next step, in the same
            step (then `infos` has `final_obs` and `final_info`), or by `reset(options={"reset_mask": ...})`.
        max_episode_steps: Length of an episode, after which it is truncated; None for the task's own.
        kwargs: As for `env_class`.

    Attributes:
        envs: The environments.

    Raises:
        TypeError: If the class is none whose frames can be made together, or an argument has a wrong type.
        ValueError: If an argument is not allowed.
    """

    def __init__(
        self,
        env_class: type[GuidanceEnv],
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        **kwargs: Any,
    ) -> None:
        """Check the configuration; nothing is simulated before the first reset."""
        if not (env_class.step is GuidanceEnv.step and env_class.reset is GuidanceEnv.reset):
            raise TypeError(
                f"{env_class.__name__} has a step or reset of its own, which a vector environment cannot "
                "divide: pass vectorization_mode='sync'."
            )
        self.num_envs = whole_number("num_envs", num_envs, low=1)
        self.autoreset_mode = arguments.mode(autoreset_mode)
        self.max_episode_steps = whole_number(
            "max_episode_steps", env_class.task.n_steps if max_episode_steps is None else max_episode_steps, 1
        )
        if isinstance(kwargs.get("senses"), Iterator):  # the first environment would use it up
            kwargs["senses"] = tuple(kwargs["senses"])
        self.envs = tuple(env_class(**kwargs) for _ in range(self.num_envs))
        first = self.envs[0]
        self.metadata = {**first.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = first.render_mode
        self.single_observation_space = first.observation_space
        self.single_action_space = first.action_space
        self.observation_space = batch_space(first.observation_space, self.num_envs)
        self.action_space = batch_space(first.action_space, self.num_envs)
        space = first.observation_space
        nothing = gym.spaces.unflatten(space, np.zeros(gym.spaces.flatdim(space)))
        self._observations: list[Observation] = [nothing] * self.num_envs
        self._elapsed = np.zeros(self.num_envs, dtype=np.int64)
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        keep_scatterers(self.num_envs)

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the environments."""
        return self.get_attr("np_random")

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seeds of the environments, -1 where one is not known."""
        return self.get_attr("np_random_seed")

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Reset all environments, or those of a mask.

        Args:
            seed: Environment i gets seed + i, or the i-th of a sequence; None continues the old streams.
            options: As for a single environment, the same for all; and "reset_mask", (num_envs,) bool, to
                reset only some of them. The observations of others are those of before, their infos are left
                out.

        Raises:
            TypeError: If an argument has a wrong type.
            ValueError: If a value is not allowed.
        """
        seeds = arguments.seeds(seed, self.num_envs)
        # A copy: the user's own keeps its mask.
        options = dict(options) if isinstance(options, Mapping) else options
        which: Iterable[int] = range(self.num_envs)
        if isinstance(options, dict) and "reset_mask" in options:
            which = np.flatnonzero(arguments.mask(options.pop("reset_mask"), self.num_envs)).tolist()
        for i in which:
            self.envs[i].start(seeds[i], options)
        infos = self._gathered(self._begin(which))
        return batch(self._observations), infos

    def step(self, actions: npt.ArrayLike) -> Step:
        """Step all environments with an action each, (num_envs,).

        Raises:
            gymnasium.error.ResetNeeded: If an environment has not begun, or has ended and is not reset here.
            ValueError: If an action is not allowed; then no environment moves.
        """
        chosen = arguments.actions(actions, self.num_envs, len(self.envs[0].task.actions))
        restarts = self._ended & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        self._check_begun(self._ended & ~restarts)
        moved = {i: self.envs[i].move(chosen[i]) for i in np.flatnonzero(~restarts).tolist()}
        frames.make(self._wanted(moved))

        rewards = np.zeros(self.num_envs)
        terminations = np.zeros(self.num_envs, dtype=np.bool_)
        told: dict[int, dict[str, Any]] = {}
        for i, one in moved.items():
            self._observations[i], rewards[i], terminations[i], _, told[i] = self.envs[i].outcome(one)
        self._elapsed += ~restarts
        truncations = (self._elapsed >= self.max_episode_steps) & ~restarts
        self._ended = terminations | truncations

        again = restarts
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            again = self._ended.copy()
            for i in np.flatnonzero(again).tolist():
                told[i] = {"final_obs": self._observations[i], "final_info": told[i]}
        which = np.flatnonzero(again).tolist()
        for i in which:
            self.envs[i].start()
        for i, info in self._begin(which).items():
            told[i] = told.get(i, {}) | info
        return batch(self._observations), rewards, terminations, truncations, self._gathered(told)

    def render(self) -> tuple[Any, ...]:
        """Return the picture of every environment, as its own `render` does."""
        return tuple(env.render() for env in self.envs)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return an attribute of every environment, or what it returns where it is a method."""
        found = [env.get_wrapper_attr(name) for env in self.envs]
        return tuple(one(*args, **kwargs) if callable(one) else one for one in found)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment: to one value, or to the values of a list or tuple.

        Raises:
            ValueError: If there are not as many values as environments.
        """
        each = values if isinstance(values, list | tuple) else [values] * self.num_envs
        if len(each) != self.num_envs:
            raise ValueError(f"values must be {self.num_envs}, one per environment, not {len(each)}.")
        for env, value in zip(self.envs, each, strict=True):
            env.set_wrapper_attr(name, value)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the environments."""
        for env in self.envs:
            env.close()

    def _wanted(self, moved: Mapping[int, Moved | None]) -> list[tuple[frames.FrameStore, Any]]:
        """Return store and pose of each frame that the environments will look at."""
        return [
            (self.envs[i].frames, pose) for i, one in moved.items() for pose in self.envs[i].looks_at(one)
        ]

    def _begin(self, which: Iterable[int]) -> dict[int, dict[str, Any]]:
        """Observe the environments that have just been started, and return their infos."""
        told: dict[int, dict[str, Any]] = {}
        frames.make(self._wanted(dict.fromkeys(which)))
        for i in which:
            self._observations[i], told[i] = self.envs[i].first_observation()
            self._elapsed[i] = 0
            self._ended[i] = False
        return told

    def _gathered(self, told: Mapping[int, dict[str, Any]]) -> dict[str, Any]:
        """Return the infos of environments as one, as Gymnasium gathers them."""
        infos: dict[str, Any] = {}
        for i, info in told.items():
            infos = self._add_info(infos, info, i)
        return infos

    def _check_begun(self, ended: Flags) -> None:
        """Raise ResetNeeded if an environment has no pose yet, or is one of those that have ended."""
        for env in self.envs:
            _ = env.pose
        if ended.any():
            raise gym.error.ResetNeeded(
                f"the episodes of the environments {np.flatnonzero(ended).tolist()} have ended: call "
                'reset(options={"reset_mask": ...}) first, with True for them.'
            )
