"""Two-way responses at a few depths: products of one-way fields, as waveforms and local plane waves.

Transmit and receive share the aperture, so the two-way response is the one-way response squared: of the
fields G_m of the grating lobes it has the products sum_m G_m G_(q-m), of the orders q. Once the geometric
delay 2 hypot(u, z) / c is taken out, each is smooth in (u, z) and short in time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.aperture import Aperture, Floats, Spectra
from usbench.envs.elevation import FAST_MATH
from usbench.envs.probe import LinearArray

# What is left out at the ends of a waveform, of the energy at its point and of the largest at its depth.
_ENERGY_CUT, _DEPTH_CUT = 2e-3, 2e-5
_PROBE_STEP = 0.02e-3  # m, over which the phase is followed in u and z
_N_FOLLOWED = 8  # frequencies over the band that it is followed at, about
ROWS = 5  # depths that are computed at a time


def orders_of(beam: Aperture) -> list[int]:
    """Return the orders q that products of two fields have."""
    return sorted({m + n for m in beam.orders for n in beam.orders})


@dataclass(frozen=True)
class Rows:
    """The waveforms at a few depths.

    Attributes:
        kept: Of every order, one waveform after the other, (n,).
        extents: First sample and number of samples of each, (n_q, n_depths, n_u, 2).
        waves: As in `ResponseTable`, of every cell, (n_q, n_depths, n_u - 1, 6).
        farther: As in `ResponseTable`, (n_depths, n_u - 1).
    """

    kept: list[Spectra]
    extents: npt.NDArray[np.int32]
    waves: npt.NDArray[np.float32]
    farther: npt.NDArray[np.float32]


@dataclass(frozen=True)
class _Responses:
    """What cells between depths are made of.

    Attributes:
        spectra: Two-way, of every order, (n_q, n_depths, n_u, n_frequencies).
        slopes: Turns per m by which the phase advances along u and z, (2, n_q, n_depths, n_u).
        extra: Mean distance of the elements less that of the line, (n_depths, n_u) m.
    """

    spectra: Spectra
    slopes: Floats
    extra: Floats

    @property
    def top(self) -> _Responses:
        """The first depth alone."""
        return _Responses(self.spectra[:, :1].copy(), self.slopes[:, :, :1], self.extra[:1])


def tabulate(beam: Aperture, depths: Floats, n_samples: int) -> list[Rows]:
    """Return the waveforms of every order at all `depths` but the last, ROWS depths at a time.

    Cells lean on the depth below them too: the deepest are made first, so that it is known.
    """
    result: list[Rows] = []
    below = _responses(beam, depths[-1:], n_samples)
    for first in reversed(range(0, len(depths) - 1, ROWS)):
        rows = depths[first : first + ROWS + 1]
        here = _responses(beam, rows[:-1], n_samples, below)
        result.insert(0, _waveforms(beam, rows, here, n_samples))
        below = here.top
    return result


def _responses(beam: Aperture, depths: Floats, n_samples: int, below: _Responses | None = None) -> _Responses:
    """Return the responses at `depths`, and after them those `below`."""
    array, u, f = beam.array, beam.u, beam.frequencies
    scale = 2 * n_samples * (f[1] - f[0])
    pulse = scale * array.pulse_spectrum(f) * np.exp(2j * np.pi * f * array.pulse_delay)
    one_way = beam.fields(depths)
    spectra = _two_way(beam, one_way, one_way, u, depths, pulse, n_free=int(below is not None))

    step = max(1, len(f) // _N_FOLLOWED)
    which = slice(step // 2, None, step)
    some, some_pulse, followed = beam.only(which), pulse[which], spectra[:, : len(depths), :, which]
    slopes = []
    for du, dz in ((_PROBE_STEP, 0.0), (0.0, _PROBE_STEP)):
        fields = some.moved(du).fields(depths + dz)
        advanced = _two_way(some, fields, fields, u + du, depths + dz, some_pulse)
        slopes.append(np.angle((advanced * followed.conj()).sum(axis=-1)) / (2 * np.pi * _PROBE_STEP))
    moments = some.fields(depths, moment=True)
    moments = _two_way(some, moments, np.ascontiguousarray(one_way[..., which]), u, depths, some_pulse)
    extra = _mean_distance(moments, followed, u, depths, array) - np.hypot(u, depths[:, np.newaxis])
    if below is None:
        return _Responses(spectra, np.stack(slopes), extra)
    spectra[:, len(depths) :] = below.spectra
    return _Responses(
        spectra, np.concatenate([slopes, below.slopes], axis=2), np.concatenate([extra, below.extra])
    )


def _waveforms(beam: Aperture, depths: Floats, here: _Responses, n_samples: int) -> Rows:
    """Return the waveforms at all `depths` but the last."""
    u, f = beam.u, beam.frequencies
    power = _power(here.spectra)
    total = power.sum(axis=0)
    silent = (_DEPTH_CUT * total.max(axis=1, keepdims=True) + _ENERGY_CUT * total)[:-1]
    n_below = int(np.rint((beam.array.iq_center_frequency - f[0]) / (f[1] - f[0])))
    kept = []
    waves = np.zeros((len(power), len(depths) - 1, len(u) - 1, 6), dtype=np.float32)
    extents = np.zeros((len(power), len(depths) - 1, len(u), 2), dtype=np.int32)
    for q, spectrum in enumerate(here.spectra):
        # An order that only the depth below hears stays without waves. To mend that would change some pixels
        # by a grey level, and with them every trial on record.
        if not (power[q, :-1] > silent).any():
            kept.append(np.zeros(0, dtype=np.complex64))
            continue
        waves[q] = _local_waves(spectrum, power[q], here.slopes[:, q], u, depths)
        waveforms = np.zeros((len(depths) - 1, len(u), n_samples), dtype=np.complex64)
        waveforms[..., : len(f) - n_below] = spectrum[:-1, :, n_below:]
        waveforms[..., n_samples - n_below :] = spectrum[:-1, :, :n_below]
        waveforms = fft.ifft(waveforms, axis=2, overwrite_x=True)
        kept.append(_cut(waveforms, silent / n_samples, extents[q]))
    return Rows(kept, extents, waves, _cell_mean(here.extra, total).astype(np.float32))


def _two_way(
    beam: Aperture, one: Spectra, other: Spectra, u: Floats, depths: Floats,
    pulse: npt.NDArray[np.complex128], n_free: int = 0,
) -> Spectra:  # fmt: skip
    """Return sum_m one_m other_(q-m) pulse(f) exp(4 pi j f hypot(u, z) / c) for every order q.

    Both fields are (n_orders, n_depths, n_u, n_frequencies), the result has n_q in place of n_orders, and
    `n_free` more depths with zeros.
    """
    _, n_depths, n_u, n_frequencies = one.shape
    result = np.zeros((len(orders_of(beam)), n_depths + n_free, n_u, n_frequencies), dtype=np.complex64)
    wave_numbers = beam.frequencies / beam.array.speed_of_sound
    _add_products(one, other, u, depths, wave_numbers, pulse.astype(np.complex64), result)
    return result


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _add_products(one, other, u, depths, wave_numbers, pulse, result):
    """Do what `_two_way` says; orders are consecutive, so that those of a product are the sum of indices."""
    n_orders, n_f = one.shape[0], one.shape[3]
    phase = np.empty(n_f, np.complex64)
    for i in range(depths.shape[0]):
        for j in range(u.shape[0]):
            turns = 4.0 * np.pi * np.sqrt(u[j] * u[j] + depths[i] * depths[i])
            start, step = turns * wave_numbers[0], turns * (wave_numbers[1] - wave_numbers[0])
            phasor, turn = complex(np.cos(start), np.sin(start)), complex(np.cos(step), np.sin(step))
            for k in range(n_f):
                phase[k] = phasor * pulse[k]
                phasor *= turn
            for m in range(n_orders):
                for n in range(n_orders):
                    for k in range(n_f):
                        result[m + n, i, j, k] += one[m, i, j, k] * other[n, i, j, k]
            for q in range(result.shape[0]):
                for k in range(n_f):
                    result[q, i, j, k] *= phase[k]


def _power(spectra: Spectra) -> npt.NDArray[np.float32]:
    """Return the sum of the squared magnitudes over frequency, the last axis."""
    parts = np.ascontiguousarray(spectra).view(np.float32)
    return np.asarray(np.einsum("...k,...k->...", parts, parts))


def _mean_distance(
    moments: Spectra, spectra: Spectra, u: Floats, depths: Floats, array: LinearArray
) -> Floats:
    """Return the mean distance from the point to the elements that it is heard through, (n_depths, n_u) m.

    The elements' distances weighted with their contributions, within the range of those distances.
    """
    power = _power(spectra).sum(axis=0) + np.finfo(np.float32).tiny
    mean = (moments * spectra.conj()).sum(axis=(0, 3)).real / power
    half = array.n_active * array.pitch / 2
    nearest = np.hypot(np.maximum(u - half, 0.0), depths[:, np.newaxis])
    return np.asarray(np.clip(mean, nearest, np.hypot(u + half, depths[:, np.newaxis])))


def _local_waves(
    spectra: Spectra, power: npt.NDArray[np.float32], slopes: Floats, u: Floats, depths: Floats
) -> npt.NDArray[np.float32]:
    """Return `waves` (n_depths - 1, n_u - 1, 6) from one order's spectra (n_depths, n_u, n_frequencies)."""
    conjugate = spectra.conj()
    along_u = np.einsum("ijk,ijk->ij", spectra[:, 1:], conjugate[:, :-1])
    along_z = np.einsum("ijk,ijk->ij", spectra[1:], conjugate[:-1])
    waves = np.zeros((len(depths) - 1, len(u) - 1, 6), dtype=np.float32)
    # The phase tells the advance up to whole turns, its slope at the nodes tells those.
    steps = [np.full((len(depths) - 1, 1), u[1] - u[0]), np.diff(depths)[:, np.newaxis]]
    measured = [np.angle(along_u[:-1] + along_u[1:]), np.angle(along_z[:, :-1] + along_z[:, 1:])]
    for axis in range(2):
        advance = measured[axis] / (2 * np.pi)
        waves[:, :, axis] = advance + np.rint(_cell_mean(slopes[axis], power) * steps[axis] - advance)
    waves[:, :, 2:4] = np.cos(2 * np.pi * waves[:, :, :2])
    waves[:, :, 4:6] = np.sin(2 * np.pi * waves[:, :, :2])
    return waves


