"""The event log: it reproduces the tallies, changes no bit, and a file is whole whatever happens."""

import errno
import os
import signal
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest
from scenes import WITH_FLIGHTS, flight_bits, gas, state_without_flights

import hardspheres as hs
from hardspheres import event_log
from hardspheres.event_log import event_dtype
from hardspheres.sums import FRACTION_BITS


def exactly(terms, per_unit):
    """Sum of terms rounded to multiples of 2^-47 units, as the engine adds, in integers of any size."""
    grain = per_unit * 2.0**FRACTION_BITS
    return float(Fraction(sum(map(int, np.rint(terms * grain).tolist()))) / Fraction(grain))


def check_against_tallies(sim, log):
    """Everything that the engine counts since the start, from the log."""
    scene, tallies, tallied = sim.scene, sim.tallies, sim.free_paths
    pairs, walls = log[log["j"] < scene.n], log[log["j"] >= scene.n]
    assert (len(pairs), len(walls)) == (tallies.collisions, tallies.wall_collisions)
    # times in the order of execution, contacts of the right pairs; the virial r.dp = sigma_ij impulse
    assert np.all(np.diff(log["time"]) >= -1e-13) and 0 < log["time"][-1] <= sim.time
    assert np.all(pairs["i"] < pairs["j"])
    np.testing.assert_allclose(np.linalg.norm(log["normal"], axis=1), 1.0, rtol=1e-14)
    sigma = scene.radii[pairs["i"]] + scene.radii[pairs["j"]]
    push = (sigma * pairs["impulse"])[:, None, None] * (
        pairs["normal"][:, :, None] * pairs["normal"][:, None, :]
    )
    np.testing.assert_allclose(push.sum(axis=0), tallies.virial, rtol=1e-12, atol=1e-12 * push.max())
    # momenta: the start's and all impulses give the end's
    momenta = scene.masses[:, None] * scene.velocities
    kicks = log["impulse"][:, None] * log["normal"]
    np.add.at(momenta, log["i"], kicks)
    np.add.at(momenta, pairs["j"], -kicks[log["j"] < scene.n])
    np.testing.assert_allclose(momenta, scene.masses[:, None] * sim.velocities, rtol=1e-10, atol=1e-11)
    # what walls and paths add up to is exact: equal to the last bit
    at, number = sim._at, sim._engine.arrays.number
    for axis, side in np.ndindex(scene.dim, 2):
        hits = walls["j"] == scene.n + 2 * axis + side
        assert exactly(walls["impulse"][hits], number[at.PER_IMPULSE]) == tallies.wall_impulses[axis, side]
        assert np.all(walls["normal"][hits][:, axis] == (-1.0 if side else 1.0))
    who = np.stack([pairs["i"], pairs["j"]], axis=1).ravel()
    kinds, paths = scene.species[who], pairs["free_path"].ravel()
    for kind in range(len(tallied.particles)):
        mine = paths[kinds == kind]
        known = mine[np.isfinite(mine)]
        assert len(known) == tallied.flights[kind]
        assert len(mine) - len(known) == tallied.first_flights[kind]
        unit, powers = sim._engine.flights.sum_units[kind, 0], (known, known * known, known * known * known)
        for k, total in enumerate(tallied.path_sums[kind]):
            assert exactly(powers[k], at.PER_MOMENT[k] / unit ** (k + 1)) == total
        assert np.array_equal(np.histogram(known, tallied.path_edges[kind])[0], tallied.path_counts[kind])
    species = scene.species[np.stack([pairs["i"], pairs["j"]])]
    met = np.zeros_like(tallied.pair_collisions)
    np.add.at(met, tuple(species), 1)
    assert np.array_equal(met + met.T - np.diag(np.diag(met)), tallied.pair_collisions)


def logged(scene, collisions, **options):
    chunks = []
    sim = hs.Simulation(scene, log=chunks.append, **options)
    sim.run(collisions=collisions)
    return sim, chunks


@pytest.mark.parametrize(("kind", "search"), WITH_FLIGHTS)
def test_the_log_reproduces_the_tallies(kind, search):
    sim, chunks = logged(gas(kind, 500, 0.1, seed=5), 20_000, search=search)
    assert [len(chunk) for chunk in chunks] == [8192, 8192, 20_000 - 2 * 8192]
    log = np.concatenate(chunks)
    check_against_tallies(sim, log)
    # siblings: one event twice, or one path that is not what was flown
    with pytest.raises(AssertionError):
        check_against_tallies(sim, np.append(log, log[-1:]))
    log["free_path"][15_000, 0] *= 1.0 + 1e-9
    with pytest.raises(AssertionError):
        check_against_tallies(sim, log)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("2d_mixture_walls", marks=pytest.mark.slow),
        pytest.param("3d_walls", marks=pytest.mark.long),
    ],
)
def test_the_log_reproduces_the_tallies_between_walls(kind):
    sim, chunks = logged(gas(kind, 500, 0.1, seed=5), 20_000)
    assert sim.wall_collisions > 1000
    check_against_tallies(sim, np.concatenate(chunks))


def test_a_full_buffer_changes_nothing(monkeypatch):
    scene = gas("3d", 500, 0.1, seed=5)
    whole, chunks = logged(scene, 1000)
    monkeypatch.setattr(event_log, "ROOM", 7)
    monkeypatch.setattr("hardspheres.engine.ROOM", 7)
    parts, small = logged(scene, 1000)
    assert [len(chunk) for chunk in small] == [7] * 142 + [6]
    assert np.concatenate(small).tobytes() == np.concatenate(chunks).tobytes()
    assert state_without_flights(parts) == state_without_flights(whole) and flight_bits(
        parts.free_paths
    ) == flight_bits(whole.free_paths)


