"""Buckets of events: each is a list of blocks, cache lines with a link and seven entries.

An insertion touches one line; what a bucket holds is found without waiting for one entry after the other.
"""

from .. import layout as at
from ..simd.jit import called, jit


@jit
def push_bucket(s, slot, entry):
    """Append an entry to a bucket."""
    block = s.buckets[slot]
    if block < 0 or (s.blocks[block * at.BLOCK] & 7) == 7:
        fresh = s.counter[at.FREE_BLOCK]
        if fresh < 0:
            s.counter[at.SHORT_QUEUE] = 1
            return
        s.counter[at.FREE_BLOCK] = s.blocks[fresh * at.BLOCK] >> 3
        s.blocks[fresh * at.BLOCK] = block << 3
        s.buckets[slot] = fresh
        block = fresh
    header = s.blocks[block * at.BLOCK] + 1
    s.blocks[block * at.BLOCK] = header
    s.blocks[block * at.BLOCK + (header & 7)] = entry


@jit
def release_block(s, block):
    """Give a block back; returns the next of its bucket, or -1."""
    header = s.blocks[block * at.BLOCK]
    s.blocks[block * at.BLOCK] = s.counter[at.FREE_BLOCK] << 3
    s.counter[at.FREE_BLOCK] = block
    return header >> 3


@called
def clear_buckets(s, buckets):
    """Empty all buckets."""
    blocks = s.counter[at.BLOCKS]
    for slot in range(buckets):
        s.buckets[slot] = -1
    for block in range(blocks):
        s.blocks[block * at.BLOCK] = (block + 1 if block + 1 < blocks else -1) << 3
    s.counter[at.FREE_BLOCK] = 0
