"""Obstacles: Sinai's billiard, and obstacles hit at grazing incidence.

The mean free path of a billiard is pi A / P of its free area A and the length P of its edge, exact (Santalo's
formula; Chernov, J. Stat. Phys. 88, 1 (1997)): (1 - pi R^2) / (2 R) on a torus of edge 1. Places are compared
with 60 digits for as many collisions as chaos allows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import mpmath
import numpy as np

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation
from studies.validation.hard_cases.case import EPS, Case, Size, counted, kept, pick

TITLE = "Obstacles"
DIGITS = 60
RUNS = 64
NEAREST = 52  # 2^-NEAREST: how close to 1 a grazing impact parameter comes


def billiard(radius: float = 0.4) -> hs.Scene:
    """Return a disc round an obstacle on a torus of edge 1; both radii together are `radius`."""
    return hs.Scene(
        [[0.5, 0.5], [0.05, 0.02]],
        [[0.0, 0.0], [0.6, 0.8]],
        radius / 2.0,
        [math.inf, 3.0],
        (1.0, 1.0),
    )


@kept
def free_path(collisions: int) -> Case:
    """Compare the mean free path with Santalo's, in standard errors of its parts."""
    simulation, radius = hs.Simulation(billiard()), 0.4
    ends = []
    for _ in range(RUNS):
        simulation.run(collisions=collisions // RUNS)
        ends.append(simulation.time)
    paths = np.diff([0.0, *ends]) / (collisions // RUNS)
    exact = (1.0 - math.pi * radius * radius) / (2.0 * radius)
    mean, error = float(paths.mean()), float(paths.std(ddof=1)) / math.sqrt(RUNS)
    return Case(
        f"Sinai's billiard, {collisions:.0e} collisions",
        f"mean free path {exact:.6f} (Santalo)",
        f"{mean:.6f} +- {error:.6f}",
        abs(mean - exact) / exact,
        allowed=5.0 * error / exact,
    )


@kept
def speed(collisions: int) -> Case:
    """Compare the speed with that at the start.

    One rounding a collision; as r.r is nearly the same in all of them, 0.003 eps of it has one sign (here).
    """
    simulation = hs.Simulation(billiard())
    simulation.run(collisions=collisions)
    off = abs(simulation.energy_drift)
    return Case(
        f"Sinai's billiard, {collisions:.0e} collisions",
        "the energy of the start",
        f"off by {off:.1e}",
        off,
        allowed=10.0 * EPS * math.sqrt(collisions) + 0.01 * EPS * collisions,
    )


def followed(collisions: int) -> Case:
    """Compare the place after so many collisions with that of the all-pairs solver, in 60 digits."""
    scene = billiard()
    simulation = hs.Simulation(scene)
    simulation.run(collisions=collisions)
    with mpmath.workdps(DIGITS):
        exact = ReferenceSimulation(scene, mpmath.mpf, mpmath.sqrt)
        while exact.collisions < collisions:
            exact.step()
        place = np.array([float(x) for x in exact.positions[1]])
    off = simulation.positions[1] - place
    far = float(np.abs(off - np.rint(off)).max())
    name = f"{collisions} collisions in {DIGITS} digits"
    return Case("Sinai's billiard, chaotic", name, f"place off by {far:.1e}", far, allowed=1e-6)


def grazing() -> Case:
    """Count which of the discs that fly by an obstacle at 1 -+ 2^-k contact distances meet it."""
    right = 0
    for k in range(10, NEAREST + 1):
        for sign in (-1.0, 1.0):
            height = 1.0 + sign * 2.0**-k
            scene = hs.Scene(
                [[5.0, 5.0], [2.0, 5.0 + height]],
                [[0.0, 0.0], [1.0, 0.0]],
                [0.75, 0.25],
                [math.inf, 3.0],
                (10.0, 10.0),
            )
            simulation = hs.Simulation(scene)
            simulation.run(time=5.0)
            meets = float(scene.positions[1, 1]) - 5.0 < 1.0
            right += int((simulation.collisions == 1) == meets and abs(simulation.energy_drift) < 4.0 * EPS)
    tried = 2 * (NEAREST - 9)
    return counted("an obstacle hit, or missed, at grazing incidence", tried, right, "told apart")


def cases(size: Size) -> Iterator[Case]:
    """Yield the billiard, and grazing hits."""
    for collisions in pick(size, ((640_000,), (640_000, 6_400_000), (6_400_000, 640_000_000))):
        yield free_path(collisions)
        yield speed(collisions)
    yield followed(12)
    yield grazing()
