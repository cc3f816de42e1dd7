"""The grid of the window method: all lines sorted by cells, and who among them comes near a line.

A line stands in the cell that holds its middle, and reaches no further than OVERHANG outside of it. Cells follow each other in y,
in which they are narrow, so the lines near another stand in few runs: one for each column of cells that its box, OVERHANG wider on
all sides, overlaps. Runs are compared by the bounds of lines, 16 at a time (`compiler.keep_overlapping`). Those that are left are
compared as lines (`segments`). To meet each pair once, a line meets all that stand behind it in its own column, in that at z + 1, and
in those at x + 1.

A particle that has collided has a new line. It takes the place of the old one where it reaches no further beyond that cell than
lines may; otherwise it is chained to those of its cell (`chains`).
"""

import numpy as np

from ..flags import SIZES, WALLS
from ..layout import (
    BUCKET,
    CELLS,
    HALF_WINDOW,
    IMAGE,
    INVERSE,
    LARGE,
    NEAR_SHIFT,
    OWNER,
    PADDED_RADIUS,
    REGISTERED,
    ROW,
    SEGMENT,
    SEGMENT_ROOM,
    SHORT_LISTS,
    N,
)
from ..simd.jit import called, jit
from ..simd.pointers import int64, prefetch
from ..simd.vectors import AT_ONCE, copy_lanes, keep_overlapping
from .filter import filter_pairs, filter_table
from .grid import cell_at, cells_along_y, column_at, columns_after, fits
from .pair_table import checked, seen_in
from .predicted_contacts import keep_wall_contact
from .segments import CELL, EDGE, EIGHT, FAR, segments_of, write_eight, write_unsorted

ALWAYS = np.float32(-1.00001)  # from the beginning of the window
AHEAD = 16  # particles from here to that whose row is fetched
SEVERAL = -1  # slots of a flight in pieces, which has many
ENOUGH = 64  # pairs that are worth a look
SEEN = -2  # the same, and it has its place in the order


@jit
def in_cells(s):
    """How many particles stand in the cells: all but the large ones (`large`)."""
    return s.counter[N] - s.counter[LARGE] if SIZES else s.counter[N]


@jit
def count_segments(s, begin, duration):
    """Draft the lines of all particles, count those of each cell, and find who meets a wall.

    Flights in several pieces are drafted later.
    """
    n = in_cells(s)
    total = n
    for first in range(0, n, EIGHT):
        for k in range(EIGHT):
            prefetch(s.row, s.order[min(first + AHEAD + k, n - 1)] * ROW)
        write_eight(s, first, duration)
        for k in range(min(EIGHT, n - first)):
            i = int64(s.order[first + k])
            if s.scratch[FAR + k] < 1.0:
                cell = int64(s.scratch[CELL + k])
                s.where[i] = cell
                s.cell_count[cell] += 1
                if WALLS and s.scratch[EDGE + k] > 0.0:
                    keep_wall_contact(s, i)
            else:
                if WALLS:
                    keep_wall_contact(s, i)
                s.where[i] = SEVERAL
                total += place_parts(s, first + k, i, begin, duration, False) - 1
    return total


@jit
def insert_segment(s, k, cell):
    """Copy a draft to the lines of its cell, the last free slot first; returns the slot."""
    slot = s.cell_count[cell] - 1
    s.cell_count[cell] = slot
    copy_lanes(s.segments, slot * SEGMENT, s.unsorted, k * SEGMENT)
    s.boxes[slot] = s.unsorted_boxes[k]
    s.cell_of_segment[slot] = cell
    return slot


@jit
def sort_segments(s, cells, begin, duration):
    """Bring the lines into the order of their cells; `cell_count` then tells where each cell begins."""
    end = 0
    for cell in range(cells):
        end += s.cell_count[cell]
        s.cell_count[cell] = end
    for empty in range(cells, cells + s.counter[CELLS + 1] + 1):  # a column that stands for all beyond walls
        s.cell_count[empty] = end
    for m in range(in_cells(s)):
        i = int64(s.order[m])
        cell = int64(s.where[i])
        if cell >= 0:
            s.where[i] = insert_segment(s, m, cell)
        else:
            place_parts(s, m, i, begin, duration, True)


@called
def place_parts(s, m, i, begin, duration, insert):
    """Bring the lines of a flight in pieces into the cells of their middles, or only count them there; returns how many there are."""
    parts = segments_of(s, i, duration)
    for p in range(parts):
        x, y, z = write_unsorted(s, m, i, begin + duration * (p + 0.5) / parts, duration, parts)
        cell = cell_at(s, x, y, z)
        if insert:
            insert_segment(s, m, cell)
        else:
            s.cell_count[cell] += 1
    return parts


