"""The convolutional trunk that every agent looks through: observations in, features out."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn
from torch.nn import functional

from usbench.agents.layers.norm_relu_pool import moments, norm_relu_pool
from usbench.agents.layers.pooling import relu_pool

# Names of the two parts of an observation with senses.
IMAGE, SENSES = "image", "senses"
CHANNELS = (16, 32)
PROJECTED = 64


@dataclass(frozen=True)
class ImageLayout:
    """How images of a space lie in memory, for trunks that take either layout."""

    channels_first: bool
    n_channels: int
    height: int
    width: int

    @classmethod
    def of(cls, space: spaces.Box, smallest: int) -> Self:
        """Return the layout of the space's images, whose channels are the smallest axis.

        Raises:
            ValueError: The space holds no images, their channels lie in the middle, or they have fewer than
                `smallest` x `smallest` pixels.
        """
        shape = space.shape
        if len(shape) != 3 or np.argmin(shape) == 1:
            raise ValueError(
                f"observations of shape {shape} are no images: allowed are (height, width, channels) and "
                "(channels, height, width), with fewer channels than rows and columns."
            )
        channels_first = bool(np.argmin(shape) == 0)
        n_channels, height, width = shape if channels_first else (shape[2], shape[0], shape[1])
        if min(height, width) < smallest:
            raise ValueError(
                f"images must have at least {smallest} x {smallest} pixels, not {height} x {width}."
            )
        return cls(channels_first, n_channels, height, width)

    def maps(self, observations: torch.Tensor) -> torch.Tensor:
        """Return a batch of images as `(n, channels, height, width)`, its channels last in memory.

        Float observations are in this layout already; with it a gradient step takes half the time.
        """
        images = observations if self.channels_first else observations.permute(0, 3, 1, 2)
        return images.contiguous(memory_format=torch.channels_last)


class ConvTrunk(BaseFeaturesExtractor):
    """Two blocks of [3x3 convolution -> batch norm -> ReLU -> 2x2 max-pool], 16 and 32 channels, flattened.

    In: `(n, height, width, channels)`, as the environments give float observations, or
    `(n, channels, height, width)`, as Stable-Baselines3 transposes uint8 images.
    Out: `(n, features_dim)`; images of 90 x 40 pixels give 32 * 22 * 10 = 7040 features.

    Source: Jarosik and Lewandowski (2019), section II-B.
    """

    def __init__(self, observation_space: spaces.Box, batch_statistics: bool = True) -> None:
        """Builds the trunk for images of `observation_space`, as `Block` says.

        Raises:
            ValueError: the space holds no images (see `ImageLayout`), or they have less than 4 x 4 pixels.
        """
        layout = ImageLayout.of(observation_space, smallest=4)
        super().__init__(observation_space, CHANNELS[-1] * (layout.height // 4) * (layout.width // 4))
        self.layout = layout
        self.blocks = nn.Sequential(
            Block(layout.n_channels, CHANNELS[0], batch_statistics), Block(*CHANNELS, batch_statistics)
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(n, features_dim)` of a batch of images."""
        features: torch.Tensor = self.blocks(self.layout.maps(observations))
        return features.flatten(1)


