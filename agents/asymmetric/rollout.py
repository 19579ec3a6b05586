"""Rollouts that hold the full state of every step, and show steps in symmetric views."""

from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from stable_baselines3.common.buffers import RolloutBuffer

from usbench.agents.asymmetric.policy import AsymmetricPolicy, Known
from usbench.agents.asymmetric.truth import SIZE
from usbench.agents.on_policy import ValuesAtEndBuffer, ValuesAtEndDictBuffer
from usbench.agents.policies import SeparatePolicy
from usbench.agents.value_based.views import Views


class StateBuffer(ValuesAtEndBuffer):
    """A rollout whose samples are `Known`, and whose values are those of the states.

    With `symmetries`, each sample is seen in a random view, another one each time: its observation and its
    action are transformed alike. What belongs to them follows.

    * PPO divides by how probable the action was. In a view that is what the policy that acted says of the
      viewed action after the viewed observation; it is asked for every view when the rollout is complete, so
      that the ratio begins at 1 (Raileanu et al. 2021, Section 3).
    * Where the viewed action was less probable than the action that was drawn, PPO divides by the probability
      of that one. The ratio begins below 1 then, and the sample counts as much less as actions like it would
      have been drawn there: the importance weight of Espeholt et al. (2018, Section 4.1), cut off at 1. A
      policy may hold a viewed action for all but impossible. Divided by that, a ratio can grow without
      bound, and PPO's clipping stops it only where the advantage is positive.
    * Advantage and return are those of the step as it was, for a symmetry changes no reward and no
      transition. They are exact once the policy has the symmetries, which the views teach it. Until then the
      action in a view is not quite what the policy would have chosen there.
    * The state stays as it was, with the value that belongs to it: the policy sees no part of it.

    Sources: Raileanu et al., "Automatic data augmentation for generalization in reinforcement learning"
    (2021); Espeholt et al., "IMPALA: scalable distributed deep-RL with importance weighted actor-learner
    architectures" (2018).

    Attributes:
        states: The state at the beginning of each step, `(n_steps, n_envs, SIZE)`, flattened by `get`.
        views: The views in which samples are seen, None where all are seen as they were.
        log_probs_in_views: The log-probability of each step's action in each view, `(n_steps, n_envs,
            n_views)`, flattened as the states; in the first view the step is as it was.
    """

    states: npt.NDArray[np.float32]
    log_probs_in_views: npt.NDArray[np.float32]

    def __init__(self, *args: Any, symmetries: Any = None, **kwargs: Any) -> None:
        """Takes SB3's arguments; `symmetries` are those of the task, None for none."""
        self.views = None if symmetries is None else Views(symmetries)
        super().__init__(*args, **kwargs)
        if self.views is not None:
            self.views.to(self.device)

    def reset(self) -> None:
        """Forgets everything."""
        self.states = np.zeros((self.buffer_size, self.n_envs, SIZE), np.float32)
        super().reset()

    def add_step(self, states: npt.NDArray[np.float32], *step: Any) -> None:
        """Adds a step: states `(n_envs, SIZE)`, then what SB3's `add` takes."""
        self.states[self.pos] = states
        self.add(*step)

    def get(self, batch_size: int | None = None) -> Any:
        """As in SB3; the first call flattens steps and environments into one axis."""
        if not self.generator_ready:
            self.states = self.swap_and_flatten(self.states)
            if self.views is not None:
                self.log_probs_in_views = self.swap_and_flatten(self.log_probs_in_views)
        return super().get(batch_size)

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: npt.NDArray[Any]) -> None:
        """As in SB3; with views, the policy that acted is also asked for its log-probabilities there."""
        super().compute_returns_and_advantage(last_values, dones)
        if self.views is not None:
            assert isinstance(self.policy, AsymmetricPolicy)
            others = range(1, len(self.views.mirrored))
            in_views = [self._log_probs(self.policy, self.views, number) for number in others]
            self.log_probs_in_views = np.stack([self.log_probs, *in_views], axis=-1)

    def _values(self, policy: SeparatePolicy) -> npt.NDArray[np.float32]:
        assert isinstance(policy, AsymmetricPolicy)
        with torch.no_grad():
            return policy.values(self.to_torch(self.states.reshape(-1, SIZE))).cpu().numpy()

    @torch.no_grad()
    def _log_probs(self, policy: AsymmetricPolicy, views: Views, number: int) -> npt.NDArray[np.float32]:
        """The log-probabilities `(n_steps, n_envs)` of all actions in the view `number`."""
        found = []
        for part, seen in self._parts():
            actions = self._part(self.actions, part).long()
            numbers = torch.full((len(actions),), number, device=self.device)
            distribution = policy.get_distribution(views.observations(seen, numbers))
            found.append(distribution.log_prob(views.actions_in(actions, numbers).flatten()))
        log_probs: npt.NDArray[np.float32] = torch.cat(found).cpu().numpy()
        return log_probs.reshape(self.log_probs.shape)

    def _get_samples(self, batch_inds: npt.NDArray[np.intp], env: Any = None) -> Any:
        samples: Any = super()._get_samples(batch_inds, env)
        if self.views is not None:
            samples = self._viewed(samples, batch_inds, self.views)
        states = self.to_torch(self.states[batch_inds])
        return samples._replace(observations=Known(samples.observations, states))

    def _viewed(self, samples: Any, batch_inds: npt.NDArray[np.intp], views: Views) -> Any:
        """The samples, each in a random view."""
        numbers = views.drawn(len(batch_inds))
        log_probs = self.to_torch(self.log_probs_in_views[batch_inds]).gather(1, numbers[:, None])
        return samples._replace(
            observations=views.observations(samples.observations, numbers),
            actions=views.actions_in(samples.actions.long(), numbers),
            old_log_prob=torch.maximum(log_probs.flatten(), samples.old_log_prob),
        )


class StateDictBuffer(StateBuffer, ValuesAtEndDictBuffer):
    """The same for observations that are dictionaries."""


def buffer_class(is_dict: bool) -> type[RolloutBuffer]:
    """The class for observations that are dictionaries, or not."""
    return StateDictBuffer if is_dict else StateBuffer
