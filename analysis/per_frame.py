"""Base of estimators of a few numbers per frame, whose first one is the result."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis.correlation_times import FrameWeights
from analysis.estimator import BlockEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.series import SHORT_RUN, BlockSeries
from analysis.statistics import Estimate, estimate_from_replicas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["PerFrame"]

FloatArray = NDArray[np.float64]


class PerFrame(BlockEstimator):
    """A few numbers per frame, the first of which is the result; memory does not grow with the frames."""

    _ylabel = ""
    _line = "equilibrium"

    def __init__(self) -> None:
        self._blocks = BlockSeries()  # s, then what `_measure` returns
        self._weights = FrameWeights()
        self._last = math.nan

    @abstractmethod
    def _measure(self, frame: Frame) -> list[float]:
        """Return what is kept of a frame."""

    def add(self, frame: Frame) -> Self:
        """Take in one frame and return the estimator itself."""
        measured = self._measure(frame)
        self._gas = self._gas or Gas.of(frame.scene)
        self._blocks.add([frame.collisions_per_particle, *measured])
        self._weights.add(frame)
        self._last = measured[0]
        return self

    def _take_in(self, other: Self) -> None:
        super()._take_in(other)
        self._weights.merge(other._weights)
        if math.isnan(self._last):
            self._last = other._last

    def _require_values(self) -> None:
        self._require(bool(self._series()), "values", "add(frame)")

    def _columns(self, index: int) -> list[FloatArray]:
        """Return one column of the rows of each run."""
        self._require_values()
        return [series.rows[:, index] for series in self._series()]

    def _estimate(self, index: int) -> Estimate:
        """Return the mean of a column over frames: error from blocks, below 16 frames from their spread.

        For few frames the variance is s^2 (n - 1)/n over `effective` - 1, with the effective number of
        independent frames from `FrameWeights`; it is s^2/n if all are independent.
        """
        columns = self._columns(index)
        self._weights.warn_if_frozen()
        if sum(map(len, columns)) >= SHORT_RUN:
            return self._pooled(columns)
        values, effective = np.concatenate(columns), float(self._weights.effective.min())
        estimate, more = estimate_from_replicas(values), effective - 1.0
        error = estimate.standard_error * math.sqrt((len(values) - 1) / more) if more > 0.0 else math.nan
        return Estimate(estimate.value, error, effective, more)

    @property
    def values(self) -> FloatArray:
        """The value in each frame, (frames,); beyond 1023 frames means over as many neighbours as needed."""
        return np.concatenate(self._columns(1))

    @property
    def collisions_per_particle(self) -> FloatArray:
        """Collisions per particle s of each of `values`."""
        return np.concatenate(self._columns(0))

    def _level(self) -> float:
        """Return where `plot` draws a line; NaN for none."""
        return 0.0

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the value of every frame against collisions per particle, over a level to compare with."""
        values = self.values
        axes = axes_or_new(ax)
        if math.isfinite(self._level()):
            axes.axhline(self._level(), color="0.4", lw=1.5, label=self._line)
        axes.plot(self.collisions_per_particle, values, ".", label="simulation")
        return labelled(axes, "collisions per particle s", self._ylabel)
