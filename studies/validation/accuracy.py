"""Speed against error: the engine, the reference solver and two time-stepping programs on the same gases.

Few particles are compared with the trajectory at 50 digits (`studies.validation.accuracy_few`), many with
exact values of the pressure and the mean free path (`studies.validation.accuracy_long`). Everything is timed
in turn on one core.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.statistics import Estimate
from hardspheres.memory import require_room_for
from studies.answer import Section, Table
from studies.fluid import THEORY_UP_TO, Fluid, representatives
from studies.options import densities, dimension, option, seed
from studies.page import Report, write_page
from studies.program import Program
from studies.report import ALARM, OutputFolder, Screen, alarming, estimate_json
from studies.running.ensemble import replica_seeds, run_replicas
from studies.running.journal import Shelf
from studies.running.ownership import REPORT, SUMMARY
from studies.validation.accuracy_answer import Curve, rounding_floor
from studies.validation.accuracy_few import (
    CERTAIN,
    ENGINE,
    LOST,
    METHODS,
    REFERENCE,
    Few,
    Horizon,
    Method,
    beside_oracle,
    followed,
    joined,
    lyapunov_exponent,
)
from studies.validation.accuracy_long import Exact, Long, engine_test_seconds, long_runs
from studies.validation.time_stepping import BACK_UP, BOUNCE, Stepper

__all__ = ["Accuracy", "Compared", "compare"]

FEW = 32
REFERENCE_SCENES = 2  # it is slow
COLLISIONS_PER_PARTICLE = 1.0  # after which trajectories are compared
LONGEST = 1e7  # steps in one scene of few particles
LEVELS = (1e-2, 1e-3)  # relative errors of Z - 1 that the answer is given for
FEW_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003, 1e-3, 1e-4, 1e-5, 1e-6)
LONG_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
FAIR = 2.0


@dataclass(frozen=True, kw_only=True)
class Accuracy(Program):
    """The same gases with the engine, the all-pairs solver and two time-stepping programs.

    Attributes
    ----------
    scenes, followed : int
        Scenes of few particles; how many of them are followed until the trajectory is lost.
    seconds : float
        Processor time of each long run, roughly; results do not depend on how fast the machine is.
    few_steps, long_steps : tuple of float
        Time steps, descending, in units of diameter sqrt(m/kT).
    """

    name = "accuracy"
    question = "What does exactness cost, beside two time-stepping programs?"
    explanation = """
    The engine, the all-pairs solver and bouncing balls by time steps on the same gases in one run: distance
    from the trajectory at 50 digits, missed collisions, overlaps, pressure and mean free path, and cost.
    Writes a summary, a table and a picture. Every finished scene and state is kept; an interrupted one starts
    again.
    """
    files = ("accuracy.csv", "accuracy.png")
    reports = True

    packing_fractions: tuple[float, ...] = densities("0.01,0.3")
    n: int = option(4000, "Particles of the long runs; those beside the oracle have 32.", at_least=2)
    dim: int = dimension()
    seed: int = seed()
    quick: bool = option(False, "Fewer and shorter runs: half a minute.")
    scenes: int = 8
    followed: int = 3
    seconds: float = 1.5
    few_steps: tuple[float, ...] = FEW_STEPS
    long_steps: tuple[float, ...] = LONG_STEPS

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run it; sound where the engine follows the true trajectory and finds the exact values."""
        return _compare_all(self.quicker() if self.quick else self, out, screen)

    def quicker(self) -> Accuracy:
        """Return a study that takes a fifth of the time."""
        return replace(
            self,
            quick=True,
            scenes=4,
            followed=2,
            seconds=0.2,
            few_steps=FEW_STEPS[:-1],
            long_steps=LONG_STEPS[1:-1],
        )

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        require_room_for(self.n)
        limit = THEORY_UP_TO[self.dim]
        for eta in self.packing_fractions:
            if eta > limit:
                raise hs.SceneError(
                    f"packing fraction {eta:g} is above {limit:g}, where the pressure is not known well "
                    "enough; ask for less"
                )
            if eta < 1e-4:
                raise hs.SceneError(
                    f"packing fraction {eta:g}: in so dilute a gas time steps take too long to a collision; "
                    "ask for at least 1e-4"
                )
        if self.n < 200:
            raise hs.SceneError(
                f"--n {self.n} is too few for an exact pressure, whose finite-size correction is known from "
                "200 particles on"
            )

    def fluid(self, eta: float, n: int) -> Fluid:
        """Return the gas at one packing fraction."""
        return Fluid(n=n, dim=self.dim, packing_fraction=eta)


