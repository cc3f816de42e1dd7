"""Events as the kernels predict them: to the last bit, at ties, from long lists. Also as plain Python, in little time."""

import numpy as np
import pytest
from scenes import KINDS, SEARCHES, gas

import hardspheres as hs
from hardspheres import lists


@np.errstate(divide="ignore", invalid="ignore")  # of particles at rest
def follow(sim, collisions=12):
    """`check` solves for all contacts and walls anew, of all pairs at once, without the kernels."""
    for _ in range(4):
        sim.check()
        sim.run(collisions=collisions // 4)
    sim.check()


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("kind", KINDS)
def test_every_stored_event_is_what_the_rows_say(kind, search):
    """One particle rests, and one flies along an axis."""
    scene = gas(kind, 12, 0.03, seed=3)
    velocities = scene.velocities.copy()
    velocities[:2] = 0.0
    velocities[1, 1] = 1.0
    follow(hs.Simulation(scene.replace(velocities=velocities), search=search))


@pytest.fixture
def long_lists(monkeypatch):
    """Neighbour lists that take more than one pass of the prediction."""
    monkeypatch.setattr(lists, "NEIGHBOURS_WANTED", {2: 40.0, 3: 40.0})


@np.errstate(divide="ignore", invalid="ignore")
def searching_lists(scene):
    sim = hs.Simulation(scene, search="lists")
    sim.run(time=2.0**-10)
    at, arrays = sim._at, sim._engine.arrays
    neighbours = arrays.neighbours[: scene.n * arrays.counter[at.LIST_ROOM]].reshape(scene.n, -1)
    assert np.min(np.sum(neighbours < scene.n, axis=1)) > at.LANES
    return sim


def test_neighbours_are_solved_for_in_several_passes(long_lists):
    follow(searching_lists(gas("2d", 50, 0.3, seed=3)), 24)


@np.errstate(divide="ignore", invalid="ignore")
def partner_of(sim, i):
    """The partner in the stored event of i, a little later."""
    sim.run(time=2.0**-10)
    return int(sim._engine.arrays.event[i * sim._at.EVENT + sim._at.PARTNER])


def test_of_two_that_arrive_at_once_the_lower_counts(long_lists):
    """Two discs fly at one that rests between them, whatever the ids, and so the passes in which the two are."""
    grid = np.stack(np.meshgrid(np.arange(7), np.arange(7), indexing="ij"), -1).reshape(-1, 2) * 1.5 + 0.75
    left, middle, right = 3 + 7 * 2, 3 + 7 * 3, 3 + 7 * 4
    velocities = np.zeros_like(grid)
    velocities[[left, right], 0] = 1.0, -1.0
    rng, lower = np.random.default_rng(1), set()
    for _ in range(6):
        order = rng.permutation(len(grid))
        ids = np.argsort(order)  # of the places
        sim = searching_lists(hs.Scene(grid[order], velocities[order], box=(10.5, 10.5)))
        assert partner_of(sim, ids[middle]) == min(ids[left], ids[right])
        lower.add(bool(ids[left] < ids[right]))
    assert lower == {True, False}


@pytest.mark.parametrize("x", [1.0, -1.0])
@pytest.mark.parametrize("y", [1.0, -1.0])
def test_in_a_corner_the_lower_wall_counts(x, y):
    """Walls are n + 2 axis + side; sibling: a little faster along y, and that wall counts."""
    walls = []
    for faster in (1.0, 1.0 + 1e-15):
        scene = hs.Scene(
            [[2.0, 2.0], [3.5, 2.0]],
            [[x, y * faster], [0.0, 0.0]],
            radii=[0.5, 0.25],
            masses=[1.0, 2.0],
            box=(4, 4),
            boundary="wall",
        )
        walls.append(partner_of(hs.Simulation(scene, search="lists"), 0))
    assert walls == [2 + (x > 0), 4 + (y > 0)]


def test_a_contact_counts_before_a_wall():
    """Both after 1/2; sibling: the wall, where it is reached earlier by a rounding."""
    partners = []
    for x in (1.0, 1.0 - 2.0**-53):
        scene = hs.Scene(
            [[x, 2.0], [0.5, 3.25]],
            [[-1.0, 0.0], [0.0, -1.0]],
            radii=[0.5, 0.25],
            masses=[1.0, 2.0],
            box=(4, 6),
            boundary="wall",
        )
        partners.append(partner_of(hs.Simulation(scene, search="lists"), 0))
    assert partners == [1, 2]


def test_where_nothing_moves_nothing_comes():
    scene = gas("3d_walls", 5, 0.03, seed=3)
    sim = hs.Simulation(scene.replace(velocities=np.zeros((5, 3))))
    assert {partner_of(sim, i) for i in range(5)} == {sim._at.NOTHING}
