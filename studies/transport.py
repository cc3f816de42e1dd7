"""Transport coefficients: shear and bulk viscosity, heat conductivity, mutual diffusion, beside Enskog."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import hardspheres as hs
from analysis.helfand import HeatConductivity, HelfandEstimator, MutualDiffusion, Viscosity, mean_free_time
from analysis.series import SeriesWarning
from analysis.statistics import estimate_from_replicas, replica_mean
from studies import options
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import Fluid, check_length, check_spread, number_fraction, ordered
from studies.options import densities, dimension, option, particles, runs
from studies.running.resuming import until
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Transport"]

USUAL_DENSITIES = "0.1,0.3"
SPACING = 0.25  # of the sampled times, in mean free times
USUAL = 8500.0  # collisions per particle: with 12 replicas errors of 3 % or better
SHORTEST = 400.0


@dataclass(frozen=True, kw_only=True)
class Transport(Study):
    """Fluxes of momentum, energy and particles in a periodic box at equilibrium."""

    name = "transport"
    question = "How viscous is the fluid, and how well does it conduct heat?"
    explanation = """
    Shear and bulk viscosity and heat conductivity, or in a mixture mutual diffusion in its place, as the
    slope of the mean square of a time integral (Einstein, Helfand) and as the integral of an autocorrelation
    (Green, Kubo). Writes a summary, two tables and a picture.
    """
    table = "transport"
    files = ("transport.csv", "integrals.csv", "transport.png")

    packing_fractions: tuple[float, ...] = densities(USUAL_DENSITIES)
    n: int = particles(500)
    dim: int = dimension()
    diameter_ratio: float = options.diameter_ratio()
    mass_ratio: float = options.mass_ratio()
    fraction: float | None = options.fraction()
    collisions_per_particle: float = option(
        USUAL, "How long to measure in each replica, s = 2 collisions / n."
    )
    replicas: int = runs(12)

    def gases(self) -> list[Fluid]:
        """Return the gases to measure, by ascending packing fraction."""
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        species = (self.diameter_ratio, self.mass_ratio, share)
        fluids = [Fluid(self.n, self.dim, eta, "periodic", *species) for eta in self.packing_fractions]
        for fluid in fluids:
            fluid.check_within("Enskog's theory")
        if fluids[0].mixed and not 0 < round(share * self.n) < self.n:
            raise hs.SceneError(f"--fraction {share:g} of {self.n} particles leaves none of one species")
        check_length(self.collisions_per_particle, SHORTEST, "is no length for a slope")
        check_spread(self.replicas)
        return fluids

    def start(self, gas: Fluid, seed: np.random.SeedSequence) -> hs.Simulation:
        """Return a gas whose heat flux is tallied, where there is one species."""
        return hs.Simulation(gas.scene(seed), heat=not gas.mixed)

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Any]:
        """Return those of one species, or of two."""
        other: HelfandEstimator = MutualDiffusion() if gas.mixed else HeatConductivity()
        return {"viscosity": Viscosity(), "other": other}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Equilibrate, then sample at equally spaced times."""
        simulation, estimators = replica.simulation, replica.estimators.values()
        yield from until(simulation, gas.settled)
        step = SPACING * _mean_free_time(gas)
        for k in range(replica.done, math.ceil(self.collisions_per_particle / SPACING) + 1):
            if k > 0:
                simulation.run(time=step)
            frame = simulation.frame()
            for estimator in estimators:
                estimator.add(frame)
            replica.done += 1
            yield
        replica.seen["ordered"] = ordered(simulation)

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return all coefficients, in both ways, with errors from the spread of the replicas."""
        numbers, columns, windows, curve = [], {}, [], None
        for which in ("viscosity", "other"):
            estimators = [replica.estimators[which] for replica in replicas]
            expected = estimators[0].expected()
            windows.append([edge / _mean_free_time(gas) for edge in estimators[0].window])
            for group, name in enumerate(estimators[0].names):
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", SeriesWarning)  # the error comes from the replicas
                    slopes = [one.slope(name).value for one in estimators]
                    integrals = [one.integral(name).value for one in estimators]
                    running = [one.running(name) for one in estimators]
                beside = expected[group] if expected else None
                numbers += [
                    number(name, estimate_from_replicas(slopes), "Enskog" if expected else "", beside),
                    number(f"{name}, Green-Kubo", estimate_from_replicas(integrals)),
                ]
                curve = running[0][0]
                columns[name.replace(" ", "_")] = Column(*replica_mean([values for _, values, _ in running]))
        assert curve is not None
        failures = alarms(numbers)
        if any(replica.seen["ordered"] for replica in replicas):
            failures.append("the particles have ordered: this is no fluid")
        return Answer(
            gas,
            numbers,
            {"integrals": Curves({"time": curve, "mean_free_times": curve / _mean_free_time(gas)}, columns)},
            failures=failures,
            details={
                "discarded_collisions_per_particle": gas.discarded,
                "collisions_per_particle": self.collisions_per_particle,
                "windows_in_mean_free_times": windows,
            },
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        windows = [answer.details["windows_in_mean_free_times"] for answer in answers]
        first, second = (
            "; ".join(dict.fromkeys(f"{one[k][0]:.3g} to {one[k][1]:.3g}" for one in windows)) for k in (0, 1)
        )
        other = "mutual diffusion" if answers[0].gas.mixed else "heat conductivity"
        how = (
            f"slopes over {first} mean free times (viscosities) and {second} ({other}), Green-Kubo integrals "
            "up to the middle of these, from the same samples; errors from the spread of the replicas"
        )
        return [
            how,
            "Enskog's theory leaves out correlated collisions: its uncertainty is its known systematic error",
        ]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return integrals against time, and coefficients against packing fraction."""
        from studies.figures.transport import figure

        return figure(answers)


def _mean_free_time(gas: Fluid) -> float:
    return mean_free_time(*gas.species, gas.dim, gas.units["temperature"])