@dataclass(frozen=True)
class Compared:
    """One packing fraction, all methods.

    Attributes
    ----------
    fluid : Fluid
        The gas of the long runs.
    few : dict of Few
        By method and time step, beside the oracle.
    long : dict of Long
        By method and time step, against exact values.
    horizons : list of Horizon
        How long the engine stays on the true trajectory.
    exact : Exact
        What the long runs should give.
    engine_test : float
        The engine's processor time per pair tested.
    """

    fluid: Fluid
    few: dict[Method, Few]
    long: dict[Method, Long]
    horizons: list[Horizon]
    exact: Exact
    engine_test: float

    @property
    def keys(self) -> list[Method]:
        """Methods and time steps: engine, reference, then each time stepper from its longest step."""
        order = list(METHODS)
        keys = {(method, dt) for table in (self.few, self.long) for method, dt in table if not math.isnan(dt)}
        stepped = sorted(keys, key=lambda key: (order.index(key[0]), -key[1]))
        return [next(k for k in self.few if k[0] == name) for name in (ENGINE, REFERENCE)] + stepped

    @property
    def engine_few(self) -> Few:
        """The engine beside the oracle."""
        return next(few for (method, _), few in self.few.items() if method == ENGINE)

    @property
    def engine_long(self) -> Long:
        """The engine's long run."""
        return next(long for (method, _), long in self.long.items() if method == ENGINE)

    def pressure_curve(self, method: str) -> Curve:
        """Error of Z - 1 and cost against the time step."""
        points = [(dt, long) for (name, dt), long in self.long.items() if name == method]
        return Curve(
            [dt for dt, _ in points],
            [abs(long.pressure.value) for _, long in points],
            [long.pressure.standard_error for _, long in points],
            [long.seconds for _, long in points],
        )

    def trajectory_curve(self, method: str, worst: bool = False) -> Curve:
        """Error of the trajectory (median over scenes, or the worst) and cost against the time step."""
        points = [(dt, few) for (name, dt), few in self.few.items() if name == method]
        return Curve(
            [dt for dt, _ in points],
            [max(few.trajectory) if worst else float(np.median(few.trajectory)) for _, few in points],
            [0.0] * len(points),
            [float(np.median(few.seconds)) for _, few in points],
        )

    @property
    def horizon(self) -> float:
        """Collisions per particle until the engine's trajectory is lost, mean over scenes."""
        return float(np.mean([h.horizon for h in self.horizons]))

    @property
    def growth(self) -> float:
        """Exponent of the error's growth per collision per particle, mean over scenes."""
        return float(np.mean([h.growth for h in self.horizons]))

    @property
    def expected_horizon(self) -> float:
        """ln(LOST / 1e-16) over the Lyapunov exponent; NaN where that is not known."""
        return math.log(LOST / 1e-16) / lyapunov_exponent(self.fluid.packing_fraction, self.fluid.dim)

    @property
    def failures(self) -> list[str]:
        """What is wrong with the engine, one sentence each."""
        few, long, found = self.engine_few, self.engine_long, []
        if not max(few.trajectory) < CERTAIN:
            found.append(f"the engine left the true trajectory, by {max(few.trajectory):.1e} diameters")
        missed, true = sum(h.missed for h in self.horizons), sum(h.collisions for h in self.horizons)
        if missed:
            found.append(f"the engine's count was off by {missed} of {true} collisions")
        if long.missed:
            found.append(
                f"the engine missed {long.missed * long.audited:.0f} of {long.audited:.0f} collisions"
            )
        for name, estimate in (("Z - 1", long.pressure), ("the mean free path", long.free_path)):
            if alarming(estimate, 0.0, 0.0):
                found.append(
                    f"the engine's {name} is {estimate.z(0.0):+.1f} standard errors from the exact value"
                )
        if not (long.energy < 1e-12 and long.overlap < 1e-11):
            found.append(f"energy drift {long.energy:.1e}, deepest overlap {long.overlap:.1e} diameters")
        return found


