"""The window method, for dilute gases: who can meet whom within a short common window of time.

In a window every flight is a known straight line, and few lines come near another. Each line is registered once, in the
cell that holds its middle (fast particles in several pieces, so that no piece reaches further than half a cell less a
contact distance), and compared with the lines of the cells around: do the two come within contact during the window?
That filter runs in single precision with a safe margin; whatever passes it is computed exactly from the rows, so the filter
never enters the trajectory. True contacts become candidates, kept by time in buckets until the window ends. A particle
that has collided gets a new line, which is compared with those around it and then chained to its cell.

There are no events but collisions: nothing is done for particles that nobody meets, except to register them.
"""

import math

import numpy as np

from .agenda import push_agenda
from .compiler import inline, jit
from .flags import DIM, SIZES, WALLS
from .layout import (
    AGENDA_LENGTH,
    BOX,
    BUCKET,
    CANDIDATE_ROOM,
    CANDIDATES,
    CELL_DENSITY,
    CELL_EDGE,
    CELLS,
    CORE,
    HALF_WINDOW,
    INVERSE,
    INVERSE_WIDTH,
    LINE,
    LINE_ROOM,
    LINE_UNIT,
    LINES,
    RADIUS,
    REGISTERED,
    ROW,
    SHORT_LISTS,
    SHORT_QUEUE,
    STAMP_BITS,
    STRETCH,
    TABLE,
    WINDOW_BUCKETS,
    N,
    T,
    V,
    X,
)
from .prediction import pair_contact, wall_contact

ONE = np.float32(1.0)
TWO = np.float32(2.0)
TINY = np.float32(1e-30)
STENCIL = 3**DIM
LINE_LANES = 16
FAR = np.float32(1e18)
MARGIN = 1e-4  # added to each radius: single precision is off by a few 1e-6 of a cell
SLACK = np.float32(1e-5)  # added to the squared contact distance
MANY = 1000000  # pieces; more than anybody can need

# A line, LINE float32, in units of the longest cell edge: its place in the middle of the window relative to the cell's
# corner, half its way, its reach. Cells are wider than flights, so these numbers stay near 1 and so do the margins' errors.
PLACE = 0
WAY = 3
REACH_OF_LINE = 6


@inline
def middle_of_window(s):
    """Time, within the epoch, at the middle of the current window."""
    windows = s.counter[BUCKET] // s.counter[WINDOW_BUCKETS]
    return windows * 2.0 * s.number[HALF_WINDOW] + s.number[HALF_WINDOW]


@inline
def pieces_of(s, i, duration):
    """In how many pieces a flight of this duration is registered, so that none reaches further than STRETCH both ways."""
    vv = 0.0
    for d in range(DIM):
        v = s.row[i * ROW + V + d]
        vv += v * v
    pieces = math.sqrt(vv) * 0.5 * duration / s.number[STRETCH]
    return 1 + int(pieces) if pieces < MANY else MANY


@inline
def cell_of(s, i, d, t):
    """Cell along axis d that holds i at time t, and how far the box that holds it is shifted."""
    x = s.row[i * ROW + X + d] + s.row[i * ROW + V + d] * (t - s.row[i * ROW + T])
    shift = 0.0
    if s.number[INVERSE + d] > 0.0:
        shift = s.number[BOX + d] * math.floor(x * s.number[INVERSE + d])
    last = s.counter[CELLS + d] - 1
    cell = (x - shift) * s.number[CELL_DENSITY + d]
    if cell > 0.0:  # written so that not even a NaN leaves the grid
        return (int(cell) if cell < last else last), shift
    return 0, shift


@jit
def cell_at(s, i, t):
    """Cell that holds i at time t."""
    cell, _ = cell_of(s, i, 0, t)
    for d in range(1, DIM):
        k, _ = cell_of(s, i, d, t)
        cell = cell * s.counter[CELLS + d] + k
    return cell


