"""The cutoff test: which particles of a table are within the cutoff, sixteen in one step.

It decides who enters a list, and is most of the work of a rebuild. LLVM turns a loop over so few lanes into
scalar steps before it could make vectors of them, so the vectors are written down here. What is found
goes into lists only, never into the trajectory.

Both functions work on columns that are `stride` apart: ids, positions, and radii where they differ. Ids are
integers in the same memory as the floats.
"""

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .. import layout as at
from ..flags import DIM, SIZES
from ..simd.jit import CHECKED, PURE_PYTHON

if PURE_PYTHON or CHECKED:

    @numba.njit
    def cutoff_test(target, kept, ids, table, k, stride, count, me, x, y, z, cutoff):
        """Append to the target the ids of those particles within the cutoff; returns how many."""
        found = 0
        limit = cutoff
        for line in range(k, k + min(count, at.CELL_LANES)):
            dx = x - table[line + stride]
            dy = y - table[line + 2 * stride]
            rr = dx * dx + dy * dy
            if DIM == 3:
                dz = z - table[line + 3 * stride]
                rr += dz * dz
            if SIZES:
                limit = cutoff + table[line + (1 + DIM) * stride]
            if rr < limit * limit and ids[line] != me:
                target[kept + found] = ids[line]
                found += 1
        return found

    @numba.njit
    def copy_columns(target_ids, target, m, wide, ids, table, k, stride, x, y, z):
        """Copy CELL_LANES particles to columns `wide` apart, seen from a corner that is (x, y, z) away."""
        for lane in range(at.CELL_LANES):
            target_ids[m + lane] = ids[k + lane]
            target[m + lane + wide] = table[k + lane + stride] + x
            target[m + lane + 2 * wide] = table[k + lane + 2 * stride] + y
            if DIM == 3:
                target[m + lane + 3 * wide] = table[k + lane + 3 * stride] + z
            if SIZES:
                target[m + lane + (1 + DIM) * wide] = table[k + lane + (1 + DIM) * stride]

else:
    WORD, SHORT = ir.IntType(64), ir.IntType(32)
    FLOATS, SHORTS = ir.VectorType(ir.FloatType(), at.CELL_LANES), ir.VectorType(SHORT, at.CELL_LANES)
    IDS, TABLE = types.CPointer(types.int32), types.CPointer(types.float32)

    def lanes_at(builder, pointer, index, vector):
        """Return where CELL_LANES elements stand."""
        return builder.bitcast(builder.gep(pointer, [index]), vector.as_pointer())

    def column(builder, table, k, stride, c):
        """Return where CELL_LANES elements of a column of floats stand."""
        return lanes_at(builder, table, builder.add(k, builder.mul(stride, WORD(c))), FLOATS)

    def everywhere(builder, value, vector):
        """Return a vector of one value."""
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), value, SHORT(0))
        return builder.shuffle_vector(one, one, ir.Constant(SHORTS, [0] * at.CELL_LANES))

    @intrinsic
    def cutoff_test(typingctx, target, kept, ids, table, k, stride, count, me, x, y, z, cutoff):
        """Append to the target the ids of those particles within the cutoff; returns how many.

        Particles from `count` on, and `me`, are passed over. CELL_LANES elements of the target are written.
        """

        def codegen(context, builder, signature, args):
            target, kept, ids, table, k, stride, count, me, x, y, z, cutoff = args
            rr = None
            for c, place in enumerate((x, y, z)[:DIM], 1):
                there = builder.load(column(builder, table, k, stride, c), align=4)
                off = builder.fsub(everywhere(builder, place, FLOATS), there)
                square = builder.fmul(off, off)
                rr = builder.fadd(rr, square) if rr else square
            limit = everywhere(builder, cutoff, FLOATS)
            if SIZES:
                radii = builder.load(column(builder, table, k, stride, 1 + DIM), align=4)
                limit = builder.fadd(limit, radii)
            names = builder.load(lanes_at(builder, ids, k, SHORTS), align=4)
            lanes = ir.Constant(SHORTS, list(range(at.CELL_LANES)))
            end = everywhere(builder, builder.trunc(count, SHORT), SHORTS)
            itself = everywhere(builder, builder.trunc(me, SHORT), SHORTS)
            chosen = builder.fcmp_ordered("<", rr, builder.fmul(limit, limit))
            chosen = builder.and_(chosen, builder.icmp_signed("<", lanes, end))
            chosen = builder.and_(chosen, builder.icmp_signed("!=", names, itself))
            kind = ir.FunctionType(SHORTS, [SHORTS, chosen.type, SHORTS])
            name = f"llvm.experimental.vector.compress.v{at.CELL_LANES}i32"
            compress = cgutils.get_or_insert_function(builder.module, kind, name)
            closed = builder.call(compress, [names, chosen, ir.Constant(SHORTS, ir.Undefined)])
            builder.store(closed, lanes_at(builder, target, kept, SHORTS), align=4)
            return builder.zext(builder.ctpop(builder.bitcast(chosen, ir.IntType(at.CELL_LANES))), WORD)

        integers, floats = [types.int64] * 4, [types.float32] * 4
        return types.int64(IDS, types.int64, IDS, TABLE, *integers, *floats), codegen

    @intrinsic
    def copy_columns(typingctx, target_ids, target, m, wide, ids, table, k, stride, x, y, z):
        """Copy CELL_LANES particles to columns `wide` apart, seen from a corner that is (x, y, z) away."""

        def codegen(context, builder, signature, args):
            target_ids, target, m, wide, ids, table, k, stride, *corner = args
            names = builder.load(lanes_at(builder, ids, k, SHORTS), align=4)
            builder.store(names, lanes_at(builder, target_ids, m, SHORTS), align=4)
            for c in range(1, at.CELL_COLUMNS):
                there = builder.load(column(builder, table, k, stride, c), align=4)
                if c <= DIM:
                    there = builder.fadd(there, everywhere(builder, corner[c - 1], FLOATS))
                builder.store(there, column(builder, target, m, wide, c), align=4)
            return context.get_dummy_value()

        integers, floats = [types.int64] * 2, [types.float32] * 3
        return types.none(IDS, TABLE, *integers, IDS, TABLE, *integers, *floats), codegen
