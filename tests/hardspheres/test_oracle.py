"""The engine executes the events of the all-pairs solver: who with whom, and when, until chaos parts them."""

import mpmath
import numpy as np
import pytest
from oracle import follow
from scenes import KINDS, gas, one_to_ten

import hardspheres as hs
from hardspheres import windows

# Collisions per particle for which the two must agree: a third of the horizon 32 / lambda at which chaos has amplified
# one rounding to a per cent (lambda: van Zon, van Beijeren, Dellago 1998, doi:10.1103/PhysRevLett.80.2035), rounded down.
AGREED = {2: {0.002: 0.8, 0.02: 1.0, 0.1: 3.0, 0.3: 6.0}, 3: {0.002: 1.0, 0.02: 1.5, 0.1: 5.0, 0.3: 8.0}}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("eta", AGREED[3])
def test_same_events_as_the_oracle(kind, eta):
    n = 20
    scene = gas(kind, n, eta, seed=7)
    needed = int(AGREED[scene.dim][eta] * n / 2)
    assert follow(scene, needed) == needed


@pytest.mark.parametrize(("kind", "eta"), [("3d_mixture", 0.01), ("2d_mixture_walls", 0.1)])
def test_large_among_small(kind, eta, monkeypatch):
    splits = windows.splits
    monkeypatch.setattr(windows, "splits", lambda scene: splits(scene)[:1])
    scene = one_to_ten(kind, n=40, large=2, packing_fraction=eta)
    sim = hs.Simulation(scene)
    assert sim._engine.arrays.counter[sim._at.LARGE] == 2
    assert follow(scene, 26) == 26


@pytest.mark.parametrize("kind", ["3d", "2d_mixture_walls"])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_few_particles_in_boxes_too_small_for_cells(kind, n):
    scene = gas(kind, n, 0.15 if n > 2 else 0.05, seed=n)
    assert follow(scene, 40) >= 4


def test_a_box_of_two_diameters():
    """Two spheres in the smallest periodic box: every image of the partner is near."""
    scene = hs.Scene([[0.5, 0.5, 0.5], [1.5, 1.5, 1.5]], [[1.0, 0.3, 0.2], [-0.1, 0.2, 0.5]], box=(2, 2, 2))
    assert follow(scene, 40) >= 8


def test_a_thin_slab():
    """One periodic axis of barely two diameters, the others long: cells on two axes, images on the third."""
    rng = np.random.default_rng(4)
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(6), indexing="ij"), -1).reshape(-1, 2) * 1.7 + 0.85
    positions = np.column_stack([grid, rng.uniform(0, 2.1, len(grid))])
    scene = hs.Scene(positions, rng.normal(size=positions.shape), box=(10.2, 10.2, 2.1))
    assert follow(scene, 40) == 40


def test_against_fifty_digits():
    """The engine follows the true trajectory, not only another one in double precision."""
    with mpmath.workdps(50):
        assert follow(gas("3d", 10, 0.2, seed=3), 20, mpmath.mpf, mpmath.sqrt) == 20


def test_the_comparison_sees_a_broken_rule():
    """Sibling: an oracle whose collisions turn a millionth too little is told apart."""
    from hardspheres.collision import elastic_collision

    def broken(m1, v1, m2, v2, r):
        w1, w2 = elastic_collision(m1, v1, m2, v2, r)
        return [a + 1e-6 * (b - a) for a, b in zip(w1, v1, strict=True)], w2

    assert follow(gas("3d", 20, 0.1, seed=7), 20, collide=broken) < 3