@called
def register_all(s, cells, begin):
    """Sort all lines into cells; SHORT_LISTS tells if there was no room."""
    duration = 2.0 * s.number[HALF_WINDOW]
    for cell in range(cells):
        s.cell_count[cell] = 0
    total = count_segments(s, begin, duration)
    s.counter[REGISTERED] = total
    if total > s.counter[SEGMENT_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    sort_segments(s, cells, begin, duration)
    if s.counter[BUCKET] == 0:
        keep_order(s)


@called
def keep_order(s):
    """Go through the particles in the order of their cells from now on: it saves waiting for memory, and changes nothing else."""
    m = int64(0)
    for slot in range(s.counter[REGISTERED]):
        i = int64(s.segment_words[slot * SEGMENT + OWNER])
        if s.where[i] == slot or s.where[i] == SEVERAL:
            s.order[m] = i
            m += 1
            if s.where[i] == SEVERAL:
                s.where[i] = SEEN


@jit
def pairs_in_run(s, m, own, first, last, code):
    """Enter the pairs of a line, seen in this image, and those from `first` to `last` whose bounds overlap.

    The table has m pairs; returns how many it has then.
    """
    word, seen, shift = s.boxes[own], seen_in(own, code), s.image_shifts[code]
    for block in range(first, last, AT_ONCE):
        kept = keep_overlapping(s.pair_slot, s.pair_own, m, word, seen, s.boxes, block, last, shift)
        m = checked(s, kept)
    return m


@jit
def pairs_in_column(s, m, own, column, first, last, after, code):
    """Do so with the cells from `first` to `last` of a column, which may lie beyond the box, and with slots that are not before `after`."""
    ny = s.counter[CELLS + 1]
    cells = column * ny
    start = int64(s.cell_count[cells + max(first, 0)])
    stop = int64(s.cell_count[cells + min(last, ny - 1) + 1])
    m = pairs_in_run(s, m, own, max(start, after), stop, code)
    if (first < 0 or last >= ny) and s.number[INVERSE + 1] > 0.0:
        m = pairs_beyond(s, m, own, cells, first, last, code)
    return m


@jit
def pairs_beyond(s, m, own, cells, first, last, code):
    """Do so with those of these cells that lie beyond the box, on its other side."""
    ny = s.counter[CELLS + 1]
    for turn in range(-1, 2, 2):
        if first < 0 if turn < 0 else last >= ny:
            start = int64(s.cell_count[cells + max(first - turn * ny, 0)])
            stop = int64(s.cell_count[cells + min(last - turn * ny, ny - 1) + 1])
            m = pairs_in_run(s, m, own, start, stop, code - turn * IMAGE[1])
    return m


@called
def compare_all(s):
    """Compare all lines with those near them, each pair once: in a line's own column those that stand behind it."""
    ny = s.counter[CELLS + 1]
    m = int64(0)
    for x in range(s.counter[CELLS]):
        for z in range(s.counter[CELLS + 2]):
            cells = column_at(s, x, z) * ny
            for y in range(ny):
                for k in range(int64(s.cell_count[cells + y]), int64(s.cell_count[cells + y + 1])):
                    near = s.boxes[k] >> NEAR_SHIFT
                    first, last = cells_along_y(s, near, y)
                    for a in range(columns_after(s, near, x, z)):
                        column, code = int64(s.column[s.places[a]]), int64(s.column_code[s.places[a]])
                        least, after = (y, k + 1) if a == 0 else (first, 0)
                        m = pairs_in_column(s, m, k, column, least, last, after, code)
                    if m >= ENOUGH:
                        filter_pairs(s, m, ALWAYS)
                        m = int64(0)
    filter_table(s, m, ALWAYS)


@jit
def withdraw(s, i):
    """Take the line away that i had."""
    slot = s.where[i]
    if slot >= 0:
        s.segments[slot * SEGMENT + PADDED_RADIUS] = np.nan


@jit
def replace_segment(s, i, new, x, y, z):
    """Put i's new line, whose middle is in (x, y, z), in the place of the old one, if it reaches no further; returns whether it does."""
    slot = s.where[i]
    if slot < 0 or not fits(s, s.boxes[new], int64(s.cell_of_segment[slot]), x, y, z):
        return False
    copy_lanes(s.segments, slot * SEGMENT, s.segments, new * SEGMENT)
    s.boxes[slot] = s.boxes[new]
    return True
