"""Lines of the window method: the straight flights of a window, in single precision, and the filter that compares them.

A line is its place in the middle of the window, half its way through it, and its reach (radius and margin), in units of the
longest cell edge. The filter asks whether two lines come within contact; rounding is covered by margins, so it lets pass
whatever does, and a little more. It compares one line with a run of others in whole vectors, without a branch.
"""

import numpy as np

from .candidates import note_candidate
from .compiler import jit, part, rough
from .flags import DIM
from .layout import HALF_WINDOW, LINE_LANES, MEETING_ROOM, MEETINGS, MIDDLE, SHORT_QUEUE
from .prediction import pair_contact

ZERO = np.float32(0.0)
ONE = np.float32(1.0)
TWO = np.float32(2.0)
TINY = np.float32(1e-30)
ALL = np.int32(-2)  # in place of a partner: the lines of all count
SLACK = np.float32(1e-5)  # for rounding: of squared distances, of b, of the moment from which a line counts

# Columns of the lines.
PLACE = 0
WAY = 3
REACH_OF_LINE = 6
LINE = 8  # float32 in a line that stands alone


@jit
def line_at(p, stride, k):
    """Place, way and reach of line k."""
    x, y, u, v = (
        p[PLACE * stride + k],
        p[(PLACE + 1) * stride + k],
        p[WAY * stride + k],
        p[(WAY + 1) * stride + k],
    )
    z, w = ZERO, ZERO
    if DIM == 3:
        z, w = p[(PLACE + 2) * stride + k], p[(WAY + 2) * stride + k]
    return x, y, z, u, v, w, p[REACH_OF_LINE * stride + k]


@jit
def shifted(line, sx, sy):
    """Return the same line in another image."""
    x, y, z, u, v, w, reach = line
    return x + sx, y + sy, z, u, v, w, reach


@rough
def compare(p, stride, k, line):
    """B = r.v, v.v, and r.r less the squared contact distance, of line k against the one given."""
    x, y, z, u, v, w, reach = line
    dx, du = p[PLACE * stride + k] - x, p[WAY * stride + k] - u
    dy, dv = p[(PLACE + 1) * stride + k] - y, p[(WAY + 1) * stride + k] - v
    rr = dx * dx + dy * dy
    b = dx * du + dy * dv
    vv = du * du + dv * dv
    if DIM == 3:
        dz, dw = p[(PLACE + 2) * stride + k] - z, p[(WAY + 2) * stride + k] - w
        rr += dz * dz
        b += dz * dw
        vv += dw * dw
    limit = p[REACH_OF_LINE * stride + k] + reach
    return b, vv, rr - (limit * limit + SLACK)


@rough
def may_meet(b, vv, c, since):
    """Whether two lines may come within contact from `since` to 1, in half windows from the middle.

    They approach at first, b + since v.v < 0, and are in contact when nearest to each other or, if that is later, at the end.
    """
    return (b < SLACK - since * vv) & (c * vv < b * b) & ((b + vv > 0.0) | (c + (TWO * b + vv) < 0.0))


@jit
def counts(j, i, other):
    """Whether a line of j that the rows hold still counts for i, which has just met `other`."""
    return (other == ALL) | ((j != i) & (j != other))


@jit
def meet_run(s, stride, first, last, i, other, line, since):
    """Compare i's line with those of the rows from `first` to `last`, and note those that it may meet.

    Unless `other` is ALL, i and `other` have just changed and what the rows have of them no longer counts.
    """
    p, ids = s.lines, s.line_ids
    own, partner = np.int32(i), np.int32(other)
    for block in range(first, last, LINE_LANES):
        met = False
        for k in range(block, block + LINE_LANES):
            b, vv, c = compare(p, stride, k, line)
            met |= may_meet(b, vv, c, since) & counts(ids[k], own, partner)
        if met:
            for k in range(LINE_LANES):
                b, vv, c = compare(p, stride, block + k, line)
                s.met[k] = 1 if may_meet(b, vv, c, since) & counts(ids[block + k], own, partner) else 0
                s.met_when[k] = min(max(-b / (vv + TINY), since), ONE)
            m = s.counter[MEETINGS]
            if m + LINE_LANES > s.counter[MEETING_ROOM]:
                s.counter[SHORT_QUEUE] = 1
                return
            for k in range(min(LINE_LANES, last - block)):
                s.meeting_i[m] = i
                s.meeting_j[m] = ids[block + k]
                s.meeting_when[m] = s.met_when[k]
                m += s.met[k]
            s.counter[MEETINGS] = m


@jit
def meet_line(s, p, ids, k, i, line, since):
    """Compare i's line with one that stands alone, and note it if they may meet."""
    b, vv, c = compare(p, 1, k * LINE, line)
    m = s.counter[MEETINGS]
    if m == s.counter[MEETING_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.meeting_i[m] = i
    s.meeting_j[m] = ids[k]
    s.meeting_when[m] = min(max(-b / (vv + TINY), since), ONE)
    s.counter[MEETINGS] = m + (1 if may_meet(b, vv, c, since) & (ids[k] != i) else 0)


@part
def solve_meetings(s):
    """Compute the contacts of those whose lines may meet: in the image in which they are nearest when the lines are."""
    for m in range(s.counter[MEETINGS]):
        i, j = int(s.meeting_i[m]), int(s.meeting_j[m])
        if i != j:
            about = s.number[MIDDLE] + s.number[HALF_WINDOW] * s.meeting_when[m]
            note_candidate(s, min(i, j), max(i, j), pair_contact(s, i, j, about))
    s.counter[MEETINGS] = 0
