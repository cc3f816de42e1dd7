"""Rows of the window method: all lines, laid out so that those around a cell stand in few contiguous runs.

Row (x, z, y) holds the lines of the cells (x, y, z - 1), (x, y, z) and (x, y, z + 1), in this order, shifted where a cell is on
the other side of the box; so each line stands in three rows (in 2D in one). Rows follow each other in y. The lines around a
cell are then three runs, of the rows y - 1 to y + 1 at x - 1, x and x + 1. To meet each pair once, a line meets all that stand
behind it in its own and the following row, and the three rows at x + 1. The lines are first sorted by cells, with z running
fastest, so that nearly every row is a copy of one contiguous run of them.
"""

import math

import numpy as np

from .candidates import note_wall
from .compiler import LANES, copy_lanes, jit, part, prefetch
from .flags import DIM, SIZES, WALLS
from .layout import (
    BOX,
    BUCKET,
    CELL_DENSITY,
    CELLS,
    CORE,
    HALF_WINDOW,
    INVERSE,
    LARGE,
    LINE_LANES,
    LINE_MARGIN,
    LINE_ROOM,
    LINE_UNIT,
    MEETING_ROOM,
    MEETINGS,
    MIDDLE,
    RADIUS,
    REGISTERED,
    ROW,
    SHORT_LISTS,
    STRETCH,
    N,
    T,
    V,
    X,
)
from .lines import ALL, LINE, PLACE, REACH_OF_LINE, WAY, ZERO, line_at, meet_run, shifted, solve_meetings

ALWAYS = np.float32(-1.00001)  # from the beginning of the window
AHEAD = 12  # particles from here to that whose row is fetched
COPIES = 3 if DIM == 3 else 1  # of each line
MANY = 1000000  # pieces; more than anybody can need


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
def cell_of(s, i, d, t):
    """Cell along axis d that holds i at time t, and how far the box that holds it is shifted."""
    x = s.row[i * ROW + X + d] + s.row[i * ROW + V + d] * (t - s.row[i * ROW + T])
    shift = s.number[BOX + d] * np.floor(x * s.number[INVERSE + d])  # INVERSE is 0 between walls
    cell = (x - shift) * s.number[CELL_DENSITY + d]
    cell = max(0.0, cell)  # written so that not even a NaN leaves the grid
    return min(int(cell), s.counter[CELLS + d] - 1), shift


@jit
def draft_line(s, drafts, k, i, t, pieces):
    """Write i's line, in the image that is in the box at time t, to draft k; returns the cell (x, y, z) that holds i then."""
    ri = i * ROW
    dt = s.number[MIDDLE] - s.row[ri + T]
    unit = s.number[LINE_UNIT]
    x, shift_x = cell_of(s, i, 0, t)
    y, shift_y = cell_of(s, i, 1, t)
    z, shift_z = 0, 0.0
    if DIM == 3:
        z, shift_z = cell_of(s, i, 2, t)
    for d in range(DIM):
        shift = shift_x if d == 0 else (shift_y if d == 1 else shift_z)
        place = s.row[ri + X + d] + s.row[ri + V + d] * dt
        drafts[k * LINE + PLACE + d] = (place - shift) * unit
        drafts[k * LINE + WAY + d] = s.row[ri + V + d] * s.number[HALF_WINDOW] * unit
    reach = (s.row[ri + RADIUS] if SIZES else s.number[CORE]) * unit + s.number[LINE_MARGIN]
    if pieces > 1:
        reach += 3e-3 * pieces * s.number[STRETCH] * unit
    drafts[k * LINE + REACH_OF_LINE] = reach
    return x, y, z


@jit
def cell_at(s, x, y, z):
    """Index of a cell."""
    return (x * s.counter[CELLS + 1] + y) * s.counter[CELLS + 2] + z


@jit
def row_at(s, x, y, z):
    """Index of the row with this cell in its middle."""
    return (x * s.counter[CELLS + 2] + z) * s.counter[CELLS + 1] + y


@jit
def in_rows(s):
    """How many particles stand in the rows: all but the large ones (`large`)."""
    return s.counter[N] - s.counter[LARGE] if SIZES else s.counter[N]


