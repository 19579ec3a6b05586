"""Evaluation: all episodes of a list in step, played by any agent."""

import contextlib
import random
import reprlib
from collections.abc import Iterator, Mapping, Sequence
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

        The generators of Python, NumPy, PyTorch and the action space are put back afterwards: training makes
        the same bits whether or not it is evaluated, unless `predict` draws from a generator of the agent's
        own that `learn` draws from, too.
        """
        for env in self._envs:
            env.unwrapped.is_watched = getattr(agent, "looks", True)  # type: ignore[attr-defined]
        self._facts.clear()
        starts = [{"seed": episode.seed, "options": episode.options} for episode in self.episodes]
        with _borrowed_randomness(getattr(agent, "action_space", self._envs[0].action_space)):
            play_in_step(agent, self._envs, starts, deterministic=deterministic)
        return [
            Evaluation(
                episode=number,
                eval_episode=number,
                step=step,
                checkpoint=checkpoint,
                deterministic=deterministic,
                **self._facts[number],
            )
            for number in range(len(self._envs))
        ]

    def close(self) -> None:
        """Close the environments."""
        for env in self._envs:
            env.close()


def play_in_step(
    agent: Agent,
    envs: Sequence[gym.Env[Any, Any]],
    starts: Sequence[Mapping[str, Any]],
    *,
    deterministic: bool,
) -> None:
    """Play one episode in each of `envs`, all at once, one batch of observations per step.

    Args:
        agent: Who acts.
        envs: The environments, which see the actions.
        starts: For each of them what its `reset` is called with.
        deterministic: Whether actions are greedy rather than sampled.
    """
    sees_state = getattr(agent, "sees_state", False)
    reset = [env.reset(**start) for env, start in zip(envs, starts, strict=True)]
    observations, infos = [list(column) for column in zip(*reset, strict=True)]
    state, first, step = None, np.ones(len(envs), dtype=bool), 0
    over: npt.NDArray[np.bool_] = np.zeros(len(envs), dtype=bool)
    # The batch stays whole: what is advised for an episode that its agent has ended is not done.
    while not over.all():
        seen = [{**info, "step": step} for info in infos] if sees_state else senses.batch(observations)
        actions, state = _act(agent, seen, state, first, deterministic)
        for k in np.flatnonzero(~over).tolist():
            observations[k], _, terminated, truncated, infos[k] = envs[k].step(int(actions[k]))
            over[k] = terminated or truncated
        first, step = np.zeros(len(envs), dtype=bool), step + 1


def explores(agent: Agent) -> bool:
    """Return whether an agent's sampled actions are exploration: it is value-based, as SB3's DQN.

    The rate of one with a teacher is the teacher's share, and it acts alone.
    """
    return hasattr(agent, "exploration_rate") and not getattr(agent, "takes_teacher", False)


def _act(
    agent: Any, seen: Any, state: Any, first: npt.NDArray[np.bool_], deterministic: bool
) -> tuple[npt.NDArray[Any], Any]:
    """Return an action for each episode and the next hidden state.

    SB3's value-based agents toss one coin for a whole batch, to explore in all of it or nowhere: here each
    episode has its own.
    """
    tosses = isinstance(agent, OffPolicyAlgorithm) and explores(agent) and not deterministic
    found = agent.predict(seen, state=state, episode_start=first, deterministic=deterministic or tosses)
    if not isinstance(found, tuple) or len(found) != 2 or np.shape(found[0]) != first.shape:
        raise TypeError(
            f"predict must return actions {first.shape} and a state, as Stable-Baselines3's does, not "
            f"{reprlib.repr(found)}."
        )
    actions, state = found
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
