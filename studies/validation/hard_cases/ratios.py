"""Masses, diameters and speeds many orders of magnitude apart in one gas.

Exact are energy, momentum, and the absence of overlaps; at first, before chaos has amplified roundings, also
the events, which the reference solver with 50 digits gives. The depth of the worst overlap measures the
accuracy of contacts: about a rounding of the time within an epoch, times the speed. Epochs become shorter
where light particles become much faster than any was at the start, but only when one ends: in an epoch in
which a light particle is squeezed between heavy ones, its contact errors grow with its speed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation
from hardspheres.scene import to_nearest_image
from studies.validation.hard_cases.case import EPS, Case, Size, kept, pick

TITLE = "Wide ratios of mass, diameter and speed"
# of energy and momentum, or ten roundings times the root of the number of collisions, over N: a random walk
DRIFT = 1e-12
OVERLAP = 1e-11  # diameters
AGREED = 1e-6  # deviation from the oracle up to which events are compared

Floats = NDArray[np.float64]


def gas(dim: int, masses: Floats, radii: Floats, packing_fraction: float, boundary: str) -> hs.Scene:
    """Return a gas at random positions with Maxwell velocities (see `hardspheres.random_gas`)."""
    return hs.random_gas(
        n=len(radii),
        packing_fraction=packing_fraction,
        dim=dim,
        boundary=boundary,
        masses=masses,
        radii=radii,
        seed=4,
    )


@kept
def invariants(name: str, scene: hs.Scene, collisions: int) -> Case:
    """Run a gas and check energy, momentum, overlap and the order of events at ten moments.

    Parameters
    ----------
    name : str
        Of the case.
    scene : Scene
        The gas.
    collisions : int
        How many.
    """
    simulation = hs.Simulation(scene)
    energy = momentum = depth = 0.0
    late = 0
    for _ in range(10):
        simulation.run(collisions=collisions // 10)
        energy = max(energy, abs(simulation.energy_drift))
        momentum = max(momentum, float(np.abs(simulation.momentum_drift).max()))
        depth = max(depth, simulation.worst_overlap)
        late = int(simulation.status()["late_events"])
    drift = max(DRIFT, 10.0 * EPS * math.sqrt(collisions) / scene.n)
    return Case(
        name,
        f"energy, momentum, no overlap, {collisions:.0e} collisions",
        f"energy {energy:.1e}, momentum {momentum:.1e}, overlap {depth:.1e}, {late} late",
        max(energy / drift, momentum / drift, depth / OVERLAP) * drift if late == 0 else 1.0,
        drift,
    )


@kept
def resolved(name: str, scene: hs.Scene, looks: int) -> Case:
    """Compare, every hundred collisions, the deepest overlap with time resolution times the largest speed.

    Parameters
    ----------
    name : str
        Of the case.
    scene : Scene
        The gas.
    looks : int
        How often.
    """
    simulation = hs.Simulation(scene)
    smallest = 2.0 * float(scene.radii.min())
    deepest = ratio = fastest = 0.0
    for _ in range(looks):
        simulation.run(collisions=100)
        depth = simulation.worst_overlap
        speed = float(np.sqrt(np.max(np.sum(simulation.velocities**2, axis=1))))
        resolution = (
            EPS * (speed * float(simulation.status()["epoch_length"]) + float(scene.box.max())) / smallest
        )
        deepest, fastest, ratio = max(deepest, depth), max(fastest, speed), max(ratio, depth / resolution)
    gain = fastest / float(np.abs(scene.velocities).max())
    return Case(
        name,
        "overlap within eps (fastest x epoch + box)",
        f"{ratio:.1g} of it at most, {deepest:.0e} diameters; {gain:.0e} times faster than initially",
        max(ratio - 1.0, 0.0),
    )


@kept
def followed(name: str, scene: hs.Scene, most: int) -> Case:
    """Compare the events with the reference solver at 50 digits, until trajectories differ by 1e-6.

    Parameters
    ----------
    name : str
        Of the case.
    scene : Scene
        The gas.
    most : int
        Pair collisions to compare.
    """
    simulation = hs.Simulation(scene)
    size, fastest = 2.0 * float(scene.radii.min()), float(np.abs(scene.velocities).max())
    agreed, off, first = 0, 0.0, 0.0
    with mpmath.workdps(50):
        oracle = ReferenceSimulation(scene, mpmath.mpf, mpmath.sqrt)
        while agreed < most and off <= AGREED:
            before = simulation.velocities
            event = _next_pair(oracle)
            simulation.run(collisions=1)
            changed = set(np.flatnonzero((simulation.velocities != before).any(axis=1)).tolist())
            if not event <= changed:
                break
            off = _distance(simulation, oracle, size, fastest)
            first = first or off
            agreed += 1
    return Case(
        name,
        f"the first {most} collisions at 50 digits",
        f"{agreed} the same; state off by {first:.0e} after one, {off:.0e} at last",
        first if agreed == most or off > AGREED else 1.0,
        1e-9,
    )


def _next_pair(oracle: ReferenceSimulation) -> set[int]:
    while (event := oracle.step()).second >= len(oracle.positions):
        pass
    return {event.first, event.second}


def _distance(simulation: hs.Simulation, oracle: ReferenceSimulation, size: float, fastest: float) -> float:
    """Return the largest deviations of positions (smallest diameters) and velocities (largest speeds)."""
    dx = to_nearest_image(
        simulation.positions - np.array(oracle.positions, dtype=np.float64), simulation.scene
    )
    dv = simulation.velocities - np.array(oracle.velocities, dtype=np.float64)
    return max(float(np.abs(dx).max()) / size, float(np.abs(dv).max()) / fastest)


def cold(scene: hs.Scene) -> hs.Scene:
    """Return the gas with its light half at rest: collisions make it faster than any initial speed."""
    velocities = np.random.default_rng(2).normal(size=scene.velocities.shape)
    velocities[scene.masses == scene.masses.min()] = 0.0
    return scene.replace(velocities=velocities)


def decades(scene: hs.Scene) -> hs.Scene:
    """Return the gas with speeds from 1e-9 to 1e9, and one particle at rest."""
    n = scene.n
    velocities = np.random.default_rng(3).normal(size=scene.velocities.shape)
    velocities *= 10.0 ** np.linspace(-9.0, 9.0, n)[:, None] / np.linalg.norm(velocities, axis=1)[:, None]
    velocities[n // 2] = 0.0
    return scene.replace(velocities=velocities)


def cases(size: Size) -> Iterator[Case]:
    """Yield gases of each ratio."""
    n, collisions = pick(size, (64, 64, 1000)), pick(size, (10_000, 100_000, 10_000_000))
    odd = np.arange(n) % 2 == 1
    radii = np.where(odd, 0.5, 0.3)
    kinds: Any = {3: "periodic", 2: "wall"}
    for dim, boundary in kinds.items():
        for ratio in pick(size, ((1e12,), (1e3, 1e6, 1e9, 1e12), (1e3, 1e6, 1e9, 1e12))):
            scene = gas(dim, np.where(odd, ratio, 1.0), radii, 0.1, boundary)
            yield invariants(f"masses 1:{ratio:.0e}, {dim}D", scene, collisions)
        yield invariants(f"masses 1:{ratio:.0e}, {dim}D, light ones at rest", cold(scene), collisions)
        yield resolved(
            f"masses 1:{ratio:.0e}, {dim}D, accelerated", cold(scene), pick(size, (100, 1000, 10_000))
        )
        for ratio in pick(size, ((1e3,), (1e1, 1e2, 1e3), (1e1, 1e2, 1e3))):
            large = np.arange(n) == 0
            scene = gas(dim, np.where(large, 100.0, 1.0), np.where(large, 0.5, 0.5 / ratio), 0.02, boundary)
            yield invariants(f"diameters 1:{ratio:.0e}, {dim}D", scene, collisions // 10)
        scene = gas(dim, np.where(odd, 3.0, 1.0), radii, 0.1, boundary)
        yield invariants(f"speeds 1e-9 to 1e9, one at rest, {dim}D", decades(scene), collisions)
        few = gas(dim, np.where(odd, 1e12, 1.0)[:8], radii[:8], 0.02, boundary)
        events = pick(size, (8, 20, 20))
        yield followed(f"masses 1:1e12, {dim}D, 8 particles", few, events)
        yield followed(f"speeds 1e-9 to 1e9, {dim}D, 8 particles", decades(few), events)
