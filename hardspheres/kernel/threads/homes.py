"""Where particles are in windows of time: in which domain they may collide, and where their segments are.

A particle may collide in a domain if all cells that have had its segment in this window are inside that
domain: so its old segments, too, are seen there alone. One whose flight has several segments may not, but for
the last round.
"""

from .. import layout as at
from ..dilute.overflow import lists_before
from ..simd.jit import jit
from ..simd.pointers import int64

ANY_DOMAIN = (1 << at.ALL_TILES) - 1


@jit
def home_of(s, i):
    """Place of i's home; those with several segments share one, of tile 0."""
    slot = int64(s.where[i])
    return (slot if slot >= 0 else s.counter[at.SEGMENT_ROOM]) * at.HOME


@jit
def column_of_segment(s, slot):
    """Column of cells of a segment."""
    return int64(s.cell_of_segment[slot]) // s.counter[at.CELLS + 1]


@jit
def tile_of_segment(s, slot):
    """Tile of a segment."""
    return int64(s.tile_of_column[column_of_segment(s, slot)])


@jit
def list_of_segment(s, slot):
    """Which overflow list belongs to the cell of a segment."""
    column = column_of_segment(s, slot)
    y = int64(s.cell_of_segment[slot]) - column * s.counter[at.CELLS + 1]
    return lists_before(s, column) + y // at.CELLS_OF_OVERFLOW


@jit
def come_back(s, slot):
    """Note that a new segment has the old place."""
    s.home[slot * at.HOME + at.HOME_LIST] = list_of_segment(s, slot)


@jit
def move_home(s, i, new, several):
    """Note that i has a new segment in an overflow list, perhaps one of several."""
    if s.where[i] < 0:
        return
    home = home_of(s, i)
    inside = 0 if several else int64(s.inside_in[column_of_segment(s, new)])
    s.home[home] &= inside | ~ANY_DOMAIN
    s.home[home + at.HOME_LIST] = list_of_segment(s, new)
