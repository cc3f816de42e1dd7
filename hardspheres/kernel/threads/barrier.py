"""Where threads wait for each other, and what they tell each other there."""

from .. import layout as at
from ..simd.atomics import atomic_add, atomic_load, atomic_store, give_way
from ..simd.jit import called

TURNS = 3000  # that one looks before it gives its core away
COME = 0  # how many have come
GATHERED = at.LINE  # how often all had come


@called
def barrier(s):
    """Wait until all threads have come."""
    s.counter[at.MEETINGS] += 1
    if s.counter[at.THREAD_COUNT] == 1:
        return
    before = atomic_load(s.barrier, GATHERED)
    if atomic_add(s.barrier, COME, 1) == s.counter[at.THREAD_COUNT] - 1:
        atomic_store(s.barrier, COME, 0)
        atomic_add(s.barrier, GATHERED, 1)
        return
    turns = 0
    while atomic_load(s.barrier, GATHERED) == before:
        turns += 1
        if turns > TURNS:
            give_way()


@called
def agree(s):
    """Tell the others how the round went, wait for them, and add up what all have told.

    They write to two places in turn: whoever is through may already write to the other one.
    """
    threads = s.counter[at.THREAD_COUNT]
    half = (s.counter[at.MEETINGS] & 1) * threads * at.TOLD
    mine = half + s.counter[at.THREAD] * at.TOLD
    s.told[mine + at.TOLD_PUT_OFF] = s.counter[at.PUT_OFF]
    s.told[mine + at.TOLD_WRONG] = s.counter[at.WRONG]
    s.told[mine + at.TOLD_SHORT] = (
        s.counter[at.SHORT_QUEUE] + s.counter[at.SHORT_LISTS] + s.counter[at.SHORT_CELLS]
    )
    s.told[mine + at.TOLD_REBUILDS] = s.counter[at.REBUILDS]
    s.told[mine + at.TOLD_PAIRS] = s.counter[at.PAIRS]
    s.told[mine + at.TOLD_EVENTS] = s.counter[at.EVENTS_DONE]
    s.told[mine + at.TOLD_LOGGED] = s.counter[at.LOGGED]
    s.told[mine + at.TOLD_OUTCOME] = s.counter[at.OUTCOME]
    barrier(s)
    for k in range(at.TOLD):
        total = 0
        for thread in range(threads):
            total += s.told[half + thread * at.TOLD + k]
        s.counter[at.AGREED + k] = total