@jit
def at_edge(s, x, y, z):
    """Whether a cell lies at a wall: flights in one piece whose middle is in another cell reach none."""
    edge = False
    for d in range(DIM):
        cell = x if d == 0 else (y if d == 1 else z)
        edge |= (s.number[INVERSE + d] == 0.0) & ((cell == 0) | (cell == s.counter[CELLS + d] - 1))
    return edge


@jit
def count_lines(s, begin, duration):
    """Draft the lines of all particles, count those of each cell, and find who meets a wall.

    A flight in several pieces is drafted later.
    """
    n = in_rows(s)
    total = n
    for m in range(n):
        i = int(s.order[m])
        prefetch(s.row, s.order[min(m + AHEAD, n - 1)] * ROW)
        pieces = pieces_of(s, i, duration)
        if pieces == 1:
            x, y, z = draft_line(s, s.drafts, m, i, s.number[MIDDLE], 1)
            cell = cell_at(s, x, y, z)
            s.where[m] = cell
            s.cell_count[cell] += 1
            if WALLS and at_edge(s, x, y, z):
                note_wall(s, i)
        else:
            if WALLS:
                note_wall(s, i)
            s.where[m] = -pieces
            total += pieces - 1
            for p in range(pieces):
                x, y, z = draft_line(s, s.drafts, m, i, begin + duration * (p + 0.5) / pieces, pieces)
                s.cell_count[cell_at(s, x, y, z)] += 1
    return total


@jit
def insert_draft(s, k, i, cell):
    """Copy a draft to the lines of its cell, the last free slot first."""
    slot = s.cell_count[cell] - 1
    s.cell_count[cell] = slot
    room = s.counter[LINE_ROOM] // COPIES
    for d in range(DIM):
        s.cell_lines[(PLACE + d) * room + slot] = s.drafts[k * LINE + PLACE + d]
        s.cell_lines[(WAY + d) * room + slot] = s.drafts[k * LINE + WAY + d]
    s.cell_lines[REACH_OF_LINE * room + slot] = s.drafts[k * LINE + REACH_OF_LINE]
    s.cell_line_ids[slot] = i


@jit
def sort_lines(s, cells, begin, duration):
    """Bring the lines into the order of their cells; `cell_count` then tells where each cell begins."""
    end = 0
    for cell in range(cells):
        end += s.cell_count[cell]
        s.cell_count[cell] = end
    s.cell_count[cells] = end
    for m in range(in_rows(s)):
        i = int(s.order[m])
        if s.where[m] >= 0:
            insert_draft(s, m, i, int(s.where[m]))
        else:
            pieces = -int(s.where[m])
            for p in range(pieces):
                x, y, z = draft_line(s, s.drafts, m, i, begin + duration * (p + 0.5) / pieces, pieces)
                insert_draft(s, m, i, cell_at(s, x, y, z))


@jit
def copy_lines(s, place, first, last):
    """Copy lines from the order of cells to a place in the rows, whole vectors at a time; returns the place behind them.

    What a vector is too long for is overwritten by what comes next.
    """
    room, own_room = s.counter[LINE_ROOM], s.counter[LINE_ROOM] // COPIES
    for block in range(first, last, LANES):
        to = place + block - first
        for column in range(LINE - 1):
            copy_lanes(s.lines, column * room + to, s.cell_lines, column * own_room + block)
        copy_lanes(s.line_ids, to, s.cell_line_ids, block)
    return place + last - first


@jit
def copy_layer(s, place, x, y, z):
    """Copy the lines of a cell, whose z may lie beyond the box, to the rows; returns the place behind them."""
    other, shift = around(s, z, 2, CELLS)
    if other < 0:
        return place
    cell = cell_at(s, x, y, other)
    behind = copy_lines(s, place, s.cell_count[cell], s.cell_count[cell + 1])
    if shift != ZERO:
        for slot in range(place, behind):
            s.lines[(PLACE + 2) * s.counter[LINE_ROOM] + slot] += shift
    return behind


