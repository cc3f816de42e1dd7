"""Neighbour lists where several threads are at work: one list in a round, or all of them together."""

from .. import layout as at
from ..common.contact_times import NEVER
from ..common.obstacles import is_obstacle
from ..dense.cell_grid import cell_and_place, place_of_slot, put_in_cell
from ..dense.events import predict_again
from ..dense.neighbour_lists import (
    MOST_AHEAD,
    make_all_lists,
    make_lists_of_cell,
    rebuild_list,
    set_reference,
)
from ..dense.prediction import threshold_crossing
from ..flags import DIM, OBSTACLES
from ..simd.jit import called, jit
from ..simd.pointers import int64
from .barrier import barrier
from .calendars import clear_calendars, schedule
from .old_flights import of_this_window
from .tile_buckets import is_mine, owner
from .tiles import has_moved, is_inside, settle, tile_of
from .undo import has_been_within


@jit
def column_of(s, i):
    """Column of cells of i's reference position."""
    x, _ = cell_and_place(s, i, 0)
    y, _ = cell_and_place(s, i, 1)
    return x * s.counter[at.CELLS + 1] + y


@called
def renew_list(s, i, now):
    """Rebuild i's list. False where that has to wait for another round; then nothing has changed.

    Somebody may yet be predicted from an earlier time of this window on, and has to find i on the list. So i
    must have been within its new threshold since the window began.
    """
    if s.counter[at.IN_ORDER]:
        rebuild_list(s, i, now, MOST_AHEAD)
        return True
    reference = i * at.EVENT + at.REFERENCE
    before_x, before_y = s.event_float[reference], s.event_float[reference + 1]
    before_z = s.event_float[reference + 2] if DIM == 3 else 0.0
    threshold = s.number[at.DISPLACEMENT_THRESHOLD]
    ahead = MOST_AHEAD
    set_reference(s, i, now, ahead)
    if not has_been_within(s, i, threshold):
        ahead = 0.0
        set_reference(s, i, now, ahead)
        if not has_been_within(s, i, threshold):
            s.counter[at.WRONG] = 1
    inside = s.counter[at.WRONG] == 0 and is_inside(s, column_of(s, i))
    s.event_float[reference], s.event_float[reference + 1] = before_x, before_y
    if DIM == 3:
        s.event_float[reference + 2] = before_z
    if inside:
        rebuild_list(s, i, now, ahead)
    return inside


@called
def renew_all_lists(s, now, afresh):
    """Rebuild all lists, each thread those in its tiles; note whose events change with that."""
    n, thread, threads = s.counter[at.N], s.counter[at.THREAD], s.counter[at.THREAD_COUNT]
    first, last = n * thread // threads, n * (thread + 1) // threads
    rebuilds = s.counter[at.AGREED + at.TOLD_REBUILDS]
    s.counter[at.SHORT_CELLS] = 0
    s.counter[at.SHORT_LISTS] = 0
    if s.counter[at.IMAGES]:  # these lists are made one from the other
        barrier(s)
        if thread == 0:
            make_all_lists(s, now)
        else:
            s.counter[at.REBUILDS_OF_ALL] += 1
        barrier(s)
        note_changes(s, first, last, now, afresh)
        barrier(s)
    else:
        s.counter[at.REBUILDS_OF_ALL] += 1
        for i in range(first, last):
            set_reference(s, i, now, MOST_AHEAD)
            settle(s, i, column_of(s, i))
            s.tile_of_each[i] = tile_of(s, i)
        note_changes(s, first, last, now, afresh)
        empty_cells(s)
        barrier(s)
        for i in range(n):
            if owner(s, int64(s.tile_of_each[i])) == thread:
                put_in_cell(s, i)
        barrier(s)
        if s.counter[at.SHORT_CELLS] == 0:
            make_lists_of_tiles(s)
    s.counter[at.REBUILD_ALL_DUE] = rebuilds + s.counter[at.REBUILD_THRESHOLD]


@jit
def note_changes(s, first, last, now, afresh):
    """Note those whose new threshold comes first, or who have come to another tile; where events are old."""
    changed = 0
    if not afresh:
        for i in range(first, last):
            s.changed_events[first + changed] = i
            changed += 1 if crosses_first(s, i, now) | has_moved(s, i) else 0
    s.changed_count[s.counter[at.THREAD] * at.LINE] = changed


