"""Chains of the window method: the new lines that fit no slot, one chain for each stretch of cells of a column."""

from .compiler import jit, part
from .layout import CELLS, NODE_ROOM, NODES, SHORT_LISTS
from .lines import LINE, WHOSE, meet_line

CELLS_OF_CHAIN = 8  # along y


@jit
def chains_before(s, x, z):
    """Index of the first chain of a column."""
    return (x * s.counter[CELLS + 2] + z) * ((s.counter[CELLS + 1] + CELLS_OF_CHAIN - 1) // CELLS_OF_CHAIN)


@jit
def chain_at(s, x, y, z):
    """Which chain holds the new lines of a cell."""
    return chains_before(s, x, z) + y // CELLS_OF_CHAIN


@part
def clear_chains(s):
    """Empty all chains of the cells."""
    for head in range(chains_before(s, s.counter[CELLS], 0)):
        s.chain_first[head] = -1


@jit
def chain_draft(s, k, head):
    """Add draft k to a chain."""
    node = s.counter[NODES]
    if node == s.counter[NODE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    s.counter[NODES] = node + 1
    for a in range(LINE):
        s.nodes[node * LINE + a] = s.drafts[k * LINE + a]
    s.node_next[node] = s.chain_first[head]
    s.chain_first[head] = node


@jit
def meet_chain(s, head, code, i, line, edges, since):
    """Compare i's line with those of a chain in this image."""
    node = int(s.chain_first[head])
    while node >= 0:
        meet_line(s, s.nodes, s.node_words, node, code, i, line, edges, since)
        node = int(s.node_next[node])


@jit
def meet_chains(s, x, z, first, last, code, i, line, edges, since):
    """Do so with the chains of the cells from `first` to `last` of a column."""
    before = chains_before(s, x, z)
    for head in range(before + first // CELLS_OF_CHAIN, before + last // CELLS_OF_CHAIN + 1):
        meet_chain(s, head, code, i, line, edges, since)


@jit
def unchain(s, head, i):
    """Take i's lines off a chain."""
    before = -1
    node = int(s.chain_first[head])
    while node >= 0:
        after = int(s.node_next[node])
        if s.node_words[node * LINE + WHOSE] != i:
            before = node
        elif before < 0:
            s.chain_first[head] = after
        else:
            s.node_next[before] = after
        node = after
