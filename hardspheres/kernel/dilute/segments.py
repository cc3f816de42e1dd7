"""Trajectory segments: a flight in one window as the filter reads it, and its quantised bounding box.

The boxes are coarse and rounded outwards: they spare most pairs the comparison of segments.
"""

import math

import numpy as np

from ..flags import DIM, SIZES, WALLS
from ..layout import (
    AFTER_X,
    AFTER_Y,
    AFTER_Z,
    BEFORE_X,
    BEFORE_Y,
    BEFORE_Z,
    BOX,
    CELL_DENSITY,
    CELLS,
    COMMON_RADIUS,
    HALF_DISPLACEMENT,
    HALF_LENGTH,
    HALF_WINDOW,
    INVERSE,
    MIDDLE,
    MIDPOINT,
    NEAR_SHIFT,
    OWNER,
    PADDED_RADIUS,
    RADIUS,
    ROW,
    SEGMENT,
    SEGMENT_MARGIN,
    SEGMENT_OVERHANG,
    SEGMENT_UNIT,
    UNIT_DENSITY,
    T,
    V,
    X,
)
from ..simd.jit import jit
from ..simd.vectors import gather_transposed, store_transposed

MANY = 1000000  # segments of a flight; an upper bound
OUTWARDS = 1e-3  # units by which bounding boxes are enlarged, for rounding
TURN = 256.0
# Places of the numbers of cells before along x, y, z, and of those after.
RUNS = tuple(float(bit) for bit in (BEFORE_X, 1 << BEFORE_Y, BEFORE_Z, AFTER_X, 1 << AFTER_Y, AFTER_Z))
NEGATED_HIGH = TURN**3  # place of the high ends in a bounding box
NEAR_A_WALL = 1e-9  # of a box, for rounding

# The table of eight segments: their rows in columns, the segments in columns, and what else is known of them.
EIGHT = 8
SEGMENTS_OF_EIGHT = EIGHT * ROW
ENDS = SEGMENTS_OF_EIGHT + EIGHT * SEGMENT  # of their bounding boxes
CELL = ENDS + EIGHT
FAR = CELL + EIGHT  # below 1 where one segment is enough
NEAR = FAR + EIGHT  # how many cells are near, see `near_of`
EDGE = NEAR + EIGHT  # 1 where the flight may reach a wall


@jit
def segments_of(s, i, duration):
    """Count the segments of a flight of this duration: none reaches further than HALF_LENGTH both ways."""
    vv = 0.0
    for d in range(DIM):
        v = s.row[i * ROW + V + d]
        vv += v * v
    far = 0.5 * duration / s.number[HALF_LENGTH]
    if vv * far * far < 1.0:
        return 1
    return 1 + int(min(math.sqrt(vv) * far, MANY))


@jit
def axis(s, d):
    """Return what a segment needs to know of an axis, loaded once.

    Edge of the box, its inverse (0 between walls), cells per length, last cell, units per length, and
    overhang.
    """
    return (
        s.number[BOX + d],
        s.number[INVERSE + d],
        s.number[CELL_DENSITY + d],
        float(s.counter[CELLS + d] - 1),
        s.number[UNIT_DENSITY + d],
        s.number[SEGMENT_OVERHANG + d],
    )


@jit
def in_box(x, of_axis):
    """Return the image of a coordinate that is in the box."""
    return x - of_axis[0] * np.floor(x * of_axis[1])


@jit
def cell_of(x, of_axis):
    """Cell, as a float, that holds a place x in the box; rounding at edges stays inside, and so does NaN."""
    return min(np.floor(max(0.0, x * of_axis[2])), of_axis[3])


@jit
def byte(x):
    """Return the whole number below x without whole turns of 256."""
    x = np.floor(x - OUTWARDS)
    return x - TURN * np.floor(x * (1.0 / TURN))


@jit
def ends_of(x, half, of_axis):
    """Both ends along an axis of a bounding box around x, in the place of the first axis."""
    return byte((x - half) * of_axis[4]) + NEGATED_HIGH * byte((-x - half) * of_axis[4])


@jit
def cells_near(x, half, cell, of_axis):
    """How many cells before and after this one may hold segments near a box of this half-width around x."""
    reach = half + of_axis[5]
    return cell - np.floor((x - reach) * of_axis[2]), np.floor((x + reach) * of_axis[2]) - cell


@jit
def near_of(d, before, after):
    """Return these numbers, at most 1 (along y 3), in the place that they have in one for all axes."""
    if WALLS:  # a middle beyond a wall has nothing near
        most = 3.0 if d == 1 else 1.0
        before, after = min(before, most), min(after, most)
    return RUNS[d] * before + RUNS[d + 3] * after


