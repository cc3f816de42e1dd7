"""Free paths: what the engine tallies of every flight between two collisions, and in which units."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import Scene, read_only, squared_lengths
from hardspheres.tally_units import flight_units

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_SPECIES = 32  # whose flights are told apart
SPEED_BIN = 1.0 / 16.0  # in units of the thermal speed sqrt(kT/m)


@dataclass(frozen=True)
class FreePaths:
    """Every free flight in a window of time, by species; exact counts, nothing is sampled.

    The window of `Simulation.free_paths` begins at the last `Simulation.reset_tallies`, that of
    `Frame.free_paths` at the start of the simulation: the difference of two frames is a window between them.

    A flight goes from one collision of two particles to the next; a wall turns it round and does not end it,
    its path goes on. Counted are the flights that *end* in the window of observation, each with its whole
    path and free time, also what it flew before the window. In a steady state as many flights of each kind
    end as begin in any stretch of time, so that this is an unbiased sample of all flights, where one of the
    flights inside of the window would lack the long ones. The one exception are the flights that were under
    way when the simulation was made (`first_flights`), whose beginning is not known: they are left out, which
    makes a sample too short as long as there are any, so let every particle collide before the window begins.
    The mean needs no sample of flights: `path_flown` / (`flights` + `first_flights`) is the path that all
    particles flew in the window over the number of collisions that they had there, unbiased in any window.

    Species are numbered as in `Scene.species`; k is their number. Paths are measured in the frame of the box.
    Arrays are read-only.

    Attributes
    ----------
    time : float
        Simulated time of the window.
    particles : (k,) int64 array
        How many particles each species has.
    flights : (k,) int64 array
        Flights that ended in the window.
    first_flights : (k,) int64 array
        Those left out: they ended in the window too, but began before the simulation.
    path_flown : (k,) float64 array
        Path that all particles flew within the window, [length].
    path_sums, time_sums : (k, 3) float64 arrays
        Sums over `flights` of path and free time, their squares, and their cubes, [length^p], [time^p].
    path_edges, time_edges : (k, 259) float64 arrays
        Edges of the bins, [length], [time]: 0, then 16 bins of equal width in each octave from 2^-8 to 2^8
        expected mean free paths (times), then infinity.
    path_counts, time_counts : (k, 258) int64 arrays
        Flights in each bin.
    speed_edges : (k, 130) float64 array
        Edges of bins of speed: 0 to 8 thermal speeds sqrt(kT/m) in sixteenths, then infinity, [length/time].
    speed_counts : (k, 129) int64 array
        Flights at each speed.
    speed_paths, speed_times : (k, 129) float64 arrays
        Their paths and free times, summed. `speed_paths / speed_counts` is the mean free path lambda(v) at a
        speed, `speed_counts / speed_times` the collision rate there.
    pair_collisions : (k, k) int64 array
        Collisions between two species in the window, symmetric: one between unlike particles stands in both
        places.
    """

    time: float
    particles: Ints
    flights: Ints
    first_flights: Ints
    path_flown: Floats
    path_sums: Floats
    time_sums: Floats
    path_edges: Floats
    path_counts: Ints
    time_edges: Floats
    time_counts: Ints
    speed_edges: Floats
    speed_counts: Ints
    speed_paths: Floats
    speed_times: Floats
    pair_collisions: Ints

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                read_only(value)

    def __repr__(self) -> str:
        """Return how much was counted."""
        return (
            f"<FreePaths of a time of {self.time:.6g}: {', '.join(str(n) for n in self.flights)} flights of "
            f"{', '.join(str(n) for n in self.particles)} particles, by species>"
        )


def kinds_of(scene: Scene) -> NDArray[np.int32]:
    """Species of each particle as flights tell them apart: where there are too many species, all are one."""
    kinds = scene.species
    return kinds if int(kinds.max()) < MOST_SPECIES else np.zeros_like(kinds)


def expected_flights(scene: Scene) -> Floats:
    """Units of the histograms, (k, 3): rough mean free path and time, and thermal speed, of each species.

    Enskog's collision rates with a crude contact value (as in `hardspheres.tuning.collision_frequency`); 1
    where nothing moves.
    """
    kinds, dim = kinds_of(scene), scene.dim
    _, first, particles = np.unique(kinds, return_index=True, return_counts=True)
    radii, spread = scene.radii[first], scene.temperature / scene.masses[first]
    room = max(1.0 - scene.packing_fraction, 0.05)
    chi = (1.0 - 0.5 * scene.packing_fraction) / room**dim
    contact = np.add.outer(radii, radii)
    area = math.pi * contact**2 if dim == 3 else 2.0 * contact
    mean = math.sqrt(8.0 / math.pi) if dim == 3 else math.sqrt(math.pi / 2.0)  # <v> / sqrt(kT/m)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rates = chi * mean / scene.volume * (area * np.sqrt(np.add.outer(spread, spread))) @ particles
        units = np.stack([mean * np.sqrt(spread) / rates, 1.0 / rates, np.sqrt(spread)], axis=1)
    return np.where(np.isfinite(units) & (units > 0.0), units, 1.0)


def octave_edges(at: Any) -> Floats:
    """Edges of the bins of paths and times, in their unit."""
    per_octave = 1 << at.OCTAVE_BITS
    octaves = 2.0 ** np.arange(at.LEAST_OCTAVE, at.LEAST_OCTAVE + at.OCTAVES)
    inside = np.outer(octaves, 1.0 + np.arange(per_octave) / per_octave).ravel()
    return np.concatenate([[0.0], inside, [2.0 * octaves[-1], math.inf]])


class FlightTallies:
    """The engine's tallies of flights, put together in the form that people read.

    Parameters
    ----------
    scene : Scene
        Where the simulation started.
    at : module
        The names in `kernel.layout`, for this kind of scene.

    Attributes
    ----------
    kinds : (N,) int32 array
        Species of each particle.
    particles : (k,) int64 array
        How many there are of each.
    units : (k, 3) float64 array
        `expected_flights`.
    sum_units : (k, 2) float64 array
        `flight_units`.
    paths_before : (k,) float64 array
        Paths of the flights that were under way when the tallies were reset, up to then.
    counts_then : array
        How many flights had ended then, as the kernels keep it.
    """

    def __init__(self, scene: Scene, at: Any) -> None:
        self.at = at
        self.kinds = kinds_of(scene)
        self.particles = np.bincount(self.kinds).astype(np.int64)
        self.units, self.sum_units = expected_flights(scene), flight_units(scene, self.kinds)
        self.paths_before = np.zeros(len(self.particles))
        kinds = len(self.particles)
        self.counts_then = np.zeros(kinds * at.FLIGHT_COUNT + kinds * kinds, dtype=np.int64)

    def state(self) -> dict[str, Any]:
        """Return what a checkpoint keeps besides the kernels' arrays."""
        return {name: getattr(self, name) for name in ("paths_before", "counts_then")}

    def prepared(self, length: float) -> tuple[Floats, Floats]:
        """Return what the kernels need for epochs of this length: all flights, and the units of the bins."""
        at = self.at
        flight = np.zeros((len(self.kinds), at.FLIGHT))
        flight[:, at.BEGAN], flight[:, at.BEGAN_EPOCH] = length, -1.0
        flight[:, at.SPECIES] = self.kinds
        of_bins = 1.0 / (self.units * [1.0, 1.0, SPEED_BIN])
        return flight.ravel(), np.hstack([of_bins, 1.0 / self.sum_units]).ravel()

    def recount(self, flight: Floats, before: float, length: float) -> None:
        """Convert the beginnings of flights to epochs of another length, a power of two times that before."""
        table = flight.reshape(-1, self.at.FLIGHT)
        known = table[:, self.at.BEGAN_EPOCH] >= 0.0
        epoch, began = table[:, self.at.BEGAN_EPOCH], table[:, self.at.BEGAN]
        if length < before:
            whole = np.floor(began / length)
            epoch, began = epoch * (before / length) + whole, began - whole * length
        else:
            whole = np.floor(epoch * (before / length))
            epoch, began = whole, began + (epoch - whole * (length / before)) * before
        table[:, self.at.BEGAN_EPOCH] = np.where(known, epoch, -1.0)
        table[:, self.at.BEGAN] = np.where(known, began, length)

    def _under_way(self, arrays: Any, epoch: int, moment: float) -> Floats:
        """Paths of the flights that are under way at a time, summed for each species."""
        at, dim = self.at, int(self.at.DIM)
        flight = arrays.flight.reshape(-1, at.FLIGHT)
        v = arrays.row.reshape(-1, at.ROW)[: len(flight), at.V : at.V + dim]
        times = (epoch - flight[:, at.BEGAN_EPOCH]) * float(arrays.number[at.EPOCH_LENGTH]) + (
            moment - flight[:, at.BEGAN]
        )
        paths: Floats = np.bincount(self.kinds, np.sqrt(squared_lengths(v)) * times).astype(np.float64)
        return paths

    def reset(self, arrays: Any, epoch: int, moment: float) -> None:
        """Begin anew at this time."""
        self.counts_then = arrays.counter[self.at.FLIGHT_COUNTS :].copy()
        self.paths_before = self._under_way(arrays, epoch, moment)

    def read(self, arrays: Any, now: tuple[int, float], passed: float, then: Floats | None) -> FreePaths:
        """Return what was tallied until now, for this time: since the sums were `then`, or from the start."""
        at, kinds = self.at, len(self.particles)
        sums, every = arrays.total[at.FLIGHT_SUMS :], arrays.counter[at.FLIGHT_COUNTS :].copy()
        before = np.zeros(kinds)
        if then is not None:  # at the start no flight was under way
            sums, every = sums - then[at.FLIGHT_SUMS :], every - self.counts_then
            before = self.paths_before
        sums = sums.reshape(kinds, 2, at.FLIGHT_SUM)
        first, square, cube = at.PER_MOMENT
        powers = self.sum_units[:, :, None] * np.ones(3)
        path_units, time_units = np.cumprod(powers, axis=2).transpose(1, 0, 2)
        by_speed = sums[:, :, at.SPEED_FLIGHTS :].reshape(kinds, 2, at.SPEED_BINS, 2)
        # All sums are rounded once: what is added up before that is exact.
        by_speed, all_flights = by_speed.sum(axis=1) / first, by_speed.sum(axis=2).sum(axis=1) / first
        higher = sums[:, :, at.HIGHER_MOMENTS : at.SPEED_FLIGHTS].sum(axis=1) / [square, cube, square, cube]
        moments = np.hstack([all_flights[:, :1], higher[:, :2], all_flights[:, 1:], higher[:, 2:]])
        path_sums, time_sums = moments[:, :3] * path_units, moments[:, 3:] * time_units
        first_paths = sums[:, :, at.FIRST_PATH].sum(axis=1) / first * self.sum_units[:, 0]
        counts, pairs = every[: -kinds * kinds].reshape(kinds, -1), every[-kinds * kinds :].reshape(kinds, -1)
        speeds = SPEED_BIN * np.append(np.arange(at.SPEED_BINS, dtype=np.float64), math.inf)
        path, time, speed = self.units.T[:, :, None]
        return FreePaths(
            passed,
            self.particles.copy(),
            counts[:, at.FLIGHTS_ENDED],
            counts[:, at.FIRST_FLIGHTS],
            (first_paths + path_sums[:, 0]) + self._under_way(arrays, *now) - before,
            path_sums,
            time_sums,
            path * octave_edges(at),
            counts[:, at.PATH_BINS : at.PATH_BINS + at.FLIGHT_BINS],
            time * octave_edges(at),
            counts[:, at.TIME_BINS : at.TIME_BINS + at.FLIGHT_BINS],
            speed * speeds,
            counts[:, at.SPEED_COUNTS : at.SPEED_COUNTS + at.SPEED_BINS],
            by_speed[:, :, 0] * path_units[:, :1],
            by_speed[:, :, 1] * time_units[:, :1],
            pairs + pairs.T - np.diag(np.diag(pairs)),
        )
