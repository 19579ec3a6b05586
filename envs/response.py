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
_SHIFT = 0.05  # pitches by which the aperture is shifted to find the order of a grating lobe
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
        cells: (n_depths, n_u, 6) float32: turns by which the phase advances over the cell along u and z, then
            the cosines and the sines of both.
    """

    depths: npt.NDArray[np.float64]
    u_step: float
    real: Floats
    imag: Floats
    nodes: npt.NDArray[np.int32]
    cells: Floats
    span: tuple[int, int]


@lru_cache(maxsize=24)
def response_table(
    array: LinearArray, focal_depth: float, u_max: float, z_max: float, offset: float = 0.0
) -> ResponseTable:
    """Tabulate the response for 0 <= u <= u_max and depths up to z_max (m).

    Args:
        array: The transducer.
        focal_depth: m.
        u_max: Largest lateral offset of a point from the line, m.
        z_max: Largest depth, m.
        offset: Line position minus centre of the active aperture, m, beyond what the order accounts for.
    """
    depths = depth_grid(focal_depth, z_max)
    u_step = float(np.clip(focal_depth / 150, 0.1e-3, 0.2e-3))  # follows the width of the beam at the focus
    frequencies = _frequencies(array)
    spectra, orders = _spectra(array, focal_depth, offset, u_step * np.arange(u_max // u_step + 3), depths)
    pulse = array.pulse_spectrum(frequencies) * np.exp(2j * np.pi * frequencies * array.pulse_delay)
    spectra *= (2.0 * len(frequencies) * (frequencies[1] - frequencies[0]) * pulse).astype(np.complex64)
    return _pack(depths, u_step, spectra, orders)


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
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.int32]]:
    """Return two-way responses without pulse, (n_depths, n_u, n_frequencies), and orders (n_depths, n_u)."""
    frequencies = _frequencies(array)
    distances = np.arange(0.0, np.hypot(u[-1] + array.n_active * array.pitch / 2, depths[-1]), _DISTANCE_STEP)
    distances[0] = _DISTANCE_STEP / 2
    factor, extra = elevation_factor(array, 0.0, distances, frequencies)
    factor *= np.exp(-2j * np.pi / array.speed_of_sound * extra[:, np.newaxis] * frequencies)
    factor *= array.element_width * array.element_height / (2 * np.pi)
    real, imag = factor.real.astype(np.float32), factor.imag.astype(np.float32)

    spectra = np.empty((len(depths), len(u), len(frequencies)), dtype=np.complex64)
    turns = np.empty((len(depths), len(u)), dtype=np.float32)

    def fill(rows: slice) -> None:
        fill_responses(
            u, depths[rows], focal_depth, offset, _SHIFT * array.pitch, array.apodization, array.pitch,
            array.element_width, array.speed_of_sound, frequencies, real, imag, _DISTANCE_STEP,
            spectra[rows], turns[rows],
        )  # fmt: skip

    parts = [slice(start, start + 8) for start in range(0, len(depths), 8)]
    with ThreadPoolExecutor(n_threads()) as pool:
        list(pool.map(fill, parts))
    return spectra, np.rint(turns / (2.0 * _SHIFT)).astype(np.int32)


def _pack(
    depths: npt.NDArray[np.float64],
    u_step: float,
    spectra: npt.NDArray[np.complex64],
    orders: npt.NDArray[np.int32],
) -> ResponseTable:
    """Turn spectra into waveforms, cut off what has no energy, and keep the phase advance of every cell."""
    n = spectra.shape[-1]
    along_u = np.einsum("ijk,ijk->ij", spectra[:, 1:], spectra[:, :-1].conj())
    along_z = np.einsum("ijk,ijk->ij", spectra[1:], spectra[:-1].conj())
    cells = np.zeros((*orders.shape, 6), dtype=np.float32)
    cells[:-1, :-1, 0] = np.angle(along_u[:-1] + along_u[1:]) / (2 * np.pi)
    cells[:-1, :-1, 1] = np.angle(along_z[:, :-1] + along_z[:, 1:]) / (2 * np.pi)
    cells[:, :, 2:4] = np.cos(2 * np.pi * cells[:, :, :2])
    cells[:, :, 4:6] = np.sin(2 * np.pi * cells[:, :, :2])

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
