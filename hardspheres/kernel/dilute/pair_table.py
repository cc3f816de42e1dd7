"""The table of pairs of segments that the filter compares.

An entry is the slot of one segment, the slot of the other, and the periodic image in which that other is
seen.
"""

import numpy as np

from .. import layout as at
from ..simd.jit import jit

SLOT_BITS = 26  # of a number with the slot and the image
SLOTS = (1 << SLOT_BITS) - 1


@jit
def seen_in(own, code):
    """Return a slot with the image in which it is seen."""
    return own | code << SLOT_BITS


@jit
def slot_in(seen):
    """Return the slot in such a number."""
    return np.int32(seen & SLOTS)


@jit
def image_in(seen):
    """Return the image in such a number."""
    return np.int32(seen >> SLOT_BITS)


@jit
def enter_pair(s, m, own, slot, code):
    """Enter a pair in the table, which has m; returns how many it has."""
    s.pair_slot[m], s.pair_own[m] = slot, seen_in(own, code)
    return checked(s, m + 1)


@jit
def checked(s, m):
    """How many pairs the table has; none where it is full (then the run makes room and starts over)."""
    if m > s.counter[at.NEAR_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return 0
    return m
