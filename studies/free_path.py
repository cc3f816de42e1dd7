"""Free paths of the fluid: means, rates between species and distributions at several packing fractions, beside theory."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.free_path import SURVIVAL_AT, FreePath
from analysis.statistics import Estimate, TheoryCheck, combine_replicas, pool_replicas
from studies.fluid import Fluid, broken, check_length, load_kernels, run_fluids
from studies.noticing import Notices, too_short
from studies.report import (
    ALARM,
    Z_MEANS,
    OutputFolder,
    Screen,
    alarming,
    checks_of,
    engine_of,
    engine_rate,
    estimate_json,
    say_checks,
    seconds_taken,
)
from studies.running.ensemble import available_cores
from studies.running.resuming import Resumable, in_blocks

__all__ = ["FreePathState", "FreePaths", "Runs", "free_path"]

FloatArray = NDArray[np.float64]

BLOCKS = 192  # of each run; they are joined as their correlation demands
FEWEST_FLIGHTS = 2000  # of each species, to know them by speed


@dataclass(frozen=True)
class FreePaths:
    """Options of the study, as on the command line (`hardspheres free-path --help`).

    Attributes
    ----------
    packing_fractions : tuple of float
        Where to measure, ascending.
    fluid : Fluid
        The gas, but for its packing fraction.
    collisions_per_particle : float
        How long to measure in each replica.
    replicas, seed, workers
        As in `studies.running.ensemble`.
    """

    packing_fractions: tuple[float, ...] = (0.001, 0.01, 0.1, 0.3)
    fluid: Fluid = field(default_factory=Fluid)
    collisions_per_particle: float = 300.0
    replicas: int = 2
    seed: int = 1
    workers: int | None = None

    @property
    def fluids(self) -> list[Fluid]:
        """The gases to measure, by ascending packing fraction."""
        return [replace(self.fluid, packing_fraction=eta) for eta in self.packing_fractions]

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        for fluid in self.fluids:
            fluid.check_within("the theory of this study")
        second = round(self.fluid.fraction * self.fluid.n) if self.fluid.mixed else self.fluid.n
        if self.fluid.mixed and not 0 < second < self.fluid.n:
            raise hs.SceneError(
                f"--fraction {self.fluid.fraction:g} of {self.fluid.n} particles leaves one species; leave the ratios out, or "
                "ask for some of each"
            )
        fewest = FEWEST_FLIGHTS / (min(second, self.fluid.n - second) or self.fluid.n)
        check_length(self.collisions_per_particle, fewest, f"gives no error bar for {self.fluid.n} particles")


@dataclass(frozen=True)
class Curve:
    """Something measured at several places for one species, beside theory.

    Attributes
    ----------
    x : (p,) array
        Where.
    measured : list of Estimate
        One for each place.
    expected : (p,) array
        What theory says, exact for a dilute gas.
    """

    x: FloatArray
    measured: list[Estimate]
    expected: FloatArray


@dataclass(frozen=True)
class _Run:
    """What one replica of one gas hands back."""

    checks: list[TheoryCheck]
    curves: dict[str, list[Curve]]
    labels: list[str]
    flights: int
    notes: tuple[str, ...]
    times: float  # how many times longer it should have been, see `Notices`
    length: float  # collisions per particle
    failure: str | None
    status: dict[str, Any]
    seconds: float


def curves_of(paths: FreePath) -> dict[str, list[Curve]]:
    """Return survival of paths and times, and lambda(v) in mean free paths over v in thermal speeds, by species."""
    curves: dict[str, list[Curve]] = {"path": [], "time": [], "speed": []}
    at = np.array(SURVIVAL_AT)
    for species, mean in enumerate(paths.mean_free_path):
        law = paths.flights_in_theory(species)
        curves["path"].append(Curve(at, paths.survival(at, "path", species), law.path_survival(at).value))
        curves["time"].append(Curve(at, paths.survival(at, "time", species), law.time_survival(at).value))
        edges, measured = paths.path_at_speed(species)
        expected = np.array([law.path_at_speed(low, high) for low, high in itertools.pairwise(edges)])
        thermal = math.sqrt(
            paths.scene.temperature / float(paths.scene.masses[paths.scene.species == species][0])
        )
        curves["speed"].append(
            Curve(
                (edges[:-1] + edges[1:]) / 2 / thermal,
                [
                    replace(e, value=e.value / mean.value, standard_error=e.standard_error / mean.value)
                    for e in measured
                ],
                expected / law.mean_path,
            )
        )
    return curves


@dataclass
class _Measuring:
    """A replica on its way: after `done` blocks."""

    simulation: hs.Simulation
    paths: FreePath
    notices: Notices = field(default_factory=Notices)
    done: int = 0


@dataclass(frozen=True)
class Runs(Resumable[tuple[Fluid, np.random.SeedSequence], _Measuring, _Run]):
    """The task that turns a fluid and a seed into one measured replica.

    Attributes
    ----------
    collisions_per_particle : float
        How long to measure.
    """

    collisions_per_particle: float

    def begin(self, item: tuple[Fluid, np.random.SeedSequence]) -> _Measuring:
        """Make the gas."""
        fluid, seed = item
        simulation = hs.Simulation(fluid.scene(seed), free_paths=True)
        return _Measuring(simulation, FreePath(simulation.scene))

    def steps(self, item: tuple[Fluid, np.random.SeedSequence], state: _Measuring) -> Iterator[None]:
        """Let it settle, then measure block by block."""
        fluid = item[0]
        total = round(self.collisions_per_particle * fluid.n / 2)
        ends = fluid.settled + np.linspace(0, total, min(BLOCKS, total // 8) + 1).round().astype(int)

        def add(frame: hs.Frame) -> None:
            with state.notices.of("free paths"):
                state.paths.add(frame)

        return in_blocks(state, [int(end) for end in ends], add)

    def result(self, item: tuple[Fluid, np.random.SeedSequence], state: _Measuring, seconds: float) -> _Run:
        """Return what was measured."""
        paths, simulation, notices = state.paths, state.simulation, state.notices
        with notices.of("free paths"):
            checks = paths.checks
        with notices.of("distributions of free paths"):
            curves = curves_of(paths)
        return _Run(
            checks,
            curves,
            paths.labels,
            paths.flights,
            tuple(notices.notes),
            notices.times,
            self.collisions_per_particle,
            broken(simulation),
            simulation.status(),
            seconds,
        )


@dataclass(frozen=True)
class FreePathState:
    """One packing fraction, all replicas together.

    Attributes
    ----------
    fluid : Fluid
        The gas.
    checks : list of TheoryCheck
        Each measured number beside its theory.
    curves : dict of list of Curve
        Survival of free "path" and "time" in units of their means, mean path by "speed", for each species.
    labels : list of str
        What tells the species apart.
    flights : int
        How many flights were tallied.
    notes : tuple of str
        What the estimators had to say.
    failures : tuple of str
        What is wrong: broken conservation, deviations beyond 5 standard errors.
    """

    fluid: Fluid
    checks: list[TheoryCheck]
    curves: dict[str, list[Curve]]
    labels: list[str]
    flights: int
    notes: tuple[str, ...]
    failures: tuple[str, ...]

    def check(self, quantity: str) -> TheoryCheck:
        """Return the comparison of this name."""
        return next(check for check in self.checks if check.quantity == quantity)


def _pooled(curves: Sequence[Curve]) -> Curve:
    """Return one curve of all replicas, as far as each of them reaches."""
    first = max(float(curve.x[0]) for curve in curves) - 1e-6
    last = min(float(curve.x[-1]) for curve in curves) + 1e-6
    inside = [(curve.x >= first) & (curve.x <= last) for curve in curves]
    columns = [np.flatnonzero(chosen) for chosen in inside]
    measured = [
        pool_replicas([curve.measured[k[p]] for curve, k in zip(curves, columns, strict=True)])
        for p in range(min(map(len, columns)))
    ]
    return Curve(curves[0].x[columns[0]], measured, curves[0].expected[columns[0]])


def combine(fluid: Fluid, runs: Sequence[_Run]) -> FreePathState:
    """Return the replicas of one packing fraction as one state, with everything that is wrong with it."""
    notices = Notices(list(dict.fromkeys(note for run in runs for note in run.notes)))
    checks, failures = [], [run.failure for run in runs if run.failure]
    for k, check in enumerate(runs[0].checks):
        replicas = [run.checks[k].measured for run in runs]
        with notices.of(check.quantity):
            combine_replicas(replicas)
        pooled = replace(check, measured=pool_replicas(replicas))
        checks.append(pooled)
        if alarming(pooled.measured, pooled.expected, pooled.uncertainty):
            failures.append(
                f"{pooled.quantity} is {pooled.z:+.1f} standard errors from theory ({pooled.theory})"
            )
    curves = {
        name: [_pooled([run.curves[name][species] for run in runs]) for species in range(len(runs[0].labels))]
        for name in runs[0].curves
    }
    flights = sum(run.flights for run in runs)
    notes = (*notices.notes, *too_short(max(run.times for run in runs), runs[0].length))
    return FreePathState(fluid, checks, curves, runs[0].labels, flights, notes, tuple(failures))


def free_path(study: FreePaths, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : FreePaths
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
        Whether everything agrees with theory to 5 standard errors, and energy and momentum are conserved.

    Raises
    ------
    HardSpheresError
        If a gas cannot be made or never collides, or the folder cannot be written.
    """
    began = time.perf_counter()
    study.check()
    out.check(study)
    fluids = study.fluids
    with screen.compiling(study.fluid.kind):
        load_kernels(fluids, free_paths=True)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        runs = run_fluids(
            Runs(study.collisions_per_particle),
            fluids,
            seed=study.seed,
            replicas=study.replicas,
            workers=study.workers,
            screen=screen,
            shelf=shelf,
        )
        ran = time.perf_counter()
        states = [combine(fluid, own) for fluid, own in zip(fluids, runs, strict=True)]

        out.write_csv("free_path.csv", _numbers(states))
        out.write_csv("free_path_curves.csv", _curves(states))
        from studies.figures.free_path import figure

        with screen.working("drawing"):
            out.save_figure("free_path.png", figure(states), f"{study.replicas} x {study.fluid}")
        summary = _summary(study, states, [run for own in runs for run in own], out)
        summary["seconds"] = seconds_taken(began, ready, ran, work="runs")
        out.write_json("summary.json", summary)
    _print(screen, study, states, summary, out)
    return summary, bool(summary["checks"]["passed"])


