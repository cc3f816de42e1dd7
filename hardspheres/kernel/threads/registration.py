"""Windows of time where several threads are at work: all segments and contacts, each thread with a share.

The segments of particles that follow each other in their order are written and inserted by one thread: which
comes first in a cell enters no bit. Then each compares those in the cells of its tiles with all near them.
"""

from .. import layout as at
from ..common.contact_times import wall_contact
from ..common.obstacles import is_obstacle
from ..dilute.cells import (
    ALWAYS,
    ENOUGH,
    count_segments,
    in_cells,
    insert_segments,
    keep_order,
    number_of_cells,
    pairs_in_column,
)
from ..dilute.filter import filter_pairs, filter_table
from ..dilute.grid import cells_along_y, columns_after, columns_around, place_of_column
from ..dilute.overflow import lists_before, number_of_lists
from ..dilute.segments import EIGHT
from ..dilute.windows import predict_again
from ..flags import OBSTACLES, WALLS
from ..simd.jit import called, jit
from ..simd.pointers import int64
from .barrier import barrier
from .contacts import enter_contact
from .old_flights import NUMBER, of_this_window
from .tile_buckets import clear_buckets, is_mine, owner


@called
def detect(s):
    """Register all segments and predict all contacts of the window that begins in the current bucket."""
    s.counter[at.PART] = at.RENEWAL
    s.counter[at.LIMIT] = -1  # no contact is due yet
    s.counter[at.SHORT_QUEUE] = 0
    s.counter[at.SHORT_LISTS] = 0
    s.counter[at.WINDOW] += 1  # no old row counts
    duration = 2.0 * s.number[at.HALF_WINDOW]
    moment = s.counter[at.BUCKET] * duration
    s.number[at.MIDDLE] = moment + s.number[at.HALF_WINDOW]
    empty_tables(s)
    barrier(s)
    first, last = share(s, (in_cells(s) + EIGHT - 1) // EIGHT)
    first, last = first * EIGHT, min(last * EIGHT, in_cells(s))
    s.changed_count[s.counter[at.THREAD] * at.LINE] = count_segments(s, first, last, moment, duration)
    barrier(s)
    total = 0
    for thread in range(s.counter[at.THREAD_COUNT]):
        total += s.changed_count[thread * at.LINE]
    s.counter[at.REGISTERED] = total
    if total > s.counter[at.SEGMENT_ROOM]:
        s.counter[at.SHORT_LISTS] = 1
        return
    count_cells_before(s)
    insert_segments(s, first, last, moment, duration)
    barrier(s)
    if s.counter[at.BUCKET] == 0:
        if s.counter[at.THREAD] == 0:
            keep_order(s)
        barrier(s)
    s.counter[at.COMPARING] = 1
    compare_tiles(s)
    s.counter[at.COMPARING] = 0
    s.counter[at.PART] = at.CALENDAR


@jit
def share(s, n):
    """Return this thread's share of n: the first, and the first after it."""
    thread, threads = s.counter[at.THREAD], s.counter[at.THREAD_COUNT]
    return n * thread // threads, n * (thread + 1) // threads


@called
def empty_tables(s):
    """Empty the tables of this thread's tiles, and its share of those of cells."""
    thread = s.counter[at.THREAD]
    s.overflowed[thread * at.LINE] = 0
    for tile in range(s.counter[at.TILES]):
        if owner(s, tile) == thread:
            clear_buckets(s, tile)
            s.contact_count[tile * at.LINE] = 0
    first, last = share(s, number_of_lists(s))
    for head in range(first, last):
        s.overflow_first[head] = -1
    cells = number_of_cells(s)
    for cell in range(thread * cells, (thread + 1) * cells):
        s.thread_count[cell] = 0
    if thread == 0:
        s.home[s.counter[at.SEGMENT_ROOM] * at.HOME] = 1 << at.ALL_TILES


@called
def count_cells_before(s):
    """Find where the segments of each cell begin, and where in it each thread inserts its own."""
    thread, threads, cells = s.counter[at.THREAD], s.counter[at.THREAD_COUNT], number_of_cells(s)
    first, last = share(s, cells)
    own = 0
    for other in range(threads):
        for cell in range(other * cells + first, other * cells + last):
            own += s.thread_count[cell]
    s.undone[thread * at.LINE] = own
    barrier(s)
    end = 0
    for other in range(thread):
        end += s.undone[other * at.LINE]
    for cell in range(first, last):
        s.cell_count[cell] = end
        for other in range(threads):
            end += s.thread_count[other * cells + cell]
            s.thread_count[other * cells + cell] = end
    if thread == threads - 1:
        for empty in range(last, last + s.counter[at.CELLS + 1] + 1):  # stand for all beyond walls
            s.cell_count[empty] = end
    barrier(s)


@called
def compare_tiles(s):
    """Compare the segments of this thread's tiles with all near them: those of two tiles in both."""
    m = int64(0)
    deep = s.counter[at.CELLS + 2]
    for column in range(s.counter[at.CELLS] * deep):
        if is_mine(s, column):
            m = compare_column(s, m, column, column // deep, column % deep)
    filter_table(s, m, ALWAYS)


@jit
def compare_column(s, m, column, x, z):
    """Compare the segments of a column of cells; the table has m pairs. Returns how many are left in it."""
    ny = s.counter[at.CELLS + 1]
    own = place_of_column(s, x, z)
    all_around = OBSTACLES or is_at_edge(s, column, x, z)
    word = int64(s.tile_of_column[column]) << at.TILE_SHIFT | int64(s.inside_in[column])
    for y in range(ny):
        near_list = lists_before(s, column) + y // at.CELLS_OF_OVERFLOW
        for k in range(int64(s.cell_count[column * ny + y]), int64(s.cell_count[column * ny + y + 1])):
            i = int64(s.segment_words[k * at.SEGMENT + at.OWNER])
            s.home[k * at.HOME], s.home[k * at.HOME + at.HOME_LIST] = word, near_list
            if OBSTACLES and is_obstacle(s, i):
                continue
            if WALLS and (s.boxes[k] & at.MAY_REACH_WALL or s.where[i] < 0):
                time, wall = wall_contact(s, i)
                if wall >= 0:
                    enter_contact(s, int64(s.tile_of_column[column]), i, wall, time)
            near = s.boxes[k] >> at.NEAR_SHIFT
            first, last = cells_along_y(s, near, y)
            places = columns_around(s, 0, near, x, z) if all_around else columns_after(s, near, x, z)
            for a in range(places):
                place = s.places[a]
                other = int64(s.column[place])
                least, after = (y, k + 1) if place == own and not OBSTACLES else (first, 0)
                if OBSTACLES or place >= own or s.tile_of_column[other] != s.tile_of_column[column]:
                    m = pairs_in_column(s, m, k, other, least, last, after, int64(s.column_code[place]))
        if m >= ENOUGH:
            filter_pairs(s, m, ALWAYS)
            m = int64(0)
    return m


@jit
def is_at_edge(s, column, x, z):
    """Whether a column has some of another tile around it."""
    layer = s.counter[at.CELLS + 2] + 2
    found = False
    for ox in range(-1, 2):
        for oz in range(-1, 2):
            other = int64(s.column[place_of_column(s, x, z) + ox * layer + oz])
            found |= s.tile_of_column[other] != s.tile_of_column[column]
    return found


@called
def predict_undone(s):
    """Predict those again that have got back the rows with which the window began: one thread for all."""
    s.counter[at.LIMIT] = -1
    if s.counter[at.THREAD] > 0:
        return
    s.counter[at.SHIFT] = at.ALL_TILES
    s.counter[at.LATE] = 0
    s.counter[at.MET] = -1
    for thread in range(s.counter[at.THREAD_COUNT]):
        number = thread * s.counter[at.UNDO_ROOM]
        for k in range(s.undone[thread * at.LINE]):
            old = (number + k) * at.OLD_ROW
            if not of_this_window(s, s.old_rows_int[old + at.OLD_BEFORE]):
                predict_again(s, s.old_rows_int[old + at.OLD_WHO] & NUMBER, -1, s.number[at.WINDOW_BEGIN])
