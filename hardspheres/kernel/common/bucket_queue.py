"""Buckets of events: each is a list of blocks, cache lines with a link and seven entries.

An insertion touches one line; what a bucket holds is found without waiting for one entry after the other.
"""

from .. import layout as at
from ..simd.jit import called, jit


@jit
def push_bucket(s, slot, entry):
    """Append an entry to a bucket.

    Without a branch on whether a new block is needed: that would be guessed wrong for one entry in seven, and
    what is computed until then is waited for.
    """
    block = s.buckets[slot]
    fresh = s.counter[at.FREE_BLOCK]
    header = s.blocks[max(block, 0) * at.BLOCK]
    full = (block < 0) | ((header & 7) == 7)
    if fresh < 0 and full:
        s.counter[at.SHORT_QUEUE] = 1
        return
    after = s.blocks[max(fresh, 0) * at.BLOCK] >> 3
    header = (block << 3 if full else header) + 1
    block = fresh if full else block
    s.counter[at.FREE_BLOCK] = after if full else fresh
    s.buckets[slot] = block
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
