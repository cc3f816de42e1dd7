"""Boxes of a million diameters and of barely two, and long times."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

import hardspheres as hs
from studies.validation.hard_cases.case import EPS, Case, Size, pick
from studies.validation.hard_cases.ratios import followed, invariants

TITLE = "Large and small boxes, long times"


def aimed(size: float, offset: float = 0.6) -> hs.Scene:
    """Return two spheres that fly at each other across a box, with this impact parameter.

    Parameters
    ----------
    size : float
        Edge of the box in diameters; they start 0.43 of it apart.
    offset : float
        Impact parameter in diameters.
    """
    a, b = np.array([0.3, 0.2, 0.1]) * size, np.array([0.55, 0.45, 0.35]) * size
    along = (b - a) / np.linalg.norm(b - a)
    side = np.cross(along, [0.0, 0.0, 1.0])
    b += offset * side / np.linalg.norm(side)
    return hs.Scene([a, b], [along, -along], box=[size] * 3)


def tight(spheres: int) -> hs.Scene:
    """Return 2 or 4 spheres in a periodic box a billionth longer than two diameters."""
    places = 0.5 * np.array([[1, 1, 1], [3, 3, 1], [1, 3, 3], [3, 1, 3]])[:spheres]
    velocities = np.random.default_rng(8).normal(size=places.shape)
    return hs.Scene(places, velocities, box=[2.0 + 2e-9] * 3)


def late_meeting(wait: float) -> hs.Scene:
    """Return two slow spheres that meet late, and one that passes at speed 1 and sets the time scale."""
    speed = 5.0 / wait
    places = [[100.0, 20.0, 20.0], [111.0, 20.0, 20.0], [30.0, 80.0, 80.0]]
    return hs.Scene(places, [[speed, 0.0, 0.0], [-speed, 0.0, 0.0], [1.0, 0.0, 0.0]], box=[128.0] * 3)


def deflection(size: float) -> Case:
    """Compare the deflection of a sphere from far away with the exact one, 2 (1 - b^2) of its velocity."""
    simulation = hs.Simulation(aimed(size))
    simulation.run(collisions=1)
    along = simulation.scene.velocities[0]
    off = abs(float(np.dot(along - simulation.velocities[0], along)) - 2.0 * (1.0 - 0.6**2))
    return Case(
        f"two spheres meet in a box of {size:.0e} diameters",
        "deflection 2 (1 - b^2) at b = 0.6",
        f"off by {off:.1e}",
        off,
        4.0 * EPS * size + 1e-14,
    )


def straight(time: float, edge: float = 1000.0) -> Case:
    """Compare a free flight of many box lengths with rational arithmetic."""
    velocity = [0.7071, -0.31415, 1.4142]
    simulation = hs.Simulation(hs.Scene([[edge / 3, edge / 5, edge / 7]], [velocity], box=[edge] * 3))
    simulation.run(time=time)
    off = 0.0
    for x, v, end in zip(simulation.scene.positions[0], velocity, simulation.positions[0], strict=True):
        gap = (Fraction(float(x)) + Fraction(v) * Fraction(time) - Fraction(float(end))) / Fraction(edge)
        off = max(off, abs(float(gap - round(gap))))
    return Case(
        f"a flight of time {time:.0e} in a box of {edge:.0f}",
        "its place, in rationals",
        f"off by {off:.1e} of the box",
        off,
        1e-9,
    )


def cases(size: Size) -> Iterator[Case]:
    """Yield large boxes, small boxes, long times."""
    for edge in pick(size, ((1e6,), (1e2, 1e4, 1e6), (1e2, 1e4, 1e6, 1e8))):
        yield deflection(edge)
    dilute = hs.random_gas(n=64, packing_fraction=64 * math.pi / 6 / 1e6, dim=3, seed=5)
    yield invariants("64 spheres in a box of 100 diameters", dilute, pick(size, (1000, 100_000, 300_000)))
    for spheres in (2, 4):
        yield followed(
            f"{spheres} spheres in a box of 2 + 2e-9 diameters", tight(spheres), pick(size, (10, 60, 60))
        )
        yield invariants(
            f"{spheres} spheres in a box of 2 + 2e-9 diameters",
            tight(spheres),
            pick(size, (10_000, 10**6, 3 * 10**7)),
        )
    yield straight(pick(size, (1e7, 1e9, 1e9)))
    wait = pick(size, (1e6, 1e8, 1e9))
    simulation = hs.Simulation(late_meeting(wait))
    # On their own, `run(collisions=1)` would conclude that they never meet.
    simulation.run(time=0.999 * wait)
    simulation.run(collisions=1)
    off = abs(simulation.time / wait - 1.0)
    # Both places, up to 128, are rounded at each epoch's end, always by the same as their steps are; they are
    # 10 apart at first.
    epochs = wait / float(simulation.status()["epoch_length"])
    yield Case(
        f"two slow spheres meet after time {wait:.0e}",
        f"at {wait:.0e}",
        f"off by {off:.1e} of it",
        off,
        1e-12 + epochs * 64.0 * EPS / 10.0,
    )