class ProjectedTrunk(ConvTrunk):
    """A `ConvTrunk` and a fully connected layer to 64 features, for an LSTM to go on from.

    An LSTM on the trunk itself is saturated from the start by thousands of positive inputs, and takes most of
    the time of a trial.
    """

    def __init__(self, observation_space: spaces.Box, batch_statistics: bool = True) -> None:
        """Builds the trunk and the layer."""
        super().__init__(observation_space, batch_statistics)
        self.projection = nn.Sequential(nn.Linear(self._features_dim, PROJECTED), nn.Tanh())
        self._features_dim = PROJECTED

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features `(n, 64)` of a batch of images."""
        features: torch.Tensor = self.projection(super().forward(observations))
        return features


class Block(nn.Sequential):
    """3x3 convolution -> batch norm -> ReLU -> 2x2 max-pool: halves height and width of `(n, n_in, h, w)`.

    While the agent acts, batch norm uses the running statistics. While the agent learns, batch norm uses
    those of the batch or, without `batch_statistics`, still the running ones, so that the loss sees the
    network that acted: PPO's ratio then begins at 1, TRPO's divergence at 0, and a Q-network and its target
    network are normalised alike. The first batch after each `train()` then moves the running statistics for
    the time after the update; the update itself keeps the statistics with which it began.
    """

    def __init__(self, n_in: int, n_out: int, batch_statistics: bool = True) -> None:
        """Builds the layers; the convolution needs no bias, since batch norm takes away any constant."""
        convolution = nn.Conv2d(n_in, n_out, kernel_size=3, padding=1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(n_out), nn.ReLU(), nn.MaxPool2d(2))
        self.batch_statistics = batch_statistics
        self._held: tuple[torch.Tensor, torch.Tensor] | None = None
        self._kept: tuple[list[torch.Tensor], tuple[torch.Tensor, torch.Tensor]] | None = None

    def train(self, mode: bool = True) -> Self:
        """As in PyTorch; an update begins or ends here, so held statistics and kept weights are dropped."""
        self._held = self._kept = None
        return super().train(mode)

    def _apply(self, *args: Any, **kwargs: Any) -> Self:
        """As in PyTorch, which moves tensors here, or gives them another type: kept weights are dropped."""
        self._kept = None
        result: Self = super()._apply(*args, **kwargs)  # type: ignore[no-untyped-call]
        return result

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """The pooled maps: layer by layer, in one step, or with batch norm folded into the convolution."""
        convolution, norm, relu, pool = self
        assert isinstance(norm, nn.BatchNorm2d)
        result: torch.Tensor
        if not torch.is_grad_enabled():
            return self._folded(images, self._weights_to_act())
        self._kept = None  # a step may follow
        if not self.training:
            return self._folded(images, self._weights())
        if not self.batch_statistics:
            if self._held is None:
                self._held = _copy(norm)
                with torch.no_grad():
                    _move_statistics(norm, convolution(images))
            return self._folded(images, self._weights())
        if images.device.type == "cpu" and bool((norm.weight > 0).all()):
            return norm_relu_pool(convolution(images), norm)
        result = pool(relu(norm(convolution(images))))
        return result

    def _folded(self, images: torch.Tensor, weights: tuple[torch.Tensor, torch.Tensor]) -> torch.Tensor:
        """The pooled maps, where batch norm is part of the convolution's `weights`."""
        return relu_pool(functional.conv2d(images, *weights, padding=1))

    def _weights(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Weight and bias of the convolution that includes batch norm, by held or else running statistics."""
        convolution, norm, *_ = self
        assert isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
        mean, var = self._held or _copy(norm)
        scale = norm.weight * torch.rsqrt(var + norm.eps)
        return convolution.weight * scale[:, None, None, None], norm.bias - mean * scale

    def _weights_to_act(self) -> tuple[torch.Tensor, torch.Tensor]:
        """The same as `_weights`, kept from step to step until a value changes from which they follow.

        Values are compared, not versions of tensors: what writes through `.data`, as Stable-Baselines3 does
        in a target network, leaves no trace in a version.
        """
        convolution, norm, *_ = self
        assert isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
        assert norm.running_mean is not None and norm.running_var is not None
        sources = convolution.weight, norm.weight, norm.bias, norm.running_mean, norm.running_var
        if self._kept is None or not all(map(torch.equal, self._kept[0], sources)):
            self._kept = [tensor.clone() for tensor in sources], self._weights()
        return self._kept[1]


def _copy(norm: nn.BatchNorm2d) -> tuple[torch.Tensor, torch.Tensor]:
    """A copy of the running mean and variance."""
    assert norm.running_mean is not None and norm.running_var is not None
    return norm.running_mean.clone(), norm.running_var.clone()


def _move_statistics(norm: nn.BatchNorm2d, maps: torch.Tensor) -> None:
    """Moves the running statistics towards those of `maps`: by the momentum, and further at first."""
    assert norm.running_mean is not None and norm.running_var is not None
    assert norm.num_batches_tracked is not None and norm.momentum is not None
    mean, var = moments(maps)
    norm.num_batches_tracked.add_(1)
    share = max(norm.momentum, 1.0 / int(norm.num_batches_tracked))
    norm.running_mean.lerp_(mean, share)
    norm.running_var.lerp_(var, share)
