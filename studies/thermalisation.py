"""Thermalisation: relaxation from a state far from equilibrium to Maxwell-Boltzmann, beside theory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.relaxation import Comparison, RelaxationCurve
from analysis.statistics import TheoryCheck, deviates
from hardspheres.files import Reading, read_scene
from hardspheres.gases import RealGas
from studies import real_fluid
from studies.answer import Answer, Column, Curves, heading, number
from studies.fluid import (
    LONGEST,
    Boundary,
    Fluid,
    box_of,
    collisions_at,
    is_dense,
    kind_of,
    two_species,
)
from studies.options import (
    MANY,
    OVER,
    boundary,
    of_labels,
    one_number,
    option,
    own_box,
    positive,
    runs,
    units,
    velocities_are,
    word,
)
from studies.real_fluid import in_units, real_gas_of, remarks_of, scaled, words_of
from studies.recording import Film, Recorder, Trajectory
from studies.running.resuming import until
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.report import OutputFolder
    from studies.viewer.replay import Replay

__all__ = ["RelaxingGas", "Thermalisation", "sampling_points"]

FloatArray = NDArray[np.float64]

RATE, RATE_WINDOW = "decay rate of a2", (2.0, 5.0)
FILM_FRAMES = 120
WATCHED = 400  # particles of the gas to be watched: more and nobody can follow one
AT_EQUILIBRIUM = "at equilibrium a2 and H - Heq vanish and KS is noise"


@dataclass(frozen=True)
class RelaxingGas:
    """A gas and its start.

    Attributes
    ----------
    n, dim, packing_fraction, boundary, temperature
        As in `hardspheres.random_gas`; the first species has diameter 1 and mass 1.
    velocities : str or None
        Word of `hardspheres.draw_velocities`; None keeps those of `base`.
    temperature_ratio : float
        Of "two-temperatures".
    mass_ratio, diameter_ratio : float
        Mass and diameter of the second species over the first's.
    fraction : float
        Number fraction of the second species; without effect when both ratios are 1.
    base : Scene or None
        Positions, radii, masses and box to use instead of making any.
    real : RealGas or None
        The real gas of which it consists, in nm, ps and u.
    """

    n: int = 4000
    dim: int = 3
    packing_fraction: float = 0.005
    boundary: Boundary = "periodic"
    velocities: str | None = "equal-speeds"
    temperature: float = 1.0
    temperature_ratio: float = 3.0
    mass_ratio: float = 1.0
    diameter_ratio: float = 1.0
    fraction: float = 0.5
    base: hs.Scene | None = None
    real: RealGas | None = None

    @property
    def kind(self) -> str:
        """What the engine is compiled for, in words."""
        if self.base is not None:
            return kind_of(self.base)
        return Fluid(self.n, self.dim, 0.0, self.boundary, self.diameter_ratio, self.mass_ratio).kind

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
        if self.real is not None:
            radii, masses = self.real.diameter / 2.0, self.real.mass
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

    def __str__(self) -> str:
        """Return the gas in words."""
        start = self.velocities or "the file's velocities"
        what = f"{self.n} {self.kind}"
        if self.real is not None:
            what = f"{words_of(self.n, self.real)}, {box_of(self.boundary)}"
        return f"{what}, start: {start}"


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
    by_collision = {collisions_at(s, n): s for s in reversed(wanted)}
    return tuple(sorted(by_collision.values()))


def _evenly(end: float, count: int) -> tuple[float, ...]:
    return tuple(float(s) for s in np.linspace(0.0, end, count)) if count > 1 else (0.0,) * count


@dataclass(frozen=True, kw_only=True)
class Thermalisation(Study):
    """Cumulants, KS distance and H against collisions per particle, after a start far from equilibrium."""

    name = "thermalise"
    question = "How does a gas come to Maxwell and Boltzmann's velocities?"
    explanation = """
    Measures the fourth cumulant a2, the Kolmogorov-Smirnov distance and Boltzmann's H against collisions per
    particle, averaged over replicas, beside the Boltzmann equation. Writes a summary, two tables, pictures
    and a trajectory.
    """
    table = "thermalisation"
    files = (
        "thermalisation.csv",
        "relaxation.csv",
        "distributions.png",
        "relaxation.png",
        Trajectory.FILE,
        "gas.html",
        "gas.gif",
    )

    n: int | None = option(None, "Particles in each replica.", at_least=1, shown="4000")
    dim: int | None = option(
        None,
        "Dimension; 2 with --from: it is of discs, whose z differ by at most 1e-6 diameters.",
        at_least=2,
        at_most=3,
        shown="3",
    )
    packing_fraction: float | None = option(None, **one_number, shown="0.005")
    boundary: Boundary | None = option(None, **boundary, shown="periodic")
    velocities: str | None = option(
        None,
        "Initial velocities. maxwell: in equilibrium. equal-speeds: one speed, in all directions. "
        "two-temperatures: half of the particles hotter, or the first species. beams: half of them along one "
        "direction, half against it.",
        shown="equal-speeds",
        **word("--velocities", "maxwell", "equal-speeds", "two-temperatures", "beams"),
    )
    gas: str | None = real_fluid.gas()
    temperature: float | None = option(
        None, "kT of the gas; with --gas its temperature in kelvin.", shown="1, 273.15 with --gas"
    )
    pressure: float | None = real_fluid.pressure()
    diameter: str | float | None = real_fluid.diameter()
    temperature_ratio: float | None = option(
        None,
        "With --velocities two-temperatures: kT of the hot over that of the cold.",
        shown="3",
        **positive("--temperature-ratio", "kT of the hot particles over that of the cold ones"),
    )
    mass_ratio: float | None = option(
        None, f"Mass {OVER}.", shown="one species", **positive("--mass-ratio", f"the mass {OVER}")
    )
    diameter_ratio: float | None = option(
        None, f"Diameter {OVER}.", shown="one species", **positive("--diameter-ratio", f"the diameter {OVER}")
    )
    fraction: float | None = option(
        None, "Number fraction of the second species.", at_least=0.0, at_most=1.0, shown="0.5"
    )
    collisions_per_particle: float = option(10.0, "How long to run, s = 2 collisions / n.")
    replicas: int = runs(100)
    source: str | None = option(None, "Start from a file of any format of ASE, or .gsd.", flag="--from")
    radius: float | dict[str, float] | None = option(None, **of_labels("--radius"))
    mass: float | dict[str, float] | None = option(None, **of_labels("--mass"))
    units: str | None = units("--from")
    velocities_are: str | None = velocities_are("--from")
    box: tuple[float, ...] | None = own_box("--from")
    frames: int = option(
        21, "Frames in trajectory.xyz, of the first replica.", at_least=0, at_most=MANY, metavar="NUMBER"
    )
    animate: bool = option(False, "Write gas.gif, the first replica in motion.")
    structure: hs.Scene | None = field(default=None, repr=False)  # what --from names, once it is read

    def prepared(self, say: Callable[[str], object]) -> Thermalisation:
        """Return the study with its file read; with velocities in the file it has one replica."""
        self._refuse()
        if self.source is None or self.structure is not None:
            return self
        units, drawn = self.units or self.velocities_are, self.velocities is not None
        reading = Reading(self.radius, self.mass, units, self.box, self.boundary, self.dim, not drawn)
        scene, remarks = read_scene(self.source, reading)
        alone = not drawn and bool(np.any(scene.velocities))
        if alone and self.temperature is not None:
            raise hs.SceneError(
                f"{self.source} has velocities; --temperature needs --velocities to draw others"
            )
        for remark in remarks:
            say(f"{self.source}: {remark}")
        if alone:
            say("the file has velocities, so all replicas would be the same: running one, without error bars")
        return replace(self, structure=scene, replicas=1 if alone else self.replicas)

    def _refuse(self) -> None:
        """Raise SceneError for options that make no sense together."""
        length = self.collisions_per_particle
        _require(
            0.0 < length <= LONGEST,
            f"--collisions-per-particle {length:g} must be positive, and at most {LONGEST:g}",
        )
        _require(
            self.temperature_ratio is None or self.velocities == "two-temperatures",
            "--temperature-ratio goes with --velocities two-temperatures",
        )
        self._real()
        if self.source is None:
            for name in ("radius", "mass", "units", "velocities_are", "box"):
                said = f"--{name.replace('_', '-')} goes with --from"
                _require(
                    getattr(self, name) is None, f"{said}; the spheres made here have diameter 1 and mass 1"
                )
            two = self.mass_ratio is not None or self.diameter_ratio is not None
            _require(two or self.fraction is None, "--fraction needs --mass-ratio or --diameter-ratio")
            return
        of_made = ["n", "packing_fraction", "mass_ratio", "diameter_ratio", "fraction"]
        for name in of_made if self.box is not None else [*of_made, "boundary"]:
            said = f"--{name.replace('_', '-')} has no effect with --from"
            _require(getattr(self, name) is None, f"{said}, which gives the whole structure")

    def _real(self) -> RealGas | None:
        return real_gas_of(self, own=("pressure", "diameter"))  # --temperature has a meaning without --gas

    def gases(self) -> list[RelaxingGas]:
        """Return the gas."""
        scene = self.prepared(lambda remark: None).structure
        given: dict[str, Any] = {
            each.name: value
            for each in fields(RelaxingGas)
            if (value := getattr(self, each.name, None)) is not None
        }
        if scene is not None:
            given |= {name: getattr(scene, name) for name in ("n", "dim", "packing_fraction", "boundary")}
            given["base"] = scene
            if self.velocities is None and np.any(scene.velocities):
                given["velocities"] = None
        if (real := self._real()) is not None:
            given |= {"packing_fraction": real.packing_fraction, "temperature": real.kT, "real": real}
        return [RelaxingGas(**given)]

    def estimators(self, gas: RelaxingGas, simulation: hs.Simulation) -> dict[str, Any]:
        """Return the relaxation curve."""
        return {"curve": RelaxationCurve()}

    def recorders(self, gas: RelaxingGas) -> dict[str, Recorder]:
        """Return the trajectory and the film, as asked for."""
        wanted: dict[str, Recorder] = {"trajectory": Trajectory()} if self.frames > 0 else {}
        return wanted | ({"film": Film()} if self.animate else {})

    def advance(self, gas: RelaxingGas, replica: Replica) -> Iterator[None]:
        """Run on, and let each estimator and recorder look at its own values of s."""
        simulation, end = replica.simulation, self.collisions_per_particle
        moments = {
            "curve": sampling_points(end, gas.n),
            "trajectory": _evenly(end, self.frames),
            "film": _evenly(end, FILM_FRAMES),
        }
        looks = {name: set(moments[name]) for name in replica.estimators}
        for s in sorted(set().union(*looks.values()))[replica.done :]:
            yield from until(simulation, collisions_at(s, gas.n))
            frame = simulation.frame()
            for name, own in looks.items():
                if s in own:
                    replica.estimators[name].add(frame)
            replica.done += 1
            yield
        replica.seen["box"] = simulation.scene.box.tolist()

    def answer(self, gas: RelaxingGas, replicas: Sequence[Replica]) -> Answer:
        """Return the decay rate of a2, the end beside equilibrium, and all curves."""
        curve = RelaxationCurve()
        for replica in replicas:
            curve.merge(replica.estimators["curve"])
        reference, end = _reference(gas, curve), float(curve.s[-1])
        late = [check.quantity for check in curve.not_thermal]
        numbers = [
            replace(check, quantity=f"{check.quantity} at s = {end:.4g}")
            for check in curve.equilibrium_checks
        ]
        rate, main = _rate(curve), None
        if isinstance(rate, TheoryCheck):
            numbers.insert(0, rate)
            if gas.real is not None:
                numbers[1:1] = in_units([_rate_in_time(rate, curve, gas.real)])
        else:
            main = f"a {RATE}, and there is none: {rate}"
        if gas.velocities is None:
            main = "replicas that differ, and the file's velocities make one; add --velocities to draw others"
        beside, axes, notes = _beside(curve), {"s": curve.s}, _notes(gas, curve, reference, rate)
        if gas.real is not None:
            axes["time [ps]"] = beside.pop("time")
            notes[:0] = remarks_of(gas.real)
        chi_square = reference.chi_square if reference is not None else None
        all_particles = curve.n_replicas * curve.n_per_replica
        return Answer(
            gas,
            numbers,
            {"relaxation": Curves(axes, _columns(curve, reference), True, beside)},
            notes,
            main=main,
            details={
                "start": gas.velocities or "file",
                "placement": gas.placement,
                "boundary": gas.boundary,
                "box": replicas[0].seen["box"],
                "species": curve.labels,
                "particles_in_all": all_particles,
                "theory": _theory_name(gas, curve, reference),
                "a2_chi_square": None if chi_square is None else asdict(chi_square),
                "decay_rate_window": RATE_WINDOW,
                "thermal": {"s": end, "passed": not late, "not_yet": late},
                "equilibrium_a2": float(theory.equilibrium_a2(curve.degrees_of_freedom)),
                "a2_noise": theory.cumulant_noise(all_particles, curve.dim),
                "ks_floor": theory.ks_floor(all_particles, curve.dim),
                "h_bins": curve.h_bins,
                "h_bin_width": theory.SPEED_LIMIT[curve.dim] / curve.h_bins,
            },
            hidden={"curve": curve, "reference": reference},
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the columns are, and which theory it is."""
        found = answers[0].details
        species = "; ".join(f"{k}: {label}" for k, label in enumerate(found["species"], 1))
        told = [f"species: {species}"] if len(found["species"]) > 1 else []
        told.append(f"theory: {found['theory']}")
        rate = f"; decay rate: mean over {RATE_WINDOW[0]:g} <= s <= {RATE_WINDOW[1]:g}"
        told.append(
            "a2: mean over replicas; KS, H - Heq: all replicas together"
            f"{rate if answers[0].numbers[0].quantity == RATE else ''}"
        )
        told.append(
            f"H on {found['h_bins']} bins of {found['h_bin_width']:.4g} thermal speeds; noise at "
            f"equilibrium: a2 {found['a2_noise']:.1e}, KS {found['ks_floor']:.1e}"
        )
        return told

    def figures(self, answers: Sequence[Answer]) -> Mapping[str, Figure]:
        """Return histograms of speeds, and the relaxation."""
        from studies.figures.thermalisation import distributions, relaxation

        return {"distributions": distributions(answers[0]), "relaxation": relaxation(answers[0])}

    def show(self, recorders: Mapping[str, Any], answers: Sequence[Answer], out: OutputFolder) -> None:
        """Put the trajectory in its place, and draw the film."""
        if "trajectory" in recorders:
            out.adopt(out.checkpoints / Trajectory.FILE)
        if "film" in recorders:
            from studies.figures.thermalisation import animation

            first = answers[0].gas.scene(np.random.SeedSequence(self.seed, spawn_key=(0,)))
            with out.partial("gas.gif") as path:
                animation(recorders["film"], first, answers[0], path, heading(answers, self.replicas))

    def replay(self) -> Replay | None:
        """Return a gas of this kind with few particles, or a small --from itself; None of a large one."""
        from studies.viewer.replay import replay_by_steps

        gas = self.gases()[0]
        if gas.base is None:
            gas = replace(gas, n=min(gas.n, WATCHED))
        try:
            scene = gas.scene(np.random.SeedSequence(self.seed, spawn_key=(0,)))
            return replay_by_steps(scene) if gas.n <= 2 * WATCHED else None
        except hs.HardSpheresError:  # the few have no room, or do not collide
            return None


