"""Few particles beside the true trajectory: error of each method, and how long the engine follows it."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from hardspheres.cells import worst_overlap
from hardspheres.reference import ReferenceSimulation
from hardspheres.scene import kinetic_energy
from studies.validation.oracle import Oracle
from studies.validation.time_stepping import BACK_UP, BOUNCE, Stepper

__all__ = [
    "ENGINE",
    "METHODS",
    "REFERENCE",
    "Few",
    "Horizon",
    "beside_oracle",
    "followed",
    "joined",
    "lyapunov_exponent",
]

FloatArray = NDArray[np.float64]
Method = tuple[str, float]  # name, and the time step: NaN where there is none

ENGINE, REFERENCE = "engine", "reference"
METHODS = {
    ENGINE: "engine",
    REFERENCE: "all pairs, float64",
    BOUNCE: "bouncing balls",
    BACK_UP: "with back-up",
}
"""The methods in words."""

TIMED_STEPS = 3000
TIMED_COLLISIONS = 2000
CERTAIN = 1e-6  # error in diameters below which the same collisions must have happened
LOST = 0.01  # error in diameters at which a trajectory counts as lost
FOLLOWED_TO = 0.3  # error in diameters at which following ends
GROWTH = (1e-12, 1e-3)  # errors between which the growth is exponential

LYAPUNOV = {
    2: {0.01: 8.69, 0.1: 2.77, 0.3: 1.19, 0.5: 0.671},
    3: {0.01: 6.15, 0.1: 1.69, 0.2: 0.974, 0.4: 0.448},
}
"""Largest Lyapunov exponents per s, by packing fraction, from tangent space; 100 discs, 125 spheres; 2 %."""


def lyapunov_exponent(eta: float, dim: int) -> float:
    """Return the largest Lyapunov exponent per collision per particle, from `LYAPUNOV`; NaN outside of it.

    Between the densities of the table the logarithm is interpolated, good to 5 %.
    """
    known = LYAPUNOV[dim]
    if not min(known) <= eta <= max(known):
        return math.nan
    return math.exp(float(np.interp(math.log(eta), np.log(list(known)), np.log(list(known.values())))))


@dataclass
class Few:
    """What one method did with the few particles, one entry for each scene.

    Attributes
    ----------
    trajectory : list of float
        Root mean square distance of the particles from the oracle's, in diameters.
    energy : list of float
        Relative change of kinetic energy, absolute.
    overlap : list of float
        Deepest overlap at the end, in diameters.
    seconds : list of float
        Processor time per true collision.
    """

    trajectory: list[float] = field(default_factory=list)
    energy: list[float] = field(default_factory=list)
    overlap: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def distance(positions: FloatArray, other: FloatArray, scene: hs.Scene) -> float:
    """Return the root mean square distance of particles from their true positions, in diameters."""
    r = positions - other
    r -= scene.box * np.rint(r / scene.box)
    return math.sqrt(float(np.mean((r * r).sum(axis=1)))) / (2.0 * float(scene.radii[0]))


def beside_oracle(scene: hs.Scene, s: float, steps: Sequence[float], reference: bool) -> dict[Method, Few]:
    """Run every method in turn from the same scene to s collisions per particle; compare with the oracle.

    Parameters
    ----------
    scene : Scene
        Few equal particles, periodic.
    s : float
        Collisions per particle; the comparison is half-way between two collisions.
    steps : sequence of float
        Time steps.
    reference : bool
        Whether the reference solver, which is slow, runs too; otherwise its entry is empty.

    Returns
    -------
    dict
        `Few` by method and time step, with one entry.
    """
    found: dict[Method, Few] = {(ENGINE, math.nan): Few(), (REFERENCE, math.nan): Few()}
    found |= {(method, dt): Few() for method in (BOUNCE, BACK_UP) for dt in steps}
    oracle = Oracle(scene)
    oracle.advance(round(s * scene.n / 2))
    end = oracle.between()
    truth, _ = oracle.at(end)
    rate = oracle.collisions / end
    for (method, dt), few in found.items():
        if method == REFERENCE and not reference:
            continue
        if method == ENGINE:
            positions, velocities, seconds = _by_engine(scene, end)
        elif method == REFERENCE:
            positions, velocities, seconds = _by_reference(scene, oracle.collisions, end)
        else:
            positions, velocities, seconds = _by_steps(scene, end, method, dt, rate)
        few.trajectory.append(distance(positions, truth, scene))
        few.energy.append(abs(kinetic_energy(velocities, scene.masses) / scene.kinetic_energy - 1.0))
        few.overlap.append(_overlap(positions, scene))
        few.seconds.append(seconds)
    return found


def joined(parts: Sequence[dict[Method, Few]]) -> dict[Method, Few]:
    """Return what several scenes gave, each from `beside_oracle`, as one table."""
    found = {key: Few() for key in parts[0]}
    for part in parts:
        for few, own in zip(found.values(), part.values(), strict=True):
            for name, values in vars(few).items():
                values.extend(getattr(own, name))
    return found


def _overlap(positions: FloatArray, scene: hs.Scene) -> float:
    inside = np.mod(positions, scene.box)
    depth = worst_overlap(inside, scene.radii, scene.box, scene.periodic)[2]
    return max(depth, 0.0) / (2.0 * float(scene.radii[0]))


def _by_engine(scene: hs.Scene, end: float) -> tuple[FloatArray, FloatArray, float]:
    simulation = hs.Simulation(scene)
    simulation.run(time=end)
    positions, velocities = simulation.positions, simulation.velocities
    began = time.process_time()
    simulation.run(collisions=TIMED_COLLISIONS)
    return positions, velocities, (time.process_time() - began) / TIMED_COLLISIONS


def _by_reference(scene: hs.Scene, collisions: int, end: float) -> tuple[FloatArray, FloatArray, float]:
    began = time.process_time()
    solver = ReferenceSimulation(scene)
    for _ in range(collisions):
        solver.step()
    seconds = (time.process_time() - began) / collisions
    solver.fly(end - solver.time)
    return np.array(solver.positions), np.array(solver.velocities), seconds


def _by_steps(
    scene: hs.Scene, end: float, method: str, dt: float, rate: float
) -> tuple[FloatArray, FloatArray, float]:
    stepper = Stepper(scene, dt, method)
    began = time.process_time()
    stepper.run(end)
    spent, elapsed = time.process_time() - began, end
    positions, velocities = stepper.positions, stepper.velocities
    if end < TIMED_STEPS * dt:  # too short to be timed
        began = time.process_time()
        stepper.run(TIMED_STEPS * dt)
        spent, elapsed = time.process_time() - began, TIMED_STEPS * dt
    return positions, velocities, spent / (rate * elapsed)


@dataclass(frozen=True)
class Horizon:
    """How long the computed trajectory of one scene follows the true one.

    Attributes
    ----------
    s : (k,) array
        Collisions per particle of the true trajectory.
    error : (k,) array
        Distance of the engine's particles from the oracle's, as in `Few`.
    missed, collisions : int
        Error of the engine's collision count while the distance was below `CERTAIN`, summed over all
        comparisons; and the number of true collisions until then.
    """

    s: FloatArray
    error: FloatArray
    missed: int
    collisions: int

    @property
    def horizon(self) -> float:
        """Collisions per particle at which the error passes `LOST`."""
        beyond = np.flatnonzero(self.error > LOST)
        return float(self.s[beyond[0]]) if len(beyond) else math.inf

    @property
    def growth(self) -> float:
        """Exponent of the error's growth per collision per particle, by a linear fit of its logarithm."""
        chosen = (self.error > GROWTH[0]) & (self.error < GROWTH[1])
        if chosen.sum() < 3:
            return math.nan
        return float(np.polyfit(self.s[chosen], np.log(self.error[chosen]), 1)[0])


def followed(scene: hs.Scene, every: int = 4, longest: float = 300.0) -> Horizon:
    """Follow a scene with the engine and the oracle until they diverge.

    Parameters
    ----------
    scene : Scene
        Few equal particles, periodic.
    every : int
        Collisions between two comparisons.
    longest : float
        Collisions per particle after which to give up.
    """
    oracle, simulation = Oracle(scene), hs.Simulation(scene)
    s, errors, missed, on_it = [], [], 0, 0
    for moment in _moments(oracle, every, longest):
        frame = next(simulation.frames(times=[moment]))
        error = distance(frame.positions, oracle.at(moment)[0], scene)
        s.append(2.0 * oracle.collisions / scene.n)
        errors.append(error)
        if error < CERTAIN:
            missed += abs(frame.collisions - oracle.collisions)
            on_it = oracle.collisions
        if error > FOLLOWED_TO:
            break
    return Horizon(np.array(s), np.array(errors), missed, on_it)


def _moments(oracle: Oracle, every: int, longest: float) -> Iterator[float]:
    while 2.0 * oracle.collisions < longest * oracle.scene.n:
        oracle.advance(every)
        yield oracle.between()
