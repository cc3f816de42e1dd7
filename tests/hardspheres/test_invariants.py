"""Energy, momentum and no overlap over long runs, at every density and boundary: to round-off.

Default tests: some ten thousand collisions each, on the specialisations that other tests compile anyway. Slow: 2e6 each.
Long: 1e7 each.
"""

from typing import NamedTuple

import numpy as np
import pytest

import hardspheres as hs
from hardspheres.invariants import allowed_drift

EPS = float(np.finfo(np.float64).eps)


class Case(NamedTuple):
    """A gas to run."""

    dim: int
    packing_fraction: float
    boundary: str | tuple[str, ...]
    mixture: bool = False
    n: int = 4000


MIXED = ("periodic", "wall", "periodic")
SLOW = [
    Case(3, 0.01, "wall"),
    Case(3, 0.1, "periodic"),
    Case(3, 0.3, MIXED),
    Case(3, 0.45, "wall"),
    Case(3, 0.49, "periodic"),
    Case(2, 0.01, ("wall", "periodic")),
    Case(2, 0.1, "wall"),
    Case(2, 0.4, "periodic"),
    Case(2, 0.65, "wall"),
    Case(3, 0.1, "periodic", mixture=True),
    Case(3, 0.1, "wall", mixture=True),
    Case(2, 0.1, ("periodic", "wall"), mixture=True),
]
MINIATURES = [
    Case(3, 0.01, "periodic", n=500),
    Case(3, 0.49, "periodic", n=500),
    Case(3, 0.3, MIXED, n=500),
    Case(3, 0.1, "periodic", mixture=True, n=300),
    Case(2, 0.1, "wall", mixture=True, n=300),
    Case(2, 0.65, "periodic", n=500),
]


def gas(case):
    """Lattice start (fcc, triangular), a mixture of diameters 1:5 and masses 1:100 at random; Maxwell velocities."""
    options = {
        "n": case.n,
        "packing_fraction": case.packing_fraction,
        "dim": case.dim,
        "boundary": case.boundary,
        "seed": 11,
    }
    if case.mixture:
        large = np.arange(case.n) % 4 == 0
        return hs.random_gas(**options, radii=np.where(large, 2.5, 0.5), masses=np.where(large, 100.0, 1.0))
    return hs.lattice_gas(**options)


def run_and_check(case, collisions, samples):
    """Assert the invariants at every sample of a run; returns the simulation."""
    sim = hs.Simulation(gas(case))
    for _ in range(samples):
        sim.run(collisions=collisions // samples)
        assert abs(sim.energy_drift) < 1e-12
        assert np.max(np.abs(sim.momentum_drift)) < 1e-12
        assert sim.worst_overlap < 1e-11
        sim.check()
    assert sim.status()["late_events"] == 0
    return sim


@pytest.mark.parametrize("case", MINIATURES, ids=str)
def test_invariants(case):
    sim = run_and_check(case, 40_000, 4)
    assert abs(sim.energy_drift) < 2e-14


@pytest.mark.parametrize("case", SLOW, ids=str)
@pytest.mark.parametrize(
    "collisions",
    [pytest.param(2 * 10**6, marks=pytest.mark.slow), pytest.param(10**7, marks=pytest.mark.long)],
)
def test_invariants_over_millions_of_collisions(case, collisions):
    """In the slow tier ten million of a million spheres, too; see below."""
    run_and_check(case, collisions, 10)


@pytest.mark.slow
def test_a_million_spheres():
    """Ten million collisions of a million spheres at packing fraction 0.3, in a few hundred bytes each."""
    sim = hs.Simulation(hs.lattice_gas(n=1_000_000, packing_fraction=0.3, seed=1))
    sim.run(collisions=10**7)
    sim.check()
    status = sim.status()
    print(f"bytes per particle: {status['bytes_per_particle']:.0f}")
    assert status["late_events"] == 0
    assert status["bytes_per_particle"] < 600


def test_the_check_sees_one_bad_collision():
    """Sibling: a single velocity off by 1e-9 in a gas of 500 breaks energy and momentum beyond the limits."""
    sim = run_and_check(MINIATURES[0], 1000, 1)
    sim._engine.arrays.row[sim._at.V] += 1e-9
    assert abs(sim.energy_drift) > 1e-12
    assert np.max(np.abs(sim.momentum_drift)) > 1e-12
    with pytest.raises(hs.InvariantError):
        sim.check()


def nearly_touching():
    """Six spheres 3e-12 diameters apart between a wall and their own images: the same bonds collide over and over."""
    apart = 1 + 3e-12
    grid = np.stack(
        np.meshgrid(*[(np.arange(k) + 0.5) * apart for k in (3, 2, 1)], indexing="ij"), -1
    ).reshape(-1, 3)
    velocities = np.random.default_rng(365).normal(size=grid.shape)
    return hs.Scene(grid, velocities, box=(3 * apart, 2 * apart + 1, 2 * apart), boundary=MIXED)


def test_bonds_that_hardly_turn_lose_energy_one_way_and_check_knows_how_much():
    """A right run, which half a unit in the last place for each event of a particle would not allow."""
    sim = hs.Simulation(nearly_touching())
    sim.run(collisions=80_000)
    sim.check()
    assert sim.energy_drift < -max(1e-12, 0.5 * EPS * (sim.collisions + sim.wall_collisions) / 6)
    allowed = allowed_drift(sim, sim.collisions)
    assert allowed < 12 * -sim.energy_drift
    # Sibling: an energy that is off by more than that is seen.
    sim._energy *= 1 + 1.01 * allowed
    with pytest.raises(hs.InvariantError, match="kinetic energy changed"):
        sim.check()


def test_what_is_allowed_follows_from_collisions_and_those_who_share_the_energy():
    sim = hs.Simulation(hs.lattice_gas(n=500, packing_fraction=0.3, seed=1))
    assert allowed_drift(sim, 0) == allowed_drift(sim, 10**5) == 1e-12
    assert allowed_drift(sim, 10**9) == pytest.approx(4 * EPS * 10**9 / 500, rel=0.15)
    few = sim.scene.velocities * (np.arange(500) < 5)[:, None]
    one = hs.Simulation(sim.scene.replace(velocities=few))
    assert 50 < allowed_drift(one, 10**9) / allowed_drift(sim, 10**9) < 200
    assert allowed_drift(hs.Simulation(sim.scene.replace(velocities=0 * few)), 0) == 1e-12
