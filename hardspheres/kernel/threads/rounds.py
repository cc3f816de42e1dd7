"""The rounds of a window: in each, domains execute their events, and put off what has to wait."""

from .. import layout as at
from ..flags import SPARSE
from ..simd.jit import called
from .barrier import agree

if SPARSE:
    from .dilute_round import execute_domain
else:
    from .dense_round import execute_domain

FEW = 8  # events that one thread executes sooner than all of them in another round


@called
def go_through_window(s):
    """Execute all events of the window, round by round; the threads then agree on how that went."""
    shift = at.ALL_TILES if s.counter[at.IN_ORDER] else 0
    threads = s.counter[at.THREAD_COUNT]
    s.counter[at.LATE] = 0
    while True:
        s.counter[at.ROUND] += 1
        s.counter[at.ROUNDS] += 1
        s.counter[at.PUT_OFF] = 0
        waiting = 0
        if shift < at.ALL_TILES:
            for domain in range(s.counter[at.THREAD], s.counter[at.DOMAINS], threads):
                go_through_domain(s, domain, shift)
                waiting += s.counter[at.PUT_OFF] + s.counter[at.STAYED]
        elif s.counter[at.THREAD] == 0:
            go_through_domain(s, 0, shift)
            waiting = s.counter[at.PUT_OFF] + s.counter[at.STAYED]
        s.counter[at.PUT_OFF] = waiting
        agree(s)
        left = s.counter[at.AGREED + at.TOLD_PUT_OFF]
        if left == 0 or s.counter[at.AGREED + at.TOLD_WRONG] or s.counter[at.AGREED + at.TOLD_SHORT]:
            return
        s.counter[at.LEFT_OVER] += left
        s.counter[at.LATE] = 1 - max(s.counter[at.IN_ORDER], s.counter[at.BLIND])
        shift += 1
        if shift >= s.counter[at.SHIFTS]:
            few = left <= FEW + 2 * threads or s.counter[at.SHIFTS] == 1
            shift = at.ALL_TILES if few or SPARSE else 0  # flights of several segments have no domain


@called
def go_through_domain(s, domain, shift):
    """Execute the events of one domain, or put them off; the clock is that of its events."""
    s.counter[at.SHIFT], s.counter[at.DOMAIN] = shift, domain
    s.counter[at.PUT_OFF] = 0
    s.counter[at.STAYED] = 0
    s.counter[at.HEAP_LENGTH] = 0
    s.counter[at.PRESENT_TICK] = s.counter[at.TICK] - 1
    s.counter[at.INSTANT_EVENTS] = 0
    s.number[at.NOW] = -s.number[at.EPOCH_LENGTH]
    s.number[at.LAST_ADVANCE] = -s.number[at.EPOCH_LENGTH]
    execute_domain(s)
    s.number[at.LATEST_IN_WINDOW] = max(s.number[at.LATEST_IN_WINDOW], s.number[at.NOW])