@jit
def segment_along(p, k, d, dt, half_time, half_window, unit, radius, of_axis):
    """Write segment k along axis d; returns box, cell, cells near it, squared speed, 1 if near a wall."""
    v = p[EIGHT * (V + d) + k]
    x = in_box(p[EIGHT * (X + d) + k] + v * dt, of_axis)
    half = half_time * abs(v) + radius
    p[SEGMENTS_OF_EIGHT + EIGHT * (MIDPOINT + d) + k] = x * unit
    p[SEGMENTS_OF_EIGHT + EIGHT * (HALF_DISPLACEMENT + d) + k] = v * half_window * unit
    edge = 0.0
    if WALLS:
        reached = min(x, of_axis[0] - x) < half + NEAR_A_WALL * of_axis[0]
        edge = 1.0 if (of_axis[1] == 0.0) & reached else 0.0
    cell = cell_of(x, of_axis)
    before, after = cells_near(x, half, cell, of_axis)
    return ends_of(x, half, of_axis), cell, near_of(d, before, after), v * v, edge


@jit
def write_eight(s, m, duration):
    """Write the segments of eight particles, from m on in their order, for the whole window.

    What else is known of them stays in the table; those too fast for one segment are written again later. All
    numbers are loaded first, so that the compiler knows that nothing changes them, and uses vector
    instructions.
    """
    p = s.scratch
    gather_transposed(p, 0, EIGHT, s.row, s.order, m)
    unit, half_window, margin = s.number[SEGMENT_UNIT], s.number[HALF_WINDOW], s.number[SEGMENT_MARGIN]
    middle, core, half_time = s.number[MIDDLE], s.number[COMMON_RADIUS], 0.5 * duration
    far = half_time / s.number[HALF_LENGTH]
    along_x, along_y, along_z = axis(s, 0), axis(s, 1), axis(s, 2)
    rows, columns = float(s.counter[CELLS + 1]), float(s.counter[CELLS + 2])
    for k in range(EIGHT):
        dt = middle - p[EIGHT * T + k]
        radius = p[EIGHT * RADIUS + k] if SIZES else core
        ends, cx, near, vv, edge = segment_along(p, k, 0, dt, half_time, half_window, unit, radius, along_x)
        more, cy, along, uu, beside = segment_along(
            p, k, 1, dt, half_time, half_window, unit, radius, along_y
        )
        ends, near, vv, edge, cz = ends + TURN * more, near + along, vv + uu, max(edge, beside), 0.0
        if DIM == 3:
            more, cz, along, uu, beside = segment_along(
                p, k, 2, dt, half_time, half_window, unit, radius, along_z
            )
            ends, near, vv, edge = ends + TURN * TURN * more, near + along, vv + uu, max(edge, beside)
        else:
            p[SEGMENTS_OF_EIGHT + EIGHT * (MIDPOINT + 2) + k] = 0.0
            p[SEGMENTS_OF_EIGHT + EIGHT * (HALF_DISPLACEMENT + 2) + k] = 0.0
        p[SEGMENTS_OF_EIGHT + EIGHT * PADDED_RADIUS + k] = radius * unit + margin
        p[ENDS + k] = ends
        p[NEAR + k] = near
        p[CELL + k] = (cx * columns + cz) * rows + cy
        p[FAR + k] = vv * far * far
        p[EDGE + k] = edge
    store_transposed(s.unsorted, m * SEGMENT, p, SEGMENTS_OF_EIGHT)
    for k in range(EIGHT):
        s.unsorted_words[(m + k) * SEGMENT + OWNER] = s.order[m + k]
        s.unsorted_boxes[m + k] = int(p[ENDS + k]) | int(p[NEAR + k]) << NEAR_SHIFT


@jit
def write_segment(s, segments, words, boxes, k, i, t, duration, parts):
    """Write i's segment around time t, one of `parts` of its flight, in the image in the box then, to slot k.

    Returns the cell (x, y, z) that holds i at time t.
    """
    ri = i * ROW
    dt = t - s.row[ri + T]
    on = s.number[MIDDLE] - t
    unit = s.number[SEGMENT_UNIT]
    radius = s.row[ri + RADIUS] if SIZES else s.number[COMMON_RADIUS]
    half_time = 0.5 * (duration / parts)
    line = k * SEGMENT
    ends, near = 0.0, 0.0
    cx, cy, cz = 0, 0, 0
    for d in range(DIM):
        v = s.row[ri + V + d]
        of_axis = axis(s, d)
        x = in_box(s.row[ri + X + d] + v * dt, of_axis)
        segments[line + MIDPOINT + d] = (x + v * on) * unit
        segments[line + HALF_DISPLACEMENT + d] = v * s.number[HALF_WINDOW] * unit
        half = half_time * abs(v) + radius
        ends += TURN**d * ends_of(x, half, of_axis)
        cell = int(cell_of(x, of_axis))
        before, after = cells_near(x, half, cell, of_axis)
        near += near_of(d, before, after)
        if d == 0:
            cx = cell
        elif d == 1:
            cy = cell
        else:
            cz = cell
    reach = radius * unit + s.number[SEGMENT_MARGIN]
    if parts > 1:
        reach += 3e-3 * parts * s.number[HALF_LENGTH] * unit
    segments[line + PADDED_RADIUS] = reach
    words[line + OWNER] = i
    boxes[k] = int(ends) | int(near) << NEAR_SHIFT
    return cx, cy, cz


@jit
def write_unsorted(s, k, i, t, duration, parts):
    """Write a segment before all are sorted."""
    return write_segment(s, s.unsorted, s.unsorted_words, s.unsorted_boxes, k, i, t, duration, parts)
