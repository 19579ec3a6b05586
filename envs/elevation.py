"""What the finite height of the elements does to the response: a factor E(y, rho; f).

rho is the distance from an element's centre in the plane of the array. The element is divided into
`n_elevation` rectangles in their far field, as Field II does (Jensen and Svendsen 1992); there is no
elevation focus. Off the plane, the two-way factor (E(y) / E(0))^2 is written as a delay and a few taps at the
I/Q rate: it is a short filter, and as a plain number it would cost a percent of correlation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from usbench.envs.probe import LinearArray

N_TAPS = 5
_TAP_OFFSETS = np.arange(N_TAPS) - N_TAPS // 2
_Y_STEP = 12.5e-6  # so fine that the nearest row will do
_REFINEMENT = 4  # rows are computed at every fourth step and interpolated between
_DISTANCE_STEP = 0.25e-3
_LEAST_DISTANCE = 0.75e-3  # nearer than an element's size the ratio has poles, and no model here holds


def elevation_factor(
    array: LinearArray, y: float, distances: npt.NDArray[np.float64], frequencies: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.float64]]:
    """Return E without its mean delay, (n_distances, n_frequencies), and its path, (n_distances,) m.

    E = mean_j rho / r_j * sinc(f h y_j / (r_j c)) * exp(-j 2 pi f (r_j - rho) / c), r_j = hypot(rho, y_j),
    over the rectangles j of height h at the distance y_j in elevation.
    """
    n, c = array.n_elevation, array.speed_of_sound
    height = array.element_height / n
    dy = y - (np.arange(n) - (n - 1) / 2) * height
    r = np.hypot(dy[:, np.newaxis], distances)
    extra = r.mean(axis=0) - distances
    factor = np.zeros((len(distances), len(frequencies)), dtype=np.complex128)
    for dy_j, r_j in zip(dy, r, strict=True):
        directivity = np.sinc((height * dy_j / c / r_j)[:, np.newaxis] * frequencies)
        path = (r_j - distances - extra)[:, np.newaxis]
        gain = (distances / r_j / n)[:, np.newaxis]
        factor += gain * directivity * np.exp(-2j * np.pi / c * path * frequencies)
    return factor, extra


@dataclass(frozen=True)
class ElevationTaps:
    """(E(y, rho; f) / E(0, rho; f))^2 on a grid over |y| and rho.

    Attributes:
        taps: (n_y, n_distances, 2, N_TAPS) float32, real and imaginary parts.
        path: Mean two-way path that y adds, (n_y, n_distances) float32, m.
        y_step: Of the first axis, m.
        distance_step: Of the second axis, m.
    """

    taps: npt.NDArray[np.float32]
    path: npt.NDArray[np.float32]
    y_step: float = _Y_STEP
    distance_step: float = _DISTANCE_STEP


@lru_cache(maxsize=4)
def elevation_taps(array: LinearArray, y_max: float, distance_max: float) -> ElevationTaps:
    """Fit the taps for |y| <= `y_max` and rho <= `distance_max` (m), weighted by the pulse's spectrum."""
    y_grid = np.arange(0.0, y_max + 2 * _Y_STEP * _REFINEMENT, _Y_STEP * _REFINEMENT)
    distances = np.arange(0.0, distance_max + 2 * _DISTANCE_STEP, _DISTANCE_STEP)
    distances = np.maximum(distances, _LEAST_DISTANCE)
    f0, rate = array.center_frequency, array.iq_sampling_frequency
    frequencies = np.linspace(f0 - 0.35 * rate, f0 + 0.35 * rate, 16)
    weight = np.abs(array.pulse_spectrum(frequencies))
    basis = np.exp(-2j * np.pi * np.outer(frequencies - f0, _TAP_OFFSETS / rate))
    fit = (np.linalg.pinv(basis * weight[:, np.newaxis]) * weight).T  # (n_frequencies, N_TAPS)

    on_plane, on_plane_extra = elevation_factor(array, 0.0, distances, frequencies)
    taps = np.empty((len(y_grid), len(distances), 2, N_TAPS), dtype=np.float32)
    path = np.empty((len(y_grid), len(distances)), dtype=np.float32)
    for i, y in enumerate(y_grid):
        factor, extra = elevation_factor(array, float(y), distances, frequencies)
        coefficients = np.square(factor / on_plane) @ fit
        taps[i, :, 0], taps[i, :, 1] = coefficients.real, coefficients.imag
        path[i] = 2.0 * (extra - on_plane_extra)
    return ElevationTaps(_refined(taps), _refined(path))


def _refined(coarse: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Interpolate linearly along the first axis, (n, ...) -> ((n - 1) * _REFINEMENT, ...)."""
    steps = [
        coarse[:-1] + np.float32(k / _REFINEMENT) * (coarse[1:] - coarse[:-1]) for k in range(_REFINEMENT)
    ]
    return np.ascontiguousarray(np.stack(steps, axis=1).reshape(-1, *coarse.shape[1:]))
