"""Series with known correlation: correlation time, calibrated error bars, equilibration, drift, warnings."""

import math
import warnings

import numpy as np
import pytest
from scipy import signal, stats

from analysis.series import (
    BlockSeries,
    DriftWarning,
    ShortSeriesWarning,
    autocorrelation_time,
    drift_p_value,
    equilibration,
    estimate_from_series,
)
from analysis.statistics import Estimate, ReplicaWarning, combine_replicas, pool_replicas


def ar1(rng, phi, n, runs):
    """Stationary series x_k = phi x_(k-1) + noise of variance 1: tau = (1 + phi)/(1 - phi)/2."""
    noise = rng.standard_normal((runs, n)) * math.sqrt(1 - phi**2)
    noise[:, 0] /= math.sqrt(1 - phi**2)
    return signal.lfilter([1], [1, -phi], noise, axis=1)


def pulls(estimates, truth=0.0):
    """Probability integral transforms of (value - truth)/error by each one's own Student's t."""
    return [stats.t.cdf((e.value - truth) / e.standard_error, e.degrees_of_freedom) for e in estimates]


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9, 0.99])
def test_autocorrelation_time_of_ar1(phi):
    rng = np.random.default_rng(1)
    tau = (1 + phi) / (1 - phi) / 2
    n = math.ceil(2000 * tau)
    estimates = [autocorrelation_time(row) for row in ar1(rng, phi, n, 40)]
    values = np.array([e.value for e in estimates])
    noise = values.std(ddof=1) / math.sqrt(40)
    assert abs(values.mean() - tau) < 4 * noise + 0.015 * tau  # the window's bias: less than exp(-5)
    if phi:
        assert np.mean([e.standard_error for e in estimates]) == pytest.approx(values.std(ddof=1), rel=0.4)
    assert np.mean([e.n_effective for e in estimates]) == pytest.approx(n / (2 * tau), rel=0.1)


@pytest.mark.parametrize(("phi", "n"), [(0.0, 500), (0.5, 600), (0.9, 3000)])
def test_error_bars_follow_students_t(phi, n):
    rng = np.random.default_rng(2)
    series = ar1(rng, phi, n, 300)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DriftWarning)  # once in 10 000 series
        estimates = [estimate_from_series(row) for row in series]
    assert stats.kstest(pulls(estimates), "uniform").pvalue > 1e-3
    assert all(e.n_effective <= n for e in estimates)
    if phi == 0.9:  # sibling: samples taken as independent
        naive = [Estimate(row.mean(), row.std(ddof=1) / math.sqrt(n), n, n - 1) for row in series]
        assert stats.kstest(pulls(naive), "uniform").pvalue < 1e-10


def test_error_of_a_ratio_follows_students_t():
    """Numerator and denominator are correlated in time and with each other; the truth is 3."""
    rng = np.random.default_rng(3)
    ratios = []
    for common, own in zip(ar1(rng, 0.8, 1800, 300), ar1(rng, 0.8, 1800, 300), strict=True):
        below = 1 + 0.2 * common
        ratios.append((3 * below + 0.3 * own, below))
    estimates = [
        estimate_from_series(np.stack(pair, axis=1), lambda mean: mean[..., 0] / mean[..., 1])
        for pair in ratios
    ]
    assert stats.kstest(pulls(estimates, 3.0), "uniform").pvalue > 1e-3
    # sibling: errors added as if the two were independent
    independent = []
    for above, below in ratios:
        parts = [estimate_from_series(part) for part in (above, below)]
        error = math.hypot(*(part.standard_error / part.value for part in parts)) * 3
        independent.append(Estimate(parts[0].value / parts[1].value, error, 0, parts[0].degrees_of_freedom))
    assert stats.kstest(pulls(independent, 3.0), "uniform").pvalue < 1e-6


def test_short_series_warn_and_carry_the_estimate():
    series = ar1(np.random.default_rng(4), 0.95, 400, 1)[0]
    with pytest.warns(ShortSeriesWarning, match="400 samples are too few") as caught:
        estimate = estimate_from_series(series)
    assert caught[0].message.estimate == estimate
    assert estimate.degrees_of_freedom == 7
    with pytest.warns(ShortSeriesWarning):
        assert estimate_from_series([1.0, 2.0, 3.0]).degrees_of_freedom == 2
    # a constant has no error and needs no warning
    assert estimate_from_series(np.full(100, 3.0)).standard_error == 0.0


