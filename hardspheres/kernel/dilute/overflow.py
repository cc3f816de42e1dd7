"""Chains of the window method: the new lines that fit no slot, one chain for each stretch of cells of a column."""

from ..layout import CELLS, CELLS_OF_CHAIN, LINE, LINE_ROOM, NODE_ROOM, NODES, SHORT_LISTS, WHOSE
from ..simd.jit import called, jit
from ..simd.pointers import int64
from ..simd.vectors import copy_lanes
from .grid import column_at
from .pair_table import enter_pair


@jit
def chains_before(s, column):
    """Index of the first chain of a column."""
    return column * ((s.counter[CELLS + 1] + CELLS_OF_CHAIN - 1) // CELLS_OF_CHAIN)


@jit
def all_chains(s):
    """How many chains the columns have, with that which stands for all beyond walls."""
    return chains_before(s, s.counter[CELLS] * s.counter[CELLS + 2] + 1)


@jit
def chain_at(s, x, y, z):
    """Which chain holds the new lines of a cell."""
    return chains_before(s, column_at(s, x, z)) + y // CELLS_OF_CHAIN


@called
def clear_chains(s):
    """Empty all chains of the cells."""
    for head in range(all_chains(s)):
        s.chain_first[head] = -1


@jit
def chain_line(s, new, head):
    """Add a new line to a chain."""
    node = s.counter[NODES]
    if node == s.counter[NODE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    s.counter[NODES] = node + 1
    copy_lanes(s.lines, (s.counter[LINE_ROOM] + node) * LINE, s.lines, new * LINE)
    s.node_next[node] = s.chain_first[head]
    s.chain_first[head] = node


@jit
def meet_chain(s, m, new, head, code):
    """Enter the pairs of a new line in this image and those of a chain in the table, which has m; returns how many it has."""
    node = int64(s.chain_first[head])
    while node >= 0:
        m = enter_pair(s, m, new, s.counter[LINE_ROOM] + node, code)
        node = int64(s.node_next[node])
    return m


@jit
def meet_chains(s, m, new, column, first, last, code):
    """Do so with the chains of the cells from `first` to `last` of a column."""
    before = chains_before(s, column)
    for head in range(before + first // CELLS_OF_CHAIN, before + last // CELLS_OF_CHAIN + 1):
        m = meet_chain(s, m, new, head, code)
    return m


@jit
def unchain(s, head, i):
    """Take i's lines off a chain."""
    before = -1
    node = int64(s.chain_first[head])
    while node >= 0:
        after = int64(s.node_next[node])
        if s.line_words[(s.counter[LINE_ROOM] + node) * LINE + WHOSE] != i:
            before = node
        elif before < 0:
            s.chain_first[head] = after
        else:
            s.node_next[before] = after
        node = after
