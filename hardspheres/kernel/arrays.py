"""The engine's memory: one table of all flat arrays, from which the kernels' record of them is made.

One class of records serves all kinds of scenes: Numba's quick look at an argument cannot tell records of
equal fields apart, and with a class for each kind every call of the second one in a process would take the
slow way.
"""

from collections import namedtuple
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

I4, U4, I8, F4, F8 = np.int32, np.uint32, np.int64, np.float32, np.float64

Length = Callable[[Any, Any], int]


class Array(NamedTuple):
    """One array, and the names under which kernels read it."""

    name: str
    dtype: type
    length: Length  # from the slots `at` (`layout`) and the counters `c`; 0: the scene has no use for it
    view: tuple[str, type] | None = None  # the same memory by another name, as another type
    kept: str = ""  # its name in a checkpoint; what has none can be found again
    own: bool = False  # each thread has one of its own


def around(at: Any, c: Any) -> int:
    """Places in the table of a cell and those around it."""
    return at.AROUND * int(c[at.CELL_ROOM]) + at.CELL_LANES if not at.SPARSE else 0


def cells(at: Any, c: Any) -> int:
    """Cells in the grid."""
    return int(np.prod(c[at.CELLS : at.CELLS + 3]))


def segments(at: Any, c: Any) -> int:
    """Slots of the sorted segments, of those in overflow lists, and of two new ones (of each thread)."""
    new = at.LINE * int(c[at.THREAD_COUNT]) if at.THREADS else 2
    return int(c[at.SEGMENT_ROOM] + c[at.OVERFLOW_ROOM]) + new if at.SPARSE else 0


def unsorted(at: Any, c: Any) -> int:
    """Segments before they are sorted; they are written eight at a time."""
    return int(c[at.N]) + 8 if at.SPARSE else 0


