"""Gases whose collision counts are known exactly."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.theory.two_spheres import two_sphere_rates
from studies.validation.hard_cases.case import EPS, Case, Size, counted, kept, pick

TITLE = "Exactly solved"
Floats = NDArray[np.float64]
CHANNEL = ("periodic", "wall", "periodic")


def fractions(numbers: Floats) -> list[Fraction]:
    """Return floats as the rational numbers that they are."""
    return [Fraction(x) for x in numbers.tolist()]


def in_equilibrium(box: tuple[float, ...], rng: np.random.Generator) -> hs.Scene:
    """Return two spheres in a hard box, drawn from the microcanonical ensemble of energy 1."""
    edges = np.array(box)
    while True:
        places = 0.5 + rng.random((2, len(box))) * (edges - 1.0)
        if float(np.sum((places[0] - places[1]) ** 2)) > 1.0:
            break
    velocities = rng.standard_normal((2, len(box)))
    velocities *= math.sqrt(2.0 / float((velocities**2).sum()))
    return hs.Scene(places, velocities, box=box, boundary="wall")


@kept
def two_spheres(box: tuple[float, ...], time: float, runs: int) -> Iterator[Case]:
    """Measure the rates of two spheres in a hard box.

    The ensemble is stationary, so that the mean number of collisions in any fixed time is exact. The mean
    time of a fixed number of collisions is not usable: the two can pass each other for very long times, these
    rare flights are missing in most samples, and the rate then appears too high, by several of its too small
    standard errors.

    Parameters
    ----------
    box : tuple of float
        Edges.
    time : float
        Of each run.
    runs : int
        How many.
    """
    rng, rates = np.random.default_rng(1), []
    for _ in range(runs):
        simulation = hs.Simulation(in_equilibrium(box, rng))
        simulation.run(time=time)
        rates.append((simulation.collisions / time, simulation.wall_collisions / time))
    exact = two_sphere_rates(box)
    means, errors = np.mean(rates, axis=0), np.std(rates, axis=0, ddof=1) / math.sqrt(runs)
    for what, mean, error, truth in zip(
        ("pair", "wall"), means.tolist(), errors.tolist(), (exact.pair, float(exact.wall.sum())), strict=True
    ):
        yield Case(
            f"two {'discs' if len(box) == 2 else 'spheres'} in a hard box, {what} rate",
            f"{truth:.5f}",
            f"{mean:.5f} +- {error:.5f}",
            abs(mean / truth - 1.0),
            4.5 * error / truth,  # 7e-6 by chance
        )


def line(masses: tuple[float, float, float], gaps: Floats, velocities: Floats) -> hs.Scene:
    """Return three discs on the middle line of a channel; the smaller one in the middle has no effect."""
    radii = np.array([0.5, 0.25, 0.5])
    x = 500.0 + np.array([-gaps[0] - 0.75, 0.0, gaps[1] + 0.75])
    places = np.column_stack([x, np.full(3, 2.0)])
    return hs.Scene(places, np.column_stack([velocities, np.zeros(3)]), radii, masses, (1000.0, 4.0), "wall")


@kept
def three_balls(masses: tuple[float, float, float], starts: int) -> Case:
    """Search for the largest number of collisions of three balls on a line without walls."""
    m1, m2, m3 = masses
    most = math.ceil(math.pi / math.acos(math.sqrt(m1 * m3 / ((m1 + m2) * (m2 + m3)))))
    rng, seen = np.random.default_rng(2), 0
    for _ in range(starts):
        velocities = np.array([1.0, rng.uniform(-1.0, 1.0), -rng.uniform(0.5, 1.0)])
        simulation = hs.Simulation(line(masses, rng.uniform(1e-4, 0.5, 2), velocities))
        simulation.run(time=100.0)
        seen = max(seen, simulation.collisions)
    return counted(
        f"three balls on a line, masses {m1:g}, {m2:g}, {m3:g}", most, seen, "collisions at most, and reached"
    )


def rods(n: int, walls: bool, seed: int) -> hs.Scene:
    """Return spheres on a line, along the second axis: on a ring, or between walls."""
    rng = np.random.default_rng(seed)
    length = 2.0 * n
    along = np.sort(rng.random(n)) * (length - n) + np.arange(n) + 0.5
    places = np.full((n, 3), 2.0)
    places[:, 1] = along
    velocities = np.zeros((n, 3))
    velocities[:, 1] = rng.normal(size=n)
    return hs.Scene(places, velocities, box=(4.0, length, 4.0), boundary=CHANNEL if walls else "periodic")


@kept
def tonks(n: int, walls: bool, time: float) -> Iterator[Case]:
    """Count the collisions of rods (Tonks 1936, doi:10.1103/PhysRev.50.955).

    Equal rods exchange velocities, so with their lengths removed they are points that pass through each
    other: each pair of points on a ring of length L - N sigma meets whenever their distance is a multiple of
    it, and each point between walls hits one after each such distance.
    """
    scene = rods(n, walls, 5)
    simulation = hs.Simulation(scene)
    simulation.run(time=time)
    free = Fraction(float(scene.box[1])) - n
    points = [x - Fraction(1, 2) - k for k, x in enumerate(fractions(scene.positions[:, 1]))]
    velocities, duration = fractions(scene.velocities[:, 1]), Fraction(time)
    where = "between walls" if walls else "on a ring"
    if walls:
        hits = sum(
            abs(math.floor((x + v * duration) / free)) for x, v in zip(points, velocities, strict=True)
        )
        yield counted(f"{n} rods {where}, time {time:g}", hits, simulation.wall_collisions, "wall collisions")
    else:
        pairs = 0
        for (x, v), (y, w) in itertools.combinations(zip(points, velocities, strict=True), 2):
            pairs += abs(math.floor((x - y + (v - w) * duration) / free) - math.floor((x - y) / free))
        yield counted(f"{n} rods {where}, time {time:g}", pairs, simulation.collisions, "collisions")
    speeds = [np.sort(np.abs(v[:, 1])) for v in (scene.velocities, simulation.velocities)]
    off = float(np.abs(speeds[0] - speeds[1]).max())
    # Rods exchange the same ten numbers repeatedly, and roundings of equal numbers are equal: they add up,
    # one per collision.
    allowed = max(1e-11, EPS * 2.0 * simulation.collisions / n)
    yield Case(f"{n} rods {where}, velocities", "the first ones, permuted", f"off by {off:.1e}", off, allowed)


@kept
def one_ball(time: float) -> Iterator[Case]:
    """Follow one ball in a box with incommensurate speeds: hits and place by unfolding the box."""
    box = (3.0, 4.0, 5.0)
    scene = hs.Scene(
        [[0.75, 1.25, 2.5]], [[math.sqrt(2.0), math.sqrt(3.0), math.pi]], box=box, boundary="wall"
    )
    simulation = hs.Simulation(scene)
    simulation.run(time=time)
    hits, off = 0, 0.0
    for x, v, edge, end in zip(
        fractions(scene.positions[0]),
        fractions(scene.velocities[0]),
        box,
        fractions(simulation.positions[0]),
        strict=True,
    ):
        free = Fraction(edge) - 1
        unfolded = x - Fraction(1, 2) + v * Fraction(time)
        count = math.floor(unfolded / free)
        rest = unfolded - count * free
        hits += abs(count)
        place = (rest if count % 2 == 0 else free - rest) + Fraction(1, 2)
        off = max(off, abs(float(place - end)))
    yield counted("one ball in a box, incommensurate speeds", hits, simulation.wall_collisions, "bounces")
    yield Case(
        f"one ball in a box, its place after {hits:.0e} bounces",
        "by unfolding, in rationals",
        f"off by {off:.1e} diameters",
        off,
        1e-16 * hits + 1e-14,
    )


def cases(size: Size) -> Iterator[Case]:
    """Yield two spheres, three balls, rods, one ball."""
    runs, time = pick(size, (200, 2000, 20_000)), pick(size, (50.0, 200.0, 1000.0))
    boxes: tuple[tuple[float, ...], ...] = ((2.6, 3.1, 3.7), (2.7, 3.6))
    for box in pick(size, (boxes[:1], boxes, boxes)):
        yield from two_spheres(box, time, runs)
    for masses in ((1.0, 1.0, 1.0), (1.0, 0.1, 1.0)):
        yield three_balls(masses, pick(size, (100, 1000, 10_000)))
    for walls in (False, True):
        yield from tonks(10, walls, pick(size, (100.0, 10_000.0, 3e6)))
    yield from one_ball(pick(size, (1e4, 1e6, 5e8)))
