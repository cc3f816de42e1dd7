r"""Bond-orientational order of discs: how far apart neighbourhoods still point the same way.

The bonds of disc j to its six nearest neighbours, at angles theta, give its local order

.. math:: \psi_j = \frac{1}{6} \sum_{k=1}^{6} e^{6 i \theta_{jk}},

of modulus 1 on a triangular lattice, with six times its orientation as argument. The mean over all discs is
the global order Psi6, and

.. math:: g_6(r) = \frac{\langle \sum_{j \neq k} \psi_j \psi_k^* \, \delta(r - r_{jk}) \rangle}
                        {\langle \sum_{j \neq k} \delta(r - r_{jk}) \rangle}

falls exponentially in a liquid, as a power r^-eta6 with eta6 up to 1/4 in a hexatic, and to a constant in a
solid (Halperin, Nelson 1978, doi 10.1103/PhysRevLett.41.121).

**Which neighbours.** The six nearest: those of a million discs take a second and a half, Voronoi's seven. The
two differ at defects, where the local order is small anyway: in fluids at packing fractions 0.68, 0.70 and
0.715 the mean |Psi6| from Voronoi's neighbours is 1.0, 0.4 and 0.1 % larger. Of g6 far away a factor depends
on the choice, the decay does not.

**Which pairs.** All of them, in a time of N log N: psi is summed over the cells of a grid, and the
correlation of the sums comes from their Fourier transforms. A pair counts at the distance of its cells, half
a diameter wide: the first three diameters are coarse, and the rest is not.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from analysis.estimator import PALETTE, PlacesEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.series import BlockSeries, complex_autocorrelation_time
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["KOSTERLITZ_THOULESS", "HexaticOrder", "local_order"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

NEIGHBOURS = 6
KOSTERLITZ_THOULESS = 0.25
"""Largest exponent eta6 of a hexatic: it melts where g6 falls as r^-1/4."""
CELL = 0.5  # edge of a cell, in diameters: a cell holds one disc at most
FIRST = 0.6  # diameters, from which on pairs of touching discs are counted
GROWTH = 1.1  # from one edge of a bin to the next, where that is more than a cell
AT_ONCE = 4000  # discs whose neighbours the cache of a core holds


def local_order(positions: FloatArray, box: FloatArray) -> ComplexArray:
    """Return psi6 of every disc of a periodic box, from its six nearest neighbours.

    Parameters
    ----------
    positions : (N, 2) array
        Within the box, [0, L); N >= 7.
    box : (2,) array
        Edges.

    Returns
    -------
    (N,) complex array
        Of modulus 1 on a triangular lattice. A neighbour counts once, by its nearest image.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(positions, boxsize=box)
    found = np.empty(len(positions), dtype=np.complex128)
    for start in range(0, len(positions), AT_ONCE):
        own = tree.indices[start : start + AT_ONCE]  # neighbours follow each other, near in memory
        distance, near = tree.query(positions[own], k=NEIGHBOURS + 1)  # the first one is the disc itself
        bonds = positions[near[:, 1:]] - positions[own][:, None]
        bonds -= box * np.rint(bonds / box)
        along = (bonds[..., 0] + 1j * bonds[..., 1]) / distance[:, 1:]
        cubes = along * along * along
        found[own] = (cubes * cubes).mean(axis=1)
    return found


