"""The equation of state: pressure at several packing fractions, in up to three ways, beside theory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.correlation_times import variance_growth, virial_block_length
from analysis.pressure import Pressure
from analysis.statistics import Estimate, combine_replicas, pool_replicas
from analysis.theory import Prediction
from studies import options
from studies.answer import Answer, alarms, number
from studies.fluid import THEORY_UP_TO, Fluid, check_length, number_fraction, ordered
from studies.noticing import Notices, too_short
from studies.options import OptionError, option, options_of, packing_fractions
from studies.running.resuming import in_blocks
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SUITE", "EquationOfState"]

BLOCKS = 128  # of each run; they are joined as their correlation demands
LENGTH = 300.0  # collisions per particle, where nothing else is asked for
CORRELATION_TIMES = 10.0  # of the virial that a run holds at least
SHORTEST = 40.0  # collisions per particle, however low the precision
NOISE = 1.25  # relative standard error of Z - 1 times the root of the number of collisions
FEWEST_COLLISIONS = 16 * 8  # of a run: 16 blocks of 8
QUANTITIES = {  # by their names in `Pressure`
    "virial": "Z from the virial",
    "rate": "Z from the rate",
    "walls": "Z from the walls",
    "virial_minus_rate": "virial - rate",
}

SUITE = (
    *(Fluid(packing_fraction=eta) for eta in packing_fractions("0.01:0.49:9")),
    *(Fluid(dim=2, packing_fraction=eta) for eta in (0.1, 0.25, 0.4, 0.55, 0.65)),
    Fluid(packing_fraction=0.3, mass_ratio=10.0),  # Z does not depend on masses: as of one species
    Fluid(packing_fraction=0.3, diameter_ratio=2.0, mass_ratio=10.0),
    Fluid(dim=2, packing_fraction=0.5, diameter_ratio=1.4),
)
"""The fluids of --suite."""
SUITE_PRECISION = 1e-3


@dataclass(frozen=True, kw_only=True)
class EquationOfState(Study):
    """Z from the virial, from the rate of collisions and from the walls, and theory."""

    name = "pressure"
    question = "What is the equation of state of the fluid?"
    explanation = """
    Pressure from the virial, from the collision rate and from the walls (where there are some), with error
    bars, at several packing fractions. Writes a summary, a table and a picture with residuals.
    """
    table = "equation_of_state"
    files = ("equation_of_state.csv", "equation_of_state.png")

    packing_fractions: tuple[float, ...] = options.densities("0.01:0.49:9")
    n: int = options.particles(4000)
    dim: int = options.dimension()
    boundary: str | tuple[str, ...] = option("periodic", **options.boundary)
    diameter_ratio: float = options.diameter_ratio()
    mass_ratio: float = options.mass_ratio()
    fraction: float | None = options.fraction()
    collisions_per_particle: float | None = option(
        None,
        "How long to measure in each replica, s = 2 collisions / n.",
        shown="300, more near freezing",
    )
    suite: bool = option(
        False,
        "Nine states of spheres, five of discs and three mixtures of 4000 particles; --until-error is 1e-3 "
        "(two minutes) or as given (1e-4: hours).",
    )
    until_error: float | None = option(
        None, "With --suite: relative standard error of Z that sets the length of the runs."
    )

    def to_precision(self, target: float) -> EquationOfState | None:
        """Return the suite with runs as long as a precision takes; other gases need more replicas."""
        return replace(self, until_error=target) if self.suite else None

    @property
    def precision(self) -> float | None:
        """The relative standard error of Z that sets the length of the runs, if one does."""
        usual = self.suite and self.collisions_per_particle is None
        return SUITE_PRECISION if usual and self.until_error is None else self.until_error

    @property
    def not_extendable(self) -> str:
        """Whether all replicas share a length."""
        return "" if self.precision is None else "whose length depends on --replicas"

    def gases(self) -> list[Fluid]:
        """Return the gases to measure, by ascending packing fraction of each kind."""
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        fluids = list(SUITE) if self.suite else self._fluids(share)
        for fluid in fluids:
            fluid.check()
        if self.until_error is not None:
            if self.collisions_per_particle is not None:
                raise OptionError("--until-error and --collisions-per-particle both say how long; give one")
            if not 1e-6 <= self.until_error <= 0.1:
                raise OptionError(f"--until-error {self.until_error:g}; expected 1e-6 to 0.1")
        if self.suite:
            names = options.PANELS["The gas"].split()
            of_gas = [each for each, _ in options_of(self) if each.name in names]
            if any(getattr(self, each.name) != each.default for each in of_gas):
                raise OptionError("--suite has gases of its own; leave out the options that describe one")
        if self.collisions_per_particle is not None:
            n = min(fluid.n for fluid in fluids)
            check_length(
                self.collisions_per_particle,
                2 * FEWEST_COLLISIONS / n,
                f"gives no error bar for {n} particles",
            )
        return fluids

    def _fluids(self, share: float) -> list[Fluid]:
        more = (self.boundary, self.diameter_ratio, self.mass_ratio, share)
        return [Fluid(self.n, self.dim, eta, *more) for eta in self.packing_fractions]

    def length(self, gas: Fluid) -> float:
        """Return how long to measure each replica of a fluid, in collisions per particle."""
        if self.collisions_per_particle is not None:
            return self.collisions_per_particle
        eta, dim = gas.packing_fraction, gas.dim
        shortest = max(CORRELATION_TIMES * virial_block_length(eta, dim), 2 * FEWEST_COLLISIONS / gas.n)
        if self.precision is None:
            return max(LENGTH, shortest)
        z = float(theory.compressibility_factor(min(eta, THEORY_UP_TO[dim]), dim).value)
        collisions = variance_growth(eta, dim) * (NOISE * (1.0 - 1.0 / z) / self.precision) ** 2
        return max(2.0 * collisions / (gas.n * self.replicas), shortest, SHORTEST)

    def _ends(self, gas: Fluid) -> list[int]:
        """Return after how many collisions the blocks begin and end."""
        total = round(self.length(gas) * gas.n / 2)
        blocks = min(BLOCKS, total // 8)
        ends = gas.settled + np.linspace(0, total, blocks + 1).round().astype(int)
        return [int(end) for end in ends]

    def start(self, gas: Fluid, seed: np.random.SeedSequence) -> hs.Simulation:
        """Return the beginning of a run; flights of a mixture are tallied for its rates of unlike pairs."""
        return hs.Simulation(gas.scene(seed), free_paths=gas.mixed)

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Pressure]:
        """Return the one of all pressures."""
        return {"pressure": Pressure(simulation.scene, discard=True)}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Equilibrate, then measure block by block."""
        yield from in_blocks(replica, self._ends(gas), replica.estimators["pressure"].add)
        replica.seen["bond_order"] = hs.bond_order(replica.simulation.to_scene()).value
        replica.seen["ordered"] = ordered(replica.simulation)

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return Z in all ways, with errors from the blocks of each replica."""
        pressures: list[Pressure] = [replica.estimators["pressure"] for replica in replicas]
        names = {way: name for way, name in QUANTITIES.items() if way != "walls" or not gas.periodic}
        notices = Notices()
        found: dict[str, list[Estimate]] = {way: [] for way in names}
        for pressure in pressures:
            for way, name in names.items():
                with notices.of(name):
                    found[way].append(getattr(pressure, way))
        for way, name in names.items():
            with notices.of(name):
                combine_replicas(found[way])
        pooled = {way: pool_replicas(found[way]) for way in names}
        theories = pressures[0].predictions if gas.packing_fraction <= THEORY_UP_TO[gas.dim] else {}
        best = next(iter(theories.items()), ("", None))
        zs = [number(names[way], pooled[way], *best) for way in names if way != "virial_minus_rate"]
        difference = number(names["virial_minus_rate"], pooled["virial_minus_rate"], expected=0.0)
        that = Prediction(pooled["virial"].value, pooled["virial"].standard_error)
        walls = [number(its.quantity, its.measured, "that of the virial", that) for its in zs[2:]]
        order = max(replica.seen["bond_order"] for replica in replicas)
        discarded = float(np.mean([self._discarded(gas, pressure) for pressure in pressures]))
        failures = []
        if any(replica.seen["ordered"] for replica in replicas):
            failures.append(f"the particles have ordered, bond order {order:.2f}: this is no fluid")
        return Answer(
            gas,
            [*zs, difference, number("discarded", discarded), number("bond order", order)],
            notes=[*notices.notes, *too_short(notices.times, self.length(gas))],
            failures=[*failures, *alarms([*zs, *walls, difference])],
            main=[QUANTITIES["virial"]],
            details={
                "start": "compressed" if gas.dense else "random",
                "collisions": sum(replica.status["collisions"] for replica in replicas),
                "collisions_per_particle": self.length(gas),
                "theories": {
                    name: {"value": float(its.value), "uncertainty": float(its.uncertainty)}
                    for name, its in theories.items()
                },
            },
        )

    def _discarded(self, gas: Fluid, pressure: Pressure) -> float:
        """Return the collisions per particle before what was measured."""
        start, *ends = self._ends(gas)
        dropped = pressure.discarded_rows * (ends[-1] - start) / len(ends)
        return 2.0 * (gas.settled + dropped) / gas.n

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return which theory it is, what the other columns are, and the precision asked for."""
        fluids, sentences = [answer.gas for answer in answers], []
        numbers = [found for answer in answers for found in answer.numbers]
        if named := dict.fromkeys(found.theory for found in numbers if found.theory):
            sizes = {fluid.n for fluid in fluids if fluid.periodic}
            finite = f" with the finite-size correction for {min(sizes)} particles" if sizes else ""
            sentences.append(f"theory: {', '.join(named)}{finite}; its uncertainty in parentheses")
        sentences.append("virial - rate: of blocks of the same collisions, expected 0")
        placed = ["placed at random"] * any(not fluid.dense for fluid in fluids)
        grown = ["grown to their size"] * any(fluid.dense for fluid in fluids)
        how = (
            f"start: {' or '.join([*placed, *grown])}; discarded: collisions per particle before the "
            "measurement, with what the rule of Chodera 2016 drops from its start; bond order: the largest "
            "at the end, Q6 of spheres, psi6 of discs"
        )
        sentences.append(how)
        if self.precision is not None:
            zs = [found.measured for found in numbers if found.quantity.startswith("Z ")]
            worst = max(z.standard_error / z.value for z in zs)
            sentences.append(
                f"relative standard error of Z: {worst:.2g} at most, asked for {self.precision:.2g}"
            )
        return sentences

    def subject(self, answers: Sequence[Answer]) -> str:
        """Return the gas, or what those of the suite have in common."""
        if not self.suite:
            return super().subject(answers)
        sizes = " or ".join(str(n) for n in sorted({answer.gas.n for answer in answers}))
        return f"{self.replicas} x {sizes} particles each, periodic box"

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return Z and its residuals; of the suite, the residuals of each kind of fluid."""
        if self.suite:
            from studies.figures.pressure_suite import figure
        else:
            from studies.figures.pressure import figure
        return figure(answers)