@dataclass(frozen=True)
class _Large:
    """Results of the gas of many particles at one packing fraction, see `Compared`."""

    long: dict[Method, Long]
    exact: Exact
    engine_test: float


@dataclass(frozen=True)
class Parts:
    """Part of the work, for `run_replicas`: one scene of few particles, or the long runs of one density.

    Attributes
    ----------
    study : Accuracy
        What to do.
    """

    study: Accuracy

    def of(self, eta: float) -> list[tuple[str, float, int]]:
        """Return the parts of one packing fraction: what is done, where, and with which scene."""
        few = [("few", eta, index) for index in range(self.study.scenes)]
        return [*few, *(("followed", eta, index) for index in range(self.study.followed)), ("long", eta, 0)]

    def __call__(self, part: tuple[str, float, int]) -> dict[Method, Few] | Horizon | _Large:
        """Do one part."""
        what, eta, index = part
        study, seeds = self.study, replica_seeds(self.study.seed, self.study.scenes + 1)
        if what == "long":
            large = _settled(study.fluid(eta, study.n), seeds[0])
            long = long_runs(large, study.long_steps, study.seconds)
            return _Large(long, Exact.of(large), engine_test_seconds(large))
        scene = _settled(study.fluid(eta, FEW), seeds[1 + index])
        if what == "followed":
            return followed(scene)
        rate = float(theory.finite_size_collision_rate(eta, study.dim, study.n, temperature=1.0).value)
        steps = [dt for dt in study.few_steps if dt > COLLISIONS_PER_PARTICLE / rate / LONGEST]
        return beside_oracle(scene, COLLISIONS_PER_PARTICLE, steps, index < REFERENCE_SCENES)


def compare(
    study: Accuracy, done: Callable[[], None] | None = None, shelf: Shelf | None = None
) -> list[Compared]:
    """Run all methods at every packing fraction, on one core, for undisturbed timing.

    Parameters
    ----------
    study : Accuracy
        What to do.
    done : callable, optional
        Called after each of the `Parts`.
    shelf : Shelf, optional
        Where these are kept.
    """
    task = Parts(study)
    parts = [part for eta in study.packing_fractions for part in task.of(eta)]
    found: Any = dict(zip(parts, run_replicas(task, parts, workers=1, done=done, shelf=shelf), strict=True))
    compared = []
    for eta in study.packing_fractions:
        *small, last = task.of(eta)
        few = joined([found[part] for part in small if part[0] == "few"])
        horizons = [found[part] for part in small if part[0] == "followed"]
        large = found[last]
        fluid = study.fluid(eta, study.n)
        compared.append(Compared(fluid, few, large.long, horizons, large.exact, large.engine_test))
    return compared


def _settled(fluid: Fluid, seed: np.random.SeedSequence) -> hs.Scene:
    simulation = hs.Simulation(fluid.scene(seed))
    fluid.settle(simulation)
    return simulation.to_scene()


