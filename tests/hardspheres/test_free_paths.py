"""Tallies of free flights: exact, the same in every window, and nothing to the dynamics."""

import hashlib
import os
import subprocess
import sys
from itertools import takewhile

import numpy as np
import pytest
from scenes import (
    KINDS,
    SEARCHES,
    WITH_FLIGHTS,
    flight_bits,
    gas,
    one_to_ten,
    state_without_flights,
)

import hardspheres as hs
from hardspheres.free_paths import expected_flights
from hardspheres.reference import ReferenceSimulation

OTHERS = [(kind, search) for kind in KINDS for search in SEARCHES if (kind, search) not in WITH_FLIGHTS]


def same_with_and_without(scene, collisions, search):
    plain, logged = hs.Simulation(scene, search=search), []
    free = hs.Simulation(scene, free_paths=True, search=search)
    log = hs.Simulation(scene, log=logged.append, search=search)
    for sim in (plain, free, log):
        for share in (0.5, 0.2, 0.3):
            sim.run(collisions=int(share * collisions))
    assert state_without_flights(plain) == state_without_flights(free) == state_without_flights(log)
    assert flight_bits(free.free_paths) == flight_bits(log.free_paths)
    tallied = free.free_paths
    assert sum(map(len, logged)) == plain.collisions + plain.wall_collisions
    assert (tallied.flights + tallied.first_flights).sum() == 2 * plain.collisions
    assert np.triu(tallied.pair_collisions).sum() == plain.collisions
    for counts in (tallied.path_counts, tallied.time_counts, tallied.speed_counts):
        assert np.array_equal(counts.sum(axis=1), tallied.flights)
    return free


@pytest.mark.parametrize(("kind", "search"), WITH_FLIGHTS)
def test_the_trajectory_is_the_same_with_and_without(kind, search):
    sim = same_with_and_without(gas(kind, 500, 0.1, seed=5), 3000, search)
    assert search in sim.status()["method"]


@pytest.mark.long
@pytest.mark.parametrize(("kind", "search"), OTHERS)
def test_the_trajectory_is_the_same_for_every_kind(kind, search):
    same_with_and_without(gas(kind, 500, 0.1, seed=5), 3000, search)
    if search == "windows" and "mixture" in kind:
        same_with_and_without(one_to_ten(kind, packing_fraction=0.01), 3000, search)


PLAIN_PYTHON = """
import sys
sys.path[:0] = {paths!r}
import test_free_paths as t
from scenes import KINDS, SEARCHES, gas
for kind in KINDS:
    for search in SEARCHES:
        print(kind, t.digest(gas(kind, 20, 0.05, seed=3), search))
        t.same_with_and_without(gas(kind, 20, 0.05, seed=3), 30, search)
    t.compare_with_the_reference(gas(kind, 20, 0.2, seed=4), 30)
"""


def digest(scene, search):
    """Digest of all tallies of flights, and of the log, after some collisions."""
    chunks = []
    sim = hs.Simulation(scene, log=chunks.append, search=search)
    sim.run(collisions=30)
    before = flight_bits(sim.free_paths)
    sim.reset_tallies()
    sim.run(collisions=30)
    everything = before + flight_bits(sim.free_paths) + np.concatenate(chunks).tobytes()
    return hashlib.sha256(everything).hexdigest()


def compare_with_the_reference(scene, events):
    """Logs and paths of both searches against the plain solver: who, when, how hard, and what each flew."""
    solver = ReferenceSimulation(scene)
    met, seen = [None] * scene.n, []
    for _ in range(events):
        before = np.array(solver.velocities)
        event = solver.step()
        i, j = event.first, event.second
        kick = scene.masses[i] * (np.array(solver.velocities[i]) - before[i])
        paths = []
        for k in (i, j):
            known = k < scene.n and met[k] is not None
            paths.append(np.linalg.norm(before[k]) * (solver.time - met[k]) if known else np.nan)
            if k < scene.n and j < scene.n:
                met[k] = solver.time
        seen.append((solver.time, i, j, kick, paths))
    for search in SEARCHES:
        chunks = []
        sim = hs.Simulation(scene, log=chunks.append, search=search)
        sim.run(collisions=solver.collisions)
        log = np.concatenate(chunks)
        for (time, i, j, kick, paths), event in zip(seen, log, strict=False):
            assert (event["i"], event["j"]) == (i, j)
            # the two round differently, and each collision makes many times as much of it
            np.testing.assert_allclose(event["time"], time, rtol=1e-6)
            np.testing.assert_allclose(event["impulse"] * event["normal"], kick, atol=1e-5)
            np.testing.assert_allclose(event["free_path"], paths, atol=1e-5)
        assert len(log) == len(seen) - sum(1 for _ in takewhile(lambda e: e[2] >= scene.n, reversed(seen)))
        assert np.isfinite(log["free_path"][log["j"] < scene.n]).sum() >= 10


def test_plain_python_gives_the_same_sums_and_agrees_with_the_reference():
    """Without Numba: every kind and both methods; those that are compiled here give the same digest compiled."""
    here = os.path.dirname(__file__)
    command = [sys.executable, "-W", "error", "-c", PLAIN_PYTHON.format(paths=[here, os.path.dirname(here)])]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 2 * len(KINDS)
    assert lines[::2] == lines[1::2]  # lists and windows add up in the same order
    for kind, search in WITH_FLIGHTS:
        assert f"{kind} {digest(gas(kind, 20, 0.05, seed=3), search)}" in lines


