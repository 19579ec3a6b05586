"""Pulse-echo lines of point scatterers, as Field II models them: linear, single scattering, no attenuation.

    rf_l(t) = pulse(t) * sum_s a_s [h_l(r_s, t) * h_l(r_s, t)]        (* is convolution in time)

with h the spatial impulse response of the line's apodised and delayed aperture (Tupholme 1969, Stepanishen 1971;
Jensen and Svendsen 1992). The bracket comes from a table per focal depth (`response.py`), the distance from the
image plane from a short filter (`elevation.py`); this file adds up the scatterers, as I/Q around the centre
frequency. Time zero of a line is the instant at which its reference point (x_l, 0, 0) fires.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt
from scipy import fft

from usbench.envs.aperture import FAST_MATH
from usbench.envs.elevation import N_TAPS, ElevationTaps, elevation_taps
from usbench.envs.probe import LinearArray
from usbench.envs.response import BLOCK, ResponseTable, response_table
from usbench.envs.threads import n_threads
from usbench.envs.vector import add_product

_PHASE_BITS = 3
_N_PHASES = 1 << _PHASE_BITS  # a delay is rounded to this part of an I/Q sample
_N_FIR = 16
_SLAB = 16  # scatterers that all lines take before the next: neighbours in depth share the table's rows
_MAX_DISTANCE = 0.5
_FAR = 1 << 20


def simulate_rf(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None = None,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """Simulate the RF of all lines.

    Args:
        positions: Scatterers in the probe's frame (lateral, elevation, depth), (n, 3) m.
        amplitudes: Their scattering amplitudes, (n,).
        array: The transducer.
        focal_depth: Of transmit and receive, m.
        line_positions: Lateral positions of the lines, (n_lines,) m; default `array.line_positions`.

    Returns:
        rf (n_samples, n_lines) float32 in arbitrary units, and time (n_samples,) in s from 0, at
        `array.rf_sampling_frequency`. The pulse is causal: an echo starts at 2 r / c.

    Raises:
        ValueError: If shapes are wrong, values are not finite, or a scatterer or the focus is not below the
            surface.
    """
    iq, iq_time = simulate_iq(positions, amplitudes, array, focal_depth, line_positions)
    n, factor = len(iq_time), array.iq_decimation
    spectrum = np.zeros((n * factor, iq.shape[1]), dtype=np.complex64)
    half = n // 2
    spectrum[:half], spectrum[-half:] = (iq_spectrum := fft.fft(iq, axis=0))[:half], iq_spectrum[n - half :]
    time = np.arange(n * factor) / array.rf_sampling_frequency
    carrier = np.exp(2j * np.pi * array.center_frequency * (time - array.pulse_delay))
    baseband = fft.ifft(spectrum, axis=0) * np.float32(factor)
    return np.real(baseband * carrier.astype(np.complex64)[:, np.newaxis]), time


def simulate_iq(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None = None,
    max_depth: float | None = None,
) -> tuple[npt.NDArray[np.complex64], npt.NDArray[np.float64]]:
    """Simulate the same as complex baseband around the centre frequency; its magnitude is the envelope.

    Args:
        positions: As for `simulate_rf`.
        amplitudes: As for `simulate_rf`.
        array: The transducer.
        focal_depth: m.
        line_positions: (n_lines,) m.
        max_depth: The lines end with the echoes from here, m; default: with the latest echo.

    Returns:
        iq (n_samples, n_lines) complex64 and time (n_samples,) s at `array.iq_sampling_frequency`;
        rf = Re(iq exp(2 pi j f0 (t - pulse_delay))).
    """
    points, weights, lines = _checked(positions, amplitudes, array, focal_depth, line_positions)
    rate, c = array.iq_sampling_frequency, array.speed_of_sound
    reach = np.abs(points).max(axis=0, initial=0.0)
    u_max = reach[0] + np.abs(lines).max(initial=0.0)
    duration = 2.0 * float(np.linalg.norm([u_max, *reach[1:]]) if max_depth is None else max_depth) / c
    n_samples = math.ceil((duration + 2.0 * array.pulse_delay) * rate / 2) * 2 + 2

    order = np.argsort(points[:, 2], kind="stable")
    points, weights = points[order], weights[order]
    iq = np.zeros((len(lines), n_samples), dtype=np.complex64)
    if len(points):
        # Generous steps, so that different scenes share a table.
        u_limit = 40e-3 * math.ceil(u_max / 40e-3 - 1e-9)
        z_limit = 90e-3 * math.ceil(reach[2] / 90e-3 - 1e-9)
        y_limit = 5e-3 * max(1, math.ceil(reach[1] / 5e-3 - 1e-9))
        taps = elevation_taps(array, y_limit, math.hypot(u_limit, z_limit) + 1e-3)
        offsets = lines - array.aperture_centers(lines)
        regular = np.abs(offsets) <= array.pitch / 2 * (1 + 1e-9)
        table = response_table(array, focal_depth, u_limit, z_limit)
        iq[regular] = _sum(points, weights, table, taps, array, lines[regular], offsets[regular], n_samples)
        for i in np.flatnonzero(
            ~regular
        ):  # the array has ended: a table of its own for either side of the line
            for side in (1.0, -1.0):
                seen = side * (points[:, 0] - lines[i]) >= 0
                table = response_table(array, focal_depth, u_limit, z_limit, side * float(offsets[i]))
                mirrored = points[seen] * [side, 1.0, 1.0]
                line = side * lines[i : i + 1]
                iq[i] += _sum(mirrored, weights[seen], table, taps, array, line, np.zeros(1), n_samples)[0]
    return np.ascontiguousarray(iq.T), np.arange(n_samples) / rate


def _checked(
    positions: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    array: LinearArray,
    focal_depth: float,
    line_positions: npt.ArrayLike | None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return points (n, 3), amplitudes (n,) and lines (n_lines,), or raise ValueError."""
    points = np.asarray(positions, dtype=np.float64)
    weights = np.asarray(amplitudes, dtype=np.float64)
    lines = np.asarray(array.line_positions if line_positions is None else line_positions, dtype=np.float64)
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
    if not 0 < focal_depth <= _MAX_DISTANCE:
        raise ValueError(f"focal_depth must be in (0, {_MAX_DISTANCE}] m, not {focal_depth!r}.")
    if len(points) and points[:, 2].min() <= 0:
        raise ValueError(
            f"scatterers must lie below the surface (z > 0), not at z = {points[:, 2].min():g} m."
        )
    for name, values in (("positions", points), ("line_positions", lines)):
        if np.abs(values).max(initial=0.0) > _MAX_DISTANCE:
            raise ValueError(f"{name} must be within {_MAX_DISTANCE} m, not {np.abs(values).max():g} m.")
    return points, weights, lines


