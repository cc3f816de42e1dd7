"""Tests that must fail: gases that violate what an estimator assumes are seen, by its check or by its warning.

Not thermalised, drifting towards equilibrium while it is measured, or with other masses than the scene says.
"""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis import theory
from analysis.distributions import ComponentDistribution, EnergyDistribution, SpeedDistribution
from analysis.pressure import Pressure
from analysis.relaxation import RelaxationCurve
from analysis.series import SeriesWarning
from analysis.structure import PairDistribution
from analysis.temperatures import TemperatureEquilibration
from analysis.transport import Diffusion
from analysis.velocities import FourthCumulant, HFunction, KolmogorovSmirnov
from analysis.virial_identity import virial_identity

DISTRIBUTIONS = [SpeedDistribution, ComponentDistribution, EnergyDistribution]
NUMBERS = [FourthCumulant, KolmogorovSmirnov, HFunction]


def between(gas, rng, n, share):
    """Velocities of which a share is Maxwellian and the rest has equal speeds: on its way to equilibrium."""
    half = n // 2
    maxwellian = int(share * half)
    v = np.concatenate([gas.equal_speeds(rng, n - 2 * maxwellian, 3), gas.maxwell(rng, 2 * maxwellian, 3)])
    return v - v.mean(axis=0)


def result(estimator):
    """The number of one of NUMBERS beside what equilibrium gives."""
    if isinstance(estimator, FourthCumulant):
        return estimator.a2, estimator.expected
    if isinstance(estimator, KolmogorovSmirnov):
        return estimator.distance, theory.ks_floor(1000, 3)
    return estimator.excess, 0.0


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
def test_distributions_see_a_gas_that_is_not_thermalised_and_wrong_masses(kind, gas):
    rng = np.random.default_rng(1)
    light, heavy = np.ones(4000), np.repeat([1.0, 2.0], 2000)
    right, raw, wrong = kind(), kind(), kind()
    for _ in range(5):
        v = gas.maxwell(rng, 4000, 3, heavy)
        right.add(gas.frame(v, heavy))
        wrong.add(gas.frame(v, light))
        raw.add(gas.frame(between(gas, rng, 4000, 0.4)))
    assert right.chi_square.p_value > 1e-3
    assert wrong.chi_square.p_value < 1e-3
    assert raw.chi_square.p_value < 1e-3


@pytest.mark.parametrize("kind", NUMBERS)
def test_cumulant_distance_and_h_see_wrong_masses_and_a_start_that_drifts(kind, gas):
    rng = np.random.default_rng(2)
    light, heavy = np.ones(1000), np.repeat([1.0, 3.0], 500)
    right, raw, wrong, drifting = (HFunction(20, 4.0) if kind is HFunction else kind() for _ in range(4))
    for k in range(64):
        v = gas.maxwell(rng, 1000, 3, heavy)
        right.add(gas.frame(v, heavy))
        wrong.add(gas.frame(v, light))
        raw.add(gas.frame(between(gas, rng, 1000, 0.6)))
        drifting.add(gas.frame(between(gas, rng, 1000, k / 64)))
    value, expected = result(right)
    assert abs(value.deviation(expected, 0.01 * abs(expected) or 1e-3)) < 4
    for broken in (wrong, raw):
        value, expected = result(broken)
        assert value.p_value(expected, 0.01 * abs(expected) or 1e-3) < 1e-6
    with pytest.warns(SeriesWarning):  # of a drift, or of a correlation as long as the series
        result(drifting)


def test_relaxation_curve_sees_a_start_that_is_not_the_one_of_the_theory(gas, boltzmann):
    """From equal speeds of which a twentieth are Maxwellian already: a2 is off by 10 standard errors at once."""
    rng, curve = np.random.default_rng(3), RelaxationCurve()
    for replica in range(12):
        for frame in boltzmann(between(gas, rng, 4000, 0.05), [0.0, 0.5], seed=replica):
            curve.add(frame)
    assert not curve.starts_from_equal_speeds
    comparison = curve.compare()
    assert np.abs(comparison.a2_z[1:]).min() > 5


