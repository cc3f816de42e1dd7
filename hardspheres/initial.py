"""Initial scenes: particles on a lattice or at random, with velocities drawn from the same seed."""

import itertools
import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres.checks import boundary_words, contact_tolerance, one_per_particle
from hardspheres.errors import SceneError
from hardspheres.memory import require_room_for
from hardspheres.placement import place_at_random
from hardspheres.scene import Scene, sphere_volume
from hardspheres.velocities import POSITIONS, Seed, draw_velocities, stream

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Planes = tuple[int, ...]


@dataclass(frozen=True)
class Lattice:
    """A lattice as the crossings of equidistant planes: all of them, or every second one as on a chessboard.

    Every second crossing of square planes is fcc in 3D, and the triangular lattice in 2D when planes are
    sqrt(3) times as far apart along y.
    """

    name: str
    every_second: bool
    proportions: tuple[float, ...]
    close_packing: float

    def sites(self, planes: Planes) -> int:
        """Count the lattice sites on this many planes along each axis."""
        crossings = math.prod(planes)
        return (crossings + 1) // 2 if self.every_second else crossings


LATTICES = {
    3: {
        "fcc": Lattice("fcc", True, (1.0, 1.0, 1.0), math.pi / math.sqrt(18)),
        "cubic": Lattice("cubic", False, (1.0, 1.0, 1.0), math.pi / 6),
    },
    2: {
        "triangular": Lattice("triangular", True, (1.0, math.sqrt(3)), math.pi / math.sqrt(12)),
        "square": Lattice("square", False, (1.0, 1.0), math.pi / 4),
    },
}


def lattice_gas(
    n: int = 4000,
    packing_fraction: float = 0.3,
    *,
    dim: int = 3,
    lattice: str | None = None,
    boundary: str | Sequence[str] = "periodic",
    velocities: str = "maxwell",
    temperature: float = 1.0,
    radii: ArrayLike = 0.5,
    masses: ArrayLike = 1.0,
    seed: Seed,
) -> Scene:
    """Make a gas whose particles start on a lattice.

    The volume of the box follows from the packing fraction of the particles themselves, exactly. The box is
    cubic, or square; only the triangular lattice in a periodic box takes the nearest rectangle into which it
    fits undistorted. Between walls the lattice is stretched to fill the box, with all particles a radius or
    more inside. Where the lattice has more sites than particles, vacancies are drawn at random; where
    particles differ in size or mass, they are assigned to the sites at random.

    Parameters
    ----------
    n : int
        Number of particles; any number >= 1.
    packing_fraction : float
        Volume of the particles over that of the box (areas in 2D).
    dim : int
        Dimension, 2 or 3.
    lattice : str, optional
        ``"fcc"`` (default) or ``"cubic"`` in 3D; ``"triangular"`` (default) or ``"square"`` in 2D.
    boundary : str or sequence of str
        ``"periodic"`` or ``"wall"``, for all axes or one word for each.
    velocities : str
        ``"maxwell"``, ``"equal-speeds"``, ``"two-temperatures"`` or ``"beams"``; see `draw_velocities`.
    temperature : float
        kT, in units of energy.
    radii, masses : float or (n,) array_like
        Radii and masses. Sites are as far apart as two of the largest spheres need.
    seed : int or numpy.random.SeedSequence
        Source of all random choices. Positions and velocities are drawn from independent streams: another
        choice of velocities leaves the positions as they are.

    Returns
    -------
    Scene
        The gas.

    Raises
    ------
    SceneError
        When an argument is not as above, or the lattice does not fit; the message gives the packing fraction
        that does.
    """
    n, dim, filled, sizes, weights = checked_arguments(n, packing_fraction, dim, radii, masses)
    kinds = LATTICES[dim]
    if lattice is not None and not (isinstance(lattice, str) and lattice in kinds):
        names = " or ".join(f'"{name}"' for name in kinds)
        raise SceneError(f"lattice is {lattice!r}; in {dim}D it must be {names}")
    chosen = kinds[lattice] if lattice is not None else next(iter(kinds.values()))
    words = boundary_words(boundary, dim)
    periodic = np.array([word == "periodic" for word in words])
    largest = float(sizes.max())
    if sizes.min() == largest and packing_fraction > chosen.close_packing * (1 + 1e-12):
        raise SceneError(
            f"packing fraction {packing_fraction} is above close packing of the {chosen.name} lattice, "
            f"{chosen.close_packing:.6f}; ask for less"
        )
    fit = _fit(chosen, n, filled / packing_fraction, periodic, largest)
    if fit is None:
        reach = _reachable(chosen, n, filled, packing_fraction, periodic, largest)
        advice = "ask for less" if sizes.min() == largest else "ask for less, or use random_gas"
        raise SceneError(
            f"n = {n} at packing fraction {packing_fraction} does not fit on the {chosen.name} lattice; with "
            f"this number of particles {reach:.6f} is the most, {advice}"
        )
    box, planes = fit
    rng = stream(seed, POSITIONS)
    sites = _sites(chosen, planes, box, periodic, largest)
    if len(sites) > n:
        sites = sites[np.sort(rng.choice(len(sites), n, replace=False))]
    if np.ptp(sizes) or np.ptp(weights):
        sites = sites[rng.permutation(n)]
    scene = Scene(sites, np.zeros_like(sites), sizes, weights, box, words)
    return with_velocities(scene, velocities, temperature, seed)


