"""One row for each rule: what is given, the type of the error, and what its one sentence says (value, place, remedy).

Rows on the arrays of a scene are in `hardspheres/test_scene.py` (BAD), more options of the command line in `studies/test_cli.py`.
"""

import json
import os
import pickle
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scenes import gas

import hardspheres as hs
from hardspheres import archive, memory
from hardspheres.files import read_structure
from studies import cli

ABSURD = 10**15

# Arguments of scenes. Each row is called with the maker of scenes that it is about.

TOUCHING = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0]])
REST = np.zeros((2, 3))


def two(**change):
    return hs.Scene(**({"positions": TOUCHING, "velocities": REST, "box": (10, 10, 10)} | change))


SCENES = {
    "n of zero": (lambda: hs.lattice_gas(0, seed=1), "n is 0; a scene needs at least one particle"),
    "n below zero": (lambda: hs.random_gas(-3, seed=1), "n is -3; a scene needs at least one"),
    "n not whole": (lambda: hs.lattice_gas(2.5, seed=1), "n is 2.5; the number of particles is an integer >= 1"),
    "n true": (lambda: hs.lattice_gas(True, seed=1), "n is True; the number of particles is an integer"),
    "temperature true": (lambda: hs.lattice_gas(10, 0.1, temperature=True, seed=1), "temperature is True; it must be a"),
    "masses masked": (lambda: hs.random_gas(2, 0.1, masses=np.ma.array([1, 2], mask=[1, 0]), seed=1), "masses are a masked"),
    "masses of 1e308": (lambda: hs.lattice_gas(10, 0.1, masses=1e308, seed=1), "masses from 1e.308 .* another unit of mass"),
    "radii of 1e-90, grown": (lambda: hs.compressed_gas(10, 0.1, radii=1e-90, seed=1), "choose other units of length, time or mass"),
    "n in words": (lambda: hs.lattice_gas("many", seed=1), "n is 'many'; the number of particles is an integer"),
    "n absurd, lattice": (lambda: hs.lattice_gas(ABSURD, seed=1), rf"n = {ABSURD}: .* 300 PB .* ask for fewer"),
    "n absurd, random": (lambda: hs.random_gas(ABSURD, seed=1), rf"\({300 * ABSURD} bytes\)"),
    "n absurd, compressed": (lambda: hs.compressed_gas(ABSURD, 0.6, seed=1), f"n = {ABSURD}"),
    "n beyond all units": (lambda: hs.lattice_gas(10**40, seed=1), "YB of memory"),
    "eta of zero": (lambda: hs.lattice_gas(10, 0, seed=1), "packing_fraction is 0; .* between 0 and 1"),
    "eta below zero": (lambda: hs.random_gas(10, -0.1, seed=1), "packing_fraction is -0.1"),
    "eta of one": (lambda: hs.compressed_gas(10, 1.0, seed=1), "packing_fraction is 1.0"),
    "eta nan": (lambda: hs.lattice_gas(10, float("nan"), seed=1), "packing_fraction is nan"),
    "eta in words": (lambda: hs.lattice_gas(10, "thin", seed=1), "packing_fraction is 'thin'"),
    "eta above close packing": (lambda: hs.lattice_gas(100, 0.75, seed=1), "0.75 is above close packing of the fcc"),
    "eta above jamming": (lambda: hs.random_gas(200, 0.6, seed=1), r"jammed at .* ask for less than that"),
    "eta tiny": (lambda: hs.lattice_gas(10, 1e-300, seed=1), "rounding moves .* take a smaller box"),
    "dim of one": (lambda: hs.lattice_gas(10, 0.1, dim=1, seed=1), "dim is 1; it must be 2 or 3"),
    "dim not whole": (lambda: hs.lattice_gas(10, 0.1, dim=3.0, seed=1), "dim is 3.0; it must be 2 or 3"),
    "lattice unknown": (lambda: hs.lattice_gas(10, 0.1, lattice="bcc", seed=1), "'bcc'; in 3D it must be"),
    "lattice of 3D": (lambda: hs.lattice_gas(10, 0.1, dim=2, lattice="fcc", seed=1), "'fcc'; in 2D it must be"),
    "lattice a list": (lambda: hs.lattice_gas(10, 0.1, lattice=["fcc"], seed=1), r"lattice is \['fcc'\]"),
    "velocities unknown": (lambda: hs.lattice_gas(10, 0.1, velocities="slow", seed=1), "velocities is 'slow'; .* one of"),
    "temperature below zero": (lambda: hs.lattice_gas(10, 0.1, temperature=-1, seed=1), "temperature is -1; .* >= 0"),
    "temperature nan": (lambda: hs.random_gas(10, 0.1, temperature=float("nan"), seed=1), "temperature is nan"),
    "seed below zero": (lambda: hs.lattice_gas(10, 0.1, seed=-1), "seed is -1; it must be an integer >= 0"),
    "seed none": (lambda: hs.lattice_gas(10, 0.1, seed=None), "seed is None"),
    "radii of another number": (lambda: hs.random_gas(10, 0.1, radii=[0.5] * 9, seed=1), r"shape \(9,\); .* 10 particles"),
    "masses of zero": (lambda: hs.random_gas(10, 0.1, masses=0, seed=1), "the mass of particle 0 is 0.0"),
    "box too small for so few": (lambda: hs.random_gas(2, 0.5, seed=1), "edge 1.27944, too short .* ask for more particles"),
    "box too long": (lambda: two(box=(1e10, 10, 10)), "edge along x is 1e[+]10, where rounding .* millionth"),
    "overlap of 1e-12": (lambda: two(positions=TOUCHING * [1 - 5e-13, 1, 1]), "particles 0 and 1 overlap by .*e-1[23] dia"),
    "box of two edges": (lambda: two(box=(10, 10)), "give 3 edge lengths"),
    "dates for numbers": (lambda: two(radii=np.array(["2020-01-01"], "M8[D]")), "radii hold datetime"),
    "a state of others": (lambda: two().with_state(np.zeros((3, 3)), np.zeros((3, 3))), r"shape \(2, 3\)"),
}  # fmt: skip


