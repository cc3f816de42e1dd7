"""Unequal temperatures become equal: rates beside theory, calibrated errors, and broken dynamics seen."""

import math
import pickle

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import gas as random_gas
from scipy import stats

import hardspheres as hs
from analysis import theory
from analysis.estimator import NoDataError
from analysis.temperatures import AnisotropyDecay, TemperatureEquilibration

S = [0.0, 0.5, 1.0, 2.0]


def stretched(gas, rng, n, dim, excess):
    v = gas.maxwell(rng, n, dim)
    v[:, 0] *= math.sqrt(1 + excess)
    v -= v.mean(axis=0)
    return v * math.sqrt(dim * n / (v**2).sum())


@pytest.mark.parametrize("dim", [2, 3])
def test_anisotropy_decays_as_the_boltzmann_equation_says(dim, boltzmann, gas):
    decay = AnisotropyDecay()
    rng = np.random.default_rng(dim)
    for replica in range(16):
        for frame in boltzmann(stretched(gas, rng, 20_000, dim, 0.5), S, seed=replica):
            decay.add(frame)
    assert decay.n_replicas == 16
    z = (decay.anisotropy - decay.theory.value) / np.hypot(decay.anisotropy_error, decay.theory.uncertainty)
    assert np.abs(z[1:]).max() < 4 and decay.anisotropy[0] == pytest.approx(decay.theory.value[0])
    check = decay.check((0, 1))
    assert abs(check.z) < 4
    assert check.measured.standard_error / check.measured.value < 0.04
    # sibling: the rate of the fourth cumulant is not that of an anisotropy
    assert abs(check.measured.deviation(theory.sonine_rate(dim))) > 10
    assert check.measured.degrees_of_freedom == 15
    axes = Figure().subplots()
    assert decay.plot(axes) is axes


def test_a_wrong_collision_rule_is_seen(boltzmann, gas):
    """A tenth of the collisions only exchange velocities, which changes nothing: the rate is 10 % too low."""
    rng, decay = np.random.default_rng(9), AnisotropyDecay()
    for replica in range(24):
        for frame in boltzmann(stretched(gas, rng, 20_000, 3, 0.5), [0.0, 0.9], seed=replica):
            object.__setattr__(frame, "collisions_per_particle", frame.collisions_per_particle / 0.9)
            object.__setattr__(frame, "time", frame.time / 0.9)
            decay.add(frame)
    assert decay.check((0, 1)).z < -3


def test_errors_of_the_rate_follow_students_t(boltzmann, gas):
    """Eight replicas each: 60 fits, against the mean of all, whose own error is small."""
    rng = np.random.default_rng(5)
    fits, ends = [], []
    for fit in range(60):
        decay = AnisotropyDecay()
        for replica in range(8):
            for frame in boltzmann(stretched(gas, rng, 1000, 3, 1.0), [0.0, 1.0], seed=100 * fit + replica):
                decay.add(frame)
        fits.append(decay.fit_rate((0, 1)))
        ends.append(decay.anisotropy)
    first, last = np.mean(ends, axis=0)
    truth = math.log(first / last)
    p = [stats.t.cdf((e.value - truth) / e.standard_error, e.degrees_of_freedom) for e in fits]
    assert stats.kstest(p, "uniform").pvalue > 1e-3


@pytest.fixture(scope="module")
def equilibration():
    decay = TemperatureEquilibration()
    for seed in range(10):
        scene = random_gas("3d_mixture", 1000, 0.004, seed=seed, velocities="two-temperatures")
        for frame in hs.Simulation(scene).frames(every=12.0, count=6):
            decay.add(frame)
    return decay


def test_two_species_become_equally_warm(equilibration):
    decay, expected = equilibration, equilibration.theory
    scale = np.hypot(decay.temperatures_error, expected.uncertainty)
    z = (decay.temperatures - expected.value)[1:] / scale[1:]
    assert np.abs(z).max() < 4
    check = decay.check((0.0, 36.0))
    assert abs(check.z) < 4
    assert check.measured.standard_error / check.measured.value < 0.1
    assert decay.temperatures[0, 0] / decay.temperatures[0, 1] == pytest.approx(3, rel=0.01)
    # sibling: theory for masses that are all alike
    mixture = decay.gas
    rho = mixture.sizes / mixture.volume
    wrong = theory.temperature_equilibration(
        decay.time, decay.temperatures[0], rho, mixture.diameters, [1.0, 1.0], 3
    )
    ratio = np.log(np.diff(wrong.value[[0, 3]], axis=1)[:, 0] / np.diff(wrong.value[[0, 3]], axis=1)[0, 0])
    assert abs(check.measured.deviation(-ratio[1] / decay.time[3])) > 4
    axes = Figure().subplots()
    assert decay.plot(axes) is axes


def test_temperatures_of_species_have_no_bias_at_equilibrium(gas):
    """Four particles with masses 1 and 9 and zero momentum: both species have the temperature of the whole."""
    rng, decay = np.random.default_rng(6), TemperatureEquilibration()
    masses = np.array([1.0, 1.0, 9.0, 9.0])
    frame = gas.frame(gas.maxwell(rng, 4, 3, masses), masses)
    for _ in range(4000):
        v = gas.maxwell(rng, 4, 3, masses)
        v -= (masses @ v) / masses.sum()
        object.__setattr__(frame, "velocities", v * math.sqrt(9 / (masses @ (v**2).sum(axis=1))))
        decay.add(frame)  # time does not advance: each is a replica
    assert decay.n_replicas == 4000
    assert np.abs((decay.temperatures[0] - 1) / decay.temperatures_error[0]).max() < 4
    assert decay.temperatures_error[0].max() < 0.02


def test_merging_and_misuse(equilibration, gas):
    copy = pickle.loads(pickle.dumps(equilibration))
    both = TemperatureEquilibration().merge(copy).merge(equilibration)
    assert both.n_replicas == 20
    np.testing.assert_allclose(both.temperatures, equilibration.temperatures)
    with pytest.raises(ValueError, match="window"):
        equilibration.fit_rate((36.0, 12.0))
    with pytest.raises(NoDataError, match=r"no replicas yet; call add\(frame\) first"):
        _ = AnisotropyDecay().anisotropy
    rng = np.random.default_rng(7)
    frame = gas.frame(gas.maxwell(rng, 50, 3))
    with pytest.raises(ValueError, match="one species"):
        TemperatureEquilibration().add(frame)
    with pytest.raises(ValueError, match="axis = 3"):
        AnisotropyDecay(3).add(frame)
    with pytest.raises(ValueError, match="expected 50 in 3"):
        AnisotropyDecay().add(frame).add(gas.frame(gas.maxwell(rng, 60, 3), s=1.0))
    calm = AnisotropyDecay()
    for _ in range(10):
        for s in (0.0, 1.0):
            calm.add(gas.frame(gas.maxwell(rng, 500, 3), s=s))
    with pytest.raises(ValueError, match="lost in the noise"):
        calm.fit_rate((0, 1))
