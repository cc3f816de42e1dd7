"""All segments sorted by cells, and the pairs of segments whose bounding boxes overlap.

A segment is in the cell that holds its middle, and reaches no further than OVERHANG outside of it. Cells
follow each other in y, in which they are narrow, so the segments near another stand in few runs: one for each
column of cells that its box, OVERHANG wider on all sides, overlaps. Runs are compared by their bounding
boxes, 16 at a time (`vectors.keep_overlapping`). What is left is compared as segments (`filter`). To see each
pair once, a segment is compared with all that stand behind it in its own column, in that at z + 1, and in
those at x + 1. With obstacles, only those that move are compared, with all around, and pairs of two of them
are passed on once (`filter`).

The new segment of a particle that has collided takes the place of the old one where it reaches no further
beyond that cell than segments may; otherwise it goes to the overflow list of its cell (`overflow`).
"""

import numpy as np

from .. import layout as at
from ..common.obstacles import is_obstacle
from ..common.prefetch import prefetch_eight_rows
from ..flags import OBSTACLES, SIZES, THREADS, WALLS
from ..simd.jit import called, jit
from ..simd.pointers import int64
from ..simd.vectors import AT_ONCE, copy_lanes, keep_overlapping
from .filter import filter_pairs, filter_table
from .grid import cell_at, cells_along_y, column_at, columns_after, columns_around, fits
from .pair_table import checked, seen_in
from .predicted_contacts import keep_wall_contact
from .segments import CELL, EDGE, EIGHT, FAR, segments_of, write_eight, write_unsorted

if THREADS:
    from ..threads.homes import come_back

ALWAYS = np.float32(-1.00001)  # from the beginning of the window
SEVERAL = -1  # slot of a flight of several segments
ENOUGH = 64  # pairs that are worth a look
SEEN = -2  # the same, and it has its place in the order


@jit
def in_cells(s):
    """How many particles stand in the cells: all but the large ones (`large`)."""
    return s.counter[at.N] - s.counter[at.LARGE] if SIZES else s.counter[at.N]


@jit
def add_to_cell(s, cell, more):
    """Add to the count of a cell, each thread to its own; returns what it is then."""
    if THREADS:
        place = s.counter[at.THREAD] * number_of_cells(s) + cell
        count = s.thread_count[place] + more
        s.thread_count[place] = count
        return count
    count = s.cell_count[cell] + more
    s.cell_count[cell] = count
    return count


@jit
def number_of_cells(s):
    """Return how many cells the box has."""
    return s.counter[at.CELLS] * s.counter[at.CELLS + 1] * s.counter[at.CELLS + 2]


@jit
def count_segments(s, begin, end, moment, duration):
    """Write the segments of particles, from begin to end in their order, and count those of each cell.

    Wall collisions are predicted too; where threads are at work, they are only noted in the bounding box.
    Flights of several segments are written when they are sorted. Returns how many segments there are.
    """
    total = end - begin
    for first in range(begin, end, EIGHT):
        prefetch_eight_rows(s, first, in_cells(s))
        write_eight(s, first, duration)
        for k in range(min(EIGHT, end - first)):
            i = int64(s.order[first + k])
            if s.scratch[FAR + k] < 1.0:
                cell = int64(s.scratch[CELL + k])
                note_cell(s, first + k, i, cell)
                add_to_cell(s, cell, 1)
                if WALLS and s.scratch[EDGE + k] > 0.0:
                    if THREADS:
                        s.unsorted_boxes[first + k] |= at.MAY_REACH_WALL
                    else:
                        keep_wall_contact(s, i)
            else:
                if WALLS and not THREADS:
                    keep_wall_contact(s, i)
                note_cell(s, first + k, i, SEVERAL)
                total += place_parts(s, first + k, i, moment, duration, False) - 1
    return total


@jit
def note_cell(s, m, i, cell):
    """Note the cell of particle i, which is m in the order: where threads do not wait for each other."""
    if THREADS:
        s.cell_of_unsorted[m] = cell
    else:
        s.where[i] = cell


@jit
def insert_segment(s, k, cell):
    """Copy an unsorted segment to the slots of its cell, the last free one first; returns the slot."""
    slot = add_to_cell(s, cell, -1)
    copy_lanes(s.segments, slot * at.SEGMENT, s.unsorted, k * at.SEGMENT)
    s.boxes[slot] = s.unsorted_boxes[k]
    s.cell_of_segment[slot] = cell
    return slot


@jit
def sort_segments(s, cells, begin, duration):
    """Sort the segments by cells; `cell_count` then tells where each cell begins."""
    end = 0
    for cell in range(cells):
        end += s.cell_count[cell]
        s.cell_count[cell] = end
    for empty in range(
        cells, cells + s.counter[at.CELLS + 1] + 1
    ):  # a column that stands for all beyond walls
        s.cell_count[empty] = end
    insert_segments(s, 0, in_cells(s), begin, duration)


@jit
def insert_segments(s, begin, end, moment, duration):
    """Insert the segments of particles, from begin to end in their order, in their cells."""
    for m in range(begin, end):
        i = int64(s.order[m])
        cell = int64(s.cell_of_unsorted[m] if THREADS else s.where[i])
        if cell >= 0:
            s.where[i] = insert_segment(s, m, cell)
        else:
            if THREADS:
                s.where[i] = SEVERAL
            place_parts(s, m, i, moment, duration, True)


