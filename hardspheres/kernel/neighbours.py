"""Who can meet whom: cells of centres, and a neighbour list for each particle that lasts while it stays in its shell.

A list names every particle whose centre (where *it* was when its own list was made) lies within REACH. REACH is the contact
distance and two shells, so nobody can meet a stranger before one of the two has left its shell. Lists are symmetric, and
making a new one touches only the old and new neighbours. Cells are at least REACH wide: 27 of them (9 in 2D) hold all candidates.
On a periodic axis of one or two cells the same cell is visited again as another image of itself, which lists then name.
"""

import math

from .compiler import jit
from .flags import DIM, SIZES
from .layout import (
    BOX,
    CELL_DENSITY,
    CELL_ROOM,
    CELLS,
    CENTRE,
    EVENT,
    IMAGES,
    INVERSE,
    LIST_ROOM,
    RADIUS,
    REACH,
    RENEWALS,
    ROW,
    SHORT_CELLS,
    SHORT_LISTS,
    N,
    T,
    V,
    X,
)


@jit
def wrapped(s, i, d):
    """Coordinate d of i's centre, brought back into the box on a periodic axis."""
    x = s.event_float[i * EVENT + CENTRE + d]
    if s.number[INVERSE + d] > 0.0:
        x -= s.number[BOX + d] * math.floor(x * s.number[INVERSE + d])
    return x


@jit
def cell_index(s, i, d):
    """Index along axis d of the cell that holds i's centre; rounding at the last edge stays inside."""
    cell = int(wrapped(s, i, d) * s.number[CELL_DENSITY + d])
    return min(max(cell, 0), s.counter[CELLS + d] - 1)


@jit
def put_in_cell(s, i):
    """Enter i's centre in its cell."""
    cell = cell_index(s, i, 0)
    for d in range(1, DIM):
        cell = cell * s.counter[CELLS + d] + cell_index(s, i, d)
    room = s.counter[CELL_ROOM]
    slot = s.cell_count[cell]
    if slot == room:
        s.counter[SHORT_CELLS] = 1
        s.where[i] = -1
        return
    s.cell_count[cell] = slot + 1
    s.cell_ids[cell * room + slot] = i
    s.where[i] = cell * room + slot
    for d in range(DIM):
        s.cell_centres[(cell * (DIM + 1) + d) * room + slot] = wrapped(s, i, d)
    if SIZES:
        s.cell_centres[(cell * (DIM + 1) + DIM) * room + slot] = s.row[i * ROW + RADIUS]


@jit
def take_from_cell(s, i):
    """Remove i's centre from its cell; the last of the cell takes its slot."""
    room = s.counter[CELL_ROOM]
    cell = s.where[i] // room
    slot = s.where[i] - cell * room
    last = s.cell_count[cell] - 1
    s.cell_count[cell] = last
    moved = s.cell_ids[cell * room + last]
    s.cell_ids[cell * room + slot] = moved
    s.where[moved] = cell * room + slot
    for d in range(DIM + 1):
        column = (cell * (DIM + 1) + d) * room
        s.cell_centres[column + slot] = s.cell_centres[column + last]


@jit
def set_centre(s, i, now):
    """Move i's centre to where i is now."""
    dt = now - s.row[i * ROW + T]
    for d in range(DIM):
        s.event_float[i * EVENT + CENTRE + d] = s.row[i * ROW + X + d] + s.row[i * ROW + V + d] * dt


@jit
def append(s, i, j):
    """Append j to i's list; returns its slot, or -1 where the list is full (then the run makes room and starts over)."""
    room = s.counter[LIST_ROOM]
    k = s.neighbours[i * room] + 1
    if k == room:
        s.counter[SHORT_LISTS] = 1
        return -1
    s.neighbours[i * room] = k
    s.neighbours[i * room + k] = j
    return i * room + k


@jit
def strike(s, j, i):
    """Remove one entry of i from j's list."""
    room = s.counter[LIST_ROOM]
    base = j * room
    last = s.neighbours[base]
    k = 1
    while k <= last and s.neighbours[base + k] != i:
        k += 1
    if k > last:
        return
    s.neighbours[base + k] = s.neighbours[base + last]
    s.neighbours[base] = last - 1
    if s.counter[IMAGES]:
        for d in range(DIM):
            s.images[(base + k) * DIM + d] = s.images[(base + last) * DIM + d]


