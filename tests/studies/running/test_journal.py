"""One run at a time in a folder; to be resumed with its own options, or not at all."""

import itertools
import multiprocessing
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from damaged import damaged

import hardspheres as hs
from hardspheres.errors import CheckpointError
from studies.mixture import Mixture
from studies.output import OutputFolder
from studies.pressure import EquationOfState
from studies.running.journal import Journal, OutputError, Shelf, about, options_of
from studies.running.locking import Lock
from studies.thermalisation import Thermalisation
from studies.validation.soak import Soak

STUDY = EquationOfState(packing_fractions=(0.1, 0.3), n=500, collisions_per_particle=50.0, replicas=3, seed=4)


def interrupted(path, study=STUDY):
    with pytest.raises(KeyboardInterrupt) as caught, OutputFolder(path).running(study):
        raise KeyboardInterrupt
    return caught.value


def test_an_interrupted_run_says_how_to_go_on(tmp_path):
    error = interrupted(tmp_path / "out")
    assert error.__notes__ == [
        f"what was done is kept in {tmp_path / 'out' / 'checkpoint'}: the same command with --resume continues"
    ]
    assert sorted(path.name for path in (tmp_path / "out" / "checkpoint").iterdir()) == [
        "lock",
        "manifest.json",
    ]


def test_a_finished_run_leaves_nothing_and_there_is_nothing_to_resume(tmp_path):
    with OutputFolder(tmp_path).running(STUDY) as shelf:
        shelf.store(0, 1.0)
        shelf.save(1, 2.0)
    assert not list(tmp_path.iterdir())
    with pytest.raises(CheckpointError, match="holds no unfinished run, so there is nothing to resume"):
        OutputFolder(tmp_path, resume=True).check(STUDY)
    assert not list(tmp_path.iterdir())


def test_an_unfinished_run_is_not_overwritten(tmp_path):
    interrupted(tmp_path)
    for use in (lambda out: out.check(STUDY), lambda out: out.running(STUDY).__enter__()):
        with pytest.raises(CheckpointError, match=r"holds an unfinished run; add --resume .* or --force"):
            use(OutputFolder(tmp_path))


def test_what_is_kept_is_found_again(tmp_path):
    with pytest.raises(ZeroDivisionError), OutputFolder(tmp_path).running(STUDY) as shelf:
        shelf.store(3, (1, 2))
        raise ZeroDivisionError
    with OutputFolder(tmp_path, resume=True).running(STUDY) as shelf:
        assert shelf.result(3) == ((1, 2),) and shelf.result(0) is None and shelf.state(3) is None


@pytest.mark.parametrize(
    ("other", "sentence"),
    [
        (replace(STUDY, seed=5), "--seed 4, not 5"),
        (replace(STUDY, replicas=2), "--replicas 3, not 2"),
        (replace(STUDY, packing_fractions=(0.1,)), "--packing-fraction 0.1,0.3, not 0.1;"),
        (replace(STUDY, boundary="wall"), "--boundary periodic, not wall"),
        (replace(STUDY, collisions_per_particle=50.5), "--collisions-per-particle 50.0, not 50.5"),
        (Mixture(), "of another study: pressure, not mixture"),
    ],
)
def test_other_options_are_refused_by_name(other, sentence, tmp_path):
    interrupted(tmp_path)
    with pytest.raises(CheckpointError) as caught:
        OutputFolder(tmp_path, resume=True).check(other)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_workers_and_the_interval_may_change(tmp_path):
    interrupted(tmp_path)
    OutputFolder(tmp_path, resume=True, checkpoint_every=1.0).check(replace(STUDY, workers=7))