def random_gas(
    n: int = 4000,
    packing_fraction: float = 0.3,
    *,
    dim: int = 3,
    boundary: str | Sequence[str] = "periodic",
    velocities: str = "maxwell",
    temperature: float = 1.0,
    radii: ArrayLike = 0.5,
    masses: ArrayLike = 1.0,
    seed: Seed,
) -> Scene:
    """Make a gas whose particles are placed at random, one after another, wherever they still fit.

    Equal spheres jam at a packing fraction near 0.384 in 3D and 0.547 in 2D (Zhang, Torquato 2013,
    doi 10.1103/PhysRevE.88.053312); mixtures go higher. The box is a cube or square.

    Parameters
    ----------
    n : int
        Number of particles; any number >= 1.
    packing_fraction : float
        Volume of the particles over that of the box (areas in 2D).
    dim : int
        Dimension, 2 or 3.
    boundary : str or sequence of str
        ``"periodic"`` or ``"wall"``, for all axes or one word for each.
    velocities : str
        ``"maxwell"``, ``"equal-speeds"``, ``"two-temperatures"`` or ``"beams"``; see `draw_velocities`.
    temperature : float
        kT, in units of energy.
    radii, masses : float or (n,) array_like
        Radii and masses. Large particles are placed first.
    seed : int or numpy.random.SeedSequence
        Source of all random choices. Positions and velocities are drawn from independent streams: another
        choice of velocities leaves the positions as they are.

    Returns
    -------
    Scene
        The gas.

    Raises
    ------
    SceneError
        When an argument is not as above, or the placement jams; the message gives the packing fraction
        reached.
    """
    n, dim, filled, sizes, weights = checked_arguments(n, packing_fraction, dim, radii, masses)
    words = boundary_words(boundary, dim)
    periodic = np.array([word == "periodic" for word in words])
    box = cubic_box(n, packing_fraction, filled, sizes, periodic)
    positions = place_at_random(sizes, box, periodic, stream(seed, POSITIONS))
    scene = Scene.as_placed(positions, sizes, weights, box, words)
    return with_velocities(scene, velocities, temperature, seed)


def cubic_box(n: int, packing_fraction: float, filled: float, radii: Floats, periodic: Bools) -> Floats:
    """Return the edges of the cube or square that gives this total volume of particles this packing fraction.

    Raises
    ------
    SceneError
        Where equal spheres cannot be so dense, or the box is too short for the largest particle.
    """
    dim = len(periodic)
    densest = next(iter(LATTICES[dim].values()))
    if radii.min() == radii.max() and packing_fraction > densest.close_packing:
        raise SceneError(
            f"packing fraction {packing_fraction} is above close packing, {densest.close_packing:.6f}; ask "
            "for less"
        )
    box = np.full(dim, (filled / packing_fraction) ** (1 / dim))
    needed = 2 * float(radii.max()) * (2 if periodic.any() else 1)
    if box[0] < needed:
        raise SceneError(
            f"n = {n} at packing fraction {packing_fraction} gives a box of edge {box[0]:.6g}, too short for "
            f"the largest particle: it needs {needed:.6g}; ask for more particles or a lower packing fraction"
        )
    return box


def with_velocities(scene: Scene, velocities: str, temperature: float, seed: Seed) -> Scene:
    """Return the scene with velocities drawn from the seed."""
    drawn = draw_velocities(scene, velocities, temperature=temperature, seed=seed)
    return scene.with_state(scene.positions, drawn)


def checked_arguments(
    n: int, packing_fraction: float, dim: int, radii: ArrayLike, masses: ArrayLike
) -> tuple[int, int, float, Floats, Floats]:
    """Return n, dim, total volume of the particles, radii and masses; or raise SceneError."""
    try:
        if isinstance(n, bool):
            raise TypeError
        n = operator.index(n)
    except TypeError:
        raise SceneError(f"n is {n!r}; the number of particles is an integer >= 1") from None
    if n < 1:
        raise SceneError(f"n is {n}; a scene needs at least one particle")
    if not isinstance(dim, Integral) or dim not in (2, 3):
        raise SceneError(f"dim is {dim!r}; it must be 2 or 3")
    if not (isinstance(packing_fraction, Real) and 0 < packing_fraction < 1):
        raise SceneError(f"packing_fraction is {packing_fraction!r}; it must be a number between 0 and 1")
    require_room_for(n)
    sizes = one_per_particle(radii, "radii", n)
    weights = one_per_particle(masses, "masses", n)
    with np.errstate(over="ignore"):
        volume = float(np.sum(sphere_volume(sizes, dim)))
    if math.isinf(volume) and np.isfinite(sizes).all():
        raise SceneError(
            f"radii up to {np.max(sizes):g} give an infinite volume; take a larger unit of length"
        )
    return n, dim, volume, sizes, weights


