"""Few large particles among many small ones: the windows' second grid finds what lists and one grid find, and pays."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scenes import one_to_ten, state

import hardspheres as hs
from hardspheres import windows
from hardspheres.tuning import epoch_length

COLLISIONS = 4000
UNEQUAL = {
    "3d_mixture": 0.25,
    "2d_mixture_walls": 0.3,
}  # kinds that other tests compile anyway, and packing fractions


def run(scene, search="auto"):
    sim = hs.Simulation(scene, search=search)
    sim.run(collisions=COLLISIONS)
    return sim


@pytest.fixture(scope="module", params=UNEQUAL)
def scene(request):
    return one_to_ten(request.param, packing_fraction=UNEQUAL[request.param])


@pytest.fixture(scope="module")
def expected(scene):
    sim = run(scene, "lists")
    assert "lists" in sim.status()["method"]
    return state(sim)


def large_ones(sim):
    return int(sim._engine.arrays.counter[sim._at.LARGE])


def test_the_large_have_their_own_grid_by_themselves(scene, expected):
    sim = run(scene)
    assert large_ones(sim) == 15
    sim.check()
    assert sim.status()["late_events"] == 0
    assert abs(sim.energy_drift) < 1e-13
    assert state(sim) == expected


def test_one_grid_for_all_gives_the_same_bits(scene, expected, monkeypatch):
    splits = windows.splits
    monkeypatch.setattr(windows, "splits", lambda scene: splits(scene)[-1:])
    sim = run(scene, "windows")
    assert "windows" in sim.status()["method"]
    assert large_ones(sim) == 0
    assert state(sim) == expected


def test_without_the_second_grid_spheres_overlap(scene, expected):
    """Sibling: the large ones left out of the comparison are flown through."""
    sim = hs.Simulation(scene)
    sim._engine.arrays.large[1:] = sim._engine.search.large[0]  # of all large ones only the first is compared
    sim.run(collisions=COLLISIONS)
    assert state(sim) != expected
    with pytest.raises(hs.InvariantError, match="overlap"):
        sim.check()


@pytest.mark.parametrize("speeds", [0.7, 5.0])
def test_pieces_of_flights_change_nothing(scene, expected, speeds, monkeypatch):
    monkeypatch.setattr(windows, "SPEEDS", (speeds,))
    sim = run(scene)
    assert large_ones(sim) == 15
    assert state(sim) == expected


def test_too_little_room_changes_nothing(scene, expected):
    """Room for fewer new lines than there are large particles, and for few pairs of lines."""
    sim = hs.Simulation(scene)
    e, at = sim._engine, sim._at
    e.arrays.counter[at.OVERFLOW_ROOM], e.arrays.counter[at.NEAR_ROOM] = 3, 1
    e.arrays = e.arrays._replace(**e._searching_arrays(e.arrays.counter))
    sim.run(collisions=COLLISIONS)
    assert e.arrays.counter[at.OVERFLOW_ROOM] >= 15
    assert state(sim) == expected


def test_searching_anew_at_any_moment_changes_nothing(scene, expected):
    sim = hs.Simulation(scene)
    for _ in range(10):
        sim.run(collisions=COLLISIONS // 10)
        sim._engine._afresh = True
    assert state(sim) == expected


def test_a_spread_of_sizes_is_divided_too():
    """A long tail of sizes: some are large, and the bits are those of the lists."""
    rng = np.random.default_rng(3)
    radii = 0.5 * rng.pareto(2.5, 1000).clip(0.0, 8.0) + 0.3
    scene = hs.random_gas(n=1000, packing_fraction=0.15, radii=radii, masses=radii, seed=2)
    sim = run(scene)
    assert 0 < large_ones(sim) < 500
    assert state(run(scene, "lists")) == state(sim)


def test_equal_or_nearly_equal_sizes_are_not_divided():
    for radii in (0.5, np.where(np.arange(1000) % 2, 0.5, 0.45)):
        scene = hs.random_gas(n=1000, packing_fraction=0.05, radii=radii, seed=2)
        plan = windows.windows_for(scene, epoch_length(scene))
        assert plan.small_radius == scene.radii.max()


PLAIN_PYTHON = """
import hashlib, sys
sys.path.insert(0, {tests!r})
import hardspheres as hs
from hardspheres import windows
from scenes import one_to_ten
splits = windows.splits
windows.splits = lambda scene: splits(scene)[:1]
digest = hashlib.sha256()
for kind, eta in (("3d_mixture", 0.01), ("2d_mixture_walls", 0.1)):
    sim = hs.Simulation(one_to_ten(kind, n=60, large=2, packing_fraction=eta))
    assert sim._engine.arrays.counter[sim._at.LARGE] == 2
    sim.run(collisions=40)
    digest.update(sim._engine.rows.tobytes() + sim._engine.arrays.total.tobytes())
print(digest.hexdigest())
"""


def test_plain_python_gives_the_same_bits():
    """On arrays with their bounds checked, too: no index leaves its array."""
    program = PLAIN_PYTHON.format(tests=os.path.dirname(os.path.dirname(__file__)))
    outputs = [
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"NUMBA_DISABLE_JIT": flag},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for flag in ("0", "1")
    ]
    assert outputs[0] == outputs[1]


@pytest.mark.parametrize("eta", [0.001, 0.01, 0.1, "unequal"])
def test_windows_that_are_not_looked_at_cost_more(eta, scene, monkeypatch):
    """Control: not all of them are looked at."""
    gas = scene if eta == "unequal" else hs.lattice_gas(n=500, packing_fraction=eta, seed=3)
    epoch, looked_at, kind = epoch_length(gas), [], windows.Windows
    monkeypatch.setattr(windows, "Windows", lambda *a: looked_at.append(a) or kind(*a))
    found = windows.cheapest_windows(gas, epoch)
    frequency, rms = windows.collision_frequency(gas), looked_at[0][2]
    costs = []
    for radius in windows.splits(gas):
        share = windows.share_of_large(gas, radius)
        for length in (epoch / parts for parts in windows.WINDOWS_IN_AN_EPOCH):
            each = kind(gas, length, rms, windows.SPEEDS[0], radius)
            if each.possible:
                costs.append((each.cost(frequency, share), length, radius))
    assert (found.length, found.small_radius) == min(costs)[1:]
    assert len(looked_at) < len(windows.splits(gas)) * len(windows.WINDOWS_IN_AN_EPOCH)
