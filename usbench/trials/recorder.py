"""Training and evaluation episodes recorded from outside, of one environment or of many in step."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnvWrapper

from usbench.agents.vec_env import SB3VecEnv
from usbench.records.facts import Facts

Report = Callable[[dict[str, Any]], None]


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Watches an environment and reports each finished episode, without changing anything.

    The report is that of `Facts`. The last `info` of an episode holds what SB3's `Monitor` would write.
    """

    def __init__(self, env: gym.Env[Any, Any], report: Report) -> None:
        """Watch `env` and call `report` at the end of each episode."""
        super().__init__(env)
        self._report = report
        self.n_steps = 0

    def state(self) -> dict[str, Any]:
        """Return how the environment came to where it is, enough for `put_back`."""
        return {"origin": self._origin, "actions": list(self._facts.actions), "n_steps": self.n_steps}

    def put_back(self, state: dict[str, Any]) -> Any:
        """Start the episode of `state` again and play its actions; return the last observation.

        Whatever wrappers there are, they end as they were, generators included.
        """
        if isinstance(state["origin"], int):
            observation, _ = self.reset(seed=state["origin"])
        else:
            self.unwrapped.np_random.bit_generator.state = state["origin"]
            observation, _ = self.reset()
        for action in state["actions"]:
            observation, *_ = self.step(action)
        self.n_steps = state["n_steps"]
        return observation

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode."""
        self._origin = self.unwrapped.np_random.bit_generator.state if seed is None else seed
        observation, info = self.env.reset(seed=seed, options=options)
        self._facts = Facts(info)
        return observation, info

    def step(self, action: Any) -> Any:
        """Make one step; report when it ends the episode."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.n_steps += 1
        self._facts.add(action, float(reward), info)
        if terminated or truncated:
            info = {**info, "episode": self._facts.monitored}
            self._report(self._facts.report(info))
        return observation, reward, terminated, truncated, info


class VectorRecorder(VecEnvWrapper):
    """Watches environments in step, as `Recorder` does one; `step` of a report counts the steps of all."""

    venv: SB3VecEnv

    def __init__(self, venv: SB3VecEnv, report: Report) -> None:
        """Watch `venv` and call `report` at the end of each episode, in the order of the environments."""
        super().__init__(venv)
        self._report = report
        self.n_steps = 0

    def state(self) -> dict[str, Any]:
        """Return how the environments came to where they are, enough for `put_back`."""
        return {
            "origins": list(self._origins),
            "options": [facts.options for facts in self._facts],
            "actions": [list(facts.actions) for facts in self._facts],
            "n_steps": self.n_steps,
        }

    def put_back(self, state: dict[str, Any]) -> Any:
        """Start the episodes of `state` again and play their actions; return the last observations."""
        self.reset()
        left = [len(actions) for actions in state["actions"]]
        observations: Any = None
        # Some may be further than others: those with most steps behind them begin first.
        for behind in range(max(left), -1, -1):
            for i in np.flatnonzero(np.equal(left, behind)).tolist():
                observations = self._begin_again(i, state["options"][i], state["origins"][i])
            if behind:
                # The others only wait for their own beginning: what they do is forgotten.
                actions = [own[-behind] if len(own) >= behind else 0 for own in state["actions"]]
                observations, *_ = self._quiet_step(np.array(actions))
        self.n_steps = state["n_steps"]
        return observations

    def reset(self) -> Any:
        """Start an episode everywhere."""
        observations = self.venv.reset()
        self._facts = [Facts(info) for info in self.venv.reset_infos]
        self._origins = [self._generator(i).state for i in range(self.num_envs)]
        return observations

    def step_wait(self) -> Any:
        """Make one step everywhere; report the episodes that it ends."""
        observations, rewards, dones, infos = self.venv.step_wait()
        self.n_steps += self.num_envs
        for i, facts in enumerate(self._facts):
            # SB3's rewards are float32; records hold what the environment gave.
            facts.add(self._actions[i], float(self.venv.rewards[i]), infos[i])
            if dones[i]:
                infos[i]["episode"] = facts.monitored
                self._report({**facts.report(infos[i]), "step": self.n_steps})
                self._facts[i] = Facts(self.venv.reset_infos[i])
                self._origins[i] = self._generator(i).state
        return observations, rewards, dones, infos

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions
        self.venv.step_async(actions)

    def _quiet_step(self, actions: npt.NDArray[Any]) -> Any:
        report, self._report = self._report, lambda facts: None
        try:
            return self.step(actions)
        finally:
            self._report = report

    def _begin_again(self, i: int, options: dict[str, int], origin: dict[str, Any]) -> Any:
        """Start the episode of environment `i` that had these options, and left its generator so."""
        mask = np.arange(self.num_envs) == i
        observations, _ = self.venv.env.reset(options={**options, "reset_mask": mask})
        self._generator(i).state = origin
        info = self.venv.env.unwrapped.envs[i].first_observation()[1]  # type: ignore[attr-defined]
        self._facts[i], self._origins[i] = Facts(info), origin
        return observations

    def _generator(self, i: int) -> Any:
        return self.venv.env.unwrapped.envs[i].np_random.bit_generator  # type: ignore[attr-defined]
