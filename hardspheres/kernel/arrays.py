"""The engine's memory: the record of flat arrays that the kernels work on.

One class for all specialisations: Numba's quick look at an argument cannot tell records of equal fields apart, and with a class
for each specialisation every call of the second one used in a process would take the slow way.
"""

from typing import NamedTuple


class Arrays(NamedTuple):
    """The arrays of a simulation, owned by `Engine`; kernels turn them into pointers on entry."""

    row: object  # float64 ((n + 1) * ROW)
    event: object  # int64 (n * EVENT)
    event_float: object  # the same memory as float64
    version: object  # int32 (n): how often a particle's row has changed through events
    mass: object  # float64 (n), or one element where all are equal
    turns: object  # int64 (n * DIM): how often the row was wrapped back into the box
    flight: object  # float64 (n * FLIGHT): where FLIGHTS, when each particle's flight began
    log: object  # float64 (LOG_ROOM * LOG_ROW): events that are still to be handed over
    neighbours: object  # int32 (n * LIST_ROOM): ids, then n in all slots that are left
    images: object  # int32 (n * LIST_ROOM * DIM): image of each neighbour, where IMAGES
    where: object  # int32 (n): slot in the cells
    cell_count: object  # int32 (cells + 1): particles in each cell; windows: the first line of each cell
    cell_places: (
        object  # float32 (cells * CELL_COLUMNS * CELL_ROOM): centres as seen from the cell's corner, radii
    )
    cell_ids: object  # the same memory as int32, for their ids
    near: object  # int32 (AROUND * CELL_ROOM + LIST_ROOM + CELL_LANES): ids of those within reach of one particle
    around: object  # float32 (CELL_COLUMNS * (AROUND * CELL_ROOM + CELL_LANES)): the same of a cell and those around it
    around_ids: object  # the same memory as int32
    buckets: object  # int64 (BUCKETS + 1): first chunk of each bucket; the last is for later years
    chunks: object  # int64 (chunks * CHUNK)
    waiting_slot: object  # int64 (WAITING): buckets that entries wait for, -1: none
    waiting_entry: object  # int64, the same
    agenda_time: object  # float64: binary heap of the current bucket's events
    agenda_key: object  # int64: lower id << 32 | higher id
    agenda_entry: object  # int64: id << 32 | stamp
    scratch: object  # float64 (LANES * 16)
    scratch_int: object  # the same memory as int64
    order: object  # windows: int32 (n): the particles of the rows in the order in which they are gone through
    large: object  # int32: those that are in the coarse grid
    draft: object  # float32 (LINE): the latest new line
    drafts: object  # float32 (n * LINE): lines before they are sorted; in 3D in the memory of `lines`, which are made later
    cell_lines: object  # float32 (7 * LINE_ROOM / copies + LINE_LANES): sorted by cells, column by column; in 2D the same as lines
    cell_line_ids: object  # int32, the same
    lines: object  # float32 (7 * LINE_ROOM + LINE_LANES): sorted into rows, column by column
    line_ids: object  # int32 (LINE_ROOM + LINE_LANES)
    row_start: object  # int32 (cells + 1): first line of each row
    row_own: object  # int32 (cells): first line of the cell in the middle
    row_above: object  # int32 (cells): first line of the cell above
    row_chain: object  # int32 (cells + coarse cells): first node of each chain of new lines
    nodes: object  # float32 (NODE_ROOM * LINE): new lines
    node_ids: object  # int32 (NODE_ROOM)
    node_next: object  # int32 (NODE_ROOM)
    met: object  # int32 (LINE_LANES): 1 where the filter let a line pass
    met_when: object  # float32 (LINE_LANES): when the two lines are nearest
    meeting_i: object  # int32 (MEETING_ROOM): pairs whose lines may meet
    meeting_j: object  # int32 (MEETING_ROOM)
    meeting_when: object  # float32 (MEETING_ROOM)
    candidates: object  # int64 (CANDIDATE_ROOM * CANDIDATE), see `candidates`
    number: object  # float64: the numbers above
    counter: object  # int64: the counters above
    total: object  # float64: the sums above
