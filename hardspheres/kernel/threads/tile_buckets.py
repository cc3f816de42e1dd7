"""Buckets of events, a table for each tile, since no two threads may write to one."""

from .. import layout as at
from ..simd.jit import jit
from ..simd.pointers import int64


@jit
def tick_of(s, time):
    """Tick of a time within the epoch."""
    return int(max(time, 0.0) * s.number[at.TICKS])


@jit
def owner(s, tile):
    """Thread that clears and fills the tables of a tile."""
    return tile * s.counter[at.THREAD_COUNT] // s.counter[at.TILES]


@jit
def is_mine(s, column):
    """Whether a column of cells is in a tile of this thread."""
    return owner(s, int64(s.tile_of_column[column])) == s.counter[at.THREAD]


@jit
def push_bucket(s, tile, slot, entry):
    """Append an entry to a bucket of a tile."""
    place = tile * (s.counter[at.BUCKETS] + 1) + slot
    block = s.buckets[place]
    if block < 0 or (s.blocks[block * at.BLOCK] & 7) == 7:
        fresh = s.free_block[tile * at.LINE]
        if fresh < 0:
            s.counter[at.SHORT_QUEUE] = 1
            return
        s.free_block[tile * at.LINE] = s.blocks[fresh * at.BLOCK] >> 3
        s.blocks[fresh * at.BLOCK] = block << 3
        s.buckets[place] = fresh
        block = fresh
    header = s.blocks[block * at.BLOCK] + 1
    s.blocks[block * at.BLOCK] = header
    s.blocks[block * at.BLOCK + (header & 7)] = entry


@jit
def release_block(s, tile, block):
    """Give a block of a tile back; returns the next of its bucket, or -1."""
    header = s.blocks[block * at.BLOCK]
    s.blocks[block * at.BLOCK] = s.free_block[tile * at.LINE] << 3
    s.free_block[tile * at.LINE] = block
    return header >> 3


@jit
def clear_buckets(s, tile):
    """Empty all buckets of a tile."""
    buckets, blocks = s.counter[at.BUCKETS] + 1, s.counter[at.BLOCKS]
    for slot in range(tile * buckets, (tile + 1) * buckets):
        s.buckets[slot] = -1
    first = tile * blocks
    for block in range(first, first + blocks):
        s.blocks[block * at.BLOCK] = (block + 1 if block + 1 < first + blocks else -1) << 3
    s.free_block[tile * at.LINE] = first
