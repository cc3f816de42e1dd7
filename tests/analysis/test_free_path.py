"""Free paths: moments and distributions beside kinetic theory, rates between species, broken gases seen."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import WITH_FLIGHTS
from scenes import gas as random_gas

import hardspheres as hs
from analysis import theory
from analysis.calibration import calibrate
from analysis.estimator import NoDataError
from analysis.free_path import FirstFlightsWarning, FreePath
from analysis.pressure import Pressure
from analysis.series import DriftWarning, SeriesWarning
from analysis.statistics import combine_replicas, estimate_from_replicas

assert ("3d_mixture", "lists") in WITH_FLIGHTS  # which the mixture here uses, compiled already
# 64 blocks are on the short side for some of the numbers.
pytestmark = pytest.mark.filterwarnings("ignore::analysis.series.ShortSeriesWarning")

# Physics.md of the dilute gas: <l^2>/<l>^2, <l^3>/<l>^3, <t^2>/<t>^2, and survival of paths in units of their mean.
MOMENTS = {3: (2.101218, 6.84075, 2.076131), 2: (2.159816, 7.29799, 2.108441)}
SURVIVAL = {
    3: {0.25: 0.765959, 0.5: 0.591780, 1.0: 0.358948, 2.0: 0.137345, 3.0: 0.054276, 5.0: 0.008982},
    2: {0.25: 0.755273, 0.5: 0.581940, 1.0: 0.354922, 2.0: 0.139437, 3.0: 0.056957, 5.0: 0.010116},
}


def measure(scene, blocks=64, per_block=5.0, equilibration=20.0, search="auto"):
    """FreePath and Pressure from the same blocks, after `equilibration` collisions per particle."""
    sim = hs.Simulation(scene, free_paths=True, search=search)
    sim.run(collisions=int(equilibration * scene.n / 2))
    paths, pressure = FreePath(sim.to_scene()), Pressure(sim.to_scene())
    for _ in range(blocks + 1):
        frame = sim.frame()
        paths.add(frame)
        pressure.add(frame)
        sim.run(collisions=int(per_block * scene.n / 2))
    return paths, pressure


def apart(estimate, expected, uncertainty=0.0):
    """Deviation in standard errors; false alarms beyond 4.5 once in 1e5 for a known error."""
    return abs(estimate.deviation(expected, uncertainty))


@pytest.fixture(scope="module")
def dilute():
    return measure(random_gas("3d", 500, 0.001, seed=2), blocks=64, per_block=5.0)


def test_the_dilute_gas_beside_theory(dilute):
    """Fifteen numbers, each within 4.5 standard errors; at eta = 0.001 recollisions change them by less than 1e-3."""
    paths, _ = dilute
    expected = theory.finite_size_mean_free_path(0.001, 3, 500)
    assert apart(paths.mean_free_path[0], expected.value) < 4.5
    rate = float(theory.finite_size_collision_rate(0.001, 3, 500, temperature=paths.scene.temperature).value)
    assert apart(paths.mean_free_time[0], 1 / rate) < 4.5
    assert paths.collision_rates[0][0].value == pytest.approx(1 / paths.mean_free_time[0].value, rel=1e-3)
    for moment, value in zip(
        (paths.moment(2), paths.moment(3), paths.moment(2, "time")), MOMENTS[3], strict=True
    ):
        assert apart(moment, value, value / 500) < 4.5
    # siblings: an exponential distribution, and that of discs
    assert apart(paths.moment(2), 2.0) > 8
    assert apart(paths.moment(2), MOMENTS[2][0]) > 5
    survival = paths.survival(list(SURVIVAL[3]))
    for point, value in zip(survival, SURVIVAL[3].values(), strict=True):
        assert apart(point, value, value / 500) < 4.5
    assert max(apart(p, math.exp(-x)) for p, x in zip(survival, SURVIVAL[3], strict=True)) > 6
    for check in paths.checks:
        assert abs(check.z) < 4.5, str(check)


def test_paths_and_rates_by_speed(dilute):
    paths, _ = dilute
    law = paths.flights_in_theory()
    edges, measured = paths.path_at_speed()
    expected = [law.path_at_speed(low, high) for low, high in pairwise(edges)]
    z = np.array([e.deviation(x) for e, x in zip(measured, expected, strict=True)])
    assert len(z) >= 15 and np.abs(z).max() < 5 and abs((z**2).mean() - 1) < 1.5
    _, rates = paths.rate_at_speed()
    middle = (edges[:-1] + edges[1:]) / 2
    ratio = np.array([r.value for r in rates]) * np.array([e.value for e in measured]) / middle
    np.testing.assert_allclose(
        ratio[2:12], 1.0, atol=0.03
    )  # nu(v) = v / lambda(v), but for the width of the bins
    # sibling: one path for all speeds
    assert apart(measured[1], law.mean_path) > 20


def test_pressure_from_the_same_rate(dilute):
    paths, pressure = dilute
    assert paths.compressibility_factor.value == pytest.approx(pressure.rate.value, rel=1e-12)
    assert (
        apart(paths.compressibility_factor, float(theory.finite_size_compressibility(0.001, 3, 500).value))
        < 4.5
    )
    assert apart(paths.compressibility_factor, 1.0) > 100


def test_a_mixture_beside_its_theory():
    """Diameters 0.6:1, masses 7:1, by lists: rates between species, path of each; Z of both from the same counts."""
    scene = random_gas("3d_mixture", 200, 0.05)
    paths, pressure = measure(scene, blocks=64, per_block=10.0, search="lists")
    checks = {check.quantity: check for check in paths.checks}
    assert {"nu 1-1", "nu 1-2", "nu 2-1", "nu 2-2", "mean free path of species 2"} <= set(checks)
    for check in checks.values():
        assert abs(check.z) < 4.5, str(check)
    rates = paths.collision_rates
    assert rates[0][1].value == pytest.approx(rates[1][0].value, rel=1e-12)  # as many of each species
    assert paths.compressibility_factor.value == pytest.approx(pressure.rate.value, rel=1e-12)
    assert apart(pressure.rate, pressure.virial.value, pressure.virial.standard_error) < 4.5
    # siblings: rates that do not know of masses, and the distribution of one species alone
    densities, diameters = paths._particles / paths.scene.volume, paths._diameters
    alike = theory.mixture_collision_rates(densities, diameters, [1.0, 1.0], 3, paths.scene.temperature)
    assert apart(rates[0][1], alike[0, 1]) > 20
    assert apart(paths.moment(2, "time", 1), MOMENTS[3][2]) > 5
    axes = paths.plot(Figure().subplots())
    assert len(axes.get_legend().get_texts()) == 3


def test_a_heavy_rare_particle():
    """One of mass 50 among 100: its path is shorter by sqrt(1 - m/M), 0.81; all numbers within 4.5 errors."""
    heavy = np.arange(101) == 0
    masses, radii = np.where(heavy, 50.0, 1.0), np.where(heavy, 0.51, 0.5)
    scene = random_gas("3d_mixture", 101, 0.01, masses=masses, radii=radii)
    paths, _ = measure(scene, blocks=64, per_block=250.0, equilibration=200.0, search="lists")
    checks = {check.quantity: check for check in paths.checks}
    assert "nu 1-1" not in checks and "nu 2-1" in checks  # it does not meet itself
    for check in checks.values():
        assert abs(check.z) < 4.5, str(check)
    law, edges, measured = paths.flights_in_theory(0), *paths.path_at_speed(0)
    assert len(measured) > 6
    z = [e.deviation(law.path_at_speed(*ends)) for e, ends in zip(measured, pairwise(edges), strict=True)]
    assert np.abs(z).max() < 4.5
    # sibling: the path of the infinite gas
    infinite = theory.FreeFlights(
        paths._particles / scene.volume, paths._diameters, paths._masses, 3, 0, scene.temperature
    )
    assert apart(paths.mean_free_path[0], infinite.mean_path) > 5


def test_two_spheres():
    """Mean free time 2.1773 of two at packing fraction 0.05, exactly; paths of two have no third moment."""
    paths, _ = measure(random_gas("3d", 2, 0.05), blocks=64, per_block=400.0)
    for check in paths.checks:
        assert abs(check.z) < 4.5 and not check.quantity.startswith("<"), str(check)
    free_time = paths.predictions["mean free time"][0]
    assert free_time.uncertainty == 0.0 and free_time.value == pytest.approx(2.1773, abs=5e-5)
    assert paths.predictions["mean free path"][0].value == pytest.approx(math.sqrt(1.5) * 2.1773, abs=1e-4)
    # sibling: the infinite gas
    assert apart(paths.mean_free_time[0], 1 / float(theory.collision_rate(0.05, 3))) > 20


@pytest.mark.slow
def test_a_heavy_rare_disc():
    """One of mass 25 among 50 in 2D: 4.5 errors; the infinite gas's path is 22 % longer."""
    heavy = np.arange(50) == 0
    scene = hs.random_gas(n=50, dim=2, packing_fraction=0.1, masses=np.where(heavy, 25.0, 1.0), seed=1)
    paths, _ = measure(scene, blocks=64, per_block=400.0, equilibration=200.0)
    for check in paths.checks:
        assert abs(check.z) < 4.5, str(check)
    infinite = theory.mixture_mean_free_paths([1 / scene.volume, 49 / scene.volume], [1, 1], [25, 1], 2).value
    assert apart(paths.mean_free_path[0], infinite[0]) > 5


