"""Policies with two networks that share nothing: one for the actions, one for the values."""

from typing import Any

from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import nn
from torch.optim import Optimizer

from usbench.agents.networks import ConvTrunk


class SeparatePolicy(ActorCriticPolicy):
    """SB3's actor-critic policy, with a features extractor each for actions and values."""

    value_optimizer: Optimizer

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        **kwargs: Any,
    ) -> None:
        """Takes SB3's arguments; `share_features_extractor` can only be False."""
        if kwargs.setdefault("share_features_extractor", False):
            raise ValueError(
                "share_features_extractor must be False: policy and value are separate networks here."
            )
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    def value_parameters(self) -> list[nn.Parameter]:
        """The parameters that give the values."""
        networks = (self.vf_features_extractor, self.mlp_extractor.value_net, self.value_net)
        return [parameter for network in networks for parameter in network.parameters()]

    def policy_parameters(self) -> list[nn.Parameter]:
        """The parameters that give the actions: all that do not give the values."""
        of_value = set(self.value_parameters())
        return [parameter for parameter in self.parameters() if parameter not in of_value]


class ConvPolicy(SeparatePolicy):
    """Two `ConvTrunk`s, each with one fully connected output layer."""

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
