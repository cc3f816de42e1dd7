"""How a gas comes to equilibrium: cumulants, Kolmogorov-Smirnov distance and H per collision.

The curve is an average over replicas, independent gases that differ in their random start only, so that every
point has a standard error and all points together a covariance. What depends on the distribution as a whole
(KS distance, H) is computed from the histograms of all replicas together, since a single small gas is
dominated by its own noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.brief import brief
from analysis.estimator import ReplicaEstimator, axes_or_new, labelled
from analysis.reduced import Gas
from analysis.statistics import (
    ChiSquare,
    Estimate,
    TheoryCheck,
    compare_with_theory,
    deviates,
    estimate_from_jackknife,
    jackknife,
    replica_mean,
)
from analysis.velocities import cumulants, h_excess, reduced_velocities
from hardspheres.scene import column_sums, squared_lengths

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["Comparison", "RelaxationCurve"]

FloatArray = NDArray[np.float64]


@dataclass
class _Replica:
    """What is kept of one replica: S sampled moments, k species, d dimensions, B speed bins."""

    s: list[float]
    time: list[float]
    tensors: list[FloatArray]  # S x (k, d, d) mean of c_a c_b
    powers: list[FloatArray]  # S x (k, 3) mean of c^2, c^4, c^6
    counts: list[NDArray[np.uint32]]  # S x (k, B) speed histogram


@dataclass(frozen=True)
class Comparison:
    """A measured relaxation beside its theory.

    Attributes
    ----------
    a2, ks, h : (S,) arrays
        What theory expects, a2 with the finite-size correction; NaN where nothing is known.
    a2_uncertainty, ks_uncertainty, h_uncertainty : (S,) arrays
        Its standard uncertainty u.
    a2_z, ks_z, h_z : (S,) arrays
        Deviations (measured - theory)/sqrt(standard error^2 + u^2) as normal deviates, see `Estimate.z`; NaN
        where either is unknown or nothing fluctuates.
    chi_square : ChiSquare or None
        All points of a2 together, with their covariance; None with too few replicas.
    """

    a2: FloatArray
    a2_uncertainty: FloatArray
    a2_z: FloatArray
    ks: FloatArray
    ks_uncertainty: FloatArray
    ks_z: FloatArray
    h: FloatArray
    h_uncertainty: FloatArray
    h_z: FloatArray
    chi_square: ChiSquare | None

    __repr__ = brief


Pair = tuple[FloatArray, FloatArray]
_FOUND: WeakKeyDictionary[RelaxationCurve, dict[str, tuple[int, Pair]]] = WeakKeyDictionary()


def _kept(find: Callable[[RelaxationCurve], Pair]) -> Callable[[RelaxationCurve], Pair]:
    """Keep what is found of all replicas together: value, error, comparison and figure ask for it in turn."""

    def found(curve: RelaxationCurve) -> Pair:
        known, name = _FOUND.setdefault(curve, {}), find.__name__
        samples = sum(len(each.s) for each in curve._replicas)
        if name not in known or known[name][0] != samples:
            known[name] = samples, find(curve)
        value, error = known[name][1]
        return value.copy(), error.copy()

    return found


class RelaxationCurve(ReplicaEstimator):
    """Relaxation of the velocity distribution against s = 2 n_coll/N, averaged over replicas.

    Add the frames of one replica in the order of s, then those of the next; a frame that does not advance in
    s begins a new replica. All replicas must be sampled at the same s. It keeps moments and histograms, not
    frames, and can be pickled: replicas may be measured in separate processes and merged afterwards.

    Notes
    -----
    Velocities are reduced by kT of the whole and each particle's own mass (`velocities.reduced_velocities`);
    all species are taken together unless a name says `by_species`. Speeds are counted on `theory.KS_BINS`
    equal bins up to `theory.SPEED_LIMIT` thermal speeds, the last one open; H uses them joined to
    `theory.H_BINS`.

    Examples
    --------
    >>> curve = RelaxationCurve()
    >>> for seed in range(10):  # doctest: +SKIP
    ...     scene = random_gas(n=1000, packing_fraction=0.005, velocities="equal-speeds", seed=seed)
    ...     for frame in Simulation(scene).frames(collisions_per_particle=[0, 1, 2, 5]):
    ...         curve.add(frame)
    >>> print(curve.fit_rate(window=(2, 5)))  # doctest: +SKIP
    0.44(2)
    """

    _temperature = 1.0  # of the first frame

    # Collecting ---------------------------------------------------------------------------------------------

    def add(self, frame: Frame) -> Self:
        """Take in the next frame of this replica, or the first of another.

        Raises
        ------
        ValueError
            If the gas has another dimension or other species than the first, or if nothing moves.
        """
        reduced, temperature = reduced_velocities(frame)
        scene = frame.scene
        sizes = Gas.of(scene).sizes
        if self._gas is None:
            self._gas, self._temperature = Gas.of(scene), temperature
        elif scene.dim != self.dim or not np.array_equal(sizes, self._sizes):
            raise ValueError(
                f"frame has {scene.dim} dimensions and species of {sizes.tolist()} particles; expected "
                f"{self.dim} and {self._sizes.tolist()}, as in the first frame"
            )
        s = frame.collisions_per_particle
        replica = self._continued(s, "s", lambda: _Replica([], [], [], [], []))
        square = squared_lengths(reduced)
        powers = np.stack([square, square**2, square**3], axis=1)
        bins = np.minimum(
            np.sqrt(square) * (theory.KS_BINS / theory.SPEED_LIMIT[scene.dim]), theory.KS_BINS - 1
        )
        bins = bins.astype(np.int64)
        members = [slice(None)] if len(sizes) == 1 else [scene.species == kind for kind in range(len(sizes))]
        of_each = list(zip(members, sizes, strict=True))
        replica.s.append(s)
        replica.time.append(frame.time)
        replica.tensors.append(
            np.stack([np.einsum("ia,ib->ab", reduced[own], reduced[own]) / size for own, size in of_each])
        )
        replica.powers.append(np.stack([column_sums(powers[own]) / size for own, size in of_each]))
        replica.counts.append(
            np.stack([np.bincount(bins[own], minlength=theory.KS_BINS) for own in members]).astype(np.uint32)
        )
        return self

    def _take_in(self, other: Self) -> None:
        if not self._replicas:
            self._temperature = other._temperature
        super()._take_in(other)

    def _ready(self) -> list[_Replica]:
        self._require(bool(self._replicas), "replicas", "add(frame)")
        first, allowed = self._replicas[0].s, 4.0 / self.n_per_replica
        same = [len(replica.s) == len(first) for replica in self._replicas]
        if all(same):  # at once: there may be thousands, asked for by every result
            apart = np.abs(np.array([replica.s for replica in self._replicas]) - first)
            same = (apart.max(axis=1) <= allowed).tolist()
        if not all(same):
            index = same.index(False)
            replica = self._replicas[index]
            raise ValueError(
                f"replica {index} was sampled at {len(replica.s)} values of s from {replica.s[0]:g} to "
                f"{replica.s[-1]:g}; expected the {len(first)} of replica 0"
            )
        return self._replicas

    # What was sampled ---------------------------------------------------------------------------------------

    @property
    def dim(self) -> int:
        """Dimension d."""
        return self.gas.dim

    @property
    def _sizes(self) -> NDArray[np.int64]:
        return self.gas.sizes

    @property
    def n_per_replica(self) -> int:
        """Number of particles N of one replica."""
        return self.gas.n

    @property
    def labels(self) -> list[str]:
        """One label per species; "all" for a single one."""
        return self.gas.labels

    @property
    def thermal_speeds(self) -> FloatArray:
        """sqrt(kT/m) of each species in the first replica, (k,), [speed]."""
        return np.asarray(np.sqrt(self._temperature / self.gas.masses))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of translational degrees of freedom D of one replica."""
        return self.gas.degrees_of_freedom

    @property
    def s(self) -> FloatArray:
        """Collisions per particle at which the gas was sampled, (S,)."""
        return np.asarray(np.mean([replica.s for replica in self._ready()], axis=0))

    @property
    def time(self) -> FloatArray:
        """Mean time at which s was reached, (S,), [time]."""
        return np.asarray(np.mean([replica.time for replica in self._ready()], axis=0))

    # Cumulants ----------------------------------------------------------------------------------------------

    def _powers(self) -> FloatArray:
        """Means of c^2, c^4, c^6 over all species, (R, S, 3)."""
        powers = np.array([replica.powers for replica in self._ready()])
        return np.asarray(np.einsum("rskp,k->rsp", powers, self._sizes / self.n_per_replica))

    @property
    def a2_samples(self) -> FloatArray:
        """a2 of each replica, (R, S)."""
        return cumulants(self._powers(), self.dim)[0]

    @property
    def a3_samples(self) -> FloatArray:
        """a3 of each replica, (R, S)."""
        return cumulants(self._powers(), self.dim)[1]

    @property
    def a2(self) -> FloatArray:
        """Fourth cumulant, mean over replicas, (S,); tends to `theory.equilibrium_a2`, not to 0."""
        return replica_mean(self.a2_samples)[0]

    @property
    def a2_error(self) -> FloatArray:
        """Standard error of `a2`, (S,).

        For a single replica, the noise of N independent Maxwellian particles, which is too large at early
        times.
        """
        return self._error(self.a2_samples, 2)

    @property
    def a3(self) -> FloatArray:
        """Sixth cumulant, mean over replicas, (S,)."""
        return replica_mean(self.a3_samples)[0]

    @property
    def a3_error(self) -> FloatArray:
        """Standard error of `a3`, (S,), as for `a2_error`."""
        return self._error(self.a3_samples, 3)

    def _error(self, samples: FloatArray, order: int) -> FloatArray:
        if len(samples) > 1:
            return replica_mean(samples)[1]
        noise = theory.cumulant_noise(self.n_per_replica, self.dim, 2 if order == 2 else 3)
        return np.full(samples.shape[1], noise)

    @property
    def a2_covariance(self) -> FloatArray:
        """Covariance of the points of `a2` (of the mean over replicas), (S, S); none of a single replica."""
        samples = self.a2_samples
        self._require(len(samples) > 1, "covariance", "add(frame) with a second replica")
        return np.atleast_2d(np.cov(samples, rowvar=False)) / len(samples)

    @property
    def a2_by_species(self) -> FloatArray:
        """a2 of each species about its own mean square velocity, mean over replicas, (S, k)."""
        powers = np.array([replica.powers for replica in self._ready()])
        return np.asarray(cumulants(powers, self.dim)[0].mean(axis=0))

    @property
    def temperature_by_species(self) -> FloatArray:
        """Kinetic temperature of each species over that of the whole, (S, k); 1 + O(1/N) at equilibrium."""
        powers = np.array([replica.powers for replica in self._ready()])[..., 0]
        return np.asarray(powers.mean(axis=0) / self.dim)

    @property
    def temperature_by_species_error(self) -> FloatArray:
        """Standard errors of `temperature_by_species`, (S, k).

        For a single replica, the noise of independent Maxwellian particles, sqrt(2/(d N_i)), too large at
        early times.
        """
        powers = np.array([replica.powers for replica in self._ready()])[..., 0] / self.dim
        if len(powers) > 1:
            return replica_mean(powers)[1]
        return np.broadcast_to(np.sqrt(2.0 / (self.dim * self._sizes)), powers.shape[1:])

    def _tensors(self) -> FloatArray:
        """Return m <v_a v_b> / kT of all species together, (R, S, d, d)."""
        tensors = np.array([replica.tensors for replica in self._ready()])
        return np.asarray(np.einsum("rskab,k->rsab", tensors, self._sizes / self.n_per_replica))

    @property
    def temperature_by_axis(self) -> FloatArray:
        """Mean m <v_k^2> / kT along each axis k, (S, d); 1 + O(1/N) at equilibrium."""
        return np.asarray(np.einsum("rsaa->sa", self._tensors()) / self.n_replicas)

    def temperature_along(self, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return T_par/T, the temperature along a direction over the mean of all, with its standard error.

        Parameters
        ----------
        direction : (d,) array
            Need not be of unit length; that of beams is `hardspheres.velocities.BEAM_DIRECTION`.

        Returns
        -------
        value, error : (S,) arrays
            1 on average at equilibrium. Of a single replica: the noise of independent Maxwellian particles.
        """
        unit = np.asarray(direction, dtype=np.float64)
        unit = unit / np.linalg.norm(unit)
        tensors = self._tensors()
        along = np.einsum("rsab,a,b->rs", tensors, unit, unit) / np.einsum("rsaa->rs", tensors) * self.dim
        if len(along) > 1:
            return replica_mean(along)
        noise = math.sqrt(2.0 * (self.dim - 1) / (self.dim * self.n_per_replica))
        return along[0], np.full(along.shape[1], noise)

    @property
    def preferred_direction(self) -> FloatArray | None:
        """The direction of the highest temperature in the first sample, (d,); None if it is isotropic.

        The sample counts as anisotropic if the temperature along that direction exceeds the mean by 30 % and
        by 5 standard errors, sqrt(2 / n) each for n particles in equilibrium.
        """
        first = self._tensors()[:, 0].mean(axis=0)
        values, vectors = np.linalg.eigh(first)
        excess = max(0.3, 5.0 * math.sqrt(2.0 / (self.n_replicas * self.n_per_replica)))
        if values[-1] < (1.0 + excess) * values.mean():
            return None
        return np.asarray(vectors[:, -1] * np.sign(vectors[np.argmax(np.abs(vectors[:, -1])), -1]))

    # The distribution as a whole ----------------------------------------------------------------------------

    def _law(self) -> FloatArray:
        """Maxwell and Boltzmann's probability below each edge, (B + 1,), the last bin open."""
        edges = np.linspace(0.0, theory.SPEED_LIMIT[self.dim], theory.KS_BINS + 1)
        return np.append(theory.speed_cdf(edges, self.dim)[:-1], 1.0)

    def _counts(self) -> NDArray[np.uint32]:
        """Speed histograms of all species together, (R, S, B)."""
        return np.array([np.sum(replica.counts, axis=1, dtype=np.uint32) for replica in self._ready()])

    @_kept
    def _ks(self) -> Pair:
        law = self._law()[1:]

        def distance(counts: FloatArray) -> FloatArray:
            shares = np.cumsum(counts, axis=-1) / counts.sum(axis=-1, keepdims=True)
            return np.asarray(np.abs(shares - law).max(axis=-1))

        return jackknife(self._counts(), distance)

    @property
    def h_bins(self) -> int:
        """Number of bins of `h`: `theory.H_BINS`, or fewer for a gas of less than 20 particles per bin."""
        bins = theory.H_BINS
        while bins > 10 and self.n_per_replica * self.n_replicas < 20 * bins:
            bins //= 2
        return bins

    @_kept
    def _h(self) -> Pair:
        joined = theory.KS_BINS // self.h_bins
        probabilities = np.diff(self._law()[::joined])
        counts = self._counts()
        coarse = counts.reshape(*counts.shape[:2], self.h_bins, joined).sum(axis=-1)
        return jackknife(coarse, lambda total: h_excess(total, probabilities))

    @property
    def ks(self) -> FloatArray:
        """Kolmogorov-Smirnov distance of all replicas' speeds from Maxwell and Boltzmann's law, (S,).

        The supremum is taken over the edges of `theory.KS_BINS` bins, which lowers it by less than the
        probability of half a bin for a spike (0.002) and by less than 1e-5 for a smooth law. At equilibrium
        it tends to `theory.ks_floor`, not to 0.
        """
        return self._ks()[0]

    @property
    def ks_error(self) -> FloatArray:
        """Standard error of `ks` by the jackknife over replicas, (S,)."""
        return self._ks()[1]

    @property
    def h(self) -> FloatArray:
        """H - H_eq of the speeds of all replicas together, (S,).

        On `h_bins` bins up to `theory.SPEED_LIMIT` and with the bias removed, see `velocities.h_excess`.
        """
        return self._h()[0]

    @property
    def h_error(self) -> FloatArray:
        """Standard error of `h` by the jackknife over replicas, (S,)."""
        return self._h()[1]

    def speed_histogram(self, index: int, bins: int = 64) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the speed distribution of each species at one of the sampled s, all replicas together.

        Parameters
        ----------
        index : int
            Which of the S moments.
        bins : int, default 64
            Number of bins; divides `theory.KS_BINS`.

        Returns
        -------
        edges : (bins + 1,) array
            In thermal speeds sqrt(kT/m) of the species.
        density, error : (k, bins) arrays
            Per thermal speed, with multinomial standard errors.

        Raises
        ------
        ValueError
            If `bins` does not divide `theory.KS_BINS`.
        """
        if theory.KS_BINS % bins:
            raise ValueError(f"bins = {bins}; expected a divisor of {theory.KS_BINS}")
        replicas = self._ready()
        parts = np.array([replica.counts[index] for replica in replicas])
        counts = parts.sum(axis=0, dtype=np.int64).reshape(parts.shape[1], bins, -1).sum(axis=-1)
        total = counts.sum(axis=-1, keepdims=True)
        edges = np.linspace(0.0, theory.SPEED_LIMIT[self.dim], bins + 1)
        share = counts / total
        return edges, share / np.diff(edges), np.sqrt(share * (1 - share) / total) / np.diff(edges)

    # Statements ---------------------------------------------------------------------------------------------

    @property
    def starts_from_beams(self) -> bool:
        """Whether the gas is of one species and starts as two opposite beams of one speed."""
        replicas, direction = self._ready(), self.preferred_direction
        if direction is None or len(self._sizes) > 1 or replicas[0].s[0] > 0.0:
            return False
        equal = np.abs(self.a2_samples[:, 0] + 2.0 / (self.dim + 2)).max() < 1e-6
        return bool(equal and abs(self.temperature_along(direction)[0][0] - self.dim) < 1e-6)

    @property
    def equilibrium_checks(self) -> list[TheoryCheck]:
        """The last sample beside equilibrium: a2, temperatures of species and along the hottest initial axis.

        A mixture is in equilibrium when each species is: a2 and H of all particles together, in units of
        their own kT/m, hardly depend on a difference of temperature between species. The expected values are
        the exact ones for N particles of fixed energy.
        """
        self._ready()
        freedom = self.n_replicas - 1.0 if self.n_replicas > 1 else math.inf

        def check(
            name: str, value: float, error: float, expected: float, uncertainty: float = 0.0
        ) -> TheoryCheck:
            measured = Estimate(float(value), float(error), self.n_replicas, freedom)
            return TheoryCheck(name, "equilibrium", measured, expected, uncertainty)

        checks = [check("a2", self.a2[-1], self.a2_error[-1], self.gas.mean_a2)]
        if len(self._sizes) > 1:
            values, errors = self.temperature_by_species[-1], self.temperature_by_species_error[-1]
            for kind, share in enumerate(1.0 - self.gas.momentum_shares):
                checks.append(check(f"T{kind + 1}/T", values[kind], errors[kind], float(share)))
        if self.preferred_direction is not None:
            along = self.temperature_along(self.preferred_direction)
            checks.append(check("T_par/T", along[0][-1], along[1][-1], 1.0, 1.0 / self.n_per_replica))
        return checks

    @property
    def checks(self) -> list[TheoryCheck]:
        """The `equilibrium_checks`; for the way to equilibrium see `compare`."""
        return self.equilibrium_checks

    @property
    def not_thermal(self) -> list[TheoryCheck]:
        """The `equilibrium_checks` that fail; at equilibrium any of them does so in 1 % of all runs."""
        checks = self.equilibrium_checks
        return [check for check in checks if check.p_value < 0.01 / len(checks)]

    @property
    def starts_from_equal_speeds(self) -> bool:
        """Whether the gas is of one species and starts with equal speeds in isotropic directions."""
        replicas = self._ready()
        if len(self._sizes) > 1 or replicas[0].s[0] > 0.0:
            return False
        equal = np.abs(self.a2_samples[:, 0] + 2.0 / (self.dim + 2)).max() < 1e-6
        spread = math.sqrt(2.0 * (self.dim - 1) / (self.dim + 2) / (self.n_per_replica * self.n_replicas))
        tensor = self._tensors()[:, 0].mean(axis=0)
        even = np.trace(tensor) / self.dim * np.eye(self.dim)
        return bool(equal and np.abs(tensor - even).max() < 6.0 * spread)

    def fit_rate(self, window: tuple[float, float] = (2.0, 5.0)) -> Estimate:
        """Return the mean rate at which a2 decays over a window of s.

        The relative decay rate is not constant, so the number depends on the window; the mean over it is
        ln[(a2(s1) - a_eq)/(a2(s2) - a_eq)]/(s2 - s1), a_eq = `theory.equilibrium_a2`, from the two ends
        alone. The points between add very little: the noise of a2 decorrelates as fast as a2 decays, and a
        straight line through all of them has the same standard error within 5 % but a value that depends on
        how they are spaced. From equal speeds and over (2, 5) theory says 0.4355 in 3D, 0.3797 in 2D
        (`theory.equal_speeds_decay_rate`).

        Parameters
        ----------
        window : (float, float), default (2, 5)
            s1 < s2, both among the sampled s.

        Returns
        -------
        Estimate
            Per unit of s; error by the jackknife over replicas, the bias of order 1/R removed.

        Raises
        ------
        ValueError
            If the gas was not sampled at the ends of the window, or a2 is below three standard errors at one
            of them.
        """
        s = self.s
        ends = []
        for end in window:
            index = int(np.argmin(np.abs(s - end)))
            if abs(s[index] - end) > 2.0 / self.n_per_replica + 1e-9:
                raise ValueError(f"the gas was not sampled at s = {end:g}, an end of the window {window}")
            ends.append(index)
        length = float(s[ends[1]] - s[ends[0]])
        if not length > 0.0:
            raise ValueError(f"window = {window}; expected s1 < s2")
        excess = self.a2_samples[:, ends] - theory.equilibrium_a2(self.degrees_of_freedom)
        noise = theory.cumulant_noise(self.n_per_replica * self.n_replicas, self.dim)
        # the error from few replicas may be too small
        mean, error = excess.mean(axis=0), np.maximum(self.a2_error[ends], noise)
        if np.any(np.abs(mean) < 3.0 * error) or mean[0] * mean[1] < 0.0:
            raise ValueError(
                f"a2 is lost in the noise within the window {window}: {mean[0]:.2g} and {mean[1]:.2g} with "
                f"standard errors {error[0]:.2g} and {error[1]:.2g}; use more particles or an earlier window"
            )

        def rate(pair: FloatArray) -> float:
            return math.log(abs(float(pair[0] / pair[1]))) / length

        return estimate_from_jackknife(excess, rate)

    def compare(self, start: Literal["equal speeds", "equilibrium"] = "equal speeds") -> Comparison:
        """Compare with theory: every point of all three curves, and a2 with all its points together.

        Parameters
        ----------
        start : {"equal speeds", "equilibrium"}
            Equal speeds: `theory.boltzmann_equal_speeds` for a dilute gas, with
            `theory.finite_size_relaxation`. Equilibrium: a gas that starts Maxwellian and stays so, a2 =
            `theory.equilibrium_a2`, H = H_eq, KS = `theory.ks_floor`.

        Notes
        -----
        The KS distance of N particles in all exceeds that of the infinite gas by about floor^2/(2 ks); twice
        that is added to its uncertainty.
        """
        s = self.s
        floor = theory.ks_floor(self.n_per_replica * self.n_replicas, self.dim)
        if start == "equal speeds":
            known = s <= 10.0
            table = theory.boltzmann_equal_speeds(np.where(known, s, 0.0), self.dim)
            finite = theory.finite_size_relaxation(table.a2, -2.0 / (self.dim + 2), self.degrees_of_freedom)
            a2, a2_uncertainty = finite.value, np.hypot(table.a2_error, finite.uncertainty)
            extra = np.where(s > 0.0, floor**2 / table.ks, 0.0)
            ks, ks_uncertainty = table.ks, np.hypot(table.ks_error, extra)
            h, h_uncertainty = table.h, table.h_error
            if self.h_bins != theory.H_BINS:  # the table holds for its bins only
                h = np.full(len(s), np.nan)
            fluctuates = known & (s > 0.0)
        else:
            known = fluctuates = np.ones(len(s), dtype=bool)
            zero = np.zeros(len(s))
            a2, a2_uncertainty = zero + theory.equilibrium_a2(self.degrees_of_freedom), zero
            ks, ks_uncertainty = zero + floor, zero + 0.3 * floor  # its spread, see `ks_floor`
            h, h_uncertainty = zero, zero
        freedom = self.n_replicas - 1.0 if self.n_replicas > 1 else math.inf

        def against(
            measured: tuple[FloatArray, FloatArray], expected: FloatArray, uncertainty: FloatArray
        ) -> tuple[FloatArray, FloatArray, FloatArray]:
            apart = np.where(fluctuates, measured[0] - expected, np.nan)
            z = deviates(apart, measured[1], uncertainty, freedom)
            return np.where(known, expected, np.nan), uncertainty, z

        points = np.flatnonzero(fluctuates)
        chi_square = None
        if self.n_replicas > len(points) + 1 and len(points):
            chi_square = compare_with_theory(self.a2_samples[:, points], a2[points], a2_uncertainty[points])
        return Comparison(
            *against((self.a2, self.a2_error), a2, a2_uncertainty),
            *against(self._ks(), ks, ks_uncertainty),
            *against(self._h(), h, h_uncertainty),
            chi_square,
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw a2 with its standard errors against s, after equal speeds over the Boltzmann equation's."""
        s = self.s
        axes = axes_or_new(ax)
        if self.starts_from_equal_speeds:
            fine = np.linspace(0.0, min(float(s.max()), 10.0), 400)
            table = theory.boltzmann_equal_speeds(fine, self.dim)
            axes.plot(fine, table.a2, color="0.25", lw=1.5, label="Boltzmann equation")
        else:
            axes.axhline(0.0, color="0.25", lw=1.5, label="equilibrium")
        axes.errorbar(s, self.a2, self.a2_error, fmt="o", ms=4, label="simulation")
        return labelled(axes, "collisions per particle s", "fourth cumulant $a_2$")