def test_theory_of_mixtures_of_equal_particles_is_that_of_one():
    for dim in (2, 3):
        whole = theory.FreeFlights([0.01], [1.0], [2.0], dim, temperature=3.0)
        parts = theory.FreeFlights([0.004, 0.006], [1.0, 1.0], [2.0, 2.0], dim, 1, 3.0)
        assert whole.mean_path == pytest.approx(parts.mean_path)
        assert whole.path_moment(2).value == pytest.approx(MOMENTS[dim][0], rel=1e-6)
        assert parts.path_moment(3).value == pytest.approx(MOMENTS[dim][1], rel=1e-5)
        assert parts.time_moment(2).value == pytest.approx(MOMENTS[dim][2], rel=1e-6)
        x = list(SURVIVAL[dim])
        np.testing.assert_allclose(parts.path_survival(x).value, list(SURVIVAL[dim].values()), atol=1e-6)
        np.testing.assert_allclose(
            parts.time_survival(x).value, theory.free_time_survival(x, dim).value, rtol=1e-9
        )
    densities, diameters, masses = [0.02, 0.01], [1.0, 2.0], [1.0, 10.0]
    for dim in (2, 3):
        for k in range(2):
            flights = theory.FreeFlights(densities, diameters, masses, dim, k, 2.0)
            rates = theory.mixture_collision_rates(densities, diameters, masses, dim, 2.0)
            assert 1 / flights.mean_time == pytest.approx(rates[k].sum(), rel=1e-12)
            expected = theory.mixture_mean_free_paths(densities, diameters, masses, dim).value[k]
            assert flights.mean_path == pytest.approx(expected, rel=1e-12)
            # the widest bin of speeds is all of them
            assert flights.path_at_speed(0.0, 20.0) == pytest.approx(expected, rel=1e-9)


