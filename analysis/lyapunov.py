"""The largest Lyapunov exponent: how fast two gases that start almost alike come apart, in tangent space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.series import estimate_from_series
from analysis.statistics import Estimate, TheoryCheck

__all__ = ["LyapunovExponent", "lyapunov_exponent"]

FloatArray = NDArray[np.float64]

RENORMALISED = 1.0  # collisions per particle between two normalisations: it grows by exp(20) at most


@dataclass(frozen=True)
class LyapunovExponent:
    """The largest Lyapunov exponent of a gas.

    Attributes
    ----------
    per_collision : Estimate
        Growth of the logarithm of the distance of two gases in phase space, per collision per particle, s = 2
        collisions / N.
    per_time : Estimate
        The same per unit of time.
    check : TheoryCheck or None
        The first beside `theory.lyapunov_exponent`; None for mixtures and boxes with walls.
    """

    per_collision: Estimate
    per_time: Estimate
    check: TheoryCheck | None

    def __repr__(self) -> str:
        """Return both exponents."""
        return f"<LyapunovExponent {self.per_collision} per collision per particle, {self.per_time} per time>"


def lyapunov_exponent(
    scene: hs.Scene, collisions_per_particle: float = 200.0, settle: float = 30.0, seed: int = 1
) -> LyapunovExponent:
    """Return the largest Lyapunov exponent of the gas that starts from a scene.

    An infinitesimal deviation is carried along with the trajectory. In flight its positions grow by its
    velocities. In a collision the neighbouring spheres touch earlier or later by dt = -(n.dr)/(n.v), with n
    along r = x_i - x_j, v the relative velocity before it; positions then change by the difference of the
    velocities times dt, and velocities by the derivative of the collision rule for a change dr + v dt of r
    (Dellago, Posch and Hoover 1996, doi 10.1103/PhysRevE.53.1485). A flat wall reflects the deviation.

    Parameters
    ----------
    scene : Scene
        Any gas in which particles collide; bring it to equilibrium before. Obstacles have no deviation.
    collisions_per_particle : float, default 200
        How long it is measured.
    settle : float, default 30
        Collisions per particle before that, in which the deviation turns into the direction that grows
        fastest.
    seed : int, default 1
        Of the direction that it starts with.

    Returns
    -------
    LyapunovExponent
        Errors from blocks, see `estimate_from_series`. Bias: less than the error, if `settle` is ten times
        1/exponent or more.

    Raises
    ------
    ValueError
        If fewer than 16 collisions per particle are to be measured, or the gas falls.
    HardSpheresError
        If the particles never collide.

    Examples
    --------
    >>> import hardspheres as hs
    >>> gas = hs.random_gas(n=108, packing_fraction=0.2, seed=1)
    >>> lyapunov_exponent(gas, collisions_per_particle=20.0)  # doctest: +SKIP
    <LyapunovExponent 0.93(3) per collision per particle, 2.61(9) per time>
    """
    if not (collisions_per_particle >= 16.0 and settle >= 0.0):
        raise ValueError(
            f"collisions_per_particle = {collisions_per_particle:g}, settle = {settle:g}; expected at "
            "least 16 collisions per particle for an error bar, and no negative number before"
        )
    if scene.falls:
        raise ValueError(
            "the exponent of a gas that falls is not measured here; take a scene without gravity"
        )
    moving = scene.n_moving
    partners = 2.0 if moving == scene.n else 1.0  # of a collision; an obstacle is none
    tangent = Tangent(scene, *np.random.default_rng(seed).normal(size=(2, *scene.positions.shape)))
    simulation = hs.Simulation(scene, log=tangent.take)
    step = max(round(RENORMALISED * moving / 2.0), 1)
    for _ in range(math.ceil(settle * moving / partners / step)):
        simulation.run(collisions=step)
        tangent.normalise(simulation.time)
    rows = []
    for _ in range(max(math.ceil(collisions_per_particle * moving / partners / step), 16)):
        began, hits = simulation.time, simulation.obstacle_collisions
        simulation.run(collisions=step)
        met = 2.0 * step - (simulation.obstacle_collisions - hits)
        rows.append((tangent.normalise(simulation.time), met / moving, simulation.time - began))
    array = np.array(rows)
    if moving == scene.n:
        per_collision = estimate_from_series(array[:, 0] / array[:, 1])
    else:  # not as many collisions per particle in each row
        per_collision = estimate_from_series(array, lambda mean: mean[..., 0] / mean[..., 1])
    per_time = estimate_from_series(array, lambda mean: mean[..., 0] / mean[..., 2])
    check = None
    if scene.periodic.all() and not scene.species.any():
        expected = theory.lyapunov_exponent(scene.packing_fraction, scene.dim)
        check = TheoryCheck(
            "largest Lyapunov exponent per collision per particle",
            "tangent space, interpolated",
            per_collision,
            float(expected.value),
            float(expected.uncertainty),
        )
    return LyapunovExponent(per_collision, per_time, check)


class Tangent:
    """An infinitesimal deviation, carried along the events of a simulation.

    Parameters
    ----------
    scene : Scene
        Where the simulation starts.
    places, velocities : (N, d) array
        The deviation at the start.
    """

    def __init__(self, scene: hs.Scene, places: FloatArray, velocities: FloatArray) -> None:
        self.radii, self.masses, self.moving = scene.radii, scene.masses, scene.velocities.copy()
        still = scene.obstacles[:, None]
        self.places, self.velocities = np.where(still, 0.0, places), np.where(still, 0.0, velocities)
        self.clocks = np.zeros(scene.n)  # of each particle: up to when its deviation has been carried

    def take(self, events: NDArray[np.void]) -> None:
        """Carry the deviation through a chunk of events: what the log of a simulation calls."""
        n = len(self.clocks)
        for time, i, j, normal, impulse in events[["time", "i", "j", "normal", "impulse"]].tolist():
            if j < n:
                self._collide(time, i, j, np.array(normal), impulse)
            else:
                self._reflect(time, i, (j - n) // 2)

    def _fly(self, time: float, i: int) -> None:
        self.places[i] += self.velocities[i] * (time - self.clocks[i])
        self.clocks[i] = time

    def _reflect(self, time: float, i: int, axis: int) -> None:
        self._fly(time, i)
        for each in (self.places, self.velocities, self.moving):
            each[i, axis] = -each[i, axis]

    def _collide(self, time: float, i: int, j: int, n: FloatArray, impulse: float) -> None:
        """Carry the deviation of two partners through their collision, in letters as of the formula."""
        self._fly(time, i)
        self._fly(time, j)
        v = self.moving[i] - self.moving[j]
        dr, dv = self.places[i] - self.places[j], self.velocities[i] - self.velocities[j]
        vn = float(v @ n)
        dt = -float(dr @ n) / vn
        dn = (dr + v * dt) / (self.radii[i] + self.radii[j])
        push = (2.0 * vn * dt) * n
        dpush = 2.0 * (float(dv @ n + v @ dn) * n + vn * dn)
        if self.masses[i] == math.inf:
            share = 0.0
        elif self.masses[j] == math.inf:
            share = 1.0
        else:
            share = self.masses[j] / (self.masses[i] + self.masses[j])
        self.places[i] += share * push
        self.places[j] -= (1.0 - share) * push
        self.velocities[i] -= share * dpush
        self.velocities[j] += (1.0 - share) * dpush
        self.moving[i] += impulse / self.masses[i] * n
        self.moving[j] -= impulse / self.masses[j] * n

    def carry_to(self, time: float) -> None:
        """Carry the deviation of all particles on to a time after the last event."""
        self.places += self.velocities * (time - self.clocks)[:, None]
        self.clocks[:] = time

    def normalise(self, time: float) -> float:
        """Carry it to a time, normalise it, and return the logarithm of its length before."""
        self.carry_to(time)
        length = math.sqrt(float(np.sum(self.places**2) + np.sum(self.velocities**2)))
        self.places /= length
        self.velocities /= length
        return math.log(length)
