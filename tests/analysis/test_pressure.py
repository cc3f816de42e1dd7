"""Pressure three ways: calibrated error bars, agreement with theory, the identity between walls, broken gases seen."""

import math
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import gas as random_gas
from scipy import stats

import hardspheres as hs
from analysis import theory
from analysis.calibration import calibrate
from analysis.estimator import NoDataError
from analysis.pressure import Pressure
from analysis.series import DriftWarning, SeriesWarning
from analysis.statistics import TheoryCheck
from analysis.virial_identity import virial_identity


def measure(scene, blocks=80, per_block=2.0, equilibration=30.0, **options):
    """A Pressure after `equilibration` collisions per particle, in blocks of `per_block` collisions per particle."""
    sim = hs.Simulation(scene)
    sim.run(collisions=int(equilibration * scene.n / 2))
    pressure = Pressure(sim.to_scene(), **options)
    return feed(pressure, sim, blocks, int(per_block * scene.n / 2))


def feed(pressure, sim, blocks, collisions):
    """The estimator, with so many blocks of so many collisions each."""
    pressure.add(sim.frame())
    for _ in range(blocks):
        sim.run(collisions=collisions)
        pressure.add(sim.frame())
    return pressure


def counted(scene, time, collisions, virial, pair_collisions=None):
    """A frame of a simulation that has counted this."""
    dim = scene.dim
    walls = np.zeros((2, dim, 2))
    tallies = hs.simulation.Tallies(time, collisions, 0, virial, time * np.eye(dim), *walls)
    paths = None if pair_collisions is None else SimpleNamespace(pair_collisions=pair_collisions)
    return SimpleNamespace(time=time, scene=scene, tallies=tallies, free_paths=paths)


@pytest.fixture(scope="module")
def runs():
    """200 independent short runs of 32 spheres."""
    return [
        measure(random_gas("3d", 32, 0.15, seed=seed), blocks=64, equilibration=20) for seed in range(200)
    ]


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_error_bars_of_z_follow_students_t(runs):
    truth = theory.finite_size_compressibility(0.15, 3, 32)
    virial, rate = [run.virial for run in runs], [run.rate for run in runs]
    for estimates in (virial, rate):
        assert calibrate(estimates, truth.value).passed
    assert np.mean([e.standard_error for e in rate]) < 0.93 * np.mean([e.standard_error for e in virial])
    apart = [run.virial_minus_rate for run in runs]
    assert calibrate(apart, 0.0).passed
    assert np.mean([e.standard_error for e in apart]) < 0.6 * np.mean([e.standard_error for e in rate])
    rates = [run.collision_rate for run in runs]
    exact = theory.finite_size_collision_rate(0.15, 3, 32)
    assert calibrate(rates, exact.value).passed
    assert not calibrate(
        rates, float(theory.collision_rate(0.15, 3))
    ).passed  # the infinite gas's: 0.8 % lower
    # siblings: no finite-size factor N/(N-1) C_N, and the truth of a gas 5 % denser
    wrong = [replace(e, value=1 + (e.value - 1) * 31 / 32) for e in rate]
    assert not calibrate(wrong, truth.value).passed
    wrong = [replace(e, value=e.value + (r.value - 1) / 32) for e, r in zip(apart, rate, strict=True)]
    assert not calibrate(wrong, 0.0).passed
    denser = theory.finite_size_compressibility(0.1575, 3, 32).value
    assert not calibrate(virial, denser).passed


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_the_tensor_is_isotropic_within_its_errors(runs):
    tensors = [run.tensor for run in runs[:60]]
    diagonal = np.array([np.diag(t.total) / np.trace(t.total) * 3 for t in tensors])
    assert np.all(np.abs(diagonal.mean(axis=0) - 1) < 4 * diagonal.std(axis=0) / math.sqrt(60))
    shear = [stats.t.cdf(t.total[0, 1] / t.total_error[0, 1], t.degrees_of_freedom[0, 1]) for t in tensors]
    assert stats.kstest(shear, "uniform").pvalue > 1e-3
    one, run = tensors[0], runs[0]
    np.testing.assert_allclose(one.total, one.kinetic + one.collisional, atol=5e-4)
    assert np.trace(one.total) / 3 == pytest.approx(run.virial_pressure.value, rel=1e-4)
    assert np.trace(one.kinetic) * run.scene.volume == pytest.approx(2 * run.scene.thermal_energy, rel=1e-9)


