"""How kernels are compiled: strict arithmetic; `hardspheres.kernel_cache` says where they are cached.

Two variables of the environment, Numba's own, give kernels for examination. ``NUMBA_DISABLE_JIT=1`` runs the
same source as plain Python, on arrays in place of pointers. ``NUMBA_BOUNDSCHECK=1`` also has arrays in place
of pointers, and every access checked: in plain Python negative indices are refused too; compiled (which then
takes minutes and is never cached) only those beyond an end.
"""

from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

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


class _Kernels(FunctionCache):
    """A kernel's files: one is loaded without the libraries that Numba needs to compile one (0.2 s)."""

    def load_overload(self, sig, target_context):
        """Return what was compiled for these types, None if nothing was: then Numba loads its libraries."""
        rtsys.initialize(target_context)  # what kernels are linked to
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def entry_point(function):
    """Compile a function that Python calls: cached on disk, and without the interpreter's lock."""
    kernel = numba.njit(error_model="numpy", nogil=True)(function)
    if not PURE_PYTHON and config.CACHE_DIR:
        kernel._cache = _Kernels(function)
    return kernel
