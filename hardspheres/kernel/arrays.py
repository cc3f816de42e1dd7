"""The engine's memory: the record of flat arrays that the kernels work on.

One class for all specialisations: Numba's quick look at an argument cannot tell records of equal fields
apart, and with a class for each specialisation every call of the second one used in a process would take the
slow way.
"""

from typing import NamedTuple


class Arrays(NamedTuple):
    """The arrays of a simulation, owned by `Engine`; kernels turn them into pointers on entry."""

    row: object  # float64 ((n + 1) * ROW)
    event: object  # int64 (n * EVENT)
    event_float: object  # the same memory as float64
    version: object  # int32 (n): how often a particle's row has changed through events
    mass: object  # float64 (n), or one element where all are equal
    image_counts: object  # int64 (n * DIM): how often the row was wrapped back into the box
    flight: object  # float64 (n * FLIGHT): where FLIGHTS, when each particle's flight began
    log: object  # float64 (LOG_ROOM * LOG_ROW): events that are still to be handed over
    neighbours: object  # int32 (n * LIST_ROOM): ids, then n in all slots that are left
    images: object  # int32 (n * LIST_ROOM * DIM): image index of each neighbour, where IMAGES
    where: (
        object  # int32 (n): slot in the cells; windows: slot of the segment, negative where there are several
    )
    cell_count: object  # int32 (cells + 1): particles in each cell; windows: the first segment of each cell
    cell_places: object  # float32 (cells * CELL_COLUMNS * CELL_ROOM): seen from the corner
    cell_ids: object  # the same memory as int32, for their ids
    near: object  # int32 (AROUND * CELL_ROOM + LIST_ROOM + CELL_LANES): those within a cutoff
    around: object  # float32 (CELL_COLUMNS * (AROUND * CELL_ROOM + CELL_LANES)): a cell and those around it
    around_ids: object  # the same memory as int32
    buckets: object  # int64 (BUCKETS + 1): first block of each bucket; the last is for later cycles
    blocks: object  # int64 (blocks * BLOCK)
    waiting_slot: object  # int64 (WAITING): buckets that entries wait for, -1: none
    waiting_entry: object  # int64, the same
    heap_time: object  # float64: binary heap of the current bucket's events
    heap_key: object  # int64: lower id << 32 | higher id
    heap_entry: object  # int64: id << 32 | stamp
    scratch: object  # float64 (LANES * 16)
    scratch_int: object  # the same memory as int64
    order: (
        object  # windows: int32 (n): the particles of the cells in the order in which they are gone through
    )
    large: object  # int32: those that are in the coarse grid
    unsorted: object  # float32 (n * SEGMENT): segments before they are sorted
    unsorted_words: object  # the same memory as int32
    unsorted_boxes: object  # int64 (n)
    segments: object  # float32 ((SEGMENT_ROOM + OVERFLOW_ROOM + 2) * SEGMENT): sorted; overflow; new
    segment_words: object  # the same memory as int32
    boxes: (
        object  # int64 (SEGMENT_ROOM + OVERFLOW_ROOM + AT_ONCE): their quantised bounding boxes, see `layout`
    )
    cell_of_segment: object  # int32 (SEGMENT_ROOM)
    image_shifts: object  # int64 (64): how far bounding boxes are shifted in each image
    column: object  # int32 ((nx + 2) (nz + 2)): index of each column, and of those beyond the box
    column_code: object  # int32, the same: the image in which the box is seen from there
    places: object  # int64 (32): columns near a segment, as places in their table
    pair_slot: (
        object  # int32 (NEAR_ROOM + 2 * AT_ONCE): slots of segments whose boxes overlap that of another
    )
    pair_own: object  # uint32, the same: the slot of that other, and the image in which it is seen
    own_slots: object  # int32 (EIGHT): such slots alone
    pair_segments: object  # float32 (2 * SEGMENT * EIGHT): the segments of eight pairs, column by column
    passed: object  # int32 (NEAR_ROOM + 2 * AT_ONCE): which pairs may touch
    changed: object  # int64 (2 * CHANGED): particles that an event has changed, see `windows`
    overflow_first: object  # int32: first node of each overflow list
    overflow_next: object  # int32 (OVERFLOW_ROOM)
    contacts: object  # int64 (CONTACT_ROOM * CONTACT), see `layout`
    number: object  # float64: the numbers above
    counter: object  # int64: the counters above
    total: object  # float64: the sums above
