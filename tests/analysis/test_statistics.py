"""Error bars: their printing, and whether they cover what they claim."""

import math

import numpy as np
import pytest
from scipy import special, stats

from analysis.statistics import (
    Estimate,
    TheoryCheck,
    compare_with_theory,
    deviates,
    estimate_from_blocks,
    estimate_from_jackknife,
    estimate_from_replicas,
    jackknife,
    normal_deviate,
    pool_replicas,
    replica_mean,
)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (9.404114, 0.0083, "9.404(8)"),
        (9.404114, 0.0012, "9.4041(12)"),
        (-1.25e-7, 3e-9, "-1.25(3)e-7"),
        (0.0, 0.02, "0.00(2)"),
        (0.001, 0.02, "0.00(2)"),
        (0.0996, 0.0097, "0.100(10)"),
        (1234.5, 56.0, "1.23(6)e3"),
        (3.25, 0.0, "3.25(0)"),
        (3.25, math.nan, "3.25(nan)"),
        (3.25, math.inf, "3.25(inf)"),
        (math.nan, 0.1, "nan(0.1)"),
    ],
)
def test_estimate_prints_its_error_in_the_last_digit(value, error, text):
    assert str(Estimate(value, error, 10)) == text


def test_deviation_adds_the_errors_in_quadrature():
    assert Estimate(1.0, 3.0, 10).deviation(-9.0, 4.0) == pytest.approx(2.0)
    assert math.isnan(Estimate(1.0, 0.0, 10).deviation(1.0))


@pytest.mark.parametrize("freedom", [1, 2, 5, 19])
def test_z_is_a_normal_deviate(freedom):
    """Means of few samples: z is standard normal, the deviation in standard errors (sibling) is not."""
    rng = np.random.default_rng(freedom)
    means = [estimate_from_replicas(row) for row in rng.normal(3.0, 2.0, (4000, freedom + 1))]
    z = np.array([mean.z(3.0) for mean in means])
    assert stats.kstest(z, "norm").pvalue > 1e-3
    naive = np.array([mean.deviation(3.0) for mean in means])
    assert np.mean(np.abs(naive) > 4) > 10 * np.mean(np.abs(z) > 4) + (2e-4 if freedom < 19 else -1)
    checks = [TheoryCheck("x", "truth", mean, 3.0, 0.0).z for mean in means[:50]]
    np.testing.assert_allclose(checks, z[:50])


def test_ten_standard_errors_of_two_replicas_are_no_discovery():
    assert Estimate(9.7, 1.0, 2, 1.0).z(0.0) == pytest.approx(1.84, abs=0.01)
    assert Estimate(9.7, 1.0, 2, 1.0).p_value(0.0) == pytest.approx(0.0654, abs=1e-4)
    assert Estimate(-9.7, 1.0).z(0.0) == -9.7  # a known error
    assert deviates([9.7, -9.7], [1.0, 1.0], [0.0, 0.0], 1.0) == pytest.approx([1.8425, -1.8425], abs=1e-4)
    assert Estimate(6.0, 1.0, 2, 1.0).z(0.0, 1e-9) == pytest.approx(
        Estimate(6.0, 1.0, 2, 1.0).z(0.0), abs=1e-6
    )
    assert Estimate(6.0, 1e-9, 2, 1.0).z(0.0, 3.0) == pytest.approx(2.0, abs=1e-6)
    assert Estimate(6.0, 1.0, 9, 8.0).z(0.0, 1e-9) == pytest.approx(
        Estimate(6.0, 1.0, 9, 8.0).z(0.0), abs=1e-6
    )
    assert Estimate(6.0, 1.0, 9, 1e6).z(0.0, 1.0) == pytest.approx(6.0 / math.sqrt(2.0), abs=1e-4)
    far = normal_deviate([30.0, 37.0, 39.0, 60.0], 1000.0)  # where probabilities end, by another formula
    assert np.all(np.diff(far) > 1) and abs(far[1] - special_deviate(37.0, 1000.0)) < 0.02
    assert math.isnan(Estimate(1.0, math.nan, 1, 0.0).z(0.0)) and math.isnan(Estimate(1.0, 0.0).z(1.0))


