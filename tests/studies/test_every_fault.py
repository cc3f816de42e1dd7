"""Every n-th write, rename, sync or removal of a study fails, once or from then on: it says so, and resumes to the same bytes.

SQLite's habit (https://sqlite.org/testing.html, I/O error tests). The operations are counted in this process, below the
output folder only: files are opened with a raw layer of ours, so that buffers fail where they really do.

Default tests: some of the operations. Slow: one of each kind. Long: `pytest -m long tests/studies/test_every_fault.py`, all.
"""

import builtins
import contextlib
import errno
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import warnings

import pytest
from matplotlib.figure import Figure
from scenes import gas

import hardspheres as hs
from studies import cli
from studies.pressure import EquationOfState
from studies.recording import Trajectory
from studies.running.journal import Shelf
from studies.running.kept import finished_run
from studies.thermalisation import Thermalisation

from .pages import masked

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="errors of POSIX systems")

PRESSURE = ["pressure", "--packing-fractions", "0.1", "--n", "60", "--replicas", "2", "--workers", "1"]
PRESSURE += ["--collisions-per-particle", "15", "--checkpoint-every", "0"]
THERMALISE = ["thermalise", "--n", "60", "--replicas", "2", "--workers", "1", "--checkpoint-every", "0"]
THERMALISE += ["--collisions-per-particle", "2", "--frames", "4"]
STUDIES = {"pressure": PRESSURE, "thermalise": THERMALISE}
KEPT = "the same command with --resume continues"
ON_PATHS = ("replace", "rename", "link", "unlink", "mkdir", "rmdir")
HOW = pytest.mark.parametrize("forever", [False, True], ids=["once", "from then on"])


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """So that no command says that it has compiled the engine."""
    for packing_fraction in (0.005, 0.1):
        hs.Simulation(gas("3d", 60, packing_fraction)).run(collisions=1)


def kind(done, k):
    """What operation k is, on which file, whatever its number; for one that names no file what came before it, too."""
    what = re.sub(r"[0-9a-f]{8,}|\d+", "#", done[k])
    return what if " " in what or not k else f"{kind(done, k - 1)}, {what}"


def one_of_each(done, forever):
    """Numbers of the first operation of each kind, or of the last where all from it on fail."""
    kinds = {}
    for k in range(len(done)):
        if forever or kind(done, k) not in kinds:
            kinds[kind(done, k)] = k + 1
    return sorted(kinds.values())


def every(step):
    """All of them, or one in so many."""
    return lambda done, _: range(1, len(done) + 1, step)


class Faults:
    """Counts what is done to files below a folder, and lets some of it fail."""

    def __init__(self, root):
        self.root, self.fails, self.done = os.fspath(root), lambda number: False, []
        self.os = {name: getattr(os, name) for name in (*ON_PATHS, "fsync")}
        self.open = io.open

    def next(self, what, path=""):
        self.done.append(f"{what} {os.path.relpath(path, self.root)}" if path else what)
        if self.fails(len(self.done)):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), os.fspath(path) or None)

    def below(self, path):
        return isinstance(path, (str, os.PathLike)) and os.path.abspath(path).startswith(self.root)

    def on_path(self, name):
        def called(path, *more, **named):
            if self.below(path):
                self.next(name, path)
            return self.os[name](path, *more, **named)

        return called

    def fsync(self, handle):
        self.next("fsync")
        self.os["fsync"](handle)

    def opened(self, path, mode="r", buffering=-1, encoding=None, errors=None, newline=None, *more, **named):
        if not self.below(path) or not set(mode) & set("wxa+"):
            return self.open(path, mode, buffering, encoding, errors, newline, *more, **named)
        self.next("open", path)
        faults = self

        class Raw(io.FileIO):
            def write(self, content):
                faults.next("write", path)
                return super().write(content)

            def truncate(self, *size):
                faults.next("truncate", path)
                return super().truncate(*size)

        raw = Raw(path, mode.replace("b", "").replace("t", ""))
        buffer = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return buffer if "b" in mode else io.TextIOWrapper(buffer, encoding, errors, newline)

    def install(self, patch):
        for name in ON_PATHS:
            patch.setattr(os, name, self.on_path(name))
        patch.setattr(os, "fsync", self.fsync)
        patch.setattr(builtins, "open", self.opened)
        patch.setattr(io, "open", self.opened)


