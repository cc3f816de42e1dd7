"""Drafts: a flight of the window method as a line, and the bounds of the box that holds it.

The bounds are coarse and rounded outwards: they only spare most pairs a closer look.
"""

import math

import numpy as np

from .compiler import jit, turn_columns, turn_rows
from .flags import DIM, SIZES, WALLS
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
    UNIT_DENSITY,
    T,
    V,
    X,
)
from .lines import LINE, PLACE, REACH_OF_LINE, WAY, WHOSE

MANY = 1000000  # pieces; more than anybody can need
OUTWARDS = 1e-3  # units that bounds are further out than they must be, because of rounding
TURN = 256.0
NEAR_A_WALL = 1e-9  # of a box, for rounding

# The table of eight drafts, after their rows in columns: their lines in columns, and what else is known of them.
EIGHT = 8
LINES_OF_EIGHT = EIGHT * ROW
ENDS = LINES_OF_EIGHT + EIGHT * LINE  # bounds
CELL = ENDS + EIGHT
FAR = CELL + EIGHT  # below 1 where one piece does
EDGE = FAR + EIGHT  # 1 where the flight may reach a wall


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
def in_box(s, d, x):
    """Return coordinate d of the image that is in the box."""
    return x - s.number[BOX + d] * np.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls


@jit
def cell_of(s, d, x):
    """Cell along axis d, as a float, that holds x, a place in the box; rounding at the edges stays inside, and so does a NaN."""
    return min(np.floor(max(0.0, x * s.number[CELL_DENSITY + d])), s.counter[CELLS + d] - 1.0)


@jit
def byte(x):
    """Return the whole number below x without whole turns of 256."""
    x = np.floor(x - OUTWARDS)
    return x - TURN * np.floor(x / TURN)


@jit
def ends_of(s, d, x, half):
    """Bounds along axis d of a box that reaches this far from x both ways, in their place among the others; a whole number."""
    density = s.number[UNIT_DENSITY + d]
    return TURN**d * byte((x - half) * density) + TURN ** (d + 3) * byte((-x - half) * density)


@jit
def draft_eight(s, m, duration):
    """Draft the lines of eight particles, from m on in their order, for the whole window, and write in the table what else is known of them.

    Those that are too fast for one piece have their line drafted anew later.
    """
    p = s.scratch
    turn_rows(p, 0, EIGHT, s.row, s.order, m)
    unit, half_window = s.number[LINE_UNIT], s.number[HALF_WINDOW]
    far = 0.5 * duration / s.number[STRETCH]
    for k in range(EIGHT):
        dt = s.number[MIDDLE] - p[EIGHT * T + k]
        radius = p[EIGHT * RADIUS + k] if SIZES else s.number[CORE]
        ends, vv, edge = 0.0, 0.0, 0.0
        cx, cy, cz = 0.0, 0.0, 0.0
        for d in range(DIM):
            v = p[EIGHT * (V + d) + k]
            x = in_box(s, d, p[EIGHT * (X + d) + k] + v * dt)
            p[LINES_OF_EIGHT + EIGHT * (PLACE + d) + k] = x * unit
            p[LINES_OF_EIGHT + EIGHT * (WAY + d) + k] = v * half_window * unit
            half = 0.5 * duration * abs(v) + radius
            ends += ends_of(s, d, x, half)
            if WALLS:
                reached = min(x, s.number[BOX + d] - x) < half + NEAR_A_WALL * s.number[BOX + d]
                edge = 1.0 if (s.number[INVERSE + d] == 0.0) & reached else edge
            cell = cell_of(s, d, x)
            if d == 0:
                cx = cell
            elif d == 1:
                cy = cell
            else:
                cz = cell
            vv += v * v
        if DIM == 2:
            p[LINES_OF_EIGHT + EIGHT * (PLACE + 2) + k] = 0.0
            p[LINES_OF_EIGHT + EIGHT * (WAY + 2) + k] = 0.0
        p[LINES_OF_EIGHT + EIGHT * REACH_OF_LINE + k] = radius * unit + s.number[LINE_MARGIN]
        p[ENDS + k] = ends
        p[CELL + k] = (cx * s.counter[CELLS + 2] + cz) * s.counter[CELLS + 1] + cy
        p[FAR + k] = vv * far * far
        p[EDGE + k] = edge
    turn_columns(s.drafts, m * LINE, p, LINES_OF_EIGHT)
    for k in range(EIGHT):
        s.draft_words[(m + k) * LINE + WHOSE] = s.order[m + k]
        s.draft_bounds[m + k] = int(p[ENDS + k])


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
    half_time = 0.5 * (duration / pieces)
    line = k * LINE
    ends = 0.0
    cx, cy, cz = 0, 0, 0
    for d in range(DIM):
        v = s.row[ri + V + d]
        x = in_box(s, d, s.row[ri + X + d] + v * dt)
        lines[line + PLACE + d] = (x + v * on) * unit
        lines[line + WAY + d] = v * s.number[HALF_WINDOW] * unit
        ends += ends_of(s, d, x, half_time * abs(v) + radius)
        cell = int(cell_of(s, d, x))
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
    bounds[k] = int(ends)
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
