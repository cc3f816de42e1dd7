"""How kernels are compiled: strict arithmetic, raw pointers, and a disk cache that never serves a stale kernel."""

import contextlib
import getpass
import hashlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.extending import intrinsic

config: Any = numba.config
PURE_PYTHON = bool(config.DISABLE_JIT)

if PURE_PYTHON:

    def pointer(array):
        """In plain Python an array is its own pointer."""
        return array

else:

    @intrinsic
    def pointer(typingctx, array):
        """Return a raw pointer to the data of a contiguous array.

        Passing arrays between jitted functions counts references atomically, which costs a hard-sphere loop most of its
        speed. `p[i]` and `p[i] = x` work on the pointer as on the array, with no reference count, stride or wrap-around.
        The caller keeps the array alive.
        """

        def codegen(context, builder, signature, args):
            return context.make_array(signature.args[0])(context, builder, args[0]).data

        return types.CPointer(array.dtype)(array), codegen


def cache_folder(tag: str) -> Path | None:
    """Folder for the compiled kernels of one specialisation, or None where no folder can be written.

    Named by a digest of all sources that the kernels are compiled from: Numba looks only at the file of the outermost
    function, and would serve an old kernel after an edit of a function in another file.
    """
    here = Path(__file__).parent
    digest = hashlib.sha256(numba.__version__.encode())
    for source in [here.parent / "collision.py", here.parent / "growth.py", *sorted(here.glob("*.py"))]:
        digest.update(source.name.encode() + source.read_bytes())
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    roots = [
        Path(base) if base else Path.home() / ".cache",
        Path(tempfile.gettempdir()) / f"cache-{getpass.getuser()}",
    ]
    for root in roots:
        folder = root / "hardspheres" / digest.hexdigest()[:16] / tag
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return folder
    return None


@contextlib.contextmanager
def cached_in(folder: Path | None) -> Iterator[None]:
    """Kernels decorated inside are cached in this folder; Numba's process-wide setting is as before afterwards."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder or "")
    try:
        yield
    finally:
        config.CACHE_DIR = before


def jit(function):
    """Compile a part of a kernel: strict IEEE arithmetic, x/0 as in NumPy (checks would stop vectorisation)."""
    return numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


def inline(function):
    """Compile a part of a kernel into its callers: handing the record of pointers over costs more than a small function."""
    return numba.njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)(
        function
    )


def entry(function):
    """Compile a function that Python calls: cached on disk, and without the interpreter's lock."""
    return numba.njit(error_model="numpy", cache=not PURE_PYTHON and bool(config.CACHE_DIR), nogil=True)(
        function
    )
