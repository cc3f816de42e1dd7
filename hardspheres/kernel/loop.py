"""The event loop, and the preparation of everything that follows from the rows."""

from . import layout as at
from .common.event_heap import pop_event
from .common.particles import begin_epoch, collide_pair, epoch_length_due, hit_wall
from .common.prefetch import prefetch_neighbours, prefetch_surroundings
from .dense.calendar import clear_calendar, next_bucket, schedule
from .dense.neighbour_lists import make_all_lists, rebuild_list
from .dense.prediction import next_event, threshold_crossing
from .dilute.predicted_contacts import contact_holds, open_contacts, partners
from .dilute.windows import follow, open_window
from .flags import FLIGHTS, GROWS, MASSES, SPARSE, WALLS
from .simd.jit import called, entry_point, jit
from .simd.pointers import handed_over, pointers

__all__ = [
    "DONE",
    "EPOCH_LENGTH_DUE",
    "LOG_FULL",
    "NO_ROOM",
    "PAUSED",
    "STANDS_STILL",
    "at",
    "handed_over",
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
    met = 0 <= partner < s.counter[at.N]
    s.event[i * at.EVENT + at.PARTNER_VERSION] = s.version[partner] if met else s.counter[at.REBUILDS_OF_ALL]
    schedule(s, i, time, partner)


@jit
def predict_all(s, now):
    """Predict every particle's next event into an empty calendar."""
    clear_calendar(s)
    for i in range(s.counter[at.N]):
        predict(s, i, now)


@entry_point
def run(arrays, afresh, stop_epoch, stop_time, stop_pairs, budget):
    """Execute events in their order.

    Stops after the pair collision that makes PAIRS equal `stop_pairs`, or before the first event later than
    `stop_time` in epoch `stop_epoch`. `budget` bounds the work of one call. `afresh`: first find lists,
    events and calendar from the rows.
    """
    s = pointers(arrays)
    n = s.counter[at.N]
    search = afresh
    while budget > 0 or search:  # a search that is due is never put off
        if search:
            if SPARSE:
                open_window(s)
            else:
                search_lists(s)
            search = False
            budget -= n
        elif s.counter[at.PAIRS] >= stop_pairs:
            return DONE
        elif s.counter[at.HEAP_LENGTH] == 0:
            budget -= 1
            bucket = s.counter[at.BUCKET] + 1
            bucket_end = bucket / s.number[at.INVERSE_WIDTH] * BEFORE
            if s.counter[at.EPOCH] == stop_epoch and (
                bucket_end > stop_time or bucket == s.counter[at.EPOCH_BUCKETS]
            ):
                return DONE
            if bucket == s.counter[at.EPOCH_BUCKETS]:
                begin_epoch(s)
                s.counter[at.BUCKET] = 0
                search = True
                if MASSES and not GROWS and epoch_length_due(s):
                    return EPOCH_LENGTH_DUE
            elif SPARSE:
                s.counter[at.BUCKET] = bucket
                search = (bucket & (s.counter[at.WINDOW_BUCKETS] - 1)) == 0
                if not search:
                    open_contacts(s)
                    if s.counter[at.BEYOND_ALL]:
                        prefetch_surroundings(s)
            elif s.counter[at.REBUILDS] >= s.counter[at.REBUILD_ALL_DUE]:
                rebuild_all(s, bucket_end)
                budget -= n
            else:
                next_bucket(s)
        else:
            time = s.heap_time[0]
            if s.counter[at.EPOCH] == stop_epoch and time > stop_time:
                return DONE
            if FLIGHTS and s.counter[at.LOG_ROOM] > 0 and s.counter[at.LOGGED] == s.counter[at.LOG_ROOM]:
                return LOG_FULL
            budget -= 1
            first = s.heap_entry[0]
            pop_event(s)
            if SPARSE:
                execute_contact(s, first, time)
            else:
                if s.counter[at.BEYOND_CACHE] and s.counter[at.HEAP_LENGTH] > 0:
                    prefetch_neighbours(s)
                execute_and_predict(s, first, time)
            if s.counter[at.INSTANT_EVENTS] > 1000 * n:
                return STANDS_STILL
        if SPARSE and s.counter[at.SHORT_LISTS] and s.counter[at.OVERFLOWED] == s.counter[at.OVERFLOW_ROOM]:
            # There is no room for more new segments: a new search clears those away that were replaced.
            s.counter[at.SHORT_LISTS] = 0
            search = True
        if s.counter[at.SHORT_QUEUE] or s.counter[at.SHORT_LISTS] or s.counter[at.SHORT_CELLS]:
            return NO_ROOM
    return PAUSED


@called
def search_lists(s):
    """Find all lists and events from the rows."""
    now = max(s.number[at.NOW], 0.0)
    make_all_lists(s, now)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        predict_all(s, now)


@called
def rebuild_all(s, now):
    """Rebuild all lists. Events stay, but a threshold that is now crossed earlier is the next event."""
    make_all_lists(s, now)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        for i in range(s.counter[at.N]):
            time = threshold_crossing(s, i)
            if time < s.event_float[i * at.EVENT + at.TIME]:
                s.event[i * at.EVENT + at.PARTNER_VERSION] = s.counter[at.REBUILDS_OF_ALL]
                schedule(s, i, max(time, now), at.REBUILD)


@jit
def execute_contact(s, c, time):
    """Execute a predicted contact of the window, if it still holds, and predict again."""
    if not contact_holds(s, c):
        s.counter[at.STALE] += 1
        return
    i, partner = partners(s, c)
    advance_clock(s, time)
    if partner < s.counter[at.N]:
        collide_pair(s, i, partner, time)
    elif WALLS:
        hit_wall(s, i, partner, time)
        partner = -1
    follow(s, i, partner, time)


@jit
def execute_and_predict(s, first, time):
    """Execute the event of a heap entry, if it still counts, and predict its particles again."""
    i = first >> 32
    if s.event[i * at.EVENT + at.STAMP] == first & at.STAMP_BITS:
        other = execute(s, i, time)
        while i >= 0:
            predict(s, i, max(time, 0.0))
            i = other
            other = -1


@jit
def execute(s, i, time):
    """Execute i's event; returns the other particle that has changed, or -1."""
    partner = s.event[i * at.EVENT + at.PARTNER]
    version = s.event[i * at.EVENT + at.PARTNER_VERSION]
    if partner == at.REBUILD and version == s.counter[at.REBUILDS_OF_ALL]:
        rebuild_list(s, i, time)
    elif partner >= s.counter[at.N]:
        if WALLS:
            advance_clock(s, time)
            hit_wall(s, i, partner, time)
    elif partner >= 0 and s.version[partner] == version:
        advance_clock(s, time)
        collide_pair(s, i, partner, time)
        return partner
    else:
        s.counter[at.STALE] += 1
    return -1


@jit
def advance_clock(s, time):
    """Advance the clock; count events out of order and events at one instant."""
    now = s.number[at.NOW]
    if time < now - s.number[at.ORDER_TOLERANCE]:
        s.counter[at.OUT_OF_ORDER] += 1
    s.number[at.NOW] = max(now, time)
    if time > s.number[at.LAST_ADVANCE] + s.number[at.ORDER_TOLERANCE]:
        s.number[at.LAST_ADVANCE] = time
        s.counter[at.INSTANT_EVENTS] = 0
    else:
        s.counter[at.INSTANT_EVENTS] += 1
