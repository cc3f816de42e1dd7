"""Somebody else's files survive byte for byte, and so do the targets of links; a finished run is replaced only when told to."""

import ast
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from hardspheres.errors import CheckpointError
from hardspheres.temporary import temporary_beside
from studies.benchmarks.command import next_folder
from studies.output import OutputFolder
from studies.pressure import EquationOfState
from studies.registry import QUESTIONS, study_named
from studies.running.journal import OutputError
from studies.running.ownership import SUMMARY
from studies.study import Study
from studies.thermalisation import Thermalisation

STUDY = EquationOfState(packing_fractions=(0.1, 0.3), n=500, collisions_per_particle=50.0, replicas=3, seed=4)
OTHER = Thermalisation(n=10)
pytestmark = pytest.mark.skipif(os.name != "posix", reason="links")


def everything_in(*folders):
    """Whatever is there, with contents and where links lead, links not followed."""
    found = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.is_symlink():
                found[path] = "link to " + os.readlink(path)
            else:
                found[path] = path.read_bytes() if path.is_file() else "folder"
    return found


def summary_of(out, study):
    return {"study": study, "version": "0.1.0", "seed": 1, "files": sorted({*out.files, SUMMARY})}


def results(out, *names, content="new", study="pressure"):
    """What a study does at its end."""
    for name in names:
        out.write_csv(name, {"x": [content]})
    out.write_json(SUMMARY, summary_of(out, study))


def run(path, *names, study=STUDY, content="new", **options):
    out = OutputFolder(path, **options)
    out.check(study)
    with out.running(study):
        results(out, *(names or ("equation_of_state.csv",)), content=content)
    return out


def attempts(path):
    """Every way to begin in a folder: looked at before, straight on, resumed, with force."""
    for options in ({}, {"resume": True}, {"force": True}):
        yield lambda options=options: OutputFolder(path, **options).check(STUDY)
        yield lambda options=options: OutputFolder(path, **options).running(STUDY).__enter__()


# Checkpoint folders that are not ours.


def somebodys(folder):
    folder.mkdir(parents=True)
    (folder / "thesis.tex").write_text("years of work")
    (folder / "chapters").mkdir()
    (folder / "chapters" / "1.tex").write_text("one")


def weights(folder):
    """Names like ours, as another program might choose them."""
    folder.mkdir(parents=True)
    (folder / "done-0000.npz").write_bytes(b"PK not ours")
    (folder / "running-0001.npz").write_bytes(b"PK nor this")
    (folder / "trajectory.xyz").write_text("1\n\nX 0 0 0\n")


def other_lock(folder):
    folder.mkdir(parents=True)
    (folder / "lock").touch()


def other_manifest(folder):
    somebodys(folder)
    (folder / "manifest.json").write_text('{"name": "a web page", "version": "1.0"}')


def linked(folder):
    somebodys(folder.parent.parent / "elsewhere")
    folder.parent.mkdir()
    folder.symlink_to(folder.parent.parent / "elsewhere")


def linked_to_ours(folder):
    """Even where a checkpoint of ours is behind it."""
    with pytest.raises(KeyboardInterrupt), OutputFolder(folder.parent.parent / "ours").running(STUDY):
        raise KeyboardInterrupt
    folder.parent.mkdir()
    folder.symlink_to(folder.parent.parent / "ours" / "checkpoint")


def linked_lock(folder):
    folder.mkdir(parents=True)
    (folder.parent.parent / "precious").write_text("held by the run of hardspheres that writes here\n")
    (folder / "lock").symlink_to(folder.parent.parent / "precious")


def linked_manifest(folder):
    linked_to_ours(folder)
    folder.unlink()
    somebodys(folder)
    (folder / "manifest.json").symlink_to(folder.parent.parent / "ours" / "checkpoint" / "manifest.json")


def dangling(folder):
    folder.parent.mkdir()
    folder.symlink_to("nowhere")


def a_file(folder):
    folder.parent.mkdir()
    folder.write_text("a checkpoint of another kind")


def link_among_ours(folder):
    """Where the next run would write its trajectory."""
    with pytest.raises(KeyboardInterrupt), OutputFolder(folder.parent).running(STUDY) as shelf:
        shelf.store(0, 1.0)
        raise KeyboardInterrupt
    (folder.parent.parent / "precious").write_text("years of work")
    (folder / "trajectory.xyz").symlink_to(folder.parent.parent / "precious")


def folder_among_ours(folder):
    link_among_ours(folder)
    (folder / "trajectory.xyz").rename(folder / "a link")
    (folder / "done-0009.npz").mkdir()


