"""How often the row of a particle has changed through events: what is known of another row does not hold."""

from .. import layout as at
from ..simd.jit import jit
from ..simd.pointers import prefetch


@jit
def version_of(s, i):
    """Version of row i."""
    if at.VERSION_IN_ROW:
        return s.row_int[i * at.ROW + at.VERSION]
    return s.version[i]


@jit
def raise_version(s, i):
    """Note that row i has changed."""
    if at.VERSION_IN_ROW:
        s.row_int[i * at.ROW + at.VERSION] += 1
    else:
        s.version[i] += 1


@jit
def prefetch_version(s, i):
    """Prefetch the version of row i, but for those that are in their rows."""
    if not at.VERSION_IN_ROW:
        prefetch(s.version, i)