def test_path_flown_is_the_integral_of_speed():
    """Over a window that begins and ends between collisions; the sums of two windows are those of both."""
    scene = gas("3d", 500, 0.1, seed=5)
    sim, whole = (hs.Simulation(scene, free_paths=True) for _ in range(2))
    sim.run(collisions=700)
    whole.run(collisions=700)
    whole.reset_tallies()
    flown, parts = 0.0, []
    for _ in range(2):
        sim.run(time=0.01)
        sim.reset_tallies()
        before, total = sim.time, 0.0
        for _ in range(150):
            speeds = np.linalg.norm(sim.velocities, axis=1)
            sim.run(collisions=1)
            total += speeds.sum() * (sim.time - before)
            before = sim.time
        assert sim.free_paths.path_flown[0] == pytest.approx(total, rel=1e-12)
        flown += total
        parts.append(sim.free_paths)
    # sibling: the flights that ended in the window flew another path in all
    assert abs(parts[0].path_sums[0, 0] / parts[0].path_flown[0] - 1) > 1e-3
    assert parts[1].time == sim.tallies.time


def test_windows_add_up():
    """Counts to the last one, sums to rounding; first flights only at the start."""
    scene = gas("3d", 500, 0.1, seed=5)
    sim, whole = (hs.Simulation(scene, free_paths=True) for _ in range(2))
    whole.run(collisions=4000)
    parts = []
    for _ in range(4):
        sim.reset_tallies()
        sim.run(collisions=1000)
        parts.append(sim.free_paths)
    every = whole.free_paths
    assert flight_bits(whole.frame().free_paths) == flight_bits(every)
    from_start = sim.frame().free_paths  # though its tallies were reset
    for field, value in vars(every).items():
        np.testing.assert_allclose(getattr(from_start, field), value, rtol=1e-12, atol=1e-12)
    for field in (
        "flights",
        "first_flights",
        "path_counts",
        "time_counts",
        "speed_counts",
        "pair_collisions",
    ):
        assert np.array_equal(sum(getattr(part, field) for part in parts), getattr(every, field))
    for field in ("path_flown", "path_sums", "time_sums", "speed_paths", "speed_times"):
        total = sum(getattr(part, field) for part in parts)
        np.testing.assert_allclose(total, getattr(every, field), rtol=1e-12, atol=1e-12)
    assert every.first_flights[0] <= 500 and parts[3].first_flights[0] == 0
    assert every.first_flights[0] == sum(part.first_flights[0] for part in parts) > 490
    for edges, counts in ((every.path_edges, every.path_counts), (every.speed_edges, every.speed_counts)):
        assert edges.shape[1] == counts.shape[1] + 1 and edges[0, 0] == 0 and np.isinf(edges[0, -1])
        assert np.all(np.diff(edges[0]) > 0)


def test_flights_without_a_beginning_would_bias_the_sample():
    """Sibling: from the start, where first flights are left out, the sample is too short; path over ends never is."""
    scene = gas("3d", 500, 0.05, seed=5)
    early, late = (hs.Simulation(scene, free_paths=True) for _ in range(2))
    early.run(collisions=500)
    late.run(collisions=5000)
    late.reset_tallies()
    late.run(collisions=20_000)
    sample, truth = early.free_paths, late.free_paths
    mean = truth.path_sums[0, 0] / truth.flights[0]
    assert truth.first_flights[0] == 0
    assert truth.path_flown[0] / truth.flights[0] == pytest.approx(mean, rel=1e-2)
    assert sample.first_flights[0] > 300
    assert sample.path_sums[0, 0] / sample.flights[0] < 0.75 * mean
    ends = sample.flights[0] + sample.first_flights[0]
    assert sample.path_flown[0] / ends == pytest.approx(mean, rel=0.1)


def test_gases_that_hardly_move():
    """Nobody moves, or nobody relative to another: units that can be divided by, and paths of what moved."""
    scene = gas("3d", 500, 0.1, seed=5)
    assert np.all(expected_flights(scene.replace(velocities=np.zeros((500, 3)))) == 1.0)
    together = hs.Simulation(scene.replace(velocities=np.full((500, 3), 2.0)), free_paths=True)
    together.run(time=10.0)
    assert together.free_paths.path_flown[0] == pytest.approx(500 * 10.0 * np.sqrt(12.0))


def test_asked_for_without_being_tallied():
    scene = gas("3d", 40, 0.05)
    with pytest.raises(hs.SimulationError, match=r"construct with Simulation\(scene, free_paths=True\)"):
        _ = hs.Simulation(scene).free_paths
    many = scene.replace(masses=np.linspace(1, 2, 40))
    with pytest.raises(hs.SimulationError, match="up to 32 species apart, and this scene has 40"):
        hs.Simulation(many, free_paths=True)


def test_a_frame_knows_the_way_it_came():
    sim = hs.Simulation(gas("3d", 40, 0.05, seed=3))
    for frame in sim.frames(times=[0.0, 3.0, 50.0]):
        unwrapped = sim.unwrapped_positions
        assert np.array_equal(frame.unwrapped_positions, unwrapped)
    sim.run(time=20.0)
    assert np.array_equal(frame.unwrapped_positions, unwrapped)
    assert np.abs(unwrapped - frame.positions).max() > sim.scene.box[0] / 2
    made = hs.Frame(0.0, 0, 0.0, frame.positions, frame.velocities, sim.scene)
    with pytest.raises(hs.SimulationError, match="no simulation made this frame"):
        _ = made.unwrapped_positions
