"""Trajectory segments: a flight in one window as the filter reads it, and its quantised bounding box.

The boxes are coarse and rounded outwards: they spare most pairs the comparison of segments.
"""

import math

import numpy as np

from .. import layout as at
from ..flags import DIM, GRAVITY, SIZES, WALLS
from ..simd.jit import jit
from ..simd.vectors import gather_transposed, store_transposed

MANY = 1000000  # segments of a flight; an upper bound
OUTWARDS = 1e-3  # units by which bounding boxes are enlarged, for rounding
TURN = 256.0
# Places of the numbers of cells before along x, y, z, and of those after.
RUNS = tuple(
    float(bit)
    for bit in (at.BEFORE_X, 1 << at.BEFORE_Y, at.BEFORE_Z, at.AFTER_X, 1 << at.AFTER_Y, at.AFTER_Z)
)
NEGATED_HIGH = TURN**3  # place of the high ends in a bounding box
NEAR_A_WALL = 1e-9  # of a box, for rounding

# The table of eight segments: their rows in columns, the segments in columns, and what else is known of them.
EIGHT = 8
SEGMENTS_OF_EIGHT = EIGHT * at.ROW
ENDS = SEGMENTS_OF_EIGHT + EIGHT * at.SEGMENT  # of their bounding boxes
CELL = ENDS + EIGHT
FAR = CELL + EIGHT  # below 1 where one segment is enough
NEAR = FAR + EIGHT  # how many cells are near, see `near_of`
EDGE = NEAR + EIGHT  # 1 where the flight may reach a wall


@jit
def in_window(s, i, d):
    """Place and velocity of row i along axis d, seen from a frame that falls: there flights are straight.

    It falls as the particles do, and in the middle of the window it is at rest and in its place.
    """
    x, v = s.row[i * at.ROW + at.X + d], s.row[i * at.ROW + at.V + d]
    to_middle = s.number[at.MIDDLE] - s.row[i * at.ROW + at.T]
    pull = s.number[at.PULL + d]
    return x - 0.5 * pull * to_middle * to_middle, v + pull * to_middle


@jit
def segments_of(s, i, duration):
    """Count the segments of a flight of this duration: none reaches further than HALF_LENGTH both ways."""
    vv = 0.0
    for d in range(DIM):
        v = s.row[i * at.ROW + at.V + d]
        if GRAVITY:
            _, v = in_window(s, i, d)
        vv += v * v
    far = 0.5 * duration / s.number[at.HALF_LENGTH]
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
        s.number[at.BOX + d],
        s.number[at.INVERSE + d],
        s.number[at.CELL_DENSITY + d],
        float(s.counter[at.CELLS + d] - 1),
        s.number[at.UNIT_DENSITY + d],
        s.number[at.SEGMENT_OVERHANG + d],
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
        if GRAVITY:  # seen from a frame that falls, even a whole segment may lie there
            before, after = max(before, 0.0), max(after, 0.0)
    return RUNS[d] * before + RUNS[d + 3] * after


