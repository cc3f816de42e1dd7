"""The calendar of the list method: a ring of buckets for the particles' coming events.

A bucket is a chain of chunks (one cache line: a link and seven entries), so that an insertion touches one line and a removal
none: an entry counts only while its stamp is its particle's latest. Events after the present year of the ring wait in one
further bucket; events after the epoch are not entered at all, since the epoch predicts them again.
"""

from ..common.bucket_queue import clear_buckets, push_bucket, release
from ..common.event_heap import push_agenda
from ..common.prefetch import fetch_events, make_ready
from ..layout import (
    AGENDA_LENGTH,
    BEYOND_CACHE,
    BUCKET,
    BUCKETS,
    CHUNK,
    EPOCH_LENGTH,
    EVENT,
    INVERSE_WIDTH,
    PARTNER,
    SHORT_QUEUE,
    STAMP,
    STAMP_BITS,
    TIME,
    WAITING,
    WAITS,
)
from ..simd.jit import jit, part
from ..simd.pointers import prefetch


@jit
def tie_key(i, partner):
    """Order of events at equal times: lower id, then higher id; a due neighbour list first."""
    if partner < 0:
        return 0
    return (min(i, partner) << 32) | max(i, partner)


@jit
def enter(s, i):
    """Put i's event, just predicted, into the calendar."""
    time = s.event_float[i * EVENT + TIME]
    if time >= s.number[EPOCH_LENGTH]:
        return
    bucket = int(max(time, 0.0) * s.number[INVERSE_WIDTH])
    now = s.counter[BUCKET]
    entry = i << 32 | s.event[i * EVENT + STAMP]
    if bucket <= now:
        make_ready(s, i)
        push_agenda(s, time, tie_key(i, s.event[i * EVENT + PARTNER]), entry)
    else:
        year = s.counter[BUCKETS]
        slot = bucket & (year - 1) if bucket < now + year else year
        if s.counter[BEYOND_CACHE]:
            put_off(s, slot, entry)
        else:
            push_bucket(s, slot, entry)


@jit
def put_off(s, slot, entry):
    """Have an entry wait for a few others before it is put in its bucket, while what that takes comes into the cache."""
    k = s.counter[WAITS]
    s.counter[WAITS] = (k + 1) % WAITING
    enter_bucket(s, k)
    s.waiting_slot[k] = slot
    s.waiting_entry[k] = entry
    prefetch(s.buckets, slot)
    halfway = s.waiting_slot[(k + WAITING // 2) % WAITING]
    if halfway >= 0:
        prefetch(s.chunks, s.buckets[halfway] * CHUNK)


@jit
def enter_bucket(s, k):
    """Put one of those that wait in its bucket."""
    if s.waiting_slot[k] >= 0:
        push_bucket(s, s.waiting_slot[k], s.waiting_entry[k])
        s.waiting_slot[k] = -1


@part
def settle(s):
    """Put all that wait in their buckets."""
    for k in range(WAITING):
        enter_bucket(s, k)


@jit
def schedule(s, i, time, partner):
    """Make this i's next event; an earlier one of i no longer counts."""
    event = i * EVENT
    s.event_float[event + TIME] = time
    s.event[event + PARTNER] = partner
    s.event[event + STAMP] = (s.event[event + STAMP] + 1) & STAMP_BITS
    enter(s, i)


@jit
def open_bucket(s, slot):
    """Enter the live events of a bucket anew: those of the current bucket reach the agenda."""
    chunk = s.buckets[slot]
    s.buckets[slot] = -1
    while chunk >= 0:
        header = s.chunks[chunk * CHUNK]
        for k in range(1, (header & 7) + 1):
            entry = s.chunks[chunk * CHUNK + k]
            i = entry >> 32
            if s.event[i * EVENT + STAMP] == entry & STAMP_BITS:
                enter(s, i)
        chunk = release(s, chunk)


@jit
def turn_page(s):
    """Go on to the next bucket of the calendar, at the turn of a year looking through the later events first."""
    bucket = s.counter[BUCKET] + 1
    year = s.counter[BUCKETS]
    s.counter[BUCKET] = bucket
    if s.counter[BEYOND_CACHE]:
        settle(s)
    if (bucket & (year - 1)) == 0:
        open_bucket(s, year)
        if s.counter[BEYOND_CACHE]:
            settle(s)
    open_bucket(s, bucket & (year - 1))
    if s.counter[BEYOND_CACHE]:
        fetch_events(s, s.buckets[(bucket + 1) & (year - 1)])
        prefetch(s.chunks, s.buckets[(bucket + 2) & (year - 1)] * CHUNK)


@jit
def clear_calendar(s, chunks):
    """Empty the calendar and go back to its first bucket."""
    clear_buckets(s, s.counter[BUCKETS] + 1, chunks)
    for k in range(WAITING):
        s.waiting_slot[k] = -1
    s.counter[AGENDA_LENGTH] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[BUCKET] = 0
