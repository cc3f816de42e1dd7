"""Bond-orientational order: exact for crystals, small for what is random, blind to how a scene is turned, scaled or listed."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scenes import gas

import hardspheres as hs
from hardspheres.order import PERFECT

FULL = {"fcc": (864, 3), "triangular": (780, 2)}  # numbers of particles that leave no site empty


def crystal(name, **options):
    n, dim = FULL[name]
    return hs.lattice_gas(n, 0.5, dim=dim, lattice=name, seed=1, **options)


def hcp():
    """A periodic box of hcp: triangular layers, every second one shifted."""
    places = [
        (i + (j + k) % 2 / 2, math.sqrt(3) / 2 * j + k % 2 / math.sqrt(12), k * math.sqrt(2 / 3))
        for k in range(4)
        for j in range(6)
        for i in range(6)
    ]
    box = 1.2 * np.array([6, 3 * math.sqrt(3), 4 * math.sqrt(2 / 3)])
    return hs.Scene(1.2 * np.array(places), np.zeros((144, 3)), box=box)


@pytest.mark.parametrize("name", PERFECT)
def test_crystals_have_their_exact_order(name):
    scene = hcp() if name == "hcp" else crystal(name)
    order = hs.bond_order(scene)
    assert_allclose(order.value, PERFECT[name], rtol=1e-10)
    assert order.bonds == scene.n * (3 if scene.dim == 2 else 6)


def test_a_crystal_that_shakes_is_still_one():
    scene = crystal("fcc")
    shaken = scene.positions + np.random.default_rng(2).uniform(-0.03, 0.03, scene.positions.shape)
    assert 0.45 < hs.bond_order(scene.replace(positions=shaken)).value < PERFECT["fcc"]


@pytest.mark.parametrize("kind", ["3d", "2d", "2d_mixture_walls"])
def test_what_is_random_has_no_order(kind):
    """Twenty scenes; the mean square is within a factor 2.5 of 1/bonds. Neighbours' bonds are nearly independent there."""
    orders = [hs.bond_order(gas(kind, 400, 0.05, seed=seed)) for seed in range(20)]
    ratio = np.mean([(order.value / order.random) ** 2 for order in orders])
    assert 0.4 < ratio < 2.5


def rotated(directions, axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
    return directions @ turn.T


def test_q6_does_not_depend_on_the_axes_and_one_bond_has_all_of_it():
    """Unsöld's theorem: the squares of the 13 harmonics sum up to the same in every direction."""
    from hardspheres.order import _q6

    directions = np.random.default_rng(4).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for one in directions:
        assert_allclose(_q6(one[None]), 1.0, rtol=1e-13)
    value = _q6(directions)
    for axis in range(3):
        assert_allclose(_q6(rotated(directions, axis, 0.7)), value, rtol=1e-12)


def test_order_by_the_particles_numbers_or_another_unit_changes_nothing():
    rng = np.random.default_rng(5)
    scene = hs.random_gas(300, 0.2, radii=rng.choice([0.5, 0.05], 300, p=[0.3, 0.7]), seed=3)
    value = hs.bond_order(scene).value
    other = rng.permutation(300)
    mixed = scene.replace(positions=scene.positions[other], radii=scene.radii[other])
    assert_allclose(hs.bond_order(mixed).value, value, rtol=1e-10)
    large = scene.replace(positions=8 * scene.positions, radii=8 * scene.radii, box=8 * scene.box)
    assert_allclose(hs.bond_order(large).value, value, rtol=1e-10)


def test_neighbours_in_a_mixture_are_those_of_the_nearest_surfaces():
    """A small disc beside a large one is bound to it, though the centres of six other small ones are nearer.

    The large disc's own six neighbours are six other small ones, so the bond is seen only from the small one.
    """
    from hardspheres.order import _bonds

    def around(radius, angles):
        return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    ring = around(1.11, np.pi / 3 * np.arange(6))
    small = around(1.15, np.array([np.pi / 6]))
    crowd = small + around(0.5, np.pi / 6 + np.linspace(-1.3, 1.3, 6))
    positions = np.concatenate([[[0.0, 0.0]], small, ring, crowd]) + 5
    scene = hs.Scene(positions, 0 * positions, np.array([1.0] + [0.1] * 13), box=(10, 10), boundary="wall")
    i, j = _bonds(scene)
    assert np.any((i == 0) & (j == 1))


def test_one_particle_has_no_bonds():
    with pytest.raises(hs.SceneError, match="one particle only"):
        hs.bond_order(hs.lattice_gas(1, 0.01, seed=1))
