"""The cells of the list method: which particles have their centre where."""

import math

import numpy as np

from ..flags import DIM, SIZES
from ..layout import (
    BOX,
    CELL_COLUMNS,
    CELL_DENSITY,
    CELL_EDGE,
    CELL_LANES,
    CELL_ROOM,
    CELLS,
    CENTRE,
    EVENT,
    INVERSE,
    RADIUS,
    ROW,
    SHORT_CELLS,
)
from ..simd.jit import jit


@jit
def wrapped(s, i, d):
    """Coordinate d of i's centre, brought back into the box on a periodic axis."""
    x = s.event_float[i * EVENT + CENTRE + d]
    if s.number[INVERSE + d] > 0.0:
        x -= s.number[BOX + d] * math.floor(x * s.number[INVERSE + d])
    return x


@jit
def cell_and_place(s, i, d):
    """Index along axis d of the cell that holds i's centre (rounding at the last edge stays inside), and the place in it."""
    x = wrapped(s, i, d)
    cell = min(max(int(x * s.number[CELL_DENSITY + d]), 0), s.counter[CELLS + d] - 1)
    return cell, np.float32(x - cell * s.number[CELL_EDGE + d])


@jit
def locate(s, i):
    """Find the indices of the cell that holds i's centre, and its place as seen from the cell's corner."""
    cx, x = cell_and_place(s, i, 0)
    cy, y = cell_and_place(s, i, 1)
    cz, z = 0, np.float32(0.0)
    if DIM == 3:
        cz, z = cell_and_place(s, i, 2)
    return cx, cy, cz, x, y, z


@jit
def line_of(slot):
    """Where in the cells' memory the id in a slot stands; each block of CELL_LANES slots has its columns together."""
    return slot // CELL_LANES * (CELL_COLUMNS * CELL_LANES) + slot % CELL_LANES


@jit
def put_in_cell(s, i):
    """Enter i's centre in its cell."""
    cx, cy, cz, x, y, z = locate(s, i)
    cell = (cx * s.counter[CELLS + 1] + cy) * s.counter[CELLS + 2] + cz
    slot = s.cell_count[cell]
    if slot == s.counter[CELL_ROOM]:
        s.counter[SHORT_CELLS] = 1
        s.where[i] = -1
        return
    s.cell_count[cell] = slot + 1
    slot += cell * s.counter[CELL_ROOM]
    s.where[i] = slot
    line = line_of(slot)
    s.cell_ids[line] = i
    s.cell_places[line + CELL_LANES] = x
    s.cell_places[line + 2 * CELL_LANES] = y
    if DIM == 3:
        s.cell_places[line + 3 * CELL_LANES] = z
    if SIZES:
        s.cell_places[line + (1 + DIM) * CELL_LANES] = s.row[i * ROW + RADIUS]


@jit
def take_from_cell(s, i):
    """Remove i's centre from its cell; the last of the cell takes its slot."""
    slot = s.where[i]
    cell = slot // s.counter[CELL_ROOM]
    left = s.cell_count[cell] - 1
    s.cell_count[cell] = left
    line, last = line_of(slot), line_of(cell * s.counter[CELL_ROOM] + left)
    s.where[s.cell_ids[last]] = slot
    for c in range(CELL_COLUMNS):
        s.cell_ids[line + c * CELL_LANES] = s.cell_ids[last + c * CELL_LANES]


@jit
def turns_of(s, i, d):
    """How many boxes i's centre is away from its wrapped place along axis d."""
    if s.number[INVERSE + d] > 0.0:
        return math.floor(s.event_float[i * EVENT + CENTRE + d] * s.number[INVERSE + d])
    return 0.0


@jit
def neighbour_cell(s, cell, d):
    """Index of a cell that may lie beyond the box's edge, -1 where there is none, and in boxes how far beyond."""
    cells = s.counter[CELLS + d]
    if 0 <= cell < cells:
        return cell, 0.0
    if s.number[INVERSE + d] == 0.0:
        return -1, 0.0
    if cell < 0:
        return cell + cells, -1.0
    return cell - cells, 1.0