FOREIGN = [
    somebodys,
    weights,
    other_lock,
    other_manifest,
    linked,
    linked_to_ours,
    linked_lock,
    linked_manifest,
]
FOREIGN += [dangling, a_file, link_among_ours, folder_among_ours]


@pytest.mark.parametrize("make", FOREIGN)
def test_a_checkpoint_folder_that_is_not_ours_is_refused_by_name_and_untouched(make, tmp_path):
    out = tmp_path / "out"
    make(out / "checkpoint")
    before = everything_in(tmp_path)
    for attempt in attempts(out):
        with pytest.raises(OutputError, match="out.checkpoint") as caught:
            attempt()
        assert "\n" not in str(caught.value)
        assert everything_in(tmp_path) == before


def test_files_beside_ours_in_our_checkpoint_folder_stay(tmp_path):
    """Links too; the folder stays ours."""
    folder = tmp_path / "out" / "checkpoint"
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path / "out").running(STUDY) as shelf:
        shelf.store(0, 1.0)
        raise KeyboardInterrupt
    somebodys(tmp_path / "elsewhere")
    (folder / "notes.txt").write_text("mine")
    (folder / "done-0007.npz.bak").write_text("mine too")
    (folder / "more").symlink_to(tmp_path / "elsewhere")
    kept = {
        path: what for path, what in everything_in(tmp_path).items() if path.stem not in ("lock", "manifest")
    }
    del kept[folder / "done-0000.npz"]
    for options in ({"resume": True}, {}):
        with OutputFolder(tmp_path / "out", **options).running(STUDY):
            pass
        left = everything_in(tmp_path)
        assert left.pop(folder / "lock")
        assert left == kept


# Results that are there already.


def test_a_finished_run_is_not_replaced_and_with_force_nothing_of_it_stays(tmp_path):
    """The first one's film beside the second one's summary."""
    run(tmp_path, "relaxation.csv", "relaxation.png", "gas.gif", study=OTHER, content="old")
    before = everything_in(tmp_path)
    for use in (OutputFolder.check, lambda out, study: out.running(study).__enter__()):
        with pytest.raises(
            OutputError,
            match=f"{tmp_path} holds a finished run; give another folder with --out, or --force to",
        ):
            use(OutputFolder(tmp_path), STUDY)
        assert everything_in(tmp_path) == before
    run(tmp_path, "equation_of_state.csv", force=True)
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "equation_of_state.csv"}
    run(tmp_path, "relaxation.csv", study=OTHER, force=True)
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "relaxation.csv"}


def test_the_old_results_stay_until_there_are_new_ones(tmp_path):
    """Interrupted at work: all is as it was. Interrupted between two results: no summary beside what is not its own."""
    run(tmp_path, "equation_of_state.csv", content="old")
    before = everything_in(tmp_path)
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path, force=True).running(STUDY):
        raise KeyboardInterrupt
    folder = tmp_path / "checkpoint"
    after = everything_in(tmp_path)
    assert {path: what for path, what in after.items() if folder not in (path, path.parent)} == before
    out = OutputFolder(tmp_path, resume=True)
    with pytest.raises(KeyboardInterrupt), out.running(STUDY):
        out.write_csv("equation_of_state.csv", {"x": ["new"]})
        assert not (tmp_path / SUMMARY).exists()
        raise KeyboardInterrupt
    run(tmp_path, "equation_of_state.png", resume=True)
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "equation_of_state.png"}


def test_a_run_resumed_after_its_summary_was_written_keeps_what_it_had_moved(tmp_path):
    out = OutputFolder(tmp_path)
    with pytest.raises(KeyboardInterrupt), out.running(OTHER) as shelf:
        (shelf.folder / "trajectory.xyz").write_text("frames")
        out.adopt(shelf.folder / "trajectory.xyz")
        results(out, "relaxation.csv")
        raise KeyboardInterrupt
    again = OutputFolder(tmp_path, resume=True)
    again.check(OTHER)
    with again.running(OTHER) as shelf:
        again.adopt(shelf.folder / "trajectory.xyz")
        results(again, "relaxation.csv")
    assert (tmp_path / "trajectory.xyz").read_text() == "frames"
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "relaxation.csv", "trajectory.xyz"}