@pytest.mark.parametrize("row", SCENES)
def test_scenes(row):
    call, sentence = SCENES[row]
    with pytest.raises(hs.SceneError, match=sentence) as caught:
        call()
    assert "\n" not in str(caught.value)


# Simulations and checkpoints' names.

ENGINE = {
    "no scene": (lambda sim: hs.Simulation("gas"), hs.SimulationError, "starts from a Scene, not from 'gas'"),
    "time in words": (lambda sim: sim.run(time="long"), hs.SimulationError, "finite number, not 'long'"),
    "time bytes": (lambda sim: sim.run(time=b"1"), hs.SimulationError, "finite number, not b'1'"),
    "time true": (lambda sim: sim.run(time=True), hs.SimulationError, "finite number, not True"),
    "time complex": (lambda sim: sim.run(time=np.complex128(1)), hs.SimulationError, "needs a finite number"),
    "time a list": (lambda sim: sim.run(time=[1.0]), hs.SimulationError, "needs a finite number"),
    "time masked": (lambda sim: sim.run(time=np.ma.masked), hs.SimulationError, "needs a finite number, not masked"),
    "time a duration": (lambda sim: sim.run(time=np.timedelta64(1, "s")), hs.SimulationError, "needs a finite number"),
    "collisions bytes": (lambda sim: sim.run(collisions=b"1"), hs.SimulationError, "finite number, not b'1'"),
    "collisions bytearray": (lambda sim: sim.run(collisions=bytearray(b"1")), hs.SimulationError, "finite number"),
    "frames of bytes": (lambda sim: sim.frames(times=b"12"), hs.SimulationError, "needs a sequence of numbers, not b'12'"),
    "frames of text": (lambda sim: sim.frames(times="12"), hs.SimulationError, "needs a sequence of numbers, not '12'"),
    "frames masked": (lambda sim: sim.frames(times=np.ma.array([1e9], mask=[1])), hs.SimulationError, "finite number"),
    "count true": (lambda sim: sim.frames(every=1.0, count=True), hs.SimulationError, "finite number, not True"),
    "free paths in words": (lambda sim: hs.Simulation(sim.scene, free_paths="no"), hs.SimulationError, "'no'; .* True or False"),
    "search unknown": (lambda sim: hs.Simulation(sim.scene, search="grid"), hs.SimulationError, "'grid'; .* \"auto\", \"lists\" or \"windows\""),
    "search a list": (lambda sim: hs.Simulation(sim.scene, search=["lists"]), hs.SimulationError, r"\['lists'\]; it must be"),
    "search None": (lambda sim: hs.Simulation(sim.scene, search=None), hs.SimulationError, "None; it must be"),
    "time inf": (lambda sim: sim.run(time=float("inf")), hs.SimulationError, "finite number, not inf"),
    "time beyond the clock": (lambda sim: sim.run(time=1e300), hs.SimulationError, "more than can be counted"),
    "collisions below zero": (lambda sim: sim.run(collisions=-1), hs.SimulationError, "at least 0 .* not -1"),
    "collisions absurd": (lambda sim: sim.run(collisions=2**62), hs.SimulationError, r"below 2\^61"),
    "frames below zero": (lambda sim: sim.frames(every=1.0, count=-2), hs.SimulationError, "not -2"),
    "frames never": (lambda sim: sim.frames(collisions_per_particle=[1e300]), hs.SimulationError, r"below 2\^61"),
    "frames at one number": (lambda sim: sim.frames(times=3.0), hs.SimulationError, "needs a sequence of numbers"),
    "save to a number": (lambda sim: sim.save(3), hs.CheckpointError, "needs the name of a file, not 3"),
    "save to nothing": (lambda sim: sim.save(""), hs.CheckpointError, "needs the name of a file, not ''"),
    "save to bytes": (lambda sim: sim.save(b"x"), hs.CheckpointError, "not b'x'"),
    "save with a NUL": (lambda sim: sim.save("a\0b"), hs.CheckpointError, "needs the name of a file"),
    "save to a folder": (lambda sim: sim.save("."), hs.CheckpointError, "no ordinary file; give .* another name"),
    "save in no folder": (lambda sim: sim.save("absent/x"), hs.CheckpointError, "absent/x cannot be written: No such"),
    "save to a device": (lambda sim: sim.save(os.devnull), hs.CheckpointError, "no ordinary file"),
    "save to an endless name": (lambda sim: sim.save("a" * 300), hs.CheckpointError, "name too long; .* another path"),
    "load nothing": (lambda sim: sim.load("absent"), hs.CheckpointError, "absent cannot be read: No such file"),
    "load a folder": (lambda sim: sim.load("."), hs.CheckpointError, "no ordinary file; name a checkpoint"),
    "load a device": (lambda sim: sim.load(os.devnull), hs.CheckpointError, "no ordinary file"),
    "load None": (lambda sim: sim.load(None), hs.CheckpointError, "not None"),
}  # fmt: skip


