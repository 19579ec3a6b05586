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

_N_PHASES = 8  # a delay is rounded to this part of an I/Q sample
_N_FIR = 16
_SLAB = 64  # scatterers that all lines take before the next: neighbours in depth share the table's rows
_MAX_DISTANCE = 0.5


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
    fraction = np.clip((z - table.depths[row]) / np.diff(table.depths)[row], 0.0, 1.0)
    y_row = np.rint(np.abs(y) / taps.y_step).astype(np.int32)
    margin = (
        2 * BLOCK
        + int(table.nodes[:, :, 2].max(initial=0))
        + int(np.abs(table.nodes[:, :, 1]).max(initial=0))
    )
    iq = np.empty((len(lines), n_samples), dtype=np.complex64)
    fir = _delays_fir()

    def run(part: slice) -> None:
        if part.start < part.stop:
            sums = np.zeros((part.stop - part.start, 2, _N_PHASES, n_samples + 2 * margin), dtype=np.float32)
            _accumulate(
                x, z, y_row, row, fraction, weights, table.u_step, table.real, table.imag, table.nodes,
                table.cells, taps.taps, taps.path, taps.distance_step, lines[part],
                4 * math.pi / array.pitch * offsets[part], array.speed_of_sound, array.center_frequency,
                array.iq_sampling_frequency, array.pulse_delay, margin, sums,
            )  # fmt: skip
            _merge(sums, fir, margin, iq[part])

    n_parts = min(n_threads(), len(lines))
    bounds = [len(lines) * k // n_parts for k in range(n_parts + 1)]
    with ThreadPoolExecutor(n_parts) as pool:
        list(pool.map(run, [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]))
    return iq


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _accumulate(
    x, z, y_row, row, fraction, weights, u_step, table_real, table_imag, nodes, cells, taps, path, distance_step,
    lines, order_phase, speed_of_sound, center_frequency, rate, pulse_delay, margin, sums,
):  # fmt: skip
    """Add every scatterer's waveform to `sums`, (n_lines, 2, n_phases, n_samples + 2 margin)."""
    n_u, n_phases, n_total = nodes.shape[1], sums.shape[2], sums.shape[3]
    wave_real, wave_imag = np.zeros(1024, np.float32), np.zeros(1024, np.float32)
    node_weight = np.empty((4, 2), np.float32)
    omega = 2 * math.pi * center_frequency
    for slab in range(0, x.shape[0], _SLAB):
        for line in range(lines.shape[0]):
            out_real, out_imag = sums[line, 0], sums[line, 1]
            for s in range(slab, min(slab + _SLAB, x.shape[0])):
                u = abs(x[s] - lines[line])
                column = int(u / u_step)
                i = row[s]
                if column >= n_u - 1:
                    continue
                if not (nodes[i, column, 2] | nodes[i, column + 1, 2]
                        | nodes[i + 1, column, 2] | nodes[i + 1, column + 1, 2]):  # fmt: skip
                    continue

                # Arrival: geometric delay in the plane, and what elevation adds.
                rho = math.sqrt(u * u + z[s] * z[s])
                q = rho / distance_step
                k = int(q)
                near = np.float32(q - k)
                iy = y_row[s]
                delay = (2 * rho + path[iy, k] * (1 - near) + path[iy, k + 1] * near) / speed_of_sound
                tick = int((delay + pulse_delay) * rate * n_phases + 0.5)
                sample = tick // n_phases
                phase = tick - sample * n_phases

                # Weights of the cell's four corners, around its local plane wave.
                wu, wz = u / u_step - column, fraction[s]
                cell = cells[i, column]
                order = nodes[i + (wz > 0.5), column + (wu > 0.5), 3]
                side = 1.0 if x[s] >= lines[line] else -1.0
                angle = cell[0] * wu + cell[1] * wz + side * order * order_phase[line] - omega * delay
                c, d = weights[s] * math.cos(angle), weights[s] * math.sin(angle)
                cu, cz, su, sz = cell[2], cell[3], cell[4], cell[5]
                node_weight[0, 0], node_weight[0, 1] = (1 - wu) * (1 - wz) * c, (1 - wu) * (1 - wz) * d
                e, f = c * cu + d * su, d * cu - c * su
                node_weight[1, 0], node_weight[1, 1] = wu * (1 - wz) * e, wu * (1 - wz) * f
                node_weight[2, 0] = (1 - wu) * wz * (c * cz + d * sz)
                node_weight[2, 1] = (1 - wu) * wz * (d * cz - c * sz)
                node_weight[3, 0] = wu * wz * (e * cz + f * sz)
                node_weight[3, 1] = wu * wz * (f * cz - e * sz)

                # The interpolated waveform, with a block of zeros on either side.
                low, high = 1 << 20, -(1 << 20)
                for corner in range(4):
                    node = nodes[i + corner // 2, column + corner % 2]
                    if node[2] > 0:
                        low, high = min(low, node[1]), max(high, node[1] + node[2])
                n_blocks = (high - low + BLOCK - 1) // BLOCK
                for m in range((n_blocks + 3) * BLOCK):
                    wave_real[m] = 0
                    wave_imag[m] = 0
                for corner in range(4):
                    node = nodes[i + corner // 2, column + corner % 2]
                    a, b = node_weight[corner, 0], node_weight[corner, 1]
                    source, target = node[0], BLOCK + node[1] - low
                    for _ in range(node[2] // BLOCK):
                        for m in range(BLOCK):
                            g, h = table_real[source + m], table_imag[source + m]
                            wave_real[target + m] += a * g - b * h
                            wave_imag[target + m] += a * h + b * g
                        source += BLOCK
                        target += BLOCK

                # Elevation: three taps, one I/Q sample apart.
                target = margin + sample + low - BLOCK
                n_blocks += 2
                if target < 0 or target + n_blocks * BLOCK > n_total:
                    continue
                t = taps[iy, k]
                v = taps[iy, k + 1]
                far = np.float32(1) - near
                a0, a1, a2 = (far * t[0, 0] + near * v[0, 0], far * t[0, 1] + near * v[0, 1],
                              far * t[0, 2] + near * v[0, 2])  # fmt: skip
                b0, b1, b2 = (far * t[1, 0] + near * v[1, 0], far * t[1, 1] + near * v[1, 1],
                              far * t[1, 2] + near * v[1, 2])  # fmt: skip
                real, imag = out_real[phase], out_imag[phase]
                for block in range(n_blocks):
                    first = block * BLOCK
                    for m in range(BLOCK):
                        j = first + m
                        g0, g1, g2 = wave_real[j + 1], wave_real[j], wave_real[max(j - 1, 0)]
                        h0, h1, h2 = wave_imag[j + 1], wave_imag[j], wave_imag[max(j - 1, 0)]
                        real[target + j] += a0 * g0 - b0 * h0 + a1 * g1 - b1 * h1 + a2 * g2 - b2 * h2
                        imag[target + j] += a0 * h0 + b0 * g0 + a1 * h1 + b1 * g1 + a2 * h2 + b2 * g2


@lru_cache(maxsize=1)
def _delays_fir() -> npt.NDArray[np.float32]:
    """Windowed-sinc filters that delay by 0, 1, .. (n_phases - 1) parts of a sample, (n_phases, _N_FIR)."""
    n = np.arange(_N_FIR) - (_N_FIR // 2 - 1)
    delays = np.arange(_N_PHASES)[:, np.newaxis] / _N_PHASES
    window = np.i0(5.0 * np.sqrt(np.maximum(0.0, 1.0 - np.square((n - delays) / (_N_FIR / 2))))) / np.i0(5.0)
    filters = np.sinc(n - delays) * window
    return (filters / filters.sum(axis=1, keepdims=True)).astype(np.float32)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def _merge(sums, fir, margin, iq):
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
                source_real, source_imag = sums[line, 0, phase, first:], sums[line, 1, phase, first:]
                for m in range(n_samples):
                    real[m] += weight * source_real[m]
                    imag[m] += weight * source_imag[m]
        for m in range(n_samples):
            iq[line, m] = complex(real[m], imag[m])