@jit
def segment_along(p, k, d, dt, half_time, half_window, unit, radius, pull, of_axis):
    """Write segment k along axis d; returns box, cell, cells near it, squared speed, 1 if near a wall."""
    v = p[EIGHT * (at.V + d) + k]
    if GRAVITY:  # as `in_window`
        x = in_box(p[EIGHT * (at.X + d) + k] + (v + 0.5 * pull * dt) * dt, of_axis)
        v += pull * dt
    else:
        x = in_box(p[EIGHT * (at.X + d) + k] + v * dt, of_axis)
    half = half_time * abs(v) + radius
    p[SEGMENTS_OF_EIGHT + EIGHT * (at.MIDPOINT + d) + k] = x * unit
    p[SEGMENTS_OF_EIGHT + EIGHT * (at.HALF_DISPLACEMENT + d) + k] = v * half_window * unit
    edge = 0.0
    if WALLS:
        near_a_wall = half + NEAR_A_WALL * of_axis[0]
        if GRAVITY:  # how far the frame falls
            near_a_wall += abs(pull) * half_time * half_time
        reached = min(x, of_axis[0] - x) < near_a_wall
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
    unit, half_window, margin = (
        s.number[at.SEGMENT_UNIT],
        s.number[at.HALF_WINDOW],
        s.number[at.SEGMENT_MARGIN],
    )
    middle, core, half_time = s.number[at.MIDDLE], s.number[at.COMMON_RADIUS], 0.5 * duration
    far = half_time / s.number[at.HALF_LENGTH]
    along_x, along_y, along_z = axis(s, 0), axis(s, 1), axis(s, 2)
    ax, ay, az = 0.0, 0.0, 0.0
    if GRAVITY:
        ax, ay, az = s.number[at.PULL], s.number[at.PULL + 1], s.number[at.PULL + 2]
    rows, columns = float(s.counter[at.CELLS + 1]), float(s.counter[at.CELLS + 2])
    for k in range(EIGHT):
        dt = middle - p[EIGHT * at.T + k]
        radius = p[EIGHT * at.RADIUS + k] if SIZES else core
        ends, cx, near, vv, edge = segment_along(
            p, k, 0, dt, half_time, half_window, unit, radius, ax, along_x
        )
        more, cy, along, uu, beside = segment_along(
            p, k, 1, dt, half_time, half_window, unit, radius, ay, along_y
        )
        ends, near, vv, edge, cz = ends + TURN * more, near + along, vv + uu, max(edge, beside), 0.0
        if DIM == 3:
            more, cz, along, uu, beside = segment_along(
                p, k, 2, dt, half_time, half_window, unit, radius, az, along_z
            )
            ends, near, vv, edge = ends + TURN * TURN * more, near + along, vv + uu, max(edge, beside)
        else:
            p[SEGMENTS_OF_EIGHT + EIGHT * (at.MIDPOINT + 2) + k] = 0.0
            p[SEGMENTS_OF_EIGHT + EIGHT * (at.HALF_DISPLACEMENT + 2) + k] = 0.0
        p[SEGMENTS_OF_EIGHT + EIGHT * at.PADDED_RADIUS + k] = radius * unit + margin
        p[ENDS + k] = ends
        p[NEAR + k] = near
        p[CELL + k] = (cx * columns + cz) * rows + cy
        p[FAR + k] = vv * far * far
        p[EDGE + k] = edge
    store_transposed(s.unsorted, m * at.SEGMENT, p, SEGMENTS_OF_EIGHT)
    for k in range(EIGHT):
        s.unsorted_words[(m + k) * at.SEGMENT + at.OWNER] = s.order[m + k]
        s.unsorted_boxes[m + k] = int(p[ENDS + k]) | int(p[NEAR + k]) << at.NEAR_SHIFT


@jit
def write_segment(s, segments, words, boxes, k, i, t, duration, parts):
    """Write i's segment around time t, one of `parts` of its flight, in the image in the box then, to slot k.

    Returns the cell (x, y, z) that holds i at time t.
    """
    ri = i * at.ROW
    dt = t - s.row[ri + at.T]
    on = s.number[at.MIDDLE] - t
    unit = s.number[at.SEGMENT_UNIT]
    radius = s.row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    half_time = 0.5 * (duration / parts)
    line = k * at.SEGMENT
    ends, near = 0.0, 0.0
    cx, cy, cz = 0, 0, 0
    for d in range(DIM):
        v = s.row[ri + at.V + d]
        of_axis = axis(s, d)
        if GRAVITY:
            x, v = in_window(s, i, d)
            x = in_box(x + v * dt, of_axis)
        else:
            x = in_box(s.row[ri + at.X + d] + v * dt, of_axis)
        segments[line + at.MIDPOINT + d] = (x + v * on) * unit
        segments[line + at.HALF_DISPLACEMENT + d] = v * s.number[at.HALF_WINDOW] * unit
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
    reach = radius * unit + s.number[at.SEGMENT_MARGIN]
    if parts > 1:
        reach += 3e-3 * parts * s.number[at.HALF_LENGTH] * unit
    segments[line + at.PADDED_RADIUS] = reach
    words[line + at.OWNER] = i
    boxes[k] = int(ends) | int(near) << at.NEAR_SHIFT
    return cx, cy, cz


@jit
def write_unsorted(s, k, i, t, duration, parts):
    """Write a segment before all are sorted."""
    return write_segment(s, s.unsorted, s.unsorted_words, s.unsorted_boxes, k, i, t, duration, parts)
