"""The window method, for dilute gases: which particles can collide within a short common window of time.

In a window every free flight is a known straight segment, and few segments come near another. Each flight is
registered in the cell that holds the middle of its segment; a fast flight has several segments, so that none
reaches further than HALF_LENGTH from its middle (the geometry of the cells: `hardspheres.windows`). Segments
are compared with those around them (`cells`): first their bounding boxes, in bytes, then whether the two come
within contact during the window (`filter`). These filters have safe margins. Whatever passes them is computed
exactly from the rows, so the filters never enter the trajectory. Contacts within the window are kept until
they happen or become stale (`predicted_contacts`). A particle that has collided gets a new segment, which is
compared with those around it and then takes the place of the old one, or goes to an overflow list
(`overflow`).

There are no events but collisions: particles that cannot collide are registered, and nothing else.
"""

import numpy as np

from .. import layout as at
from ..common.bucket_queue import clear_buckets
from ..common.obstacles import is_obstacle
from ..common.prefetch import prefetch_runs, prefetch_segments
from ..flags import OBSTACLES, SIZES, THREADS, WALLS
from ..simd.jit import called, jit
from ..simd.pointers import int64
from .cells import ALWAYS, SEVERAL, compare_all, pairs_in_column, register_all, replace_segment, withdraw
from .filter import filter_pairs, filter_table, new_segment
from .grid import cell_at, cells_along_y, columns_around
from .large import clear_large, is_large, overflow_large, pairs_with_large, pairs_with_small
from .overflow import append_overflow, clear_overflow, list_at, pairs_in_lists
from .predicted_contacts import keep_wall_contact
from .segments import segments_of, write_segment

if THREADS:
    from ..threads.contacts import put_search_off
    from ..threads.homes import column_of_segment, move_home
    from ..threads.old_flights import compare_with_old
    from ..threads.tiles import is_inside

# Of each of the particles that an event has changed, int64.
WHO = 0
PARTS = 1  # segments of its new flight
CELL = 2  # that holds the middle of the present segment, 3 slots
FIRST = 5  # first and last cell along y near it
PLACES = 7  # how many columns are near it
CHANGED = 8
MOST_PLACES = 16  # in the table of columns


@jit
def detect(s):
    """Register all segments and predict all contacts of the window that begins in the current bucket."""
    s.counter[at.CONTACTS] = 0
    s.counter[at.OVERFLOWED] = 0
    s.counter[at.SHORT_LISTS] = 0
    s.counter[at.SHORT_QUEUE] = 0
    s.counter[at.HEAP_LENGTH] = 0
    clear_buckets(s, s.counter[at.WINDOW_BUCKETS])
    begin = s.counter[at.BUCKET] // s.counter[at.WINDOW_BUCKETS] * (2.0 * s.number[at.HALF_WINDOW])
    s.number[at.MIDDLE] = begin + s.number[at.HALF_WINDOW]
    clear_overflow(s)
    register_all(s, begin)
    if s.counter[at.SHORT_LISTS]:
        return
    if SIZES:
        register_large(s, begin)
        if s.counter[at.SHORT_LISTS]:
            return
    compare_all(s)


@called
def register_large(s, begin):
    """Compare the segments of all large particles with all others, and register them in the coarse grid."""
    clear_large(s)
    duration = 2.0 * s.number[at.HALF_WINDOW]
    new = new_segment(s)
    for a in range(s.counter[at.LARGE]):
        i = int64(s.large[a])
        s.where[i] = SEVERAL
        if WALLS:
            keep_wall_contact(s, i)
        parts = segments_of(s, i, duration)
        for p in range(parts):
            time = begin + duration * (p + 0.5) / parts
            write_new(s, new, i, time, duration, parts)
            m = pairs_with_small(s, 0, i, new, time)
            if not (OBSTACLES and is_obstacle(s, i)):  # obstacles come first
                m = pairs_with_large(s, m, i, new, time)
            filter_table(s, m, ALWAYS)
            overflow_large(s, i, new, time, p == 0)
    if s.counter[at.SHORT_LISTS]:
        s.counter[at.OVERFLOWED] = 0  # more segments than there is room for, and none of them was replaced


