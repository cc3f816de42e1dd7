"""Numbers with their standard errors: replicas, blocks of a time series, and comparison with a theory.

Blocks of automatic length are in `analysis.series`. Every quantity that a study reports is an `Estimate`;
every comparison of a curve with a theory is a `ChiSquare`.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

__all__ = [
    "ChiSquare",
    "Estimate",
    "ReplicaWarning",
    "TheoryCheck",
    "combine_replicas",
    "compare_with_theory",
    "deviates",
    "estimate_from_blocks",
    "estimate_from_jackknife",
    "estimate_from_replicas",
    "jackknife",
    "normal_deviate",
    "pool_replicas",
    "replica_mean",
]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A measured number with its statistical uncertainty.

    Attributes
    ----------
    value : float
        The estimate, in the units of what was measured.
    standard_error : float
        One standard error of `value`, same units; NaN where it cannot be estimated (a single replica).
    n_effective : float
        Number of independent samples on which the standard error rests.
    degrees_of_freedom : float
        Of the standard error: (value - truth) / standard_error follows Student's t with this many. Infinite
        where the error is known rather than estimated.

    Examples
    --------
    >>> str(Estimate(9.404114, 0.0083, 20))
    '9.404(8)'
    >>> str(Estimate(-1.25e-7, 3e-9, 20))
    '-1.25(3)e-7'
    >>> f"{Estimate(9.404114, 0.0083, 20):.3f}"
    '9.404'
    """

    value: float
    standard_error: float
    n_effective: float = math.nan
    degrees_of_freedom: float = math.inf

    def __repr__(self) -> str:
        """Return value and error, and how well the error is known."""
        known = math.isfinite(self.degrees_of_freedom)
        freedom = f", {self.degrees_of_freedom:.3g} degrees of freedom" if known else ""
        return f"<Estimate {self}{freedom}>"

    def __float__(self) -> float:
        """Return the value."""
        return float(self.value)

    def __format__(self, form: str) -> str:
        """Return the value in this form; without one, or padded as text, value and error as `str` does."""
        return format(str(self), form) if form.endswith("s") or not form else format(float(self), form)

    def __str__(self) -> str:
        """Return the value with its error in parentheses, in units of the last printed digit.

        The error is rounded to one digit, to two where the first is a 1. An unknown error prints as "(nan)",
        an exact value as "(0)".
        """
        value, error = float(self.value), abs(float(self.standard_error))
        if not math.isfinite(value) or not math.isfinite(error):
            return f"{value:.6g}({error:.3g})"
        if error == 0.0:
            return f"{value:.10g}(0)"
        place = _last_place(error)
        largest = max(abs(value), error)
        magnitude = math.floor(math.log10(largest))
        exponent = magnitude if magnitude < -4 or magnitude >= 6 or place > 0 else 0
        decimals = max(exponent - place, 0)
        digits = round(error / 10.0**place)
        mantissa = f"{value / 10.0**exponent:.{decimals}f}({digits})"
        return mantissa + (f"e{exponent}" if exponent else "")

    def deviation(self, theory: float, uncertainty: float = 0.0) -> float:
        """Return how far the estimate lies from a theory, in combined standard errors.

        Parameters
        ----------
        theory : float
            The value expected.
        uncertainty : float, default 0
            The theory's own standard uncertainty u.

        Returns
        -------
        float
            z = (value - theory) / sqrt(standard_error^2 + u^2); NaN where both errors vanish or are unknown.
        """
        scale = math.hypot(self.standard_error, uncertainty)
        return (self.value - theory) / scale if scale > 0.0 else math.nan

    def z(self, theory: float, uncertainty: float = 0.0) -> float:
        """Return the deviation from a theory as a normal deviate: what all tables show.

        It has the tail probability of `deviation`, whose parameters these are, with these degrees of freedom,
        see `deviates`: with two replicas, 10 standard errors give z = 1.8.
        """
        return float(deviates(self.value - theory, self.standard_error, uncertainty, self.degrees_of_freedom))

    def p_value(self, theory: float, uncertainty: float = 0.0) -> float:
        """Return the probability of |z| at least as large if the theory is right; NaN for unknown errors."""
        return float(2.0 * special.ndtr(-abs(self.z(theory, uncertainty))))

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval that covers the truth with this probability, by Student's t.

        Parameters
        ----------
        confidence : float, default 0.95
            Between 0 and 1.

        Returns
        -------
        low, high : float
            In the units of `value`.
        """
        if not 0.0 < confidence < 1.0:
            raise ValueError(f"confidence = {confidence}; expected a probability between 0 and 1")
        freedom, below = self.degrees_of_freedom, 0.5 + confidence / 2
        times = special.stdtrit(freedom, below) if math.isfinite(freedom) else special.ndtri(below)
        half = float(times) * self.standard_error
        return self.value - half, self.value + half


def normal_deviate(t: ArrayLike, degrees_of_freedom: ArrayLike) -> FloatArray:
    """Return the standard normal deviate that is exceeded as often as t by Student's distribution.

    Parameters
    ----------
    t : array_like
        (value - truth) / standard error.
    degrees_of_freedom : array_like
        Of the standard error, > 0; infinite where it is known, and then the result is t.

    Returns
    -------
    array
        With the sign of t; NaN where t or the degrees of freedom are.

    Notes
    -----
    Where the tail is below the range of double precision it is taken for density (nu + t^2) / (nu t). The
    derivative of that is -density (1 + 1/t^2), so it is too large by less than a factor of 1 + 1/t^2.
    """
    size, freedom = np.broadcast_arrays(np.abs(np.asarray(t, float)), np.asarray(degrees_of_freedom, float))
    known = np.isposinf(freedom)
    nu = np.where(known | ~(freedom > 0.0), 1.0, freedom)
    tail = special.stdtr(nu, -size)
    t_far = np.maximum(size, 1.0)
    log_density = -special.betaln(nu / 2, 0.5) - np.log(nu) / 2 - (nu + 1) / 2 * np.log1p(t_far**2 / nu)
    far = -special.ndtri_exp(log_density + np.log(t_far / nu + 1.0 / t_far))
    exact = -special.ndtri(np.where(tail > 1e-300, tail, 0.5))
    deviate = np.where(known, size, np.where(tail > 1e-300, exact, far))
    return np.asarray(np.where(known | (freedom > 0.0), np.sign(np.asarray(t, float)) * deviate, np.nan))


def deviates(
    difference: ArrayLike, standard_error: ArrayLike, uncertainty: ArrayLike, degrees_of_freedom: float
) -> FloatArray:
    """Return deviations from theory as normal deviates: `Estimate.z` of whole curves.

    A difference is standard_error t + uncertainty x, t of Student's and x of a normal distribution (Behrens
    and Fisher: Fisher, Ann. Eugen. 11, 141 (1941), doi 10.1111/j.1469-1809.1941.tb02281.x). For a given
    chi-square of the standard error the difference is normal, so that its tail probability is an integral
    over chi-square. Welch's degrees of freedom do not serve here: they are infinite for two replicas that
    agree by chance.

    Parameters
    ----------
    difference : array_like
        Measured less theory.
    standard_error, uncertainty : array_like
        Of either.
    degrees_of_freedom : float
        Of the standard errors.

    Returns
    -------
    array
        NaN where nothing fluctuates, or an error is unknown.
    """
    apart, own, other = np.broadcast_arrays(
        np.asarray(difference, float), np.asarray(standard_error, float), np.asarray(uncertainty, float)
    )
    both = np.hypot(own, other)
    both = np.where(both > 0.0, both, np.nan)
    nu = degrees_of_freedom
    if not nu > 0.0:
        return np.full(apart.shape, np.nan)
    if math.isinf(nu):
        return np.asarray(apart / both)
    y = np.linspace(
        -min(80.0, 1500.0 / nu + 20.0 / math.sqrt(nu)), min(5.0, 12.0 / math.sqrt(nu)), 2001
    )  # logarithm of chi-square/nu
    weight = (
        nu / 2 * (y - np.exp(y)) + nu / 2 * math.log(nu / 2) - math.lgamma(nu / 2) + math.log(y[1] - y[0])
    )
    scale = np.hypot(own[..., None] * np.exp(-y / 2), other[..., None])
    with np.errstate(divide="ignore", invalid="ignore"):
        beyond = special.logsumexp(special.log_ndtr(-np.abs(apart[..., None]) / scale) + weight, axis=-1)
    z = -special.ndtri_exp(np.minimum(beyond, math.log(0.5)))
    exact = normal_deviate(np.abs(apart) / both, nu)
    return np.asarray(np.sign(apart) * np.where(other > 0.0, z, exact))


def _last_place(error: float) -> int:
    """Return the power of ten of the last digit to print: one digit of the error, two after a leading 1."""
    power = math.floor(math.log10(error))
    return power - 1 if error / 10.0**power < 1.95 else power


def estimate_from_replicas(values: ArrayLike) -> Estimate:
    """Return the mean over independent replicas with its standard error.

    Parameters
    ----------
    values : (R,) array_like
        One number per replica.

    Returns
    -------
    Estimate
        Mean and s / sqrt(R), s the standard deviation across replicas (R - 1 in the denominator); the error
        of a single replica is NaN.

    Raises
    ------
    ValueError
        If there are no values or they are not one number per replica.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"replica values have shape {array.shape}; expected (R,) with R >= 1")
    count = array.size
    error = float(array.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan
    return Estimate(float(array.mean()), error, float(count), float(count - 1))


class ReplicaWarning(UserWarning):
    """Replicas differ by more than their own errors: they are not in the same state, or the errors too small.

    Attributes
    ----------
    estimate : Estimate
        The combined estimate, returned in spite of the warning.
    """

    def __init__(self, message: str, estimate: Estimate) -> None:
        super().__init__(message)
        self.estimate = estimate


def combine_replicas(estimates: Sequence[Estimate], weights: Sequence[float] | None = None) -> Estimate:
    """Return the mean of independent replicas, each with an error of its own.

    The error is that of their spread, s / sqrt(R) with R - 1 degrees of freedom. It includes the effect of
    different initial states that have not relaxed, which blocks within one replica do not show. The replicas'
    own errors serve as a check: s^2 over their mean square follows Fisher's F if they are right.

    Parameters
    ----------
    estimates : sequence of Estimate
        One per replica.
    weights : sequence of float, optional
        Lengths of the replicas, to which their variances are inverse; equal by default. The squared error is
        then sum of w (x - mean)^2 / ((R - 1) sum of w).

    Warns
    -----
    ReplicaWarning
        If a spread this large has a probability below 1e-4.

    Raises
    ------
    ValueError
        If there are none.
    """
    values = np.array([e.value for e in estimates])
    combined = estimate_from_replicas(values)
    if weights is not None and len(values) > 1:
        mean = float(np.average(values, weights=weights))
        variance = float(np.average((values - mean) ** 2, weights=weights)) / (len(values) - 1)
        combined = replace(combined, value=mean, standard_error=math.sqrt(variance))
    freedom = np.array([e.degrees_of_freedom for e in estimates])
    own = np.array([e.standard_error for e in estimates])
    if len(own) > 1 and np.all(own > 0.0) and np.all(freedom > 0.0):
        ratio = (combined.standard_error / _own_error(own, weights)) ** 2
        behind = float(np.minimum(freedom, 1e6).sum())
        if special.fdtrc(len(own) - 1, behind, ratio) < 1e-4:
            warnings.warn(
                ReplicaWarning(
                    f"{len(own)} replicas spread {math.sqrt(ratio):.2g} times as far as their own errors "
                    "say: equilibrate longer, or use longer blocks; the error quoted is that of the spread",
                    combined,
                ),
                stacklevel=2,
            )
    return combined


def _own_error(own: FloatArray, weights: Sequence[float] | None) -> float:
    """Return the error of a mean whose parts have errors of their own."""
    w = np.ones(len(own)) if weights is None else np.asarray(weights, dtype=np.float64)
    return math.sqrt(float(((w * own) ** 2).sum())) / float(w.sum())


def pool_replicas(estimates: Sequence[Estimate], weights: Sequence[float] | None = None) -> Estimate:
    """Return the mean of independent replicas with the error that their own errors give.

    For few replicas with good errors of their own, such as blocks of a time series: sqrt(sum of s_r^2) / R
    has the degrees of freedom of all their blocks, where the spread of R values has only R - 1. Blocks within
    a replica do not show the effect of an initial state that has not relaxed. If the replicas spread so much
    further than their own errors say that `combine_replicas` warns, its result is returned, with the error of
    the spread.

    Parameters
    ----------
    estimates, weights
        As in `combine_replicas`; with weights the error is sqrt(sum of (w s)^2) / sum of w.

    Returns
    -------
    Estimate
        Degrees of freedom by Welch and Satterthwaite's rule (Welch 1947, doi 10.1093/biomet/34.1-2.28).

    Raises
    ------
    ValueError
        If there are none.
    """
    if not estimates:
        raise ValueError("there are no replicas to pool")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReplicaWarning)
        try:
            combine_replicas(estimates, weights)
        except ReplicaWarning as warning:
            return warning.estimate
    own = np.array([e.standard_error for e in estimates])
    parts = own if weights is None else own * np.asarray(weights)
    freedom = np.array([e.degrees_of_freedom for e in estimates])
    total = float((parts**2).sum())
    behind = float((parts**4 / freedom).sum()) if total > 0.0 else 0.0
    return Estimate(
        float(np.average([e.value for e in estimates], weights=weights)),
        _own_error(own, weights),
        float(sum(e.n_effective for e in estimates)),
        total**2 / behind if behind > 0.0 else math.inf,
    )


