"""Correlated samples: velocity correlation times, and the warning where a run is shorter than they are."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scenes import gas as random_gas
from scipy import stats

import hardspheres as hs
from analysis import theory
from analysis.correlation_times import FrameWeights, FrozenWarning, velocity_correlation_times
from analysis.distributions import SpeedDistribution
from analysis.free_path import FreePath
from analysis.pressure import Pressure
from analysis.series import SeriesWarning
from analysis.statistics import estimate_from_replicas, pool_replicas
from analysis.velocities import FourthCumulant

HEAVY = np.where(np.arange(200) % 20 == 0, 1e4, 1.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_memory_of_velocities(dim):
    eta = 1e-4
    one = velocity_correlation_times(random_gas(f"{dim}d", 50, eta))
    rate = theory.velocity_correlation_rate(eta, dim) / theory.collision_rate(eta, dim)
    assert one == pytest.approx([1 / rate])
    # rare heavy particles among light ones: until temperatures are equal, half the time in which friction
    # stops one, M over 8/3 rho sigma^2 sqrt(2 pi m kT) in 3D, 2 rho sigma sqrt(2 pi m kT) in 2D
    scene = random_gas(f"{dim}d", 200, eta, masses=HEAVY)
    heavy, light = velocity_correlation_times(scene)
    rho = 190 / scene.volume
    friction = (8 / 3 if dim == 3 else 2.0) * rho * math.sqrt(2 * math.pi) / 1e4
    nu = theory.mixture_collision_rates([10 / scene.volume, rho], [1.0, 1.0], [1e4, 1.0], dim)
    per_time = float(np.array([0.05, 0.95]) @ nu.sum(axis=1))  # collisions per particle and time
    dilute = float(theory.contact_value(eta, dim))
    assert heavy == pytest.approx(per_time / (2 * friction * dilute * (1 + 10 / 190)), rel=0.01)
    assert light == pytest.approx(one[0], rel=0.2)
    assert heavy > 1000 * light


def walk(gas, rng, masses, steps, apart, memory):
    """Frames of Maxwellian velocities, each of which is drawn anew after `memory` collisions per particle on average."""
    frame = gas.frame(gas.maxwell(rng, len(masses), 3, masses), masses)
    v = frame.velocities
    for k in range(steps):
        yield replace(frame, velocities=v, collisions_per_particle=k * apart)
        new = rng.random((len(masses), 1)) > math.exp(-apart / memory)
        v = np.where(new, gas.maxwell(rng, len(masses), 3, masses), v)


def test_frames_close_together_are_no_independent_samples(gas):
    """Chi-square of speeds with frames a tenth of a memory apart: p is even; of all frames alike (sibling) it is not."""
    rng, masses = np.random.default_rng(1), np.ones(400)
    p, naive, pulls = [], [], []
    for _ in range(60):
        speeds = SpeedDistribution(20, 4.0)
        for frame in walk(gas, rng, masses, 100, 0.15, 1.5):
            speeds.add(frame)
        p.append(speeds.chi_square.p_value)
        pulls.append(((speeds.density - speeds.finite_theory) / speeds.density_error)[0, 3:12])
        speeds._tested, speeds._tested_sizes = speeds._counts, speeds._sizes
        naive.append(speeds.chi_square.p_value)
    assert stats.kstest(p, "uniform").pvalue > 1e-3
    assert np.median(naive) < 1e-6
    assert 0.8 < np.std(pulls) < 1.2
    assert (
        np.std(pulls) * math.sqrt(speeds._frames / speeds._weights.effective[0]) > 1.8
    )  # sibling: all independent


def test_frames_of_other_gases_are_independent(gas):
    rng, weights = np.random.default_rng(2), FrameWeights()
    frame = gas.frame(gas.maxwell(rng, 50, 3))
    assert all(weights.add(frame) for _ in range(5))
    assert weights.effective == pytest.approx([5.0])
    later = replace(frame, collisions_per_particle=1.0)
    assert not weights.add(later)
    assert weights.effective == pytest.approx([5.0 + math.tanh(1 / 3)])
    assert weights.add(replace(frame, collisions_per_particle=6.1))


def test_few_frames_close_together_have_larger_errors(gas):
    """Eight frames half a memory apart: a2 covers; as if independent (sibling) it does not."""
    rng, masses = np.random.default_rng(3), np.ones(100)
    z, naive = [], []
    for _ in range(200):
        a2 = FourthCumulant()
        for frame in walk(gas, rng, masses, 8, 0.375, 1.5):
            a2.add(frame)
        z.append(a2.a2.z(a2.expected))
        naive.append(estimate_from_replicas(a2.values).z(a2.expected))
    assert np.std(z) < 1.2 and 1.6 < np.std(naive)


def frozen(seed, blocks=60):
    """Free paths and pressure of 10 spheres of mass 1e4 among 190 of mass 1, over 60 collisions per particle."""
    radii = np.where(HEAVY > 1.0, 0.5, 0.5 + 1e-9)  # for the engine the kind of gas that other tests compile
    scene = random_gas("3d_mixture", 200, 0.05, seed=seed, radii=radii, masses=HEAVY)
    sim = hs.Simulation(scene, free_paths=True, search="lists")
    sim.run(collisions=2000)
    paths, pressure = FreePath(sim.scene), Pressure(sim.scene)
    for frame in sim.frames(collisions_per_particle=20 + np.arange(blocks + 1)):
        paths.add(frame)
        pressure.add(frame)
    return paths, pressure


def test_a_frozen_species_is_told_of():
    """Heavy velocities are those of the start: their free path was quoted to 3 % where starts differ by 13 %."""
    runs = []
    for seed in range(6):
        paths, pressure = frozen(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)
            with pytest.warns(FrozenWarning, match="correlation time of species 1 is .* the run has 60"):
                runs.append(paths.mean_free_path[0])
            with pytest.warns(FrozenWarning, match="or take the spread of many starts"):
                _ = pressure.rate
            with pytest.warns(FrozenWarning):
                never = paths.collision_rates[0][0]
        assert never.standard_error > 0.0  # heavy ones hardly meet: not 0(0)
    together = pool_replicas(runs)
    spread = estimate_from_replicas([run.value for run in runs])
    assert together.standard_error == pytest.approx(spread.standard_error)
    assert together.degrees_of_freedom == 5
    # siblings: their own errors together, and a gas of one mass, of which nothing is said
    own = math.sqrt(sum(run.standard_error**2 for run in runs)) / 6
    assert own < 0.5 * spread.standard_error
