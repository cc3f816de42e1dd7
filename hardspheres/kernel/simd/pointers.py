"""Raw pointers in place of arrays, prefetching, and numbers as bits."""

import struct
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hardspheres.kernel.addresses import addresses, pointers_at
from hardspheres.kernel.arrays import Arrays

from .jit import CHECKED, PURE_PYTHON, jit


class BoundsChecked:
    """An array that refuses every index outside of it; NumPy would count negative ones from its end."""

    __slots__ = ("array",)

    def __init__(self, array):
        self.array = array

    def _inside(self, k):
        if not 0 <= k < len(self.array):
            raise IndexError(f"index {k} is outside of an array of {len(self.array)}")
        return k

    def __getitem__(self, k):
        return self.array[self._inside(k)]

    def __setitem__(self, k, value):
        self.array[self._inside(k)] = value


# `int` leaves numbers of 32 bits as they are, and a 0 a constant: a function is then compiled once more for
# each mix of them.
int64: Any = int if PURE_PYTHON else np.int64

if PURE_PYTHON:

    def pointer(array):
        """In plain Python an array is its own pointer."""
        return BoundsChecked(array) if CHECKED else array

    def prefetch(array, k):
        """In plain Python: nothing."""

    def bits(x):
        """Return the bits of a float64 as int64."""
        return struct.unpack("q", struct.pack("d", x))[0]

    def from_bits(k):
        """Return the float64 that has these bits."""
        return struct.unpack("d", struct.pack("q", k))[0]

else:

    @intrinsic
    def pointer(typingctx, array):
        """Return a raw pointer to the data of a contiguous array.

        Passing arrays between jitted functions counts references atomically, which costs a hard-sphere loop
        most of its speed. `p[i]` and `p[i] = x` work on the pointer as on the array, with no reference count,
        stride or wrap-around. The caller keeps the array alive.
        """

        def codegen(context, builder, signature, args):
            return context.make_array(signature.args[0])(context, builder, args[0]).data

        return types.CPointer(array.dtype)(array), codegen

    @intrinsic
    def prefetch(typingctx, pointer, k):
        """Bring the cache line of pointer[k] nearer; any k will do, it is never read."""

        def codegen(context, builder, signature, args):
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            where = builder.bitcast(builder.gep(args[0], [args[1]]), byte)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            hint = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            builder.call(hint, [where, word(0), word(3), word(1)])
            return context.get_dummy_value()

        return types.none(pointer, types.int64), codegen

    if CHECKED:

        @numba.njit
        def pointer(array):
            """With checks an array is its own pointer."""
            return array

        @numba.njit
        def prefetch(array, k):
            """With checks: nothing."""

    @intrinsic
    def bits(typingctx, x):
        """Return the bits of a float64 as int64."""

        def codegen(context, builder, signature, args):
            return builder.bitcast(args[0], context.get_value_type(types.int64))

        return types.int64(types.float64), codegen

    @intrinsic
    def from_bits(typingctx, k):
        """Return the float64 that has these bits."""

        def codegen(context, builder, signature, args):
            return builder.bitcast(args[0], context.get_value_type(types.float64))

        return types.float64(types.int64), codegen


if PURE_PYTHON or CHECKED:

    def handed_over(arrays):
        """Return what a kernel takes: the record of arrays as it is."""
        return Arrays(*map(pointer, arrays)) if PURE_PYTHON else arrays

    @jit
    def pointers(arrays):
        """With checks, and in plain Python, arrays are their own pointers."""
        return arrays

else:
    handed_over, pointers = addresses, pointers_at
