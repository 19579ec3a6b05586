"""Complex multiply-add of eight float32 samples as vector instructions.

A loop over array slices would do, but its code first proves at run time, for every few samples, that source
and destination do not overlap; here they never do, and that proof cost more than the arithmetic.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

LANES = 8


@intrinsic
def add_product(
    typing_context: Any,
    real: Any,
    imag: Any,
    first: Any,
    source_real: Any,
    source_imag: Any,
    source_first: Any,
    a: Any,
    b: Any,
) -> Any:
    """Add (a + jb) times LANES samples of the source to those of real + j imag, from their first indices on.

    Nothing is checked: arrays are contiguous float32, indices in range, source and destination apart.
    """
    signature = types.void(
        real, imag, types.int64, source_real, source_imag, types.int64, types.float32, types.float32
    )

    def codegen(context: Any, builder: ir.IRBuilder, sig: Any, args: Any) -> Any:
        vector = ir.VectorType(ir.FloatType(), LANES)
        undefined = ir.Constant(vector, ir.Undefined)
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)

        def pointer(array: int, index: int) -> Any:
            data = context.make_array(sig.args[array])(context, builder, args[array]).data
            return builder.bitcast(builder.gep(data, [args[index]]), vector.as_pointer())

        def everywhere(value: Any) -> Any:
            one = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
            return builder.shuffle_vector(one, undefined, zeros)

        def fused(u: Any, v: Any, w: Any) -> Any:
            return builder.fadd(builder.fmul(u, v, flags=("contract",)), w, flags=("contract",))

        targets = pointer(0, 2), pointer(1, 2)
        g, h = (builder.load(pointer(array, 5), align=4) for array in (3, 4))
        p, q = (builder.load(target, align=4) for target in targets)
        weight, turned = everywhere(args[6]), everywhere(args[7])
        p = fused(weight, g, fused(builder.fneg(turned), h, p))
        q = fused(weight, h, fused(turned, g, q))
        builder.store(p, targets[0], align=4)
        builder.store(q, targets[1], align=4)
        return context.get_dummy_value()

    return signature, codegen
