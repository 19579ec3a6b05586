"""Pulse-echo response of a point to one line, tabulated over its lateral offset and depth per focal depth.

Transmit and receive share the aperture, so the two-way response is the one-way response squared. Once the
geometric delay 2 hypot(u, z) / c is taken out it is smooth in (u, z) and short in time: a table of I/Q
waveforms on a coarse grid gives it everywhere. Three things keep the grid coarse and the waveforms few:

* within a cell the phase advances almost linearly (the beam's local direction): the table keeps the advance
  per cell, and the waveforms are interpolated around it;
* lines do not lie on elements' centres. The offset d changes the beam's grating lobes only, by the phase
  4 pi m d / pitch for the lobe of order m (element sampling by Poisson's formula): the table keeps the order;
* waveforms are cut where they have no energy, and points that a line does not hear have none.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.aperture import LANES, Floats, fill_responses
from usbench.envs.elevation import elevation_factor
from usbench.envs.probe import LinearArray
from usbench.envs.threads import n_threads
from usbench.envs.vector import LANES as VECTOR_LANES

BLOCK = VECTOR_LANES  # waveforms start and end at multiples of it
_ENERGY_CUT = 3e-3
_DEPTH_CUT = 3e-5
_OVERLAP = 0.82  # wavelengths of path between elements
_N_CLASSES = 12
_PROBE_STEP = 0.02e-3  # m, over which the phase is followed in u, z and offset
_DISTANCE_STEP = 0.05e-3


@dataclass(frozen=True)
class ResponseTable:
    """Waveforms on a grid of lateral offsets u = 0, step, ... and depths z (n_depths,), all in m.

    Attributes:
        depths: (n_depths,) m, increasing.
        u_step: m.
        real: Real parts of all waveforms, one after the other, (n,).
        imag: Imaginary parts, (n,).
        nodes: (n_depths, n_u, 4) int32: first index in `real`, first sample relative to the geometric delay,
            number of samples, order of the grating lobe.
        span: First and last sample over all waveforms.
        cells: (n_depths, n_u, 7) float32: turns by which the phase advances over the cell along u and z,
            the cosines and the sines of both, and by how many m the elements that hear the point are farther
            from it than the line is.
    """

    depths: npt.NDArray[np.float64]
    u_step: float
    real: Floats
    imag: Floats
    nodes: npt.NDArray[np.int32]
    cells: Floats
    span: tuple[int, int]


@lru_cache(maxsize=16)
def response_table(
    array: LinearArray, focal_depth: float, u_max: float, z_max: float, offset: float = 0.0
) -> ResponseTable:
    """Tabulate the response for 0 <= u <= u_max and depths up to z_max (m).

    Args:
        array: The transducer.
        focal_depth: m.
        u_max: Largest lateral offset of a point from the line, m.
        z_max: Largest depth, m.
        offset: Line position minus centre of the active aperture, m; the lobes' orders account for small
            differences from it.
    """
    depths = depth_grid(focal_depth, z_max)
    u_step = float(np.clip(focal_depth / 150, 0.1e-3, 0.2e-3))  # like the beam's width at the focus
    frequencies = _frequencies(array)
    u = u_step * np.arange(u_max // u_step + 3)
    spectra, turns, heard_from = _spectra(array, focal_depth, offset, u, depths)
    pulse = array.pulse_spectrum(frequencies) * np.exp(2j * np.pi * frequencies * array.pulse_delay)
    spectra *= (2.0 * len(frequencies) * (frequencies[1] - frequencies[0]) * pulse).astype(np.complex64)
    orders = np.rint(turns[:, :, 2] * array.pitch / (2 * _PROBE_STEP)).astype(np.int32)
    advances = turns[:, :, :2] / _PROBE_STEP
    extra = heard_from - np.hypot(u, depths[:, np.newaxis])
    return _pack(depths, u_step, spectra, orders, advances, extra.astype(np.float32))


def offset_classes(
    array: LinearArray, focal_depth: float, offsets: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return the offset (n_lines,) m of the table that serves each line; the order accounts for what is left.

    One table, without offset, serves all lines, as long as a point is seen through one lobe at a time. Where
    the delays between elements approach a period, lobes overlap, and only tables of close offsets do. A line
    beyond the array's last full aperture has a table of its own.
    """
    half = array.n_active * array.pitch / 2
    overlap = array.pitch * half / float(np.hypot(half, focal_depth)) > _OVERLAP * array.wavelength
    step = array.pitch / _N_CLASSES
    middle = (np.floor(offsets / step) + 0.5) * step if overlap else np.zeros_like(offsets)
    return np.where(np.abs(offsets) <= array.pitch / 2 * (1 + 1e-9), middle, offsets)


def depth_grid(focal_depth: float, z_max: float) -> npt.NDArray[np.float64]:
    """Return depths from 0.5 mm to beyond `z_max`, dense at the focus, (n_depths,) m."""
    depths = [0.5e-3]
    while depths[-1] <= z_max:
        depths.append(depths[-1] + float(np.clip(0.1 * abs(depths[-1] - focal_depth), 0.4e-3, 1e-3)))
    return np.array(depths)


