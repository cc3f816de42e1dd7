"""Discs where they melt: pressure and hexatic order from two starts, beside Monte Carlo programs."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.hexatic import HexaticOrder, local_order
from analysis.pressure import Pressure
from analysis.statistics import Estimate, TheoryCheck, pool_replicas, replica_mean
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import LONGEST, check_length
from studies.noticing import Notices, too_short
from studies.options import OptionError, densities, option, runs, word
from studies.running.resuming import until
from studies.study import Replica, Study
from studies.two_starts import Discs, canonical_pressure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Melting"]

STARTS = {"both": ("fluid", "crystal"), "crystal": ("crystal",), "fluid": ("fluid",)}
MOST_FRAMES = 512  # of the measurement, and at the same spacing before it: fewer than a series joins
FEWEST_FRAMES, CLOSEST = 32, 10.0  # collisions per particle from one to the next
SHORTEST = 100.0  # collisions per particle
INDEPENDENT = 20.0  # correlation times of Psi6 that a run holds at least
RESOLVED = 0.75  # distances of two frames: below, Psi6 may last for any shorter time
APART = 3.0  # standard errors between two starts that do not agree

PRESSURE, PRESSURES = "beta P (2r)^2", "P, fluid - crystal"
ORDER, ORDERS = "|Psi6|", "|Psi6|, fluid - crystal"
SUSCEPTIBILITY, TIME = "susceptibility", "correlation time"


@dataclass(frozen=True, kw_only=True)
class Melting(Study):
    """Pressure, hexatic order and how long it lasts, of discs that start as a crystal and as a fluid."""

    name = "melting"
    question = "How do discs melt, and when is a run long enough to say?"
    explanation = """
    Pressure, global order Psi6 and its correlation g6(r) of hard discs between liquid, hexatic and solid,
    from a crystal and from a grown fluid in the same box, which must agree; beside pressures of event-chain
    and parallel Monte Carlo. Says of each density whether the run was long enough. Writes a summary, three
    tables and a picture of the discs by the direction of their order.
    """
    table = "melting"
    files = ("melting.csv", "order.csv", "g6.csv", "melting.png")

    packing_fractions: tuple[float, ...] = densities("0.7,0.71,0.72")
    n: int = option(
        870, "Discs: a whole triangular lattice in a nearly square box, as 65536 = 256 x 256.", at_least=64
    )
    starts: str = option(
        "both",
        "What replicas start as; both: fluid and crystal in turn.",
        flag="--start",
        **word("--start", *STARTS),
    )
    collisions_per_particle: float = option(
        160_000.0, "How long to measure in each replica, s = 2 collisions / n."
    )
    equilibration: float | None = option(
        None,
        "Collisions per particle before the measurement.",
        at_least=0.0,
        at_most=LONGEST,
        shown="a quarter of the measurement",
    )
    replicas: int = runs(2)

    def gases(self) -> list[Discs]:
        """Return the discs, by ascending packing fraction."""
        found = [Discs(self.n, 2, eta, starts=STARTS[self.starts]) for eta in self.packing_fractions]
        for discs in found:
            discs.check()
        check_length(self.collisions_per_particle, SHORTEST, "is too short for any order to change")
        if self.starts == "both" and self.replicas < 2:
            raise OptionError("--start both needs --replicas 2 or more: one from a fluid, one from a crystal")
        return found

    @property
    def discarded(self) -> float:
        """Collisions per particle before the measurement."""
        given = self.equilibration
        return 0.25 * self.collisions_per_particle if given is None else given

    @property
    def frames(self) -> int:
        """Number of frames of the measurement, besides the first."""
        return min(max(round(self.collisions_per_particle / CLOSEST), FEWEST_FRAMES), MOST_FRAMES)

    def moments(self, gas: Discs) -> tuple[list[int], int]:
        """Return at how many pair collisions frames are taken, and which of them begins the measurement."""
        total, before = (round(0.5 * s * gas.n) for s in (self.collisions_per_particle, self.discarded))
        count = min(MOST_FRAMES, max(round(self.frames * before / total), 1)) if before else 0
        first = np.linspace(0, before, count + 1).round().astype(int)
        rest = before + np.linspace(0, total, self.frames + 1).round().astype(int)
        return [*first[:-1].tolist(), *rest.tolist()], count

    def estimators(self, gas: Discs, simulation: hs.Simulation) -> dict[str, Any]:
        """Return those of pressure and order."""
        return {"pressure": Pressure(simulation.scene), "order": HexaticOrder()}

    def advance(self, gas: Discs, replica: Replica) -> Iterator[None]:
        """Follow the order from the start on, and measure from the end of equilibration."""
        simulation, (moments, begin) = replica.simulation, self.moments(gas)
        box, before = simulation.scene.box, replica.seen.setdefault("before", [])
        for k in range(replica.done, len(moments)):
            yield from until(simulation, moments[k])
            frame = simulation.frame()
            if k == begin:  # of this scene, which a checkpoint may have made anew
                replica.estimators = self.estimators(gas, simulation)
            if k < begin:
                before.append(float(abs(local_order(frame.positions, box).mean())))
            else:
                replica.estimators["order"].add(frame)
                replica.estimators["pressure"].add(frame)
            replica.done += 1
            yield
        places = simulation.positions
        psi = local_order(places, box)
        replica.seen["places_and_order"] = np.column_stack([places, psi.real, psi.imag]).astype(np.float32)

    def answer(self, gas: Discs, replicas: Sequence[Replica]) -> Answer:
        """Return pressure and order of all runs, and how far both starts differ."""
        starts = {
            name: [one for one in replicas if gas.start_of(one.seed) == name]
            for name in sorted({gas.start_of(one.seed) for one in replicas}, reverse=True)
        }
        notices = Notices()
        pressures, orders, g6 = {}, {}, {}
        for name, own in starts.items():
            merged = {key: _merged(own, key) for key in ("pressure", "order")}
            with notices.of(f"Z from the {name}"):
                virial = merged["pressure"].virial
            pressures[name] = canonical_pressure(virial, gas.packing_fraction, gas.n)
            with notices.of(f"{ORDER} from the {name}"):
                orders[name] = merged["order"].order
            g6[name] = merged["order"]
        together = _merged(replicas, "order")
        with notices.of(SUSCEPTIBILITY):
            susceptibility = together.susceptibility
        time = together.correlation_time
        known = theory.disc_pressure(gas.packing_fraction, gas.n, gas.ratio)
        with notices.of("both starts"):
            pressure, order = (pool_replicas(list(each.values())) for each in (pressures, orders))
        numbers = [number(PRESSURE, pressure, *(known or ("", None)))]
        if len(starts) == 2:
            numbers.append(number(PRESSURES, _difference(pressures), expected=0.0))
        numbers.append(number(ORDER, order))
        if len(starts) == 2:
            numbers.append(number(ORDERS, _difference(orders), expected=0.0))
        numbers += [number(SUSCEPTIBILITY, susceptibility), number(TIME, time)]
        long_enough, verdict = self._verdict(time, notices.times > 0.0 or bool(notices.notes), numbers)
        return Answer(
            gas,
            numbers,
            {"order": self._paths(gas, starts), "g6": _correlations(together, g6)},
            [verdict, *notices.notes, *too_short(notices.times, self.collisions_per_particle)],
            alarms(numbers[:1]) if long_enough else [],
            details={
                "box": gas.box.tolist(),
                "equilibration": self.discarded,
                "collisions_per_particle": self.collisions_per_particle,
                "long_enough": long_enough,
                "starts": {
                    name: {
                        PRESSURE: [pressures[name].value, pressures[name].standard_error],
                        ORDER: [orders[name].value, orders[name].standard_error],
                    }
                    for name in starts
                },
            },
            hidden={
                "starts": {name: (pressures[name], orders[name]) for name in starts},
                "last": {name: own[-1].seen["places_and_order"] for name, own in starts.items()},
            },
        )

    def _verdict(self, time: Estimate, short: bool, numbers: Sequence[TheoryCheck]) -> tuple[bool, str]:
        """Return whether the run was long enough, as far as it can tell, and a sentence that says so."""
        length = self.collisions_per_particle
        held, most = length / time.value, "at most " * (time.value < RESOLVED * length / self.frames)
        kept = f"Psi6 lasts for {most}{_two_digits(time.value)} collisions per particle"
        apart = [each for each in numbers if each.quantity in (PRESSURES, ORDERS) and abs(each.z) > APART]
        if held < INDEPENDENT:
            return False, (
                f"too short: {kept} or more, and a run of {length:g} holds {_two_digits(held)} such times "
                f"instead of the {INDEPENDENT:g} that it needs; pressure and order may be those of the start"
            )
        if apart:
            which = " and ".join(f"{each.quantity} is {each.z:+.1f} standard errors from 0" for each in apart)
            return False, f"too short: the starts do not agree, {which}"
        if short:
            return (
                False,
                f"too short: {kept}, but pressure or |Psi6| drift, or have longer correlations than that",
            )
        if self.starts != "both":
            return False, f"{kept}, but there is one start, and nothing says that another one would agree"
        return True, f"long enough: {kept}, a run holds {_two_digits(held)} such times, and both starts agree"

    def _paths(self, gas: Discs, starts: dict[str, list[Replica]]) -> Curves:
        """Return |Psi6| of every frame from the start on, mean over the replicas of each start."""
        moments, begin = self.moments(gas)
        columns = {}
        for name, own in starts.items():
            paths = [np.append(one.seen["before"], one.estimators["order"].moduli) for one in own]
            columns[name] = Column(*replica_mean(paths))
        s, measured = 2.0 * np.array(moments) / gas.n, np.arange(float(len(moments))) >= begin
        return Curves(
            {"collisions_per_particle": s}, columns, beside={"measured": measured.astype(np.float64)}
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        low, high = theory.COEXISTENCE
        known = dict.fromkeys(each.theory for answer in answers for each in answer.numbers if each.theory)
        between = Estimate(theory.COEXISTENCE_PRESSURE.value, theory.COEXISTENCE_PRESSURE.uncertainty)
        pressure = f"{PRESSURE}: at fixed temperature, r the radius, from the virial"
        phases = (
            f"in a large box liquid and hexatic coexist from packing fraction {low:g} to {high:g}, at "
            f"{between}, and the hexatic reaches to {theory.HEXATIC_UP_TO:g} (Bernard, Krauth 2011)"
        )
        apart = self.collisions_per_particle / self.frames
        order = (
            "Psi6: mean over the discs of exp(6 i angle) of the bonds to their six nearest neighbours; "
            "susceptibility N (<|Psi6|^2> - <|Psi6|>^2); correlation time of the complex Psi6, in collisions "
            f"per particle, where it is longer than half of the {apart:.3g} between two frames"
        )
        how = (
            f"{self.discarded:g} collisions per particle discarded, {self.collisions_per_particle:g} "
            "measured; errors from blocks as long as the correlation asks for"
        )
        beside = f"; theory: {', '.join(known)}, as many discs" if known else ""
        return [pressure + beside, phases, order, how]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return the discs by the direction of their order, pressures, |Psi6| over time, and g6."""
        from studies.figures.melting import figure

        return figure(answers)


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):.10g}"


