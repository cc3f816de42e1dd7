"""The search is chosen by a word, changes no bit, and is refused where it is impossible."""

import contextlib
import copy
import itertools
import pickle

import numpy as np
import pytest
from scenes import KINDS, SEARCHES, gas, state

import hardspheres as hs
from hardspheres import tuning, windows

DENSE = {
    "3d": {"n": 256, "packing_fraction": 0.49},
    "2d": {"n": 168, "packing_fraction": 0.7},
    "3d_walls": {"n": 256, "packing_fraction": 0.4},
}


def run(scene, search):
    sim = hs.Simulation(scene, search=search)
    sim.run(collisions=2000)
    sim.check()
    return sim


@pytest.mark.parametrize("kind", DENSE)
def test_each_search_gives_the_bits_of_the_other_in_dense_gases(kind):
    """Dilute gases: `test_canonical`. Control: a velocity changed in its last digits gives other bits."""
    scene = hs.lattice_gas(seed=5, **KINDS[kind], **DENSE[kind])
    lists, windows, auto = (run(scene, search) for search in (*SEARCHES, "auto"))
    assert state(lists) == state(windows) == state(auto)
    methods = [sim.status()["method"] for sim in (lists, windows, auto)]
    assert methods == ["neighbour lists", "windows of time", "neighbour lists"]
    velocities = scene.velocities.copy()
    velocities[3, 0] += 1e-15
    assert state(run(scene.replace(velocities=velocities), "windows")) != state(lists)


def at_rest():
    return hs.Scene([[1.0, 1, 1], [3, 3, 3]], np.zeros((2, 3)), box=(9, 9, 9))


def one_fast():
    scene = hs.lattice_gas(n=4000, packing_fraction=0.1, velocities="equal-speeds", seed=1)
    return scene.replace(velocities=np.where(np.arange(4000)[:, None] == 7, 1e6, 1e-6) * scene.velocities)


def narrow(boundary, edge):
    return hs.Scene([[0.5, 0.5, 0.5]], [[0.1, 0.2, 0.0]], box=(9, 9, edge), boundary=boundary)


IMPOSSIBLE = {
    "no particle moves": at_rest,
    "particle 7 is more than 50 times as fast": one_fast,
    "over two of the largest diameter must fit along each periodic axis": lambda: narrow("periodic", 2.2),
    "well over one between walls": lambda: narrow("wall", 1.0),
}


@pytest.mark.parametrize("reason", IMPOSSIBLE)
def test_impossible_windows_are_refused(reason, tmp_path):
    """Before a log is begun, whose older file stays; the other searches take the scene."""
    scene, log = IMPOSSIBLE[reason](), tmp_path / "log.npy"
    log.write_bytes(b"mine")
    with pytest.raises(
        hs.SimulationError, match=f'search="windows" cannot be used here: .*{reason}'
    ) as caught:
        hs.Simulation(scene, search="windows", log=log)
    assert "\n" not in str(caught.value) and log.read_bytes() == b"mine"
    for search in ("auto", "lists"):
        assert "lists" in hs.Simulation(scene, search=search).status()["method"]


def test_boxes_just_large_enough_have_windows():
    """Sibling: a little more room, and nothing is refused."""
    for scene in (narrow("periodic", 2.4), narrow("wall", 1.2)):
        assert hs.Simulation(scene, search="windows").status()["method"] == "windows of time"


def two_that_meet_round_the_box(speed):
    """Head-on in a line along x, for ever, among six at rest beside them."""
    x = np.array(list(itertools.product((0.5, 1.95), repeat=3)))[:, ::-1]
    v = np.zeros((8, 3))
    v[:2, 0] = speed, -speed
    return hs.Scene(x, v, box=(2.9, 2.9, 2.9))


def test_windows_are_so_short_that_none_meet_again_round_a_small_box(monkeypatch):
    """Control: in longer ones two that have collided meet again in the same window, and are not seen."""
    monkeypatch.setattr(windows, "WINDOWS_IN_AN_EPOCH", (4, 6, 8, 12, 16))
    scenes = [two_that_meet_round_the_box(speed) for speed in (1.0, 1.01, 1.02)]
    for scene in scenes:
        assert state(run(scene, "windows")) == state(run(scene, "lists"))
    monkeypatch.setattr(windows, "WINDOWS_IN_AN_EPOCH", (4,))
    monkeypatch.setattr(windows, "ROOM", 1.3)
    with pytest.raises(hs.InvariantError, match="that contact is not stored"):
        run(scenes[1], "windows")


@pytest.mark.parametrize("kind", ["3d", "2d", "3d_walls", "3d_mixture"])
def test_windows_of_any_length_give_the_same_bits_in_small_boxes(kind, monkeypatch):
    """The longest reach from one side of the box to the other: each segment is near its own images."""
    cells = []
    for n, packing_fraction in ((5, 0.1), (12, 0.02), (30, 0.2)):
        scene = gas(kind, n, packing_fraction, seed=n)
        wanted = state(run(scene, "lists"))
        for parts in (1, 2, 4, 8, 16, 32):
            monkeypatch.setattr(windows, "WINDOWS_IN_AN_EPOCH", (parts,))
            with contextlib.suppress(hs.SimulationError):  # too long for this box
                cells.append(windows.windows_for(scene, tuning.epoch_length(scene), "windows").cells[0])
                assert state(run(scene, "windows")) == wanted
    assert 1 in cells and max(cells) > 1


def test_a_copy_searches_in_the_same_way_and_a_checkpoint_in_any(tmp_path):
    sim = hs.Simulation(gas("3d", 60, 0.1, seed=4), search="lists")
    sim.run(collisions=300)
    sim.save(tmp_path / "checkpoint")
    load = hs.Simulation.load
    others = {
        "lists": [copy.copy(sim), copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))],
        "windows": [load(tmp_path / "checkpoint", search="windows"), load(tmp_path / "checkpoint")],
    }
    others["lists"] += [load(tmp_path / "checkpoint", search="lists"), copy.copy(others["lists"][0])]
    sim.run(collisions=500)
    for search, found in others.items():
        for other in found:
            assert search in other.status()["method"]
            other.run(collisions=500)
            assert state(other) == state(sim)
    with pytest.raises(hs.SimulationError, match="search is 'grid'"):
        load(tmp_path / "checkpoint", search="grid")


def test_lists_keep_the_earlier_of_two_contacts_however_close_they_are():
    """Two fly at one at rest from both sides, one of them a few roundings nearer; equal times: the lower id."""
    for at_rest, right, left in itertools.permutations(range(3)):
        for k in range(-12, 13):
            positions, velocities = np.full((3, 3), 1.0), np.zeros((3, 3))
            positions[right, 0], velocities[right, 0] = 1.5 + k * 2.0**-52, -1.0
            positions[left, 0], velocities[left, 0] = 0.5, 1.0
            scene = hs.Scene(positions, velocities, radii=0.125, box=(4.0, 4.0, 4.0))
            simulation = hs.Simulation(scene, search="lists")
            simulation.run(time=2.0**-10)
            at, events = simulation._engine.layout, simulation._engine.arrays.event.reshape(3, -1)
            first = right if k < 0 or (k == 0 and right < left) else left
            assert events[at_rest, at.PARTNER] == first, (at_rest, right, left, k)
            assert events[at_rest, at.TIME] == events[first, at.TIME]
