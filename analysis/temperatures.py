"""Temperature equilibration between two species, and between directions."""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import PALETTE, ReplicaEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.statistics import Estimate, TheoryCheck, estimate_from_jackknife, replica_mean
from analysis.theory import Prediction
from hardspheres.scene import drift

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["AnisotropyDecay", "TemperatureEquilibration"]

FloatArray = NDArray[np.float64]


@dataclass
class _Replica:
    """What is kept of one replica: S sampled moments."""

    time: list[float]
    s: list[float]
    values: list[FloatArray]


class SampledReplicas(ReplicaEstimator):
    """A few numbers per frame, replica by replica; a frame that does not advance in time begins a new one."""

    @abstractmethod
    def _measure(self, frame: Frame) -> FloatArray:
        """Return what is kept of a frame."""

    def add(self, frame: Frame) -> Self:
        """Take in the next frame of this replica, or the first of another.

        Raises
        ------
        ValueError
            If the gas is not one this estimator is for, or not the one of the first frame.
        """
        scene = frame.scene
        gas = self._gas or Gas.of(scene)
        if (scene.n, scene.dim) != (gas.n, gas.dim):
            raise ValueError(
                f"frame has {scene.n} particles in {scene.dim} dimensions; expected {gas.n} in "
                f"{gas.dim}, as in the first frame"
            )
        values = self._measure(frame)
        self._gas = gas
        replica = self._continued(frame.time, "time", lambda: _Replica([], [], []))
        replica.time.append(frame.time)
        replica.s.append(frame.collisions_per_particle)
        replica.values.append(values)
        return self

    @property
    def time(self) -> FloatArray:
        """Mean time of each sample since the first, (S,), [time]."""
        times = np.array(self._ready("time"))
        return np.asarray((times - times[:, :1]).mean(axis=0))

    @property
    def s(self) -> FloatArray:
        """Mean collisions per particle of each sample since the first, (S,)."""
        s = np.array(self._ready("s"))
        return np.asarray((s - s[:, :1]).mean(axis=0))

    @property
    def samples(self) -> FloatArray:
        """The values of each replica, (R, S, ...)."""
        return np.array(self._ready("values"))

    def _ready(self, name: str) -> list[list[Any]]:
        self._require(bool(self._replicas), "replicas", "add(frame)")
        series = [getattr(replica, name) for replica in self._replicas]
        for index, replica in enumerate(series):
            if len(replica) != len(series[0]):
                raise ValueError(
                    f"replica {index} was sampled {len(replica)} times; expected {len(series[0])}, as "
                    "replica 0"
                )
        return series

    def _ends(self, axis: FloatArray, window: tuple[float, float]) -> tuple[int, int]:
        """Return the samples nearest to the ends of a window."""
        first, last = (int(np.argmin(np.abs(axis - end))) for end in window)
        slack = 0.51 * float(np.diff(axis).max()) if len(axis) > 1 else 0.0
        if first >= last or max(abs(axis[first] - window[0]), abs(axis[last] - window[1])) > slack:
            raise ValueError(
                f"window = {window}; expected two samples between {axis[0]:g} and {axis[-1]:g}, the first "
                "earlier"
            )
        return first, last

    def _decayed(self, axis: FloatArray, expected: FloatArray, measured: FloatArray) -> tuple[float, float]:
        """Return the window from the first sample to where 1/e of a quantity is left, or to before the noise.

        `expected`, (S,), is what theory says of the quantity, `measured`, (R, S), what the replicas gave.
        """
        mean, error = replica_mean(measured)
        clear = np.abs(mean) > 3.0 * np.nan_to_num(error)
        clear &= mean * mean[0] > 0.0
        last = int(np.argmin(np.append(clear, False))) - 1  # of those that are clear from the first on
        self._require(last > 0, "decay above the noise", "add(frame) with more particles or replicas")
        wanted = int(np.argmin(np.abs(np.log(np.abs(expected[: last + 1] / expected[0])) + 1.0)))
        return float(axis[0]), float(axis[max(wanted, 1)])

    def _rate(
        self, axis: FloatArray, decaying: FloatArray, window: tuple[float, float], what: str
    ) -> Estimate:
        """Mean rate of exponential decay of a quantity, (R, S), over a window; jackknife over replicas."""
        places = list(self._ends(axis, window))
        ends, length = decaying[:, places], float(axis[places[1]] - axis[places[0]])
        mean, error = replica_mean(ends)
        if np.any(np.abs(mean) < 3.0 * np.nan_to_num(error)) or mean[0] * mean[1] <= 0.0:
            raise ValueError(
                f"the {what} is lost in the noise within the window: {mean[0]:.2g} and {mean[1]:.2g} with "
                f"standard errors {error[0]:.2g} and {error[1]:.2g}; use more particles or replicas, or an "
                "earlier window"
            )
        return estimate_from_jackknife(ends, lambda pair: math.log(float(pair[0] / pair[1])) / length)


