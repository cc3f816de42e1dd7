"""The calendar: a ring of buckets for the coming events, and a small heap for those of the current bucket.

A bucket is a chain of chunks (one cache line: a link and seven entries), so that an insertion touches one line and a removal
none: an entry counts only while its stamp is its particle's latest. Events after the present year of the ring wait in one
further bucket; events after the epoch are not entered at all, since the epoch predicts them again.
"""

from .compiler import jit
from .layout import (
    AGENDA_LENGTH,
    AGENDA_ROOM,
    BUCKET,
    BUCKETS,
    CHUNK,
    CHUNKS_LEFT,
    EPOCH_LENGTH,
    EVENT,
    FREE_CHUNK,
    INVERSE_WIDTH,
    PARTNER,
    SHORT_QUEUE,
    STAMP,
    STAMP_BITS,
    TIME,
)


@jit
def tie_key(i, partner):
    """Order of events at equal times: lower id, then higher id; a due neighbour list first."""
    if partner < 0:
        return 0
    return (min(i, partner) << 32) | max(i, partner)


@jit
def precedes(s, a, b):
    """Whether agenda entry a comes before entry b."""
    ta = s.agenda_time[a]
    tb = s.agenda_time[b]
    return ta < tb or (ta == tb and s.agenda_key[a] < s.agenda_key[b])


@jit
def swap(s, a, b):
    """Exchange two agenda entries."""
    time, key, entry = s.agenda_time[a], s.agenda_key[a], s.agenda_entry[a]
    s.agenda_time[a], s.agenda_key[a], s.agenda_entry[a] = (
        s.agenda_time[b],
        s.agenda_key[b],
        s.agenda_entry[b],
    )
    s.agenda_time[b], s.agenda_key[b], s.agenda_entry[b] = time, key, entry


@jit
def push_agenda(s, i):
    """Enter i's event in the heap of the current bucket."""
    a = s.counter[AGENDA_LENGTH]
    if a == s.counter[AGENDA_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.counter[AGENDA_LENGTH] = a + 1
    event = i * EVENT
    s.agenda_time[a] = s.event_float[event + TIME]
    s.agenda_key[a] = tie_key(i, s.event[event + PARTNER])
    s.agenda_entry[a] = i << 32 | s.event[event + STAMP]
    while a > 0:
        parent = (a - 1) >> 1
        if not precedes(s, a, parent):
            break
        swap(s, a, parent)
        a = parent


@jit
def pop_agenda(s):
    """Remove the first entry of the heap."""
    last = s.counter[AGENDA_LENGTH] - 1
    s.counter[AGENDA_LENGTH] = last
    s.agenda_time[0], s.agenda_key[0], s.agenda_entry[0] = (
        s.agenda_time[last],
        s.agenda_key[last],
        s.agenda_entry[last],
    )
    a = 0
    while True:
        child = 2 * a + 1
        if child >= last:
            break
        if child + 1 < last and precedes(s, child + 1, child):
            child += 1
        if not precedes(s, child, a):
            break
        swap(s, child, a)
        a = child


@jit
def push_bucket(s, slot, entry):
    """Append an entry to a bucket."""
    chunk = s.buckets[slot]
    if chunk < 0 or (s.chunks[chunk * CHUNK] & 7) == 7:
        fresh = s.counter[FREE_CHUNK]
        if fresh < 0:
            s.counter[SHORT_QUEUE] = 1
            return
        s.counter[FREE_CHUNK] = s.chunks[fresh * CHUNK] >> 3
        s.counter[CHUNKS_LEFT] -= 1
        s.chunks[fresh * CHUNK] = chunk << 3
        s.buckets[slot] = fresh
        chunk = fresh
    header = s.chunks[chunk * CHUNK] + 1
    s.chunks[chunk * CHUNK] = header
    s.chunks[chunk * CHUNK + (header & 7)] = entry


@jit
def enter(s, i):
    """Put i's event, just predicted, into the calendar."""
    time = s.event_float[i * EVENT + TIME]
    if time >= s.number[EPOCH_LENGTH]:
        return
    bucket = int(max(time, 0.0) * s.number[INVERSE_WIDTH])
    now = s.counter[BUCKET]
    if bucket <= now:
        push_agenda(s, i)
    else:
        year = s.counter[BUCKETS]
        entry = i << 32 | s.event[i * EVENT + STAMP]
        push_bucket(s, bucket & (year - 1) if bucket < now + year else year, entry)


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
        s.chunks[chunk * CHUNK] = s.counter[FREE_CHUNK] << 3
        s.counter[FREE_CHUNK] = chunk
        s.counter[CHUNKS_LEFT] += 1
        chunk = header >> 3


@jit
def turn_page(s):
    """Go on to the next bucket of the calendar, at the turn of a year looking through the later events first."""
    bucket = s.counter[BUCKET] + 1
    year = s.counter[BUCKETS]
    s.counter[BUCKET] = bucket
    if (bucket & (year - 1)) == 0:
        open_bucket(s, year)
    open_bucket(s, bucket & (year - 1))


@jit
def clear_calendar(s, chunks):
    """Empty the calendar and go back to its first bucket."""
    for slot in range(s.counter[BUCKETS] + 1):
        s.buckets[slot] = -1
    for chunk in range(chunks):
        s.chunks[chunk * CHUNK] = (chunk + 1 if chunk + 1 < chunks else -1) << 3
    s.counter[FREE_CHUNK] = 0
    s.counter[CHUNKS_LEFT] = chunks
    s.counter[AGENDA_LENGTH] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[BUCKET] = 0
