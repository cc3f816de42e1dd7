"""Planes of the window method: all pairs of neighbouring cells, met in two contiguous runs for each cell.

A plane holds the lines of all cells of one x, each three times: row (z, y) is the lines of the cells z - 1, z and z + 1 at
that y, one after the other, with a row beyond either end in y, and shifted where the cells are on the other side of the box.
Rows of one z follow each other in y. The partners of a line in cell (x, y, z), each pair once, are then two runs: in its own
plane everything behind it up to the end of row (z, y + 1), and in the next plane the rows from (z, y - 1) to (z, y + 1).
"""

import numpy as np

from .compiler import jit
from .flags import DIM
from .layout import BOX, CELLS, INVERSE, LINE_LANES, LINE_ROOM, LINE_UNIT, PLANE_ROOM, PLANE_ROWS, SHORT_CELLS
from .lines import line_at, meet_run

COLUMNS = 7
ZERO = np.float32(0.0)
ALWAYS = np.float32(-1.00001)  # from the beginning of the window


@jit
def around(s, cell, d):
    """Index of a cell that may lie beyond the box's edge, -1 where there is none, and how far it is shifted."""
    cells = s.counter[CELLS + d]
    if 0 <= cell < cells:
        return cell, ZERO
    if s.number[INVERSE + d] == 0.0:
        return -1, ZERO
    length = np.float32(s.number[BOX + d] * s.number[LINE_UNIT])
    if cell < 0:
        return cell + cells, -length
    return cell - cells, length


@jit
def copy_run(s, p, end, first, last, sx, sy, sz):
    """Copy a run of lines, shifted, to the planes from position p on; returns the position after it."""
    room, stride = s.counter[LINE_ROOM], 2 * s.counter[PLANE_ROOM]
    if p + (last - first) + LINE_LANES > end:
        s.counter[SHORT_CELLS] = 1
        return p
    whole = (last - first + LINE_LANES - 1) // LINE_LANES * LINE_LANES  # what is copied too much is overwritten, or never read
    for column in range(COLUMNS):
        if DIM == 3 or not (column == 2 or column == 5):
            shift = sx if column == 0 else (sy if column == 1 else (sz if column == 2 else ZERO))
            for k in range(whole):
                s.planes[column * stride + p + k] = s.lines[column * room + first + k] + shift
    for k in range(whole):
        s.plane_ids[p + k] = s.line_ids[first + k]
    return p + (last - first)


@jit
def copy_row(s, p, end, row, x, sx, y, sy, z):
    """Copy the lines of the cells (x, y, z - 1 to z + 1) to a plane; notes where those of (x, y, z) begin."""
    nz = s.counter[CELLS + 2]
    cell = (x * s.counter[CELLS + 1] + y) * nz
    below, shift_below = around(s, z - 1, 2)
    above, shift_above = around(s, z + 1, 2)
    if below > z:
        p = copy_run(s, p, end, s.cell_start[cell + below], s.cell_start[cell + below + 1], sx, sy, shift_below)
    first, last = cell + max(z - 1, 0), cell + min(z + 1, nz - 1)
    s.plane_own[row] = p + s.cell_start[cell + z] - s.cell_start[first]
    p = copy_run(s, p, end, s.cell_start[first], s.cell_start[last + 1], sx, sy, ZERO)
    if 0 <= above < z:
        p = copy_run(s, p, end, s.cell_start[cell + above], s.cell_start[cell + above + 1], sx, sy, shift_above)
    return p


@jit
def fill_plane(s, plane, kx):
    """Fill a plane with the lines of the cells of one x, which may lie beyond the box's edge."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    x, sx = around(s, kx, 0)
    row = plane * s.counter[PLANE_ROWS]
    p = plane * s.counter[PLANE_ROOM]
    end = p + s.counter[PLANE_ROOM]
    for z in range(nz):
        for ky in range(-1, ny + 1):
            s.plane_start[row] = p
            y, sy = around(s, ky, 1)
            if x >= 0 and y >= 0:
                p = copy_row(s, p, end, row, x, sx, y, sy, z)
            row += 1
        s.plane_start[row] = p
        row += 1


@jit
def meet_cell(s, plane, kx, y, z):
    """Compare the lines of a cell with each other and with those of the half of its neighbours that come after it."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    cell = (kx * ny + y) * nz + z
    count = s.cell_start[cell + 1] - s.cell_start[cell]
    if count == 0:
        return
    stride = 2 * s.counter[PLANE_ROOM]
    row = z * (ny + 3) + y + 1
    here = plane * s.counter[PLANE_ROWS] + row
    there = (1 - plane) * s.counter[PLANE_ROWS] + row
    first = s.plane_own[here]
    behind = s.plane_start[here + 2]
    begin, end = s.plane_start[there - 1], s.plane_start[there + 2]
    for k in range(first, first + count):
        i = int(s.plane_ids[k])
        line = line_at(s.planes, stride, k, ZERO, ZERO, ZERO)
        meet_run(s, s.planes, s.plane_ids, stride, k + 1, behind, i, line, ALWAYS)
        meet_run(s, s.planes, s.plane_ids, stride, begin, end, i, line, ALWAYS)


@jit
def meet_all(s):
    """Compare all lines with those of the same and the neighbouring cells, each pair once."""
    fill_plane(s, 0, 0)
    for kx in range(s.counter[CELLS]):
        plane = kx & 1
        fill_plane(s, 1 - plane, kx + 1)
        if s.counter[SHORT_CELLS]:
            return
        for z in range(s.counter[CELLS + 2]):
            for y in range(s.counter[CELLS + 1]):
                meet_cell(s, plane, kx, y, z)
