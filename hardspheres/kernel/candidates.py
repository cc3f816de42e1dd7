"""Candidates of the window method: the contacts found for the present window, kept by time in buckets until it ends."""

from .agenda import push_agenda
from .compiler import jit
from .layout import (
    BUCKET,
    CANDIDATE_ROOM,
    CANDIDATES,
    HALF_WINDOW,
    INVERSE_WIDTH,
    MIDDLE,
    SHORT_QUEUE,
    STAMP_BITS,
    WINDOW_BUCKETS,
    N,
)


@jit
def versions_of(s, low, high):
    """Versions of both partners in one number; a wall has none."""
    versions = int(s.version[low]) << 32
    if high < s.counter[N]:
        versions |= int(s.version[high]) & STAMP_BITS
    return versions


@jit
def note_candidate(s, low, high, time):
    """Keep a contact if it lies in this window."""
    if time >= s.number[MIDDLE] + s.number[HALF_WINDOW]:
        return
    c = s.counter[CANDIDATES]
    if c == s.counter[CANDIDATE_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.counter[CANDIDATES] = c + 1
    s.candidate_time[c] = time
    s.candidate_pair[c] = low << 32 | high
    s.candidate_versions[c] = versions_of(s, low, high)
    last = s.counter[BUCKET] | (s.counter[WINDOW_BUCKETS] - 1)  # of this window, whatever rounding says
    bucket = min(int(max(time, 0.0) * s.number[INVERSE_WIDTH]), last)
    if bucket <= s.counter[BUCKET]:
        push_agenda(s, time, low << 32 | high, c)
    else:
        slot = bucket & (s.counter[WINDOW_BUCKETS] - 1)
        s.candidate_next[c] = s.buckets[slot]
        s.buckets[slot] = c


@jit
def candidate_holds(s, c):
    """Whether neither partner of a candidate has changed since it was noted."""
    low = s.candidate_pair[c] >> 32
    high = s.candidate_pair[c] & STAMP_BITS
    return versions_of(s, low, high) == s.candidate_versions[c]


@jit
def open_candidates(s):
    """Bring the candidates of the current bucket, as far as they still hold, to the agenda."""
    slot = s.counter[BUCKET] & (s.counter[WINDOW_BUCKETS] - 1)
    c = s.buckets[slot]
    s.buckets[slot] = -1
    while c >= 0:
        if candidate_holds(s, c):
            push_agenda(s, s.candidate_time[c], s.candidate_pair[c], c)
        c = s.candidate_next[c]