def test_a_function_that_fails_loses_its_chunk_and_nothing_else():
    scene = gas("3d", 500, 0.1, seed=5)
    whole, expected = logged(scene, 20_000)
    chunks = []

    def take(events):
        chunks.append(events)
        if len(chunks) == 2:
            raise KeyError("mine")

    sim = hs.Simulation(scene, log=take)
    with pytest.raises(KeyError, match="mine"):
        sim.run(collisions=20_000)
    assert sim.collisions == 2 * 8192
    sim.run(collisions=20_000 - sim.collisions)
    assert state_without_flights(sim) == state_without_flights(whole)
    assert np.concatenate(chunks).tobytes() == np.concatenate(expected).tobytes()


def test_a_file_holds_what_has_happened_so_far(tmp_path):
    scene, path = gas("3d", 500, 0.1, seed=5), tmp_path / "events.npy"
    _, chunks = logged(scene, 12_000)
    expected = np.concatenate(chunks)
    sim = hs.Simulation(scene, log=path)
    assert np.load(path).shape == (0,) and np.load(path).dtype == event_dtype(3)
    sim.run(collisions=10)
    assert np.load(path).tobytes() == expected[:10].tobytes()
    for frame in sim.frames(times=[sim.time, sim.time + 0.5]):
        assert len(np.load(path)) == frame.collisions > 0
    sim.run(collisions=12_000 - sim.collisions)
    assert np.load(path, mmap_mode="r").tobytes() == expected.tobytes()
    hs.Simulation(scene, log=str(path))
    assert np.load(path).shape == (0,)


KILLED = """
import os, signal, sys
sys.path.insert(0, {tests!r})
from scenes import gas
import hardspheres as hs
sim = hs.Simulation(gas("3d", 500, 0.1, seed=5), log={path!r})
write, done = os.write, []
def killed(file, data):
    if len(data) > 1000:
        done.append(len(data))
        if len(done) == 3:  # in the middle of the third chunk
            write(file, data[: len(data) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
    return write(file, data)
os.write = killed
sim.run(collisions=50_000)
"""


def test_a_killed_run_leaves_a_file_that_opens(tmp_path):
    path = tmp_path / "events.npy"
    tests = os.path.dirname(os.path.dirname(__file__))
    program = KILLED.format(tests=tests, path=str(path))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    _, chunks = logged(gas("3d", 500, 0.1, seed=5), 2 * 8192)
    assert np.load(path).tobytes() == np.concatenate(chunks).tobytes()
    assert path.stat().st_size > len(chunks) * chunks[0].nbytes + 2000  # what it was writing when it died


def test_a_full_disk_is_one_sentence_and_the_file_opens(tmp_path, monkeypatch):
    path, write = tmp_path / "events.npy", os.write
    sim = hs.Simulation(gas("3d", 500, 0.1, seed=5), log=path)
    sim.run(collisions=100)

    def full(file, data):
        if len(data) > 1000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(file, data)

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(
            hs.SimulationError, match=r"events.npy cannot be written: No space .* ends after 100 events"
        ):
            sim.run(collisions=100)
    time = sim.time
    with pytest.raises(hs.SimulationError, match="ends after 100 events"):
        sim.run(time=1.0)  # there is room again, but a log has no gaps
    assert len(np.load(path)) == 100
    assert sim.collisions > 200 and sim.time == time + 1.0  # what was run has been run


def test_bad_logs_are_refused(tmp_path):
    scene = gas("3d", 40, 0.05)
    for log, sentence in [
        (tmp_path / "events.txt", "events.txt' must end in .npy"),
        (tmp_path / "missing" / "events.npy", "cannot be written: No such file or directory"),
        (3, "log=3 must be a path that ends in .npy, or a function"),
    ]:
        with pytest.raises(hs.SimulationError, match=sentence) as caught:
            hs.Simulation(scene, log=log)
        assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_relative_path_is_pinned_where_the_log_began(tmp_path, monkeypatch):
    """Somebody goes to another folder, where even a file of that name is."""
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "events.npy").write_text("mine")
    monkeypatch.chdir(tmp_path)
    sim = hs.Simulation(gas("3d", 300, 0.1, seed=5), log="events.npy")
    monkeypatch.chdir(tmp_path / "there")
    sim.run(collisions=100)
    assert len(np.load(tmp_path / "events.npy")) == 100
    assert (tmp_path / "there" / "events.npy").read_text() == "mine"


def test_normals_have_no_negative_zeros():
    """Along the rows of a grid: a zero's sign would say which of the two the search found first."""
    grid = np.stack(np.meshgrid(*[1.5 + 3.0 * np.arange(3)] * 3, indexing="ij"), -1).reshape(-1, 3)
    odd, along = np.arange(27) % 2, np.random.default_rng(5).normal(size=27)
    velocities = np.column_stack([along, np.zeros((27, 2))])
    seen = []
    scene = hs.Scene(grid, velocities, np.where(odd, 0.3, 0.5), np.where(odd, 1.0, 7.0), (9, 9, 9))
    sim = hs.Simulation(scene, log=seen.append, search="lists")
    sim.run(collisions=200)
    normals = np.concatenate(seen)["normal"]
    assert np.all(normals[:, 1:] == 0.0) and not np.signbit(normals[:, 1:]).any()
    at, raw = sim._at, sim._engine.arrays.log[: 200 * sim._at.LOG_ROW].reshape(200, -1)
    assert np.signbit(raw[:, at.LOG_NORMAL + 1]).any()  # sibling: the kernels do write some
