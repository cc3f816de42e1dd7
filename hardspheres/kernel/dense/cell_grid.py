"""The cells of the list method: which reference positions are where.

A cell keeps the reference positions of its particles as seen from its own corner, in single precision: their
rounding then does not grow with the box, and sixteen of them fill a vector. A block of sixteen slots has all
ids, then all x, all y, all z, as the cutoff test reads them. Only a rebuilt list moves a particle in the
cells; a particle that flies across a boundary between cells stays where its reference position is.
"""

import math

import numpy as np

from .. import layout as at
from ..flags import DIM, SIZES, THREADS
from ..simd.jit import jit
from ..threads.tiles import settle


@jit
def fallen(s, d, x, v, t):
    """Place and velocity along axis d at time t, seen from a frame that falls since the epoch began.

    There every flight is straight, and a reference position stays where it is. All lists are of one epoch.
    Not with obstacles, which do not fall.
    """
    pull = s.number[at.PULL + d]
    return x - 0.5 * pull * t * t, v - pull * t


@jit
def wrapped(s, i, d):
    """Coordinate d of i's reference position, wrapped into the box on a periodic axis."""
    x = s.event_float[i * at.EVENT + at.REFERENCE + d]
    if s.number[at.INVERSE + d] > 0.0:
        x -= s.number[at.BOX + d] * math.floor(x * s.number[at.INVERSE + d])
    return x


@jit
def cell_and_place(s, i, d):
    """Cell along axis d of i's reference position (rounding stays inside), and the place in it."""
    x = wrapped(s, i, d)
    cell = min(max(int(x * s.number[at.CELL_DENSITY + d]), 0), s.counter[at.CELLS + d] - 1)
    return cell, np.float32(x - cell * s.number[at.CELL_EDGE + d])


@jit
def locate(s, i):
    """Return the cell of i's reference position, and the position as seen from the cell's corner."""
    cx, x = cell_and_place(s, i, 0)
    cy, y = cell_and_place(s, i, 1)
    cz, z = 0, np.float32(0.0)
    if DIM == 3:
        cz, z = cell_and_place(s, i, 2)
    return cx, cy, cz, x, y, z


@jit
def place_of_slot(slot):
    """Where the id in a slot stands; each block of CELL_LANES slots has its columns together."""
    return slot // at.CELL_LANES * (at.CELL_COLUMNS * at.CELL_LANES) + slot % at.CELL_LANES


@jit
def put_in_cell(s, i):
    """Enter i's reference position in its cell."""
    cx, cy, cz, x, y, z = locate(s, i)
    cell = (cx * s.counter[at.CELLS + 1] + cy) * s.counter[at.CELLS + 2] + cz
    slot = s.cell_count[cell]
    if slot == s.counter[at.CELL_ROOM]:
        s.counter[at.SHORT_CELLS] = 1
        s.where[i] = -1
        return
    s.cell_count[cell] = slot + 1
    if THREADS:
        settle(s, i, cx * s.counter[at.CELLS + 1] + cy)
    slot += cell * s.counter[at.CELL_ROOM]
    s.where[i] = slot
    line = place_of_slot(slot)
    s.cell_ids[line] = i
    s.cell_places[line + at.CELL_LANES] = x
    s.cell_places[line + 2 * at.CELL_LANES] = y
    if DIM == 3:
        s.cell_places[line + 3 * at.CELL_LANES] = z
    if SIZES:
        s.cell_places[line + (1 + DIM) * at.CELL_LANES] = s.row[i * at.ROW + at.RADIUS]


@jit
def take_from_cell(s, i):
    """Remove i's reference position from its cell; the last of the cell takes its slot."""
    slot = s.where[i]
    cell = slot // s.counter[at.CELL_ROOM]
    left = s.cell_count[cell] - 1
    s.cell_count[cell] = left
    line, last = place_of_slot(slot), place_of_slot(cell * s.counter[at.CELL_ROOM] + left)
    s.where[s.cell_ids[last]] = slot
    for c in range(at.CELL_COLUMNS):
        s.cell_ids[line + c * at.CELL_LANES] = s.cell_ids[last + c * at.CELL_LANES]


@jit
def image_of(s, i, d):
    """Image of i's reference position along axis d: how many boxes it is away from its wrapped place."""
    if s.number[at.INVERSE + d] > 0.0:
        return math.floor(s.event_float[i * at.EVENT + at.REFERENCE + d] * s.number[at.INVERSE + d])
    return 0.0


@jit
def neighbour_cell(s, cell, d):
    """Index of a cell that may lie beyond the box, -1 where there is none, and the image, in boxes."""
    cells = s.counter[at.CELLS + d]
    if 0 <= cell < cells:
        return cell, 0.0
    if s.number[at.INVERSE + d] == 0.0:
        return -1, 0.0
    if cell < 0:
        return cell + cells, -1.0
    return cell - cells, 1.0