def _numbers(states: Sequence[FreePathState]) -> dict[str, Any]:
    """Return the columns of free_path.csv: one row for each number."""
    rows = [(state.fluid.packing_fraction, check) for state in states for check in state.checks]
    return {
        "packing_fraction": [eta for eta, _ in rows],
        "quantity": [check.quantity for _, check in rows],
        "value": [check.measured.value for _, check in rows],
        "error": [check.measured.standard_error for _, check in rows],
        "degrees_of_freedom": [check.measured.degrees_of_freedom for _, check in rows],
        "theory": [check.theory for _, check in rows],
        "expected": [check.expected for _, check in rows],
        "uncertainty": [check.uncertainty for _, check in rows],
        "deviation": [check.z for _, check in rows],
    }


CURVE_NAMES = {
    "path": "part of free paths longer than x mean free paths",
    "time": "part of free times longer than x mean free times",
    "speed": "free path at x thermal speeds over mean free path",
}


def _curves(states: Sequence[FreePathState]) -> dict[str, Any]:
    """Return the columns of free_path_curves.csv: one row for each point of each curve."""
    rows = [
        (state.fluid.packing_fraction, CURVE_NAMES[name], species + 1, float(x), measured, float(expected))
        for state in states
        for name, curves in state.curves.items()
        for species, curve in enumerate(curves)
        for x, measured, expected in zip(curve.x, curve.measured, curve.expected, strict=True)
    ]
    return {
        "packing_fraction": [row[0] for row in rows],
        "curve": [row[1] for row in rows],
        "species": [row[2] for row in rows],
        "x": [row[3] for row in rows],
        "value": [row[4].value for row in rows],
        "error": [row[4].standard_error for row in rows],
        "expected": [row[5] for row in rows],
    }


