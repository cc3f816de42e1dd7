"""Windows: the flights that a few events have replaced, by the cells that had their segments.

They tell whether a particle that was predicted late would have met one of them: `undo` says why that counts.
The comparison is in double precision, with a margin for its rounding: what is nearly a contact counts as one,
and costs only time.
"""

from .. import layout as at
from ..common.particles import nearest
from ..dilute.overflow import lists_before
from ..flags import DIM, GRAVITY, SIZES
from ..simd.jit import called, jit
from ..simd.pointers import int64
from .homes import home_of

WINDOW = 32  # where the window stands in `old_row_of` and `old_first`
NUMBER = 0xFFFFFFFF
MARGIN = 1.0 + 1e-9  # of squared distances
SEPARATING = 1e-12  # a cosine
FAR = 0.25  # of an edge of the box: two that come so much nearer might meet in another image


@jit
def of_this_window(s, word):
    """Whether an entry of `old_row_of` or `old_first` is of this window, and counts."""
    return word >> WINDOW == s.counter[at.WINDOW]


@jit
def keep_old_flight(s, i, number, time):
    """Enter an old row of i, replaced at this time, in the list of its cells."""
    old = number * at.OLD_ROW
    s.old_rows[old + at.OLD_END] = time
    if s.where[i] >= 0:  # others come in the last round, after which nobody is late
        near = s.home[home_of(s, i) + at.HOME_LIST]
        before = s.old_first[near]
        after = (before & NUMBER) + 1 if of_this_window(s, before) else 0
        s.old_rows_int[old + at.OLD_WHO] = after << WINDOW | i
        s.old_first[near] = s.counter[at.WINDOW] << WINDOW | number


@called
def compare_with_old(s, i, met, column, first, last, now):
    """Compare i's flight, from now on, with old ones from cells of a column.

    Not with its own, nor with that of the one it met which ended there. WRONG tells if it would have met one.
    """
    before = lists_before(s, column)
    for near in range(before + first // at.CELLS_OF_OVERFLOW, before + last // at.CELLS_OF_OVERFLOW + 1):
        word = s.old_first[near]
        after = (word & NUMBER) + 1 if of_this_window(s, word) else 0
        while after > 0:
            old = int64(after - 1) * at.OLD_ROW
            who = s.old_rows_int[old + at.OLD_WHO] & NUMBER
            end = s.old_rows[old + at.OLD_END]
            known = who == i or (who == met and end == now)
            if end >= now and not known and would_meet(s, i, old, now):
                s.counter[at.WRONG] = 1
            after = s.old_rows_int[old + at.OLD_WHO] >> WINDOW


@jit
def would_meet(s, i, old, now):
    """Whether i, from now on, comes within contact of an old flight until that ends."""
    begin = max(now, s.old_rows[old + at.T])
    span = s.old_rows[old + at.OLD_END] - begin
    rr, b, vv = 0.0, 0.0, 0.0
    edge = s.number[at.BOX]
    for d in range(DIM):
        x, v = place_at(s, d, s.row, i * at.ROW, begin)
        y, u = place_at(s, d, s.old_rows, old, begin)
        x, v = nearest(s, d, x - y), v - u
        rr, b, vv = rr + x * x, b + x * v, vv + v * v
        edge = min(edge, s.number[at.BOX + d])
    far = FAR * edge
    if vv * span * span > far * far:
        return True
    if b * b < SEPARATING * SEPARATING * rr * vv or b < 0.0:
        soonest = min(max(-b / max(vv, 1e-300), 0.0), span)
        contact = 2.0 * s.number[at.COMMON_RADIUS]
        if SIZES:
            contact = s.row[i * at.ROW + at.RADIUS] + s.old_rows[old + at.RADIUS]
        return rr + (2.0 * b + vv * soonest) * soonest <= contact * contact * MARGIN
    return False


@jit
def place_at(s, d, rows, row, t):
    """Place and velocity of a row along an axis at a time."""
    x, v, dt = rows[row + at.X + d], rows[row + at.V + d], t - rows[row + at.T]
    if GRAVITY:
        pull = s.number[at.PULL + d]
        return x + (v + 0.5 * pull * dt) * dt, v + pull * dt
    return x + v * dt, v