def test_drift_warns_and_carries_the_estimate():
    series = ar1(np.random.default_rng(5), 0.5, 4000, 1)[0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate_from_series(series)
    # 0.8 standard deviations of a sample from end to end, 8 standard errors of the slope
    with pytest.warns(DriftWarning, match="drifts") as caught:
        estimate_from_series(series + np.linspace(0, 0.8, 4000))
    assert math.isfinite(caught[0].message.estimate.standard_error)
    assert drift_p_value(np.ones(10)) == 1.0
    # a start far off looks like a long correlation, but is told from it
    with pytest.warns(DriftWarning, match="unlike the rest"):
        estimate_from_series(series + 30 * np.exp(-np.arange(4000) / 200))


@pytest.mark.parametrize("n", [3, 4, 7, 24, 33, 34, 200])
@pytest.mark.parametrize("tied", [False, True])
def test_the_probability_of_a_drift_is_the_one_of_scipy(n, tied):
    """Of Kendall's tau with its exact law, or the normal one. Sibling: turned round in time, the same; a trend, less."""
    rng = np.random.default_rng(n)
    for strength in (0.0, 0.05, -1.0):
        values = rng.standard_normal(n) + strength * np.arange(n)
        if tied:
            values = np.round(values)
        if np.ptp(values) == 0.0:
            continue
        known = stats.kendalltau(np.arange(n), values).pvalue
        assert drift_p_value(values) == pytest.approx(known, rel=1e-11, abs=1e-300)
        assert drift_p_value(values[::-1]) == drift_p_value(values)
    assert drift_p_value(np.arange(n)) < drift_p_value([*range(1, n), 0]) or n == 3


def test_equilibration_discards_the_start_and_little_else():
    rng = np.random.default_rng(6)
    series = ar1(rng, 0.8, 4000, 60)
    decay = 10 * np.exp(-np.arange(4000) / 100)
    found = [equilibration(row + decay) for row in series]
    starts = np.array([e.start for e in found])
    assert all(e.reached for e in found)
    assert np.all((starts > 150) & (starts < 1000))  # 10 exp(-1.5) = 2.2 standard deviations is too much
    kept = np.array([(row + decay)[e.start :].mean() for row, e in zip(series, found, strict=True)])
    whole = (series + decay).mean(axis=1)
    noise = series.mean(axis=1).std()
    assert abs(kept.mean()) < 4 * noise / math.sqrt(60) + 0.3 * noise
    assert whole.mean() > 3 * noise  # sibling: nothing discarded
    # steady from the start: most is kept
    assert np.mean([equilibration(row).start for row in series]) < 500
    # never steady
    assert not equilibration(series[0] + np.linspace(0, 30, 4000)).reached


def test_a_block_series_has_bounded_memory_and_the_same_estimates():
    row = ar1(np.random.default_rng(7), 0.9, 70_001, 1)[0]
    blocks = BlockSeries(capacity=1024)
    for value in row:
        blocks.add(value)
    assert (blocks.samples_per_row, len(blocks), blocks.n_samples) == (128, 546, 70_001)
    np.testing.assert_allclose(blocks.rows, row[: 546 * 128].reshape(546, 128).mean(axis=1))
    assert float(blocks.mean) == pytest.approx(row.mean(), rel=1e-12)
    direct, streamed = estimate_from_series(row), estimate_from_series(blocks.rows)
    assert streamed.standard_error == pytest.approx(direct.standard_error, rel=0.3)
    with pytest.raises(ValueError, match="capacity = 17"):
        BlockSeries(17)


def test_replicas_are_combined_by_their_spread_and_checked_by_their_errors():
    rng = np.random.default_rng(9)

    def replicas(extra):
        values = rng.normal(5.0, math.hypot(0.1, extra), 12)
        return [Estimate(v, 0.1 * math.sqrt(rng.chisquare(20) / 20), 100, 20) for v in values]

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        combined = [combine_replicas(replicas(0.0)) for _ in range(200)]
    assert stats.kstest(pulls(combined, 5.0), "uniform").pvalue > 1e-3
    assert combined[0].degrees_of_freedom == 11
    with pytest.warns(ReplicaWarning, match="12 replicas spread") as caught:
        estimate = combine_replicas(replicas(0.5))
    assert caught[0].message.estimate == estimate


def test_pooled_replicas_follow_their_own_students_t():
    """800 pools of 2 replicas with 8 values each: KS p < 0.001 once in 1000 seeds."""
    rng = np.random.default_rng(5)

    def replica():
        values = rng.standard_normal(8)
        return Estimate(values.mean(), values.std(ddof=1) / math.sqrt(8), 8, 7)

    pools = [pool_replicas([replica(), replica()]) for _ in range(800)]
    assert stats.kstest(pulls(pools), "uniform").pvalue > 1e-3
    assert all(7 <= pool.degrees_of_freedom <= 14 and pool.n_effective == 16 for pool in pools)
    # sibling: the errors of single replicas, not divided by their number
    wrong = [Estimate(p.value, p.standard_error * math.sqrt(2), 16, p.degrees_of_freedom) for p in pools]
    assert stats.kstest(pulls(wrong), "uniform").pvalue < 1e-3
    with pytest.raises(ValueError, match="no replicas to pool"):
        pool_replicas([])


def test_p_values_and_intervals_are_students():
    estimate = Estimate(1.3, 0.1, 5, 4)
    assert estimate.p_value(1.0) == pytest.approx(2 * stats.t.sf(3.0, 4))
    assert estimate.p_value(1.0, 10.0) == pytest.approx(
        2 * stats.norm.sf(0.3 / math.hypot(0.1, 10)), rel=1e-5
    )
    _, high = estimate.interval(0.9)
    assert (high - 1.3) / 0.1 == pytest.approx(stats.t.ppf(0.95, 4))
    assert Estimate(0.0, 1.0).interval()[0] == pytest.approx(-1.959964, abs=1e-6)
    with pytest.raises(ValueError, match="confidence = 95"):
        estimate.interval(95)


@pytest.mark.parametrize(
    ("series", "message"),
    [([1.0], "n >= 2"), ([1.0, np.nan, 2.0], "sample 1"), (np.ones((4, 2)), "statistic of p means")],
)
def test_misuse_is_named(series, message):
    with pytest.raises(ValueError, match=message):
        estimate_from_series(series)
    with pytest.raises(ValueError, match="at least 16"):
        equilibration(np.ones(10))