@jit
def predict_again(s, i, j, now):
    """Predict what i and j (or -1), whose rows have changed, do in the rest of the window; register both.

    Both are searched at once: each step waits for the one before, but not for those of the other. Then they
    do not see each other, but they fly apart. Flights of several segments, which may lead round the box, are
    searched one after the other.
    """
    duration = s.number[at.MIDDLE] + s.number[at.HALF_WINDOW] - now
    changed = 2 if j >= 0 else 1
    s.changed[WHO], s.changed[CHANGED + WHO] = i, j
    s.changed[CHANGED + PARTS] = 0
    most = 0
    for a in range(changed):
        who = s.changed[a * CHANGED + WHO]
        withdraw(s, who)
        if WALLS:
            keep_wall_contact(s, who)
        parts = segments_of(s, who, duration) if duration > 0.0 else 0
        s.changed[a * CHANGED + PARTS] = parts
        most = max(most, parts)
    apart = most > 1
    for step in range(s.changed[PARTS] + s.changed[CHANGED + PARTS] if apart else most):
        second = step >= s.changed[PARTS]
        begin = 1 if apart and second else 0
        end = begin + 1 if apart else changed
        search_part(s, begin, end, step - s.changed[PARTS] if second else step, now, duration)


@jit
def search_part(s, begin, end, p, now, duration):
    """Predict the contacts of segment p of the new flights from `begin` to `end`, and register it."""
    since = np.float32((now - s.number[at.MIDDLE]) / s.number[at.HALF_WINDOW] - 1e-5)
    for a in range(begin, end):
        write_part(s, a, p, now, duration)
        if THREADS and is_put_off(s, a, p, now):
            continue
        find_runs(s, a)
        if THREADS and s.counter[at.LATE]:
            look_back(s, a, now)
    m = int64(0)
    for a in range(begin, end):
        m = pairs_of_part(s, m, a, p, now, duration)
    filter_pairs(s, m, since)
    for a in range(begin, end):
        register_part(s, a, p, now, duration)


@jit
def is_put_off(s, a, p, now):
    """Whether a search has to wait for another round: it would leave the domain."""
    parts = s.changed[a * CHANGED + PARTS]
    column = column_of_segment(s, new_segment(s) + a)
    waits = s.counter[at.SHIFT] != at.ALL_TILES and (parts > 1 or not is_inside(s, column))
    if waits:
        s.changed[a * CHANGED + PLACES] = -1
        if p == 0:
            put_search_off(s, s.changed[a * CHANGED + WHO], met_by(s, a), now)
    return waits


@jit
def met_by(s, a):
    """Whom a particle has just met, -1 for a wall."""
    met = s.counter[at.MET]  # by one whose search was put off
    return met if met >= 0 else s.changed[(1 - a) * CHANGED + WHO]


@called
def look_back(s, a, now):
    """Compare a new flight with those around it that others have replaced too early (`old_flights`)."""
    i, met, begin = s.changed[a * CHANGED + WHO], met_by(s, a), a * MOST_PLACES
    first, last = s.changed[a * CHANGED + FIRST], s.changed[a * CHANGED + FIRST + 1]
    ny = s.counter[at.CELLS + 1]
    for k in range(begin, begin + s.changed[a * CHANGED + PLACES]):
        column = int64(s.column[s.places[k]])
        for turn in range(-1, 2):
            low, high = max(first + turn * ny, 0), min(last + turn * ny, ny - 1)
            if low <= high and (turn == 0 or s.number[at.INVERSE + 1] > 0.0):
                compare_with_old(s, i, met, column, low, high, now)


@jit
def middle_of_part(s, a, p, now, duration):
    """Time at the middle of segment p of a new flight."""
    return now + duration * (p + 0.5) / s.changed[a * CHANGED + PARTS]


