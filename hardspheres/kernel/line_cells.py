"""The grid of the window method: all lines sorted by cells, and who among them comes near a line.

A line stands in the cell that holds its middle, and reaches no further than half a cell beyond. Cells follow each other in y, so
the lines around a cell stand in nine runs (in 2D three), one for each column of cells along y. Runs are compared by the bounds of
lines, 16 at a time (`compiler.keep_overlapping`): Those that are left are compared as lines (`lines`). To meet each pair once, a line meets all that stand behind it in its own and
the following cell, and four of the columns around.

A particle that has collided has a new line. It takes the place of the old one where it reaches no further beyond that cell than
lines may; otherwise it is chained to those of its cell (`chains`).
"""

import numpy as np

from .candidates import note_wall
from .compiler import AT_ONCE, copy_lanes, jit, keep_overlapping, part, prefetch
from .drafts import cell_at, column_at, pieces_of, write_draft
from .flags import DIM, SIZES, WALLS
from .layout import (
    BUCKET,
    CELLS,
    HALF_WINDOW,
    INVERSE,
    LARGE,
    LINE_ROOM,
    MEETING_ROOM,
    MEETINGS,
    MIDDLE,
    NEAR_ROOM,
    REACH_OF_BOUNDS,
    REGISTERED,
    ROW,
    SHORT_LISTS,
    N,
)
from .lines import (
    BYTE,
    IMAGE,
    LINE,
    SAME,
    UNITS,
    WHOSE,
    boxes,
    examine,
    line_at,
    solve_meetings,
)

ALWAYS = np.float32(-1.00001)  # from the beginning of the window
AHEAD = 12  # particles from here to that whose row is fetched
SEVERAL = -1  # slots of a flight in pieces, which has many
SEEN = -2  # the same, and it has its place in the order


@jit
def in_cells(s):
    """How many particles stand in the cells: all but the large ones (`large`)."""
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
    n = in_cells(s)
    total = n
    for m in range(n):
        i = int(s.order[m])
        prefetch(s.row, s.order[min(m + AHEAD, n - 1)] * ROW)
        pieces = pieces_of(s, i, duration)
        if pieces == 1:
            x, y, z = write_draft(s, m, i, s.number[MIDDLE], duration, 1)
            cell = cell_at(s, x, y, z)
            s.where[i] = cell
            s.cell_count[cell] += 1
            if WALLS and at_edge(s, x, y, z):
                note_wall(s, i)
        else:
            if WALLS:
                note_wall(s, i)
            s.where[i] = -pieces
            total += pieces - 1
            for p in range(pieces):
                x, y, z = write_draft(s, m, i, begin + duration * (p + 0.5) / pieces, duration, pieces)
                s.cell_count[cell_at(s, x, y, z)] += 1
    return total


@jit
def copy_draft(s, k, slot, cell):
    """Copy a draft to a slot."""
    copy_lanes(s.lines, slot * LINE, s.drafts, k * LINE)
    s.bounds[slot] = s.draft_bounds[k]
    s.cell_of_line[slot] = cell


@jit
def insert_draft(s, k, cell):
    """Copy a draft to the lines of its cell, the last free slot first; returns the slot."""
    slot = s.cell_count[cell] - 1
    s.cell_count[cell] = slot
    copy_draft(s, k, slot, cell)
    return slot


@jit
def sort_lines(s, cells, begin, duration):
    """Bring the lines into the order of their cells; `cell_count` then tells where each cell begins."""
    end = 0
    for cell in range(cells):
        end += s.cell_count[cell]
        s.cell_count[cell] = end
    s.cell_count[cells] = end
    for m in range(in_cells(s)):
        i = int(s.order[m])
        cell = int(s.where[i])
        if cell >= 0:
            s.where[i] = insert_draft(s, m, cell)
        else:
            s.where[i] = SEVERAL
            pieces = -cell
            for p in range(pieces):
                x, y, z = write_draft(s, m, i, begin + duration * (p + 0.5) / pieces, duration, pieces)
                insert_draft(s, m, cell_at(s, x, y, z))


