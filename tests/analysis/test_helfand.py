"""Transport coefficients from tallied moments: unbiased with right errors, exact limits, frames of reference."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import gas as random_gas
from scipy import stats

import hardspheres as hs
from analysis import theory
from analysis.helfand import HeatConductivity, MutualDiffusion, Viscosity
from analysis.transport import Diffusion
from hardspheres.frame import Tallies

ETA, SPHERES = 0.1, 64
FREE_TIME = 1.0 / float(theory.collision_rate(ETA, 3))


@pytest.fixture(scope="module")
def scene():
    """A gas at equilibrium, without common motion."""
    sim = hs.Simulation(random_gas("3d", SPHERES, ETA, seed=2))
    sim.run(collisions=20 * SPHERES)
    return sim.to_scene()


def walk(scene, rng, frames, mean=3.0):
    """Frames whose moments are random walks with steps of variance 2: with a unit of V kT, coefficients are 1.

    The trace has a mean, like the pressure.
    """
    scale = math.sqrt(2.0 * scene.volume * scene.temperature)
    steps = rng.standard_normal((frames, 6)) * scale
    tensor = np.zeros((frames, 3, 3))
    for k, (a, b) in enumerate([(0, 1), (0, 2), (1, 2)]):
        tensor[:, a, b] = tensor[:, b, a] = steps[:, k]
    first, second, trace = steps[:, 3], steps[:, 4] / math.sqrt(3.0), steps[:, 5] + mean * scale
    for a, part in enumerate((first + second, second - first, -2.0 * second)):
        tensor[:, a, a] = part + trace
    for t, total in enumerate(np.cumsum(tensor, axis=0)):
        yield SimpleNamespace(
            time=float(t), scene=scene, tallies=Tallies(float(t), 0, 0, total, 0.0 * total, total, total)
        )


def add_all(estimator, frames):
    for frame in frames:
        estimator.add(frame)
    return estimator


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_random_walks_are_unbiased(scene):
    """300 short runs with a coefficient of exactly 1, beside 4 standard errors of their mean.

    Sibling: without what the fitted mean takes off, a bulk viscosity of 0.85.
    """
    rng, window = np.random.default_rng(3), (2.0, 4.0)
    runs = [add_all(Viscosity(points=4), walk(scene, rng, 40)) for _ in range(300)]
    shear = np.array([run.shear(window).value for run in runs])
    bulk = np.array([run.bulk(window).value for run in runs])
    for found in (shear, bulk):
        assert abs(found.mean() - 1.0) < 4.0 * found.std() / math.sqrt(len(runs))
    uncorrected = bulk * (1.0 - 6.0 / 39.0)
    assert abs(uncorrected.mean() - 1.0) > 4.0 * uncorrected.std() / math.sqrt(len(runs))


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_random_walks_follow_students_t(scene):
    """30 runs, false alarm 1e-3; merged, they agree with 1, and the drift of all is found from all.

    Sibling: errors as of independent origins, too small by some sqrt(window).
    """
    rng, window = np.random.default_rng(4), (2.0, 4.0)
    runs = [add_all(Viscosity(points=4), walk(scene, rng, 600)) for _ in range(30)]
    for kind in (Viscosity.shear, Viscosity.bulk, lambda run, window: run.integral(time=3.0)):
        z = [kind(run, window).z(1.0) for run in runs]
        assert stats.kstest(z, "norm").pvalue > 1e-3
    assert stats.kstest(2.0 * np.array(z), "norm").pvalue < 1e-2
    whole = Viscosity(points=4)
    for run in runs:
        whole.merge(run)
    for measured in (whole.shear(window), whole.bulk(window)):
        assert abs(measured.z(1.0)) < 4.0 and measured.standard_error < 0.04


def test_integral_is_that_of_the_autocorrelation(scene):
    """Green and Kubo's sum of products of the fluxes between frames, computed directly."""
    flux = [frame.tallies.virial for frame in walk(scene, np.random.default_rng(5), 400)]
    steps = np.diff([g[0, 1] for g in flux])
    viscosity = add_all(Viscosity(points=8), walk(scene, np.random.default_rng(5), 400))
    only_xy = viscosity._levels.rows[0].mean  # of all components; here the first alone is compared
    assert only_xy.shape == (2, 8, 2)
    moments = np.array([np.mean(np.convolve(steps, np.ones(k), "valid") ** 2) for k in (2, 3, 4)])
    products = [np.mean(steps[: len(steps) - k] * steps[k:]) for k in range(4)]
    slope = (moments[2] - moments[0]) / 4.0
    assert slope == pytest.approx(products[0] / 2 + products[1] + products[2] + products[3] / 2, rel=0.03)


