"""The event heap: the events of the current bucket, ordered by time, lower id, higher id.

A binary heap: the earliest event is entry 0, and no entry comes before its parent, entry (a - 1) / 2. It is
small, since a bucket holds few events, and so stays in the cache; the long queue is the buckets'. Of each
event it has the time, a key for the order of equal times, and what the search needs to find the event again.
"""

from .. import layout as at
from ..simd.jit import jit


@jit
def precedes(s, a, b):
    """Whether entry a comes before entry b."""
    ta = s.heap_time[a]
    tb = s.heap_time[b]
    return ta < tb or (ta == tb and s.heap_key[a] < s.heap_key[b])


@jit
def swap(s, a, b):
    """Exchange two entries."""
    time, key, entry = s.heap_time[a], s.heap_key[a], s.heap_entry[a]
    s.heap_time[a], s.heap_key[a], s.heap_entry[a] = (
        s.heap_time[b],
        s.heap_key[b],
        s.heap_entry[b],
    )
    s.heap_time[b], s.heap_key[b], s.heap_entry[b] = time, key, entry


@jit
def push_event(s, time, key, entry):
    """Enter an event."""
    a = s.counter[at.HEAP_LENGTH]
    if a == s.counter[at.HEAP_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return
    s.counter[at.HEAP_LENGTH] = a + 1
    s.heap_time[a] = time
    s.heap_key[a] = key
    s.heap_entry[a] = entry
    while a > 0:  # rise past all that come later
        parent = (a - 1) >> 1
        if not precedes(s, a, parent):
            break
        swap(s, a, parent)
        a = parent


@jit
def pop_event(s):
    """Remove the first entry of the heap."""
    last = s.counter[at.HEAP_LENGTH] - 1
    s.counter[at.HEAP_LENGTH] = last
    s.heap_time[0], s.heap_key[0], s.heap_entry[0] = (
        s.heap_time[last],
        s.heap_key[last],
        s.heap_entry[last],
    )
    a = 0
    while True:  # sink below all that come earlier
        child = 2 * a + 1
        if child >= last:
            break
        if child + 1 < last and precedes(s, child + 1, child):
            child += 1
        if not precedes(s, child, a):
            break
        swap(s, child, a)
        a = child
