"""Pulse-echo response of a point to one line, tabulated over its lateral offset and depth per focal depth.

The responses of `two_way.py` are so smooth that waveforms on a coarse grid (`waveforms.py`) give them
everywhere. In a cell of the grid the phase advances almost linearly (the beam's local direction): the table
keeps that advance, and waveforms are turned by it, interpolated between two columns, and taken from the
nearest depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import chain

import numba
import numpy as np
import numpy.typing as npt

from usbench.envs.cache.table_files import on_disk
from usbench.envs.field.aperture import Floats, Spectra, aperture
from usbench.envs.field.receive import Receiving
from usbench.envs.field.summation import SAMPLES
from usbench.envs.field.two_way import orders_of
from usbench.envs.field.waveforms import ROWS, Rows, tabulate
from usbench.envs.probe import LinearArray
from usbench.envs.threads import divided, in_parallel
from usbench.waiting import Waiting
from usbench.words import in_words

BLOCK = SAMPLES  # waveforms are whole vectors long
_PULSE_CUT = 3e-3
_FAR = 1 << 20  # samples, where no waveform is


@dataclass(frozen=True)
class ResponseTable:
    """Waveforms of all orders on a grid of lateral offsets u = 0, step, ... and depths z (n_depths,), in m.

    The response of a line at the offset d is the sum over the orders q of their responses times
    exp(-2 pi j q d / pitch). A part is one order in one cell of the grid, between four waveforms.

    Attributes:
        depths: (n_depths,) m, increasing.
        u_step: m.
        waveforms: One after the other, (n,) complex64.
        cells: (n_depths - 1, n_u - 1, 4) int32: first part, number of parts, first sample relative to the
            geometric delay and number of samples of all parts together.
        farther: (n_depths - 1, n_u - 1) float32: by how many m the elements that hear a point in the cell are
            farther from it than the line is.
        parts: (n_parts, 7) int32: indices in `waveforms` of the four waveforms' samples at the geometric
            delay (at u, z; next u; next z; both), first sample and number of samples, order.
        waves: (n_parts, 6) float32: turns by which the phase advances over the cell along u and z, their
            cosines and their sines.
    """

    depths: Floats
    u_step: float
    waveforms: npt.NDArray[np.complex64]
    cells: npt.NDArray[np.int32]
    farther: npt.NDArray[np.float32]
    parts: npt.NDArray[np.int32]
    waves: npt.NDArray[np.float32]

    @cached_property
    def span(self) -> tuple[int, int]:
        """First and last sample over all parts."""
        _, n_parts, first, n_samples = np.moveaxis(self.cells, 2, 0)
        heard = n_parts > 0
        return int(first[heard].min()), int((first + n_samples)[heard].max())


def response_table(
    array: LinearArray,
    focal_depth: float,
    u_max: float,
    z_max: float,
    attenuation: float = 0.0,
) -> ResponseTable:
    """Tabulate the response for 0 <= u <= u_max and depths up to z_max (m), or take it from memory or disk.

    Args:
        array: The transducer.
        focal_depth: m.
        u_max: Largest lateral offset of a point from the line, m.
        z_max: Largest depth, m.
        attenuation: Of the tissue, Np / (m Hz).
    """
    return _tables(array, focal_depth, u_max, z_max, attenuation)


def keep_tables(n_depths: int) -> None:
    """Let this process keep the tables of `n_depths` focal depths, some 10 to 60 MB each (18: 315 MB).

    Four are kept anyway, enough where all frames of one depth are made together. A table takes a second or
    more to make: a probe that refocuses between more depths would wait for one at nearly every step.
    """
    global _tables
    if n_depths > _tables.cache_parameters()["maxsize"]:
        _tables = lru_cache(maxsize=n_depths)(_tabulated)


def forget_tables() -> None:
    """Let go of all tables that are kept."""
    _tables.cache_clear()


def _tabulated(
    array: LinearArray, focal_depth: float, u_max: float, z_max: float, attenuation: float
) -> ResponseTable:
    scene = (
        f"responses, focal depth {focal_depth!r} m, lateral offsets to {u_max!r} m, depths to {z_max!r} m, "
        f"attenuation {attenuation!r} Np/(m Hz), {in_words(array)}"
    )
    return on_disk(array, ResponseTable, scene, lambda: _made(array, focal_depth, u_max, z_max, attenuation))


def _made(
    array: LinearArray, focal_depth: float, u_max: float, z_max: float, attenuation: float
) -> ResponseTable:
    depths = depth_grid(focal_depth, z_max)
    depths = np.append(depths, 2 * depths[-1] - depths[-2])
    frequencies, n_samples = _band(array)
    # Between elements the path changes by at most twice the pitch: so many wavelengths, so many lobes.
    highest = max(1, round(2 * array.pitch / array.wavelength))
    oversampling = max(2 * highest + 1, int(np.ceil(4.4 * array.pitch / array.wavelength)))
    # Like the beam's width at the focus, which of waves shorter than 0.15 mm is less.
    step = float(np.clip(focal_depth / 150, 0.1e-3, 0.2e-3)) * min(1.0, array.wavelength / 0.15e-3)
    stride = max(1, round(step * oversampling / array.pitch))
    lobes = tuple(range(-highest, highest + 1))
    beam = aperture(
        array, focal_depth, frequencies, u_max, float(depths[-1]), oversampling, stride, lobes, attenuation
    )
    receive = Receiving(beam, focal_depth, oversampling) if array.receives_apart else beam
    n_blocks = math.ceil((len(depths) - 1) / ROWS)
    shares = [depths[ROWS * part.start : ROWS * part.stop + 1] for part in divided(n_blocks)]
    what = (
        f"Making the table of a probe's responses at {1e-6 * array.center_frequency:g} MHz for the focal "
        f"depth {1e3 * focal_depth:g} mm"
    )
    waiting = Waiting(what, n_blocks, len(shares))
    parts = in_parallel(lambda share: tabulate(beam, receive, share, n_samples, waiting), shares)
    rows = chain.from_iterable(parts)
    return _joined(orders_of(beam), depths[:-1], float(beam.u[1]), list(rows))


_tables = lru_cache(maxsize=4)(_tabulated)


def depth_grid(focal_depth: float, z_max: float) -> Floats:
    """Return depths from 0.5 mm to beyond `z_max`, dense at the focus, (n_depths,) m."""
    least = float(np.clip(focal_depth / 100, 0.15e-3, 0.4e-3))
    depths = [0.5e-3]
    while depths[-1] <= z_max:
        step = float(np.clip(0.1 * abs(depths[-1] - focal_depth), least, 1e-3))
        depths.append(depths[-1] + min(step, max(depths[-1] / 25, 0.2e-3)))
    return np.array(depths)


def _band(array: LinearArray) -> tuple[Floats, int]:
    """Return the frequencies that the pulse has, (n_frequencies,) Hz, and the samples of a waveform.

    They are spaced for the longest response of the aperture: multiples of that spacing from the I/Q's middle.
    """
    rate = array.iq_sampling_frequency
    longest = 1.25 * array.n_active * array.pitch / array.speed_of_sound + 6.0 / array.center_frequency
    n = 16 * int(np.ceil(longest * rate / 16))  # quick to transform
    frequencies = array.iq_center_frequency + (np.arange(n) - n // 2) * (rate / n)
    spectrum = np.abs(array.pulse_spectrum(frequencies))
    heard = np.flatnonzero(spectrum > _PULSE_CUT * spectrum.max())
    return frequencies[heard[0] : heard[-1] + 1], n


def _joined(orders: list[int], depths: Floats, u_step: float, rows: list[Rows]) -> ResponseTable:
    """Put all depths together, every waveform with zeros where the cells around it reach further."""
    extents = np.concatenate([part.extents for part in rows], axis=1).astype(np.int64)
    start, length = extents[..., 0], extents[..., 1]
    heard = length > 0
    # A part's samples are those of its four waveforms, in whole blocks; a waveform's are those of its parts.
    low = _around(np.where(heard, start, _FAR), np.minimum, next_ones=True)
    high = _around(np.where(heard, start + length, -_FAR), np.maximum, next_ones=True)
    used = high > low
    # All begin and end at whole blocks: vectors across two lines of the processor's cache are slow to load,
    # and adding to what was only just stored would stall.
    low = np.where(used, low // BLOCK * BLOCK, low)
    high = np.where(used, -(-high // BLOCK) * BLOCK, high)
    first, last = _around(low, np.minimum), _around(high, np.maximum)
    padded = np.maximum(last - first, 0)
    origins = (np.cumsum(padded) - padded.ravel()).reshape(padded.shape) - first
    waveforms = _aligned_zeros(int(padded.sum()))
    ends = np.cumsum([part.extents.shape[1] for part in rows])
    places = np.split(origins + start, ends[:-1], axis=1)
    in_parallel(lambda k: _put(rows[k], places[k], waveforms), range(len(rows)))

    # Parts of the same cell lie together.
    i, j, q = np.nonzero(np.moveaxis(used[:, :-1, :-1], 0, 2))
    corners = [origins[q, i + down, j + right] for down in (0, 1) for right in (0, 1)]
    parts = np.stack([*corners, low[q, i, j], (high - low)[q, i, j], np.array(orders)[q]], axis=1)
    n_parts = used[:, :-1, :-1].sum(axis=0)
    first, last = low[:, :-1, :-1].min(axis=0), high[:, :-1, :-1].max(axis=0)
    samples = np.where(n_parts > 0, last - first, 0)
    before = (np.cumsum(n_parts) - n_parts.ravel()).reshape(n_parts.shape)
    cells = np.stack([before, n_parts, first, samples], axis=2).astype(np.int32)
    waves = np.concatenate([part.waves for part in rows], axis=1)
    farther = np.concatenate([part.farther for part in rows])
    return ResponseTable(
        depths, u_step, waveforms, cells, farther[:-1], parts.astype(np.int32), waves[q, i, j]
    )


def _aligned_zeros(n: int) -> npt.NDArray[np.complex64]:
    """Return `n` zeros at an address that is a multiple of a vector's size."""
    values = np.zeros(n + SAMPLES, dtype=np.complex64)
    first = -values.ctypes.data // values.itemsize % SAMPLES
    return values[first : first + n]


