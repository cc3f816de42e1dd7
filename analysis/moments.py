"""Temperatures, momenta and cumulants of velocities in each frame, with errors for any spacing of frames."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis import theory
from analysis.correlation_times import FrameWeights, velocity_correlation_times
from analysis.per_frame import PerFrame
from analysis.reduced import Gas
from analysis.series import (
    BLOCK_LENGTH,
    FEWEST_BLOCKS,
    ShortSeriesWarning,
    autocorrelation_time,
    block_length,
)
from analysis.statistics import Estimate, TheoryCheck
from analysis.velocities import cumulants
from hardspheres.scene import drift, total_momentum

if TYPE_CHECKING:
    from hardspheres import Frame

__all__ = ["FEW", "FIXED", "VelocityMoments"]

FloatArray = NDArray[np.float64]

CONSERVED = 1e-3  # spread, over that of a gas in contact with others, that is rounding: of any file's digits
FIXED = 1e-4  # the same of the momentum, in sqrt(M kT)
FEW = 10  # particles of a species below which it has no distribution of its own


class VelocityMoments(PerFrame):
    """kT in all, along each axis and of each species, a2 of each species, and the momentum, frame by frame.

    kT is 2 K_th / D of each frame, kT along an axis sum of m (v - u)^2 / f with f = N, less 1 where the axis
    is periodic, and kT of a species as in `temperatures.TemperatureEquilibration`: at equilibrium all have
    the mean kT at any N. a2 of a species is about its own mean square velocity, `velocities.cumulants`.

    Notes
    -----
    Frames may be as close together as one likes. Where there are enough, errors come from blocks
    (`series.estimate_from_series`), each of at least 20 correlation times of the velocities, which are known
    from the collisions per particle between frames. Where there are too few, the error is the noise of N
    particles at equilibrium in one frame over the root of the effective number of frames
    (`correlation_times.FrameWeights`). A kinetic energy that is the same in all frames has no error.
    """

    _ylabel = "temperature $k_BT$"
    _line = "mean"

    def __init__(self) -> None:
        super().__init__()
        self._slow = FrameWeights()  # with the correlation time of a2
        self._lowest, self._highest = math.inf, -math.inf

    def add(self, frame: Frame) -> Self:
        """Take in one frame; all must be of one gas."""
        super().add(frame)
        if not len(self._slow.effective):
            dim = frame.scene.dim
            ratio = 2.0 / dim / float(theory.near_equilibrium_rate(dim).value)
            times = max(ratio, 1.0) * velocity_correlation_times(frame.scene)
            self._slow = FrameWeights(np.zeros_like(times), times)
        self._slow.add(frame)
        self._lowest, self._highest = min(self._lowest, self._last), max(self._highest, self._last)
        return self

    def _take_in(self, other: Self) -> None:
        super()._take_in(other)
        self._slow.merge(other._slow)
        self._lowest = min(self._lowest, other._lowest)
        self._highest = max(self._highest, other._highest)

    def _measure(self, frame: Frame) -> list[float]:
        scene, gas = frame.scene, self._gas or Gas.of(frame.scene)
        masses, dim = scene.masses, scene.dim
        peculiar = frame.velocities - drift(frame.velocities, masses, scene.periodic)
        squares = peculiar**2
        twice = masses @ squares
        temperature = float(twice.sum()) / gas.degrees_of_freedom
        if not temperature > 0.0:
            raise ValueError("nothing moves in this frame; it has no temperature")
        square = squares.sum(axis=1)
        own = np.bincount(scene.species, weights=masses * square)
        powers = np.stack([square, square**2, square**3], axis=1)
        with np.errstate(invalid="ignore"):
            a2 = [
                float(cumulants(powers[scene.species == kind].mean(axis=0), dim)[0])
                for kind in range(len(gas.sizes))
            ]
        momentum = total_momentum(frame.velocities, masses)
        return [
            temperature,
            *(twice / _along(gas) / temperature).tolist(),
            *(own / gas.species_degrees_of_freedom / temperature).tolist(),
            *a2,
            *(momentum / math.sqrt(temperature * float(masses.sum()))).tolist(),
            frame.time,
        ]

    def _results(self) -> list[str]:
        if not self._series():
            return []
        a2 = ", ".join(str(each) for each in self.a2)
        return [f"kT {self.temperature}", f"a2 {a2}", f"independent frames {self.effective_frames:.3g}"]

    def _level(self) -> float:
        return float(self._mean[1])

    # Results ------------------------------------------------------------------------------------------------

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        self._require_values()
        return sum(series.n_samples for series in self._series())

    @property
    def effective_frames(self) -> float:
        """Effective number of independent frames, of the species with the longest correlation time."""
        self._require_values()
        return float(min(self._weights.effective.min(), self.n_frames))

    @property
    def table(self) -> dict[str, FloatArray]:
        """Every quantity in each of `values`, by name, with the time of the frame as index."""
        gas = self.gas
        names = ["kT", *(f"kT_{axis}_over_kT" for axis in "xyz"[: gas.dim])]
        kinds = range(1, len(gas.sizes) + 1)
        names += [f"kT_{k}_over_kT" for k in kinds] + [f"a2_{k}" for k in kinds]
        names += [f"momentum_{axis}" for axis in "xyz"[: gas.dim]] + ["index"]
        return {name: np.concatenate(self._columns(1 + k)) for k, name in enumerate(names)}

    @property
    def energy_spread(self) -> float:
        """Largest less smallest kinetic energy of all frames, relative to their mean."""
        self._require_values()
        return (self._highest - self._lowest) / self._level()

    @property
    def energy_conserved(self) -> bool:
        """Whether the kinetic energy of all frames, at least two, is the same but for rounding."""
        few = CONSERVED * math.sqrt(2.0 / self.gas.degrees_of_freedom)
        return self.n_frames > 1 and self.energy_spread < few

    @property
    def temperature(self) -> Estimate:
        """kT, [energy]; without error where the kinetic energy is conserved, as in a gas of hard spheres."""
        self._require_values()
        if self.energy_conserved:
            return Estimate(self._level(), 0.0, float(self.n_frames))
        return self._settled(1, self._level() * math.sqrt(2.0 / self.gas.degrees_of_freedom))

    @property
    def along_axes(self) -> list[Estimate]:
        """KT along each axis over kT."""
        self._require_values()
        noise = _share_noise(_along(self.gas), self.gas.degrees_of_freedom)
        return [self._settled(2 + k, float(noise[k])) for k in range(self.gas.dim)]

    @property
    def of_species(self) -> list[Estimate]:
        """KT of each species over kT."""
        self._require_values()
        noise = _share_noise(self.gas.species_degrees_of_freedom, self.gas.degrees_of_freedom)
        first = 2 + self.gas.dim
        return [self._settled(first + k, float(noise[k]), k) for k in range(len(self.gas.sizes))]

    @property
    def a2(self) -> list[Estimate]:
        """a2 of each species; NaN for one of fewer than 10 particles."""
        self._require_values()
        gas, kinds = self.gas, len(self.gas.sizes)
        first = 2 + gas.dim + kinds
        return [
            self._settled(first + k, theory.cumulant_noise(int(n), gas.dim), k, slow=True)
            if n >= FEW
            else Estimate(math.nan, math.nan)
            for k, n in enumerate(gas.sizes)
        ]

    @property
    def expected_a2(self) -> FloatArray:
        """What an equilibrium gas of this size gives on average: -2/(D + 2), D of each species, (k,)."""
        return np.asarray(theory.equilibrium_a2(self.gas.species_degrees_of_freedom))

    @property
    def momentum(self) -> list[Estimate]:
        """Total momentum along each axis over sqrt(M kT): of unit variance at equilibrium if not fixed.

        Without error where it is the same in all frames, as along the axes of a periodic box.
        """
        self._require_values()
        first = 2 + self.gas.dim + 2 * len(self.gas.sizes)
        found = []
        for index in range(first, first + self.gas.dim):
            column = np.concatenate(self._columns(index))
            conserved = np.ptp(column) < FIXED if len(column) > 1 else self.gas.periodic[index - first]
            value = float(self._mean[index])
            found.append(Estimate(value, 0.0) if conserved else self._settled(index, 1.0))
        return found

    @property
    def drift(self) -> Estimate:
        """Change of kT from the first frame to the last by a straight line, relative to its mean.

        Least squares over all frames, taken as evenly spaced. The error is that of as many independent frames
        as the velocities and the residuals have; NaN with fewer than 4, or where the energy is conserved.
        """
        t, y, residuals = self._line_through(1)
        effective = min(self.effective_frames, float(len(y)))
        if len(y) >= 4 and np.ptp(residuals) > 0.0:
            effective = min(effective, len(y) / max(2.0 * block_length(residuals) / BLOCK_LENGTH, 1.0))
        change = float(t @ y / (t @ t) * np.ptp(t)) / self._level()
        if self.energy_conserved or effective < 4.0:
            return Estimate(change, math.nan, effective)
        variance = float(residuals @ residuals) / (effective - 2.0)
        error = math.sqrt(variance / float(t @ t)) * float(np.ptp(t)) / self._level()
        return Estimate(change, error, effective, effective - 2.0)

    @property
    def share_drifts(self) -> dict[str, Estimate]:
        """Changes, as `drift`, of kT along each axis and of each species over kT; empty for too few frames.

        The errors are those of the noise of so many particles at equilibrium.
        """
        self._require_values()
        gas, effective = self.gas, self.effective_frames
        if effective < FEWEST_BLOCKS:
            return {}
        names = [f"kT along {axis}" for axis in "xyz"[: gas.dim]]
        noise = [*_share_noise(_along(gas), gas.degrees_of_freedom)]
        if len(gas.sizes) > 1:
            names += [f"kT of species {kind + 1}" for kind in range(len(gas.sizes))]
            noise += [*_share_noise(gas.species_degrees_of_freedom, gas.degrees_of_freedom)]
        found = {}
        for index, (name, own) in enumerate(zip(names, noise, strict=True), 2):
            t, y, _ = self._line_through(index)
            length = float(np.ptp(t)) / float(t @ t)
            error = float(own) * math.sqrt(len(y) / effective * float(t @ t)) * length
            found[name] = Estimate(float(t @ y) * length, error, effective)
        return found

    def _line_through(self, index: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return numbers of frames and a column, both less their mean in each run, and its residuals."""
        columns = [column for column in self._columns(index) if len(column) > 1]
        self._require(bool(columns), "two frames", "add(frame) twice or more")
        t = np.concatenate([np.arange(len(each)) - (len(each) - 1) / 2 for each in columns])
        y = np.concatenate([each - each.mean() for each in columns])
        return t, y, y - float(t @ y) / float(t @ t) * t

    def _settled(self, index: int, noise: float, kind: int | None = None, slow: bool = False) -> Estimate:
        """Return the mean of a column: error from blocks, or from the noise of one frame at equilibrium."""
        columns = self._columns(index)
        rows, samples = sum(map(len, columns)), self.n_frames
        weights = (self._slow if slow else self._weights).effective
        effective = float(min(weights.min() if kind is None else weights[kind], samples))
        tau = samples / (2.0 * max(effective, 1.0))  # in frames
        needed = math.ceil(BLOCK_LENGTH * (tau - 0.25 / tau)) if tau > 0.55 else 1
        if rows >= FEWEST_BLOCKS and samples >= FEWEST_BLOCKS * needed:
            with warnings.catch_warnings():
                warnings.simplefilter("error", ShortSeriesWarning)
                shortest = [math.ceil(needed / series.samples_per_row) for series in self._series()]
                try:
                    found = self._pooled(columns, shortest=shortest)
                    if found.standard_error > 0.0:  # frames that repeat themselves have none
                        return found
                except ShortSeriesWarning:
                    each = [autocorrelation_time(column).n_effective for column in columns if len(column) > 1]
                    effective = min(effective, sum(each))
        return Estimate(float(self._mean[index]), noise / math.sqrt(max(effective, 1.0)), effective)

    @property
    def checks(self) -> list[TheoryCheck]:
        """KT along each axis and of each species beside kT, and a2 beside that of fixed energy."""
        labels = [f"species {k + 1}" for k in range(len(self.gas.sizes))]
        several = len(labels) > 1
        axes = [
            TheoryCheck(f"kT along {'xyz'[k]} / kT", "equipartition", found, 1.0, 0.0)
            for k, found in enumerate(self.along_axes)
        ]
        kinds = [
            TheoryCheck(f"kT of {label} / kT", "equipartition", found, 1.0, 0.0)
            for label, found in zip(labels, self.of_species if several else [], strict=False)
        ]
        a2 = [
            TheoryCheck(f"a2 of {label}" if several else "a2", "equilibrium", found, float(expected), 0.0)
            for label, found, expected in zip(labels, self.a2, self.expected_a2, strict=True)
            if not math.isnan(found.value)
        ]
        return [*axes, *kinds, *a2]

    @property
    def equal_axes(self) -> float:
        """Probability of axes as unequal as these at equilibrium."""
        found = self.along_axes
        squares = [((each.value - 1.0) / each.standard_error) ** 2 for each in found]
        dim, freedom = len(found), min(each.degrees_of_freedom for each in found)
        statistic = (1.0 - 1.0 / dim) * sum(squares)  # the sum of all is fixed
        if math.isinf(freedom):
            return float(special.chdtrc(dim - 1, statistic))
        return float(special.fdtrc(dim - 1, freedom, statistic / (dim - 1)))

    @property
    def equal_species(self) -> float:
        """Probability of species as unequal in temperature as these at equilibrium, by Bonferroni's bound."""
        found = [check.p_value for check in self.checks if check.quantity.startswith("kT of")]
        tests = len(found) if len(found) > 2 else 1  # of two species both say the same
        return min(1.0, min(found) * tests) if found else math.nan


def _along(gas: Gas) -> FloatArray:
    """Degrees of freedom along each axis, (d,)."""
    return np.asarray(gas.n - np.where(gas.periodic & (gas.n > 1), 1.0, 0.0))


def _share_noise(own: FloatArray, whole: float) -> FloatArray:
    """Return the noise in one frame of kT of some degrees of freedom over that of all, at fixed energy.

    Their share of the energy follows Beta(own/2, (whole - own)/2).
    """
    return np.asarray(np.sqrt(np.maximum(2.0 * (whole - own) / (own * (whole + 2.0)), 0.0)))
