"""The kernels never leave their arrays: run as plain Python on arrays that refuse every index outside, negative ones too."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

PRELUDE = """
import json, sys
sys.path.insert(0, {tests!r})
from scenes import KINDS, gas
import numpy as np
import hardspheres as hs
from hardspheres import engine, lists
"""

EVERY_KIND = """
seen = {{}}
for kind, cached in [(kind, cached) for kind in {kinds} for cached in (0, 1000)]:
    engine.CACHED = engine.CACHED_AT_ALL = cached
    for n, eta, search, wanted in ((10, 0.2, "lists", 12), (30, 0.02, "lists", 1), (10, 0.02, "windows", 0)):
        lists.NEIGHBOURS_WANTED = {{2: wanted, 3: wanted}}
        sim = hs.Simulation(gas(kind, n, eta, seed=3), search=search)
        sim.run(collisions={collisions})
        seen[kind, cached, n, eta, sim.status()["method"]] = [sim.collisions, float(abs(sim.energy_drift))]
print(json.dumps(list(seen.items())))
"""

LITTLE_ROOM = """
grown = []
for search in ("lists", "windows"):
    sim = hs.Simulation(gas("3d_mixture", 20, 0.1, seed=3), search=search)
    at, e = sim._at, sim._engine
    small = {at.HEAP_ROOM: 2, at.LIST_ROOM: at.LANES, at.CELL_ROOM: at.CELL_LANES}
    if search == "windows":
        small = {at.HEAP_ROOM: 2, at.SEGMENT_ROOM: 10, at.CONTACT_ROOM: 2, at.OVERFLOW_ROOM: 7, at.NEAR_ROOM: 1}
    for slot, room in small.items():
        e.arrays.counter[slot] = room
    e.arrays.counter[at.BLOCKS] = 4
    e.arrays = e.arrays._replace(**e._searching_arrays(e.arrays.counter))
    sim.run(collisions=20)
    grown.append(sum(int(e.arrays.counter[slot]) > room for slot, room in small.items()))
print(json.dumps(grown))
"""

GROWTH = """
from hardspheres.engine import Engine
pairs = []
for kind in ("3d", "2d_mixture_walls"):
    engine = Engine(gas(kind, 10, 0.2, seed=3), growth=(0.9, 0.01))
    engine.run(2**62, 0.0, 20, 10**6)
    pairs.append(int(engine.arrays.counter[engine.layout.PAIRS]))
print(json.dumps(pairs))
"""

ONE_TOO_SHORT = """
short = []
for search, names in (
    ("lists", ("event", "neighbours", "images", "cell_ids", "cell_places", "near", "blocks", "scratch")),
    ("windows", ("order", "unsorted", "segments", "boxes", "cell_of_segment", "column", "pair_slot", "pair_own", "passed", "changed", "version")),
):
    for name in names:
        sim = hs.Simulation(gas("3d", 10, 0.02, seed=3), search=search)
        e = sim._engine
        whole = getattr(e.arrays, name)
        e.arrays = e.arrays._replace(**{name: whole[:1]})
        try:
            sim.run(collisions=20)
        except IndexError:
            short.append(name)
print(json.dumps(short))
"""


AMONG_OBSTACLES = """
sys.path.insert(0, {root!r})
from tests.hardspheres.test_obstacles import maze
np.seterr(divide="ignore", invalid="ignore")  # compiled, 1/0 is infinity: the time of what is at rest to a wall
seen = []
for pull, search, logs in ((0, "lists", True), (0, "windows", False), (-1, "lists", False), (-1, "lists", True)):
    scene, chunks = maze(1, n=6, obstacles=8, edge=20.0, boundary=("periodic", "wall")), []
    scene = scene.replace(gravity=(0, pull))
    options = {{"log": chunks.append, "free_paths": pull == 0}} if logs else {{}}
    sim = hs.Simulation(scene, search=search, **options)
    sim.run(collisions=40)
    sim.check()
    flights = 0
    if logs and not pull:
        pairs = np.concatenate(chunks)
        pairs = pairs[pairs["j"] < scene.n]
        fixed = scene.obstacles[np.stack([pairs["i"], pairs["j"]], axis=1)]
        flights = int(np.sum(np.isfinite(pairs["free_path"][fixed])))
        assert fixed.any() and np.sum(fixed) == sim.obstacle_collisions
        paths = sim.free_paths
        assert int(np.sum(paths.flights + paths.first_flights)) == 80 - sim.obstacle_collisions
        assert paths.flights[scene.species[scene.obstacles]].sum() == 0
    seen.append([sim.collisions, sim.obstacle_collisions, flights, float(abs(sim.energy_drift))])
