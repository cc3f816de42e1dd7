"""Lines of the window method: the straight flights of a window, in single precision, and the filter that compares them.

A line is its place in the middle of the window, half its way through it, its reach (radius and margin), in units of the
longest cell edge, and its id. The filter asks whether two lines come within contact; rounding is covered by margins, so it lets
pass whatever does, and a little more. It compares one line with eight others at a time, without a branch.
"""

import numpy as np

from .candidates import note_candidate
from .compiler import jit, part, rough, turn_rows
from .flags import DIM
from .layout import BOX, HALF_WINDOW, LINE_UNIT, MEETING_ROOM, MEETINGS, MIDDLE, SHORT_QUEUE
from .prediction import pair_contact

ZERO = np.float32(0.0)
ONE = np.float32(1.0)
TWO = np.float32(2.0)
TINY = np.float32(1e-30)
SLACK = np.float32(1e-5)  # for rounding: of squared distances, of b, of the moment from which a line counts

LINE = 8  # float32 in a line
PLACE = 0
WAY = 3
REACH_OF_LINE = 6
WHOSE = 7  # the id, in the same memory as int32
LINES = 8  # lines that the filter compares at once

# Bounds of a line, 6 bytes of an int64: the low ends of a box that holds it, along x, y, z, and the high ends negated. A cell is
# UNITS wide, and whole turns of 256 are left out: the difference of two that overlap is less than two cells, so that its sign
# can be told; of others that stand in cells that touch, too.
UNITS = 60
BYTE = 255

# The image in which a line is compared: 1, plus or minus a box, for each axis.
IMAGE = (1, 4, 16)
SAME = 21


@jit
def line_at(p, k):
    """Place, way and reach of line k."""
    k = k * LINE
    return p[k], p[k + 1], p[k + 2], p[k + WAY], p[k + WAY + 1], p[k + WAY + 2], p[k + REACH_OF_LINE]


@jit
def boxes(s):
    """Edges of the box in the units of lines; what lies between walls has no other image."""
    unit = s.number[LINE_UNIT]
    return (
        np.float32(s.number[BOX] * unit),
        np.float32(s.number[BOX + 1] * unit),
        np.float32(s.number[BOX + 2] * unit),
    )


@rough
def compare(p, stride, k, code, line, edges):
    """B = r.v, v.v, and r.r less the squared contact distance, of line k against the one given in this image."""
    x, y, z, u, v, w, reach = line
    ex, ey, ez = edges
    dx = (p[k] - x) - np.float32((code & 3) - 1) * ex
    dy = (p[stride + k] - y) - np.float32(((code >> 2) & 3) - 1) * ey
    du = p[WAY * stride + k] - u
    dv = p[(WAY + 1) * stride + k] - v
    rr = dx * dx + dy * dy
    b = dx * du + dy * dv
    vv = du * du + dv * dv
    if DIM == 3:
        dz = (p[2 * stride + k] - z) - np.float32((code >> 4) - 1) * ez
        dw = p[(WAY + 2) * stride + k] - w
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
def examine(s, m, i, line, edges, since):
    """Compare i's line with those whose bounds it overlaps, the first m of the table, and note those that it may meet."""
    for block in range(0, m, LINES):
        turn_rows(s.near_lines, 0, LINES, s.lines, s.near, block)
        met = False
        for k in range(LINES):
            b, vv, c = compare(s.near_lines, LINES, k, s.near_codes[block + k], line, edges)
            met |= may_meet(b, vv, c, since)
        if met:
            for k in range(LINES):
                b, vv, c = compare(s.near_lines, LINES, k, s.near_codes[block + k], line, edges)
                s.met[k] = 1 if may_meet(b, vv, c, since) else 0
                s.met_when[k] = min(max(-b / (vv + TINY), since), ONE)
            note_meetings(s, i, block, min(m - block, LINES))


@jit
def note_meetings(s, i, block, lines):
    """Note those of up to eight lines that i's line may meet."""
    m = s.counter[MEETINGS]
    if m + LINES > s.counter[MEETING_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    for k in range(lines):
        s.meeting_i[m] = i
        s.meeting_j[m] = s.line_words[s.near[block + k] * LINE + WHOSE]
        s.meeting_when[m] = s.met_when[k]
        m += s.met[k]
    s.counter[MEETINGS] = m


@jit
def meet_line(s, p, words, k, code, i, line, edges, since):
    """Compare i's line with one that stands alone, and note it if they may meet."""
    b, vv, c = compare(p, 1, k * LINE, code, line, edges)
    m = s.counter[MEETINGS]
    if m == s.counter[MEETING_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.meeting_i[m] = i
    s.meeting_j[m] = words[k * LINE + WHOSE]
    s.meeting_when[m] = min(max(-b / (vv + TINY), since), ONE)
    s.counter[MEETINGS] = m + (1 if may_meet(b, vv, c, since) else 0)


@part
def solve_meetings(s):
    """Compute the contacts of those whose lines may meet: in the image in which they are nearest when the lines are."""
    for m in range(s.counter[MEETINGS]):
        i, j = int(s.meeting_i[m]), int(s.meeting_j[m])
        if i != j:
            about = s.number[MIDDLE] + s.number[HALF_WINDOW] * s.meeting_when[m]
            note_candidate(s, min(i, j), max(i, j), pair_contact(s, i, j, about))
    s.counter[MEETINGS] = 0
