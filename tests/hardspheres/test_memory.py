"""Memory of a million particles: growth of the peak resident memory by engine and simulation, the scene itself not counted."""

import json
import pickle
import subprocess
import sys

import pytest

import hardspheres as hs

MOST = 400  # bytes per particle

PROGRAM = """
import json, pickle, resource, sys
import hardspheres as hs
with open(sys.argv[1], "rb") as file:
    small, scene = pickle.load(file)
warm = hs.Simulation(small)
warm.run(collisions=10)
with open("/proc/self/statm") as file:
    before = int(file.read().split()[1]) * resource.getpagesize()
sim = hs.Simulation(scene)
sim.run(collisions=int(sys.argv[2]))
with open("/proc/self/status") as file:  # ru_maxrss would remember the peak of the process that started this one
    after = 1024 * int(next(line for line in file if line.startswith("VmHWM")).split()[1])
arrays = sim._engine.arrays._asdict()
own = {name: a.nbytes / scene.n for name, a in arrays.items() if name not in ("event_float", "scratch_int")}
print(json.dumps({
    "grown": (after - before) / scene.n,
    "arrays": sim.status()["bytes_per_particle"],
    "own": {name: size for name, size in own.items() if size >= 0.5},
}))
"""


def memory(scene, small, collisions, folder):
    """Bytes per particle that a simulation of this scene adds, in a process of its own."""
    path = folder / "scenes.pickle"
    path.write_bytes(pickle.dumps((small, scene), protocol=5))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path), str(collisions)],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize(
    "packing_fraction",  # with windows of time, and with the longest lists
    [
        pytest.param(eta, marks=pytest.mark.slow if eta in (0.01, 0.5) else pytest.mark.long)
        for eta in (0.01, 0.1, 0.3, 0.5)
    ],
)
def test_bytes_per_particle(packing_fraction, tmp_path):
    small, scene = (hs.lattice_gas(n=n, packing_fraction=packing_fraction, seed=1) for n in (4000, 1_000_000))
    found = memory(scene, small, 1_000_000, tmp_path)
    assert found["grown"] <= MOST, found
    # Sibling: the arrays, which are all written to, must be seen by what is measured.
    assert found["grown"] > 0.5 * found["arrays"], found
