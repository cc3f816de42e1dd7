"""Barometer: a fluid under gravity, its density, temperature and pressure at all heights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.barometer import HeightProfile
from analysis.reduced import species_labels
from analysis.statistics import Estimate, deviates
from analysis.theory import Prediction
from studies import options
from studies.answer import Answer, Column, Curves, alarms, number
from studies.atmosphere import Atmosphere
from studies.fluid import Fluid, check_length, check_spread, number_fraction
from studies.options import densities, dimension, option, packing_fractions, particles, positive, runs, word
from studies.report import alarming
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BarometerStudy"]

FloatArray = NDArray[np.float64]

USUAL_DENSITIES = "0.002,0.05"
FEWEST, SHORTEST = 16, 10.0  # particles, collisions per particle
WARMING = 20  # steps before the first frame, for checkpoints
BALANCED = 1e-10  # forces on floor and lid off the weight and the change of momentum, relative
HIGH = "the height of the box over kT/(m g)"


@dataclass(frozen=True, kw_only=True)
class BarometerStudy(Study):
    """Fluids in equilibrium under gravity, between floor and lid."""

    name = "barometer"
    question = "How dense, how hot and under which pressure is a gas at each height?"
    explanation = """
    A fluid in a tall box under gravity: density at each height beside hydrostatics with the equation of state
    of the dense fluid and the barometric law; temperature, the same at all heights but for what the fixed
    energy of few particles changes; the equation of state from the weight above each slice; forces on floor
    and lid. With --mass-ratio heavy ones sink. Writes a summary, two tables and a picture.
    """
    table = "barometer"
    files = ("barometer.csv", "profile.csv", "barometer.png")

    packing_fractions: tuple[float, ...] | None = densities(USUAL_DENSITIES)
    n: int = particles(1000)
    dim: int = dimension()
    boundary: str = option("periodic", "Of the sides of the box.", **word("--boundary", "periodic", "wall"))
    diameter_ratio: float = options.diameter_ratio()
    mass_ratio: float = options.mass_ratio()
    fraction: float | None = options.fraction()
    scale_heights: float = option(
        4.0, "Height of the box, in kT/(m g), m the mean mass.", **positive("--scale-heights", HIGH)
    )
    cells: int = option(24, "Slices along the height.", at_least=2, at_most=1000)
    collisions_per_particle: float = option(400.0, "How long to measure, s = 2 collisions / n.")
    replicas: int = runs(12)

    def gases(self) -> list[Atmosphere]:
        """Return the gases, by ascending packing fraction."""
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        species = (self.diameter_ratio, self.mass_ratio, share)
        if self.n < FEWEST:
            raise hs.SceneError(f"--n {self.n} is too few for a profile; ask for at least {FEWEST}")
        check_length(self.collisions_per_particle, SHORTEST, "is too short for a profile")
        check_spread(self.replicas)
        sides = (*[self.boundary] * (self.dim - 1), "wall")
        found = []
        for eta in self.packing_fractions or packing_fractions(USUAL_DENSITIES):
            gas = Atmosphere(Fluid(self.n, self.dim, eta, sides, *species), self.scale_heights)
            gas.check()
            found.append(gas)
        return found

    def estimators(self, gas: Atmosphere, simulation: hs.Simulation) -> dict[str, Any]:
        """Return what measures the profile."""
        return {"profile": HeightProfile(self.cells)}

    def moments(self, gas: Atmosphere) -> list[float]:
        """Return times: WARMING that are discarded, then those of the frames, a mean free time apart."""
        count = math.ceil(self.collisions_per_particle)
        warming = gas.settling * np.arange(1, WARMING + 1) / WARMING
        every = self.collisions_per_particle / count / gas.rate
        return [*warming.tolist(), *(gas.settling + every * np.arange(1, count + 1)).tolist()]

    def advance(self, gas: Atmosphere, replica: Replica) -> Iterator[None]:
        """Come to equilibrium, then measure at equal intervals of time."""
        profile = replica.estimators["profile"]
        for frame in replica.simulation.frames(times=self.moments(gas)[replica.done :]):
            if replica.done >= WARMING - 1:
                profile.add(frame)
            replica.done += 1
            yield
        replica.seen["species"] = species_labels(replica.simulation.frame())

    def answer(self, gas: Atmosphere, replicas: Sequence[Replica]) -> Answer:
        """Return the profile and the numbers, with errors from the spread of the replicas."""
        profile = HeightProfile(self.cells)
        for replica in replicas:
            profile.merge(replica.estimators["profile"])
        curves, failures = _profile(profile)
        off, (floor, lid) = max(profile.support, key=abs), profile.forces
        if not abs(off) < BALANCED * (floor.value + lid.value):
            failures.append(
                f"floor and lid carry {off:+.1e} of the weight more than weight and change of momentum"
            )
        of_lid: Any = None
        if (known := profile.theory) is not None:
            of_lid = known.on_the_lid(profile.edges[0], profile.temperature)
        numbers = [
            *profile.checks,
            number("on the lid, over the weight", lid, "hydrostatics", of_lid),
            number("on the floor, over the weight", floor),
            number("imbalance of forces, relative", off),
        ]
        notes = []
        if profile.theory is None:
            notes.append("no theory here of species of different diameters at one height")
        return Answer(
            gas,
            numbers,
            {"profile": curves},
            notes,
            [*failures, *alarms(numbers)],
            details={
                "species": replicas[0].seen["species"],
                "g": gas.g,
                "box": gas.box.tolist(),
                "kT_of_theory": profile.temperature,
                "discarded_time": gas.settling,
            },
            hidden={"profile": profile},
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the columns are."""
        labels = answers[0].details["species"]
        which = [f"species, {k}: {label}" for k, label in enumerate(labels, 1)] if len(labels) > 1 else []
        columns = (
            "z: height of centres above where they touch the floor; n: number density; kT: temperature of "
            "those there"
        )
        if "compressibility" in answers[0].curves["profile"].columns:
            columns += (
                "; Z: weight above and force on the lid, over n kT, beside the equation of state at that n"
            )
        how = (
            "theory of n: hydrostatics with the equation of state of the fluid and the adsorption at walls; "
            "of both n and kT: at the fixed energy of so many particles"
        )
        left = (
            "slices within some diameters of floor and lid, where particles lie in layers, are not compared, "
            "nor are those with hardly any particles"
        )
        return [*which, columns, how, left, "errors from the spread of the replicas"]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return density, temperature and equation of state."""
        from studies.figures.barometer import figure

        return figure(answers)


def _profile(profile: HeightProfile) -> tuple[Curves, list[str]]:
    """Return densities, temperatures and Z at all heights, and sentences where theory fails."""
    freedom, told = profile.n_replicas - 1.0, profile.told
    columns, failures = {}, []
    z = profile.heights[0]
    expected, warm = profile.expected, profile.expected_temperatures
    (density, spread), (kt, kt_spread) = profile.densities, profile.temperatures
    several = len(density) > 1

    def compared(
        name: str, title: str, value: FloatArray, error: FloatArray, law: Prediction, where: Any
    ) -> None:
        deviation = deviates(np.where(where, value - law.value, np.nan), error, law.uncertainty, freedom)
        columns[name] = Column(value, error, law.value, law.uncertainty, deviation, title, brief=True)
        if np.isfinite(deviation).any():
            worst = int(np.argmax(np.nan_to_num(np.abs(deviation))))
            there = Estimate(float(value[worst]), float(error[worst]), degrees_of_freedom=freedom)
            if alarming(there, float(law.value[worst]), float(law.uncertainty[worst])):
                failures.append(
                    f"{title} is {deviation[worst]:+.1f} standard errors from theory at z = {z[worst]:.4g}"
                )

    for k in range(len(density)):
        label = f" {k + 1}" if several else ""
        tail = label.replace(" ", "_")
        law = Prediction(expected.value[k], expected.uncertainty[k])
        compared(f"density{tail}", f"n{label}", density[k], spread[k], law, told[k])
        heat = Prediction(warm[k], (warm[k] - profile.temperature) ** 2)
        compared(f"temperature{tail}", f"kT{label}", kt[k], kt_spread[k], heat, told[k])
    if not several and profile.theory is not None:
        value, error, law = profile.state
        compared("compressibility", "Z", value, error, law, told[0])
    return Curves({"z": z}, columns, printed=True), failures
