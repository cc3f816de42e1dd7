"""Random sequential placement: spheres put down one after another wherever they still fit, up to saturation.

A particle takes the first random place where it overlaps nothing (random sequential addition; Widom 1966, doi
10.1063/1.1726548). Large particles go first. When fewer than one trial in ten succeeds, the box is divided
into voxels, those that are certainly covered (no centre fits anywhere inside) are dropped, and trials are
restricted to the rest, which changes no probability; voxels are halved again whenever successes become rare.
With no voxel left there is no space left: the placement has provably jammed (Zhang, Torquato 2013, doi
10.1103/PhysRevE.88.053312).
"""

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from hardspheres.cells import CellGrid, distances, size_classes
from hardspheres.errors import SceneError
from hardspheres.scene import sphere_volume

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

FEWEST_TRIALS = 4096  # in one round, to amortise its overhead
RARE = 0.1  # fraction of successful trials below which the free space is mapped
MOST_VOXELS = 8_000_000
VOXELS_AT_ONCE = 1 << 15  # keeps the working arrays within the processor's cache
MOST_IDLE_ROUNDS = 100  # without one success, when voxels can be divided no further


def place_at_random(radii: Floats, box: Floats, periodic: Bools, rng: np.random.Generator) -> Floats:
    """Place spheres at random without overlap.

    Parameters
    ----------
    radii : (N,) array
        Radii in any order.
    box : (d,) array
        Edge lengths.
    periodic : (d,) bool array
        Periodic axes; on the others spheres stay a radius inside.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    (N, d) array
        Centres.

    Raises
    ------
    SceneError
        When no room is left, with the packing fraction reached.
    """
    positions = np.empty((len(radii), len(box)))
    is_placed = np.zeros(len(radii), dtype=np.bool_)
    placed: list[Ints] = []  # particles by octaves of their radii
    for members in size_classes(radii):
        placed.append(members[:0])
        room = _Room(float(radii[members].min()), box, periodic)
        waiting = members[np.argsort(-radii[members], kind="stable")]
        idle = tried = 0
        while len(waiting):
            trials = np.resize(waiting, max(len(waiting), FEWEST_TRIALS, sum(map(len, placed)) // 4))
            places = room.draw(rng, len(trials))
            free = np.flatnonzero(_inside(places, radii[trials], box, periodic))
            for old in filter(len, placed):
                grid = CellGrid(positions[old], box, periodic, 2 * float(radii[old].max()))
                free = free[_unhit(grid, radii[old], places[free], radii[trials[free]])]
            tried += len(trials)
            rare = len(free) < RARE * len(trials) and tried > room.cost_of_shrinking
            _, first = np.unique(trials[free], return_index=True)
            free = free[np.sort(first)]  # one success for each particle
            stay = free[_first_come(places[free], radii[trials[free]], box, periodic)]
            positions[trials[stay]] = places[stay]
            placed[-1] = np.concatenate([placed[-1], trials[stay]])
            is_placed[trials[stay]] = True
            waiting = waiting[~is_placed[waiting]]
            idle = 0 if len(stay) else idle + 1
            if rare and len(waiting):
                tried = 0
                room.shrink([(positions[old], radii[old]) for old in filter(len, placed)])
            if len(waiting) and (room.is_full or idle >= MOST_IDLE_ROUNDS):
                raise _jammed(radii, np.concatenate(placed), box)
    return positions


class _Room:
    """The part of the box where a centre may still fit: first the whole box, later a list of equal voxels."""

    def __init__(self, radius: float, box: Floats, periodic: Bools) -> None:
        self.radius, self.box, self.periodic = radius, box, periodic
        self.low = np.where(periodic, 0.0, radius)
        self.extent = box - 2 * self.low
        self.edges = self.extent
        self.voxels = np.zeros((1, len(box)), dtype=np.int64)  # corners, in units of the edges
        self.mapped = False

    @property
    def cost_of_shrinking(self) -> int:
        """Work of dividing the voxels, in trials: about one for each new voxel."""
        return len(self.voxels) * 2 ** len(self.box) if self.mapped else math.prod(self._counts().tolist())

    def _counts(self) -> Ints:
        """Voxels along each axis at first: about a radius wide, but not more than the most."""
        widest = math.prod(self.extent.tolist()) / MOST_VOXELS
        edge = max(self.radius, widest ** (1 / len(self.box)))
        counts: Ints = np.maximum(np.ceil(self.extent / edge), 1).astype(np.int64)
        return counts

    @property
    def is_full(self) -> bool:
        """Whether no voxel is left."""
        return len(self.voxels) == 0

    def draw(self, rng: np.random.Generator, n: int) -> Floats:
        """Return n positions, uniform over the free space."""
        inside = rng.random((n, len(self.box)))
        if self.mapped:
            inside += self.voxels[rng.integers(len(self.voxels), size=n)]
        places: Floats = np.minimum(self.low + inside * self.edges, np.nextafter(self.low + self.extent, 0.0))
        return places

    def shrink(self, placed: list[tuple[Floats, Floats]]) -> None:
        """Divide the voxels and drop those where no centre fits beside the placed (centres, radii)."""
        dim = len(self.box)
        if not self.mapped:
            counts = self._counts()
            self.mapped = True
            self.voxels = np.stack(
                [axis.ravel() for axis in np.meshgrid(*map(np.arange, counts), indexing="ij")], axis=1
            )
            self.edges = self.extent / counts
        elif len(self.voxels) * 2**dim <= MOST_VOXELS:
            halves = np.array(list(itertools.product((0, 1), repeat=dim)))
            self.voxels = (2 * self.voxels[:, None, :] + halves).reshape(-1, dim)
            self.edges = self.edges / 2
        else:
            return
        for points, radii in placed:
            grid = CellGrid(points, self.box, self.periodic, float(radii.max()) + self.radius)
            parts = range(0, len(self.voxels), VOXELS_AT_ONCE)
            open_ = [self._uncovered(self.voxels[k : k + VOXELS_AT_ONCE], grid, radii) for k in parts]
            self.voxels = np.concatenate([self.voxels[:0], *open_])

    def _uncovered(self, voxels: Ints, grid: CellGrid, radii: Floats) -> Ints:
        """Return the voxels in which a centre may fit beside the spheres of the grid, of these radii."""
        centres = self.low + (voxels + 0.5) * self.edges
        cells = grid.coordinates(centres)
        for offset in grid.offsets:
            covered = np.zeros(len(voxels), dtype=np.bool_)
            for i, j in grid.pairs_with(cells, offset):
                reach = _farthest_corner(centres, grid.points, i, j, self.edges, self.box, self.periodic)
                covered[i[reach <= radii[j] + self.radius]] = True
            left = np.flatnonzero(~covered)
            voxels, centres, cells = voxels[left], centres[left], cells[:, left]
        return voxels


def _farthest_corner(
    centres: Floats, points: Floats, i: Ints, j: Ints, edges: Floats, box: Floats, periodic: Bools
) -> Floats:
    """Distances from points[j] to the farthest corner of the voxel around centres[i]."""
    square = np.zeros(len(i))
    for axis in range(len(box)):
        step = np.abs(centres[i, axis] - points[j, axis])
        if periodic[axis]:
            np.minimum(step, np.abs(box[axis] - step), out=step)
        step += 0.5 * edges[axis]
        step *= step
        square += step
    return np.sqrt(square)


def _inside(places: Floats, radii: Floats, box: Floats, periodic: Bools) -> Bools:
    """Which of these spheres lie within all walls."""
    room = (places >= radii[:, None]) & (places <= box - radii[:, None])
    inside: Bools = np.all(room | periodic, axis=1)
    return inside


def _unhit(grid: CellGrid, old: Floats, places: Floats, radii: Floats) -> Ints:
    """Which of the spheres at these places overlap no sphere of the grid, whose radii are `old`."""
    cells = grid.coordinates(places)
    home = grid.by_cells(cells)
    places, radii, cells = places[home], radii[home], cells[:, home]
    for offset in grid.offsets:
        hit = np.zeros(len(home), dtype=np.bool_)
        for i, j in grid.pairs_with(cells, offset):
            hit[i[distances(places, grid.points, i, j, grid.box, grid.periodic) < radii[i] + old[j]]] = True
        free = np.flatnonzero(~hit)
        home, places, radii, cells = home[free], places[free], radii[free], cells[:, free]
    return np.sort(home)


def _first_come(places: Floats, radii: Floats, box: Floats, periodic: Bools) -> Bools:
    """Which spheres stay when each must not overlap any that stayed before it, in the order given.

    All spheres without an overlap to an earlier one still undecided stay at once, and remove those they
    overlap, until all are decided: the same answer as one by one, in a few rounds.
    """
    stays = np.ones(len(places), dtype=np.bool_)
    if not len(places):
        return stays
    early, late = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for i, j in CellGrid(places, box, periodic, 2 * float(radii.max())).pairs():
        close = distances(places, places, i, j, box, periodic) < radii[i] + radii[j]
        early.append(np.minimum(i, j)[close])
        late.append(np.maximum(i, j)[close])
    first, second = np.concatenate(early), np.concatenate(late)
    while len(first):
        waiting = np.zeros(len(places), dtype=np.bool_)
        waiting[second] = True
        stays[second[~waiting[first]]] = False
        open_ = waiting[first] & stays[first] & stays[second]
        first, second = first[open_], second[open_]
    return stays


def _jammed(radii: Floats, placed: Ints, box: Floats) -> SceneError:
    reached = float(np.sum(sphere_volume(radii[placed], len(box)))) / float(np.prod(box))
    return SceneError(
        f"random placement jammed at packing fraction {reached:.4f}, with {len(placed)} of {len(radii)} "
        "particles placed; ask for less than that, or start from lattice_gas"
    )