class HexaticOrder(PlacesEstimator):
    """Bond-orientational order of equal discs in a periodic box: size, correlation, and how long it lasts.

    A row per frame, in bounded memory. Errors come from blocks of automatic length
    (`series.estimate_from_series`): a run that is short against the time in which Psi6 changes says so in a
    `SeriesWarning`, and near melting that time is tens of thousands of collisions per particle and more.

    Notes
    -----
    psi of N discs that do not know of each other gives |Psi6| of order 1/sqrt(N): N <|Psi6|^2> is then
    `local_order`, and <|Psi6|> sqrt(pi/4) of the root. In a liquid of correlation length xi it is larger by
    some xi^2 rho; in a hexatic <|Psi6|^2> falls as N^(-eta6/2), no faster than N^(-1/8).
    """

    def __init__(self) -> None:
        # s, Re Psi, Im Psi, |Psi|, |Psi|^2, mean |psi|^2, then per bin pairs and their correlation, over N^2
        self._blocks = BlockSeries()

    def add(self, frame: Frame) -> Self:
        """Take in one frame.

        Parameters
        ----------
        frame : Frame
            Of at least seven equal discs, periodic along both axes; all frames of the same gas.

        Raises
        ------
        ValueError
            If it is of spheres, of discs of several sizes or of fewer than seven, or an axis has walls.
        """
        scene = self._follow(frame)
        psi = local_order(frame.positions, scene.box)
        whole = complex(psi.mean())
        pairs, products = _correlated(frame.positions, psi, self.gas)
        size = abs(whole)
        numbers = [frame.collisions_per_particle, whole.real, whole.imag, size, size**2, _square(psi)]
        self._blocks.add(np.concatenate([numbers, pairs, products]))
        return self

    def _begin(self, scene: Scene) -> None:
        if scene.dim != 2:
            raise ValueError("hexatic order is one of discs; this scene is in 3D, see order.BondOrder")
        if not scene.periodic.all():
            raise ValueError("hexatic order needs a box that is periodic along both axes; this one has walls")
        if scene.radii.min() < scene.radii.max():
            raise ValueError("hexatic order is measured for equal discs; these differ in their radii")
        if scene.n <= NEIGHBOURS:
            raise ValueError(f"{scene.n} discs have no six neighbours each; hexatic order needs at least 7")
        self._gas = Gas.of(scene)

    # Results ------------------------------------------------------------------------------------------------

    def _columns(self, *which: int) -> list[FloatArray]:
        """Return some columns of the rows of each run."""
        self._require_frames()
        return [run.rows[:, which] for run in self._series()]

    @property
    def values(self) -> ComplexArray:
        """Psi6 of each frame, (frames,); beyond 1023 frames means over as many neighbours as needed."""
        rows = np.concatenate(self._columns(1, 2))
        return np.asarray(rows[:, 0] + 1j * rows[:, 1])

    @property
    def moduli(self) -> FloatArray:
        """|Psi6| of each of `values`."""
        return np.concatenate(self._columns(3))[:, 0]

    @property
    def collisions_per_particle(self) -> FloatArray:
        """Collisions per particle s of each of `values`."""
        return np.concatenate(self._columns(0))[:, 0]

    @property
    def order(self) -> Estimate:
        """Mean |Psi6|. It is no zero in a liquid, see the notes of the class."""
        return self._mean_of([rows[:, 0] for rows in self._columns(3)])

    @property
    def mean_square_order(self) -> Estimate:
        """<|Psi6|^2>, with the mean over frames."""
        return self._mean_of([rows[:, 0] for rows in self._columns(4)])

    @property
    def susceptibility(self) -> Estimate:
        """N (<|Psi6|^2> - <|Psi6|>^2): how far the order fluctuates; (1 - pi/4) N <|Psi6|^2> in a liquid."""
        n = self.gas.n
        return self._mean_of(self._columns(3, 4), lambda mean: n * (mean[..., 1] - mean[..., 0] ** 2))

    @property
    def local_order(self) -> Estimate:
        """Mean |psi|^2 of a disc; 1/6 where six bonds point anywhere."""
        return self._mean_of([rows[:, 0] for rows in self._columns(5)])

    def _mean_of(self, runs: list[FloatArray], statistic: object = None) -> Estimate:
        """Return a mean over frames; that of a single frame has no error."""
        if self._frames == 1:
            only = runs[0][0]
            return Estimate(float(statistic(only) if callable(statistic) else only), math.nan, 1.0)
        return self._pooled(runs, statistic)  # type: ignore[arg-type]

    @property
    def correlation_time(self) -> Estimate:
        """How many collisions per particle Psi6 keeps its modulus and its direction for.

        Integrated autocorrelation time of the complex Psi6, whose mean over all orientations is 0
        (`series.complex_autocorrelation_time`; in Sokal's convention a run of length T has T / 2 tau
        independent values). Mean over runs. Bias: it is no less than half of what is between two frames,
        which is what independent frames give; in a run that is short against it, it is too small, at most
        half of the run. NaN of fewer than 16 frames.
        """
        found, weights = [], []
        for run in self._series():
            rows = run.rows
            if len(rows) >= 16:
                apart = float(rows[-1, 0] - rows[0, 0]) / (len(rows) - 1)
                tau = complex_autocorrelation_time(rows[:, 1] + 1j * rows[:, 2])
                found.append((tau.value * apart, tau.standard_error * apart))
                weights.append(len(rows))
        self._require_frames()
        if not found:
            return Estimate(math.nan, math.nan)
        share = np.array(weights) / sum(weights)
        value, error = np.array(found).T
        return Estimate(float(share @ value), float(np.linalg.norm(share * error)))

    def _binned(self) -> tuple[FloatArray, FloatArray]:
        """Return pairs and correlations of all bins, mean over frames."""
        self._require_frames()
        pairs, products = self._mean[6:].reshape(2, -1)
        return pairs, products

    @property
    def r(self) -> FloatArray:
        """Mean distance of each bin, (bins,), up to half of the shorter edge of the box, [length]."""
        self._require_frames()
        return _bins(*_geometry(self.gas))[1] * float(self.gas.diameters[0])

    @property
    def correlation(self) -> FloatArray:
        """g6 of each bin, (bins,); NaN where there was no pair."""
        pairs, products = self._binned()
        return np.divide(products, pairs, out=np.full_like(pairs, np.nan), where=pairs > 0.0)

    @property
    def correlation_error(self) -> FloatArray:
        """Standard errors of `correlation`, (bins,), from blocks as long as |Psi6|^2 asks for.

        NaN of a single frame. The points of g6 are strongly correlated with each other.
        """
        pairs = self._binned()[0]
        if self._frames == 1:
            return np.full_like(pairs, np.nan)
        along = np.zeros(6 + 2 * len(pairs))
        along[4] = 1.0
        g6, there = self.correlation, np.where(pairs > 0.0, pairs, np.nan)

        def deviations(rows: FloatArray) -> FloatArray:
            """Return how far each frame moves the ratio of the means."""
            own, products = np.split(rows[:, 6:], 2, axis=1)
            return np.asarray((products - g6 * own) / there)

        return self._errors_of_rows(along, deviations)

    @property
    def checks(self) -> list[TheoryCheck]:
        """None: there is no theory of the order of discs at a given density."""
        self._require_frames()
        return []

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw g6(r) with its standard errors, and the slowest decay of a liquid's last neighbour, r^-1/4."""
        r, g6, error = self.r, self.correlation, self.correlation_error
        axes = axes_or_new(ax)
        diameter = float(self.gas.diameters[0])
        there = g6 > 0.0
        axes.errorbar(
            r[there] / diameter, g6[there], error[there], fmt=".", color=PALETTE[0], label="simulation"
        )
        axes.plot(r / diameter, (r / diameter) ** -KOSTERLITZ_THOULESS, color="0.4", label="$r^{-1/4}$")
        axes.set_xscale("log")
        axes.set_yscale("log")
        return labelled(axes, "r / diameter", "$g_6(r)$")


