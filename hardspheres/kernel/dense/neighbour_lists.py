"""Neighbour lists: with whom each particle can collide before it exceeds its displacement threshold.

Each particle has a reference position, a little ahead of where it was when its list was made. The list names
every particle whose reference position lies within CUTOFF of it. CUTOFF is the contact distance and two
displacement thresholds, so no particle outside the list can collide before one of the two exceeds its
threshold. Then that one gets a new list, and only the lists of removed and added neighbours change with it:
lists are symmetric, but for obstacles, whose own lists are empty. All lists are rebuilt at once, cell by
cell, from a table of the particles around each cell.

A list ends with the id n, the null particle, and so does every slot after that. Cells are at least CUTOFF
wide, so 27 of them (9 in 2D) hold all neighbours; CUTOFF covers the rounding of positions in cells to single
precision. On a periodic axis of one or two cells the same cell is visited again as another image of itself;
lists then store the image index.
"""

import numpy as np

from .. import layout as at
from ..common.obstacles import is_obstacle
from ..flags import DIM, GRAVITY, OBSTACLES, SIZES
from ..simd.jit import called, jit
from .cell_grid import fallen, image_of, locate, neighbour_cell, place_of_slot, put_in_cell, take_from_cell
from .cutoff import copy_columns, cutoff_test

# Of the displacement threshold, along each axis: the reference position is at most so far ahead of the
# particle.
MOST_AHEAD = 0.5


@jit
def set_reference(s, i, now, most_ahead):
    """Put i's reference position ahead of i, about where it will collide: i stays near it for longer."""
    dt = now - s.row[i * at.ROW + at.T]
    most = most_ahead * s.number[at.DISPLACEMENT_THRESHOLD]
    for d in range(DIM):
        x, v = s.row[i * at.ROW + at.X + d], s.row[i * at.ROW + at.V + d]
        if GRAVITY and OBSTACLES:  # they stay where they are: so do reference positions
            pull = 0.0 if is_obstacle(s, i) else s.number[at.PULL + d]
            x, v = x - 0.5 * pull * dt * dt, v + pull * dt
        elif GRAVITY:
            x, v = fallen(s, d, x, v, s.row[i * at.ROW + at.T])
        ahead = max(min(v * s.number[at.LEAD], most), -most)
        s.event_float[i * at.EVENT + at.REFERENCE + d] = x + v * dt + ahead


@jit
def position_in_list(s, i, j):
    """Slot of the first entry of j in i's list; the number of slots where there is none."""
    room = s.counter[at.LIST_ROOM]
    # To the end of the list, wherever it is found: without a branch this is a few vector instructions.
    found = room
    for k in range(room):
        found = min(found, k if s.neighbours[i * room + k] == j else room)
    return found


@jit
def add_neighbour(s, i, j):
    """Append j to i's list; returns its slot, or -1 where the list is full (then the run makes room)."""
    room = s.counter[at.LIST_ROOM]
    end = position_in_list(s, i, s.counter[at.N])
    if end >= room - 1:
        s.counter[at.SHORT_LISTS] = 1
        return -1
    s.neighbours[i * room + end] = j
    return i * room + end


@jit
def remove_neighbour(s, i, j):
    """Remove one entry of j from i's list; the last entry takes its slot."""
    room = s.counter[at.LIST_ROOM]
    k = position_in_list(s, i, j)
    last = position_in_list(s, i, s.counter[at.N]) - 1
    if k > last:
        return
    s.neighbours[i * room + k] = s.neighbours[i * room + last]
    s.neighbours[i * room + last] = s.counter[at.N]
    if s.counter[at.IMAGES]:
        for d in range(DIM):
            s.images[(i * room + k) * DIM + d] = s.images[(i * room + last) * DIM + d]


@jit
def clear_list(s, i):
    """Empty i's list, and remove i from the lists of those on it."""
    room = s.counter[at.LIST_ROOM]
    for k in range(room):
        j = s.neighbours[i * room + k]
        if j < s.counter[at.N]:
            remove_neighbour(s, j, i)
        s.neighbours[i * room + k] = s.counter[at.N]


@jit
def add_pair(s, i, j, sx, sy, sz):
    """Enter i and j in each other's lists; j is seen in the image that is shifted by (sx, sy, sz) boxes."""
    if OBSTACLES and is_obstacle(s, i):
        if not is_obstacle(s, j):
            add_obstacle(s, j, i, -sx, -sy, -sz)
        return
    if OBSTACLES and is_obstacle(s, j):
        add_obstacle(s, i, j, sx, sy, sz)
        return
    a = add_neighbour(s, i, j)
    b = add_neighbour(s, j, i)
    if s.counter[at.IMAGES] and a >= 0 and b >= 0:
        for d in range(DIM):
            shift = sx if d == 0 else (sy if d == 1 else sz)
            image = int(shift + image_of(s, i, d) - image_of(s, j, d))
            s.images[a * DIM + d] = image
            s.images[b * DIM + d] = -image


