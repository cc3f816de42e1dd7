"""Touching balls: Newton's cradle, and impacts on several balls at once.

When several pairs touch at one time, the engine executes their collisions in the order (time, lower id,
higher id). The outcome of a cradle does not depend on the order. That of a ball that hits two at once, or of
a rack of balls, does: hard-sphere dynamics does not define simultaneous impacts of these, the limits from
either side differ, and the documented order is a choice. Exact are then the result for that order, momentum
and energy.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import hardspheres as hs
from hardspheres.scene import kinetic_energy, total_momentum
from studies.validation.hard_cases.case import Case, Size, kept, pick
from studies.validation.hard_cases.rational import as_floats, rational_simulation

TITLE = "Cradles and simultaneous impacts"
ROUNDINGS = 2e-15


def cradle(balls: int, moving: int, dim: int) -> hs.Scene:
    """Return a row of touching balls, of which the first few, also touching, move towards the rest.

    Parameters
    ----------
    balls, moving : int
        Number of balls, and of those that arrive with speed 1 from half a diameter away.
    dim : int
        2 or 3.
    """
    positions = np.full((balls, dim), 2.0)
    positions[:, 0] += np.arange(balls)
    positions[:moving, 0] -= 0.5
    velocities = np.zeros((balls, dim))
    velocities[:moving, 0] = 1.0
    return hs.Scene(positions, velocities, box=[48.0] * dim)


def rack(rows: int) -> hs.Scene:
    """Return a cue ball moving towards a triangle of discs, each of which touches those of the next row.

    Diameters are 5 and neighbours are 4 along and 3 across apart, so that they touch exactly.
    """
    places = [(12.0, 40.0)]
    places += [(20.0 + 4.0 * row, 40.0 + 6.0 * k - 3.0 * row) for row in range(rows) for k in range(row + 1)]
    velocities = np.zeros((len(places), 2))
    velocities[0, 0] = 1.0
    return hs.Scene(places, velocities, 2.5, box=(80.0, 80.0))


def into_the_gap() -> hs.Scene:
    """Return a disc that hits two others, 3 above and below its path, at one moment."""
    return hs.Scene(
        [(12.0, 40.0), (20.0, 37.0), (20.0, 43.0)], [(1.0, 0.0), (0, 0), (0, 0)], 2.5, box=(80.0, 80.0)
    )


@kept
def outcome(name: str, scene: hs.Scene, until: float) -> Case:
    """Compare velocities after a simultaneous impact with exact arithmetic in the documented order."""
    exact = rational_simulation(scene)
    while (event := exact.step()).time <= until:
        pairs, velocities = exact.collisions, np.array(as_floats(exact.velocities))
    del event
    simulation = hs.Simulation(scene)
    simulation.run(time=until)
    off = float(np.abs(simulation.velocities - velocities).max())
    # Touching discs at relative rest may, by a rounding, approach at 1e-17: one more collision, without
    # effect.
    return Case(
        name,
        f"{pairs} collisions in the order (time, lower id, higher id), in rationals",
        f"{simulation.collisions}, velocities off by {off:.1e}",
        off,
        ROUNDINGS,
    )


def conserved(name: str, scene: hs.Scene, until: float) -> Case:
    """Check momentum and energy of an impact without a unique outcome; report its asymmetry."""
    simulation = hs.Simulation(scene)
    simulation.run(time=until)
    momentum = total_momentum(simulation.velocities, scene.masses) - total_momentum(
        scene.velocities, scene.masses
    )
    energy = kinetic_energy(simulation.velocities, scene.masses) / scene.kinetic_energy - 1.0
    sideways = float(np.abs(simulation.velocities[0, 1]))
    return Case(
        name,
        "momentum and energy; the outcome is not unique",
        f"{simulation.collisions} collisions, striker leaves sideways with {sideways:.2g}",
        max(float(np.abs(momentum).max()), abs(energy)),
        ROUNDINGS,
    )


def cases(size: Size) -> Iterator[Case]:
    """Yield the cradles of each length, then the simultaneous impacts."""
    dims = pick(size, ((2,), (2, 3), (2, 3)))
    for dim in dims:
        off, wrong, tried = 0.0, 0, 0
        for balls in range(2, 11):
            for moving in range(1, balls):
                simulation = hs.Simulation(cradle(balls, moving, dim))
                simulation.run(time=2.0)
                ideal = np.zeros((balls, dim))
                ideal[balls - moving :, 0] = 1.0
                tried += 1
                off = max(off, float(np.abs(simulation.velocities - ideal).max()))
                wrong += simulation.collisions != moving * (balls - moving)
        yield Case(
            f"cradles of 2 to 10 balls, {dim}D",
            "k in, k out; k (n - k) collisions",
            f"{tried - wrong} of {tried}, velocities off by {off:.1e}",
            off if wrong == 0 else 1.0,
            ROUNDINGS,
        )
    yield outcome("a ball into the gap of two", into_the_gap(), 10.0)
    yield conserved("a ball into the gap of two", into_the_gap(), 10.0)
    for rows in pick(size, ((3,), (3, 4, 5), (3, 4, 5))):
        yield outcome(f"break shot, {rows} rows", rack(rows), 4.0)
        yield conserved(f"break shot, {rows} rows", rack(rows), 4.0)
