"""The largest Lyapunov exponent: its tangent is the difference of two gases; known exponents; bad input."""

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis.lyapunov import Tangent, lyapunov_exponent


def carried(scene, tangent, time, search):
    hs.Simulation(scene, log=tangent.take, search=search).run(time=time)
    tangent.carry_to(time)


@pytest.mark.parametrize(
    ("kind", "search", "eta"),
    [
        ("3d", "windows", 0.2),
        ("3d_mixture", "lists", 0.2),
        pytest.param("2d_mixture_walls", "windows", 0.3, marks=pytest.mark.slow),
    ],
)
def test_the_tangent_is_the_difference_of_two_gases(kind, search, eta):
    """A deviation carried through some 20 events, against two gases 1e-8 apart on either side, to 1e-4.

    Sibling: without what a curved surface does to the direction, it is not.
    """
    scene = random_gas(kind, 12, eta, seed=2)
    rng, small = np.random.default_rng(1), 1e-8
    dx, dv = rng.normal(size=(2, *scene.positions.shape))
    probe = hs.Simulation(scene)
    probe.run(collisions=12)
    time = probe.time + 1e-3
    tangent = Tangent(scene, dx, dv)
    carried(scene, tangent, time, search)
    ends = []
    for sign in (-1, 1):
        positions = scene.positions + sign * small * dx
        positions = np.where(scene.periodic, positions % scene.box, positions)
        ends.append(
            hs.Simulation(scene.replace(positions=positions, velocities=scene.velocities + sign * small * dv))
        )
        ends[-1].run(time=time)
        assert ends[-1].collisions == probe.collisions and ends[-1].wall_collisions >= probe.wall_collisions
    for name in ("velocities", "unwrapped_positions"):
        own = tangent.velocities if name == "velocities" else tangent.places
        difference = (getattr(ends[1], name) - getattr(ends[0], name)) / (2 * small)
        assert np.abs(difference - own).max() < 1e-4 * np.abs(own).max()
    flat = Tangent(scene, dx, dv)
    flat.radii = 1e6 * flat.radii
    carried(scene, flat, time, search)
    assert np.abs(difference - flat.places).max() > 1e-2 * np.abs(tangent.places).max()


def test_exponent_beside_known_ones():
    """125 spheres at 0.1: 1.69 (2 %) by another program, some 1.8 (10 %) of larger gases; 3.5 standard errors.

    Sibling: half of it.
    """
    sim = hs.Simulation(random_gas("3d", 125, 0.1, seed=1))
    sim.run(collisions=1250)
    found = lyapunov_exponent(sim.to_scene(), 150.0)
    assert abs(found.per_collision.deviation(1.69, 0.034)) < 3.5
    assert abs(found.per_collision.deviation(0.845, 0.034)) > 3.5
    assert found.check is not None and abs(found.check.z) < 3.5
    again = hs.Simulation(sim.to_scene())
    again.run(collisions=31 * 62)  # what settles it: 30 collisions per particle, in steps of one
    began = again.time
    again.run(collisions=152 * 62)
    per_time = 2 * 152 * 62 / 125 / (again.time - began)
    assert found.per_time.value / found.per_collision.value == pytest.approx(per_time, rel=1e-3)
    assert repr(found).startswith("<LyapunovExponent 1.") and "per collision per particle" in repr(found)


def test_the_direction_at_the_start_is_forgotten():
    """The same gas has the same exponent to 1e-6 whatever deviation it begins with. Sibling: another gas."""
    scene = random_gas("3d", 32, 0.1, seed=1)
    found = [lyapunov_exponent(scene, 100.0, seed=seed).per_collision.value for seed in range(2)]
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    other = lyapunov_exponent(random_gas("3d", 32, 0.1, seed=2), 100.0).per_collision
    assert other.value != pytest.approx(found[0], rel=1e-6)
    assert abs(other.deviation(found[0], other.standard_error)) < 4.0


def test_bad_input():
    scene = random_gas("3d", 32, 0.1)
    with pytest.raises(ValueError, match="collisions_per_particle = 3, settle = 30; expected at least 16"):
        lyapunov_exponent(scene, 3.0)
    with pytest.raises(ValueError, match="settle = -1"):
        lyapunov_exponent(scene, settle=-1.0)
    with pytest.raises(ValueError, match="a gas that falls is not measured here"):
        lyapunov_exponent(random_gas("2d_mixture_walls", 20, 0.1).replace(gravity=(0.0, -1.0)))
    assert lyapunov_exponent(random_gas("3d_mixture", 20, 0.3), 16.0, settle=1.0).check is None
