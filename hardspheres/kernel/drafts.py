"""Drafts: a flight of the window method as a line, and the bounds of the box that holds it.

The bounds are coarse and rounded outwards: they only spare most pairs a closer look.
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
    HALF_WINDOW,
    INVERSE,
    LINE_MARGIN,
    LINE_UNIT,
    MIDDLE,
    RADIUS,
    ROW,
    STRETCH,
    T,
    V,
    X,
)
from .lines import BYTE, LINE, PLACE, REACH_OF_LINE, UNITS, WAY, WHOSE

MANY = 1000000  # pieces; more than anybody can need
OUTWARDS = 1e-3  # units that bounds are further out than they must be, because of rounding


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
def write_draft(s, lines, words, bounds, k, i, t, duration, pieces):
    """Write i's line, in the image that is in the box at time t, to slot k, and its bounds for one of the pieces of this duration, around t.

    Returns the cell (x, y, z) that holds i at time t.
    """
    ri = i * ROW
    dt = t - s.row[ri + T]
    on = s.number[MIDDLE] - t
    unit = s.number[LINE_UNIT]
    radius = s.row[ri + RADIUS] if SIZES else s.number[CORE]
    line = k * LINE
    ends = 0
    cx, cy, cz = 0, 0, 0
    for d in range(DIM):
        v = s.row[ri + V + d]
        x = s.row[ri + X + d] + v * dt
        x -= s.number[BOX + d] * np.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls
        lines[line + PLACE + d] = (x + v * on) * unit
        lines[line + WAY + d] = v * s.number[HALF_WINDOW] * unit
        density = UNITS * s.number[CELL_DENSITY + d]
        half = (0.5 * (duration / pieces) * abs(v) + radius) * density + OUTWARDS
        low, negated_high = np.floor(x * density - half), np.floor(-x * density - half)
        ends |= (int(low) & BYTE) << 8 * d | (int(negated_high) & BYTE) << 8 * (d + 3)
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
    lines[line + REACH_OF_LINE] = reach
    words[line + WHOSE] = i
    bounds[k] = ends
    return cx, cy, cz


@jit
def draft(s, k, i, t, duration, pieces):
    """Write a draft before lines are sorted."""
    return write_draft(s, s.drafts, s.draft_words, s.draft_bounds, k, i, t, duration, pieces)


@jit
def cell_at(s, x, y, z):
    """Index of a cell; y runs fastest, so that a column of cells stands together."""
    return column_at(s, x, z) * s.counter[CELLS + 1] + y


@jit
def column_at(s, x, z):
    """Index of a column of cells."""
    return x * s.counter[CELLS + 2] + z