@jit
def crosses_first(s, i, now):
    """Whether i crosses its new threshold before its next event; that crossing is then the next one."""
    time, event = threshold_crossing(s, i, now), i * at.EVENT
    if time < s.event_float[event + at.TIME]:
        s.event_float[event + at.TIME] = max(time, now)
        s.event[event + at.PARTNER] = at.REBUILD
        s.event[event + at.PARTNER_VERSION] = s.counter[at.REBUILDS_OF_ALL]
        return True
    return False


@called
def enter_changes(s):
    """Enter the events of those noted in the calendars of this thread's tiles."""
    n, threads = s.counter[at.N], s.counter[at.THREAD_COUNT]
    for thread in range(threads):
        first = n * thread // threads
        for k in range(first, first + s.changed_count[thread * at.LINE]):
            i = int64(s.changed_events[k])
            if owner(s, tile_of(s, i)) == s.counter[at.THREAD]:
                schedule(s, i, s.event_float[i * at.EVENT + at.TIME], s.event[i * at.EVENT + at.PARTNER])


@jit
def empty_cells(s):
    """Empty the cells of this thread's tiles."""
    deep = s.counter[at.CELLS + 2]
    for column in range(s.counter[at.CELLS] * s.counter[at.CELLS + 1]):
        if is_mine(s, column):
            for cell in range(column * deep, (column + 1) * deep):
                s.cell_count[cell] = 0


@jit
def make_lists_of_tiles(s):
    """Make the lists of all particles in this thread's tiles."""
    for column in range(s.counter[at.CELLS] * s.counter[at.CELLS + 1]):
        if is_mine(s, column):
            for z in range(s.counter[at.CELLS + 2]):
                make_lists_of_cell(s, column // s.counter[at.CELLS + 1], column % s.counter[at.CELLS + 1], z)


@called
def detect(s):
    """Find all lists and events from the rows."""
    s.counter[at.PART] = at.RENEWAL
    now = max(s.number[at.NOW], 0.0)
    s.counter[at.LIMIT] = -1  # no event is due yet
    s.number[at.WINDOW_BEGIN] = now
    s.counter[at.SHORT_QUEUE] = 0
    s.counter[at.WINDOW] += 1  # no old row counts
    renew_all_lists(s, now, True)
    clear_calendars(s)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        predict_all(s, now)
    s.counter[at.PART] = at.CALENDAR
    barrier(s)


@called
def rebuild_all(s, now):
    """Rebuild all lists. Events stay, but a threshold that is now crossed earlier is the next event."""
    s.counter[at.PART] = at.RENEWAL
    s.counter[at.LIMIT] = -1
    renew_all_lists(s, now, False)
    enter_changes(s)
    s.counter[at.PART] = at.CALENDAR
    barrier(s)


@called
def predict_all(s, now):
    """Predict the events of all particles in this thread's tiles, in the order of their cells."""
    deep, room = s.counter[at.CELLS + 2], s.counter[at.CELL_ROOM]
    for column in range(s.counter[at.CELLS] * s.counter[at.CELLS + 1]):
        if is_mine(s, column):
            for cell in range(column * deep, (column + 1) * deep):
                for k in range(s.cell_count[cell]):
                    i = int64(s.cell_ids[place_of_slot(cell * room + k)])
                    predict_first(s, i, now)


@called
def predict_first(s, i, now):
    """Predict i's next event from its row."""
    if OBSTACLES and is_obstacle(s, i):
        schedule(s, i, NEVER, at.NOTHING)
    else:
        predict_again(s, i, -1, now)


@called
def predict_undone(s):
    """Predict those again that have got back the rows with which the window began, each in its own tile."""
    begin = s.number[at.WINDOW_BEGIN]
    s.counter[at.LIMIT] = -1
    for thread in range(s.counter[at.THREAD_COUNT]):
        number = thread * s.counter[at.UNDO_ROOM]
        for k in range(s.undone[thread * at.LINE]):
            old = (number + k) * at.OLD_ROW
            i = s.old_rows_int[old + at.OLD_WHO]
            first = not of_this_window(s, s.old_rows_int[old + at.OLD_BEFORE])
            if first and owner(s, tile_of(s, i)) == s.counter[at.THREAD]:
                predict_first(s, i, begin)
