"""Chains of the window method: the new lines that fit no slot, one chain for each stretch of cells of a column."""

from ..layout import (
    CELLS,
    CELLS_OF_OVERFLOW,
    OVERFLOW_ROOM,
    OVERFLOWED,
    OWNER,
    SEGMENT,
    SEGMENT_ROOM,
    SHORT_LISTS,
)
from ..simd.jit import called, jit
from ..simd.pointers import int64
from ..simd.vectors import copy_lanes
from .grid import column_at
from .pair_table import enter_pair


@jit
def lists_before(s, column):
    """Index of the first chain of a column."""
    return column * ((s.counter[CELLS + 1] + CELLS_OF_OVERFLOW - 1) // CELLS_OF_OVERFLOW)


@jit
def number_of_lists(s):
    """How many chains the columns have, with that which stands for all beyond walls."""
    return lists_before(s, s.counter[CELLS] * s.counter[CELLS + 2] + 1)


@jit
def list_at(s, x, y, z):
    """Which chain holds the new lines of a cell."""
    return lists_before(s, column_at(s, x, z)) + y // CELLS_OF_OVERFLOW


@called
def clear_overflow(s):
    """Empty all chains of the cells."""
    for head in range(number_of_lists(s)):
        s.overflow_first[head] = -1


@jit
def append_overflow(s, new, head):
    """Add a new line to a chain."""
    node = s.counter[OVERFLOWED]
    if node == s.counter[OVERFLOW_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    s.counter[OVERFLOWED] = node + 1
    copy_lanes(s.segments, (s.counter[SEGMENT_ROOM] + node) * SEGMENT, s.segments, new * SEGMENT)
    s.overflow_next[node] = s.overflow_first[head]
    s.overflow_first[head] = node


@jit
def pairs_in_list(s, m, new, head, code):
    """Enter the pairs of a new line in this image and those of a chain in the table, which has m; returns how many it has."""
    node = int64(s.overflow_first[head])
    while node >= 0:
        m = enter_pair(s, m, new, s.counter[SEGMENT_ROOM] + node, code)
        node = int64(s.overflow_next[node])
    return m


@jit
def pairs_in_lists(s, m, new, column, first, last, code):
    """Do so with the chains of the cells from `first` to `last` of a column."""
    before = lists_before(s, column)
    for head in range(before + first // CELLS_OF_OVERFLOW, before + last // CELLS_OF_OVERFLOW + 1):
        m = pairs_in_list(s, m, new, head, code)
    return m


@jit
def remove_overflow(s, head, i):
    """Take i's lines off a chain."""
    before = -1
    node = int64(s.overflow_first[head])
    while node >= 0:
        after = int64(s.overflow_next[node])
        if s.segment_words[(s.counter[SEGMENT_ROOM] + node) * SEGMENT + OWNER] != i:
            before = node
        elif before < 0:
            s.overflow_first[head] = after
        else:
            s.overflow_next[before] = after
        node = after