def _compare_all(study: Accuracy, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    began = time.perf_counter()
    study.check()
    out.check(study)
    with screen.compiling(f"{study.fluid(0.3, FEW).kind}, and the time steppers"):
        (seed,) = replica_seeds(0, 1)
        for fluid in representatives([study.fluid(eta, FEW) for eta in study.packing_fractions]):
            hs.Simulation(fluid.scene(seed)).run(collisions=1)
        Stepper(study.fluid(0.05, 50).scene(seed), 0.01).run(0.01)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        parts = sum(len(Parts(study).of(eta)) for eta in study.packing_fractions)
        with screen.progress("runs", parts) as advance:
            compared = compare(study, advance, shelf)
        ran = time.perf_counter()
        out.write_csv("accuracy.csv", _columns(compared))
        from studies.validation.accuracy_figure import figure

        with screen.working("drawing"):
            drawn = figure(compared)
            out.save_figure("accuracy.png", drawn, _in_words(study))
        failures = [
            f"packing fraction {each.fluid.packing_fraction:g}: {sentence}"
            for each in compared
            for sentence in each.failures
        ]
        summary: dict[str, Any] = {
            **study.made(),
            "seed": study.seed,
            "n": study.n,
            "dim": study.dim,
            "few": FEW,
            "collisions_per_particle": COLLISIONS_PER_PARTICLE,
            "states": [_state_summary(each) for each in compared],
            "answers": [sentence for each in compared for sentence in answers(each)],
            "checks": {"passed": not failures, "failures": failures, "alarm_in_standard_errors": ALARM},
            "files": sorted({*out.files, REPORT, SUMMARY}),
            "seconds": {
                "setup_and_compilation": ready - began,
                "runs": ran - ready,
                "total": time.perf_counter() - began,
            },
        }
        tables, legend = _tables(study, compared), _legend(study, summary)
        page = Report(
            name=study.name,
            subject=_in_words(study),
            question=study.asked,
            answer=[_as_sentence(answers(each)[0]) for each in compared],
            notes=[sentence for each in compared for sentence in answers(each)[1:]],
            figures={"accuracy": drawn},
            sections=tables,
            legend=legend,
            summary=summary,
        )
        write_page(out, page)
        out.write_json(SUMMARY, summary)
    _print(screen, tables, legend, summary)
    screen.say(f"{summary['seconds']['total']:.0f} s; written to {out.path}: {', '.join(summary['files'])}")
    return summary, not failures


def answers(state: Compared) -> list[str]:
    """Return the results at one packing fraction, in sentences."""
    sentences = [
        _pressure_answer(state),
        *_trajectory_answers(state),
        _horizon_answer(state),
        _fairness(state),
    ]
    return [f"packing fraction {state.fluid.packing_fraction:g}, {sentence}" for sentence in sentences]


def _pressure_answer(state: Compared) -> str:
    own, parts = state.engine_long.seconds, []
    for level in LEVELS:
        words = []
        for method in (BOUNCE, BACK_UP):
            need = state.pressure_curve(method).need(level)
            if need is None:
                words.append(f"{METHODS[method]} unknown (error lost in noise)")
            else:
                mark = ", extrapolated" * need.extrapolated
                words.append(f"{METHODS[method]} {need.seconds / own:.2g} times (dt = {need.dt:.2g}{mark})")
        parts.append(f"{100.0 * level:g} %: " + ", ".join(words))
    return f"time over the engine's for Z - 1 to {'; to '.join(parts)}"


def _trajectory_answers(state: Compared) -> list[str]:
    engine = state.engine_few
    worst, seconds = max(engine.trajectory), float(np.median(engine.seconds))
    text = f"trajectory after {COLLISIONS_PER_PARTICLE:g} collision per particle: the engine is "
    text += f"{np.median(engine.trajectory):.1e} diameters off, "
    text += f"in the worst of {len(engine.trajectory)} scenes {worst:.1e}"
    bounce, back_up = state.trajectory_curve(BOUNCE), state.trajectory_curve(BACK_UP, worst=True)
    error, dt = bounce.error[-1], bounce.dt[-1]
    said = (
        f"bouncing balls are {error:.1e} off with dt = {dt:g}, "
        f"in {bounce.seconds[-1] / seconds:.2g} times the engine's time"
    )
    floor, at = rounding_floor(error / dt, state.trajectory_curve(BACK_UP).error[-1] * back_up.dt[-1])
    if floor < error:
        said += (
            f"; the error falls as dt^{bounce.order:.2g}, and the rounding of so many steps ends that at "
            f"about {floor:.0e} near dt = {at:.0e} (extrapolated)"
        )
    best = int(np.argmin(back_up.error))
    backed = (
        f"with back-up at best {back_up.error[best]:.1e} in the worst scene, with dt = {back_up.dt[best]:g} "
        f"in {back_up.seconds[best] / seconds:.2g} times the engine's time"
    )
    if best < len(back_up.dt) - 1:
        backed += (
            f"; no time step reaches less than {back_up.error[best] / worst:.2g} times the engine's worst: "
            "longer ones change the sequence of collisions in some scenes, shorter ones round more often"
        )
    return [text, said, backed]


def _horizon_answer(state: Compared) -> str:
    eta, dim, long = state.fluid.packing_fraction, state.fluid.dim, state.engine_long
    missed, true = sum(h.missed for h in state.horizons), sum(h.collisions for h in state.horizons)
    expected = state.expected_horizon
    words = f", {expected:.2g} by the Lyapunov exponent {lyapunov_exponent(eta, dim):.3g}"
    return (
        f"the engine stays on the true trajectory (to {LOST:g} diameters) for {state.horizon:.3g} collisions "
        f"per particle{words if math.isfinite(expected) else ''}; its error grows by exp({state.growth:.3g} "
        f"s); it missed {missed} of {true} collisions beside the oracle, {long.missed * long.audited:.0f} of "
        f"{long.audited:.0f} in the long run"
    )


def _fairness(state: Compared) -> str:
    longest = max(dt for _, dt in state.long if not math.isnan(dt))
    test = state.long[BOUNCE, longest].test_seconds
    ratio = test / state.engine_test
    verdict = "fair" if ratio < FAIR else "NOT fair: a better program would be faster"
    return (
        f"time of a neighbour test: engine {state.engine_test * 1e9:.2g} ns, time stepping {test * 1e9:.2g} "
        f"ns (longest steps, which do little else), {ratio:.2g} times ({verdict})"
    )


def _columns(compared: Sequence[Compared]) -> dict[str, list[Any]]:
    """Return the columns of accuracy.csv."""
    rows = [_row(state, key) for state in compared for key in state.keys]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _row(state: Compared, key: Method) -> dict[str, Any]:
    few = state.few.get(key)
    long = next((long for k, long in state.long.items() if k == key or k[0] == key[0] == ENGINE), None)
    nothing, none = math.nan, Estimate(math.nan, math.nan)
    return {
        "packing_fraction": state.fluid.packing_fraction,
        "method": METHODS[key[0]],
        "dt": key[1],
        "few_seconds_per_collision": nothing if few is None else float(np.median(few.seconds)),
        "trajectory_error": nothing if few is None else float(np.median(few.trajectory)),
        "trajectory_error_worst": nothing if few is None else max(few.trajectory),
        "few_energy_drift": nothing if few is None else max(few.energy),
        "few_overlap": nothing if few is None else max(few.overlap),
        "seconds_per_collision": nothing if long is None else long.seconds,
        "seconds_per_particle_and_time": nothing if long is None else 0.5 * state.exact.rate * long.seconds,
        "collisions": 0 if long is None else long.collisions,
        "missed_per_collision": nothing if long is None else long.missed,
        "energy_drift": nothing if long is None else long.energy,
        "overlap": nothing if long is None else long.overlap,
        "pressure_error": (long.pressure if long else none).value,
        "pressure_error_error": (long.pressure if long else none).standard_error,
        "free_path_error": (long.free_path if long else none).value,
        "free_path_error_error": (long.free_path if long else none).standard_error,
        "seconds_per_test": state.engine_test
        if key[0] == ENGINE
        else nothing
        if long is None
        else long.test_seconds,
    }


def _state_summary(state: Compared) -> dict[str, Any]:
    return {
        "packing_fraction": state.fluid.packing_fraction,
        "exact": {"z": state.exact.z, "z_minus_1_relative_uncertainty": state.exact.z_uncertainty},
        "engine": {
            "pressure_error": estimate_json(state.engine_long.pressure),
            "free_path_error": estimate_json(state.engine_long.free_path),
        },
        "rows": [_row(state, key) for key in state.keys],
        "pressure": {
            method: {
                f"{level:g}": None
                if need is None
                else {
                    "dt": need.dt,
                    "times_engine": need.seconds / state.engine_long.seconds,
                    "extrapolated": need.extrapolated,
                }
                for level in LEVELS
                for need in [state.pressure_curve(method).need(level)]
            }
            | {"order": state.pressure_curve(method).order}
            for method in (BOUNCE, BACK_UP)
        },
        "horizon": {
            "collisions_per_particle": state.horizon,
            "expected": state.expected_horizon,
            "growth": state.growth,
            "lyapunov_exponent": lyapunov_exponent(state.fluid.packing_fraction, state.fluid.dim),
            "missed": sum(h.missed for h in state.horizons),
            "collisions": sum(h.collisions for h in state.horizons),
        },
    }


def _in_words(study: Accuracy) -> str:
    kind = "spheres" if study.dim == 3 else "discs"
    return (
        f"hard {kind}, periodic box: {FEW} for the distance from the true trajectory, {study.n} for "
        f"everything else; packing fraction {', '.join(f'{eta:g}' for eta in study.packing_fractions)}"
    )


def _as_sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _tables(study: Accuracy, compared: Sequence[Compared]) -> list[Section]:
    """Return a table for each packing fraction."""
    few, many = f"us, {FEW}", f"us, {study.n}"
    header = ["", "dt", few, "trajectory", "worst", many, "missed", "overlap", "Z - 1", "mean free path"]
    return [
        Section(
            f"packing fraction {state.fluid.packing_fraction:g}",
            [Table(header, [_cells(_row(state, key)) for key in state.keys], keys=2)],
        )
        for state in compared
    ]


def _legend(study: Accuracy, summary: dict[str, Any]) -> list[str]:
    """Return what the columns are; first what stands above the tables on the screen."""
    kind = "spheres" if study.dim == 3 else "discs"
    rows = [row for state in summary["states"] for row in state["rows"]]
    drift = max(row["energy_drift"] for row in rows if not math.isnan(row["energy_drift"]))
    return [
        (
            f"{FEW} hard {kind} beside the trajectory at 50 digits, {study.n} against exact pressure and "
            "mean free path; processor time in us per true collision"
        ),
        (
            f"trajectory: rms distance from the true one after {COLLISIONS_PER_PARTICLE:g} collision per "
            "particle, in diameters, median and worst of the scenes"
        ),
        (
            "missed: pairs that pass through each other within a step or are not detected, per true "
            "collision; overlap: the deepest, in diameters; Z - 1, mean free path: relative error"
        ),
        f"energy: no method lost more than {drift:.0e} of it, so energy is no measure of the other errors",
    ]


def _print(screen: Screen, tables: Sequence[Section], legend: Sequence[str], summary: dict[str, Any]) -> None:
    screen.say(legend[0])
    for section in tables:
        screen.say()
        for table in section.tables:
            screen.table(section.title, table.header, table.rows, keys=table.keys)
    screen.say()
    for sentence in (*legend[1:], "", *summary["answers"]):
        screen.say(sentence)
    for failure in summary["checks"]["failures"]:
        screen.say(f"CHECK FAILED, {failure}")


def _cells(row: dict[str, Any]) -> list[str]:
    def text(value: float, form: str) -> str:
        return "" if math.isnan(value) else "0" if value == 0.0 else format(value, form)

    def estimate(name: str) -> str:
        return "" if math.isnan(row[name]) else str(Estimate(row[name], row[f"{name}_error"]))

    def time_of(seconds: float) -> str:
        return text(seconds * 1e6, ".3g" if seconds < 1e-3 else ".0f")

    return [
        row["method"],
        text(row["dt"], "g"),
        time_of(row["few_seconds_per_collision"]),
        text(row["trajectory_error"], ".1e"),
        text(row["trajectory_error_worst"], ".1e"),
        time_of(row["seconds_per_collision"]),
        text(row["missed_per_collision"], ".1e"),
        text(row["overlap"], ".1e"),
        estimate("pressure_error"),
        estimate("free_path_error"),
    ]
