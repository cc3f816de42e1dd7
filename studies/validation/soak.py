"""Very long runs: invariants over 1e9 collisions, measured a hundred times during the run."""

from __future__ import annotations

import datetime
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from studies.fluid import Fluid, broken
from studies.report import (
    OutputFolder,
    Screen,
    checks_of,
    engine_of,
    engine_rate,
    machine,
    say_checks,
    seconds_taken,
)
from studies.running.encoding import encode
from studies.running.ensemble import available_cores, replica_seeds, run_replicas
from studies.running.resuming import Resumable, until

__all__ = ["Gas", "Soak", "Soaking", "growth_exponent", "soak"]

Floats = NDArray[np.float64]

SAMPLES = 100  # in each run
WARM = 10_000_000  # collisions in a process before its memory is compared
MOST_GROWTH = 1_000_000  # bytes


@dataclass(frozen=True)
class Gas:
    """What to run, and for how many pair collisions."""

    fluid: Fluid
    collisions: int


@dataclass(frozen=True)
class Soak:
    """Options of the study, as on the command line (`hardspheres soak --help`).

    Attributes
    ----------
    n, dim : int
        Particles in each gas, and the dimension.
    collisions : int
        Pair collisions of the fluid.
    seed, workers
        As in `studies.running.ensemble`.
    """

    n: int = 4000
    dim: int = 3
    collisions: int = 1_000_000_000
    seed: int = 1
    workers: int | None = None

    @property
    def gases(self) -> tuple[Gas, ...]:
        """A fluid, and for a tenth as long a mixture between walls."""
        fluid = Fluid(self.n, self.dim)
        mixture = Fluid(self.n, self.dim, 0.25, "wall", diameter_ratio=2.0, mass_ratio=10.0)
        return Gas(fluid, self.collisions), Gas(mixture, self.collisions // 10)


COLUMNS = (
    "collisions",
    "time",
    "energy_drift",
    "momentum_drift",
    "worst_overlap",
    "late_events",
    "memory_growth",
)


@dataclass(frozen=True)
class Soaked:
    """Result of one run: `samples` has a row for each moment and a column for each of `COLUMNS`."""

    samples: Floats
    failures: tuple[str, ...]
    status: dict[str, Any]
    seconds: float

    def column(self, name: str) -> Floats:
        """Return one of the columns."""
        return self.samples[:, COLUMNS.index(name)]

    def worst(self, name: str) -> float:
        """Return the largest absolute value of a column, NaN where it is not known."""
        column = np.abs(self.column(name))
        return float(np.nanmax(column)) if np.isfinite(column).any() else math.nan


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


@dataclass
class _Soaking:
    """A run in progress."""

    simulation: hs.Simulation
    samples: list[tuple[float, ...]]
    failures: list[str]


def resident() -> float:
    """Return the resident memory of this process in bytes, NaN where it is not known (it is on Linux)."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return math.nan
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith("VmRSS:")), math.nan)


@dataclass(frozen=True)
class Soaking(Resumable[tuple[Gas, np.random.SeedSequence], _Soaking, Soaked]):
    """The task that turns a gas and a seed into a long run."""

    def begin(self, item: tuple[Gas, np.random.SeedSequence]) -> _Soaking:
        """Make the gas."""
        gas, seed = item
        return _Soaking(hs.Simulation(gas.fluid.scene(seed)), [], [])

    def steps(self, item: tuple[Gas, np.random.SeedSequence], state: _Soaking) -> Iterator[None]:
        """Run, and sample at regular numbers of collisions."""
        simulation, total = state.simulation, item[0].collisions
        first, before = simulation.collisions, math.nan
        warm = first + min(WARM, total // 10)
        for sample in range(len(state.samples) + 1, SAMPLES + 1):
            yield from until(simulation, total * sample // SAMPLES)
            overlap, status, failure = simulation.worst_overlap, simulation.status(), broken(simulation)
            if math.isnan(before) and simulation.collisions >= warm:
                encode(state)  # first, so that one-time allocations do not count as growth
                before = resident()
            row = [simulation.collisions, simulation.time, status["energy_drift"], status["momentum_drift"]]
            state.samples.append((*row, overlap, status["late_events"], resident() - before))
            if failure:
                state.failures.append(f"after {simulation.collisions} collisions {failure}")
            yield

    def result(self, item: tuple[Gas, np.random.SeedSequence], state: _Soaking, seconds: float) -> Soaked:
        """Return what was measured."""
        samples = np.array(state.samples, dtype=np.float64)
        found = Soaked(samples, tuple(state.failures), state.simulation.status(), seconds)
        late, growth = found.worst("late_events"), found.worst("memory_growth")
        failures = [*state.failures]
        failures += [f"{late:.0f} events were out of order"] if late else []
        failures += [f"resident memory grew by {growth / 1e6:.1f} MB"] if growth >= MOST_GROWTH else []
        return Soaked(samples, tuple(failures), found.status, seconds)


def soak(study: Soak, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : Soak
        What to do.
    out : OutputFolder
        Where the files go; made only after everything has been checked.
    screen : Screen
        Where results and progress are shown.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        Whether energy and momentum were conserved, no particles overlapped, no event was out of order and
        memory did not grow.

    Raises
    ------
    HardSpheresError
        If a gas cannot be made or never collides, or the folder cannot be written.
    """
    began = time.perf_counter()
    for gas in study.gases:
        gas.fluid.check()
    out.check(study)
    seeds = replica_seeds(study.seed, len(study.gases))
    with screen.compiling("a fluid, and a mixture between walls"):
        for gas, seed in zip(study.gases, seeds, strict=True):
            hs.Simulation(gas.fluid.scene(seed)).run(collisions=1)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        items = list(zip(study.gases, seeds, strict=True))
        with screen.progress("runs", len(items)) as advance:
            runs = run_replicas(Soaking(), items, workers=study.workers, done=advance, shelf=shelf)
        ran = time.perf_counter()
        out.write_csv("soak.csv", _columns(runs))
        summary = _summary(study, runs, out)
        summary["seconds"] = seconds_taken(began, ready, ran, work="runs")
        out.write_json("summary.json", summary)
    _print(screen, study, runs, summary, out)
    return summary, bool(summary["checks"]["passed"])


def _columns(runs: Sequence[Soaked]) -> dict[str, Any]:
    """Return the columns of soak.csv, one run after another."""
    table = np.concatenate([run.samples for run in runs])
    return {"gas": np.repeat(range(len(runs)), [len(run.samples) for run in runs])} | dict(
        zip(COLUMNS, table.T, strict=True)
    )


def _summary(study: Soak, runs: Sequence[Soaked], out: OutputFolder) -> dict[str, Any]:
    statuses = [run.status for run in runs]
    failures = [f"gas {index}: {failure}" for index, run in enumerate(runs) for failure in run.failures]
    collisions = sum(status["collisions"] for status in statuses)
    return {
        "study": "soak",
        "version": hs.__version__,
        "seed": study.seed,
        "options": {"n": study.n, "dim": study.dim, "collisions": study.collisions},
        "workers": available_cores() if study.workers is None else study.workers,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": machine(),
        "gases": [
            {
                "gas": str(gas.fluid),
                "packing_fraction": gas.fluid.packing_fraction,
                "collisions": run.status["collisions"],
                "wall_collisions": run.status["wall_collisions"],
                "energy_drift": run.worst("energy_drift"),
                "momentum_drift": run.worst("momentum_drift"),
                "energy_growth_exponent": growth_exponent(run.column("energy_drift")),
                "momentum_growth_exponent": growth_exponent(run.column("momentum_drift")),
                "worst_overlap": run.worst("worst_overlap"),
                "late_events": run.worst("late_events"),
                "memory_growth": run.worst("memory_growth"),
                "collisions_per_second": run.status["collisions"] / run.seconds,
            }
            for gas, run in zip(study.gases, runs, strict=True)
        ],
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / sum(run.seconds for run in runs),
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, failures),
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def _power(exponent: float) -> str:
    return f"n^{exponent:.2f}" if math.isfinite(exponent) else ""


def _print(
    screen: Screen, study: Soak, runs: Sequence[Soaked], summary: dict[str, Any], out: OutputFolder
) -> None:
    for index, gas in enumerate(study.gases):
        screen.say(f"gas {index}: {gas.fluid}, packing fraction {gas.fluid.packing_fraction:g}")
    screen.say()
    header = [
        "gas",
        "collisions",
        "wall collisions",
        "energy",
        "growth",
        "momentum",
        "growth",
        "overlap",
        "late",
        "memory",
        "per second",
    ]
    rows = []
    for index, gas in enumerate(summary["gases"]):
        growth = gas["memory_growth"]
        rows.append(
            [
                str(index),
                f"{gas['collisions']:.3g}",
                f"{gas['wall_collisions']:.3g}",
                f"{gas['energy_drift']:.1e}",
                _power(gas["energy_growth_exponent"]),
                f"{gas['momentum_drift']:.1e}",
                _power(gas["momentum_growth_exponent"]),
                f"{gas['worst_overlap']:.1e}",
                f"{gas['late_events']:.0f}",
                f"{growth / 1e6:.2f} MB" if math.isfinite(growth) else "",
                f"{gas['collisions_per_second']:.2g}",
            ]
        )
    screen.table("", header, rows)
    screen.say()
    screen.say(
        "energy, momentum: largest change, relative, and of sum m |v|, and how it grows with the number n "
        "of collisions (random walk: n^0.5, drift: n^1)"
    )
    screen.say("overlap: deepest, in contact distances")
    screen.say("late: events executed out of order; memory: largest growth of the process after the start-up")
    say_checks(screen, summary, out)
