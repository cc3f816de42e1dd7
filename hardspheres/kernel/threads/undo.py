"""The rows that a window has replaced: they tell whether its events were found in a wrong order, and undo it.

Two events depend on each other only through a particle of both. Within a domain events come in their order,
and one that is put off holds its particles back. So one thing alone can go wrong: a particle is predicted
from a time on at which a neighbour still had a row that it has no longer, since another domain was faster. If
the two would have met before that row was replaced, the neighbour's later events ought not to have happened.
That is tested exactly, with the old row. On a hit the whole window is undone, and gone through again in
smaller ones.
"""

from .. import layout as at
from ..common.contact_times import PLACE, SHIFT, SINCE, SIZE, VEL, WHEN, solve
from ..common.obstacles import is_obstacle
from ..common.versions import raise_version
from ..dense.cell_grid import fallen
from ..flags import DIM, FLIGHTS, GRAVITY, OBSTACLES, SIZES, SPARSE
from ..simd.jit import called, jit
from ..simd.pointers import int64
from .old_flights import NUMBER, WINDOW, keep_old_flight, of_this_window


@jit
def remember(s, i, time):
    """Keep i's row as it is; an event at that time is about to change it."""
    if s.counter[at.IN_ORDER] or (OBSTACLES and is_obstacle(s, i)):
        return
    k = s.counter[at.UNDO_LENGTH]
    s.counter[at.UNDO_LENGTH] = k + 1
    number = s.counter[at.THREAD] * s.counter[at.UNDO_ROOM] + k
    old = number * at.OLD_ROW
    for d in range(at.ROW):
        s.old_rows[old + d] = s.row[i * at.ROW + d]
    s.old_rows_int[old + at.OLD_WHO] = i
    s.old_rows_int[old + at.OLD_BEFORE] = s.old_row_of[i * at.OLD_ROW_OF]
    if FLIGHTS:
        s.old_rows[old + at.OLD_FLIGHT] = s.flight[i * at.FLIGHT + at.BEGAN]
        s.old_rows[old + at.OLD_FLIGHT + 1] = s.flight[i * at.FLIGHT + at.BEGAN_EPOCH]
    if GRAVITY:
        for d in range(DIM):
            s.old_rows[old + at.OLD_FALL + d] = s.fall[i * at.FALL + d]
    s.old_row_of[i * at.OLD_ROW_OF] = s.counter[at.WINDOW] << WINDOW | number
    if SPARSE:
        keep_old_flight(s, i, number, time)


@jit
def can_remember(s):
    """Whether there is room for the rows of another event."""
    return s.counter[at.IN_ORDER] == 1 or s.counter[at.UNDO_LENGTH] + 2 <= s.counter[at.UNDO_ROOM]


@called
def look_back(s, i, now, other):
    """Whether i, predicted from now on, would have met a neighbour on a row that it has no longer.

    Then this window is wrong. Not with `other`, which i has just met.
    """
    room = s.counter[at.LIST_ROOM]
    for k in range(room):
        j = int64(s.neighbours[i * room + k])
        if j == s.counter[at.N]:
            return
        end = s.row[j * at.ROW + at.T]
        word = s.old_row_of[j * at.OLD_ROW_OF]
        while end >= now and j != other and of_this_window(s, word):
            old = (word & NUMBER) * at.OLD_ROW
            if contact_with_old(s, i, old, i * room + k, now) <= end:
                s.counter[at.WRONG] = 1
                return
            end = s.old_rows[old + at.T]
            word = s.old_rows_int[old + at.OLD_BEFORE]


@jit
def contact_with_old(s, i, old, entry, now):
    """Time of contact of i with an old row, whose particle has this entry in i's list."""
    for d in range(DIM):
        s.scratch[PLACE + d * at.LANES] = s.old_rows[old + at.X + d]
        s.scratch[VEL + d * at.LANES] = s.old_rows[old + at.V + d]
        if s.counter[at.IMAGES]:
            s.scratch[SHIFT + d * at.LANES] = s.images[entry * DIM + d]
    s.scratch[SINCE] = s.old_rows[old + at.T]
    if SIZES:
        s.scratch[SIZE] = s.old_rows[old + at.RADIUS]
    solve(s, 0, i, now, 1)
    return s.scratch[WHEN]