def _square(psi: ComplexArray) -> float:
    return float((psi.real**2 + psi.imag**2).mean())


def _geometry(gas: Gas) -> tuple[tuple[int, int], tuple[float, float]]:
    """Return cells along each axis, and their edges in diameters."""
    box = gas.box / float(gas.diameters[0])
    cells = [fft.next_fast_len(math.ceil(edge / CELL)) for edge in box.tolist()]
    return (cells[0], cells[1]), (float(box[0]) / cells[0], float(box[1]) / cells[1])


@lru_cache(maxsize=4)
def _bins(cells: tuple[int, int], edges: tuple[float, float]) -> tuple[NDArray[np.int32], FloatArray]:
    """Return the bin of each displacement of cells, one beyond the last for none, and the mean r of each bin.

    Bins are a cell wide, and a tenth of their distance where that is more, up to half of the shorter edge of
    the box. Lengths are in diameters.
    """
    across = [np.minimum(np.arange(n), n - np.arange(n)) * edge for n, edge in zip(cells, edges, strict=True)]
    distance = np.hypot(across[0][:, None], across[1])
    limits, last = [FIRST], 0.5 * min(cells[0] * edges[0], cells[1] * edges[1])
    while limits[-1] < last:
        limits.append(max(limits[-1] + CELL, limits[-1] * GROWTH))
    limits[-1] = last
    place = np.digitize(distance, limits) - 1
    place[(place < 0) | (place > len(limits) - 2)] = len(limits) - 1
    counts = np.bincount(place.ravel())[:-1]
    mean = np.bincount(place.ravel(), distance.ravel())[:-1] / np.maximum(counts, 1)
    return place.astype(np.int32), mean


def _correlated(positions: FloatArray, psi: ComplexArray, gas: Gas) -> tuple[FloatArray, FloatArray]:
    """Return the ordered pairs of each bin and the sum of psi psi* over them, both over N^2."""
    cells, edges = _geometry(gas)
    place = _bins(cells, edges)[0]
    own = np.floor(positions * (np.array(cells) / gas.box)).astype(np.int64) % cells
    flat, size = own[:, 0] * cells[1] + own[:, 1], cells[0] * cells[1]
    counts = np.bincount(flat, minlength=size).reshape(cells)
    order = np.bincount(flat, psi.real, size) + 1j * np.bincount(flat, psi.imag, size)
    pairs = fft.irfft2(np.abs(fft.rfft2(counts)) ** 2, cells)
    products = fft.ifft2(np.abs(fft.fft2(order.reshape(cells))) ** 2).real
    pairs[0, 0] -= len(psi)  # each with itself
    products[0, 0] -= len(psi) * _square(psi)
    there = np.rint(pairs)  # what is no whole number is rounding
    both = (np.bincount(place.ravel(), each.ravel())[:-1] for each in (there, products * (there > 0.0)))
    many = float(len(psi)) ** 2
    pairs_of_bins, products_of_bins = both
    return np.asarray(pairs_of_bins / many), np.asarray(products_of_bins / many)
