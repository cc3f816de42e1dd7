"""The event loop, which is the whole algorithm: detect, fly, collide, predict again.

*Detect*: a search finds the coming events from the rows, at the start and at every epoch or window. *Fly*:
nothing is done until the earliest event; where a bucket has no event left the next one is opened. *Collide*:
the two particles of the event fly to its time and exchange momentum. *Predict again*: the search finds the
next events of these two, since only their rows have changed.

To the loop a search is four functions: `detect`, `next_bucket`, `event_of` (what an entry of the event heap
stands for, and whether it still holds) and `predict_again`. Lists also have their rebuilds.
"""

from . import layout as at
from .common.event_heap import pop_event
from .common.particles import begin_epoch, epoch_length_due
from .common.prefetch import prefetch_next_event
from .execution import execute
from .flags import FLIGHTS, GRAVITY, GROWS, MASSES, SPARSE
from .simd.jit import entry_point
from .simd.pointers import handed_over, pointers

if SPARSE:
    from .dilute.overflow import is_full
    from .dilute.predicted_contacts import event_of, next_bucket
    from .dilute.windows import detect
else:
    from .dense.calendar import next_bucket
    from .dense.events import detect, event_of, rebuild_all

__all__ = [
    "DONE",
    "EPOCH_LENGTH_DUE",
    "LOG_FULL",
    "NO_ROOM",
    "PAUSED",
    "RESTS",
    "STANDS_STILL",
    "at",
    "handed_over",
    "run",
]

# A bucket is done with only when rounding cannot have put an earlier event in the next one.
BEFORE = 1.0 - 2.0**-50

# What `run` returns.
DONE = 0  # reached the time or the number of collisions asked for
PAUSED = 1  # used up its budget; call it again
NO_ROOM = 2  # a list, a cell or the calendar is full: make room, search from the rows, call it again
STANDS_STILL = 3  # 1000 events per particle without time moving
LOG_FULL = 4  # empty the log, and call it again
RESTS = 6  # a particle has come to rest on a wall
EPOCH_LENGTH_DUE = 5  # an epoch is over, and the next ones ought to be shorter or longer: change that first


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
            s.counter[at.PART] = at.RENEWAL
            detect(s)
            s.counter[at.PART] = at.CALENDAR
            search = False
            budget -= n
        elif s.counter[at.PAIRS] >= stop_pairs:
            return DONE
        elif s.counter[at.HEAP_LENGTH] == 0:
            budget -= 1
            bucket = s.counter[at.BUCKET] + 1
            end = bucket / s.number[at.INVERSE_WIDTH] * BEFORE
            epoch_ends = bucket == s.counter[at.EPOCH_BUCKETS]
            if s.counter[at.EPOCH] == stop_epoch and (end > stop_time or epoch_ends):
                return DONE
            if epoch_ends:
                begin_epoch(s)
                search = True
                if MASSES and not GROWS and epoch_length_due(s):
                    return EPOCH_LENGTH_DUE
            elif not SPARSE and s.counter[at.REBUILDS] >= s.counter[at.REBUILD_ALL_DUE]:
                s.counter[at.PART] = at.RENEWAL
                rebuild_all(s, end)
                s.counter[at.PART] = at.CALENDAR
                budget -= n
            else:
                search = next_bucket(s)
        else:
            time = s.heap_time[0]
            if s.counter[at.EPOCH] == stop_epoch and time > stop_time:
                return DONE
            if FLIGHTS and s.counter[at.LOG_ROOM] > 0 and s.counter[at.LOGGED] == s.counter[at.LOG_ROOM]:
                return LOG_FULL
            budget -= 1
            entry = s.heap_entry[0]
            pop_event(s)
            prefetch_next_event(s)
            i, partner = event_of(s, entry)
            if partner != at.NOTHING:
                execute(s, i, partner, time)
            if GRAVITY and s.counter[at.RESTING] > 0:
                return RESTS
            if s.counter[at.INSTANT_EVENTS] > 1000 * n:
                return STANDS_STILL
        if SPARSE and s.counter[at.SHORT_LISTS] and is_full(s):
            # No room for more new segments: a new search clears those away that were replaced.
            s.counter[at.SHORT_LISTS] = 0
            search = True
        if s.counter[at.SHORT_QUEUE] or s.counter[at.SHORT_LISTS] or s.counter[at.SHORT_CELLS]:
            return NO_ROOM
    return PAUSED
