"""Vector instructions that LLVM does not find by itself, each with its equivalent in plain Python.

They move and compare bits, decide what is looked at more closely, and add to tallies; none of them computes a
number that enters the trajectory. Each intrinsic writes LLVM's own vector operations, which every processor
has in some form; where one has no such instruction LLVM makes it of several.
"""

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hardspheres import sums

from .jit import CHECKED, PURE_PYTHON

AT_ONCE = 16  # what `keep_overlapping` and `alike` compare


if PURE_PYTHON or CHECKED:
    split, merged = numba.njit(sums.split), numba.njit(sums.merged)

    @numba.njit
    def add_terms(array, first, gap, terms):
        """Add terms to sums from `first` on, one by one; see `hardspheres.sums`."""
        for n in range(len(terms)):
            k = first + n
            whole, fraction = split(terms[n])
            array[k], array[k + gap] = merged(array[k], array[k + gap], whole, fraction)

    @numba.njit
    def gather_transposed(target, k, stride, source, ids, entry):
        """Copy 8 rows of 8 numbers to 8 columns, one by one."""
        for line in range(8):
            for column in range(8):
                target[column * stride + k + line] = source[8 * ids[entry + line] + column]

    @numba.njit
    def store_transposed(target, k, source, m):
        """Copy 8 columns of 8 numbers to 8 rows in single precision, one by one."""
        for line in range(8):
            for column in range(8):
                target[k + 8 * line + column] = source[m + 8 * column + line]

    @numba.njit
    def alike(values, k, wanted, ignored):
        """Return which of 16 integers, a bit of the result each, are the one wanted but for bits ignored."""
        found = 0
        for lane in range(AT_ONCE):
            found |= int((values[k + lane] | ignored) == (wanted | ignored)) << lane
        return found

    @numba.njit
    def copy_lanes(target, k, source, m):
        """Copy 8 elements, one by one."""
        for lane in range(8):
            target[k + lane] = source[m + lane]

    @numba.njit
    def keep_overlapping(kept, to, m, word, own, those, first, last, shift):
        """Append which from `first` to `last`, at most 16, have boxes that overlap `word`, and `own`."""
        for j in range(first, min(first + AT_ONCE, last)):
            overlap = True
            for lane in range(6):
                mine, other = word >> 8 * ((lane + 3) % 6), those[j] >> 8 * lane
                overlap = overlap and (((shift >> 8 * lane) - mine - other) & 255) < 128
            kept[m], to[m] = j, own
            m += 1 if overlap else 0
        return m

    @numba.njit
    def keep_marked(kept, m, first, last, marks):
        """Append to `kept` the numbers from `first` to `last`, at most 8, that have a bit in `marks`."""
        for lane in range(min(8, last - first)):
            kept[m] = first + lane
            m += (marks >> lane) & 1
        return m

