"""Temperature equilibration of two species, beside kinetic theory."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

import hardspheres as hs
from analysis import theory
from analysis.reduced import species_labels
from analysis.statistics import Estimate, TheoryCheck, deviates, estimate_from_replicas, replica_mean
from analysis.temperatures import TemperatureEquilibration
from analysis.theory import Prediction
from studies.fluid import THEORY_UP_TO, Fluid, broken
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
from studies.running.ensemble import available_cores, replica_seeds, run_replicas
from studies.running.resuming import Resumable, until

__all__ = ["Equilibrations", "Mixture", "Result", "mixture"]

FloatArray = NDArray[np.float64]

SAMPLES = 4  # in each relaxation time


@dataclass(frozen=True)
class Mixture:
    """Options of the study, as on the command line (`hardspheres mixture --help`).

    Attributes
    ----------
    fluid : Fluid
        Two species in a periodic box.
    temperature_ratio : float
        kT of the first species over the second's at the start; kT of the whole is 1.
    relaxation_times : float
        How long to run, in initial decay times of the temperature difference.
    replicas, seed, workers
        As in `studies.running.ensemble`; errors come from the spread of the replicas.
    """

    fluid: Fluid = field(
        default_factory=lambda: Fluid(n=2000, packing_fraction=0.01, diameter_ratio=2.0, mass_ratio=10.0)
    )
    temperature_ratio: float = 3.0
    relaxation_times: float = 4.0
    replicas: int = 100
    seed: int = 1
    workers: int | None = None

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        fluid, limit = self.fluid, THEORY_UP_TO[self.fluid.dim]
        fluid.check()
        few = min(round(fluid.fraction * fluid.n), fluid.n - round(fluid.fraction * fluid.n))
        if not fluid.mixed:
            raise hs.SceneError("the gas has one species; give --mass-ratio or --diameter-ratio other than 1")
        if few < 2:
            raise hs.SceneError(
                f"--fraction {fluid.fraction:g} of {fluid.n} particles leaves {few} of one species; a "
                "temperature "
                "needs at least 2"
            )
        if fluid.packing_fraction > limit:
            raise hs.SceneError(
                f"packing fraction {fluid.packing_fraction:g} is above {limit:g}, where the theory of "
                "mixtures ends; "
                "ask for less"
            )
        if not 0.0 < self.temperature_ratio < math.inf or self.temperature_ratio == 1.0:
            raise hs.SceneError(
                f"--temperature-ratio {self.temperature_ratio:g} leaves nothing to equilibrate; expected a "
                "positive "
                "number other than 1"
            )
        if not 0.5 <= self.relaxation_times <= 100.0:
            raise hs.SceneError(f"--relaxation-times {self.relaxation_times:g}; expected 0.5 to 100")
        if self.replicas < 4:
            raise hs.SceneError(
                f"--replicas {self.replicas} gives no error bar, which comes from their spread; ask for at "
                "least 4"
            )

    def start(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return a fluid equilibrated at one temperature, with new velocities of two temperatures.

        Raises
        ------
        SceneError
            If there is none.
        """
        settling = hs.Simulation(self.fluid.scene(seed))
        settling.run(collisions=self.fluid.settled)
        return self.heated(settling, seed)

    def heated(self, settled: hs.Simulation, seed: np.random.SeedSequence) -> hs.Scene:
        """Return a gas with new velocities, of two temperatures."""
        scene = settled.to_scene()
        hot_and_cold = hs.draw_velocities(
            scene, "two-temperatures", temperature_ratio=self.temperature_ratio, seed=seed
        )
        return scene.with_state(scene.positions, hot_and_cold)

    def times(self, scene: hs.Scene) -> tuple[float, ...]:
        """Return when to measure: four times in each initial decay time of the temperature difference."""
        temperatures = TemperatureEquilibration().add(hs.Simulation(scene).frame()).temperatures[0]
        rate = float(theory.temperature_equilibration_rate(temperatures, *_species(scene), scene.dim).sum())
        count = round(SAMPLES * self.relaxation_times) + 1
        return tuple((np.arange(count) / SAMPLES / rate).tolist())


