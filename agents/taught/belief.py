"""A classical agent: recognise what is seen, filter where the object may be, act as the oracle would."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.dqn.policies import QNetwork
from torch.nn import functional

from usbench.agents.networks import IMAGE, SENSES
from usbench.agents.taught.taught import Infos, Taught
from usbench.agents.value_based.grid_trunk import GridTrunk
from usbench.agents.value_based.symmetric_policy import SymmetricPolicy

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int64]


class Model(Protocol):
    """What the agent knows of its task."""

    looks: Ints  # how the object looks, by pose and place (n_states, n_targets)
    is_best: Floats  # 1 for the best actions there, (n_states, n_targets, n_actions)

    @property
    def n_looks(self) -> int:
        """How many different looks there are."""

    def look(self, infos: Infos) -> Ints:
        """How the object looks where `infos` say `(n,)`."""

    def states(self, senses: Floats) -> Ints:
        """The poses `(n,)` that senses `(n, size)` tell."""


NO_MODEL = "a belief agent knows its task: make it with a model, or set `model` after loading it."


class Known(NamedTuple):
    """What the agent knows of episodes.

    Attributes:
        evidence: Logarithms of how likely each place of the object is, but for a constant, (n, n_targets).
        visited: From which poses a frame was seen, (n, n_states): the frame of a pose tells nothing twice.
    """

    evidence: Floats
    visited: npt.NDArray[np.bool_]


class LastFrameTrunk(GridTrunk):
    """The `GridTrunk` on the last image of a stack; senses are not looked at."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        """Builds the trunk for the space's `image`, `(height, width, channels)`."""
        image = observation_space[IMAGE]
        assert isinstance(image, spaces.Box)
        super().__init__(spaces.Box(image.low[..., -1:], image.high[..., -1:], dtype=np.float32))

    def forward(self, observations: Any) -> torch.Tensor:
        """Features `(n, 720)` of a batch of observations."""
        return super().forward(observations[IMAGE][..., -1:])


class RecognisingPolicy(SymmetricPolicy):
    """The recogniser: its networks tell looks, not actions.

    Attributes:
        counts: How often each look was seen in training, and once more, (n_looks,).
    """

    counts: torch.Tensor

    def __init__(self, *args: Any, n_looks: int, **kwargs: Any) -> None:
        """Takes SB3's arguments; there are `n_looks` looks."""
        self.n_looks = n_looks
        super().__init__(*args, **kwargs)
        self.register_buffer("counts", torch.ones(n_looks))

    def make_q_net(self) -> Any:
        """A new network, with an output for each look."""
        arguments: dict[str, Any] = {**self.net_args, "action_space": spaces.Discrete(self.n_looks)}
        arguments = self._update_features_extractor(arguments, features_extractor=None)
        return QNetwork(**arguments).to(self.device)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {**super()._get_constructor_parameters(), "n_looks": self.n_looks}


