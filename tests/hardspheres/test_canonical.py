"""Bitwise promises: looking, stopping, searching differently, and scaling by powers of two leave every bit as it was."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import KINDS, SEARCHES, gas, state

import hardspheres as hs
from hardspheres import engine, lists, tuning, windows

COLLISIONS = 3000


def run(scene, collisions=COLLISIONS, search="auto"):
    sim = hs.Simulation(scene, search=search)
    sim.run(collisions=collisions)
    return sim


@pytest.fixture(scope="module", params=KINDS)
def scene(request):
    return gas(request.param, 500, 0.1, seed=5)


@pytest.fixture(scope="module")
def expected(scene):
    sim = run(scene, search="lists")
    assert "lists" in sim.status()["method"]
    return state(sim)


@pytest.fixture(params=SEARCHES)
def search(request):
    return request.param


def test_every_search_gives_the_same_bits(scene, expected, search):
    sim = run(scene, search=search)
    assert search in sim.status()["method"]
    assert state(sim) == expected == state(run(scene, search="auto"))


def test_a_changed_bit_is_seen(scene, expected):
    """Sibling: one velocity changed in its last digits gives another state."""
    velocities = scene.velocities.copy()
    velocities[3, 0] += 1e-15
    assert state(run(scene.replace(velocities=velocities))) != expected


def test_looking_changes_nothing(scene, expected, search):
    sim = hs.Simulation(scene, search=search)
    for _ in sim.frames(collisions_per_particle=np.linspace(0, 2 * COLLISIONS / scene.n, 37)):
        sim.check()
        repr(sim)
        _ = sim.tallies, sim.positions, sim.unwrapped_positions, sim.momentum, sim.to_scene()
    assert state(sim) == expected


@settings(max_examples=15)
@given(cuts=st.lists(st.floats(0.0, 1.0), max_size=12))
def test_any_set_of_stops_gives_the_same_bits(cuts):
    scene = gas("3d", 60, 0.1, seed=2)
    whole = hs.Simulation(scene)
    whole.run(time=8.0)
    parts = hs.Simulation(scene)
    for frame in parts.frames(times=[8.0 * cut for cut in sorted(cuts)] + [8.0]):
        assert np.array_equal(frame.scene.box, scene.box)
    assert state(parts) == state(whole)
    assert parts.time == whole.time == 8.0
    assert np.array_equal(parts.positions, whole.positions)


@pytest.mark.parametrize("wanted", [4.0, 30.0])
def test_the_width_of_the_shells_changes_nothing(scene, expected, wanted, monkeypatch):
    usual = hs.Simulation(scene, search="lists").status()["shell"]
    monkeypatch.setattr(lists, "NEIGHBOURS_WANTED", {2: wanted, 3: wanted})
    sim = run(scene, search="lists")
    assert state(sim) == expected
    assert sim.status()["shell"] != usual


@pytest.mark.parametrize(("patience", "often"), [(1e-9, True), (1e6, False)])
def test_renewing_all_lists_at_once_changes_nothing(scene, expected, patience, often, monkeypatch):
    """Whenever one list has been renewed, or, sibling, at the beginning of epochs only."""
    monkeypatch.setattr(lists, "REBUILT_SINGLY", patience)
    sim = hs.Simulation(scene, search="lists")
    for _ in range(5):
        sim.run(collisions=COLLISIONS // 5)
        sim.check()
    assert state(sim) == expected
    count = sim._engine.arrays.counter
    assert (count[sim._at.REBUILDS_OF_ALL] > 2 * count[sim._at.EPOCH] + 2) is np.bool_(often)


@pytest.mark.parametrize("speeds", [0.7, 5.0])
def test_the_length_of_the_pieces_changes_nothing(scene, expected, speeds, monkeypatch):
    """Flights registered in many pieces, or in ones so long that others lie many cells away."""
    length = tuning.epoch_length(scene)
    usual = windows.windows_for(scene, length, "windows").half_length
    monkeypatch.setattr(windows, "SPEEDS", (speeds,))
    assert windows.windows_for(scene, length, "windows").half_length != usual
    assert state(run(scene, search="windows")) == expected


def test_naming_the_image_changes_nothing(scene, expected):
    """Lists that name the periodic image, needed in small boxes only, give what the nearest image gives."""
    sim = hs.Simulation(scene, search="lists")
    at, e = sim._at, sim._engine
    assert e.arrays.counter[at.IMAGES] == 0
    e.arrays.counter[at.IMAGES] = 1
    e.arrays = e.arrays._replace(**e._searching_arrays(e.arrays.counter))
    sim.run(collisions=COLLISIONS)
    assert state(sim) == expected


def test_running_out_of_room_changes_nothing(scene, expected, search):
    """Lists, cells, lines, candidates and calendar that begin far too small grow on the way."""
    sim = hs.Simulation(scene, search=search)
    at, e = sim._at, sim._engine
    small = (
        {at.LIST_ROOM: at.LANES}
        if search == "lists"
        else {at.SEGMENT_ROOM: 10, at.CONTACT_ROOM: 2, at.OVERFLOW_ROOM: 7, at.NEAR_ROOM: 1}
    )
    small |= {at.HEAP_ROOM: 2}
    for slot, room in small.items():
        e.arrays.counter[slot] = room
    e.arrays.counter[at.BLOCKS] = 4
    e.arrays = e.arrays._replace(**e._searching_arrays(e.arrays.counter))
    sim.run(collisions=COLLISIONS)
    assert state(sim) == expected
    grown = {slot for slot, room in small.items() if e.arrays.counter[slot] > room}
    assert grown >= ({at.LIST_ROOM} if search == "lists" else {at.SEGMENT_ROOM, at.CONTACT_ROOM})


def test_fetching_ahead_changes_nothing(scene, expected, search, monkeypatch):
    monkeypatch.setattr(engine, "CACHED", 0)
    monkeypatch.setattr(engine, "CACHED_AT_ALL", 0)
    sim = run(scene, search=search)
    assert all(sim._engine.arrays.counter[at] for at in (sim._at.BEYOND_CACHE, sim._at.BEYOND_ALL))
    assert state(sim) == expected


def test_a_crowded_cell_changes_nothing():
    """A droplet in a large box: some cells hold many times what they were made for."""
    droplet = hs.lattice_gas(n=300, packing_fraction=0.4, seed=5)
    box = 4.0 * droplet.box
    scene = hs.Scene(droplet.positions + droplet.box, droplet.velocities, 0.5, 1.0, box, "periodic")
    sim = hs.Simulation(scene, search="lists")
    room = sim._engine.arrays.counter[sim._at.CELL_ROOM]
    sim.run(collisions=COLLISIONS)
    assert sim._engine.arrays.counter[sim._at.CELL_ROOM] > room
    assert state(run(scene, search="windows")) == state(sim)


def test_searching_anew_at_any_moment_changes_nothing(scene, expected, search):
    """Everything but the rows can be thrown away: what a restart will rely on."""
    sim = hs.Simulation(scene, search=search)
    for _ in range(10):
        sim.run(collisions=COLLISIONS // 10)
        sim._engine._afresh = True
    assert state(sim) == expected


@pytest.mark.parametrize(("length", "time"), [(2.0, 1.0), (0.25, 1.0), (1.0, 4.0), (1024.0, 0.5)])
def test_scaling_by_powers_of_two_is_exact(scene, length, time, search):
    sim = run(scene, search=search)
    scaled = run(
        hs.Scene(
            scene.positions * length,
            scene.velocities * length / time,
            scene.radii * length,
            scene.masses,
            scene.box * length,
            scene.boundary,
        ),
        search=search,
    )
    assert np.array_equal(scaled.positions, sim.positions * length)
    assert np.array_equal(scaled.velocities, sim.velocities * (length / time))
    assert scaled.time == sim.time * time


PLAIN_PYTHON = """
import sys
import hashlib
sys.path.insert(0, {tests!r})
from scenes import KINDS, gas, state
import hardspheres as hs
digest = hashlib.sha256()
for kind in KINDS:
    for n, eta in ((10, 0.2), (40, 0.05)):
        sim = hs.Simulation(gas(kind, n, eta, seed=3))
        sim.run(collisions=60)
        digest.update(sim._engine.rows.tobytes() + sim._engine.arrays.total.tobytes())
