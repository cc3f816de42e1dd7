"""A domain in a round, with neighbour lists: it executes its events in their order, and puts some off."""

from .. import layout as at
from ..common.event_heap import pop_event
from ..common.prefetch import prefetch_next_event
from ..common.versions import version_of
from ..dense.events import event_of
from ..execution import execute
from ..simd.jit import jit
from .calendars import clear_queue, next_tick, open_tile, put_back, put_back_all
from .renewal import renew_list
from .stopping import goes_on
from .tiles import free_to_go, freeze, is_ours, put_off
from .undo import look_back


@jit
def execute_domain(s):
    """Execute the events of the domain at work; what is put off goes back to the calendar."""
    clear_queue(s)
    tiles = s.counter[at.TILES]
    for tile in range(tiles):
        if s.domain_of[s.counter[at.SHIFT] * tiles + tile] == s.counter[at.DOMAIN]:
            open_tile(s, tile)
    execute_all(s)
    if not goes_on(s):
        put_back_all(s)
    for k in range(s.counter[at.PUT_OFF]):
        put_back(s, int(s.put_off[k]))


@jit
def execute_all(s):
    """Execute the events of the window in their order, but for those that have to wait for another round."""
    while goes_on(s):
        if s.counter[at.HEAP_LENGTH] == 0:
            if next_tick(s):
                continue
            return
        time = s.heap_time[0]
        entry = s.heap_entry[0]
        pop_event(s)
        i = entry >> 32
        event = i * at.EVENT
        if s.event[event + at.STAMP] != entry & at.STAMP_BITS:
            continue
        prefetch_next_event(s)
        partner = s.event[event + at.PARTNER]
        met = 0 <= partner < s.counter[at.N]
        if not free_to_go(s, i):
            put_off(s, i)
            if met and is_ours(s, partner) and version_of(s, partner) == s.event[event + at.PARTNER_VERSION]:
                freeze(s, partner)
            continue
        i, partner = event_of(s, entry)
        if 0 <= partner and partner < s.counter[at.N] and not free_to_go(s, partner):
            put_off(s, i)
            freeze(s, partner)
            continue
        if partner == at.REBUILD:
            s.counter[at.PART] = at.RENEWAL
            renewed = renew_list(s, i, time)
            s.counter[at.PART] = at.CALENDAR
            if not renewed:
                put_off(s, i)
                continue
            partner = at.STALE_EVENT  # all that is left to do is a prediction
        s.counter[at.CHANGED_SINCE] = 0
        i, other = execute(s, i, partner, time)
        s.counter[at.EVENTS_DONE] += 1
        suspect = s.counter[at.CHANGED_SINCE] > (2 if other >= 0 else 0)
        if suspect and s.counter[at.IN_ORDER] == 0 and s.counter[at.BLIND] == 0:
            look_back(s, i, time, other)
            if other >= 0:
                look_back(s, other, time, i)
