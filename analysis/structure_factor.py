"""Structure factor S(k) of a periodic box, and its limit of long waves: the compressibility of the fluid."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis import theory
from analysis.estimator import PALETTE, PlacesEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.series import BlockSeries
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["StructureFactor"]

FloatArray = NDArray[np.float64]

AT_ONCE = 1_000_000  # phases held in memory
MOST_STEPS = 50  # of k below the window, and beyond
MANY = 20_000  # wave vectors of which those in a step are looked for


class StructureFactor(PlacesEstimator):
    """Structure factor S(k) = <|sum_j exp(i k.r_j)|^2>/N of all particles, from frames of a periodic box.

    Wave vectors are those that fit into the box, k = 2 pi (n_x/L_x, ...). S is averaged over those of nearly
    the same length: up to `window` over equal steps of k^2, at best each length for itself, beyond over equal
    steps of k.

    Parameters
    ----------
    k_max : float, default 15.0
        Largest wave number, in units of 1/mean diameter; the first peak of a liquid is at 7.
    vectors : int, default 24
        Most wave vectors in a step, chosen evenly where there are more. k and -k count once.
    window : float, default 2.0
        S is extrapolated to k = 0 from k < window, in the same unit.
    degree : int, default 2
        Degree of the polynomial in k^2 that is fitted there.

    Notes
    -----
    Frames a few collisions per particle apart are nearly independent for all but the longest waves, which
    decay as sound and by the conduction of heat; correlated ones are allowed, errors come from blocks
    (`series.estimate_from_series`) of the frames. Memory does not grow with the number of frames.
    """

    def __init__(self, k_max: float = 15.0, vectors: int = 24, window: float = 2.0, degree: int = 2) -> None:
        if not 0.0 < window <= k_max:
            raise ValueError(f"window = {window:g}; expected a positive number of at most k_max = {k_max:g}")
        if vectors < 1 or degree < 1:
            raise ValueError(f"vectors = {vectors}, degree = {degree}; expected at least 1 of each")
        self.k_max, self.vectors, self.window, self.degree = k_max, vectors, window, degree
        self._blocks = BlockSeries(256)
        self._waves = np.zeros((0, 0), dtype=np.int64)  # (waves, d), whole waves along each axis
        self._bins = np.zeros(0, dtype=np.int64)  # (waves,), the step of each

    def add(self, frame: Frame) -> Self:
        """Take in one frame.

        Parameters
        ----------
        frame : Frame
            Of a gas that is periodic along every axis; all frames of the same gas.

        Raises
        ------
        ValueError
            If an axis has walls, or too few waves with k < window fit into the box for the polynomial.
        """
        scene = self._follow(frame)
        phases = 2.0 * math.pi * frame.positions / scene.box
        largest = np.abs(self._waves).max(axis=0)
        powers = [
            np.exp(1j * np.arange(-most, most + 1)[:, None] * phases[:, axis])
            for axis, most in enumerate(largest.tolist())
        ]
        strength = np.empty(len(self._waves))
        rows = max(AT_ONCE // len(phases), 1)
        for start in range(0, len(self._waves), rows):
            chosen = slice(start, start + rows)
            product = np.ones((1, 1), dtype=complex)
            for axis, most in enumerate(largest.tolist()):
                product = product * powers[axis][self._waves[chosen, axis] + most]
            strength[chosen] = np.abs(product.sum(axis=1)) ** 2
        sums = np.bincount(self._bins, strength)
        self._blocks.add(sums / np.bincount(self._bins) / len(phases))
        return self

    def _begin(self, scene: Scene) -> None:
        if not scene.periodic.all():
            raise ValueError("S(k) needs a box that is periodic along every axis; this one has walls")
        gas = Gas.of(scene)
        diameter = gas.mean_diameter
        longest = 2.0 * math.pi * diameter / scene.box.max()
        if longest > self.k_max:
            raise ValueError(
                f"k_max = {self.k_max:g} is below {longest:.4g}, the wave number of the longest wave that "
                "fits into this box"
            )
        edges = _steps(longest, self.window, self.k_max)
        self._waves, self._bins = _chosen(2.0 * math.pi * diameter / scene.box, edges, self.vectors)
        self._gas = gas

    def _take_in(self, other: Self) -> None:
        if not len(self._waves):
            self._waves, self._bins = other._waves, other._bins
        super()._take_in(other)

    # Results ------------------------------------------------------------------------------------------------

    def _reduced(self) -> FloatArray:
        """Wave number of each wave in units of 1/mean diameter, (waves,)."""
        steps = 2.0 * math.pi * self.gas.mean_diameter / self.gas.box
        return np.asarray(np.linalg.norm(self._waves * steps, axis=1))

    def _over_steps(self, values: FloatArray) -> FloatArray:
        """Return the mean over the waves of each step."""
        return np.asarray(np.bincount(self._bins, values) / np.bincount(self._bins))

    @property
    def k(self) -> FloatArray:
        """Mean wave number of each step, (bins,), [1/length]."""
        self._require_frames()
        return self._over_steps(self._reduced()) / self.gas.mean_diameter

    @property
    def structure_factor(self) -> FloatArray:
        """S(k) of each step, (bins,)."""
        self._require_frames()
        return self._mean

    @property
    def structure_factor_error(self) -> FloatArray:
        """Standard errors of `structure_factor`, (bins,), from blocks as long as the limit asks for.

        Those of a single frame are those of independent waves, S times the root of 1 over their number.
        """
        self._require_frames()
        if self._frames == 1:
            return np.asarray(self._mean / np.sqrt(np.bincount(self._bins)))
        along = self._extrapolation() if self._fitted() > self.degree else self._inside() / self._fitted()
        return self._errors_of_rows(along)

    def _inside(self) -> FloatArray:
        """Return which steps are in the window, as 0 or 1; the first one, where none is."""
        inside = np.where(self._over_steps(self._reduced()) < self.window, 1.0, 0.0)
        return inside if inside.any() else np.asarray(np.arange(len(inside)) == 0, dtype=np.float64)

    def _fitted(self) -> int:
        return int(self._inside().sum())

    def _extrapolation(self) -> FloatArray:
        """Weights, (bins,), by which S of the steps gives the fitted polynomial in k^2 at k = 0.

        Least squares, each step with as much weight as it has waves.
        """
        squares = (self._reduced() / self.window) ** 2
        basis = np.stack([self._over_steps(squares**p) for p in range(self.degree + 1)], axis=1)
        root = np.sqrt(self._inside() * np.bincount(self._bins))
        return np.asarray(np.linalg.pinv(basis * root[:, None])[0] * root)

    @property
    def limit(self) -> Estimate:
        """S in the limit of long waves, extrapolated: of one species kT d rho/dP.

        Bias: what the polynomial does not follow, see `extrapolation_bias`.

        Raises
        ------
        ValueError
            If too few waves with k < window fit into the box.
        """
        self._require_frames()
        if self._fitted() <= self.degree + 1:
            raise ValueError(
                f"{self._fitted()} lengths of waves have k < window = {self.window:g}, and a polynomial of "
                f"degree {self.degree} in k^2 needs {self.degree + 2}; take a larger window, or a larger gas"
            )
        weights = self._extrapolation()
        if self._frames == 1:
            error = float(np.linalg.norm(weights * self.structure_factor_error))
            return Estimate(float(weights @ self._mean), error, 1.0)
        return self._pooled([series.rows @ weights for series in self._series()])

    @property
    def extrapolation_bias(self) -> float:
        """What the polynomial misses of a structure factor of this density, known in closed form.

        In 3D Percus and Yevick's; in 2D that of a direct correlation as the overlap of two discs.
        """
        self._require_frames()
        eta, k = self.gas.packing_fraction, self._reduced()
        if self.gas.dim == 3:
            whole = theory.percus_yevick_structure(np.append(k, 0.0), eta).value
        else:
            inverse = 1.0 / float(theory.structure_limit(eta, 2).value) - 1.0
            half = np.maximum(np.append(k, 0.0) / 2.0, 1e-6)
            whole = 1.0 / (1.0 + inverse * (2.0 * special.j1(half) / half) ** 2)
        return float(abs(self._extrapolation() @ self._over_steps(whole[:-1]) - whole[-1]))

    @property
    def check(self) -> TheoryCheck:
        """The limit of long waves beside the compressibility of the equation of state; of one species."""
        measured, gas = self.limit, self.gas
        expected = theory.structure_limit(gas.packing_fraction, gas.dim, gas.n)
        uncertainty = math.hypot(float(expected.uncertainty), self.extrapolation_bias)
        name = "compressibility of the equation of state"
        return TheoryCheck("S in the limit of long waves", name, measured, float(expected.value), uncertainty)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The one `check`; none of a mixture, and in a box into which too few long waves fit."""
        self._require_frames()
        known = len(self.gas.sizes) == 1 and self._fitted() > self.degree + 1
        return [self.check] if known else []

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw S(k) with its standard errors, Percus and Yevick's (3D), and the exact limit at k = 0."""
        k, measured, error = self.k, self.structure_factor, self.structure_factor_error
        axes, gas = axes_or_new(ax), self.gas
        axes.errorbar(k, measured, error, fmt=".", ms=4, color=PALETTE[0], label="simulation")
        if len(gas.sizes) == 1:
            diameter = gas.mean_diameter
            if gas.dim == 3:
                fine = np.linspace(0.0, float(k[-1]), 400)
                expected = theory.percus_yevick_structure(fine * diameter, gas.packing_fraction).value
                axes.plot(fine, expected, color=PALETTE[1], lw=1.2, label="Percus and Yevick")
            limit = theory.structure_limit(gas.packing_fraction, gas.dim).value
            axes.plot(0.0, limit, "D", color=PALETTE[1], mfc="none", label="exact limit")
        axes.axhline(1.0, color="0.7", lw=1, zorder=0)
        axes.set_ylim(bottom=0.0)
        return labelled(axes, "wave number k", "structure factor S(k)")


