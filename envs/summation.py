"""The compiled loops that add up the waveforms of all scatterers for all lines.

Numba infers the types; shapes stand in the docstrings, the physics in `rf.py` and `response.py`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt

from usbench.envs.aperture import FAST_MATH
from usbench.envs.response import BLOCK
from usbench.envs.vector import add_product

PHASE_BITS = 3
N_PHASES = 1 << PHASE_BITS  # a delay is rounded to this part of an I/Q sample
_N_FIR = 16
_SLAB = 16  # scatterers that all lines take before the next: neighbours in depth share rows of the tables
_FAR = 1 << 20
_SILENT_TAP = np.float32(2e-3)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def accumulate(
    x, z, y_row, row, fraction, weights, table_real, table_imag, nodes, cells, taps, path, lines, order_turns,
    columns_per_m, distances_per_m, ticks_per_m, ticks_at_zero, turns_per_m, n_total, wave_length, one_sided,
    sums_real, sums_imag,
):  # fmt: skip
    """Add every scatterer's waveform to the sums, each (n_lines, N_PHASES, n_total) laid out flat."""
    n_u, n_wave, n_taps = nodes.shape[1], wave_length, taps.shape[3]
    wave_real, wave_imag = np.zeros(_SLAB * n_wave, np.float32), np.zeros(_SLAB * n_wave, np.float32)
    lengths, targets = np.zeros(_SLAB, np.int64), np.zeros(_SLAB, np.int64)
    weight = np.zeros((_SLAB, n_taps, 2), np.float32)
    for slab in range(0, x.shape[0], _SLAB):
        for line in range(lines.shape[0]):
            n_waves = 0
            for s in range(slab, min(slab + _SLAB, x.shape[0])):
                if one_sided and x[s] < lines[line]:
                    continue
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
                r = (rho + cells[i, column, 6]) * distances_per_m
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
                target = (tick >> PHASE_BITS) + low - n_taps // 2
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
                targets[n_waves] = (line * N_PHASES + (tick & (N_PHASES - 1))) * n_total + target
                for tap in range(n_taps):
                    weight[n_waves, tap, 0] = vr * taps[iy, k, 0, tap] + wr * taps[iy, k + 1, 0, tap]
                    weight[n_waves, tap, 1] = vr * taps[iy, k, 1, tap] + wr * taps[iy, k + 1, 1, tap]
                n_waves += 1

            # Apart from the loop above, as a processor stalls where it reads what it has only just written.
            for w in range(n_waves):
                for tap in range(n_taps):
                    a, b = weight[w, tap, 0], weight[w, tap, 1]
                    if abs(a) + abs(b) > _SILENT_TAP:
                        first = w * n_wave + BLOCK - tap
                        _add(sums_real, sums_imag, targets[w], wave_real, wave_imag, first, lengths[w], a, b)


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
    """Return cosine and sine of 2 pi `turns` (float32), by Taylor's series within an eighth of a turn."""
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
def delay_filters() -> npt.NDArray[np.float32]:
    """Windowed-sinc filters that delay by 0, 1, .. (n_phases - 1) parts of a sample, (n_phases, _N_FIR)."""
    n = np.arange(_N_FIR) - (_N_FIR // 2 - 1)
    delays = np.arange(N_PHASES)[:, np.newaxis] / N_PHASES
    window = np.i0(5.0 * np.sqrt(np.maximum(0.0, 1.0 - np.square((n - delays) / (_N_FIR / 2))))) / np.i0(5.0)
    filters = np.sinc(n - delays) * window
    return np.asarray(filters / filters.sum(axis=1, keepdims=True), dtype=np.float32)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def merge(sums_real, sums_imag, fir, margin, iq):
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
