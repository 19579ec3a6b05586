"""The second network: its shape, its source's formula, and every algorithm learns with it."""

import numpy as np
import pytest
import torch
from gymnasium import spaces
from torch.nn import functional

from usbench.agents import zoo
from usbench.agents.residual_trunk import Residual, ResidualTrunk
from usbench.trials import runner
from usbench.trials.configuration import resolve
from usbench.trials.model_loading import load_agent


def trunk(height=90, width=40, channels=4):
    return ResidualTrunk(spaces.Box(0, 1, (height, width, channels), np.float32))


@pytest.mark.parametrize("size", [(90, 40), (45, 31), (8, 8)])
def test_features_are_32_whatever_the_size(size):
    assert trunk(*size)(torch.zeros(3, *size, 4)).shape == (3, 32)


def test_both_layouts_of_images_give_the_same_features():
    one = trunk()
    other = ResidualTrunk(spaces.Box(0, 1, (4, 90, 40), np.float32))
    other.load_state_dict(one.state_dict())
    images = torch.rand(2, 90, 40, 4)
    torch.testing.assert_close(one(images), other(images.permute(0, 3, 1, 2)))


def test_block_is_the_identity_and_two_convolutions():
    block, maps = Residual(8), torch.randn(2, 8, 9, 5)
    inner = functional.conv2d(maps.clamp(min=0), block.first.weight, block.first.bias, padding=1)
    expected = maps + functional.conv2d(inner.clamp(min=0), block.second.weight, block.second.bias, padding=1)
    torch.testing.assert_close(block(maps), expected)
    torch.nn.init.zeros_(block.second.weight)
    torch.nn.init.zeros_(block.second.bias)
    torch.testing.assert_close(block(maps), maps)


def test_images_that_are_too_small_are_refused():
    with pytest.raises(ValueError, match="at least 8 x 8 pixels, not 90 x 6"):
        trunk(90, 6)


@pytest.mark.parametrize("algo", [name for name, row in zoo.ZOO.items() if row.learns and not row.needs])
def test_every_algorithm_learns_with_it(quick, tmp_path, algo):
    name = f"{algo}+residual"
    config = resolve(name, "pp", steps=64)
    assert config.hyperparameters == resolve(algo, "pp", steps=64).hyperparameters
    folder = runner.run_trial(config, tmp_path).folder
    networks = load_agent(folder).agent.policy.modules()
    assert any(isinstance(network, ResidualTrunk) for network in networks)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("ppo+resdual", "unknown network 'resdual' .did you mean 'residual'"),
        ("pop+residual", "unknown algorithm 'pop' .did you mean 'ppo'"),
        ("oracle+residual", "oracle has no network"),
        ("ppo+residual+residual", "unknown network 'residual.residual'"),
    ],
)
def test_unknown_networks_are_refused(name, said):
    with pytest.raises(ValueError, match=said):
        zoo.entry(name)
