"""A gas, or the particles of one half of it, that spreads into the whole box."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import PALETTE, axes_or_new, labelled
from analysis.statistics import (
    Estimate,
    TheoryCheck,
    estimate_from_jackknife,
    replica_mean,
)
from analysis.temperatures import SampledReplicas
from analysis.theory import Prediction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["HALF_WAY", "Spreading", "cell_counts", "in_upper_half", "started_below"]

FloatArray = NDArray[np.float64]
Bools = NDArray[np.bool_]

HALF_WAY = 0.25  # share in the upper half, of the 1/2 in equilibrium
PER_COLLISION, MOST, MIXING = 0.008, 0.25, 0.012  # known errors of theory, see `Spreading.theory`


def started_below(scene: Scene, axis: int) -> Bools:
    """Return which particles of a scene are in the lower half of the box along an axis, (N,)."""
    return np.asarray(scene.positions[:, axis] < 0.5 * scene.box[axis])


def cell_counts(positions: FloatArray, scene: Scene, axis: int, cells: int) -> FloatArray:
    """Return how many of these positions are in each of equal cells between the walls of an axis, (b,).

    The cells divide where centres can be, from a radius off the lower wall to a radius off the upper one: a
    gas that is spread evenly fills them equally.
    """
    radius, edge = float(scene.radii[0]), float(scene.box[axis])
    place = (positions[:, axis] - radius) / (edge - 2.0 * radius) * cells
    which = np.clip(place.astype(np.int64), 0, cells - 1)  # a contact with a wall is rounded
    return np.bincount(which, minlength=cells).astype(np.float64)


def in_upper_half(cells: FloatArray) -> FloatArray:
    """Return the sum over the upper half of the cells, which are the last axis."""
    return np.asarray(cells[..., cells.shape[-1] // 2 :].sum(axis=-1))


class Spreading(SampledReplicas):
    """Where particles are that were all in the lower half of a box between walls, against time.

    Followed are the particles whose simulation started with them below the middle: all of a gas that is let
    out of half of a box, or half of those of a gas in equilibrium, whose two halves mix. Theory of the first:
    no collisions, `theory.spread_shares` with s = sqrt(kT/m) t. Of the second: the same with the displacement
    of a tracer in equilibrium, `theory.tracer_displacement`.

    Parameters
    ----------
    axis : int, default 0
        Along which axis, between walls.
    cells : int, default 20
        Equal cells along it, an even number.
    filled : float, optional
        Up to which coordinate the centres are evenly spread at the start, [length]: the middle by default.
    """

    def __init__(self, axis: int = 0, cells: int = 20, filled: float | None = None) -> None:
        super().__init__()
        if cells < 2 or cells % 2:
            raise ValueError(f"cells = {cells}; expected an even number, so that the middle is an edge")
        self.axis, self.cells, self.filled = axis, cells, filled

    def add(self, frame: Frame) -> Self:
        """Take in the next frame of this replica, or the first of another: that of the start.

        Raises
        ------
        ValueError
            If it begins later, or this estimator is not for the gas.
        """
        if self._begins(frame.time, "time") and frame.time > 0.0:
            raise ValueError(f"the first frame is at time {frame.time:g}; begin with the simulation's start")
        return super().add(frame)

    def _measure(self, frame: Frame) -> FloatArray:
        scene = frame.scene
        if not 0 <= self.axis < scene.dim:
            raise ValueError(f"axis = {self.axis} in a gas of {scene.dim} dimensions")
        if scene.periodic[self.axis]:
            raise ValueError(f"axis {self.axis} is periodic; a gas spreads here between two walls")
        if scene.species.any():
            raise ValueError(f"the gas has {scene.species.max() + 1} species; this is for one")
        followed = started_below(scene, self.axis)
        if not followed.any():
            raise ValueError("no particle starts in the lower half of the box")
        return cell_counts(frame.positions[followed], scene, self.axis, self.cells)

    @property
    def edges(self) -> FloatArray:
        """Edges of the cells, (b + 1,), [length]."""
        radius = 0.5 * float(self.gas.diameters[0])
        return np.linspace(radius, float(self.gas.box[self.axis]) - radius, self.cells + 1)

    @property
    def mixing(self) -> bool:
        """Whether there are other particles too: two halves mix."""
        return bool(self.samples[0, 0].sum() < self.gas.n)

    @property
    def shares(self) -> FloatArray:
        """Share of the particles in each cell, mean over replicas, (S, b)."""
        return replica_mean(self._shares)[0]

    @property
    def shares_error(self) -> FloatArray:
        """Standard errors of `shares`, (S, b); NaN for a single replica."""
        return replica_mean(self._shares)[1]

    @property
    def _shares(self) -> FloatArray:
        counts = self.samples
        return np.asarray(counts / counts.sum(axis=2, keepdims=True))

    @property
    def _crossed(self) -> FloatArray:
        return in_upper_half(self._shares)

    @property
    def crossed(self) -> FloatArray:
        """Share of the particles in the upper half, mean over replicas, (S,)."""
        return replica_mean(self._crossed)[0]

    @property
    def crossed_error(self) -> FloatArray:
        """Standard error of `crossed`, (S,); NaN for a single replica."""
        return replica_mean(self._crossed)[1]

    @property
    def entropies(self) -> list[Estimate]:
        """Coarse-grained entropy per particle of each sample, from 0 in one half to ln 2: `spread_entropy`.

        Of the mean density of all replicas. Counts fluctuate, which makes the entropy of n particles in b
        cells too small by (b - 1)/(2 n) (Miller 1955): the jackknife over replicas removes that. A single
        replica has no error, and keeps its bias. Where the gas is spread evenly, the entropy is at its
        maximum and its error of second order; the one quoted is then up to sqrt(2) too large.
        """
        return [
            estimate_from_jackknife(counts, lambda mean: float(theory.spread_entropy(mean)))
            for counts in np.swapaxes(self.samples, 0, 1)
        ]

    @property
    def half_time(self) -> Estimate:
        """When a quarter of the particles is in the upper half, half of what it holds at last, [time].

        Interpolated between two samples, of which the first that is beyond decides; jackknife over replicas.
        """
        time, crossed = self.time, self._crossed
        self._require(bool(self.crossed.max() > HALF_WAY), "half-time", "add(frame) at later times")
        return estimate_from_jackknife(crossed, lambda mean: _first_time(time, mean))

    def displacement(self, time: FloatArray) -> Prediction:
        """Return the standard deviation of displacements along the axis in theory, [length]."""
        gas = self.gas
        diameter, mass = float(gas.diameters[0]), float(gas.masses[0])
        if not self.mixing:
            free = math.sqrt(gas.temperature / mass) * np.asarray(time)
            return Prediction(free, np.zeros_like(free))
        edge = float(gas.box[self.axis])
        eta = gas.packing_fraction * edge / (edge - diameter)  # where centres can be
        return theory.tracer_displacement(time, eta, gas.dim, diameter, mass, gas.temperature)

    def expected(self, time: FloatArray) -> FloatArray:
        """Return the shares of the cells in theory at any times since the start, (..., b)."""
        return self._spread(self.displacement(time).value)

    def _spread(self, displacement: FloatArray) -> FloatArray:
        edges = self.edges
        start = edges[0]
        filled = (0.5 * (edges[0] + edges[-1]) if self.filled is None else self.filled) - start
        return theory.spread_shares(displacement, edges - start, float(edges[-1] - start), float(filled))

    def _predicted(self, of_shares: Callable[[FloatArray], FloatArray]) -> Prediction:
        """Return a function of the shares in theory at `time`, and what is known of its error."""
        displacement = self.displacement(self.time)
        value = of_shares(self._spread(displacement.value))
        other = of_shares(self._spread(displacement.value + displacement.uncertainty))
        most = MIXING if self.mixing else MOST
        return Prediction(value, np.hypot(other - value, np.minimum(PER_COLLISION * self.s, most)))

    @property
    def theory(self) -> Prediction:
        """What is expected of `crossed`, (S,).

        Without collisions it is exact. Each collision per particle was found to change it by up to 0.008
        (this package, 1000 spheres and discs, packing fractions 0.001 to 0.1 at the start): u = 0.008 s, at
        most 0.25. In an equilibrium that mixes it was off by up to 0.01 where the mean free path is a third
        of the box: u = 0.008 s, at most 0.012, and what the uncertainty of D makes.
        """
        return self._predicted(in_upper_half)

    @property
    def theory_entropy(self) -> Prediction:
        """What is expected of `entropies`, (S,); u as in `theory`, and `layering`."""
        found = self._predicted(theory.spread_entropy)
        return Prediction(found.value, np.hypot(found.uncertainty, self.layering))

    @property
    def layering(self) -> float:
        """By how much the entropy of a gas at rest may be below ln 2: its density is higher at the walls.

        (1.5 eta sigma/w)^2 / b for b cells of width w, from an excess of 1.5 eta sigma times the density
        at each wall, as it was found at eta = 0.1 (this package); an upper limit in denser gases.
        """
        gas = self.gas
        width = float(self.edges[1] - self.edges[0])
        return (1.5 * gas.packing_fraction * float(gas.diameters[0]) / width) ** 2 / self.cells

    @property
    def checks(self) -> list[TheoryCheck]:
        """The half-time, where the gas comes so far."""
        found = self.half_time
        time, expected = self.time, self.theory
        value = _first_time(time, expected.value)
        ends = [_first_time(time, expected.value + sign * expected.uncertainty) for sign in (-1.0, 1.0)]
        return [TheoryCheck("half-time", self.theory_name, found, value, abs(ends[1] - ends[0]) / 2.0)]

    @property
    def theory_name(self) -> str:
        """Which theory it is."""
        return "Enskog's diffusion" if self.mixing else "no collisions"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the share in the upper half and the entropy against time, over theory."""
        time, crossed, entropies = self.time, self.crossed, self.entropies
        axes = axes_or_new(ax)
        fine = np.linspace(0.0, float(time[-1]), 200)
        shares = self.expected(fine)
        lines = (in_upper_half(shares), theory.spread_entropy(shares))
        both = ([getattr(each, part) for each in entropies] for part in ("value", "standard_error"))
        values = ((crossed, self.crossed_error), tuple(map(np.array, both)))
        names = ("share in the upper half", "entropy per particle")
        for line, (value, error), name, colour in zip(lines, values, names, PALETTE, strict=False):
            axes.plot(fine, line, color=colour, lw=1.5)
            axes.errorbar(time, value, error, fmt="o", ms=4, color=colour, label=name)
        axes.plot([], [], color="0.4", lw=1.5, label=self.theory_name)
        return labelled(axes, "time", "share, entropy / $k_B$")


def _first_time(time: FloatArray, crossed: FloatArray) -> float:
    """Return when a quarter has crossed, between the first sample beyond and the one before."""
    after = int(np.argmax(crossed > HALF_WAY))
    if after == 0:
        return math.nan if crossed[0] <= HALF_WAY else float(time[0])
    low, high = crossed[after - 1], crossed[after]
    return float(time[after - 1] + (HALF_WAY - low) / (high - low) * (time[after] - time[after - 1]))
