"""Weighted sums of a few complex sequences, four complex64 samples at a time, as vector instructions.

A loop over array slices would do, but its code first proves at run time, for every few samples, that source
and destination do not overlap; here they never do, and that proof cost more than the arithmetic.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8  # float32 in a vector
SAMPLES = LANES // 2  # complex64 in a vector
ALTERNATE = [lane + lane % 2 * LANES for lane in range(LANES)]  # of two vectors in turn


def weighted_sum(n_terms: int, add: bool = True) -> Any:
    """Return a function for compiled code that sums `n_terms` weighted parts of a complex source.

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
