"""The event loop of several threads: window by window, with the bits of one thread.

Every thread goes through this loop with tables of its own, and takes the same decisions as all others: they
follow from what all have agreed on. In a window (some 1 % of the particles collide) the domains of all
threads execute their events at the same time (`rounds`, `tiles`). A collision's outcome and a contact's time
are pure functions of two rows, so only the order of the events of each particle matters, and an order that
would have been another one is seen exactly and undone (`undo`). The end of a window is a moment at which all
earlier events have happened and no later one: there lists are rebuilt, epochs end, and runs stop. How long
windows are decides no bit.

A dilute gas has windows of time, in which all contacts are found beforehand (`dilute.windows`). Each of those
is a *bucket* here, and divided into many of the shorter windows meant above.
"""

from .. import layout as at
from ..common.particles import count_epoch, epoch_length_due, fly_to_end_of_epoch, mean_square
from ..flags import MASSES, SPARSE
from ..loop import (
    BEFORE,
    DONE,
    EPOCH_LENGTH_DUE,
    LOG_FULL,
    NO_ROOM,
    PAUSED,
    RESTS,
    STANDS_STILL,
)
from ..simd.jit import called, entry_point, jit
from ..simd.pointers import handed_over, pointers
from .barrier import agree, barrier
from .handing_over import hand_over_sums
from .rounds import go_through_window
from .stopping import ENOUGH_PAIRS, LOG_IS_FULL, RESTING, STANDING_STILL
from .tile_buckets import tick_of
from .undo import keep_counts, restore_counts, restore_rows

if SPARSE:
    from .registration import detect, predict_undone
else:
    from .renewal import detect, predict_undone, rebuild_all

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

LONG_ENOUGH = 100  # windows without a fault, after which they get longer
NOT_LESS = 64  # collisions: the last ones of a run, if they are fewer, come in order
GO_ON = -1
HALVINGS = 5  # after which one thread goes through a window alone


@entry_point
def run(arrays, afresh, stop_epoch, stop_time, stop_pairs, budget):
    """Execute events as `hardspheres.kernel.loop.run` does; all threads call it with the same arguments."""
    s = pointers(arrays)
    if budget <= 0:
        return PAUSED
    s.number[at.LATEST] = s.number[at.NOW]
    begun = max(s.number[at.NOW], 0.0)  # no event to come is earlier
    s.counter[at.EVENTS_DONE] = 0
    s.counter[at.WRONG] = 0
    s.counter[at.PUT_OFF] = 0
    agree(s)
    search = afresh
    if afresh:
        s.counter[at.TICK] = tick_of(s, begun)
    work = 0
    while True:
        bucket = s.counter[at.TICK] // s.counter[at.BUCKET_TICKS]
        epoch_ends = s.counter[at.TICK] == s.counter[at.EPOCH_BUCKETS] * s.counter[at.BUCKET_TICKS]
        if SPARSE and bucket != s.counter[at.BUCKET] and not epoch_ends:
            search = True  # a window of time begins
        if search:
            s.counter[at.BUCKET] = bucket
            detect(s)
            agree(s)
            if s.counter[at.AGREED + at.TOLD_SHORT]:
                return stopped(s, NO_ROOM)
            search = False
            work += s.counter[at.N]
        pairs = s.counter[at.AGREED + at.TOLD_PAIRS]
        if pairs >= stop_pairs:
            return stopped(s, DONE)
        if work + s.counter[at.AGREED + at.TOLD_EVENTS] >= budget:
            return stopped(s, PAUSED)
        begin = s.counter[at.TICK] / s.number[at.TICKS] * BEFORE
        last = s.counter[at.EPOCH] == stop_epoch
        if last and begin > stop_time:
            return stopped(s, DONE)
        if epoch_ends:
            if last:
                return stopped(s, DONE)
            end_epoch(s)
            s.counter[at.TICK] = 0
            begun = max(s.number[at.NOW], 0.0)
            search = True
            if MASSES and epoch_length_due(s):
                return stopped(s, EPOCH_LENGTH_DUE)
            continue
        s.number[at.WINDOW_BEGIN] = max(begin, begun)
        s.number[at.STOP_TIME] = stop_time if last else s.number[at.EPOCH_LENGTH]
        outcome = window(s, pairs, stop_pairs)
        if outcome != GO_ON:
            return stopped(s, outcome)
        if last and s.counter[at.LIMIT] / s.number[at.TICKS] > stop_time:
            return stopped(s, DONE)  # in the rest of the window there are events that wait
        s.counter[at.TICK] = s.counter[at.LIMIT]
        if not SPARSE:
            s.counter[at.BUCKET] = s.counter[at.TICK] // s.counter[at.BUCKET_TICKS]
        if s.counter[at.AGREED + at.TOLD_LOGGED] > s.counter[at.LOG_ROOM] // 2 and s.counter[at.LOG_ROOM] > 0:
            return stopped(s, LOG_FULL)
        if not SPARSE and s.counter[at.AGREED + at.TOLD_REBUILDS] >= s.counter[at.REBUILD_ALL_DUE]:
            rebuild_all(s, s.counter[at.TICK] / s.number[at.TICKS] * BEFORE)
            agree(s)
            if s.counter[at.AGREED + at.TOLD_SHORT]:
                return stopped(s, NO_ROOM)
            work += s.counter[at.N]


