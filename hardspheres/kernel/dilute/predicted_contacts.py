"""Candidates of the window method: the contacts found for the present window, kept by time in buckets until it ends."""

from ..common.bucket_queue import push_bucket, release_block
from ..common.contact_times import wall_contact
from ..common.event_heap import push_event
from ..common.prefetch import prefetch_contacts
from ..layout import (
    BEYOND_CACHE,
    BLOCK,
    BUCKET,
    CANDIDATE,
    CANDIDATE_ROOM,
    CANDIDATES,
    HALF_WINDOW,
    INVERSE_WIDTH,
    MIDDLE,
    PAIR,
    SHORT_QUEUE,
    STAMP_BITS,
    VERSIONS,
    WHEN,
    WINDOW_BUCKETS,
    N,
)
from ..simd.jit import jit
from ..simd.pointers import bits, from_bits


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
    entry = c * CANDIDATE
    s.candidates[entry + WHEN] = bits(time)
    s.candidates[entry + PAIR] = low << 32 | high
    s.candidates[entry + VERSIONS] = versions_of(s, low, high)
    last = s.counter[BUCKET] | (s.counter[WINDOW_BUCKETS] - 1)  # of this window, whatever rounding says
    bucket = min(int(max(time, 0.0) * s.number[INVERSE_WIDTH]), last)
    if bucket <= s.counter[BUCKET]:
        push_event(s, time, low << 32 | high, c)
    else:
        slot = bucket & (s.counter[WINDOW_BUCKETS] - 1)
        push_bucket(s, slot, c)


@jit
def note_wall(s, i):
    """Keep i's next wall as a candidate."""
    time, wall = wall_contact(s, i)
    if wall >= 0:
        note_candidate(s, i, wall, time)


@jit
def partners(s, c):
    """Lower and higher id of a candidate."""
    pair = s.candidates[c * CANDIDATE + PAIR]
    return pair >> 32, pair & STAMP_BITS


@jit
def candidate_holds(s, c):
    """Whether neither partner of a candidate has changed since it was noted."""
    low, high = partners(s, c)
    return versions_of(s, low, high) == s.candidates[c * CANDIDATE + VERSIONS]


@jit
def open_candidates(s):
    """Bring the candidates of the current bucket, as far as they still hold, to the event heap."""
    slot = s.counter[BUCKET] & (s.counter[WINDOW_BUCKETS] - 1)
    block = s.buckets[slot]
    s.buckets[slot] = -1
    if s.counter[BEYOND_CACHE]:
        prefetch_contacts(s, block)
    while block >= 0:
        for k in range(1, (s.blocks[block * BLOCK] & 7) + 1):
            c = s.blocks[block * BLOCK + k]
            if candidate_holds(s, c):
                entry = c * CANDIDATE
                push_event(s, from_bits(s.candidates[entry + WHEN]), s.candidates[entry + PAIR], c)
        block = release_block(s, block)