def test_jumps_of_the_virial_give_enskogs_bulk_viscosity_exactly():
    """Within 1 % of the free time collisions are independent jumps: bulk and, 3/5 of it, shear viscosity.

    4 standard errors. To the latter the kinetic stress adds rho kT times half the lag; sibling: at three times
    the lag it has added more than that.
    """
    sim = hs.Simulation(random_gas("3d", 500, 0.1, seed=6))
    sim.run(collisions=5000)
    step = 0.01 * FREE_TIME
    viscosity = add_all(Viscosity(points=4), sim.frames(every=step, count=6000))
    chi = float(theory.finite_size_compressibility(0.1, 3, 500).value - 1.0) / 0.4
    expected = float(theory.bulk_viscosity(0.1, 3).value) * chi / float(theory.contact_value(0.1, 3))
    bulk, shear, later = (
        viscosity.bulk((0.0, step)),
        viscosity.shear((0.0, step)),
        viscosity.shear((2.0 * step, 4.0 * step)),
    )
    assert abs(bulk.z(expected, 0.003 * expected)) < 4.0 and bulk.standard_error < 0.03 * expected
    jumps = 0.6 * expected + 0.5 * sim.scene.number_density * step
    assert abs(shear.z(jumps, 0.01 * jumps)) < 4.0 and shear.standard_error < 0.02 * jumps
    assert not abs(later.z(jumps, 0.01 * jumps)) < 4.0


def test_common_motion_changes_nothing(scene):
    """To rounding, as long as the trajectories are the same. Sibling: the tallies themselves differ."""
    moving = scene.replace(velocities=scene.velocities + [0.3, -0.2, 0.1])
    found = []
    for start in (scene, moving):
        *_, frame = hs.Simulation(start, heat=True).frames(times=[0.0, 2.0 * FREE_TIME])
        found.append((frame, *(kind().add(frame)._moment(frame) for kind in (Viscosity, HeatConductivity))))
    (still, *expected), (seen, *own) = found
    assert still.collisions == seen.collisions > 50
    for a, b in zip(expected, own, strict=True):
        assert a == pytest.approx(b, rel=1e-9, abs=1e-7)
    assert np.abs(still.tallies.heat_flux - seen.tallies.heat_flux).max() > 1.0


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_equal_spheres_mix_as_fast_as_they_diffuse(scene):
    """D_12 = D N/(N - 1), measured in the same run; sibling: D_12 of the first half alone with the rest, x = 1/4."""
    sim = hs.Simulation(scene.replace(labels=np.arange(SPHERES) % 2))
    mixing, self_diffusion = MutualDiffusion(labels=True), Diffusion()
    for _ in range(4000):
        sim.run(time=0.5 * FREE_TIME)
        mixing.add(sim.frame())
        self_diffusion.add(sim)
    expected = self_diffusion.diffusion(mixing.window).value * SPHERES / (SPHERES - 1)
    assert mixing.diffusion().standard_error < 0.13 * expected
    assert abs(mixing.diffusion().z(expected)) < 4.0
    assert abs(mixing.integral().z(expected)) < 4.0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_hard_spheres_follow_students_t():
    """48 runs of 500 mean free times beside their mean; false alarm 1e-3 for each coefficient.

    Sibling: half the errors.
    """
    z = {}
    for seed in range(48):
        sim = hs.Simulation(random_gas("3d", SPHERES, ETA, seed=100 + seed), heat=True, search="lists")
        sim.run(collisions=20 * SPHERES)
        viscosity, conductivity = Viscosity(), HeatConductivity()
        for frame in sim.frames(every=0.5 * FREE_TIME, count=1001):
            viscosity.add(frame)
            conductivity.add(frame)
        for name in viscosity.names:
            z.setdefault(name, []).append(viscosity.slope(name))
        z.setdefault("heat", []).append(conductivity.conductivity())
    for name, found in z.items():
        mean = float(np.mean([each.value for each in found]))
        deviations = np.array([each.z(mean) for each in found])
        squares = float((deviations**2).sum())
        assert 5e-4 < stats.chi2.sf(squares, len(found) - 1) < 1.0 - 5e-4, name
        assert stats.chi2.sf(4.0 * squares, len(found) - 1) < 1e-6, name


