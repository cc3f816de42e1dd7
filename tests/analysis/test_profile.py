"""Density between walls: exact for points and tables, the contact theorem beside the impulse on the walls."""

from types import SimpleNamespace

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis.calibration import calibrate
from analysis.estimator import NoDataError
from analysis.profile import DensityProfile
from analysis.statistics import Estimate


def of_points(scene, axis, share, count=400):
    """Profile of frames whose particles are at random; `share` turns uniform numbers into places on the way."""
    rng, profile = np.random.default_rng(1), DensityProfile(axis, width=0.2, window=1.5)
    for _ in range(count):
        positions = scene.positions.copy()
        room = scene.box[axis] - 2.0 * scene.radii
        positions[:, axis] = scene.radii + share(rng.random(scene.n)) * room
        profile.add(SimpleNamespace(scene=scene, positions=positions))
    return profile


@pytest.mark.parametrize(("kind", "axis"), [("3d_walls", 1), ("2d_mixture_walls", -1)])
def test_points_at_random(kind, axis):
    """A flat profile, and one that rises linearly from the lower wall (sibling): known densities in every slice."""
    scene = random_gas(kind, 60, 0.02)
    species = np.unique(scene.species, return_index=True)[1]
    cross = scene.volume / scene.box[axis]
    room = scene.box[axis] - 2.0 * scene.radii[species]
    flat = (np.bincount(scene.species) / cross / room)[:, None]
    profile = of_points(scene, axis, lambda u: u)
    z = (profile.density - flat) / profile.density_error
    assert np.abs(z).max() < 5.0 and abs(z.std() - 1.0) < 0.2
    assert [abs(each.deviation(float(flat.sum()))) < 4.0 for each in profile.contact] == [True, True]
    assert profile.middle == pytest.approx(flat[:, 0], rel=0.05)
    rising = of_points(scene, axis, np.sqrt)
    share = (profile.z - profile.gas.diameters[:, None] / 2.0) / room[:, None]
    z = (rising.density - 2.0 * flat * share) / rising.density_error
    assert np.abs(z).max() < 5.0
    lower, upper = rising.contact
    assert abs(lower.deviation(0.0)) < 4.0 and abs(upper.deviation(2.0 * float(flat.sum()))) < 4.0
    assert abs(upper.deviation(float(flat.sum()))) > 4.0


def test_extrapolation_is_exact_for_polynomials():
    """Slices that hold averages of a cubic give its value at the wall to round-off. Sibling: of degree 1, not."""
    scene = random_gas("3d_walls", 60, 0.02)
    profile = DensityProfile(1)
    profile._begin(scene)
    edges = np.arange(profile._bins + 1) / profile._bins
    cubic = np.polynomial.Polynomial([3.0, -5.0, 4.0, -1.0])
    slices = np.diff(cubic.integ()(edges)) * profile._bins
    assert profile._extrapolation()[0] @ slices == pytest.approx(3.0, rel=1e-9)
    steep = DensityProfile(1, width=2.0, window=6.0, degree=1)
    steep._gas = profile._gas
    edges = np.arange(steep._bins + 1) / steep._bins
    slices = np.diff(cubic.integ()(edges)) * steep._bins
    assert abs(steep._extrapolation()[0] @ slices - 3.0) > 0.01


@pytest.mark.parametrize(("kind", "axis", "eta"), [("3d_walls", 1, 0.3), ("2d_mixture_walls", 0, 0.3)])
def test_contact_theorem(kind, axis, eta):
    """kT n(contact) is the force on the wall, which the engine tallies; sibling: the density in the middle is not.

    Exact at any density and fixed energy; 3.5 standard errors of each wall and of theory, false alarm 1.5e-3.
    """
    scene, profile = random_gas(kind, 400, eta), DensityProfile(axis)
    sim = hs.Simulation(scene)
    sim.run(collisions=8000)
    before, time = sim.tallies.wall_impulses[axis], sim.time
    for frame in sim.frames(every=time / 13.0, count=250):
        profile.add(frame)
    force = (sim.tallies.wall_impulses[axis] - before) / (sim.time - time)
    pressure = force / (scene.volume / scene.box[axis]) / scene.temperature
    for measured, expected in zip(profile.contact, pressure, strict=True):
        assert abs(measured.deviation(expected, 0.01 * expected)) < 3.5
        assert abs(measured.deviation(float(profile.middle.sum()))) > 4.0
    assert all(abs(check.z) < 3.5 for check in profile.checks)
    assert len(profile.checks) == (kind != "3d_walls")  # 8.9 diameters: both walls are felt in the middle


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_contact_densities_are_calibrated():
    """100 short runs beside their own wall pressures, whose errors are a tenth; sibling: 15 % more pressure."""
    found = []
    for seed in range(100):
        scene, profile = random_gas("3d_walls", 200, 0.2, seed=seed), DensityProfile(1)
        sim = hs.Simulation(scene)
        sim.run(collisions=2000)
        before, time = sim.tallies.wall_impulses[1], sim.time
        for frame in sim.frames(every=time / 5.0, count=60):
            profile.add(frame)
        force = (sim.tallies.wall_impulses[1] - before) / (sim.time - time)
        pressure = float(force.mean()) / (scene.volume / scene.box[1]) / scene.temperature
        lower, upper = profile.contact
        found += [
            Estimate(
                each.value / pressure,
                each.standard_error / pressure,
                each.n_effective,
                each.degrees_of_freedom,
            )
            for each in (lower, upper)
        ]
    assert calibrate(found, 1.0).passed
    assert not calibrate(found, 1.15).passed


def test_bad_input():
    with pytest.raises(NoDataError, match="no frames yet"):
        _ = DensityProfile().density
    with pytest.raises(ValueError, match="a polynomial of degree 3 needs at least 5 slices in the window"):
        DensityProfile(width=0.1)
    scene = random_gas("3d_walls", 64, 0.1)
    frame = SimpleNamespace(scene=scene, positions=scene.positions)
    with pytest.raises(
        ValueError, match="axis 0 is periodic, so the density is the same everywhere along it"
    ):
        DensityProfile(0).add(frame)
    with pytest.raises(ValueError, match="axis = 3; a gas in 3D has axes 0 to 2"):
        DensityProfile(3).add(frame)
    with pytest.raises(
        ValueError, match="window = 4 mean diameters is more than half of what centres can reach"
    ):
        DensityProfile(1, window=4.0).add(frame)
    other = random_gas("3d_walls", 32, 0.1)
    with pytest.raises(ValueError, match="32 particles; expected 64"):
        DensityProfile(1).add(frame).add(SimpleNamespace(scene=other, positions=other.positions))