def _fit(
    lattice: Lattice, n: int, volume: float, periodic: Bools, radius: float
) -> tuple[Floats, Planes] | None:
    """Box and numbers of planes for n spheres of this radius without overlap, or None."""
    best: tuple[float, Floats, Planes] | None = None
    for planes in _candidates(lattice, n, periodic):
        box = _box(lattice, planes, volume, periodic)
        if np.any(box < np.where(periodic, 4, 2) * radius):
            continue
        gap = _nearest(lattice, planes, box, periodic, radius) - 2 * radius
        if gap < -contact_tolerance(box):
            continue
        surplus = lattice.sites(planes) / n - 1
        # In a box of one shape: most room. Where the shape follows the planes: nearest to a square, fewest
        # vacancies.
        cost = surplus + abs(math.log(box[0] / box[1])) if periodic.all() else -gap
        if best is None or cost < best[0] - 1e-9 * abs(best[0]):
            best = (cost, box, planes)
    return None if best is None else best[1:]


def _candidates(lattice: Lattice, n: int, periodic: Bools) -> list[Planes]:
    """Numbers of planes worth trying: enough sites for n, near the lattice's own proportions."""
    dim = len(periodic)
    crossings = 2 * n if lattice.every_second else n
    scale = (crossings * math.prod(lattice.proportions)) ** (1 / dim)
    # A chessboard wraps around in even numbers only.
    step = [2 if lattice.every_second and wraps else 1 for wraps in periodic]

    def rounded(planes: float, axis: int) -> int:
        return max(1, math.ceil(planes / step[axis] - 1e-9)) * step[axis]

    if periodic.all() and len(set(lattice.proportions)) == 1:  # a cube, undistorted
        planes = rounded(scale, 0)
        while lattice.sites((planes,) * dim) < n:
            planes += step[0]
        while planes > step[0] and lattice.sites((planes - step[0],) * dim) >= n:
            planes -= step[0]
        return [(planes,) * dim]
    ranges = []
    for axis in range(dim - 1):
        middle = scale / lattice.proportions[axis]
        spread = max(6.0, 0.3 * middle) if dim == 2 else 6.0
        low, high = rounded(max(1.0, middle - spread), axis), rounded(middle + spread, axis)
        ranges.append(range(low, high + 1, step[axis]))
    found = []
    for some in itertools.product(*ranges):
        last = rounded(crossings / math.prod(some) - (1 if lattice.every_second else 0), dim - 1)
        while lattice.sites((*some, last)) < n:
            last += step[-1]
        found.append((*some, last))
    return found


def _box(lattice: Lattice, planes: Planes, volume: float, periodic: Bools) -> Floats:
    """Return a cube (square) of this volume; for a periodic triangular lattice its undistorted rectangle."""
    dim = len(periodic)
    if not periodic.all():
        return np.full(dim, volume ** (1 / dim))
    shape = np.array(planes) * np.array(lattice.proportions)
    box: Floats = shape * (volume / math.prod(shape.tolist())) ** (1 / dim)
    return box


def _spacings(planes: Planes, box: Floats, periodic: Bools, radius: float) -> Floats:
    """Distances between neighbouring planes; between walls all planes are a radius inside."""
    count = np.array(planes)
    even = box / count
    inside = (box - 2 * radius) / np.maximum(count - 1, 1)
    spacings: Floats = np.where(periodic | (count == 1), even, np.minimum(even, inside))
    return spacings


def _nearest(lattice: Lattice, planes: Planes, box: Floats, periodic: Bools, radius: float) -> float:
    """Smallest distance between sites; infinity where there is only one."""
    alone = (np.array(planes) == 1) & ~periodic
    spacing = np.where(alone, math.inf, _spacings(planes, box, periodic, radius))
    if not lattice.every_second:
        return float(spacing.min())
    diagonal = min(math.hypot(a, b) for a, b in itertools.combinations(spacing, 2))
    straight = [2 * h for h, count in zip(spacing, planes, strict=True) if count > 2]
    return float(min([diagonal, *straight]))


def _reachable(
    lattice: Lattice, n: int, filled: float, refused: float, periodic: Bools, radius: float
) -> float:
    """Find the largest packing fraction at which the lattice fits, by bisection below the refused one."""
    low, high = 0.0, refused
    for _ in range(30):
        middle = 0.5 * (low + high)
        if _fit(lattice, n, filled / middle, periodic, radius) is None:
            high = middle
        else:
            low = middle
    return low


def _sites(lattice: Lattice, planes: Planes, box: Floats, periodic: Bools, radius: float) -> Floats:
    """Positions of all lattice sites, shape (sites, d)."""
    spacing = _spacings(planes, box, periodic, radius)
    indices = np.stack([axis.ravel() for axis in np.meshgrid(*map(np.arange, planes), indexing="ij")], axis=1)
    if lattice.every_second:
        indices = indices[np.sum(indices, axis=1) % 2 == 0]
    span = (np.array(planes) - 1) * spacing
    margin = 0.5 * (box - span)  # half a spacing, or a radius where planes touch walls
    sites = margin + indices * spacing
    kept: Floats = np.where(periodic, sites, np.clip(sites, radius, box - radius))
    return kept
