"""The scene's unit of time: found without Python's loops, with the bits of the exactly rounded sum."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import gas

import hardspheres as hs
from hardspheres import tuning


def exponent(x):
    return math.frexp(x)[1]


def exact(velocities):
    return math.fsum((velocities * velocities).ravel().tolist()) / len(velocities)


@given(st.lists(st.floats(-1e150, 1e150), min_size=3, max_size=60), st.sampled_from([1, 2, 3]))
def test_the_mean_square_has_the_exact_power_of_two(numbers, dim):
    velocities = np.array(numbers[: len(numbers) // dim * dim]).reshape(-1, dim)
    assert exponent(tuning.mean_square(velocities)) == exponent(exact(velocities))


@pytest.mark.parametrize("n", [4, 1000, 100_000])
def test_near_a_power_of_two_the_exact_sum_decides(n):
    """Velocities scaled until the mean square lies within roundings of 1, on either side."""
    velocities = np.random.default_rng(n).standard_normal((n, 3))
    velocities /= math.sqrt(exact(velocities))
    seen = set()
    for k in range(-20, 21):
        scaled = velocities * (1.0 + k * 2.0**-52)
        assert exponent(tuning.mean_square(scaled)) == exponent(exact(scaled))
        seen.add(exponent(exact(scaled)))
    assert seen == {0, 1}


def test_a_last_digit_can_change_the_unit_of_time():
    """Sibling: it matters, a mean square just below a power of two gives another unit than that power."""
    scene = gas("3d", 64, 0.1)
    ones = np.zeros((64, 3))
    ones[:, 0] = 1.0
    less = ones.copy()
    less[0, 0] -= 1e-13
    units = [tuning.epoch_length(scene.replace(velocities=v)) for v in (ones, less)]
    assert units[1] == 2.0 * units[0]


def test_what_a_scene_keeps_is_right_and_not_carried_over():
    """Derived quantities are computed once for each scene; another state has its own."""
    scene = hs.lattice_gas(n=32, packing_fraction=0.1, seed=1)
    energy = scene.kinetic_energy
    faster = scene.with_state(scene.positions, 2.0 * scene.velocities)
    assert faster.kinetic_energy == 4.0 * energy == 4.0 * scene.kinetic_energy
    assert faster.thermal_energy == 4.0 * scene.thermal_energy
    larger = scene.with_state(scene.positions, scene.velocities, 0.5 * scene.radii)
    assert larger.packing_fraction == scene.packing_fraction / 8.0


@pytest.mark.parametrize(("kind", "eta"), [("3d", 0.01), ("3d", 0.1), ("2d", 0.2)])
def test_the_grid_of_windows_says_how_many_pairs_it_compares(kind, eta):
    """Counted: each segment names, in its bounding box, the cells that it is compared with."""
    sim = hs.Simulation(gas(kind, 3000, eta), search="windows")
    sim.run(time=0.0)
    at, a = sim._at, sim._engine.arrays
    near = a.boxes[: a.counter[at.REGISTERED]] >> at.NEAR_SHIFT
    along_x = 1 + (near & at.BEFORE_X > 0) + (near & at.AFTER_X > 0)
    along_z = 1 + (near & at.BEFORE_Z > 0) + (near & at.AFTER_Z > 0)
    along_y = 1 + (near >> at.BEFORE_Y & 3) + (near >> at.AFTER_Y & 3)
    in_a_cell = sim.scene.n / np.prod(a.counter[at.CELLS : at.CELLS + 3])
    counted = 0.5 * in_a_cell * float(np.sum(along_x * along_y * (along_z if sim.scene.dim == 3 else 1)))
    assert sim.status()["pairs_compared"] == pytest.approx(counted, rel=0.1)
