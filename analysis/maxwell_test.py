"""Kolmogorov and Smirnov's test of the velocities in independent frames, all together."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis.correlation_times import FrameWeights
from analysis.estimator import PALETTE, Estimator, axes_or_new, counted, labelled
from analysis.moments import FEW
from analysis.reduced import Gas
from analysis.statistics import Estimate, TheoryCheck
from analysis.velocities import stephens

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["MaxwellTest"]

FloatArray = NDArray[np.float64]

BINS = 1 << 14  # of probability: the distance is that of unbinned values to 6e-5


class MaxwellTest(Estimator):
    """Distance of speeds and velocity components from Maxwell and Boltzmann's law, and its significance.

    For each species (of at least 10 particles), the largest distance between the distribution of the speeds,
    or of the components along one axis, and the law of normal velocities that is exact for any N. Mean
    velocity and mean square are those of the same species in the same frame: different temperatures do not
    count here, see `moments.VelocityMoments`.

    Notes
    -----
    Only frames at least four velocity correlation times apart are taken (`correlation_times.FrameWeights`);
    their values together are compared with Kolmogorov's statistic of a law whose scale comes from the sample
    (Stephens, J. Am. Stat. Assoc. 69, 730 (1974), doi 10.2307/2286009). Memory does not grow with the frames.
    """

    def __init__(self) -> None:
        self._weights = FrameWeights()
        self._counts: NDArray[np.int64] = np.zeros((0, 0, BINS), dtype=np.int64)  # species, speeds and axes
        self._frames = self._tested = 0

    def add(self, frame: Frame) -> Self:
        """Take in one frame; all must be of one gas."""
        scene = frame.scene
        gas = self._gas or Gas.of(scene)
        own = len(gas.sizes), 1 + gas.dim
        if self._gas is None:
            self._counts = np.zeros((*own, BINS), dtype=np.int64)
        self._frames, self._gas = self._frames + 1, gas
        if not self._weights.add(frame):
            return self
        self._tested += 1
        for kind, size in enumerate(gas.sizes):
            if size < FEW:
                continue
            own_ones = frame.velocities[scene.species == kind]
            own_ones = own_ones - own_ones.mean(axis=0)
            along = own_ones**2
            total = np.maximum(along.sum(axis=0), 1e-300)
            most = (size - 1) / size  # of the sum, that one particle can have
            speeds = np.minimum(along.sum(axis=1) / total.sum() / most, 1.0)
            self._count(kind, 0, special.betainc(gas.dim / 2, gas.dim * (size - 2) / 2, speeds))
            half = special.betainc(0.5, (size - 2) / 2, np.minimum(along / total / most, 1.0)) / 2
            for axis, column in enumerate((0.5 + np.sign(own_ones) * half).T):
                self._count(kind, 1 + axis, column)
        return self

    def _count(self, kind: int, row: int, probabilities: FloatArray) -> None:
        place = np.minimum((probabilities * BINS).astype(np.int64), BINS - 1)
        self._counts[kind, row] += np.bincount(place, minlength=BINS)

    def _take_in(self, other: Self) -> None:
        self._counts = self._counts + other._counts if self._tested else other._counts
        self._frames, self._tested = self._frames + other._frames, self._tested + other._tested
        self._weights.merge(other._weights)

    @property
    def _added(self) -> str:
        return counted(self._frames, "frame")

    def _results(self) -> list[str]:
        found = zip(self.gas.labels, self.p_values[:, 0], strict=True) if self._tested else ()
        return [f"p of speeds{'' if label == 'all' else f', {label},'} {p:.2g}" for label, p in found]

    @property
    def n_tested(self) -> int:
        """How many frames count as independent and are tested."""
        self._require(self._tested > 0, "tested frames", "add(frame)")
        return self._tested

    @property
    def distances(self) -> FloatArray:
        """Distances of speeds, and of components along each axis, (k, 1 + d); NaN for a small species."""
        self._require(self._tested > 0, "distances", "add(frame)")
        counts = self._counts.cumsum(axis=-1)
        total = counts[..., -1:]
        share = counts / np.maximum(total, 1)
        apart = np.abs(share - np.arange(1, BINS + 1) / BINS).max(axis=-1)
        return np.asarray(np.where(total[..., 0] > 0, apart, np.nan))

    @property
    def p_values(self) -> FloatArray:
        """Probability of larger distances at equilibrium, (k, 1 + d); never below 1/2001."""
        found = np.full(self.distances.shape, np.nan)
        for (kind, row), distance in np.ndenumerate(self.distances):
            if not math.isnan(distance):
                null = _null(self.gas.dim if row == 0 else 1)
                scaled = distance * stephens(int(self.gas.sizes[kind]) * self._tested)
                found[kind, row] = (np.count_nonzero(null >= scaled) + 1) / (len(null) + 1)
        return found

    @property
    def checks(self) -> list[TheoryCheck]:
        """Each distance beside its mean at equilibrium, and the spread there; `p_values` compare them."""
        several = len(self.gas.sizes) > 1
        found = []
        for (kind, row), distance in np.ndenumerate(self.distances):
            if math.isnan(distance):
                continue
            n = int(self.gas.sizes[kind]) * self._tested
            null = _null(self.gas.dim if row == 0 else 1) / stephens(n)
            what = "speeds" if row == 0 else f"velocities along {'xyz'[row - 1]}"
            name = f"KS distance of {what}{f', species {kind + 1}' if several else ''}"
            measured = Estimate(float(distance), math.nan, float(n))
            mean, spread = float(null.mean()), float(null.std())
            found.append(TheoryCheck(name, "Maxwell-Boltzmann", measured, mean, spread))
        return found

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how far the distribution of speeds is above the law, against the probability of the law."""
        self._require(self._tested > 0, "tested frames", "add(frame)")
        axes = axes_or_new(ax)
        for kind, label in enumerate(self.gas.labels):
            counts = self._counts[kind, 0].cumsum()
            if counts[-1]:
                u = np.arange(1, BINS + 1) / BINS
                name = "simulation" if label == "all" else label
                axes.plot(u, counts / counts[-1] - u, color=PALETTE[kind % len(PALETTE)], label=name)
        axes.axhline(0.0, color="0.4", lw=1.5, label="Maxwell\u2013Boltzmann")
        return labelled(axes, "probability of a smaller speed", "measured less expected")


@lru_cache(maxsize=4)
def _null(dim: int) -> FloatArray:
    """Return 2000 scaled distances of 1000 speeds in `dim` dimensions (1: components), always the same."""
    n, rng = 1000, np.random.default_rng(np.random.SeedSequence([dim, 2000]))
    found = []
    ranks = np.arange(n + 1) / n
    for _ in range(10):
        values = rng.standard_normal((200, n, dim))
        values -= values.mean(axis=1, keepdims=True)
        squares = np.einsum("rnk,rnk->rn", values, values)
        share = squares / squares.sum(axis=1, keepdims=True) * (n / (n - 1))
        u = special.betainc(dim / 2, dim * (n - 2) / 2, np.minimum(share, 1.0))
        if dim == 1:
            u = 0.5 + np.sign(values[..., 0]) * u / 2
        u.sort(axis=1)
        found.append(np.maximum(ranks[1:] - u, u - ranks[:-1]).max(axis=1))
    return np.concatenate(found) * stephens(n)
