"""Max-pooling (2x2) with or without ReLU as compiled loops: the bits of PyTorch in less time.

The maps of a first convolution take 30 MB for 128 frames, so that pooling spends its time on memory. PyTorch
reads them, writes 8 bytes per pooled pixel that say where it came from, goes over the pooled maps again for
ReLU, and on the way back fills the maps' gradient with zeros before it writes to a few places. Here one pass
does it in each direction, and a byte says where a pixel came from.

Gradients have derivatives again, since pooling by known places is linear.
"""

from typing import Any

import numba
import torch
from torch.nn import functional

Tensor = torch.Tensor
NOWHERE = 4  # in place of a corner (0 to 3, row by row): ReLU stopped the pixel


def relu_pool(maps: Tensor) -> Tensor:
    """Max-pool (2x2) of ReLU of maps: `(n, c, height, width)` to `(n, c, height // 2, width // 2)`."""
    is_last = maps.is_contiguous(memory_format=torch.channels_last)
    if maps.device.type != "cpu" or not (is_last or maps.requires_grad):
        # Pooling first: the same result, with a quarter of the pixels left for ReLU.
        return torch.relu(functional.max_pool2d(maps, 2))
    pooled: Tensor = _ReluPool.apply(maps)
    return pooled


def pool(maps: Tensor, relu: bool = False) -> tuple[Tensor, Tensor]:
    """The pooled maps `(n, c, height // 2, width // 2)` and the places that they came from, without gradient.

    Of equal pixels the first is taken, row by row, and not-a-number before all, as PyTorch does.
    """
    n, c, height, width = maps.shape
    pooled = _like(maps, (n, c, height // 2, width // 2))
    places = _like(maps, pooled.shape, torch.uint8)
    _pool(_array(maps), relu, _array(pooled), _array(places))
    return pooled, places


def spread(pooled: Tensor, places: Tensor, shape: torch.Size) -> Tensor:
    """Maps `(n, c, height, width)` of zeros, with the pixels of `pooled` at the `places` they came from."""
    maps = _like(pooled, shape)
    _spread(_array(pooled), _array(places), _array(maps))
    return maps


def spread_on(pooled: Tensor, places: Tensor, maps: Tensor, slope: Tensor, offset: Tensor) -> Tensor:
    """The same, plus `offset - slope * maps`, where both have a number for each channel, `(c,)`."""
    result = _like(maps, maps.shape)
    _spread_on(_array(pooled), _array(places), _array(maps), slope.numpy(), offset.numpy(), _array(result))
    return result


class _ReluPool(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, maps: Tensor) -> Tensor:
        pooled, places = pool(maps, relu=True)
        ctx.save_for_backward(places)
        ctx.shape = maps.shape
        return pooled

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        return _Spread.apply(gradient, *ctx.saved_tensors, ctx.shape)


class _Spread(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, pooled: Tensor, places: Tensor, shape: torch.Size) -> Tensor:
        ctx.save_for_backward(places)
        return spread(pooled, places, shape)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        return _Gather.apply(gradient, *ctx.saved_tensors), None, None


class _Gather(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, maps: Tensor, places: Tensor) -> Tensor:
        ctx.save_for_backward(places)
        ctx.shape = maps.shape
        pooled = _like(maps, places.shape)
        _gather(_array(maps), _array(places), _array(pooled))
        return pooled

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        return _Spread.apply(gradient, *ctx.saved_tensors, ctx.shape), None


def _like(tensor: Tensor, shape: torch.Size | tuple[int, ...], dtype: torch.dtype | None = None) -> Tensor:
    """A new tensor with channels last in memory, and no particular values."""
    kind = dtype or tensor.dtype
    return torch.empty(shape, dtype=kind, device=tensor.device, memory_format=torch.channels_last)


def _array(maps: Tensor) -> Any:
    """The same numbers as an array `(n, height, width, c)`."""
    last = maps.detach().contiguous(memory_format=torch.channels_last)
    return last.permute(0, 2, 3, 1).numpy()


@numba.njit(nogil=True, error_model="numpy", cache=True)
def _pool(maps, relu, pooled, places):
    zero = pooled.dtype.type(0)
    for i in range(pooled.shape[0]):
        for y in range(pooled.shape[1]):
            for x in range(pooled.shape[2]):
                a, b = maps[i, 2 * y, 2 * x], maps[i, 2 * y, 2 * x + 1]
                c, d = maps[i, 2 * y + 1, 2 * x], maps[i, 2 * y + 1, 2 * x + 1]
                to, at = pooled[i, y, x], places[i, y, x]
                for k in range(pooled.shape[3]):
                    largest, place = a[k], 0
                    is_next = b[k] > largest or b[k] != b[k]
                    largest, place = (b[k], 1) if is_next else (largest, place)
                    is_next = c[k] > largest or c[k] != c[k]
                    largest, place = (c[k], 2) if is_next else (largest, place)
                    is_next = d[k] > largest or d[k] != d[k]
                    largest, place = (d[k], 3) if is_next else (largest, place)
                    stopped = relu and largest <= zero
                    to[k], at[k] = (zero, NOWHERE) if stopped else (largest, place)


# Loops over one array each, which become vectors.
@numba.njit(nogil=True, error_model="numpy", cache=True)
def _spread(pooled, places, maps):
    zero, height, width = maps.dtype.type(0), pooled.shape[1], pooled.shape[2]
    for i in range(pooled.shape[0]):
        for y in range(height):
            for x in range(width):
                value, at = pooled[i, y, x], places[i, y, x]
                for corner in range(4):
                    to = maps[i, 2 * y + corner // 2, 2 * x + corner % 2]
                    for k in range(to.shape[0]):
                        to[k] = value[k] if at[k] == corner else zero
        maps[i, 2 * height :] = zero
        maps[i, :, 2 * width :] = zero


# Products and sums are rounded once, as PyTorch's addcmul does.
@numba.njit(nogil=True, error_model="numpy", cache=True, fastmath={"contract"})
def _spread_on(pooled, places, maps, slope, offset, result):
    zero, height, width = maps.dtype.type(0), pooled.shape[1], pooled.shape[2]
    for i in range(pooled.shape[0]):
        for y in range(height):
            for x in range(width):
                value, at = pooled[i, y, x], places[i, y, x]
                for corner in range(4):
                    row, column = 2 * y + corner // 2, 2 * x + corner % 2
                    to, of = result[i, row, column], maps[i, row, column]
                    for k in range(to.shape[0]):
                        here = value[k] if at[k] == corner else zero
                        to[k] = (here - of[k] * slope[k]) + offset[k]
        for row in range(maps.shape[1]):
            for column in range(0 if row >= 2 * height else 2 * width, maps.shape[2]):
                for k in range(maps.shape[3]):
                    result[i, row, column, k] = (zero - maps[i, row, column, k] * slope[k]) + offset[k]


@numba.njit(nogil=True, error_model="numpy", cache=True)
def _gather(maps, places, pooled):
    zero = pooled.dtype.type(0)
    for i in range(pooled.shape[0]):
        for y in range(pooled.shape[1]):
            for x in range(pooled.shape[2]):
                for k in range(pooled.shape[3]):
                    at = places[i, y, x, k]
                    known = maps[i, 2 * y + at // 2, 2 * x + at % 2, k] if at < NOWHERE else zero
                    pooled[i, y, x, k] = known
