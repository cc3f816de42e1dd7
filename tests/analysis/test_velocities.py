"""Estimators of the velocity distribution: right for a Maxwellian gas, and sure to see one that is not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis import theory
from analysis.calibration import calibrate
from analysis.estimator import NoDataError
from analysis.statistics import estimate_from_replicas
from analysis.velocities import (
    ComponentDistribution,
    EnergyDistribution,
    FourthCumulant,
    HFunction,
    KolmogorovSmirnov,
    SpeedDistribution,
    h_excess,
    ks_p_value,
    reduced_velocities,
)
from hardspheres import HardSpheresError

ESTIMATORS = [
    SpeedDistribution,
    ComponentDistribution,
    EnergyDistribution,
    FourthCumulant,
    KolmogorovSmirnov,
    HFunction,
]


def not_maxwell(rng, n, dim):
    """Velocities even within a ball: 15 % and more off in every cumulant."""
    v = rng.standard_normal((n, dim))
    return v / np.linalg.norm(v, axis=1, keepdims=True) * rng.random((n, 1)) ** (1 / dim)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("boundary", ["periodic", "wall"])
def test_reduced_velocities_have_the_energy_of_their_degrees_of_freedom(dim, boundary, gas):
    rng = np.random.default_rng(1)
    masses = np.repeat([1.0, 7.0], 200)
    frame = gas.frame(gas.maxwell(rng, 400, dim, masses, 2.5) + 3.0, masses, boundary=boundary)
    c, kT = reduced_velocities(frame)
    assert (c**2).sum() == pytest.approx(frame.scene.degrees_of_freedom, rel=1e-12)
    if boundary == "periodic":  # the common motion does not count
        assert kT == pytest.approx(2.5, rel=0.2)
        np.testing.assert_allclose((c * np.sqrt(masses)[:, None]).sum(axis=0), 0, atol=1e-10)
    else:  # against walls it does
        assert kT > 5


def test_a_gas_at_rest_is_refused(gas):
    with pytest.raises(ValueError, match="nothing moves"):
        FourthCumulant().add(gas.frame(np.ones((10, 3))))


@pytest.mark.parametrize("dim", [2, 3])
def test_maxwellian_gas_is_accepted_and_another_rejected(dim, gas):
    """False alarms: each p below 1e-3 once in 1000 seeds; this seed is fixed."""
    rng = np.random.default_rng(20 + dim)
    for make, accepted in ((gas.maxwell, True), (not_maxwell, False)):
        frame = gas.frame(make(rng, 20000, dim))
        tests = [SpeedDistribution().add(frame).chi_square.p_value, KolmogorovSmirnov().add(frame).p_value]
        tests += [ComponentDistribution(axis).add(frame).chi_square.p_value for axis in range(dim)]
        a2 = FourthCumulant().add(frame)
        z = a2.a2.deviation(a2.expected)
        h = HFunction().add(frame).excess.value
        if accepted:
            assert min(tests) > 1e-3
            assert abs(z) < 3.5
            assert abs(h) < 4 * math.sqrt(60 / 2) / 20000
        else:
            assert max(tests) < 1e-3
            assert abs(z) > 20
            assert h > 100 * math.sqrt(60 / 2) / 20000


@pytest.mark.parametrize("boundary", ["periodic", "wall"])
def test_small_gases_follow_the_exact_laws_and_not_the_infinite_one(boundary, gas):
    """Six particles with masses 1 and 4: the exact laws hold, and Maxwell and Boltzmann's do not."""
    rng = np.random.default_rng(35)
    masses = np.repeat([1.0, 4.0], 3)
    estimators = [SpeedDistribution(30, 4.0), ComponentDistribution(1, 30), EnergyDistribution(30, 9.0)]
    frame = gas.frame(gas.maxwell(rng, 6, 3, masses), masses, boundary=boundary)
    for _ in range(4000):
        moved = replace(frame, velocities=gas.maxwell(rng, 6, 3, masses))
        for estimator in estimators:
            estimator.add(moved)
    for estimator in estimators:
        size = 12000 * np.diff(estimator.edges)
        assert estimator.chi_square.p_value > 1e-3
        expected = estimator.finite_theory * size
        infinite = estimator.theory * size
        seen = infinite > 20
        wrong = ((estimator.counts - infinite) ** 2 / np.where(seen, infinite, np.inf)).sum()
        right = ((estimator.counts - expected) ** 2 / np.where(seen, np.maximum(expected, 1), np.inf)).sum()
        assert wrong > right + 40
        np.testing.assert_allclose(estimator.density * size, estimator.counts)
    # a heavier particle has less of the energy where the momentum is zero
    means = (estimators[2].finite_theory * (estimators[2].edges[1:] + estimators[2].edges[:-1])).sum(axis=1)
    assert (means[0] > 1.02 * means[1]) == (boundary == "periodic")


def test_one_part_in_fifty_off_is_seen(gas):
    """A gas with 2 % of its particles at rest passes by eye and must not pass the tests."""
    rng = np.random.default_rng(30)
    v = gas.maxwell(rng, 40000, 3)
    v[:800] = 0
    frame = gas.frame(v)
    assert SpeedDistribution().add(frame).chi_square.p_value < 1e-6
    assert KolmogorovSmirnov().add(frame).p_value < 1e-3


