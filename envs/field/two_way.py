"""Two-way responses at a few depths: products of one-way fields.

Where transmit and receive share the aperture, the two-way response is the one-way response squared: of the
fields G_m of the grating lobes it has the products sum_m G_m G_(q-m), of the orders q. Otherwise it has the
products sum_m T_m R_(q-m) of the transmit's fields and the receive's (`receive.py`). Once the geometric
delay 2 hypot(u, z) / c is taken out, each is smooth in (u, z) and short in time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from usbench.envs.field.aperture import Aperture, Beam, Floats, Spectra
from usbench.envs.field.elevation import FAST_MATH
from usbench.envs.probe import LinearArray

_PROBE_STEP = 0.02e-3  # m, over which the phase is followed in u and z
_N_FOLLOWED = 8  # frequencies over the band that it is followed at, about


def orders_of(beam: Aperture) -> list[int]:
    """Return the orders q that products of two fields have."""
    return sorted({m + n for m in beam.orders for n in beam.orders})


@dataclass(frozen=True)
class Responses:
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
    def top(self) -> Responses:
        """The first depth alone."""
        return Responses(self.spectra[:, :1].copy(), self.slopes[:, :, :1], self.extra[:1])


def responses(
    beam: Aperture, receive: Beam, depths: Floats, n_samples: int, below: Responses | None = None
) -> Responses:
    """Return those at `depths` (m), scaled for waveforms of `n_samples`, and after them those `below`.

    `receive` is the transmitting aperture `beam` itself where both ways share it.
    """
    array, u, f = beam.array, beam.u, beam.frequencies
    scale = 2 * n_samples * (f[1] - f[0])
    pulse = scale * array.pulse_spectrum(f) * np.exp(2j * np.pi * f * array.pulse_delay)
    one_way, back = _both_ways(beam, receive, depths)
    spectra = _two_way(beam, one_way, back, u, depths, pulse, n_free=int(below is not None))

    step = max(1, len(f) // _N_FOLLOWED)
    which = slice(step // 2, None, step)
    some, some_pulse, followed = beam.only(which), pulse[which], spectra[:, : len(depths), :, which]
    hears = some if receive is beam else receive.only(which)
    slopes = []
    for du, dz in ((_PROBE_STEP, 0.0), (0.0, _PROBE_STEP)):
        beside = some.moved(du)
        fields = _both_ways(beside, beside if receive is beam else hears.moved(du), depths + dz)
        advanced = _two_way(some, *fields, u + du, depths + dz, some_pulse)
        slopes.append(np.angle((advanced * followed.conj()).sum(axis=-1)) / (2 * np.pi * _PROBE_STEP))
    moments = _two_way(
        some, some.fields(depths, moment=True), np.ascontiguousarray(back[..., which]), u, depths, some_pulse
    )
    if receive is not beam:
        far = hears.fields(depths, moment=True)
        there = np.ascontiguousarray(one_way[..., which])
        moments = (moments + _two_way(some, there, far, u, depths, some_pulse)) / np.float32(2)
    extra = _mean_distance(moments, followed, u, depths, array) - np.hypot(u, depths[:, np.newaxis])
    if below is None:
        return Responses(spectra, np.stack(slopes), extra)
    spectra[:, len(depths) :] = below.spectra
    return Responses(
        spectra, np.concatenate([slopes, below.slopes], axis=2), np.concatenate([extra, below.extra])
    )


def _both_ways(beam: Aperture, receive: Beam, depths: Floats) -> tuple[Spectra, Spectra]:
    """Return the fields of both ways, (n_orders, n_depths, n_u, n_frequencies) each."""
    there = beam.fields(depths)
    return there, there if receive is beam else receive.fields(depths)


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


def _mean_distance(
    moments: Spectra, spectra: Spectra, u: Floats, depths: Floats, array: LinearArray
) -> Floats:
    """Return the mean distance from the point to the elements that it is heard through, (n_depths, n_u) m.

    The elements' distances weighted with their contributions, within the range of those distances.
    """
    power = power_of(spectra).sum(axis=0) + np.finfo(np.float32).tiny
    mean = (moments * spectra.conj()).sum(axis=(0, 3)).real / power
    half = array.n_active * array.pitch / 2
    nearest = np.hypot(np.maximum(u - half, 0.0), depths[:, np.newaxis])
    return np.asarray(np.clip(mean, nearest, np.hypot(u + half, depths[:, np.newaxis])))


def power_of(spectra: Spectra) -> npt.NDArray[np.float32]:
    """Return the sum of the squared magnitudes over frequency, the last axis."""
    parts = np.ascontiguousarray(spectra).view(np.float32)
    return np.asarray(np.einsum("...k,...k->...", parts, parts))
