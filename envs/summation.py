"""The compiled loops that add up the waveforms of all scatterers for all lines.

Numba infers the types; shapes stand in the docstrings, the physics in `rf.py` and `response.py`.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numba
import numpy as np
import numpy.typing as npt

from usbench.envs.elevation import FAST_MATH
from usbench.envs.response import BLOCK
from usbench.envs.vector import LANES, weighted_sum

PHASE_BITS = 3
N_PHASES = 1 << PHASE_BITS  # a delay is rounded to this part of an I/Q sample
_N_FIR = 16
_GROUP = 16  # pairs that are interpolated before they are filtered
_ROOM = 1024  # for the parts of a group

_interpolate, _add_interpolated = weighted_sum(2, add=False), weighted_sum(2)
_clear = weighted_sum(0, add=False)
_add_one, _add_whole, _add_half = weighted_sum(1), weighted_sum(3), weighted_sum(4)


# One long function, since arrays handed to another are counted as in use: a quarter of the time.
@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def accumulate(
    x, z, y_row, row, fraction, amplitudes, table_real, table_imag, cells, farther, parts, waves, taps,
    n_taps, path, lines, offset_turns, columns_per_m, distances_per_m, ticks_per_m, ticks_at_zero,
    turns_per_m, n_total, wave_length, sums_real, sums_imag,
):  # fmt: skip
    """Add every scatterer's waveform to the sums, each (n_lines, N_PHASES, n_total) laid out flat."""
    n_u, n_lines = cells.shape[1], lines.shape[0]
    wave_real = np.zeros(_GROUP * wave_length, np.float32)
    wave_imag = np.zeros_like(wave_real)
    heard, columns = np.empty(n_lines, np.int64), np.empty(n_lines, np.int64)
    delay, filters = np.empty(n_lines, np.int64), np.empty(n_lines, np.int64)
    offset = np.empty(n_lines, np.float64)
    n_group = max(1, min(_GROUP, _ROOM // max(1, cells[:, :, 1].max())))
    # Rows: turns; weight of the next column; cosine and sine of the plane wave's advance to the next column,
    # and downwards; then the weights that come of it: of the nearer column and of the next, complex.
    source, scratch = np.empty((_ROOM, 4), np.int64), np.zeros((10, _ROOM), np.float32)
    for s in range(x.shape[0]):
        i, iy, wz = row[s], y_row[s], fraction[s]
        deeper = int(wz > np.float32(0.5))

        # The lines that hear the scatterer.
        n = 0
        for line in range(n_lines):
            u = abs(x[s] - lines[line])
            column = int(u * columns_per_m)
            if column < n_u and cells[i, column, 1] > 0:
                heard[n], columns[n], offset[n] = line, column, u
                n += 1

        for group in range(0, n, n_group):
            n_waves = min(n_group, n - group)
            n_items = 0
            for m in range(group, group + n_waves):
                # Arrival: geometric delay in the plane, and what elevation adds.
                column, line = columns[m], heard[m]
                rho = math.sqrt(offset[m] * offset[m] + z[s] * z[s])
                r = (rho + farther[i, column]) * distances_per_m
                k = int(r)
                beyond = np.float32(r - k)
                way = 2.0 * rho + (path[iy, k] + beyond * (path[iy, k + 1] - path[iy, k]))
                delay[m] = int(way * ticks_per_m + ticks_at_zero)
                turns = way * turns_per_m
                turn = np.float32(math.floor(turns) - turns)
                filters[m] = k + (beyond > np.float32(0.5))

                wu = np.float32(offset[m] * columns_per_m - column)
                lobe = offset_turns[line] if x[s] < lines[line] else -offset_turns[line]
                first = cells[i, column, 0]
                for p in range(first, first + cells[i, column, 1]):
                    scratch[0, n_items] = (
                        turn + np.float32(parts[p, 6] * lobe) + waves[p, 0] * wu + waves[p, 1] * wz
                    )
                    scratch[1, n_items] = wu
                    scratch[2, n_items], scratch[3, n_items] = waves[p, 2], waves[p, 4]
                    scratch[4, n_items] = waves[p, 3] if deeper else np.float32(1)
                    scratch[5, n_items] = waves[p, 5] if deeper else np.float32(0)
                    start = parts[p, 4]
                    source[n_items, 0] = parts[p, 2 * deeper] + start
                    source[n_items, 1] = parts[p, 2 * deeper + 1] + start
                    source[n_items, 2], source[n_items, 3] = start - cells[i, column, 2], parts[p, 5]
                    n_items += 1

            # Weights of the two columns, around the local plane wave: a loop that becomes vectors.
            amplitude = amplitudes[s]
            for k in range((n_items + LANES - 1) // LANES * LANES):
                c, d = _cos_sin(scratch[0, k])
                c, d = amplitude * c, amplitude * d
                c, d = c * scratch[4, k] + d * scratch[5, k], d * scratch[4, k] - c * scratch[5, k]
                wu = scratch[1, k]
                vu = np.float32(1) - wu
                scratch[6, k], scratch[7, k] = vu * c, vu * d
                scratch[8, k] = wu * (c * scratch[2, k] + d * scratch[3, k])
                scratch[9, k] = wu * (d * scratch[2, k] - c * scratch[3, k])

            item = 0
            for w in range(n_waves):
                # The sum of the cell's parts, between zeros for the filter.
                column, at = columns[group + w], w * wave_length + BLOCK
                n_parts, length = cells[i, column, 1], cells[i, column, 3]
                _clear(wave_real, wave_imag, at - BLOCK, BLOCK, table_real, table_imag, (), ())
                _clear(wave_real, wave_imag, at + length, BLOCK, table_real, table_imag, (), ())
                if n_parts > 1:
                    _clear(wave_real, wave_imag, at, length, table_real, table_imag, (), ())
                for _ in range(n_parts):
                    a = scratch[6, item], scratch[7, item], scratch[8, item], scratch[9, item]
                    o = source[item, 0], source[item, 1]
                    if n_parts == 1:
                        _interpolate(wave_real, wave_imag, at, length, table_real, table_imag, o, a)
                    else:
                        first, size = at + source[item, 2], source[item, 3]
                        _add_interpolated(wave_real, wave_imag, first, size, table_real, table_imag, o, a)
                    item += 1

            # Apart from the loop above, as a processor stalls where it reads what it has only just written.
            for w in range(n_waves):
                m, at = group + w, w * wave_length + BLOCK
                start, length = cells[i, columns[m], 2], cells[i, columns[m], 3]
                first = (delay[m] >> PHASE_BITS) + start
                if first < 2 or first + length + 2 * BLOCK > n_total:
                    continue
                k, base = filters[m], heard[m] * N_PHASES * n_total
                to = base + (delay[m] & (N_PHASES - 1)) * n_total + first
                one = taps[iy, k, 2], taps[iy, k, 3]
                if n_taps[iy, k] == 1:
                    _add_one(sums_real, sums_imag, to, length, wave_real, wave_imag, (at,), one)
                    continue
                # Filtered waves begin one or two samples earlier.
                length += BLOCK
                f = taps[iy, k, 0], taps[iy, k, 1], one[0], one[1], taps[iy, k, 4], taps[iy, k, 5]
                at3 = at, at - 1, at - 2
                _add_whole(sums_real, sums_imag, to - 1, length, wave_real, wave_imag, at3, f)
                if n_taps[iy, k] > 3:
                    later = delay[m] + N_PHASES // 2
                    to = base + (later & (N_PHASES - 1)) * n_total + (later >> PHASE_BITS) + start
                    g = (
                        taps[iy, k, 6], taps[iy, k, 7], taps[iy, k, 8], taps[iy, k, 9],
                        taps[iy, k, 10], taps[iy, k, 11], taps[iy, k, 12], taps[iy, k, 13],
                    )  # fmt: skip
                    at4 = at, at - 1, at - 2, at - 3
                    _add_half(sums_real, sums_imag, to - 2, length, wave_real, wave_imag, at4, g)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", forceinline=True)
def _cos_sin(turns):
    """Return cosine and sine of 2 pi `turns` (float32), by Taylor's series within an eighth of a turn."""
    quarter = np.floor(turns * np.float32(4) + np.float32(0.5))
    w = (turns - quarter * np.float32(0.25)) * np.float32(2 * math.pi)
    w2 = w * w
    c = np.float32(1) - w2 * (np.float32(1 / 2) - w2 * (np.float32(1 / 24) - w2 * np.float32(1 / 720)))
    s = w * (
        np.float32(1) - w2 * (np.float32(1 / 6) - w2 * (np.float32(1 / 120) - w2 * np.float32(1 / 5040)))
    )
    half = np.floor(quarter * np.float32(0.5))
    odd = quarter - np.float32(2) * half  # 0 or 1, as is the next
    opposite = half - np.float32(2) * np.floor(half * np.float32(0.5))
    sign = np.float32(1) - np.float32(2) * opposite
    p, q = (c, s) if odd == np.float32(0) else (-s, c)
    return sign * p, sign * q


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