def _around(
    values: npt.NDArray[np.int64], reduce: np.ufunc, next_ones: bool = False
) -> npt.NDArray[np.int64]:
    """Reduce every value with the ones before it along the last two axes, or with the `next_ones`."""
    for axis in (1, 2):
        low, high = [slice(None)] * 3, [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        target, source = (low, high) if next_ones else (high, low)
        result = values.copy()
        result[tuple(target)] = reduce(values[tuple(target)], values[tuple(source)])
        values = result
    return values


def _put(part: Rows, places: npt.NDArray[np.int64], waveforms: Spectra) -> None:
    """Copy the waveforms of a few depths to their places, (n_q, n_depths, n_u), among all."""
    for kept, extents, to in zip(part.kept, part.extents, places, strict=True):
        _copy(kept, extents.reshape(-1, 2), to.ravel(), waveforms)


@numba.njit(nogil=True, cache=True)
def _copy(
    kept: Spectra, extents: npt.NDArray[np.int32], places: npt.NDArray[np.int64], waveforms: Spectra
) -> None:
    """Copy waveforms that lie one after the other, so long as `extents` says."""
    first = 0
    for k in range(len(places)):
        # Sample by sample: what Numba makes of slices takes 2 s longer to compile.
        for i in range(extents[k, 1]):
            waveforms[places[k] + i] = kept[first + i]
        first += extents[k, 1]
