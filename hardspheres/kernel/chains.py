"""Chains of the window method: the lines that are new since the window began, one chain for each row."""

from .compiler import jit
from .flags import DIM
from .layout import NODE_ROOM, NODES, SHORT_LISTS
from .lines import LINE, PLACE, meet_line


@jit
def chain_draft(s, i, row, shift):
    """Add the new line, shifted along z, to the chain of a row."""
    node = s.counter[NODES]
    if node == s.counter[NODE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    s.counter[NODES] = node + 1
    for k in range(LINE):
        s.nodes[node * LINE + k] = s.draft[k]
    if DIM == 3:
        s.nodes[node * LINE + PLACE + 2] += shift
    s.node_ids[node] = i
    s.node_next[node] = s.row_chain[row]
    s.row_chain[row] = node


@jit
def meet_chain(s, row, i, line, since):
    """Compare i's line with those chained to a row."""
    node = int(s.row_chain[row])
    while node >= 0:
        meet_line(s, s.nodes, s.node_ids, node, i, line, since)
        node = int(s.node_next[node])


@jit
def unchain(s, row, i):
    """Take i's lines off the chain of a row."""
    before = -1
    node = int(s.row_chain[row])
    while node >= 0:
        after = int(s.node_next[node])
        if s.node_ids[node] != i:
            before = node
        elif before < 0:
            s.row_chain[row] = after
        else:
            s.node_next[before] = after
        node = after
