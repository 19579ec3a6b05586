"""What the finite height of the elements does to the response: a factor E(y, rho; f).

rho is the distance from an element's centre in the plane of the array. The element is divided into
`n_elevation` rectangles in their far field, as Field II does (Jensen and Svendsen 1992); there is no
elevation focus. Off the plane, the two-way factor (E(y) / E(0))^2 is written as a delay and a few taps, whole
and half samples of the I/Q apart: a filter as short as the accuracy allows, most often of one or three taps.
In the near field the waves of an element's ends come later than that of its middle. Tall elements, whose near
field reaches far, therefore have further taps, earlier and later ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt

from usbench.envs.cache.table_files import on_disk
from usbench.envs.probe import LinearArray
from usbench.waiting import Waiting
from usbench.words import in_words

Floats = npt.NDArray[np.float64]
# Functions of other files are compiled again after a change of these flags only where __pycache__ is removed.
FAST_MATH = {"contract", "reassoc", "nsz", "arcp", "nnan", "ninf"}
# In I/Q samples: those on the sample's own grid, then those between.
WHOLE, HALF = (-1.0, 0.0, 1.0), (-1.5, -0.5, 0.5, 1.5)
_OFFSETS = WHOLE + HALF
_SILENT = 1e-6  # of the energy on the plane: errors that are allowed in any case
# Elements are tall whose near field, height^2 / (4 wavelengths), reaches farther than this, m.
_TALL = 20e-3
_Y_STEP = 12.5e-6  # so fine that the nearest row will do
_REFINEMENT = 4  # rows are computed at every fourth step and interpolated between
_DISTANCE_STEP = 0.25e-3
_LEAST_DISTANCE = 0.75e-3  # nearer than an element's size the ratio has poles, and no model here holds


def elevation_factor(
    array: LinearArray,
    y: float,
    distances: npt.NDArray[np.floating],
    frequencies: npt.NDArray[np.floating],
    attenuation: float = 0.0,
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.float64]]:
    """Return E without its mean delay, (n_distances, n_frequencies), and its path, (n_distances,) m.

    E = mean_j rho / r_j * sinc(f h y_j / (r_j c)) * exp(-j 2 pi f (r_j - rho) / c), r_j = hypot(rho, y_j),
    over the rectangles j of height h at the distance y_j in elevation. Frequencies are equally spaced. In
    tissue with the attenuation b, Np / (m Hz), each term is multiplied by exp(-b f (r_j - rho)).
    """
    height = array.element_height / array.n_elevation
    dy = y - (np.arange(array.n_elevation) - (array.n_elevation - 1) / 2) * height
    factor = np.zeros((len(distances), len(frequencies)), dtype=np.complex64)
    extra = np.hypot(dy[:, np.newaxis], distances).mean(axis=0) - distances
    loss = attenuation * array.speed_of_sound
    _add_rectangles(dy, height, distances, extra, frequencies / array.speed_of_sound, loss, factor)
    return factor, extra


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _add_rectangles(dy, height, distances, extra, wave_numbers, loss, factor):
    """Add every rectangle to `factor`; wave numbers f / c in 1/m, loss b c."""
    first, step = wave_numbers[0], wave_numbers[-1] - wave_numbers[0]
    step /= max(wave_numbers.shape[0] - 1, 1)
    for i in range(distances.shape[0]):
        for j in range(dy.shape[0]):
            r = np.sqrt(distances[i] * distances[i] + dy[j] * dy[j])
            a = np.pi * height * max(abs(dy[j]) / r, 1e-9)
            way = 1j * (-2.0 * np.pi * (r - distances[i] - extra[i])) - loss * (r - distances[i])
            gain = distances[i] / (r * dy.shape[0] * a)
            # sin(a f / c) is the imaginary part of the one phasor, propagation is the other.
            wave, wave_turn = np.exp(1j * a * first), np.exp(1j * a * step)
            phasor, turn = gain * np.exp(way * first), np.exp(way * step)
            for k in range(wave_numbers.shape[0]):
                factor[i, k] += wave.imag / wave_numbers[k] * phasor
                wave *= wave_turn
                phasor *= turn


@dataclass(frozen=True)
class ElevationTaps:
    """(E(y, rho; f) / E(0, rho; f))^2 on a grid over |y| and rho.

    Attributes:
        taps: (n_y, n_distances, 14) float32, real and imaginary part of each tap, at WHOLE and HALF samples.
        n_taps: How many are used: 1 (the middle one), 3 (WHOLE) or 7, (n_y, n_distances) int8.
        path: Mean two-way path that y adds, (n_y, n_distances) float32, m.
        further: (n_groups, n_y, n_distances, 14) float32: further taps, of signals whose whole way, with its
            phase, is longer by `further_path`. There are none (n_groups is 0) unless elements are tall.
        n_further: How many of each group are used: 0 or 7, (n_y, n_distances) int8.
        further_path: (n_groups,) float64, m.
        y_step: Of the first axis, m.
        distance_step: Of the second axis, m.
    """

    taps: npt.NDArray[np.float32]
    n_taps: npt.NDArray[np.int8]
    path: npt.NDArray[np.float32]
    further: npt.NDArray[np.float32]
    n_further: npt.NDArray[np.int8]
    further_path: Floats
    y_step: float = _Y_STEP
    distance_step: float = _DISTANCE_STEP

    def need_further(
        self, y_row: npt.NDArray[np.integer], least_distance: npt.NDArray[np.floating]
    ) -> npt.NDArray[np.bool_]:
        """Return which points (n,) at `y_row` have further taps at `least_distance` (m) or beyond, (n,)."""
        beyond = np.maximum.accumulate(self.n_further[:, ::-1], axis=1)[:, ::-1]
        return np.asarray(beyond[y_row, (least_distance / self.distance_step).astype(int)] > 0)


@lru_cache(maxsize=4)
def elevation_taps(
    array: LinearArray, y_max: float, distance_max: float, attenuation: float = 0.0
) -> ElevationTaps:
    """Fit the taps for |y| <= `y_max` and rho <= `distance_max` (m), or take them from memory or disk.

    The fit is weighted by the pulse's spectrum. `attenuation` is that of the tissue, Np / (m Hz).
    """
    scene = (
        f"elevation, offsets to {y_max!r} m, distances to {distance_max!r} m, attenuation {attenuation!r} "
        f"Np/(m Hz), {in_words(array)}"
    )
    return on_disk(array, ElevationTaps, scene, lambda: _fitted(array, y_max, distance_max, attenuation))


@dataclass(frozen=True)
class _Model:
    """Which taps a filter may have, and how near to the factor it must come.

    Attributes:
        tolerance: Of the energy.
        n_frequencies: At which both are compared.
        later: By how many I/Q samples the taps of each further group come later than those of the first:
            where the taps of another group end.
    """

    tolerance: float
    n_frequencies: int
    later: tuple[float, ...] = ()

    @property
    def offsets(self) -> Floats:
        """Return the delays of all taps in I/Q samples, group by group, (n_taps,)."""
        return np.add.outer((0.0, *self.later), _OFFSETS).ravel()

    @property
    def kinds(self) -> list[list[int]]:
        """Return the taps of each kind of filter, from the cheapest on."""
        longest = [list(range(len(self.offsets)))] if self.later else []
        return [[1], [0, 1, 2], [0, 1, 2, 3, 4, 5, 6], *longest]


_SHORT = _Model(tolerance=3e-3, n_frequencies=48)
_LONG = _Model(tolerance=3e-4, n_frequencies=128, later=(-3.5, 3.5, -7.0, 7.0))


def _model_for(array: LinearArray) -> _Model:
    return _LONG if array.element_height**2 / (4 * array.wavelength) > _TALL else _SHORT


def _fitted(array: LinearArray, y_max: float, distance_max: float, attenuation: float) -> ElevationTaps:
    y_grid = np.arange(0.0, y_max + 2 * _Y_STEP * _REFINEMENT, _Y_STEP * _REFINEMENT)
    distances = np.arange(0.0, distance_max + 2 * _DISTANCE_STEP, _DISTANCE_STEP)
    distances = np.maximum(distances, _LEAST_DISTANCE)
    model, n = _model_for(array), len(_OFFSETS)
    rate, middle = array.iq_sampling_frequency, array.iq_center_frequency
    frequencies = middle + rate * ((np.arange(model.n_frequencies) + 0.5) / model.n_frequencies - 0.5)
    weight = np.abs(array.pulse_spectrum(frequencies))
    weight = (weight / np.sqrt(np.square(weight).sum())).astype(np.float32)
    on_plane, on_plane_extra = elevation_factor(array, 0.0, distances, frequencies, attenuation)
    if model.later:  # what is heard on the plane differs between distances: (n_distances, n_frequencies)
        weight = weight * np.square(np.abs(on_plane))
        weight /= np.sqrt(_energy(weight.astype(np.complex64)))[:, np.newaxis]
    delays = np.exp(-2j * np.pi * np.outer(frequencies - middle, model.offsets) / rate)
    delays = delays * weight[..., np.newaxis]
    bases = [delays[..., kind].astype(np.complex64) for kind in model.kinds]
    fits = [np.linalg.pinv(basis, rcond=1e-4) for basis in bases]

    shape = len(y_grid), len(distances)
    taps = np.zeros((len(fits), *shape, n), dtype=np.complex64)
    further = np.zeros((len(model.later), *shape, n), dtype=np.complex64)
    kinds = np.full(shape, len(fits) - 1)
    path = np.empty(shape, dtype=np.float32)
    waiting = Waiting("Fitting the filters of a probe's height", len(y_grid))
    for i, y in enumerate(y_grid):
        factor, extra = elevation_factor(array, float(y), distances, frequencies, attenuation)
        path[i] = 2.0 * (extra - on_plane_extra)
        weighted = np.square(factor / on_plane) * weight
        allowed = np.maximum(model.tolerance * _energy(weighted), _SILENT)
        for k in reversed(range(len(fits))):
            coefficients = _times(fits[k], weighted)
            kinds[i, _energy(weighted - _times(bases[k], coefficients)) <= allowed] = k
            taps[k, i][:, model.kinds[k][:n]] = coefficients[:, :n]
            if coefficients.shape[1] > n:
                groups = coefficients[:, n:].reshape(-1, len(further), n)
                further[:, i] = np.moveaxis(groups, 1, 0)
        waiting.done()
    # A longer way turns the phase, which a tap that comes later does not.
    turns = middle / rate * np.array(model.later)
    further *= np.exp(2j * np.pi * turns).astype(np.complex64)[:, np.newaxis, np.newaxis, np.newaxis]
    return _between_rows(taps, kinds, path, further, array.speed_of_sound / rate * np.array(model.later))


def _between_rows(
    taps: npt.NDArray[np.complex64],
    kinds: npt.NDArray[np.intp],
    path: npt.NDArray[np.float32],
    further: npt.NDArray[np.complex64],
    further_path: Floats,
) -> ElevationTaps:
    """Return the filters on the fine grid from those of all kinds on the coarse one.

    `taps` (n_kinds, n_y, n_distances, 7) and `further` (n_groups, n_y, n_distances, 7) are complex; `kinds`
    (n_y, n_distances) says which are used.
    """
    # Between two rows, the longer of their filters.
    kinds = np.repeat(np.maximum(kinds[:-1], kinds[1:]), _REFINEMENT, axis=0)
    refined = np.select(
        [(kinds == k)[:, :, np.newaxis] for k in range(len(taps))],
        [_refined(one.view(np.float32)) for one in taps],
    )
    n_taps = np.array([1, 3, 7, 7], dtype=np.int8)[kinds]
    n_further = np.array([0, 0, 0, 7], dtype=np.int8)[kinds]
    more = np.zeros((len(further), *refined.shape), dtype=np.float32)
    for k, one in enumerate(further):
        more[k] = _refined(one.view(np.float32)) * (n_further > 0)[:, :, np.newaxis]
    return ElevationTaps(refined, n_taps, _refined(path), more, n_further, further_path)


def _times(
    matrices: npt.NDArray[np.complex64], vectors: npt.NDArray[np.complex64]
) -> npt.NDArray[np.complex64]:
    """Return each vector (n, k) times the matrix (m, k), or times its own of (n, m, k): (n, m)."""
    if matrices.ndim == 2:
        return np.asarray(vectors @ matrices.T)
    return np.asarray((matrices @ vectors[:, :, np.newaxis])[:, :, 0])


def _energy(spectra: npt.NDArray[np.complex64]) -> npt.NDArray[np.float32]:
    """Return the sum over the last axis of the squared magnitude."""
    return np.asarray((np.square(spectra.real) + np.square(spectra.imag)).sum(axis=-1))


def _refined(coarse: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Interpolate linearly along the first axis, (n, ...) -> ((n - 1) * _REFINEMENT, ...)."""
    steps = [
        coarse[:-1] + np.float32(k / _REFINEMENT) * (coarse[1:] - coarse[:-1]) for k in range(_REFINEMENT)
    ]
    return np.ascontiguousarray(np.stack(steps, axis=1).reshape(-1, *coarse.shape[1:]))