@pytest.mark.parametrize("own", [0.2, 1.0, 5.0])
def test_z_beside_an_uncertain_theory(own):
    """Two replicas of error `own` beside a theory of uncertainty 1: |z| > 3 in no more than 0.3 % of 20 000 cases.

    Sibling: Welch's degrees of freedom, which are infinite where two replicas agree by chance.
    """
    rng = np.random.default_rng(12)
    values = rng.normal(0.0, own * math.sqrt(2), (20_000, 2)) + rng.standard_normal((20_000, 1))
    mean, error = values.mean(axis=1), np.abs(np.diff(values, axis=1)[:, 0]) / 2
    z = np.concatenate(
        [deviates(m, e, 1.0, 1.0) for m, e in zip(np.split(mean, 20), np.split(error, 20), strict=True)]
    )
    assert np.mean(np.abs(z) > 3) < 0.004
    share = error**2 / (error**2 + 1.0)
    welch = normal_deviate(mean / np.hypot(error, 1.0), 1.0 / share**2)
    if own == 5.0:
        assert np.mean(np.abs(welch) > 3) > 0.01


def special_deviate(t, freedom):
    """The same from the logarithm of the probability."""
    return -float(special.ndtri_exp(stats.t.logsf(t, freedom)))


def test_a_check_without_theory_says_so():
    check = TheoryCheck(
        "Z from the virial", "Kolafa-Labik-Malijevsky", Estimate(22.1, 0.2, 9, 8), math.nan, math.nan
    )
    assert (
        str(check)
        == "Z from the virial 22.1(2); Kolafa-Labik-Malijevsky gives no value here: outside its range"
    )
    assert math.isnan(check.z) and not check.better_than_theory


def test_replicas_that_differ_are_pooled_by_their_spread():
    """Six starts that are not forgotten, of 13 % each and quoted to 3 %; of equal ones (sibling) blocks give the error."""
    rng = np.random.default_rng(11)
    starts = [Estimate(value, 0.03, 20, 19) for value in rng.normal(1.0, 0.13, 6)]
    pooled = pool_replicas(starts)
    assert pooled.standard_error == pytest.approx(np.std([e.value for e in starts], ddof=1) / math.sqrt(6))
    assert pooled.degrees_of_freedom == 5
    equal = [Estimate(value, 0.03, 20, 19) for value in rng.normal(1.0, 0.03, 6)]
    assert pool_replicas(equal).standard_error == pytest.approx(0.03 / math.sqrt(6))
    assert pool_replicas(equal).degrees_of_freedom == pytest.approx(6 * 19)


def test_replicas():
    estimate = estimate_from_replicas([1.0, 2.0, 3.0, 4.0])
    assert estimate.value == 2.5
    assert estimate.standard_error == pytest.approx(np.std([1, 2, 3, 4], ddof=1) / 2)
    assert estimate.n_effective == 4
    assert math.isnan(estimate_from_replicas([1.0]).standard_error)
    with pytest.raises(ValueError, match=r"shape \(0,\)"):
        estimate_from_replicas([])


def test_blocks_find_the_error_of_a_correlated_series():
    # AR(1) with correlation 0.9 per step: the variance of the mean is larger by (1 + 0.9)/(1 - 0.9) = 19.
    rng = np.random.default_rng(1)
    count, runs = 2**14, 40
    noise = rng.standard_normal((runs, count)) * math.sqrt(1 - 0.81)
    series = np.empty_like(noise)
    series[:, 0] = rng.standard_normal(runs)
    for k in range(1, count):
        series[:, k] = 0.9 * series[:, k - 1] + noise[:, k]
    estimates = [estimate_from_blocks(row) for row in series]
    truth = math.sqrt(19 / count)
    ratio = np.array([e.standard_error for e in estimates]) / truth
    assert abs(ratio.mean() - 1) < 0.1
    pulls = np.array([e.value / e.standard_error for e in estimates])
    assert (
        stats.chi2.sf((pulls**2).sum() * 30 / 32, runs) > 1e-4
    )  # t with 31 degrees of freedom has variance 31/29
    assert np.median([e.n_effective for e in estimates]) == pytest.approx(count / 19, rel=0.3)
    # the naive error must fail the same test
    naive = series.mean(axis=1) / (series.std(axis=1) / math.sqrt(count))
    assert stats.chi2.sf((naive**2).sum(), runs) < 1e-10


