"""A fluid under gravity: densities, temperatures and weight at all heights, forces on floor and lid."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis.estimator import PALETTE, ReplicaEstimator, axes_or_new, labelled, tallies_of
from analysis.reduced import Gas
from analysis.statistics import Estimate, TheoryCheck, estimate_from_replicas, replica_mean
from analysis.theory.barometer import Barometer
from analysis.theory.prediction import Prediction, packing_fraction
from analysis.theory.state import compressibility_factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["HeightProfile", "barometer_of"]

FloatArray = NDArray[np.float64]

ENOUGH = 300.0  # particles seen in a slice
SAME_SIZE = 1e-6  # relative difference of diameters below which theory takes them for equal


@dataclass
class _Run:
    """What one replica has given: sums over its frames, and what it was at the first and the last of them."""

    energy: float  # of the start, kinetic and potential
    counts: FloatArray  # (k, slices)
    energies: FloatArray  # (k, slices), m v^2
    shares: FloatArray  # (k, slices), of the slice that is below the particles in it
    heights: FloatArray  # (k,)
    time: list[float] = field(default_factory=list)
    impulses: list[FloatArray] = field(default_factory=list)  # (2,), on floor and lid until then
    momentum: list[float] = field(default_factory=list)  # along gravity
    frames: int = 0


def barometer_of(
    box: FloatArray,
    periodic: NDArray[np.bool_],
    counts: NDArray[np.int64],
    weights: FloatArray,
    diameters: FloatArray,
    freedom: float,
    axis: int,
) -> Barometer | None:
    """Return the theory of a gas that falls along an axis of its box; None where diameters differ."""
    if np.ptp(diameters) > SAME_SIZE * diameters[0]:
        return None
    across = np.arange(len(box)) != axis
    room = box[across] - diameters[0] * ~periodic[across]
    return Barometer(
        counts=tuple(counts.tolist()),
        weights=tuple(weights.tolist()),
        area=float(np.prod(room)),
        height=float(box[axis] - diameters[0]),
        diameter=float(diameters[0]),
        dim=len(box),
        freedom=float(freedom),
        sides=float((2.0 * ~periodic[across] / room).sum()),
    )


class HeightProfile(ReplicaEstimator):
    """Density and temperature of each species against height, and the weight above, of gases under gravity.

    Heights are those of centres above where they touch the floor, the wall that gravity pulls to. Slices
    divide what centres of a species can reach. Theory: `theory.Barometer`, of a fluid of one diameter.

    Parameters
    ----------
    cells : int, default 24
        Slices of equal height.

    Notes
    -----
    Take frames at times that are independent of the collisions, such as ``sim.frames(every=...)``; those of
    one replica in order, then those of the next.
    """

    def __init__(self, cells: int = 24) -> None:
        super().__init__()
        if cells < 2:
            raise ValueError(f"cells = {cells}; a profile has at least 2")
        self.cells = cells
        self._axis, self._pull = 0, 0.0

    def add(self, frame: Frame) -> Self:
        """Take in the next frame of this replica, or the first of another.

        Raises
        ------
        ValueError
            If there is no gravity, or along several axes, or the frame is of another gas.
        """
        scene = frame.scene
        along = np.flatnonzero(scene.gravity)
        if len(along) != 1:
            raise ValueError("the gas needs gravity along one axis, towards one wall")
        tallies = tallies_of(frame)
        energy = 0.0
        if self._begins(frame.time, "time"):
            energy = scene.kinetic_energy + scene.potential_energy
            # of what is conserved: the temperature of the start is not yet that of equilibrium
            its = replace(Gas.of(scene), temperature=2.0 * energy / scene.degrees_of_freedom)
            if self._gas is None:
                self._gas, self._axis = its, int(along[0])
                self._pull = float(scene.gravity[self._axis])
            elif difference := self._gas.difference(its).replace(
                "temperature", "energy per degree of freedom"
            ):
                raise ValueError(f"the frame is of another gas: {difference}")
            elif scene.gravity[self._axis] != self._pull:
                raise ValueError("the frame is of a gas with another gravity")
        elif scene.n != self.gas.n:
            raise ValueError(f"frame has {scene.n} particles; expected {self.gas.n}, as in the first")
        axis, species = self._axis, scene.species
        impulses = tallies.wall_impulses[axis, :: 1 if self._pull < 0.0 else -1]
        momentum = float(scene.masses @ frame.velocities[:, axis]) * float(np.sign(self._pull))
        shape = (len(self.gas.sizes), self.cells)

        def begun() -> _Run:
            return _Run(energy, np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape[0]))

        run: _Run = self._continued(frame.time, "time", begun)
        run.time[1:], run.impulses[1:], run.momentum[1:] = [frame.time], [impulses.copy()], [momentum]
        above = self._above(frame)
        place = above / self._reach()[species] * self.cells
        which = np.clip(place.astype(np.int64), 0, self.cells - 1)
        at = species * self.cells + which
        energies = scene.masses * np.sum(frame.velocities**2, axis=1)
        for sums, weights in (
            (run.counts, np.ones(scene.n)), (run.energies, energies), (run.shares, place - which)
        ):  # fmt: skip
            sums += np.bincount(at, weights, minlength=shape[0] * shape[1]).reshape(shape)
        run.heights += np.bincount(species, above, minlength=shape[0])
        run.frames += 1
        return self

    def _above(self, frame: Frame) -> FloatArray:
        """Return heights above the floor, (N,)."""
        scene, axis = frame.scene, self._axis
        here = frame.positions[:, axis]
        return np.asarray((here if self._pull < 0.0 else scene.box[axis] - here) - scene.radii)

    def _reach(self) -> FloatArray:
        """Return the height that centres of each species can reach, (k,)."""
        return np.asarray(self.gas.box[self._axis] - self.gas.diameters)

    @property
    def gas(self) -> Gas:
        """The gas, of the first frame."""
        self._require(self._gas is not None, "frames", "add(frame)")
        assert self._gas is not None
        return self._gas

    def _runs(self) -> list[_Run]:
        runs: list[_Run] = [run for run in self._replicas if len(run.time) > 1]
        self._require(bool(runs), "profile", "add(frame) with two frames of a gas")
        return runs

    def _take_in(self, other: Self) -> None:
        super()._take_in(other)
        self._axis, self._pull = other._axis, other._pull

    # Results ------------------------------------------------------------------------------------------------

    @property
    def edges(self) -> FloatArray:
        """Edges of the slices of each species, (k, cells + 1), [length] above its contact with the floor."""
        return np.asarray(self._reach()[:, None] * np.linspace(0.0, 1.0, self.cells + 1))

    @property
    def heights(self) -> FloatArray:
        """Middles of the slices, (k, cells)."""
        return np.asarray((self.edges[:, 1:] + self.edges[:, :-1]) / 2.0)

    @property
    def weights(self) -> FloatArray:
        """Weight m g of one particle of each species, (k,)."""
        return np.asarray(self.gas.masses * abs(self._pull))

    def _area(self) -> FloatArray:
        """Return the cross-section that centres of each species can reach, (k,)."""
        gas, across = self.gas, np.arange(self.gas.dim) != self._axis
        walls = np.where(gas.periodic[across], 0.0, 1.0)
        return np.asarray(np.prod(gas.box[across] - walls * gas.diameters[:, None], axis=1))

    def _freedom(self) -> FloatArray:
        """Return degrees of freedom of one particle of each species, (k,), less its share of momenta."""
        gas = self.gas
        return np.asarray(gas.dim - gas.periodic.sum() * gas.masses / float(gas.sizes @ gas.masses))

    @property
    def densities(self) -> tuple[FloatArray, FloatArray]:
        """Number density of each species and its standard error, (k, cells) each, over replicas."""
        volume = self._area()[:, None] * np.diff(self.edges, axis=1)
        return replica_mean([run.counts / run.frames / volume for run in self._runs()])

    @property
    def temperatures(self) -> tuple[FloatArray, FloatArray]:
        """Temperature of each species in each slice and its standard error, (k, cells) each.

        Sum of m v^2 over the degrees of freedom of those that were there; NaN where nobody was in a replica.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            return replica_mean(
                [run.energies / (run.counts * self._freedom()[:, None]) for run in self._runs()]
            )

    @property
    def mean_heights(self) -> list[Estimate]:
        """Mean height of each species, [length]."""
        each = np.array([run.heights / run.frames / self.gas.sizes for run in self._runs()])
        return [estimate_from_replicas(column) for column in each.T]

    @property
    def support(self) -> list[float]:
        """Force on the floor less that on the lid and the change of momentum, over the weight, less 1.

        For each replica: 0 to rounding, at any density and from any start.
        """
        found = []
        for run in self._runs():
            floor, lid = self._forces(run)
            change = (run.momentum[-1] - run.momentum[0]) / (run.time[-1] - run.time[0]) / self._weight()
            found.append(float(floor - lid + change - 1.0))
        return found

    @property
    def forces(self) -> list[Estimate]:
        """Forces on the floor and on the lid, over the weight."""
        each = np.array([self._forces(run) for run in self._runs()])
        return [estimate_from_replicas(column) for column in each.T]

    def _forces(self, run: _Run) -> FloatArray:
        """Return forces on floor and lid over the weight, (2,)."""
        lasted = run.time[-1] - run.time[0]
        return np.asarray((run.impulses[-1] - run.impulses[0]) / (lasted * self._weight()))

    def _weight(self) -> float:
        return float(self.weights @ self.gas.sizes)

    @property
    def pressures(self) -> tuple[FloatArray, FloatArray]:
        """Pressure in each slice and its standard error, (cells,): weight above and force on the lid.

        Over the cross-section that centres can reach; of a fluid of one diameter.
        """
        return replica_mean(self._pressure_rows())

    def _pressure_rows(self) -> list[FloatArray]:
        area = float(self._area().mean())
        rows = []
        for run in self._runs():
            lid = self._forces(run)[1] * self._weight()
            own = self.weights @ run.shares / run.frames
            all_of = self.weights @ run.counts / run.frames
            rows.append((lid + all_of[::-1].cumsum()[::-1] - all_of + own) / area)
        return rows

    @property
    def state(self) -> tuple[FloatArray, FloatArray, Prediction]:
        """Z from the weight: pressure over n kT, its standard error, and theory, (cells,) each.

        Theory is the equation of state at the measured density, times what an average over a slice changes.
        """
        volume = self._area()[0] * np.diff(self.edges[0])
        pressures, densities = (
            self._pressure_rows(),
            [run.counts.sum(axis=0) / run.frames for run in self._runs()],
        )
        kt = self._kinetic_temperature()
        with np.errstate(invalid="ignore", divide="ignore"):
            rows = [
                p * volume / np.where(n > 0.0, n * kt, np.nan)
                for p, n in zip(pressures, densities, strict=True)
            ]
        value, error = replica_mean(rows)
        known, gas = self.theory, self.gas
        if known is None:
            return value, error, Prediction(np.full(self.cells, np.nan), np.full(self.cells, np.nan))
        per = float(packing_fraction(1.0, gas.diameters[0], gas.dim))
        mean, law = self.densities[0].sum(axis=0) * per, known.bulk(self.edges[0], self.temperature)
        here = compressibility_factor(np.minimum(mean, 0.66 if gas.dim == 2 else 0.494), gas.dim)
        at_law = compressibility_factor(law[0] * per, gas.dim).value
        ratio = law[1] / (law[0] * self.temperature * at_law)
        return value, error, Prediction(here.value * ratio, here.uncertainty)

    def _kinetic_temperature(self) -> float:
        """Return the mean temperature of all."""
        energies = sum(float(run.energies.sum()) / run.frames for run in self._runs())
        return energies / len(self._runs()) / float(self._freedom() @ self.gas.sizes)

    @property
    def upper_over_lower(self) -> Estimate:
        """Temperature of the particles above half of them, over that of those below; by whole slices."""
        split, freedom, found = self._split(), self._freedom(), []
        for run in self._runs():
            lower, upper = (
                run.energies[:, part].sum() / float(freedom @ run.counts[:, part].sum(axis=1))
                for part in (slice(0, split), slice(split, None))
            )
            found.append(upper / lower)
        return estimate_from_replicas(found)

    def _split(self) -> int:
        """Return the first slice that has half of the particles below it."""
        below = np.cumsum(np.sum([run.counts.sum(axis=0) for run in self._runs()], axis=0))
        return min(int(np.searchsorted(below, 0.5 * below[-1])) + 1, self.cells - 1)

    # Theory -------------------------------------------------------------------------------------------------

    @property
    def theory(self) -> Barometer | None:
        """Theory of this gas; None where diameters differ."""
        gas = self.gas
        return barometer_of(
            gas.box, gas.periodic, gas.sizes, self.weights, gas.diameters, gas.degrees_of_freedom, self._axis
        )

    @property
    def temperature(self) -> float:
        """The temperature at which the theory has the energy of these gases, mean of all; NaN without one."""
        known = self.theory
        return (
            math.nan if known is None else known.temperature(float(np.mean([r.energy for r in self._runs()])))
        )

    @property
    def expected(self) -> Prediction:
        """Number densities of the species in theory, (k, cells); NaN without one."""
        known = self.theory
        if known is None:
            nothing = np.full((len(self.gas.sizes), self.cells), np.nan)
            return Prediction(nothing, nothing)
        return known.profile(self.edges[0], self.temperature)

    @property
    def expected_temperatures(self) -> FloatArray:
        """Temperatures of the species in theory, (k, cells); NaN without one."""
        known = self.theory
        if known is None:
            return np.full((len(self.gas.sizes), self.cells), np.nan)
        return known.temperatures(self.edges[0], self.temperature)

    @property
    def clear(self) -> NDArray[np.bool_]:
        """Which slices are so far from floor and lid that particles do not lie in layers, (cells,).

        3 diameters, and 7.5 for each 1 by which the packing fraction there exceeds 0.1.
        """
        gas, edges = self.gas, self.edges.mean(axis=0)
        largest = float(gas.diameters.max())
        eta = packing_fraction(1.0, gas.diameters, gas.dim) @ self.densities[0]
        needed = (3.0 + 7.5 * np.maximum(eta[[0, -1]] - 0.1, 0.0)) * largest
        return np.asarray((edges[:-1] >= needed[0]) & (edges[1:] <= edges[-1] - needed[1]))

    @property
    def told(self) -> NDArray[np.bool_]:
        """In which slices theory is compared, (k, cells): `clear`, where each replica has seen enough.

        300 in theory, whatever was seen: with fewer, a handful of visits, their spread is no error bar.
        """
        volume = self._area()[:, None] * np.diff(self.edges, axis=1)
        frames = min(run.frames for run in self._runs())
        return np.asarray(self.clear & (self.expected.value * volume * frames >= ENOUGH))

    @property
    def checks(self) -> list[TheoryCheck]:
        """Mean height of each species, the balance of forces, and the temperature above over that below."""
        found, known = [], self.theory
        names = [""] if len(self.gas.sizes) == 1 else [f", {label}" for label in self.gas.labels]
        heights = self.mean_heights
        if known is None:
            of_theory = [Prediction(math.nan, math.nan)] * len(names)
        else:
            of_theory = known.mean_heights(self.edges[0], self.temperature)
        for name, measured, expected in zip(names, heights, of_theory, strict=True):
            found.append(_check(f"mean height{name}", "hydrostatics", measured, expected))
        runs = self._runs()
        balance = [np.subtract(*self._forces(run)) for run in runs]
        found.append(_check("floor less lid, over the weight", "force balance",
                            estimate_from_replicas(balance), Prediction(1.0, 0.0)))  # fmt: skip
        warmer = Prediction(math.nan, math.nan)
        if known is not None:
            freedom = self._freedom()[:, None]
            share = freedom * self.expected.value
            energy, split = share * self.expected_temperatures, self._split()
            lower, upper = (
                energy[:, part].sum() / share[:, part].sum() for part in (slice(0, split), slice(split, None))
            )
            warmer = Prediction(upper / lower, (upper / lower - 1.0) ** 2)
        name = "kT of the upper half over the lower"
        return [*found, _check(name, "fixed energy", self.upper_over_lower, warmer)]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the densities of all species against height, with standard errors."""
        axes = axes_or_new(ax)
        value, error = self.densities
        for k, label in enumerate(self.gas.labels):
            name = "simulation" if len(value) == 1 else label
            colour = PALETTE[k % len(PALETTE)]
            axes.errorbar(self.heights[k], value[k], error[k], fmt="o", ms=3, color=colour, label=name)
        axes.set_yscale("log")
        return labelled(axes, "height above the floor", "number density")


def _check(quantity: str, theory: str, measured: Estimate, expected: Prediction) -> TheoryCheck:
    return TheoryCheck(quantity, theory, measured, float(expected.value), float(expected.uncertainty))
