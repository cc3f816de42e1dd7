"""Each particle's next event in the list method: found from the rows, read from the heap, predicted again.

A stored event is its time, the partner, and the partner's version at that moment. It is stale when the
partner has changed since: its particle is then predicted again, and nothing else happens. An entry of the
calendar holds only while its stamp is its particle's latest; so a new prediction need not look for the old
entry.
"""

from .. import layout as at
from ..common.contact_times import NEVER
from ..common.obstacles import is_obstacle
from ..flags import OBSTACLES
from ..simd.jit import called, jit
from .calendar import clear_calendar, schedule
from .neighbour_lists import make_all_lists
from .prediction import next_event, threshold_crossing


@called
def detect(s):
    """Find all lists and events from the rows."""
    now = max(s.number[at.NOW], 0.0)
    make_all_lists(s, now)
    if s.counter[at.SHORT_CELLS] == 0 and s.counter[at.SHORT_LISTS] == 0:
        clear_calendar(s)
        for i in range(s.counter[at.N]):
            predict(s, i, now)


@jit
def predict(s, i, now):
    """Find i's next event and enter it in the calendar."""
    if OBSTACLES and is_obstacle(s, i):
        schedule(s, i, NEVER, at.NOTHING)
        return
    time, partner = next_event(s, i, now)
    # A rebuild has the number of the latest rebuild of all in place of a version: that one makes it stale.
    met = 0 <= partner < s.counter[at.N]
    s.event[i * at.EVENT + at.PARTNER_VERSION] = s.version[partner] if met else s.counter[at.REBUILDS_OF_ALL]
    schedule(s, i, time, partner)


@jit
def predict_again(s, i, other, time):
    """Predict i again, and the other particle unless it is -1.

    In a loop, so that the compiled loop has one copy of the prediction.
    """
    while i >= 0:
        predict(s, i, max(time, 0.0))
        i = other
        other = -1


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
        holds = partner >= s.counter[at.N] or (partner >= 0 and s.version[partner] == version)
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
