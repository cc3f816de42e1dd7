"""Symmetries: units, order of particles, reflections, the origin, and a common velocity.

Lengths and times scaled by powers of two must give the same bits. The other symmetries change roundings,
which chaos amplifies: events agree up to half the predictability horizon of float64 (17 collisions per
particle at packing fraction 0.2), and statistics after it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from studies.validation.hard_cases.case import Case, Size, kept, pick

TITLE = "Symmetries"
HALF_HORIZON = 17.0
"""Collisions per particle: 32 / lambda / 2 with lambda = 0.974."""

Transformation = Callable[[hs.Scene, np.random.Generator], tuple[hs.Scene, NDArray[np.int64]]]


def sequence(scene: hs.Scene, collisions: int) -> list[tuple[int, ...]]:
    """Return the partners of all collisions, in order; the scene is periodic."""
    simulation = hs.Simulation(scene)
    pairs = []
    before = simulation.velocities
    for _ in range(collisions):
        simulation.run(collisions=1)
        after = simulation.velocities
        pairs.append(tuple(np.flatnonzero((after != before).any(axis=1)).tolist()))
        before = after
    return pairs


def permuted(scene: hs.Scene, rng: np.random.Generator) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the particles in another order, and the permutation."""
    order = rng.permutation(scene.n)
    moved = hs.Scene(
        scene.positions[order], scene.velocities[order], scene.radii[order], scene.masses[order], scene.box
    )
    return moved, order


def mirrored(scene: hs.Scene, rng: np.random.Generator) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the mirror image along a random axis."""
    sign = np.ones(scene.dim)
    sign[rng.integers(scene.dim)] = -1.0
    return _same(scene, scene.positions * sign % scene.box, scene.velocities * sign)


def shifted(scene: hs.Scene, rng: np.random.Generator) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the gas shifted by a vector and wrapped into the box."""
    return _same(
        scene, (scene.positions + rng.normal(size=scene.dim) * scene.box) % scene.box, scene.velocities
    )


def shifted_by_lattice_vector(
    scene: hs.Scene, rng: np.random.Generator
) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the gas shifted by whole boxes and back."""
    shift = rng.integers(-9, 10, scene.dim) * scene.box
    return _same(scene, (scene.positions + shift) % scene.box, scene.velocities)


def turned(scene: hs.Scene, rng: np.random.Generator) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the gas with its axes in another order."""
    axes = np.roll(np.arange(scene.dim), 1)
    moved = hs.Scene(
        scene.positions[:, axes], scene.velocities[:, axes], scene.radii, scene.masses, scene.box[axes]
    )
    return moved, np.arange(scene.n)


def boosted(scene: hs.Scene, rng: np.random.Generator) -> tuple[hs.Scene, NDArray[np.int64]]:
    """Return the gas in a moving frame: all velocities with a constant added."""
    return _same(scene, scene.positions, scene.velocities + rng.normal(size=scene.dim))


def _same(
    scene: hs.Scene, positions: NDArray[np.float64], velocities: NDArray[np.float64]
) -> tuple[hs.Scene, NDArray[np.int64]]:
    inside = np.where(
        positions < scene.box, positions, 0.0
    )  # a rounding below 0 comes back as the edge itself
    return hs.Scene(inside, velocities, scene.radii, scene.masses, scene.box), np.arange(scene.n)


TRANSFORMATIONS: dict[str, Transformation] = {
    "particles in another order": permuted,
    "mirror image": mirrored,
    "shift by a vector": shifted,
    "shift by whole boxes": shifted_by_lattice_vector,
    "axes in another order": turned,
    "Galilean boost": boosted,
}


def agreement(scene: hs.Scene, name: str, collisions: int, seed: int) -> int:
    """Return the number of collisions over which a gas and its transformed twin have the same partners."""
    twin, who = TRANSFORMATIONS[name](scene, np.random.default_rng(seed))
    here, there = sequence(scene, collisions), sequence(twin, collisions)
    for agreed, (one, other) in enumerate(zip(here, there, strict=True)):
        if set(one) != set(who[list(other)].tolist()):
            return agreed
    return collisions


def scaled(scene: hs.Scene, length: float, time: float) -> hs.Scene:
    """Return the same gas in other units."""
    return hs.Scene(
        scene.positions * length,
        scene.velocities * (length / time),
        scene.radii * length,
        scene.masses,
        scene.box * length,
    )


@kept
def same_bits(scene: hs.Scene, length: float, time: float, collisions: int) -> bool:
    """Return whether a gas in other units, powers of two, follows the same trajectory to the last bit."""
    one, other = hs.Simulation(scene), hs.Simulation(scaled(scene, length, time))
    one.run(collisions=collisions)
    other.run(collisions=collisions)
    return (
        np.array_equal(one.positions * length, other.positions)
        and np.array_equal(one.velocities * (length / time), other.velocities)
        and one.time * time == other.time
    )


@kept
def compressibility(scene: hs.Scene, collisions: int) -> float:
    """Return Z - 1 over so many collisions, after a tenth as many."""
    simulation = hs.Simulation(scene)
    simulation.run(collisions=collisions // 10)
    simulation.reset_tallies()
    simulation.run(collisions=collisions)
    return simulation.compressibility_factor - 1.0


def cases(size: Size) -> Iterator[Case]:
    """Yield the bitwise symmetry, then the others: events up to half the horizon, statistics after."""
    n = pick(size, (16, 32, 64))
    scene = hs.random_gas(n=n, packing_fraction=0.2, seed=3)
    units = ((2.0, 1.0), (1.0, 0.5), (2.0**-40, 1.0), (2.0**20, 2.0**-30))
    same = sum(same_bits(scene, length, time, pick(size, (1000, 10**5, 10**7))) for length, time in units)
    yield Case(
        "units of length and time by powers of two",
        "the same bits",
        f"{same} of {len(units)}",
        float(len(units) - same),
    )
    collisions, seeds = int(HALF_HORIZON * n / 2), pick(size, (1, 6, 30))
    long = pick(size, (20_000, 400_000, 10**7))
    reference = compressibility(scene, long)
    allowed = (
        4.5 * math.sqrt(2.0) * 1.3 / math.sqrt(long)
    )  # the error of Z - 1 is 1.0 to 1.3 / sqrt(collisions)
    for number, name in enumerate(TRANSFORMATIONS):
        agreed = min(agreement(scene, name, collisions, seed) for seed in range(seeds))
        yield Case(
            f"{name}, {n} spheres",
            f"the same {collisions} collisions, half the horizon",
            f"{agreed} the same at least, {seeds} times",
            1.0 - agreed / collisions,
        )
        twin, _ = TRANSFORMATIONS[name](scene, np.random.default_rng(number))
        off = abs(compressibility(twin, long) / reference - 1.0)
        yield Case(
            f"{name}, after the horizon",
            f"the same Z - 1 to {allowed:.1e} (4.5 standard errors)",
            f"off by {off:.1e}",
            off,
            allowed,
        )
