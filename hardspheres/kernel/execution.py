"""What happens at an event: the clock goes on, rows change, and their particles are predicted again."""

from . import layout as at
from .common.obstacles import is_obstacle
from .common.particles import collide_pair, hit_wall
from .flags import OBSTACLES, SPARSE, THREADS, WALLS
from .simd.jit import jit

if SPARSE:
    from .dilute.windows import predict_again
else:
    from .dense.events import predict_again
    from .dense.neighbour_lists import MOST_AHEAD, rebuild_list
if THREADS:
    from .threads.undo import remember


@jit
def execute(s, i, partner, time):
    """Execute an event, and predict its particles again; returns them, -1 for none.

    One call of `predict_again` serves all outcomes: each more would be another copy of the search.
    """
    other = -1  # the second particle whose row has changed
    if partner >= 0:
        s.counter[at.PART] = at.EXECUTION
        advance_clock(s, time)
        if THREADS:
            remember(s, i, time)
            if partner < s.counter[at.N]:
                remember(s, partner, time)
        if partner < s.counter[at.N]:
            collide_pair(s, i, partner, time)
            other = partner
            if OBSTACLES:  # the row of one of them is as it was
                if is_obstacle(s, i):
                    i, other = other, -1
                elif is_obstacle(s, other):
                    other = -1
        elif WALLS:
            hit_wall(s, i, partner, time)
    elif not SPARSE and partner == at.REBUILD:
        s.counter[at.PART] = at.RENEWAL
        rebuild_list(s, i, time, MOST_AHEAD)
    s.counter[at.PART] = at.PREDICTION
    predict_again(s, i, other, time)
    s.counter[at.PART] = at.CALENDAR
    return i, other


@jit
def advance_clock(s, time):
    """Advance the clock; count events out of order and events at one instant."""
    now = s.number[at.NOW]
    if time < now - s.number[at.ORDER_TOLERANCE]:
        s.counter[at.OUT_OF_ORDER] += 1
    s.number[at.NOW] = max(now, time)
    if time > s.number[at.LAST_ADVANCE] + s.number[at.ORDER_TOLERANCE]:
        s.number[at.LAST_ADVANCE] = time
        s.counter[at.INSTANT_EVENTS] = 0
    else:
        s.counter[at.INSTANT_EVENTS] += 1
