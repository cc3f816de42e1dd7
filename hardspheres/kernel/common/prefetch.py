"""Prefetching, all of it: what coming events need is brought into the cache before they need it.

No bit depends on it, and the method reads without it: each call says at what moment which memory is known to
be needed soon. A gas beyond a core's caches (BEYOND_CACHE) waits for the cache that cores share, one beyond
that too (BEYOND_ALL) for the memory, some 300 cycles for each line. Where neither, most functions do nothing.
"""

from .. import layout as at
from ..dilute.grid import cell_place, columns_around
from ..dilute.pair_table import slot_in
from ..flags import SPARSE, THREADS
from ..simd.jit import called, jit
from ..simd.pointers import int64, prefetch
from ..simd.vectors import AT_ONCE
from .bucket_queue import push_bucket
from .versions import prefetch_version

AHEAD = 16  # particles from the one at work to the one whose row is prefetched


@jit
def prefetch_next_event(s):
    """Prefetch the rows of those that the particles of the heap's first event can collide with next."""
    if not SPARSE and s.counter[at.BEYOND_CACHE] and s.counter[at.HEAP_LENGTH] > 0:
        i = s.heap_entry[0] >> 32
        partner = s.event[i * at.EVENT + at.PARTNER]
        for k in range(at.LANES):
            prefetch(s.row, s.neighbours[i * s.counter[at.LIST_ROOM] + k] * at.ROW)
        if 0 <= partner < s.counter[at.N]:
            for k in range(at.LANES):
                prefetch(s.row, s.neighbours[partner * s.counter[at.LIST_ROOM] + k] * at.ROW)


# Lists.


@jit
def prefetch_event(s, i):
    """Prefetch what the coming event of i needs; it has just gone to the heap."""
    partner = s.event[i * at.EVENT + at.PARTNER]
    prefetch(s.row, i * at.ROW)
    prefetch(s.neighbours, i * s.counter[at.LIST_ROOM])
    prefetch_version(s, i)
    if 0 <= partner < s.counter[at.N]:
        prefetch(s.row, partner * at.ROW)
        prefetch(s.neighbours, partner * s.counter[at.LIST_ROOM])
        prefetch(s.event, partner * at.EVENT)
        prefetch_version(s, partner)
    if THREADS:
        prefetch(s.old_row_of, i * at.OLD_ROW_OF)
        prefetch(s.old_row_of, max(partner, 0) * at.OLD_ROW_OF)


