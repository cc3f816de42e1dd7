"""The contacts of a window where several threads are at work: those of a tile are in buckets of its own.

A contact of particles of two tiles stands with both. The domain that executes it has both tiles; in another
one it holds the particle of that domain back. When it has been executed, the other entry holds no longer.
"""

from .. import layout as at
from ..common.event_heap import push_event
from ..common.prefetch import prefetch_contacts
from ..dilute.partners import push_contacts, versions_of
from ..simd.jit import called, jit
from ..simd.pointers import bits, from_bits
from .homes import tile_of_segment
from .tile_buckets import push_bucket, release_block, tick_of
from .tiles import freeze, tile_of


@jit
def keep_contact_of(s, low, high, time, own, slot):
    """Keep a contact of two segments; while all are compared, whoever has the other one finds it too."""
    tile = tile_of_segment(s, own)
    enter_contact(s, tile, low, high, time)
    if s.counter[at.COMPARING] == 0:
        other = tile_of_segment(s, slot)
        if other != tile:
            enter_contact(s, other, low, high, time)


@jit
def enter_contact(s, tile, low, high, time):
    """Enter a contact in the table of a tile if it lies in this window."""
    if time >= s.number[at.MIDDLE] + s.number[at.HALF_WINDOW]:
        return
    c = new_contact(s, tile, low, high, time)
    if c >= 0:
        if s.counter[at.LIMIT] > 0 and tick_in_window(s, time) <= s.counter[at.PRESENT_TICK]:
            push_event(s, time, low << 32 | high, c)
        else:
            put_back(s, c)


@jit
def new_contact(s, tile, low, high, time):
    """Write a contact down; returns its number, -1 where there is no room."""
    k = s.contact_count[tile * at.LINE]
    if k == s.counter[at.CONTACT_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return -1
    s.contact_count[tile * at.LINE] = k + 1
    c = tile * s.counter[at.CONTACT_ROOM] + k
    s.contacts[c * at.CONTACT + at.CONTACT_TIME] = bits(time)
    s.contacts[c * at.CONTACT + at.CONTACT_PAIR] = low << 32 | high
    s.contacts[c * at.CONTACT + at.CONTACT_VERSIONS] = versions_of(s, low, high)
    return c


@jit
def put_back(s, c):
    """Insert a contact into its bucket, even if that is of this window."""
    tick = tick_in_window(s, from_bits(s.contacts[c * at.CONTACT + at.CONTACT_TIME]))
    first = s.counter[at.BUCKET] * s.counter[at.BUCKET_TICKS]
    push_bucket(s, c // s.counter[at.CONTACT_ROOM], max(tick, s.counter[at.TICK]) - first, c)


@jit
def tick_in_window(s, time):
    """Tick of a time in this window of time, however it is rounded."""
    return min(tick_of(s, time), (s.counter[at.BUCKET] + 1) * s.counter[at.BUCKET_TICKS] - 1)


@jit
def set_aside(s, c):
    """Put a contact back after this round."""
    k = s.counter[at.SET_ASIDE]
    if k == s.counter[at.HEAP_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return
    s.counter[at.SET_ASIDE] = k + 1
    s.set_aside[k] = c


@called
def put_search_off(s, i, met, now):
    """Put off the search for the coming contacts of i, which has just met somebody, to a later round."""
    c = new_contact(s, tile_of(s, i), i, at.SEARCH_DUE + 1 + met, now)
    if c >= 0:
        s.counter[at.PUT_OFF] += 1
        freeze(s, i)
        set_aside(s, c)


@jit
def open_tick(s, tick):
    """Push the contacts of a tick, in all tiles of the domain at work, to the event heap.

    Those that hold no longer are dropped. Particles of another domain may be changing: one that has is seen.
    """
    slot = tick - s.counter[at.BUCKET] * s.counter[at.BUCKET_TICKS]
    for a in range(s.counter[at.TILES_AT_WORK]):
        tile = s.tiles_at_work[a]
        place = tile * (s.counter[at.BUCKETS] + 1) + slot
        block = s.buckets[place]
        s.buckets[place] = -1
        prefetch_contacts(s, block)
        while block >= 0:
            push_contacts(s, block)
            block = release_block(s, tile, block)


@called
def put_heap_back(s):
    """Put back what is left in the heap."""
    for k in range(s.counter[at.HEAP_LENGTH]):
        put_back(s, s.heap_entry[k])
    s.counter[at.HEAP_LENGTH] = 0