@pytest.fixture(scope="module")
def sim():
    sim = hs.Simulation(gas("3d_walls", 30, 0.1, seed=5))
    sim.run(collisions=100)
    return sim


@pytest.mark.parametrize("row", ENGINE)
@pytest.mark.skipif(os.name != "posix", reason="messages of POSIX systems")
def test_simulations(row, sim, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    call, error, sentence = ENGINE[row]
    with pytest.raises(error, match=sentence) as caught:
        call(sim)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_too_little_memory(monkeypatch):
    """Above a quarter of a gigabyte the machine is asked; the search's tables are counted before they are made."""
    monkeypatch.setattr(memory, "available_memory", lambda: 10**9)
    with pytest.raises(
        hs.SceneError, match=r"n = 4000000: .* 1.2 GB .*\(1200000000 bytes\), and 1 GB are available"
    ):
        hs.lattice_gas(4_000_000, seed=1)
    sim = hs.Simulation(gas("3d", 50, 0.4 / 4, seed=1))
    engine, at = sim._engine, sim._at
    count = engine.arrays.counter.copy()
    count[at.CONTACT_ROOM] = 10**8
    with pytest.raises(hs.SimulationError, match=r"search among 50 particles need about 3.2 GB"):
        engine._searching_arrays(count)
    count[at.CONTACT_ROOM] = 2**31
    with pytest.raises(hs.SimulationError, match="a table of 2147483648 entries, .* take fewer particles"):
        engine._searching_arrays(count)


# Checkpoints that lie.


def altered(name, place, value):
    def change(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name].flat[place] = value

    return change


def replaced(name, make):
    def change(arrays):
        arrays[name] = make(arrays[name])

    return change


def told(**changes):
    def change(arrays):
        about = json.loads(arrays["about"].tobytes()) | changes
        arrays["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)

    return change


def text(content):
    return replaced("about", lambda about: np.frombuffer(content, dtype=np.uint8))


FORGED = {
    "another version": (told(version=5, package="9.0"), "format is version 5, written by hardspheres '9.0'"),
    "an older version": (told(version=3), "format is version 3, .*; this one reads version 4"),
    "another program": (told(format="gas"), "does not say that it is a checkpoint"),
    "no words": (text(b"\xff\xfe"), "does not say that"),
    "deep words": (text(b"[" * 100_000), "does not say that"),
    "a list for words": (text(b"[1]"), "does not say that"),
    "boundary open": (told(boundary=["open"] * 3), "scene is impossible: boundary"),
    "boundary a word": (told(boundary="wall"), "boundary is not a list"),
    "boundary of one axis": (told(boundary=["wall", "wall"]), "boundary has 2 words for 3 axes"),
    "clock below zero": (told(clock=[-1, 0.5]), "clock .* is invalid"),
    "clock not finite": (told(clock=[0, float("inf")]), "clock .* is invalid"),
    "clock absurd": (told(clock=[10**400, 0.0]), "clock .* is invalid"),
    "clock in words": (told(clock=["now", 0.0]), "clock .* is invalid"),
    "clock of another epoch": (told(clock=[2**40, 0.0]), "clocks contradict"),
    "clock before the last event": (told(clock=[1, 0.0]), "clocks contradict"),
    "epoch of another length": (told(epoch_length=0.37), "epochs are 0.37 long"),
    "tallies from tomorrow": (told(tallied_since=[2**50, 0.0, 0, 0]), "tallies begin after its time"),
    "tallies of truth": (told(tallied_since=[0, 0.0, True, 0]), "clock or the start"),
    "no rows": (lambda arrays: arrays.pop("row"), r"\['row'\] too much or too little"),
    "no radii": (lambda arrays: arrays.pop("radii"), "it has no radii"),
    "something more": (lambda arrays: arrays.update(extra=np.zeros(1)), r"\['extra'\] too much"),
    "rows cut off": (replaced("row", lambda row: row[:-1]), r"row is float64 of shape \(29, 8\); .* \(30, 8\)"),
    "rows flat": (replaced("row", np.ravel), r"shape \(240,\)"),
    "rows whole numbers": (replaced("row", lambda row: row.astype(np.int64)), "row is int64"),
    "row nan": (altered("row", 8, np.nan), "row holds a value that is not finite"),
    "row far away": (altered("row", 8, 1e9), "further from the box"),
    "row beyond a wall": (altered("row", 9, -3.0), "further from the box"),
    "row fast": (altered("row", 8 + 3, 1e9), "kinetic energy is"),
    "row of tomorrow": (altered("row", 8 + 6, 1e9), "outside of the present epoch"),
    "row of another size": (altered("row", 8 + 7, 7.0), "other radii"),
    "sum inf": (altered("total", 3, np.inf), "total holds a value that is not finite"),
    "earlier sum inf": (altered("total_then", 3, np.inf), "total_then holds a value that is not finite"),
    "sum of parts": (altered("total", 3, 0.5), "a sum in total is not a whole number and a fraction"),
    "earlier sum of parts": (altered("total_then", -1, 0.75), "a sum in total_then is not"),
    "finer than fractions": (altered("total", -1, 2.0**-48), "a sum in total is not"),
    "counter below zero": (altered("counters", 1, -5), "counter is out of range"),
    "counter absurd": (altered("counters", 2, 2**62), "counter is out of range"),
    "turns absurd": (altered("turns", 2, -(2**63)), "counter is out of range"),
    "now nan": (altered("numbers", 0, np.nan), "numbers holds a value that is not finite"),
    "positions heaped": (replaced("positions", lambda x: np.ones_like(x)), "scene is impossible: particles 0 and"),
    "positions nan": (altered("positions", 4, np.nan), "scene is impossible: the position of particle 1"),
    "radii below zero": (altered("radii", 3, -0.5), "the radius of particle 3 is -0.5"),
    "masses of zero": (altered("masses", 3, 0.0), "the mass of particle 3 is 0.0"),
    "box of zero": (altered("box", 1, 0.0), "box edge along y is 0.0"),
}  # fmt: skip


def rows_heaped(arrays):
    arrays["row"] = arrays["row"].copy()
    arrays["row"][:, :3] = 0.5 * arrays["box"]


FORGED["rows heaped"] = (rows_heaped, "its particles overlap by 1 diameters")


@pytest.mark.parametrize("row", FORGED)
def test_forged_checkpoints(row, sim, tmp_path):
    """Sealed with a valid checksum, and still wrong: no kernel ever sees such numbers."""
    change, sentence = FORGED[row]
    sim.save(tmp_path / "checkpoint")
    arrays = archive.read_archive(tmp_path / "checkpoint")
    change(arrays)
    archive.write_archive(tmp_path / "checkpoint", arrays)
    with pytest.raises(hs.CheckpointError, match=sentence) as caught:
        hs.Simulation.load(tmp_path / "checkpoint")
    assert str(tmp_path / "checkpoint") in str(caught.value) and "\n" not in str(caught.value)


def test_the_forger_writes_what_is_taken_if_nothing_is_wrong(sim, tmp_path):
    """Sibling: it is the change that is refused."""
    sim.save(tmp_path / "checkpoint")
    archive.write_archive(tmp_path / "checkpoint", archive.read_archive(tmp_path / "checkpoint"))
    assert hs.Simulation.load(tmp_path / "checkpoint").collisions == 100


class Evil:
    def __reduce__(self):
        return (open, ("executed", "w"))


def npy(shape, kind="<f8", content=b"", version=(1, 0)):
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}}}".encode().ljust(118) + b"\n"
    return b"\x93NUMPY" + bytes(version) + len(header).to_bytes(2, "little") + header + content


