"""The agenda: a binary heap of the events of the calendar's current bucket, ordered by time, lower id, higher id."""

from ..layout import AGENDA_LENGTH, AGENDA_ROOM, SHORT_QUEUE
from ..simd.jit import jit


@jit
def precedes(s, a, b):
    """Whether entry a comes before entry b."""
    ta = s.agenda_time[a]
    tb = s.agenda_time[b]
    return ta < tb or (ta == tb and s.agenda_key[a] < s.agenda_key[b])


@jit
def swap(s, a, b):
    """Exchange two entries."""
    time, key, entry = s.agenda_time[a], s.agenda_key[a], s.agenda_entry[a]
    s.agenda_time[a], s.agenda_key[a], s.agenda_entry[a] = (
        s.agenda_time[b],
        s.agenda_key[b],
        s.agenda_entry[b],
    )
    s.agenda_time[b], s.agenda_key[b], s.agenda_entry[b] = time, key, entry


@jit
def push_agenda(s, time, key, entry):
    """Enter an event."""
    a = s.counter[AGENDA_LENGTH]
    if a == s.counter[AGENDA_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.counter[AGENDA_LENGTH] = a + 1
    s.agenda_time[a] = time
    s.agenda_key[a] = key
    s.agenda_entry[a] = entry
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