class BeliefAgent(Taught):
    """Recognises, filters, and acts; learning is for the recogniser alone.

    A network tells how the object looks in a frame, that is which set of poses it may be seen from; it learns
    the truth of training phantoms. Its probabilities, divided by how often each look was met, are the
    likelihoods of a Bayes filter over the places of the object; the tracked probe tells where it is itself.
    The action is that which is best in the likeliest cases: each place votes with its probability.

    Sources: Bourlard and Morgan, "Connectionist speech recognition" (1994), for likelihoods from a
    classifier; Simmons and Koenig, "Probabilistic robot navigation in partially observable environments"
    (1995), for votes.

    Attributes:
        takes_model: Whether the class is made with a `model` of the task.
        remembers: Whether `predict` needs its state of the steps before.
    """

    takes_model = True
    takes_symmetries = False
    remembers = True
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"MultiInputPolicy": RecognisingPolicy}
    model: Any
    policy: RecognisingPolicy

    def __init__(
        self,
        policy: Any,
        env: Any,
        *,
        model: Model | None = None,
        policy_kwargs: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        """Takes the arguments of `Taught`, and those below.

        Args:
            policy: A `RecognisingPolicy`, or "MultiInputPolicy".
            env: As there, with senses that tell the pose; its infos say poses and targets, for training.
            model: What is known of the task.
            policy_kwargs: As there.
            kwargs: As there; those of returns have no effect.

        Raises:
            ValueError: If there is no model.
        """
        if model is not None:
            policy_kwargs = {**(policy_kwargs or {}), "n_looks": model.n_looks}
        elif kwargs.get("_init_setup_model", True):  # SB3's `load` sets up later, from what was saved
            raise ValueError(NO_MODEL)
        self.model = model
        self._known = Known(np.zeros((0, 0), np.float32), np.zeros((0, 0), np.bool_))
        self._looks: Ints = np.zeros(0, np.int64)
        self._begun = np.zeros(0, np.bool_)
        super().__init__(policy, env, n_told=1, policy_kwargs=policy_kwargs, **kwargs)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[npt.NDArray[Any], Any]:
        """Actions for observations, and what is known then; `state` is what was known before.

        Raises:
            ValueError: If there is no model: it is not saved, and has to be given again after `load`.
        """
        if self.model is None:
            raise ValueError(NO_MODEL)
        seen, is_batch = self.policy.obs_to_tensor(observation)
        states = self.model.states(seen[SENSES].cpu().numpy())  # type: ignore[index]
        known = self._following(state, episode_start, seen, states)
        places = functional.softmax(torch.as_tensor(known.evidence), dim=1).numpy()
        actions = np.einsum("nt,nta->na", places, self.model.is_best[states]).round(6).argmax(axis=1)
        if not deterministic:
            actions = self._explored(actions)
        return (actions if is_batch else actions[0]), known

    @torch.no_grad()
    def _following(self, state: Any, first: npt.NDArray[Any] | None, seen: Any, states: Ints) -> Known:
        """What is known with the frames that are seen from these poses, too."""
        n, (n_states, n_targets) = len(states), self.model.looks.shape
        known = Known(np.zeros((n, n_targets), np.float32), np.zeros((n, n_states), np.bool_))
        if state is not None:
            known = Known(*(part.copy() for part in state))
            if first is not None:
                for part in known:
                    part[np.asarray(first, np.bool_)] = 0
        chances = functional.log_softmax(self.policy.greedy_net(seen), dim=1)
        likelihoods = (chances - self.policy.counts.log()).cpu().numpy()
        of_places = np.take_along_axis(likelihoods, self.model.looks[states], axis=1)
        is_new = ~known.visited[np.arange(n), states]
        evidence = known.evidence + of_places * is_new[:, np.newaxis]
        known.visited[np.arange(n), states] = True
        return Known((evidence - evidence.max(axis=1, keepdims=True)).astype(np.float32), known.visited)

    def _setup_learn(self, *args: Any, **kwargs: Any) -> tuple[int, BaseCallback]:
        if self.model is None:
            raise ValueError(NO_MODEL)
        return super()._setup_learn(*args, **kwargs)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "model"]

    def _begin(self, infos: Infos) -> None:
        self._looks = self.model.look(infos)
        self._begun = np.ones(self.n_envs, np.bool_)

    def _go_on(self, actions: npt.NDArray[Any], dones: npt.NDArray[np.bool_], infos: Infos) -> None:
        met = np.bincount(self._looks, minlength=self.policy.n_looks)
        self.policy.counts += torch.as_tensor(met, device=self.policy.counts.device)
        self._looks, self._begun = self.model.look(infos), np.asarray(dones, np.bool_)

    def _told(self) -> Ints:
        return self._looks[:, np.newaxis]

    def _sample_action(
        self, learning_starts: int, action_noise: Any = None, n_envs: int = 1
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        known = None if self._begun.all() else self._known
        actions, self._known = self.predict(self._last_obs, known, self._begun)
        return actions, actions

    def _update(self, batch_size: int) -> float:
        observations, told = self.replay_buffer.advice(batch_size)
        loss = functional.cross_entropy(self.q_net(self._shifted(observations)), told[:, 0].long())
        return self._descended(loss)