def _merged(replicas: Sequence[Replica], name: str) -> Any:
    """Return one estimator with the data of all runs."""
    first, *others = [replica.estimators[name] for replica in replicas]
    whole = copy.deepcopy(first)
    for other in others:
        whole.merge(other)
    return whole


def _difference(of: dict[str, Estimate]) -> Estimate:
    """Return that of the fluid less that of the crystal."""
    both = [of["fluid"], of["crystal"]]
    squares = np.array([each.standard_error for each in both]) ** 2
    behind = float((squares**2 / [each.degrees_of_freedom for each in both]).sum())
    error, effective = math.sqrt(float(squares.sum())), min(each.n_effective for each in both)
    freedom = error**4 / behind if behind > 0.0 else math.inf  # Welch and Satterthwaite, as `pool_replicas`
    return Estimate(both[0].value - both[1].value, error, effective, freedom)


def _correlations(together: HexaticOrder, starts: dict[str, HexaticOrder]) -> Curves:
    """Return g6 of all runs, and of each start."""
    every = {
        "g6": together,
        **({f"g6_{name}": its for name, its in starts.items()} if len(starts) > 1 else {}),
    }
    columns = {name: Column(its.correlation, its.correlation_error) for name, its in every.items()}
    return Curves({"r": together.r}, columns)
