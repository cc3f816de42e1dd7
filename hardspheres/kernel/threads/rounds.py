"""A round: each domain executes its events of the window in their order, and puts off what has to wait."""

from .. import layout as at
from ..common.event_heap import pop_event
from ..common.prefetch import prefetch_next_event
from ..common.versions import version_of
from ..dense.events import event_of
from ..execution import execute
from ..flags import FLIGHTS, GRAVITY
from ..simd.jit import called, jit
from .barrier import agree
from .calendars import clear_queue, next_tick, open_tile, put_back, put_back_all
from .renewal import renew_list
from .tiles import free_to_go, freeze, is_ours, put_off
from .undo import can_remember, look_back

# Why one thread, alone and in order, stopped within a window.
ENOUGH_PAIRS, LOG_IS_FULL, RESTING, STANDING_STILL = 1, 2, 3, 4
FEW = 8  # events that one thread executes sooner than all of them in another round


@called
def go_through_window(s):
    """Execute all events of the window, round by round; the threads then agree on how that went."""
    shift = at.ALL_TILES if s.counter[at.IN_ORDER] else 0
    threads = s.counter[at.THREAD_COUNT]
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
        shift += 1
        if shift >= s.counter[at.SHIFTS]:
            shift = at.ALL_TILES if left <= FEW + 2 * threads or s.counter[at.SHIFTS] == 1 else 0


@called
def go_through_domain(s, domain, shift):
    """Execute the events of one domain; what is put off goes back to the calendar."""
    s.counter[at.SHIFT], s.counter[at.DOMAIN] = shift, domain
    s.counter[at.PUT_OFF] = 0
    s.counter[at.STAYED] = 0
    clear_queue(s)
    s.counter[at.INSTANT_EVENTS] = 0
    s.number[at.NOW] = -s.number[at.EPOCH_LENGTH]
    s.number[at.LAST_ADVANCE] = -s.number[at.EPOCH_LENGTH]
    tiles = s.counter[at.TILES]
    for tile in range(tiles):
        if s.domain_of[shift * tiles + tile] == domain:
            open_tile(s, tile)
    execute_all(s)
    s.number[at.LATEST_IN_WINDOW] = max(s.number[at.LATEST_IN_WINDOW], s.number[at.NOW])
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
