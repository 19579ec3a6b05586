"""Waveforms and local plane waves of two-way responses: what a table keeps of them."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.field.aperture import Aperture, Beam, Floats, Spectra
from usbench.envs.field.elevation import FAST_MATH
from usbench.envs.field.two_way import Responses, power_of, responses
from usbench.waiting import Waiting

# What is left out at the ends of a waveform, of the energy at its point and of the largest at its depth.
_ENERGY_CUT, _DEPTH_CUT = 2e-3, 2e-5
ROWS = 5  # depths that are computed at a time


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


def tabulate(beam: Aperture, receive: Beam, depths: Floats, n_samples: int, waiting: Waiting) -> list[Rows]:
    """Return the waveforms of every order at all `depths` but the last, ROWS depths at a time.

    Cells lean on the depth below them too: the deepest are made first, so that it is known.
    """
    result: list[Rows] = []
    below = responses(beam, receive, depths[-1:], n_samples)
    for first in reversed(range(0, len(depths) - 1, ROWS)):
        rows = depths[first : first + ROWS + 1]
        here = responses(beam, receive, rows[:-1], n_samples, below)
        result.insert(0, _waveforms(beam, rows, here, n_samples))
        below = here.top
        waiting.done()
    return result


def _waveforms(beam: Aperture, depths: Floats, here: Responses, n_samples: int) -> Rows:
    """Return the waveforms at all `depths` but the last."""
    u, f = beam.u, beam.frequencies
    power = power_of(here.spectra)
    total = power.sum(axis=0)
    silent = _DEPTH_CUT * total.max(axis=1, keepdims=True) + _ENERGY_CUT * total
    n_below = int(np.rint((beam.array.iq_center_frequency - f[0]) / (f[1] - f[0])))
    kept = []
    waves = np.zeros((len(power), len(depths) - 1, len(u) - 1, 6), dtype=np.float32)
    extents = np.zeros((len(power), len(depths) - 1, len(u), 2), dtype=np.int32)
    for q, spectrum in enumerate(here.spectra):
        if not (power[q] > silent).any():  # not at the depth below either, which the last cells lean on
            kept.append(np.zeros(0, dtype=np.complex64))
            continue
        waves[q] = _local_waves(spectrum, power[q], here.slopes[:, q], u, depths)
        waveforms = np.zeros((len(depths) - 1, len(u), n_samples), dtype=np.complex64)
        waveforms[..., : len(f) - n_below] = spectrum[:-1, :, n_below:]
        waveforms[..., n_samples - n_below :] = spectrum[:-1, :, :n_below]
        waveforms = fft.ifft(waveforms, axis=2, overwrite_x=True)
        kept.append(_cut(waveforms, silent[:-1] / n_samples, extents[q]))
    return Rows(kept, extents, waves, _cell_mean(here.extra, total).astype(np.float32))


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