def test_an_unfinished_run_is_replaced_with_force_and_what_it_had_written_too(tmp_path):
    out = OutputFolder(tmp_path)
    with pytest.raises(KeyboardInterrupt), out.running(OTHER) as shelf:
        shelf.store(0, 1.0)
        out.write_csv("relaxation.csv", {"x": [1]})
        raise KeyboardInterrupt
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(CheckpointError, match=r"unfinished run; add --resume .* --force to start again"):
        OutputFolder(tmp_path).check(STUDY)
    replaced = OutputFolder(tmp_path, force=True)
    replaced.check(STUDY)
    with replaced.running(STUDY) as shelf:
        assert shelf.result(0) is None
        results(replaced, "equation_of_state.csv")
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "equation_of_state.csv", "notes.txt"}


@pytest.mark.parametrize("name", [SUMMARY, "equation_of_state.csv", "equation_of_state.png"])
@pytest.mark.parametrize("kind", ["file", "link", "dangling link", "folder"])
def test_files_of_others_with_the_names_of_ours_are_not_replaced(name, kind, tmp_path):
    """Told before anything is run; sibling: files with other names are in nobody's way."""
    out, precious = tmp_path / "out", tmp_path / "precious"
    out.mkdir()
    precious.write_text("years of work")
    (out / "relaxation.csv").write_text("of another program")
    if kind == "file":
        (out / name).write_text('{"files": ["summary.json"]}')
    elif kind == "folder":
        (out / name).mkdir()
    else:
        (out / name).symlink_to(precious if kind == "link" else "nowhere")
    before = everything_in(tmp_path)
    for attempt in attempts(out):
        with pytest.raises(
            (OutputError, CheckpointError), match=f"{name} is not of a finished run|nothing to res"
        ):
            attempt()
        shutil.rmtree(out / "checkpoint", ignore_errors=True)
        assert everything_in(tmp_path) == before
    with pytest.raises(OutputError, match=f"{name} is not of a finished run"):
        OutputFolder(out).write_json(name, {})
    assert everything_in(tmp_path) == before
    (out / name).rmdir() if kind == "folder" else (out / name).unlink()
    run(out)
    assert (out / "relaxation.csv").read_text() == "of another program"


def test_force_removes_nothing_but_files_of_ours_whatever_a_summary_lists(tmp_path):
    """A summary made to deceive: files of others, paths, links."""
    out, precious = tmp_path / "out", tmp_path / "precious"
    folder = run(out, "equation_of_state.csv")
    precious.write_text("years of work")
    (out / "thesis.tex").write_text("mine")
    (out / "relaxation.png").symlink_to(precious)
    (out / "gas.gif").mkdir()
    listed = ["thesis.tex", "../precious", str(precious), "relaxation.png", "gas.gif", 7, None]
    folder.write_json(SUMMARY, summary_of(folder, "pressure") | {"files": [SUMMARY, *listed]})
    (out / "equation_of_state.csv").unlink()
    before = {path: what for path, what in everything_in(tmp_path).items() if path.name != SUMMARY}
    run(out, "equation_of_state.png", force=True)
    after = everything_in(tmp_path)
    assert after.pop(out / SUMMARY) and after.pop(out / "equation_of_state.png")
    assert after == before


@dataclass
class Own:
    """A study of somebody's own, which this package does not list."""

    name, files = "own", ("contact.csv", "contact.png")


def test_force_replaces_what_a_study_of_ones_own_wrote_too(tmp_path):
    """Sibling: for a study that does not name them, they are files of others."""
    run(tmp_path, "contact.csv", "contact.png", study=Own(), content="old")
    run(tmp_path, "contact.csv", study=Own(), content="new", force=True)
    assert {path.name for path in tmp_path.iterdir()} == {SUMMARY, "contact.csv"}
    before = (tmp_path / "contact.csv").read_text()
    assert "new" in before
    run(tmp_path, "equation_of_state.csv", force=True)
    assert (tmp_path / "contact.csv").read_text() == before
    with pytest.raises(OutputError, match="contact.csv is not of a finished run"):
        run(tmp_path, "contact.csv", study=Own(), force=True)


def test_a_file_that_somebody_puts_there_during_the_run_is_not_replaced(tmp_path):
    """Nor when the run is resumed."""
    out = OutputFolder(tmp_path)
    with (
        pytest.raises(OutputError, match="equation_of_state.csv is not of this run, and is not replaced"),
        out.running(STUDY),
    ):
        (tmp_path / "equation_of_state.csv").write_text("mine")
        results(out, "equation_of_state.csv")
    with pytest.raises(OutputError, match="is not of this run"):
        run(tmp_path, "equation_of_state.csv", resume=True)
    assert (tmp_path / "equation_of_state.csv").read_text() == "mine"
    (tmp_path / "equation_of_state.csv").unlink()
    run(tmp_path, "equation_of_state.csv", resume=True)


