"""Diffusion: a walk whose diffusion is known exactly, calibrated errors, spheres beside Enskog."""

import math
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
from analysis.transport import Diffusion, ShortWindowWarning

GAMMA, STEP = 0.5, 0.25


def brownian(rng, n, steps, scene, drift=0.0):
    """Ornstein-Uhlenbeck particles with friction 0.5 and kT/m = 1, sampled exactly: D = 2, <v v(t)> = exp(-t/2)."""
    decay = math.exp(-GAMMA * STEP)
    # covariance of the two noises of one step (Uhlenbeck and Ornstein 1930)
    vv = 1 - decay**2
    xv = (1 - decay) ** 2 / GAMMA
    xx = (2 * GAMMA * STEP - 3 + 4 * decay - decay**2) / GAMMA**2
    root = np.linalg.cholesky([[xx, xv], [xv, vv]])
    x, v = np.zeros((n, scene.dim)), rng.standard_normal((n, scene.dim))
    for step in range(steps):
        yield SimpleNamespace(time=step * STEP, unwrapped_positions=x, velocities=v, scene=scene)
        noise = np.einsum("ab,bnk->ank", root, rng.standard_normal((2, n, scene.dim)))
        x = x + (1 - decay) / GAMMA * v + noise[0] + drift * STEP
        v = decay * v + noise[1]


def exact_msd(t, dim):
    return 2 * dim / GAMMA**2 * (GAMMA * t - 1 + np.exp(-GAMMA * t))


@pytest.fixture(scope="module")
def scene():
    return random_gas("3d", 400, 0.01, boundary="wall")


def test_a_known_walk(scene):
    diffusion = Diffusion(points=8)
    for frame in brownian(np.random.default_rng(1), 400, 3000, scene):
        diffusion.add(frame)
    lags = diffusion.lags
    assert lags[:10] == pytest.approx(np.array([1, 2, 3, 4, 5, 6, 7, 8, 10, 12]) * STEP)
    assert np.all(np.diff(lags) > 0) and lags[-1] > 300 * STEP
    assert np.all(diffusion.mean_square_displacement_error > 0)
    z = (diffusion.mean_square_displacement - exact_msd(lags, 3)) / diffusion.mean_square_displacement_error
    assert np.nanmax(np.abs(z)) < 4.5
    z = (
        diffusion.velocity_autocorrelation - np.exp(-GAMMA * lags)
    ) / diffusion.velocity_autocorrelation_error
    assert np.nanmax(np.abs(z)) < 4.5
    window = (16 * STEP, 32 * STEP)
    expected = (exact_msd(window[1], 3) - exact_msd(window[0], 3)) / (6 * 16 * STEP)
    measured = diffusion.diffusion(window)
    assert abs(measured.deviation(expected)) < 4
    assert measured.standard_error / measured.value < 0.03
    # the same from velocities: D(t) = (1 - exp(-gamma t))/gamma by Green and Kubo, Simpson's error far below
    for until in (8 * STEP, 32 * STEP):
        from_velocities = diffusion.diffusion_from_velocities(until)
        assert abs(from_velocities.deviation((1 - math.exp(-GAMMA * until)) / GAMMA)) < 4
        assert from_velocities.standard_error / from_velocities.value < 0.03
    assert abs(diffusion.diffusion_from_velocities(4 * STEP).deviation(2.0)) > 10  # the tail is cut off
    with pytest.raises(ValueError, match="expected at least 0.5, two spacings"):
        diffusion.diffusion_from_velocities(0.1 * STEP)
    # siblings: the slope is not yet 2 kT/m/gamma at short times, and the unit of time matters
    assert abs(diffusion.diffusion((STEP, 4 * STEP)).deviation(2.0)) > 10
    assert abs(measured.deviation(2 * expected)) > 10


def long_lags(frames_of, runs, points=8):
    """Mean and errors of MSD and VACF at every lag, of so many runs: two pairs of (runs, lags) arrays, and the lags."""
    values, errors = [], []
    for run in range(runs):
        diffusion = Diffusion(points=points)
        for frame in frames_of(run):
            diffusion.add(frame)
        values.append([diffusion.mean_square_displacement, diffusion.velocity_autocorrelation])
        errors.append([diffusion.mean_square_displacement_error, diffusion.velocity_autocorrelation_error])
    return np.array(values), np.array(errors), diffusion.lags


def test_errors_hold_at_lags_of_half_the_run():
    """80 walks of 20 particles over 160 steps, lags up to 64: deviations spread as far as the errors say, none is unknown."""
    few = random_gas("3d", 20, 0.001, boundary="wall")
    values, errors, lags = long_lags(
        lambda run: brownian(np.random.default_rng(100 + run), 20, 160, few), 80, 4
    )
    assert lags[-1] == 64 * STEP
    truth = np.array([exact_msd(lags, 3), np.exp(-GAMMA * lags)])
    z = (values - truth) / errors
    assert np.all(errors > 0)
    spread = np.sqrt((z**2).mean(axis=0))  # of 80: good to 8 %, correlated between lags
    assert np.all((spread > 0.7) & (spread < 1.45))
    assert abs(np.sqrt((spread**2).mean()) - 1) < 0.2
    # sibling: the origins of a long lag overlap, and taken as independent they say next to nothing
    naive = []
    for run in range(80):
        diffusion = Diffusion(points=4)
        for frame in brownian(np.random.default_rng(100 + run), 20, 160, few):
            diffusion.add(frame)
        rows = diffusion._rows_by_level[4].rows[:, 3]  # lag 64
        naive.append((rows.mean() - truth[0, -1]) / (rows.std(ddof=1) / math.sqrt(len(rows))))
    assert np.sqrt(np.mean(np.square(naive))) > 1.6


