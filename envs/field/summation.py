"""The compiled loops that add up the waveforms of all scatterers for all lines.

Numba infers the types; shapes stand in the docstrings, the physics in `rf.py` and `response_table.py`. All
that the loops are made of stands in this file, as Numba compiles a function again when its file has changed.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from usbench.envs.field.elevation import FAST_MATH

LANES = 8  # float32 in a vector
SAMPLES = LANES // 2  # complex64 in a vector
ALTERNATE = [lane + lane % 2 * LANES for lane in range(LANES)]  # of two vectors in turn
PHASE_BITS = 3
N_PHASES = 1 << PHASE_BITS  # a delay is rounded to this part of an I/Q sample
N_FIR = 16  # samples of a delay filter
_GROUP = 16  # pairs that are interpolated before they are filtered
_ROOM = 1024  # for the parts of a group


def weighted_sum(n_terms: int, add: bool = True) -> Any:
    """Return a function for compiled code that sums `n_terms` weighted parts of a complex source.

    It uses vector instructions, SAMPLES samples at a time. A loop over array slices would first prove at run
    time, for every few samples, that source and destination do not overlap; here they never do, and that
    proof cost more than the arithmetic.

    f(target, first, n, source, firsts, weights): n samples from `first` on, in whole vectors of SAMPLES,
    become (or with `add`, are increased by) the sum over k of those of the source from firsts[k] on, times
    weights[2 k] + j weights[2 k + 1]. Nothing is checked: arrays are contiguous complex64, tuples hold int64
    and float32, indices are in range, source and destination apart.
    """

    @intrinsic
    def summed(
        typing_context: Any, target: Any, first: Any, n: Any, source: Any, firsts: Any, weights: Any
    ) -> Any:
        indices, factors = types.UniTuple(types.int64, n_terms), types.UniTuple(types.float32, 2 * n_terms)
        signature = types.void(target, types.int64, types.int64, source, indices, factors)

        def codegen(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> Any:
            vector = ir.VectorType(ir.FloatType(), LANES)
            undefined, nothing = ir.Constant(vector, ir.Undefined), ir.Constant(vector, [0.0] * LANES)
            flags = ("contract", "nsz")

            def start(array: int, index: Any) -> Any:
                data = context.make_array(sig.args[array])(context, builder, args[array]).data
                return builder.gep(data, [index])

            def at(pointer: Any, index: Any) -> Any:
                return builder.bitcast(builder.gep(pointer, [index]), vector.as_pointer())

            def shuffled(one: Any, other: Any, lanes: list[int]) -> Any:
                mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), lanes)
                return builder.shuffle_vector(one, other, mask)

            def everywhere(value: Any) -> Any:
                one = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
                return shuffled(one, undefined, [0] * LANES)

            def fused(u: Any, v: Any, w: Any) -> Any:
                return builder.fadd(builder.fmul(u, v, flags=flags), w, flags=flags)

            def product(a: Any, b: Any, z: Any, more: Any) -> Any:
                """(a + j b) z, which may be added to more; products are rounded in this order."""
                minus_b = builder.fneg(b)
                if more is nothing:
                    reals = shuffled(z, undefined, [lane & ~1 for lane in range(LANES)])
                    imags = shuffled(z, undefined, [lane | 1 for lane in range(LANES)])
                    second = builder.fmul(shuffled(minus_b, a, ALTERNATE), imags, flags=flags)
                    return fused(shuffled(a, b, ALTERNATE), reals, second)
                swapped = shuffled(z, undefined, [lane ^ 1 for lane in range(LANES)])
                return fused(a, z, fused(shuffled(minus_b, b, ALTERNATE), swapped, more))

            target = start(0, args[1])
            sources = [start(3, builder.extract_value(args[4], k)) for k in range(n_terms)]
            factors = [everywhere(builder.extract_value(args[5], k)) for k in range(2 * n_terms)]
            whole = args[2].type
            with cgutils.for_range_slice(builder, whole(0), args[2], whole(SAMPLES)) as (index, _):
                # Two sums of every second term: a processor waits less for the one before.
                sums = [builder.load(at(target, index), align=8) if add else nothing, nothing]
                for k, source in enumerate(sources):
                    z = builder.load(at(source, index), align=8)
                    sums[k % 2] = product(factors[2 * k], factors[2 * k + 1], z, sums[k % 2])
                total = builder.fadd(*sums, flags=("nsz",)) if n_terms > 1 else sums[0]
                builder.store(total, at(target, index), align=8)
            return context.get_dummy_value()

        return signature, codegen

    return summed


_interpolate, _add_interpolated = weighted_sum(2, add=False), weighted_sum(2)
_clear = weighted_sum(0, add=False)
_add_one, _add_whole, _add_half = weighted_sum(1), weighted_sum(3), weighted_sum(4)


# One long function, since arrays handed to another are counted as in use: a quarter of the time.
@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def accumulate(
    x, z, y_row, row, fraction, amplitudes, table, cells, farther, parts, waves, taps,
    n_taps, path, lines, offset_turns, columns_per_m, distances_per_m, ticks_per_m, ticks_at_zero,
    turns_per_m, n_total, wave_length, sums,
):  # fmt: skip
    """Add every scatterer's waveform to `sums`, (n_lines, N_PHASES, n_total) complex64 laid out flat."""
    n_u, n_lines = cells.shape[1], lines.shape[0]
    wave = np.zeros(_GROUP * wave_length, np.complex64)
    heard, columns = np.empty(n_lines, np.int64), np.empty(n_lines, np.int64)
    delay, filters = np.empty(n_lines, np.int64), np.empty(n_lines, np.int64)
    offset, beside = np.empty(n_lines, np.float64), np.empty(n_lines, np.float32)
    n_group = max(1, min(_GROUP, _ROOM // max(1, cells[:, :, 1].max())))
    phases, cosines, sines = np.zeros((3, _ROOM), np.float32)  # of parts; phases in turns
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

                # Phase of the local plane wave, of every part.
                wu = np.float32(offset[m] * columns_per_m - column)
                beside[m] = wu
                lobe = offset_turns[line] if x[s] < lines[line] else -offset_turns[line]
                first = cells[i, column, 0]
                for p in range(first, first + cells[i, column, 1]):
                    phases[n_items] = (
                        turn + np.float32(parts[p, 6] * lobe) + waves[p, 0] * wu + waves[p, 1] * wz
                    )
                    n_items += 1

            amplitude = amplitudes[s]
            for k in range((n_items + LANES - 1) // LANES * LANES):  # becomes vectors
                c, d = _cos_sin(phases[k])
                cosines[k], sines[k] = amplitude * c, amplitude * d

            item = 0
            for w in range(n_waves):
                # The sum of the cell's parts, between zeros for the filter.
                column, at = columns[group + w], w * wave_length + SAMPLES
                n_parts, length = cells[i, column, 1], cells[i, column, 3]
                _clear(wave, at - SAMPLES, SAMPLES, table, (), ())
                _clear(wave, at + length, SAMPLES, table, (), ())
                if n_parts > 1:
                    _clear(wave, at, length, table, (), ())
                wu = beside[group + w]
                vu = np.float32(1) - wu
                for p in range(cells[i, column, 0], cells[i, column, 0] + n_parts):
                    # The phase at the nearest depth's nearer column, and from there at the next.
                    c, d = cosines[item], sines[item]
                    if deeper:
                        c, d = c * waves[p, 3] + d * waves[p, 5], d * waves[p, 3] - c * waves[p, 5]
                    next_c = wu * (c * waves[p, 2] + d * waves[p, 4])
                    next_d = wu * (d * waves[p, 2] - c * waves[p, 4])
                    a = vu * c, vu * d, next_c, next_d
                    start = parts[p, 4]
                    o = parts[p, 2 * deeper] + start, parts[p, 2 * deeper + 1] + start
                    if n_parts == 1:
                        _interpolate(wave, at, length, table, o, a)
                    else:
                        first = at + start - cells[i, column, 2]
                        _add_interpolated(wave, first, parts[p, 5], table, o, a)
                    item += 1

            # Apart from the loop above, as a processor stalls where it reads what it has only just written.
            for w in range(n_waves):
                m, at = group + w, w * wave_length + SAMPLES
                start, length = cells[i, columns[m], 2], cells[i, columns[m], 3]
                first = (delay[m] >> PHASE_BITS) + start
                if first < 2 or first + length + N_FIR > n_total:
                    continue
                k, base = filters[m], heard[m] * N_PHASES * n_total
                to = base + (delay[m] & (N_PHASES - 1)) * n_total + first
                one = taps[iy, k, 2], taps[iy, k, 3]
                if n_taps[iy, k] == 1:
                    _add_one(sums, to, length, wave, (at,), one)
                    continue
                # Filtered waves begin one or two samples earlier.
                length += SAMPLES
                f = taps[iy, k, 0], taps[iy, k, 1], one[0], one[1], taps[iy, k, 4], taps[iy, k, 5]
                at3 = at, at - 1, at - 2
                _add_whole(sums, to - 1, length, wave, at3, f)
                if n_taps[iy, k] > 3:
                    later = delay[m] + N_PHASES // 2
                    to = base + (later & (N_PHASES - 1)) * n_total + (later >> PHASE_BITS) + start
                    g = (
                        taps[iy, k, 6], taps[iy, k, 7], taps[iy, k, 8], taps[iy, k, 9],
                        taps[iy, k, 10], taps[iy, k, 11], taps[iy, k, 12], taps[iy, k, 13],
                    )  # fmt: skip
                    at4 = at, at - 1, at - 2, at - 3
                    _add_half(sums, to - 2, length, wave, at4, g)


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
    """Windowed-sinc filters that delay by 0, 1, .. (n_phases - 1) parts of a sample, (n_phases, N_FIR)."""
    n = np.arange(N_FIR) - (N_FIR // 2 - 1)
    delays = np.arange(N_PHASES)[:, np.newaxis] / N_PHASES
    window = np.i0(5.0 * np.sqrt(np.maximum(0.0, 1.0 - np.square((n - delays) / (N_FIR / 2))))) / np.i0(5.0)
    filters = np.sinc(n - delays) * window
    return np.asarray(filters / filters.sum(axis=1, keepdims=True), dtype=np.float32)


@numba.njit(fastmath=FAST_MATH, nogil=True, error_model="numpy", cache=True)
def merge(sums, fir, margin, iq):
    """Delay every phase by its part of a sample and add them up: (n_lines, n_samples) complex64 in `iq`."""
    n_taps, n_samples = fir.shape[1], iq.shape[1]
    for line in range(iq.shape[0]):
        total = iq[line].view(np.float32)
        total[:] = 0
        for phase in range(fir.shape[0]):
            for tap in range(n_taps):
                weight = fir[phase, tap]
                first = margin - (tap - (n_taps // 2 - 1))
                source = sums[line, phase, first : first + n_samples].view(np.float32)
                for m in range(2 * n_samples):
                    total[m] += weight * source[m]
