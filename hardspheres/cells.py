"""Pairs of near points by a cell grid in NumPy, for checks and placements outside the event loop.

Cells are never smaller than the cutoff, so every pair closer than it lies in the same or in touching cells.
Only occupied cells are stored (found through a table, or by bisection where the box is mostly empty), so cost
and memory grow with the particles and not with the box.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CELL_BITS = 62  # of the number of a cell, shared by the axes
PAIRS_AT_ONCE = 1 << 18  # keeps the working arrays within the processor's cache
MOST_EMPTY, MOST_AT_LEAST = 8, 1 << 20  # cells for each particle, or in all, of which a table is kept
MOST_PAIRS = 2e8  # more than these occur only if particles are piled on one another


class CellGrid:
    """Points sorted into cells that are at least `cutoff` wide.

    Parameters
    ----------
    points : (N, d) array
        Positions inside the box, lengths in any unit.
    box : (d,) array
        Edge lengths.
    periodic : (d,) bool array
        Axes that wrap around.
    cutoff : float
        Pairs closer than this are found.
    """

    def __init__(self, points: Floats, box: Floats, periodic: Bools, cutoff: float) -> None:
        self.box = box
        self.periodic = periodic
        cells = np.floor(np.minimum(box / cutoff, 2 ** (CELL_BITS // len(box)))).astype(np.int64)
        self.shape = np.maximum(cells, 1)
        self._total = math.prod(self.shape.tolist())
        coordinates = self.coordinates(points)
        numbers = self._numbers(coordinates, (0,) * len(box))
        self.order = np.argsort(numbers, kind="stable")
        self._coordinates = coordinates[:, self.order]
        numbers = numbers[self.order]
        begins = np.flatnonzero(np.diff(numbers, prepend=-1))
        self.cells = numbers[begins]
        # One extra cell without points represents all empty ones.
        self._first = np.append(begins, 0)
        self._count = np.append(np.diff(np.append(begins, len(points))), 0)
        self.points = points
        self._table: NDArray[np.int32] | None = (
            None  # from the number of a cell to its place among the occupied
        )
        if self._total <= max(MOST_EMPTY * len(points), MOST_AT_LEAST):
            self._table = np.full(self._total + 1, len(begins), dtype=np.int32)
            self._table[self.cells] = np.arange(len(begins))

    @property
    def occupancy(self) -> Ints:
        """Points in each occupied cell."""
        return self._count[:-1]

    def coordinates(self, points: Floats) -> Ints:
        """Return the cells of points, shape (d, number of points): an index for each axis."""
        found = np.empty(points.shape[::-1], dtype=np.int64)
        for axis, density in enumerate(self.shape / self.box):
            np.clip((points[:, axis] * density).astype(np.int64), 0, self.shape[axis] - 1, out=found[axis])
        return found

    def by_cells(self, coordinates: Ints) -> Ints:
        """Return an order of the points in which neighbours in space are near in memory."""
        return np.argsort(self._numbers(coordinates, (0,) * len(self.box)))

    def members(self, cell: int) -> Ints:
        """Return the indices of the points in the `cell`-th occupied cell, ascending."""
        first = self._first[cell]
        return self.order[first : first + self._count[cell]]

    def pairs_with(self, coordinates: Ints, offset: tuple[int, ...]) -> Iterator[tuple[Ints, Ints]]:
        """Yield, in batches, pairs (index into the cells given, index of a point in the cell at this offset).

        Over all of `offsets` every near pair comes, twice where a periodic axis has fewer than three cells.
        """
        for i, slot in _expand(*self._look_up(self._numbers(coordinates, offset))):
            yield i, self.order[slot]

    @property
    def offsets(self) -> list[tuple[int, ...]]:
        """Steps to the cell itself and to those that touch it, the nearest first."""
        steps = itertools.product((-1, 0, 1), repeat=len(self.box))
        return sorted(steps, key=lambda step: sum(map(abs, step)))

    def pairs(self) -> Iterator[tuple[Ints, Ints]]:
        """Yield, in batches, pairs of different points in the same or adjacent cells; some come twice."""
        place = np.arange(len(self.order))
        last = np.repeat((self._first + self._count)[:-1], self.occupancy)
        for i, slot in _expand(place + 1, last - place - 1):
            yield self.order[i], self.order[slot]
        dim, nothing = len(self.box), np.zeros(len(place), dtype=np.int64)
        parts = [
            {step: self._part(axis, index, step) for step in (-1, 0, 1)}
            for axis, index in enumerate(self._coordinates)
        ]
        for offset in itertools.product((-1, 0, 1), repeat=dim):
            if offset <= (0,) * dim:  # half of the neighbours: the other half is found from their side
                continue
            numbers = sum((part[step] for part, step in zip(parts, offset, strict=True)), start=nothing)
            for i, slot in _expand(*self._look_up(numbers)):
                if self.shape.min() < 3:  # a cell may be its own neighbour
                    i, slot = i[i != slot], slot[i != slot]
                yield self.order[i], self.order[slot]

    def _numbers(self, coordinates: Ints, offset: tuple[int, ...]) -> Ints:
        """Return the number of the cell at `offset` from each of those given, negative beyond a wall."""
        number = np.zeros(coordinates.shape[1], dtype=np.int64)
        for axis, step in enumerate(offset):
            number += self._part(axis, coordinates[axis], step)
        return number

    def _part(self, axis: int, index: Ints, step: int) -> Ints:
        """Return what an axis adds to the numbers of cells a step away; beyond a wall, minus all cells."""
        cells, factor = int(self.shape[axis]), math.prod(self.shape[axis + 1 :].tolist())
        part: Ints = (index + step) * factor
        if step:
            edge = index == (cells - 1 if step > 0 else 0)
            part[edge] = (cells - 1 if step < 0 else 0) * factor if self.periodic[axis] else -self._total
        return part

    def _look_up(self, number: Ints) -> tuple[Ints, Ints]:
        """First slot and number of points in cells of these numbers."""
        if self._table is not None:
            if not self.periodic.all():
                number[number < 0] = self._total
            cell: NDArray[np.integer[Any]] = self._table[number]
        else:
            cell = np.searchsorted(self.cells, number)
            cell[self.cells[np.minimum(cell, len(self.cells) - 1)] != number] = len(self.cells)
        return self._first[cell], self._count[cell]


def _expand(first: Ints, count: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Yield all (i, first[i] + k) with 0 <= k < count[i], in batches of about `PAIRS_AT_ONCE`."""
    keep = np.flatnonzero(count)
    ends = np.cumsum(count[keep])
    done = 0
    while done < len(keep):
        before = ends[done - 1] if done else 0
        stop = max(done + 1, int(np.searchsorted(ends, before + PAIRS_AT_ONCE, side="right")))
        some = keep[done:stop]
        number = count[some]
        i = np.repeat(some, number)
        starts = np.cumsum(number) - number
        yield i, np.arange(len(i)) + np.repeat(first[some] - starts, number)
        done = stop