@jit
def stopped(s, outcome):
    """Set the clock to the last event that counts; returns the outcome."""
    s.number[at.NOW] = s.number[at.LATEST]
    s.number[at.LAST_ADVANCE] = s.number[at.LATEST]
    s.counter[at.INSTANT_EVENTS] = 0
    return outcome


@called
def window(s, pairs, stop_pairs):
    """Execute the events of the next window, whatever number of attempts it takes.

    Returns what `run` is to return, or `GO_ON`.
    """
    halvings = 0
    alone = stop_pairs - pairs < NOT_LESS
    while True:
        begin_window(s, halvings)
        s.counter[at.IN_ORDER] = 1 if alone or halvings == HALVINGS else 0
        s.counter[at.STOP_PAIRS] = s.counter[at.PAIRS] + (stop_pairs - pairs)
        go_through_window(s)
        short = s.counter[at.AGREED + at.TOLD_SHORT] > 0
        if s.counter[at.IN_ORDER]:
            end_window(s)
            return NO_ROOM if short else outcome_in_order(s)
        too_many = s.counter[at.AGREED + at.TOLD_PAIRS] > stop_pairs
        if not (short or too_many or s.counter[at.AGREED + at.TOLD_WRONG]):
            end_window(s)
            lengthen(s)
            return GO_ON
        undo(s, short)
        if short:
            return NO_ROOM
        alone = alone or too_many
        if not alone:
            halvings += 1
            s.counter[at.REDONE] += 1
            s.counter[at.UNDISTURBED] = 0


@jit
def begin_window(s, halvings):
    """Set the limits of an attempt at a window, and keep what it may have to take back."""
    if halvings == 1:
        s.counter[at.WINDOW_TICKS] = max(s.counter[at.WINDOW_TICKS] // 2, 1)
    ticks = max(s.counter[at.WINDOW_TICKS] >> max(halvings - 1, 0), 1)
    bucket_ends = (s.counter[at.TICK] // s.counter[at.BUCKET_TICKS] + 1) * s.counter[at.BUCKET_TICKS]
    s.counter[at.LIMIT] = min(s.counter[at.TICK] + ticks, bucket_ends)
    s.counter[at.WINDOW] += 1
    s.counter[at.UNDO_LENGTH] = 0
    s.counter[at.WRONG] = 0
    s.counter[at.OUTCOME] = 0
    s.number[at.LATEST_IN_WINDOW] = s.number[at.LATEST]
    keep_counts(s)


@jit
def end_window(s):
    """Let what has happened in the window stand."""
    s.number[at.LATEST] = s.number[at.LATEST_IN_WINDOW]
    s.counter[at.WINDOWS] += 1


@jit
def lengthen(s):
    """Make windows longer where none had to be undone for a while."""
    s.counter[at.UNDISTURBED] += 1
    if s.counter[at.UNDISTURBED] == LONG_ENOUGH:
        s.counter[at.UNDISTURBED] = 0
        s.counter[at.WINDOW_TICKS] = min(2 * s.counter[at.WINDOW_TICKS], s.counter[at.BUCKET_TICKS])


@called
def undo(s, short):
    """Go back to the beginning of the window; where room is short, events are found anew anyway."""
    s.undone[s.counter[at.THREAD] * at.LINE] = s.counter[at.UNDO_LENGTH]
    restore_rows(s)
    restore_counts(s)
    s.number[at.NOW] = s.number[at.LATEST]
    barrier(s)
    if not short:
        predict_undone(s)
    agree(s)


@jit
def outcome_in_order(s):
    """Why the one thread that was at work stopped within the window, if it did."""
    why = s.counter[at.AGREED + at.TOLD_OUTCOME]
    if why == ENOUGH_PAIRS:
        return DONE
    if why == LOG_IS_FULL:
        return LOG_FULL
    if why == RESTING:
        return RESTS
    if why == STANDING_STILL:
        return STANDS_STILL
    return GO_ON


@called
def end_epoch(s):
    """As `common.particles.begin_epoch`, each thread with a share of the rows."""
    n, thread, threads = s.counter[at.N], s.counter[at.THREAD], s.counter[at.THREAD_COUNT]
    s.number[at.NOW] = s.number[at.LATEST]
    fly_to_end_of_epoch(s, n * thread // threads, n * (thread + 1) // threads)
    hand_over_sums(s)
    count_epoch(s)
    s.number[at.LATEST] = s.number[at.NOW]
    barrier(s)
    if MASSES:
        s.number[at.MEAN_SQUARE] = mean_square(s)