def still(scene):
    return scene.replace(velocities=np.zeros((scene.n, 3)))


WRONG = {
    "walls": (lambda scene: Viscosity().add(hs.Simulation(random_gas("3d_walls", 32, 0.1)).frame()), "walls"),
    "gas at rest": (lambda scene: Viscosity().add(hs.Simulation(still(scene)).frame()), "nothing moves"),
    "no heat": (lambda scene: HeatConductivity().add(hs.Simulation(scene).frame()), "heat=True"),
    "heat of a mixture": (
        lambda scene: HeatConductivity().add(hs.Simulation(random_gas("3d_mixture", 32, 0.1)).frame()),
        "2 species",
    ),
    "one species": (
        lambda scene: MutualDiffusion().add(hs.Simulation(scene).frame()),
        "two species; .* has 1",
    ),
    "no labels": (lambda scene: MutualDiffusion(labels=True).add(hs.Simulation(scene).frame()), "none"),
    "twice": (lambda scene: add_all(Viscosity(), [hs.Simulation(scene).frame()] * 2), "not after 0"),
    "unequal": (
        lambda scene: add_all(Viscosity(), hs.Simulation(scene).frames(times=[0.0, 1.0, 3.0])),
        "time = 3; expected 2: frames must be equally spaced, here by 1",
    ),
    "points": (lambda scene: Viscosity(points=5), "points = 5; expected an even number"),
    "window": (
        lambda scene: add_all(Viscosity(), walk(scene, np.random.default_rng(1), 60)).shear((3.0, 2.0)),
        r"window = \(3, 2\)",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_bad_input_is_refused_in_a_sentence(scene, name):
    call, words = WRONG[name]
    with pytest.raises(ValueError, match=words):
        call(scene)


@pytest.mark.parametrize("dim", [2, 3])
def test_mutual_diffusion_of_equal_spheres_is_enskogs_and_scales(dim):
    """Kinetic theory's square root of kT over the reduced mass; sibling: unequal species have another value."""
    density = 0.2 / float(theory.packing_fraction(1.0, 1.0, dim))
    half = [density / 2, density / 2]
    equal = theory.mutual_diffusion(half, [1.0, 1.0], [1.0, 1.0], dim)
    assert equal.value == pytest.approx(float(theory.enskog_diffusion(0.2, dim).value), rel=1e-9)
    heavier = theory.mutual_diffusion(half, [1.0, 1.0], [4.0, 4.0], dim, temperature=16.0)
    assert heavier.value == pytest.approx(2.0 * equal.value)
    unequal = theory.mutual_diffusion(half, [1.0, 1.0], [1.0, 4.0], dim)
    assert unequal.value == pytest.approx(equal.value * math.sqrt(5.0 / 8.0))
    assert unequal.uncertainty / unequal.value > equal.uncertainty / equal.value
    with pytest.raises(ValueError, match="mutual diffusion is of two species"):
        theory.mutual_diffusion([density], [1.0], [1.0], dim)