@jit
def add_obstacle(s, i, j, sx, sy, sz):
    """Enter the obstacle j in the list of i, in this image; its own list stays empty."""
    a = add_neighbour(s, i, j)
    if s.counter[at.IMAGES] and a >= 0:
        for d in range(DIM):
            shift = sx if d == 0 else (sy if d == 1 else sz)
            s.images[a * DIM + d] = int(shift + image_of(s, i, d) - image_of(s, j, d))


@jit
def find_in_cell(s, cell, i, x, y, z, cutoff, kept):
    """Append the ids of a cell within the cutoff of (x, y, z), without i; returns how many are kept."""
    count = s.cell_count[cell]
    line = place_of_slot(cell * s.counter[at.CELL_ROOM])
    for k in range(0, max(count, 1), at.CELL_LANES):
        left = count - k
        column = line + at.CELL_COLUMNS * k
        kept += cutoff_test(
            s.near, kept, s.cell_ids, s.cell_places, column, at.CELL_LANES, left, i, x, y, z, cutoff
        )
    return kept


@called
def find_neighbours(s, i):
    """Find all within the cutoff of i, and return how many; where lists store images, enter them at once."""
    cx, cy, cz, x, y, z = locate(s, i)
    named = s.counter[at.IMAGES] == 1
    cutoff = np.float32(s.number[at.CUTOFF])
    if SIZES:
        cutoff = np.float32(s.number[at.CUTOFF] + s.row[i * at.ROW + at.RADIUS])
    kept = 0
    for ox in range(-1, 2):
        kx, sx = neighbour_cell(s, cx + ox, 0)
        px = np.float32(x - np.float32(ox * s.number[at.CELL_EDGE]))
        for oy in range(-1, 2):
            ky, sy = neighbour_cell(s, cy + oy, 1)
            py = np.float32(y - np.float32(oy * s.number[at.CELL_EDGE + 1]))
            if kx < 0 or ky < 0:
                continue
            row_of_cells = (kx * s.counter[at.CELLS + 1] + ky) * s.counter[at.CELLS + 2]
            for oz in range(-1 if DIM == 3 else 0, 2 if DIM == 3 else 1):
                kz, sz = neighbour_cell(s, cz + oz, 2)
                pz = np.float32(z - np.float32(oz * s.number[at.CELL_EDGE + 2]))
                if kz >= 0:
                    kept = find_in_cell(s, row_of_cells + kz, i, px, py, pz, cutoff, kept)
                    if named:
                        for k in range(kept):
                            add_pair(s, i, s.near[k], sx, sy, sz)
                        kept = 0
    for k in range(kept, kept + at.CELL_LANES):
        s.near[k] = -1
    return kept


@jit
def is_found(s, kept, j):
    """Whether j is one of those kept."""
    found = False
    for k in range(0, kept, at.CELL_LANES):
        for a in range(k, k + at.CELL_LANES):
            found |= s.near[a] == j
    return found


@jit
def update_list(s, i):
    """Replace i's list, and update the lists of removed and added neighbours."""
    room = s.counter[at.LIST_ROOM]
    n = s.counter[at.N]
    kept = find_neighbours(s, i)
    # First those that are new, then those that are gone: most stay, and their lists are not touched.
    if kept >= room:
        s.counter[at.SHORT_LISTS] = 1
        return
    for k in range(kept):
        j = s.near[k]
        if position_in_list(s, i, j) == room and not (OBSTACLES and is_obstacle(s, j)):
            add_neighbour(s, j, i)
    for k in range(room):
        j = s.neighbours[i * room + k]
        if j == n:
            break
        if not is_found(s, kept, j):
            remove_neighbour(s, j, i)
    write_list(s, i, kept)


@jit
def write_list(s, i, kept):
    """Write the particles that were kept to i's list."""
    room, n = s.counter[at.LIST_ROOM], np.int32(s.counter[at.N])
    if kept >= room:
        s.counter[at.SHORT_LISTS] = 1
        return
    end = np.int32(kept)  # as wide as ids are: then 16 fill a vector
    for k in range(room):
        s.neighbours[i * room + k] = s.near[k] if np.int32(k) < end else n


