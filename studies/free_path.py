"""Free paths of the fluid: means, rates between species and distributions, beside theory."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.free_path import SURVIVAL_AT, FreePath
from analysis.statistics import Estimate, TheoryCheck, combine_replicas, pool_replicas
from studies import options, real_fluid
from studies.answer import Answer, Column, Curves, alarms
from studies.fluid import Fluid, check_length, number_fraction
from studies.noticing import Notices, too_short
from studies.options import densities, dimension, option, packing_fractions, particles
from studies.real_fluid import RealFluid, real_gas_of, scaled
from studies.running.resuming import in_blocks
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FreePaths"]

FloatArray = NDArray[np.float64]

USUAL = "0.001,0.01,0.1,0.3"  # packing fractions
BLOCKS = 192  # of each run; they are joined as their correlation demands
FEWEST_FLIGHTS = 2000  # of each species, to know them by speed
CURVES = {  # file: (what is at the abscissae, what is measured)
    "free_path_survival": ("mean_free_paths", "survival"),
    "free_time_survival": ("mean_free_times", "survival"),
    "free_path_by_speed": ("thermal_speeds", "free_path"),
}


@dataclass(frozen=True)
class _Curve:
    """What one replica says of one species, as far as it reaches: abscissae, measured values, theory."""

    x: FloatArray
    measured: list[Estimate]
    theory: FloatArray


@dataclass(frozen=True, kw_only=True)
class FreePaths(Study):
    """Flights between two collisions of a particle, in a periodic box."""

    name = "free-path"
    question = "How far do particles fly between collisions?"
    explanation = """
    Mean free path and time, collision rates between species, moments and survival functions of all flights,
    and the free path at each speed, with error bars, at several packing fractions. Writes a summary, four
    tables and a picture.
    """
    table = "free_path"
    files = ("free_path.csv", *(f"{name}.csv" for name in CURVES), "free_path.png")

    packing_fractions: tuple[float, ...] | None = densities(USUAL, asked=True)
    gas: str | None = real_fluid.gas()
    temperature: float | None = real_fluid.temperature()
    pressure: float | None = real_fluid.pressure()
    diameter: str | float | None = real_fluid.diameter()
    n: int = particles(4000)
    dim: int = dimension()
    diameter_ratio: float = options.diameter_ratio()
    mass_ratio: float = options.mass_ratio()
    fraction: float | None = options.fraction()
    collisions_per_particle: float = option(
        300.0, "How long to measure in each replica, s = 2 collisions / n."
    )

    def gases(self) -> list[Fluid]:
        """Return the gases to measure, by ascending packing fraction."""
        real = real_gas_of(self)
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        second = (self.diameter_ratio, self.mass_ratio, share)
        etas = self.packing_fractions or packing_fractions(USUAL)
        fluids = [Fluid(self.n, self.dim, eta, "periodic", *second) for eta in etas]
        if real is not None:
            fluids = [RealFluid.of(self.n, real)]
        for fluid in fluids:
            fluid.check_within("the theory of this study")
        few = round(share * self.n) if fluids[0].mixed else self.n
        if fluids[0].mixed and not 0 < few < self.n:
            raise hs.SceneError(
                f"--fraction {share:g} of {self.n} particles leaves one species; leave the ratios out, or "
                "ask for some of each"
            )
        fewest = FEWEST_FLIGHTS / (min(few, self.n - few) or self.n)
        check_length(self.collisions_per_particle, fewest, f"gives no error bar for {self.n} particles")
        return fluids

    def start(self, gas: Fluid, seed: np.random.SeedSequence) -> hs.Simulation:
        """Return a gas whose free flights are tallied."""
        return hs.Simulation(gas.scene(seed), free_paths=True)

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Any]:
        """Return the one that knows all of it."""
        return {"paths": FreePath(simulation.scene)}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Equilibrate, then measure block by block."""
        paths, notices = replica.estimators["paths"], Notices(replica.notes)
        total = round(self.collisions_per_particle * gas.n / 2)
        ends = gas.settled + np.linspace(0, total, min(BLOCKS, total // 8) + 1).round().astype(int)

        def add(frame: hs.Frame) -> None:
            with notices.of("free paths"):
                paths.add(frame)

        return in_blocks(replica, ends.tolist(), add)

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return means, rates, moments and distributions, with the error bars of all replicas' blocks."""
        found, curves, notes, times = [], [], [], 0.0
        of_speed = Notices()  # the mean speed is correlated for longer than all else
        for replica in replicas:
            paths, notices = replica.estimators["paths"], Notices(list(replica.notes))
            with notices.of("free paths"):
                found.append(paths.checks)
            if isinstance(gas, RealFluid):
                with of_speed.of("mean speed"):
                    found[-1] = _physical(paths, found[-1])
            with notices.of("distributions of free paths"):
                curves.append(_curves(paths))
            notes += notices.notes
            times = max(times, notices.times)
        length = self.collisions_per_particle
        notes += [*of_speed.notes, *(f"mean speed: {why}" for why in too_short(of_speed.times, length))]
        notices, numbers = Notices(list(dict.fromkeys(notes))), []
        for checks in zip(*found, strict=True):
            measured = [check.measured for check in checks]
            with notices.of(checks[0].quantity):
                combine_replicas(measured)
            numbers.append(replace(checks[0], measured=pool_replicas(measured)))
        numbers = gas.in_units(numbers)
        paths = [replica.estimators["paths"] for replica in replicas]
        return Answer(
            gas,
            numbers,
            {name: _pooled(name, [of_one[name] for of_one in curves]) for name in CURVES},
            [*gas.remarks, *notices.notes, *too_short(times, length)],
            alarms(numbers),
            main=[each.quantity for each in numbers if each.quantity.startswith("mean free path")],
            details={"flights": sum(one.flights for one in paths), "species": paths[0].labels},
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        labels = answers[0].details["species"]
        means = f"means and rates: Enskog for {self.n} particles at fixed energy and momentum"
        sentences = [f"{means}; Z: {answers[0].numbers[-1].theory}; uncertainty in parentheses"]
        if len(labels) > 1:
            sentences.insert(0, "species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(labels, 1)))
        if isinstance(answers[0].gas, RealFluid):
            sentences.append(
                "pressure: Z rho kT, of a large box; in this one, whose momentum is zero, it is 1/N lower"
            )
        if self.n > 2:
            sentences.append(
                "<l^k>, <t^k> of all flights, counted exactly: Boltzmann, whose uncertainty, k - 1 times the "
                "packing fraction, is what meeting the same neighbours again may change in a denser gas"
            )
        return sentences

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return mean free path, survival of paths, and free path by speed."""
        from studies.figures.free_path import figure

        return figure(answers)


def _physical(paths: FreePath, checks: Sequence[TheoryCheck]) -> list[TheoryCheck]:
    """Return checks of a real gas with its mean speed, and the pressure that follows from its collisions."""
    path, time, *others = checks
    exact = path.expected / time.expected  # of the velocities of N particles at this temperature
    speed = TheoryCheck("mean speed", "Maxwell", paths.mean_speed[0], exact, 0.0)
    ideal = paths.scene.number_density * paths.scene.temperature
    pressure = scaled(others[-1], "pressure", ideal)  # Z rho kT
    return [path, time, speed, pressure, *others]


def _curves(paths: FreePath) -> dict[str, list[_Curve]]:
    """Return survival of paths and times, and lambda(v) in mean free paths, for each species."""
    at = np.array(SURVIVAL_AT)
    curves: dict[str, list[_Curve]] = {name: [] for name in CURVES}
    for species, mean in enumerate(paths.mean_free_path):
        law = paths.flights_in_theory(species)
        for of, theory in (("path", law.path_survival(at)), ("time", law.time_survival(at))):
            measured = paths.survival(at, of, species)  # type: ignore[arg-type]  # it is one of the two
            curves[f"free_{of}_survival"].append(_Curve(at, measured, theory.value))
        edges, measured = paths.path_at_speed(species)
        expected = np.array([law.path_at_speed(low, high) for low, high in itertools.pairwise(edges)])
        mass = float(paths.scene.masses[paths.scene.species == species][0])
        reduced = [
            replace(each, value=each.value / mean.value, standard_error=each.standard_error / mean.value)
            for each in measured
        ]
        middle = (edges[:-1] + edges[1:]) / 2 / math.sqrt(paths.scene.temperature / mass)
        curves["free_path_by_speed"].append(_Curve(middle, reduced, expected / law.mean_path))
    return curves


def _pooled(name: str, replicas: Sequence[Sequence[_Curve]]) -> Curves:
    """Return the curves of all species, one after another, as far as every replica reaches."""
    where, what = CURVES[name]
    kinds, x, measured, theory = [], [], [], []
    for kind, curves in enumerate(zip(*replicas, strict=True), 1):
        first = max(float(curve.x[0]) for curve in curves) - 1e-6
        last = min(float(curve.x[-1]) for curve in curves) + 1e-6
        inside = [np.flatnonzero((curve.x >= first) & (curve.x <= last)) for curve in curves]
        for places in zip(*inside, strict=True):
            measured.append(pool_replicas([c.measured[p] for c, p in zip(curves, places, strict=True)]))
        x.append(curves[0].x[inside[0]])
        theory.append(curves[0].theory[inside[0]])
        kinds.append(np.full(len(inside[0]), kind))
    column = Column(
        np.array([each.value for each in measured]),
        np.array([each.standard_error for each in measured]),
        np.concatenate(theory),
    )
    axes: dict[str, Any] = {"species": np.concatenate(kinds)} if len(kinds) > 1 else {}
    return Curves(axes | {where: np.concatenate(x)}, {what: column})
