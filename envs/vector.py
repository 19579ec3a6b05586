"""Weighted sums of a few complex sequences, eight float32 samples at a time, as vector instructions.

A loop over array slices would do, but its code first proves at run time, for every few samples, that source
and destination do not overlap; here they never do, and that proof cost more than the arithmetic.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8


def weighted_sum(n_terms: int, add: bool = True) -> Any:
    """Return a function for compiled code that sums `n_terms` weighted parts of a complex source.

    f(real, imag, first, n, source_real, source_imag, firsts, weights): n samples from `first` on, in whole
    vectors of LANES, become (or with `add`, are increased by) the sum over k of those of the source from
    firsts[k] on, times weights[2 k] + j weights[2 k + 1]. Nothing is checked: arrays are contiguous float32,
    tuples hold int64 and float32, indices are in range, source and destination apart.
    """

    @intrinsic
    def summed(
        typing_context: Any, real: Any, imag: Any, first: Any, n: Any, source_real: Any, source_imag: Any,
        firsts: Any, weights: Any,
    ) -> Any:  # fmt: skip
        indices, factors = types.UniTuple(types.int64, n_terms), types.UniTuple(types.float32, 2 * n_terms)
        signature = types.void(
            real, imag, types.int64, types.int64, source_real, source_imag, indices, factors
        )  # fmt: skip

        def codegen(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> Any:
            vector = ir.VectorType(ir.FloatType(), LANES)
            undefined = ir.Constant(vector, ir.Undefined)
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

            def start(array: int, index: Any) -> Any:
                data = context.make_array(sig.args[array])(context, builder, args[array]).data
                return builder.gep(data, [index])

            def at(pointer: Any, index: Any) -> Any:
                return builder.bitcast(builder.gep(pointer, [index]), vector.as_pointer())

            def everywhere(value: Any) -> Any:
                one = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
                return builder.shuffle_vector(one, undefined, zeros)

            flags = ("contract", "nsz")

            def fused(u: Any, v: Any, w: Any) -> Any:
                return builder.fadd(builder.fmul(u, v, flags=flags), w, flags=flags)

            targets = start(0, args[2]), start(1, args[2])
            sources = [
                [start(array, builder.extract_value(args[6], k)) for array in (4, 5)] for k in range(n_terms)
            ]
            factors = [everywhere(builder.extract_value(args[7], k)) for k in range(2 * n_terms)]
            nothing = ir.Constant(vector, [0.0] * LANES)
            whole = args[3].type
            with cgutils.for_range_slice(builder, whole(0), args[3], whole(LANES)) as (index, _):
                # Two sums of every second term: a processor waits less for the one before.
                sums = [[nothing, nothing], [nothing, nothing]]
                if add:
                    sums[0] = [builder.load(at(target, index), align=4) for target in targets]
                for k, source in enumerate(sources):
                    p, q = sums[k % 2]
                    g, h = (builder.load(at(pointer, index), align=4) for pointer in source)
                    a, b = factors[2 * k], factors[2 * k + 1]
                    sums[k % 2] = [fused(a, g, fused(builder.fneg(b), h, p)), fused(a, h, fused(b, g, q))]
                for target, one, other in zip(targets, *sums, strict=True):
                    total = builder.fadd(one, other, flags=("nsz",)) if n_terms > 1 else one
                    builder.store(total, at(target, index), align=4)
            return context.get_dummy_value()

        return signature, codegen

    return summed