@pytest.mark.slow
def test_errors_hold_at_long_lags_in_a_gas():
    """100 runs of 32 spheres over 320 collisions per particle, against their own mean, at lags up to 256 of 640 steps.

    The spread of 100 is good to 7 %; false alarm 5e-3.
    """
    eta = 0.15
    step = 0.5 / float(theory.collision_rate(eta, 3))

    def run(seed):
        sim = hs.Simulation(random_gas("3d", 32, eta, seed=seed))
        sim.run(collisions=320)
        for _ in range(640):
            sim.run(time=step)
            yield sim

    values, errors, lags = long_lags(run, 100)
    seen = lags < 260 * step
    z = (values - values.mean(axis=0))[..., seen] / errors[..., seen]
    spread = np.sqrt((z**2).mean(axis=0))
    assert np.all((spread > 0.75) & (spread < 1.3))


def test_memory_is_bounded(scene):
    diffusion, few = Diffusion(points=4), random_gas("3d", 5, 0.001)
    for frame in brownian(np.random.default_rng(2), 5, 3000, few):
        diffusion.add(frame)
    assert len(diffusion._levels) == 12  # 2^11 < 3000
    assert all(len(level) <= 4 for level in diffusion._levels)
    assert all(len(rows) < 256 for rows in diffusion._rows_by_level)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_d_follow_students_t():
    rng, few = np.random.default_rng(3), random_gas("3d", 8, 0.001, boundary="wall")
    window = (8 * STEP, 16 * STEP)
    truth = (exact_msd(window[1], 3) - exact_msd(window[0], 3)) / (6 * 8 * STEP)
    estimates, naive = [], []
    for _ in range(100):
        diffusion = Diffusion(points=16)
        for frame in brownian(rng, 8, 1000, few):
            diffusion.add(frame)
        d = diffusion.diffusion(window)
        estimates.append(d)
        rows = diffusion._rows_by_level[0].rows
        slopes = (rows[:, 15] - rows[:, 7]) / (6 * 8 * STEP)
        naive.append((d.value - truth) / (slopes.std(ddof=1) / math.sqrt(len(slopes))))
    assert calibrate(estimates, truth).passed
    assert stats.chi2.sf(np.square(naive).sum(), len(naive)) < 1e-6  # sibling: origins taken as independent


def test_common_motion_does_not_diffuse():
    few = random_gas("3d", 200, 0.001)
    measured = []
    for drift in (0.0, 50.0):
        diffusion = Diffusion(points=8)
        for frame in brownian(np.random.default_rng(4), 200, 200, few, drift):
            diffusion.add(frame)
        measured.append(diffusion.mean_square_displacement)
    np.testing.assert_allclose(measured[0], measured[1], rtol=1e-8)


def spheres(eta, n, spacing, count, seed=1):
    """Diffusion of a fluid, looked at every `spacing` mean free times."""
    sim = hs.Simulation(random_gas("3d", n, eta, seed=seed))
    sim.run(collisions=50 * n)
    step = spacing / float(theory.collision_rate(eta, 3))
    diffusion = Diffusion()
    for _ in range(count):
        sim.run(time=step)
        diffusion.add(sim)
    return diffusion, step


def test_spheres_diffuse_as_known():
    """256 spheres at eta = 0.2: an independent code found 0.3684; of the infinite fluid 0.4043(7) is known."""
    diffusion, step = spheres(0.2, 256, 2.0, 2000)
    checks = diffusion.check()
    assert abs(checks[0].measured.deviation(0.3684, 0.006)) < 4
    assert checks[0].measured.standard_error / checks[0].measured.value < 0.03
    correction = diffusion.periodic_correction
    assert checks[1].measured.value == pytest.approx(checks[0].measured.value + correction.value)
    assert checks[1].measured.standard_error == pytest.approx(
        math.hypot(checks[0].measured.standard_error, correction.uncertainty)
    )
    assert abs(checks[1].measured.deviation(0.4043, 0.0007)) < 4
    assert abs(checks[1].z) < 2
    # an earlier slope is told, and has the rest of the tail from theory
    early = (4 * step, 8 * step)
    with pytest.warns(ShortWindowWarning, match=r"too early for D of this box, 6\.018 to 9\.027"):
        from_early = diffusion.infinite_diffusion(early)
    assert abs(from_early.deviation(0.4043, 0.0007)) < 4
    # siblings: the dilute gas's D, particles of twice the mass
    dilute = theory.enskog_diffusion(0.2, 3).value * theory.contact_value(0.2, 3)
    assert abs(checks[0].measured.deviation(dilute)) > 8
    assert abs(checks[0].measured.deviation(0.3684 / math.sqrt(2), 0.006)) > 5
    assert from_early.value > diffusion.diffusion(early).value + correction.value
    axes = Figure().subplots()
    assert diffusion.plot(axes) is axes


