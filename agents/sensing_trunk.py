"""The trunk of agents that are told something beside the frames: image and senses in, features out."""

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from usbench.agents.networks import IMAGE, SENSES, ConvTrunk

JOINT = 256


class SensingTrunk(BaseFeaturesExtractor):
    """Features of the image beside the senses, and a fully connected layer with ReLU that mixes both.

    Without that layer a linear output could only add what a sense says to what the picture says, while which
    way to turn follows from both together.

    In: a dictionary of `image`, as the `trunk` takes it, and `senses` `(n, size)`.
    Out: `(n, 256)`.
    """

    def __init__(
        self, observation_space: spaces.Dict, trunk: type[BaseFeaturesExtractor] = ConvTrunk, **kwargs: Any
    ) -> None:
        """Builds the `trunk` for the space's images, with `kwargs`, and the layer.

        Raises:
            ValueError: the space has other parts than an image and senses.
        """
        if set(observation_space.spaces) != {IMAGE, SENSES}:
            raise ValueError(
                f"observations must have the parts {IMAGE!r} and {SENSES!r}, "
                f"not {', '.join(map(repr, observation_space.spaces))}."
            )
        super().__init__(observation_space, JOINT)
        self.trunk = trunk(observation_space[IMAGE], **kwargs)
        n_senses = spaces.flatdim(observation_space[SENSES])
        self.joint = nn.Sequential(nn.Linear(self.trunk.features_dim + n_senses, JOINT), nn.ReLU())

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Features `(n, 256)` of a batch of observations."""
        both = torch.cat([self.trunk(observations[IMAGE]), observations[SENSES].flatten(1)], dim=1)
        features: torch.Tensor = self.joint(both)
        return features
