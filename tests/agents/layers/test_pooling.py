"""Compiled max-pooling against PyTorch's: the same bits there and back, whatever the pixels are."""

import pytest
import torch
from torch.nn import functional

from usbench.agents.layers import pooling

SIZES = [(90, 40), (45, 20), (5, 7), (2, 2)]


def maps_of(size: tuple[int, int], values: str) -> torch.Tensor:
    """Maps with channels last, in which every pixel differs, many are equal, or some are not a number."""
    torch.manual_seed(0)
    maps = torch.randn(3, 16, *size)
    if values == "equal":
        maps = maps.round()  # -1, 0, 0.0 and -0.0 among them
    if values == "not numbers":
        maps[torch.rand(maps.shape) < 0.1] = torch.nan
    return maps.contiguous(memory_format=torch.channels_last).requires_grad_()


def same(found: torch.Tensor | None, expected: torch.Tensor | None) -> bool:
    """Whether both have the same numbers, bit by bit but for the sign of zero."""
    assert found is not None and expected is not None
    return torch.equal(found.nan_to_num(1e9), expected.nan_to_num(1e9))


@pytest.mark.parametrize("values", ["different", "equal", "not numbers"])
@pytest.mark.parametrize("size", SIZES)
def test_relu_pool_and_its_gradient_are_pytorchs(size: tuple[int, int], values: str) -> None:
    here, there = maps_of(size, values), maps_of(size, values)
    found, expected = pooling.relu_pool(here), torch.relu(functional.max_pool2d(there, 2))
    assert "ReluPool" in type(found.grad_fn).__name__
    assert same(found, expected)
    towards = torch.randn_like(expected)
    found.backward(towards)
    expected.backward(towards)
    assert same(here.grad, there.grad)


@pytest.mark.parametrize("size", SIZES)
def test_a_penalty_on_the_gradient_has_pytorchs_gradient(size: tuple[int, int]) -> None:
    gradients = []
    for relu_pool in (pooling.relu_pool, lambda maps: torch.relu(functional.max_pool2d(maps, 2))):
        maps = maps_of(size, "different")
        (first,) = torch.autograd.grad(relu_pool(maps.square()).sum(), maps, create_graph=True)
        gradients.append(torch.autograd.grad(first.pow(3).sum(), maps)[0])
    torch.testing.assert_close(*gradients)


@pytest.mark.parametrize("size", SIZES)
def test_spread_on_adds_a_line_per_channel_to_what_is_spread(size: tuple[int, int]) -> None:
    maps = maps_of(size, "different").detach()
    pooled, places = pooling.pool(maps)
    slope, offset = torch.randn(2, 16)
    found = pooling.spread_on(pooled, places, maps, slope, offset)
    spread = pooling.spread(pooled, places, maps.shape)
    # Every pixel that was the largest of its four has come back.
    assert torch.equal(spread[spread != 0], maps[spread != 0])
    assert (spread != 0).sum() == pooled.numel()
    torch.testing.assert_close(found, spread + offset[:, None, None] - slope[:, None, None] * maps)


def test_other_layouts_give_the_same() -> None:
    maps = maps_of((9, 8), "different")
    pooled = pooling.relu_pool(maps)
    first = maps.detach().contiguous().requires_grad_()
    assert torch.equal(pooling.relu_pool(first), pooled)
    with torch.no_grad():
        assert torch.equal(pooling.relu_pool(first), pooled)
