"""A drop: balls that are let fall into a box come to Maxwell and Boltzmann's velocities."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.barometer import SAME_SIZE
from analysis.reduced import species_labels
from analysis.statistics import Estimate, estimate_from_replicas, replica_mean
from analysis.theory import Prediction
from studies import options
from studies.answer import Answer, Column, Curves, alarms, number
from studies.atmosphere import Atmosphere
from studies.fluid import Fluid, check_spread, number_fraction
from studies.options import dimension, one_number, option, particles, positive, runs, word
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.viewer.replay import Replay

__all__ = ["Drop"]

FloatArray = NDArray[np.float64]

FEWEST = 16  # particles
EARLY, FALLS = 24, 2.0  # moments within the first two falls
LATE, SETTLED = (
    45,
    3.0,
)  # moments after them, for so many times of settling, the last third of which is the end
WATCHED, SHOWN = 60, 12.0  # particles in gas.html, collisions per particle there
HIGH = "the height of the box over kT/(m g) at the end, about"


@dataclass
class Fall:
    """What one gas has given: rows of energies at each moment."""

    kinetic: list[FloatArray] = field(default_factory=list)  # of each species and axis, (k, d), m v^2 / 2
    cumulants: list[float] = field(default_factory=list)  # a2
    heights: list[FloatArray] = field(default_factory=list)  # mean of each species, (k,)
    collisions: list[float] = field(default_factory=list)  # per particle

    def add(self, frame: hs.Frame) -> None:
        """Take in a frame."""
        scene, v = frame.scene, frame.velocities
        energies = 0.5 * scene.masses[:, None] * v * v
        kinds = range(int(scene.species.max()) + 1)
        self.kinetic.append(np.array([energies[scene.species == k].sum(axis=0) for k in kinds]))
        above = frame.positions[:, -1] - scene.radii
        self.heights.append(np.array([above[scene.species == k].mean() for k in kinds]))
        total = energies.sum(axis=1)
        ratio = float((total**2).mean() / total.mean() ** 2) if total.any() else math.nan
        self.cumulants.append(scene.dim / (scene.dim + 2) * ratio - 1.0)
        self.collisions.append(frame.collisions_per_particle)


@dataclass(frozen=True, kw_only=True)
class Drop(Study):
    """Balls at rest, spread through a tall box, are let fall."""

    name = "drop"
    question = "How do balls that are let fall come to Maxwell and Boltzmann's velocities?"
    explanation = """
    Balls at rest in a tall box are let fall; nothing is lost when they bounce and collide. Kinetic energy
    along and across gravity and of each species, mean heights and the fourth cumulant against time, up to
    equilibrium, whose temperature and heights follow from the energy at the start. Writes a summary, two
    tables, a picture and a page with a small gas to be watched.
    """
    table = "drop"
    files = ("drop.csv", "fall.csv", "drop.png", "gas.html")

    packing_fraction: float = option(0.02, **one_number)
    n: int = particles(400)
    dim: int = dimension()
    boundary: str = option("wall", "Of the sides of the box.", **word("--boundary", "periodic", "wall"))
    diameter_ratio: float = options.diameter_ratio()
    mass_ratio: float = options.mass_ratio(4.0)
    fraction: float | None = options.fraction()
    scale_heights: float = option(
        5.0, "Height of the box, in kT/(m g) at the end, about.", **positive("--scale-heights", HIGH)
    )
    replicas: int = runs(20)

    def gases(self) -> list[Atmosphere]:
        """Return the one gas."""
        share = number_fraction(self.fraction, self.diameter_ratio, self.mass_ratio)
        if self.n < FEWEST:
            raise hs.SceneError(f"--n {self.n} is too few for a temperature; ask for at least {FEWEST}")
        check_spread(self.replicas)
        return [self._gas(self.n, share)]

    def _gas(self, n: int, share: float) -> Atmosphere:
        sides = (*[self.boundary] * (self.dim - 1), "wall")
        fluid = Fluid(n, self.dim, self.packing_fraction, sides, self.diameter_ratio, self.mass_ratio, share)
        gas = Atmosphere(fluid, self.scale_heights, at_rest=True)
        gas.check()
        return gas

    def fall(self, gas: Atmosphere) -> float:
        """Return how long a ball falls from lid to floor."""
        return math.sqrt(2.0 * float(gas.box[-1]) / gas.g)

    def moments(self, gas: Atmosphere) -> list[float]:
        """Return when to measure."""
        early = FALLS * self.fall(gas) * np.arange(EARLY + 1) / EARLY
        late = early[-1] + SETTLED * gas.settling * np.arange(1, LATE + 1) / LATE
        return [*early.tolist(), *late.tolist()]

    def estimators(self, gas: Atmosphere, simulation: hs.Simulation) -> dict[str, Any]:
        """Return what measures it."""
        return {"fall": Fall()}

    def advance(self, gas: Atmosphere, replica: Replica) -> Iterator[None]:
        """Let it fall."""
        for frame in replica.simulation.frames(times=self.moments(gas)[replica.done :]):
            if replica.done == 0:
                replica.seen["energy"] = frame.scene.potential_energy
                replica.seen["species"] = species_labels(frame)
            replica.estimators["fall"].add(frame)
            replica.done += 1
            yield

    def answer(self, gas: Atmosphere, replicas: Sequence[Replica]) -> Answer:
        """Return energies against time, and what the end is like."""
        falls = [replica.estimators["fall"] for replica in replicas]
        kinetic = np.array([one.kinetic for one in falls])  # (replica, moment, species, axis)
        freedom = _freedom(gas)
        end, uncertainty = self._ends(gas, replicas)
        kinetic *= 2.0 / end[:, None, None, None]

        def temperature(*part: Any) -> FloatArray:
            return np.asarray(kinetic[:, :, *part].sum(axis=(2, 3)) / freedom[*part].sum())

        every, one_axis, others = slice(None), slice(-1, None), slice(0, -1)
        along, across, whole = (
            temperature(every, one_axis),
            temperature(every, others),
            temperature(every, every),
        )
        kinds = [temperature(slice(k, k + 1), every) for k in range(len(freedom))]
        a2 = np.array([one.cumulants for one in falls])
        thermal = float(theory.equilibrium_a2(freedom.sum()))
        fixed = abs(thermal) * (0.0 if self.boundary == "wall" else 0.1)  # of momenta that do not change
        numbers = [
            number(
                "kT at the end, over theory's", _end(whole), "from the energy", Prediction(1.0, uncertainty)
            ),
            number("kT along gravity over across", _end(along, across), "equilibrium", 1.0),
        ]
        if len(kinds) > 1:
            ratio = _end(kinds[1], kinds[0])
            numbers.append(number("kT of species 2 over 1", ratio, "equilibrium", 1.0))
        numbers.append(number("a2 at the end", _end(a2), "Maxwell-Boltzmann", Prediction(thermal, fixed)))
        columns = {
            "along": Column(*replica_mean(along), title="kT along"),
            "across": Column(*replica_mean(across), title="across"),
        }
        heights = np.array([one.heights for one in falls])
        for k, kind in enumerate(kinds):
            tail = f"_{k + 1}" if len(kinds) > 1 else ""
            if tail:
                columns[f"temperature{tail}"] = Column(*replica_mean(kind), title=f"kT {k + 1}")
            title = f"z{tail}".replace("_", " ")
            columns[f"height{tail}"] = Column(*replica_mean(heights[:, :, k]), title=title)
        columns["a2"] = Column(*replica_mean(a2))
        axes = {
            "t": np.array(self.moments(gas)) / self.fall(gas),
            "s": np.mean([one.collisions for one in falls], axis=0),
        }
        return Answer(
            gas,
            numbers,
            {"fall": Curves(axes, columns, printed=True)},
            failures=alarms(numbers),
            details={"species": replicas[0].seen["species"], "fall_time": self.fall(gas), "g": gas.g},
        )

    def _ends(self, gas: Atmosphere, replicas: Sequence[Replica]) -> tuple[FloatArray, float]:
        """Return the temperature of the end in theory for each replica, and its relative uncertainty."""
        known = gas.theory
        energies = [known.temperature(replica.seen["energy"]) for replica in replicas]
        mean = float(np.mean(energies))
        wrong = [each.uncertainty for each in known.mean_heights(np.linspace(0.0, known.height, 21), mean)]
        missed = float(np.dot(np.multiply(known.counts, known.weights), wrong)) / (0.5 * known.freedom * mean)
        if np.ptp(gas.sizes_and_masses[0]) > SAME_SIZE:
            missed += gas.packing_fraction  # the theory is of equal diameters
        shift = known.kinetic_temperature(mean) / mean
        return shift * np.array(energies), missed

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the columns are."""
        labels = answers[0].details["species"]
        which = [f"species, {k}: {label}" for k, label in enumerate(labels, 1)] if len(labels) > 1 else []
        columns = (
            "t: time over that of a fall from lid to floor; s: collisions per particle; kT: of all along and "
            "across gravity, and of each species, over that of the end in theory; z: mean height"
        )
        end = (
            "end: mean over the last moments; its temperature in theory follows from the energy at the start"
        )
        return [*which, columns, end, "errors from the spread of the replicas"]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return temperatures, heights and a2 against time."""
        from studies.figures.drop import figure

        return figure(answers[0])

    def replay(self) -> Replay | None:
        """Return a few balls that are let fall, to be watched; None where they have no room."""
        from studies.viewer.replay import replay_by_steps

        share = self.gases()[0].fluid.fraction
        try:
            gas = self._gas(min(self.n, WATCHED), share)
            return replay_by_steps(gas.scene(np.random.SeedSequence(self.seed, spawn_key=(0,))), SHOWN)
        except hs.HardSpheresError:
            return None


def _freedom(gas: Atmosphere) -> FloatArray:
    """Return degrees of freedom of the species along each axis, (k, d), less fixed momenta."""
    radii, masses = gas.sizes_and_masses
    second = (radii != radii[0]) | (masses != masses[0])
    fixed = np.array([word == "periodic" for word in gas.fluid.boundary])
    groups = [~second, second] if second.any() else [~second]
    return np.array([own.sum() - fixed * masses[own].sum() / masses.sum() for own in groups])


def _end(values: FloatArray, over: FloatArray | None = None) -> Estimate:
    """Return the mean of (replica, moment) at the end, or its ratio to another mean there."""
    late = values[:, -(LATE // 3) :].mean(axis=1)
    return estimate_from_replicas(late if over is None else late / over[:, -(LATE // 3) :].mean(axis=1))
