"""Deviation of velocities from the Maxwell-Boltzmann law: cumulants, Kolmogorov-Smirnov distance, H.

The distributions themselves are in `analysis.distributions`. All estimators work with reduced velocities c =
(v - u) sqrt(m/kT), where u is the velocity of the common motion along periodic axes (zero along walls), m the
particle's own mass and kT = 2 K_th / D the temperature of the whole gas, D its degrees of freedom. At
equilibrium every component of c is a standard normal number whatever the species. Since the energy of a
simulated gas is fixed, <c^2> = D/N in every frame: kT does not fluctuate, and each estimator below states the
consequence. A mixture is in equilibrium when each species is and all have one temperature: use
`FourthCumulant.by_species` and `temperatures.TemperatureEquilibration` too, since all species together can
look Maxwellian while their temperatures differ by several per cent.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from analysis import theory
from analysis.distributions import ComponentDistribution, EnergyDistribution, SpeedDistribution
from analysis.per_frame import PerFrame
from analysis.reduced import reduced_velocities, species_labels
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from hardspheres import Frame

__all__ = [
    "ComponentDistribution",
    "EnergyDistribution",
    "FourthCumulant",
    "HFunction",
    "KolmogorovSmirnov",
    "SpeedDistribution",
    "cumulants",
    "h_excess",
    "ks_distance",
    "ks_p_value",
    "reduced_velocities",
    "species_labels",
]

FloatArray = NDArray[np.float64]


def cumulants(moments: FloatArray, dim: int) -> tuple[FloatArray, FloatArray]:
    """Return the cumulants a2 and a3 of a speed distribution.

    a2 = d <v^4>/((d+2) <v^2>^2) - 1 and a3 = -(d^2 <v^6>/((d+2)(d+4) <v^2>^3) - 1 - 3 a2), the coefficients
    of the Sonine (Laguerre) expansion about Maxwell and Boltzmann's law; both vanish there. Over N particles
    of fixed energy their mean at equilibrium is `theory.equilibrium_a2` = -2/(dN) and
    `theory.equilibrium_a3`, of order 1/N^2.

    Parameters
    ----------
    moments : (..., 3) array
        <v^2>, <v^4>, <v^6>, in any one unit of speed.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    a2, a3 : (...) arrays
    """
    second, fourth, sixth = moments[..., 0], moments[..., 1], moments[..., 2]
    a2 = dim * fourth / ((dim + 2) * second**2) - 1.0
    a3 = -(dim**2 * sixth / ((dim + 2) * (dim + 4) * second**3) - 1.0 - 3.0 * a2)
    return a2, a3


def ks_distance(speeds: FloatArray, dim: int) -> float:
    """Return the Kolmogorov-Smirnov distance of reduced speeds from Maxwell and Boltzmann's law.

    Parameters
    ----------
    speeds : (N,) array
        |c|, dimensionless.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    float
        sup over v of |F_N(v) - F(v)|, F the law of the infinite gas.
    """
    law = theory.speed_cdf(np.sort(speeds), dim)
    ranks = np.arange(len(law) + 1) / len(law)
    return float(max((ranks[1:] - law).max(), (law - ranks[:-1]).max()))


def ks_p_value(distance: float, n: int, dim: int, momentum_conserved: bool = True) -> float:
    """Return the probability that a gas at equilibrium lies further from its law than `distance`.

    Kolmogorov's distribution does not apply, since the scale of the law, kT, is taken from the sample. The
    distribution used is that of 4000 gases with velocities uniform on the sphere of fixed energy (and zero
    momentum in a periodic box), of min(N, 1000) particles of one mass, brought to N by Stephens' factor
    sqrt(N) + 0.12 + 0.11/sqrt(N) (Stephens, J. Am. Stat. Assoc. 69, 730 (1974), doi 10.2307/2286009).

    Parameters
    ----------
    distance : float
        From `ks_distance`.
    n : int
        Number of particles N.
    dim : {2, 3}
        Dimension d.
    momentum_conserved : bool, default True
        As in a periodic box; False between walls. It matters for N below some hundreds.

    Returns
    -------
    float
        Never below 1/4001, the resolution of the sample.
    """
    sample = min(n, 1000)
    null = _ks_null(sample, dim, momentum_conserved)
    scaled = distance * stephens(n)
    return float((np.count_nonzero(null >= scaled) + 1) / (len(null) + 1))


@lru_cache(maxsize=16)
def _ks_null(n: int, dim: int, momentum_conserved: bool) -> FloatArray:
    """Return 4000 scaled distances of equilibrium gases of n particles, always the same."""
    rng = np.random.default_rng(np.random.SeedSequence([n, dim]))
    distances = np.empty(4000)
    for index in range(len(distances)):
        velocity = rng.standard_normal((n, dim))
        if momentum_conserved:
            velocity -= velocity.mean(axis=0)
        speed = np.sqrt(np.einsum("ik,ik->i", velocity, velocity))
        freedom = dim * (n - 1) if momentum_conserved else dim * n
        distances[index] = ks_distance(speed * math.sqrt(freedom / (speed @ speed)), dim)
    return distances * stephens(n)


def stephens(n: int) -> float:
    """Return the factor that makes KS distances of n values comparable, see `ks_p_value`."""
    return math.sqrt(n) + 0.12 + 0.11 / math.sqrt(n)


def h_excess(histogram: NDArray[np.generic], probabilities: FloatArray) -> FloatArray:
    """Return H - H_eq of a histogram of speeds, with the bias of the finite sample removed.

    H is the integral of f ln f over velocities, f isotropic; since <v^2> is conserved, H - H_eq is the
    integral of f ln(f/f_MB). Coarse-grained on bins of probability q_b under Maxwell and Boltzmann's law it
    is sum p_b ln(p_b/q_b) >= 0, here with p_b = n_b/N less (B - 1)/(2N), B the number of occupied bins
    (Miller 1955, Madow): the leading bias of the plug-in value. Sparsely filled bins leave part of the bias:
    +0.004 for 60 bins up to 5 thermal speeds and N = 1000. A distribution with a spike, such as equal speeds,
    has no limit for narrow bins: always state the bins.

    Parameters
    ----------
    histogram : (..., B) array
        Counts n_b.
    probabilities : (B,) array
        q_b > 0, summing to 1.

    Returns
    -------
    (...) array
        Dimensionless, per particle. Around 0, of either sign, at equilibrium; noise sqrt(B/2)/N there.
    """
    counts = np.asarray(histogram, dtype=np.float64)
    total = counts.sum(axis=-1, keepdims=True)
    share = counts / total
    logarithm = np.log(np.where(counts > 0, share, 1.0) / probabilities)
    occupied = np.count_nonzero(counts, axis=-1)
    plug_in = np.where(counts > 0, share * logarithm, 0.0).sum(axis=-1)
    return np.asarray(plug_in - (occupied - 1) / (2.0 * total[..., 0]))


def h_bias(probabilities: FloatArray, n: int) -> float:
    """Return the mean of `h_excess` over gases of N particles at equilibrium: what its correction leaves.

    The mean of the sum over bins of n_b ln(n_b / N q_b) / N - (occupied - 1) / 2N, n_b of Poisson's law. From
    each bin this leaves half of a count where many are expected, which one count fewer for the fixed number
    of particles takes off again for all bins together; and one half less for the fixed energy, as in
    `SpeedDistribution.chi_square`.

    Parameters
    ----------
    probabilities : (B,) array
        q_b > 0, summing to 1.
    n : int
        Number of particles N.
    """
    total = 0.0
    for expected in n * probabilities:
        if expected > 1e3:
            total += 1.0 / (12.0 * expected)
            continue
        counts = np.arange(1, math.ceil(expected + 12.0 * math.sqrt(expected)) + 20)
        own = np.exp(special.xlogy(counts, expected) - special.gammaln(counts + 1.0) - expected)  # Poisson's
        total += float(own @ (counts * np.log(counts / expected) - 0.5))
    return (total - 0.5) / n


class FourthCumulant(PerFrame):
    """Fourth cumulant a2 (and sixth, a3) of the reduced velocities of all particles; see `cumulants`.

    In a mixture the particles of all species are taken together in units of their own kT/m, with one kT for
    all; `by_species` refers each species to its own mean square instead.

    Notes
    -----
    Bias: at equilibrium the mean is `theory.equilibrium_a2`(D) = -2/(D + 2) and not 0 because the energy is
    fixed; it is not removed here. `expected` gives it.
    """

    _ylabel = "fourth cumulant $a_2$"

    def _measure(self, frame: Frame) -> list[float]:
        reduced, _ = reduced_velocities(frame)
        square = np.einsum("ik,ik->i", reduced, reduced)
        powers = np.stack([square, square**2, square**3], axis=1)
        dim = frame.scene.dim
        a2, a3 = cumulants(powers.mean(axis=0), dim)
        species = frame.scene.species
        own = [cumulants(powers[species == kind].mean(axis=0), dim)[0] for kind in np.unique(species)]
        return [float(a2), float(a3), *map(float, own)]

    def _level(self) -> float:
        return self.expected

    @property
    def a2(self) -> Estimate:
        """Mean over frames; the error of one frame is the noise of N particles.

        Frames may be correlated: errors come from blocks (`series.estimate_from_series`), with fewer than 16
        frames from their spread and the collisions between them (`correlation_times.FrameWeights`). If the
        frames span too few velocity correlation times of a species, a `correlation_times.FrozenWarning` is
        given.
        """
        return self._cumulant(2)

    @property
    def a3(self) -> Estimate:
        """Mean of a3 over frames, with its error as for `a2`."""
        return self._cumulant(3)

    def _cumulant(self, order: Literal[2, 3]) -> Estimate:
        if len(self.values) > 1:
            return self._estimate(order - 1)
        n = self.gas.n
        value = float(self._columns(order - 1)[0][0])
        return Estimate(value, theory.cumulant_noise(n, self.gas.dim, order), float(n))

    @property
    def by_species(self) -> FloatArray:
        """a2 of each species about its own mean square velocity, averaged over frames, (k,)."""
        self._require_values()
        return np.asarray(self._mean[3:])

    @property
    def expected(self) -> float:
        """What an equilibrium gas of this size gives on average: -2/(D + 2)."""
        return float(theory.equilibrium_a2(self.gas.degrees_of_freedom))

    @property
    def checks(self) -> list[TheoryCheck]:
        """The mean of `a2` beside that of N particles of fixed energy, `reduced.mean_a2`."""
        return [TheoryCheck("a2", "equilibrium", self.a2, self.gas.mean_a2, 0.0)]


class KolmogorovSmirnov(PerFrame):
    """Largest distance of the reduced speeds' distribution from Maxwell and Boltzmann's, frame by frame.

    Notes
    -----
    Even at equilibrium the distance of N particles is `theory.ks_floor`, about 0.72/sqrt(N), and not 0.
    """

    _ylabel = "Kolmogorov\u2013Smirnov distance"

    def _measure(self, frame: Frame) -> list[float]:
        reduced, _ = reduced_velocities(frame)
        return [ks_distance(np.sqrt(np.einsum("ik,ik->i", reduced, reduced)), frame.scene.dim)]

    def _level(self) -> float:
        return theory.ks_floor(self.gas.n, self.gas.dim)

    @property
    def distance(self) -> Estimate:
        """Mean distance over frames, with an error as that of `FourthCumulant.a2`; NaN for one frame."""
        return self._estimate(1)

    @property
    def p_value(self) -> float:
        """Probability of a larger distance at equilibrium, for the last frame; see `ks_p_value`."""
        self._require_values()
        return ks_p_value(self._last, self.gas.n, self.gas.dim, bool(self.gas.periodic.all()))

    @property
    def checks(self) -> list[TheoryCheck]:
        """The mean `distance` beside `theory.ks_floor`, uncertain by its 1 % and by 1/N."""
        floor = self._level()
        uncertainty = floor * math.hypot(0.01, 1.0 / self.gas.n)
        return [TheoryCheck("KS distance", "equilibrium", self.distance, floor, uncertainty)]


class HFunction(PerFrame):
    """Boltzmann's H less its equilibrium value, from a histogram of each frame; see `h_excess`.

    All particles of a mixture are taken together, in units of their own sqrt(kT/m). f is taken as isotropic:
    an anisotropy at equal speeds, such as of two beams, does not count.

    Parameters
    ----------
    bins : int, default 60
        Number of equal bins, the last one open above. The bias removed is (B - 1)/(2N): use few bins for one
        small gas, and `analysis.relaxation.RelaxationCurve` to take all replicas together.
    maximum : float, default 5
        Start of the open bin in thermal speeds.
    """

    _ylabel = r"$H - H_\mathrm{eq}$"

    def __init__(self, bins: int = 60, maximum: float = 5.0) -> None:
        super().__init__()
        self.edges: FloatArray = np.append(np.linspace(0.0, maximum, bins + 1)[:-1], np.inf)

    def _measure(self, frame: Frame) -> list[float]:
        reduced, _ = reduced_velocities(frame)
        counts = np.histogram(np.sqrt(np.einsum("ik,ik->i", reduced, reduced)), bins=self.edges)[0]
        return [float(h_excess(counts, self._probabilities(frame.scene.dim)))]

    def _probabilities(self, dim: int) -> FloatArray:
        return np.diff(theory.speed_cdf(self.edges, dim))

    @property
    def excess(self) -> Estimate:
        """Mean of H - H_eq over frames, with an error as that of `FourthCumulant.a2`; NaN for one frame."""
        return self._estimate(1)

    @property
    def expected(self) -> float:
        """What an equilibrium gas of this size gives on average with these bins: `h_bias`."""
        return h_bias(self._probabilities(self.gas.dim), self.gas.n)

    @property
    def checks(self) -> list[TheoryCheck]:
        """The mean `excess` beside that of N particles at equilibrium, uncertain by a tenth and 1/N^2."""
        expected, n = self.expected, self.gas.n
        uncertainty = math.hypot(0.1 * expected, 1.0 / n**2)
        return [TheoryCheck("H - H_eq", "equilibrium", self.excess, expected, uncertainty)]
