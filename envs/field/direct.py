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
from usbench.waiting import Waiting

Floats = npt.NDArray[np.float64]

_CHUNK = 128  # scatterers of which the echoes' lengths are looked at together
_POINTS = 16  # scatterers at a time: some MB of fields
_LENGTHS = 64  # samples of an echo, or a multiple
BLOCK = 64  # frequencies at a time
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
    what = f"Summing {len(points)} scatterers directly for {len(lines)} lines"
    waiting = Waiting(what, math.ceil(len(points) / _CHUNK))
    for start in range(0, len(points), _CHUNK):
        some, strengths = points[start : start + _CHUNK], amplitudes[start : start + _CHUNK]
        receive = _receiving(some, array, focal_depth, lines, from_line) or transmit
        begin, lengths = _samples(some, array, elements, active[:, 0], transmit, receive)
        # Grouped by length, which follows from a point and the lines: other points change no echo.
        for length in np.unique(lengths):
            alike = np.flatnonzero(lengths == length)
            for which in np.split(alike, range(_POINTS, len(alike), _POINTS)):
                heard = transmit if receive is transmit else receive.of(which)
                _add_block(
                    iq, some[which], strengths[which], array, elements, active[:, 0], transmit, heard,
                    begin[:, which], int(length), attenuation,
                )  # fmt: skip
        waiting.done()


@dataclass(frozen=True)
class Aperture:
    """How the active elements of every line fire or hear, for every point or (n_points 1) for all the same.

    Attributes:
        weights: (n_lines, n_points, n_active).
        ahead: By how much they fire before the line's reference point, (n_lines, n_points, n_active) m.
    """

    weights: Floats
    ahead: Floats

    def of(self, points: npt.NDArray[np.int64]) -> Aperture:
        """Return the same for some of the points."""
        if self.ahead.shape[1] == 1:
            return self
        weights = self.weights if self.weights.shape[1] == 1 else self.weights[:, points]
        return Aperture(weights, np.ascontiguousarray(self.ahead[:, points]))


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


