"""The contacts predicted for the present window, kept in buckets by their time until it ends.

A contact names its two particles and the versions that they had: after a collision of either it no longer
holds, and is passed over when its turn comes. The new contacts of the two have been found by then. So no
contact is ever looked for to be removed, and at the end of the window all are dropped at once.
"""

from .. import layout as at
from ..common.bucket_queue import push_bucket, release_block
from ..common.contact_times import wall_contact
from ..common.event_heap import push_event
from ..common.prefetch import prefetch_contacts, prefetch_surroundings
from ..flags import THREADS
from ..simd.jit import jit
from ..simd.pointers import bits, int64
from .partners import contact_holds, partners, push_contacts, versions_of

if THREADS:
    from ..threads.contacts import enter_contact
    from ..threads.tiles import tile_of


@jit
def keep_contact(s, low, high, time):
    """Keep a contact if it lies in this window."""
    if time >= s.number[at.MIDDLE] + s.number[at.HALF_WINDOW]:
        return
    c = s.counter[at.CONTACTS]
    if c == s.counter[at.CONTACT_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return
    s.counter[at.CONTACTS] = c + 1
    entry = c * at.CONTACT
    s.contacts[entry + at.CONTACT_TIME] = bits(time)
    s.contacts[entry + at.CONTACT_PAIR] = low << 32 | high
    s.contacts[entry + at.CONTACT_VERSIONS] = versions_of(s, low, high)
    last = s.counter[at.BUCKET] | (
        s.counter[at.WINDOW_BUCKETS] - 1
    )  # of this window, however the time is rounded
    bucket = min(int(max(time, 0.0) * s.number[at.INVERSE_WIDTH]), last)
    if bucket <= s.counter[at.BUCKET]:
        push_event(s, time, low << 32 | high, c)
    else:
        slot = bucket & (s.counter[at.WINDOW_BUCKETS] - 1)
        push_bucket(s, slot, c)


@jit
def keep_wall_contact(s, i):
    """Keep i's next wall collision."""
    time, wall = wall_contact(s, i)
    if wall >= 0:
        if THREADS:
            enter_contact(s, tile_of(s, i), i, wall, time)
        else:
            keep_contact(s, i, wall, time)


@jit
def event_of(s, c):
    """Both partners of a predicted contact; NOTHING in place of the second where it no longer holds."""
    if not contact_holds(s, c):
        s.counter[at.STALE] += 1
        return int64(0), int64(at.NOTHING)
    return partners(s, c)


@jit
def next_bucket(s):
    """Go on to the next bucket; returns whether it begins a window, whose contacts have to be found first."""
    bucket = s.counter[at.BUCKET] + 1
    s.counter[at.BUCKET] = bucket
    begins = (bucket & (s.counter[at.WINDOW_BUCKETS] - 1)) == 0
    if not begins:
        open_contacts(s)
        prefetch_surroundings(s)
    return begins


@jit
def open_contacts(s):
    """Push the contacts of the current bucket, as far as they still hold, to the event heap."""
    slot = s.counter[at.BUCKET] & (s.counter[at.WINDOW_BUCKETS] - 1)
    block = s.buckets[slot]
    s.buckets[slot] = -1
    prefetch_contacts(s, block)
    while block >= 0:
        push_contacts(s, block)
        block = release_block(s, block)
