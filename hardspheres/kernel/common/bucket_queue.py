"""Buckets of events: each a chain of chunks, one cache line with a link and seven entries.

An insertion touches one line; what a bucket holds is found without waiting for one entry after the other.
"""

from ..layout import CHUNK, FREE_CHUNK, SHORT_QUEUE
from ..simd.jit import jit, part


@jit
def push_bucket(s, slot, entry):
    """Append an entry to a bucket."""
    chunk = s.buckets[slot]
    if chunk < 0 or (s.chunks[chunk * CHUNK] & 7) == 7:
        fresh = s.counter[FREE_CHUNK]
        if fresh < 0:
            s.counter[SHORT_QUEUE] = 1
            return
        s.counter[FREE_CHUNK] = s.chunks[fresh * CHUNK] >> 3
        s.chunks[fresh * CHUNK] = chunk << 3
        s.buckets[slot] = fresh
        chunk = fresh
    header = s.chunks[chunk * CHUNK] + 1
    s.chunks[chunk * CHUNK] = header
    s.chunks[chunk * CHUNK + (header & 7)] = entry


@jit
def release(s, chunk):
    """Give a chunk back; returns the next of its chain, or -1."""
    header = s.chunks[chunk * CHUNK]
    s.chunks[chunk * CHUNK] = s.counter[FREE_CHUNK] << 3
    s.counter[FREE_CHUNK] = chunk
    return header >> 3


@part
def clear_buckets(s, buckets, chunks):
    """Empty all buckets."""
    for slot in range(buckets):
        s.buckets[slot] = -1
    for chunk in range(chunks):
        s.chunks[chunk * CHUNK] = (chunk + 1 if chunk + 1 < chunks else -1) << 3
    s.counter[FREE_CHUNK] = 0