class TemperatureEquilibration(SampledReplicas):
    """Kinetic temperatures of two or more species that start unequal, against time.

    kT_i = sum over species i of m (v - u)^2 / (d N_i (1 - q_i)), u the common motion along periodic axes, q_i
    = m_i/M times the fraction of periodic axes: at equilibrium of N particles of fixed energy its mean is
    exactly kT (`theory.finite_energy_law`), so that there is no bias of order 1/N in equilibrium. Theory: two
    Maxwellians with a time-dependent temperature each, `theory.temperature_equilibration`, with its known
    deviation as uncertainty; the temperatures it starts from are those measured in the first sample.

    Examples
    --------
    >>> decay = TemperatureEquilibration()
    >>> for seed in range(10):  # doctest: +SKIP
    ...     scene = random_gas(n=1000, packing_fraction=0.005, velocities="two-temperatures", seed=seed, ...)
    ...     for frame in Simulation(scene).frames(every=2.0, count=10):
    ...         decay.add(frame)
    >>> print(decay.fit_rate(window=(0, 10)), decay.expected_rate(window=(0, 10)))  # doctest: +SKIP
    """

    def _measure(self, frame: Frame) -> FloatArray:
        scene = frame.scene
        species = Gas.of(scene)
        if len(species.sizes) < 2:
            raise ValueError("the gas has one species; temperatures of species need at least two")
        peculiar = frame.velocities - drift(frame.velocities, scene.masses, scene.periodic)
        twice = scene.masses * np.einsum("ik,ik->i", peculiar, peculiar)
        total = np.bincount(scene.species, weights=twice)
        return np.asarray(total / species.species_degrees_of_freedom)

    @property
    def temperatures(self) -> FloatArray:
        """Mean kT of each species, (S, k), [energy]."""
        return replica_mean(self.samples)[0]

    @property
    def temperatures_error(self) -> FloatArray:
        """Standard errors of `temperatures`, (S, k); NaN for a single replica."""
        return replica_mean(self.samples)[1]

    @property
    def theory(self) -> Prediction:
        """What the two-Maxwellian theory expects at `time`, (S, k)."""
        return self._theory(self.time)

    def _theory(self, time: FloatArray) -> Prediction:
        gas, start = self.gas, self.temperatures[0]
        densities = gas.sizes / gas.volume
        return theory.temperature_equilibration(time, start, densities, gas.diameters, gas.masses, gas.dim)

    def fit_rate(self, window: tuple[float, float], species: tuple[int, int] = (0, 1)) -> Estimate:
        """Return the mean rate at which the difference of two temperatures decays over a window of time.

        ln[(T_i - T_j)(t1) / (T_i - T_j)(t2)]/(t2 - t1), from the two ends alone, see
        `RelaxationCurve.fit_rate`; jackknife over replicas, R - 1 degrees of freedom.

        Parameters
        ----------
        window : (float, float)
            t1 < t2, times since the first sample; the nearest samples are used.
        species : (int, int), default (0, 1)
            Which two.

        Returns
        -------
        Estimate
            [1/time].

        Raises
        ------
        ValueError
            If the window does not hold two samples, or the difference is lost in the noise at one end.
        """
        samples = self.samples
        difference = samples[..., species[0]] - samples[..., species[1]]
        return self._rate(self.time, difference, window, "temperature difference")

    def expected_rate(self, window: tuple[float, float], species: tuple[int, int] = (0, 1)) -> Prediction:
        """Return what the two-Maxwellian theory says of `fit_rate`, with its uncertainty."""
        time = self.time
        ends = np.array(self._ends(time, window))
        expected = self._theory(time)
        difference = expected.value[ends, species[0]] - expected.value[ends, species[1]]
        length = float(time[ends[1]] - time[ends[0]])
        rate = math.log(float(difference[0] / difference[1])) / length
        relative = {3: 0.04, 2: 0.08}[self.gas.dim]
        return Prediction(rate, relative * rate)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The rate of each species beside the next one's, over about one relaxation time; see `check`."""
        found, expected = [], self.theory.value
        for i, j in itertools.pairwise(range(expected.shape[1])):
            apart, samples = (values[..., i] - values[..., j] for values in (expected, self.samples))
            check = self.check(self._decayed(self.time, apart, samples), (i, j))
            pair = f", species {i + 1}-{j + 1}" if expected.shape[1] > 2 else ""
            found.append(replace(check, quantity=check.quantity + pair))
        return found

    def check(self, window: tuple[float, float], species: tuple[int, int] = (0, 1)) -> TheoryCheck:
        """Return the fitted rate beside the theory's."""
        p, measured = self.expected_rate(window, species), self.fit_rate(window, species)
        name = "rate of temperature equilibration"
        return TheoryCheck(name, "two Maxwellians", measured, p.value, p.uncertainty)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the temperatures of the species against time over the theory with its band."""
        time, values, errors = self.time, self.temperatures, self.temperatures_error
        axes = axes_or_new(ax)
        fine = np.linspace(0.0, float(time[-1]), 200)
        expected = self._theory(fine)
        for kind in range(values.shape[1]):
            low, high = (expected.value + sign * expected.uncertainty for sign in (-1, 1))
            colour, label = PALETTE[kind % len(PALETTE)], f"species {kind}"
            axes.fill_between(fine, low[:, kind], high[:, kind], color=colour, alpha=0.2, lw=0)
            axes.plot(fine, expected.value[:, kind], color=colour, lw=1.5)
            axes.errorbar(time, values[:, kind], errors[:, kind], fmt="o", ms=4, color=colour, label=label)
        axes.plot([], [], color="0.4", lw=1.5, label="two Maxwellians")
        return labelled(axes, "time", "temperature $k_BT$")


class AnisotropyDecay(SampledReplicas):
    """Temperature along one axis over the mean of all axes, less 1, against collisions per particle.

    A = T_x / T - 1 with kT_k = (1/N) sum m (v_k - u_k)^2: at equilibrium 0 on average, exactly where all axes
    have the same boundary. Theory: `theory.anisotropy_decay` times the first sample, for a gas of one species
    that starts Maxwellian with a different temperature along the axis; for small A, which a few tenths are.

    Parameters
    ----------
    axis : int or (d,) array_like, default 0
        Which axis, or a direction, such as `hardspheres.velocities.BEAM_DIRECTION` of beams.
    """

    def __init__(self, axis: int | Sequence[float] | FloatArray = 0) -> None:
        super().__init__()
        self.axis = axis

    def _direction(self, dim: int) -> FloatArray:
        if isinstance(self.axis, int):
            if not 0 <= self.axis < dim:
                raise ValueError(f"axis = {self.axis} in a gas of {dim} dimensions")
            return np.asarray(np.eye(dim)[self.axis])
        direction = np.asarray(self.axis, dtype=np.float64)
        if direction.shape != (dim,) or not 0.0 < float(np.linalg.norm(direction)) < math.inf:
            raise ValueError(f"axis = {direction.tolist()} is no direction in a gas of {dim} dimensions")
        return np.asarray(direction / np.linalg.norm(direction))

    def _measure(self, frame: Frame) -> FloatArray:
        scene = frame.scene
        direction = self._direction(scene.dim)
        peculiar = frame.velocities - drift(frame.velocities, scene.masses, scene.periodic)
        tensor = np.einsum("i,ia,ib->ab", scene.masses, peculiar, peculiar)
        return np.asarray(direction @ tensor @ direction / np.trace(tensor) * scene.dim - 1.0)

    @property
    def anisotropy(self) -> FloatArray:
        """A, mean over replicas, (S,)."""
        return replica_mean(self.samples)[0]

    @property
    def anisotropy_error(self) -> FloatArray:
        """Standard error of `anisotropy`, (S,); NaN for a single replica."""
        return replica_mean(self.samples)[1]

    @property
    def theory(self) -> Prediction:
        """What the Boltzmann equation expects at `s`, (S,); NaN beyond s = 4, with a warning."""
        return self._theory(self.s)

    def _theory(self, s: FloatArray) -> Prediction:
        start = float(self.anisotropy[0])
        decay = theory.anisotropy_decay(s, self.gas.dim)
        return Prediction(start * decay.value, abs(start) * decay.uncertainty)

    def fit_rate(self, window: tuple[float, float] = (0.0, 2.0)) -> Estimate:
        """Return the mean rate at which A decays over a window, ln[A(s1)/A(s2)]/(s2 - s1), per unit of s.

        From the two ends alone, jackknife over replicas; see `TemperatureEquilibration.fit_rate`.

        Parameters
        ----------
        window : (float, float), default (0, 2)
            s1 < s2, collisions per particle since the first sample; the nearest samples are used.
        """
        return self._rate(self.s, self.samples, window, "anisotropy")

    def expected_rate(self, window: tuple[float, float] = (0.0, 2.0)) -> Prediction:
        """Return what the Boltzmann equation says of `fit_rate`, with its uncertainty."""
        s = self.s
        ends = list(self._ends(s, window))
        expected = self._theory(s[ends])
        length = float(s[ends[1]] - s[ends[0]])
        rate = math.log(float(expected.value[0] / expected.value[1])) / length
        return Prediction(rate, float(np.hypot(*(expected.uncertainty / expected.value))) / length)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The rate beside theory over about one relaxation time, as far as theory reaches; see `check`."""
        known = int(np.searchsorted(self.s, 4.0, side="right"))
        s, samples = self.s[:known], self.samples[:, :known]
        return [self.check(self._decayed(s, self._theory(s).value, samples))]

    def check(self, window: tuple[float, float] = (0.0, 2.0)) -> TheoryCheck:
        """Return the fitted rate beside the theory's."""
        p, measured = self.expected_rate(window), self.fit_rate(window)
        name = "decay rate of the anisotropy"
        return TheoryCheck(name, "Boltzmann equation", measured, p.value, p.uncertainty)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the anisotropy with its standard errors against s over the Boltzmann equation's."""
        s, values, errors = self.s, self.anisotropy, self.anisotropy_error
        axes = axes_or_new(ax)
        fine = np.linspace(0.0, min(float(s[-1]), 4.0), 200)
        axes.plot(fine, self._theory(fine).value, color="0.25", lw=1.5, label="Boltzmann equation")
        axes.errorbar(s, values, errors, fmt="o", ms=4, label="simulation")
        name = "xyz"[self.axis] if isinstance(self.axis, int) else r"\parallel"
        return labelled(axes, "collisions per particle s", f"anisotropy $T_{name}/T - 1$")
