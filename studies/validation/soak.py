"""Very long runs: invariants over 1e9 collisions, measured a hundred times during the run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.theory import Prediction
from studies.answer import Answer, Column, Curves, number
from studies.fluid import Fluid, broken
from studies.options import dimension, option, particles, runs
from studies.running.encoding import encode
from studies.running.resuming import until
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Invariants", "Soak", "growth_exponent"]

Floats = NDArray[np.float64]

SAMPLES = 100  # in each run
WARM = 10_000_000  # collisions in a process before its memory is compared
MOST_GROWTH = 1_000_000  # bytes
EXPONENT_ERROR = 0.08  # of `growth_exponent`, with 100 samples of a random walk

COLUMNS = (
    "collisions",
    "time",
    "energy_drift",
    "momentum_drift",
    "worst_overlap",
    "late_events",
    "memory_growth",
)


def growth_exponent(values: Floats) -> float:
    """Exponent of growth of a quantity with the length of a run: 1/2 in a random walk, 1 in a drift.

    Parameters
    ----------
    values : ndarray, shape (samples,)
        The quantity at regular moments; it was 0 before the first.

    Returns
    -------
    exponent : float
        log10 of the root mean square change over ten samples to that over one; NaN where there are not twenty
        samples, or nothing has changed. With 100 samples of a random walk it scatters by about 0.08.
    """
    course = np.concatenate(([0.0], values))
    if len(values) < 20:
        return math.nan
    short, long = (math.sqrt(float(np.mean((course[lag:] - course[:-lag]) ** 2))) for lag in (1, 10))
    return math.log10(long / short) if short > 0.0 and long > 0.0 else math.nan


def resident() -> float:
    """Return the resident memory of this process in bytes, NaN where it is not known (it is on Linux)."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return math.nan
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmRSS:")), math.nan)


@dataclass
class Invariants:
    """What must not change, sampled during a run.

    Attributes
    ----------
    samples : list of list of float
        A row for each moment, with an entry for each of `COLUMNS`.
    failures : list of str
        What `Simulation.check` found broken, and when.
    """

    samples: list[list[float]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def add(self, frame: hs.Simulation, memory: float = math.nan) -> Self:
        """Sample a simulation; `memory` is by how many bytes the process has grown."""
        overlap, status, failure = frame.worst_overlap, frame.status(), broken(frame)
        row = [frame.collisions, frame.time, status["energy_drift"], status["momentum_drift"]]
        self.samples.append([*row, overlap, status["late_events"], memory])
        if failure:
            self.failures.append(f"after {frame.collisions} collisions {failure}")
        return self

    def column(self, name: str) -> Floats:
        """Return one of `COLUMNS`."""
        return np.array(self.samples, dtype=np.float64)[:, COLUMNS.index(name)]

    def worst(self, name: str) -> float:
        """Return the largest absolute value of a column, NaN where it is not known."""
        column = np.abs(self.column(name))
        return float(np.nanmax(column)) if np.isfinite(column).any() else math.nan


@dataclass(frozen=True, kw_only=True)
class Soak(Study):
    """A fluid, and for a tenth as long a mixture between walls."""

    name = "soak"
    question = "What changes in 1e9 collisions that must not?"
    explanation = """
    Energy, momentum, overlaps, events out of order and resident memory of a fluid at packing fraction 0.3,
    and of a mixture between walls. Takes about half an hour on two cores. Writes a summary and two tables.
    """
    table = "soak"
    files = ("soak.csv", "invariants.csv")
    to_an_error = False

    collisions: int = option(
        1_000_000_000,
        "Pair collisions of the fluid; the mixture gets a tenth.",
        at_least=1000,
        at_most=10**15,
    )
    n: int = particles(4000)
    dim: int = dimension()
    replicas: int = runs(1)

    def gases(self) -> list[Fluid]:
        """Return the two gases."""
        fluid = Fluid(self.n, self.dim)
        mixture = Fluid(self.n, self.dim, 0.25, "wall", diameter_ratio=2.0, mass_ratio=10.0)
        fluid.check()
        return [fluid, mixture]

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Invariants]:
        """Return what samples the invariants."""
        return {"invariants": Invariants()}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Run, and sample at regular numbers of collisions."""
        simulation, invariants = replica.simulation, replica.estimators["invariants"]
        total = self.collisions // 10 if gas.mixed else self.collisions
        before, warm = math.nan, simulation.collisions + min(WARM, total // 10)
        while replica.done < SAMPLES:
            yield from until(simulation, total * (replica.done + 1) // SAMPLES)
            if math.isnan(before) and simulation.collisions >= warm:
                encode(replica)  # first, so that one-time allocations do not count as growth
                before = resident()
            invariants.add(simulation, resident() - before)
            replica.done += 1
            yield

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return the largest changes of all runs, and the course of the first."""
        seen = [replica.estimators["invariants"] for replica in replicas]
        worst = {name: max(one.worst(name) for one in seen) for name in COLUMNS}
        walk = Prediction(0.5, EXPONENT_ERROR)
        numbers = [number("collisions", sum(replica.status["collisions"] for replica in replicas))]
        numbers.append(
            number("collisions with walls", sum(replica.status["wall_collisions"] for replica in replicas))
        )
        for name in ("energy", "momentum"):
            growth = growth_exponent(seen[0].column(f"{name}_drift"))
            numbers.append(number(f"change of {name}, relative", worst[f"{name}_drift"]))
            numbers.append(number(f"exponent of its growth, {name}", growth, "random walk", walk))
        numbers += [
            number("deepest overlap, in contact distances", worst["worst_overlap"]),
            number("events out of order", worst["late_events"], "none", 0.0),
            number("growth of memory, MB", worst["memory_growth"] / 1e6),
        ]
        failures = [failure for one in seen for failure in one.failures]
        if worst["late_events"]:
            failures.append(f"{worst['late_events']:.0f} events were out of order")
        if worst["memory_growth"] >= MOST_GROWTH:
            failures.append(f"resident memory grew by {worst['memory_growth'] / 1e6:.1f} MB")
        course = {
            name: Column(seen[0].column(name), np.full(len(seen[0].samples), np.nan)) for name in COLUMNS
        }
        axes = {name: course.pop(name).value for name in COLUMNS[:2]}
        return Answer(gas, numbers, {"invariants": Curves(axes, course)}, failures=failures)

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        growth = (
            "change of momentum: relative to the sum of m |v|; exponent of its growth: n^0.5 for n "
            "collisions in a random walk of roundings, n^1 in a drift"
        )
        return [growth, "growth of memory: of the process, after the start-up"]

    def figures(self, answers: Sequence[Answer]) -> Mapping[str, Figure]:
        """Return no figure."""
        return {}