@called
def has_been_within(s, i, threshold):
    """Whether i has been within the threshold of its reference position since the window began.

    Then whoever is predicted from an earlier time on finds it on its list. Flights are straight, so both ends
    of each are enough; among obstacles they are parabolas, no further from their chords than `bulge`.
    """
    begin = s.number[at.WINDOW_BEGIN]
    if GRAVITY and OBSTACLES:
        threshold -= bulge(s, s.counter[at.LIMIT] / s.number[at.TICKS] - begin)
    since = s.row[i * at.ROW + at.T]
    if not is_within(s, i, s.row, i * at.ROW, max(since, begin), threshold):
        return False
    word = s.old_row_of[i * at.OLD_ROW_OF]
    while since > begin:
        if not of_this_window(s, word):
            return False
        old = (word & NUMBER) * at.OLD_ROW
        if not is_within(s, i, s.old_rows, old, since, threshold):
            return False
        since = s.old_rows[old + at.T]
        if not is_within(s, i, s.old_rows, old, max(since, begin), threshold):
            return False
        word = s.old_rows_int[old + at.OLD_BEFORE]
    return True


@jit
def bulge(s, duration):
    """How far a parabola of this duration is from its chord, at most."""
    pull = 0.0
    for d in range(DIM):
        pull += abs(s.number[at.PULL + d])
    return 0.125 * pull * duration * duration


@jit
def is_within(s, i, rows, at_row, t, threshold):
    """Whether a row, at time t, is within the threshold of i's reference position."""
    rr = 0.0
    for d in range(DIM):
        x, v = rows[at_row + at.X + d], rows[at_row + at.V + d]
        if GRAVITY and OBSTACLES:
            dt = t - rows[at_row + at.T]
            x += 0.5 * s.number[at.PULL + d] * dt * dt
        elif GRAVITY:
            x, v = fallen(s, d, x, v, rows[at_row + at.T])
        away = x + v * (t - rows[at_row + at.T]) - s.event_float[i * at.EVENT + at.REFERENCE + d]
        rr += away * away
    return threshold > 0.0 and rr <= threshold * threshold


@jit
def keep_counts(s):
    """Keep sums and counters as they are when a window begins."""
    for k in range(at.COUNTERS + flight_counts(s)):
        s.old_counter[k] = s.counter[k]
    for k in range(at.FLIGHT_SUMS + flight_sums(s)):
        s.old_total[k] = s.total[k]


@jit
def flight_counts(s):
    """Return how many counters flights have."""
    species = s.counter[at.SPECIES_COUNT]
    return species * (at.FLIGHT_COUNT + species)


@jit
def flight_sums(s):
    """Return how many numbers the sums of flights have."""
    return 2 * s.counter[at.SPECIES_COUNT] * at.FLIGHT_SUM


@jit
def restore_counts(s):
    """Take back what events of this window have added."""
    for k in range(at.FLIGHT_COUNTS, at.FLIGHT_COUNTS + flight_counts(s)):
        s.counter[k] = s.old_counter[k]
    for k in range(at.FLIGHT_SUMS + flight_sums(s)):
        s.total[k] = s.old_total[k]
    restore(s, at.PAIRS)
    restore(s, at.WALL_HITS)
    restore(s, at.OUT_OF_ORDER)
    restore(s, at.LAST_PAIR_EPOCH)
    restore(s, at.LOGGED)
    if OBSTACLES:
        restore(s, at.OBSTACLE_HITS)
    if GRAVITY:
        s.counter[at.RESTING] = 0


@jit
def restore(s, k):
    """Take one counter back."""
    s.counter[k] = s.old_counter[k]


@called
def restore_rows(s):
    """Give all particles, of which this thread was the first to change the row, that row back."""
    for k in range(s.counter[at.UNDO_LENGTH]):
        old = (s.counter[at.THREAD] * s.counter[at.UNDO_ROOM] + k) * at.OLD_ROW
        if of_this_window(s, s.old_rows_int[old + at.OLD_BEFORE]):
            continue
        i = s.old_rows_int[old + at.OLD_WHO] & NUMBER
        for d in range(at.ROW):
            if not (at.VERSION_IN_ROW and d == at.VERSION):
                s.row[i * at.ROW + d] = s.old_rows[old + d]
        if FLIGHTS:
            s.flight[i * at.FLIGHT + at.BEGAN] = s.old_rows[old + at.OLD_FLIGHT]
            s.flight[i * at.FLIGHT + at.BEGAN_EPOCH] = s.old_rows[old + at.OLD_FLIGHT + 1]
        if GRAVITY:
            for d in range(DIM):
                s.fall[i * at.FALL + d] = s.old_rows[old + at.OLD_FALL + d]
        raise_version(s, i)  # what others know of the row that it had does not hold
