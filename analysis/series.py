"""Correlated time series: autocorrelation time, blocks of automatic length, equilibration, drift.

A series holds samples in the order of time, equally spaced. The correlation time tau is in samples and in
Sokal's convention, tau = 1/2 + sum of rho(k) over k >= 1: n samples are equivalent to n / 2 tau independent
ones.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from analysis.statistics import Estimate, combine_replicas, pool_replicas

__all__ = [
    "BlockSeries",
    "DriftWarning",
    "Equilibration",
    "SeriesWarning",
    "ShortSeriesWarning",
    "autocorrelation_time",
    "complex_autocorrelation_time",
    "drift_p_value",
    "equilibration",
    "estimate_from_runs",
    "estimate_from_series",
]

FloatArray = NDArray[np.float64]

SOKAL_WINDOW = 5.0  # the sum of the autocorrelation ends after this many correlation times
BLOCK_LENGTH = 20.0  # in correlation times: the variance of the mean is then at most 5 % too small
MOST_BLOCKS, FEWEST_BLOCKS = 24, 8
DRIFT_ALARM = 1e-4
FEW = 33  # blocks up to which the probability of a drift is exact
SHORT_RUN = 16  # samples below which a run is not taken as a series of its own


class SeriesWarning(UserWarning):
    """An estimate whose error bar cannot be trusted.

    Attributes
    ----------
    estimate : Estimate
        The best estimate available; its error is a lower bound.
    """

    def __init__(self, message: str, estimate: Estimate) -> None:
        super().__init__(message)
        self.estimate = estimate


class ShortSeriesWarning(SeriesWarning):
    """The series is too short for its correlation time.

    Attributes
    ----------
    times : float
        How many times longer it should be.
    """

    def __init__(self, message: str, estimate: Estimate, times: float = math.nan) -> None:
        super().__init__(message, estimate)
        self.times = times


class DriftWarning(SeriesWarning):
    """The series drifts: it has not come to equilibrium."""


def autocorrelation_time(series: ArrayLike) -> Estimate:
    """Return the integrated autocorrelation time of a series, in samples.

    tau(W) = 1/2 + sum of rho(k), 1 <= k <= W, with the smallest window W >= 5 tau(W) (Madras and Sokal, J.
    Stat. Phys. 50, 109 (1988), doi 10.1007/BF01022990).

    Parameters
    ----------
    series : (n,) array_like
        n >= 2.

    Returns
    -------
    Estimate
        At least 1/2. Its standard error is sqrt((4/n) (W + 1/2 - 2.2 tau + 0.3/tau)) tau, which is Bartlett's
        (J. R. Stat. Soc. Suppl. 8, 27 (1946), doi 10.2307/2983611) for an exponential autocorrelation and a
        window of 5 tau; the usual sqrt(2 (2W + 1) / n) tau neglects that the variance is estimated too, and
        is a third too large. Bias: the window cuts off about exp(-5) of an exponential, and the use of the
        sample mean lowers tau by about 2 tau^2/n, so that a series of fewer than some 100 tau gives too small
        a value. `n_effective` is n / 2 tau.

    Raises
    ------
    ValueError
        If the series is not one-dimensional, shorter than 2, or not finite.
    """
    array = _series(series)
    n = array.size
    centred = array - array.mean()
    variance = float(centred @ centred) / n
    if variance <= (1e-14 * abs(float(array.mean()))) ** 2:  # nothing but rounding
        return Estimate(0.5, 0.0, float(n))
    return _integrated(centred)


def complex_autocorrelation_time(series: ArrayLike) -> Estimate:
    """Return the integrated autocorrelation time of a complex series whose mean is known to be 0, in samples.

    rho(k) is the real part of <x(t + k) x(t)*> over <|x|^2>; else as `autocorrelation_time`. The mean of the
    series is not subtracted: a series that keeps its direction from end to end has not decorrelated at all.

    Parameters
    ----------
    series : (n,) array_like of complex
        n >= 2, such as an order parameter, all of whose directions are equivalent.

    Returns
    -------
    Estimate
        From 1/2 to n/2, which is that of a constant.
    """
    array = np.asarray(series, dtype=np.complex128)
    _series(array.real), _series(array.imag)
    return _integrated(array) if np.any(array) else Estimate(0.5, 0.0, float(array.size))


def _integrated(centred: NDArray[np.generic]) -> Estimate:
    """Return the integrated autocorrelation time of a series, real or complex, of mean 0."""
    n = centred.size
    transform = fft.fft(centred, fft.next_fast_len(2 * n))
    covariance = fft.ifft(np.abs(transform) ** 2).real[:n] / n
    running = np.cumsum(covariance / covariance[0]) - 0.5
    closed = np.arange(n) >= SOKAL_WINDOW * running
    window = int(np.argmax(closed)) if closed.any() else n - 1
    tau = max(float(running[window]), 0.5)
    spread = max(window + 0.5 - 2.2 * tau + 0.3 / tau, 1.0)
    return Estimate(tau, tau * math.sqrt(4.0 * spread / n), n / (2.0 * tau))


def _series(series: ArrayLike) -> FloatArray:
    array = np.asarray(series, dtype=np.float64)
    if array.ndim != 1 or array.size < 2:
        raise ValueError(f"series has shape {array.shape}; expected (n,) with n >= 2")
    if not np.isfinite(array).all():
        raise ValueError(f"sample {int(np.argmin(np.isfinite(array)))} of the series is not finite")
    return array


def block_length(series: ArrayLike) -> int:
    """Return how many samples a block needs so that blocks are practically independent.

    For an exponential autocorrelation the variance of the mean from blocks of B samples is too small by the
    relative amount (tau - 1/4 tau) / B; B is chosen to make that 5 %, or 2.5 % of the standard error. If tau
    is within two standard errors, sqrt(3.5/n) each, of 1/2, the series counts as uncorrelated and B = 1.

    Parameters
    ----------
    series : (n,) array_like
        n >= 2.
    """
    array = _series(series)
    tau = autocorrelation_time(array).value
    if tau < 0.5 + 2.0 * math.sqrt(3.5 / array.size):
        return 1
    return max(math.ceil(BLOCK_LENGTH * (tau - 0.25 / tau)), 1)


def estimate_from_series(
    series: ArrayLike, statistic: Callable[[FloatArray], FloatArray] | None = None, shortest: int = 1
) -> Estimate:
    """Return the mean of a correlated series, or a function of its means, with an error from blocks.

    The series is cut into M blocks of automatic length (`block_length`: 20 correlation times by Sokal's
    window, but no less than `shortest`; some 24 to 48 blocks where the series is long enough for more), and
    the blocks are taken as independent (Flyvbjerg and Petersen, J. Chem. Phys. 91, 461 (1989), doi
    10.1063/1.457480). (value - truth) / standard_error follows Student's t with M - 1 degrees of freedom. A
    nonlinear function, such as a ratio, comes from the jackknife over the same blocks, its bias of order 1/M
    removed.

    Parameters
    ----------
    series : (n,) or (n, p) array_like
        Samples in the order of time; n >= 2. Samples at the start that do not fill a block count for the
        value but not for its error.
    statistic : callable, optional
        Maps means of shape (..., p) to (...); needed for a series of shape (n, p). The ratio of two sums is
        ``lambda mean: mean[..., 0] / mean[..., 1]``.
    shortest : int, default 1
        Least number of samples in a block, for a correlation known to be too weak and too long to be detected
        in the series.

    Returns
    -------
    Estimate
        `n_effective` is the number of independent samples that would give the same error, at most n. Bias:
        the error is too small by up to 2.5 %, in a series of fewer than 100 samples by more, since a weak
        correlation cannot be detected there.

    Warns
    -----
    ShortSeriesWarning
        With fewer than 8 blocks; the error is then from 8 shorter ones, or from single samples, and a lower
        bound.
    DriftWarning
        If there are fewer than 8 blocks only because the start is not equilibrated: dropping it by the rule
        of `equilibration` would double the number of independent samples. Or if the blocks show a trend whose
        probability by chance is below 1e-4. Both warnings carry the estimate.

    Raises
    ------
    ValueError
        For a wrong shape, or samples that are not finite.
    """
    array = np.asarray(series, dtype=np.float64)
    rows, function = array, statistic or _first
    if array.ndim == 1 and statistic is None:
        rows = _series(array)[:, None]
    elif array.ndim != 2 or statistic is None or len(array) < 2:
        expected = "(n,) with n >= 2, or (n, p) with a statistic of p means"
        raise ValueError(f"series has shape {array.shape}; expected {expected}")
    pseudo = _series(_pseudo_values(rows, function))
    n = len(rows)

    def statistic_of(samples: FloatArray) -> FloatArray:
        return np.asarray(function(samples.mean(axis=0)))

    needed = max(block_length(pseudo), shortest)
    length = max(needed, n // MOST_BLOCKS)
    too_short = n // length < FEWEST_BLOCKS
    if too_short:
        length = max(n // FEWEST_BLOCKS, 1)
    blocks = n // length
    kept = rows[n - blocks * length :]
    means = kept.reshape(blocks, length, -1).mean(axis=1)
    values = _pseudo_values(means, function)
    error = float(values.std(ddof=1)) / math.sqrt(blocks)
    variance = float(pseudo.var(ddof=1))
    effective = min(variance / error**2, float(n)) if error > 0.0 else float(n)
    bias_free = float(statistic_of(rows)) + float(values.mean()) - float(statistic_of(kept))
    estimate = Estimate(bias_free, error, effective, float(blocks - 1))
    whole = autocorrelation_time(pseudo)
    settled = equilibration(pseudo, candidates=20) if too_short and n >= 16 else None
    if settled is not None and settled.n_effective > 2.0 * whole.n_effective:
        message = (
            f"the first {settled.start} of {n} samples are unlike the rest ({estimate} with them); "
            "discard them, or equilibrate longer"
        )
        warnings.warn(DriftWarning(message, estimate), stacklevel=2)
    elif too_short:
        message = (
            f"{n} samples are too few for an error bar, which needs {FEWEST_BLOCKS} blocks of {needed} "
            f"(that of {estimate} is a lower bound); take at least {FEWEST_BLOCKS * needed} samples"
        )
        warnings.warn(ShortSeriesWarning(message, estimate, FEWEST_BLOCKS * needed / n), stacklevel=2)
    elif drift_p_value(values) < DRIFT_ALARM:
        message = f"the series drifts ({estimate} is no average of a steady state); equilibrate longer"
        warnings.warn(DriftWarning(message, estimate), stacklevel=2)
    return estimate


def estimate_from_runs(
    runs: Sequence[FloatArray],
    statistic: Callable[[FloatArray], FloatArray] | None = None,
    shortest: Sequence[int] | None = None,
    weights: Sequence[float] | None = None,
) -> Estimate:
    """Return the mean over independent runs, or a function of their means, with the errors of all.

    Each run gives an estimate of its own (`estimate_from_series`); their mean has the error of
    `statistics.pool_replicas`. Runs of fewer than `SHORT_RUN` samples are joined to the first long one, or to
    each other: what is short says little about its own error.

    Parameters
    ----------
    runs : sequence of (n,) or (n, p) arrays
        Samples of each run in the order of time.
    statistic : callable, optional
        As in `estimate_from_series`.
    shortest : sequence of int, optional
        Least number of samples in a block of each run.
    weights : sequence of float, optional
        Lengths of the runs; by default their numbers of samples.

    Returns
    -------
    Estimate
        Of a single run, that of `estimate_from_series`.

    Warns
    -----
    SeriesWarning
        As `estimate_from_series`, for each run.
    ReplicaWarning
        If the runs spread further than their own errors say; the error is then that of the spread.
    """
    lengths = [len(run) for run in runs] if weights is None else weights
    blocks = [1] * len(runs) if shortest is None else shortest
    estimates, totals = [], []
    for group in run_groups(runs):
        joined = runs[group[0]] if len(group) == 1 else np.concatenate([runs[k] for k in group])
        estimates.append(estimate_from_series(joined, statistic, max(blocks[k] for k in group)))
        totals.append(sum(lengths[k] for k in group))
    return pool_runs(estimates, totals)


def run_groups(runs: Sequence[FloatArray]) -> list[list[int]]:
    """Return which runs are taken as one series: see `estimate_from_runs`."""
    short = [k for k, run in enumerate(runs) if len(run) < SHORT_RUN]
    groups = [[k] for k, run in enumerate(runs) if len(run) >= SHORT_RUN] or [[]]
    return [groups[0] + short, *groups[1:]]


def pool_runs(estimates: Sequence[Estimate], lengths: Sequence[float]) -> Estimate:
    """Return the mean of runs with these lengths; warn as `combine_replicas` where they disagree."""
    if len(estimates) == 1:
        return estimates[0]
    weights = None if min(lengths) == max(lengths) else lengths
    combine_replicas(estimates, weights)
    return pool_replicas(estimates, weights)


def _first(means: FloatArray) -> FloatArray:
    return means[..., 0]


def _pseudo_values(rows: FloatArray, statistic: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Return what each row contributes to a statistic of the means: the jackknife's pseudo-values."""
    if statistic is _first:
        return rows[:, 0]
    n = len(rows)
    mean = rows.mean(axis=0)
    deleted = np.asarray(statistic(mean + (mean - rows) / (n - 1)), dtype=np.float64)
    return np.asarray(n * float(np.asarray(statistic(mean))) - (n - 1) * deleted)


