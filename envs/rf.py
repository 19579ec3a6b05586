"""Pulse-echo lines of point scatterers, as Field II models them: linear, single scattering.

    rf_l(t) = pulse(t) * sum_s a_s [h_l(r_s, t) * h_l(r_s, t)]        (* is convolution in time)

with h the spatial impulse response of the line's apodised and delayed aperture (Tupholme 1969, Stepanishen
1971; Jensen and Svendsen 1992). `field/slow_sum.py` computes it formula by formula. Here the bracket comes
from a table per focal depth (`field/response_table.py`) and the distance from the image plane from a short
filter (`field/elevation.py`); this file adds up the scatterers, as I/Q (`LinearArray.iq_center_frequency`).
Few scatterers, and lines beyond the array's last full aperture, are summed directly (`field/direct.py`).
Time zero of a line is the instant at which its reference point (x_l, 0, 0) fires. Tissue may attenuate, by
exp(-b f d) over a distance d.
"""

from __future__ import annotations

import math
import reprlib
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.checks import METRES, meant, number
from usbench.envs.arrays import check_amplitudes, real
from usbench.envs.attenuation import checked_attenuation, nepers_per_m_hz
from usbench.envs.field.direct import add_echoes
from usbench.envs.field.elevation import ElevationTaps, elevation_taps
from usbench.envs.field.response_table import BLOCK, ResponseTable, response_table
from usbench.envs.field.summation import N_FIR, N_PHASES, accumulate, delay_filters, merge
from usbench.envs.probe import LinearArray, check_array
from usbench.envs.threads import divided, in_parallel
from usbench.waiting import announce

_MAX_DISTANCE = 0.5
# Pairs of line and scatterer that are summed directly; docs/physics.md says why so many.
FEW_PAIRS = 2048
# Pairs that a thread adds up in a second with a table, about (make bench-sim): said to those who wait.
_PAIRS_PER_S = 5e6
_FEWEST_SHARED = 8  # active elements: with fewer, the window's shift by an offset is not a small one