def without_timings(value):
    if isinstance(value, dict):
        return {key: without_timings(entry) for key, entry in value.items() if "second" not in key}
    return [without_timings(entry) for entry in value] if isinstance(value, list) else value


def contents(folder):
    """Every file of a folder but for timings; no folder may be left in it but that of replicas, which are whole."""
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "replicas"}
    kept = finished_run(folder)
    files["replicas"] = [replica.digest for own in kept.replicas for replica in own]
    files["report.html"] = masked(files["report.html"].decode())
    files["summary.json"] = json.dumps(without_timings(json.loads(files["summary.json"])))
    return files


@pytest.fixture
def study(monkeypatch, capsys):
    """Run a command in this process: its exit code, and what it wrote to standard error."""
    for kind, name in ((EquationOfState, "equation_of_state"), (Thermalisation, "relaxation")):
        # pictures have tests of their own, and cost time
        monkeypatch.setattr(kind, "figures", lambda *_, name=name: {name: Figure(figsize=(1, 1))})
    save = Shelf.save

    def run(*options):
        monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
        calls = itertools.count()
        monkeypatch.setattr(Shelf, "save", lambda *its: None if next(calls) % 40 else save(*its))
        capsys.readouterr()
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code or 0, capsys.readouterr().err

    return run


def operations(study, options, out):
    """What an undisturbed run does to files, and the bytes that it leaves."""
    faults = Faults(out)
    with pytest.MonkeyPatch.context() as patch:
        faults.install(patch)
        assert study(*options, "--out", out) == (0, "")
    return faults.done, contents(out)


def try_fault(study, options, out, number, forever, right):
    """Let one operation fail, or all from then on; then go on as the program says."""
    faults = Faults(out)
    faults.fails = lambda n: n == number or (forever and n > number)
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("default", "the run is finished")
        warnings.showwarning = lambda message, *_: print(message, file=sys.stderr)
        faults.install(patch)
        code, errors = study(*options, "--out", out)
    which = f"{number}: {faults.done[number - 1]}: {code} {errors}"
    going_on = (out / "checkpoint" / "manifest.json").exists()
    finished = (out / "summary.json").exists() and not going_on
    assert code == (0 if finished else 2), which
    if code:
        assert errors.startswith("error: ") and errors.count("\n") == 1 and "No space left" in errors, which
        assert (KEPT in errors) == going_on, which
        code, errors = study(*options, "--out", out, *(["--resume"] if going_on else []))
        assert code == 0, f"{which}, then {errors}"
    elif "unlink checkpoint/done" in which:
        assert "the run is finished, but " in errors and "remove it by hand" in errors, which
    left = contents_without_leftovers(out)
    assert left == right, f"{which}: {sorted(left)}"


def contents_without_leftovers(out):
    """As `contents`, but for what could not be removed: the next run does, when this process has ended."""
    leftovers = (out.glob(f"{place}.partial-*") for place in ("", "checkpoint/", "replicas/"))
    for path in itertools.chain(*leftovers):
        path.unlink()
    if (out / "checkpoint").exists():
        names = {path.name for path in (out / "checkpoint").iterdir()}
        assert names <= {"lock"} or not names & {"manifest.json"}
        for name in names:
            (out / "checkpoint" / name).unlink()
        (out / "checkpoint").rmdir()
    return contents(out)


