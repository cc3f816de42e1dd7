"""Temperature equilibration of two species, beside kinetic theory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.reduced import species_labels
from analysis.statistics import Estimate, TheoryCheck, deviates, estimate_from_replicas, replica_mean
from analysis.temperatures import TemperatureEquilibration
from analysis.theory import Prediction
from studies import options
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import THEORY_UP_TO, Fluid, check_spread, number_fraction
from studies.options import dimension, one_number, option, particles, positive, runs
from studies.report import alarming
from studies.running.resuming import until
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Mixture"]

FloatArray = NDArray[np.float64]

SAMPLES = 4  # in each relaxation time
HOTTER = "kT of the first species over the second's at the start"


@dataclass(frozen=True, kw_only=True)
class Mixture(Study):
    """Two species in a periodic box, hot and cold at the start; kT of the whole is 1."""

    name = "mixture"
    question = "How do two species of different temperatures come to one?"
    explanation = """
    Temperatures of both against time, averaged over replicas, beside the two-Maxwellian equations with their
    known deviation, and the collision rate. Writes a summary, two tables and a picture.
    """
    table = "mixture"
    files = ("mixture.csv", "temperatures.csv", "mixture.png")

    packing_fraction: float = option(0.01, **one_number)
    n: int = particles(2000)
    dim: int = dimension()
    diameter_ratio: float = options.diameter_ratio(2.0)
    mass_ratio: float = options.mass_ratio(10.0)
    fraction: float | None = options.fraction()
    temperature_ratio: float = option(3.0, f"{HOTTER}.", **positive("--temperature-ratio", HOTTER))
    relaxation_times: float = option(
        4.0, "How long to run, in initial decay times of the difference.", at_least=0.5, at_most=100.0
    )
    replicas: int = runs(100)
    threads: ClassVar[int] = 1  # type: ignore[misc]  # no option: it makes its gas on the way, a small one

    def gases(self) -> list[Fluid]:
        """Return the one gas."""
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        species = (self.diameter_ratio, self.mass_ratio, share)
        fluid = Fluid(self.n, self.dim, self.packing_fraction, "periodic", *species)
        fluid.check()
        if not fluid.mixed:
            raise hs.SceneError("the gas has one species; give --mass-ratio or --diameter-ratio other than 1")
        few = min(round(share * self.n), self.n - round(share * self.n))
        if few < 2:
            raise hs.SceneError(
                f"--fraction {share:g} of {self.n} particles leaves {few} of one species; a temperature "
                "needs at least 2"
            )
        if self.packing_fraction > THEORY_UP_TO[self.dim]:
            raise hs.SceneError(
                f"packing fraction {self.packing_fraction:g} is above {THEORY_UP_TO[self.dim]:g}, where the "
                "theory of mixtures ends; ask for less"
            )
        if not 0.0 < self.temperature_ratio < math.inf or self.temperature_ratio == 1.0:
            raise hs.SceneError(
                f"--temperature-ratio {self.temperature_ratio:g} leaves nothing to equilibrate; expected a "
                "positive number other than 1"
            )
        check_spread(self.replicas)
        return [fluid]

    def times(self, gas: Fluid) -> list[float]:
        """Return when to measure: four times in each initial decay time of the temperature difference."""
        _, _, masses = species = gas.species
        counts = gas.n * species[0] / species[0].sum()
        # `draw_velocities` sets both temperatures exactly, each species at rest; seen from the whole gas, as
        # `TemperatureEquilibration` measures them, they are lower
        hot = np.array([self.temperature_ratio, 1.0])
        start = (counts - 1) * hot * (gas.n - 1) / float((counts - 1) @ hot)
        start /= counts * (1.0 - masses / float(counts @ masses))
        rate = float(theory.temperature_equilibration_rate(start, *species, gas.dim).sum())
        count = round(SAMPLES * self.relaxation_times) + 1
        return (np.arange(count) / SAMPLES / rate).tolist()  # type: ignore[no-any-return]

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Any]:
        """Return what measures the temperatures."""
        return {"decay": TemperatureEquilibration()}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Equilibrate at one temperature, then draw velocities of two temperatures, and measure."""
        if replica.done == 0:
            yield from until(replica.simulation, gas.settled)
            scene = replica.simulation.to_scene()
            velocities = hs.draw_velocities(
                scene, "two-temperatures", temperature_ratio=self.temperature_ratio, seed=replica.seed
            )
            replica.running = hs.Simulation(scene.with_state(scene.positions, velocities))
            replica.seen["species"] = species_labels(replica.running.frame())
            replica.done = 1
        for frame in replica.simulation.frames(times=self.times(gas)[replica.done - 1 :]):
            replica.estimators["decay"].add(frame)
            replica.done += 1
            yield

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return both temperatures and the rates, with errors from the spread of the replicas."""
        parts = [replica.estimators["decay"] for replica in replicas]
        decay = TemperatureEquilibration()
        for part in parts:
            decay.merge(part)
        curves, failures = _temperatures(decay)
        numbers = _rates(gas, decay, parts)
        main = "a decay rate of the temperature difference, which is lost in the noise"
        return Answer(
            gas,
            numbers,
            {"temperatures": curves},
            failures=[*failures, *alarms(numbers)],
            main=[numbers[0].quantity] if len(numbers) == 2 else main,
            details={"species": replicas[0].seen["species"]},
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the columns are."""
        labels = answers[0].details["species"]
        error = (
            "its uncertainty in parentheses is its known systematic error later, when the species are no "
            "longer Maxwellian and the difference decays more slowly"
        )
        return [
            "species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(labels, 1)),
            f"theory: two Maxwellians, exact at the start; {error}",
            "errors from the spread of replicas",
        ]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return both temperatures, and the decay of their difference."""
        from studies.figures.mixture import figure

        return figure(answers[0])


def _temperatures(decay: TemperatureEquilibration) -> tuple[Curves, list[str]]:
    """Return both temperatures and their difference against time, and a sentence where theory fails."""
    time, expected = decay.time, decay.theory
    columns = {
        f"temperature_{k + 1}": Column(
            decay.temperatures[:, k],
            decay.temperatures_error[:, k],
            expected.value[:, k],
            expected.uncertainty[:, k],
            title=f"T{k + 1}",
        )
        for k in range(2)
    }
    difference, error = replica_mean(decay.samples[:, :, 0] - decay.samples[:, :, 1])
    law = expected.value[:, 0] - expected.value[:, 1]
    # the energy is conserved: where one temperature is too high in theory the other is too low
    uncertainty = expected.uncertainty.sum(axis=1)
    freedom = decay.n_replicas - 1.0
    apart = np.where(time > 0.0, difference - law, np.nan)  # at the start both are the same
    z = deviates(apart, error, uncertainty, freedom)
    columns["difference"] = Column(difference, error, law, uncertainty, z, title="T1 - T2")
    worst = int(np.nanargmax(np.abs(z)))
    there = Estimate(float(difference[worst]), float(error[worst]), degrees_of_freedom=freedom)
    failures = []
    if alarming(there, law[worst], uncertainty[worst]):
        failures.append(f"T1 - T2 is {z[worst]:+.1f} standard errors from theory at time {time[worst]:.4g}")
    return Curves({"time": time, "s": decay.s}, columns, printed=True), failures


def _rates(
    gas: Fluid, decay: TemperatureEquilibration, replicas: Sequence[TemperatureEquilibration]
) -> list[TheoryCheck]:
    """Return the decay rate of the difference, unless it is lost in noise, and the collision rate.

    The first is that over the first relaxation time, or the run if shorter. Theory of collisions per particle
    and time: sum of x_i nu_ij at the temperatures of theory, averaged over the second half of the run; u from
    the contact values, 1/N for the finite size, and the theory's temperatures.
    """
    time, expected = decay.time, decay.theory
    numbers = []
    try:
        numbers.append(decay.check((0.0, float(time[min(SAMPLES, len(time) - 1)]))))
    except ValueError:
        pass
    half = len(time) // 2
    late = [(one.s[-1] - one.s[half]) / (one.time[-1] - one.time[half]) for one in replicas]
    densities, diameters, masses = gas.species

    def mean(temperatures: FloatArray) -> float:
        rates = [
            theory.mixture_collision_rates(densities, diameters, masses, gas.dim, kT).sum(axis=1)
            for kT in temperatures
        ]
        span = time[half:]
        total = np.array(rates) @ (densities / densities.sum())
        area = (np.diff(span) * (total[1:] + total[:-1]) / 2.0).sum()
        return float(area / (span[-1] - span[0]))

    rate = mean(expected.value[half:])
    shifted = mean(expected.value[half:] + expected.uncertainty[half:] * [[1.0, -1.0]])
    contact = float(theory.mixture_contact_values(densities, diameters, gas.dim).max())
    doubt = theory.mixture_contact_uncertainty(diameters, gas.dim) * (1.0 - 1.0 / contact)
    uncertainty = math.hypot(rate * math.hypot(doubt, 1.0 / gas.n), shifted - rate)
    found = estimate_from_replicas(late)
    return [
        *numbers,
        number("collisions per particle and time", found, "Enskog", Prediction(rate, uncertainty)),
    ]
