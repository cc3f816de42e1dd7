"""Density between two walls, and the pressure on them: the contact theorem."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import PALETTE, PlacesEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.series import BlockSeries
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["DensityProfile"]

FloatArray = NDArray[np.float64]

FEW = 10.0  # particles in a slice below which blocks do not tell their variance
MIDDLE = (0.35, 0.65)  # of the way between the walls: there the fluid does not feel them


class DensityProfile(PlacesEstimator):
    """Number density of each species against the distance along an axis with walls, from frames.

    n(z) is the number of centres in a slice over its volume; slices divide what centres of a species can
    reach, from one radius off the lower wall to one radius off the upper one. At a hard wall the density is
    kT n(contact) = P summed over species, P the pressure on that wall, exactly and at any density (Henderson,
    Blum and Lebowitz, J. Electroanal. Chem. 102, 315 (1979), doi 10.1016/S0022-0728(79)80459-3).

    Parameters
    ----------
    axis : int, default -1
        Axis with walls.
    width : float, default 0.04
        Width of a slice, in mean diameters, at most; slices are equal.
    window : float, default 0.3
        The density is extrapolated to contact from within this distance, in mean diameters.
    degree : int, default 3
        Degree of the polynomial that is fitted there.

    Notes
    -----
    Take frames at times that are independent of the collisions, such as ``sim.frames(every=...)``. Errors
    come from blocks of frames (`series.estimate_from_series`). Between walls along the other axes, too,
    densities are averages over the whole cross-section.
    """

    def __init__(self, axis: int = -1, width: float = 0.04, window: float = 0.3, degree: int = 3) -> None:
        if degree < 1 or not 0.0 < width * (degree + 2) <= window * (1.0 + 1e-9):
            raise ValueError(
                f"window = {window:g} with slices of width = {width:g}; a polynomial of degree {degree} "
                f"needs at least {degree + 2} slices in the window"
            )
        self.axis, self.width, self.window, self.degree = axis, width, window, degree
        self._blocks = BlockSeries(256)
        self._falls = False

    def add(self, frame: Frame) -> Self:
        """Take in one frame.

        Parameters
        ----------
        frame : Frame
            All frames of the same gas.

        Raises
        ------
        ValueError
            If the axis has no walls, or they are closer than two windows.
        """
        scene = self._follow(frame)
        gas = self.gas
        reach = self._reach()[scene.species]
        share = (frame.positions[:, self.axis] - scene.radii) / reach
        slices = np.clip((share * self._bins).astype(np.int64), 0, self._bins - 1)  # contact may round beyond
        place = scene.species * self._bins + slices
        counts = np.bincount(place, minlength=len(gas.sizes) * self._bins).reshape(-1, self._bins)
        self._blocks.add(counts / self._volumes()[:, None])
        return self

    def _begin(self, scene: Scene) -> None:
        if not -scene.dim <= self.axis < scene.dim:
            raise ValueError(f"axis = {self.axis}; a gas in {scene.dim}D has axes 0 to {scene.dim - 1}")
        if scene.periodic[self.axis]:
            raise ValueError(
                f"axis {self.axis} is periodic, so the density is the same everywhere along it; choose an "
                "axis with walls"
            )
        self._gas, self._falls = Gas.of(scene), scene.falls
        if self._fitted().max() > self._bins // 2:
            room, self._gas = float(self._reach().min()), None
            raise ValueError(
                f"window = {self.window:g} mean diameters is more than half of what centres can reach "
                f"between the walls, {room:.4g}; take a narrower one"
            )

    def _take_in(self, other: Self) -> None:
        self._falls = self._falls or other._falls
        super()._take_in(other)

    @property
    def _bins(self) -> int:
        """Number of slices."""
        room = float(self._reach().max()) / (self.width * self.gas.mean_diameter)
        return max(math.ceil(room * (1.0 - 1e-9)), 1)

    def _reach(self) -> FloatArray:
        """Length that centres of each species can reach, (species,)."""
        gas = self.gas
        return np.asarray(gas.box[self.axis] - gas.diameters)

    def _volumes(self) -> FloatArray:
        """Volume of a slice of each species, (species,)."""
        gas = self.gas
        return np.asarray(gas.volume / gas.box[self.axis] * self._reach() / self._bins)

    def _fitted(self) -> NDArray[np.int64]:
        """How many slices are in the window, (species,)."""
        slices = self.window * self.gas.mean_diameter * self._bins / self._reach()
        return np.asarray(np.floor(slices * (1.0 + 1e-9)), np.int64)

    def _extrapolation(self) -> FloatArray:
        """Weights, (species, bins), by which slices give the fitted polynomial at the lower wall."""
        weights = np.zeros((len(self.gas.sizes), self._bins))
        for own, fitted in zip(weights, self._fitted().tolist(), strict=True):
            edges = np.arange(fitted + 1) / fitted
            powers = np.arange(1, self.degree + 2)
            basis = np.diff(edges[:, None] ** powers, axis=0) / powers * fitted  # averages over slices
            own[:fitted] = np.linalg.pinv(basis)[0]
        return weights

    # Results ------------------------------------------------------------------------------------------------

    @property
    def z(self) -> FloatArray:
        """Middle of each slice, (species, bins), [length], from the lower wall."""
        self._require_frames()
        middle = (np.arange(self._bins) + 0.5) / self._bins
        return np.asarray(self.gas.diameters[:, None] / 2.0 + self._reach()[:, None] * middle)

    @property
    def density(self) -> FloatArray:
        """Number density of each species, (species, bins), [1/length^d]."""
        self._require_frames()
        return self._mean

    @property
    def density_error(self) -> FloatArray:
        """Standard errors of `density`, (species, bins); Poisson's where few particles were seen."""
        self._require_frames()
        volume = self._volumes()[:, None] * self._frames
        seen, expected = self._mean * volume, self._mean.mean(axis=1)[:, None] * volume
        poisson = np.sqrt(np.maximum(seen, np.minimum(expected, 1.0))) / volume
        if self._frames == 1:
            return np.asarray(poisson)
        along = self._extrapolation()
        return np.asarray(np.where(seen < FEW, poisson, self._errors_of_rows(along + along[:, ::-1])))

    @property
    def contact(self) -> tuple[Estimate, Estimate]:
        """Pressure over kT from the density at the lower wall, and at the upper one: n at contact.

        Summed over species. Bias: what the polynomial does not follow, see `extrapolation_bias`.
        """
        self._require_frames()
        along = self._extrapolation()
        return self._sum_of(along), self._sum_of(along[:, ::-1])

    def _sum_of(self, weights: FloatArray) -> Estimate:
        runs = [np.tensordot(series.rows, weights, 2) for series in self._series()]
        if self._frames > 1:
            return self._pooled(runs)
        error = float(np.linalg.norm(weights * self.density_error))
        return Estimate(float(runs[0][0]), error, 1.0)

    @property
    def middle(self) -> FloatArray:
        """Number density of each species midway between the walls, over 30 % of the way, (species,)."""
        self._require_frames()
        return np.asarray(self._mean @ self._amid())

    def _amid(self) -> FloatArray:
        """Return the weight of each slice in the density of the middle, (bins,)."""
        share = (np.arange(self._bins) + 0.5) / self._bins
        inside = (share > MIDDLE[0]) & (share < MIDDLE[1])
        return np.asarray(inside / inside.sum())

    @property
    def extrapolation_bias(self) -> float:
        """Uncertainty of the mean of `contact` from the extrapolation: its change with one degree more.

        It contains noise of about the standard error, and is an upper bound while that dominates.
        """
        self._require_frames()
        other = DensityProfile(self.axis, self.width, self.window, self.degree + 1)
        other._gas = self._gas
        change = self._extrapolation() - other._extrapolation()
        return float(abs(np.tensordot(self._mean, change + change[:, ::-1], 2)) / 2.0)

    @property
    def check(self) -> TheoryCheck:
        """Pressure on the walls over kT and the density midway, beside Z of a fluid of that density."""
        gas, middle, amid = self.gas, self.middle, self._amid()
        weights = self._extrapolation()
        both = (weights + weights[:, ::-1]) / 2.0
        runs = [
            np.stack([np.tensordot(series.rows, both, 2), (series.rows @ amid).sum(axis=1)], axis=1)
            for series in self._series()
        ]
        if self._frames > 1:
            measured = self._pooled(runs, lambda mean: mean[..., 0] / mean[..., 1])
            spread = self._pooled([run[:, 1] for run in runs]).standard_error / float(middle.sum())
        else:
            lower, upper = self.contact
            spread = math.hypot(lower.standard_error, upper.standard_error) / 2.0 / float(middle.sum())
            measured = Estimate(float(runs[0][0, 0] / runs[0][0, 1]), spread, 1.0)
        name, expected, slope = _theory(middle, gas)
        uncertainty = math.hypot(
            float(expected.uncertainty), slope * spread, self.extrapolation_bias / float(middle.sum())
        )
        what = f"Z from the density at the walls of axis {self.axis % gas.dim}"
        return TheoryCheck(what, name, measured, float(expected.value), uncertainty)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The one `check`; none under gravity, nor where all of the fluid feels the walls."""
        self._require_frames()
        gas = self.gas
        needed = 6.0 + 15.0 * max(gas.packing_fraction - 0.1, 0.0)  # layers decay more slowly in dense fluids
        wide = gas.box[self.axis] >= needed * self.gas.mean_diameter
        return [self.check] if wide and not self._falls else []

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw n(z) of each species with its standard errors, and what theory says of the sum at contact."""
        z, density, error = self.z, self.density, self.density_error
        axes, gas = axes_or_new(ax), self.gas
        for index, label in enumerate(gas.labels):
            colour = PALETTE[index % len(PALETTE)]
            name = "simulation" if len(z) == 1 else label
            axes.errorbar(z[index], density[index], error[index], fmt=".", ms=3, color=colour, label=name)
        if len(gas.sizes) == 1 and self.checks:
            expected = float(self.middle.sum()) * self.check.expected
            ends = [float(z[0, 0]), float(z[0, -1])]
            axes.plot(ends, [expected] * 2, "D", color=PALETTE[1], mfc="none", label="theory at contact")
        axes.set_ylim(bottom=0.0)
        return labelled(axes, "distance from the lower wall z", "number density n(z)")


def _theory(densities: FloatArray, gas: Gas) -> tuple[str, theory.Prediction, float]:
    """Return Z of a fluid of these densities, and its slope, dZ/d ln density."""
    eta = float(densities @ theory.packing_fraction(1.0, gas.diameters, gas.dim))
    slope = eta * float(theory.compressibility_slope(eta, gas.dim))
    if np.ptp(gas.diameters) == 0.0:
        name = "Kolafa-Labik-Malijevsky" if gas.dim == 3 else "virial series resummed"
        return name, theory.compressibility_factor(eta, gas.dim), slope
    return (
        "Santos-Yuste-Lopez de Haro",
        theory.mixture_compressibility(densities, gas.diameters, gas.dim),
        slope,
    )