def _summary(
    study: FreePaths, states: Sequence[FreePathState], runs: Sequence[_Run], out: OutputFolder
) -> dict[str, Any]:
    fluid, statuses = study.fluid, [run.status for run in runs]
    failures = [
        f"packing fraction {state.fluid.packing_fraction:g}: {failure}"
        for state in states
        for failure in state.failures
    ]
    collisions = sum(status["collisions"] for status in statuses)
    return {
        "study": "free-path",
        "version": hs.__version__,
        "seed": study.seed,
        "options": {
            "packing_fractions": study.packing_fractions,
            "n": fluid.n,
            "dim": fluid.dim,
            "diameter_ratio": fluid.diameter_ratio,
            "mass_ratio": fluid.mass_ratio,
            "fraction": fluid.fraction if fluid.mixed else None,
            "collisions_per_particle": study.collisions_per_particle,
            "replicas": study.replicas,
        },
        "workers": available_cores() if study.workers is None else study.workers,
        "n": fluid.n,
        "dim": fluid.dim,
        "species": states[0].labels,
        "states": [_state_summary(state) for state in states],
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / sum(run.seconds for run in runs),
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, failures) | {"alarm_in_standard_errors": ALARM},
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def _state_summary(state: FreePathState) -> dict[str, Any]:
    return {
        "packing_fraction": state.fluid.packing_fraction,
        "flights": state.flights,
        "measured": [
            {
                "quantity": check.quantity,
                **estimate_json(check.measured),
                "theory": check.theory,
                "expected": check.expected,
                "uncertainty": check.uncertainty,
                "deviation": check.z,
                "better_than_theory": check.better_than_theory,
            }
            for check in state.checks
        ],
        "notes": list(state.notes),
        "failures": list(state.failures),
    }