def _frequencies(array: LinearArray) -> npt.NDArray[np.float64]:
    """Return the frequencies of the band around f0, spaced for the longest response of the aperture."""
    rate = array.iq_sampling_frequency
    longest = 1.25 * array.n_active * array.pitch / array.speed_of_sound + 6.0 / array.center_frequency
    n = LANES * max(2, int(np.ceil(longest * rate / LANES)))
    return np.asarray(array.center_frequency + (np.arange(n) - n // 2) * (rate / n))


def _spectra(
    array: LinearArray,
    focal_depth: float,
    offset: float,
    u: npt.NDArray[np.float64],
    depths: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.complex64], Floats, npt.NDArray[np.float64]]:
    """Return responses without pulse, (n_depths, n_u, n_frequencies), and the nodes' turns and distances."""
    frequencies = _frequencies(array)
    distances = np.arange(0.0, np.hypot(u[-1] + array.n_active * array.pitch / 2, depths[-1]), _DISTANCE_STEP)
    distances[0] = _DISTANCE_STEP / 2
    factor, extra = elevation_factor(array, 0.0, distances, frequencies)
    factor *= np.exp(-2j * np.pi / array.speed_of_sound * extra[:, np.newaxis] * frequencies)
    factor *= array.element_width * array.element_height / (2 * np.pi)
    real, imag = factor.real.astype(np.float32), factor.imag.astype(np.float32)

    spectra = np.empty((len(depths), len(u), len(frequencies)), dtype=np.complex64)
    turns = np.empty((len(depths), len(u), 3), dtype=np.float32)
    heard_from = np.empty((len(depths), len(u)))

    def fill(rows: slice) -> None:
        fill_responses(
            u, depths[rows], focal_depth, offset, array.apodization, array.pitch, array.element_width,
            array.speed_of_sound, frequencies, real, imag, _DISTANCE_STEP, np.full(3, _PROBE_STEP),
            spectra[rows], turns[rows], heard_from[rows],
        )  # fmt: skip

    parts = [slice(start, start + 8) for start in range(0, len(depths), 8)]
    with ThreadPoolExecutor(n_threads()) as pool:
        list(pool.map(fill, parts))
    return spectra, turns, heard_from


def _pack(
    depths: npt.NDArray[np.float64],
    u_step: float,
    spectra: npt.NDArray[np.complex64],
    orders: npt.NDArray[np.int32],
    advances: Floats,
    extra: Floats,
) -> ResponseTable:
    """Turn spectra into waveforms, cut off what has no energy, and keep the phase advance of every cell."""
    n = spectra.shape[-1]
    along_u = np.einsum("ijk,ijk->ij", spectra[:, 1:], spectra[:, :-1].conj())
    along_z = np.einsum("ijk,ijk->ij", spectra[1:], spectra[:-1].conj())
    cells = np.zeros((*orders.shape, 7), dtype=np.float32)
    # The phase tells the advance up to whole turns, its slope at the nodes tells those.
    power = np.square(np.abs(spectra)).sum(axis=2)
    slopes = [_cell_mean(advances[:, :, axis], power) for axis in range(2)]
    steps = [np.full((len(depths) - 1, 1), u_step), np.diff(depths)[:, np.newaxis]]
    measured = [np.angle(along_u[:-1] + along_u[1:]), np.angle(along_z[:, :-1] + along_z[:, 1:])]
    for axis in range(2):
        advance = measured[axis] / (2 * np.pi)
        cells[:-1, :-1, axis] = advance + np.rint(slopes[axis] * steps[axis] - advance)
    cells[:, :, 2:4] = np.cos(2 * np.pi * cells[:, :, :2])
    cells[:, :, 4:6] = np.sin(2 * np.pi * cells[:, :, :2])
    cells[:-1, :-1, 6] = _cell_mean(extra, power)

    waveforms = fft.fftshift(fft.ifft(fft.ifftshift(spectra, axes=2), axis=2), axes=2)
    power = np.square(waveforms.real) + np.square(waveforms.imag)
    energy = power.sum(axis=2)
    silent = _DEPTH_CUT * energy.max(axis=1, keepdims=True)
    cut = 0.5 * (_ENERGY_CUT * energy + silent)[:, :, np.newaxis]
    start = (np.cumsum(power, axis=2) < cut).sum(axis=2)
    stop = n - (np.cumsum(power[:, :, ::-1], axis=2) < cut).sum(axis=2)
    start = start // BLOCK * BLOCK
    length = np.where(energy > silent, -(-(stop - start) // BLOCK) * BLOCK, 0)

    index = np.arange(n)
    kept = waveforms[(index >= start[:, :, np.newaxis]) & (index < (start + length)[:, :, np.newaxis])]
    nodes = np.empty((*orders.shape, 4), dtype=np.int32)
    nodes[:, :, 0] = (np.cumsum(length) - length.ravel()).reshape(length.shape)
    nodes[:, :, 1], nodes[:, :, 2], nodes[:, :, 3] = start - n // 2, length, orders
    span = (int(nodes[:, :, 1].min()), int(nodes[:, :, 1:3].sum(axis=2).max()))
    real, imag = np.ascontiguousarray(kept.real), np.ascontiguousarray(kept.imag)
    return ResponseTable(depths, u_step, real, imag, nodes, cells, span)


def _cell_mean(values: Floats, weights: Floats) -> Floats:
    """Return the weighted mean over the four corners of every cell, (n - 1, m - 1)."""
    total, product = weights + np.float32(1e-30), values * weights
    corners = [(slice(a, a - 1 or None), slice(b, b - 1 or None)) for a in (0, 1) for b in (0, 1)]
    return np.asarray(sum(product[c] for c in corners) / sum(total[c] for c in corners))
