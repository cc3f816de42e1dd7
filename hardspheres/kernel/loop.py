"""The event loop, and the preparation of everything that follows from the rows."""

from . import layout
from .common.event_heap import pop_event
from .common.particles import begin_epoch, collide_pair, epoch_length_due, hit_wall
from .common.prefetch import prefetch_neighbours, prefetch_surroundings
from .dense.calendar import clear_calendar, next_bucket, schedule
from .dense.neighbour_lists import make_all_lists, rebuild_list
from .dense.prediction import next_event, threshold_crossing
from .dilute.predicted_contacts import contact_holds, open_contacts, partners
from .dilute.windows import follow, open_window
from .flags import FLIGHTS, GROWS, MASSES, SPARSE, WALLS
from .layout import (
    BEYOND_ALL,
    BEYOND_CACHE,
    BUCKET,
    EPOCH,
    EPOCH_BUCKETS,
    EVENT,
    HEAP_LENGTH,
    INSTANT_EVENTS,
    INVERSE_WIDTH,
    LAST_ADVANCE,
    LOG_ROOM,
    LOGGED,
    NOW,
    ORDER_TOLERANCE,
    OUT_OF_ORDER,
    OVERFLOW_ROOM,
    OVERFLOWED,
    PAIRS,
    PARTNER,
    PARTNER_VERSION,
    REBUILD,
    REBUILD_ALL_DUE,
    REBUILDS,
    REBUILDS_OF_ALL,
    SHORT_CELLS,
    SHORT_LISTS,
    SHORT_QUEUE,
    STALE,
    STAMP,
    STAMP_BITS,
    TIME,
    WINDOW_BUCKETS,
    N,
)
from .simd.jit import called, entry_point, jit
from .simd.pointers import handed_over, pointers

__all__ = [
    "DONE",
    "EPOCH_LENGTH_DUE",
    "LOG_FULL",
    "NO_ROOM",
    "PAUSED",
    "STANDS_STILL",
    "handed_over",
    "layout",
    "run",
]

BEFORE = (
    1.0 - 2.0**-50
)  # a bucket is done with only when rounding cannot have put an earlier event in the next one

# What `run` returns.
DONE = 0  # reached the time or the number of collisions asked for
PAUSED = 1  # used up its budget; call it again
NO_ROOM = 2  # a list, a cell or the calendar is full: make room, prepare, call it again
STANDS_STILL = 3  # 1000 events per particle without time moving
LOG_FULL = 4  # empty the log, and call it again
EPOCH_LENGTH_DUE = (
    5  # an epoch is over, and the next ones ought to be shorter or longer: see to it, and call it again
)


@jit
def predict(s, i, now):
    """Find i's next event and enter it in the calendar."""
    time, partner = next_event(s, i, now)
    met = 0 <= partner < s.counter[N]
    s.event[i * EVENT + PARTNER_VERSION] = s.version[partner] if met else s.counter[REBUILDS_OF_ALL]
    schedule(s, i, time, partner)


@jit
def predict_all(s, now, blocks):
    """Predict every particle's next event into an empty calendar."""
    clear_calendar(s, blocks)
    for i in range(s.counter[N]):
        predict(s, i, now)