@jit
def forget(s, i):
    """Empty i's list, and remove i from the lists of those on it."""
    base = i * s.counter[LIST_ROOM]
    for k in range(1, s.neighbours[base] + 1):
        strike(s, s.neighbours[base + k], i)
    s.neighbours[base] = 0


@jit
def turns_of(s, i, d):
    """How many boxes i's centre is away from its wrapped place along axis d."""
    if s.number[INVERSE + d] > 0.0:
        return math.floor(s.event_float[i * EVENT + CENTRE + d] * s.number[INVERSE + d])
    return 0.0


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
def scan_cell(s, i, cell, sx, sy, sz, x, y, z, half):
    """Link i with the centres of one cell that lie within reach of (x, y, z); `half`: only with lower ids."""
    room = s.counter[CELL_ROOM]
    column = cell * (DIM + 1) * room
    reach = s.number[REACH]
    for slot in range(s.cell_count[cell]):
        j = s.cell_ids[cell * room + slot]
        dx = x - s.cell_centres[column + slot]
        dy = y - s.cell_centres[column + room + slot]
        rr = dx * dx + dy * dy
        if DIM == 3:
            dz = z - s.cell_centres[column + 2 * room + slot]
            rr += dz * dz
        limit = reach
        if SIZES:
            limit += s.row[i * ROW + RADIUS] + s.cell_centres[column + DIM * room + slot]
        if rr < limit * limit and (j < i or (j > i and not half)):
            link(s, i, j, sx, sy, sz)


@jit
def find_neighbours(s, i, half):
    """Fill i's list from the cells around its centre; `half`: with lower ids only, when all lists are made in turn."""
    nx, ny, nz = s.counter[CELLS], s.counter[CELLS + 1], s.counter[CELLS + 2]
    cx, cy = cell_index(s, i, 0), cell_index(s, i, 1)
    x, y = wrapped(s, i, 0), wrapped(s, i, 1)
    cz, z = 0, 0.0
    if DIM == 3:
        cz, z = cell_index(s, i, 2), wrapped(s, i, 2)
    for ox in range(-1, 2):
        kx, sx, inside_x = neighbour_cell(s, cx + ox, nx, 0)
        if not inside_x:
            continue
        for oy in range(-1, 2):
            ky, sy, inside_y = neighbour_cell(s, cy + oy, ny, 1)
            if not inside_y:
                continue
            if DIM == 2:
                scan_cell(
                    s,
                    i,
                    kx * ny + ky,
                    sx,
                    sy,
                    0.0,
                    x - sx * s.number[BOX],
                    y - sy * s.number[BOX + 1],
                    0.0,
                    half,
                )
            else:
                for oz in range(-1, 2):
                    kz, sz, inside_z = neighbour_cell(s, cz + oz, nz, 2)
                    if inside_z:
                        scan_cell(
                            s,
                            i,
                            (kx * ny + ky) * nz + kz,
                            sx,
                            sy,
                            sz,
                            x - sx * s.number[BOX],
                            y - sy * s.number[BOX + 1],
                            z - sz * s.number[BOX + 2],
                            half,
                        )


@jit
def neighbour_cell(s, cell, cells, d):
    """Index of a cell that may lie beyond the box's edge, in boxes how far beyond, and whether there is one at all."""
    if cell < 0:
        return cell + cells, -1.0, s.number[INVERSE + d] > 0.0
    if cell >= cells:
        return cell - cells, 1.0, s.number[INVERSE + d] > 0.0
    return cell, 0.0, True


@jit
def renew_list(s, i, now):
    """Move i's centre to where i is, and make its list anew."""
    forget(s, i)
    take_from_cell(s, i)
    set_centre(s, i, now)
    put_in_cell(s, i)
    find_neighbours(s, i, False)
    s.counter[RENEWALS] += 1


@jit
def make_all_lists(s, now, cells):
    """Centres, cells and lists of all particles from their rows."""
    n = s.counter[N]
    s.counter[SHORT_CELLS] = 0
    s.counter[SHORT_LISTS] = 0
    for cell in range(cells):
        s.cell_count[cell] = 0
    for i in range(n):
        set_centre(s, i, now)
        put_in_cell(s, i)
        s.neighbours[i * s.counter[LIST_ROOM]] = 0
    for i in range(n):
        find_neighbours(s, i, True)