@part
def register_all(s, cells, begin):
    """Sort all lines into cells; SHORT_LISTS tells if there was no room."""
    duration = 2.0 * s.number[HALF_WINDOW]
    for cell in range(cells):
        s.cell_count[cell] = 0
    total = count_lines(s, begin, duration)
    s.counter[REGISTERED] = total
    if total > s.counter[LINE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    sort_lines(s, cells, begin, duration)
    if s.counter[BUCKET] == 0:
        keep_order(s)


@part
def keep_order(s):
    """Go through the particles in the order of their cells from now on: it saves waiting for memory, and changes nothing else."""
    m = 0
    for slot in range(s.counter[REGISTERED]):
        i = int(s.line_words[slot * LINE + WHOSE])
        if s.where[i] == slot or s.where[i] == SEVERAL:
            s.order[m] = i
            m += 1
            if s.where[i] == SEVERAL:
                s.where[i] = SEEN


@jit
def around(s, cell, d, grid):
    """Index of a cell of a grid that may lie beyond the box's edge, -1 where there is none, and the image seen there."""
    cells = s.counter[grid + d]
    if 0 <= cell < cells:
        return cell, 0
    if s.number[INVERSE + d] == 0.0:
        return -1, 0
    if cell < 0:
        return cell + cells, IMAGE[d]
    return cell - cells, -IMAGE[d]


@jit
def meet_run(s, m, word, first, last, code, i, line, edges, since):
    """Add to the table, which has m lines, those from `first` to `last` whose bounds overlap `word` in this image; returns how many it has.

    A full table is emptied: its lines are compared with i's.
    """
    for slot in range(first, last, AT_ONCE):
        m = keep_overlapping(s.near, s.near_codes, m, word, s.bounds, slot, last, s.image_shifts[code], code)
        if m > s.counter[NEAR_ROOM]:
            examine(s, m, i, line, edges, since)
            m = 0
    return m


@jit
def meet_column(s, m, word, column, y, code, i, line, edges, since):
    """Do so with the cells from y - 1 to y + 1 of a column."""
    ny = s.counter[CELLS + 1]
    first, last = s.cell_count[column + max(y - 1, 0)], s.cell_count[column + min(y + 1, ny - 1) + 1]
    m = meet_run(s, m, word, first, last, code, i, line, edges, since)
    if y == 0 or y == ny - 1:
        m = meet_beyond(s, m, word, column, y, -1, code, i, line, edges, since)
        m = meet_beyond(s, m, word, column, y, 1, code, i, line, edges, since)
    return m


@jit
def meet_beyond(s, m, word, column, y, step, code, i, line, edges, since):
    """Do so with the cell at y + step of a column, if that lies on the other side of the box."""
    beside, image = around(s, y + step, 1, CELLS)
    if beside < 0 or image == 0:
        return m
    first, last = s.cell_count[column + beside], s.cell_count[column + beside + 1]
    return meet_run(s, m, word, first, last, code + image, i, line, edges, since)


@jit
def find_columns(s, x, z):
    """Find the columns that follow one: those beside it at x + 1, and that at z + 1; returns how many there are."""
    found = 0
    for step in range(4 if DIM == 3 else 1):
        kx, image_x = around(s, x + (1 if DIM == 2 or step > 0 else 0), 0, CELLS)
        kz, image_z = around(s, z + (step - 2 if step > 0 else 1) if DIM == 3 else 0, 2, CELLS)
        if kx >= 0 and kz >= 0:
            s.columns[found] = column_at(s, kx, kz)
            s.column_codes[found] = SAME + image_x + image_z
            found += 1
    return found


@part
def meet_all(s):
    """Compare all lines with those of the same and the neighbouring cells, each pair once."""
    ny = s.counter[CELLS + 1]
    edges = boxes(s)
    for x in range(s.counter[CELLS]):
        for z in range(s.counter[CELLS + 2]):
            own = column_at(s, x, z)
            columns = find_columns(s, x, z)
            for y in range(ny):
                behind = s.cell_count[own + min(y + 2, ny)]
                for k in range(s.cell_count[own + y], s.cell_count[own + y + 1]):
                    i = int(s.line_words[k * LINE + WHOSE])
                    line, word = line_at(s.lines, k), s.bounds[k]
                    m = meet_run(s, 0, word, k + 1, behind, SAME, i, line, edges, ALWAYS)
                    if y == ny - 1:
                        m = meet_beyond(s, m, word, own, y, 1, SAME, i, line, edges, ALWAYS)
                    for a in range(columns):
                        column, code = int(s.columns[a]), int(s.column_codes[a])
                        m = meet_column(s, m, word, column, y, code, i, line, edges, ALWAYS)
                    examine(s, m, i, line, edges, ALWAYS)
                if 2 * s.counter[MEETINGS] > s.counter[MEETING_ROOM]:
                    solve_meetings(s)
    solve_meetings(s)


@jit
def signed(difference):
    """Return a difference of bounds, given with whole turns, without them."""
    return ((difference + 128) & BYTE) - 128


@jit
def fits(s, word, cell, cx, cy, cz):
    """Whether a line with these bounds, whose middle is in (cx, cy, cz), reaches no further beyond another cell than lines may."""
    column = cell // s.counter[CELLS + 1]
    y = cell - column * s.counter[CELLS + 1]
    x = column // s.counter[CELLS + 2]
    z = column - x * s.counter[CELLS + 2]
    inside = (abs(cx - x) <= 1) & (abs(cy - y) <= 1) & (abs(cz - z) <= 1)
    for d in range(DIM):
        reach = s.counter[REACH_OF_BOUNDS + d]
        first = (x if d == 0 else (y if d == 1 else z)) * UNITS - reach
        last = first + UNITS + 2 * reach
        inside &= (signed((word >> 8 * d) - first) >= 0) & (signed(last + (word >> 8 * (d + 3))) >= 0)
    return inside


@jit
def withdraw(s, i):
    """Take the line away that i had."""
    slot = s.where[i]
    if slot >= 0:
        s.lines[slot * LINE] = np.nan


@jit
def replace_line(s, i, k, x, y, z):
    """Put draft k, whose middle is in (x, y, z), in the place of i's old line, if it reaches no further; returns whether it does."""
    slot = s.where[i]
    if slot < 0:
        return False
    cell = int(s.cell_of_line[slot])
    if not fits(s, s.draft_bounds[k], cell, x, y, z):
        return False
    copy_draft(s, k, slot, cell)
    return True
