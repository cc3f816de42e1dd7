"""One set of modules for each kind of scene.

The set of the kind `3d_sparse` is the package `hardspheres.kernel.3d_sparse`. It has the files of
`hardspheres.kernel`, and `flags` of its own. Relative imports stay inside it, also those of its rooms, so no
constant of another kind is ever seen.
"""

import importlib
import sys
import threading
import types
from pathlib import Path

__all__ = ["specialise"]

_KERNEL = Path(__file__).parent
# Threads that load different kernels at once would mix up their constants and caches.
_ONE_AT_A_TIME = threading.Lock()


def specialise(
    dim: int,
    walls: bool,
    sizes: bool,
    masses: bool,
    sparse: bool,
    grows: bool = False,
    flights: bool = False,
    gravity: bool = False,
    obstacles: bool = False,
    heat: bool = False,
    threads: bool = False,
) -> types.ModuleType:
    """Load the kernels for one kind of scene.

    Parameters
    ----------
    dim : int
        2 or 3.
    walls, sizes, masses : bool
        Whether some axis lies between walls, radii differ, masses differ.
    sparse : bool
        Windows in place of lists: the same trajectory, faster where the gas is dilute.
    grows : bool
        Radii grow linearly in time; with lists only.
    flights : bool
        Free flights are tallied and events can be logged; not with `grows`.
    gravity : bool
        All that move have the same acceleration; not with `grows`, and with `obstacles` not where `sparse`.
    obstacles : bool
        Some particles have infinite mass; with `masses` only, not with `grows`.
    heat : bool
        The heat flux is tallied; not with `grows`, `gravity` or `obstacles`.
    threads : bool
        Several threads are at work; not with `grows`.

    Returns
    -------
    module
        The module `loop`, or `threads.loop`, compiled, on first use, for these constants; the same module for
        the same constants.
    """
    tag = (
        f"{dim}d"
        + "_walls" * walls
        + "_sizes" * sizes
        + "_masses" * masses
        + "_sparse" * sparse
        + "_grows" * grows
        + "_flights" * flights
        + "_gravity" * gravity
        + "_obstacles" * obstacles
        + "_heat" * heat
        + "_threads" * threads
    )
    name = f"{__package__}.{tag}"
    with _ONE_AT_A_TIME:
        loop = f"{name}.threads.loop" if threads else f"{name}.loop"
        if loop not in sys.modules:
            from hardspheres.kernel_cache import cache_folder, cached_in

            package = types.ModuleType(name)
            package.__path__ = [str(_KERNEL)]
            flags = types.ModuleType(f"{name}.flags")
            vars(flags).update(DIM=dim, WALLS=walls, SIZES=sizes, MASSES=masses, SPARSE=sparse)
            vars(flags).update(GROWS=grows, FLIGHTS=flights, GRAVITY=gravity, OBSTACLES=obstacles, HEAT=heat)
            vars(flags).update(THREADS=threads)
            sys.modules[name] = package
            sys.modules[flags.__name__] = flags
            with cached_in(cache_folder(tag)):
                importlib.import_module(loop)
    return sys.modules[loop]
