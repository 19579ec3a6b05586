"""Pulse-echo lines of a few scatterers, summed directly over elements and their rectangles.

Where a table of responses would cost more than it saves: for few pairs of line and scatterer, and for lines
beyond the array's last full aperture, each of which would need tables of its own. The formula is that of
`slow_sum.one_way`, without interpolation. What is shared is computed once: an element's field at a point
serves every line,

    H_l(r_s; f) = sum_n w_n exp(2 pi j f delay_ln / c) G_n(r_s; f),

with G_n the sum over the rectangles of the element n (Jensen and Svendsen 1992). The two-way spectrum H_l^2,
times the pulse's, is brought to samples of the I/Q by an inverse Fourier transform as long as the echo lasts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.field.elevation import FAST_MATH
from usbench.envs.probe import LinearArray
from usbench.envs.threads import divided, in_parallel

Floats = npt.NDArray[np.float64]

_POINTS = 32  # scatterers at a time: some MB of fields
_PULSE_CUT = 1e-4  # of the pulse's largest magnitude: weaker frequencies are left out
_EDGE = 1 / 32  # of the band, over which its ends are faded
_MARGIN = 16  # samples about an echo, which rings by the edges of its band


def add_echoes(
    iq: npt.NDArray[np.complex64],
    points: Floats,
    amplitudes: Floats,
    array: LinearArray,
    focal_depth: float,
    lines: Floats,
    attenuation: float = 0.0,
) -> None:
    """Add the echoes of `points` (n, 3) m to the lines, (n_lines, n_samples) from time 0 on.

    Args:
        iq: To which is added.
        points: Scatterers (lateral, elevation, depth), m.
        amplitudes: (n,).
        array: The transducer.
        focal_depth: m.
        lines: Lateral positions, (n_lines,) m.
        attenuation: Of the tissue, Np / (m Hz).
    """
    elements = (np.arange(array.n_elements, dtype=np.float64) - (array.n_elements - 1) / 2) * array.pitch
    first = np.rint(array.aperture_centers(lines) / array.pitch + (array.n_elements - array.n_active) / 2)
    active = first.astype(np.int64)[:, np.newaxis] + np.arange(array.n_active)
    from_line = elements[active] - lines[:, np.newaxis]
    transmit = Aperture(
        np.broadcast_to(array.apodization, active.shape)[:, np.newaxis],
        (np.hypot(from_line, focal_depth) - focal_depth)[:, np.newaxis],
    )
    # Long enough for any point: an echo has the same samples whichever others there are.
    longest = 2 * (array.aperture_width + array.element_height) + np.ptp(transmit.ahead)
    longest += np.abs(from_line).max() if array.receives_apart else np.ptp(transmit.ahead)
    for start in range(0, len(points), _POINTS):
        some = slice(start, start + _POINTS)
        receive = _receiving(points[some], array, focal_depth, lines, from_line)
        _add_block(
            iq, points[some], amplitudes[some], array, elements, active[:, 0], transmit, receive or transmit,
            longest, attenuation,
        )  # fmt: skip


@dataclass(frozen=True)
class Aperture:
    """How the active elements of every line fire or hear, for every point or (n_points 1) for all the same.

    Attributes:
        weights: (n_lines, n_points, n_active).
        ahead: By how much they fire before the line's reference point, (n_lines, n_points, n_active) m.
    """

    weights: Floats
    ahead: Floats


def _receiving(
    points: Floats, array: LinearArray, focal_depth: float, lines: Floats, from_line: Floats
) -> Aperture | None:
    """Return the receiving aperture, None if it is the transmitting one.

    `from_line` are the positions of the active elements, (n_lines, n_active) m from their lines.
    """
    if not array.receives_apart:
        return None
    distances = np.zeros((len(lines), 1))
    if array.receives_dynamically:
        beside = points[:, 0] - lines[:, np.newaxis]
        distances = np.sqrt(np.square(beside) + np.square(points[:, 1]) + np.square(points[:, 2]))
    depths = array.receive_depths(focal_depth, distances)[:, :, np.newaxis]
    from_line = from_line[:, np.newaxis]
    weights = np.broadcast_to(array.apodization, np.broadcast_shapes(depths.shape, from_line.shape))
    if array.receive_f_number is not None:
        half = array.receive_half_width(depths)
        weights = np.where(np.abs(from_line) < half, np.cos(np.pi / 2 * from_line / half) ** 2, 0.0)
    return Aperture(weights, np.hypot(from_line, depths) - depths)


def _add_block(
    iq: npt.NDArray[np.complex64],
    points: Floats,
    amplitudes: Floats,
    array: LinearArray,
    elements: Floats,
    first: npt.NDArray[np.int64],
    transmit: Aperture,
    receive: Aperture,
    longest: float,
    attenuation: float,
) -> None:
    """Add the echoes of some points to lines whose apertures begin with the elements `first` (n_lines,).

    No echo lasts longer than the way `longest`, m.
    """
    rate, middle, c = array.iq_sampling_frequency, array.iq_center_frequency, array.speed_of_sound
    there, back = (_shortest_paths(points, array, elements, first, way.ahead) for way in (transmit, receive))
    begin = np.floor((there + back) * (rate / c)).astype(np.int64) - _MARGIN  # (n_lines, n_points)
    duration = longest / c + len(array.pulse) / array.sampling_frequency
    n = 16 * fft.next_fast_len(math.ceil((duration * rate + 2 * _MARGIN) / 16))
    steps, pulse = _band(array, n)
    wave_numbers = (middle + steps * (rate / n)) / c
    fields = np.empty((2, len(points), len(elements), len(steps)), dtype=np.float32)
    height = array.element_height / array.n_elevation
    rows = (np.arange(array.n_elevation) - (array.n_elevation - 1) / 2) * height

    def element_fields(part: slice) -> None:
        _element_fields(
            points[part], elements, rows, array.element_width, height, wave_numbers, attenuation * c,
            fields[0, part], fields[1, part],
        )  # fmt: skip

    def echoes(part: slice) -> None:
        bins = np.zeros((part.stop - part.start, len(points), n), dtype=np.complex64)
        _two_way(
            transmit.weights[part], transmit.ahead[part], receive.weights[part], receive.ahead[part],
            receive is not transmit, first[part], wave_numbers, fields, amplitudes, pulse, begin[part], steps,
            bins,
        )  # fmt: skip
        _add(fft.ifft(bins, axis=2, overwrite_x=True), begin[part], iq[part])

    in_parallel(element_fields, divided(len(points)))
    in_parallel(echoes, divided(len(iq)))


@lru_cache(maxsize=64)
def _band(array: LinearArray, n: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.complex128]]:
    """Return the frequencies that the pulse has, and its spectrum as I/Q of `n` samples, (n_frequencies,).

    Frequencies are in parts of 1 / n of the rate, from the middle of the band.
    """
    rate, middle = array.iq_sampling_frequency, array.iq_center_frequency
    steps = np.arange(-(n // 2) + 1, n // 2)
    # A sharp edge of the band would ring beyond the samples of an echo.
    edge = np.clip((n / 2 - np.abs(steps)) / (_EDGE * n), 0.0, 1.0)
    spectrum = array.pulse_spectrum(middle + steps * (rate / n)) * np.square(np.sin(np.pi / 2 * edge))
    heard = np.flatnonzero(np.abs(spectrum) > _PULSE_CUT * np.abs(spectrum).max())
    heard = np.arange(heard[0], heard[-1] + 1)
    return steps[heard], 2 * rate * spectrum[heard] * np.exp(2j * np.pi * middle * array.pulse_delay)


def _shortest_paths(
    points: Floats, array: LinearArray, elements: Floats, first: npt.NDArray[np.int64], ahead: Floats
) -> Floats:
    """Return the length of the shortest path from the active aperture, (n_lines, n_points) m.

    Its elements fire `ahead` (n_lines, n_points or 1, n_active) m.
    """
    nearest = np.hypot(np.maximum(np.abs(points[:, 1]) - array.element_height / 2, 0.0), points[:, 2])
    distances = np.hypot(points[:, 0, np.newaxis] - elements, nearest[:, np.newaxis])
    paths = [
        (distances[:, begin : begin + array.n_active] - ahead[line]).min(axis=1)
        for line, begin in enumerate(first)
    ]
    return np.stack(paths)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _element_fields(points, elements, rows, width, height, wave_numbers, loss, real, imaginary):
    """Compute G_n, (n_points, n_elements, n_frequencies); wave numbers f / c in 1/m, loss b c in Np."""
    n_f, n = wave_numbers.shape[0], elements.shape[0]
    k0, step = wave_numbers[0], (wave_numbers[-1] - wave_numbers[0]) / max(n_f - 1, 1)
    # Phasors of the way, and of the two sines, and their turns from one frequency to the next.
    way, across, up, way_turn, across_turn, up_turn = np.empty((6, n), np.complex64)
    field = np.empty((n_f, n), np.complex64)
    for p in range(points.shape[0]):
        field[:] = 0
        for row in rows:
            dy = points[p, 1] - row
            for e in range(n):
                dx = points[p, 0] - elements[e]
                r = math.sqrt(dx * dx + dy * dy + points[p, 2] * points[p, 2])
                a, b = math.pi * width * max(abs(dx) / r, 1e-9), math.pi * height * max(abs(dy) / r, 1e-9)
                gain = width * height / (2.0 * math.pi * r * a * b)
                decay = complex(-loss * r, -2.0 * math.pi * r)
                way[e], way_turn[e] = gain * np.exp(decay * k0), np.exp(decay * step)
                across[e], across_turn[e] = np.exp(1j * a * k0), np.exp(1j * a * step)
                up[e], up_turn[e] = np.exp(1j * b * k0), np.exp(1j * b * step)
            for k in range(n_f):
                scale = np.float32(1.0 / (wave_numbers[k] * wave_numbers[k]))
                for e in range(n):
                    field[k, e] += (scale * across[e].imag * up[e].imag) * way[e]
                    way[e] *= way_turn[e]
                    across[e] *= across_turn[e]
                    up[e] *= up_turn[e]
        for e in range(n):
            for k in range(n_f):
                real[p, e, k], imaginary[p, e, k] = field[k, e].real, field[k, e].imag


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _two_way(
    weights, ahead, receive_weights, receive_ahead, is_apart, first, wave_numbers, fields, amplitudes, pulse,
    begin, steps, bins,
):  # fmt: skip
    """Put two-way spectra into `bins` (n_lines, n_points, n), of echoes that start at the samples `begin`."""
    n_points, n_f, n = fields.shape[1], wave_numbers.shape[0], bins.shape[2]
    one_way = np.empty((2, n_points, n_f), np.float32)
    other = np.empty((2, n_points, n_f), np.float32) if is_apart else one_way
    for line in range(bins.shape[0]):
        _add_elements(weights[line], ahead[line], first[line], wave_numbers, fields, one_way)
        if is_apart:
            _add_elements(
                receive_weights[line], receive_ahead[line], first[line], wave_numbers, fields, other
            )
        for p in range(n_points):
            phasor = complex(amplitudes[p], 0.0)
            turn = np.exp(2j * math.pi * (begin[line, p] % n) / n)
            phasor *= np.exp(2j * math.pi * ((begin[line, p] * steps[0]) % n) / n)
            for k in range(n_f):
                there = complex(one_way[0, p, k], one_way[1, p, k])
                back = complex(other[0, p, k], other[1, p, k])
                bins[line, p, steps[k] % n] = there * back * pulse[k] * phasor
                phasor *= turn


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _add_elements(weights, ahead, first, wave_numbers, fields, one_way):
    """Sum the elements' fields (2, n_points, n_elements, n_frequencies), weighted, delayed, in `one_way`."""
    n_f = wave_numbers.shape[0]
    c, s = np.empty(n_f, np.float32), np.empty(n_f, np.float32)
    k0, step = wave_numbers[0], (wave_numbers[-1] - wave_numbers[0]) / max(n_f - 1, 1)
    one_way[:] = 0
    n_alike = one_way.shape[1] // weights.shape[0]  # points of which the aperture is the same
    for focus in range(weights.shape[0]):
        for n in range(weights.shape[1]):
            if weights[focus, n] == 0.0:
                continue
            turns = 2.0 * math.pi * ahead[focus, n]
            phasor, turn = weights[focus, n] * np.exp(1j * turns * k0), np.exp(1j * turns * step)
            for k in range(n_f):
                c[k], s[k] = phasor.real, phasor.imag
                phasor *= turn
            for p in range(focus * n_alike, (focus + 1) * n_alike):
                for k in range(n_f):
                    real, imaginary = fields[0, p, first + n, k], fields[1, p, first + n, k]
                    one_way[0, p, k] += c[k] * real - s[k] * imaginary
                    one_way[1, p, k] += c[k] * imaginary + s[k] * real


@numba.njit(nogil=True, cache=True)
def _add(echoes, begin, iq):
    """Add echoes (n_lines, n_points, n), which start at the samples `begin`, to `iq` (n_lines, n_samples)."""
    for line in range(echoes.shape[0]):
        for p in range(echoes.shape[1]):
            at = begin[line, p]
            for k in range(max(0, -at), min(echoes.shape[2], iq.shape[1] - at)):
                iq[line, at + k] += echoes[line, p, k]