def test_a_run_too_short_for_its_box_says_so():
    diffusion, _ = spheres(0.2, 256, 2.0, 20)
    with pytest.raises(ValueError, match=r"the lags reach 6\.707; .* from 6\.018 to 9\.027: run longer, or"):
        diffusion.infinite_diffusion()


def test_velocities_forget_at_the_rate_of_collisions():
    eta = 0.2
    diffusion, _ = spheres(eta, 256, 0.05, 1500, seed=2)
    lags, value = diffusion.lags, diffusion.velocity_autocorrelation
    rate = float(theory.velocity_correlation_rate(eta, 3))
    short = slice(0, 8)  # up to 0.4 collisions per particle
    expected = np.exp(-rate * lags[short])
    error = diffusion.velocity_autocorrelation_error[short]
    assert np.all(np.abs(value[short] - expected) < 4 * np.nan_to_num(error, nan=0.01) + 0.004)
    assert abs(value[7] - math.exp(-1.2 * rate * lags[7])) > 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("eta", "known", "infinite"), [(0.1, 0.9055, 0.949), (0.3, None, None)])
def test_diffusion_to_two_per_cent(eta, known, infinite):
    diffusion, _ = spheres(eta, 256, 2.0, 5000)
    checks = diffusion.check()
    for check in checks:
        assert check.measured.standard_error / check.measured.value < 0.02
        assert abs(check.z) < 2
    if known is not None:
        assert abs(checks[0].measured.deviation(known, 0.01 * known)) < 4
        assert abs(checks[1].measured.deviation(infinite, 0.001)) < 4


def test_a_tracer_is_the_particles_with_a_label(scene):
    """Exactly what the labelled particles alone give; sibling: the others give something else."""
    chosen = np.arange(400) % 3 == 1
    labelled, few = scene.replace(labels=np.where(chosen, 7, 2)), random_gas("3d", 133, 0.01, boundary="wall")
    tracer, alone, others = Diffusion(points=8, label=7), Diffusion(points=8), Diffusion(points=8, label=2)
    for frame in brownian(np.random.default_rng(3), 400, 40, labelled):
        for each in (tracer, others):
            each.add(frame)
        alone.add(
            SimpleNamespace(
                time=frame.time,
                unwrapped_positions=frame.unwrapped_positions[chosen],
                velocities=frame.velocities[chosen],
                scene=few,
            )
        )
    for name in ("mean_square_displacement", "mean_square_displacement_error", "velocity_autocorrelation"):
        assert np.array_equal(getattr(tracer, name), getattr(alone, name))
        assert not np.array_equal(getattr(others, name), getattr(alone, name))
    walk = next(brownian(np.random.default_rng(3), 400, 1, labelled))
    with pytest.raises(ValueError, match="label = 3, but no particle"):
        Diffusion(label=3).add(walk)
    with pytest.raises(ValueError, match="label = 7, but the particles have no labels"):
        Diffusion(label=7).add(next(brownian(np.random.default_rng(3), 400, 1, scene)))
    with pytest.raises(ValueError, match="of different label"):
        tracer.merge(others)


def test_misuse_is_named(scene):
    with pytest.raises(NoDataError, match=r"call add\(sim\) at least 18 times first"):
        _ = Diffusion().lags
    with pytest.raises(NoDataError, match=r"no moments yet; call add\(sim\) first"):
        _ = Diffusion().periodic_correction
    with pytest.raises(ValueError, match="points = 5"):
        Diffusion(points=5)
    with pytest.raises(ValueError, match="no unwrapped positions"):
        Diffusion().add(SimpleNamespace(time=0.0, positions=np.zeros((400, 3)), scene=scene))
    walk = list(brownian(np.random.default_rng(5), 400, 40, scene))
    with pytest.raises(ValueError, match="equally spaced"):
        Diffusion().add(walk[0]).add(walk[1]).add(walk[3])
    with pytest.raises(ValueError, match="not after"):
        Diffusion().add(walk[0]).add(walk[0])
    with pytest.raises(ValueError, match="species = 3; the gas has 1"):
        Diffusion(species=3).add(walk[0])
    diffusion = Diffusion(points=8)
    for frame in walk:
        diffusion.add(frame)
    with pytest.raises(ValueError, match="expected 0 < t1 < t2"):
        diffusion.diffusion((2.0, 1.0))
    with pytest.raises(ValueError, match="cubic box"):
        _ = diffusion.periodic_correction
    flat = Diffusion().add(hs.Simulation(random_gas("2d", 20, 0.1)))
    with pytest.raises(ValueError, match="no infinite limit"):
        _ = flat.periodic_correction
