"""Long runs of many particles, in turn: effect of time steps on pressure and mean free path, and the cost."""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import hardspheres as hs
from analysis import theory
from analysis.series import SeriesWarning, estimate_from_series
from analysis.statistics import Estimate
from studies.validation.accuracy_few import ENGINE, Method
from studies.validation.time_stepping import BACK_UP, BOUNCE, Stepper

__all__ = ["Exact", "Long", "engine_test_seconds", "long_runs", "passed_through"]

FloatArray = NDArray[np.float64]

BLOCKS = 32
SETTLE = 2.0  # collisions per particle in which a stepper reaches its own steady state
MOST_COLLISIONS = 400.0  # per particle
PILOT_STEPS = 60
# Nominal seconds that set the lengths of runs, so that results do not depend on the machine's speed: per
# collision in the engine, per particle and per tested pair in a step.
ENGINE_COST, FLIGHT_COST, TEST_COST = 1.5e-6, 2.5e-9, 4.5e-9
AUDIT_STEPS = 4000
AUDIT_COLLISIONS = 100_000
AUDIT_WINDOWS = 200  # of the engine


class _Runner(Protocol):
    """A running gas with counters."""

    def run(self, duration: float) -> None:
        """Advance by a time."""

    def counts(self) -> tuple[int, float]:
        """Return collisions and the sum of r.dp since the last call."""

    def overlap(self) -> float:
        """Return the deepest overlap now, in diameters."""

    def drift(self) -> float:
        """Return the relative change of energy since the start."""


class _Engine:
    """Our engine."""

    def __init__(self, scene: hs.Scene) -> None:
        self.simulation = hs.Simulation(scene)

    def run(self, duration: float) -> None:
        self.simulation.run(time=duration)

    def counts(self) -> tuple[int, float]:
        tallies = self.simulation.tallies
        self.simulation.reset_tallies()
        return tallies.collisions, float(np.trace(tallies.virial))

    def overlap(self) -> float:
        return max(self.simulation.worst_overlap, 0.0)

    def drift(self) -> float:
        return self.simulation.energy_drift


class _Steps:
    """A time stepper."""

    def __init__(self, scene: hs.Scene, method: str, dt: float) -> None:
        self.stepper = Stepper(scene, dt, method)
        self.tests = 0

    def run(self, duration: float) -> None:
        self.stepper.run(duration)

    def counts(self) -> tuple[int, float]:
        count = self.stepper.count
        self.tests += count.tests
        self.stepper.reset()
        return count.collisions, count.virial

    def overlap(self) -> float:
        return self.stepper.worst_overlap

    def drift(self) -> float:
        return self.stepper.energy_drift


@dataclass(frozen=True)
class Exact:
    """Exact values for a gas of so many particles, kT = m = diameter = 1.

    Attributes
    ----------
    z, z_uncertainty : float
        Compressibility factor and its uncertainty, relative to Z - 1.
    rate, rate_uncertainty : float
        Collisions per particle and time, and its relative uncertainty.
    """

    z: float
    z_uncertainty: float
    rate: float
    rate_uncertainty: float

    @classmethod
    def of(cls, scene: hs.Scene) -> Exact:
        """Return the values for an equal-particle periodic scene, with the correction for its finite size."""
        eta, dim, n = scene.packing_fraction, scene.dim, scene.n
        z = theory.finite_size_compressibility(eta, dim, n)
        rate = theory.finite_size_collision_rate(eta, dim, n, temperature=scene.temperature)
        return cls(
            float(z.value),
            float(z.uncertainty) / (float(z.value) - 1.0),
            float(rate.value),
            float(rate.uncertainty) / float(rate.value),
        )


