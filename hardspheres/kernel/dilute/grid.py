"""The geometry of the window method's grid: cells, columns of cells, and which of them are near a segment."""

from .. import layout as at
from ..flags import DIM
from ..simd.jit import jit


@jit
def cell_at(s, x, y, z):
    """Index of a cell; y runs fastest, so that a column of cells stands together."""
    return column_at(s, x, z) * s.counter[at.CELLS + 1] + y


@jit
def column_at(s, x, z):
    """Index of a column of cells."""
    return x * s.counter[at.CELLS + 2] + z


@jit
def signed(difference):
    """Return a difference of box ends in units, without whole turns of 256."""
    return ((difference + 128) & at.BYTE) - 128


@jit
def cells_along_y(s, near, y):
    """First and last cell along y with segments that may overlap a segment of cell y."""
    return y - (near >> at.BEFORE_Y & 3), y + (near >> at.AFTER_Y & 3)


@jit
def place_of_column(s, x, z):
    """Where the table of columns has a column that may lie one cell beyond the box."""
    return (x + 1) * (s.counter[at.CELLS + 2] + 2) + z + 1


@jit
def cell_place(s, cell):
    """Return x, y, z of a cell."""
    column = cell // s.counter[at.CELLS + 1]
    x = column // s.counter[at.CELLS + 2]
    return x, cell - column * s.counter[at.CELLS + 1], column - x * s.counter[at.CELLS + 2]


@jit
def note_place(s, k, place, noted):
    """Note a place in the table of columns, if it is asked for; returns how many there are."""
    s.places[k] = place
    return k + (1 if noted != 0 else 0)


@jit
def columns_around(s, begin, near, x, z):
    """Note, from `begin` on, the columns with segments that may overlap one of this; returns the end."""
    layer = s.counter[at.CELLS + 2] + 2
    k = begin
    for ox in range(-1, 2):
        along_x = (
            1
            if ox == 0
            else ((near & at.BEFORE_X) // at.BEFORE_X if ox < 0 else (near & at.AFTER_X) // at.AFTER_X)
        )
        place = place_of_column(s, x, z) + ox * layer
        if DIM == 3:
            k = note_place(s, k, place - 1, along_x & (near & at.BEFORE_Z) // at.BEFORE_Z)
            k = note_place(s, k, place + 1, along_x & (near & at.AFTER_Z) // at.AFTER_Z)
        k = note_place(s, k, place, along_x)
    return k


@jit
def columns_after(s, near, x, z):
    """Note this column and those behind it with segments that may overlap its own; returns how many."""
    layer = s.counter[at.CELLS + 2] + 2
    own = place_of_column(s, x, z)
    right = (near & at.AFTER_X) // at.AFTER_X
    k = note_place(s, 0, own, 1)
    if DIM == 2:
        return note_place(s, k, own + layer, right)
    before, after = (near & at.BEFORE_Z) // at.BEFORE_Z, (near & at.AFTER_Z) // at.AFTER_Z
    k = note_place(s, k, own + 1, after)
    k = note_place(s, k, own + layer, right)
    k = note_place(s, k, own + layer - 1, right & before)
    return note_place(s, k, own + layer + 1, right & after)


@jit
def fits(s, word, cell, cx, cy, cz):
    """Whether a segment with this box and its middle in (cx, cy, cz) overhangs a cell by at most OVERHANG.

    What lies further away than one cell, along y than two, does not, even if whole turns of 256 make it seem
    so.
    """
    x, y, z = cell_place(s, cell)
    inside = (abs(cx - x) <= 1) & (abs(cy - y) <= 2) & (abs(cz - z) <= 1)
    for d in range(DIM):
        place = x if d == 0 else (y if d == 1 else z)
        beyond = s.counter[at.OVERHANG + d]
        low = signed((word >> 8 * d) - place * s.counter[at.WIDTH + d])
        length = (-(word >> 8 * (d + 3)) - (word >> 8 * d)) & at.BYTE
        inside &= (low >= -beyond) & (low + length <= s.counter[at.WIDTH + d] + beyond)
    return inside
