"""Who can meet whom: cells of centres, and a neighbour list for each particle that lasts while it stays in its shell.

A list names every particle whose centre (a little ahead of where *it* was when its own list was made) lies within REACH. REACH is
the contact distance and two shells, so nobody can meet a stranger before one of the two has left its shell. Lists are symmetric,
and making a new one touches only the neighbours lost and won. All are made at once from a table of what is around each cell. A
list ends with the id n, the row of which nobody meets, and so does every slot after that. Cells are at least REACH wide: 27 of them (9 in 2D) hold all candidates; they keep the centres as seen
from their own corner, in single precision, which REACH makes up for. On a periodic axis of one or two cells the same cell is
visited again as another image of itself, which lists then name.
"""

import numpy as np

from ..flags import DIM, SIZES
from ..layout import (
    AROUND,
    CELL_COLUMNS,
    CELL_EDGE,
    CELL_LANES,
    CELL_ROOM,
    CELLS,
    CENTRE,
    EVENT,
    IMAGES,
    LEAD,
    LIST_ROOM,
    PATIENCE,
    RADIUS,
    REACH,
    RENEWALS,
    ROW,
    SHELL,
    SHORT_CELLS,
    SHORT_LISTS,
    SWEEP_DUE,
    SWEEPS,
    N,
    T,
    V,
    X,
)
from ..simd.jit import called, jit
from .cell_grid import line_of, locate, neighbour_cell, put_in_cell, take_from_cell, turns_of
from .cutoff import copy_lines, keep_within

AHEAD = (
    0.5  # of a shell, along each axis: the centre is so far ahead at most, so the particle is in the shell
)


@jit
def set_centre(s, i, now):
    """Move i's centre to a little ahead of where i is now, about where it will collide: it stays around there for longer."""
    dt = now - s.row[i * ROW + T]
    most = AHEAD * s.number[SHELL]
    for d in range(DIM):
        v = s.row[i * ROW + V + d]
        ahead = max(min(v * s.number[LEAD], most), -most)
        s.event_float[i * EVENT + CENTRE + d] = s.row[i * ROW + X + d] + v * dt + ahead


@jit
def position_in_list(s, i, j):
    """Slot of the first entry of j in i's list; the number of slots where there is none."""
    room = s.counter[LIST_ROOM]
    found = room
    for k in range(room):
        found = min(found, k if s.neighbours[i * room + k] == j else room)
    return found


@jit
def append(s, i, j):
    """Append j to i's list; returns its slot, or -1 where the list is full (then the run makes room and starts over)."""
    room = s.counter[LIST_ROOM]
    end = position_in_list(s, i, s.counter[N])
    if end >= room - 1:
        s.counter[SHORT_LISTS] = 1
        return -1
    s.neighbours[i * room + end] = j
    return i * room + end


@jit
def strike(s, i, j):
    """Remove one entry of j from i's list; the last entry takes its slot."""
    room = s.counter[LIST_ROOM]
    k = position_in_list(s, i, j)
    last = position_in_list(s, i, s.counter[N]) - 1
    if k > last:
        return
    s.neighbours[i * room + k] = s.neighbours[i * room + last]
    s.neighbours[i * room + last] = s.counter[N]
    if s.counter[IMAGES]:
        for d in range(DIM):
            s.images[(i * room + k) * DIM + d] = s.images[(i * room + last) * DIM + d]


@jit
def forget(s, i):
    """Empty i's list, and remove i from the lists of those on it."""
    room = s.counter[LIST_ROOM]
    for k in range(room):
        j = s.neighbours[i * room + k]
        if j < s.counter[N]:
            strike(s, j, i)
        s.neighbours[i * room + k] = s.counter[N]


@jit
def link(s, i, j, sx, sy, sz):
    """Enter i and j in each other's lists; the image of j that i meets is shifted by (sx, sy, sz) boxes."""
    a = append(s, i, j)
    b = append(s, j, i)
    if s.counter[IMAGES] and a >= 0 and b >= 0:
        for d in range(DIM):
            shift = sx if d == 0 else (sy if d == 1 else sz)
            image = int(shift + turns_of(s, i, d) - turns_of(s, j, d))
            s.images[a * DIM + d] = image
            s.images[b * DIM + d] = -image


@jit
def look_in_cell(s, cell, i, x, y, z, reach, kept):
    """Add the ids of a cell's centres within reach of (x, y, z), other than i's, to those kept. Returns how many there are then."""
    count = s.cell_count[cell]
    line = line_of(cell * s.counter[CELL_ROOM])
    for k in range(0, max(count, 1), CELL_LANES):
        left = count - k
        at = line + CELL_COLUMNS * k
        kept += keep_within(s.near, kept, s.cell_ids, s.cell_places, at, CELL_LANES, left, i, x, y, z, reach)
    return kept


@called
def look_around(s, i):
    """Find the ids of all centres within reach of i's; where lists name images, link them at once. Returns how many."""
    cx, cy, cz, x, y, z = locate(s, i)
    named = s.counter[IMAGES] == 1
    reach = np.float32(s.number[REACH])
    if SIZES:
        reach = np.float32(s.number[REACH] + s.row[i * ROW + RADIUS])
    kept = 0
    for ox in range(-1, 2):
        kx, sx = neighbour_cell(s, cx + ox, 0)
        px = np.float32(x - np.float32(ox * s.number[CELL_EDGE]))
        for oy in range(-1, 2):
            ky, sy = neighbour_cell(s, cy + oy, 1)
            py = np.float32(y - np.float32(oy * s.number[CELL_EDGE + 1]))
            if kx < 0 or ky < 0:
                continue
            row_of_cells = (kx * s.counter[CELLS + 1] + ky) * s.counter[CELLS + 2]
            for oz in range(-1 if DIM == 3 else 0, 2 if DIM == 3 else 1):
                kz, sz = neighbour_cell(s, cz + oz, 2)
                pz = np.float32(z - np.float32(oz * s.number[CELL_EDGE + 2]))
                if kz >= 0:
                    kept = look_in_cell(s, row_of_cells + kz, i, px, py, pz, reach, kept)
                    if named:
                        for k in range(kept):
                            link(s, i, s.near[k], sx, sy, sz)
                        kept = 0
    for k in range(kept, kept + CELL_LANES):
        s.near[k] = -1
    return kept


