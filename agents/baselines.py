"""The reference policies (random, stay, oracle): they learn nothing, and have SB3's `learn` and `predict`."""

import abc
import json
import zipfile
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from usbench.checks import check_seed
from usbench.coordinates import POSE, TARGET

Actions = np.ndarray[Any, np.dtype[np.int64]]
STAY = 0


class Planner(Protocol):
    """What the oracle follows: a plan that knows where the probe is."""

    def action(self, step: int, pose: tuple[int, ...], *target: tuple[int, ...]) -> int:
        """The action after `step` steps at the pose `(x_mm, focal_depth_mm, angle_deg)`.

        `target` is the pose to be found, where episodes differ in that pose. A plan whose poses have other
        coordinates names these in an attribute `coordinates`.
        """
        ...


class _NotLearned(abc.ABC):
    """What the reference policies share: the interface of SB3, with nothing to learn."""

    sees_state: ClassVar[bool] = False
    looks: ClassVar[bool] = False
    num_timesteps = 0

    def __init__(self, policy: object, env: Any, seed: int | None = None) -> None:
        """Takes the spaces of `env`, of Gymnasium or a vector of Stable-Baselines3, with discrete actions."""
        if not isinstance(env.action_space, spaces.Discrete):
            raise ValueError(f"the actions must be Discrete, not {env.action_space}.")
        self.policy = policy
        self.action_space = env.action_space
        self.observation_space = env.observation_space
        self.seed = None if seed is None else check_seed(seed)

    def learn(self, total_timesteps: int, *args: object, **kwargs: object) -> Self:
        """Learns nothing and takes no step; returns the agent."""
        return self

    def predict(
        self,
        observation: Any,
        state: tuple[Any, ...] | None = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Actions, tuple[Any, ...] | None]:
        """Actions `(n_envs,)` for a batch of observations, `()` for a single one; `state` passes through."""
        return self._actions(observation), state

    @abc.abstractmethod
    def _actions(self, observation: Any) -> Actions:
        """The action for each observation."""

    def _batch_shape(self, observation: Any) -> tuple[int, ...]:
        """`(n_envs,)` for a batch of observations, `()` for a single one."""
        space = self.observation_space
        while isinstance(space, spaces.Dict):  # every part of it has the batch's axis
            part = next(iter(space.spaces))
            space, observation = space[part], observation[part]
        shape: tuple[int, ...] = np.shape(observation)
        return shape[: len(shape) - len(space.shape)]

    def _data(self) -> dict[str, Any]:
        return {"seed": self.seed}

    def _restore(self, data: dict[str, Any]) -> None:
        self.seed = data["seed"]

    def save(self, path: str | Path) -> None:
        """Writes a zip of JSON; `.zip` is added where the name has no ending."""
        path = Path(path)
        with zipfile.ZipFile(path if path.suffix else path.with_suffix(".zip"), "w") as archive:
            # A `ZipInfo` made here carries no time of day, so that the same agent gives the same bytes.
            archive.writestr(zipfile.ZipInfo("data.json"), json.dumps(self._data()))

    @classmethod
    def load(cls, path: str | Path, env: gym.Env[Any, Any], policy: object = None) -> Self:
        """The agent that `save` wrote, for `env`; the oracle's `policy` has to be given again."""
        path = Path(path)
        with zipfile.ZipFile(path if path.suffix else path.with_suffix(".zip")) as archive:
            data = json.loads(archive.read("data.json"))
        agent = cls(policy, env)
        agent._restore(data)
        return agent


class Random(_NotLearned):
    """Every action with the same probability, whatever `deterministic` says."""

    def __init__(self, policy: object, env: Any, seed: int | None = None) -> None:
        """Makes the generator of the actions from `seed`."""
        super().__init__(policy, env, seed)
        self._generator = np.random.default_rng(self.seed)

    def _actions(self, observation: Any) -> Actions:
        return np.asarray(self._generator.integers(self.action_space.n, size=self._batch_shape(observation)))

    def _data(self) -> dict[str, Any]:
        return super()._data() | {"generator": self._generator.bit_generator.state}

    def _restore(self, data: dict[str, Any]) -> None:
        super()._restore(data)
        self._generator.bit_generator.state = data["generator"]


class Stay(_NotLearned):
    """Action 0, always: in every task it moves nothing."""

    def _actions(self, observation: Any) -> Actions:
        return np.full(self._batch_shape(observation), STAY, dtype=np.int64)


class Oracle(_NotLearned):
    """Follows a plan made with full knowledge: `predict` is given `info` in place of the observation.

    An `info` says the pose (`x_mm`, `focal_depth_mm`, `angle_deg`) and `step`, the number of steps that were
    taken in the episode, 0 after reset. Where episodes differ in the pose to be found, `info` says that pose
    too (`target_x_mm`, ...).
    """

    sees_state: ClassVar[bool] = True
    policy: Planner

    def __init__(self, policy: Planner, env: Any, seed: int | None = None) -> None:
        """Takes the plan: an object with `action(step, (x_mm, focal_depth_mm, angle_deg)) -> int`."""
        if not callable(getattr(policy, "action", None)):
            raise TypeError(f"the oracle's policy must have a method action(step, pose), not {policy!r}.")
        super().__init__(policy, env, seed)

    def _actions(self, observation: Any) -> Actions:
        if isinstance(observation, dict):
            return np.asarray(self._action(observation))
        return np.array([self._action(info) for info in observation], dtype=np.int64)

    def _action(self, info: dict[str, Any]) -> int:
        keys = getattr(self.policy, "coordinates", POSE)
        missing = [key for key in ("step", *keys) if key not in info]
        if missing:
            raise ValueError(f"info must say {', '.join(('step', *keys))}; {', '.join(missing)} is missing.")
        known = [names for names in (keys, TARGET) if names[0] in info]
        pose, *target = (tuple(int(info[name]) for name in names) for names in known)
        return int(self.policy.action(int(info["step"]), pose, *target))