@dataclass
class Long:
    """What one method did in a long run.

    Attributes
    ----------
    seconds : float
        Processor time per true collision, the median over blocks.
    collisions : int
        Found in all.
    pressure : Estimate
        Measured Z - 1 over the exact one, less 1; the theory's uncertainty is in the error.
    free_path : Estimate
        Measured mean free path <v>/nu over the exact one, less 1.
    energy, overlap : float
        Relative energy drift at the end, absolute; deepest overlap at any block's end, in diameters.
    missed, audited : float
        Pairs that passed through each other per collision that should be, and how many of those there were.
    test_seconds : float
        Processor time per pair whose distance was computed, everything else included; NaN for the engine.
    """

    seconds: float
    collisions: int
    pressure: Estimate
    free_path: Estimate
    energy: float
    overlap: float
    missed: float = math.nan
    audited: float = math.nan
    test_seconds: float = math.nan


@dataclass
class _Clocked:
    """A runner, how long its blocks are, and what they gave."""

    runner: _Runner
    duration: float
    rows: list[tuple[float, float, float]] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    overlap: float = 0.0

    def block(self) -> None:
        began = time.process_time()
        self.runner.run(self.duration)
        self.cpu.append(time.process_time() - began)
        collisions, virial = self.runner.counts()
        self.rows.append((self.duration, float(collisions), virial))
        self.overlap = max(self.overlap, self.runner.overlap())


def long_runs(scene: hs.Scene, steps: Sequence[float], seconds: float) -> dict[Method, Long]:
    """Run every method from the same equilibrated scene, block by block in turn.

    Parameters
    ----------
    scene : Scene
        Many equal particles, periodic, in equilibrium, kT = m = diameter = 1.
    steps : sequence of float
        Time steps.
    seconds : float
        Processor time for each time step and method, roughly, as a usual machine would need; the engine gets
        twice that. None runs for more than `MOST_COLLISIONS` per particle.

    Returns
    -------
    dict
        `Long` by method and time step.
    """
    exact = Exact.of(scene)
    settle, most = SETTLE / exact.rate, MOST_COLLISIONS / exact.rate / BLOCKS
    clocked: dict[Method, _Clocked] = {}
    for method, dt in [(ENGINE, math.nan), *((m, dt) for m in (BOUNCE, BACK_UP) for dt in steps)]:
        if method == ENGINE:
            own = _Engine(scene)
            own.run(settle)
            pace = ENGINE_COST * 0.5 * scene.n * exact.rate
            own.counts()
            clocked[method, dt] = _Clocked(own, min(most, 2.0 * seconds / pace / BLOCKS))
            continue
        runner = _Steps(scene, method, dt)
        runner.run(PILOT_STEPS * dt)
        runner.counts()
        pace = (FLIGHT_COST * scene.n + TEST_COST * runner.tests / PILOT_STEPS) / dt  # seconds per time
        runner.run(min(settle, 0.2 * seconds / pace))
        runner.counts()
        runner.tests = 0
        duration = min(most, seconds / pace / BLOCKS)
        clocked[method, dt] = _Clocked(runner, max(1.0, round(duration / dt)) * dt)
    for _ in range(BLOCKS):
        for each in clocked.values():
            each.block()
    found = {key: _result(each, scene, exact) for key, each in clocked.items()}
    for (method, dt), long in found.items():
        each = clocked[method, dt]
        if isinstance(each.runner, _Steps):
            long.missed, long.audited = _audit(scene, method, dt, exact.rate)
            long.test_seconds = sum(each.cpu) / each.runner.tests
        else:
            long.missed, long.audited = _audit_engine(scene, exact.rate)
    return found


def _result(each: _Clocked, scene: hs.Scene, exact: Exact) -> Long:
    rows = np.array(each.rows)
    thermal, n = 2.0 * scene.thermal_energy, scene.n
    true_collisions = 0.5 * n * exact.rate * each.duration
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeriesWarning)  # of short series: errors are then lower bounds
        pressure = estimate_from_series(
            rows, lambda m: m[..., 2] / m[..., 0] / thermal / (exact.z - 1.0) - 1.0
        )
        path = estimate_from_series(rows, lambda m: exact.rate * n * m[..., 0] / (2.0 * m[..., 1]) - 1.0)
    return Long(
        float(np.median(each.cpu)) / true_collisions,
        int(rows[:, 1].sum()),
        _with_uncertainty(pressure, exact.z_uncertainty),
        _with_uncertainty(path, exact.rate_uncertainty),
        abs(each.runner.drift()),
        each.overlap,
    )


