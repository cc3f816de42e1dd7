"""Trial insertions of spheres among those placed before, compiled; `hardspheres.placement` says what for.

A trial is a sphere with its centre at one place, or anywhere in a voxel around that place. It is covered if
even the farthest corner of its voxel is nearer to the centre of a placed sphere than the sum of both radii.

Placed spheres lie in cells no narrower than the largest contact distance. `heads` has the last sphere of each
cell, `nexts` the one placed there before it, so that numbers fall along a list, to -1 at its end. Where fewer
than three axes have an extent, the others have one cell.
"""

import numpy as np

from hardspheres.kernel.simd.jit import entry_point, jit

__all__ = ["insert"]

R = 3  # column of the radius in rows of spheres; the place is in those before it
SLACK = 1.0 + 1e-6  # of squared distances to cells, so that no rounding skips one that matters


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
def is_covered(
    trial, trials, half, touching, largest, edges, period, shape, heads, nexts, placed, oldest, cells, squares
):
    """Whether a sphere placed as number `oldest` or later covers a trial."""
    radius = trials[trial, R]
    for axis in range(3):
        three_cells(axis, trials[trial, axis], half[axis], edges, period, shape, cells, squares)
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
                    reach = 0.0
                    for axis in range(3):
                        step = abs(trials[trial, axis] - placed[j, axis])
                        step = min(step, abs(period[axis] - step)) + half[axis]
                        reach += step * step
                    reach = np.sqrt(reach)
                    contact = radius + placed[j, R]
                    if reach < contact or (touching and reach == contact):
                        return True
                    j = nexts[j]
    return False


@jit
def by_columns(trials, edges, shape):
    """Sort trials by columns of cells along the last axis; return their order too."""
    n = len(trials)
    column = np.empty(n, np.int32)
    begins = np.zeros(shape[0] * shape[1] + 1, np.int32)
    for i in range(n):
        column[i] = cell_along(0, trials[i, 0], edges, shape) * shape[1]
        column[i] += cell_along(1, trials[i, 1], edges, shape)
        begins[column[i] + 1] += 1
    for k in range(1, len(begins)):
        begins[k] += begins[k - 1]
    order, found = np.empty(n, np.int32), np.empty_like(trials)
    for i in range(n):
        k = begins[column[i]]
        begins[column[i]] = k + 1
        order[k] = i
        for axis in range(R + 1):
            found[k, axis] = trials[i, axis]
    return order, found


@entry_point
def insert(
    trials,
    covered,
    half,
    touching,
    largest,
    edges,
    period,
    shape,
    heads,
    nexts,
    placed,
    n_placed,
    stays,
):
    """Find the trials that placed spheres cover, and place those of the others that do not overlap.

    Trials are those of len(stays) particles in turn, several times. Of each particle the first that no placed
    sphere covers counts, and stays if it overlaps none that stayed before it.

    Parameters
    ----------
    trials : (T, 4) array
        Places and radii.
    covered : (T,) bool array
        Trials that need no look; all that are covered are marked.
    half : (3,) array
        Half the edges of voxels.
    touching : bool
        Whether touching counts as covered.
    largest : float
        Largest radius among placed spheres.
    edges, period, shape : (3,) array
        Edges of a cell, of a periodic box (infinity between walls), and the number of cells.
    heads, nexts, placed : array
        The cells and lists, and the spheres in them, (N, 4) as trials; they are added to.
    n_placed : int
        How many there are.
    stays : (W,) int array
        Takes the trials that stayed; none are wanted where it is empty.

    Returns
    -------
    free, n_placed : int
        How many trials no sphere placed before covers, and how many spheres there are now.
    """
    cells, squares = np.empty((3, 3), np.int64), np.empty((3, 3))
    order, trials_in_order = by_columns(trials, edges, shape)
    for k in range(len(order)):
        if not covered[order[k]]:
            covered[order[k]] = is_covered(
                k, trials_in_order, half, touching, largest, edges, period, shape, heads, nexts, placed, 0,
                cells, squares,
            )  # fmt: skip
    free, oldest, particle = 0, n_placed, -1
    decided = np.zeros(len(stays), np.bool_)
    for i in range(len(trials) if len(stays) else 0):
        particle = particle + 1 if particle + 1 < len(stays) else 0
        if covered[i]:
            continue
        free += 1
        if decided[particle]:
            continue
        decided[particle] = True
        if is_covered(
            i,
            trials,
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
            cells,
            squares,
        ):
            continue
        cell = 0
        for axis in range(3):
            cell = cell * shape[axis] + cell_along(axis, trials[i, axis], edges, shape)
            placed[n_placed, axis] = trials[i, axis]
        placed[n_placed, R] = trials[i, R]
        nexts[n_placed] = heads[cell]
        heads[cell] = n_placed
        stays[n_placed - oldest] = i
        n_placed += 1
    return free, n_placed
