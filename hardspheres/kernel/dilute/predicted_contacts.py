"""The contacts predicted for the present window, kept in buckets by their time until it ends."""

from ..common.bucket_queue import push_bucket, release_block
from ..common.contact_times import wall_contact
from ..common.event_heap import push_event
from ..common.prefetch import prefetch_contacts
from ..layout import (
    BEYOND_CACHE,
    BLOCK,
    BUCKET,
    CONTACT,
    CONTACT_PAIR,
    CONTACT_ROOM,
    CONTACT_TIME,
    CONTACT_VERSIONS,
    CONTACTS,
    HALF_WINDOW,
    INVERSE_WIDTH,
    MIDDLE,
    SHORT_QUEUE,
    STAMP_BITS,
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
def keep_contact(s, low, high, time):
    """Keep a contact if it lies in this window."""
    if time >= s.number[MIDDLE] + s.number[HALF_WINDOW]:
        return
    c = s.counter[CONTACTS]
    if c == s.counter[CONTACT_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.counter[CONTACTS] = c + 1
    entry = c * CONTACT
    s.contacts[entry + CONTACT_TIME] = bits(time)
    s.contacts[entry + CONTACT_PAIR] = low << 32 | high
    s.contacts[entry + CONTACT_VERSIONS] = versions_of(s, low, high)
    last = s.counter[BUCKET] | (s.counter[WINDOW_BUCKETS] - 1)  # of this window, however the time is rounded
    bucket = min(int(max(time, 0.0) * s.number[INVERSE_WIDTH]), last)
    if bucket <= s.counter[BUCKET]:
        push_event(s, time, low << 32 | high, c)
    else:
        slot = bucket & (s.counter[WINDOW_BUCKETS] - 1)
        push_bucket(s, slot, c)


@jit
def keep_wall_contact(s, i):
    """Keep i's next wall collision."""
    time, wall = wall_contact(s, i)
    if wall >= 0:
        keep_contact(s, i, wall, time)


@jit
def partners(s, c):
    """Lower and higher id of a predicted contact."""
    pair = s.contacts[c * CONTACT + CONTACT_PAIR]
    return pair >> 32, pair & STAMP_BITS


@jit
def contact_holds(s, c):
    """Whether neither partner of a contact has changed since it was predicted."""
    low, high = partners(s, c)
    return versions_of(s, low, high) == s.contacts[c * CONTACT + CONTACT_VERSIONS]


@jit
def open_contacts(s):
    """Push the contacts of the current bucket, as far as they still hold, to the event heap."""
    slot = s.counter[BUCKET] & (s.counter[WINDOW_BUCKETS] - 1)
    block = s.buckets[slot]
    s.buckets[slot] = -1
    if s.counter[BEYOND_CACHE]:
        prefetch_contacts(s, block)
    while block >= 0:
        for k in range(1, (s.blocks[block * BLOCK] & 7) + 1):
            c = s.blocks[block * BLOCK + k]
            if contact_holds(s, c):
                entry = c * CONTACT
                push_event(
                    s, from_bits(s.contacts[entry + CONTACT_TIME]), s.contacts[entry + CONTACT_PAIR], c
                )
        block = release_block(s, block)