def drift_p_value(blocks: ArrayLike) -> float:
    """Return the probability of a trend as strong as this in independent blocks that have none.

    Kendall's rank correlation of the block means with time (Biometrika 30, 81 (1938), doi
    10.1093/biomet/30.1-2.81): a single outlying block at the start neither hides a trend nor makes one. Exact
    for up to `FEW` blocks, all different; beyond that by the normal law. SciPy's function gives the same, and
    takes a quarter of a second to import.

    Parameters
    ----------
    blocks : (M,) array_like
        Block means, M >= 3, each longer than the correlation time.
    """
    values = _series(blocks)
    if values.size < 3:
        raise ValueError(f"{values.size} blocks; a drift needs at least 3")
    if float(np.ptp(values)) == 0.0:
        return 1.0
    n, ties = values.size, np.unique(values, return_counts=True)[1]
    rising = sum(float(np.sign(values[k + 1 :] - values[k]).sum()) for k in range(n - 1))
    if n <= FEW and ties.max() == 1:
        chances = np.ones(1)  # of so many pairs out of order, in a random order of 1, 2, ... numbers
        for k in range(2, n + 1):
            chances = np.convolve(chances, np.full(k, 1.0 / k))
        out_of_order = int(n * (n - 1) - 2 * abs(rising)) // 4
        return min(1.0, 2.0 * float(chances[: out_of_order + 1].sum()))
    variance = (n * (n - 1) * (2 * n + 5) - float((ties * (ties - 1) * (2 * ties + 5)).sum())) / 18.0
    return math.erfc(abs(rising) / math.sqrt(2.0 * variance))