def _sum(
    points: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    table: ResponseTable,
    taps: ElevationTaps,
    array: LinearArray,
    lines: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.float64],
    n_samples: int,
) -> npt.NDArray[np.complex64]:
    """Add up the scatterers, sorted by depth, for every line, (n_lines, n_samples)."""
    x, y, z = (np.ascontiguousarray(column) for column in points.T)
    row = np.searchsorted(table.depths, z, side="right") - 1
    row = np.clip(row, 0, len(table.depths) - 2)
    fraction = np.clip((z - table.depths[row]) / np.diff(table.depths)[row], 0.0, 1.0).astype(np.float32)
    y_row = np.rint(np.abs(y) / taps.y_step).astype(np.int32)
    first, last = table.span
    margin, wave_length = 2 * BLOCK + max(-first, last), last - first + 2 * BLOCK
    iq = np.empty((len(lines), n_samples), dtype=np.complex64)
    fir = _delays_fir()
    rate, c = array.iq_sampling_frequency, array.speed_of_sound

    def run(part: slice) -> None:
        if part.start < part.stop:
            n_total = n_samples + 2 * margin
            sums_real, sums_imag = np.zeros((2, part.stop - part.start, _N_PHASES, n_total), dtype=np.float32)
            _accumulate(
                x, z, y_row, row, fraction, weights.astype(np.float32), table.real, table.imag, table.nodes,
                table.cells, taps.taps, taps.path, lines[part], 2.0 / array.pitch * offsets[part],
                1.0 / table.u_step, 1.0 / taps.distance_step, _N_PHASES * rate / c,
                _N_PHASES * (array.pulse_delay * rate + margin) + 0.5, array.center_frequency / c,
                n_total, wave_length, sums_real.reshape(-1), sums_imag.reshape(-1),
            )  # fmt: skip
            _merge(sums_real, sums_imag, fir, margin, iq[part])

    n_parts = min(n_threads(), len(lines))
    bounds = [len(lines) * k // n_parts for k in range(n_parts + 1)]
    with ThreadPoolExecutor(n_parts) as pool:
        list(pool.map(run, [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]))
    return iq


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _accumulate(
    x, z, y_row, row, fraction, weights, table_real, table_imag, nodes, cells, taps, path, lines, order_turns,
    columns_per_m, distances_per_m, ticks_per_m, ticks_at_zero, turns_per_m, n_total, wave_length,
    sums_real, sums_imag,
):  # fmt: skip
    """Add every scatterer's waveform to the sums, each (n_lines, _N_PHASES, n_total) laid out flat."""
    n_u, n_wave = nodes.shape[1], wave_length
    wave_real, wave_imag = np.zeros(_SLAB * n_wave, np.float32), np.zeros(_SLAB * n_wave, np.float32)
    lengths, targets = np.zeros(_SLAB, np.int64), np.zeros(_SLAB, np.int64)
    weight = np.zeros((_SLAB, 2 * N_TAPS), np.float32)
    for slab in range(0, x.shape[0], _SLAB):
        for line in range(lines.shape[0]):
            n_waves = 0
            for s in range(slab, min(slab + _SLAB, x.shape[0])):
                u = abs(x[s] - lines[line])
                q = u * columns_per_m
                column, i = int(q), row[s]
                if column >= n_u - 1:
                    continue
                n0, n1 = nodes[i, column, 2], nodes[i, column + 1, 2]
                n2, n3 = nodes[i + 1, column, 2], nodes[i + 1, column + 1, 2]
                if not (n0 | n1 | n2 | n3):
                    continue

                # Arrival: geometric delay in the plane, and what elevation adds.
                rho = math.sqrt(u * u + z[s] * z[s])
                r = rho * distances_per_m
                k, iy = int(r), y_row[s]
                wr = np.float32(r - k)
                vr = np.float32(1) - wr
                way = 2.0 * rho + (path[iy, k] * vr + path[iy, k + 1] * wr)
                tick = int(way * ticks_per_m + ticks_at_zero)

                # Weights of the cell's four corners, around its local plane wave.
                wu, wz = np.float32(q - column), fraction[s]
                vu, vz = np.float32(1) - wu, np.float32(1) - wz
                order = nodes[i + (wz > 0.5), column + (wu > 0.5), 3]
                turns = order * order_turns[line]
                turns = (turns if x[s] >= lines[line] else -turns) - way * turns_per_m
                along_u, along_z = cells[i, column, 0], cells[i, column, 1]
                c, d = _cos_sin(np.float32(turns - math.floor(turns)) + along_u * wu + along_z * wz)
                c, d = weights[s] * c, weights[s] * d
                cos_u, sin_u = cells[i, column, 2], cells[i, column, 4]
                cos_z, sin_z = cells[i, column, 3], cells[i, column, 5]
                c_u, d_u = c * cos_u + d * sin_u, d * cos_u - c * sin_u
                c_z, d_z = c * cos_z + d * sin_z, d * cos_z - c * sin_z
                c_uz, d_uz = c_u * cos_z + d_u * sin_z, d_u * cos_z - c_u * sin_z

                # The interpolated waveform, with zeros on either side.
                s0, s1 = nodes[i, column, 1], nodes[i, column + 1, 1]
                s2, s3 = nodes[i + 1, column, 1], nodes[i + 1, column + 1, 1]
                low = min(
                    min(s0 if n0 else _FAR, s1 if n1 else _FAR), min(s2 if n2 else _FAR, s3 if n3 else _FAR)
                )
                high = max(
                    max(s0 + n0 if n0 else -_FAR, s1 + n1 if n1 else -_FAR),
                    max(s2 + n2 if n2 else -_FAR, s3 + n3 if n3 else -_FAR),
                )
                length = high - low
                target = (tick >> _PHASE_BITS) + low - 1
                if target < 0 or target + length + BLOCK > n_total:
                    continue
                wave = n_waves * n_wave
                _clear(wave_real, wave_imag, wave, length + 2 * BLOCK)
                low -= wave + BLOCK
                _add(wave_real, wave_imag, s0 - low, table_real, table_imag, nodes[i, column, 0], n0,
                     vu * vz * c, vu * vz * d)  # fmt: skip
                _add(wave_real, wave_imag, s1 - low, table_real, table_imag, nodes[i, column + 1, 0], n1,
                     wu * vz * c_u, wu * vz * d_u)  # fmt: skip
                _add(wave_real, wave_imag, s2 - low, table_real, table_imag, nodes[i + 1, column, 0], n2,
                     vu * wz * c_z, vu * wz * d_z)  # fmt: skip
                _add(wave_real, wave_imag, s3 - low, table_real, table_imag, nodes[i + 1, column + 1, 0], n3,
                     wu * wz * c_uz, wu * wz * d_uz)  # fmt: skip
                lengths[n_waves] = length + BLOCK
                targets[n_waves] = (line * _N_PHASES + (tick & (_N_PHASES - 1))) * n_total + target
                for tap in range(N_TAPS):
                    weight[n_waves, tap] = vr * taps[iy, k, 0, tap] + wr * taps[iy, k + 1, 0, tap]
                    weight[n_waves, N_TAPS + tap] = vr * taps[iy, k, 1, tap] + wr * taps[iy, k + 1, 1, tap]
                n_waves += 1

            # Apart from the loop above, as a processor stalls where it reads what it has only just written.
            for w in range(n_waves):
                for tap in range(N_TAPS):
                    _add(
                        sums_real, sums_imag, targets[w], wave_real, wave_imag, w * n_wave + BLOCK - tap,
                        lengths[w], weight[w, tap], weight[w, N_TAPS + tap],
                    )  # fmt: skip


@numba.njit(nogil=True, error_model="numpy", forceinline=True)
def _add(real, imag, first, source_real, source_imag, source_first, n, a, b):
    """Add (a + jb) times n samples of the source (whole blocks) to n samples from `first` on."""
    for m in range(0, n, BLOCK):
        add_product(real, imag, first + m, source_real, source_imag, source_first + m, a, b)


@numba.njit(nogil=True, error_model="numpy", forceinline=True)
def _clear(real, imag, first, n):
    """Set n samples from `first` on to 0."""
    p, q = real[first : first + n], imag[first : first + n]
    for m in range(n):
        p[m] = 0
        q[m] = 0


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", forceinline=True)
def _cos_sin(turns):
    """Return cosine and sine of 2 pi `turns` (float32) to 2e-7, by Taylor's series within an eighth of a turn."""
    quarter = math.floor(turns * np.float32(4) + np.float32(0.5))
    w = (turns - np.float32(quarter) * np.float32(0.25)) * np.float32(2 * math.pi)
    w2 = w * w
    c = np.float32(1) - w2 * (np.float32(1 / 2) - w2 * (np.float32(1 / 24) - w2 * np.float32(1 / 720)))
    s = w * (
        np.float32(1) - w2 * (np.float32(1 / 6) - w2 * (np.float32(1 / 120) - w2 * np.float32(1 / 5040)))
    )
    n = int(quarter) & 3
    if n & 1:
        c, s = -s, c
    return (-c, -s) if n & 2 else (c, s)


@lru_cache(maxsize=1)
def _delays_fir() -> npt.NDArray[np.float32]:
    """Windowed-sinc filters that delay by 0, 1, .. (n_phases - 1) parts of a sample, (n_phases, _N_FIR)."""
    n = np.arange(_N_FIR) - (_N_FIR // 2 - 1)
    delays = np.arange(_N_PHASES)[:, np.newaxis] / _N_PHASES
    window = np.i0(5.0 * np.sqrt(np.maximum(0.0, 1.0 - np.square((n - delays) / (_N_FIR / 2))))) / np.i0(5.0)
    filters = np.sinc(n - delays) * window
    return (filters / filters.sum(axis=1, keepdims=True)).astype(np.float32)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _merge(sums_real, sums_imag, fir, margin, iq):
    """Delay every phase by its part of a sample and add them up: (n_lines, n_samples) complex64 in `iq`."""
    n_taps = fir.shape[1]
    n_samples = iq.shape[1]
    real, imag = np.empty(n_samples, np.float32), np.empty(n_samples, np.float32)
    for line in range(iq.shape[0]):
        real[:] = 0
        imag[:] = 0
        for phase in range(fir.shape[0]):
            for tap in range(n_taps):
                weight = fir[phase, tap]
                first = margin - (tap - (n_taps // 2 - 1))
                source_real, source_imag = sums_real[line, phase, first:], sums_imag[line, phase, first:]
                for m in range(n_samples):
                    real[m] += weight * source_real[m]
                    imag[m] += weight * source_imag[m]
        for m in range(n_samples):
            iq[line, m] = complex(real[m], imag[m])
