"""What both searches use: particles, contact times, the bucket queue and its heap, prefetching, tallies."""