def estimate_from_blocks(series: ArrayLike, blocks: int = 32) -> Estimate:
    """Return the mean of a correlated time series with its standard error from blocks.

    The series is cut into equal blocks, whose means are treated as independent. That is right when a block is
    much longer than the correlation time; neighbouring block means that are visibly correlated raise a
    warning, since the error is then too small (Flyvbjerg and Petersen, J. Chem. Phys. 91, 461 (1989), doi
    10.1063/1.457480).

    Parameters
    ----------
    series : (n,) array_like
        Samples in the order of time, equally spaced.
    blocks : int, default 32
        Number of blocks, at least 8; samples left over at the start are dropped as the least equilibrated.

    Returns
    -------
    Estimate
        `n_effective` is the number of independent samples that would give the same error, at most n.

    Raises
    ------
    ValueError
        If the series is not one-dimensional or has fewer than two samples per block.
    """
    array = np.asarray(series, dtype=np.float64)
    if blocks < 8:
        raise ValueError(f"blocks = {blocks}; expected at least 8 for a meaningful standard error")
    if array.ndim != 1 or array.size < 2 * blocks:
        raise ValueError(
            f"series has shape {array.shape}; expected (n,) with n >= {2 * blocks} for {blocks} blocks"
        )
    length = array.size // blocks
    used = array[array.size - length * blocks :]
    means = used.reshape(blocks, length).mean(axis=1)
    centred = means - means.mean()
    spread = float(centred @ centred)
    error = math.sqrt(spread / (blocks - 1) / blocks)
    if spread > 0.0 and float(centred[1:] @ centred[:-1]) / spread > 3.0 / math.sqrt(blocks):
        warnings.warn(
            f"neighbouring blocks of {length} samples are correlated: the standard error is too small; "
            "run longer or use fewer blocks",
            stacklevel=2,
        )
    variance = float(used.var(ddof=1))
    effective = min(variance / error**2, float(used.size)) if error > 0.0 else float(used.size)
    return Estimate(float(used.mean()), error, effective, float(blocks - 1))