@jit
def write_part(s, a, p, now, duration):
    """Write segment p of a new flight."""
    i, parts = s.changed[a * CHANGED + WHO], s.changed[a * CHANGED + PARTS]
    x, y, z = write_new(s, new_segment(s) + a, i, middle_of_part(s, a, p, now, duration), duration, parts)
    cell = a * CHANGED + CELL
    s.changed[cell], s.changed[cell + 1], s.changed[cell + 2] = x, y, z
    if THREADS:
        s.cell_of_segment[new_segment(s) + a] = cell_at(s, x, y, z)


@jit
def cell_of_part(s, a):
    """Cell that holds the middle of the present segment."""
    return s.changed[a * CHANGED + CELL], s.changed[a * CHANGED + CELL + 1], s.changed[a * CHANGED + CELL + 2]


@jit
def pairs_of_part(s, m, a, p, now, duration):
    """Enter the pairs of a new segment and those near it in the table, which has m."""
    if SIZES:
        i, new = s.changed[a * CHANGED + WHO], new_segment(s) + a
        time = middle_of_part(s, a, p, now, duration)
        m = pairs_with_small(s, m, i, new, time) if is_large(s, i) else pairs_around(s, m, a)
        return pairs_with_large(s, m, i, new, time)
    return pairs_around(s, m, a)


@jit
def register_part(s, a, p, now, duration):
    """Register a new segment: in the place of the old one, or in an overflow list."""
    i, new = s.changed[a * CHANGED + WHO], new_segment(s) + a
    if THREADS and s.changed[a * CHANGED + PLACES] < 0:
        return
    if SIZES and is_large(s, i):
        overflow_large(s, i, new, middle_of_part(s, a, p, now, duration), p == 0)
        return
    x, y, z = cell_of_part(s, a)
    if s.changed[a * CHANGED + PARTS] > 1 or not replace_segment(s, i, new, x, y, z):
        append_overflow(s, new, list_at(s, x, y, z))
        if THREADS:
            move_home(s, i, new, s.changed[a * CHANGED + PARTS] > 1)


@jit
def write_new(s, new, i, t, duration, parts):
    """Write a new segment of i."""
    return write_segment(s, s.segments, s.segment_words, s.boxes, new, i, t, duration, parts)


@jit
def find_runs(s, a):
    """Find the columns with segments that may overlap a new one."""
    x, y, z = cell_of_part(s, a)
    near = s.boxes[new_segment(s) + a] >> at.NEAR_SHIFT
    first, last = cells_along_y(s, near, y)
    s.changed[a * CHANGED + FIRST], s.changed[a * CHANGED + FIRST + 1] = first, last
    begin = a * MOST_PLACES
    k = columns_around(s, begin, near, x, z)
    s.changed[a * CHANGED + PLACES] = k - begin
    prefetch_runs(s, begin, k, first)


@jit
def pairs_around(s, m, a):
    """Enter the pairs of a new segment and those whose boxes overlap its own; returns how many there are."""
    new, begin = new_segment(s) + a, a * MOST_PLACES
    first, last = s.changed[a * CHANGED + FIRST], s.changed[a * CHANGED + FIRST + 1]
    for k in range(begin, begin + s.changed[a * CHANGED + PLACES]):
        column, code = int64(s.column[s.places[k]]), int64(s.column_code[s.places[k]])
        before = m
        m = pairs_in_column(s, m, new, column, first, last, 0, code)
        prefetch_segments(s, before, m)
        m = overflow_pairs_around(s, m, new, column, first, last, code)
    return m


@jit
def overflow_pairs_around(s, m, new, column, first, last, code):
    """Enter the pairs with the overflow lists of cells, even beyond the box; returns how many there are."""
    ny = s.counter[at.CELLS + 1]
    m = pairs_in_lists(s, m, new, column, max(first, 0), min(last, ny - 1), code)
    if s.number[at.INVERSE + 1] > 0.0:
        if first < 0:
            m = pairs_in_lists(s, m, new, column, max(first + ny, 0), ny - 1, code + at.IMAGE[1])
        if last >= ny:
            m = pairs_in_lists(s, m, new, column, 0, min(last - ny, ny - 1), code - at.IMAGE[1])
    return m
