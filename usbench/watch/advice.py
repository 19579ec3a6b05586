"""An agent is asked what it advises: how likely it takes every action, or which return it expects of it."""

from typing import Any

import numpy as np
import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.qrdqn.policies import QRDQNPolicy
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.dqn.policies import DQNPolicy

from usbench.agents.baselines import Random
from usbench.envs.observation import senses
from usbench.watch.moment import Advice


class Adviser:
    """Asks an agent about episodes, step by step; an episode begins with step 0."""

    def __init__(self, agent: Any) -> None:
        """Ask `agent`, which acts with `predict`."""
        self._agent = agent
        self._policy = getattr(agent, "policy", None)
        if isinstance(self._policy, BasePolicy):
            self._policy.set_training_mode(False)
        self._memory: Any = None

    @torch.no_grad()
    def advise(self, observation: Any, info: dict[str, Any], step: int) -> Advice:
        """Return the advice after `step` steps; only agents that see the state look at `info`."""
        if step == 0:
            self._forget()
        policy = self._policy
        if not isinstance(policy, BasePolicy) or getattr(self._agent, "remembers", False):
            return self._certain(observation, info, step)
        seen: Any = policy.obs_to_tensor(senses.batch([observation]))[0]
        if isinstance(policy, RecurrentActorCriticPolicy):
            first = torch.tensor([float(step == 0)], device=policy.device)
            distribution, self._memory = policy.get_distribution(seen, self._memory, first)
            return Advice(_probabilities(distribution))
        if isinstance(policy, ActorCriticPolicy):
            return Advice(_probabilities(policy.get_distribution(seen)))
        if isinstance(policy, DQNPolicy):
            values = getattr(policy, "greedy_values", policy.q_net)(seen)
            if getattr(self._agent, "tells_costs", False):
                return Advice(_numbers(values * self._agent.largest_cost), "loss")
            return Advice(_numbers(values), "value")
        if isinstance(policy, QRDQNPolicy):
            return Advice(_numbers(policy.quantile_net(seen).mean(dim=1)), "value")
        return self._certain(observation, info, step)

    def _forget(self) -> None:
        """Forget the episode before."""
        self._memory = None
        if isinstance(self._policy, RecurrentActorCriticPolicy):
            shape = (self._policy.lstm_actor.num_layers, 1, self._policy.lstm_actor.hidden_size)
            zeros = torch.zeros(shape, device=self._policy.device)
            self._memory = (zeros, zeros)

    def _certain(self, observation: Any, info: dict[str, Any], step: int) -> Advice:
        """Ask an agent that tells only its action."""
        n_actions = int(self._agent.action_space.n)
        if isinstance(self._agent, Random):
            return Advice((1 / n_actions,) * n_actions)
        seen = (
            [{**info, "step": step}]
            if getattr(self._agent, "sees_state", False)
            else senses.batch([observation])
        )
        actions, self._memory = self._agent.predict(
            seen, state=self._memory, episode_start=np.array([step == 0]), deterministic=True
        )
        return Advice(tuple(float(action == int(actions[0])) for action in range(n_actions)), "choice")


def _probabilities(distribution: Any) -> tuple[float, ...]:
    return _numbers(distribution.distribution.probs)


def _numbers(row: torch.Tensor) -> tuple[float, ...]:
    return tuple(row[0].tolist())
