"""Drafts: a flight of the window method as a line, and the bounds of the box that holds it.

The bounds are in 16 bits, so coarse, and rounded outwards: they only spare most pairs a closer look. A box of the scene is
CELLS + 2 cells wide in them, so that what lies half a cell outside can be told, too.
"""

import math

import numpy as np

from .compiler import jit
from .flags import DIM, SIZES
from .layout import (
    BOX,
    CELL_DENSITY,
    CELLS,
    CORE,
    GRID,
    GRID_HALF,
    HALF_WINDOW,
    INVERSE,
    LINE_MARGIN,
    LINE_UNIT,
    MIDDLE,
    RADIUS,
    ROW,
    STRETCH,
    N,
    T,
    V,
    X,
)
from .lines import BOUNDS, LINE, NEGATED_HIGH, PLACE, REACH_OF_LINE, WAY, WHOSE

MANY = 1000000  # pieces; more than anybody can need
OUTWARDS = 2.0  # bounds are rounded by more than a unit
LEAST, MOST = -32768.0, 32767.0  # bounds


@jit
def pieces_of(s, i, duration):
    """In how many pieces a flight of this duration is registered, so that none reaches further than STRETCH both ways."""
    vv = 0.0
    for d in range(DIM):
        v = s.row[i * ROW + V + d]
        vv += v * v
    far = 0.5 * duration / s.number[STRETCH]
    if vv * far * far < 1.0:
        return 1
    return 1 + int(min(math.sqrt(vv) * far, MANY))


@jit
def cell_of(s, d, x):
    """Cell along axis d that holds x, a place in the box; rounding at the edges stays inside, and so does a NaN."""
    return min(int(max(0.0, x * s.number[CELL_DENSITY + d])), s.counter[CELLS + d] - 1)


@jit
def write_draft(s, k, i, t, duration, pieces):
    """Write draft k: i's line, in the image that is in the box at time t, and its bounds for one of the pieces of this duration, around t.

    Returns the cell (x, y, z) that holds i at time t.
    """
    ri = i * ROW
    dt = t - s.row[ri + T]
    on = s.number[MIDDLE] - t
    unit = s.number[LINE_UNIT]
    radius = s.row[ri + RADIUS] if SIZES else s.number[CORE]
    line, bounds = k * LINE, k * BOUNDS
    cx, cy, cz = 0, 0, 0
    for d in range(DIM):
        v = s.row[ri + V + d]
        x = s.row[ri + X + d] + v * dt
        x -= s.number[BOX + d] * np.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls
        s.drafts[line + PLACE + d] = (x + v * on) * unit
        s.drafts[line + WAY + d] = v * s.number[HALF_WINDOW] * unit
        middle = x * s.number[GRID + d] - s.number[GRID_HALF + d]
        half = (0.5 * (duration / pieces) * abs(v) + radius) * s.number[GRID + d] + OUTWARDS
        s.draft_bounds[bounds + d] = int(max(min(middle - half, MOST), LEAST))
        s.draft_bounds[bounds + NEGATED_HIGH + d] = int(max(min(-middle - half, MOST), LEAST))
        cell = cell_of(s, d, x)
        if d == 0:
            cx = cell
        elif d == 1:
            cy = cell
        else:
            cz = cell
    reach = radius * unit + s.number[LINE_MARGIN]
    if pieces > 1:
        reach += 3e-3 * pieces * s.number[STRETCH] * unit
    s.drafts[line + REACH_OF_LINE] = reach
    s.draft_words[line + WHOSE] = i
    return cx, cy, cz


@jit
def lone_draft(s):
    """Which draft is that of a new line; those before it are of the window's opening."""
    return s.counter[N]


@jit
def cell_at(s, x, y, z):
    """Index of a cell; y runs fastest, so that a column of cells stands together."""
    return column_at(s, x, z) + y


@jit
def column_at(s, x, z):
    """Index of the first cell of a column."""
    return (x * s.counter[CELLS + 2] + z) * s.counter[CELLS + 1]
