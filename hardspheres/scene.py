"""A scene of hard spheres: positions, velocities, radii, masses and box, checked once on construction."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres import atoms as ase_atoms
from hardspheres.checks import (
    LEFT_BY_ROUNDING,
    acceleration,
    boundary_words,
    box_edges,
    contact_tolerance,
    inertia,
    integer_labels,
    obstacles_among,
    one_per_particle,
    real_numbers,
    require_finite,
    require_in_box,
    require_inside,
    require_long_axes,
    require_no_overlap,
    require_resolved,
    wrapped,
)
from hardspheres.errors import SceneError
from hardspheres.gravity import impact_square

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Array = TypeVar("Array", bound=NDArray[Any])
Lengths = TypeVar("Lengths", float, Floats)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Scene:
    """Hard spheres (or discs) in a box.

    All numbers are in any one consistent set of units (reduced units: lengths in diameters, masses in
    particle masses, kT = 1). Arrays are copied, made read-only and checked once, here; the engine does not
    check them again.

    Parameters
    ----------
    positions : (N, d) array_like
        Centres, d = 2 or 3, N >= 1. The box spans [0, L] on each axis. On periodic axes any value is taken
        and wrapped into [0, L); on wall axes a centre lies at least a radius inside.
    velocities : (N, d) array_like
        Velocities.
    radii : float or (N,) array_like
        Radii, positive.
    masses : float or (N,) array_like
        Masses, positive. Infinity makes a particle an obstacle, which nothing moves: its velocity is 0, and
        it may overlap other obstacles and reach beyond walls, so that obstacles make walls of any shape. At
        least one particle moves. Obstacles do not fall.
    box : (d,) array_like
        Edge lengths. A periodic axis is at least two largest diameters long (so that no pair meets through
        two images at once), a wall axis at least one; the longest at most 1e9 smallest diameters (so that
        coordinates resolve contacts).
    boundary : str or sequence of str
        ``"periodic"`` or ``"wall"`` (elastic, smooth), for all axes or one word for each.
    labels : (N,) array_like of int, optional
        A number for each particle, for whatever you want to tell apart (left and right, a tracer). Labels
        follow particles into frames, checkpoints and files; the dynamics never looks at them.
    gravity : (d,) array_like, optional
        Acceleration of all that move, such as ``(0, 0, -9.81)``; only along wall axes. No particle may rest
        on the wall that it is pulled to: elastic balls never come to rest. It follows a scene into
        simulations, copies and checkpoints; trajectory files have the particles, and not gravity.

    Attributes
    ----------
    positions, velocities : (N, d) float64 array
        As given, positions wrapped. Read-only, C order.
    radii, masses : (N,) float64 array
        One entry for each particle. Read-only.
    box : (d,) float64 array
        Edge lengths. Read-only.
    boundary : tuple of str
        One word for each axis.
    periodic : (d,) bool array
        True where the axis is periodic. Read-only.
    species : (N,) int32 array
        Number of the particle's kind: particles of one kind have the same mass and the same radius, all
        obstacles are of one kind, and kinds are numbered in the order in which they first appear. Read-only.
    obstacles : (N,) bool array
        True where the mass is infinite. Read-only.
    gravity : (d,) float64 array
        Acceleration of all particles; zero where none is given. Read-only.
    labels : (N,) int64 array or None
        As given. Read-only.

    Raises
    ------
    SceneError
        For the first thing that is wrong: shape, type, a value that is not finite or not positive, an
        obstacle that moves, a particle beyond a wall, a box too short or too long, an overlap (the worst is
        named). Spheres may touch. They may also overlap, or reach beyond a wall, by the rounding of
        coordinates in a box of this size, `contact_tolerance`: four units in the last place of the longest
        edge (9e-15 in a box of edge 10).
    """

    positions: Floats
    velocities: Floats
    radii: Floats
    masses: Floats
    box: Floats
    boundary: tuple[str, ...]
    periodic: Bools
    species: NDArray[np.int32]
    gravity: Floats
    labels: NDArray[np.int64] | None

    def __init__(
        self,
        positions: ArrayLike,
        velocities: ArrayLike,
        radii: ArrayLike = 0.5,
        masses: ArrayLike = 1.0,
        box: ArrayLike = (10, 10, 10),
        boundary: str | Sequence[str] = "periodic",
        labels: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> None:
        self._fill(positions, velocities, radii, masses, box, boundary, labels, gravity)

    def _fill(
        self,
        positions: ArrayLike,
        velocities: ArrayLike,
        radii: ArrayLike,
        masses: ArrayLike,
        box: ArrayLike,
        boundary: str | Sequence[str],
        labels: ArrayLike | None,
        gravity: ArrayLike | None,
        spare: float = 0.0,
        apart: bool = False,
    ) -> None:
        """Check everything and store it; overlaps by `spare` largest diameters count as rounding.

        They are not looked for where all particles are known to be `apart`.
        """
        places = real_numbers(positions, "positions")
        if places.ndim != 2 or places.shape[1] not in (2, 3):
            raise SceneError(
                f"positions have shape {places.shape}; they need one row for each particle and 2 or 3 columns"
            )
        n, dim = places.shape
        if n == 0:
            raise SceneError("a scene needs at least one particle; positions are empty")
        speeds = real_numbers(velocities, "velocities")
        if speeds.shape != places.shape:
            raise SceneError(
                f"velocities have shape {speeds.shape}; they need that of positions, {places.shape}"
            )
        edges = box_edges(box, dim)
        words = boundary_words(boundary, dim)
        require_finite(places, "position")
        require_finite(speeds, "velocity")
        sizes = one_per_particle(radii, "radii", n)
        weights = one_per_particle(masses, "masses", n, infinite=True)
        fixed = obstacles_among(weights, speeds)
        named = integer_labels(labels, n)
        pull = acceleration(gravity, words)
        periodic = np.array([word == "periodic" for word in words])
        places = wrapped(places, edges, periodic)
        _require_representable(speeds, sizes, weights, edges, pull)
        require_long_axes(sizes, edges, periodic)
        require_resolved(sizes, edges)
        tolerance = max(contact_tolerance(edges), spare * 2.0 * float(sizes.max()))
        require_inside(places, sizes, edges, periodic, tolerance, fixed)
        if not apart:
            require_no_overlap(places, sizes, edges, periodic, tolerance, fixed)
        _require_none_at_rest(places, speeds, sizes, edges, pull, ~fixed, tolerance)
        kinds = _kinds(weights, sizes)
        self._store(places, speeds, sizes, weights, edges, words, periodic, kinds, pull, named)

    def _store(self, *values: Any) -> None:
        """Set the fields in their order, arrays read-only."""
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __getstate__(self) -> tuple[Any, ...]:  # without what was derived from the fields and kept
        return tuple(getattr(self, name) for name in self.__dataclass_fields__)

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._store(*state)  # an unpickled array is no longer read-only

    @property
    def n(self) -> int:
        """Number of particles N."""
        return len(self.positions)

    @property
    def dim(self) -> int:
        """Dimension d of space, 2 or 3."""
        return len(self.box)

    @property
    def volume(self) -> float:
        """Volume of the box (area in 2D), length^d."""
        return float(math.prod(self.box.tolist()))

    @property
    def number_density(self) -> float:
        """Particles that move per volume of the box, 1/length^d."""
        return self.n_moving / self.volume

    @cached_property
    def obstacles(self) -> Bools:
        """Which particles have infinite mass, (N,). Read-only."""
        return read_only(np.isinf(self.masses))

    @cached_property
    def n_moving(self) -> int:
        """Number of particles that move: all but obstacles."""
        return self.n - int(np.count_nonzero(self.obstacles))

    @cached_property
    def packing_fraction(self) -> float:
        """Packing fraction: volume of the particles that move over that of the box (areas in 2D)."""
        radii = self.radii if self.n_moving == self.n else self.radii[~self.obstacles]
        return float(np.sum(sphere_volume(radii, self.dim))) / self.volume

    @property
    def momentum(self) -> Floats:
        """Total momentum of all but obstacles, shape (d,), mass length/time. Read-only."""
        return total_momentum(self.velocities, self.masses)

    @cached_property
    def kinetic_energy(self) -> float:
        """Kinetic energy, including the common motion."""
        return kinetic_energy(self.velocities, self.masses)

    @cached_property
    def thermal_energy(self) -> float:
        """Kinetic energy without the common motion along periodic axes, sum of P_k^2 / 2M."""
        return thermal_energy(self.velocities, self.masses, self.periodic)

    @cached_property
    def accelerations(self) -> Floats:
        """Acceleration of each particle, (N, d): gravity; 0 for obstacles. Read-only."""
        return read_only(np.where(self.obstacles[:, None], 0.0, self.gravity))

    @cached_property
    def falls(self) -> bool:
        """Whether there is gravity."""
        return bool(self.gravity.any())

    @cached_property
    def potential_energy(self) -> float:
        """Potential energy; 0 with all particles at the walls that gravity pulls them to, or without it."""
        return potential_energy(self.positions, self)

    @property
    def degrees_of_freedom(self) -> int:
        """Translational degrees of freedom: d N less the number of periodic axes; d for a single particle.

        Obstacles have none, and take up momentum: with them d for each particle that moves.
        """
        if self.n_moving < self.n:
            return self.dim * self.n_moving
        return degrees_of_freedom(self.n, self.periodic)

    @property
    def temperature(self) -> float:
        """Temperature kT = 2 thermal_energy / degrees_of_freedom, in units of energy."""
        return 2 * self.thermal_energy / self.degrees_of_freedom

    def replace(self, **changes: Any) -> "Scene":
        """Return a scene with some of the constructor's arguments replaced, checked anew.

        Other labels alone need no check of the rest: contacts as the engine left them stay as they are.

        Parameters
        ----------
        **changes
            Any of `positions`, `velocities`, `radii`, `masses`, `box`, `boundary`, `labels`, `gravity`.

        Returns
        -------
        Scene
            The new scene; this one stays as it is.

        Raises
        ------
        SceneError
            As the constructor does.
        """
        if changes.keys() == {"labels"}:
            scene = object.__new__(Scene)
            scene._store(*self.__getstate__()[:-1], integer_labels(changes["labels"], self.n))
            return scene
        names = ("positions", "velocities", "radii", "masses", "box", "boundary", "labels", "gravity")
        return Scene(**{name: getattr(self, name) for name in names} | changes)

    def with_state(self, positions: Floats, velocities: Floats, radii: Floats | None = None) -> "Scene":
        """Return the same particles and box in a state reached by the dynamics, without an overlap search.

        The engine leaves contacts that overlap by its rounding (below 1e-11 diameters), which a scene made by
        hand may not have. Numbers are checked as in the constructor, and that centres lie in the box.

        Parameters
        ----------
        positions : (N, d) float64 array
            Centres, in [0, L]. Copied.
        velocities : (N, d) float64 array
            Velocities. Copied.
        radii : (N,) float64 array, optional
            Other radii, in the same proportions (as spheres that grow have them). Copied.

        Returns
        -------
        Scene
            The new scene, sharing masses, box, labels and, if none are given, radii with this one.

        Raises
        ------
        SceneError
            For a wrong shape or type, a value that is not finite or not positive, a centre outside of the
            box.
        """
        scene = object.__new__(Scene)
        here, there = real_numbers(positions, "positions"), real_numbers(velocities, "velocities")
        if here.shape != self.positions.shape or there.shape != self.positions.shape:
            raise SceneError(
                f"a state of this scene has positions and velocities of shape {self.positions.shape}"
            )
        require_finite(here, "position")
        require_finite(there, "velocity")
        sizes = self.radii if radii is None else one_per_particle(radii, "radii", self.n)
        _require_representable(there, sizes, self.masses, self.box, self.gravity)
        require_in_box(here, self.box)
        scene._store(here, there, sizes, *self.__getstate__()[3:])
        return scene

    @classmethod
    def as_left(
        cls,
        positions: Floats,
        velocities: Floats,
        radii: Floats,
        masses: Floats,
        box: Floats,
        boundary: tuple[str, ...],
        labels: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> "Scene":
        """Return a scene checked as by the constructor, with the overlaps allowed that the engine leaves.

        Parameters
        ----------
        positions, velocities, radii, masses, box, boundary, labels, gravity
            As in the constructor; overlaps up to `LEFT_BY_ROUNDING` largest diameters are taken for rounding.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            As the constructor does.
        """
        scene = object.__new__(cls)
        scene._fill(positions, velocities, radii, masses, box, boundary, labels, gravity, LEFT_BY_ROUNDING)
        return scene

    @classmethod
    def as_placed(
        cls, positions: Floats, radii: Floats, masses: Floats, box: Floats, boundary: tuple[str, ...]
    ) -> "Scene":
        """Return a scene at rest whose particles were placed so that none overlap; the rest is checked.

        Parameters
        ----------
        positions, radii, masses, box, boundary
            As in the constructor, no two particles overlapping.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            As the constructor does, but for overlaps.
        """
        scene = object.__new__(cls)
        rest = np.zeros_like(positions)
        scene._fill(positions, rest, radii, masses, box, boundary, None, None, apart=True)
        return scene

    @classmethod
    def from_atoms(
        cls, atoms: Any, radius: ArrayLike | Mapping[str, float] | None = None, **reading: Any
    ) -> "Scene":
        """Return the scene in an ASE Atoms object.

        Parameters
        ----------
        atoms : ase.Atoms
            Positions; an orthogonal cell, whose first corner is the origin (or ``celldisp``, or `Origin` in
            ``info``); pbc, where False means a wall; radii or diameters, masses, momenta and velocities in
            ``arrays`` or ``info``, by the names in `hardspheres.columns`. Particles are at rest without
            momenta and velocities (see `has_velocities`); masses are ASE's own for the element where none are
            given. Two-dimensional where ``info["dimension"]`` says so, or the third cell vector is zero. An
            ``id`` for each particle gives their order. Labels are a column ``label`` of integers, or ASE's
            tags unless all of them are 0.
        radius : float, (N,) array_like or mapping of labels to floats, optional
            Radii, whatever `atoms` has.
        **reading
            Other fields of `hardspheres.atoms.Reading`: `mass`, `units`, `box`, `boundary`, `dim`,
            `velocities`.

        Returns
        -------
        Scene
            The scene. Where spheres overlap each other or a wall by no more than 8 printed decimals explain
            (3e-8 between two spheres, in the unit of length of the file, and a ten-thousandth of the smallest
            diameter; in a .gsd in single precision 2.4e-7 of the longest edge), all radii are reduced by half
            of the worst overlap; positions and velocities are as given. Without such an overlap every bit is
            as given. That, and every column of numbers that is not used, is logged as a warning.

        Raises
        ------
        TrajectoryError
            When there is no orthogonal cell, no radius, or velocities are in a column whose unit is not
            known.
        SceneError
            When the content makes no valid scene.
        """
        return ase_atoms.scene_of(cls, atoms, ase_atoms.Reading(radius, **reading))

    def to_atoms(self, units: str | None = None) -> Any:
        """Return the scene as an ASE Atoms object; see `hardspheres.atoms.to_atoms`."""
        return ase_atoms.to_atoms(self, units)

    def __repr__(self) -> str:
        edges = " x ".join(f"{edge:.6g}" for edge in self.box)
        walls = self.boundary[0] if len(set(self.boundary)) == 1 else ", ".join(self.boundary)
        kinds = len(np.unique(self.species[~self.obstacles]))
        mixture = f", {kinds} species" if kinds > 1 else ""
        if self.n_moving < self.n:
            fixed = self.n - self.n_moving
            mixture += f", {fixed} obstacle{'s' * (fixed != 1)}"
        if self.labels is not None:
            marks = len(np.unique(self.labels))
            mixture += f", {marks} label{'s' * (marks != 1)}"
        if self.falls:
            mixture += f", gravity {' '.join(f'{pull:.6g}' for pull in self.gravity)}"
        return (
            f"Scene({self.n_moving} particles in {self.dim}D{mixture}, box {edges} ({walls}), "
            f"packing_fraction={self.packing_fraction:.6g}, temperature={self.temperature:.6g})"
        )


def sphere_volume(radii: Lengths, dim: int) -> Lengths:
    """Volumes of spheres, or of one (areas of discs): 4/3 pi r^3 in 3D, pi r^2 in 2D."""
    return (4 / 3) * math.pi * radii * radii * radii if dim == 3 else math.pi * radii * radii


def to_nearest_image(separations: Floats, scene: Scene) -> Floats:
    """Separations of positions, (..., d), to the nearest image along periodic axes."""
    return separations - np.where(scene.periodic, scene.box * np.rint(separations / scene.box), 0.0)


def total_momentum(velocities: Floats, masses: Floats) -> Floats:
    """Total momentum sum of m v, shape (d,), read-only; obstacles have none."""
    return read_only(column_sums(times_each(inertia(masses), velocities)))


def times_each(factors: Floats, vectors: Floats) -> Floats:
    """Return (N, d) vectors times a factor each; the same bits, soon, where all factors are equal."""
    alike = len(factors) and bool((factors == factors[0]).all())
    product: Floats = vectors * (factors[0] if alike else factors[:, None])
    return product


def column_sums(rows: Floats) -> Floats:
    """Return the sums of the columns of (N, k) numbers, added from the first row on."""
    sums: Floats = np.einsum("ij->j", np.ascontiguousarray(rows))
    return sums


def squared_lengths(vectors: Floats) -> Floats:
    """Return the squared lengths of (N, d) vectors, (N,), added from the first axis on."""
    total: Floats = vectors[:, 0] * vectors[:, 0]
    for axis in range(1, vectors.shape[1]):
        total += vectors[:, axis] * vectors[:, axis]
    return total


def read_only(array: Array) -> Array:
    """Return the array, read-only: writing to it would not change the scene."""
    array.setflags(write=False)
    return array


def kinetic_energy(velocities: Floats, masses: Floats) -> float:
    """Kinetic energy sum of m v^2 / 2; obstacles have none."""
    return 0.5 * float(np.sum(inertia(masses) * squared_lengths(velocities)))


def heights(positions: Floats, scene: Any) -> Floats:
    """Distances along each axis to where gravity pulls each particle, (N, d); 0 along axes without it."""
    low, high = scene.radii[:, None], scene.box - scene.radii[:, None]
    above: Floats = np.where(scene.gravity < 0.0, positions - low, high - positions)
    return np.where(scene.gravity != 0.0, above, 0.0)


def squares_at_floor(scene: Any, positions: Floats, velocities: Floats) -> Floats:
    """Squared speed along each axis at the wall that gravity pulls to, (N, d); v^2 along axes without it."""
    above = np.maximum(heights(positions, scene), 0.0)
    squares: Floats = impact_square(velocities, above, np.abs(scene.gravity))
    return squares


def potential_energy(positions: Floats, scene: Any) -> float:
    """Potential energy of a state of a scene; see `Scene.potential_energy`."""
    if not scene.falls:
        return 0.0
    return float(np.sum(inertia(scene.masses) * (heights(positions, scene) @ np.abs(scene.gravity))))


def momentum_flux(velocities: Floats, masses: Floats) -> Floats:
    """Sum of m v_a v_b, shape (d, d); obstacles add nothing."""
    flux: Floats = (velocities * inertia(masses)[:, None]).T @ velocities
    return flux


def energy_flux(velocities: Floats, masses: Floats) -> Floats:
    """Sum of v_a m v^2/2, shape (d,)."""
    flux: Floats = (0.5 * masses * squared_lengths(velocities)) @ velocities
    return flux


def degrees_of_freedom(n: int, periodic: Bools) -> int:
    """Degrees of freedom: d N less one for each periodic axis, where the total momentum is conserved.

    All motion of a single particle counts as thermal, with d degrees of freedom.
    """
    return len(periodic) * n - (int(np.sum(periodic)) if n > 1 else 0)


def thermal_energy(velocities: Floats, masses: Floats, periodic: Bools) -> float:
    """Kinetic energy relative to the common motion along periodic axes.

    K_th = K - sum over periodic axes of P_k^2 / 2M, computed as sum of m (v - P/M)^2 / 2, which has no
    cancellation. Momentum normal to a wall is not conserved, so that along wall axes all of K is thermal; so
    it is on all axes for a single particle, and with obstacles.
    """
    return kinetic_energy(velocities - drift(velocities, masses, periodic), masses)


def drift(velocities: Floats, masses: Floats, periodic: Bools) -> Floats:
    """Velocity of the common motion, P/M on periodic axes and zero on others, (d,).

    Zero for one particle, and with obstacles: they take up momentum, and nothing keeps it.
    """
    if len(masses) == 1 or np.isinf(masses).any():
        return np.zeros(len(periodic))
    return np.where(periodic, total_momentum(velocities, masses) / float(np.sum(masses)), 0.0)


def returned_to_box(flown: Floats, box: Floats, periodic: Bools) -> Floats:
    """Return positions after a flight with periodic coordinates in [0, L); a copy."""
    positions = flown.copy()
    for axis in np.flatnonzero(periodic):  # one at a time: loops over rows of two or three numbers are slow
        x, edge = flown[:, axis], box[axis]
        inside = x - edge * np.floor(x / edge)
        inside[inside >= edge] = 0.0
        positions[:, axis] = inside
    return positions


def _require_none_at_rest(
    positions: Floats,
    velocities: Floats,
    radii: Floats,
    box: Floats,
    gravity: Floats,
    moves: Bools,
    tolerance: float,
) -> None:
    """Refuse particles that lie on a wall that gravity pulls them to."""
    for axis in np.flatnonzero(gravity):
        x, v, pull = positions[:, axis], velocities[:, axis], abs(float(gravity[axis]))
        gap = x - radii if gravity[axis] < 0.0 else (box[axis] - radii) - x
        lying = np.flatnonzero(moves & (gap <= tolerance) & (radii + v * v / (2.0 * pull) == radii))
        if len(lying):
            raise SceneError(
                f"particle {lying[0]} rests on the wall that gravity pulls it to along {'xyz'[axis]}; "
                "elastic balls bounce for ever and never rest: lift it, or give it a velocity away from it"
            )


def _require_representable(
    velocities: Floats, radii: Floats, masses: Floats, box: Floats, gravity: Floats
) -> None:
    """Refuse units in which anything that is computed later leaves the range of doubles.

    With the energy E no particle is ever faster than sqrt(2 E / smallest mass), and the fastest never slower
    than sqrt(2 E / total mass). The dynamics computes products of lengths, masses and speeds between these
    two.
    """
    dim, edge, small = len(box), float(box.max()), float(radii.min())
    moving = np.isfinite(masses)
    velocities, masses = velocities[moving], masses[moving]
    with np.errstate(all="ignore"):
        filled = float(np.sum(sphere_volume(radii, dim)))
        energy = np.float64(kinetic_energy(velocities, masses))
        energy += np.sum(masses) * np.sum(np.abs(gravity) * box)  # more than falling can give
        total, lightest = np.sum(masses), masses.min()
        fastest, slowest = np.sqrt(2.0 * energy / lightest), np.sqrt(2.0 * energy / total)
        sizes = [math.prod(box.tolist()), filled]
        weights = [total, 1.0 / lightest]
        motion = [energy, *(len(masses) * fastest * fastest, slowest * slowest, 2.0 * energy / lightest)]
        # Discriminants v^2 sigma^2 - |r x v|^2, the impulse per separation m v / r, and the virial's r.dp.
        squares = [64.0 * (fastest * edge) ** 2, (slowest * small) ** 2]
        impulses = [total * fastest / small, lightest * slowest / edge, total * fastest * edge]
    if not _in_range(sizes):
        raise SceneError(
            "volumes of the box or the particles leave the range of double precision; choose another unit "
            "of length"
        )
    if not _in_range(weights):
        raise SceneError(
            f"masses from {lightest:.3g} to {masses.max():.3g} leave the range of double precision, or their "
            "sum does; choose another unit of mass"
        )
    if energy > 0.0 and not _in_range(motion):
        raise SceneError(
            "the kinetic energy leaves the range of double precision, or the squares of speeds that it "
            "allows do; choose other units of time or mass"
        )
    if energy > 0.0 and not _in_range(squares + impulses):
        raise SceneError(
            "products of the box's edges, or the radii, with speeds and masses leave the range of double "
            "precision; choose other units of length, time or mass"
        )


def _in_range(values: Sequence[float]) -> bool:
    """Whether all are positive and represented with all digits."""
    return all(np.finfo(np.float64).tiny <= value < math.inf for value in values)


def _kinds(masses: Floats, radii: Floats) -> NDArray[np.int32]:
    """Count the distinct (mass, radius) pairs in the order in which they first appear."""
    if masses.min() == masses.max() and radii.min() == radii.max():
        return np.zeros(len(masses), dtype=np.int32)
    pairs = np.empty(len(masses), dtype=np.complex128)  # sorts by mass, then radius
    pairs.real, pairs.imag = masses, np.where(np.isinf(masses), 0.0, radii)  # obstacles are of one kind
    _, first, kind = np.unique(pairs, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int32)
    rank[np.argsort(first)] = np.arange(len(first), dtype=np.int32)
    return rank[kind]