def _require(condition: bool, sentence: str) -> None:
    if not condition:
        raise hs.SceneError(sentence)


def _reference(gas: RelaxingGas, curve: RelaxationCurve) -> Comparison | None:
    """Return the theory that applies to this start, None where there is none at every s."""
    if curve.starts_from_equal_speeds:
        return curve.compare()
    if gas.velocities == "maxwell":
        return curve.compare("equilibrium")
    return None


def _columns(curve: RelaxationCurve, reference: Comparison | None) -> dict[str, Column]:
    """Return all curves against s."""
    columns = {}
    for name, title in (("a2", "a2"), ("ks", "KS"), ("h", "H - Heq")):
        known: dict[str, Any] = {}
        if reference is not None:
            known = {"theory": getattr(reference, name), "z": getattr(reference, f"{name}_z")}
            known |= {"uncertainty": getattr(reference, f"{name}_uncertainty"), "brief": True}
        columns[name] = Column(getattr(curve, name), getattr(curve, f"{name}_error"), title=title, **known)
    columns["a3"] = Column(curve.a3, curve.a3_error, printed=False)
    if len(curve.labels) > 1:
        both = zip(curve.temperature_by_species.T, curve.temperature_by_species_error.T, strict=True)
        for index, (kT, error) in enumerate(both):
            columns[f"temperature_{index + 1}"] = Column(kT, error, title=f"T{index + 1}/T")
    if curve.preferred_direction is not None:
        along = curve.temperature_along(curve.preferred_direction)
        columns["temperature_parallel"] = Column(*along, **_beams(curve), title="T_par/T", brief=True)
    return columns