def sweep(study, options, tmp_path, chosen, forever):
    done, right = operations(study, options, tmp_path / "whole")
    assert len(done) > 40 and {line.split()[0] for line in done} >= {
        "open",
        "write",
        "replace",
        "unlink",
        "fsync",
    }
    for number in chosen(done, forever):
        try_fault(study, options, tmp_path / f"out-{number}-{forever}", number, forever, right)


@HOW
def test_some_operations_fail(study, forever, tmp_path):
    sweep(study, PRESSURE, tmp_path, every(17), forever)


def test_one_study_does_all_that_the_other_does(study, tmp_path):
    """So that one of each kind of operation of one will do. Sibling: the other writes no trajectory."""
    kinds = {}
    for name, options in STUDIES.items():
        done, _ = operations(study, options, tmp_path / name)
        kinds[name] = {kind(done, k) for k in range(len(done))}
        assert {kind(done, k - 1) for k in one_of_each(done, False)} == kinds[name]
    assert kinds["pressure"] < kinds["thermalise"]


@pytest.mark.slow
@HOW
def test_one_of_each_kind_of_operation_fails(study, forever, tmp_path):
    sweep(study, THERMALISE, tmp_path, one_of_each, forever)


@pytest.mark.long
@HOW
@pytest.mark.parametrize("name", STUDIES)
def test_every_operation_fails(study, name, forever, tmp_path):
    sweep(study, STUDIES[name], tmp_path, every(1), forever)


def extended(study, tmp_path, chosen, forever):
    """A finished run of two replicas is asked for three; whatever fails, the old results are there, or it goes on."""
    more = [*PRESSURE, "--replicas", "3"]
    assert study(*more, "--out", tmp_path / "direct") == (0, "")
    assert study(*PRESSURE, "--out", tmp_path / "two") == (0, "")
    old, right = contents(tmp_path / "two"), contents(tmp_path / "direct")
    shutil.copytree(tmp_path / "two", tmp_path / "whole")
    faults = Faults(tmp_path / "whole")
    with pytest.MonkeyPatch.context() as patch:
        faults.install(patch)
        code, told = study(*more, "--out", tmp_path / "whole")
    assert (code, told, contents(tmp_path / "whole")) == (0, "2 of 3 replicas were there\n", right)
    left = set()
    for number in chosen(faults.done, forever):
        out = tmp_path / f"out-{number}-{forever}"
        shutil.copytree(tmp_path / "two", out)
        failing = Faults(out)
        failing.fails = lambda n, first=number: n == first or (forever and n > first)
        with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            failing.install(patch)
            code, errors = study(*more, "--out", out)
        which = f"{number}: {faults.done[number - 1]}: {code} {errors}"
        going_on = (out / "checkpoint" / "manifest.json").exists()
        left.add((code, going_on))
        if code:
            assert "error: " in errors and "No space left" in errors and (KEPT in errors) == going_on, which
            if not going_on:
                assert contents_without_leftovers(out) == old, which
            code, errors = study(*more, "--out", out, *(["--resume"] if going_on else []))
            assert code == 0, f"{which}, then {errors}"
        assert contents_without_leftovers(out) == right, which
    assert (2, True) in left


@HOW
def test_some_operations_fail_while_a_run_is_extended(study, forever, tmp_path):
    extended(study, tmp_path, every(13), forever)


SHARDS = (["--shard", "1/2"], ["--shard", "2/2"])


def try_shards(study, out, fails):
    """Run two shards one after the other while operations fail; what they did, and how they ended."""
    faults = Faults(out)
    faults.fails = fails
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        faults.install(patch)
        return faults.done, [study(*PRESSURE, "--out", out, *shard) for shard in SHARDS]


