"""Trial insertions of spheres among those placed before, compiled; `hardspheres.placement` says what for.

A trial is a sphere with its centre at one place, or anywhere in a voxel around that place. It is covered if
even the farthest corner of its voxel is nearer to the centre of a placed sphere than the sum of both radii.

Placed spheres lie in cells no narrower than the largest contact distance. `heads` has the last sphere of each
cell, `nexts` the one placed there before it, so that numbers fall along a list, to -1 at its end. Where fewer
than three axes have an extent, the others have one cell.

Most trials in a dense gas are covered, and by spheres of long ago. `settled` has these cell by cell in single
precision, in units of the largest diameter. The cells of a row follow each other; `firsts` says where each
begins.
"""

import numpy as np

from hardspheres.kernel.simd.jit import entry_point, jit

__all__ = ["insert", "map_room", "settle"]

SLACK = 1.0 + 1e-6  # of squared distances to cells, so that no rounding skips one that matters
# Nine rows of cells, nearest first: steps to the nearer side of a place along two axes.
ROWS = np.array([(0, 0), (1, 0), (0, 1), (1, 1), (-1, 0), (0, -1), (1, -1), (-1, 1), (-1, -1)])


@jit
def cell_along(axis, x, edges, shape):
    return min(max(int(x / edges[axis]), 0), shape[axis] - 1)


@jit
def three_cells(axis, x, half, edges, period, shape, cells, squares):
    """Find the cells along an axis, nearest first, and the squares of the least reach of spheres in them."""
    home = cell_along(axis, x, edges, shape)
    below = x - home * edges[axis]
    above = edges[axis] - below
    nearest = 1 if above < below else -1
    for k in range(3):
        step = 0 if k == 0 else nearest if k == 1 else -nearest
        gap = 0.0 if k == 0 else max(above if step > 0 else below, 0.0)
        cell = home + step
        squares[axis, k] = (gap + half) * (gap + half)
        if cell < 0 or cell >= shape[axis]:
            cell -= step * shape[axis]
            if period[axis] == np.inf or shape[axis] == 1:
                squares[axis, k] = np.inf
        cells[axis, k] = cell


@jit
def reach_along(axis, x, other, half, period):
    """Distance along an axis of a centre to the farther side of a voxel."""
    step = abs(x - other)
    return min(step, abs(period[axis] - step)) + half[axis]


@jit
def is_covered(
    x,
    y,
    z,
    radius,
    half,
    touching,
    largest,
    edges,
    period,
    shape,
    heads,
    nexts,
    placed,
    oldest,
    end,
    cells,
    squares,
):
    """Whether a sphere placed as number `oldest` or later, but before `end`, covers a trial."""
    three_cells(0, x, half[0], edges, period, shape, cells, squares)
    three_cells(1, y, half[1], edges, period, shape, cells, squares)
    three_cells(2, z, half[2], edges, period, shape, cells, squares)
    limit = (radius + largest) * (radius + largest) * SLACK
    for a in range(3):
        for b in range(3):
            square = squares[0, a] + squares[1, b]
            if square > limit:
                continue
            row = (cells[0, a] * shape[1] + cells[1, b]) * shape[2]
            for c in range(3):
                if square + squares[2, c] > limit:
                    continue
                j = heads[row + cells[2, c]]
                while j >= oldest:
                    # As `cells.distances`, to the last bit.
                    dx = reach_along(0, x, placed[j, 0], half, period)
                    dy = reach_along(1, y, placed[j, 1], half, period)
                    dz = reach_along(2, z, placed[j, 2], half, period)
                    reach = np.sqrt((dx * dx + dy * dy) + dz * dz)
                    contact = radius + placed[j, 3]
                    if j < end and (reach < contact or (touching and reach == contact)):
                        return True
                    j = nexts[j]
    return False


@entry_point
def settle(heads, nexts, placed, n_placed, largest, rounding):
    """Return `firsts` and `settled` for the spheres that are placed, with radii reduced by `rounding`."""
    firsts, settled = np.empty(len(heads) + 1, np.int32), np.empty((n_placed, 4), np.float32)
    unit, n = 0.5 / largest, 0
    for cell in range(len(heads)):
        firsts[cell] = n
        j = heads[cell]
        while j >= 0:
            for axis in range(3):
                settled[n, axis] = placed[j, axis] * unit
            settled[n, 3] = (placed[j, 3] - rounding) * unit
            n += 1
            j = nexts[j]
    firsts[len(heads)] = n
    return firsts, settled