def simulate_rf(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None = None,
    attenuation_db_per_cm_mhz: float = 0.0,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """Simulate the RF of all lines.

    Args:
        positions: Scatterers in the probe's coordinates (lateral, elevation, depth), (n, 3) m.
        amplitudes: Their scattering amplitudes, (n,), up to 1e30.
        array: The transducer.
        focal_depth: Of transmit and, without a `receive_focus`, of receive, m.
        line_positions: Lateral positions of the lines, (n_lines,) m; default `array.line_positions`.
        attenuation_db_per_cm_mhz: Of the tissue, 0 for none, at most 1.

    Returns:
        rf (n_samples, n_lines) float32 in arbitrary units, and time (n_samples,) in s from 0, at
        `array.rf_sampling_frequency`. The pulse is causal: an echo starts at 2 r / c.

    Raises:
        TypeError: If `array` is no `LinearArray`, or the focal depth or the attenuation is no number.
        ValueError: If shapes are wrong, values are not finite real numbers, a scatterer or the focus is not
            below the surface, positions, lines or the focus are beyond 0.5 m, amplitudes beyond 1e30, or the
            attenuation is negative or above 1.
    """
    iq, iq_time = simulate_iq(
        positions,
        amplitudes,
        array,
        focal_depth,
        line_positions,
        attenuation_db_per_cm_mhz=attenuation_db_per_cm_mhz,
    )
    n, factor = len(iq_time), array.iq_decimation
    iq_spectrum = fft.fft(iq, axis=0)
    # Zeros between the positive and the negative frequencies: the same signal, sampled more often.
    spectrum = np.zeros((n * factor, iq.shape[1]), dtype=np.complex64)
    spectrum[: n // 2] = iq_spectrum[: n // 2]
    spectrum[-(n // 2) :] = iq_spectrum[n // 2 :]
    baseband = fft.ifft(spectrum, axis=0) * np.float32(factor)
    time = np.arange(n * factor) / array.rf_sampling_frequency
    carrier = np.exp(2j * np.pi * array.iq_center_frequency * (time - array.pulse_delay))
    return np.real(baseband * carrier.astype(np.complex64)[:, np.newaxis]), time


def simulate_iq(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None = None,
    max_depth: float | None = None,
    attenuation_db_per_cm_mhz: float = 0.0,
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.float64]]:
    """Simulate the same as complex baseband (I/Q); its magnitude is the envelope.

    Args:
        positions: As for `simulate_rf`.
        amplitudes: As for `simulate_rf`.
        array: The transducer.
        focal_depth: m.
        line_positions: (n_lines,) m.
        max_depth: The lines end with the echoes from here, m; default: with the latest echo.
        attenuation_db_per_cm_mhz: As for `simulate_rf`.

    Returns:
        iq (n_samples, n_lines) complex64 and time (n_samples,) s at `array.iq_sampling_frequency`;
        rf = Re(iq exp(2 pi j f (t - pulse_delay))) with f = `array.iq_center_frequency`.

    Raises:
        TypeError: If an argument has the wrong type.
        ValueError: If a value is not allowed.
    """
    if max_depth is not None:
        max_depth = _depth("max_depth", max_depth)
    points, weights, lines = _checked(positions, amplitudes, array, line_positions)
    focal_depth = _depth("focal_depth", focal_depth)
    attenuation = nepers_per_m_hz(checked_attenuation(attenuation_db_per_cm_mhz))
    rate, c = array.iq_sampling_frequency, array.speed_of_sound
    reach = np.abs(points).max(axis=0, initial=0.0)
    u_max = (
        float(max(points[:, 0].max() - lines.min(), lines.max() - points[:, 0].min())) if len(points) else 0.0
    )
    if max_depth is None:  # the farthest point, seen by the elements that fire or hear last
        late = array.n_active * array.pitch
        duration = (2.0 * float(np.linalg.norm([u_max, *reach[1:]])) + late) / c
    else:
        duration = 2.0 * max_depth / c
    n_samples = math.ceil((duration + 2.0 * array.pulse_delay) * rate / 2) * 2 + 2

    order = np.argsort(points[:, 2], kind="stable")
    points, weights = points[order], weights[order]
    iq = np.zeros((len(lines), n_samples), dtype=np.complex64)
    if len(points):
        offsets = lines - array.aperture_centers(lines)
        shared = np.abs(offsets) <= array.pitch / 2 * (1 + 1e-9)
        shared &= len(points) * len(lines) > FEW_PAIRS and array.n_active >= _FEWEST_SHARED
        if shared.any():
            # Generous steps, so that different scenes share a table.
            u_limit = 20e-3 * math.ceil(u_max / 20e-3 - 1e-9)
            z_limit = 90e-3 * math.ceil(reach[2] / 90e-3 - 1e-9)
            y_limit = 5e-3 * max(1, math.ceil(reach[1] / 5e-3 - 1e-9))
            farthest = math.hypot(u_limit + array.n_active * array.pitch, z_limit)
            taps = elevation_taps(array, y_limit, farthest, attenuation)
            table = response_table(array, focal_depth, u_limit, z_limit, attenuation)
            iq[shared] = _sum(
                points, weights, table, taps, array, lines[shared], offsets[shared], n_samples, attenuation
            )
        if not shared.all():  # lines beyond the array's last full aperture, or few scatterers
            others = np.zeros((np.count_nonzero(~shared), n_samples), dtype=np.complex64)
            add_echoes(others, points, weights, array, focal_depth, lines[~shared], attenuation)
            iq[~shared] = others
    return np.ascontiguousarray(iq.T), np.arange(n_samples) / rate


def _checked(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    line_positions: npt.ArrayLike | None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return points (n, 3), amplitudes (n,) and lines (n_lines,), or raise TypeError or ValueError."""
    check_array(array)
    points, weights = real("positions", positions), real("amplitudes", amplitudes)
    lines = real("line_positions", array.line_positions if line_positions is None else line_positions)
    points = points.reshape(0, 3) if points.size == 0 else points
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"positions must have shape (n, 3), not {points.shape}.")
    if weights.shape != (len(points),):
        raise ValueError(f"amplitudes must have shape ({len(points)},) like positions, not {weights.shape}.")
    if lines.ndim != 1 or len(lines) == 0:
        raise ValueError(f"line_positions must have shape (n_lines,) with n_lines >= 1, not {lines.shape}.")
    for name, values in (("positions", points), ("amplitudes", weights), ("line_positions", lines)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite, without NaN.")
    check_amplitudes(weights)
    if len(points) and points[:, 2].min() <= 0:
        raise ValueError(
            f"scatterers must lie below the surface (z > 0), not at z = {points[:, 2].min():g} m."
        )
    for name, values in (("positions", points), ("line_positions", lines)):
        if (farthest := float(np.abs(values).max(initial=0.0))) > _MAX_DISTANCE:
            hint = meant(farthest, 1e-3, _MAX_DISTANCE, METRES)
            raise ValueError(f"{name} must be within {_MAX_DISTANCE} m, not {farthest:g} m{hint or '.'}")
    return points, weights, lines


def _depth(name: str, depth: float) -> float:
    """Return a depth as a float; TypeError if it is no number, ValueError if it is not one up to 0.5 m."""
    try:
        return number(name, depth, low=0.0, high=_MAX_DISTANCE, above=True)
    except ValueError:
        # A whole number may be too large for a float.
        hint = meant(float(depth), 1e-3, _MAX_DISTANCE, METRES) if abs(depth) < 1e300 else ""
        allowed = f"in (0, {_MAX_DISTANCE}] m"
        raise ValueError(f"{name} must be {allowed}, not {reprlib.repr(depth)}{hint or '.'}") from None


def _sum(
    points: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    table: ResponseTable,
    taps: ElevationTaps,
    array: LinearArray,
    lines: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.float64],
    n_samples: int,
    attenuation: float,
) -> npt.NDArray[np.complex64]:
    """Add up the scatterers, sorted by depth, for every line, (n_lines, n_samples).

    `offsets` (n_lines,) m are those of the lines from their apertures' centres; `attenuation` is in
    Np / (m Hz).
    """
    x, y, z = (np.ascontiguousarray(column) for column in points.T)
    row = np.searchsorted(table.depths, z, side="right") - 1
    row = np.clip(row, 0, len(table.depths) - 2)
    fraction = np.clip((z - table.depths[row]) / np.diff(table.depths)[row], 0.0, 1.0).astype(np.float32)
    # Waveforms are those of the nearest depth: the way from there counts too.
    nearest = table.depths[row + (fraction > np.float32(0.5))]
    weights = weights * np.exp(-2 * attenuation * array.center_frequency * (z - nearest))
    y_row = np.rint(np.abs(y) / taps.y_step).astype(np.int32)
    first, last = table.span
    rate, c = array.iq_sampling_frequency, array.speed_of_sound
    longest = math.ceil(rate / c * np.abs(taps.further_path).max(initial=0.0))
    margin, wave_length = N_FIR + 2 * BLOCK + max(-first, last) + longest, last - first + 2 * BLOCK
    iq = np.empty((len(lines), n_samples), dtype=np.complex64)
    fir = delay_filters()
    # Of each group of taps: the scatterers that have them, the taps, how many, and the path.
    groups: list[tuple[Any, ...]] = [(slice(None), taps.taps, taps.n_taps, taps.path)]
    if len(taps.further):
        tall = np.flatnonzero(taps.need_further(y_row, z))
        paths = (taps.path + np.float32(longer) for longer in taps.further_path)
        groups += [(tall, one, taps.n_further, path) for one, path in zip(taps.further, paths, strict=True)]

    def run(part: slice) -> None:
        n_total = n_samples + 2 * margin
        sums = np.zeros((part.stop - part.start, N_PHASES, n_total), dtype=np.complex64)
        for which, coefficients, n_taps, path in groups:
            accumulate(
                x[which], z[which], y_row[which], row[which], fraction[which],
                weights[which].astype(np.float32), table.waveforms, table.cells, table.farther, table.parts,
                table.waves, coefficients, n_taps, path, lines[part], offsets[part] / array.pitch,
                1.0 / table.u_step, 1.0 / taps.distance_step, N_PHASES * rate / c,
                N_PHASES * (array.pulse_delay * rate + margin) + 0.5, array.iq_center_frequency / c, n_total,
                wave_length, sums.reshape(-1),
            )  # fmt: skip
        merge(sums, fir, margin, iq[part])

    parts = divided(len(lines))
    what = f"Summing {len(points)} scatterers for {len(lines)} lines"
    announce(what, len(points) * len(lines) / len(parts) / _PAIRS_PER_S)
    in_parallel(run, parts)
    return iq
