"""The equation of state: pressure at several packing fractions, in up to three ways, beside theory."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.correlation_times import variance_growth, virial_block_length
from analysis.pressure import Pressure
from analysis.statistics import Estimate, combine_replicas, pool_replicas
from analysis.theory import Prediction
from studies.fluid import THEORY_UP_TO, Fluid, broken, check_length, load_kernels, ordered, run_fluids
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

__all__ = ["EquationOfState", "State", "States", "equation_of_state", "packing_fractions"]

BLOCKS = 128  # of each run; they are joined as their correlation demands
LENGTH = 300.0  # collisions per particle, where nothing else is asked for
MEMORIES = 10.0  # how many times as long as what the fluid remembers a run is at least
SHORTEST = 40.0  # collisions per particle, however low the precision
NOISE = 1.25  # relative standard error of Z - 1 times the root of the number of collisions
FEWEST_COLLISIONS = 16 * 8  # of a run: 16 blocks of 8
UNKNOWN = Estimate(math.nan, math.nan)


@dataclass(frozen=True)
class EquationOfState:
    """Options of the study, as on the command line (`hardspheres pressure --help`).

    Attributes
    ----------
    packing_fractions : tuple of float
        Where to measure, ascending.
    fluid : Fluid
        The gas, but for its packing fraction.
    collisions_per_particle : float, optional
        How long to measure in each replica; by default 300, or more where a dense fluid remembers long
        (`analysis.correlation_times`).
    replicas, seed, workers
        As in `studies.running.ensemble`.
    precision : float, optional
        Measure as long as this relative standard error of Z takes, all replicas together.
    """

    packing_fractions: tuple[float, ...] = tuple(np.linspace(0.01, 0.49, 9).tolist())
    fluid: Fluid = field(default_factory=Fluid)
    collisions_per_particle: float | None = None
    replicas: int = 2
    seed: int = 1
    workers: int | None = None
    precision: float | None = None

    @property
    def fluids(self) -> list[Fluid]:
        """The gases to measure, by ascending packing fraction."""
        return [replace(self.fluid, packing_fraction=eta) for eta in self.packing_fractions]

    def length(self, fluid: Fluid) -> float:
        """Return how long to measure each replica of a fluid, in collisions per particle."""
        if self.collisions_per_particle is not None:
            return self.collisions_per_particle
        eta, dim = fluid.packing_fraction, fluid.dim
        shortest = max(MEMORIES * virial_block_length(eta, dim), 2 * FEWEST_COLLISIONS / fluid.n)
        if self.precision is None:
            return max(LENGTH, shortest)
        z = float(theory.compressibility_factor(min(eta, THEORY_UP_TO[dim]), dim).value)
        collisions = variance_growth(eta, dim) * (NOISE * (1.0 - 1.0 / z) / self.precision) ** 2
        return max(2.0 * collisions / (fluid.n * self.replicas), shortest, SHORTEST)

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        for fluid in self.fluids:
            fluid.check()
        if self.precision is not None:
            if self.collisions_per_particle is not None:
                raise hs.SceneError("--until-error and --collisions-per-particle both say how long; give one")
            if not 1e-6 <= self.precision <= 0.1:
                raise hs.SceneError(f"--until-error {self.precision:g}; expected 1e-6 to 0.1")
        fewest = 2 * FEWEST_COLLISIONS / self.fluid.n
        if self.collisions_per_particle is None:
            return
        check_length(self.collisions_per_particle, fewest, f"gives no error bar for {self.fluid.n} particles")


MOST = 10_000  # packing fractions


def packing_fractions(text: str) -> tuple[float, ...]:
    """Return the packing fractions that a text names.

    Parameters
    ----------
    text : str
        Numbers with commas between them, or first:last:count for evenly spaced ones.

    Returns
    -------
    tuple of float
        Ascending, each once.

    Raises
    ------
    SceneError
        If the text is neither, or a number is not between 0 and 1.
    """
    try:
        if ":" in text:
            first, last, count = text.split(":")
            with np.errstate(invalid="ignore"):
                points = np.linspace(float(first), float(last), min(int(count), MOST + 1))
            values = [float(f"{value:.12g}") for value in points]
        else:
            values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values:
        raise hs.SceneError(
            f"--packing-fraction {text} is not understood; give first:last:count, as in 0.01:0.49:9, or "
            "numbers with commas between them"
        )
    if len(values) > MOST:
        raise hs.SceneError(f"--packing-fraction {text} are too many; ask for at most {MOST}")
    for value in values:
        if not 0.0 < value < 1.0:
            raise hs.SceneError(f"--packing-fraction {text} has {value:g}; expected numbers between 0 and 1")
    return tuple(sorted(set(values)))


@dataclass(frozen=True)
class _Run:
    """What one replica of one state hands back."""

    measured: dict[str, Estimate]
    difference: Estimate
    theories: dict[str, Prediction]
    discarded: float
    order: float
    ordered: bool
    notes: tuple[str, ...]
    times: float  # how many times longer it should have been, see `Notices`
    length: float  # collisions per particle
    failure: str | None
    status: dict[str, Any]
    seconds: float


@dataclass
class _Measuring:
    """A replica on its way: after `done` blocks."""

    simulation: hs.Simulation
    pressure: Pressure
    done: int = 0


@dataclass(frozen=True)
class States(Resumable[tuple[Fluid, np.random.SeedSequence], _Measuring, _Run]):
    """The task that turns a fluid and a seed into one measured replica.

    Attributes
    ----------
    study : EquationOfState
        Says how long to measure.
    """

    study: EquationOfState

    def _ends(self, fluid: Fluid) -> list[int]:
        """Return after how many collisions the blocks begin and end."""
        total = round(self.study.length(fluid) * fluid.n / 2)
        blocks = min(BLOCKS, total // 8)
        ends = fluid.settled + np.linspace(0, total, blocks + 1).round().astype(int)
        return [int(end) for end in ends]

    def begin(self, item: tuple[Fluid, np.random.SeedSequence]) -> _Measuring:
        """Make the gas; flights of a mixture are tallied for its rates of unlike pairs."""
        fluid, seed = item
        simulation = hs.Simulation(fluid.scene(seed), free_paths=fluid.mixed)
        return _Measuring(simulation, Pressure(simulation.scene, discard=True))

    def steps(self, item: tuple[Fluid, np.random.SeedSequence], state: _Measuring) -> Iterator[None]:
        """Let it settle, then measure block by block."""
        return in_blocks(state, self._ends(item[0]), state.pressure.add)

    def result(self, item: tuple[Fluid, np.random.SeedSequence], state: _Measuring, seconds: float) -> _Run:
        """Return what was measured."""
        fluid, simulation, pressure = item[0], state.simulation, state.pressure
        notices, measured = Notices(), {}
        for name in ("virial", "rate") if fluid.periodic else ("virial", "rate", "walls"):
            with notices.of(f"Z, {name}"):
                measured[name] = getattr(pressure, name)
        with notices.of("virial - rate"):
            difference = pressure.virial_minus_rate
        known = fluid.packing_fraction <= THEORY_UP_TO[fluid.dim]
        start, *ends = self._ends(fluid)
        dropped = pressure.discarded_rows * (ends[-1] - start) / len(ends)
        return _Run(
            measured,
            difference,
            pressure.predictions if known else {},
            2.0 * (fluid.settled + dropped) / fluid.n,
            hs.bond_order(simulation.to_scene()).value,
            ordered(simulation),
            tuple(notices.notes),
            notices.times,
            self.study.length(fluid),
            broken(simulation),
            simulation.status(),
            seconds,
        )


@dataclass(frozen=True)
class State:
    """One packing fraction, all replicas together.

    Attributes
    ----------
    fluid : Fluid
        The gas.
    measured : dict of Estimate
        Z from the "virial", the "rate" of collisions and the "walls" (where there are some).
    difference : Estimate
        Z from the virial less that from the rate, taken block by block: 0 whatever theory says of Z.
    theories : dict of Prediction
        Z by name, the best one first; empty where none holds.
    discarded : float
        Collisions per particle thrown away, mean over replicas.
    order : float
        Largest bond order at the end, Q6 or psi6.
    notes : tuple of str
        What the estimators had to say.
    failures : tuple of str
        What is wrong with the state: broken conservation, order, deviations beyond 5 standard errors.
    collisions : int
        Of all replicas, what was discarded included.
    """

    fluid: Fluid
    measured: dict[str, Estimate]
    difference: Estimate
    theories: dict[str, Prediction]
    discarded: float
    order: float
    notes: tuple[str, ...]
    failures: tuple[str, ...]
    collisions: int = 0

    @property
    def best(self) -> Prediction:
        """The best theory, NaN where there is none."""
        return next(iter(self.theories.values()), Prediction(math.nan, math.nan))

    def deviation(self, name: str) -> float:
        """Return how far a measurement is from the best theory, as a normal deviate (`Estimate.z`)."""
        return self.measured[name].z(float(self.best.value), float(self.best.uncertainty))

    @property
    def better_than_theory(self) -> bool:
        """Whether the theory's uncertainty is more than two standard errors of the virial's Z."""
        return bool(self.best.uncertainty > 2.0 * self.measured["virial"].standard_error)


def combine(fluid: Fluid, runs: Sequence[_Run]) -> State:
    """Return the replicas of one packing fraction as one state, with everything that is wrong with it."""
    notices = Notices(list(dict.fromkeys(note for run in runs for note in run.notes)))
    measured = {}
    for name in runs[0].measured:
        replicas = [run.measured[name] for run in runs]
        measured[name] = pool_replicas(replicas)
        with notices.of(f"Z, {name}"):
            combine_replicas(replicas)
    state = State(
        fluid,
        measured,
        pool_replicas([run.difference for run in runs]),
        runs[0].theories,
        float(np.mean([run.discarded for run in runs])),
        max(run.order for run in runs),
        (*notices.notes, *too_short(max(run.times for run in runs), runs[0].length)),
        (),
        sum(run.status["collisions"] for run in runs),
    )
    failures = [run.failure for run in runs if run.failure]
    if any(run.ordered for run in runs):
        failures.append(f"the particles have ordered, bond order {state.order:.2f}: this is no fluid")
    failures += _deviations(state)
    return replace(state, failures=tuple(failures))


def _deviations(state: State) -> list[str]:
    """Return one sentence for each pair of numbers that do not agree."""
    best, virial, sentences = state.best, state.measured["virial"], []
    for name, z in state.measured.items():
        if alarming(z, float(best.value), float(best.uncertainty)):
            theory = next(iter(state.theories))
            sentences.append(
                f"Z from the {name} is {state.deviation(name):+.1f} standard errors from {theory}"
            )
        if name == "walls" and alarming(z, virial.value, virial.standard_error):
            deviation = z.z(virial.value, virial.standard_error)
            sentences.append(f"Z from the {name} is {deviation:+.1f} standard errors from that of the virial")
    if alarming(state.difference, 0.0, 0.0):
        deviation = -state.difference.z(0.0)
        sentences.append(f"Z from the rate is {deviation:+.1f} standard errors from that of the virial")
    return sentences


def equation_of_state(
    study: EquationOfState, out: OutputFolder, screen: Screen
) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : EquationOfState
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
        Whether every state is a fluid that agrees with theory to 5 standard errors, and conserves energy and
        momentum.

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
        load_kernels(fluids, free_paths=study.fluid.mixed)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        runs = run_fluids(
            States(study),
            fluids,
            seed=study.seed,
            replicas=study.replicas,
            workers=study.workers,
            screen=screen,
            shelf=shelf,
        )
        ran = time.perf_counter()
        states = [combine(fluid, own) for fluid, own in zip(fluids, runs, strict=True)]

        out.write_csv("equation_of_state.csv", columns(states))
        from studies.figures.pressure import figure

        with screen.working("drawing"):
            out.save_figure("equation_of_state.png", figure(states), f"{study.replicas} x {study.fluid}")
        summary = _summary(study, states, [run for own in runs for run in own], out)
        summary["seconds"] = seconds_taken(began, ready, ran, work="runs")
        out.write_json("summary.json", summary)
    _print(screen, study, states, summary, out)
    return summary, bool(summary["checks"]["passed"])


def columns(states: Sequence[State]) -> dict[str, Any]:
    """Return the columns of equation_of_state.csv; NaN where there is no such measurement or theory."""
    fluids = [state.fluid for state in states]
    table: dict[str, Any] = {
        "packing_fraction": [fluid.packing_fraction for fluid in fluids],
        "dim": [fluid.dim for fluid in fluids],
        "particles": [fluid.n for fluid in fluids],
    }
    if any(fluid.mixed for fluid in fluids):
        for name in ("diameter_ratio", "mass_ratio", "fraction"):
            table[name] = [getattr(fluid, name) for fluid in fluids]
    table |= {
        "collisions": [state.collisions for state in states],
        "discarded_collisions_per_particle": [state.discarded for state in states],
        "bond_order": [state.order for state in states],
    }
    for name in dict.fromkeys(name for state in states for name in state.measured):
        known = [state.measured.get(name, UNKNOWN) for state in states]
        table[f"z_{name}"] = [z.value for z in known]
        table[f"z_{name}_error"] = [z.standard_error for z in known]
        table[f"z_{name}_degrees_of_freedom"] = [z.degrees_of_freedom for z in known]
        table[f"z_{name}_deviation"] = [
            state.deviation(name) if name in state.measured else math.nan for state in states
        ]
    differences = [state.difference for state in states]
    table["z_virial_minus_rate"] = [z.value for z in differences]
    table["z_virial_minus_rate_error"] = [z.standard_error for z in differences]
    table["z_virial_minus_rate_degrees_of_freedom"] = [z.degrees_of_freedom for z in differences]
    table["z_virial_minus_rate_deviation"] = [z.z(0.0) for z in differences]
    table["theory"] = [next(iter(state.theories), "") for state in states]
    table["z_theory"] = [float(state.best.value) for state in states]
    table["z_theory_error"] = [float(state.best.uncertainty) for state in states]
    others = dict.fromkeys(name for state in states for name in list(state.theories)[1:])
    nothing = Prediction(math.nan, math.nan)
    for name in others:
        predictions = [state.theories.get(name, nothing) for state in states]
        table[_slug(name)] = [float(p.value) for p in predictions]
        table[f"{_slug(name)}_error"] = [float(p.uncertainty) for p in predictions]
    return table


def _slug(name: str) -> str:
    return name.lower().replace(" ", "_").replace("-", "_")


def _summary(
    study: EquationOfState, states: Sequence[State], runs: Sequence[_Run], out: OutputFolder
) -> dict[str, Any]:
    fluid, statuses = study.fluid, [run.status for run in runs]
    failures = [
        f"packing fraction {state.fluid.packing_fraction:g}: {failure}"
        for state in states
        for failure in state.failures
    ]
    collisions = sum(status["collisions"] for status in statuses)
    return {
        "study": "pressure",
        "version": hs.__version__,
        "seed": study.seed,
        "options": {
            "packing_fractions": study.packing_fractions,
            "n": fluid.n,
            "dim": fluid.dim,
            "boundary": fluid.boundary,
            "diameter_ratio": fluid.diameter_ratio,
            "mass_ratio": fluid.mass_ratio,
            "fraction": fluid.fraction if fluid.mixed else None,
            "collisions_per_particle": study.collisions_per_particle,
            "precision": study.precision,
            "replicas": study.replicas,
        },
        "workers": available_cores() if study.workers is None else study.workers,
        "n": fluid.n,
        "dim": fluid.dim,
        "states": [state_summary(state) for state in states],
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / sum(run.seconds for run in runs),
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, failures) | {"alarm_in_standard_errors": ALARM},
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def state_summary(state: State) -> dict[str, Any]:
    """Return what a summary tells of one state."""
    return {
        "packing_fraction": state.fluid.packing_fraction,
        "start": "compressed" if state.fluid.dense else "random",
        "collisions": state.collisions,
        "discarded_collisions_per_particle": state.discarded,
        "bond_order": state.order,
        "measured": {
            name: estimate_json(z) | {"deviation": state.deviation(name)}
            for name, z in state.measured.items()
        },
        "virial_minus_rate": estimate_json(state.difference) | {"deviation": state.difference.z(0.0)},
        "theories": {
            name: {"value": float(p.value), "uncertainty": float(p.uncertainty)}
            for name, p in state.theories.items()
        },
        "better_than_theory": state.better_than_theory,
        "notes": list(state.notes),
        "failures": list(state.failures),
    }


def _print(
    screen: Screen,
    study: EquationOfState,
    states: Sequence[State],
    summary: dict[str, Any],
    out: OutputFolder,
) -> None:
    print_states(
        screen,
        f"{study.replicas} x {study.fluid}, {len(states)} packing fraction{'s' * (len(states) > 1)}",
        states,
    )
    say_notes(screen, states)
    say_checks(screen, summary, out)


def print_states(screen: Screen, title: str, states: Sequence[State]) -> None:
    """Print a title and the table of some states of one kind of fluid."""
    screen.say(title)
    screen.say()
    names = list(states[0].measured)
    order = "Q6" if states[0].fluid.dim == 3 else "psi6"
    header = ["packing fraction", "discarded", order]
    for name in names:
        header += [f"Z, {name}", "z"]
    header += ["virial - rate", "z", "theory", ""]
    rows = []
    for state in states:
        row = [f"{state.fluid.packing_fraction:.4g}", f"{state.discarded:.0f}", f"{state.order:.3f}"]
        for name in names:
            deviation = state.deviation(name)
            row += [str(state.measured[name]), f"{deviation:+.1f}" if math.isfinite(deviation) else ""]
        row += [str(state.difference), f"{state.difference.z(0.0):+.1f}"]
        best = state.best
        row.append(str(Estimate(float(best.value), float(best.uncertainty))) if state.theories else "")
        rows.append([*row, "u" if state.better_than_theory else ""])
    screen.table("", header, rows)
    screen.say()


def say_notes(screen: Screen, states: Sequence[State]) -> None:
    """Print what the columns of the tables mean and what the estimators had to say."""
    fluids = [state.fluid for state in states]
    named = dict.fromkeys(next(iter(state.theories)) for state in states if state.theories)
    if named:
        sizes = {fluid.n for fluid in fluids if fluid.periodic}
        finite = f" with the finite-size correction for {min(sizes)} particles" if sizes else ""
        screen.say(f"theory: {', '.join(named)}{finite}; its uncertainty in parentheses")
    screen.say(f"{Z_MEANS}; virial - rate: of blocks of the same collisions, expected 0")
    if any(state.better_than_theory for state in states):
        screen.say(
            "u: the measurement is better than the theory, whose uncertainty exceeds two standard errors"
        )
    placed = ["placed at random"] * any(not fluid.dense for fluid in fluids)
    grown = ["grown to their size"] * any(fluid.dense for fluid in fluids)
    screen.say(
        f"start: {' or '.join([*placed, *grown])}; discarded: collisions per particle before the "
        "measurement, with what the rule of Chodera 2016 drops from its start"
    )
    for state in states:
        for note in state.notes:
            screen.say(f"packing fraction {state.fluid.packing_fraction:g}: {note}")