def jackknife(
    contributions: NDArray[np.generic], statistic: Callable[[FloatArray], ArrayLike]
) -> tuple[FloatArray, FloatArray]:
    """Return a statistic of summed contributions and its standard error by deleting one replica at a time.

    For quantities that are defined only for all replicas together, such as H or the Kolmogorov-Smirnov
    distance of a pooled histogram (Efron and Stein, Ann. Stat. 9, 586 (1981), doi 10.1214/aos/1176345462).

    Parameters
    ----------
    contributions : (R, ...) array
        What each replica adds, for example its histograms.
    statistic : callable
        Maps the sum over replicas, shape (...), to an array of any shape.

    Returns
    -------
    value : array
        The statistic of the sum over all replicas. It is not bias-corrected.
    error : array
        sqrt((R - 1)/R sum_r (theta_r - mean theta)^2); NaN for a single replica. It is first order: for
        smooth statistics it is too large by a relative term of order 1/R.
    """
    total = contributions.sum(axis=0, dtype=np.float64)
    value = np.asarray(statistic(total), dtype=np.float64)
    count = len(contributions)
    if count < 2:
        return value, np.full_like(value, np.nan)
    deleted = np.stack([np.asarray(statistic(total - part), dtype=np.float64) for part in contributions])
    centred = deleted - deleted.mean(axis=0)
    return value, np.sqrt((count - 1) / count * np.einsum("r...,r...->...", centred, centred))