def feed(sim, paths, blocks, collisions, quiet=True):
    with warnings.catch_warnings():
        if quiet:
            warnings.simplefilter("ignore", FirstFlightsWarning)
        for _ in range(blocks):
            sim.run(collisions=collisions)
            paths.add(sim.frame())


def test_broken_gases_are_seen():
    """Beams that have not met, a gas that relaxes, masses that the theory was not told of, and another gas's blocks."""
    sim = hs.Simulation(random_gas("3d", 12_000, 0.02, velocities="beams"), free_paths=True)
    paths = FreePath(sim.scene).add(sim.frame())
    feed(sim, paths, 19, 120)
    with pytest.warns(FirstFlightsWarning, match="let every particle collide"):
        feed(sim, paths, 1, 120, quiet=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeriesWarning)
        expected = paths.predictions["mean free time"][0]
        assert apart(paths.mean_free_time[0], expected.value, expected.uncertainty) > 5
    # two temperatures that come to one: the rate falls, and the series says so
    sim = hs.Simulation(random_gas("3d", 4000, 0.05, velocities="two-temperatures"), free_paths=True)
    paths = FreePath(sim.scene).add(sim.frame())
    feed(sim, paths, 64, 200)
    with pytest.warns(DriftWarning):
        _ = paths.moment(2)
    # wrong mass, wrong size
    sim = hs.Simulation(random_gas("3d", 500, 0.05), free_paths=True)
    sim.run(collisions=5000)
    heavy, small = FreePath(sim.scene.replace(masses=1.1)), FreePath(sim.scene.replace(radii=0.49))
    for frame in sim.frames(collisions_per_particle=20.0 + 6.0 * np.arange(65)):
        heavy.add(frame)
        small.add(frame)
    path = small.predictions["mean free path"][0]
    assert apart(small.mean_free_path[0], path.value, path.uncertainty) > 5
    # masses change neither paths nor, as the scene's kT grows with them, times: what a free path cannot see
    assert all(abs(check.z) < 4.5 for check in heavy.checks)
    with pytest.raises(
        ValueError, match=r"\[500\] particles of each species in 3 dimensions; the scene has \[32\]"
    ):
        FreePath(random_gas("3d", 32, 0.15)).add(sim.frame())


