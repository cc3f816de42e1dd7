"""Checkpoints: a run that is saved, and goes on in another process, ends with the same bits; and what is no checkpoint is refused."""

import io
import json
import os
import pickle
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import KINDS, gas, one_to_ten, state

import hardspheres as hs
from hardspheres import archive, checkpoint, tuning

TESTS = str(Path(__file__).parent.parent)
LISTS, WINDOWS = {2: 0.0, 3: 0.0}, {2: 1.0, 3: 1.0}
GO_ON = """
import json, pickle, sys
sys.path.insert(0, {tests!r})
from scenes import state
import hardspheres as hs
from hardspheres import tuning
done = []
for path, below, steps in json.load(sys.stdin):
    tuning.SPARSE_BELOW = {{2: below, 3: below}}
    sim = hs.Simulation.load(path)
    for step in steps:
        sim.run(**step)
    done.append((everything(sim)))
pickle.dump(done, sys.stdout.buffer)
"""
EVERYTHING = """
def everything(sim):
    t = sim.tallies
    tallies = [a.tobytes() for a in (t.virial, t.kinetic, t.wall_impulses, t.wall_radius_impulses)]
    status = {k: v for k, v in sim.status().items() if k not in ("stale_events", "list_renewals", "bytes_per_particle")}
    return (state(sim), sim.time, sim.positions.tobytes(), sim.unwrapped_positions.tobytes(), t.time, t.collisions,
            t.wall_collisions, tallies, repr(status))
"""
exec(EVERYTHING)  # the same words here and in the child


def scenes():
    """Every kind by both searches; boxes so small that lists name the image; two grids."""
    for kind in KINDS:
        yield f"{kind} lists", gas(kind, 300, 0.1, seed=5), LISTS
        yield f"{kind} windows", gas(kind, 300, 0.1, seed=5), WINDOWS
    yield "images", gas("3d", 12, 0.2, seed=5), LISTS
    yield "two grids", one_to_ten("3d_mixture", n=500, large=5, packing_fraction=0.05), WINDOWS


STEPS = [{"collisions": 501}, {"time": 3.3}, {"collisions": 700}]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Each scene run in one go, and saved after the first step of it for a child to go on with."""
    folder = tmp_path_factory.mktemp("checkpoints")
    expected, orders = {}, []
    with pytest.MonkeyPatch.context() as patch:
        for name, scene, method in scenes():
            patch.setattr(tuning, "SPARSE_BELOW", method)
            for cut in (1, 2):
                sim = hs.Simulation(scene)
                sim.run(collisions=100)
                sim.reset_tallies()
                for k, step in enumerate(STEPS):
                    if k == cut:
                        sim.save(folder / f"{name} {cut}")
                    sim.run(**step)
                expected[name, cut] = everything(sim)  # noqa: F821
                orders.append((str(folder / f"{name} {cut}"), method[3], STEPS[cut:]))
    program = GO_ON.format(tests=TESTS).replace("done = []", EVERYTHING + "\ndone = []")
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        input=json.dumps(orders).encode(),
        capture_output=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr.decode()[-2000:]
    return expected, dict(zip(expected, pickle.loads(child.stdout), strict=True)), folder


@pytest.mark.parametrize("cut", [1, 2])
@pytest.mark.parametrize("name", [name for name, _, _ in scenes()])
def test_another_process_goes_on_with_the_same_bits(runs, name, cut):
    expected, resumed, _ = runs
    assert resumed[name, cut] == expected[name, cut]