def estimate_from_jackknife(samples: FloatArray, statistic: Callable[[FloatArray], float]) -> Estimate:
    """Return a nonlinear function of the replica mean with its jackknife error, bias removed.

    Parameters
    ----------
    samples : (R, ...) array
        One row per replica.
    statistic : callable
        Maps the mean row to a number.

    Returns
    -------
    Estimate
        R theta - (R - 1) mean theta_(r); a single replica gives theta itself with an error of NaN.
    """
    count = len(samples)
    mean = samples.mean(axis=0)
    value = float(statistic(mean))
    if count < 2:
        return Estimate(value, math.nan, float(count), 0.0)
    deleted = np.array([statistic(mean + (mean - row) / (count - 1)) for row in samples])
    error = math.sqrt((count - 1) / count * float(((deleted - deleted.mean()) ** 2).sum()))
    bias_free = count * value - (count - 1) * float(deleted.mean())
    return Estimate(bias_free, error, float(count), float(count - 1))


@dataclass(frozen=True)
class TheoryCheck:
    """One measured number compared with one theory.

    Attributes
    ----------
    quantity, theory : str
        What was measured, and the theory that it is compared with.
    measured : Estimate
        The measurement.
    expected, uncertainty : float
        The theory's value and its own standard uncertainty u; NaN where there is no theory.
    """

    quantity: str
    theory: str
    measured: Estimate
    expected: float
    uncertainty: float

    def __repr__(self) -> str:
        """Return the comparison in one line."""
        return f"<TheoryCheck: {self}>"

    @property
    def z(self) -> float:
        """Deviation from the theory as a normal deviate, see `Estimate.z`; NaN without a theory."""
        return self.measured.z(self.expected, self.uncertainty)

    @property
    def p_value(self) -> float:
        """Probability of a larger deviation when the theory is right, see `Estimate.p_value`."""
        return self.measured.p_value(self.expected, self.uncertainty)

    @property
    def better_than_theory(self) -> bool:
        """Whether u exceeds two standard errors: the measurement is then more precise than the theory."""
        return self.uncertainty > 2.0 * self.measured.standard_error

    def __str__(self) -> str:
        """Return the comparison in one line."""
        if not self.theory and math.isnan(self.expected):
            return f"{self.quantity} {self.measured}"
        if math.isnan(self.expected):
            return f"{self.quantity} {self.measured}; {self.theory} gives no value here: outside its range"
        expected = Estimate(self.expected, self.uncertainty)
        note = "; the measurement is better than the theory" if self.better_than_theory else ""
        return f"{self.quantity} {self.measured}, {self.theory} {expected}, z = {self.z:+.2f}{note}"


