"""Overflow lists: the new segments that fit no slot of the sorted ones.

Each stretch of CELLS_OF_OVERFLOW cells of a column has a linked list of its own.
"""

from .. import layout as at
from ..flags import THREADS
from ..simd.jit import called, jit
from ..simd.pointers import int64
from ..simd.vectors import copy_lanes
from .grid import column_at
from .pair_table import enter_pair


@jit
def lists_before(s, column):
    """Index of the first overflow list of a column."""
    return column * ((s.counter[at.CELLS + 1] + at.CELLS_OF_OVERFLOW - 1) // at.CELLS_OF_OVERFLOW)


@jit
def number_of_lists(s):
    """How many overflow lists the columns have; the last stands for all beyond walls."""
    return lists_before(s, s.counter[at.CELLS] * s.counter[at.CELLS + 2] + 1)


@jit
def list_at(s, x, y, z):
    """Which overflow list holds the new segments of a cell."""
    return lists_before(s, column_at(s, x, z)) + y // at.CELLS_OF_OVERFLOW


@called
def clear_overflow(s):
    """Empty all overflow lists of the cells."""
    for head in range(number_of_lists(s)):
        s.overflow_first[head] = -1


@jit
def is_full(s):
    """Whether there is no room for another new segment."""
    return s.counter[at.OVERFLOWED] == s.counter[at.OVERFLOW_ROOM]


@jit
def next_node(s):
    """Return a node for another new segment, -1 where there is no room; each thread has some of its own."""
    if THREADS:
        thread, room = s.counter[at.THREAD], s.counter[at.OVERFLOW_ROOM] // s.counter[at.THREAD_COUNT]
        k = s.overflowed[thread * at.LINE]
        if k == room:
            return int64(-1)
        s.overflowed[thread * at.LINE] = k + 1
        return thread * room + k
    if is_full(s):
        return int64(-1)
    s.counter[at.OVERFLOWED] += 1
    return s.counter[at.OVERFLOWED] - 1


@jit
def append_overflow(s, new, head):
    """Add a new segment to an overflow list."""
    node = next_node(s)
    if node < 0:
        s.counter[at.SHORT_LISTS] = 1
        return
    if THREADS:
        s.cell_of_segment[s.counter[at.SEGMENT_ROOM] + node] = s.cell_of_segment[new]
    copy_lanes(s.segments, (s.counter[at.SEGMENT_ROOM] + node) * at.SEGMENT, s.segments, new * at.SEGMENT)
    s.overflow_next[node] = s.overflow_first[head]
    s.overflow_first[head] = node


@jit
def pairs_in_list(s, m, new, head, code):
    """Enter the pairs of a new segment, in this image, and an overflow list in the table, which has m."""
    node = int64(s.overflow_first[head])
    while node >= 0:
        m = enter_pair(s, m, new, s.counter[at.SEGMENT_ROOM] + node, code)
        node = int64(s.overflow_next[node])
    return m


@jit
def pairs_in_lists(s, m, new, column, first, last, code):
    """Enter the pairs of a new segment and the overflow lists of cells `first` to `last` of a column."""
    before = lists_before(s, column)
    for head in range(before + first // at.CELLS_OF_OVERFLOW, before + last // at.CELLS_OF_OVERFLOW + 1):
        m = pairs_in_list(s, m, new, head, code)
    return m


@jit
def remove_overflow(s, head, i):
    """Remove i's segments from an overflow list."""
    before = -1
    node = int64(s.overflow_first[head])
    while node >= 0:
        after = int64(s.overflow_next[node])
        if s.segment_words[(s.counter[at.SEGMENT_ROOM] + node) * at.SEGMENT + at.OWNER] != i:
            before = node
        elif before < 0:
            s.overflow_first[head] = after
        else:
            s.overflow_next[before] = after
        node = after