def _species(scene: hs.Scene) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return number densities, diameters and masses of the species."""
    first = np.unique(scene.species, return_index=True)[1]
    return np.bincount(scene.species) / scene.volume, 2.0 * scene.radii[first], scene.masses[first]


@dataclass(frozen=True)
class _Run:
    """Result of one replica."""

    decay: TemperatureEquilibration
    labels: list[str]
    failure: str | None
    status: dict[str, Any]
    seconds: float


@dataclass
class _Equilibrating:
    """A replica in progress: measured `done` times, or still equilibrating where that is None."""

    simulation: hs.Simulation
    decay: TemperatureEquilibration
    done: int | None = None


@dataclass(frozen=True)
class Equilibrations(Resumable[np.random.SeedSequence, _Equilibrating, _Run]):
    """The task that turns a seed into one measured replica.

    Attributes
    ----------
    study : Mixture
        The gas.
    times : tuple of float
        When to measure.
    """

    study: Mixture
    times: tuple[float, ...]

    def begin(self, item: np.random.SeedSequence) -> _Equilibrating:
        """Make the gas, at one temperature."""
        return _Equilibrating(hs.Simulation(self.study.fluid.scene(item)), TemperatureEquilibration())

    def steps(self, item: np.random.SeedSequence, state: _Equilibrating) -> Iterator[None]:
        """Equilibrate, then draw velocities of two temperatures and measure."""
        if state.done is None:
            yield from until(state.simulation, self.study.fluid.settled)
            state.simulation = hs.Simulation(self.study.heated(state.simulation, item))
            state.done = 0
        for frame in state.simulation.frames(times=self.times[state.done :]):
            state.decay.add(frame)
            state.done += 1
            yield

    def result(self, item: np.random.SeedSequence, state: _Equilibrating, seconds: float) -> _Run:
        """Return what was measured."""
        simulation = state.simulation
        labels = species_labels(simulation.frame())
        return _Run(state.decay, labels, broken(simulation), simulation.status(), seconds)


class Result:
    """All replicas together, beside the theory.

    Parameters
    ----------
    replicas : sequence of TemperatureEquilibration
        One per replica.
    scene : Scene
        Of one of them.
    labels : list of str
        Labels of the species.
    """

    def __init__(
        self, replicas: Sequence[TemperatureEquilibration], scene: hs.Scene, labels: list[str]
    ) -> None:
        self.scene, self.labels = scene, labels
        self.decay = decay = TemperatureEquilibration()
        for replica in replicas:
            decay.merge(replica)
        self.time, self.s = decay.time, decay.s
        self.expected = self.theory_at(self.time)
        half = len(self.time) // 2
        late = [(r.s[-1] - r.s[half]) / (r.time[-1] - r.time[half]) for r in replicas]
        self._late_rate = estimate_from_replicas(late)
        samples = decay.samples
        self.difference, self.difference_error = replica_mean(samples[:, :, 0] - samples[:, :, 1])
        self.theory_difference = self.expected.value[:, 0] - self.expected.value[:, 1]
        # the energy is conserved: where one temperature is too high in theory the other is too low
        self.theory_difference_error = self.expected.uncertainty.sum(axis=1)

    def theory_at(self, moments: FloatArray) -> Prediction:
        """Return the temperatures of the two-Maxwellian theory at these times, (n, 2)."""
        densities, diameters, masses = _species(self.scene)
        start = self.decay.temperatures[0]
        return theory.temperature_equilibration(moments, start, densities, diameters, masses, self.scene.dim)

    @property
    def deviations(self) -> FloatArray:
        """T_1 - T_2 less theory as normal deviates, NaN at the start, where both are the same."""
        apart = np.where(self.time > 0.0, self.difference - self.theory_difference, np.nan)
        freedom = self.decay.n_replicas - 1.0
        return deviates(apart, self.difference_error, self.theory_difference_error, freedom)

    @property
    def rate(self) -> TheoryCheck:
        """Decay rate of the temperature difference over the first relaxation time, or the run if shorter."""
        return self.decay.check((0.0, float(self.time[min(SAMPLES, len(self.time) - 1)])))

    @property
    def collision_rate(self) -> TheoryCheck:
        """Collisions per particle and time over the second half of the run, all species together.

        Theory: sum of x_i nu_ij at the temperatures of theory, averaged over that half; u from the contact
        values, 1/N for the finite size, and the theory's temperatures.
        """
        half = len(self.time) // 2
        expected = self._rates(self.expected.value[half:])
        shifted = self._rates(self.expected.value[half:] + self.expected.uncertainty[half:] * [[1.0, -1.0]])
        span = self.time[half:]
        mean = float(trapezoid(expected, span) / (span[-1] - span[0]))
        by_temperature = abs(float(trapezoid(shifted - expected, span) / (span[-1] - span[0])))
        densities, diameters, _ = _species(self.scene)
        g = float(theory.mixture_contact_values(densities, diameters, self.scene.dim).max())
        uncertainty = mean * math.hypot(
            theory.mixture_contact_uncertainty(diameters, self.scene.dim) * (1.0 - 1.0 / g),
            1.0 / self.scene.n,
        )
        return TheoryCheck(
            "collisions per particle and time",
            "Enskog",
            self._late_rate,
            mean,
            math.hypot(uncertainty, by_temperature),
        )

    def _rates(self, temperatures: FloatArray) -> FloatArray:
        """Collisions per particle and time at these temperatures (n, 2)."""
        densities, diameters, masses = _species(self.scene)
        share = densities / densities.sum()
        return np.array(
            [
                share
                @ theory.mixture_collision_rates(densities, diameters, masses, self.scene.dim, kT).sum(axis=1)
                for kT in temperatures
            ]
        )

    @property
    def checks(self) -> list[TheoryCheck]:
        """Measured numbers beside theory, except the curve; without a rate that is lost in noise."""
        found = []
        for name in ("rate", "collision_rate"):
            try:
                found.append(getattr(self, name))
            except ValueError:
                continue
        return found

    @property
    def failures(self) -> list[str]:
        """One sentence for each number beyond 5 standard errors, the worst moment for the curve."""
        sentences, z = [], np.abs(self.deviations)
        worst = int(np.nanargmax(z))
        freedom = self.decay.n_replicas - 1.0
        error = float(self.difference_error[worst])
        there = Estimate(float(self.difference[worst]), error, degrees_of_freedom=freedom)
        if alarming(there, self.theory_difference[worst], self.theory_difference_error[worst]):
            sentences.append(
                f"T1 - T2 is {self.deviations[worst]:+.1f} standard errors from theory at time "
                f"{self.time[worst]:.4g}"
            )
        for check in self.checks:
            if alarming(check.measured, check.expected, check.uncertainty):
                sentences.append(
                    f"{check.quantity}: {check.z:+.1f} standard errors from theory ({check.theory})"
                )
        return sentences


def mixture(study: Mixture, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : Mixture
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
        Whether theory holds to 5 standard errors, and energy, momentum and non-overlap in every replica.

    Raises
    ------
    HardSpheresError
        If the gas cannot be made or never collides, or the folder cannot be written.
    """
    began = time.perf_counter()
    study.check()
    out.check(study)
    seeds = replica_seeds(study.seed, study.replicas)
    with screen.compiling(study.fluid.kind):
        first = study.start(seeds[0])
    times = study.times(first)
    ready = time.perf_counter()
    with out.running(study) as shelf:
        with screen.progress("replicas", study.replicas) as advance:
            runs = run_replicas(
                Equilibrations(study, times), seeds, workers=study.workers, done=advance, shelf=shelf
            )
        ran = time.perf_counter()
        result = Result([run.decay for run in runs], first, runs[0].labels)

        out.write_csv("mixture.csv", _columns(result))
        from studies.figures.mixture import figure

        with screen.working("drawing"):
            out.save_figure("mixture.png", figure(result), _in_words(study))
        summary = _summary(study, result, runs, out)
        summary["seconds"] = seconds_taken(began, ready, ran)
        out.write_json("summary.json", summary)
    _print(screen, study, result, summary, out)
    return summary, bool(summary["checks"]["passed"])


