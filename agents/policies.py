"""Policies with two networks that share nothing: one for the actions, one for the values."""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import nn
from torch.optim import Optimizer

from usbench.agents.networks import ConvTrunk
from usbench.agents.sensing_trunk import SensingTrunk


class SeparatePolicy(ActorCriticPolicy):
    """SB3's actor-critic policy, with a features extractor each for actions and values.

    Attributes:
        values_at_end: whether whoever collects a rollout computes its values afterwards, in one batch;
            `forward` then leaves them out.
    """

    value_optimizer: Optimizer
    values_at_end = False

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments; `share_features_extractor` can only be False.

        Observations that are dictionaries have a `SensingTrunk` by default.

        Raises:
            ValueError: `share_features_extractor` is True.
        """
        if isinstance(observation_space, spaces.Dict):
            kwargs.setdefault("features_extractor_class", SensingTrunk)
        if kwargs.setdefault("share_features_extractor", False):
            raise ValueError(
                "share_features_extractor must be False: policy and value are separate networks here."
            )
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def forward(
        self, obs: torch.Tensor, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Actions `(n, ...)`, values `(n, 1)` (NaN with `values_at_end`), log-probabilities `(n,)`."""
        if not self.values_at_end:
            return super().forward(obs, deterministic)
        if isinstance(self.action_space, spaces.Discrete) and not deterministic:
            actions, log_prob = self._drawn(obs)
        else:
            distribution = self.get_distribution(obs)
            actions = distribution.get_actions(deterministic=deterministic)
            log_prob = distribution.log_prob(actions)
            actions = actions.reshape((-1, *self.action_space.shape))  # type: ignore[misc]
        return actions, log_prob.new_full((len(log_prob), 1), torch.nan), log_prob

    def _drawn(self, obs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Drawn actions `(n,)` and their log-probabilities `(n,)`.

        They have the bits of SB3's `CategoricalDistribution`, whose checks of itself take a fifteenth of the
        time of A2C and VPG. Values that are not finite fail here too.
        """
        features = BasePolicy.extract_features(self, obs, self.pi_features_extractor)
        logits = self.action_net(self.mlp_extractor.forward_actor(features))
        logits = logits - logits.logsumexp(-1, keepdim=True)
        actions = torch.multinomial(logits.softmax(-1), 1, replacement=True)
        return actions.squeeze(1), logits.gather(1, actions).squeeze(1)

    def value_parameters(self) -> list[nn.Parameter]:
        """The parameters that give the values."""
        networks = (self.vf_features_extractor, self.mlp_extractor.value_net, self.value_net)
        return [parameter for network in networks for parameter in network.parameters()]

    def policy_parameters(self) -> list[nn.Parameter]:
        """The parameters that give the actions: all that do not give the values."""
        of_value = set(self.value_parameters())
        return [parameter for parameter in self.parameters() if parameter not in of_value]


class ConvPolicy(SeparatePolicy):
    """Two trunks `ConvTrunk`, each with one fully connected output layer."""

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments; other trunks and hidden layers can be asked for."""
        kwargs.setdefault("features_extractor_class", ConvTrunk)
        kwargs.setdefault("net_arch", [])
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)