def _beside(curve: RelaxationCurve) -> dict[str, FloatArray]:
    """Return what has no error bar, against s."""
    found = {"time": curve.time}
    found |= {f"temperature_{axis}": kT for axis, kT in zip("xyz", curve.temperature_by_axis.T, strict=False)}
    if len(curve.labels) > 1:
        found |= {f"a2_{kind}": a2 for kind, a2 in enumerate(curve.a2_by_species.T, 1)}
    return found


def _beams(curve: RelaxationCurve) -> dict[str, Any]:
    """Return T_par/T of two beams in theory, its uncertainty, and z; nothing after another start."""
    direction = curve.preferred_direction
    if direction is None or not curve.starts_from_beams:
        return {}
    known = curve.s <= 7.0
    table = theory.boltzmann_beams(np.where(known, curve.s, 0.0), curve.dim)
    expected = np.where(known, 1.0 + table.anisotropy, np.nan)
    value, error = curve.temperature_along(direction)
    apart = np.where(curve.s > 0.0, value - expected, np.nan)
    freedom = curve.n_replicas - 1.0 if curve.n_replicas > 1 else math.inf
    uncertainty = np.hypot(table.anisotropy_error, table.lag)
    return {"theory": expected, "uncertainty": uncertainty, "z": deviates(apart, error, uncertainty, freedom)}


