"""Checkpoints: a run that is saved, and goes on in another process, ends with the same bits; a file is whole or refused."""

import errno
import json
import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from damaged import damaged
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import KINDS, SEARCHES, everything, flight_bits, gas, one_to_ten, state

import hardspheres as hs
from hardspheres import archive, temporary
from hardspheres.engine import Engine

STEPS = [{"collisions": 501}, {"time": 3.3}, {"collisions": 700}]
GO_ON = """
import json, pickle, sys
sys.path.insert(0, {tests!r})
from scenes import everything
import hardspheres as hs
done = []
for path, search, steps in json.load(sys.stdin):
    sim = hs.Simulation.load(path, search=search)
    for step in steps:
        sim.run(**step)
    done.append(everything(sim))
pickle.dump(done, sys.stdout.buffer)
"""


def scenes():
    """Every kind by both searches; boxes so small that lists name the image; two grids."""
    for kind in KINDS:
        for search in SEARCHES:
            yield f"{kind} {search}", lambda kind=kind: gas(kind, 300, 0.1, seed=5), search
    yield "images", lambda: gas("3d", 12, 0.2, seed=5), "lists"
    yield "two grids", lambda: one_to_ten("3d_mixture", n=500, large=5, packing_fraction=0.05), "windows"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Each scene run in one go, and saved after one or two steps of it for a child to go on with."""
    folder = tmp_path_factory.mktemp("checkpoints")
    expected, orders = {}, []
    for name, scene, search in scenes():
        sim = hs.Simulation(scene(), search=search)
        sim.run(collisions=100)
        sim.reset_tallies()
        for k, step in enumerate(STEPS):
            if k:
                sim.save(folder / f"{name} {k}")
                orders.append((str(folder / f"{name} {k}"), search, STEPS[k:]))
            sim.run(**step)
        expected[name] = everything(sim)
    program = GO_ON.format(tests=str(Path(__file__).parent.parent))
    child = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        input=json.dumps(orders).encode(),
        capture_output=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr.decode()[-2000:]
    resumed = dict(zip([Path(path).name for path, *_ in orders], pickle.loads(child.stdout), strict=True))
    return expected, resumed


@pytest.mark.parametrize("cut", [1, 2])
@pytest.mark.parametrize("name", [name for name, *_ in scenes()])
def test_another_process_goes_on_with_the_same_bits(runs, name, cut):
    expected, resumed = runs
    assert resumed[f"{name} {cut}"] == expected[name]


@pytest.fixture(scope="module")
def half_way():
    """A gas between walls, half way through an epoch and a tally."""
    sim = hs.Simulation(gas("3d_walls", 60, 0.1, seed=5))
    sim.run(collisions=300)
    sim.reset_tallies()
    sim.run(time=5.3)
    return sim


@pytest.fixture
def path(half_way, tmp_path):
    half_way.save(tmp_path / "checkpoint")
    return tmp_path / "checkpoint"


@pytest.mark.parametrize(
    "lost", ["row", "turns", "total", "integral", "total_then", "integral_then", "numbers", "counters"]
)
def test_whatever_is_lost_is_missed(path, lost, monkeypatch):
    """Sibling: each part of the state matters; without it something that a user sees is another."""
    expected = everything(hs.Simulation.load(path))
    restore = Engine.restore
    monkeypatch.setattr(
        Engine, "restore", lambda self, state: restore(self, state | {lost: self.state()[lost]})
    )
    sim = hs.Simulation.load(path)
    at = sim._at
    if lost == "numbers":
        assert sim._engine.arrays.number[at.LAST_ADVANCE] == -sim._engine.length
    else:
        assert everything(sim) != expected


def test_another_search_changes_nothing(path, half_way):
    """Saved with windows, continued with lists: the search is no part of the state."""
    assert half_way.status()["method"] == "windows of time"
    other = hs.Simulation.load(path, search="lists")
    assert "lists" in other.status()["method"]
    same = hs.Simulation.load(path)
    assert same.status()["method"] == "windows of time"
    for sim in (same, other):
        sim.run(collisions=500)
    assert state(same) == state(other)


def test_the_same_state_gives_the_same_file(half_way, path, tmp_path):
    """So files can be compared; loading and saving again changes no byte either, and neither touches the simulation."""
    before = everything(half_way)
    half_way.save(tmp_path / "again")
    hs.Simulation.load(path).save(tmp_path / "loaded")
    assert path.read_bytes() == (tmp_path / "again").read_bytes() == (tmp_path / "loaded").read_bytes()
    assert everything(half_way) == before


def test_numpy_opens_it_without_pickle(path, half_way):
    with np.load(path, allow_pickle=False) as file:
        assert np.array_equal(file["positions"], half_way.scene.positions)


def test_a_scene_with_contacts_as_the_engine_left_them(tmp_path):
    """What `to_scene` gives may overlap by rounding; its simulation is saved and loaded all the same."""
    scene = hs.lattice_gas(n=32, packing_fraction=0.7, seed=2)
    sim = hs.Simulation(scene)
    sim.run(collisions=997)
    later = hs.Simulation(sim.to_scene())
    later.save(tmp_path / "checkpoint")
    loaded = hs.Simulation.load(tmp_path / "checkpoint")
    assert np.array_equal(loaded.scene.positions, later.scene.positions)


@pytest.mark.parametrize(
    "scene",
    [
        hs.Scene([[1.0, 1, 1]], [[0.3, 0, 0]], box=(3, 3, 3)),
        hs.Scene([[1.0, 1, 1], [2.0, 1, 1]], np.zeros((2, 3)), box=(4, 4, 4)),
    ],
    ids=["one particle", "no motion"],
)
def test_scenes_without_events(scene, tmp_path):
    sim = hs.Simulation(scene)
    sim.run(time=1e4)
    sim.save(tmp_path / "checkpoint")
    loaded = hs.Simulation.load(tmp_path / "checkpoint")
    sim.run(time=2.5)
    loaded.run(time=2.5)
    assert everything(loaded) == everything(sim)


# The file.


def test_any_changed_bit_and_any_missing_end_is_refused(path):
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    for k in [0, 5, *rng.integers(0, len(whole), 200).tolist(), len(whole) - 65, len(whole) - 1]:
        altered = bytearray(whole)
        altered[k] ^= 1 << int(rng.integers(8))
        path.write_bytes(altered)
        with pytest.raises(hs.CheckpointError, match="damaged|not a checkpoint"):
            hs.Simulation.load(path)
    for length in [0, 1, 64, *rng.integers(0, len(whole), 50).tolist(), len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(hs.CheckpointError, match="empty|not a checkpoint"):
            hs.Simulation.load(path)


@pytest.mark.slow
def test_every_changed_byte_is_refused(path):
    """All of its bits, and each of them in turn. The smallest gas: its file is all headers."""
    sim = hs.Simulation(gas("3d", 4, 0.05, seed=3))
    sim.run(collisions=20)
    sim.save(path)
    for _ in damaged(path, bits=8):
        with pytest.raises(hs.CheckpointError, match="damaged|not a checkpoint"):
            hs.Simulation.load(path)


def no_room(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def interrupted(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("what", ["numpy.lib.format.write_array", "os.fsync", "os.replace"])
@pytest.mark.parametrize("how", [no_room, interrupted])
def test_a_failed_save_leaves_the_old_file_and_nothing_else(half_way, path, what, how, monkeypatch):
    old = path.read_bytes()
    monkeypatch.setattr(what, how)
    with pytest.raises(hs.CheckpointError if how is no_room else KeyboardInterrupt) as error:
        half_way.save(path)
    if how is no_room:
        assert "No space left on device" in str(error.value)
    assert path.read_bytes() == old
    assert list(path.parent.iterdir()) == [path]


def test_the_new_file_is_on_disk_before_it_has_the_name(half_way, path, monkeypatch):
    calls = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: calls.append("fsync") or fsync(handle))
    monkeypatch.setattr(os, "replace", lambda *names: calls.append("replace") or replace(*names))
    half_way.save(path)
    assert calls == ["fsync", "replace", "fsync"]  # the folder last


@pytest.fixture
def dead():
    """The id of a process that is no more."""
    program = "import os; print(os.getpid())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return int(done.stdout)


def left_by(folder, where, pid, age=0.0):
    file = folder / f".partial-{where}-{pid}-0123abcd.npz"
    file.write_bytes(b"half of it")
    os.utime(file, (time.time() - age,) * 2)
    return file


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks the system for processes")
def test_what_a_killed_writer_left_is_removed_and_what_another_machine_writes_is_not(half_way, path, dead):
    """An id of a process tells nothing about another machine, or another container on this one: there only age does."""
    here, other = temporary.neighbourhood(), "0" * 16
    left_by(path.parent, here, dead)
    left_by(path.parent, here, os.getpid(), temporary.OLD + 60)
    left_by(path.parent, other, dead, temporary.OLD + 60)
    kept = {left_by(path.parent, here, os.getpid()), left_by(path.parent, other, dead, temporary.OLD - 60)}
    half_way.save(path)
    assert set(path.parent.iterdir()) == {path, *kept}


def test_what_only_looks_like_a_leftover_stays(half_way, path, dead):
    """A file of another name, a folder, a link and what it leads to."""
    here, elsewhere = temporary.neighbourhood(), path.parent / "thesis.tex"
    elsewhere.write_text("years of work")
    (path.parent / f".partial-{here}-{dead}-0123abcd.npz").symlink_to(elsewhere)
    (path.parent / f".partial-{here}-{dead}-abcd0123").mkdir()
    (path.parent / f".partial-{dead}-abcd0123.npz").touch()
    (path.parent / ".partial-thesis.tex").touch()
    before = set(path.parent.iterdir())
    for file in before - {path, elsewhere}:
        os.utime(file, (0, 0), follow_symlinks=False)
    half_way.save(path)
    assert set(path.parent.iterdir()) == before and elsewhere.read_text() == "years of work"


def test_machines_and_containers_are_told_apart(monkeypatch):
    """By host, boot and namespace of processes; where these are not known nobody is taken for a neighbour."""
    known = temporary.neighbourhood()
    if sys.platform.startswith("linux"):
        assert known == temporary.neighbourhood()
        with monkeypatch.context() as patch:
            patch.setattr(os, "readlink", lambda path: "pid:[4026532999]")
            assert temporary.neighbourhood() != known
        with monkeypatch.context() as patch:
            patch.setattr(temporary.Path, "read_text", lambda *_, **__: "another boot")
            assert temporary.neighbourhood() != known

    def unknown(path):
        raise FileNotFoundError(path)

    monkeypatch.setattr(os, "readlink", unknown)
    assert temporary.neighbourhood() != temporary.neighbourhood()


# Files that are sealed, and lie: made with `forged`, which writes what no simulation leaves.


def forged(path, **changes):
    """Write the checkpoint anew with some of its arrays replaced, taken out (None) or added, and a valid checksum."""
    arrays = {name: array.copy() for name, array in archive.read_archive(path).items()}
    for name, change in changes.items():
        arrays[name] = change(arrays[name]) if callable(change) else change
    archive.write_archive(path, {name: array for name, array in arrays.items() if array is not None})


@settings(max_examples=150)
@given(data=st.data())
def test_a_sealed_file_with_any_bytes_is_refused_or_runs(half_way, tmp_path_factory, data):
    """Found nothing that gets past the checks and then breaks: what is taken runs on, or says why not."""
    path = tmp_path_factory.mktemp("forged") / "checkpoint"
    half_way.save(path)
    if data.draw(st.booleans()):
        content = bytearray(path.read_bytes()[: -archive.DIGEST])
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        with open(path, "w+b") as file:
            file.write(bytes(content) + b"0" * archive.DIGEST)
            archive._seal(file)
    else:
        arrays = archive.read_archive(path)
        name = data.draw(
            st.sampled_from(sorted(name for name in arrays if name != "about" and arrays[name].size))
        )
        strange = [0, -1, 1, 2**31, 2**62, -(2**63)] + [np.nan, np.inf, -1e300, 1e300, 1e-300, 3.7] * (
            arrays[name].dtype.kind == "f"
        )

        def change(array):
            flat = array.ravel()
            flat[data.draw(st.integers(0, len(flat) - 1))] = data.draw(st.sampled_from(strange))
            return array

        forged(path, **{name: change})
    try:
        sim = hs.Simulation.load(path)
        sim.run(time=0.01)
        sim.run(collisions=3)
    except (hs.CheckpointError, hs.SimulationError):
        return
    assert np.isfinite(sim.positions).all()


def test_flights_and_the_log_go_on(tmp_path):
    whole, logs = hs.Simulation(gas("3d", 300, 0.1, seed=5), free_paths=True, search="windows"), []
    for step in STEPS:
        whole.reset_tallies()
        whole.run(**step)
        whole.save(tmp_path / f"after {whole.collisions}")
    first, *_ = sorted(tmp_path.iterdir(), key=lambda file: int(file.name.split()[-1]))
    sim = hs.Simulation.load(first, log=logs.append, search="windows")
    for step in STEPS[1:]:
        sim.reset_tallies()
        sim.run(**step)
    assert everything(sim) == everything(whole)
    assert sim.frame().free_paths.flights[0] > sim.free_paths.flights[0]
    assert flight_bits(sim.free_paths) == flight_bits(whole.free_paths)
    assert sum(map(len, logs)) == whole.collisions - STEPS[0]["collisions"]


def test_flights_of_many_species_are_loaded_without_their_log(tmp_path):
    """More species than are told apart: the log has the flights, and a checkpoint without it goes on all the same."""
    scene = gas("3d_mixture", 40, 0.05)
    sim = hs.Simulation(scene.replace(masses=1.0 + np.arange(40)), log=lambda events: None, search="lists")
    sim.run(collisions=100)
    sim.save(tmp_path / "checkpoint")
    loaded = hs.Simulation.load(tmp_path / "checkpoint", search="lists")
    for each in (sim, loaded):
        each.run(collisions=100)
    assert everything(loaded) == everything(sim)
    with pytest.raises(hs.SimulationError, match="for up to 32 species only; read them from the log"):
        _ = loaded.free_paths


@pytest.mark.parametrize(
    ("slot", "value"),
    [("SPECIES", 1.0), ("SPECIES", -5.0), ("BEGAN", -1.0), ("BEGAN_EPOCH", 1e9), ("BEGAN_EPOCH", 0.5)],
)
def test_impossible_flights_are_refused(tmp_path, slot, value):
    sim = hs.Simulation(gas("3d", 300, 0.1, seed=5), free_paths=True)
    sim._engine.arrays.flight[getattr(sim._at, slot)] = value
    sim.save(tmp_path / "crafted")
    with pytest.raises(hs.CheckpointError, match="flights"):
        hs.Simulation.load(tmp_path / "crafted")


def test_a_refused_checkpoint_leaves_an_older_log_alone(tmp_path):
    """Control: a sound one begins the log anew."""
    sim = hs.Simulation(gas("3d", 300, 0.1, seed=5), free_paths=True)
    sim.save(tmp_path / "sound")
    sim._engine.arrays.flight[sim._at.SPECIES] = 1.0
    sim.save(tmp_path / "crafted")
    log = tmp_path / "log.npy"
    log.write_bytes(b"mine")
    with pytest.raises(hs.CheckpointError, match="flights"):
        hs.Simulation.load(tmp_path / "crafted", log=log)
    assert log.read_bytes() == b"mine"
    hs.Simulation.load(tmp_path / "sound", log=log)
    assert len(np.load(log)) == 0


def test_no_log_where_nothing_is_known_of_flights(path):
    with pytest.raises(hs.CheckpointError, match="log=.*free_paths=True"):
        hs.Simulation.load(path, log=print)