def overflow_lists(at: Any, c: Any) -> int:
    """Overflow lists: of each column, of the one that stands for all beyond walls, of the coarse cells."""
    if not at.SPARSE:
        return 0
    nx, ny, nz = c[at.CELLS : at.CELLS + 3].tolist()
    large = int(np.prod(c[at.LARGE_CELLS : at.LARGE_CELLS + 3]))
    return int((nx * nz + 1) * -(-ny // at.CELLS_OF_OVERFLOW) + large)


def columns(at: Any, c: Any) -> int:
    """Columns of cells, and those one cell beyond the box."""
    return int((c[at.CELLS] + 2) * (c[at.CELLS + 2] + 2)) if at.SPARSE else 0


def near_pairs(at: Any, c: Any) -> int:
    """Pairs of segments; vectors of 16 are written where the room ends."""
    return int(c[at.NEAR_ROOM]) + 32 if at.SPARSE else 0


def tables_of_tiles(at: Any, c: Any, length: int) -> int:
    """Tables that each tile has, all in one array."""
    tables = int(c[at.TILES]) if at.THREADS else 1
    return tables * int(length)


def cell_columns(at: Any, c: Any) -> int:
    """Columns of cells, and the one that stands for all beyond walls, where threads need to know of them."""
    return int(c[at.CELLS] * c[at.CELLS + (2 if at.SPARSE else 1)]) + 1 if at.THREADS else 0


def of_dilute(at: Any, length: int) -> int:
    """Length of what only windows on threads need."""
    return int(length) if at.THREADS and at.SPARSE else 0


def old_rows(at: Any, c: Any) -> int:
    """Room for the old rows of a window, of all threads."""
    return int(c[at.UNDO_ROOM] * c[at.THREAD_COUNT]) * at.OLD_ROW if at.THREADS else 0


def counters(at: Any, c: Any) -> int:
    """Return how many counters there are, with those of flights."""
    species = c[at.SPECIES_COUNT]
    return int(at.COUNTERS + species * (at.FLIGHT_COUNT + species))


def sums(at: Any, c: Any) -> int:
    """Return how many sums there are, with those of flights."""
    return int(at.FLIGHT_SUMS + 2 * c[at.SPECIES_COUNT] * at.FLIGHT_SUM)


OF_RUN = (  # These last as long as the simulation.
    # Rows of the particles, and one of NaN; see `layout`.
    Array("row", F8, lambda at, c: (c[at.N] + 1) * at.ROW, view=("row_int", I8), kept="row"),
    # How often a particle's row has changed through events.
    Array("version", I4, lambda at, c: c[at.N]),
    # One element where all are equal.
    Array("mass", F8, lambda at, c: c[at.N] if at.MASSES else 1),
    # How often the row was wrapped back into the box.
    Array("image_counts", I8, lambda at, c: c[at.N] * at.DIM, kept="turns"),
    # When each particle's flight began.
    Array("flight", F8, lambda at, c: c[at.N] * at.FLIGHT, kept="flight"),
    # Events that are still to be handed over.
    Array("log", F8, lambda at, c: c[at.LOG_ROOM] * at.LOG_ROW, own=True),
    # Two tables of partners, or one of segments, that vector instructions read; see `contact_times`,
    # `segments`.
    Array("scratch", F8, lambda at, c: at.LANES * 32, view=("scratch_int", I8), own=True),
    Array("number", F8, lambda at, c: at.NUMBERS + at.FLIGHT_UNIT * c[at.SPECIES_COUNT], own=True),
    Array(
        "counter",
        I8,
        counters,
        own=True,
    ),
    # Gravity: squared speed of each particle at the wall it is pulled to, along each axis.
    Array("fall", F8, lambda at, c: c[at.N] * at.FALL, kept="fall"),
    Array("total", F8, sums, kept="total", own=True),
    # Counters and sums when the window began.
    Array("old_counter", I8, lambda at, c: counters(at, c) * at.THREADS, own=True),
    Array("old_total", F8, lambda at, c: sums(at, c) * at.THREADS, own=True),
    Array("integral", F8, lambda at, c: 2 * at.INTEGRALS, kept="integral"),
    # Sums that threads hand over.
    Array("handed_sums", F8, lambda at, c: sums(at, c) * c[at.THREAD_COUNT] * at.THREADS),
)

OF_SEARCH = (  # These are found again from the rows whenever room runs out or epochs get another length.
    # Where a particle is in the cells; windows: slot of its segment, negative where there are several.
    Array("where", I4, lambda at, c: c[at.N]),
    # Bucket queue and event heap. First block of each bucket; the last bucket is for later cycles.
    Array("buckets", I8, lambda at, c: tables_of_tiles(at, c, c[at.BUCKETS] + 1)),
    Array("blocks", I8, lambda at, c: tables_of_tiles(at, c, c[at.BLOCKS] * at.BLOCK)),
    # Binary heap of the current bucket's events: time; lower id << 32 | higher id; the entry of the queue.
    Array("heap_time", F8, lambda at, c: c[at.HEAP_ROOM], own=True),
    Array("heap_key", I8, lambda at, c: c[at.HEAP_ROOM], own=True),
    Array("heap_entry", I8, lambda at, c: c[at.HEAP_ROOM], own=True),
    # Lists. A particle's next event.
    Array("event", I8, lambda at, c: c[at.N] * at.EVENT, view=("event_float", F8)),
    # Ids, then n in all slots that are left; the image index of each where IMAGES.
    Array("neighbours", I4, lambda at, c: c[at.N] * c[at.LIST_ROOM]),
    Array("images", I4, lambda at, c: c[at.N] * c[at.LIST_ROOM] * at.DIM * c[at.IMAGES]),
    # Particles in each cell; windows: the first segment of each cell, and of a column beyond the last.
    Array("cell_count", I4, lambda at, c: cells(at, c) + c[at.CELLS + 1] + 1),
    # Reference positions in each cell, as seen from its corner, with their ids.
    Array(
        "cell_places", F4, lambda at, c: cells(at, c) * at.CELL_COLUMNS * c[at.CELL_ROOM], ("cell_ids", I4)
    ),
    # Ids of those within a cutoff, a table of those in a cell and around it.
    Array("near", I4, lambda at, c: around(at, c) + c[at.LIST_ROOM], own=True),
    Array("around", F4, lambda at, c: at.CELL_COLUMNS * around(at, c), view=("around_ids", I4), own=True),
    # Buckets that entries wait for (-1: none), and the entries.
    Array("waiting_slot", I8, lambda at, c: at.WAITING),
    Array("waiting_entry", I8, lambda at, c: at.WAITING),
    # Threads. Of each column of cells its tile, and the shifts in which it is inside a domain, a bit each.
    Array("tile_of_column", I4, cell_columns),
    Array("inside_in", I4, cell_columns),
    # Of each tile, for each shift, its domain.
    Array("domain_of", I4, lambda at, c: (at.ALL_TILES + 1) * c[at.TILES] * at.THREADS),
    # The head of each tile's list of free blocks; the cycle whose later events it has taken.
    Array("free_block", I8, lambda at, c: c[at.TILES] * at.LINE * at.THREADS),
    Array("cycle_of", I8, lambda at, c: c[at.TILES] * at.LINE * at.THREADS),
    # Of each particle: the window << 32 | the latest of its old rows; these rows, each thread's in turn, and
    # how many each has of a window that is undone.
    Array("old_row_of", I8, lambda at, c: c[at.N] * at.OLD_ROW_OF * at.THREADS),
    Array("old_rows", F8, old_rows, view=("old_rows_int", I8)),
    Array("undone", I8, lambda at, c: c[at.THREAD_COUNT] * at.LINE * at.THREADS),
    Array("changed_count", I8, lambda at, c: c[at.THREAD_COUNT] * at.LINE * at.THREADS),
    # While all lists are rebuilt: the tile of each particle; whose events change, each thread's in turn.
    Array("tile_of_each", I4, lambda at, c: c[at.N] * at.THREADS),
    Array("changed_events", I4, lambda at, c: c[at.N] * at.THREADS),
    # Entries queued for later ticks of a window: the latest of each tick, the one before each.
    Array("queued_last", I4, lambda at, c: c[at.BUCKET_TICKS] * at.THREADS, own=True),
    Array("queued_before", I4, lambda at, c: c[at.HEAP_ROOM] * at.THREADS, own=True),
    Array("queued", I8, lambda at, c: c[at.HEAP_ROOM] * at.THREADS, own=True),
    # Those whose events are put off; what threads tell each other; how many have come to the barrier.
    Array("put_off", I4, lambda at, c: c[at.HEAP_ROOM] * at.THREADS, own=True),
    Array("told", I8, lambda at, c: 2 * c[at.THREAD_COUNT] * at.TOLD * at.THREADS),
    Array("barrier", I8, lambda at, c: 2 * at.LINE * at.THREADS),
    # Threads, windows. Cell of each segment before they are sorted; each thread's segments in each cell.
    Array("cell_of_unsorted", I4, lambda at, c: of_dilute(at, unsorted(at, c))),
    Array("thread_count", I4, lambda at, c: of_dilute(at, cells(at, c) * c[at.THREAD_COUNT])),
    # Where particles are, see `layout`; the last place is for all with several segments.
    Array("home", I8, lambda at, c: of_dilute(at, (c[at.SEGMENT_ROOM] + 1) * at.HOME)),
    # The window << 32 | the latest old row from the cells of each overflow list.
    Array("old_first", I8, lambda at, c: of_dilute(at, overflow_lists(at, c))),
    # How many segments each thread has in overflow lists; how many contacts each tile has.
    Array("overflowed", I8, lambda at, c: of_dilute(at, c[at.THREAD_COUNT] * at.LINE)),
    Array("contact_count", I8, lambda at, c: of_dilute(at, c[at.TILES] * at.LINE)),
    # Contacts that go back to their buckets; the tiles of the domain at work.
    Array("set_aside", I8, lambda at, c: of_dilute(at, c[at.HEAP_ROOM]), own=True),
    Array("tiles_at_work", I8, lambda at, c: of_dilute(at, c[at.TILES]), own=True),
    # Windows. The particles of the cells in the order in which they are gone through; the large ones.
    Array("order", I4, lambda at, c: unsorted(at, c)),
    Array("large", I4, lambda at, c: c[at.LARGE] + 1),
    # Segments and their quantised bounding boxes before they are sorted, ...
    Array("unsorted", F4, lambda at, c: unsorted(at, c) * at.SEGMENT, view=("unsorted_words", I4)),
    Array("unsorted_boxes", I8, lambda at, c: unsorted(at, c)),
    # ... and sorted, then those in overflow lists, then two new ones. Boxes are read 16 at a time.
    Array("segments", F4, lambda at, c: segments(at, c) * at.SEGMENT, view=("segment_words", I4)),
    Array("boxes", I8, lambda at, c: segments(at, c) + 16),
    Array("cell_of_segment", I4, lambda at, c: segments(at, c) if at.THREADS else c[at.SEGMENT_ROOM]),
    # First node of each overflow list, and the node after each.
    Array("overflow_first", I4, overflow_lists),
    Array("overflow_next", I4, lambda at, c: c[at.OVERFLOW_ROOM]),
    # How far bounding boxes are shifted in each image.
    Array("image_shifts", I8, lambda at, c: 64),
    # Index of each column, and of those beyond the box; the image in which the box is seen from there.
    Array("column", I4, columns),
    Array("column_code", I4, columns),
    # Columns near each of the two new segments, as places in that table.
    Array("places", I8, lambda at, c: 32, own=True),
    # Slots of segments whose boxes overlap that of another; the slot of that other, and its image.
    Array("pair_slot", I4, near_pairs, own=True),
    Array("pair_own", U4, near_pairs, own=True),
    # The segments of eight such pairs, column by column; which pairs may touch.
    Array("own_slots", I4, lambda at, c: 8, own=True),
    Array("pair_segments", F4, lambda at, c: 2 * at.SEGMENT * 8, own=True),
    Array("passed", I4, near_pairs, own=True),
    # Particles that an event has changed, see `dilute.windows`.
    Array("changed", I8, lambda at, c: 16, own=True),
    Array("contacts", I8, lambda at, c: tables_of_tiles(at, c, c[at.CONTACT_ROOM] * at.CONTACT)),
)

TYPES = {a.name: a.dtype for a in OF_RUN + OF_SEARCH} | dict(a.view for a in OF_RUN + OF_SEARCH if a.view)
Arrays = namedtuple("Arrays", TYPES)  # type: ignore[misc]


def allocated(table: tuple[Array, ...], at: Any, counter: Any) -> dict[str, Any]:
    """Return arrays of zeros, each with the line of a cache at its beginning."""
    made: dict[str, Any] = {}
    for array in table:
        length = max(int(array.length(at, counter)), 1)
        size = length * np.dtype(array.dtype).itemsize
        raw = np.zeros(size + 64, dtype=np.uint8)
        start = -raw.ctypes.data % 64
        made[array.name] = raw[start : start + size].view(array.dtype)
        if array.view:
            made[array.view[0]] = made[array.name].view(array.view[1])
    return made


def bytes_of(table: tuple[Array, ...], at: Any, counter: Any) -> int:
    """Memory of arrays, in bytes."""
    return sum(int(a.length(at, counter)) * np.dtype(a.dtype).itemsize for a in table)


def record(arrays: dict[str, Any]) -> Any:
    """Return the record of all arrays that kernels work on."""
    return Arrays(**arrays)