else:

    def _constant(element, numbers):
        return ir.Constant(ir.VectorType(element, len(numbers)), numbers)

    def _turned(builder, lines):
        """Transpose 8 vectors of 8: in three steps, each of which exchanges halves of pairs of vectors."""
        for step in (1, 2, 4):
            low = [j if j & step == 0 else j - step + 8 for j in range(8)]
            high = [j + step if j & step == 0 else j + 8 for j in range(8)]
            masks = [_constant(ir.IntType(32), mask) for mask in (low, high)]
            for a in range(8):
                if a & step == 0:
                    pair = lines[a], lines[a + step]
                    lines[a], lines[a + step] = (builder.shuffle_vector(*pair, mask) for mask in masks)
        return lines

    class _Lanes:
        """A vector of float64, for functions that add and subtract."""

        def __init__(self, builder, value):
            self.builder, self.value = builder, value

        def _with(self, other):
            if isinstance(other, _Lanes):
                return other.value
            return _constant(self.value.type.element, [other] * self.value.type.count)

        def __add__(self, other):
            return _Lanes(self.builder, self.builder.fadd(self.value, self._with(other)))

        def __sub__(self, other):
            return _Lanes(self.builder, self.builder.fsub(self.value, self._with(other)))

    @intrinsic
    def add_terms(typingctx, array, first, gap, terms):
        """Add a tuple of terms to as many sums from `first` on, as one vector; see `hardspheres.sums`."""

        def codegen(context, builder, signature, args):
            array, first, gap, terms = args
            vector = ir.VectorType(ir.DoubleType(), signature.args[3].count)
            term = ir.Constant(vector, ir.Undefined)
            for k in range(vector.count):
                term = builder.insert_element(term, builder.extract_value(terms, k), ir.IntType(32)(k))
            places = [
                builder.bitcast(builder.gep(array, [k]), vector.as_pointer())
                for k in (first, builder.add(first, gap))
            ]
            there = (_Lanes(builder, builder.load(place, align=8)) for place in places)
            added = sums.merged(*there, *sums.split(_Lanes(builder, term)))
            for place, lanes in zip(places, added, strict=True):
                builder.store(lanes.value, place, align=8)
            return context.get_dummy_value()

        return types.none(array, types.int64, types.int64, terms), codegen

    @intrinsic
    def store_transposed(typingctx, target, k, source, m):
        """Copy 8 columns of 8 float64, one behind the other, to 8 rows of 8 float32, turned in registers."""

        def codegen(context, builder, signature, args):
            target, k, source, m = args
            double, single = ir.VectorType(ir.DoubleType(), 8), ir.VectorType(ir.FloatType(), 8)
            lines = []
            for column in range(8):
                where = builder.gep(source, [builder.add(m, ir.IntType(64)(8 * column))])
                whole = builder.load(builder.bitcast(where, double.as_pointer()), align=8)
                lines.append(builder.fptrunc(whole, single))
            for row, line in enumerate(_turned(builder, lines)):
                where = builder.gep(target, [builder.add(k, ir.IntType(64)(8 * row))])
                builder.store(line, builder.bitcast(where, single.as_pointer()), align=4)
            return context.get_dummy_value()

        return types.none(target, types.int64, source, types.int64), codegen

    @intrinsic
    def gather_transposed(typingctx, target, k, stride, source, ids, entry):
        """Copy 8 rows of 8 numbers, which `ids` names from `entry` on, to 8 columns `stride` apart.

        The square is turned in registers.
        """

        def codegen(context, builder, signature, args):
            target, k, stride, source, ids, entry = args
            vector = ir.VectorType(context.get_data_type(signature.args[3].dtype), 8)
            size = context.get_abi_sizeof(vector.element)
            word = ir.IntType(64)
            lines = []
            for line in range(8):
                name = builder.load(builder.gep(ids, [builder.add(entry, word(line))]))
                row = builder.mul(builder.sext(name, word), word(8))
                lines.append(
                    builder.load(builder.bitcast(builder.gep(source, [row]), vector.as_pointer()), align=size)
                )
            for column, line in enumerate(_turned(builder, lines)):
                place = builder.add(k, builder.mul(stride, word(column)))
                where = builder.bitcast(builder.gep(target, [place]), vector.as_pointer())
                builder.store(line, where, align=size)
            return context.get_dummy_value()

        return types.none(target, types.int64, types.int64, source, ids, types.int64), codegen

    @intrinsic
    def alike(typingctx, values, k, wanted, ignored):
        """Return which of 16 integers, a bit of the result each, are the one wanted but for bits ignored."""

        def codegen(context, builder, signature, args):
            values, k, wanted, ignored = args
            word = ir.IntType(64)
            vector = ir.VectorType(word, AT_ONCE)
            there = builder.load(builder.bitcast(builder.gep(values, [k]), vector.as_pointer()), align=8)
            there = builder.or_(there, _spread(builder, ignored, AT_ONCE))
            found = builder.icmp_signed("==", there, _spread(builder, builder.or_(wanted, ignored), AT_ONCE))
            return builder.zext(builder.bitcast(found, ir.IntType(AT_ONCE)), word)

        return types.int64(values, types.int64, types.int64, types.int64), codegen

    @intrinsic
    def copy_lanes(typingctx, target, k, source, m):
        """Copy 8 elements as one vector; arrays may begin anywhere, but must not overlap."""

        def codegen(context, builder, signature, args):
            element = context.get_data_type(source.dtype)
            vector = ir.VectorType(element, 8).as_pointer()
            size = context.get_abi_sizeof(element)
            whole = builder.load(builder.bitcast(builder.gep(args[2], [args[3]]), vector), align=size)
            builder.store(whole, builder.bitcast(builder.gep(args[0], [args[1]]), vector), align=size)
            return context.get_dummy_value()

        return types.none(target, types.int64, source, types.int64), codegen

    def _spread(builder, x, lanes):
        """Return a vector with x in all lanes."""
        one = builder.insert_element(
            ir.Constant(ir.VectorType(x.type, lanes), ir.Undefined), x, ir.IntType(32)(0)
        )
        return builder.shuffle_vector(one, one, _constant(ir.IntType(32), [0] * lanes))

    def _call(builder, name, result, *values):
        kind = ir.FunctionType(result, [v.type for v in values])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)

    def _append(builder, array, m, first, last, chosen):
        """Store those of first, first + 1, ... that are below last and chosen; returns how many."""
        lanes, word, long = chosen.type.count, ir.IntType(32), ir.IntType(64)
        numbers = builder.add(
            _spread(builder, builder.trunc(first, word), lanes), _constant(word, list(range(lanes)))
        )
        inside = builder.icmp_signed("<", numbers, _spread(builder, builder.trunc(last, word), lanes))
        chosen = builder.and_(chosen, inside)
        # The chosen lanes move to the front, and all lanes are stored: the next call overwrites the rest.
        name = f"llvm.experimental.vector.compress.v{lanes}i32"
        some = _call(builder, name, numbers.type, numbers, chosen, _constant(word, [0] * lanes))
        builder.store(some, builder.bitcast(builder.gep(array, [m]), some.type.as_pointer()), align=4)
        count = builder.zext(builder.bitcast(chosen, ir.IntType(lanes)), long)
        return builder.add(m, _call(builder, "llvm.ctpop.i64", long, count))

    @intrinsic
    def keep_overlapping(typingctx, kept, to, m, word, own, those, first, last, shift):
        """Append which from `first` to `last`, at most 16, have boxes that overlap `word`, and `own`.

        Returns how many `kept` has. Boxes are 6 bytes, see `layout`; `shift` is that of the image in which
        `word` is seen. No branch depends on it.
        """

        def codegen(context, builder, signature, args):
            kept, to, m, word, own, those, first, last, shift = args
            byte, int32, int64 = (ir.IntType(k) for k in (8, 32, 64))
            words = ir.VectorType(int64, AT_ONCE)
            eight, all_bytes = ir.VectorType(byte, 8), ir.VectorType(byte, 8 * AT_ONCE)
            ends = builder.bitcast(word, eight)
            ends = builder.shuffle_vector(
                ends, _constant(byte, [0] * 8), _constant(int32, [3, 4, 5, 0, 1, 2, 8, 8])
            )
            ends = builder.sub(builder.bitcast(shift, eight), ends)
            ends = builder.bitcast(_spread(builder, builder.bitcast(ends, int64), AT_ONCE), all_bytes)
            others = builder.load(builder.bitcast(builder.gep(those, [first]), words.as_pointer()), align=8)
            gap = builder.bitcast(builder.sub(ends, builder.bitcast(others, all_bytes)), words)
            # Boxes overlap where no gap, of the six of each, has its sign bit set.
            signs = _constant(int64, [0x808080808080] * AT_ONCE)
            overlap = builder.icmp_signed("==", builder.and_(gap, signs), _constant(int64, [0] * AT_ONCE))
            mine = _spread(builder, builder.trunc(own, int32), AT_ONCE)
            builder.store(mine, builder.bitcast(builder.gep(to, [m]), mine.type.as_pointer()), align=4)
            return _append(builder, kept, m, first, last, overlap)

        integer = types.int64
        return integer(kept, to, integer, integer, integer, those, integer, integer, integer), codegen

    @intrinsic
    def keep_marked(typingctx, kept, m, first, last, marks):
        """Append to `kept` the numbers from `first` to `last`, at most 8, that have a bit in `marks`."""

        def codegen(context, builder, signature, args):
            kept, m, first, last, marks = args
            chosen = builder.bitcast(builder.trunc(marks, ir.IntType(8)), ir.VectorType(ir.IntType(1), 8))
            return _append(builder, kept, m, first, last, chosen)

        integer = types.int64
        return integer(kept, integer, integer, integer, integer), codegen
