"""Self-diffusion: mean square displacement, velocity autocorrelation and D, beside Enskog's theory."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.series import SeriesWarning
from analysis.statistics import Estimate, TheoryCheck, estimate_from_replicas, replica_mean
from analysis.theory import Prediction
from analysis.transport import Diffusion
from studies.ensemble import available_cores
from studies.fluid import Fluid, broken, check_length, load_kernels, ordered, run_fluids
from studies.report import (
    ALARM,
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
from studies.resuming import Resumable, until

__all__ = ["DiffusionState", "SelfDiffusion", "Walks", "self_diffusion"]

FloatArray = NDArray[np.float64]

SPACING = 0.25  # of the moments that are compared, in mean free times
WINDOW = (20.0, 40.0)  # lags between which the slope is taken, in mean free times
POINTS = 16  # snapshots per level of `Diffusion`
SHORTEST = 80.0  # collisions per particle: twice the longest lag


@dataclass(frozen=True)
class SelfDiffusion:
    """Options of the study, as on the command line (`hardspheres diffusion --help`).

    Attributes
    ----------
    packing_fractions : tuple of float
        Where to measure, ascending.
    fluid : Fluid
        The gas, but for its packing fraction: one species in a periodic box.
    collisions_per_particle : float
        How long to measure in each replica.
    replicas, seed, workers
        As in `studies.ensemble`; errors come from the spread of the replicas.
    """

    packing_fractions: tuple[float, ...] = (0.1, 0.3)
    fluid: Fluid = field(default_factory=lambda: Fluid(n=1000))
    collisions_per_particle: float = 200.0
    replicas: int = 12
    seed: int = 1
    workers: int | None = None

    @property
    def fluids(self) -> list[Fluid]:
        """The gases to measure, by ascending packing fraction."""
        return [replace(self.fluid, packing_fraction=eta) for eta in self.packing_fractions]

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        for fluid in self.fluids:
            fluid.check_within("Enskog's theory")
        if self.fluid.n < 2:
            raise hs.SceneError(f"--n {self.fluid.n} cannot diffuse among others; ask for at least 2")
        check_length(
            self.collisions_per_particle,
            SHORTEST,
            f"is no length for a slope between {WINDOW[0]:g} and {WINDOW[1]:g} mean free times",
        )
        if self.replicas < 4:
            raise hs.SceneError(
                f"--replicas {self.replicas} gives no error bar, which comes from their spread; ask for at "
                "least 4"
            )


@dataclass(frozen=True)
class _Walk:
    """What one replica of one state hands back."""

    lags: FloatArray
    mean_square_displacement: FloatArray
    velocity_autocorrelation: FloatArray
    diffusion: float
    correction: Prediction | None
    ordered: bool
    failure: str | None
    status: dict[str, Any]
    seconds: float


def _mean_free_time(fluid: Fluid) -> float:
    return 1.0 / float(theory.collision_rate(fluid.packing_fraction, fluid.dim))


@dataclass
class _Walking:
    """A replica on its way: `diffusion` has seen `done` moments."""

    simulation: hs.Simulation
    diffusion: Diffusion
    done: int = 0


@dataclass(frozen=True)
class Walks(Resumable[tuple[Fluid, np.random.SeedSequence], _Walking, _Walk]):
    """The task that turns a fluid and a seed into one measured replica.

    Attributes
    ----------
    collisions_per_particle : float
        How long to measure.
    """

    collisions_per_particle: float

    def begin(self, item: tuple[Fluid, np.random.SeedSequence]) -> _Walking:
        """Make the gas."""
        fluid, seed = item
        return _Walking(hs.Simulation(fluid.scene(seed)), Diffusion(POINTS))

    def steps(self, item: tuple[Fluid, np.random.SeedSequence], state: _Walking) -> Iterator[None]:
        """Let it settle, then look at it at equally spaced times."""
        fluid, simulation = item[0], state.simulation
        yield from until(simulation, fluid.settled)
        for moment in range(state.done, math.ceil(self.collisions_per_particle / SPACING) + 1):
            if moment > 0:
                simulation.run(time=SPACING * _mean_free_time(fluid))
            state.diffusion.add(simulation)
            state.done += 1
            yield

    def result(self, item: tuple[Fluid, np.random.SeedSequence], state: _Walking, seconds: float) -> _Walk:
        """Return what was measured."""
        fluid, simulation, diffusion = item[0], state.simulation, state.diffusion
        mean_free_time = _mean_free_time(fluid)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)  # the error comes from the replicas
            slope = diffusion.diffusion((WINDOW[0] * mean_free_time, WINDOW[1] * mean_free_time)).value
        return _Walk(
            diffusion.lags,
            diffusion.mean_square_displacement,
            diffusion.velocity_autocorrelation,
            slope,
            diffusion.periodic_correction if fluid.dim == 3 else None,
            ordered(simulation),
            broken(simulation),
            simulation.status(),
            seconds,
        )


@dataclass(frozen=True)
class DiffusionState:
    """One packing fraction, all replicas together.

    Attributes
    ----------
    fluid : Fluid
        The gas.
    lags : (L,) array
        Times between two moments, ascending.
    mean_square_displacement, mean_square_displacement_error : (L,) arrays
        With standard errors from the replicas.
    velocity_autocorrelation, velocity_autocorrelation_error : (L,) arrays
        <v(0).v(t)>/<v^2>.
    here : Estimate
        D of this box.
    correction : Prediction or None
        What the periodic box takes from D; None in 2D, where D has no limit.
    enskog : Prediction
        Enskog's D of the infinite fluid.
    failures : tuple of str
        What is wrong with the state.
    """

    fluid: Fluid
    lags: FloatArray
    mean_square_displacement: FloatArray
    mean_square_displacement_error: FloatArray
    velocity_autocorrelation: FloatArray
    velocity_autocorrelation_error: FloatArray
    here: Estimate
    correction: Prediction | None
    enskog: Prediction
    failures: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Collisions per particle and time, in theory."""
        return float(theory.collision_rate(self.fluid.packing_fraction, self.fluid.dim))

    @property
    def infinite(self) -> Estimate | None:
        """D of the infinite fluid, in 3D: the doubt of the correction is not in the standard error."""
        if self.correction is None:
            return None
        return replace(self.here, value=self.here.value + float(self.correction.value))

    @property
    def check(self) -> TheoryCheck:
        """D (infinite in 3D, of this box in 2D) beside Enskog's, the uncertainties of all theory included."""
        doubt = 0.0 if self.correction is None else float(self.correction.uncertainty)
        doubt = math.hypot(float(self.enskog.uncertainty), doubt)
        return TheoryCheck("D", "Enskog", self.infinite or self.here, float(self.enskog.value), doubt)

    @property
    def deviation(self) -> float:
        """Deviation of `check` in combined standard errors."""
        return self.check.z


