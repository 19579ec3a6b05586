"""The best policy over beliefs, distilled into a network that sees frames and senses (DAgger)."""

from __future__ import annotations

from itertools import compress
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.callbacks import BaseCallback

from usbench.agents.taught.taught import Infos, Taught

Beliefs = npt.NDArray[np.int64]


class Teacher(Protocol):
    """What knows the costs of actions from all that was seen since an episode began."""

    @property
    def stay(self) -> int:
        """The action that moves nothing."""

    def first(self, infos: Infos) -> Beliefs:
        """The beliefs `(n,)` after the first frames of episodes that begin where `infos` say."""

    def following(self, beliefs: Beliefs, actions: npt.NDArray[Any], infos: Infos) -> Beliefs:
        """The beliefs `(n,)` after `actions` have led where `infos` say."""

    def costs(self, beliefs: Beliefs) -> npt.NDArray[np.float32]:
        """What each action costs against the best one, `(n, n_actions)`, not below 0."""


class Distilled(Taught):
    """A student of a teacher who knows the simulator, with the network and the symmetries of `DoubleDQN`.

    Student and teacher take turns by chance, the teacher ever less often, and every step is remembered with
    what the teacher says of it: so the student learns what to do where it gets to by its own errors, too
    (dataset aggregation, DAgger). The network learns the mean of the costs over all that the teacher may know
    and the student does not, and the student takes the action that costs least on average: where it cannot
    tell which of two turns is right, it does first what is needed in any case. At the end it acts alone.

    Two things are changed in the costs. Above `largest_cost` they all count as that, so that the network's
    outputs are exact where actions differ little. To stay costs as much, unless nothing is better: it shows
    nothing new, although the teacher, who has lost a step only, would know what to do afterwards.

    `exploration_rate` is the teacher's share of the steps.

    Sources: Ross et al., "A reduction of imitation learning and structured prediction to no-regret online
    learning" (2011), Algorithm 3.1; Ross and Bagnell, "Reinforcement and imitation learning via interactive
    no-regret learning" (2014), Algorithm 1, for costs in place of actions.

    Attributes:
        takes_teacher: Whether the class is made with a `teacher`.
        tells_costs: Whether the network's outputs are costs, below 0 and in units of `largest_cost`.
    """

    takes_teacher = True
    tells_costs = True

    def __init__(
        self,
        policy: Any,
        env: Any,
        *,
        teacher: Teacher | None = None,
        largest_cost: float = 0.5,
        **kwargs: Any,
    ) -> None:
        """Takes the arguments of `Taught`, and those below.

        Args:
            policy: As there.
            env: As there; its infos say poses and targets, from which the teacher knows what is seen.
            teacher: Who is asked while the student learns; acting needs none.
            largest_cost: What costs more counts as this, in units of returns.
            kwargs: As there; those of returns have no effect.
        """
        self.teacher, self.largest_cost = teacher, largest_cost
        self._beliefs: Beliefs = np.zeros(0, np.int64)
        self._costs: npt.NDArray[np.float32] = np.zeros((0, 0), np.float32)
        super().__init__(policy, env, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "teacher"]

    def _setup_learn(self, *args: Any, **kwargs: Any) -> tuple[int, BaseCallback]:
        if self.teacher is None:
            raise ValueError("a distilled agent learns from a teacher: make it with one.")
        return super()._setup_learn(*args, **kwargs)

    def _sample_action(
        self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """The student's greedy actions, and in their place some of the teacher's."""
        assert self.teacher is not None
        self._costs = self.teacher.costs(self._beliefs)
        share = 1.0 if self.num_timesteps < learning_starts else self.exploration_rate
        led = np.random.rand(n_envs) < share
        actions = self._costs.argmin(axis=1)
        if not led.all():
            own, _ = self.policy.predict(self._last_obs, deterministic=True)  # type: ignore[arg-type]
            actions = np.where(led, actions, own)
        return actions, actions

    def _explored(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The actions as they are: the rate is the teacher's share, and the student acts alone."""
        return actions

    def _begin(self, infos: Infos) -> None:
        assert self.teacher is not None
        self._beliefs = self.teacher.first(infos)

    def _go_on(self, actions: npt.NDArray[Any], dones: npt.NDArray[np.bool_], infos: Infos) -> None:
        assert self.teacher is not None
        going = ~dones
        self._beliefs[going] = self.teacher.following(
            self._beliefs[going], actions[going], list(compress(infos, going))
        )
        self._beliefs[dones] = self.teacher.first(list(compress(infos, dones)))

    def _told(self) -> npt.NDArray[np.float32]:
        assert self.teacher is not None
        costs: npt.NDArray[np.float32] = np.minimum(self._costs / self.largest_cost, 1.0)
        costs[:, self.teacher.stay] = np.sign(costs[:, self.teacher.stay])
        return costs

    def _update(self, batch_size: int) -> float:
        observations, costs = self.replay_buffer.advice(batch_size)
        views = self.policy.q_net.views
        if views is not None:
            numbers = views.drawn(len(costs))
            observations = views.observations(observations, numbers)
            # Symmetries undo themselves: the way there is the way back.
            costs = views.values_from(costs, numbers)
        outputs = self.q_net(self._shifted(observations))
        return self._descended((outputs + costs).square().mean())