def test_temporary_files_of_others_stay(tmp_path):
    """Names that were once ours, links at them, and names that nobody else would choose."""
    precious = tmp_path / "precious"
    precious.write_text("years of work")
    (tmp_path / ".partial-summary.json").write_text("mine")
    (tmp_path / ".partial-equation_of_state.csv").symlink_to(precious)
    before = everything_in(tmp_path)
    run(tmp_path, "equation_of_state.csv")
    after = everything_in(tmp_path)
    assert {path: after[path] for path in before} == before


def test_what_a_killed_run_left_goes_when_one_comes_to_its_end(tmp_path):
    """Also where the first file is in its place already, and another one was half written when the run was killed."""
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    mine = temporary_beside(tmp_path / "distributions.png")
    half = tmp_path / mine.name.replace(f"-{os.getpid()}-", f"-{ended.pid}-")
    half.write_bytes(b"half")
    (tmp_path / "trajectory.xyz").write_text("whole")
    out = OutputFolder(tmp_path)
    out._own = {"trajectory.xyz"}  # as the manifest of the run that was killed says
    out.adopt(tmp_path / "checkpoint" / "trajectory.xyz")
    out.write_json("distributions.json", {})
    assert half.exists()
    out.write_json(SUMMARY, {})
    assert not half.exists()


def test_every_file_that_a_program_writes_is_known():
    """Of those that write by themselves under names that stand there; others are compared where they run."""
    known = {}
    for name in QUESTIONS:
        kind = study_named(name)
        if not issubclass(kind, Study) and not kind.page:  # a page is written where --out says
            known[Path(sys.modules[kind.__module__].__file__)] = set(kind.files)
    for source, files in known.items():
        written, made = set(), False
        for own in source.parent.glob("*.py") if source.stem in ("__init__", "command") else [source]:
            for node in ast.walk(ast.parse(own.read_text(encoding="utf-8"))):
                call = node if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) else None
                writes = call and call.func.attr in ("write_csv", "write_json", "save_figure", "partial")
                if writes and call.args and isinstance(call.args[0], ast.Constant):
                    written.add(call.args[0].value)
                made = made or bool(writes and isinstance(call.args[0], ast.JoinedStr))
        assert written - {SUMMARY} <= files and (made or files <= written), source


def test_a_new_run_does_not_load_every_study(tmp_path, monkeypatch):
    """The names of all files are asked for only where there is a finished run; sibling: such a folder."""

    def asked():
        raise ZeroDivisionError

    monkeypatch.setattr("studies.output.every_file", asked)
    run(tmp_path / "new", "equation_of_state.csv")
    with pytest.raises(ZeroDivisionError):
        OutputFolder(tmp_path / "new", force=True).check(STUDY)


def test_a_relative_folder_is_pinned(tmp_path, monkeypatch):
    """Results and checkpoints stay together when somebody goes elsewhere in between."""
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path)
    out = OutputFolder("out")
    monkeypatch.chdir(tmp_path / "there")
    with out.running(STUDY) as shelf:
        assert shelf.folder == tmp_path / "out" / "checkpoint"
        results(out, "equation_of_state.csv")
    assert {path.name for path in tmp_path.rglob("*")} == {"there", "out", SUMMARY, "equation_of_state.csv"}


# Links to nowhere.


@pytest.mark.parametrize("below", ["", "deeper", "deeper/still"])
def test_a_dangling_link_is_called_one(below, tmp_path):
    (tmp_path / "link").symlink_to("nowhere")
    (tmp_path / "circle").symlink_to("circle")
    for name in ("link", "circle"):
        with pytest.raises(
            OutputError, match=f"{name} is a link to (nowhere|circle), where there is nothing"
        ):
            OutputFolder(tmp_path / name / below).check(STUDY)
    (tmp_path / "nowhere").mkdir()
    OutputFolder(tmp_path / "link" / below).check(STUDY)


def test_timings_without_a_folder_go_to_the_next_free_one(tmp_path):
    assert next_folder(tmp_path / "bench-1", force=False) == tmp_path / "bench-1"
    for number in ("", "-2"):
        run(tmp_path / f"bench-1{number}")
    (tmp_path / "bench-1-3").mkdir()
    (tmp_path / "bench-1-3" / "bench.csv").touch()  # of one that was interrupted
    assert next_folder(tmp_path / "bench-1", force=False) == tmp_path / "bench-1-4"
    assert next_folder(tmp_path / "bench-1", force=True) == tmp_path / "bench-1"
