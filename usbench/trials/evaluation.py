"""Episodes observed from outside: the recorder around an environment, and evaluation in lockstep."""

import contextlib
import random
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from usbench import suite
from usbench.envs.observation import senses
from usbench.records import Evaluation
from usbench.setting import Setting
from usbench.trials.recorder import Recorder

# Seed of sampled actions in evaluations; the seeds of the episodes come from the suite.
ACTION_SEED = 20_190_001


class Agent(Protocol):
    """Anything that acts as SB3's models do; those draw from their `action_space`, if they have one."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[npt.NDArray[Any], Any]:
        """Return the actions for a batch of observations, and the next hidden state."""


class Evaluator:
    """Episodes of a setting, ready to be played by any agent; the true reward counts."""

    def __init__(self, setting: Setting, episodes: Sequence[suite.EvaluationEpisode]) -> None:
        """Make one environment per episode; those of the evaluation are `setting.evaluation_episodes()`."""
        self.episodes = tuple(episodes)
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