def _print(
    screen: Screen,
    study: FreePaths,
    states: Sequence[FreePathState],
    summary: dict[str, Any],
    out: OutputFolder,
) -> None:
    screen.say(f"{study.replicas} x {study.fluid}, {len(states)} packing fraction{'s' * (len(states) > 1)}")
    if study.fluid.mixed:
        screen.say("species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(states[0].labels, 1)))
    screen.say()
    rows, before = [], None
    for state in states:
        for check in state.checks:
            eta = f"{state.fluid.packing_fraction:.4g}"
            rows.append(
                [
                    eta if eta != before else "",
                    check.quantity,
                    str(check.measured),
                    str(Estimate(check.expected, check.uncertainty)),
                    f"{check.z:+.1f}" if math.isfinite(check.z) else "",
                    "u" if check.better_than_theory else "",
                ]
            )
            before = eta
    screen.table("", ["packing fraction", "quantity", "measured", "theory", "z", ""], rows, keys=2)
    screen.say()
    screen.say(
        f"means and rates: Enskog for {study.fluid.n} particles at fixed energy and momentum; Z: "
        f"{states[0].checks[-1].theory}; uncertainty in parentheses"
    )
    if study.fluid.n > 2:
        screen.say(
            "<l^k>, <t^k> of all flights, counted exactly: Boltzmann, whose uncertainty, k - 1 times the packing fraction, is "
            "what meeting the same neighbours again may change in a denser gas"
        )
    screen.say(Z_MEANS)
    if any(check.better_than_theory for state in states for check in state.checks):
        screen.say(
            "u: the measurement is better than the theory, whose uncertainty exceeds two standard errors"
        )
    for state in states:
        for note in state.notes:
            screen.say(f"packing fraction {state.fluid.packing_fraction:g}: {note}")
    say_checks(screen, summary, out)