@pytest.mark.parametrize(("kind", "n", "eta"), [("3d", 500, 0.2), ("2d", 400, 0.3)])
def test_pressure_beside_the_theories(kind, n, eta):
    pressure = measure(random_gas(kind, n, eta), blocks=150, per_block=8.0)
    checks = {(check.quantity, check.theory): check for check in pressure.checks}
    assert len(checks) == 6
    best = [check for check in pressure.checks if check.theory == next(iter(pressure.predictions))]
    assert all(abs(check.z) < 3.3 and not check.better_than_theory for check in best)
    assert best[0].measured.standard_error / best[0].measured.value < 2e-3
    # siblings: the ideal gas, and a packing fraction 2 % off
    assert best[0].measured.p_value(1.0) < 1e-6
    denser = theory.finite_size_compressibility(1.02 * eta, int(kind[0]), n)
    assert abs(best[0].measured.deviation(denser.value)) > 3.3
    axes = Figure().subplots()
    assert pressure.plot(axes) is axes and axes.get_ylabel()
    assert "Z from the virial" in str(best[0])


def test_a_mixture_beside_its_theory():
    pressure = measure(random_gas("3d_mixture", 200, 0.2), blocks=120, per_block=8.0)
    (check,) = pressure.checks
    assert check.theory.startswith("Santos") and abs(check.z) < 3.3
    with pytest.raises(NoDataError, match="free_paths=True"):
        _ = pressure.rate
    # sibling: one species of the same packing fraction
    assert abs(check.measured.deviation(theory.finite_size_compressibility(0.2, 3, 200).value)) > 4


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_a_crystal_beside_the_theory_of_crystals_and_a_dense_gas_beside_none():
    """Spheres at 0.60: the fluid's polynomial says -16 there. Full fcc has a theory, one with vacancies has none."""
    pressure = measure(hs.lattice_gas(n=256, packing_fraction=0.6, seed=1), blocks=60, per_block=5.0)
    check = pressure.checks[0]
    assert check.theory == "fcc crystal, Schultz-Kofke" and len(pressure.predictions) == 1
    assert abs(check.z) < 3.5 and check.uncertainty < 0.005 * check.expected
    assert (
        abs(check.measured.z(-16.0)) > 8
        and abs(check.measured.z(0.95 * check.expected, check.uncertainty)) > 5
    )
    for scene in (
        hs.lattice_gas(n=240, packing_fraction=0.58, seed=1),
        hs.lattice_gas(n=120, packing_fraction=0.75, dim=2, seed=1),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("error", theory.TheoryRangeWarning)  # the check says it
            ((name, nothing),) = Pressure(scene).predictions.items()
        assert math.isnan(nothing.value) and math.isnan(nothing.uncertainty)
        assert "gives no value here" in str(
            TheoryCheck("Z", name, check.measured, nothing.value, nothing.uncertainty)
        )


def test_rate_of_a_mixture_from_its_pairs():
    """Counts by the contact values of theory give back its pressure, through the estimator."""
    scene = random_gas("3d_mixture", 200, 0.2)
    pressure = Pressure(scene)
    rho = np.bincount(scene.species) / scene.volume
    rates = theory.mixture_collision_rates(
        rho, 2 * scene.radii[:2], scene.masses[:2], 3, scene.temperature
    ) * (rho[:, None] * scene.volume)
    rates[np.diag_indices(2)] /= 2
    rng, counts = np.random.default_rng(1), np.zeros((2, 2), dtype=int)
    for k in range(101):
        both = counts + np.triu(counts, 1).T
        pressure.add(counted(scene, 2.0 * k, int(counts.sum()), np.zeros((3, 3)), both))
        counts = counts + rng.poisson(np.triu(rates) * 2.0)
    free = scene.degrees_of_freedom
    expected = theory.mixture_compressibility(rho, 2 * scene.radii[:2], 3).value - 1
    expected *= 3 * 200 / free * theory.collision_speed_factor(free)
    assert abs(pressure.rate.deviation(1 + expected)) < 4
    sim = hs.Simulation(scene)  # sibling: without free paths nobody knows who collided with whom
    with pytest.raises(
        NoDataError, match=r"add\(frame\) with frames of Simulation\(scene, free_paths=True\)"
    ):
        _ = Pressure(scene).add(sim.frame()).add(counted(scene, 1.0, 9, np.zeros((3, 3)))).rate
    with pytest.raises(ValueError, match="some of the frames have free paths"):
        pressure.add(counted(scene, 1e3, 10**6, np.zeros((3, 3))))


@pytest.mark.parametrize(("kind", "n", "eta"), [("2d_mixture_walls", 40, 0.3), ("3d_walls", 50, 0.2)])
def test_identity_between_walls_to_round_off(kind, n, eta):
    sim = hs.Simulation(random_gas(kind, n, eta))
    for collisions in (1, 100, 20_000):
        sim.run(collisions=50)
        start = sim.frame()
        sim.reset_tallies()  # which frames need not and do not notice
        sim.run(collisions=collisions)
        identity = virial_identity(start, sim.frame())
        assert identity.residual < 2e-12
        # sibling: without its boundary term it fails
        assert np.abs(identity.inside - identity.walls).max() > 1e-6 * np.abs(identity.inside).max()
    assert len(identity.axes) == (2 if kind.startswith("2d") else 1)
    with pytest.raises(ValueError, match="the start comes first"):
        virial_identity(start, start)
    with pytest.raises(ValueError, match="another simulation"):
        virial_identity(start, hs.Simulation(random_gas(kind, n, eta, seed=2)).frame())


@pytest.mark.parametrize("kind", ["2d_mixture_walls", "3d_walls"])
def test_walls_and_virial_agree_between_walls(kind):
    scene = random_gas(kind, 60, 0.2)
    pressure = measure(scene, blocks=120, per_block=20.0)
    tensor = pressure.tensor
    axes = np.flatnonzero(~scene.periodic)
    inside = np.diag(tensor.total)[axes].mean() * scene.volume / (2 * scene.thermal_energy / scene.dim)
    error = np.diag(tensor.total_error)[axes].max() * scene.volume / (2 * scene.thermal_energy / scene.dim)
    walls = pressure.walls
    assert (
        abs(walls.value - inside) < 0.2 * error
    )  # they share their noise: only the boundary term is between them
    for low, high in (("x low", "x high"), ("y low", "y high")):
        if low in pressure.wall_forces:
            forces = pressure.wall_forces
            apart = forces[low].value - forces[high].value
            assert abs(apart) < 4 * math.hypot(forces[low].standard_error, forces[high].standard_error)
    # sibling: the walls' force over the area of the box is not the pressure
    name, force = next(iter(pressure.wall_forces.items()))
    across = float(np.prod(np.delete(scene.box, "xyz".index(name[0]))))
    assert abs(force.value / across / pressure.virial_pressure.value - 1) > 0.02
    assert pressure.wall_pressures[name].value >= force.value / across


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_error_bars_between_walls_cover():
    """200 runs between walls against their own mean, which is 14 times as sharp as one of them."""
    runs = []
    for seed in range(200):
        runs.append(measure(random_gas("2d_mixture_walls", 24, 0.2, seed=seed), per_block=6.0))
    virial, walls = ([getattr(run, name) for run in runs] for name in ("virial", "walls"))
    forces = [run.wall_forces["x high"] for run in runs]
    assert calibrate(virial, float(np.mean([e.value for e in virial]))).passed
    # between walls the boundary terms of neighbouring blocks cancel: errors are too large there, never too
    # small
    for estimates in (walls, forces):
        result = calibrate(estimates, float(np.mean([e.value for e in estimates])))
        assert result.spread < result.expected_spread + 3 * result.spread_error
        assert result.spread > 0.5 * result.expected_spread
    small = [replace(e, standard_error=0.7 * e.standard_error) for e in virial]
    assert not calibrate(small, float(np.mean([e.value for e in virial]))).passed


def test_sound_between_walls():
    """Correlations over 80 waves of what a run's ends add to the walls' forces: 0.17 is 3.5 standard errors or more."""
    sim = hs.Simulation(hs.random_gas(n=400, packing_fraction=0.2, dim=2, boundary="wall", seed=1))
    sim.run(collisions=4000)
    box = sim.scene.box
    speed, damping = (float(f(0.2, 2).value) for f in (theory.sound_speed, theory.sound_damping))
    half, rows = float(box[0] - 1) / speed / 2, []
    for _ in range(160):
        sim.run(time=half)
        frame = sim.frame()
        around = (frame.positions - box / 2) * frame.velocities
        rows.append([around.sum(axis=0), frame.velocities.sum(axis=0)])
    for k, (lag, correlation) in enumerate(
        ((1, theory.virial_correlation), (2, theory.momentum_correlation))
    ):
        series = np.array(rows)[:, k]
        found = np.mean(series[lag:] * series[:-lag]) / np.mean(series**2)
        expected = correlation(lag * half, float(box[0] - 1), speed, damping)
        assert abs(found - expected) < 0.17
        assert abs(found) > 0.17  # sibling: as if the ends of a run knew nothing of each other


def test_contact_theorem_at_a_wall():
    """P_wall = kT times the density of centres at the wall, from the frames' own profile near it."""
    sim = hs.Simulation(random_gas("3d_walls", 50, 0.1))
    sim.run(collisions=2000)
    pressure, near, frames, depth = Pressure(sim.scene), 0, 3000, 0.06
    pressure.add(sim.frame())
    for _ in range(60):
        for frame in sim.frames(every=0.2, count=frames // 60 + 1):
            y = frame.positions[:, 1] - 0.5
            near += np.count_nonzero(y < depth) + np.count_nonzero(y > sim.scene.box[1] - 1.0 - depth)
        pressure.add(frame)
    seen = 60 * (frames // 60 + 1)
    area = float(sim.scene.box[0] * sim.scene.box[2])
    contact = near / seen / (2 * area * depth) * sim.scene.temperature
    both = [pressure.wall_pressures[name] for name in ("y low", "y high")]
    mean = (both[0].value + both[1].value) / 2
    error = math.hypot(both[0].standard_error, both[1].standard_error) / 2
    # the profile falls by a few per cent over the depth; counts are Poisson but for correlations
    assert abs(contact / mean - 1) < 4 * math.hypot(1.5 / math.sqrt(near), error / mean) + 0.03


def test_broken_gases_are_seen():
    # not thermalised: two beams, whose collisions are rare or head-on; virial and rate cannot agree
    sim = hs.Simulation(random_gas("3d", 4000, 0.02, velocities="beams"))
    pressure = Pressure(sim.scene)
    feed(pressure, sim, blocks=20, collisions=40)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeriesWarning)
        assert abs(pressure.virial.deviation(pressure.rate.value)) > 4
        assert abs(pressure.virial_minus_rate.deviation(0.0)) > 4
    # drifting: a crystal that melts
    sim = hs.Simulation(hs.lattice_gas(n=864, packing_fraction=0.45, seed=1))
    sim.run(collisions=400)
    pressure = Pressure(sim.scene)
    feed(pressure, sim, blocks=300, collisions=160)
    with pytest.warns(DriftWarning):
        _ = pressure.virial
    # wrong mass: velocities as at equilibrium, tallies of a gas twice as heavy as the scene says
    sim = hs.Simulation(random_gas("3d", 108, 0.2))
    pressure = Pressure(sim.scene.replace(masses=2.0))
    feed(pressure, sim, blocks=64, collisions=100)
    assert max(abs(check.z) for check in pressure.checks[:1]) > 5


def test_equilibration_is_discarded():
    sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.45, seed=2))
    both = Pressure(sim.scene), Pressure(sim.scene, discard=True)
    for _ in range(501):
        frame = sim.frame()
        for pressure in both:
            pressure.add(frame)
        sim.run(collisions=20)
    assert both[0].discarded_rows == 0
    assert 2 <= both[1].discarded_rows < 250
    assert both[0].n_blocks == 500