def test_blocks_that_are_too_short_warn():
    walk = np.cumsum(np.random.default_rng(2).standard_normal(1000))
    with pytest.warns(UserWarning, match="blocks of 31 samples are correlated"):
        estimate_from_blocks(walk)
    with pytest.raises(ValueError, match="n >= 64"):
        estimate_from_blocks(walk[:60])


def test_jackknife_of_a_mean_is_its_standard_error():
    samples = np.random.default_rng(3).standard_normal((25, 4))
    value, error = jackknife(samples, lambda total: total / 25)
    mean, expected = replica_mean(samples)
    np.testing.assert_allclose(value, mean)
    # deleting a row from a sum over 25 leaves the mean of 24 times 24/25
    np.testing.assert_allclose(error, expected * 24 / 25, rtol=1e-12)


def test_jackknife_removes_the_bias_of_a_square():
    rng = np.random.default_rng(4)
    estimates = [
        estimate_from_jackknife(rng.normal(1.0, 1.0, (10, 1)), lambda m: float(m[0] ** 2))
        for _ in range(2000)
    ]
    values = np.array([e.value for e in estimates])
    assert abs(values.mean() - 1.0) < 4 * values.std() / math.sqrt(2000)  # plain square: 1.1, biased by 0.1
    assert np.mean([e.standard_error for e in estimates]) == pytest.approx(values.std(), rel=0.1)


def _correlated(rng, replicas, points=8):
    walk = rng.standard_normal((replicas, points)).cumsum(axis=1)
    return walk * np.linspace(1, 2, points)


def test_hotelling_p_values_are_even_and_see_a_shift():
    rng = np.random.default_rng(5)
    p = [compare_with_theory(_correlated(rng, 30), np.zeros(8)).p_value for _ in range(400)]
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    shift = np.zeros(8)
    shift[3] = 1.5  # 5.5 standard errors of one step of the walk, but only 1.6 of the point itself
    shifted = [compare_with_theory(_correlated(rng, 30), shift).p_value for _ in range(20)]
    assert max(shifted) < 1e-2


def test_theory_uncertainty_weakens_the_test():
    samples = _correlated(np.random.default_rng(6), 30)
    off = np.full(8, 3.0)
    sharp = compare_with_theory(samples, off)
    soft = compare_with_theory(samples, off, np.full(8, 10.0))
    assert sharp.statistic > 5 * soft.statistic
    assert soft.p_value > 0.5


def test_hotelling_refuses_what_it_cannot_do():
    samples = _correlated(np.random.default_rng(7), 9)
    with pytest.raises(ValueError, match="9 replicas for 8 points"):
        compare_with_theory(samples, np.zeros(8))
    with pytest.raises(ValueError, match="expected"):
        compare_with_theory(samples, np.zeros(3))
    with pytest.raises(ValueError, match="no fluctuation"):
        compare_with_theory(np.ones((20, 2)), np.ones(2))


def test_an_estimate_is_a_number():
    """In sums, in formats, and in words; sibling: its error is not lost where no form is given."""
    z = Estimate(9.404114, 0.0083, 20)
    assert float(z) == 9.404114 and math.sqrt(z) == math.sqrt(9.404114)
    assert f"{z:.3f}" == "9.404" and f"{z:+.1e}" == "+9.4e+00" and f"{z:8.2f}" == "    9.40"
    assert f"{z}" == str(z) == "9.404(8)" and f"{z:>10s}" == "  9.404(8)"
    with pytest.raises(ValueError, match="format"):
        f"{z:q}"
