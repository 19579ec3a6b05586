"""A small residual trunk that keeps where something is: images in, averages over a coarse grid out."""

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from usbench.agents.networks import ImageLayout
from usbench.agents.residual_trunk import convolution

CHANNELS = (16, 32, 48)
GROUPS = 4
# Rows (depth) and columns (lateral).
GRID = (3, 5)


class GridTrunk(BaseFeaturesExtractor):
    """Three stages of one residual block with group norm, and an average over each cell of a grid.

    In: as `ConvTrunk`. Out: `(n, 720)`, whatever the size of the images; with another grid, 48 per cell.

    An average over the whole image would forget on which side the object lies, which says where to move. The
    first convolution has stride 2 and a max-pool behind it: most work is done on a 16th of the pixels. Group
    norm knows no batch: acting and learning see the same network.

    Sources: Espeholt et al., "IMPALA" (2018), Fig. 3, right; Wu and He, "Group normalization" (2018).
    """

    def __init__(
        self, observation_space: spaces.Box, *, grid: tuple[int, int] = GRID, groups: int = GROUPS
    ) -> None:
        """Builds the trunk for images of `observation_space`, at least 8 x 8 pixels.

        Args:
            observation_space: Of the images.
            grid: Rows and columns of the grid.
            groups: Those of group norm, which divide 16, 32 and 48; 1 is layer norm, 0 is no norm.
        """
        layout = ImageLayout.of(observation_space, smallest=8)
        super().__init__(observation_space, CHANNELS[-1] * grid[0] * grid[1])
        self.layout = layout
        first, second, third = CHANNELS
        self.stages = nn.Sequential(
            convolution(layout.n_channels, first, stride=2),
            nn.MaxPool2d(3, stride=2, padding=1),
            NormalizedResidual(first, groups),
            convolution(first, second, stride=2),
            NormalizedResidual(second, groups),
            convolution(second, third),
            NormalizedResidual(third, groups),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(grid),
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(n, features_dim)` of a batch of images."""
        maps: torch.Tensor = self.stages(self.layout.maps(observations))
        return maps.flatten(1)


class NormalizedResidual(nn.Module):
    """x + conv(ReLU(norm(conv(ReLU(norm(x)))))), 3x3 each, on maps `(n, n_channels, height, width)`.

    Sources: He et al., "Identity mappings in deep residual networks" (2016), Fig. 4 e; Wu and He, "Group
    normalization" (2018), Section 3.1: with one group it is layer norm.
    """

    def __init__(self, n_channels: int, groups: int) -> None:
        """Builds two group norms, or none for 0 groups, and two convolutions."""
        super().__init__()
        layers: list[nn.Module] = []
        for _ in range(2):
            layers += [nn.GroupNorm(groups, n_channels)] if groups else []
            layers += [nn.ReLU(), convolution(n_channels, n_channels)]
        self.branch = nn.Sequential(*layers)

    def forward(self, maps: torch.Tensor) -> torch.Tensor:
        """Maps of the same shape."""
        result: torch.Tensor = maps + self.branch(maps)
        return result