@inline
def write_line(s, slot, i, t, middle, pieces):
    """Write i's line to a slot, as seen from the cell that holds i at time t."""
    line = slot * LINE
    ri = i * ROW
    dt = middle - s.row[ri + T]
    unit = s.number[LINE_UNIT]
    for d in range(DIM):
        cell, shift = cell_of(s, i, d, t)
        place = s.row[ri + X + d] + s.row[ri + V + d] * dt
        s.lines[line + PLACE + d] = ((place - shift) - cell * s.number[CELL_EDGE + d]) * unit
        s.lines[line + WAY + d] = s.row[ri + V + d] * s.number[HALF_WINDOW] * unit
    reach = (s.row[ri + RADIUS] if SIZES else s.number[CORE]) * unit + MARGIN
    if pieces > 1:
        reach += 3e-3 * pieces * s.number[STRETCH] * unit
    s.lines[line + REACH_OF_LINE] = reach
    s.line_ids[slot] = i
    s.line_versions[slot] = s.version[i]


@jit
def register_all(s, cells):
    """Sort the lines of all particles into contiguous runs, one for each cell; SHORT_LISTS tells if there was no room."""
    n = s.counter[N]
    middle = middle_of_window(s)
    duration = 2.0 * s.number[HALF_WINDOW]
    begin = middle - s.number[HALF_WINDOW]
    for cell in range(cells + 1):
        s.cell_start[cell] = 0
        s.cell_chain[cell] = -1
    total = 0
    for i in range(n):
        pieces = pieces_of(s, i, duration)
        s.pieces[i] = pieces
        total += pieces
        for p in range(pieces):
            cell = cell_at(s, i, begin + duration * (p + 0.5) / pieces)
            s.where[i] = cell
            s.cell_start[cell] += 1
    s.counter[REGISTERED] = total
    if total > s.counter[LINE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    running = 0
    for cell in range(cells + 1):
        running += s.cell_start[cell]
        s.cell_start[cell] = running
    for i in range(n - 1, -1, -1):
        pieces = s.pieces[i]
        for p in range(pieces):
            t = begin + duration * (p + 0.5) / pieces
            cell = s.where[i] if pieces == 1 else cell_at(s, i, t)
            slot = s.cell_start[cell] - 1
            s.cell_start[cell] = slot
            write_line(s, slot, i, t, middle, pieces)
    s.counter[LINES] = total


@inline
def copy_line(s, m, slot, sx, sy, sz):
    """Copy a line to column m of the table, seen from a cell that lies (sx, sy, sz) from its own."""
    line = slot * LINE
    s.table[m] = s.lines[line + PLACE] + sx
    s.table[TABLE + m] = s.lines[line + PLACE + 1] + sy
    s.table[3 * TABLE + m] = s.lines[line + WAY]
    s.table[4 * TABLE + m] = s.lines[line + WAY + 1]
    if DIM == 3:
        s.table[2 * TABLE + m] = s.lines[line + PLACE + 2] + sz
        s.table[5 * TABLE + m] = s.lines[line + WAY + 2]
    s.table[6 * TABLE + m] = s.lines[line + REACH_OF_LINE]
    s.table_slots[m] = slot


@inline
def fill_up(s, m):
    """Fill the table's last vector with lines that nobody meets."""
    while m % LINE_LANES:
        s.table[m] = FAR
        s.table[TABLE + m] = FAR
        s.table[2 * TABLE + m] = FAR
        m += 1


@inline
def closest(s, k, x, y, z, u, v, w, since):
    """When, in half windows from the middle, and how near (squared) line k of the table comes to the line given."""
    dx, du = s.table[k] - x, s.table[3 * TABLE + k] - u
    dy, dv = s.table[TABLE + k] - y, s.table[4 * TABLE + k] - v
    rr = dx * dx + dy * dy
    b = dx * du + dy * dv
    vv = du * du + dv * dv
    if DIM == 3:
        dz, dw = s.table[2 * TABLE + k] - z, s.table[5 * TABLE + k] - w
        rr += dz * dz
        b += dz * dw
        vv += dw * dw
    when = min(max(-b / (vv + TINY), since), ONE)
    return when, rr + when * (TWO * b + when * vv)


@inline
def count_meetings(s, first, m, slot, since):
    """How many lines of the table, from `first` to m, come within contact of a line: in whole vectors, without branches."""
    line = slot * LINE
    x, y, z = s.lines[line + PLACE], s.lines[line + PLACE + 1], s.lines[line + PLACE + 2]
    u, v, w = s.lines[line + WAY], s.lines[line + WAY + 1], s.lines[line + WAY + 2]
    reach = s.lines[line + REACH_OF_LINE]
    meetings = 0
    for block in range(first - first % LINE_LANES, m, LINE_LANES):
        for k in range(block, block + LINE_LANES):
            _, gap2 = closest(s, k, x, y, z, u, v, w, since)
            limit = s.table[6 * TABLE + k] + reach
            met = 1 if gap2 < limit * limit + SLACK and k >= first else 0
            s.table_met[k] = met
            meetings += met
    return meetings


@jit
def note_meetings(s, first, m, slot, since):
    """Compute the contacts of a line with those lines of the table that `count_meetings` has marked."""
    line = slot * LINE
    i = int(s.line_ids[slot])
    middle = middle_of_window(s)
    half = s.number[HALF_WINDOW]
    x, y, z = s.lines[line + PLACE], s.lines[line + PLACE + 1], s.lines[line + PLACE + 2]
    u, v, w = s.lines[line + WAY], s.lines[line + WAY + 1], s.lines[line + WAY + 2]
    for k in range(first, m):
        if s.table_met[k]:
            when, _ = closest(s, k, x, y, z, u, v, w, since)
            other = s.table_slots[k]
            j = int(s.line_ids[other])
            if j != i and s.line_versions[other] == s.version[j]:
                time = pair_contact(s, i, j, middle + half * when)
                note_candidate(s, min(i, j), max(i, j), time, middle + half)


@inline
def versions_of(s, low, high):
    """Versions of both partners in one number; a wall has none."""
    versions = int(s.version[low]) << 32
    if high < s.counter[N]:
        versions |= int(s.version[high]) & STAMP_BITS
    return versions


@jit
def note_candidate(s, low, high, time, end):
    """Keep a contact that lies in this window."""
    if time >= end:
        return
    c = s.counter[CANDIDATES]
    if c == s.counter[CANDIDATE_ROOM]:
        s.counter[SHORT_QUEUE] = 1
        return
    s.counter[CANDIDATES] = c + 1
    s.candidate_time[c] = time
    s.candidate_pair[c] = low << 32 | high
    s.candidate_versions[c] = versions_of(s, low, high)
    bucket = int(max(time, 0.0) * s.number[INVERSE_WIDTH])
    if bucket <= s.counter[BUCKET]:
        push_agenda(s, time, low << 32 | high, c)
    else:
        slot = bucket & (s.counter[WINDOW_BUCKETS] - 1)
        s.candidate_next[c] = s.buckets[slot]
        s.buckets[slot] = c


@jit
def candidate_holds(s, c):
    """Whether neither partner of a candidate has changed since it was noted."""
    low = s.candidate_pair[c] >> 32
    high = s.candidate_pair[c] & STAMP_BITS
    return versions_of(s, low, high) == s.candidate_versions[c]


@jit
def open_candidates(s):
    """Bring the candidates of the current bucket, as far as they still hold, to the agenda."""
    slot = s.counter[BUCKET] & (s.counter[WINDOW_BUCKETS] - 1)
    c = s.buckets[slot]
    s.buckets[slot] = -1
    while c >= 0:
        if candidate_holds(s, c):
            push_agenda(s, s.candidate_time[c], s.candidate_pair[c], c)
        c = s.candidate_next[c]


@inline
def side_cell(s, cell, d):
    """Index of a cell that may lie beyond the box's edge, -1 where there is none."""
    cells = s.counter[CELLS + d]
    if 0 <= cell < cells:
        return cell
    if s.number[INVERSE + d] == 0.0:
        return -1
    return cell + cells if cell < 0 else cell - cells


@inline
def offset_of(k):
    """Offset of the k-th of the 9 or 27 cells around a cell; the one in the middle is the cell itself."""
    if DIM == 2:
        return k // 3 - 1, k % 3 - 1, 0
    return k // 9 - 1, k // 3 % 3 - 1, k % 3 - 1


@inline
def cell_beside(s, kx, ky, kz, k):
    """Index of the k-th cell around a cell, -1 where a wall is in between, and where it lies from that cell."""
    ox, oy, oz = offset_of(k)
    unit = s.number[LINE_UNIT]
    x, y, z = side_cell(s, kx + ox, 0), side_cell(s, ky + oy, 1), side_cell(s, kz + oz, 2)
    cell = (x * s.counter[CELLS + 1] + y) * s.counter[CELLS + 2] + z if min(x, y, z) >= 0 else -1
    return (
        cell,
        np.float32(ox * s.number[CELL_EDGE] * unit),
        np.float32(oy * s.number[CELL_EDGE + 1] * unit),
        np.float32(oz * s.number[CELL_EDGE + 2] * unit),
    )


@jit
def meet_cell(s, kx, ky, kz):
    """Compare the lines of a cell with each other and with those of the half of its neighbours that come after it."""
    cell = (kx * s.counter[CELLS + 1] + ky) * s.counter[CELLS + 2] + kz
    first, last = s.cell_start[cell], s.cell_start[cell + 1]
    if first == last:
        return
    m = 0
    own = True  # whether this cell's own lines head the table
    for k in range(STENCIL // 2, STENCIL):
        other, sx, sy, sz = cell_beside(s, kx, ky, kz, k)
        if other < 0:
            continue
        for slot in range(s.cell_start[other], s.cell_start[other + 1]):
            if m == TABLE:
                compare_run(s, first, last, m, own)
                m, own = 0, False
            copy_line(s, m, slot, sx, sy, sz)
            m += 1
    compare_run(s, first, last, m, own)


@jit
def compare_run(s, first, last, m, own):
    """Compare the lines of a run with the table; where the run itself heads the table, each of its pairs once."""
    fill_up(s, m)
    for slot in range(first, last):
        begin = slot - first + 1 if own else 0
        if count_meetings(s, begin, m, slot, -ONE):
            note_meetings(s, begin, m, slot, -ONE)


@jit
def open_window(s, cells):
    """Register all lines and find all candidates of the window that begins in the current bucket."""
    s.counter[CANDIDATES] = 0
    s.counter[SHORT_LISTS] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[AGENDA_LENGTH] = 0
    for slot in range(s.counter[WINDOW_BUCKETS]):
        s.buckets[slot] = -1
    register_all(s, cells)
    if s.counter[SHORT_LISTS]:
        return
    for kx in range(s.counter[CELLS]):
        for ky in range(s.counter[CELLS + 1]):
            for kz in range(s.counter[CELLS + 2]):
                meet_cell(s, kx, ky, kz)
    if WALLS:
        for i in range(s.counter[N]):
            note_wall(s, i)


@jit
def note_wall(s, i):
    """Keep i's next wall as a candidate."""
    time, wall = wall_contact(s, i)
    if wall >= 0:
        note_candidate(s, i, wall, time, middle_of_window(s) + s.number[HALF_WINDOW])


@jit
def follow(s, i, now):
    """Find what happens to i, which has just changed, in the rest of the window, and chain its new line to its cells."""
    if WALLS:
        note_wall(s, i)
    middle = middle_of_window(s)
    half = s.number[HALF_WINDOW]
    duration = middle + half - now
    if duration <= 0.0:
        return
    since = np.float32((now - middle) / half) - np.float32(1e-5)
    pieces = pieces_of(s, i, duration)
    for p in range(pieces):
        t = now + duration * (p + 0.5) / pieces
        slot = s.counter[LINES]
        if slot == s.counter[LINE_ROOM]:
            s.counter[SHORT_LISTS] = 1
            return
        s.counter[LINES] = slot + 1
        write_line(s, slot, i, t, middle, pieces)
        cell = cell_at(s, i, t)
        meet_around(s, slot, cell, since)
        s.line_next[slot] = s.cell_chain[cell]
        s.cell_chain[cell] = slot


@jit
def meet_table(s, m, slot, since):
    """Compare a new line with the table."""
    fill_up(s, m)
    if count_meetings(s, 0, m, slot, since):
        note_meetings(s, 0, m, slot, since)


@inline
def take_line(s, m, slot, old, sx, sy, sz, since):
    """Copy a line to the table that a new line is to be compared with, first emptying a full one; returns its length."""
    if m == TABLE:
        meet_table(s, m, slot, since)
        m = 0
    copy_line(s, m, old, sx, sy, sz)
    return m + 1


@jit
def meet_around(s, slot, cell, since):
    """Compare a new line with all lines of its cell and the cells around."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    kx, ky, kz = cell // nz // ny, cell // nz % ny, cell % nz
    m = 0
    for k in range(STENCIL):
        other, sx, sy, sz = cell_beside(s, kx, ky, kz, k)
        if other < 0:
            continue
        for old in range(s.cell_start[other], s.cell_start[other + 1]):
            m = take_line(s, m, slot, old, sx, sy, sz, since)
        new = s.cell_chain[other]
        while new >= 0:
            m = take_line(s, m, slot, new, sx, sy, sz, since)
            new = s.line_next[new]
    meet_table(s, m, slot, since)