def _steps(longest: float, window: float, k_max: float) -> FloatArray:
    """Return the edges of the steps of k: equal ones of k^2 up to the window, equal ones of k beyond."""
    square = max(longest**2, window**2 / MOST_STEPS)
    inside = np.sqrt(np.arange(0.5 * longest**2, window**2, square)) if longest < window else np.zeros(0)
    beyond = max(longest, (k_max - window) / MOST_STEPS)
    start = max(window, longest * (1.0 - 1e-9))
    count = max(math.ceil((k_max - start) / beyond), 1)
    return np.concatenate([inside, np.linspace(start, k_max * (1.0 + 1e-9), count + 1)])


def _chosen(unit: FloatArray, edges: FloatArray, most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return wave vectors in whole waves along each axis, and the step of each; at most so many in a step.

    Parameters
    ----------
    unit : (d,) array
        Wave number of one wave along each axis.
    edges : array
        Of the steps of k.
    most : int
        In a step.
    """
    rng, found, places = np.random.default_rng(0), [], []
    for low, high in itertools.pairwise(edges.tolist()):
        inside = _candidates(unit, low, high, most, rng)
        if len(inside):
            found.append(inside)
            places.append(len(inside))
    return np.concatenate(found), np.repeat(np.arange(len(places)), places)


def _candidates(
    unit: FloatArray, low: float, high: float, most: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Return wave vectors with k from low to high: all, or so many evenly chosen ones."""
    reach = np.floor(high / unit).astype(int)
    if np.prod(2 * reach + 1) <= MANY:
        axes = [np.arange(-each, each + 1) for each in reach]
        waves = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(unit))
    else:  # directions at random, rounded to what fits into the box
        directions = rng.normal(size=(8 * most, len(unit)))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        lengths = rng.uniform(low, high, len(directions))
        waves = np.rint(directions * lengths[:, None] / unit).astype(int)
    first = np.take_along_axis(waves, np.argmax(waves != 0, axis=1)[:, None], axis=1)
    waves = np.unique(waves * np.sign(first), axis=0)  # of k and -k one
    k = np.linalg.norm(waves * unit, axis=1)
    waves = waves[(k >= low) & (k < high) & (k > 0.0)]
    if len(waves) > most:
        waves = waves[np.sort(rng.choice(len(waves), most, replace=False))]
    return np.asarray(waves, dtype=np.int64)