def _columns(result: Result) -> dict[str, FloatArray]:
    """Return the columns of mixture.csv."""
    columns = {"time": result.time, "s": result.s}
    values, errors = result.decay.temperatures, result.decay.temperatures_error
    for kind in range(2):
        columns[f"temperature_{kind + 1}"] = values[:, kind]
        columns[f"temperature_{kind + 1}_error"] = errors[:, kind]
        columns[f"temperature_{kind + 1}_theory"] = result.expected.value[:, kind]
        columns[f"temperature_{kind + 1}_theory_error"] = result.expected.uncertainty[:, kind]
    return columns | {
        "difference": result.difference,
        "difference_error": result.difference_error,
        "difference_theory": result.theory_difference,
        "difference_theory_error": result.theory_difference_error,
        "deviation": result.deviations,
    }


def _summary(study: Mixture, result: Result, runs: Sequence[_Run], out: OutputFolder) -> dict[str, Any]:
    fluid, statuses = study.fluid, [run.status for run in runs]
    failures = [f"replica {index}: {run.failure}" for index, run in enumerate(runs) if run.failure]
    collisions = sum(status["collisions"] for status in statuses)
    return {
        "study": "mixture",
        "version": hs.__version__,
        "seed": study.seed,
        "options": {
            "n": fluid.n,
            "dim": fluid.dim,
            "packing_fraction": fluid.packing_fraction,
            "mass_ratio": fluid.mass_ratio,
            "diameter_ratio": fluid.diameter_ratio,
            "fraction": fluid.fraction,
            "temperature_ratio": study.temperature_ratio,
            "relaxation_times": study.relaxation_times,
            "replicas": study.replicas,
        },
        "workers": available_cores() if study.workers is None else study.workers,
        "n": fluid.n,
        "dim": fluid.dim,
        "species": result.labels,
        "temperatures": _columns(result),
        "measured": [
            {
                "quantity": check.quantity,
                **estimate_json(check.measured),
                "theory": check.theory,
                "expected": check.expected,
                "uncertainty": check.uncertainty,
                "deviation": check.z,
            }
            for check in result.checks
        ],
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / sum(run.seconds for run in runs),
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, [*failures, *result.failures]) | {"alarm_in_standard_errors": ALARM},
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def _in_words(study: Mixture) -> str:
    return f"{study.replicas} x {study.fluid}, packing fraction {study.fluid.packing_fraction:.4g}"


