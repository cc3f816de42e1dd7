"""How kernels are compiled: strict arithmetic; `hardspheres.kernel_cache` says where they are cached.

Two variables of the environment, Numba's own, give kernels for examination. ``NUMBA_DISABLE_JIT=1`` runs the
same source as plain Python, on arrays in place of pointers. ``NUMBA_BOUNDSCHECK=1`` also has arrays in place
of pointers, and every access checked: in plain Python negative indices are refused too; compiled (which then
takes minutes and is never cached) only those beyond an end.
"""

from typing import Any

import numba

from .parts import part

config: Any = numba.config
PURE_PYTHON = bool(config.DISABLE_JIT)
CHECKED = bool(config.BOUNDSCHECK)


def jit(function):
    """Compile a function into its callers.

    Strict IEEE arithmetic, x/0 as in NumPy (checks would stop vectorisation).
    """
    return function if PURE_PYTHON else part(function, error_model="numpy", forceinline=True)


def fast_arithmetic(function):
    """As `jit` for what never enters the trajectory: products and sums may be fused.

    Their rounding depends on the machine.
    """
    if PURE_PYTHON:
        return function
    return part(function, error_model="numpy", forceinline=True, fastmath={"contract"})


def called(function):
    """Compile a large part that is called rarely as a function of its own: it saves compilation time."""
    return function if PURE_PYTHON else part(function, error_model="numpy")


def entry_point(function):
    """Compile a function that Python calls: cached on disk, and without the interpreter's lock."""
    return numba.njit(error_model="numpy", cache=not PURE_PYTHON and bool(config.CACHE_DIR), nogil=True)(
        function
    )
