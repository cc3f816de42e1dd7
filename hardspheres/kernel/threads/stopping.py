"""Whether a domain may go on with its events, and why not."""

from .. import layout as at
from ..flags import FLIGHTS, GRAVITY
from ..simd.jit import jit
from .undo import can_remember

# Why one thread, alone and in order, stopped within a window.
ENOUGH_PAIRS, LOG_IS_FULL, RESTING, STANDING_STILL = 1, 2, 3, 4


@jit
def goes_on(s):
    """Whether another event may be executed; if not, why."""
    if not can_remember(s):  # a shorter window will do
        s.counter[at.WRONG] = 1
    short = s.counter[at.SHORT_QUEUE] | s.counter[at.SHORT_LISTS] | s.counter[at.SHORT_CELLS]
    if s.counter[at.WRONG] | short:
        return False
    outcome = 0
    if s.counter[at.IN_ORDER] and s.counter[at.PAIRS] >= s.counter[at.STOP_PAIRS]:
        outcome = ENOUGH_PAIRS
    if FLIGHTS and s.counter[at.LOG_ROOM] > 0 and s.counter[at.LOGGED] == s.counter[at.LOG_ROOM]:
        outcome = LOG_IS_FULL
    if GRAVITY and s.counter[at.RESTING] > 0:
        outcome = RESTING
    if s.counter[at.INSTANT_EVENTS] > 1000 * s.counter[at.N]:
        outcome = STANDING_STILL
    if outcome:
        if s.counter[at.IN_ORDER]:
            s.counter[at.OUTCOME] = outcome
        else:  # one thread alone will see it in the order of time
            s.counter[at.WRONG] = 1
    return outcome == 0
