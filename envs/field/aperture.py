"""One-way field of a line's focused aperture in the plane of the array, on a lateral grid.

At a depth z all elements have the same field g(x, z; f), shifted. The aperture's field is the convolution of
g with the elements' weights and delays along the array, so a product after a Fourier transform:

    G(u, z; f) = sum_n w_n exp(-j 2 pi f (F - hypot(e_n, F)) / c) g(u - e_n, z; f)

    g(x, z; f) = a / (2 pi r) sinc(f width x / (r c)) E(r; f) exp(-j 2 pi f r / c),     r = hypot(x, z)

with a the element's area and E the factor of `elevation.py`: rectangles in their far field (Jensen and
Svendsen 1992). Tissue that attenuates multiplies g by exp(-b f r), the amplitude's loss on the way r: a power
law of exponent 1 in frequency (Szabo 2004, section 4.2), without dispersion.

A line need not lie on the centre of its aperture. Its elements, at e_n - d, are a comb of period `pitch`. By
Poisson's formula their field is a sum over grating lobes, sum_m G_m exp(-2 pi j m d / pitch), where G_m
hardly depends on the offset d.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.field.elevation import FAST_MATH, elevation_factor
from usbench.envs.probe import LinearArray

Floats = npt.NDArray[np.floating]
Spectra = npt.NDArray[np.complex64]

_DISTANCE_STEP = 0.05e-3


class Beam(Protocol):
    """What has one-way fields: an aperture with a fixed focus, or one that follows the echoes."""

    def only(self, which: slice) -> Beam:
        """Return the same for some of the frequencies."""
        ...

    def moved(self, distance: float) -> Beam:
        """Return what has at u the field of u + `distance` (m)."""
        ...

    def fields(self, depths: Floats, moment: bool = False) -> Spectra:
        """Return G_m at `depths` (m), (n_orders, n_depths, n_u, n_frequencies); with `moment`, of r g."""
        ...


@dataclass(frozen=True)
class Aperture:
    """What the field of a line's active aperture is made of; see `aperture`.

    Attributes:
        orders: m of the fields G_m.
        u: Lateral offsets at which fields are returned, from 0 on, (n_u,) m.
        x: Lateral distances from element to point, (n_x,) m.
        first_x: Where u = 0 is in the convolution along x.
        stride: Steps of x per step of u.
        frequencies: Equally spaced, (n_frequencies,) Hz.
        weights: w_n and their delays, transformed along x, (n_orders, n_frequencies, n_x).
        factor: a / (2 pi) E(r; f) exp(-b f r), (n_frequencies, n_distances).
        array: The transducer.
    """

    orders: tuple[int, ...]
    u: Floats
    x: Floats
    first_x: int
    stride: int
    frequencies: Floats
    weights: Spectra
    factor: Spectra
    array: LinearArray

    def only(self, which: slice) -> Aperture:
        """Return the same for some of the frequencies."""
        return replace(
            self,
            frequencies=self.frequencies[which],
            weights=self.weights[:, which],
            factor=np.ascontiguousarray(self.factor[which]),
        )

    def moved(self, distance: float) -> Aperture:
        """Return what has at u the field of u + `distance` (m)."""
        turns = np.exp(2j * np.pi * distance * fft.fftfreq(len(self.x), self.x[1] - self.x[0]))
        return replace(self, weights=self.weights * turns.astype(np.complex64))

    def element_fields(self, depths: Floats, moment: bool = False, distance: float = 0.0) -> Spectra:
        """Return g, or r g, at `distance` (m) beside every x, (n_depths, n_frequencies, n_x)."""
        element = np.empty((len(depths), len(self.frequencies), len(self.x)), dtype=np.complex64)
        _element_field(
            self.x + distance, depths, self.frequencies / self.array.speed_of_sound,
            self.array.element_width, self.factor, _DISTANCE_STEP, moment, element,
        )  # fmt: skip
        return element

    def fields(self, depths: Floats, moment: bool = False) -> Spectra:
        """Return G_m at `depths` (m), (n_orders, n_depths, n_u, n_frequencies); with `moment`, of r g."""
        transformed = fft.fft(self.element_fields(depths, moment), axis=2, overwrite_x=True)
        shape = (len(self.orders), len(depths), len(self.u), len(self.frequencies))
        fields = np.empty(shape, dtype=np.complex64)
        for weights, field in zip(self.weights, fields, strict=True):
            convolved = fft.ifft(transformed * weights, axis=2, overwrite_x=True)
            # The last ones: those that all elements take part in.
            field[:] = convolved[:, :, self.first_x :: self.stride].swapaxes(1, 2)
        return fields


def aperture(
    array: LinearArray,
    focal_depth: float,
    frequencies: Floats,
    u_max: float,
    z_max: float,
    oversampling: int,
    stride: int,
    orders: tuple[int, ...],
    attenuation: float = 0.0,
) -> Aperture:
    """Prepare the fields of the aperture.

    Args:
        array: The transducer.
        focal_depth: F, m.
        frequencies: Equally spaced, (n_frequencies,) Hz.
        u_max: Largest lateral offset of a point from the line, m.
        z_max: Largest depth, m.
        oversampling: Points of the lateral grid per pitch.
        stride: Every how many of them a field is wanted.
        orders: m of the grating lobes.
        attenuation: b, Np / (m Hz).
    """
    c, step = array.speed_of_sound, array.pitch / oversampling
    n = (array.n_active + 1) * oversampling - 1
    comb = np.arange(n) - (oversampling - 1)  # multiples of `oversampling` are elements
    centered = (np.arange(n) - (n - 1) / 2) * step
    n_x = int(fft.next_fast_len(n - 1 + int(np.ceil(u_max / step)) + 2 * stride))
    x = step * np.arange(n_x) - centered[-1]

    delays = (focal_depth - np.hypot(centered, focal_depth)) / c
    delayed = array.window(centered) * np.exp(-2j * np.pi * np.outer(frequencies, delays))
    turns = np.outer(orders, comb) / oversampling
    weights = delayed * np.exp(-2j * np.pi * turns)[:, np.newaxis] / oversampling

    distances = np.arange(0.0, np.hypot(np.abs(x).max(), z_max) + 2 * _DISTANCE_STEP, _DISTANCE_STEP)
    distances[0] = _DISTANCE_STEP / 2
    factor, extra = elevation_factor(array, 0.0, distances, frequencies, attenuation)
    factor *= np.exp(-2j * np.pi / c * extra[:, np.newaxis] * frequencies)
    factor *= np.exp(-attenuation * np.outer(distances, frequencies))
    factor *= array.element_width * array.element_height / (2 * np.pi)
    return Aperture(
        orders,
        step * np.arange(0, n_x - n + 1, stride),
        x,
        n - 1,
        stride,
        frequencies,
        fft.fft(weights.astype(np.complex64), n_x, axis=2),
        np.ascontiguousarray(factor.T.astype(np.complex64)),
        array,
    )


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _element_field(x, depths, wave_numbers, width, factor, distance_step, moment, field):
    """Compute g(x, z; f), or r g, into `field` (n_depths, n_frequencies, n_x); wave numbers f / c in 1/m."""
    n_f, n_x = field.shape[1], field.shape[2]
    phasor, turn = np.empty(n_x, np.complex64), np.empty(n_x, np.complex64)
    wave, wave_turn = np.empty(n_x, np.complex64), np.empty(n_x, np.complex64)
    near = np.empty(n_x, np.int32)
    first, step = wave_numbers[0], (wave_numbers[-1] - wave_numbers[0]) / max(n_f - 1, 1)
    for i in range(depths.shape[0]):
        for j in range(n_x):
            r = np.sqrt(x[j] * x[j] + depths[i] * depths[i])
            near[j] = min(int(r / distance_step + 0.5), factor.shape[1] - 1)
            a = np.pi * width * max(abs(x[j]) / r, 1e-9)
            path = -2.0 * np.pi * r
            # sin(a f / c) is the imaginary part of the one phasor, propagation is the other.
            wave[j], wave_turn[j] = np.exp(1j * a * first), np.exp(1j * a * step)
            gain = 1.0 / a if moment else 1.0 / (a * r)
            phasor[j], turn[j] = gain * np.exp(1j * path * first), np.exp(1j * path * step)
        for k in range(n_f):
            scale = np.float32(1.0 / wave_numbers[k])
            for j in range(n_x):
                field[i, k, j] = scale * wave[j].imag * (factor[k, near[j]] * phasor[j])
                wave[j] = wave[j] * wave_turn[j]
                phasor[j] = phasor[j] * turn[j]
