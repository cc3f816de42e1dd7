"""The calendar of the list method (Brown 1988): a ring of buckets for the next events of the particles.

An insertion touches one block of a bucket (`bucket_queue`), a removal touches none: an entry counts only
while its stamp is its particle's latest. One turn of the ring is a cycle. Events after the present cycle are
in one further bucket; events after the epoch are not entered at all, since the next epoch predicts them
again.
"""

from .. import layout as at
from ..common.bucket_queue import clear_buckets, release_block
from ..common.event_heap import push_event
from ..common.prefetch import (
    forget_waiting,
    prefetch_buckets,
    prefetch_event,
    push_all_waiting,
    push_bucket_later,
)
from ..simd.jit import jit


@jit
def tie_key(i, partner):
    """Order of events at equal times: lower id, then higher id; a list to rebuild first."""
    if partner < 0:
        return 0
    return (min(i, partner) << 32) | max(i, partner)


@jit
def insert_event(s, i):
    """Insert i's event, just predicted, into the calendar."""
    time = s.event_float[i * at.EVENT + at.TIME]
    if time >= s.number[at.EPOCH_LENGTH]:
        return
    # An event in the past, by rounding, goes to the current bucket, which is not over.
    bucket = int(max(time, 0.0) * s.number[at.INVERSE_WIDTH])
    now = s.counter[at.BUCKET]
    entry = i << 32 | s.event[i * at.EVENT + at.STAMP]
    if bucket <= now:
        prefetch_event(s, i)
        push_event(s, time, tie_key(i, s.event[i * at.EVENT + at.PARTNER]), entry)
    else:
        cycle = s.counter[at.BUCKETS]
        slot = bucket & (cycle - 1) if bucket < now + cycle else cycle
        push_bucket_later(s, slot, entry)


@jit
def replace_event(s, i, time, partner):
    """Make this i's next event; an entry of i made before no longer counts."""
    event = i * at.EVENT
    s.event_float[event + at.TIME] = time
    s.event[event + at.PARTNER] = partner
    s.event[event + at.STAMP] = (s.event[event + at.STAMP] + 1) & at.STAMP_BITS


@jit
def schedule(s, i, time, partner):
    """Make this i's next event, and insert it into the calendar."""
    replace_event(s, i, time, partner)
    insert_event(s, i)


@jit
def open_bucket(s, slot):
    """Insert the live events of a bucket again: those of the current bucket go to the event heap."""
    block = s.buckets[slot]
    s.buckets[slot] = -1
    while block >= 0:
        header = s.blocks[block * at.BLOCK]
        for k in range(1, (header & 7) + 1):
            entry = s.blocks[block * at.BLOCK + k]
            i = entry >> 32
            if s.event[i * at.EVENT + at.STAMP] == entry & at.STAMP_BITS:
                insert_event(s, i)
        block = release_block(s, block)


@jit
def next_bucket(s):
    """Go on to the next bucket; a new cycle first takes its share of the later events.

    Returns whether all events have to be found anew: never here.
    """
    bucket = s.counter[at.BUCKET] + 1
    cycle = s.counter[at.BUCKETS]
    s.counter[at.BUCKET] = bucket
    push_all_waiting(s)
    if (bucket & (cycle - 1)) == 0:
        open_bucket(s, cycle)
        push_all_waiting(s)
    open_bucket(s, bucket & (cycle - 1))
    prefetch_buckets(s, bucket)
    return False


@jit
def clear_calendar(s):
    """Empty the calendar and go back to its first bucket."""
    clear_buckets(s, s.counter[at.BUCKETS] + 1)
    forget_waiting(s)
    s.counter[at.HEAP_LENGTH] = 0
    s.counter[at.SHORT_QUEUE] = 0
    s.counter[at.BUCKET] = 0