@jit
def is_near(s, kept, j):
    """Whether j is one of those kept."""
    found = False
    for k in range(0, kept, CELL_LANES):
        for a in range(k, k + CELL_LANES):
            found |= s.near[a] == j
    return found


@jit
def relist(s, i):
    """Replace i's list by what `look_around` finds, and tell those lost and won."""
    room = s.counter[LIST_ROOM]
    n = s.counter[N]
    kept = look_around(s, i)
    if kept >= room:
        s.counter[SHORT_LISTS] = 1
        return
    for k in range(kept):
        j = s.near[k]
        if position_in_list(s, i, j) == room:
            append(s, j, i)
    for k in range(room):
        j = s.neighbours[i * room + k]
        if j == n:
            break
        if not is_near(s, kept, j):
            strike(s, j, i)
    write_list(s, i, kept)


@jit
def write_list(s, i, kept):
    """Make those kept i's list."""
    room = s.counter[LIST_ROOM]
    if kept >= room:
        s.counter[SHORT_LISTS] = 1
        return
    for k in range(room):
        s.neighbours[i * room + k] = s.near[k] if k < kept else s.counter[N]


@jit
def renew_list(s, i, now):
    """Move i's centre to where i is, and make its list anew."""
    take_from_cell(s, i)
    set_centre(s, i, now)
    if s.counter[IMAGES]:
        forget(s, i)
        look_around(s, i)
    else:
        relist(s, i)
    put_in_cell(s, i)
    s.counter[RENEWALS] += 1


@called
def make_all_lists(s, now, cells):
    """Centres, cells and lists of all particles from their rows."""
    n = s.counter[N]
    s.counter[SHORT_CELLS] = 0
    s.counter[SHORT_LISTS] = 0
    s.counter[SWEEPS] += 1
    s.counter[SWEEP_DUE] = s.counter[RENEWALS] + s.counter[PATIENCE]
    for cell in range(cells):
        s.cell_count[cell] = 0
    if s.counter[IMAGES]:
        for k in range(n * s.counter[LIST_ROOM]):
            s.neighbours[k] = n
    for i in range(n):
        set_centre(s, i, now)
        if s.counter[IMAGES]:
            look_around(s, i)  # each for those that came before
        put_in_cell(s, i)
    if s.counter[IMAGES] == 0 and s.counter[SHORT_CELLS] == 0:
        for cx in range(s.counter[CELLS]):
            for cy in range(s.counter[CELLS + 1]):
                for cz in range(s.counter[CELLS + 2]):
                    list_cell(s, cx, cy, cz)


@jit
def list_cell(s, cx, cy, cz):
    """Make the lists of all particles in a cell."""
    wide = AROUND * s.counter[CELL_ROOM] + CELL_LANES
    m, own, count = lay_out_around(s, cx, cy, cz)
    for line in range(own, own + count):
        i = s.around_ids[line]
        x, y = s.around[line + wide], s.around[line + 2 * wide]
        z = s.around[line + 3 * wide] if DIM == 3 else np.float32(0.0)
        reach = np.float32(s.number[REACH])
        if SIZES:
            reach += s.around[line + (1 + DIM) * wide]
        kept = 0
        for k in range(0, m, CELL_LANES):
            kept += keep_within(s.near, kept, s.around_ids, s.around, k, wide, m - k, i, x, y, z, reach)
        write_list(s, i, kept)


@jit
def lay_out_around(s, cx, cy, cz):
    """Copy a cell and those around it to a table, as seen from its corner.

    Returns how many lines that makes, which is the first of the cell itself, and how many it has.
    """
    wide = AROUND * s.counter[CELL_ROOM] + CELL_LANES
    m, own, count = 0, 0, 0
    for ox in range(-1, 2):
        kx, _ = neighbour_cell(s, cx + ox, 0)
        x = np.float32(ox * s.number[CELL_EDGE])
        for oy in range(-1, 2):
            ky, _ = neighbour_cell(s, cy + oy, 1)
            y = np.float32(oy * s.number[CELL_EDGE + 1])
            if kx < 0 or ky < 0:
                continue
            row_of_cells = (kx * s.counter[CELLS + 1] + ky) * s.counter[CELLS + 2]
            for oz in range(-1 if DIM == 3 else 0, 2 if DIM == 3 else 1):
                kz, _ = neighbour_cell(s, cz + oz, 2)
                z = np.float32(oz * s.number[CELL_EDGE + 2])
                if kz < 0:
                    continue
                here = s.cell_count[row_of_cells + kz]
                if ox == 0 and oy == 0 and oz == 0:
                    own, count = m, here
                line = line_of((row_of_cells + kz) * s.counter[CELL_ROOM])
                for k in range(0, max(here, 1), CELL_LANES):
                    at = line + CELL_COLUMNS * k
                    copy_lines(
                        s.around_ids,
                        s.around,
                        m + k,
                        wide,
                        s.cell_ids,
                        s.cell_places,
                        at,
                        CELL_LANES,
                        x,
                        y,
                        z,
                    )
                m += here
    return m, own, count