@jit
def push_bucket_later(s, slot, entry):
    """Append an entry to a bucket, delayed by a few others while the end of that bucket is prefetched.

    Two steps: where the last block is, then the block. Whoever opens a bucket first calls `push_all_waiting`.
    """
    if s.counter[at.BEYOND_CACHE]:
        k = s.counter[at.WAITS]
        s.counter[at.WAITS] = (k + 1) % at.WAITING
        push_waiting(s, k)
        s.waiting_slot[k] = slot
        s.waiting_entry[k] = entry
        prefetch(s.buckets, slot)
        halfway = s.waiting_slot[(k + at.WAITING // 2) % at.WAITING]
        if halfway >= 0:
            prefetch(s.blocks, s.buckets[halfway] * at.BLOCK)
    else:
        push_bucket(s, slot, entry)


@jit
def push_waiting(s, k):
    """Append one of the delayed entries."""
    if s.waiting_slot[k] >= 0:
        push_bucket(s, s.waiting_slot[k], s.waiting_entry[k])
        s.waiting_slot[k] = -1


@called
def push_all_waiting(s):
    """Append all delayed entries."""
    if s.counter[at.BEYOND_CACHE]:
        for k in range(at.WAITING):
            push_waiting(s, k)


@jit
def forget_waiting(s):
    """Drop all delayed entries: the calendar is emptied."""
    for k in range(at.WAITING):
        s.waiting_slot[k] = -1


@jit
def prefetch_buckets(s, bucket):
    """Prefetch the events of the bucket after this one, and the first block of the one after that."""
    if s.counter[at.BEYOND_CACHE]:
        cycle = s.counter[at.BUCKETS]
        block = s.buckets[(bucket + 1) & (cycle - 1)]
        while block >= 0:
            header = s.blocks[block * at.BLOCK]
            for k in range(1, (header & 7) + 1):
                prefetch(s.event, (s.blocks[block * at.BLOCK + k] >> 32) * at.EVENT)
            block = header >> 3
        prefetch(s.blocks, s.buckets[(bucket + 2) & (cycle - 1)] * at.BLOCK)


# Windows.


@jit
def prefetch_eight_rows(s, first, n):
    """Prefetch the rows of the eight particles that are AHEAD of those from `first` on, in their order."""
    for k in range(8):
        prefetch(s.row, s.order[min(first + AHEAD + k, n - 1)] * at.ROW)


@jit
def prefetch_contacts(s, first):
    """Prefetch the predicted contacts of a bucket, given its first block, and then their particles."""
    if s.counter[at.BEYOND_CACHE]:
        for stage in range(3 if THREADS else 2):
            block = first
            while block >= 0:
                header = s.blocks[block * at.BLOCK]
                for k in range(1, (header & 7) + 1):
                    c = s.blocks[block * at.BLOCK + k]
                    if stage == 0:
                        prefetch(s.contacts, c * at.CONTACT)
                        continue
                    pair = s.contacts[c * at.CONTACT + at.CONTACT_PAIR]
                    low, high = pair >> 32, pair & at.STAMP_BITS
                    if stage == 2:
                        prefetch(s.home, s.where[low] * at.HOME)
                        prefetch(s.home, s.where[min(high, s.counter[at.N] - 1)] * at.HOME)
                    else:
                        prefetch_version(s, low)
                        prefetch_version(s, high)
                        prefetch(s.row, low * at.ROW)
                        prefetch(s.row, high * at.ROW)
                        if THREADS:
                            prefetch(s.where, low)
                            prefetch(s.where, high)
                            prefetch(s.old_row_of, low * at.OLD_ROW_OF)
                            prefetch(s.old_row_of, high * at.OLD_ROW_OF)
                block = header >> 3


# A search reads where a particle's segment is, the segment itself, where the segments of near columns begin,
# and their bounding boxes: each from a place that the one before tells, and each would be waited for.
STEPS = 4
ITSELF, COLUMNS = 1, 2


@jit
def prefetch_surroundings(s):
    """Prefetch what the searches after all events in the heap will read."""
    if s.counter[at.BEYOND_ALL]:
        prefetch_all_surroundings(s)


@called
def prefetch_all_surroundings(s):
    """Take every step for all events of the bucket before the next step.

    The columns near both partners are the same, nearly: they are prefetched once.
    """
    for step in range(STEPS):
        ids = 2 if step < COLUMNS else 1
        for a in range(ids * s.counter[at.HEAP_LENGTH]):
            key = s.heap_key[a // ids]
            i = key >> 32 if a % ids == 0 else key & at.STAMP_BITS
            if i < s.counter[at.N]:  # no wall
                prefetch_step(s, step, i)


@jit
def prefetch_step(s, step, i):
    """Prefetch what one step reads of i."""
    if step == 0:
        prefetch(s.where, i)
        return
    slot = s.where[i]
    if slot < 0:
        return
    if step == ITSELF:
        prefetch(s.segments, slot * at.SEGMENT)
        prefetch(s.boxes, slot)
        prefetch(s.cell_of_segment, slot)
        return
    x, y, z = cell_place(s, int64(s.cell_of_segment[slot]))
    for k in range(columns_around(s, int64(0), s.boxes[slot] >> at.NEAR_SHIFT, x, z)):
        cell = int64(s.column[s.places[k]]) * s.counter[at.CELLS + 1] + max(y - 1, 0)
        if step == COLUMNS:
            prefetch(s.cell_count, cell)
        else:
            prefetch(s.boxes, s.cell_count[cell])
            prefetch(s.boxes, s.cell_count[cell] + AT_ONCE // 2)


@jit
def prefetch_runs(s, begin, end, first):
    """Prefetch the boxes of cell `first` on in each of the columns noted from `begin` to `end`."""
    if s.counter[at.BEYOND_CACHE]:
        for place in range(begin, end):
            column = int64(s.column[s.places[place]])
            start = s.cell_count[column * s.counter[at.CELLS + 1] + max(first, 0)]
            prefetch(s.boxes, start)
            prefetch(s.boxes, start + AT_ONCE // 2)


@jit
def prefetch_segments(s, first, last):
    """Prefetch the segments of pairs `first` to `last` of the table: the filter will read them."""
    if s.counter[at.BEYOND_ALL]:
        for pair in range(first, last):
            prefetch(s.segments, s.pair_slot[pair] * at.SEGMENT)


@jit
def prefetch_partners(s, passed):
    """Prefetch the rows of those whose contacts are to be computed."""
    if s.counter[at.BEYOND_ALL]:
        prefetch_all_partners(s, passed)


@called
def prefetch_all_partners(s, passed):
    """As `prefetch_partners`, out of the way of those who do not need it."""
    for a in range(passed):
        pair = int(s.passed[a])
        for slot in (int(s.pair_slot[pair]), int(slot_in(s.pair_own[pair]))):
            i = int64(s.segment_words[slot * at.SEGMENT + at.OWNER])
            prefetch(s.row, i * at.ROW)
            prefetch(s.version, i)