@entry_point
def run(arrays, cells, blocks, afresh, stop_epoch, stop_time, stop_pairs, budget):
    """Execute events in their order.

    Stops after the pair collision that makes PAIRS equal `stop_pairs`, or before the first event later than
    `stop_time` in epoch `stop_epoch`. `budget` bounds the work of one call. `afresh`: first find lists,
    events and calendar from the rows.
    """
    s = pointers(arrays)
    n = s.counter[N]
    search = afresh
    while budget > 0 or search:  # a search that is due is never put off
        if search:
            if SPARSE:
                open_window(s, cells, blocks)
            else:
                search_lists(s, cells, blocks)
            search = False
            budget -= n
        elif s.counter[PAIRS] >= stop_pairs:
            return DONE
        elif s.counter[HEAP_LENGTH] == 0:
            budget -= 1
            bucket = s.counter[BUCKET] + 1
            bucket_end = bucket / s.number[INVERSE_WIDTH] * BEFORE
            if s.counter[EPOCH] == stop_epoch and (
                bucket_end > stop_time or bucket == s.counter[EPOCH_BUCKETS]
            ):
                return DONE
            if bucket == s.counter[EPOCH_BUCKETS]:
                begin_epoch(s)
                s.counter[BUCKET] = 0
                search = True
                if MASSES and not GROWS and epoch_length_due(s):
                    return EPOCH_LENGTH_DUE
            elif SPARSE:
                s.counter[BUCKET] = bucket
                search = (bucket & (s.counter[WINDOW_BUCKETS] - 1)) == 0
                if not search:
                    open_contacts(s)
                    if s.counter[BEYOND_ALL]:
                        prefetch_surroundings(s)
            elif s.counter[REBUILDS] >= s.counter[REBUILD_ALL_DUE]:
                rebuild_all(s, bucket_end, cells)
                budget -= n
            else:
                next_bucket(s)
        else:
            time = s.heap_time[0]
            if s.counter[EPOCH] == stop_epoch and time > stop_time:
                return DONE
            if FLIGHTS and s.counter[LOG_ROOM] > 0 and s.counter[LOGGED] == s.counter[LOG_ROOM]:
                return LOG_FULL
            budget -= 1
            first = s.heap_entry[0]
            pop_event(s)
            if SPARSE:
                execute_contact(s, first, time)
            else:
                if s.counter[BEYOND_CACHE] and s.counter[HEAP_LENGTH] > 0:
                    prefetch_neighbours(s)
                execute_and_predict(s, first, time)
            if s.counter[INSTANT_EVENTS] > 1000 * n:
                return STANDS_STILL
        if SPARSE and s.counter[SHORT_LISTS] and s.counter[OVERFLOWED] == s.counter[OVERFLOW_ROOM]:
            # There is no room for more new segments: a new search clears those away that were replaced.
            s.counter[SHORT_LISTS] = 0
            search = True
        if s.counter[SHORT_QUEUE] or s.counter[SHORT_LISTS] or s.counter[SHORT_CELLS]:
            return NO_ROOM
    return PAUSED


@called
def search_lists(s, cells, blocks):
    """Find all lists and events from the rows."""
    now = max(s.number[NOW], 0.0)
    make_all_lists(s, now, cells)
    if s.counter[SHORT_CELLS] == 0 and s.counter[SHORT_LISTS] == 0:
        predict_all(s, now, blocks)


@called
def rebuild_all(s, now, cells):
    """Rebuild all lists. Events stay, but a threshold that is now crossed earlier is the next event."""
    make_all_lists(s, now, cells)
    if s.counter[SHORT_CELLS] == 0 and s.counter[SHORT_LISTS] == 0:
        for i in range(s.counter[N]):
            time = threshold_crossing(s, i)
            if time < s.event_float[i * EVENT + TIME]:
                s.event[i * EVENT + PARTNER_VERSION] = s.counter[REBUILDS_OF_ALL]
                schedule(s, i, max(time, now), REBUILD)


@jit
def execute_contact(s, c, time):
    """Execute a predicted contact of the window, if it still holds, and predict again."""
    if not contact_holds(s, c):
        s.counter[STALE] += 1
        return
    i, partner = partners(s, c)
    advance_clock(s, time)
    if partner < s.counter[N]:
        collide_pair(s, i, partner, time)
    elif WALLS:
        hit_wall(s, i, partner, time)
        partner = -1
    follow(s, i, partner, time)


@jit
def execute_and_predict(s, first, time):
    """Execute the event of a heap entry, if it still counts, and predict its particles again."""
    i = first >> 32
    if s.event[i * EVENT + STAMP] == first & STAMP_BITS:
        other = execute(s, i, time)
        while i >= 0:
            predict(s, i, max(time, 0.0))
            i = other
            other = -1


@jit
def execute(s, i, time):
    """Execute i's event; returns the other particle that has changed, or -1."""
    partner = s.event[i * EVENT + PARTNER]
    version = s.event[i * EVENT + PARTNER_VERSION]
    if partner == REBUILD and version == s.counter[REBUILDS_OF_ALL]:
        rebuild_list(s, i, time)
    elif partner >= s.counter[N]:
        if WALLS:
            advance_clock(s, time)
            hit_wall(s, i, partner, time)
    elif partner >= 0 and s.version[partner] == version:
        advance_clock(s, time)
        collide_pair(s, i, partner, time)
        return partner
    else:
        s.counter[STALE] += 1
    return -1


@jit
def advance_clock(s, time):
    """Advance the clock; count events out of order and events at one instant."""
    now = s.number[NOW]
    if time < now - s.number[ORDER_TOLERANCE]:
        s.counter[OUT_OF_ORDER] += 1
    s.number[NOW] = max(now, time)
    if time > s.number[LAST_ADVANCE] + s.number[ORDER_TOLERANCE]:
        s.number[LAST_ADVANCE] = time
        s.counter[INSTANT_EVENTS] = 0
    else:
        s.counter[INSTANT_EVENTS] += 1