def _rate(curve: RelaxationCurve) -> TheoryCheck | str:
    """Return the decay rate of a2 beside theory, or the reason why there is none."""
    try:
        rate = curve.fit_rate(RATE_WINDOW)
    except ValueError as error:
        return str(error)
    if not curve.starts_from_equal_speeds:
        return number(RATE, rate)
    expected = theory.equal_speeds_decay_rate(curve.dim, RATE_WINDOW)
    return number(RATE, rate, "Boltzmann equation", expected)


def _rate_in_time(rate: TheoryCheck, curve: RelaxationCurve, gas: RealGas) -> TheoryCheck:
    """Return the decay rate of a2 in time: that per collision, times the collision rate in the window.

    That of theory is Enskog's in equilibrium, which a2 changes by -a2/16 of itself: less than 1 % on average.
    """
    begin, end = np.interp(RATE_WINDOW, curve.s, curve.time)
    collisions = (RATE_WINDOW[1] - RATE_WINDOW[0]) / float(end - begin)
    expected = float(theory.collision_rate(gas.packing_fraction, 3, gas.diameter, gas.mass, gas.kT))
    found = scaled(rate, f"{rate.quantity} in time", collisions, expected)
    return replace(found, uncertainty=math.hypot(found.uncertainty, 0.01 * found.expected))


