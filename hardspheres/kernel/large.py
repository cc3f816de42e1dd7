"""Large particles among many small ones, in the window method: cells sized by the small, and a second grid for the large.

With cells as wide as the largest diameter each small particle would meet hundreds of others at every comparison. So the rows
hold the lines of the small particles only. A large one (radius above SMALL_RADIUS) is compared with all rows within its reach,
and its line hangs in the one cell of a coarse grid that holds its middle. A small one looks, beside the rows around it, at the
coarse cells within its own reach; they are few and mostly empty. Lines, filter and chains are those of `lines` and `chains`: the
heads of the coarse cells' chains follow those of the rows.
"""

import math

import numpy as np

from .chains import chain_draft, meet_chain, unchain
from .compiler import jit
from .flags import DIM, SIZES
from .layout import (
    BOX,
    CELL_DENSITY,
    CELLS,
    INVERSE,
    LARGE,
    LARGE_CELLS,
    LARGE_DENSITY,
    LARGEST,
    LINE_ROOM,
    LINE_UNIT,
    RADIUS,
    ROW,
    SMALL_RADIUS,
    STRETCH,
    T,
    V,
    X,
)
from .lines import ZERO, meet_run, shifted
from .rows import around, row_at

ROUNDED_UP = 1.001  # spans are this much wider than they must be


@jit
def is_large(s, i):
    """Whether i is too large for the rows."""
    return SIZES and s.row[i * ROW + RADIUS] > s.number[SMALL_RADIUS]


@jit
def span(s, i, t, d, reach, cells, density):
    """First and last cell of a grid along axis d within reach of i at time t; on periodic axes they may lie beyond the box."""
    x = s.row[i * ROW + X + d] + s.row[i * ROW + V + d] * (t - s.row[i * ROW + T])
    inside = s.number[BOX + d] * math.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls
    first = math.floor((x - inside - reach) * s.number[density + d])
    last = math.floor((x - inside + reach) * s.number[density + d])
    most = s.counter[cells + d]
    if s.number[INVERSE + d] == 0.0:
        return int(min(max(first, 0), most - 1)), int(max(min(last, most - 1), 0))
    return int(max(first, -most)), int(min(last, 2 * most - 1))


@jit
def shifted_along_z(line, sz):
    """Return the same line in another image."""
    x, y, z, u, v, w, reach = line
    return x, y, z + sz, u, v, w, reach


@jit
def meet_small(s, i, other, line, t, since):
    """Compare the line of a large particle, as registered at time t, with those of all small ones within reach."""
    reach = (s.row[i * ROW + RADIUS] + s.number[SMALL_RADIUS] + 2.0 * s.number[STRETCH]) * ROUNDED_UP
    nz = s.counter[CELLS + 2]
    first_x, last_x = span(s, i, t, 0, reach, CELLS, CELL_DENSITY)
    first_y, last_y = span(s, i, t, 1, reach, CELLS, CELL_DENSITY)
    first_z, last_z = 0, 0
    if DIM == 3:
        first_z, last_z = span(s, i, t, 2, reach, CELLS, CELL_DENSITY)
    for kx in range(first_x, last_x + 1):
        x, sx = around(s, kx, 0, CELLS)
        for kz in range(first_z + 1, last_z + 2, 3):  # a row holds the cells above and below it, too
            z, sz = nz - 1, ZERO
            if kz < nz or s.number[INVERSE + 2] > 0.0:
                z, sz = around(s, kz, 2, CELLS)
            seen = shifted_along_z(shifted(line, -sx, ZERO), -sz)
            meet_along_y(s, row_at(s, x, 0, z), first_y, last_y, i, other, seen, since)


@jit
def meet_along_y(s, row, first, last, i, other, line, since):
    """Compare i's line with the rows from `first` to `last`, which may lie beyond the box, and with their chains."""
    ny = s.counter[CELLS + 1]
    length = np.float32(s.number[BOX + 1] * s.number[LINE_UNIT])
    for turn in range(-1, 2):
        begin, end = row + max(first - turn * ny, 0), row + min(last - turn * ny, ny - 1) + 1
        if begin < end:
            seen = shifted(line, ZERO, -length * np.float32(turn))
            room = s.counter[LINE_ROOM]
            meet_run(s, room, s.row_start[begin], s.row_start[end], i, other, seen, since)
            for beside in range(begin, end):
                meet_chain(s, beside, i, seen, since)


@jit
def meet_large(s, i, line, t, since):
    """Compare any line, as registered at time t, with those of the large particles within reach."""
    if s.counter[LARGE] == 0:
        return
    reach = (s.row[i * ROW + RADIUS] + s.number[LARGEST] + 2.0 * s.number[STRETCH]) * ROUNDED_UP
    first_x, last_x = span(s, i, t, 0, reach, LARGE_CELLS, LARGE_DENSITY)
    first_y, last_y = span(s, i, t, 1, reach, LARGE_CELLS, LARGE_DENSITY)
    first_z, last_z = 0, 0
    if DIM == 3:
        first_z, last_z = span(s, i, t, 2, reach, LARGE_CELLS, LARGE_DENSITY)
    for kx in range(first_x, last_x + 1):
        x, sx = around(s, kx, 0, LARGE_CELLS)
        for ky in range(first_y, last_y + 1):
            y, sy = around(s, ky, 1, LARGE_CELLS)
            for kz in range(first_z, last_z + 1):
                z, sz = around(s, kz, 2, LARGE_CELLS)
                head = chain_of_large(s, x, y, z)
                if s.row_chain[head] >= 0:
                    meet_chain(s, head, i, shifted_along_z(shifted(line, -sx, -sy), -sz), since)


@jit
def chain_of_large(s, x, y, z):
    """Which chain holds the large particles of a coarse cell: they follow those of the rows."""
    rows = s.counter[CELLS] * s.counter[CELLS + 1] * s.counter[CELLS + 2]
    return rows + (x * s.counter[LARGE_CELLS + 1] + y) * s.counter[LARGE_CELLS + 2] + z


@jit
def coarse_cell(s, i, t, d):
    """Coarse cell along axis d that holds i at time t (rounding at the edges stays inside)."""
    cell, _ = span(s, i, t, d, 0.0, LARGE_CELLS, LARGE_DENSITY)
    return min(max(cell, 0), s.counter[LARGE_CELLS + d] - 1)


@jit
def chain_large(s, i, t, replaces):
    """Hang the new line of a large particle, as registered at time t, in its coarse cell, perhaps in place of older ones."""
    z = coarse_cell(s, i, t, 2) if DIM == 3 else 0
    head = chain_of_large(s, coarse_cell(s, i, t, 0), coarse_cell(s, i, t, 1), z)
    if replaces:
        unchain(s, head, i)
    chain_draft(s, i, head, ZERO)


@jit
def clear_large(s):
    """Empty the coarse grid."""
    first = chain_of_large(s, 0, 0, 0)
    for head in range(first, chain_of_large(s, s.counter[LARGE_CELLS], 0, 0)):
        s.row_chain[head] = -1
