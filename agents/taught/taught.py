"""What agents have in common that are told something of every observation while they learn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from usbench.agents.taught.advice_buffer import AdviceBuffer
from usbench.agents.value_based.double_dqn import DoubleDQN
from usbench.agents.vec_env import infos_after

Infos = Sequence[Mapping[str, Any]]


class Taught(DoubleDQN, ABC):
    """A `DoubleDQN` that remembers each observation with what it is told of it, in place of rewards.

    What it is told follows from the infos of the environments, which say the truth; subclasses say how.

    Args:
        policy: As for `DoubleDQN`.
        env: As there; its infos say poses and targets.
        n_told: How many numbers are told of an observation, None for one per action.
        kwargs: As there; those of returns have no effect.
    """

    replay_buffer: AdviceBuffer

    def __init__(self, policy: Any, env: Any, *, n_told: int | None = None, **kwargs: Any) -> None:
        """Takes the arguments of the class."""
        told = {"n_values": n_told}
        super().__init__(policy, env, replay_buffer_class=AdviceBuffer, replay_buffer_kwargs=told, **kwargs)

    @abstractmethod
    def _begin(self, infos: Infos) -> None:
        """Episodes begin in all environments, where `infos` say."""

    @abstractmethod
    def _go_on(self, actions: npt.NDArray[Any], dones: npt.NDArray[np.bool_], infos: Infos) -> None:
        """Actions `(n_envs,)` have led where `infos` say; where `dones`, to the beginning of an episode."""

    @abstractmethod
    def _told(self) -> npt.NDArray[Any]:
        """What is told of the observations on which the last actions were chosen, `(n_envs, n_told)`."""

    def _episodes_begin(self) -> None:
        super()._episodes_begin()
        assert self.env is not None
        self._begin(self.env.unwrapped.reset_infos)

    def _store_transition(
        self,
        replay_buffer: Any,
        buffer_action: npt.NDArray[Any],
        new_obs: Any,
        reward: npt.NDArray[Any],
        dones: npt.NDArray[Any],
        infos: list[dict[str, Any]],
    ) -> None:
        assert self.env is not None
        replay_buffer.note(self._told())
        super()._store_transition(replay_buffer, buffer_action, new_obs, reward, dones, infos)
        self._go_on(buffer_action, dones, infos_after(self.env, dones, infos))