def _with_uncertainty(estimate: Estimate, uncertainty: float) -> Estimate:
    """Return an estimate with another relative uncertainty in its error."""
    error = math.hypot(estimate.standard_error, uncertainty)
    return Estimate(estimate.value, error, estimate.n_effective, estimate.degrees_of_freedom)


def _audit(scene: hs.Scene, method: str, dt: float, rate: float) -> tuple[float, float]:
    """Return missed pairs per true collision, and the number of true collisions."""
    stepper = Stepper(scene, dt, method, audit=True)
    wanted = 2.0 * AUDIT_COLLISIONS / (rate * scene.n)
    stepper.run(min(max(wanted, 20 * dt), AUDIT_STEPS * dt))
    count = stepper.count
    true = max(count.missed + count.collisions, 1)
    return count.missed / true, float(true)


def _audit_engine(scene: hs.Scene, rate: float) -> tuple[float, float]:
    """Return missed collisions of the engine per true one, and the number of these."""
    simulation = hs.Simulation(scene)
    sigma = 2.0 * float(scene.radii[0])
    fastest = float(np.sqrt((scene.velocities**2).sum(axis=1).max()))
    window = min(0.1 / rate, (float(scene.box.min()) / 3.0 - sigma) / (3.0 * fastest))
    states = ((f.positions, f.velocities) for f in simulation.frames(every=window, count=AUDIT_WINDOWS + 1))
    missed = passed_through(states, scene, window)
    true = max(missed + simulation.collisions, 1)
    return missed / true, float(true)


def passed_through(states: Iterable[tuple[FloatArray, FloatArray]], scene: hs.Scene, window: float) -> int:
    """Count the pairs that pass through each other between neighbouring states.

    The flight is known only of particles that kept their velocities through a window, so only pairs of these
    are tested.

    Parameters
    ----------
    states : iterable of ((N, d) array, (N, d) array)
        Positions in the periodic box and velocities, a window apart.
    scene : Scene
        Equal particles in that box.
    window : float
        Time between two states; no particle may move by a third of the box in it.
    """
    sigma, missed = 2.0 * float(scene.radii[0]), 0
    for (x, v), (_, later) in itertools.pairwise(states):
        kept = np.flatnonzero((v == later).all(axis=1))
        fastest = float(np.sqrt((v * v).sum(axis=1).max()))
        tree = cKDTree(x[kept], boxsize=scene.box)
        i, j = kept[tree.query_pairs(sigma + 2.0 * fastest * window, output_type="ndarray").T]
        r, u = x[i] - x[j], v[i] - v[j]
        r -= scene.box * np.rint(r / scene.box)
        b, uu = (r * u).sum(axis=1), (u * u).sum(axis=1)
        closest2 = (r * r).sum(axis=1) - b * b / uu
        inside = (b < 0.0) & (-b < uu * window) & ((r * r).sum(axis=1) > sigma**2)
        missed += int(np.sum(inside & (closest2 < sigma**2 * (1.0 - 1e-9))))
    return missed


def engine_test_seconds(scene: hs.Scene, repeats: int = 5) -> float:
    """Return the engine's processor time per pair tested, from complete searches of the scene.

    A simulation that has just been made searches for all next events at its first step; its status tells
    how many pairs that compares.
    """
    taken = []
    for _ in range(repeats):
        simulation = hs.Simulation(scene)
        began = time.process_time()
        simulation.run(time=0.0)
        taken.append(time.process_time() - began)
    return float(np.median(taken)) / float(simulation.status()["pairs_compared"])
