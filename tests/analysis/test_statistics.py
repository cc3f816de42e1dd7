"""Error bars: their printing, and whether they cover what they claim."""

import math
import warnings

import mpmath
import numpy as np
import pytest
from scipy import integrate, special, stats

from analysis.statistics import (
    Estimate,
    ReplicaWarning,
    TheoryCheck,
    combine_replicas,
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
        (9.404114, 0.017, "9.404(17)"),
        (12.0, 1.95, "12(2)"),  # the error rounds to 2.0: one digit
        (12.0, 3.0, "12(3)"),
        (3.1e-4, 2e-5, "0.00031(2)"),
        (3.1e-5, 2e-6, "3.1(2)e-5"),
        (125000.5, 0.3, "125000.5(3)"),
        (1250000.5, 0.3, "1.2500005(3)e6"),
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
    assert np.all(np.diff(far) > 1) and abs(far[1] - special_deviate(37.0, 1000.0)) < 1e-9
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


@pytest.mark.parametrize("own", [1.0, 3.0])
def test_z_beside_an_uncertain_theory_has_the_tail_of_the_sum(own):
    """P(|own t + x/2| > d), integrated over Student's t; a curve has the z of each of its points."""
    apart = np.array([0.3, -2.0, 6.0])
    z = deviates(apart, own, 0.5, 2.0)
    for d, found in zip(np.abs(apart), z, strict=True):
        tail = integrate.quad(
            lambda t, d=d: stats.t.pdf(t, 2.0) * stats.norm.sf((d - own * t) / 0.5),
            -np.inf,
            np.inf,
            limit=500,
        )[0]
        assert abs(found) == pytest.approx(stats.norm.isf(tail), rel=1e-6)
    assert z.tolist() == [Estimate(d, own, 3, 2.0).z(0.0, 0.5) for d in apart]
    assert np.sign(z).tolist() == [1, -1, 1]


def test_where_nothing_fluctuates_there_is_no_z():
    """And no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for freedom in (0.0, 3.0, math.inf):
            assert np.isnan(deviates([1.0, 0.0, -1.0], 0.0, 0.0, freedom)).all()
        assert np.isnan(deviates(1.0, math.nan, 0.5, 3.0)) and np.isnan(deviates(1.0, 0.5, math.nan, 3.0))


def test_normal_deviates_of_any_degrees_of_freedom():
    """Infinitely many, few, less than one, none; and where probabilities end, by the incomplete beta function."""
    known = normal_deviate([2.0, -2.0, 2.0], [math.inf, 0.5, 0.0])
    assert known.dtype == np.float64
    assert known[:2].tolist() == [2.0, pytest.approx(-stats.norm.isf(stats.t.sf(2.0, 0.5)))]
    assert math.isnan(known[2])
    for nu, t in ((3, 1e105), (10, 1e35), (100, 2e4), (1000, 60.0)):
        with mpmath.workdps(30):
            tail = mpmath.betainc(nu / 2, 0.5, 0, nu / (nu + mpmath.mpf(t) ** 2), regularized=True) / 2
            log_tail = float(mpmath.log(tail))
        assert log_tail < math.log(1e-300)
        z = -special.ndtri_exp(log_tail)  # of a tail too large by 1 / t^2
        assert normal_deviate(t, nu) == pytest.approx(z, abs=1.0 / (t * t * z) + 1e-9)


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
    assert str(TheoryCheck("Z", "", Estimate(22.1, 0.2, 9, 8), math.nan, math.nan)) == "Z 22.1(2)"


@pytest.mark.parametrize(
    ("uncertainty", "text"),
    [
        (0.01, "Z 9.40(2), KLM 9.360(10), z = +1.79"),
        (0.05, "Z 9.40(2), KLM 9.36(5), z = +0.74; the measurement is better than the theory"),
    ],
)
def test_a_check_in_words(uncertainty, text):
    check = TheoryCheck("Z", "KLM", Estimate(9.4, 0.02, 9), 9.36, uncertainty)
    assert str(check) == text
    assert repr(check) == f"<TheoryCheck: {check}>"


def test_an_estimate_shows_how_well_its_error_is_known():
    assert repr(Estimate(9.404, 0.008, 20)) == "<Estimate 9.404(8)>"
    assert repr(Estimate(9.404, 0.008, 20, 19.0)) == "<Estimate 9.404(8), 19 degrees of freedom>"


@pytest.mark.parametrize("confidence", [-0.1, 0.0, 1.0, 1.5])
def test_an_interval_has_a_probability(confidence):
    with pytest.raises(ValueError, match="expected a probability between 0 and 1"):
        Estimate(1.0, 0.1).interval(confidence)


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


def test_a_single_replica_has_no_error_and_no_warning():
    one = np.array([[2.0, 3.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert math.isnan(estimate_from_replicas([1.0]).standard_error)
        for value, error in (replica_mean(one), jackknife(one, lambda total: total)):
            assert value.tolist() == [2.0, 3.0] and error.shape == (2,) and np.isnan(error).all()
        single = estimate_from_jackknife(one, lambda mean: mean[0] * mean[1])
    assert (single.value, single.n_effective, single.degrees_of_freedom) == (6.0, 1.0, 0.0)
    assert math.isnan(single.standard_error)


def test_two_replicas_are_enough():
    mean, error = replica_mean([[1.0, 5.0], [2.0, 8.0]])
    assert mean.tolist() == [1.5, 6.5]
    np.testing.assert_allclose(error, [0.5, 1.5])


def unequal(errors=(0.4, 0.4, 0.2)):
    """Replicas at 1, 2, 4 of lengths 1, 1, 4, whose mean is 19/6, with errors of their own."""
    values = zip([1.0, 2.0, 4.0], errors, (10.0, 20.0, 40.0), (5.0, 10.0, 20.0), strict=True)
    return [Estimate(*each) for each in values], [1.0, 1.0, 4.0]


def test_replicas_of_unequal_length_count_by_their_lengths():
    """The weighted mean and its error written out; sibling: equal weights are no weights."""
    replicas, lengths = unequal((3.0, 3.0, 1.5))
    combined = combine_replicas(replicas, lengths)
    assert combined.value == pytest.approx(19 / 6)
    spread = 1.0 * (1 - 19 / 6) ** 2 + 1.0 * (2 - 19 / 6) ** 2 + 4.0 * (4 - 19 / 6) ** 2
    assert combined.standard_error == pytest.approx(math.sqrt(spread / (2 * 6)))
    assert (combined.n_effective, combined.degrees_of_freedom) == (3, 2)
    even, plain = combine_replicas(replicas, [2.0] * 3), combine_replicas(replicas)
    assert (even.value, even.standard_error) == pytest.approx((plain.value, plain.standard_error))
    assert combine_replicas(replicas[:1], [2.0]).value == 1.0
    assert combine_replicas(replicas[:2], [1.0, 3.0]).value == 1.75

    pooled = pool_replicas(replicas, lengths)
    assert pooled.value == pytest.approx(19 / 6)
    assert pooled.standard_error == pytest.approx(math.sqrt(9 + 9 + 36) / 6)
    assert pooled.degrees_of_freedom == pytest.approx((9 + 9 + 36) ** 2 / (81 / 5 + 81 / 10 + 36**2 / 20))
    assert pooled.n_effective == 70


def test_a_pool_of_unequal_replicas_that_differ_has_the_error_of_their_spread():
    replicas, lengths = unequal((0.1, 0.1, 0.05))
    with pytest.warns(ReplicaWarning, match="^3 replicas spread 21 times as far"):
        combined = combine_replicas(replicas, lengths)
    assert pool_replicas(replicas, lengths) == combined
    assert combined.value == pytest.approx(19 / 6)


def test_exact_replicas_pool_to_an_exact_number():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for freedom in (0.0, 4.0):
            pooled = pool_replicas([Estimate(2.0, 0.0, 5, freedom)] * 3)
            assert (pooled.value, pooled.standard_error, pooled.degrees_of_freedom) == (2.0, 0.0, math.inf)


@pytest.mark.parametrize(("count", "freedom", "weighted"), [(12, 20, False), (12, 1, False), (2, 20, True)])
def test_replicas_warn_where_their_spread_has_a_probability_below_1e_4(count, freedom, weighted):
    """Just beyond it and, sibling, just short of it."""
    pattern = np.arange(count) - (count - 1) / 2
    pattern /= pattern.std(ddof=1)
    weights = [2.0] * count if weighted else None
    for probability, heard in ((0.9e-4, True), (1.1e-4, False)):
        ratio = math.sqrt(stats.f.isf(probability, count - 1, count * freedom))
        replicas = [Estimate(5.0 + ratio * x, 1.0, 9, freedom) for x in pattern]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            combined = combine_replicas(replicas, weights)
        assert bool(caught) is heard
        assert combined.standard_error == pytest.approx(ratio / math.sqrt(count))
        if heard:
            assert str(caught[0].message) == (
                f"{count} replicas spread {ratio:.2g} times as far as their own errors say: "
                "equilibrate longer, or use longer blocks; the error quoted is that of the spread"
            )


@pytest.mark.parametrize(("error", "freedom"), [(0.0, 5.0), (math.nan, 5.0), (0.1, 0.0)])
def test_replicas_whose_own_errors_are_unknown_are_not_checked(error, freedom):
    """One of them is enough."""
    replicas = [Estimate(1.0, 0.1, 5, 5.0), Estimate(9.0, error, 5, freedom), Estimate(5.0, 0.1, 5, 5.0)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert combine_replicas(replicas).value == 5.0


def test_eight_blocks_of_two_samples_written_out():
    """Far from zero; what is left over at the start is dropped."""
    series = [1e9, 5, 3, 6, 8, 2, 4, 7, 7, 3, 1, 9, 3, 5, 5, 2, 8]
    means = np.array([4, 7, 3, 7, 2, 6, 5, 5])
    estimate = estimate_from_blocks(series, 8)
    assert estimate.value == means.mean()
    assert estimate.standard_error == pytest.approx(means.std(ddof=1) / math.sqrt(8))
    assert estimate.degrees_of_freedom == 7
    samples = np.array(series[1:])
    assert estimate.n_effective == pytest.approx(samples.var(ddof=1) / estimate.standard_error**2)
    assert estimate.n_effective < 16
    for blocks, n, message in ((7, 16, "blocks = 7; expected at least 8"), (8, 15, r"\(n,\) with n >= 16")):
        with pytest.raises(ValueError, match=message):
            estimate_from_blocks(series[:n], blocks)


def test_a_constant_series_is_known_exactly():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate = estimate_from_blocks(np.full(70, 3.0), 8)
    assert (estimate.value, estimate.standard_error, estimate.n_effective) == (3.0, 0.0, 64.0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_blocks_warn_from_three_standard_errors_of_their_correlation(scale):
    """32 waves sampled by 32 blocks: neighbours correlate by 0.58 and, sibling, 0.48; 3 / sqrt(32) is 0.53."""
    for period, heard in ((6.8, True), (5.9, False)):
        means = scale * np.cos(2 * math.pi * np.arange(32) / period)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            estimate_from_blocks(np.repeat(means, 4))
        assert bool(caught) is heard
        if heard:
            assert str(caught[0].message) == (
                "neighbouring blocks of 4 samples are correlated: the standard error is too small; "
                "run longer or use fewer blocks"
            )


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


def test_jackknife_of_a_square_written_out():
    """Of 1, 2, 4: sums without one of them are 6, 5, 3; two replicas are enough."""
    deleted = np.array([36.0, 25.0, 9.0])
    value, error = jackknife(np.array([1, 2, 4]), lambda total: total**2)
    assert value == 49.0
    assert error == pytest.approx(math.sqrt(2 / 3 * ((deleted - deleted.mean()) ** 2).sum()))
    assert jackknife(np.array([1, 2]), lambda total: total**2)[1] == pytest.approx(1.5)

    of_means = deleted / 4
    estimate = estimate_from_jackknife(np.array([1.0, 2.0, 4.0]), lambda mean: mean**2)
    assert estimate.value == pytest.approx(3 * 49 / 9 - 2 * of_means.mean())
    assert estimate.standard_error == pytest.approx(
        math.sqrt(2 / 3 * ((of_means - of_means.mean()) ** 2).sum())
    )
    assert (estimate.n_effective, estimate.degrees_of_freedom) == (3, 2)
    two = estimate_from_jackknife(np.array([1.0, 2.0]), lambda mean: mean**2)
    assert (two.value, two.standard_error) == (2.0, 1.5)  # unbiased: 1 times 2


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


def test_one_point_is_students_t():
    """T^2 = t^2 with R - 1 degrees of freedom, and with an uncertain theory the square of the deviation."""
    rng = np.random.default_rng(8)
    for replicas in (3, 7):
        samples = rng.normal(5.0, 2.0, (replicas, 1))
        t = stats.ttest_1samp(samples[:, 0], 4.0)
        test = compare_with_theory(samples, [4.0])
        assert test.statistic == pytest.approx(t.statistic**2)
        assert test.p_value == pytest.approx(t.pvalue)
        assert (test.degrees_of_freedom, test.n_replicas) == (1, replicas)
        mean = estimate_from_replicas(samples[:, 0])
        soft = compare_with_theory(samples, [4.0], [0.5])
        assert soft.statistic == pytest.approx(mean.deviation(4.0, 0.5) ** 2)


def test_theory_uncertainty_weakens_the_test():
    samples = _correlated(np.random.default_rng(6), 30)
    off = np.full(8, 3.0)
    sharp = compare_with_theory(samples, off)
    soft = compare_with_theory(samples, off, np.full(8, 10.0))
    assert sharp.statistic > 5 * soft.statistic
    assert soft.p_value > 0.5


def test_hotelling_refuses_what_it_cannot_do():
    samples = _correlated(np.random.default_rng(7), 9)
    with pytest.raises(ValueError, match="9 replicas for 8 points; the covariance needs more than 9"):
        compare_with_theory(samples, np.zeros(8))
    with pytest.raises(ValueError, match="expected"):
        compare_with_theory(samples, np.zeros(3))
    with pytest.raises(ValueError, match="^a point has no fluctuation"):
        compare_with_theory(np.ones((20, 2)), np.ones(2))


def test_an_estimate_is_a_number():
    """In sums, in formats, and in words; sibling: its error is not lost where no form is given."""
    z = Estimate(9.404114, 0.0083, 20)
    assert float(z) == 9.404114 and math.sqrt(z) == math.sqrt(9.404114)
    assert f"{z:.3f}" == "9.404" and f"{z:+.1e}" == "+9.4e+00" and f"{z:8.2f}" == "    9.40"
    assert f"{z}" == str(z) == "9.404(8)" and f"{z:>10s}" == "  9.404(8)"
    with pytest.raises(ValueError, match="format"):
        f"{z:q}"