def _samples(
    points: Floats, array: LinearArray, elements: Floats, first: npt.NDArray[np.int64], transmit: Aperture,
    receive: Aperture,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:  # fmt: skip
    """Return the samples at which echoes begin, (n_lines, n_points), and how many they take, (n_points,)."""
    rate, c = array.iq_sampling_frequency, array.speed_of_sound
    there, back = (_paths(points, array, elements, first, way.ahead) for way in (transmit, receive))
    shortest, longest = there + back
    begin = np.floor(shortest * (rate / c)).astype(np.int64) - _MARGIN
    duration = (longest - shortest).max(axis=0) / c + len(array.pulse) / array.sampling_frequency
    steps = np.ceil((duration * rate + 2 * _MARGIN) / _LENGTHS).astype(int)
    return begin, np.array([_LENGTHS * fft.next_fast_len(int(n)) for n in steps])


def _add_block(
    iq: npt.NDArray[np.complex64],
    points: Floats,
    amplitudes: Floats,
    array: LinearArray,
    elements: Floats,
    first: npt.NDArray[np.int64],
    transmit: Aperture,
    receive: Aperture,
    begin: npt.NDArray[np.int64],
    n: int,
    attenuation: float,
) -> None:
    """Add the echoes of some points, `n` samples from `begin` (n_lines, n_points) on.

    The lines' apertures begin with the elements `first` (n_lines,).
    """
    rate, middle, c = array.iq_sampling_frequency, array.iq_center_frequency, array.speed_of_sound
    steps, pulse = _band(array, n)
    n_blocks = math.ceil(len(steps) / BLOCK)
    wave_numbers = (middle + (steps[0] + np.arange(n_blocks * BLOCK)) * (rate / n)) / c
    fields = np.empty((len(points), n_blocks, 2, len(elements), BLOCK), dtype=np.float32)
    height = array.element_height / array.n_elevation
    rows = (np.arange(array.n_elevation) - (array.n_elevation - 1) / 2) * height

    def element_fields(part: slice) -> None:
        _element_fields(
            points[part], elements, rows, array.element_width, height, wave_numbers, attenuation * c,
            fields[part],
        )  # fmt: skip

    def echoes(part: slice) -> None:
        bins = np.zeros((part.stop - part.start, len(points), n), dtype=np.complex64)
        _two_way(
            transmit.weights[part], transmit.ahead[part], receive.weights[part], receive.ahead[part],
            receive is not transmit, first[part], wave_numbers, fields, amplitudes, pulse, steps, bins,
        )  # fmt: skip
        # Line by line: from SciPy 1.18 on, the bits of a transform depend on how many are asked for at once.
        for line in bins:
            line[:] = fft.ifft(line, axis=1, overwrite_x=True)
        _add(bins, begin[part], iq[part])

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


def _paths(
    points: Floats, array: LinearArray, elements: Floats, first: npt.NDArray[np.int64], ahead: Floats
) -> Floats:
    """Return the lengths of the shortest and of the longest path from apertures, (2, n_lines, n_points) m.

    Their elements fire `ahead` (n_lines, n_points or 1, n_active) m.
    """
    aside, half = np.abs(points[:, 1]), array.element_height / 2
    edges = np.stack([np.maximum(aside - half, 0.0), aside + half])
    off_line = np.hypot(edges, points[:, 2])[..., np.newaxis]
    distances = np.hypot(points[:, 0, np.newaxis] - elements, off_line)  # (2, n_points, n_elements)
    paths = np.empty((2, len(first), len(points)))
    _extremes(distances, first, ahead, paths)
    return paths


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", forceinline=True)
def _sin(turns):
    """Return the sine of 2 pi `turns` (float32), by Taylor's series within a quarter of a turn, to 4e-6."""
    half = np.floor(turns * np.float32(2) + np.float32(0.5))
    w = (turns - half * np.float32(0.5)) * np.float32(2 * math.pi)
    w2 = w * w
    high = np.float32(1 / 120) - w2 * (np.float32(1 / 5040) - w2 * np.float32(1 / 362880))
    odd = half - np.float32(2) * np.floor(half * np.float32(0.5))
    return (np.float32(1) - np.float32(2) * odd) * w * (np.float32(1) - w2 * (np.float32(1 / 6) - w2 * high))


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _element_fields(points, elements, rows, width, height, wave_numbers, loss, fields):
    """Compute G_n, (n_points, n_blocks, 2, n_elements, BLOCK), real and imaginary part.

    Wave numbers f / c (n_blocks BLOCK,) in 1/m, loss b c in Np. Rows are symmetric: of a point in the image
    plane, half are computed.
    """
    n_f, quarter = wave_numbers.shape[0], np.float32(0.25)
    k, decay, real, imaginary = np.empty((4, n_f), np.float32)
    k[:] = wave_numbers
    for p in range(points.shape[0]):
        sides = 2 if points[p, 1] == 0.0 and rows.shape[0] % 2 == 0 else 1
        for e in range(elements.shape[0]):
            real[:] = 0
            imaginary[:] = 0
            dx = points[p, 0] - elements[e]
            for row in range(rows.shape[0] // sides):
                dy = points[p, 1] - rows[row]
                r = math.sqrt(dx * dx + dy * dy + points[p, 2] * points[p, 2])
                a, b = width * max(abs(dx) / r, 1e-9), height * max(abs(dy) / r, 1e-9)
                gain = sides * width * height / (2.0 * math.pi**3 * r * a * b)
                decay[:] = gain
                if loss != 0.0:
                    for i in range(n_f):
                        decay[i] *= math.exp(-loss * r * wave_numbers[i])
                # The sines' arguments are pi times a and b, half as many turns.
                half_a, half_b, way = np.float32(a / 2), np.float32(b / 2), np.float32(r)
                for i in range(n_f):
                    size = decay[i] * _sin(half_a * k[i]) * _sin(half_b * k[i])
                    real[i] += size * _sin(quarter - way * k[i])
                    imaginary[i] -= size * _sin(way * k[i])
            for i in range(n_f):
                fields[p, i // BLOCK, 0, e, i % BLOCK] = real[i] / (k[i] * k[i])
                fields[p, i // BLOCK, 1, e, i % BLOCK] = imaginary[i] / (k[i] * k[i])


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _two_way(
    weights, ahead, receive_weights, receive_ahead, is_apart, first, wave_numbers, fields, amplitudes, pulse,
    steps, bins,
):  # fmt: skip
    """Put two-way spectra into `bins` (n_lines, n_points, n), all 0 before.

    A block of frequencies for all lines: its fields then stay in the processor's cache.
    """
    n_points, n, k = fields.shape[0], bins.shape[2], np.empty(BLOCK, np.float32)
    one_way = np.empty((n_points, 2, BLOCK), np.float32)
    other = np.empty((n_points, 2, BLOCK), np.float32) if is_apart else one_way
    for block in range(fields.shape[1]):
        low = block * BLOCK
        for i in range(BLOCK):
            k[i] = wave_numbers[low + i]
        for line in range(bins.shape[0]):
            _add_elements(weights[line], ahead[line], first[line], k, block, fields, one_way)
            if is_apart:
                _add_elements(
                    receive_weights[line], receive_ahead[line], first[line], k, block, fields, other
                )
            for p in range(n_points):
                amplitude = np.float32(amplitudes[p])
                for i in range(min(BLOCK, steps.shape[0] - low)):
                    there = complex(one_way[p, 0, i], one_way[p, 1, i])
                    back = complex(other[p, 0, i], other[p, 1, i])
                    bins[line, p, steps[low + i] % n] = amplitude * there * back * pulse[low + i]


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _add_elements(weights, ahead, first, wave_numbers, block, fields, one_way):
    """Sum a block of the elements' fields, weighted and delayed, in `one_way` (n_points, 2, BLOCK)."""
    c, s = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    one_way[:] = 0
    n_alike = one_way.shape[0] // weights.shape[0]  # points of which the aperture is the same
    for focus in range(weights.shape[0]):
        for n in range(weights.shape[1]):
            weight, path = np.float32(weights[focus, n]), np.float32(ahead[focus, n])
            if weight == 0.0:
                continue
            for i in range(BLOCK):
                c[i] = weight * _sin(np.float32(0.25) + path * wave_numbers[i])
            for i in range(BLOCK):
                s[i] = weight * _sin(path * wave_numbers[i])
            for p in range(focus * n_alike, (focus + 1) * n_alike):
                for i in range(BLOCK):
                    one_way[p, 0, i] += (
                        c[i] * fields[p, block, 0, first + n, i] - s[i] * fields[p, block, 1, first + n, i]
                    )
                for i in range(BLOCK):
                    one_way[p, 1, i] += (
                        c[i] * fields[p, block, 1, first + n, i] + s[i] * fields[p, block, 0, first + n, i]
                    )


@numba.njit(nogil=True, cache=True)
def _add(echoes, begin, iq):
    """Add echoes (n_lines, n_points, n) from the samples `begin` on to `iq` (n_lines, n_samples).

    Echoes are periodic, with the period n: sample t of a line has the place t % n.
    """
    n = echoes.shape[2]
    for line in range(echoes.shape[0]):
        for p in range(echoes.shape[1]):
            at, end = max(begin[line, p], 0), min(begin[line, p] + n, iq.shape[1])
            while at < end:
                period = at // n * n
                stop = min(end, period + n)
                for t in range(at, stop):
                    iq[line, t] += echoes[line, p, t - period]
                at = stop


@numba.njit(nogil=True, cache=True)
def _extremes(distances, first, ahead, paths):
    """Put the shortest and the longest path from each line's aperture into `paths` (2, n_lines, n_points), m.

    `distances` (2, n_points, n_elements) m are those of the elements' nearest and farthest parts.
    """
    for line in range(paths.shape[1]):
        for p in range(paths.shape[2]):
            alike = min(p, ahead.shape[1] - 1)
            shortest, longest = np.inf, -np.inf
            for n in range(ahead.shape[2]):
                e = first[line] + n
                shortest = min(shortest, distances[0, p, e] - ahead[line, alike, n])
                longest = max(longest, distances[1, p, e] - ahead[line, alike, n])
            paths[0, line, p], paths[1, line, p] = shortest, longest
