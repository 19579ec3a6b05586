"""The convolutional trunk that every agent looks through: observations in, features out."""

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from usbench.agents.fused import norm_relu_pool

CHANNELS = (16, 32)


def channels_first(space: spaces.Box) -> bool:
    """Whether images of this space have their channels, the smallest axis, in front.

    Raises:
        ValueError: the space holds no images, or their channels lie in the middle.
    """
    if len(space.shape) != 3 or np.argmin(space.shape) == 1:
        raise ValueError(
            f"observations of shape {space.shape} are no images: allowed are (height, width, channels) and "
            "(channels, height, width), with fewer channels than rows and columns."
        )
    return bool(np.argmin(space.shape) == 0)


class ConvTrunk(BaseFeaturesExtractor):
    """Two blocks of [3x3 convolution -> batch norm -> ReLU -> 2x2 max-pool], 16 and 32 channels, flattened.

    In: `(n, height, width, channels)`, as the environments give float observations, or
    `(n, channels, height, width)`, as Stable-Baselines3 transposes uint8 images.
    Out: `(n, features_dim)`; images of 90 x 40 pixels give 32 * 22 * 10 = 7040 features.

    Source: Jarosik and Lewandowski (2019), section II-B.
    """

    def __init__(self, observation_space: spaces.Box) -> None:
        """Builds the trunk for images of `observation_space`, at least 4 x 4 pixels."""
        self._channels_first = channels_first(observation_space)
        shape = observation_space.shape
        n_channels, height, width = shape if self._channels_first else (shape[2], shape[0], shape[1])
        if min(height, width) < 4:
            raise ValueError(f"images must have at least 4 x 4 pixels, not {height} x {width}.")
        super().__init__(observation_space, CHANNELS[-1] * (height // 4) * (width // 4))
        self.blocks = nn.Sequential(Block(n_channels, CHANNELS[0]), Block(*CHANNELS))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(n, features_dim)` of a batch of images."""
        images = observations if self._channels_first else observations.permute(0, 3, 1, 2)
        # Float observations are in this layout already; with it a gradient step takes half the time.
        features: torch.Tensor = self.blocks(images.contiguous(memory_format=torch.channels_last))
        return features.flatten(1)


class Block(nn.Sequential):
    """3x3 convolution -> batch norm -> ReLU -> 2x2 max-pool: halves height and width of `(n, n_in, h, w)`."""

    def __init__(self, n_in: int, n_out: int) -> None:
        """Builds the layers; the convolution needs no bias, since batch norm takes away any constant."""
        convolution = nn.Conv2d(n_in, n_out, kernel_size=3, padding=1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(n_out), nn.ReLU(), nn.MaxPool2d(2))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """The layers one after the other; in a training step the last three in one."""
        convolution, norm, relu, pool = self
        assert isinstance(norm, nn.BatchNorm2d)
        if self.training and torch.is_grad_enabled() and bool((norm.weight > 0).all()):
            return norm_relu_pool(convolution(images), norm)
        result: torch.Tensor = pool(relu(norm(convolution(images))))
        return result
