"""Pair distribution in a periodic box, its value at contact, and the pressure that this implies."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import PALETTE, PlacesEstimator, axes_or_new, labelled, over_runs
from analysis.reduced import Gas
from analysis.series import BlockSeries
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["ContactSamplingWarning", "PairDistribution"]

FloatArray = NDArray[np.float64]

SPARSE = 10.0  # pairs in a bin below which the variance from blocks is not reliable


class ContactSamplingWarning(UserWarning):
    """Frames were taken at collisions: a pair is in contact in each, which makes g at contact too large."""


class PairDistribution(PlacesEstimator):
    """Pair distributions g_ij(r) between species, from frames of a periodic box.

    g_ij = V / (N_i N_j) <number of j in a shell around an i> / volume of the shell; i itself is not counted
    among the N_i, so that g tends to 1 - 1/N_i far away for i = j. With this normalisation the contact
    theorem holds at any N: canonically Z_N - 1 = 2^(d-1) eta g(sigma+). Bins are in x = (r -
    sigma_ij)/sigma_ij, from contact outwards.

    Parameters
    ----------
    depth : float, default 1.0
        How far beyond contact, in contact distances.
    bins : int, default 100
        Number of equal bins in x.
    window : float, default 0.25
        g is extrapolated to contact from x < window.
    degree : int, default 4
        Degree of the polynomial in x that is fitted there. In 3D at eta = 0.45 Z is then right to 0.1 %, with
        degree 3 it is 0.5 % too small.

    Notes
    -----
    Take frames at times that are independent of the collisions, such as ``sim.frames(every=...)``. Right
    after a collision, as ``sim.frames(collisions_per_particle=...)`` gives them, one pair is always in
    contact; where that happened in more than half of the frames, the contact value comes with a
    `ContactSamplingWarning`. Frames a few collisions per particle apart are nearly independent; correlated
    ones are allowed, errors come from blocks (`series.estimate_from_series`) of the frames. Those of a single
    frame are Poisson's of its pairs. Memory does not grow with the number of frames.
    """

    def __init__(self, depth: float = 1.0, bins: int = 100, window: float = 0.25, degree: int = 4) -> None:
        if not (0.0 < window <= depth and bins * window / depth > 2 * degree + 4):
            raise ValueError(
                f"window = {window:g} of depth = {depth:g} with {bins} bins; a polynomial of degree "
                f"{degree} needs "
                f"more than {2 * degree + 4} bins in the window, which ends within the depth"
            )
        self.degree = degree
        self.window = window
        self.edges: FloatArray = np.linspace(0.0, depth, bins + 1)
        self._blocks = BlockSeries(256)
        self._at_collision = 0
        self._scene: Scene | None = None

    def add(self, frame: Frame) -> Self:
        """Take in one frame.

        Parameters
        ----------
        frame : Frame
            Of a gas that is periodic along every axis; all frames of the same gas.

        Raises
        ------
        ValueError
            If an axis has walls, or the box is not twice as long as the largest r.
        """
        from scipy.spatial import cKDTree  # loaded where it is needed: it takes long

        scene = self._follow(frame)
        species, depth = self.gas, float(self.edges[-1])
        reach = float(species.diameters.max()) * (1.0 + depth)
        tree = cKDTree(frame.positions, boxsize=scene.box)
        i, j = tree.query_pairs(reach, output_type="ndarray").T
        apart = frame.positions[i] - frame.positions[j]
        apart -= scene.box * np.rint(apart / scene.box)
        contact = scene.radii[i] + scene.radii[j]
        x = np.sqrt(np.einsum("nk,nk->n", apart, apart)) / contact - 1.0
        self._at_collision += bool(len(x) and x.min() < 1e-10)
        pairs, kinds = self._pairs(), len(species.sizes)
        first = np.minimum(scene.species[i], scene.species[j])
        second = np.maximum(scene.species[i], scene.species[j])
        place = np.zeros((kinds, kinds), dtype=np.intp)
        for index, pair in enumerate(pairs):
            place[pair] = index
        bins = len(self.edges) - 1
        slot = np.maximum(np.floor(x / depth * bins), 0.0).astype(np.intp)  # contacts may overlap by rounding
        inside = slot < bins
        counts = np.bincount(
            (place[first, second] * bins + slot)[inside], minlength=len(pairs) * bins
        ).reshape(-1, bins)
        self._blocks.add(counts / self._ideal())
        return self

    def _begin(self, scene: Scene) -> None:
        if not scene.periodic.all():
            raise ValueError("g(r) needs a box that is periodic along every axis; this one has walls")
        reach = 2.0 * float(scene.radii.max()) * (1.0 + float(self.edges[-1]))
        if reach > scene.box.min() / 2:
            raise ValueError(
                f"depth = {self.edges[-1]:g} reaches to r = {reach:.4g}, beyond half of the shortest edge, "
                f"{scene.box.min() / 2:.4g}; choose a smaller depth or a larger gas"
            )
        self._scene, self._gas = scene, Gas.of(scene)

    def _take_in(self, other: Self) -> None:
        self._scene = self._scene or other._scene
        super()._take_in(other)
        self._at_collision += other._at_collision

    def _pairs(self) -> list[tuple[int, int]]:
        return list(itertools.combinations_with_replacement(range(len(self.gas.sizes)), 2))

    def _ideal(self) -> FloatArray:
        """Pairs that each bin would hold without any correlation, (pairs, bins)."""
        gas, sizes = self.gas, self.gas.sizes
        shells = self._shells(gas.dim)
        rows = []
        for i, j in self._pairs():
            pairs = sizes[i] * sizes[j] / (2.0 if i == j else 1.0)
            rows.append(pairs / gas.volume * self._contact(i, j) ** gas.dim * shells)
        return np.array(rows)

    def _shells(self, dim: int) -> FloatArray:
        """Volume of each bin's shell in units of contact distance^d."""
        ball = 4 * math.pi / 3 if dim == 3 else math.pi
        return np.asarray(ball * np.diff((1.0 + self.edges) ** dim))

    def _contact(self, i: int, j: int) -> float:
        diameters = self.gas.diameters
        return float(diameters[i] + diameters[j]) / 2.0

    # Results ------------------------------------------------------------------------------------------------

    def _rows(self) -> list[FloatArray]:
        """Return the rows of each run."""
        self._require_frames()
        return [series.rows for series in self._series()]

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Which two species each row of `g` is of."""
        self._require_frames()
        return self._pairs()

    @property
    def r(self) -> FloatArray:
        """Middle of each bin, (pairs, bins), [length]."""
        self._require_frames()
        middle = 1.0 + (self.edges[1:] + self.edges[:-1]) / 2
        return np.array([self._contact(i, j) * middle for i, j in self._pairs()])

    @property
    def g(self) -> FloatArray:
        """Pair distributions averaged over each bin's shell, (pairs, bins)."""
        self._require_frames()
        return self._mean

    @property
    def g_error(self) -> FloatArray:
        """Standard errors of `g`, (pairs, bins), from blocks as long as the contact value asks for.

        In bins of fewer than 10 pairs no less than Poisson's, see `_sparse_variance`.
        """
        if self._frames == 1:
            return np.asarray(np.sqrt(self._poisson_variance()))
        along = np.outer(self._shares(), self._extrapolation(self.degree))
        error = self._errors_of_rows(along)
        return np.asarray(np.maximum(error, self._sparse_variance() ** 0.5))

    def _sparse(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return pairs observed, pairs expected without correlation, and which bins are sparse (0 or 1)."""
        expected = self._ideal() * self._frames
        seen = self._mean * expected
        return seen, expected, np.where(seen < SPARSE, 1.0, 0.0)

    def _sparse_variance(self) -> FloatArray:
        """Return the least variance of g in bins of fewer than `SPARSE` pairs, 0 in others, (pairs, bins).

        A bin without pairs still has an uncertainty: if E pairs are expected without correlation and n were
        observed, the variance is Poisson's for max(n, E) pairs, or max(n, E)/E^2 of g.
        """
        return np.asarray(self._sparse()[2] * self._poisson_variance())

    def _poisson_variance(self) -> FloatArray:
        """Return the variance of g from max(n, E) pairs in each bin, (pairs, bins)."""
        seen, expected, _ = self._sparse()
        return np.asarray(np.maximum(seen, expected) / expected**2)

    def _sum_over_bins(self, runs: Sequence[FloatArray], weights: FloatArray) -> Estimate:
        """Return the mean of a sum of g over bins, from its value in each row of each run."""
        if self._frames == 1:
            error = math.sqrt(float((weights**2 * self._poisson_variance()).sum()))
            return Estimate(float(runs[0][0]), error, 1.0)
        return self._with_floor(self._pooled(runs), weights)

    def _with_floor(self, estimate: Estimate, weights: FloatArray) -> Estimate:
        """Return a sum of g over bins with no smaller an error than sparse bins leave; weights (pairs, bins).

        As `_sparse_variance`, but with g of all sparse bins of a pair of species together: n/E, at least 1,
        in place of each bin's own, since a single pair is a poor estimate for its bin.
        """
        seen, expected, sparse = self._sparse()
        sparse = np.where(weights != 0.0, sparse, 0.0)
        all_expected = np.maximum((sparse * expected).sum(axis=1), 1e-300)
        g = np.maximum((sparse * seen).sum(axis=1) / all_expected, 1.0)
        floor = math.sqrt(float((weights**2 * sparse * g[:, None] / expected).sum()))
        if estimate.standard_error >= floor:
            return estimate
        return Estimate(estimate.value, floor, estimate.n_effective)

    def _extrapolation(self, degree: int) -> FloatArray:
        """Weights, (bins,), by which g averaged over bins gives the fitted polynomial at x = 0.

        Least squares with the shells' volumes as weights, which are those of counts where g is flat, and with
        the polynomial averaged over each bin: fixed numbers, so that the result is linear in the data.
        """
        dim = self.gas.dim
        last = int(np.searchsorted(self.edges, self.window * (1.0 + 1e-9), side="right")) - 1
        low, high = self.edges[:last], self.edges[1 : last + 1]
        nodes, weights = np.polynomial.legendre.leggauss(degree + 3)
        x = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * nodes
        measure = weights * (1.0 + x) ** (dim - 1)
        basis = np.stack(
            [(measure * (x / self.window) ** p).sum(axis=1) / measure.sum(axis=1) for p in range(degree + 1)],
            axis=1,
        )
        root = np.sqrt(self._shells(dim)[:last])
        functional = np.zeros(len(self.edges) - 1)
        functional[:last] = np.linalg.pinv(basis * root[:, None])[0] * root
        return functional

    def _contact_rows(self) -> list[FloatArray]:
        """Return the contact values of each row of each run, (rows, pairs)."""
        runs = self._rows()
        if self._at_collision > self._frames / 2:
            warnings.warn(
                f"a pair was in contact in {self._at_collision} of {self._frames} frames, which "
                "were taken at collisions: g at contact is too large; take frames at equal times",
                ContactSamplingWarning,
                stacklevel=3,
            )
        functional = self._extrapolation(self.degree)
        return [np.asarray(rows @ functional) for rows in runs]

    def _shares(self) -> FloatArray:
        """Return what each pair's contact value adds to canonical Z - 1, (pairs,)."""
        gas, sizes = self.gas, self.gas.sizes
        ball = 2 * math.pi / 3 if gas.dim == 3 else math.pi / 2
        shares = []
        for i, j in self._pairs():
            both = sizes[i] * sizes[j] * (1.0 if i == j else 2.0) / gas.n**2
            shares.append(ball * gas.n / gas.volume * both * self._contact(i, j) ** gas.dim)
        return np.array(shares)

    @property
    def contact(self) -> dict[tuple[int, int], Estimate]:
        """g_ij at contact by extrapolation, for each pair of species.

        Bias: what the polynomial does not follow, see `extrapolation_bias`. If very few pairs came near
        contact the error is Poisson's, as for `g_error`.
        """
        values, functional = self._contact_rows(), self._extrapolation(self.degree)
        contacts = {}
        for index, pair in enumerate(self._pairs()):
            weights = np.zeros((values[0].shape[1], len(functional)))
            weights[index] = functional
            contacts[pair] = self._sum_over_bins([run[:, index] for run in values], weights)
        return contacts

    @property
    def compressibility_factor(self) -> Estimate:
        """Z = P V / (2 K_th / d) from the contact values.

        Z - 1 = N/(N-1) (2 pi/3) rho sum x_i x_j sigma_ij^3 g_ij in 3D, (pi/2) rho sum x_i x_j sigma_ij^2 g_ij
        in 2D: the virial theorem, exact at any N but for the extrapolation. Comparable with `Pressure.virial`
        and with `theory.finite_size_compressibility`.
        """
        shares = self._shares() * self.gas.n / (self.gas.n - 1)
        weights = np.outer(shares, self._extrapolation(self.degree))
        return self._sum_over_bins([1.0 + run @ shares for run in self._contact_rows()], weights)

    @property
    def extrapolation_bias(self) -> float:
        """Uncertainty of Z from the extrapolation: its change with a polynomial one degree higher.

        It contains noise of about the standard error of Z, and is an upper bound while that dominates.
        """
        frames = [series.n_samples for series in self._series()]
        mean = over_runs([rows.mean(axis=0) for rows in self._rows()], frames) @ np.stack(
            [self._extrapolation(self.degree), self._extrapolation(self.degree + 1)], axis=1
        )
        both = self._shares() @ mean * (self.gas.n / (self.gas.n - 1))
        return float(abs(both[1] - both[0]))

    @property
    def check(self) -> TheoryCheck:
        """Z from contact beside theory with its finite-size correction; u includes `extrapolation_bias`."""
        from analysis.pressure import Pressure

        measured = self.compressibility_factor
        assert self._scene is not None
        scene = self._scene
        if not scene.thermal_energy > 0.0:  # positions alone; Z does not depend on velocities
            scene = scene.with_state(scene.positions, scene.positions - scene.positions.mean(axis=0))
        name, expected = next(iter(Pressure(scene).predictions.items()))
        uncertainty = math.hypot(expected.uncertainty, self.extrapolation_bias)
        return TheoryCheck("Z from g at contact", name, measured, expected.value, uncertainty)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The one `check`."""
        return [self.check]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw g(r) of each pair of species with its standard errors, and theory's contact value."""
        r, g, error = self.r, self.g, self.g_error
        axes = axes_or_new(ax)
        gas = self.gas
        if len(gas.sizes) > 1:
            expected = theory.mixture_contact_values(gas.sizes / gas.volume, gas.diameters, gas.dim)
        else:
            expected = np.array([[float(theory.contact_value(gas.packing_fraction, gas.dim))]])
        for index, (i, j) in enumerate(self.pairs):
            colour = PALETTE[index % len(PALETTE)]
            label = "simulation" if len(r) == 1 else f"species {i}, {j}"
            axes.errorbar(r[index], g[index], error[index], fmt=".", ms=3, color=colour, label=label)
            axes.plot(self._contact(i, j), expected[i, j], "D", color=colour, mfc="none")
        axes.plot([], [], "D", color="0.4", mfc="none", label="theory at contact")
        axes.axhline(1.0, color="0.7", lw=1, zorder=0)
        return labelled(axes, "distance r", "pair distribution g(r)")