print(json.dumps(seen))
"""

FITS = """
from types import SimpleNamespace
from hardspheres.kernel import specialise
at = specialise(2, False, False, False, True).at
fits = sys.modules["hardspheres.kernel.2d_sparse.dilute.grid"].fits
wrong = 0
for cells in range(1, 7):
    for width in (42, 66, 85):
        counter = np.zeros(at.COUNTERS, dtype=np.int64)
        counter[at.CELLS : at.CELLS + 3], counter[at.WIDTH : at.WIDTH + 2] = (cells, 9, 1), (width, 20)
        counter[at.OVERHANG : at.OVERHANG + 2] = 21
        for middle in range(0, cells * width, 3):
            for half in (2, 20):
                ends = (middle - half, 85, 0, -(middle + half), -95, 0)
                word = sum((end & 255) << 8 * k for k, end in enumerate(ends))
                for x in range(cells):
                    inside = x * width - 21 <= middle - half and middle + half <= (x + 1) * width + 21
                    wrong += fits(SimpleNamespace(counter=counter), word, x * 9 + 4, middle // width, 4, 0) != inside
print(json.dumps(int(wrong)))
"""


def checked(program, jit=False):
    """Run a program with bounds checks in a fresh interpreter; returns the JSON that it prints."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env=os.environ | {"NUMBA_DISABLE_JIT": str(int(not jit)), "NUMBA_BOUNDSCHECK": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def with_prelude(program):
    return PRELUDE.format(tests=str(Path(__file__).parent.parent)) + program


def test_no_kernel_leaves_its_arrays():
    seen = checked(with_prelude(EVERY_KIND.format(kinds="KINDS", collisions=20)))
    assert len(seen) == 30
    names = {"windows of time", "neighbour lists", "neighbour lists that name the image"}
    assert {method for (*_, method), _ in seen} == names
    assert all(collisions == 20 and drift < 1e-13 for _, (collisions, drift) in seen)


@pytest.mark.long
def test_no_compiled_kernel_leaves_its_arrays():
    """The same compiled with checks, ten minutes for one kind: what vectors and inlining do to the code is seen, too."""
    seen = checked(with_prelude(EVERY_KIND.format(kinds="['3d']", collisions=100_000)), jit=True)
    assert len(seen) == 6
    assert all(collisions == 100_000 and drift < 1e-11 for _, (collisions, drift) in seen)


def test_nor_while_room_is_short():
    grown = checked(with_prelude(LITTLE_ROOM))
    assert min(grown) >= 1


def test_nor_while_spheres_grow():
    assert checked(with_prelude(GROWTH)) == [20, 20]


def test_nor_among_obstacles():
    """With and without gravity and a log; obstacles have no free flights in it, and in no tally."""
    root = str(Path(__file__).parents[2])
    seen = checked(with_prelude(AMONG_OBSTACLES.format(root=root)))
    assert len(seen) == 4
    for collisions, with_obstacles, flights, drift in seen:
        assert collisions == 40 and 10 < with_obstacles < 40 and flights == 0 and drift < 1e-13


def test_a_new_line_takes_the_place_of_an_old_one_only_where_it_fits():
    """In bytes a box some cells away can look as if it were here; then a line would stand where nobody looks for it."""
    assert checked(with_prelude(FITS)) == 0


def test_an_array_too_short_is_seen():
    """Sibling: where only its first element is left of an array the checks speak up, whichever array it is."""
    seen = checked(with_prelude(ONE_TOO_SHORT))
    lists = "event neighbours images cell_ids cell_places near blocks scratch"
    windows = "order unsorted segments boxes cell_of_segment column pair_slot pair_own passed changed version"
    assert seen == lists.split() + windows.split()


@pytest.mark.parametrize("k", [-1, 3, np.int32(-3), np.int64(3)])
def test_negative_indices_are_refused_too(k):
    """Sibling: NumPy itself takes an index of -1 for the last."""
    from hardspheres.kernel.simd.pointers import BoundsChecked

    guarded = BoundsChecked(np.zeros(3))
    guarded[2] += 1.0
    assert guarded[2] == 1.0
    with pytest.raises(IndexError, match="outside"):
        guarded[k]
    with pytest.raises(IndexError, match="outside"):
        guarded[k] = 1.0
