"""What norm_relu_pool gains: a gradient step of the paper's trunk with it, and with PyTorch's layers.

Both take turns in one thread, on the same images. CPU time is measured, since others may use the machine.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch
from gymnasium import spaces
from torch import nn

from usbench.agents.networks import ConvTrunk


def layers(trunk: ConvTrunk, images: torch.Tensor) -> torch.Tensor:
    """Return the features (n, features_dim) of `images`, computed layer by layer."""
    for block in trunk.blocks:
        images = nn.Sequential.forward(block, images)
    return images.flatten(1)


def milliseconds(features: Callable[[], torch.Tensor]) -> float:
    """Return the CPU time of a gradient step through `features`."""
    start = time.process_time()
    features().square().mean().backward()
    return 1e3 * (time.process_time() - start)


def main() -> None:
    """Print the medians and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=64, help="images of a gradient step (default 64)")
    parser.add_argument("--steps", type=int, default=100, help="gradient steps of both (default 100)")
    args = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(0)
    trunk = ConvTrunk(spaces.Box(-np.inf, np.inf, (90, 40, 4), np.float32)).train()
    images = torch.randn(args.images, 90, 40, 4)
    stacked = images.permute(0, 3, 1, 2)
    turns = [
        (milliseconds(lambda: trunk(images)), milliseconds(lambda: layers(trunk, stacked)))
        for _ in range(args.steps + 5)
    ]
    here, plain = (statistics.median(times) for times in zip(*turns[5:], strict=True))
    print(f"a gradient step of {args.images} images: {here:.1f} ms, with PyTorch's layers {plain:.1f} ms,")
    print(f"so {1 - here / plain:.0%} less")


if __name__ == "__main__":
    main()
