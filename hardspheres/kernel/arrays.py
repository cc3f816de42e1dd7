"""The engine's memory: the record of flat arrays that the kernels work on, with their types."""

from typing import NamedTuple

from numpy import float32, float64, int32, int64, uint32


class Arrays(NamedTuple):
    """The arrays of a simulation, owned by `Engine`; `addresses` tells kernels where they are."""

    row: float64  # ((n + 1) * ROW)
    event: int64  # (n * EVENT)
    event_float: float64  # the same memory as float64
    version: int32  # (n): how often a particle's row has changed through events
    mass: float64  # (n), or one element where all are equal
    image_counts: int64  # (n * DIM): how often the row was wrapped back into the box
    flight: float64  # (n * FLIGHT): where FLIGHTS, when each particle's flight began
    log: float64  # (LOG_ROOM * LOG_ROW): events that are still to be handed over
    neighbours: int32  # (n * LIST_ROOM): ids, then n in all slots that are left
    images: int32  # (n * LIST_ROOM * DIM): image index of each neighbour, where IMAGES
    where: int32  # (n): slot in the cells; windows: slot of the segment, negative where there are several
    cell_count: int32  # (cells + 1): particles in each cell; windows: the first segment of each cell
    cell_places: float32  # (cells * CELL_COLUMNS * CELL_ROOM): seen from the corner
    cell_ids: int32  # the same memory as int32, for their ids
    near: int32  # (AROUND * CELL_ROOM + LIST_ROOM + CELL_LANES): those within a cutoff
    around: float32  # (CELL_COLUMNS * (AROUND * CELL_ROOM + CELL_LANES)): a cell and those around it
    around_ids: int32  # the same memory as int32
    buckets: int64  # (BUCKETS + 1): first block of each bucket; the last is for later cycles
    blocks: int64  # (blocks * BLOCK)
    waiting_slot: int64  # (WAITING): buckets that entries wait for, -1: none
    waiting_entry: int64  # int64, the same
    heap_time: float64  # binary heap of the current bucket's events
    heap_key: int64  # lower id << 32 | higher id
    heap_entry: int64  # id << 32 | stamp
    scratch: float64  # (LANES * 16)
    scratch_int: int64  # the same memory as int64
    order: int32  # windows: (n): the particles of the cells in the order in which they are gone through
    large: int32  # those that are in the coarse grid
    unsorted: float32  # (n * SEGMENT): segments before they are sorted
    unsorted_words: int32  # the same memory as int32
    unsorted_boxes: int64  # (n)
    segments: float32  # ((SEGMENT_ROOM + OVERFLOW_ROOM + 2) * SEGMENT): sorted; overflow; new
    segment_words: int32  # the same memory as int32
    boxes: (
        int64  # int64 (SEGMENT_ROOM + OVERFLOW_ROOM + AT_ONCE): their quantised bounding boxes, see `layout`
    )
    cell_of_segment: int32  # (SEGMENT_ROOM)
    image_shifts: int64  # (64): how far bounding boxes are shifted in each image
    column: int32  # ((nx + 2) (nz + 2)): index of each column, and of those beyond the box
    column_code: int32  # int32, the same: the image in which the box is seen from there
    places: int64  # (32): columns near a segment, as places in their table
    pair_slot: int32  # (NEAR_ROOM + 2 * AT_ONCE): slots of segments whose boxes overlap that of another
    pair_own: uint32  # uint32, the same: the slot of that other, and the image in which it is seen
    own_slots: int32  # (EIGHT): such slots alone
    pair_segments: float32  # (2 * SEGMENT * EIGHT): the segments of eight pairs, column by column
    passed: int32  # (NEAR_ROOM + 2 * AT_ONCE): which pairs may touch
    changed: int64  # (2 * CHANGED): particles that an event has changed, see `windows`
    overflow_first: int32  # first node of each overflow list
    overflow_next: int32  # (OVERFLOW_ROOM)
    contacts: int64  # (CONTACT_ROOM * CONTACT), see `layout`
    number: float64  # the numbers above
    counter: int64  # the counters above
    total: float64  # the sums above
