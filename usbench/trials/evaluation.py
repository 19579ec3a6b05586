"""Episodes observed from outside: the recorder around an environment, and evaluation in lockstep."""

import contextlib
import random
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from usbench.coordinates import BY_NAME, TARGET
from usbench.envs.observation import senses
from usbench.records import Evaluation
from usbench.records.episode import MEASURES
from usbench.setting import Setting

# Seed of sampled actions in evaluations; the seeds of the episodes come from the suite.
ACTION_SEED = 20_190_001


class Agent(Protocol):
    """Anything that acts as SB3's models do; those draw from their `action_space`, if they have one."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[npt.NDArray[Any], Any]:
        """Return the actions for a batch of observations, and the next hidden state."""


class Recorder(gym.Wrapper[Any, Any, Any, Any]):
    """Watches an environment and reports each finished episode, without changing anything.

    The report holds the fields of `records.Episode` (without the two counters) and `actions`. In `info` of an
    episode's last step stands what SB3's `Monitor` would write, so that SB3 logs its mean return as usual.
    """

    def __init__(self, env: gym.Env[Any, Any], report: Callable[[dict[str, Any]], None]) -> None:
        """Watch `env` and call `report` at the end of each episode."""
        super().__init__(env)
        self._report = report
        self.n_steps = 0

    def state(self) -> dict[str, Any]:
        """Return how the environment came to where it is, enough for `put_back`."""
        return {"origin": self._origin, "actions": list(self._actions), "n_steps": self.n_steps}

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
        self._pose_keys = [key for key in BY_NAME if key in info]
        self._poses = {f"start_{key}": int(info[key]) for key in self._pose_keys}
        self._poses |= {key: int(info[key]) for key in TARGET if key in info}
        self._phantom = int(info["phantom"]) if "phantom" in info else None
        self._return = 0.0
        self._to_goal: int | None = None
        self._actions: list[int] = []
        return observation, info

    def step(self, action: Any) -> Any:
        """Make one step; report when it ends the episode."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.n_steps += 1
        self._actions.append(int(action))
        # Trained on whatever reward, an agent is judged by the true one.
        self._return += float(info.get("true_reward", reward))
        if info["is_success"] and self._to_goal is None:
            self._to_goal = len(self._actions)
        if terminated or truncated:
            info = {**info, "episode": {"r": self._return, "l": len(self._actions)}}
            self._report(
                {
                    "return_": self._return,
                    "poses": self._poses | {f"final_{key}": int(info[key]) for key in self._pose_keys},
                    "phantom": self._phantom,
                    "measures": {f"final_{name}": float(info[name]) for name in MEASURES if name in info},
                    "final_distance_mm": float(info["distance_mm"]),
                    "final_sin_angle": float(info["sin_angle"]),
                    "is_success": bool(info["is_success"]),
                    "steps_to_goal": self._to_goal,
                    "actions": tuple(self._actions),
                }
            )
        return observation, reward, terminated, truncated, info


class Evaluator:
    """The evaluation episodes of a setting, ready to be played by any agent; the true reward counts."""

    def __init__(self, setting: Setting) -> None:
        """Make one environment per episode of the setting's list."""
        self.episodes = setting.evaluation_episodes()
        self._facts: dict[int, dict[str, Any]] = {}
        self._envs = [
            Recorder(setting.scored.make_env(), partial(self._facts.__setitem__, number))
            for number in range(len(self.episodes))
        ]

    def play(self, agent: Agent, *, checkpoint: int, step: int, deterministic: bool) -> list[Evaluation]:
        """Play every episode, all at once, one batch of observations per step; return them in list order.

        Every random state that the agent could draw from is put back afterwards: training makes the same
        bits whether or not it is evaluated.
        """
        for env in self._envs:
            env.unwrapped.is_watched = getattr(agent, "looks", True)  # type: ignore[attr-defined]
        with _borrowed_randomness(getattr(agent, "action_space", self._envs[0].action_space)):
            facts = self._play(agent, deterministic)
        return [
            Evaluation(
                episode=number,
                eval_episode=number,
                step=step,
                checkpoint=checkpoint,
                deterministic=deterministic,
                **fact,
            )
            for number, fact in enumerate(facts)
        ]

    def _play(self, agent: Agent, deterministic: bool) -> list[dict[str, Any]]:
        self._facts.clear()
        sees_state = getattr(agent, "sees_state", False)
        starts = [
            env.reset(seed=episode.seed, options=episode.options)
            for env, episode in zip(self._envs, self.episodes, strict=True)
        ]
        observations, infos = [list(column) for column in zip(*starts, strict=True)]
        state, first, step = None, np.ones(len(self._envs), dtype=bool), 0
        # The batch stays whole: what is advised for an episode that its agent has ended is not done.
        while len(self._facts) < len(self._envs):
            seen = [{**info, "step": step} for info in infos] if sees_state else senses.batch(observations)
            actions, state = _act(agent, seen, state, first, deterministic)
            for k, env in enumerate(self._envs):
                if k in self._facts:
                    continue
                observations[k], _, _, _, infos[k] = env.step(int(actions[k]))
            first, step = np.zeros(len(self._envs), dtype=bool), step + 1
        return [self._facts[number] for number in range(len(self._envs))]

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()


def explores(agent: Agent) -> bool:
    """Return whether an agent's sampled actions are exploration: it is value-based, as SB3's DQN."""
    return hasattr(agent, "exploration_rate")


def _act(
    agent: Any, seen: Any, state: Any, first: npt.NDArray[np.bool_], deterministic: bool
) -> tuple[npt.NDArray[Any], Any]:
    """Return an action for each episode and the next hidden state.

    SB3's value-based agents toss one coin for a whole batch, to explore in all of it or nowhere: here each
    episode has its own.
    """
    tosses = isinstance(agent, OffPolicyAlgorithm) and explores(agent) and not deterministic
    actions, state = agent.predict(
        seen, state=state, episode_start=first, deterministic=deterministic or tosses
    )
    if tosses:
        for k in np.flatnonzero(np.random.rand(len(actions)) < agent.exploration_rate):
            actions[k] = agent.action_space.sample()
    return actions, state


@contextlib.contextmanager
def _borrowed_randomness(action_space: gym.Space[Any]) -> Iterator[None]:
    """Seed every generator that an agent draws actions from, and put the states back at the end."""
    python_state, numpy_state = random.getstate(), np.random.get_state()
    generator = action_space.np_random.bit_generator
    generator_state = generator.state
    with torch.random.fork_rng(devices=range(torch.cuda.device_count())):
        try:
            random.seed(ACTION_SEED)
            np.random.seed(ACTION_SEED)
            torch.manual_seed(ACTION_SEED)
            generator.state = np.random.PCG64(ACTION_SEED).state
            yield
        finally:
            random.setstate(python_state)
            np.random.set_state(numpy_state)
            generator.state = generator_state