@jit
def is_all_around(axis, x, cell, doubt, width, period, shape):
    """Whether all that is near lies in this cell and those beside it, without images."""
    if shape[axis] == 1:
        return period[axis] == np.inf
    inside = min(x - cell * width[axis], (cell + 1) * width[axis] - x) > doubt
    return inside and (0 < cell < shape[axis] - 1 or period[axis] == np.inf)


@jit
def look_at_settled(trial, trials, doubt, width, period, shape, firsts, settled):
    """Return 1 if a settled sphere covers a trial, -1 if none does, 0 if exact places have to decide."""
    x, y, z, radius = trials[trial, 0], trials[trial, 1], trials[trial, 2], trials[trial, 3]
    a, b = cell_along(0, x, width, shape), cell_along(1, y, width, shape)
    c = cell_along(2, z, width, shape)
    near_a = 1 if x - a * width[0] > 0.5 * width[0] else -1
    near_b = 1 if y - b * width[1] > 0.5 * width[1] else -1
    begin, end = max(c - 1, 0), min(c + 2, shape[2])
    nearest = np.float32(np.inf)
    for k in range(9):
        row_a, row_b = a + ROWS[k, 0] * near_a, b + ROWS[k, 1] * near_b
        if row_a < 0 or row_b < 0 or row_a >= shape[0] or row_b >= shape[1]:
            continue
        row = (row_a * shape[1] + row_b) * shape[2]
        for j in range(firsts[row + begin], firsts[row + end]):
            dx, dy, dz = x - settled[j, 0], y - settled[j, 1], z - settled[j, 2]
            contact = radius + settled[j, 3]
            gap = dx * dx + dy * dy + dz * dz - contact * contact
            if gap < 0.0:
                return 1
            nearest = min(nearest, gap)
    around = is_all_around(0, x, a, doubt, width, period, shape)
    around = around and is_all_around(1, y, b, doubt, width, period, shape)
    around = around and is_all_around(2, z, c, doubt, width, period, shape)
    return -1 if around and nearest > doubt else 0


@jit
def by_columns(places, radii, covered, unit, edges, shape):
    """Sort trials that are not covered yet by columns of cells along the last axis.

    Return their order, and places and radii as `settled` has them.
    """
    dim = places.shape[1]
    column = np.empty(len(places), np.int32)
    begins = np.zeros(shape[0] * shape[1] + 1, np.int32)
    for i in range(len(places)):
        column[i] = cell_along(0, places[i, 0], edges, shape) * shape[1]
        column[i] += cell_along(1, places[i, 1], edges, shape)
        begins[column[i] + 1] += not covered[i]
    for k in range(1, len(begins)):
        begins[k] += begins[k - 1]
    order, trials = np.empty(begins[-1], np.int32), np.zeros((begins[-1], 4), np.float32)
    for i in range(len(places)):
        if covered[i]:
            continue
        k = begins[column[i]]
        begins[column[i]] = k + 1
        order[k] = i
        for axis in range(dim):
            trials[k, axis] = places[i, axis] * unit
        trials[k, 3] = radii[i % len(radii)] * unit
    return order, trials


