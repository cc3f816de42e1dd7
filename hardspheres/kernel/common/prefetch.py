"""Prefetching: what the coming events need, where a gas is larger than the caches. It changes no bit.

In windows a search reads where a particle's segment is, in which cell, where the segments near it begin, and
these: each from a place that the one before tells, and each would be waited for. So `prefetch_surroundings`
takes every step for all events of a bucket before the next one.
"""

from .. import layout as at
from ..dilute.grid import cell_place, columns_around
from ..dilute.pair_table import slot_in
from ..simd.jit import called, jit
from ..simd.pointers import int64, prefetch
from ..simd.vectors import AT_ONCE


@jit
def prefetch_event(s, i):
    """Prefetch what the coming event of i needs."""
    partner = s.event[i * at.EVENT + at.PARTNER]
    prefetch(s.row, i * at.ROW)
    prefetch(s.neighbours, i * s.counter[at.LIST_ROOM])
    prefetch(s.version, i)
    if 0 <= partner < s.counter[at.N]:
        prefetch(s.row, partner * at.ROW)
        prefetch(s.neighbours, partner * s.counter[at.LIST_ROOM])
        prefetch(s.event, partner * at.EVENT)
        prefetch(s.version, partner)


@jit
def prefetch_neighbours(s):
    """Prefetch the rows of those that the particles of the heap's first event can collide with next."""
    i = s.heap_entry[0] >> 32
    partner = s.event[i * at.EVENT + at.PARTNER]
    for k in range(at.LANES):
        prefetch(s.row, s.neighbours[i * s.counter[at.LIST_ROOM] + k] * at.ROW)
    if 0 <= partner < s.counter[at.N]:
        for k in range(at.LANES):
            prefetch(s.row, s.neighbours[partner * s.counter[at.LIST_ROOM] + k] * at.ROW)


@jit
def prefetch_events(s, block):
    """Prefetch the events of a bucket, given its first block."""
    while block >= 0:
        header = s.blocks[block * at.BLOCK]
        for k in range(1, (header & 7) + 1):
            prefetch(s.event, (s.blocks[block * at.BLOCK + k] >> 32) * at.EVENT)
        block = header >> 3


@jit
def prefetch_contacts(s, first):
    """Prefetch the predicted contacts of a bucket, given its first block, and then their particles."""
    for stage in range(2):
        block = first
        while block >= 0:
            header = s.blocks[block * at.BLOCK]
            for k in range(1, (header & 7) + 1):
                c = s.blocks[block * at.BLOCK + k]
                if stage == 0:
                    prefetch(s.contacts, c * at.CONTACT)
                else:
                    pair = s.contacts[c * at.CONTACT + at.CONTACT_PAIR]
                    low, high = pair >> 32, pair & at.STAMP_BITS
                    prefetch(s.version, low)
                    prefetch(s.version, high)
                    prefetch(s.row, low * at.ROW)
                    prefetch(s.row, high * at.ROW)
            block = header >> 3


# The steps: where the segment is, the segment itself, where the segments of near columns begin, and their
# bounding boxes.
STEPS = 4
ITSELF, COLUMNS = 1, 2


@called
def prefetch_surroundings(s):
    """Prefetch what the searches after the events in the heap will read.

    The columns near both partners are the same, nearly: they are fetched once.
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
    """Fetch what one step reads of i."""
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


@called
def prefetch_rows(s, passed):
    """Prefetch the rows of those whose contacts are to be computed."""
    for a in range(passed):
        pair = int(s.passed[a])
        for slot in (int(s.pair_slot[pair]), int(slot_in(s.pair_own[pair]))):
            i = int64(s.segment_words[slot * at.SEGMENT + at.OWNER])
            prefetch(s.row, i * at.ROW)
            prefetch(s.version, i)
