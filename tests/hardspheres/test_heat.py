"""The tallied heat flux: an identity to rounding, the same bits in both searches, and nothing else changed."""

import copy

import numpy as np
import pytest
from scenes import SEARCHES, WITH_HEAT, gas, state_without_flights

import hardspheres as hs
from hardspheres.archive import read_archive, write_archive


def total(t):
    return t.heat_transfer + t.heat_flux


def energy_moment(positions, velocities, masses):
    """Sum of x E."""
    return (0.5 * masses * (velocities**2).sum(axis=1)) @ positions


def cluster(kind="3d", **more):
    """A gas in the middle of a large box, which its particles do not reach the sides of."""
    inner = gas(kind, 60, 0.1, seed=2, **more)
    return inner.replace(positions=inner.positions + 100.0, box=(200.0,) * inner.dim)


def test_what_flows_moves_the_centre_of_energy():
    """sum x E changes by flux and transfer, to rounding. Sibling: by the flux alone it does not."""
    scene = cluster()
    sim = hs.Simulation(scene, heat=True, search="lists")
    sim.run(time=4.0)
    change = energy_moment(sim.unwrapped_positions, sim.velocities, scene.masses)
    change = change - energy_moment(scene.positions, scene.velocities, scene.masses)
    assert sim.collisions > 30
    assert total(sim.tallies) == pytest.approx(change, abs=1e-9)
    assert np.abs(sim.tallies.heat_flux - change).min() > 1.0


SLOW = [
    ("2d_mixture_walls", "lists"),
    ("3d_mixture", "windows"),
]  # discs and spheres, walls and none, both searches
OTHERS = [(kind, search) for kind in ("2d_mixture_walls", "3d_mixture", "2d") for search in SEARCHES]


@pytest.mark.parametrize(
    ("kind", "search"),
    [
        *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW),
        *(pytest.param(*case, marks=pytest.mark.long) for case in OTHERS if case not in SLOW),
    ],
)
def test_so_it_does_with_several_masses_and_with_walls(kind, search):
    scene = gas(kind, 60, 0.05, seed=2) if "walls" in kind else cluster(kind)
    sim = hs.Simulation(scene, heat=True, search=search)
    sim.run(time=40.0 if "walls" in kind else 4.0)
    change = energy_moment(sim.unwrapped_positions, sim.velocities, scene.masses)
    change = change - energy_moment(scene.positions, scene.velocities, scene.masses)
    assert sim.collisions > 30 and (sim.wall_collisions > 100 or "walls" not in kind)
    assert total(sim.tallies) == pytest.approx(change, abs=1e-8)


@pytest.fixture(scope="module")
def runs():
    """The same run with either search."""
    found = []
    for kind, search in WITH_HEAT:
        sim = hs.Simulation(gas(kind, 200, 0.1, seed=3), heat=True, search=search)
        sim.run(collisions=4000)
        sim.run(time=sim.time / 3)
        found.append(sim)
    return found


def bits(sim):
    t = sim.frame().tallies
    return t.heat_transfer.tobytes(), t.heat_flux.tobytes(), sim._engine.arrays.total.tobytes()


def test_both_searches_tally_the_same_bits(runs):
    lists, windows = runs
    assert bits(lists) == bits(windows)
    assert np.all(lists.tallies.heat_transfer != 0.0)


def test_tallying_changes_nothing_else(runs):
    plain = hs.Simulation(gas("3d", 200, 0.1, seed=3), search="lists")
    plain.run(collisions=4000)
    plain.run(time=plain.time / 3)
    own, at = state_without_flights(runs[0]), runs[0]._at
    other = state_without_flights(plain)
    assert own[0] == other[0] and own[2:] == other[2:]
    assert own[1][: 8 * at.HEAT_TRANSFER] == other[1][: 8 * at.HEAT_TRANSFER]
    assert runs[0].tallies.virial.tobytes() == plain.tallies.virial.tobytes()
    assert plain.tallies.heat_flux is None and plain.frame().tallies.heat_transfer is None


def test_tallies_begin_anew_and_frames_go_on(runs):
    sim = copy.deepcopy(runs[0])
    before, at_reset = sim.frame().tallies, sim.time
    sim.reset_tallies()
    sim.run(time=3.0)
    since, whole = sim.tallies, sim.frame().tallies
    assert since.time == pytest.approx(sim.time - at_reset)
    assert total(whole) - total(before) == pytest.approx(total(since), abs=1e-9)
    assert np.abs(total(since)).max() > 0.1


def test_saved_and_loaded_it_goes_on_with_the_same_bits(runs, tmp_path):
    sim = copy.copy(runs[0])
    sim.save(tmp_path / "a.npz")
    again = hs.Simulation.load(tmp_path / "a.npz")
    sim.run(collisions=300)
    again.run(collisions=300)
    assert bits(again) == bits(sim)


def test_impossible_ones_are_refused(runs, tmp_path):
    falling = gas("3d_walls", 32, 0.05).replace(gravity=(0.0, -1.0, 0.0))
    with pytest.raises(hs.SimulationError, match="under gravity they change all the time; leave heat out"):
        hs.Simulation(falling, heat=True)
    obstacle = gas("3d", 32, 0.05)
    still = np.arange(32) == 0
    obstacle = obstacle.replace(
        masses=np.where(still, np.inf, 1.0), velocities=np.where(still[:, None], 0.0, obstacle.velocities)
    )
    with pytest.raises(hs.SimulationError, match="an obstacle takes none; leave heat out"):
        hs.Simulation(obstacle, heat=True)
    with pytest.raises(hs.SimulationError, match="heat is 'yes'; it must be True or False"):
        hs.Simulation(gas("3d", 32, 0.05), heat="yes")
    runs[0].save(tmp_path / "a.npz")
    arrays = read_archive(tmp_path / "a.npz")
    text = arrays["about"].tobytes().replace(b'"heat": true', b'"heat": 1')
    write_archive(tmp_path / "b.npz", arrays | {"about": np.frombuffer(text, dtype=np.uint8)})
    with pytest.raises(hs.CheckpointError, match="whether it tallies heat is neither true nor false"):
        hs.Simulation.load(tmp_path / "b.npz")
    text = arrays["about"].tobytes().replace(b'"heat": true', b'"heat": false')
    write_archive(tmp_path / "c.npz", arrays | {"about": np.frombuffer(text, dtype=np.uint8)})
    with pytest.raises(hs.CheckpointError):
        hs.Simulation.load(tmp_path / "c.npz")