@entry_point
def insert(
    places,
    radii,
    covered,
    half,
    ahead,
    largest,
    rounding,
    edges,
    period,
    shape,
    firsts,
    settled,
    heads,
    nexts,
    placed,
    n_placed,
    stays,
):
    """Find the trials that placed spheres cover, and place those of the others that do not overlap.

    Trials are those of len(radii) particles in turn, several times. Of each particle the first that no placed
    sphere covers counts, and stays if it overlaps none that stayed before it.

    Parameters
    ----------
    places : (T, d) array
        Places.
    radii : (W,) array
        Radii of the particles.
    covered : (T,) bool array
        Trials that need no look; all that are covered are marked.
    half : (3,) array
        Half the edges of voxels, where touching counts as covered; 0 for spheres, where it does not.
    ahead : bool
        Whether all trials are looked at, in the order of memory, and not only those that may count.
    largest, rounding : float
        Largest radius among placed spheres; more than single precision loses of a distance in the box.
    edges, period, shape : (3,) array
        Edges of a cell, of a periodic box (infinity between walls), and the number of cells.
    firsts, settled : array
        What `settle` returns; both empty if it was not called.
    heads, nexts, placed : array
        The cells and lists, and the spheres in them, places and radii, (N, 4); they are added to.
    n_placed : int
        How many there are.
    stays : (W,) int array
        Takes the trials that stayed; none are wanted where it is empty.

    Returns
    -------
    free, n_placed : int
        How many trials no sphere placed before covers, if all are looked at; how many spheres there are now.
    """
    cells, squares = np.empty((3, 3), np.int64), np.empty((3, 3))
    dim, touching, oldest = places.shape[1], half[0] > 0.0, n_placed
    if ahead and n_placed > 0:
        unit = 0.5 / largest
        width = (edges * unit).astype(np.float32)
        order, trials = by_columns(places, radii, covered, unit, edges, shape)
        doubt = np.float32(8.0 * rounding * unit)  # of squared distances up to about 1
        found = np.zeros(len(order), np.int8)
        for k in range(len(order) if len(settled) else 0):
            found[k] = look_at_settled(k, trials, doubt, width, period, shape, firsts, settled)
        for k in range(len(order)):
            i = order[k]
            z = places[i, 2] if dim == 3 else 0.0
            covered[i] = found[k] > 0 or is_covered(
                places[i, 0], places[i, 1], z, radii[i % len(radii)], half, touching, largest, edges, period,
                shape, heads, nexts, placed, len(settled) if found[k] < 0 else 0, oldest, cells, squares,
            )  # fmt: skip
    free, particle = 0, -1
    decided = np.zeros(len(stays), np.bool_)
    for i in range(len(places) if len(stays) else 0):
        particle = particle + 1 if particle + 1 < len(stays) else 0
        if covered[i]:
            continue
        free += 1
        if decided[particle]:
            continue
        z = places[i, 2] if dim == 3 else 0.0
        overlaps = False
        for new in range(1 if ahead else 0, 2):
            overlaps = is_covered(
                places[i, 0], places[i, 1], z, radii[particle], half, False, largest, edges, period, shape,
                heads, nexts, placed, oldest if new else 0, len(placed) if new else oldest, cells, squares,
            )  # fmt: skip
            decided[particle] = new or not overlaps
            if overlaps:
                break
        if overlaps:
            continue
        cell = 0
        placed[n_placed, 2] = 0.0
        for axis in range(dim):
            cell = cell * shape[axis] + cell_along(axis, places[i, axis], edges, shape)
            placed[n_placed, axis] = places[i, axis]
        placed[n_placed, 3] = radii[particle]
        nexts[n_placed] = heads[cell]
        heads[cell] = n_placed
        stays[n_placed - oldest] = i
        n_placed += 1
    return free, n_placed


@entry_point
def map_room(covered, low, edges, half, radius, period, placed, n_placed):
    """Mark all voxels that placed spheres cover.

    Parameters
    ----------
    covered : (V0, V1, V2) bool array
        The voxels, which divide a part of the box; what is covered is marked.
    low, edges, half : (3,) array
        First corner, edges of a voxel, and half of these.
    radius : float
        Least radius of trials.
    period, placed, n_placed
        As in `insert`.
    """
    first, end = np.empty(3, np.int64), np.empty(3, np.int64)
    for j in range(n_placed):
        contact = radius + placed[j, 3]
        for axis in range(3):
            first[axis], end[axis] = 0, 1
            if covered.shape[axis] == 1:  # perhaps without an extent
                continue
            reach = (contact - half[axis]) / edges[axis] + 1e-6
            middle = (placed[j, axis] - low[axis]) / edges[axis] - 0.5
            first[axis], end[axis] = np.ceil(middle - reach), np.floor(middle + reach) + 1
            if period[axis] == np.inf:
                first[axis], end[axis] = max(first[axis], 0), min(end[axis], covered.shape[axis])
            else:
                end[axis] = min(end[axis], first[axis] + covered.shape[axis])
        for a in range(first[0], end[0]):
            a = a % covered.shape[0]
            dx = reach_along(0, low[0] + (a + 0.5) * edges[0], placed[j, 0], half, period)
            for b in range(first[1], end[1]):
                b = b % covered.shape[1]
                dy = reach_along(1, low[1] + (b + 0.5) * edges[1], placed[j, 1], half, period)
                for c in range(first[2], end[2]):
                    c = c % covered.shape[2]
                    dz = reach_along(2, low[2] + (c + 0.5) * edges[2], placed[j, 2], half, period)
                    if np.sqrt((dx * dx + dy * dy) + dz * dz) <= contact:
                        covered[a, b, c] = True