def sweep_shards(study, tmp_path, chosen, forever):
    """A shard of which something failed says so, goes on when it is started again, and is gathered to the same bytes."""
    done, ends = try_shards(study, tmp_path / "whole", lambda _: False)
    assert [code for code, _ in ends] == [0, 0] and len(done) > 30
    assert {"unlink checkpoint/shard", "link checkpoint/.partial"} <= {line[:24].rstrip("-") for line in done}
    assert study(*PRESSURE, "--out", tmp_path / "whole", "--resume")[0] == 0
    right = contents(tmp_path / "whole")
    assert right == operations(study, PRESSURE, tmp_path / "alone")[1]
    for number in chosen(done, forever):
        out = tmp_path / f"out-{number}"
        _, ends = try_shards(study, out, lambda n, number=number: n == number or (forever and n > number))
        which = f"{number}: {done[number - 1]}: {ends}"
        for left in out.glob("checkpoint/shard-*"):  # of this process: a shard's would have ended
            left.unlink()
        for shard, (code, errors) in zip(SHARDS, ends, strict=True):
            assert (code == 0 and errors == "") or (code == 2 and "No space left" in errors), which
            assert code == 0 or (errors.startswith("error: ") and errors.count("\n") == 1), which
            assert code == 0 or study(*PRESSURE, "--out", out, *shard) == (0, ""), which
        assert study(*PRESSURE, "--out", out, "--resume") == (0, ""), which
        assert contents_without_leftovers(out) == right, which


def test_some_operations_of_shards_fail(study, tmp_path):
    sweep_shards(study, tmp_path, every(19), forever=True)


@pytest.mark.slow
@HOW
def test_one_of_each_kind_of_operation_fails_while_a_run_is_extended(study, forever, tmp_path):
    extended(study, tmp_path, one_of_each, forever)


@pytest.mark.long
@HOW
def test_every_operation_fails_while_a_run_is_extended(study, forever, tmp_path):
    extended(study, tmp_path, every(1), forever)


@pytest.mark.slow
@HOW
def test_one_of_each_kind_of_operation_of_shards_fails(study, forever, tmp_path):
    sweep_shards(study, tmp_path, one_of_each, forever)


@pytest.mark.long
@HOW
def test_every_operation_of_shards_fails(study, forever, tmp_path):
    sweep_shards(study, tmp_path, every(1), forever)


class Killed(BaseException):
    """What ends a shard without a word."""


def test_three_shards_of_which_one_is_killed_give_the_same_bytes(study, tmp_path, monkeypatch):
    """While it writes the trajectory; in real processes in test_faults."""
    right, out = operations(study, THERMALISE, tmp_path / "whole")[1], tmp_path / "out"

    def add(trajectory, frame):
        if trajectory.written == 2:
            raise Killed
        whole(trajectory, frame)

    whole = Trajectory.add
    with monkeypatch.context() as patch, subprocess.Popen([sys.executable, "-c", ""]) as ended:
        patch.setattr(os, "getpid", lambda: ended.pid)
        patch.setattr("studies.output.renewing", lambda _: contextlib.nullcontext())  # nothing is tidied up
        patch.setattr(Trajectory, "add", add)
        with pytest.raises(Killed):
            study(*THERMALISE, "--out", out, "--shard", "1/3")
    names = {path.name for path in (out / "checkpoint").iterdir()}
    assert names >= {"trajectory.xyz", "running-0002.npz", "claim-0002"} and "done-0002.npz" not in names
    for last in (["--shard", "3/3"], ["--shard", "2/3"], ["--resume"]):
        assert not (out / "summary.json").exists()
        assert study(*THERMALISE, "--out", out, *last) == (0, "")
    assert contents(out) == right


def test_a_manifest_that_is_written_in_its_place_is_found_out(study, tmp_path, monkeypatch):
    """Sibling: not beside it and then renamed, so that a write that fails leaves half of one."""
    monkeypatch.setattr("studies.running.journal.replacing", contextlib.nullcontext)
    done, right = operations(study, PRESSURE, tmp_path / "whole")
    number = 1 + next(k for k, what in enumerate(done) if what == "write checkpoint/manifest.json")
    with pytest.raises(AssertionError, match="write checkpoint/manifest.json: 2 error"):
        try_fault(study, PRESSURE, tmp_path / "out", number, True, right)