@jit
def rebuild_list(s, i, now, most_ahead):
    """Move i's reference position to where i is now, and rebuild its list."""
    # Out of the cells first, so that i is not found as a neighbour of itself.
    take_from_cell(s, i)
    set_reference(s, i, now, most_ahead)
    if s.counter[at.IMAGES]:
        clear_list(s, i)
        find_neighbours(s, i)
    else:
        update_list(s, i)
    put_in_cell(s, i)
    s.counter[at.REBUILDS] += 1


@called
def make_all_lists(s, now):
    """Make the reference positions, cells and lists of all particles from their rows."""
    n = s.counter[at.N]
    cells = s.counter[at.CELLS] * s.counter[at.CELLS + 1] * s.counter[at.CELLS + 2]
    s.counter[at.SHORT_CELLS] = 0
    s.counter[at.SHORT_LISTS] = 0
    s.counter[at.REBUILDS_OF_ALL] += 1
    s.counter[at.REBUILD_ALL_DUE] = s.counter[at.REBUILDS] + s.counter[at.REBUILD_THRESHOLD]
    for cell in range(cells):
        s.cell_count[cell] = 0
    if s.counter[at.IMAGES]:
        for k in range(n * s.counter[at.LIST_ROOM]):
            s.neighbours[k] = n
    for i in range(n):
        set_reference(s, i, now, MOST_AHEAD)
        if s.counter[at.IMAGES]:
            find_neighbours(s, i)  # each with those before it
        put_in_cell(s, i)
    if s.counter[at.IMAGES] == 0 and s.counter[at.SHORT_CELLS] == 0:
        for cx in range(s.counter[at.CELLS]):
            for cy in range(s.counter[at.CELLS + 1]):
                for cz in range(s.counter[at.CELLS + 2]):
                    make_lists_of_cell(s, cx, cy, cz)


@jit
def make_lists_of_cell(s, cx, cy, cz):
    """Make the lists of all particles in a cell."""
    wide = at.AROUND * s.counter[at.CELL_ROOM] + at.CELL_LANES
    m, own, count = gather_cells(s, cx, cy, cz)
    for k_own in range(own, own + count):
        i = s.around_ids[k_own]
        if OBSTACLES and is_obstacle(s, i):
            write_list(s, i, 0)
            continue
        x, y = s.around[k_own + wide], s.around[k_own + 2 * wide]
        z = s.around[k_own + 3 * wide] if DIM == 3 else np.float32(0.0)
        cutoff = np.float32(s.number[at.CUTOFF])
        if SIZES:
            cutoff += s.around[k_own + (1 + DIM) * wide]
        kept = 0
        for k in range(0, m, at.CELL_LANES):
            kept += cutoff_test(s.near, kept, s.around_ids, s.around, k, wide, m - k, i, x, y, z, cutoff)
        write_list(s, i, kept)


@jit
def gather_cells(s, cx, cy, cz):
    """Copy a cell and those around it to a table, as seen from its corner.

    Returns how many particles the table has, which is the first of the cell itself, and how many it has.
    """
    wide = at.AROUND * s.counter[at.CELL_ROOM] + at.CELL_LANES
    m, own, count = 0, 0, 0
    for ox in range(-1, 2):
        kx, _ = neighbour_cell(s, cx + ox, 0)
        x = np.float32(ox * s.number[at.CELL_EDGE])
        for oy in range(-1, 2):
            ky, _ = neighbour_cell(s, cy + oy, 1)
            y = np.float32(oy * s.number[at.CELL_EDGE + 1])
            if kx < 0 or ky < 0:
                continue
            row_of_cells = (kx * s.counter[at.CELLS + 1] + ky) * s.counter[at.CELLS + 2]
            for oz in range(-1 if DIM == 3 else 0, 2 if DIM == 3 else 1):
                kz, _ = neighbour_cell(s, cz + oz, 2)
                z = np.float32(oz * s.number[at.CELL_EDGE + 2])
                if kz < 0:
                    continue
                here = s.cell_count[row_of_cells + kz]
                if ox == 0 and oy == 0 and oz == 0:
                    own, count = m, here
                line = place_of_slot((row_of_cells + kz) * s.counter[at.CELL_ROOM])
                for k in range(0, max(here, 1), at.CELL_LANES):
                    column = line + at.CELL_COLUMNS * k
                    copy_columns(
                        s.around_ids,
                        s.around,
                        m + k,
                        wide,
                        s.cell_ids,
                        s.cell_places,
                        column,
                        at.CELL_LANES,
                        x,
                        y,
                        z,
                    )
                m += here
    return m, own, count