def test_species_have_their_own_curves(gas):
    rng = np.random.default_rng(40)
    masses = np.repeat([1.0, 9.0], [3000, 5000])
    frame = gas.frame(gas.maxwell(rng, 8000, 3, masses, 2.0), masses)
    speeds = SpeedDistribution().add(frame).add(gas.frame(gas.maxwell(rng, 8000, 3, masses, 2.0), masses))
    assert speeds.counts.shape == (2, 60)
    assert speeds.thermal_speeds[0] == pytest.approx(3 * speeds.thermal_speeds[1])
    assert speeds.chi_square.p_value > 1e-3
    pulls = (speeds.density - speeds.theory) / np.where(
        speeds.density_error > 0, speeds.density_error, np.inf
    )
    assert np.abs(pulls).max() < 4.5
    assert speeds.labels[1] == "m = 9, \u03c3 = 0.2"
    assert FourthCumulant().add(frame).by_species.shape == (2,)
    # two species at two temperatures are two Maxwellians, but not at the temperature of the whole
    hot = np.concatenate([gas.maxwell(rng, 3000, 3, 1.0, 2.0), gas.maxwell(rng, 5000, 3, 9.0, 1.0)])
    frame = gas.frame(hot, masses)
    assert SpeedDistribution().add(frame).chi_square.p_value < 1e-10
    assert np.abs(FourthCumulant().add(frame).by_species).max() < 0.1


def test_cumulant_bias_and_noise_are_as_stated(gas):
    """Mean of 2000 gases of 30 particles: -2/(D+2) = -0.0225, not 0."""
    rng = np.random.default_rng(50)
    many = FourthCumulant()
    for _ in range(2000):
        many.add(gas.frame(gas.maxwell(rng, 30, 3)))
    assert abs(many.a2.deviation(many.expected)) < 4
    assert abs(many.a2.deviation(0.0)) > 4
    assert abs(many.a3.deviation(float(theory.equilibrium_a3(87)))) < 4
    one = FourthCumulant().add(gas.frame(gas.maxwell(rng, 30, 3)))
    each = many.values.std() * math.sqrt(2000 / len(many.values))  # the values are means of several frames
    assert one.a2.standard_error == pytest.approx(each, rel=0.15)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_a2_over_correlated_frames_follow_students_t():
    """Frames half a collision per particle apart; the truth at fixed energy is -2/(D + 2)."""
    runs = []
    for seed in range(200):
        sim = hs.Simulation(random_gas("3d", 32, 0.15, seed=seed))
        sim.run(collisions=320)
        run = FourthCumulant()
        for frame in sim.frames(every=0.5 * sim.time / 20, count=200):
            run.add(frame)
        runs.append(run)
    truth = runs[0].expected
    assert calibrate([run.a2 for run in runs], truth).passed
    # siblings: frames taken as independent, and the truth of the infinite gas
    naive = [estimate_from_replicas(run.values) for run in runs]
    assert not calibrate(naive, truth).passed
    assert not calibrate([run.a2 for run in runs], 0.0).passed


def test_ks_p_values_are_even_though_the_energy_is_fixed(gas):
    rng = np.random.default_rng(60)
    p = []
    for _ in range(300):
        p.append(KolmogorovSmirnov().add(gas.frame(gas.maxwell(rng, 1500, 3))).p_value)
    counts = np.histogram(p, bins=[0, 0.1, 0.5, 1])[0]
    expected = np.array([30, 120, 150])
    assert ((counts - expected) ** 2 / expected).sum() < 13.8  # chi-square, 2 degrees of freedom: 1 in 1000
    assert ks_p_value(0.9, 1000, 3) == pytest.approx(1 / 4001)


def test_ks_floor(gas):
    for dim in (2, 3):
        rng = np.random.default_rng(61)
        many = KolmogorovSmirnov()
        for _ in range(300):
            many.add(gas.frame(gas.maxwell(rng, 2000, dim)))
        assert abs(many.distance.deviation(theory.ks_floor(2000, dim), 0.01 * theory.ks_floor(2000, dim))) < 4
        assert many.distance.value < 0.95 * 0.8687 / math.sqrt(
            2000
        )  # Kolmogorov's mean, for independent draws


def test_h_excess_is_unbiased_and_positive_off_equilibrium():
    rng = np.random.default_rng(70)
    q = np.diff(theory.speed_cdf(np.append(np.linspace(0, 4, 41)[:-1], np.inf), 3))
    counts = rng.multinomial(5000, q, size=3000)
    h = h_excess(counts, q)
    assert abs(h.mean()) < 4 * h.std() / math.sqrt(3000) + 2e-5
    plug_in = h + (np.count_nonzero(counts, axis=1) - 1) / 10000
    assert plug_in.mean() > 30 * h.std() / math.sqrt(3000)  # what the correction is there for
    p = rng.dirichlet(np.full(40, 50.0))
    exact = (p * np.log(p / q)).sum()
    measured = h_excess(rng.multinomial(10**6, p, size=200), q)
    assert abs(measured.mean() - exact) < 4 * measured.std() / math.sqrt(200) + 1e-6


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_one_shape(kind, gas):
    frame = gas.frame(gas.maxwell(np.random.default_rng(80), 500, 3))
    estimator = kind()
    with pytest.raises(NoDataError, match=r"call add\(frame\) first"):
        estimator.plot()
    assert issubclass(NoDataError, HardSpheresError)
    assert estimator.add(frame) is estimator
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert estimator.plot(axes) is axes
    assert axes.get_xlabel() and axes.get_ylabel()


def test_wrong_parameters_are_named(gas):
    with pytest.raises(ValueError, match="bins = 1"):
        SpeedDistribution(bins=1)
    frame = gas.frame(gas.maxwell(np.random.default_rng(90), 100, 2))
    with pytest.raises(ValueError, match="axis = 2 in a gas of 2 dimensions"):
        ComponentDistribution(axis=2).add(frame)
    speeds = SpeedDistribution().add(frame)
    with pytest.raises(ValueError, match="frame has 2 species; expected 1"):
        speeds.add(gas.frame(gas.maxwell(np.random.default_rng(91), 100, 2), np.repeat([1.0, 2.0], 50)))
