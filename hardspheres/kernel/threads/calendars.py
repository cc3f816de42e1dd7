"""The calendars of the tiles: as `dense.calendar`, one for each, since no two threads may write to one.

The heap has the events of this window, of one domain at a time. A window ends at a tick, of which a bucket
has many, so an event of the current bucket may wait for a later window.
"""

from .. import layout as at
from ..common.event_heap import push_event
from ..common.prefetch import prefetch_event
from ..dense.calendar import replace_event, tie_key
from ..simd.jit import called, jit
from ..simd.pointers import prefetch
from .tile_buckets import clear_buckets, owner, push_bucket, release_block, tick_of
from .tiles import is_inside_now, tile_of


@jit
def put_back(s, i):
    """Insert i's event into its bucket, even if it is of this window."""
    time = s.event_float[i * at.EVENT + at.TIME]
    now, cycle = s.counter[at.BUCKET], s.counter[at.BUCKETS]
    bucket = max(tick_of(s, time) // s.counter[at.BUCKET_TICKS], now)
    slot = bucket & (cycle - 1) if bucket < now + cycle else cycle
    push_bucket(s, tile_of(s, i), slot, i << 32 | s.event[i * at.EVENT + at.STAMP])


@jit
def insert_event(s, i):
    """Insert i's event, just predicted, into the heap or the calendar."""
    event = i * at.EVENT
    time = s.event_float[event + at.TIME]
    if time >= s.number[at.EPOCH_LENGTH]:
        return
    tick = tick_of(s, time)
    if not is_due(s, i):
        put_back(s, i)
    elif tick > s.counter[at.PRESENT_TICK]:
        queue(s, tick - s.counter[at.TICK], i << 32 | s.event[event + at.STAMP])
    else:
        prefetch_event(s, i)
        push_event(s, time, tie_key(i, s.event[event + at.PARTNER]), i << 32 | s.event[event + at.STAMP])


@jit
def queue(s, tick, entry):
    """Queue an entry for a later tick of this window."""
    k = s.counter[at.QUEUED]
    if k == s.counter[at.HEAP_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return
    s.counter[at.QUEUED] = k + 1
    s.queued[k] = entry
    s.queued_before[k] = s.queued_last[tick]
    s.queued_last[tick] = k


@jit
def next_tick(s):
    """Go on to the next tick: its events go to the heap. Whether there is one, in this window."""
    tick = s.counter[at.PRESENT_TICK] + 1
    if tick >= s.counter[at.LIMIT]:
        return False
    s.counter[at.PRESENT_TICK] = tick
    k = s.queued_last[tick - s.counter[at.TICK]]
    s.queued_last[tick - s.counter[at.TICK]] = -1
    while k >= 0:
        entry = s.queued[k]
        i = entry >> 32
        if s.event[i * at.EVENT + at.STAMP] == entry & at.STAMP_BITS:
            insert_event(s, i)
        k = s.queued_before[k]
    if tick + 1 < s.counter[at.LIMIT]:
        k = s.queued_last[tick + 1 - s.counter[at.TICK]]
        while k >= 0:
            prefetch(s.event, (s.queued[k] >> 32) * at.EVENT)
            k = s.queued_before[k]
    return True


@jit
def clear_queue(s):
    """Empty the queue of this window's ticks."""
    s.counter[at.QUEUED] = 0
    for tick in range(s.counter[at.BUCKET_TICKS]):
        s.queued_last[tick] = -1


@called
def put_back_all(s):
    """Put back to the calendar what is left in the heap and in the queue."""
    for k in range(s.counter[at.HEAP_LENGTH]):
        put_back_live(s, s.heap_entry[k])
    for tick in range(s.counter[at.BUCKET_TICKS]):
        k = s.queued_last[tick]
        while k >= 0:
            put_back_live(s, s.queued[k])
            k = s.queued_before[k]
    s.counter[at.HEAP_LENGTH] = 0


@jit
def put_back_live(s, entry):
    """Put an entry back, unless a later prediction has replaced it."""
    if s.event[(entry >> 32) * at.EVENT + at.STAMP] == entry & at.STAMP_BITS:
        put_back(s, entry >> 32)


@jit
def schedule(s, i, time, partner):
    """Make this i's next event, and insert it into the heap or the calendar."""
    replace_event(s, i, time, partner)
    insert_event(s, i)


@jit
def is_due(s, i):
    """Whether i's event is of this window."""
    time = s.event_float[i * at.EVENT + at.TIME]
    return tick_of(s, time) < s.counter[at.LIMIT] and time <= s.number[at.STOP_TIME]


@jit
def stays(s, i):
    """Whether i's event has to wait for another round, and nobody inside the domain has to wait for it."""
    if is_inside_now(s, i):
        return False
    partner = s.event[i * at.EVENT + at.PARTNER]
    return partner < 0 or partner >= s.counter[at.N] or not is_inside_now(s, partner)


@called
def open_bucket(s, tile, slot):
    """Insert the live events of a bucket again: those of this window go to the heap."""
    place = tile * (s.counter[at.BUCKETS] + 1) + slot
    block = s.buckets[place]
    s.buckets[place] = -1
    while block >= 0:
        header = s.blocks[block * at.BLOCK]
        for k in range(1, (header & 7) + 1):
            entry = s.blocks[block * at.BLOCK + k]
            i = entry >> 32
            if s.event[i * at.EVENT + at.STAMP] == entry & at.STAMP_BITS:
                if is_due(s, i) and stays(s, i):
                    s.counter[at.STAYED] += 1
                    put_back(s, i)
                else:
                    insert_event(s, i)
        block = release_block(s, tile, block)


@jit
def open_tile(s, tile):
    """Take the events of this window from a tile's calendar; first a new cycle's share of later ones."""
    bucket, cycle = s.counter[at.BUCKET], s.counter[at.BUCKETS]
    if s.cycle_of[tile * at.LINE] != bucket // cycle:
        s.cycle_of[tile * at.LINE] = bucket // cycle
        open_bucket(s, tile, cycle)
    prefetch_bucket(s, tile, bucket & (cycle - 1))
    open_bucket(s, tile, bucket & (cycle - 1))


@jit
def prefetch_bucket(s, tile, slot):
    """Prefetch the events of a bucket."""
    block = s.buckets[tile * (s.counter[at.BUCKETS] + 1) + slot]
    while block >= 0:
        header = s.blocks[block * at.BLOCK]
        for k in range(1, (header & 7) + 1):
            prefetch(s.event, (s.blocks[block * at.BLOCK + k] >> 32) * at.EVENT)
        block = header >> 3


@called
def clear_calendars(s):
    """Empty the calendars of this thread's tiles."""
    for tile in range(s.counter[at.TILES]):
        if owner(s, tile) == s.counter[at.THREAD]:
            clear_buckets(s, tile)
            s.cycle_of[tile * at.LINE] = s.counter[at.BUCKET] // s.counter[at.BUCKETS]