FILES = {
    "empty": (b"", "is empty, not a checkpoint"),
    "text": (b"hello, world\n" * 100, "not a checkpoint: it does not begin as one"),
    "a pickle": (pickle.dumps(Evil()), "not a checkpoint"),
    "a zip": (("about.npy", npy("(0,)"), zipfile.ZIP_STORED, False), "its end is missing"),
    "objects": (("about.npy", npy("(1,)", "|O", pickle.dumps(Evil())), 0, True), "holds object, not plain numbers"),
    "text in it": (("about.npy", npy("(1,)", "<U2", b"x" * 8), 0, True), "not plain numbers"),
    "absurd size": (("about.npy", npy("(10**15,)"), 0, True), "not a checkpoint as this package writes"),
    "huge size": (("about.npy", npy("(1000000000000000,)"), 0, True), "declares the shape"),
    "negative size": (("about.npy", npy("(-1, -1)", "<f8", b"x" * 8), 0, True), "not a checkpoint as"),
    "endless header": (("about.npy", npy("(" + "(" * 50_000), 0, True), "not a checkpoint as"),
    "code in the header": (("about.npy", npy("open('executed', 'w')"), 0, True), "not a checkpoint as"),
    "another npy": (("about.npy", npy("(0,)", version=(3, 0)), 0, True), "another version of .npy"),
    "no npy": (("about.npy", b"nothing", 0, True), "not a checkpoint as"),
    "a zip bomb": (("about.npy", bytes(10**7), zipfile.ZIP_DEFLATED, True), "a member is compressed"),
    "by columns": (("about.npy", npy("(0,)").replace(b"False", b"True "), 0, True), "not plain numbers row by row"),
}  # fmt: skip