def test_memory_is_bounded_and_results_stay():
    rng = np.random.default_rng(5)
    scene = random_gas("3d", 32, 0.15)
    pressure = Pressure(scene)
    virial = np.zeros((3, 3))
    for k in range(3001):
        pressure.add(counted(scene, float(k), 50 * k, virial))
        virial = virial + np.diag(rng.normal(10.0, 1.0, 3))
    assert len(pressure._blocks) < 1024 and pressure.n_blocks == 3000
    expected = 1 + 30 / (2 * scene.thermal_energy)
    assert abs(pressure.virial.deviation(expected)) < 4


def test_asked_too_early_it_says_what_to_call():
    scene = random_gas("3d", 32, 0.15)
    pressure = Pressure(scene)
    for name in ("virial", "rate", "tensor", "checks"):
        with pytest.raises(NoDataError, match=r"call add\(frame\) with three frames first"):
            getattr(pressure, name)
    with pytest.raises(NoDataError, match="no walls yet"):
        _ = pressure.walls
    with pytest.raises(ValueError, match=r"only frames of a simulation have tallies.*this is <Tallies"):
        pressure.add(hs.Simulation(scene).tallies)
    with pytest.raises(ValueError, match="nothing moves"):
        Pressure(scene.replace(velocities=np.zeros((32, 3))))
    with pytest.raises(ValueError, match="dimensions"):
        pressure.add(hs.Simulation(random_gas("2d", 32, 0.15)).frame())
    with pytest.raises(ValueError, match="needs a wall axis"):
        sim = hs.Simulation(scene)
        virial_identity(sim.frame(), sim.frame())
