"""Distributions of speeds, velocity components and kinetic energies per species, beside their exact laws.

Histograms are of reduced velocities c = (v - u) sqrt(m/kT), see `analysis.velocities`. The law of N ->
infinity is Maxwell and Boltzmann's; at fixed energy and N particles it is exact too, and slightly different.
Take frames at equal times: right after a collision its two partners are faster than others, a bias of order
1/N.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis import theory
from analysis.correlation_times import FrameWeights
from analysis.estimator import PALETTE, Estimator, NoDataError, axes_or_new, counted, labelled
from analysis.reduced import Gas, reduced_velocities
from analysis.statistics import ChiSquare, Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["ComponentDistribution", "EnergyDistribution", "SpeedDistribution"]

FloatArray = NDArray[np.float64]


class _Histogram(Estimator):
    """A histogram of a reduced quantity per species, beside its exact law."""

    _quantity = ""

    def __init__(self, bins: int, low: float, high: float) -> None:
        if bins < 2 or not low < high:
            raise ValueError(
                f"bins = {bins}, range {low:g} to {high:g}; expected at least 2 bins and a range"
            )
        self.edges: FloatArray = np.linspace(low, high, bins + 1)
        self._counts: NDArray[np.int64] | None = None
        self._sizes: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        # counts and sizes of independent frames
        self._tested, self._tested_sizes = np.zeros((0, bins), dtype=np.int64), self._sizes
        self._weights = FrameWeights()
        self._frames = 0
        self._temperature = 1.0

    @abstractmethod
    def _values(self, reduced: FloatArray) -> FloatArray:
        """Return the quantity of each particle."""

    @abstractmethod
    def _law(self, edges: FloatArray) -> FloatArray:
        """Probability below each edge, infinitely many particles."""

    @abstractmethod
    def _finite_law(self, edges: FloatArray, momentum_share: float) -> FloatArray:
        """Probability below each edge at fixed energy; one particle has this share of the mass."""

    def add(self, frame: Frame) -> Self:
        """Take in one frame; all must have the species of the first."""
        reduced, temperature = reduced_velocities(frame)
        species = frame.scene.species
        values = self._values(reduced)
        gas = Gas.of(frame.scene)
        sizes = gas.sizes
        counts = np.stack(
            [np.histogram(values[species == kind], bins=self.edges)[0] for kind in range(len(sizes))]
        )
        if self._counts is not None and counts.shape != self._counts.shape:
            raise ValueError(
                f"frame has {len(sizes)} species; expected {len(self._counts)}, as in the first frame"
            )
        self._begin(gas, temperature, counts.shape)
        self._count(counts, sizes, 1)
        if self._weights.add(frame):
            self._tested, self._tested_sizes = self._tested + counts, self._tested_sizes + sizes
        return self

    def _begin(self, gas: Gas, temperature: float, shape: tuple[int, ...]) -> None:
        """Keep the gas and its temperature where nothing has been counted yet."""
        if self._counts is None:
            self._gas, self._temperature = gas, temperature
            self._counts = self._tested = np.zeros(shape, dtype=np.int64)
            self._sizes = self._tested_sizes = np.zeros(shape[0], dtype=np.int64)

    def _count(self, counts: NDArray[np.int64], sizes: NDArray[np.int64], frames: int) -> None:
        self._counts = self._counted() + counts
        self._sizes = self._sizes + sizes
        self._frames += frames

    def _take_in(self, other: Self) -> None:
        counts = other._counted()
        self._begin(other.gas, other._temperature, counts.shape)
        self._count(counts, other._sizes, other._frames)
        self._tested = self._tested + other._tested
        self._tested_sizes = self._tested_sizes + other._tested_sizes
        self._weights.merge(other._weights)

    @property
    def _added(self) -> str:
        return counted(self._frames, "frame")

    def _counted(self) -> NDArray[np.int64]:
        self._require(self._counts is not None, "histogram", "add(frame)")
        assert self._counts is not None
        return self._counts

    @property
    def counts(self) -> NDArray[np.int64]:
        """Counts, (k, bins) int64, one row per species; what lies outside the edges is not counted."""
        return self._counted().copy()

    @property
    def thermal_speeds(self) -> FloatArray:
        """Thermal speed sqrt(kT/m) of each species, (k,), [speed].

        Multiply `edges` of speeds by it and divide `density` by it for absolute units.
        """
        return np.asarray(np.sqrt(self._temperature / self.gas.masses))

    @property
    def labels(self) -> list[str]:
        """One label per species; "all" for a single one."""
        return self.gas.labels

    def _units(self) -> FloatArray:
        """Return what 1 on the axis of the histogram is for each species, (k,)."""
        return self.thermal_speeds

    @property
    def density(self) -> FloatArray:
        """Probability densities, (k, bins), per thermal speed."""
        return np.asarray(self._counted() / self._sizes[:, None] / np.diff(self.edges))

    @property
    def density_error(self) -> FloatArray:
        """Standard errors of `density`, (k, bins): multinomial, by the effective number of frames.

        This number follows from the collisions between frames, see `correlation_times.FrameWeights`.
        """
        share = self._counted() / self._sizes[:, None]
        independent = self._sizes * self._weights.effective / self._frames
        return np.asarray(np.sqrt(share * (1 - share) / independent[:, None]) / np.diff(self.edges))

    @property
    def theory(self) -> FloatArray:
        """The density averaged over each bin at equilibrium, N -> infinity, (bins,), per thermal unit."""
        self._counted()
        return np.asarray(np.diff(self._law(self.edges)) / np.diff(self.edges))

    @property
    def finite_theory(self) -> FloatArray:
        """The exact density of N particles of fixed energy averaged over each bin, (k, bins).

        From `theory.finite_energy_law`: exact for any N and masses where all axes are periodic, or all walls.
        It differs from `theory` by a relative amount of order 1/N, more in the tail, which ends.
        """
        self._counted()
        return np.asarray(np.diff(self._finite_laws(), axis=1) / np.diff(self.edges))

    def _finite_laws(self) -> FloatArray:
        if self.gas.degrees_of_freedom <= self.gas.dim:  # a single particle shares no energy
            return np.tile(self._law(self.edges), (len(self._sizes), 1))
        return np.array([self._finite_law(self.edges, share) for share in self.gas.momentum_shares])

    @property
    def chi_square(self) -> ChiSquare:
        """Pearson's test of all species against the exact law of N particles.

        Bins that expect fewer than 10 counts are joined into the tail. Each species has B - 1 degrees of
        freedom, and one less for all together because the energy is fixed (slightly conservative: the
        constraint acts on <c^2> exactly). Only frames at least four times the longest velocity correlation
        time apart are tested (`correlation_times.velocity_correlation_times`: 6 collisions per particle in a
        gas of one species in 3D, thousands for masses 1:1e4); they count as independent.
        """
        self._counted()
        counts = self._tested
        statistic, freedom = 0.0, -1
        for row, size, law in zip(
            counts, self._tested_sizes, np.diff(self._finite_laws(), axis=1), strict=True
        ):
            kept = law * size >= 10
            expected = np.append(law[kept] * size, size * (1.0 - law[kept].sum()))
            observed = np.append(row[kept], size - row[kept].sum())
            if expected[-1] < 10:  # too few expected counts for a bin of its own
                expected = np.append(expected[:-2], expected[-2:].sum())
                observed = np.append(observed[:-2], observed[-2:].sum())
            statistic += float(((observed - expected) ** 2 / expected).sum())
            freedom += len(expected) - 1
        if freedom < 1:
            self._require(False, "test: too few particles", "add(frame) with more particles")
        return ChiSquare(statistic, freedom, 1, float(special.chdtrc(freedom, statistic)))

    @property
    def checks(self) -> list[TheoryCheck]:
        """`chi_square` per degree of freedom, its cube root, beside the exact law of N particles.

        For k degrees of freedom the cube root is normal with mean 1 - 2/9k and variance 2/9k (Wilson and
        Hilferty, Proc. Natl. Acad. Sci. 17, 684 (1931), doi 10.1073/pnas.17.12.684). Empty where there are
        too few particles for a test.
        """
        try:
            test = self.chi_square
        except NoDataError:
            self._counted()
            return []
        variance = 2.0 / (9.0 * test.degrees_of_freedom)
        root = float(np.cbrt(test.statistic / test.degrees_of_freedom))
        measured = Estimate(root, variance**0.5, test.degrees_of_freedom)
        name = f"cube root of chi-square/{test.degrees_of_freedom}, {self._quantity}"
        return [TheoryCheck(name, "N particles of fixed energy", measured, 1.0 - variance, 0.0)]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the histogram of each species with its standard errors over the law of the infinite gas.

        The exact law of N particles is drawn dashed where N < 1000.
        """
        self._counted()
        axes = axes_or_new(ax)
        shares, freedom = self.gas.momentum_shares, self.gas.degrees_of_freedom
        centres = (self.edges[1:] + self.edges[:-1]) / 2
        fine = np.linspace(self.edges[0], self.edges[-1], 601)
        step = 1e-4
        law = (self._law(fine + step) - self._law(fine - step)) / (2 * step)
        for index, (thermal, label) in enumerate(zip(self._units(), self.labels, strict=True)):
            colour = PALETTE[index % len(PALETTE)]
            if self._sizes[index] < 1000 and freedom > self.gas.dim:
                share = shares[index]
                finite = self._finite_law(fine + step, share) - self._finite_law(fine - step, share)
                axes.plot(fine * thermal, finite / (2 * step) / thermal, "--", color=colour, lw=1, zorder=1)
            name = "simulation" if label == "all" else label
            axes.plot(fine * thermal, law / thermal, color=colour, lw=1.5, zorder=1)
            axes.errorbar(
                centres * thermal,
                self.density[index] / thermal,
                self.density_error[index] / thermal,
                fmt=".",
                color=colour,
                label=name,
            )
        axes.plot([], [], color="0.4", lw=1.5, label="Maxwell\u2013Boltzmann")
        return labelled(axes, self._quantity, "probability density")


