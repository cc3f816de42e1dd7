"""Each particle's next event in the list method: found from the rows, read from the heap, predicted again.

A stored event is its time, the partner, and the partner's version at that moment. It is stale when the
partner has changed since: its particle is then predicted again, and nothing else happens. An entry of the
calendar holds only while its stamp is its particle's latest; so a new prediction need not look for the old
entry.
"""

from .. import layout as at
from ..common.contact_times import NEVER, NO_TIME, TABLE
from ..common.obstacles import is_obstacle
from ..common.versions import version_of
from ..flags import OBSTACLES, THREADS
from ..simd.jit import called, jit
from .neighbour_lists import make_all_lists
from .prediction import gather, next_event, soonest_contact, threshold_crossing

if THREADS:
    from ..threads.calendars import schedule
else:
    from .calendar import clear_calendar, schedule


@called
def detect(s):
    """Find all lists and events from the rows."""
    now = max(s.number[at.NOW], 0.0)
    make_all_lists(s, now)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        clear_calendar(s)
        for i in range(s.counter[at.N]):
            if OBSTACLES and is_obstacle(s, i):
                schedule(s, i, NEVER, at.NOTHING)
            else:
                predict_again(s, i, -1, now)


@jit
def predict_again(s, i, other, time):
    """Find the next events of i, and of the other particle unless it is -1; enter them in the calendar.

    Each step waits for the one before, but not for those of the other: so both take a step before the next.
    """
    now = max(time, 0.0)
    both = other >= 0
    gather(s, 0, i, 0)
    if both:
        gather(s, TABLE, other, 0)
    soonest = soonest_contact(s, 0, i, 0, now)
    soonest_of_other = soonest_contact(s, TABLE, other, 0, now) if both else NO_TIME
    enter_next(s, 0, i, soonest, now)
    if both:
        enter_next(s, TABLE, other, soonest_of_other, now)


@jit
def enter_next(s, table, i, soonest, now):
    """Enter i's next event in the calendar, given the soonest contact of its table."""
    time, partner = next_event(s, table, i, soonest, now)
    # A rebuild has the number of the latest rebuild of all in place of a version: that one makes it stale.
    met = 0 <= partner < s.counter[at.N]
    s.event[i * at.EVENT + at.PARTNER_VERSION] = (
        version_of(s, partner) if met else s.counter[at.REBUILDS_OF_ALL]
    )
    part = s.counter[at.PART]
    s.counter[at.PART] = at.CALENDAR
    schedule(s, i, time, partner)
    s.counter[at.PART] = part


@jit
def event_of(s, entry):
    """Particle and partner of an entry.

    In place of the partner NOTHING where a later prediction replaced the entry, STALE_EVENT where the event
    is stale.
    """
    i = entry >> 32
    event = i * at.EVENT
    if s.event[event + at.STAMP] != entry & at.STAMP_BITS:
        return i, at.NOTHING
    partner, version = s.event[event + at.PARTNER], s.event[event + at.PARTNER_VERSION]
    if partner == at.REBUILD:
        holds = version == s.counter[at.REBUILDS_OF_ALL]
    else:
        holds = partner >= s.counter[at.N] or (partner >= 0 and version_of(s, partner) == version)
    if not holds:
        s.counter[at.STALE] += 1
        return i, at.STALE_EVENT
    return i, partner


@called
def rebuild_all(s, now):
    """Rebuild all lists. Events stay, but a threshold that is now crossed earlier is the next event."""
    make_all_lists(s, now)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        for i in range(s.counter[at.N]):
            time = threshold_crossing(s, i, now)
            if time < s.event_float[i * at.EVENT + at.TIME]:
                s.event[i * at.EVENT + at.PARTNER_VERSION] = s.counter[at.REBUILDS_OF_ALL]
                schedule(s, i, max(time, now), at.REBUILD)
