"""Numbers that several threads write to, and giving the processor away."""

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from .jit import CHECKED, PURE_PYTHON

if PURE_PYTHON or CHECKED:  # one thread only

    @numba.njit
    def atomic_add(array, k, x):
        """Add to an element; returns what it was."""
        before = array[k]
        array[k] = before + x
        return before

    @numba.njit
    def atomic_load(array, k):
        """Read an element, and all that was written before it."""
        return array[k]

    @numba.njit
    def atomic_store(array, k, x):
        """Write an element after all that was written before."""
        array[k] = x

    @numba.njit
    def give_way():
        """Nobody else is at work."""

else:

    @intrinsic
    def atomic_add(typingctx, array, k, x):
        """Add to an element; returns what it was."""

        def codegen(context, builder, signature, args):
            return builder.atomic_rmw("add", builder.gep(args[0], [args[1]]), args[2], "seq_cst")

        return types.int64(array, types.int64, types.int64), codegen

    @intrinsic
    def atomic_load(typingctx, array, k):
        """Read an element, and all that was written before it."""

        def codegen(context, builder, signature, args):
            return builder.load_atomic(builder.gep(args[0], [args[1]]), "acquire", 8)

        return types.int64(array, types.int64), codegen

    @intrinsic
    def atomic_store(typingctx, array, k, x):
        """Write an element after all that was written before."""

        def codegen(context, builder, signature, args):
            builder.store_atomic(args[2], builder.gep(args[0], [args[1]]), "release", 8)
            return context.get_dummy_value()

        return types.none(array, types.int64, types.int64), codegen

    @intrinsic
    def give_way(typingctx):
        """Let another thread have this core, if one waits for it."""

        def codegen(context, builder, signature, args):
            kind = ir.FunctionType(ir.IntType(32), [])
            found = builder.module.globals.get("sched_yield") or ir.Function(
                builder.module, kind, "sched_yield"
            )
            builder.call(found, [])
            return context.get_dummy_value()

        return types.none(), codegen