def test_asked_too_early_or_wrongly():
    scene = random_gas("3d", 500, 0.05)
    paths = FreePath(scene)
    for name in ("mean_free_path", "mean_free_time", "collision_rates", "compressibility_factor", "checks"):
        with pytest.raises(NoDataError, match=r"call add\(frame\) with three frames first"):
            getattr(paths, name)
    for call in (paths.survival, paths.path_at_speed, paths.plot, lambda: paths.moment(2)):
        with pytest.raises(NoDataError, match="has no two blocks yet"):
            call()
    with pytest.raises(ValueError, match=r"construct with Simulation\(scene, free_paths=True\)"):
        paths.add(hs.Simulation(scene).frame())
    with pytest.raises(ValueError, match="nothing moves"):
        FreePath(scene.replace(velocities=np.zeros((500, 3))))
    sim = hs.Simulation(scene, free_paths=True)
    paths.add(sim.frame())
    with pytest.warns(FirstFlightsWarning):
        feed(sim, paths, 2, 100, quiet=False)
    with pytest.raises(ValueError, match="add each frame once, in the order of time"):
        paths.add(sim.frame())
    with pytest.raises(ValueError, match="order = 4"):
        paths.moment(4)
    with pytest.raises(ValueError, match="species = 1; the gas has 1"):
        paths.survival(species=1)
    faster = hs.Simulation(scene.replace(velocities=1.01 * scene.velocities), free_paths=True)
    faster.run(collisions=100)
    with pytest.raises(ValueError, match="another simulation than the one before"):
        paths.add(faster.frame())
    assert paths.n_blocks == 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
@pytest.mark.parametrize("dim", [2, 3])
def test_moments_and_survival_to_a_hundredth(dim):
    """At eta = 0.001 against the dilute law; what recollisions and N = 2000 change is of order 1e-3."""
    runs = [measure(random_gas(f"{dim}d", 2000, 0.001, seed=seed), per_block=8.0)[0] for seed in range(4)]
    for order, of, value in zip((2, 3, 2), ("path", "path", "time"), MOMENTS[dim], strict=True):
        moment = combine_replicas([run.moment(order, of) for run in runs])
        assert abs(moment.value / value - 1) < 1e-2
        print(dim, of, order, moment, value)
    moment = estimate_from_replicas([run.moment(2).value for run in runs])
    assert moment.standard_error < 5e-3 * moment.value
    x = list(SURVIVAL[dim])[:-1]
    for at, value in zip(x, SURVIVAL[dim].values(), strict=False):
        point = estimate_from_replicas([run.survival([at])[0].value for run in runs])
        assert abs(point.value / value - 1) < 2e-2, (at, point)
    # siblings: an exponential, and the other dimension
    assert abs(moment.value / 2 - 1) > 2e-2
    assert abs(moment.value / MOMENTS[5 - dim][0] - 1) > 1e-2


@pytest.mark.slow
def test_rates_of_a_mixture_of_masses_one_to_ten_and_diameters_one_to_two():
    """nu_ij against Boltzmann's rates with the contact values of the mixture, to 1 %."""
    second = np.arange(2000) % 4 == 0
    scene = hs.random_gas(
        n=2000,
        packing_fraction=0.01,
        radii=np.where(second, 1.0, 0.5),
        masses=np.where(second, 10.0, 1.0),
        seed=3,
    )
    paths, pressure = measure(scene, blocks=100, per_block=5.0)
    for check in paths.checks:
        assert abs(check.z) < 4.5, str(check)
        if check.quantity.startswith("nu"):
            assert check.measured.standard_error < 1e-2 * check.measured.value
            print(check)
    assert apart(pressure.rate, pressure.virial.value, pressure.virial.standard_error) < 4.5
    # sibling: the rates of equal masses
    densities, diameters = paths._particles / scene.volume, paths._diameters
    alike = theory.mixture_collision_rates(densities, diameters, [1.0, 1.0], 3, scene.temperature)
    assert apart(paths.collision_rates[0][0], alike[0, 0]) > 10  # the heavy ones come first in this scene


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_error_bars_of_free_paths_follow_students_t():
    """150 independent short runs of 64 spheres, against theory where that is exact and their own mean elsewhere."""
    runs = [measure(random_gas("3d", 64, 0.1, seed=seed), per_block=2.0)[0] for seed in range(150)]
    path = theory.finite_size_mean_free_path(0.1, 3, 64)
    means = [run.mean_free_path[0] for run in runs]
    assert calibrate(means, float(path.value)).passed
    moments = [run.moment(2) for run in runs]
    assert calibrate(moments, float(np.mean([m.value for m in moments]))).passed
    # sibling: the mean path of an infinite gas 3 % denser
    assert not calibrate(means, float(theory.mean_free_path(0.103, 3))).passed