@called
def place_parts(s, m, i, begin, duration, insert):
    """Insert the segments of a fast flight in their cells, or only count them; returns how many."""
    parts = segments_of(s, i, duration)
    for p in range(parts):
        x, y, z = write_unsorted(s, m, i, begin + duration * (p + 0.5) / parts, duration, parts)
        cell = cell_at(s, x, y, z)
        if insert:
            insert_segment(s, m, cell)
        else:
            add_to_cell(s, cell, 1)
    return parts


@called
def register_all(s, begin):
    """Sort all segments into cells; SHORT_LISTS tells if there was no room."""
    duration = 2.0 * s.number[at.HALF_WINDOW]
    cells = number_of_cells(s)
    for cell in range(cells):
        s.cell_count[cell] = 0
    total = count_segments(s, 0, in_cells(s), begin, duration)
    s.counter[at.REGISTERED] = total
    if total > s.counter[at.SEGMENT_ROOM]:
        s.counter[at.SHORT_LISTS] = 1
        return
    sort_segments(s, cells, begin, duration)
    if s.counter[at.BUCKET] == 0:
        keep_order(s)


@called
def keep_order(s):
    """From now on go through the particles in the order of their cells: faster, and the same bits."""
    m = int64(0)
    for slot in range(s.counter[at.REGISTERED]):
        i = int64(s.segment_words[slot * at.SEGMENT + at.OWNER])
        if s.where[i] == slot or s.where[i] == SEVERAL:
            s.order[m] = i
            m += 1
            if s.where[i] == SEVERAL:
                s.where[i] = SEEN


@jit
def pairs_in_run(s, m, own, first, last, code):
    """Enter the pairs of a segment, in this image, and those from `first` to `last` with overlapping boxes.

    The table has m pairs; returns how many it has then.
    """
    word, seen, shift = s.boxes[own], seen_in(own, code), s.image_shifts[code]
    for block in range(first, last, AT_ONCE):
        kept = keep_overlapping(s.pair_slot, s.pair_own, m, word, seen, s.boxes, block, last, shift)
        m = checked(s, kept)
    return m


@jit
def pairs_in_column(s, m, own, column, first, last, after, code):
    """Enter the pairs with cells `first` to `last` of a column, even beyond the box, from slot `after` on."""
    ny = s.counter[at.CELLS + 1]
    cells = column * ny
    start = int64(s.cell_count[cells + max(first, 0)])
    stop = int64(s.cell_count[cells + min(last, ny - 1) + 1])
    m = pairs_in_run(s, m, own, max(start, after), stop, code)
    if (first < 0 or last >= ny) and s.number[at.INVERSE + 1] > 0.0:
        m = pairs_beyond(s, m, own, cells, first, last, code)
    return m


@jit
def pairs_beyond(s, m, own, cells, first, last, code):
    """Enter the pairs with those of these cells that lie beyond the box: cells on its other side."""
    ny = s.counter[at.CELLS + 1]
    for turn in range(-1, 2, 2):
        if first < 0 if turn < 0 else last >= ny:
            start = int64(s.cell_count[cells + max(first - turn * ny, 0)])
            stop = int64(s.cell_count[cells + min(last - turn * ny, ny - 1) + 1])
            m = pairs_in_run(s, m, own, start, stop, code - turn * at.IMAGE[1])
    return m


@called
def compare_all(s):
    """Compare all segments with those near them, each pair once; obstacles with those that move."""
    ny = s.counter[at.CELLS + 1]
    m = int64(0)
    for x in range(s.counter[at.CELLS]):
        for z in range(s.counter[at.CELLS + 2]):
            cells = column_at(s, x, z) * ny
            for y in range(ny):
                for k in range(int64(s.cell_count[cells + y]), int64(s.cell_count[cells + y + 1])):
                    if OBSTACLES and is_obstacle(s, s.segment_words[k * at.SEGMENT + at.OWNER]):
                        continue
                    near = s.boxes[k] >> at.NEAR_SHIFT
                    first, last = cells_along_y(s, near, y)
                    places = columns_around(s, 0, near, x, z) if OBSTACLES else columns_after(s, near, x, z)
                    for a in range(places):
                        column, code = int64(s.column[s.places[a]]), int64(s.column_code[s.places[a]])
                        least, after = (y, k + 1) if a == 0 and not OBSTACLES else (first, 0)
                        m = pairs_in_column(s, m, k, column, least, last, after, code)
                    if m >= ENOUGH:
                        filter_pairs(s, m, ALWAYS)
                        m = int64(0)
    filter_table(s, m, ALWAYS)


@jit
def withdraw(s, i):
    """Remove i's segment: no pair passes the filter with a radius of NaN."""
    slot = s.where[i]
    if slot >= 0:
        s.segments[slot * at.SEGMENT + at.PADDED_RADIUS] = np.nan


@jit
def replace_segment(s, i, new, x, y, z):
    """Put i's new segment, of cell (x, y, z), in the place of the old one; returns whether it fits."""
    slot = s.where[i]
    if slot < 0 or not fits(s, s.boxes[new], int64(s.cell_of_segment[slot]), x, y, z):
        return False
    copy_lanes(s.segments, slot * at.SEGMENT, s.segments, new * at.SEGMENT)
    s.boxes[slot] = s.boxes[new]
    if THREADS:
        come_back(s, slot)
    return True
