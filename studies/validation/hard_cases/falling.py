"""Gravity: balls that bounce very often, columns of two balls, a corner that gravity pulls to, and pins.

Two balls of equal masses in a column exchange their energies in every collision, measured from where each
could fall to, so the set of the two never changes. Where the lower one is heavier the motion is chaotic
(Wojtkowski, Commun. Math. Phys. 126, 507 (1990); Simanyi, arXiv:2407.12033). Then places are compared with 60
digits, for as many collisions as chaos allows, and so are those of discs in a corner and among the pins of a
Galton board, which do not fall: elastic balls climb back up it for ever (Chernov, Dolgopyat, J. Amer. Math.
Soc. 22, 821 (2009)).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import mpmath
import numpy as np

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation
from studies.validation.hard_cases.case import EPS, Case, Size, counted, kept, pick

TITLE = "Gravity"
DIGITS = 60
NEAREST = 46  # 2^-NEAREST: how close to an obstacle's edge a parabola passes it


def column(lower: float, upper: float) -> hs.Scene:
    """Return two discs of these masses above each other, and a third one in a column of its own."""
    return hs.Scene(
        [[1.0, 1.5], [1.0, 2.9], [3.0, 2.0]],
        np.zeros((3, 2)),
        [0.5, 0.3, 0.4],
        [lower, upper, 0.7],
        (4.0, 16.0),
        "wall",
        gravity=(0.0, -1.0),
    )


def corner() -> hs.Scene:
    """Return two discs that gravity pulls to a corner."""
    return hs.Scene(
        [[1.0, 3.0], [2.0, 1.1]],
        [[0.3, 0.1], [0.0, 0.4]],
        [0.5, 0.3],
        [1.0, 2.0],
        (5.0, 5.0),
        "wall",
        gravity=(-1.0, -0.7),
    )


def board() -> hs.Scene:
    """Return a Galton board: rows of pins, each between those beside it, and a ball above them."""
    pins = [(float(k), float(y)) for y in range(2, 7) for k in range(1 + y % 2, 12, 2)]
    return hs.Scene(
        [*pins, (6.2, 9.0)],
        np.zeros((len(pins) + 1, 2)),
        [0.3] * len(pins) + [0.2],
        [math.inf] * len(pins) + [1.0],
        (12.0, 10.0),
        "wall",
        gravity=(0.0, -1.0),
    )


@kept
def among_pins(collisions: int) -> Case:
    """Compare kinetic and potential energy of a ball among pins with those at the start."""
    simulation = hs.Simulation(board())
    simulation.run(collisions=collisions)
    off = abs(simulation.energy_drift)
    return Case(
        f"a Galton board, {collisions:.0e} collisions",
        "the energy of the start, kinetic and potential",
        f"off by {off:.1e}",
        off,
        allowed=10.0 * EPS * math.sqrt(collisions),
    )


def grazing() -> Case:
    """Count which of the discs whose parabola tops an obstacle by 1 -+ 2^-k contact distances meet it."""
    right = 0
    for k in range(10, NEAREST + 1):
        for sign in (-1.0, 1.0):
            scene = hs.Scene(
                [[5.0, 3.0], [3.0, 3.5 + sign * 2.0**-k]],
                [[0.0, 0.0], [2.0, 1.0]],  # the top is after a time of 1, half a length higher
                [0.75, 0.25],
                [math.inf, 3.0],
                (10.0, 10.0),
                "wall",
                gravity=(0.0, -1.0),
            )
            simulation = hs.Simulation(scene)
            simulation.run(time=1.75)
            right += int((simulation.collisions == 1) == (sign < 0.0))
    return counted("an obstacle touched by a parabola", 2 * (NEAREST - 9), right, "told apart")


@kept
def bounces(count: float) -> Case:
    """Let discs bounce so often, and compare the height that each would rise to with that at the start."""
    scene = hs.Scene(
        [[1.0, 2.5], [3.0, 1.0]],
        np.zeros((2, 2)),
        [0.5, 0.3],
        [1.0, 2.0],
        (4.0, 4.0),
        "wall",
        gravity=(0.0, -0.7),
    )
    simulation = hs.Simulation(scene)
    simulation.run(time=count * 2.0 * math.sqrt(2.0 * 2.0 / 0.7))
    start, now = (
        state.positions[:, 1] - scene.radii + state.velocities[:, 1] ** 2 / 1.4
        for state in (scene, simulation)
    )
    off = float(np.abs(now / start - 1.0).max())
    return Case(
        f"{count:.0e} bounces", "the height of the first", f"heights off by {off:.1e}", off, allowed=8.0 * EPS
    )


@kept
def exchanged(collisions: int) -> Case:
    """Compare the set of the energies of two equal balls in a column with that at the start."""
    simulation = hs.Simulation(column(1.0, 1.0))

    def energies(positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        lowest = np.array([0.5, 1.3])
        return np.sort(positions[:2, 1] - lowest + 0.5 * velocities[:2, 1] ** 2)

    start = energies(simulation.scene.positions, simulation.scene.velocities)
    simulation.run(collisions=collisions)
    off = float(np.abs(energies(simulation.positions, simulation.velocities) / start - 1.0).max())
    return Case(
        f"a column of two equal balls, {collisions:.0e} collisions",
        "the energies of both, exchanged",
        f"off by {off:.1e}",
        off,
        allowed=10.0 * EPS * math.sqrt(collisions),
    )


def followed(name: str, scene: hs.Scene, collisions: int, allowed: float) -> Case:
    """Compare places after so many collisions with those of the all-pairs solver, in 60 digits."""
    simulation = hs.Simulation(scene)
    simulation.run(collisions=collisions)
    with mpmath.workdps(DIGITS):
        exact = ReferenceSimulation(scene, mpmath.mpf, mpmath.sqrt)
        hits = 0
        while exact.collisions < collisions:
            hits += exact.step().second >= scene.n
        places = np.array([[float(x) for x in row] for row in exact.positions])
    off = float(np.abs(simulation.positions - places).max())
    same = simulation.wall_collisions == hits
    return Case(
        name,
        f"{collisions} collisions and {hits} bounces, in {DIGITS} digits",
        f"{simulation.wall_collisions} bounces, places off by {off:.1e}",
        off if same else 1.0,
        allowed,
    )


def cases(size: Size) -> Iterator[Case]:
    """Yield the bounces, the columns, and the corner."""
    for count in pick(size, ((1e4,), (1e4, 1e6), (1e4, 1e6, 1e9))):
        yield bounces(count)
    for collisions in pick(size, ((10**4,), (10**4, 10**6), (10**4, 10**6, 10**8))):
        yield exchanged(collisions)
    yield followed("a column of two balls, masses 2:1, chaotic", column(2.0, 1.0), 15, 1e-7)
    yield followed("a column of two balls, masses 1:2", column(1.0, 2.0), 30, 1e-7)
    yield followed("two balls in a corner", corner(), 10, 1e-7)
    for collisions in pick(size, ((10**4,), (10**4, 10**6), (10**4, 10**6, 10**7))):
        yield among_pins(collisions)
    yield followed("a Galton board, chaotic", board(), 8, 1e-6)
    yield grazing()