@pytest.mark.parametrize("row", FILES)
def test_files_that_are_no_checkpoints(row, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    content, sentence = FILES[row]
    if isinstance(content, tuple):
        name, member, method, sealed = content
        with open("file", "w+b") as file:
            with zipfile.ZipFile(file, "w", method) as archived:
                archived.comment = archive.SEAL + b"0" * archive.DIGEST if sealed else b""
                archived.writestr(name, member)
            if sealed:
                archive._seal(file)
    else:
        (tmp_path / "file").write_bytes(content)
    with pytest.raises(hs.CheckpointError, match=sentence):
        hs.Simulation.load("file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]  # nothing was executed


# The command line, and files for --from.

HEAD = 'Lattice="10 0 0 0 10 0 0 0 10" Properties=species:S:1:pos:R:3:radius:R:1 pbc="T T T"'
XYZ = f"2\n{HEAD}\nX 1 1 1 0.5\nX 5 5 5 0.5\n"
STRUCTURES = {
    "good.xyz": XYZ,
    "empty.xyz": "",
    "binary.xyz": bytes(range(256)) * 20,
    "binary.traj": bytes(range(256)) * 20,
    "binary.gsd": bytes(range(256)) * 20,
    "empty.gsd": "",
    "cut.xyz": XYZ[:-15],
    "column.xyz": XYZ.replace("X 5 5 5 0.5", "X 5 5 0.5"),
    "words.xyz": XYZ.replace("X 5 5 5", "X 5 five 5"),
    "nan.xyz": XYZ.replace("X 5 5 5", "X 5 nan 5"),
    "size.xyz": XYZ.replace("5 0.5", "5 -0.5"),
    "cell.xyz": XYZ.replace('Lattice="10 0 0 0 10 0 0 0 10" ', ""),
    "oblique.xyz": XYZ.replace("10 0 0 0 10", "10 0 0 3 10"),
    "flat.xyz": XYZ.replace("0 0 0 10 0 0 0 10", "0 0 0 10 0 0 0 0"),
    "outside.xyz": XYZ.replace("T T T", "T F T").replace("1 1 1", "1 0.1 1"),
    "overlap.xyz": XYZ.replace("5 5 5", "1 1 1.5"),
    "short.xyz": XYZ.replace("10 0 0 0 10 0 0 0 10", "10 0 0 0 10 0 0 0 1.5").replace("5 5 5", "5 5 1"),
    "velo.xyz": XYZ.replace("radius:R:1", "radius:R:1:velo:R:3").replace("0.5\n", "0.5 1 0 0\n"),
    "none.xyz": f"0\n{HEAD}\n",
    "many.xyz": XYZ.replace("2\n", "999999999999\n", 1),
    "huge.xyz": XYZ.replace('"10 0', '"1e12 0'),
    "rest.xyz": XYZ,
}
CLI = {
    "n absurd": (["thermalise", "--n", "1000000000000"], "300 TB of memory (300000000000000 bytes)"),
    "n absurd, mixture": (["mixture", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, pressure": (["pressure", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, diffusion": (["diffusion", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, bench": (["bench", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, dense": (["pressure", "--packing-fractions", "0.45", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, suite": (["bench", "--suite", "quick", "--n", "500", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, accuracy": (["accuracy", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, free paths": (["free-path", "--n", "1000000000000"], "300 TB of memory"),
    "n absurd, soak": (["soak", "--n", "1000000000000"], "300 TB of memory"),
    "eta tiny": (["thermalise", "--packing-fraction", "1e-300"], "take a smaller box (a higher packing fraction)"),
    "eta nan": (["thermalise", "--packing-fraction", "nan"], "packing_fraction is nan"),
    "etas nonsense": (["pressure", "--packing-fractions", "a:b"], "--packing-fraction a:b is not understood"),
    "etas above one": (["diffusion", "--packing-fractions", "0.1,1.5"], "has 1.5; expected numbers between 0 and 1"),
    "out empty": (["thermalise", "--out", ""], "--out is empty; name a folder"),
    "out blank": (["pressure", "--out", " "], "--out is empty"),
    "out endless": (["thermalise", "--out", "a" * 300], "name too long; give another one with --out"),
    "out in a file": (["thermalise", "--out", "good.xyz/x"], "good.xyz cannot be written to"),
    "boundary of two": (["thermalise", "--boundary", "wall,periodic"], "boundary has 2 words for 3 axes"),
    "temperature nan": (["thermalise", "--temperature", "nan"], "temperature is nan"),
    "ratio nan": (["thermalise", "--mass-ratio", "nan"], "nan"),
    "length nan": (["thermalise", "--collisions-per-particle", "nan"], "--collisions-per-particle nan must be"),
    "length inf": (["thermalise", "--collisions-per-particle", "inf"], "must be positive, and at most 1e+09"),
    "length absurd": (["pressure", "--collisions-per-particle", "1e300"], "1e+300 would never end; ask for at most"),
    "length inf, diffusion": (["diffusion", "--collisions-per-particle", "inf"], "would never end"),
    "discard nan": (["bench", "--discard", "nan"], "--discard nan must be at least 0, and at most 1e+09"),
    "etas inf": (["pressure", "--packing-fractions", "0.1:inf:3"], "has nan; expected numbers between 0 and 1"),
    "ratio absurd": (["thermalise", "--diameter-ratio", "1e300"], "give an infinite volume; take a larger unit"),
    "etas too many": (["pressure", "--packing-fractions", "0.1:0.2:1000000000000"], "too many; ask for at most 10000"),
    "nothing to resume": (["hard-cases", "--resume"], "hard-cases-full holds no unfinished run"),
    "nothing to resume, accuracy": (["accuracy", "--resume"], "accuracy-1 holds no unfinished run"),
    "empty file": (["thermalise", "--from", "empty.xyz"], "empty.xyz is empty"),
    "binary file": (["thermalise", "--from", "binary.xyz"], "binary.xyz, line 1: the number of particles"),
    "binary traj": (["thermalise", "--from", "binary.traj"], "binary.traj cannot be read by ASE"),
    "binary gsd": (["thermalise", "--from", "binary.gsd"], "binary.gsd cannot be read as a trajectory of HOOMD (RuntimeE"),
    "empty gsd": (["thermalise", "--from", "empty.gsd"], "empty.gsd is empty"),
    "gsd of no gas": (["view", "binary.gsd"], "binary.gsd cannot be read as a trajectory of HOOMD"),
    "cut file": (["thermalise", "--from", "cut.xyz"], "cut.xyz says in line 1 that 2 particles follow where 1"),
    "missing column": (["thermalise", "--from", "column.xyz"], "column.xyz, line 4: there are 4 values"),
    "words": (["thermalise", "--from", "words.xyz"], "words.xyz, line 4: 'five' in the column pos"),
    "nan": (["thermalise", "--from", "nan.xyz"], "the position of particle 1 along y is nan"),
    "negative size": (["thermalise", "--from", "size.xyz"], "the radius of particle 1 is -0.5"),
    "no cell": (["thermalise", "--from", "cell.xyz"], "there is no cell; give the box as an orthogonal cell"),
    "oblique cell": (["thermalise", "--from", "oblique.xyz"], "the cell is not orthogonal"),
    "two dimensions": (["thermalise", "--from", "flat.xyz"], "particles 0 and 1 differ in z"),
    "outside": (["thermalise", "--from", "outside.xyz"], "particle 0 reaches 0.4 beyond a wall along y"),
    "overlap": (["thermalise", "--from", "overlap.xyz"], "particles 0 and 1 overlap by 0.5 diameters"),
    "short axis": (["thermalise", "--from", "short.xyz"], "edge along z is 1.5, but a periodic axis"),
    "velo": (["thermalise", "--from", "velo.xyz"], 'in a column "velo", whose unit differs'),
    "no particles": (["thermalise", "--from", "none.xyz"], "none.xyz"),
    "many promised": (["thermalise", "--from", "many.xyz"], "many.xyz says in line 1 that 999999999999 particles follow where 2"),
    "huge cell": (["thermalise", "--from", "huge.xyz"], "edge along x is 1e+12, where rounding"),
    "an endless name": (["thermalise", "--from", "a" * 300 + ".xyz"], "cannot be read: File name too long; give another"),
    "a device": (["thermalise", "--from", os.devnull], "is empty"),
    "a folder": (["thermalise", "--from", "."], "is a folder; give a file"),
    "radius nan": (["thermalise", "--from", "good.xyz", "--radius", "nan"], "the radius of particle 0 is nan"),
}  # fmt: skip


@pytest.mark.parametrize("row", CLI)
def test_command_line(row, tmp_path, monkeypatch, capsys):
    """The same function that the console script calls: exit code 2, one sentence, nothing left behind."""
    options, sentence = CLI[row]
    for name, content in STRUCTURES.items():
        if name in options or f"{name}/x" in options:
            (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", *options])
    monkeypatch.setattr("signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as end:
        cli.main()
    out, errors = capsys.readouterr()
    assert end.value.code == 2
    assert errors.startswith("error: ") and errors.count("\n") == 1 and out == ""
    assert sentence in errors
    assert sorted(tmp_path.iterdir()) == before


def test_a_real_process_says_the_same(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "studies", "thermalise", "--n", "1000000000000"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: n = 1000000000000") and done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


SIGNAL = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
SWALLOWED = (
    "try:\n    import os, signal\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException:\n    pass\n"
)


@pytest.mark.usefixtures("heard")
@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
@pytest.mark.parametrize(
    ("module", "content", "options"),
    [("typer", SIGNAL, "--help"), ("typer", SWALLOWED, "--help"), ("numpy", SIGNAL, "thermalise")],
)
def test_an_interrupt_while_modules_are_loaded(module, content, options, tmp_path):
    """A module that sends the signal as it is imported: no traceback even then, and no interrupt that is lost."""
    (tmp_path / f"{module}.py").write_text(content)
    done = subprocess.run(
        [sys.executable, "-m", "studies", options],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr, done.stdout) == (130, "interrupted\n", "")
    assert not [path for path in tmp_path.iterdir() if path.is_dir() and path.name != "__pycache__"]


# Anything at all.

NASTY = st.sampled_from(
    [0.0, -0.0, -1.0, 0.5, 1.0, 3.0, 1e-12, 1e12, 1e-300, 1e300, 5e-324, np.nan, np.inf, -np.inf]
)


@st.composite
def arguments(draw):
    """A legal scene of three particles with one to three numbers, shapes or types replaced."""
    given = {
        "positions": np.array([[1.0, 1, 1], [4, 4, 4], [4, 1, 7]]),
        "velocities": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0.5, 1]]),
        "radii": np.full(3, 0.5),
        "masses": np.ones(3),
        "box": np.array([8.0, 8.0, 8.0]),
        "boundary": ["periodic"] * 3,
    }
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(given)))
        if name == "boundary":
            given[name] = draw(st.lists(st.sampled_from(["periodic", "wall", "open", 3]), max_size=4))
        elif not isinstance(given[name], np.ndarray) or draw(st.integers(0, 5)) == 0:
            given[name] = draw(
                st.one_of(
                    st.none(), st.text(max_size=3), NASTY, st.lists(NASTY, max_size=4), st.just([[1.0], []])
                )
            )
        else:
            given[name] = given[name].copy()
            given[name].flat[draw(st.integers(0, given[name].size - 1))] = draw(NASTY)
    return given


@settings(max_examples=200)
@given(arguments())
def test_any_scene_is_refused_or_sound(given):
    try:
        scene = hs.Scene(**given)
    except hs.SceneError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(scene.positions).all()
    assert scene.n == 3


@settings(max_examples=100)
@given(
    st.lists(
        st.tuples(st.integers(0, len(XYZ) - 1), st.characters(min_codepoint=1, max_codepoint=127)), max_size=3
    ),
    st.integers(0, len(XYZ)),
)
@example([(0, "9")], len(XYZ))
@example([], 0)
def test_any_xyz_is_refused_or_read(tmp_path_factory, changes, length):
    content = list(XYZ)
    for place, character in changes:
        content[place] = character
    path = tmp_path_factory.mktemp("xyz") / "structure.xyz"
    path.write_text("".join(content)[: length or None], encoding="ascii")
    try:
        scene = hs.Scene.from_atoms(read_structure(path))
    except hs.HardSpheresError as error:
        assert "\n" not in str(error)
        return
    assert scene.n >= 1


# Legal, and extreme.

EXTREME = {
    "touching": two(velocities=[[1.0, 0, 0], [-1.0, 0, 0]]),
    "a touching row between walls": hs.Scene(
        np.column_stack([np.arange(0.5, 10.0), np.full((10, 2), 5.0)]),
        np.column_stack([np.linspace(-1, 1, 10), np.zeros((10, 2))]),
        box=(10.5, 10, 10),
        boundary="wall",
    ),
    "mass ratio 1e12": two(
        positions=[[1.0, 1, 1], [4.0, 1.2, 1]],
        velocities=[[1e-6, 0, 0], [-1.0, 0, 0]],
        masses=[1e12, 1.0],
        radii=[0.5, 0.4],
    ),
    "one particle": hs.Scene([[1.0, 1, 1]], [[0.3, 0, 0]], box=(3, 3, 3)),
    "no motion": two(),
}


@pytest.mark.parametrize("name", EXTREME)
def test_legal_but_extreme_scenes_run(name, tmp_path):
    sim = hs.Simulation(EXTREME[name])
    sim.run(time=7.3)
    sim.check()
    sim.save(tmp_path / "checkpoint")
    hs.Simulation.load(tmp_path / "checkpoint").check()
