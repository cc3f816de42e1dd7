"""Random sequential placement: spheres put down one after another wherever they still fit, up to saturation.

A particle takes the first random place where it overlaps nothing (random sequential addition; Widom 1966, doi
10.1063/1.1726548). Large particles go first. When fewer than one trial in ten succeeds, the box is divided
into voxels, those that are certainly covered (no centre fits anywhere inside) are dropped, and trials are
restricted to the rest, which changes no probability; voxels are halved again whenever successes become rare.
With no voxel left there is no space left: the placement has provably jammed (Zhang, Torquato 2013, doi
10.1103/PhysRevE.88.053312).

Random numbers are drawn here, round by round; `hardspheres.insertion` decides about them, compiled.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.cells import size_classes
from hardspheres.errors import SceneError
from hardspheres.scene import sphere_volume

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

MOST_CELLS = 2.0  # for each sphere
FEWEST_TRIALS = 4096  # in one round, to amortise its overhead
RARE = 0.1  # fraction of successful trials below which the free space is mapped
MOST_VOXELS = 8_000_000
VOXELS_AT_ONCE = 1 << 15  # keeps the working arrays within the processor's cache
FEW = 10_000  # spheres that a core's cache holds: trials among them need no order
SINGLE = 1e-6  # of a length: more than single precision loses of it
SETTLED = 1.1  # times as many as at the last time are sorted by cells anew
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
    placed: list[_Placed] = []  # by octaves of the radii
    for members in size_classes(radii):
        placed.append(_Placed(radii[members], box, periodic))
        room = _Room(float(radii[members].min()), box, periodic)
        waiting = members[np.argsort(-radii[members], kind="stable")]
        idle = tried = 0
        while len(waiting):
            places = room.draw(rng, max(len(waiting), FEWEST_TRIALS, sum(map(len, placed)) // 4))
            tried += len(places)
            sizes = radii[waiting]
            covered = _beyond_walls(places, sizes, box, periodic)
            for larger in placed[:-1]:
                larger.cover(covered, places, sizes)
            counted = tried > room.cost_of_shrinking
            free, stay = placed[-1].add(covered, places, sizes, counted)
            stayed = waiting[stay % len(waiting)]
            positions[stayed] = places[stay]
            is_placed[stayed] = True
            waiting = waiting[~is_placed[waiting]]
            idle = 0 if len(stay) else idle + 1
            if counted and free < RARE * len(places) and len(waiting):
                tried = 0
                room.shrink(placed)
            if len(waiting) and (room.is_full or idle >= MOST_IDLE_ROUNDS):
                raise _jammed(radii, np.flatnonzero(is_placed), box)
    return positions


class _Placed:
    """Spheres placed so far, of one octave of radii, in the cells of `hardspheres.insertion`."""

    def __init__(self, radii: Floats, box: Floats, periodic: Bools) -> None:
        self._largest, self._rounding = float(radii.max()), SINGLE * float(box.max())
        self._can_settle = bool(radii.min() > 10.0 * self._rounding)
        widest = math.prod(box.tolist()) / (MOST_CELLS * len(radii))
        cells = np.maximum(np.floor(box / max(2.0 * self._largest, widest ** (1 / len(box)))), 1)
        self._shape = _three(cells, 1).astype(np.int64)
        self._edges = _three(box / cells, 1.0)
        self._period = _three(np.where(periodic, box, math.inf), math.inf)
        self._firsts, self._settled = np.empty(0, dtype=np.int32), np.empty((0, 4), dtype=np.float32)
        self._heads = np.full(math.prod(self._shape.tolist()), -1, dtype=np.int32)
        self._nexts = np.empty(len(radii), dtype=np.int32)
        self._spheres = np.empty((len(radii), 4))
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def cover(self, covered: Bools, places: Floats, radii: Floats, edges: Floats | None = None) -> None:
        """Mark which spheres overlap one that is placed; or fit nowhere in voxels of these edges.

        They are those of all particles, whose radii are given, in turn.
        """
        self._insert(covered, places, radii, edges, True, 0)

    def cover_all(self, covered: Bools, low: Floats, edges: Floats, radius: float) -> None:
        """Mark which voxels of a grid that begins at `low` have no room for a sphere."""
        low, edges, half = _three(low, -0.5), _three(edges, 1.0), _three(0.5 * edges, 0.0)
        covered = covered.reshape((*covered.shape, 1)[:3])
        _compiled().map_room(covered, low, edges, half, radius, self._period, self._spheres, self._n)

    def add(self, covered: Bools, places: Floats, radii: Floats, counted: bool) -> tuple[int, Ints]:
        """Place what is not covered and does not overlap; return how many were not covered, and which stay.

        Trials are those of all waiting particles in turn. The first of each that is not covered counts. How
        many are not covered is right only where they are to be counted.
        """
        ahead = counted or self._n > FEW
        return self._insert(covered, places, radii, None, ahead, len(radii))

    def _insert(
        self, covered: Bools, places: Floats, radii: Floats, edges: Floats | None, ahead: bool, waiting: int
    ) -> tuple[int, Ints]:
        half = np.zeros(3) if edges is None else _three(0.5 * edges, 0.0)
        if ahead and self._can_settle and self._n > max(SETTLED * len(self._settled), FEW):
            self._firsts, self._settled = _compiled().settle(
                self._heads, self._nexts, self._spheres, self._n, self._largest, self._rounding
            )
        settled = self._settled if edges is None else self._settled[:0]
        stay, before = np.empty(waiting, dtype=np.int64), self._n
        free, self._n = _compiled().insert(
            places, radii, covered, half, ahead, self._largest, self._rounding, self._edges, self._period,
            self._shape, self._firsts, settled, self._heads, self._nexts, self._spheres, before, stay,
        )  # fmt: skip
        return free, stay[: self._n - before]


def _three(values: Floats, other: float) -> Floats:
    """Return one value for each of three axes: these, and another for those that are missing."""
    return np.append(values, np.full(3 - len(values), other))


@functools.cache
def _compiled() -> Any:
    """Return the compiled part, which is loaded, or compiled, on first use."""
    from hardspheres.kernel_cache import cache_folder, cached_in

    with cached_in(cache_folder("insertion")):
        from hardspheres import insertion
    return insertion


class _Room:
    """The part of the box where a centre may still fit: first the whole box, later a list of equal voxels."""

    def __init__(self, radius: float, box: Floats, periodic: Bools) -> None:
        self.radius, self.box, self.periodic = radius, box, periodic
        self.low = np.where(periodic, 0.0, radius)
        self.extent = box - 2 * self.low
        self.edges = self.extent
        self.voxels = np.zeros((1, len(box)))  # corners, in units of the edges: whole numbers
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
        places = rng.random((n, len(self.box)))
        if self.mapped:
            places += self.voxels.take(rng.integers(len(self.voxels), size=n), axis=0)
        places *= self.edges
        places += self.low
        np.minimum(places, np.nextafter(self.low + self.extent, 0.0), out=places)
        return places

    def shrink(self, placed: Sequence["_Placed"]) -> None:
        """Divide the voxels and drop those where no centre fits beside the spheres that are placed."""
        if not self.mapped:
            self._map(placed)
        elif len(self.voxels) * 2 ** len(self.box) <= MOST_VOXELS:
            self._halve(placed)

    def _map(self, placed: Sequence["_Placed"]) -> None:
        """Divide the whole box."""
        counts = self._counts()
        self.mapped, self.edges = True, self.extent / counts
        covered = np.zeros(counts, dtype=np.bool_)
        for spheres in placed:
            spheres.cover_all(covered, self.low, self.edges, self.radius)
        covered, small = covered.ravel(), np.min_scalar_type(int(counts.max()))
        parts = []
        for k in range(0, len(covered), VOXELS_AT_ONCE):
            numbers = np.flatnonzero(~covered[k : k + VOXELS_AT_ONCE]) + k
            parts.append(np.stack(np.unravel_index(numbers, counts), axis=1).astype(small))
        self.voxels = np.concatenate(parts)

    def _halve(self, placed: Sequence["_Placed"]) -> None:
        """Divide each voxel along all axes."""
        dim = len(self.box)
        self.edges = self.edges / 2
        halves, step = np.array(list(itertools.product((0.0, 1.0), repeat=dim))), VOXELS_AT_ONCE >> dim
        parts = [self.voxels[:0].astype(np.float64)]
        for k in range(0, len(self.voxels), step):
            voxels = (2.0 * self.voxels[k : k + step, None, :] + halves).reshape(-1, dim)
            centres = self.low + (voxels + 0.5) * self.edges
            covered = np.zeros(len(voxels), dtype=np.bool_)
            for spheres in placed:
                spheres.cover(covered, centres, np.array([self.radius]), self.edges)
            parts.append(voxels[~covered])
        self.voxels = np.concatenate(parts)


def _beyond_walls(places: Floats, radii: Floats, box: Floats, periodic: Bools) -> Bools:
    """Which spheres at these places, of all radii in turn, reach beyond a wall."""
    beyond = np.zeros(len(places), dtype=np.bool_)
    if not periodic.all():
        sizes = radii[np.arange(len(places)) % len(radii)]
        for axis in np.flatnonzero(~periodic):
            beyond |= (places[:, axis] < sizes) | (places[:, axis] > box[axis] - sizes)
    return beyond


def _jammed(radii: Floats, placed: Ints, box: Floats) -> SceneError:
    reached = float(np.sum(sphere_volume(radii[placed], len(box)))) / float(np.prod(box))
    return SceneError(
        f"random placement jammed at packing fraction {reached:.4f}, with {len(placed)} of {len(radii)} "
        "particles placed; ask for less than that, or start from lattice_gas"
    )
