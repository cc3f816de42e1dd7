"""The largest Lyapunov exponent of hard spheres, in tangent space along the engine's events."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from studies.validation.hard_cases.case import kept

__all__ = ["Tangent", "largest_exponent"]

Floats = NDArray[np.float64]


class Tangent:
    """An infinitesimal deviation, propagated with its trajectory.

    In a collision the neighbour's spheres touch earlier or later by dt = -(n.dr)/(n.v), with n along r =
    x_i - x_j, v the relative velocity before it. Positions then change by the difference of the velocities
    times dt, and velocities by the derivative of the collision rule for a change dr + v dt of r (Dellago,
    Posch and Hoover 1996, doi:10.1103/PhysRevE.53.1485).

    Parameters
    ----------
    scene : Scene
        The gas; periodic.
    places, velocities : (N, d) array
        The deviation.
    """

    def __init__(self, scene: hs.Scene, places: Floats, velocities: Floats) -> None:
        self.box = scene.box
        self.radii, self.masses = scene.radii, scene.masses
        self.places, self.velocities = places.copy(), velocities.copy()

    def fly(self, time: float) -> None:
        """Free flight for a time."""
        self.places += self.velocities * time

    def collide(self, i: int, j: int, positions: Floats, before: Floats) -> None:
        """Propagate through the collision of i and j.

        Parameters
        ----------
        i, j : int
            The partners.
        positions, before : (N, d) array
            Positions at contact, and velocities before it.
        """
        r = positions[i] - positions[j]
        r -= self.box * np.rint(r / self.box)
        sigma = float(np.sqrt(r @ r))
        n, v = r / sigma, before[i] - before[j]
        vn = float(v @ n)
        dr, dv = self.places[i] - self.places[j], self.velocities[i] - self.velocities[j]
        dt = -float(dr @ n) / vn
        dn = (dr + v * dt) / sigma
        push = 2.0 * vn * n
        dpush = 2.0 * (float(dv @ n + v @ dn) * n + vn * dn)
        share = self.masses[j] / (self.masses[i] + self.masses[j])
        self.places[i] += share * push * dt
        self.places[j] -= (1.0 - share) * push * dt
        self.velocities[i] -= share * dpush
        self.velocities[j] += (1.0 - share) * dpush

    def renormalise(self) -> float:
        """Normalise the deviation and return the logarithm of its length."""
        length = math.sqrt(float(np.sum(self.places**2) + np.sum(self.velocities**2)))
        self.places /= length
        self.velocities /= length
        return math.log(length)


def step(simulation: hs.Simulation, tangent: Tangent) -> None:
    """Advance to the next collision, with the deviation."""
    before, began = simulation.velocities, simulation.time
    simulation.run(collisions=1)
    tangent.fly(simulation.time - began)
    i, j = np.flatnonzero((simulation.velocities != before).any(axis=1))
    tangent.collide(int(i), int(j), simulation.positions, before)


@kept
def largest_exponent(scene: hs.Scene, settle: float, measure: float) -> tuple[float, float]:
    """Return the largest Lyapunov exponent per collision per particle, and its standard error from 10 blocks.

    Parameters
    ----------
    scene : Scene
        The gas; periodic.
    settle, measure : float
        Collisions per particle until the deviation has the fastest growing direction, and of the measurement.
    """
    simulation = hs.Simulation(scene)
    rng = np.random.default_rng(1)
    tangent = Tangent(scene, rng.normal(size=scene.positions.shape), rng.normal(size=scene.positions.shape))
    for _ in range(round(settle * scene.n / 2)):
        step(simulation, tangent)
        tangent.renormalise()
    growth = []
    steps = round(measure * scene.n / 20)
    for _ in range(10):
        growth.append(sum(_grown(simulation, tangent) for _ in range(steps)) / (2.0 * steps / scene.n))
    return float(np.mean(growth)), float(np.std(growth, ddof=1) / math.sqrt(10.0))


def _grown(simulation: hs.Simulation, tangent: Tangent) -> float:
    step(simulation, tangent)
    return tangent.renormalise()
