"""A policy that sees observations, beside a critic that sees states."""

from typing import Any, NamedTuple

import torch
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

from usbench.agents.asymmetric.truth import SIZE
from usbench.agents.policies import SeparatePolicy

HIDDEN = (64, 64)


class Known(NamedTuple):
    """What is known of a step while the agent learns.

    Attributes:
        observations: What the policy sees, a batch of arrays or dictionaries.
        states: The full states, (n, SIZE), for the critic alone.
    """

    observations: Any
    states: torch.Tensor


class AsymmetricPolicy(SeparatePolicy):
    """SB3's actor-critic policy, whose values follow from the full state and from nothing else.

    Acting, `predict` and what is saved for it need observations alone. Source: Pinto et al., "Asymmetric
    actor critic for image-based robot learning" (2017), Section III.
    """

    values_at_end = True

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)
        # In place of a trunk and an output for values of observations.
        self.vf_features_extractor = nn.Identity()  # type: ignore[assignment]
        self.value_net = nn.Sequential(*create_mlp(SIZE, 1, list(HIDDEN), nn.Tanh))  # type: ignore[assignment]
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]

    def values(self, states: torch.Tensor) -> torch.Tensor:
        """The values `(n, 1)` of states `(n, SIZE)`."""
        values: torch.Tensor = self.value_net(states)
        return values

    def predict_values(self, obs: Any) -> torch.Tensor:
        """The values `(n, 1)` of what is `Known`.

        Raises:
            TypeError: there are observations alone, from which no value follows.
        """
        if not isinstance(obs, Known):
            raise TypeError(f"values follow from states, not from observations alone ({type(obs).__name__}).")
        return self.values(obs.states)

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values `(n, 1)`, log-probabilities `(n,)` and entropies `(n,)` of actions in what is `Known`."""
        distribution = self.get_distribution(obs.observations)
        return self.predict_values(obs), distribution.log_prob(actions), distribution.entropy()
