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
from analysis.transport import Diffusion, with_correction
from studies.fluid import Fluid, broken, check_length, load_kernels, ordered, run_fluids
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
from studies.running.resuming import Resumable, until

__all__ = ["DiffusionState", "SelfDiffusion", "Slope", "Walks", "self_diffusion"]

FloatArray = NDArray[np.float64]

SPACING = 0.25  # of the sampled times, in mean free times
POINTS = 16  # snapshots per level of `Diffusion`
# collisions per particle with this spacing, then for the slope alone; fewer where there are more particles
DENSE, FEWEST_DENSE, DENSE_PARTICLES = 100.0, 30.0, 4000
SLOPE_POINTS = 12  # snapshots for the slope: its window ends at the last
DISCS = (20.0, 40.0)  # lags between which the slope is taken in 2D, in mean free times
SHORTEST = 80.0  # collisions per particle
USUAL, LONGEST_BY_DEFAULT = 200.0, 2000.0  # collisions per particle where none are asked for


@dataclass(frozen=True)
class SelfDiffusion:
    """Options of the study, as on the command line (`hardspheres diffusion --help`).

    Attributes
    ----------
    packing_fractions : tuple of float
        Where to measure, ascending.
    fluid : Fluid
        The gas, but for its packing fraction: one species in a periodic box.
    collisions_per_particle : float, optional
        How long to measure in each replica; by default as `Slope.of` has it.
    replicas, seed, workers
        As in `studies.running.ensemble`; errors come from the spread of the replicas.
    """

    packing_fractions: tuple[float, ...] = (0.1, 0.3)
    fluid: Fluid = field(default_factory=lambda: Fluid(n=1000))
    collisions_per_particle: float | None = None
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
        if self.collisions_per_particle is not None:
            check_length(self.collisions_per_particle, SHORTEST, "is no length for a slope")
        if self.replicas < 4:
            raise hs.SceneError(
                f"--replicas {self.replicas} gives no error bar, which comes from their spread; ask for at "
                "least 4"
            )


@dataclass(frozen=True)
class Slope:
    """Window of the slope of the mean square displacement, and length of the run, in mean free times.

    Attributes
    ----------
    needed : (float, float)
        The window for D of the box: `theory.periodic_diffusion_window`, 20 to 40 in 2D.
    length : float
        Of the measurement.
    dense : float
        Part of it in which samples are SPACING apart, for the curves.
    """

    needed: tuple[float, float]
    length: float
    dense: float = DENSE

    @classmethod
    def of(cls, fluid: Fluid, length: float | None) -> Slope:
        """Return the slope for a fluid: by default a run of three windows, at least 200 and at most 2000."""
        needed = DISCS
        if fluid.dim == 3:
            edge = (fluid.n / (fluid.packing_fraction / float(theory.packing_fraction(1.0, 1.0, 3)))) ** (
                1 / 3
            )
            begin, end = theory.periodic_diffusion_window(fluid.packing_fraction, edge)
            needed = (begin / _mean_free_time(fluid), end / _mean_free_time(fluid))
        dense = max(DENSE * min(1.0, DENSE_PARTICLES / fluid.n), FEWEST_DENSE)
        return cls(needed, length or min(max(USUAL, 3.0 * needed[1]), LONGEST_BY_DEFAULT), dense)

    @property
    def short(self) -> bool:
        """Whether the measurement is shorter than two windows."""
        return self.needed[1] > self.length / 2.0 * (1.0 + 1e-9)

    @property
    def stride(self) -> int:
        """Sample spacings between two samples of the slope."""
        return max(math.floor(min(self.needed[1], self.length / 2.0) / SLOPE_POINTS / SPACING + 0.5), 1)

    @property
    def window(self) -> tuple[float, float]:
        """Lags between which the slope is taken."""
        end = SLOPE_POINTS * self.stride
        return SPACING * round(
            end * self.needed[0] / self.needed[1] / self.stride
        ) * self.stride, SPACING * end

    @property
    def moments(self) -> list[int]:
        """Sample times, in units of SPACING."""
        last = math.ceil(self.length / SPACING)
        dense = range(min(last, round(self.dense / SPACING)) + 1)
        return sorted({*dense, *range(0, last + 1, self.stride)})

    @property
    def note(self) -> str | None:
        """Note on a short measurement."""
        if not self.short:
            return None
        begin, end = self.window
        return (
            f"too short for D of this box, the slope from {self.needed[0]:.0f} to {self.needed[1]:.0f} mean "
            f"free times: it is that from {begin:.0f} to {end:.0f}, and theory supplies the rest of the "
            f"tail; ask for --collisions-per-particle {math.ceil(2.0 * self.needed[1])}"
        )


@dataclass(frozen=True)
class _Walk:
    """Result of one replica of one state."""

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
    """A replica in progress: after `done` moments, close ones in `near`, those for the slope in `far`."""

    simulation: hs.Simulation
    near: Diffusion
    far: Diffusion
    done: int = 0