def _cell_mean(values: Floats, weights: npt.NDArray[np.float32]) -> Floats:
    """Return the weighted mean over the four corners of every cell, (n - 1, m - 1)."""
    total, product = weights + np.finfo(np.float32).tiny, values * weights
    corners = [(slice(a, a - 1 or None), slice(b, b - 1 or None)) for a in (0, 1) for b in (0, 1)]
    return np.asarray(sum(product[c] for c in corners) / sum(total[c] for c in corners))


def _cut(waveforms: Spectra, silent: npt.NDArray[np.float32], extents: npt.NDArray[np.int32]) -> Spectra:
    """Return what is left of waveforms (n_depths, n_u, n_samples), and in `extents` where that is.

    At their ends, energy of `silent` (n_depths, n_u) altogether is cut off. The second half of the samples is
    that before the geometric delay.
    """
    kept = np.empty(waveforms.size, dtype=np.complex64)
    return kept[: _copy_heard(waveforms, silent, extents, kept)].copy()


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _copy_heard(waveforms, silent, extents, kept):
    """Do what `_cut` says; return how many samples are kept."""
    n, n_kept = waveforms.shape[2], 0
    wave = np.empty(n, np.complex64)
    for i in range(waveforms.shape[0]):
        for j in range(waveforms.shape[1]):
            energy = np.float32(0)
            for k in range(n):
                wave[k] = waveforms[i, j, (k + n // 2) % n]
                energy += wave[k].real ** 2 + wave[k].imag ** 2
            if energy <= silent[i, j]:
                continue
            start, stop, tail = 0, n, np.float32(0)
            while tail < silent[i, j] / 2:
                tail += wave[start].real ** 2 + wave[start].imag ** 2
                start += 1
            tail = np.float32(0)
            while tail < silent[i, j] / 2:
                stop -= 1
                tail += wave[stop].real ** 2 + wave[stop].imag ** 2
            start, stop = start - 1, stop + 1
            extents[i, j, 0], extents[i, j, 1] = start - n // 2, stop - start
            for k in range(start, stop):
                kept[n_kept] = wave[k]
                n_kept += 1
    return n_kept
