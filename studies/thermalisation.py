"""Thermalisation: relaxation from a state far from equilibrium to Maxwell-Boltzmann, beside theory."""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.relaxation import Comparison, RelaxationCurve
from analysis.statistics import Estimate, deviates
from analysis.velocities import reduced_velocities
from hardspheres.files import Reading, read_scene
from studies.fluid import broken, is_dense, kind_of, two_species
from studies.report import Z_MEANS, OutputFolder, Screen, engine_of, engine_rate, say_checks, seconds_taken
from studies.running.ensemble import available_cores, replica_seeds, run_replicas
from studies.running.resuming import Resumable, until

__all__ = ["Recipe", "ReplicaResult", "Replicas", "Thermalisation", "sampling_points", "thermalise"]

FloatArray = NDArray[np.float64]

RATE_WINDOW = (2.0, 5.0)
MOVIE_FRAMES = 120


@dataclass(frozen=True)
class Recipe:
    """How to make the gas of one replica from its seed.

    Attributes
    ----------
    n, dim, packing_fraction, boundary, temperature
        As in `hardspheres.random_gas`; the first species has diameter 1 and mass 1.
    velocities : str or None
        Word of `hardspheres.draw_velocities`; None keeps those of `base`.
    mass_ratio, diameter_ratio : float
        Mass and diameter of the second species over the first's.
    fraction : float
        Number fraction of the second species; without effect when both ratios are 1.
    temperature_ratio : float
        Of "two-temperatures".
    base : Scene or None
        Positions, radii, masses and box to use instead of making any.
    """

    n: int = 4000
    dim: int = 3
    packing_fraction: float = 0.005
    boundary: str | tuple[str, ...] = "periodic"
    velocities: str | None = "equal-speeds"
    temperature: float = 1.0
    mass_ratio: float = 1.0
    diameter_ratio: float = 1.0
    fraction: float = 0.5
    base: hs.Scene | None = None
    temperature_ratio: float = 3.0

    @property
    def placement(self) -> str:
        """Initial positions: "file", "random" or "lattice"."""
        if self.base is not None:
            return "file"
        return "lattice" if is_dense(self.dim, self.packing_fraction) else "random"

    def scene(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return the scene that belongs to a seed.

        Raises
        ------
        SceneError
            If there is none.
        """
        if self.base is not None:
            return self.base if self.velocities is None else self._drawn(self.base, seed)
        make = hs.random_gas if self.placement == "random" else hs.lattice_gas
        radii, masses = two_species(self.n, self.diameter_ratio, self.mass_ratio, self.fraction)
        scene = make(
            n=self.n,
            packing_fraction=self.packing_fraction,
            dim=self.dim,
            boundary=self.boundary,
            velocities=self.velocities or "maxwell",
            temperature=self.temperature,
            radii=radii,
            masses=masses,
            seed=seed,
        )
        return self._drawn(scene, seed) if self.velocities == "two-temperatures" else scene

    def _drawn(self, scene: hs.Scene, seed: np.random.SeedSequence) -> hs.Scene:
        """Return a scene with new velocities."""
        drawn = hs.draw_velocities(
            scene,
            str(self.velocities),
            temperature=self.temperature,
            temperature_ratio=self.temperature_ratio,
            seed=seed,
        )
        return scene.replace(velocities=drawn)


@dataclass(frozen=True)
class Movie:
    """Positions and speeds of one replica, for the animation: (F,), (F, N, d), (F, N) in thermal speeds."""

    s: FloatArray
    positions: NDArray[np.float32]
    speeds: NDArray[np.float32]


@dataclass
class _Film:
    """A `Movie` in the making."""

    s: list[float] = field(default_factory=list)
    positions: list[NDArray[np.float32]] = field(default_factory=list)
    speeds: list[NDArray[np.float32]] = field(default_factory=list)

    def add(self, frame: hs.Frame) -> None:
        self.s.append(frame.collisions_per_particle)
        self.positions.append(frame.positions.astype(np.float32))
        self.speeds.append(np.linalg.norm(reduced_velocities(frame)[0], axis=1).astype(np.float32))

    def movie(self) -> Movie | None:
        if not self.s:
            return None
        return Movie(np.array(self.s), np.array(self.positions), np.array(self.speeds))


@dataclass(frozen=True)
class ReplicaResult:
    """Result of one replica.

    Attributes
    ----------
    curve : RelaxationCurve
        Of this replica alone.
    status : dict
        `Simulation.status` at the end.
    seconds : float
        Wall time of making, running and measuring it.
    failure : str or None
        What `Simulation.check` found broken at the end.
    movie : Movie or None
        Of the first replica, when asked for.
    """

    curve: RelaxationCurve
    status: dict[str, Any]
    seconds: float
    failure: str | None
    movie: Movie | None


@dataclass
class _Relaxing:
    """A replica in progress: `curve` and `film` have `done` samples, and the trajectory `written` of them."""

    simulation: hs.Simulation
    curve: RelaxationCurve = field(default_factory=RelaxationCurve)
    film: _Film = field(default_factory=_Film)
    done: int = 0
    written: int = 0


@dataclass(frozen=True)
class Replicas(Resumable[tuple[int, np.random.SeedSequence], _Relaxing, ReplicaResult]):
    """The task that turns an index and a seed into a `ReplicaResult`; the first writes the trajectory.

    Attributes
    ----------
    recipe : Recipe
        The gas.
    s : tuple of float
        Where to measure.
    trajectory : Path or None, trajectory_s : tuple of float
        Where to write, and at which s.
    movie_s : tuple of float
        Where to record the animation.
    """

    recipe: Recipe
    s: tuple[float, ...]
    trajectory: Path | None = None
    trajectory_s: tuple[float, ...] = ()
    movie_s: tuple[float, ...] = ()

    def begin(self, item: tuple[int, np.random.SeedSequence]) -> _Relaxing:
        """Make the gas."""
        return _Relaxing(hs.Simulation(self.recipe.scene(item[1])))

    def steps(self, item: tuple[int, np.random.SeedSequence], state: _Relaxing) -> Iterator[None]:
        """Measure, write and film it at each s."""
        simulation, first = state.simulation, item[0] == 0
        written = set(self.trajectory_s) if first and self.trajectory is not None else set()
        filmed = set(self.movie_s) if first else set()
        with contextlib.ExitStack() as open_files:
            if written and self.trajectory is not None:
                writer = open_files.enter_context(hs.TrajectoryWriter(self.trajectory, keep=state.written))
            for s in sorted({*self.s, *written, *filmed})[state.done :]:
                yield from until(simulation, _collisions_at(s, simulation.scene.n))
                frame = simulation.frame()
                if s in self.s:
                    state.curve.add(frame)
                if s in written:
                    writer.write(frame)
                    state.written += 1
                if s in filmed:
                    state.film.add(frame)
                state.done += 1
                yield

    def result(
        self, item: tuple[int, np.random.SeedSequence], state: _Relaxing, seconds: float
    ) -> ReplicaResult:
        """Return what was measured."""
        simulation = state.simulation
        return ReplicaResult(
            state.curve, simulation.status(), seconds, broken(simulation), state.film.movie()
        )


def _collisions_at(s: float, n: int) -> int:
    """Return after how many pair collisions s collisions per particle are reached."""
    return math.ceil(s * n / 2 - 1e-9)


def sampling_points(end: float, n: int) -> tuple[float, ...]:
    """Return where to measure up to `end` collisions per particle, dense early, no collision twice.

    Parameters
    ----------
    end : float
        Largest s, positive.
    n : int
        Number of particles: s advances by steps of 2 / n.

    Returns
    -------
    tuple of float
        From 0 to `end`, 17 points for 10; beyond 10 by steps of a sixth.
    """
    if end < 1.0:
        points = list(np.linspace(0.0, end, 9))
    else:
        points = [0.0, 0.25, 0.5, 0.75, *np.arange(1.0, 4.01, 0.5), *np.arange(5.0, 10.01)]
        while points[-1] < end:
            points.append(float(f"{points[-1] * 7 / 6:.2g}"))
    wanted = [float(s) for s in points if s < end - 1e-9] + [float(end)]
    by_collision = {_collisions_at(s, n): s for s in reversed(wanted)}
    return tuple(sorted(by_collision.values()))


@dataclass(frozen=True)
class Thermalisation:
    """Options of the study, as on the command line (`hardspheres thermalise --help`)."""

    recipe: Recipe = Recipe()
    collisions_per_particle: float = 10.0
    replicas: int = 100
    seed: int = 1
    workers: int | None = None
    frames: int = 21
    animate: bool = False
    source: str | None = None
    notes: tuple[str, ...] = ()  # everything in the source that was changed or not used

    @classmethod
    def from_file(
        cls,
        path: str,
        reading: Reading,
        velocities: str | None,
        temperature: float | None,
        **options: Any,
    ) -> Thermalisation:
        """Return the study of a structure from a file.

        Velocities are those of the file unless there are none or a distribution is named; positions are the
        same in all replicas.

        Parameters
        ----------
        path : str
            Any file that ASE reads.
        reading : Reading
            How to interpret what is ambiguous in the file.
        velocities : str, optional
            Draw velocities, whatever the file has.
        temperature : float, optional
            kT of drawn velocities, 1 by default.
        **options
            Other fields of this class.

        Raises
        ------
        TrajectoryError, SceneError
            If the file gives no valid scene.
        """
        scene, notes = read_scene(path, replace(reading, velocities=velocities is None))
        keep = velocities is None and bool(np.any(scene.velocities))
        if keep and temperature is not None:
            raise hs.SceneError(f"{path} has velocities; --temperature needs --velocities to draw others")
        recipe = Recipe(
            n=scene.n,
            dim=scene.dim,
            packing_fraction=scene.packing_fraction,
            boundary=scene.boundary,
            velocities=None if keep else velocities or "equal-speeds",
            temperature=scene.temperature if keep else (1.0 if temperature is None else temperature),
            base=scene,
        )
        study = cls(recipe=recipe, source=str(path), notes=tuple(notes), **options)
        return replace(study, replicas=1) if keep else study


def thermalise(study: Thermalisation, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the study, print its results and write its files.

    Parameters
    ----------
    study : Thermalisation
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
        Whether energy, momentum and non-overlap held in every replica.

    Raises
    ------
    HardSpheresError
        If the gas cannot be made or never collides, or the folder cannot be written.
    """
    began = time.perf_counter()
    recipe = study.recipe
    for note in study.notes:
        screen.note(f"{study.source}: {note}")
    if recipe.base is not None and recipe.velocities is None:
        screen.note(
            "the file has velocities, so all replicas would be the same: running one, without error bars"
        )
    out.check(study)
    seeds = replica_seeds(study.seed, study.replicas)
    first = recipe.scene(seeds[0])
    with screen.compiling(kind_of(first)):
        hs.Simulation(first).run(collisions=1)
    ready = time.perf_counter()
    s = sampling_points(study.collisions_per_particle, recipe.n)
    movie_s = _evenly(study.collisions_per_particle, MOVIE_FRAMES) if study.animate else ()
    with out.running(study) as shelf:
        trajectory = shelf.folder / "trajectory.xyz" if study.frames > 0 else None
        task = Replicas(recipe, s, trajectory, _evenly(study.collisions_per_particle, study.frames), movie_s)
        with screen.progress("replicas", study.replicas) as advance:
            items = list(enumerate(seeds))
            results = run_replicas(task, items, workers=study.workers, done=advance, shelf=shelf)
        ran = time.perf_counter()
        if trajectory is not None:
            out.adopt(trajectory)

        curve = RelaxationCurve()
        for result in results:
            curve.merge(result.curve)
        reference = _reference(study, curve)
        out.write_csv("relaxation.csv", _columns(curve, reference))
        from studies.figures import thermalisation as figures

        gas = _in_words(study, first, len(results))
        with screen.working("drawing"):
            out.save_figure("distributions.png", figures.distributions(curve), gas)
            out.save_figure("relaxation.png", figures.relaxation(curve, reference), gas)
            if results[0].movie is not None:
                with out.partial("gas.gif") as path:
                    figures.animation(results[0].movie, first, curve, path, gas)
        summary = _summary(study, first, curve, reference, results, out)
        summary["seconds"] = seconds_taken(began, ready, ran)
        out.write_json("summary.json", summary)
    _print(screen, study, gas, curve, reference, summary, out)
    return summary, bool(summary["checks"]["passed"])


def _in_words(study: Thermalisation, scene: hs.Scene, replicas: int) -> str:
    """Return which gas this is."""
    start = study.recipe.velocities or "the file's velocities"
    kind, box = kind_of(scene).split(", ", 1)
    return (
        f"{replicas} x {scene.n} {kind}, packing fraction {scene.packing_fraction:.4g}, {box}, start: {start}"
    )


def _evenly(end: float, count: int) -> tuple[float, ...]:
    return tuple(float(s) for s in np.linspace(0.0, end, count)) if count > 1 else (0.0,) * count


def _reference(study: Thermalisation, curve: RelaxationCurve) -> Comparison | None:
    """Return the theory that applies to this start, None where there is none at every s."""
    if curve.starts_from_equal_speeds:
        return curve.compare()
    if study.recipe.velocities == "maxwell":
        return curve.compare("equilibrium")
    return None


def _columns(curve: RelaxationCurve, reference: Comparison | None) -> dict[str, FloatArray]:
    """Return the columns of relaxation.csv."""
    unknown = np.full(len(curve.s), np.nan)

    def theory_of(name: str) -> FloatArray:
        return unknown if reference is None else np.asarray(getattr(reference, name))

    columns = {"s": curve.s, "time": curve.time}
    for name in ("a2", "ks", "h"):
        columns[name] = getattr(curve, name)
        columns[f"{name}_error"] = getattr(curve, f"{name}_error")
        columns[f"{name}_boltzmann"] = theory_of(name)
        columns[f"{name}_boltzmann_error"] = theory_of(f"{name}_uncertainty")
        columns[f"{name}_z"] = theory_of(f"{name}_z")
    columns["a3"], columns["a3_error"] = curve.a3, curve.a3_error
    if len(curve.labels) > 1:
        errors = curve.temperature_by_species_error.T
        for index, kT in enumerate(curve.temperature_by_species.T):
            columns[f"temperature_{index + 1}"], columns[f"temperature_{index + 1}_error"] = kT, errors[index]
            columns[f"a2_{index + 1}"] = curve.a2_by_species[:, index]
    for axis, share in zip("xyz", curve.temperature_by_axis.T, strict=False):
        columns[f"temperature_{axis}"] = share
    if curve.preferred_direction is not None:
        along = curve.temperature_along(curve.preferred_direction)
        columns["temperature_parallel"], columns["temperature_parallel_error"] = along
        for name, column in zip(("boltzmann", "boltzmann_error", "z"), _beams(curve) or (), strict=False):
            columns[f"temperature_parallel_{name}"] = column
    return columns


def _beams(curve: RelaxationCurve) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return T_par/T of two beams in theory, its uncertainty, and z; None after another start."""
    direction = curve.preferred_direction
    if direction is None or not curve.starts_from_beams:
        return None
    known = curve.s <= 7.0
    table = theory.boltzmann_beams(np.where(known, curve.s, 0.0), curve.dim)
    expected = np.where(known, 1.0 + table.anisotropy, np.nan)
    value, error = curve.temperature_along(direction)
    apart = np.where(curve.s > 0.0, value - expected, np.nan)
    freedom = curve.n_replicas - 1.0 if curve.n_replicas > 1 else math.inf
    return expected, table.anisotropy_error, deviates(apart, error, table.anisotropy_error, freedom)


def _rate(curve: RelaxationCurve) -> Estimate | str:
    """Return the fitted rate, or the reason why there is none."""
    try:
        return curve.fit_rate(RATE_WINDOW)
    except ValueError as error:
        return str(error)


def _summary(
    study: Thermalisation,
    scene: hs.Scene,
    curve: RelaxationCurve,
    reference: Comparison | None,
    results: Sequence[ReplicaResult],
    out: OutputFolder,
) -> dict[str, Any]:
    options = {key: value for key, value in asdict(replace(study.recipe, base=None)).items() if key != "base"}
    options |= {"from": study.source, "placement": study.recipe.placement}
    options |= {
        name: getattr(study, name)
        for name in ("collisions_per_particle", "replicas", "seed", "frames", "animate")
    }
    workers = available_cores() if study.workers is None else study.workers
    rate = _rate(curve)
    measured: dict[str, Any] = {"window": RATE_WINDOW}
    if isinstance(rate, Estimate):
        measured |= {"value": rate.value, "standard_error": rate.standard_error}
    else:
        measured["reason"] = rate
    if curve.starts_from_equal_speeds:
        expected = theory.equal_speeds_decay_rate(curve.dim, RATE_WINDOW)
        measured |= {"boltzmann": expected.value, "boltzmann_error": expected.uncertainty}
        if isinstance(rate, Estimate):
            measured["z"] = rate.z(expected.value, expected.uncertainty)
    chi_square = reference.chi_square if reference is not None else None
    failures = [
        f"replica {index}: {result.failure}" for index, result in enumerate(results) if result.failure
    ]
    statuses = [result.status for result in results]
    collisions = sum(status["collisions"] for status in statuses)
    seconds = sum(result.seconds for result in results)
    return {
        "study": "thermalise",
        "version": hs.__version__,
        "seed": study.seed,
        "options": options,
        "workers": workers,
        "n": scene.n,
        "dim": scene.dim,
        "packing_fraction": scene.packing_fraction,
        "box": scene.box,
        "boundary": list(scene.boundary),
        "species": curve.labels,
        "replicas": curve.n_replicas,
        "particles_in_all": curve.n_replicas * curve.n_per_replica,
        "collisions": collisions,
        "collisions_per_second_and_core": collisions / seconds,
        "engine_collisions_per_second": engine_rate(statuses),
        "theory": _theory_name(study, curve, reference),
        "relaxation": _columns(curve, reference),
        "a2_chi_square": None if chi_square is None else asdict(chi_square),
        "decay_rate": measured,
        "thermal": _thermal(curve),
        "equilibrium_a2": float(theory.equilibrium_a2(curve.degrees_of_freedom)),
        "ks_floor": theory.ks_floor(curve.n_replicas * curve.n_per_replica, curve.dim),
        "h_bins": curve.h_bins,
        "h_bin_width": theory.SPEED_LIMIT[curve.dim] / curve.h_bins,
        "checks": {
            "passed": not failures,
            "failures": failures,
            "worst_energy_drift": max(abs(status["energy_drift"]) for status in statuses),
            "worst_momentum_drift": max(abs(status["momentum_drift"]) for status in statuses),
            "late_events": sum(status["late_events"] for status in statuses),
        },
        "engine": engine_of(statuses[0]),
        "files": sorted({*out.files, "summary.json"}),
        "seconds": {},
    }


def _thermal(curve: RelaxationCurve) -> dict[str, Any]:
    """Report whether the gas is in equilibrium at the end, and by which numbers."""
    late = [check.quantity for check in curve.not_thermal]
    return {
        "s": float(curve.s[-1]),
        "passed": not late,
        "checks": [
            {
                "quantity": check.quantity,
                "value": check.measured.value,
                "standard_error": check.measured.standard_error,
                "equilibrium": check.expected,
                "z": check.z,
                "thermal": check.quantity not in late,
            }
            for check in curve.equilibrium_checks
        ],
    }


def _say_dominant(screen: Screen, curve: RelaxationCurve, reference: Comparison) -> None:
    """Report where the theory's uncertainty exceeds the measurement's, if at over a quarter of the points."""
    for name, title in (("a2", "a2"), ("ks", "KS"), ("h", "H - Heq")):
        uncertainty, error = getattr(reference, f"{name}_uncertainty"), getattr(curve, f"{name}_error")
        known = np.isfinite(getattr(reference, f"{name}_z"))
        hidden = curve.s[known & (uncertainty > 2.0 * error)]
        if 4 * len(hidden) > known.sum():
            screen.say(
                f"{title}: the theory's uncertainty exceeds two standard errors at {len(hidden)} of "
                f"{known.sum()} points, {hidden[0]:.4g} <= s <= {hidden[-1]:.4g}; z is small there for "
                "any measurement"
            )


def _say_thermal(screen: Screen, curve: RelaxationCurve) -> None:
    checks, late = curve.equilibrium_checks, curve.not_thermal
    end = f"at s = {curve.s[-1]:.4g}"
    if late:
        told = "; ".join(
            f"{check.quantity} = {check.measured}, at equilibrium {check.expected:.4f} (z = {check.z:+.1f})"
            for check in late
        )
        screen.say(f"not in equilibrium yet {end}: {told}")
    else:
        told = ", ".join(f"{check.quantity} = {check.measured}" for check in checks)
        screen.say(f"{end} this gas is indistinguishable from one in equilibrium: {told}")


def _theory_name(study: Thermalisation, curve: RelaxationCurve, reference: Comparison | None) -> str:
    if reference is None and curve.starts_from_beams:
        return (
            "T_par/T: Boltzmann equation, two beams, dilute gas; "
            "at equilibrium a2 and H - Heq vanish and KS is noise"
        )
    if reference is None:
        return "none for this start; at equilibrium a2 and H - Heq vanish and KS is noise"
    if study.recipe.velocities == "maxwell":
        return "equilibrium at fixed energy"
    name, density = "Boltzmann equation, equal speeds, dilute gas", study.recipe.packing_fraction
    return (
        name if density <= 0.01 else f"{name}; this gas is not dilute, and corrections grow with its density"
    )


def _print(
    screen: Screen,
    study: Thermalisation,
    gas: str,
    curve: RelaxationCurve,
    reference: Comparison | None,
    summary: Mapping[str, Any],
    out: OutputFolder,
) -> None:
    recipe = study.recipe
    screen.say(gas)
    if len(curve.labels) > 1:
        screen.say("species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(curve.labels, 1)))
    screen.say()
    header, rows = _table(curve, reference)
    screen.table("", header, rows)
    screen.say()
    screen.say(f"theory: {summary['theory']}")
    screen.say(f"a2: mean over replicas; KS, H - Heq: all replicas together; {Z_MEANS}")
    screen.say(
        f"H on {curve.h_bins} bins of {summary['h_bin_width']:.4g} thermal speeds; noise at equilibrium: "
        f"a2 {theory.cumulant_noise(summary['particles_in_all'], curve.dim):.1e}, KS "
        f"{summary['ks_floor']:.1e}"
    )
    chi_square = reference.chi_square if reference is not None else None
    if chi_square is not None:
        screen.say(f"a2(s) as a whole against theory, with the covariance of its points: {chi_square}")
    elif reference is not None:
        screen.say(f"a2(s) as a whole: too few replicas for a covariance of {len(curve.s) - 1} points")
    rate = summary["decay_rate"]
    if "value" in rate:
        text = f"decay rate of a2 over 2 <= s <= 5: {Estimate(rate['value'], rate['standard_error'])}"
        if "boltzmann" in rate:
            text += f", Boltzmann equation {Estimate(rate['boltzmann'], rate['boltzmann_error'])}"
            text += f", z = {rate['z']:+.1f}" if math.isfinite(rate.get("z", math.nan)) else ""
        screen.say(text)
    elif recipe.velocities != "maxwell":
        screen.say(f"no decay rate: {rate['reason']}")
    if reference is not None:
        _say_dominant(screen, curve, reference)
    _say_thermal(screen, curve)
    say_checks(screen, summary, out)


def _table(curve: RelaxationCurve, reference: Comparison | None) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of the table of results."""
    header, columns = ["s"], [[f"{s:.4g}" for s in curve.s]]
    for name, title in (("a2", "a2"), ("ks", "KS"), ("h", "H - Heq")):
        values, errors = getattr(curve, name), getattr(curve, f"{name}_error")
        header.append(title)
        columns.append([_estimate(value, error) for value, error in zip(values, errors, strict=True)])
        if reference is not None:
            header += ["theory", "z"]
            columns.append([_number(value) for value in getattr(reference, name)])
            columns.append([f"{z:+.1f}" if math.isfinite(z) else "" for z in getattr(reference, f"{name}_z")])
    if len(curve.labels) > 1:
        both = zip(curve.temperature_by_species.T, curve.temperature_by_species_error.T, strict=True)
        for index, (kT, errors) in enumerate(both, 1):
            header.append(f"T{index}/T")
            columns.append([_estimate(value, error) for value, error in zip(kT, errors, strict=True)])
    if curve.preferred_direction is not None:
        header.append("T_par/T")
        along = curve.temperature_along(curve.preferred_direction)
        columns.append([_estimate(value, error) for value, error in zip(*along, strict=True)])
        beams = _beams(curve)
        if beams is not None:
            header += ["theory", "z"]
            columns.append([_number(value) for value in beams[0]])
            columns.append([f"{z:+.1f}" if math.isfinite(z) else "" for z in beams[2]])
    return header, [list(row) for row in itertools.zip_longest(*columns)]


def _estimate(value: float, error: float) -> str:
    if not math.isfinite(error) or error < 1e-12:  # unknown, or nothing fluctuates
        return f"{value:.4f}"
    return str(Estimate(value, error))


def _number(value: float) -> str:
    if not math.isfinite(value):
        return ""
    return f"{value:.4f}" if value == 0.0 or abs(value) >= 1e-3 else f"{value:.1e}"