def _print(
    screen: Screen, study: Mixture, result: Result, summary: dict[str, Any], out: OutputFolder
) -> None:
    screen.say(_in_words(study))
    screen.say("species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(result.labels, 1)))
    screen.say()
    values, errors = result.decay.temperatures, result.decay.temperatures_error
    rows = []
    for k, moment in enumerate(result.time):
        z, uncertainty = result.deviations[k], result.theory_difference_error[k]
        rows.append(
            [
                f"{moment:.4g}",
                f"{result.s[k]:.3g}",
                _text(values[k, 0], errors[k, 0]),
                _text(values[k, 1], errors[k, 1]),
                _text(result.difference[k], result.difference_error[k]),
                _text(result.theory_difference[k], uncertainty),
                f"{z:+.1f}" if math.isfinite(z) else "",
                "u" if k and uncertainty > 2.0 * result.difference_error[k] else "",
            ]
        )
    screen.table("", ["time", "s", "T1", "T2", "T1 - T2", "theory", "z", ""], rows)
    screen.say()
    screen.say(
        "theory: two Maxwellians, exact at the start; its uncertainty in parentheses is its known systematic "
        "error later, when the species are no longer Maxwellian and the difference decays more slowly"
    )
    screen.say(f"{Z_MEANS}; errors from the spread of replicas")
    if any(row[-1] for row in rows):
        screen.say(
            "u: the measurement is better than the theory, whose uncertainty exceeds two standard errors"
        )
    for check in result.checks:
        screen.say(str(check))
    say_checks(screen, summary, out)


def _text(value: float, error: float) -> str:
    return f"{value:.4f}" if not error > 1e-12 else str(Estimate(float(value), float(error)))