class SpeedDistribution(_Histogram):
    """Histogram of speeds |v - u| per species, beside the exact Maxwell-Boltzmann law of the infinite gas.

    Parameters
    ----------
    bins : int, default 60
        Number of equal bins.
    maximum : float, default 5
        Upper edge in thermal speeds sqrt(kT/m).

    Notes
    -----
    The particles of a frame count as independent samples; at fixed energy that is right to order 1/N. The
    correlation of frames is taken into account (`density_error`, `chi_square`). Unbiased: bins are compared
    with their exact averages.
    """

    _quantity = "speed"

    def __init__(self, bins: int = 60, maximum: float = 5.0) -> None:
        super().__init__(bins, 0.0, maximum)

    def _values(self, reduced: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.einsum("ik,ik->i", reduced, reduced)))

    def _law(self, edges: FloatArray) -> FloatArray:
        return theory.speed_cdf(edges, self.gas.dim)

    def _finite_law(self, edges: FloatArray, momentum_share: float) -> FloatArray:
        law = theory.finite_energy_law(self.gas.degrees_of_freedom, self.gas.dim, momentum_share)
        return np.asarray(law.cdf(np.maximum(edges, 0.0) ** 2 / 2))


class ComponentDistribution(_Histogram):
    """Histogram of one velocity component per species, beside the exact normal law of variance kT/m.

    Parameters
    ----------
    axis : int, default 0
        Which component.
    bins : int, default 60
        Number of equal bins.
    maximum : float, default 4
        The histogram spans -maximum to maximum, in thermal speeds sqrt(kT/m).
    """

    def __init__(self, axis: int = 0, bins: int = 60, maximum: float = 4.0) -> None:
        super().__init__(bins, -maximum, maximum)
        self.axis = axis
        self._quantity = f"velocity along {'xyz'[axis]}"

    def _values(self, reduced: FloatArray) -> FloatArray:
        if self.axis >= reduced.shape[1]:
            raise ValueError(f"axis = {self.axis} in a gas of {reduced.shape[1]} dimensions")
        return reduced[:, self.axis]

    def _law(self, edges: FloatArray) -> FloatArray:
        return theory.component_cdf(edges)

    def _finite_law(self, edges: FloatArray, momentum_share: float) -> FloatArray:
        # a component's share of the energy is (1 - q) Beta(1/2, (D - 1)/2)
        freedom = self.gas.degrees_of_freedom
        square = edges**2 / (freedom * (1.0 - momentum_share))
        half = special.betainc(0.5, (freedom - 1) / 2, np.minimum(square, 1.0)) / 2
        return np.asarray(0.5 + np.sign(edges) * half)


class EnergyDistribution(_Histogram):
    """Histogram of kinetic energies m |v - u|^2/2 per species, beside the gamma law and the exact finite one.

    At fixed energy of N particles each one's share follows a beta distribution (`theory.finite_energy_law`),
    which tends to the gamma distribution of shape d/2 for N -> infinity: same for all species.

    Parameters
    ----------
    bins : int, default 60
        Number of equal bins.
    maximum : float, default 12
        Upper edge in units of kT.
    """

    _quantity = "kinetic energy"

    def __init__(self, bins: int = 60, maximum: float = 12.0) -> None:
        super().__init__(bins, 0.0, maximum)

    def _values(self, reduced: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ik,ik->i", reduced, reduced) / 2)

    def _units(self) -> FloatArray:
        return np.full(len(self._sizes), self._temperature)

    def _law(self, edges: FloatArray) -> FloatArray:
        return theory.energy_cdf(edges, self.gas.dim)

    def _finite_law(self, edges: FloatArray, momentum_share: float) -> FloatArray:
        law = theory.finite_energy_law(self.gas.degrees_of_freedom, self.gas.dim, momentum_share)
        return np.asarray(law.cdf(edges))