def test_another_version_and_a_manifest_that_is_none_are_refused(tmp_path, monkeypatch):
    interrupted(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(hs, "__version__", "9.9", raising=False)
        with pytest.raises(CheckpointError, match="another version: .*, not 9.9"):
            OutputFolder(tmp_path, resume=True).check(STUDY)
    for text in ("", "[1]", '{"study": 1}', "\0", "[" * 10_000):
        (tmp_path / "checkpoint" / "manifest.json").write_text(text)
        with pytest.raises(OutputError, match="manifest.json cannot be understood"):
            OutputFolder(tmp_path, resume=True).check(STUDY)


def test_a_checkpoint_folder_that_cannot_be_one_is_refused(tmp_path):
    """A file of its name; a folder in the place of the lock."""
    (tmp_path / "file").mkdir()
    (tmp_path / "file" / "checkpoint").touch()
    (tmp_path / "folder" / "checkpoint" / "lock").mkdir(parents=True)
    for name, sentence in (
        ("file", "checkpoint is a file, not the folder of a run"),
        ("folder", "lock cannot be written: Is a dir"),
    ):
        for use in (OutputFolder.check, lambda out, study: out.running(study).__enter__()):
            with pytest.raises(OutputError, match=sentence):
                use(OutputFolder(tmp_path / name), STUDY)


class Killed(BaseException):
    pass


def kill_after(count, patch, *names):
    """From the given call of one of these on, all raise."""
    calls = itertools.count()

    def dying(call):
        def called(*names, **options):
            if next(calls) >= count:
                raise Killed
            return call(*names, **options)

        return called

    for owner, name in names:
        patch.setattr(owner, name, dying(getattr(owner, name)))


def test_a_run_that_was_killed_as_it_began_leaves_a_folder_that_is_known_as_ours(tmp_path, monkeypatch):
    """Killed before each of the calls that make something: also before what is in the lock is written."""
    for count in itertools.count():
        out = tmp_path / str(count)
        with monkeypatch.context() as patch:
            kill_after(
                count, patch, (Path, "mkdir"), (Path, "write_bytes"), (Path, "write_text"), (Path, "unlink"),
                (os, "open"), (os, "write"), (os, "link"), (os, "replace"),
            )  # fmt: skip
            try:
                interrupted(out)
                break
            except Killed:
                pass
        resume = (out / "checkpoint" / "manifest.json").exists()
        with OutputFolder(out, resume=resume).running(STUDY):
            pass
        assert not list(out.iterdir())
    assert count >= 8


def test_a_lock_is_made_where_there_are_no_hard_links(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", lambda *_: os.stat(tmp_path / "no such call"))
    lock = Lock(tmp_path / "lock")
    assert lock.acquire() and lock.is_ours() and [path.name for path in tmp_path.iterdir()] == ["lock"]
    if sys.platform != "win32":
        assert not Lock(tmp_path / "lock").acquire()


def test_what_a_run_left_that_was_killed_while_it_tidied_up_is_used_again(tmp_path, monkeypatch):
    """Killed after each of the calls that remove something: the folder is known as ours to the end."""

    def run(out):
        with OutputFolder(out).running(STUDY) as shelf:
            shelf.store(0, 1.0)
            shelf.save(1, 2.0)
            yield  # from now on the folder is removed

    for count in itertools.count():
        out, running = tmp_path / str(count), run(tmp_path / str(count))
        next(running)
        with monkeypatch.context() as patch:
            kill_after(count, patch, (os, "replace"), (Path, "unlink"), (Path, "rmdir"))
            try:
                next(running, None)
                break
            except Killed:
                pass
        left = {path.name for path in (out / "checkpoint").iterdir()}
        if "manifest.json" in left:
            assert count == 0  # killed before anything was removed: there is something to resume
            continue
        with OutputFolder(out).running(STUDY) as shelf:
            assert shelf.result(0) is None and shelf.state(1) is None
        assert not list(out.iterdir())
    assert count >= 5


def test_all_options_of_all_studies_count():
    scene = hs.lattice_gas(n=8, packing_fraction=0.1, seed=1)
    of_file = Thermalisation(source="gas.xyz", structure=scene)
    assert options_of(of_file)["--from"] == "gas.xyz"
    moved = replace(of_file, structure=hs.lattice_gas(n=8, packing_fraction=0.1, seed=2))
    name = "the structure that it starts from"
    assert options_of(of_file)[name] != options_of(moved)[name]
    assert {"--n", "--dim", "--collisions", "--seed", "--replicas"} == set(options_of(Soak()))
    assert "--workers" not in options_of(STUDY) and "--n" in options_of(STUDY)


pytestmark_posix = pytest.mark.skipif(sys.platform == "win32", reason="there are no locks")


@pytestmark_posix
def test_the_second_run_is_refused_and_changes_nothing(tmp_path):
    with OutputFolder(tmp_path).running(STUDY) as shelf:
        shelf.store(0, 1.0)
        before = sorted(path.name for path in shelf.folder.iterdir())
        for resume in (False, True):
            out = OutputFolder(tmp_path, resume=resume)
            with pytest.raises(
                OutputError, match=r"another run writes into .*give another folder with --out"
            ):
                out.check(STUDY)
            with pytest.raises(OutputError, match="another run writes into"):
                out.running(STUDY).__enter__()
        assert sorted(path.name for path in shelf.folder.iterdir()) == before
        assert shelf.result(0) == (1.0,)


@pytestmark_posix
def test_a_lock_ends_with_its_process_and_passes_to_no_child(tmp_path):
    program = "import os, pathlib, sys, studies.running.locking as l; assert l.Lock(pathlib.Path(sys.argv[1])).acquire(); os.kill(os.getpid(), 9)"
    path = tmp_path / "lock"
    done = subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert done.returncode == -9 and path.exists()
    lock, other = Lock(path), Lock(path)
    assert lock.acquire() and not other.acquire()
    child = multiprocessing.get_context("spawn").Process(target=print)
    child.start()
    lock.release()
    assert other.acquire()
    other.release()
    child.join()


@pytestmark_posix
def test_a_lock_that_was_removed_is_not_the_one_that_counts(tmp_path):
    path = tmp_path / "lock"
    old, new = Lock(path), Lock(path)
    assert old.acquire()
    path.unlink()
    assert new.acquire() and not Lock(path).acquire()


def test_a_journal_makes_nothing_when_it_checks(tmp_path):
    OutputFolder(tmp_path / "absent").check(STUDY)
    assert not list(tmp_path.iterdir())


def test_every_byte_of_a_manifest_is_guarded(tmp_path):
    """It is refused, or says the same; sibling: without a seal, names of files that may be replaced would change."""
    study = replace(STUDY, packing_fractions=(0.1,))
    interrupted(tmp_path, study)
    path = tmp_path / "checkpoint" / "manifest.json"
    journal, right, whole = Journal(tmp_path, tmp_path), about(study) | {"own": []}, path.read_bytes()
    assert journal.unfinished() == right
    found = []
    for _ in damaged(path):
        found.append(journal.unfinished())
    assert [each for each in found if each not in (None, right)] == []
    assert found.count(None) > 0.9 * len(found)
    path.write_bytes(whole.replace(b'"own": []', b'"own": ["letter.txt"]'))
    with pytest.raises(OutputError, match="manifest.json cannot be understood"):
        OutputFolder(tmp_path, resume=True).running(study).__enter__()


def test_every_byte_of_a_state_is_guarded(tmp_path):
    """Of a study's checkpoint: no other state, but a warning, and the work is done again."""
    shelf = Shelf(tmp_path)
    shelf.save(0, {"x": 1.5, "many": [1, 2]})
    path = tmp_path / "running-0000.npz"
    for _ in damaged(path):
        with pytest.warns(UserWarning, match="running-0000.npz .* what it held is computed again"):
            assert shelf.state(0) is None
    assert shelf.state(0) == {"x": 1.5, "many": [1, 2]}
