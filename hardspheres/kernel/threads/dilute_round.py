"""A domain in a round, with windows of time: it executes its contacts in their order, and puts some off."""

from .. import layout as at
from ..common.event_heap import pop_event
from ..common.obstacles import is_obstacle
from ..common.prefetch import prefetch_surroundings
from ..dilute.partners import contact_holds, partners
from ..dilute.windows import predict_again
from ..execution import execute
from ..flags import OBSTACLES
from ..simd.jit import jit
from .contacts import open_tick, put_back, put_heap_back, set_aside
from .stopping import goes_on
from .tiles import free_to_go, freeze, is_inside_now, is_ours


@jit
def execute_domain(s):
    """Execute the contacts of the domain at work; what is put off goes back to the buckets."""
    s.counter[at.SET_ASIDE] = 0
    note_tiles(s)
    execute_all(s)
    put_heap_back(s)
    for k in range(s.counter[at.SET_ASIDE]):
        put_back(s, s.set_aside[k])


@jit
def note_tiles(s):
    """Note the tiles of the domain at work."""
    found, tiles = 0, s.counter[at.TILES]
    for tile in range(tiles):
        s.tiles_at_work[found] = tile
        found += 1 if s.domain_of[s.counter[at.SHIFT] * tiles + tile] == s.counter[at.DOMAIN] else 0
    s.counter[at.TILES_AT_WORK] = found


@jit
def execute_all(s):
    """Execute the contacts of the window in their order, but for those that have to wait."""
    while goes_on(s):
        if s.counter[at.HEAP_LENGTH] == 0:
            tick = s.counter[at.PRESENT_TICK] + 1
            if tick >= s.counter[at.LIMIT]:
                return
            s.counter[at.PRESENT_TICK] = tick
            open_tick(s, tick)
            prefetch_surroundings(s)
            continue
        time = s.heap_time[0]
        c = s.heap_entry[0]
        pop_event(s)
        if time > s.number[at.STOP_TIME]:
            set_aside(s, c)
            continue
        i, j = partners(s, c)
        both = j < s.counter[at.N]
        if not contact_holds(s, c):
            s.counter[at.STALE] += 1
            continue
        if not (may_go(s, i) and (not both or may_go(s, j))):
            hold_back(s, i)
            if both:
                hold_back(s, j)
            s.counter[at.PUT_OFF] += 1
            set_aside(s, c)
            continue
        s.counter[at.MET] = -1
        s.counter[at.EVENTS_DONE] += 1
        if j >= at.SEARCH_DUE:
            s.counter[at.MET] = j - at.SEARCH_DUE - 1
            predict_again(s, i, -1, time)
        else:
            execute(s, i, j, time)


@jit
def is_inside_ours(s, i):
    """Whether i moves, and is inside this domain; then no other domain changes those whom it can meet."""
    return not (OBSTACLES and is_obstacle(s, i)) and is_inside_now(s, i) and is_ours(s, i)


@jit
def may_go(s, i):
    """Whether i may collide in this domain now."""
    return (OBSTACLES and is_obstacle(s, i)) or (free_to_go(s, i) and is_ours(s, i))


@jit
def hold_back(s, i):
    """Let i, if it is inside this domain, do nothing more in this round."""
    if is_inside_ours(s, i):
        freeze(s, i)