@dataclass(frozen=True)
class ChiSquare:
    """A measured curve against a theoretical one, with the covariance between its points.

    Attributes
    ----------
    statistic : float
        Hotelling's T^2 = delta' C^-1 delta; a chi-square of `degrees_of_freedom` for infinitely many
        replicas.
    degrees_of_freedom : int
        Number of points p.
    n_replicas : int
        Replicas R behind the covariance.
    p_value : float
        Probability of a larger T^2 when the theory is right; reject below 0.001.
    """

    statistic: float
    degrees_of_freedom: int
    n_replicas: int
    p_value: float

    def __repr__(self) -> str:
        """Return the comparison in one line."""
        return f"<ChiSquare: {self}>"

    def __str__(self) -> str:
        """Return the comparison in one line."""
        return f"T^2 = {self.statistic:.1f} for {self.degrees_of_freedom} points, p = {self.p_value:.3g}"


def compare_with_theory(
    samples: ArrayLike, theory: ArrayLike, theory_uncertainty: ArrayLike | None = None
) -> ChiSquare:
    """Test whether the mean of replicas equals a theory, all points together (Hotelling's T^2).

    The points of a relaxation curve are strongly correlated, so that a sum of z^2 is not a chi-square. With S
    the covariance across replicas, C = S/R + diag(u^2) and T^2 = delta' C^-1 delta,

        (R - p) / (p (R - 1)) T^2  ~  F(p, R - p)

    exactly for Gaussian samples and u = 0 (Hotelling, Ann. Math. Stat. 2, 360 (1931), doi
    10.1214/aoms/1177732979); with u > 0 the p-value is slightly too large, never too small by more than
    sampling noise of S.

    Parameters
    ----------
    samples : (R, p) array_like
        One curve per replica, R > p + 1.
    theory : (p,) array_like
        The curve expected for the mean.
    theory_uncertainty : (p,) array_like, optional
        The theory's own standard uncertainty at each point, taken as independent between points.

    Raises
    ------
    ValueError
        If shapes disagree, there are too few replicas, or a point does not fluctuate at all.
    """
    array = np.asarray(samples, dtype=np.float64)
    expected = np.asarray(theory, dtype=np.float64)
    if array.ndim != 2 or expected.shape != array.shape[1:]:
        raise ValueError(f"samples {array.shape} and theory {expected.shape}; expected (R, p) and (p,)")
    replicas, points = array.shape
    if replicas <= points + 1:
        raise ValueError(
            f"{replicas} replicas for {points} points; the covariance needs more than {points + 1}"
        )
    covariance = np.atleast_2d(np.cov(array, rowvar=False)) / replicas
    if theory_uncertainty is not None:
        covariance = covariance + np.diag(np.broadcast_to(np.asarray(theory_uncertainty, float), points) ** 2)
    scale = np.sqrt(np.diag(covariance))
    if not np.all(scale > 0.0):
        raise ValueError("a point has no fluctuation and no uncertainty; leave it out of the comparison")
    correlation = covariance / np.outer(scale, scale)
    delta = (array.mean(axis=0) - expected) / scale
    statistic = float(delta @ np.linalg.solve(correlation, delta))
    ratio = (replicas - points) / (points * (replicas - 1)) * statistic
    p_value = float(special.fdtrc(points, replicas - points, ratio))
    return ChiSquare(statistic, points, replicas, p_value)


def replica_mean(samples: Sequence[ArrayLike] | FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean and standard error over the first axis, point by point.

    Parameters
    ----------
    samples : (R, ...) array_like
        One array per replica.

    Returns
    -------
    mean, error : (...) arrays
        The error is NaN for a single replica.
    """
    array = np.asarray(samples, dtype=np.float64)
    if len(array) < 2:
        return array.mean(axis=0), np.full(array.shape[1:], np.nan)
    return array.mean(axis=0), array.std(axis=0, ddof=1) / math.sqrt(len(array))
