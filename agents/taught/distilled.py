"""The best policy over beliefs, distilled into a network that sees frames and senses (DAgger)."""

from __future__ import annotations

from itertools import compress
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.callbacks import BaseCallback
from torch.nn import functional

from usbench.agents.taught.taught import Infos, Taught

Beliefs = npt.NDArray[np.int64]


class Teacher(Protocol):
    """What knows the costs of actions from all that was seen since an episode began."""

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
    (dataset aggregation, DAgger). An update brings the softmax of the network's outputs nearer to that of the
    negative costs over `temperature`. At the end the student acts alone, from observations.

    `exploration_rate` is the teacher's share of the steps.

    Sources: Ross et al., "A reduction of imitation learning and structured prediction to no-regret online
    learning" (2011), Algorithm 3.1; Rusu et al., "Policy distillation" (2016), Eq. 3.

    Attributes:
        takes_teacher: Whether the class is made with a `teacher`.
        tells_preferences: Whether the network's outputs are logits of actions, and no returns.
    """

    takes_teacher = True
    tells_preferences = True

    def __init__(
        self,
        policy: Any,
        env: Any,
        *,
        teacher: Teacher | None = None,
        temperature: float = 0.1,
        **kwargs: Any,
    ) -> None:
        """Takes the arguments of `Taught`, and those below.

        Args:
            policy: As there.
            env: As there; its infos say poses and targets, from which the teacher knows what is seen.
            teacher: Who is asked while the student learns; acting needs none.
            temperature: Costs are divided by it: the lower it is, the less does the second-best action count.
            kwargs: As there; those of returns have no effect.
        """
        self.teacher, self.temperature = teacher, temperature
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
        return self._costs

    def _update(self, batch_size: int) -> float:
        observations, costs = self.replay_buffer.advice(batch_size)
        views = self.policy.q_net.views
        if views is not None:
            numbers = views.drawn(len(costs))
            observations = views.observations(observations, numbers)
            # Symmetries undo themselves: the way there is the way back.
            costs = views.values_from(costs, numbers)
        outputs = self.q_net(self._shifted(observations))
        advised = functional.softmax(-costs / self.temperature, dim=1)
        loss = functional.kl_div(functional.log_softmax(outputs, dim=1), advised, reduction="batchmean")
        return self._descended(loss)