def _theory_name(gas: RelaxingGas, curve: RelaxationCurve, reference: Comparison | None) -> str:
    if reference is None and curve.starts_from_beams:
        return f"T_par/T: Boltzmann equation, without what parallel beams remember; {AT_EQUILIBRIUM}"
    if reference is None:
        return f"none for this start; {AT_EQUILIBRIUM}"
    if gas.velocities == "maxwell":
        return "equilibrium at fixed energy"
    name = "Boltzmann equation, equal speeds, dilute gas"
    if gas.packing_fraction <= 0.01:
        return name
    return f"{name}; this gas is not dilute, and corrections grow with its density"


def _notes(
    gas: RelaxingGas, curve: RelaxationCurve, reference: Comparison | None, rate: TheoryCheck | str
) -> list[str]:
    """Return what the curves say as a whole, and how far the gas has come."""
    notes = []
    if reference is not None and reference.chi_square is not None:
        notes.append(
            f"a2(s) as a whole against theory, with the covariance of its points: {reference.chi_square}"
        )
    elif reference is not None:
        notes.append(f"a2(s) as a whole: too few replicas for a covariance of {len(curve.s) - 1} points")
    if isinstance(rate, str) and gas.velocities != "maxwell":
        notes.append(f"no decay rate: {rate}")
    end, late = f"at s = {curve.s[-1]:.4g}", [check.quantity for check in curve.not_thermal]
    if late:
        notes.append(f"not in equilibrium yet {end}: {', '.join(late)}")
    else:
        notes.append(f"{end} this gas is indistinguishable from one in equilibrium")
    return notes