@part
def lay_out_rows(s):
    """Make all rows from the lines of the cells; in 2D these are the rows already."""
    nx, ny, nz = s.counter[CELLS], s.counter[CELLS + 1], s.counter[CELLS + 2]
    place = 0
    row = 0
    for x in range(nx):
        for z in range(nz):
            for y in range(ny):
                cell = cell_at(s, x, y, z)
                first, last = int(s.cell_count[cell]), int(s.cell_count[cell + 1])
                s.row_start[row] = place
                if DIM == 2:
                    s.row_own[row] = place
                    place = last
                    s.row_above[row] = place
                elif 0 < z < nz - 1:
                    below = int(s.cell_count[cell - 1])
                    s.row_own[row] = place + first - below
                    s.row_above[row] = place + last - below
                    place = copy_lines(s, place, below, int(s.cell_count[cell + 2]))
                else:
                    place = copy_layer(s, place, x, y, z - 1)
                    s.row_own[row] = place
                    place = copy_lines(s, place, first, last)
                    s.row_above[row] = place
                    place = copy_layer(s, place, x, y, z + 1)
                row += 1
    s.row_start[row] = place


@part
def register_all(s, cells, begin):
    """Lay all lines out in rows; SHORT_LISTS tells if there was no room."""
    duration = 2.0 * s.number[HALF_WINDOW]
    for cell in range(cells):
        s.cell_count[cell] = 0
        s.row_chain[cell] = -1
    total = count_lines(s, begin, duration)
    s.counter[REGISTERED] = total
    if COPIES * total + LINE_LANES > s.counter[LINE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    sort_lines(s, cells, begin, duration)
    lay_out_rows(s)
    if s.counter[BUCKET] == 0:
        keep_order(s)


@part
def keep_order(s):
    """Go through the particles in the order of their cells from now on: it saves waiting for memory, and changes nothing else."""
    for i in range(s.counter[N]):
        s.where[i] = 0
    m = 0
    for slot in range(s.counter[REGISTERED]):
        i = int(s.cell_line_ids[slot])
        if s.where[i] == 0:
            s.where[i] = 1
            s.order[m] = i
            m += 1


@jit
def around(s, cell, d, grid):
    """Index of a cell of a grid that may lie beyond the box's edge, -1 where there is none, and how far it is shifted."""
    cells = s.counter[grid + d]
    if 0 <= cell < cells:
        return cell, ZERO
    if s.number[INVERSE + d] == 0.0:
        return -1, ZERO
    length = np.float32(s.number[BOX + d] * s.number[LINE_UNIT])
    if cell < 0:
        return cell + cells, -length
    return cell - cells, length


@jit
def meet_rows(s, row, y, i, other, line, since):
    """Compare i's line with the rows from y - 1 to y + 1 of those that begin with `row`."""
    ny = s.counter[CELLS + 1]
    first, last = row + max(y - 1, 0), row + min(y + 1, ny - 1)
    room = s.counter[LINE_ROOM]
    meet_run(s, room, s.row_start[first], s.row_start[last + 1], i, other, line, since)
    if last - first < 2:
        meet_beyond(s, row, y, -1, i, other, line, since)
        meet_beyond(s, row, y, 1, i, other, line, since)


@part
def meet_beyond(s, row, y, step, i, other, line, since):
    """Compare i's line with the row at y + step, if that lies on the other side of the box."""
    beside, shift = around(s, y + step, 1, CELLS)
    if beside >= 0 and shift != ZERO:
        first, last = s.row_start[row + beside], s.row_start[row + beside + 1]
        meet_run(s, s.counter[LINE_ROOM], first, last, i, other, shifted(line, ZERO, -shift), since)


@part
def meet_all(s):
    """Compare all lines with those of the same and the neighbouring cells, each pair once."""
    nx, ny, nz = s.counter[CELLS], s.counter[CELLS + 1], s.counter[CELLS + 2]
    room = s.counter[LINE_ROOM]
    for x in range(nx):
        right, shift = around(s, x + 1, 0, CELLS)
        for z in range(nz):
            row = (x * nz + z) * ny
            beside = (right * nz + z) * ny
            for y in range(ny):
                behind = s.row_start[row + min(y + 2, ny)]
                for k in range(s.row_own[row + y], s.row_above[row + y]):
                    i = int(s.line_ids[k])
                    line = line_at(s.lines, room, k)
                    meet_run(s, room, k + 1, behind, i, ALL, line, ALWAYS)
                    if y == ny - 1:
                        meet_beyond(s, row, y, 1, i, ALL, line, ALWAYS)
                    if right >= 0:
                        meet_rows(s, beside, y, i, ALL, shifted(line, -shift, ZERO), ALWAYS)
                if 2 * s.counter[MEETINGS] > s.counter[MEETING_ROOM]:
                    solve_meetings(s)
    solve_meetings(s)