print(digest.hexdigest())
"""


def test_the_kernels_run_as_plain_python_with_the_same_bits():
    """Without Numba the same source works on bounds-checked arrays: keeps the compiled code honest."""
    program = PLAIN_PYTHON.format(tests=os.path.dirname(os.path.dirname(__file__)))
    outputs = [
        subprocess.run(
            [sys.executable, "-W", "error", "-c", program],
            env=os.environ | {"NUMBA_DISABLE_JIT": flag},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for flag in ("0", "1")
    ]
    assert outputs[0] == outputs[1]


def golden_scene():
    """27 discs or spheres on a grid, with velocities built from integers: the same on every machine."""
    k = np.arange(27)
    positions = np.stack([k % 3, k // 3 % 3, k // 9], axis=1) * 1.5 + 0.75
    velocities = np.stack([(7 * k + 3) % 11 - 5, (5 * k + 1) % 13 - 6, (3 * k + 2) % 7 - 3], axis=1) / 8.0
    masses = 1.0 + (k % 4) / 2
    return hs.Scene(
        positions,
        velocities,
        0.5 - (k % 2) / 16,
        masses,
        (4.5, 4.5, 4.5),
        ("periodic", "periodic", "periodic"),
    )


def test_golden_checksum():
    """The bits of a stored trajectory: a change of arithmetic, or of the machine's, shows here; the changelog says when."""
    sim = run(golden_scene(), 500)
    digest = hashlib.sha256(sim.velocities.tobytes() + sim.positions.tobytes()).hexdigest()
    assert digest[:16] == "199d5320a3c28a55"


def test_signs_of_zero_do_not_depend_on_the_search():
    """Flights along the rows of a grid: the same bits by lists and windows, and with zeros of either sign."""
    grid = np.stack(np.meshgrid(*[1.5 + 3.0 * np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    along = np.random.default_rng(5).normal(size=len(grid))
    bits = set()
    for zero in (0.0, -0.0):
        scene = hs.Scene(grid, np.column_stack([along, np.full((len(grid), 2), zero)]), box=(9, 9, 9))
        for search in SEARCHES:
            sim = run(scene, 100, search)
            bits.add((state(sim), sim.velocities.tobytes()))
    assert len(bits) == 1
    assert np.all(sim.velocities[:, 1:] == 0.0) and not np.any(np.signbit(sim.velocities[:, 1:]))
