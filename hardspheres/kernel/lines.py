"""Lines of the window method: the straight flights of a window, in single precision, and the filter that compares them.

A line is its place in the middle of the window, half its way through it, and its reach (radius and margin), in units of the
longest cell edge. The filter asks whether two lines come within contact; rounding is covered by margins, so it lets pass
whatever does, and a little more. It compares one line with a run of others in whole vectors, without a branch.
"""

import numpy as np

from .candidates import note_candidate
from .compiler import jit
from .flags import DIM, SIZES
from .layout import (
    BOX,
    CELL_DENSITY,
    CELLS,
    CORE,
    HALF_WINDOW,
    INVERSE,
    LINE_LANES,
    LINE_MARGIN,
    LINE_ROOM,
    LINE_UNIT,
    MIDDLE,
    RADIUS,
    ROW,
    STRETCH,
    T,
    V,
    X,
)
from .prediction import pair_contact

ONE = np.float32(1.0)
TWO = np.float32(2.0)
TINY = np.float32(1e-30)
SLACK = np.float32(1e-5)  # for the rounding of squared distances, of b, and of the moment from which a line counts

# Columns of the lines.
PLACE = 0
WAY = 3
REACH_OF_LINE = 6


@jit
def cell_of(s, i, d, t):
    """Cell along axis d that holds i at time t, and how far the box that holds it is shifted."""
    x = s.row[i * ROW + X + d] + s.row[i * ROW + V + d] * (t - s.row[i * ROW + T])
    shift = s.number[BOX + d] * np.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls
    cell = (x - shift) * s.number[CELL_DENSITY + d]
    last = s.counter[CELLS + d] - 1
    if cell > 0.0:  # written so that not even a NaN leaves the grid
        return (int(cell) if cell < last else last), shift
    return 0, shift


@jit
def cell_at(s, i, t):
    """Cell that holds i at time t."""
    cell, _ = cell_of(s, i, 0, t)
    for d in range(1, DIM):
        k, _ = cell_of(s, i, d, t)
        cell = cell * s.counter[CELLS + d] + k
    return cell


@jit
def write_line(s, slot, i, t, middle, pieces):
    """Write i's line to a slot, in the image that is in the box at time t."""
    room = s.counter[LINE_ROOM]
    ri = i * ROW
    dt = middle - s.row[ri + T]
    unit = s.number[LINE_UNIT]
    for d in range(DIM):
        _, shift = cell_of(s, i, d, t)
        place = s.row[ri + X + d] + s.row[ri + V + d] * dt
        s.lines[(PLACE + d) * room + slot] = (place - shift) * unit
        s.lines[(WAY + d) * room + slot] = s.row[ri + V + d] * s.number[HALF_WINDOW] * unit
    reach = (s.row[ri + RADIUS] if SIZES else s.number[CORE]) * unit + s.number[LINE_MARGIN]
    if pieces > 1:
        reach += 3e-3 * pieces * s.number[STRETCH] * unit
    s.lines[REACH_OF_LINE * room + slot] = reach
    s.line_ids[slot] = i


@jit
def line_at(p, stride, k, sx, sy, sz):
    """Place, way and reach of line k, shifted."""
    z, w = sz, sz
    if DIM == 3:
        z = p[(PLACE + 2) * stride + k] + sz
        w = p[(WAY + 2) * stride + k]
    x, y = p[PLACE * stride + k] + sx, p[(PLACE + 1) * stride + k] + sy
    return x, y, z, p[WAY * stride + k], p[(WAY + 1) * stride + k], w, p[REACH_OF_LINE * stride + k]


@jit
def compare(p, stride, k, line):
    """b = r.v, v.v, and r.r less the squared contact distance, of line k against the one given."""
    x, y, z, u, v, w, reach = line
    dx, du = p[PLACE * stride + k] - x, p[WAY * stride + k] - u
    dy, dv = p[(PLACE + 1) * stride + k] - y, p[(WAY + 1) * stride + k] - v
    rr = dx * dx + dy * dy
    b = dx * du + dy * dv
    vv = du * du + dv * dv
    if DIM == 3:
        dz, dw = p[(PLACE + 2) * stride + k] - z, p[(WAY + 2) * stride + k] - w
        rr += dz * dz
        b += dz * dw
        vv += dw * dw
    limit = p[REACH_OF_LINE * stride + k] + reach
    return b, vv, rr - (limit * limit + SLACK)


@jit
def may_meet(b, vv, c, since):
    """Whether two lines may come within contact from `since` to 1, in half windows from the middle.

    They approach at first, b + since v.v < 0, and are in contact when nearest to each other or, if that is later, at the end.
    """
    return (b < SLACK - since * vv) & (c * vv < b * b) & ((b + vv > 0.0) | (c + (TWO * b + vv) < 0.0))


@jit
def meet_run(s, p, ids, stride, first, last, i, line, since):
    """Compare i's line with those from `first` to `last`, and compute the contacts of those that it may meet."""
    for block in range(first, last, LINE_LANES):
        met = False
        for k in range(block, block + LINE_LANES):
            b, vv, c = compare(p, stride, k, line)
            met |= may_meet(b, vv, c, since)
        if met:
            for k in range(block, min(block + LINE_LANES, last)):
                meet_line(s, p, ids, stride, k, i, line, since)


@jit
def meet_line(s, p, ids, stride, k, i, line, since):
    """Compare i's line with line k, and compute their contact if they may meet."""
    b, vv, c = compare(p, stride, k, line)
    if may_meet(b, vv, c, since) and ids[k] != i:
        about = s.number[MIDDLE] + s.number[HALF_WINDOW] * min(max(-b / (vv + TINY), since), ONE)
        j = int(ids[k])
        note_candidate(s, min(i, j), max(i, j), pair_contact(s, i, j, about))