def distances(a: Floats, b: Floats, i: Ints, j: Ints, box: Floats, periodic: Bools) -> Floats:
    """Return the distances between points a[i] and b[j], to the nearest image on periodic axes."""
    square = np.zeros(len(i))
    for axis in range(len(box)):
        step = np.abs(a[i, axis] - b[j, axis])
        if periodic[axis]:
            np.minimum(step, np.abs(box[axis] - step), out=step)
        step *= step
        square += step
    return np.sqrt(square)


def size_classes(radii: Floats) -> list[Ints]:
    """Group the particles by octaves of the radius, largest first: in one, radii differ at most twofold."""
    if radii.min() == radii.max():
        return [np.arange(len(radii))]
    octave = np.floor(np.log2(radii.max() / radii)).astype(np.int64)
    return [np.flatnonzero(octave == k) for k in np.unique(octave)]


def most_that_fit(edges: Floats, radius: float) -> int:
    """Bound the number of spheres of at least this radius whose centres fit in a cell with these edges."""
    dim = len(edges)
    one = math.pi ** (dim / 2) / math.gamma(dim / 2 + 1) * radius**dim
    return int(math.prod(edges + 2 * radius) / one) + 1


def worst_overlap(
    positions: Floats, radii: Floats, box: Floats, periodic: Bools, fixed: Bools | None = None
) -> tuple[int, int, float]:
    """Find the pair that overlaps most, in time and memory proportional to the number of particles.

    Parameters
    ----------
    positions : (N, d) array
        Centres, in [0, L) on periodic axes.
    radii : (N,) array
        Radii, all positive; any ratio of sizes (they are searched octave by octave).
    box : (d,) array
        Edges; a periodic one at least twice the largest diameter, so that the nearest image decides.
    periodic : (d,) bool array
        Axes that wrap around.
    fixed : (N,) bool array, optional
        Particles that may overlap each other, though nothing else.

    Returns
    -------
    i, j, depth : int, int, float
        The pair, i < j, and the sum of its radii less its distance: positive for an overlap. (0, 0, -inf)
        when no two particles are near. If too many particles are near one another for all pairs to be tried,
        the worst overlap among some of them.
    """
    worst = (0, 0, -math.inf)
    classes = size_classes(radii)
    if fixed is not None and fixed.any():
        kinds = (np.flatnonzero(~fixed), np.flatnonzero(fixed))
        classes = [kind[members] for kind in kinds if len(kind) for members in size_classes(radii[kind])]
        classes.sort(key=lambda members: -float(radii[members].max()))
    else:
        fixed = np.zeros(len(radii), dtype=np.bool_)
    grids = []
    for members in classes:
        sizes = radii[members]
        grid = CellGrid(positions[members], box, periodic, 2 * sizes.max())
        if fixed[members[0]]:
            grids.append(grid)
            continue
        if np.sum(grid.occupancy.astype(np.float64) ** 2) > MOST_PAIRS:
            limit = most_that_fit(box / grid.shape, float(sizes.min()))
            if grid.occupancy.max() > limit + 1:
                part = members[grid.members(int(np.argmax(grid.occupancy)))[: limit + 1]]
                a, b, depth = worst_overlap(positions[part], radii[part], box, periodic)
                return int(part[a]), int(part[b]), depth
        grids.append(grid)
        for i, j in grid.pairs():
            worst = _deeper(worst, members[i], members[j], positions, radii, box, periodic)
    for large, small in itertools.combinations(range(len(classes)), 2):
        if fixed[classes[large][0]] and fixed[classes[small][0]]:
            continue
        places = grids[large].coordinates(positions[classes[small]])
        for offset in grids[large].offsets:
            for i, j in grids[large].pairs_with(places, offset):
                worst = _deeper(worst, classes[small][i], classes[large][j], positions, radii, box, periodic)
    return worst


def _deeper(
    worst: tuple[int, int, float],
    i: Ints,
    j: Ints,
    positions: Floats,
    radii: Floats,
    box: Floats,
    periodic: Bools,
) -> tuple[int, int, float]:
    """Return the deeper of the worst overlap so far and the worst of these pairs; on a tie the first."""
    if not len(i):
        return worst
    depth = radii[i] + radii[j] - distances(positions, positions, i, j, box, periodic)
    deepest = int(np.argmax(depth))
    if depth[deepest] <= worst[2]:
        return worst
    a, b = int(i[deepest]), int(j[deepest])
    return min(a, b), max(a, b), float(depth[deepest])