def combine(fluid: Fluid, walks: Sequence[_Walk]) -> DiffusionState:
    """Return the replicas of one packing fraction as one state, with everything that is wrong with it."""
    squares = np.array([walk.mean_square_displacement for walk in walks])
    products = np.array([walk.velocity_autocorrelation for walk in walks])
    state = DiffusionState(
        fluid,
        walks[0].lags,
        *replica_mean(squares),
        *replica_mean(products),
        estimate_from_replicas([walk.diffusion for walk in walks]),
        walks[0].correction,
        theory.enskog_diffusion(fluid.packing_fraction, fluid.dim),
        (),
    )
    failures = [walk.failure for walk in walks if walk.failure]
    if any(walk.ordered for walk in walks):
        failures.append("the particles have ordered: this is no fluid")
    if alarming(state.check.measured, state.check.expected, state.check.uncertainty):
        failures.append(f"D is {state.deviation:+.1f} standard errors from Enskog's theory")
    return replace(state, failures=tuple(failures))


def self_diffusion(study: SelfDiffusion, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : SelfDiffusion
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
        Whether every state is a fluid whose D agrees with theory to 5 standard errors, and conserves energy
        and momentum.

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
        load_kernels(fluids)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        walks = run_fluids(
            Walks(study.collisions_per_particle),
            fluids,
            seed=study.seed,
            replicas=study.replicas,
            workers=study.workers,
            screen=screen,
            shelf=shelf,
        )
        ran = time.perf_counter()
        states = [combine(fluid, own) for fluid, own in zip(fluids, walks, strict=True)]

        out.write_csv("diffusion.csv", _columns(states))
        out.write_csv("correlations.csv", _correlations(states))
        from studies.diffusion_figure import figure

        with screen.working("drawing"):
            out.save_figure("diffusion.png", figure(states), f"{study.replicas} x {study.fluid}")
        summary = _summary(study, states, [walk for own in walks for walk in own], out)
        summary["seconds"] = seconds_taken(began, ready, ran, work="runs")
        out.write_json("summary.json", summary)
    _print(screen, study, states, summary, out)
    return summary, bool(summary["checks"]["passed"])


def _columns(states: Sequence[DiffusionState]) -> dict[str, Any]:
    """Return the columns of diffusion.csv."""
    infinite = [state.infinite or Estimate(math.nan, math.nan) for state in states]
    corrections = [state.correction or Prediction(math.nan, math.nan) for state in states]
    return {
        "packing_fraction": [state.fluid.packing_fraction for state in states],
        "d_box": [state.here.value for state in states],
        "d_box_error": [state.here.standard_error for state in states],
        "correction": [float(correction.value) for correction in corrections],
        "correction_error": [float(correction.uncertainty) for correction in corrections],
        "d_infinite": [estimate.value for estimate in infinite],
        "d_infinite_error": [estimate.standard_error for estimate in infinite],
        "d_enskog": [float(state.enskog.value) for state in states],
        "d_enskog_error": [float(state.enskog.uncertainty) for state in states],
        "deviation": [state.deviation for state in states],
    }


def _correlations(states: Sequence[DiffusionState]) -> dict[str, FloatArray]:
    """Return the columns of correlations.csv, one state after another."""

    def joined(parts: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate(parts)

    return {
        "packing_fraction": joined([np.full(len(s.lags), s.fluid.packing_fraction) for s in states]),
        "time": joined([s.lags for s in states]),
        "mean_free_times": joined([s.lags * s.rate for s in states]),
        "mean_square_displacement": joined([s.mean_square_displacement for s in states]),
        "mean_square_displacement_error": joined([s.mean_square_displacement_error for s in states]),
        "velocity_autocorrelation": joined([s.velocity_autocorrelation for s in states]),
        "velocity_autocorrelation_error": joined([s.velocity_autocorrelation_error for s in states]),
        "velocity_autocorrelation_enskog": joined(
            [np.exp(-2 / s.fluid.dim * s.rate * s.lags) for s in states]
        ),
    }


def _summary(
    study: SelfDiffusion, states: Sequence[DiffusionState], walks: Sequence[_Walk], out: OutputFolder
) -> dict[str, Any]:
    fluid, statuses = study.fluid, [walk.status for walk in walks]
    failures = [
        f"packing fraction {state.fluid.packing_fraction:g}: {failure}"
        for state in states
        for failure in state.failures
    ]
    collisions = sum(status["collisions"] for status in statuses)
    return {
        "study": "diffusion",
        "version": hs.__version__,
        "seed": study.seed,
        "options": {
            "packing_fractions": study.packing_fractions,
            "n": fluid.n,
            "dim": fluid.dim,
            "collisions_per_particle": study.collisions_per_particle,
            "replicas": study.replicas,
        },
        "workers": available_cores() if study.workers is None else study.workers,
        "n": fluid.n,
        "dim": fluid.dim,
        "window_in_mean_free_times": WINDOW,
        "states": [_state_summary(state) for state in states],
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / sum(walk.seconds for walk in walks),
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, failures) | {"alarm_in_standard_errors": ALARM},
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def _state_summary(state: DiffusionState) -> dict[str, Any]:
    correction, infinite = state.correction, state.infinite
    return {
        "packing_fraction": state.fluid.packing_fraction,
        "discarded_collisions_per_particle": state.fluid.discarded,
        "d_box": estimate_json(state.here),
        "correction": None
        if correction is None
        else {"value": float(correction.value), "uncertainty": float(correction.uncertainty)},
        "d_infinite": None if infinite is None else estimate_json(infinite),
        "enskog": {"value": float(state.enskog.value), "uncertainty": float(state.enskog.uncertainty)},
        "deviation": state.deviation,
        "failures": list(state.failures),
    }


def _print(
    screen: Screen,
    study: SelfDiffusion,
    states: Sequence[DiffusionState],
    summary: dict[str, Any],
    out: OutputFolder,
) -> None:
    screen.say(f"{study.replicas} x {study.fluid}, kT = 1")
    screen.say()
    three = study.fluid.dim == 3
    header = ["packing fraction", "discarded", "D in this box"]
    header += ["correction", "D infinite"] if three else []
    header += ["Enskog", "z", "D / Enskog"]
    rows = []
    for state in states:
        row = [f"{state.fluid.packing_fraction:.4g}", f"{state.fluid.discarded:.0f}", str(state.here)]
        measured, enskog = state.infinite or state.here, state.enskog
        if state.correction is not None:
            row.append(str(Estimate(float(state.correction.value), float(state.correction.uncertainty))))
            row.append(str(measured))
        row.append(str(Estimate(float(enskog.value), float(enskog.uncertainty))))
        ratio = Estimate(measured.value / float(enskog.value), measured.standard_error / float(enskog.value))
        rows.append([*row, f"{state.deviation:+.1f}", str(ratio)])
    screen.table("", header, rows)
    screen.say()
    screen.say(
        f"D from the slope of the mean square displacement between {WINDOW[0]:g} and {WINDOW[1]:g} mean "
        "free times; "
        "errors from the spread of the replicas"
    )
    if three:
        screen.say(
            "correction: of the periodic box (Yeh and Hummer 2004) with Enskog's viscosity; D infinite has it"
        )
    else:
        screen.say("in 2D diffusion has no infinite limit: D grows as the logarithm of the box")
    screen.say(
        "Enskog's theory leaves out correlated collisions: its uncertainty is what it is known to miss; z: "
        "deviation "
        "in standard errors, uncertainties of theory included"
    )
    say_checks(screen, summary, out)
