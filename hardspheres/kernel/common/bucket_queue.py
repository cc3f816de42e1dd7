"""Buckets of events: each is a list of blocks, cache lines with a link and seven entries.

An insertion touches one line; what a bucket holds is found without waiting for one entry after the other.
"""

from ..layout import BLOCK, FREE_BLOCK, SHORT_QUEUE
from ..simd.jit import called, jit


@jit
def push_bucket(s, slot, entry):
    """Append an entry to a bucket."""
    block = s.buckets[slot]
    if block < 0 or (s.blocks[block * BLOCK] & 7) == 7:
        fresh = s.counter[FREE_BLOCK]
        if fresh < 0:
            s.counter[SHORT_QUEUE] = 1
            return
        s.counter[FREE_BLOCK] = s.blocks[fresh * BLOCK] >> 3
        s.blocks[fresh * BLOCK] = block << 3
        s.buckets[slot] = fresh
        block = fresh
    header = s.blocks[block * BLOCK] + 1
    s.blocks[block * BLOCK] = header
    s.blocks[block * BLOCK + (header & 7)] = entry


@jit
def release_block(s, block):
    """Give a block back; returns the next of its bucket, or -1."""
    header = s.blocks[block * BLOCK]
    s.blocks[block * BLOCK] = s.counter[FREE_BLOCK] << 3
    s.counter[FREE_BLOCK] = block
    return header >> 3


@called
def clear_buckets(s, buckets, blocks):
    """Empty all buckets."""
    for slot in range(buckets):
        s.buckets[slot] = -1
    for block in range(blocks):
        s.blocks[block * BLOCK] = (block + 1 if block + 1 < blocks else -1) << 3
    s.counter[FREE_BLOCK] = 0
