"""A second trunk, to see whether a ranking is the network's: residual blocks and a global average."""

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from usbench.agents.networks import ImageLayout

CHANNELS = (16, 32, 32)


class ResidualTrunk(BaseFeaturesExtractor):
    """IMPALA's network, small: a strided convolution, three stages of one residual block, a global average.

    In: as `ConvTrunk`. Out: `(n, 32)`, whatever the size of the images.

    It differs from the original in three things: the first convolution has stride 2 and no max-pool, each
    stage has one residual block in place of two, and an average over all places stands for the flattened maps
    and the layer after them. There is no batch norm: acting and learning see the same network.

    Source: Espeholt et al., "IMPALA" (2018), Fig. 3, right.
    """

    def __init__(self, observation_space: spaces.Box) -> None:
        """Builds the trunk for images of `observation_space`.

        Raises:
            ValueError: the space holds no images (see `ImageLayout`), or they have less than 8 x 8 pixels.
        """
        layout = ImageLayout.of(observation_space, smallest=8)
        super().__init__(observation_space, CHANNELS[-1])
        self.layout = layout
        stages: list[nn.Module] = [
            convolution(layout.n_channels, CHANNELS[0], stride=2),
            Residual(CHANNELS[0]),
        ]
        for n_in, n_out in zip(CHANNELS, CHANNELS[1:], strict=False):
            stages += [convolution(n_in, n_out), nn.MaxPool2d(3, stride=2, padding=1), Residual(n_out)]
        self.stages = nn.Sequential(*stages, nn.ReLU())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(n, 32)` of a batch of images."""
        maps: torch.Tensor = self.stages(self.layout.maps(observations))
        return maps.mean(dim=(2, 3))


class Residual(nn.Module):
    """x + conv(ReLU(conv(ReLU(x)))), 3x3 each, on maps `(n, n_channels, height, width)`."""

    def __init__(self, n_channels: int) -> None:
        """Builds the two convolutions."""
        super().__init__()
        self.first, self.second = (convolution(n_channels, n_channels) for _ in range(2))

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """Maps of the same shape."""
        result: torch.Tensor = maps + self.second(torch.relu(self.first(torch.relu(maps))))
        return result


def convolution(n_in: int, n_out: int, stride: int = 1) -> nn.Conv2d:
    """A convolution of 3 x 3 pixels that keeps the size of maps, but for the stride."""
    return nn.Conv2d(n_in, n_out, kernel_size=3, stride=stride, padding=1)