def test_temperatures_see_wrong_masses():
    """A mixture of masses 7:1 that says 3.5:1: its two temperatures do not start where the scene's would."""
    right, wrong = TemperatureEquilibration(), TemperatureEquilibration()
    for seed in range(6):
        scene = random_gas("3d_mixture", 200, 0.004, seed=seed)
        for frame in hs.Simulation(scene).frames(times=[0.0, 5.0]):
            right.add(frame)
            other = scene.replace(masses=np.where(scene.masses > 1.0, 3.5, 1.0))
            wrong.add(replace(frame, scene=other))
    gap = [np.diff(e.temperatures, axis=1)[:, 0] / np.hypot(*e.temperatures_error.T) for e in (right, wrong)]
    assert np.abs(gap[0]).max() < 5 and np.abs(gap[1]).min() > 8


def test_diffusion_sees_a_crystal_and_wrong_masses():
    """A crystal does not diffuse as the fluid at freezing does; spheres four times as heavy do so half as fast."""

    def measure(scene):
        sim = hs.Simulation(scene)
        sim.run(collisions=10 * scene.n)
        step = 0.5 * scene.n * sim.time / sim.collisions  # one collision per particle
        diffusion = Diffusion()
        for _ in range(400):
            sim.run(time=step)
            diffusion.add(sim)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)
            return diffusion.diffusion((8 * step, 16 * step)), diffusion

    crystal, _ = measure(hs.lattice_gas(n=108, packing_fraction=0.58, seed=1))
    fluid, diffusion = measure(random_gas("3d", 108, 0.3))
    assert crystal.value < 0.1 * float(theory.enskog_diffusion(0.49, 3).value)
    heavy = float(theory.enskog_diffusion(0.3, 3, mass=4.0).value)
    correction = float(diffusion.periodic_correction.value)
    enskog = theory.enskog_diffusion(0.3, 3)
    assert abs(fluid.deviation(float(enskog.value) - correction, float(enskog.uncertainty))) < 3
    assert fluid.deviation(heavy, float(enskog.uncertainty) / 2) > 3


def test_pair_distribution_sees_a_melting_crystal():
    """Contact values fall while the lattice melts: a drift, and a Z that is not the virial's of the same stretch."""
    scene = hs.lattice_gas(n=256, packing_fraction=0.3, seed=1)
    sim = hs.Simulation(scene)
    pairs, pressure = PairDistribution(depth=0.5, bins=40, window=0.5, degree=3), Pressure(scene)
    step = 0.02 / float(theory.collision_rate(0.3, 3))
    pressure.add(sim.frame())
    for _ in range(64):
        sim.run(time=step)
        pairs.add(sim.frame())
        pressure.add(sim.frame())
    with pytest.warns(SeriesWarning):
        measured = pairs.compressibility_factor
    fluid = float(theory.compressibility_factor(0.3, 3).value)
    assert abs(measured.value - fluid) > 0.1 * fluid
    with pytest.warns(SeriesWarning):
        assert abs(pressure.virial.value - fluid) > 0.1 * fluid


def test_a_gas_that_moves_as_a_whole_has_the_same_pressure():
    """A common velocity along periodic axes is no heat: same Z, and no drag on what is measured."""
    still = random_gas("3d", 64, 0.1)
    measured = []
    for velocity in (0.0, 3.0):
        sim = hs.Simulation(still.replace(velocities=still.velocities + [velocity, 0.0, 0.0]))
        pressure, cumulants = Pressure(sim.scene), FourthCumulant()
        pressure.add(sim.frame())
        for _ in range(64):
            sim.run(collisions=64)
            pressure.add(sim.frame())
            cumulants.add(sim.frame())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)
            measured.append((pressure.virial, pressure.tensor.component(0, 0, "kinetic"), cumulants.a2))
    for one, other in zip(*measured, strict=True):
        assert abs(one.value - other.value) < 5 * math.hypot(one.standard_error, other.standard_error)
    # sibling: with the common motion left in, kT would be larger by (3^2) / 3
    assert measured[1][1].value < 1.3 * measured[0][1].value


def test_the_identity_between_walls_sees_wrong_masses():
    scene = random_gas("3d_walls", 50, 0.1)
    sim = hs.Simulation(scene)
    start = sim.frame()
    sim.run(collisions=500)
    assert virial_identity(start, sim.frame()).residual < 2e-12
    heavy = scene.replace(masses=np.where(np.arange(50) % 2, 1.0, 1.01))
    wrong = virial_identity(replace(start, scene=heavy), replace(sim.frame(), scene=heavy))
    assert wrong.residual > 1e-6