@dataclass(frozen=True)
class Equilibration:
    """From where on a series is in equilibrium.

    Attributes
    ----------
    start : int
        First sample to keep.
    autocorrelation_time : float
        tau of what is kept, in samples.
    n_effective : float
        Independent samples in what is kept.
    reached : bool
        False when more than 40 % of the series would be discarded, or fewer than 20 independent samples
        remain: the series may then never have reached equilibrium, and `start` has no meaning.
    """

    start: int
    autocorrelation_time: float
    n_effective: float
    reached: bool


def equilibration(series: ArrayLike, candidates: int = 50) -> Equilibration:
    """Return how much of the start of a series to discard.

    The rule: keep what has the most independent samples, start = argmax over t0 of (n - t0) / 2 tau(t0)
    (Chodera, J. Chem. Theory Comput. 12, 1799 (2016), doi 10.1021/acs.jctc.5b00784). An initial part far from
    equilibrium raises tau, so that dropping it increases that number.

    Parameters
    ----------
    series : (n,) array_like
        n >= 16.
    candidates : int, default 50
        How many t0 are tried, evenly from 0 to n/2.

    Returns
    -------
    Equilibration
        Bias: of an exponential approach about a third of a standard error of the mean is left; in a series
        that is stationary from the start the rule drops a few per cent by chance. A drift slower than the
        series is not detected here but by `estimate_from_series`.

    Raises
    ------
    ValueError
        If the series has fewer than 16 samples or is not finite.
    """
    array = _series(series)
    n = array.size
    if n < 16:
        raise ValueError(f"{n} samples; finding the equilibration needs at least 16")
    starts = np.unique(np.linspace(0, n // 2, min(candidates, n // 2)).astype(np.int64))
    times = [autocorrelation_time(array[start:]) for start in starts]
    best = int(np.argmax([time.n_effective for time in times]))
    start, time = int(starts[best]), times[best]
    reached = start <= 0.4 * n and time.n_effective >= 20.0
    return Equilibration(start, time.value, time.n_effective, reached)


class BlockSeries:
    """A series of any length in bounded memory: when it is full, adjacent rows are averaged in pairs.

    Parameters
    ----------
    capacity : int, default 1024
        Most rows kept; even, at least 16. A long series fills between half and all of them; each row is the
        mean of the same number of samples, a power of two.

    Notes
    -----
    This is Flyvbjerg and Petersen's blocking transformation done as the data come in: an estimate from the
    rows is that from the samples as long as a row is shorter than 20 correlation times or so.
    """

    def __init__(self, capacity: int = 1024) -> None:
        if capacity < 16 or capacity % 2:
            raise ValueError(f"capacity = {capacity}; expected an even number of at least 16")
        self._capacity = capacity
        self._rows: list[FloatArray] = []
        self._partial: FloatArray | None = None
        self._in_partial = 0
        self._samples_per_row = 1

    def add(self, sample: ArrayLike) -> None:
        """Append one sample, a number or an array; all of the same shape."""
        row = np.array(sample, dtype=np.float64)
        self._partial = row if self._partial is None else self._partial + row
        self._in_partial += 1
        if self._in_partial < self._samples_per_row:
            return
        self._rows.append(self._partial / self._samples_per_row)
        self._partial, self._in_partial = None, 0
        if len(self._rows) == self._capacity:
            pairs = zip(self._rows[::2], self._rows[1::2], strict=True)
            self._rows = [(first + second) / 2 for first, second in pairs]
            self._samples_per_row *= 2

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        """Return how many samples there are, and in how many rows."""
        return f"<BlockSeries: {self.n_samples} samples in {len(self)} rows>"

    @property
    def samples_per_row(self) -> int:
        """How many samples each row is the mean of."""
        return self._samples_per_row

    @property
    def rows(self) -> FloatArray:
        """Means in the order of time, (rows, ...); samples that do not fill a row yet are left out."""
        return np.array(self._rows)

    @property
    def n_samples(self) -> int:
        """How many samples were added."""
        return len(self._rows) * self._samples_per_row + self._in_partial

    @property
    def mean(self) -> FloatArray:
        """Mean of all samples, the last ones included."""
        total = np.sum(self._rows, axis=0) * self._samples_per_row
        if self._partial is not None:
            total = total + self._partial
        return np.asarray(total / self.n_samples)