@dataclass(frozen=True)
class Walks(Resumable[tuple[Fluid, np.random.SeedSequence], _Walking, _Walk]):
    """The task that turns a fluid and a seed into one measured replica.

    Attributes
    ----------
    collisions_per_particle : float, optional
        How long to measure; by default as `Slope.of` has it.
    """

    collisions_per_particle: float | None = None

    def begin(self, item: tuple[Fluid, np.random.SeedSequence]) -> _Walking:
        """Make the gas."""
        fluid, seed = item
        return _Walking(hs.Simulation(fluid.scene(seed)), Diffusion(POINTS), Diffusion(SLOPE_POINTS))

    def steps(self, item: tuple[Fluid, np.random.SeedSequence], state: _Walking) -> Iterator[None]:
        """Equilibrate, then sample at equally spaced times: close ones, then those of the slope."""
        fluid, simulation = item[0], state.simulation
        slope = Slope.of(fluid, self.collisions_per_particle)
        yield from until(simulation, fluid.settled)
        moments = slope.moments
        for k in range(state.done, len(moments)):
            if k > 0:
                simulation.run(time=(moments[k] - moments[k - 1]) * SPACING * _mean_free_time(fluid))
            if moments[k] <= slope.dense / SPACING:
                state.near.add(simulation)
            if moments[k] % slope.stride == 0:
                state.far.add(simulation)
            state.done += 1
            yield

    def result(self, item: tuple[Fluid, np.random.SeedSequence], state: _Walking, seconds: float) -> _Walk:
        """Return what was measured."""
        fluid, simulation, near, far = item[0], state.simulation, state.near, state.far
        mean_free_time = _mean_free_time(fluid)
        slope = Slope.of(fluid, self.collisions_per_particle)
        window = (slope.window[0] * mean_free_time, slope.window[1] * mean_free_time)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)  # the error comes from the replicas
            measured = far.diffusion(window).value
        correction = None
        if fluid.dim == 3:
            edge = float(simulation.to_scene().box[0])
            correction = theory.periodic_diffusion_correction(fluid.packing_fraction, edge, window=window)
        later = far.lags > near.lags[-1] * (1.0 + 1e-9)
        return _Walk(
            np.append(near.lags, far.lags[later]),
            np.append(near.mean_square_displacement, far.mean_square_displacement[later]),
            np.append(near.velocity_autocorrelation, far.velocity_autocorrelation[later]),
            measured,
            correction,
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
    slope : Slope
        Where D is taken from.
    lags : (L,) array
        Times between two moments, ascending.
    mean_square_displacement, mean_square_displacement_error : (L,) arrays
        With standard errors from the replicas.
    velocity_autocorrelation, velocity_autocorrelation_error : (L,) arrays
        <v(0).v(t)>/<v^2>.
    here : Estimate
        D of this box.
    correction : Prediction or None
        Reduction of D by the periodic box; None in 2D, where D has no limit.
    enskog : Prediction
        Enskog's D of the infinite fluid.
    failures : tuple of str
        Failed checks of the state.
    """

    fluid: Fluid
    slope: Slope
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
        """D of the infinite fluid, in 3D; the uncertainty of the correction is in its error."""
        return None if self.correction is None else with_correction(self.here, self.correction)

    @property
    def check(self) -> TheoryCheck:
        """D (infinite in 3D, of this box in 2D) beside Enskog's."""
        enskog = self.enskog
        return TheoryCheck(
            "D", "Enskog", self.infinite or self.here, float(enskog.value), float(enskog.uncertainty)
        )

    @property
    def deviation(self) -> float:
        """Deviation of `check` in combined standard errors."""
        return self.check.z


def combine(fluid: Fluid, walks: Sequence[_Walk], length: float | None = None) -> DiffusionState:
    """Return the replicas of one packing fraction as one state, with its failed checks.

    Parameters
    ----------
    fluid : Fluid
        The gas.
    walks : sequence of _Walk
        Its replicas.
    length : float, optional
        Collisions per particle of each, as `Walks` has it.
    """
    squares = np.array([walk.mean_square_displacement for walk in walks])
    products = np.array([walk.velocity_autocorrelation for walk in walks])
    state = DiffusionState(
        fluid,
        Slope.of(fluid, length),
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
        states = [
            combine(fluid, own, study.collisions_per_particle)
            for fluid, own in zip(fluids, walks, strict=True)
        ]

        out.write_csv("diffusion.csv", _columns(states))
        out.write_csv("correlations.csv", _correlations(states))
        from studies.figures.diffusion import figure

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
        "collisions_per_particle": state.slope.length,
        "window_in_mean_free_times": state.slope.window,
        "d_box": estimate_json(state.here),
        "correction": None
        if correction is None
        else {"value": float(correction.value), "uncertainty": float(correction.uncertainty)},
        "d_infinite": None if infinite is None else estimate_json(infinite),
        "enskog": {"value": float(state.enskog.value), "uncertainty": float(state.enskog.uncertainty)},
        "deviation": state.deviation,
        "notes": [state.slope.note] if state.slope.note else [],
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
    header = ["packing fraction", "discarded", "slope", "D in this box"]
    header += ["correction", "D infinite"] if three else []
    header += ["Enskog", "z", "D / Enskog"]
    rows = []
    for state in states:
        begin, end = state.slope.window
        row = [
            f"{state.fluid.packing_fraction:.4g}",
            f"{state.fluid.discarded:.0f}",
            f"{begin:.0f} to {end:.0f}",
        ]
        row.append(str(state.here))
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
        "D from the slope of the mean square displacement between these many mean free times; errors from "
        "the spread of the replicas"
    )
    if three:
        screen.say(
            "correction: reduction of D by the periodic box (after Yeh and Hummer 2004); D infinite includes "
            "it, and its uncertainty"
        )
    else:
        screen.say("in 2D diffusion has no infinite limit: D grows as the logarithm of the box")
    screen.say(
        "Enskog's theory leaves out correlated collisions: its uncertainty is its known systematic error; "
        f"{Z_MEANS}"
    )
    for state in states:
        if state.slope.note:
            screen.say(f"packing fraction {state.fluid.packing_fraction:g}: {state.slope.note}")
    say_checks(screen, summary, out)
