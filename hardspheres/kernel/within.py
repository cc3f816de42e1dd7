"""Which centres are within reach, sixteen in one step.

LLVM turns a loop over sixteen lanes into sixteen scalar steps before it could make vectors of them, so here the vectors are
written down. What is found goes into lists only, never into the trajectory.
"""

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .compiler import CHECKED, PURE_PYTHON
from .flags import DIM, SIZES
from .layout import CELL_COLUMNS, CELL_LANES

if PURE_PYTHON or CHECKED:

    @numba.njit
    def keep_within(target, kept, ids, k, places, c, stride, count, me, x, y, z, reach):
        """Append to the target the ids of those of the next sixteen lines that are within reach; returns how many."""
        found = 0
        limit = reach
        for lane in range(min(count, CELL_LANES)):
            dx = x - places[c + lane]
            dy = y - places[c + stride + lane]
            rr = dx * dx + dy * dy
            if DIM == 3:
                dz = z - places[c + 2 * stride + lane]
                rr += dz * dz
            if SIZES:
                limit = reach + places[c + DIM * stride + lane]
            if rr < limit * limit and ids[k + lane] != me:
                target[kept + found] = ids[k + lane]
                found += 1
        return found

    @numba.njit
    def copy_lines(target_ids, target, m, lines, ids, k, places, c, stride, x, y, z):
        """Copy sixteen lines of a cell to a table, as seen from a corner that is (x, y, z) away."""
        for lane in range(CELL_LANES):
            target_ids[m + lane] = ids[k + lane]
            for d in range(CELL_COLUMNS):
                shift = (x, y, z)[d] if d < DIM else 0.0
                target[d * lines + m + lane] = places[c + d * stride + lane] + shift

else:
    WORD, SHORT = ir.IntType(64), ir.IntType(32)
    FLOATS, SHORTS = ir.VectorType(ir.FloatType(), CELL_LANES), ir.VectorType(SHORT, CELL_LANES)
    IDS, PLACES, INTEGER, SINGLE = (
        types.CPointer(types.int32),
        types.CPointer(types.float32),
        types.int64,
        types.float32,
    )

    def place_of(builder, pointer, index, vector):
        """Return where sixteen elements stand."""
        return builder.bitcast(builder.gep(pointer, [index]), vector.as_pointer())

    def column_of(builder, places, c, stride, d):
        """Return where sixteen elements of one column stand."""
        return place_of(builder, places, builder.add(c, builder.mul(stride, WORD(d))), FLOATS)

    def everywhere(builder, value, vector):
        """Return a vector of one value."""
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, SHORT(0))
        return builder.shuffle_vector(one, one, ir.Constant(SHORTS, [0] * CELL_LANES))

    @intrinsic
    def keep_within(typingctx, target, kept, ids, k, places, c, stride, count, me, x, y, z, reach):
        """Append to the target the ids of those of the next sixteen lines that are within reach; returns how many.

        Lines from `count` on, and `me`, are passed over. Whatever stands in the sixteen elements of the target is lost.
        """

        def codegen(context, builder, signature, args):
            target, kept, ids, k, places, c, stride, count, me, x, y, z, reach = args
            rr = None
            for d, place in enumerate((x, y, z)[:DIM]):
                other = builder.load(column_of(builder, places, c, stride, d), align=4)
                off = builder.fsub(everywhere(builder, place, FLOATS), other)
                square = builder.fmul(off, off)
                rr = builder.fadd(rr, square) if rr else square
            limit = everywhere(builder, reach, FLOATS)
            if SIZES:
                limit = builder.fadd(limit, builder.load(column_of(builder, places, c, stride, DIM), align=4))
            near = builder.fcmp_ordered("<", rr, builder.fmul(limit, limit))
            names = builder.load(place_of(builder, ids, k, SHORTS), align=4)
            lanes = ir.Constant(SHORTS, list(range(CELL_LANES)))
            last = everywhere(builder, builder.trunc(count, SHORT), SHORTS)
            itself = everywhere(builder, builder.trunc(me, SHORT), SHORTS)
            meant = builder.and_(
                builder.icmp_signed("<", lanes, last), builder.icmp_signed("!=", names, itself)
            )
            chosen = builder.and_(near, meant)
            kind = ir.FunctionType(SHORTS, [SHORTS, chosen.type, SHORTS])
            name = f"llvm.experimental.vector.compress.v{CELL_LANES}i32"
            compress = cgutils.get_or_insert_function(builder.module, kind, name)
            closed = builder.call(compress, [names, chosen, ir.Constant(SHORTS, ir.Undefined)])
            builder.store(closed, place_of(builder, target, kept, SHORTS), align=4)
            return builder.zext(builder.ctpop(builder.bitcast(chosen, ir.IntType(CELL_LANES))), WORD)

        return INTEGER(IDS, INTEGER, IDS, INTEGER, PLACES, *[INTEGER] * 4, *[SINGLE] * 4), codegen

    @intrinsic
    def copy_lines(typingctx, target_ids, target, m, lines, ids, k, places, c, stride, x, y, z):
        """Copy sixteen lines of a cell to a table, as seen from a corner that is (x, y, z) away."""

        def codegen(context, builder, signature, args):
            target_ids, target, m, lines, ids, k, places, c, stride, *shifts = args
            names = builder.load(place_of(builder, ids, k, SHORTS), align=4)
            builder.store(names, place_of(builder, target_ids, m, SHORTS), align=4)
            for d in range(CELL_COLUMNS):
                column = builder.load(column_of(builder, places, c, stride, d), align=4)
                if d < DIM:
                    column = builder.fadd(column, everywhere(builder, shifts[d], FLOATS))
                builder.store(column, column_of(builder, target, m, lines, d), align=4)
            return context.get_dummy_value()

        return types.none(
            IDS, PLACES, INTEGER, INTEGER, IDS, INTEGER, PLACES, INTEGER, INTEGER, *[SINGLE] * 3
        ), codegen
