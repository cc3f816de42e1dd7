"""Replicas stay beside the results of a study: more of them extend it to the bytes of a longer run, or nothing is lost."""

import hashlib
import itertools
import json
import os
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from hardspheres.errors import CheckpointError
from studies import cli, output
from studies.output import OutputError, OutputFolder
from studies.pressure import EquationOfState
from studies.report import Screen
from studies.running.journal import Shelf
from studies.running.kept import Kept, finished_run
from studies.study import Replica, _Running, conduct, run_study
from studies.until_error import until_error

from .test_journal import Killed, kill_after

STUDY = EquationOfState(
    packing_fractions=(0.05, 0.1), n=60, collisions_per_particle=15.0, replicas=2, workers=1
)
MORE = replace(STUDY, replicas=3)
ITEMS = [f"done-{k:04d}.npz" for k in range(6)]


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """They have tests of their own, and cost time."""
    drawn = {"equation_of_state": Figure(figsize=(1, 1))}
    monkeypatch.setattr(EquationOfState, "figures", lambda *_: drawn)


def run(path, study=STUDY, **options):
    return conduct(study, OutputFolder(path, **options), Screen(json_output=True))[0]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folders with two and with three replicas of each gas."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EquationOfState, "figures", lambda *_: {"equation_of_state": Figure(figsize=(1, 1))})
        place = tmp_path_factory.mktemp("kept")
        run(place / "two")
        run(place / "three", MORE)
    return place


@pytest.fixture
def two(finished, tmp_path):
    """A folder with two replicas of each gas, of one's own."""
    shutil.copytree(finished / "two", tmp_path / "two")
    return tmp_path / "two"


@pytest.fixture
def began(monkeypatch):
    """The replicas that were begun: gas and number."""
    runs, begin = [], _Running.begin

    def counting(self, item):
        runs.append((item.which, item.index))
        return begin(self, item)

    monkeypatch.setattr(_Running, "begin", counting)
    return runs


def results(path):
    """Numbers to the last digit, and the digest of all particles."""
    summary = json.loads((path / "summary.json").read_text())
    return (path / "equation_of_state.csv").read_bytes(), summary["states"], summary["digest"]


def names(path):
    return sorted(each.name for each in path.iterdir())


def test_more_replicas_extend_a_run_to_the_bytes_of_a_direct_one(two, finished, began, capsys):
    """Only the third replica of each gas is run. Sibling: the results of two."""
    assert results(two) != results(finished / "three")
    run(two, MORE)
    assert "2 of 3 replicas were there\n" in capsys.readouterr().err and began == [(1, 2), (0, 2)]
    assert results(two) == results(finished / "three")
    assert names(two) == names(finished / "three") and "checkpoint" not in names(two)
    assert names(two / "replicas") == [*ITEMS, "manifest.json", "study.npz"]
    assert finished_run(two).study == replace(MORE, workers=None)


def test_a_seed_that_depends_on_the_number_of_replicas_is_found_out(two, finished, monkeypatch):
    """Sibling: as it was once, gas after gas."""
    for count in (2, 3):
        key = property(
            lambda its, n=count: np.random.SeedSequence(its.root, spawn_key=(its.gas * n + its.index,))
        )
        monkeypatch.setattr(Replica, "seed", key)
        study = replace(STUDY, replicas=count)
        run(two.with_name("once"), study)
        run(two.with_name(f"direct{count}"), study)
    assert results(two.with_name("once")) != results(two.with_name("direct3"))


def test_seeds_of_all_runs_differ_and_those_of_the_first_gas_are_of_the_replica_alone():
    keys = {Replica(1, r, None, {}, gas=k).seed.spawn_key for k in range(3) for r in range(4)}
    assert len(keys) == 12
    assert [Replica(1, r, None, {}).seed.spawn_key for r in range(3)] == [(0,), (1,), (2,)]


def test_interrupted_while_it_is_extended_the_old_results_stay_and_it_is_resumed(
    two, finished, monkeypatch, began
):
    before, begin = results(two), _Running.begin

    def interrupted(self, item):
        if len(began) == 1:
            raise KeyboardInterrupt
        return begin(self, item)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(_Running, "begin", interrupted)
        run(two, MORE)
    assert results(two) == before and names(two / "replicas") == [*ITEMS[:4], "manifest.json", "study.npz"]
    run(two, MORE, resume=True)
    assert began == [(1, 2), (0, 2)] and results(two) == results(finished / "three")


REFUSED = [
    (["--replicas", "2"], "holds this finished run already; ask for more than --replicas 2 to extend it"),
    (["--replicas", "1"], "holds a finished run with --replicas 2, not 1; give another folder with --out"),
    (["--replicas", "3", "--seed", "2"], "holds a finished run with --seed 1, not 2; give another folder"),
    (["--replicas", "3", "--n", "61"], "holds a finished run with --n 60, not 61; give another folder"),
]


@pytest.mark.parametrize(("options", "sentence"), REFUSED)
def test_what_extends_nothing_is_refused_by_name(options, sentence, two, monkeypatch, capsys):
    before = results(two)
    common = ["--packing-fraction", "0.05,0.1", "--n", "60", "--collisions-per-particle", "15"]
    monkeypatch.setattr(
        sys, "argv", ["hardspheres", "pressure", *common, "--workers", "1", *options, "--out", str(two)]
    )
    with pytest.raises(SystemExit) as end:
        cli.main()
    told = capsys.readouterr().err
    assert end.value.code == 2 and sentence in told and told.count("\n") == 1
    assert results(two) == before and "checkpoint" not in names(two)


def test_runs_whose_length_depends_on_their_number_are_not_kept_and_not_extended(two, monkeypatch):
    suite = replace(EquationOfState(), suite=True, until_error=0.01)
    assert suite.not_extendable and not STUDY.not_extendable
    assert OutputFolder(two).keep_replicas(suite, 17, Shelf(two)) == "" and "replicas" not in names(two)
    run(two, replace(STUDY, replicas=1), force=True)
    with monkeypatch.context() as patch:
        patch.setattr(EquationOfState, "not_extendable", "whose length depends on --replicas")
        with pytest.raises(
            OutputError, match="holds a finished run whose length depends on --replicas; give"
        ):
            OutputFolder(two).check(STUDY)


def test_replicas_are_kept_while_they_are_small_or_if_that_is_asked_for(tmp_path, monkeypatch, capsys):
    run(tmp_path / "no", keep=False)
    assert "replicas" not in names(tmp_path / "no")
    with pytest.raises(OutputError, match="no holds a finished run; give another folder"):
        run(tmp_path / "no", MORE)
    monkeypatch.setattr(output, "LARGE", 10_000)
    run(tmp_path / "large")
    assert "the replicas take 0 MB and were not kept; --keep keeps them" in capsys.readouterr().err
    assert "replicas" not in names(tmp_path / "large")
    run(tmp_path / "asked", keep=True)
    run(tmp_path / "asked", MORE)  # none are lost by asking for more
    assert names(tmp_path / "asked" / "replicas")[:6] == ITEMS
    run(tmp_path / "asked", replace(MORE, replicas=4), keep=False)
    assert "replicas" not in names(tmp_path / "asked")


def test_a_forced_run_takes_the_place_of_the_replicas_too(two):
    """Those of the old run that are more than the new one has. Somebody's file beside them stays."""
    (two / "replicas" / "notes.txt").write_text("mine")
    run(two, replace(STUDY, seed=2, replicas=1), force=True)
    assert names(two / "replicas") == [*ITEMS[:2], "manifest.json", "notes.txt", "study.npz"]
    assert finished_run(two).study.seed == 2
    run(two, replace(STUDY, seed=3), force=True, keep=False)
    assert names(two / "replicas") == ["manifest.json", "notes.txt"]
    run(two, replace(STUDY, seed=4), force=True)  # the folder is still known as ours
    assert names(two / "replicas") == [*ITEMS[:4], "manifest.json", "notes.txt", "study.npz"]


@pytest.mark.parametrize("what", ["folder", "file", "link", "link inside"])
def test_somebodys_folder_of_that_name_is_left_alone(what, tmp_path, two):
    place, mine = tmp_path / "out" / "replicas", tmp_path / "mine"
    (tmp_path / "out").mkdir()
    mine.mkdir()
    (mine / "done-0000.npz").write_text("mine")
    if what == "folder":
        shutil.copytree(mine, place)
    elif what == "file":
        place.write_text("mine")
    elif what == "link":
        place.symlink_to(mine)
    else:
        shutil.copytree(two / "replicas", place)
        (place / "done-0001.npz").unlink()
        (place / "done-0001.npz").symlink_to(mine / "done-0000.npz")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(OutputError, match=r"replicas.* is not of a run of hardspheres.*--no-keep"):
        OutputFolder(tmp_path / "out").check(STUDY)
    OutputFolder(tmp_path / "out", keep=False).check(replace(STUDY, replicas=9))
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_a_precision_is_resumed_and_then_refined_with_what_is_there(tmp_path, monkeypatch, began, capsys):
    """The pilot runs again, its gases are others. Sibling: the run that was never interrupted."""
    begin, coarse, fine = _Running.begin, 0.03, 0.01

    def to(target, path, **options):
        until_error(STUDY, target, OutputFolder(path, **options), Screen(json_output=True))
        return capsys.readouterr().err

    def interrupted(self, item):
        if item.index == 3 and self.study.seed == STUDY.seed:
            raise KeyboardInterrupt
        return begin(self, item)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(_Running, "begin", interrupted)
        to(coarse, tmp_path / "out")
    to(coarse, tmp_path / "out", resume=True)
    to(coarse, tmp_path / "direct")
    assert results(tmp_path / "out") == results(tmp_path / "direct")
    count = finished_run(tmp_path / "out").study.replicas
    began.clear()
    assert f"{count} of " in to(fine, tmp_path / "out")
    assert all(r >= count for k, r in began[2 * STUDY.replicas :])  # after those of the pilot
    with pytest.raises(OutputError, match="holds a finished run with --replicas .*, not "):
        to(coarse, tmp_path / "out")


def test_a_damaged_replica_is_run_again(two, finished, began):
    path = two / "replicas" / ITEMS[1]
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.warns(UserWarning, match="done-0001.npz .* what it held is computed again"):
        run(two, MORE)
    assert began == [(1, 2), (1, 0), (0, 2)] and results(two) == results(finished / "three")
    assert finished_run(two).replicas[1][0].digest == finished_run(finished / "three").replicas[1][0].digest


def test_a_file_in_the_place_of_another_is_found_out(two):
    """Sibling: in its own place, as above."""
    shutil.copyfile(two / "replicas" / ITEMS[2], two / "replicas" / ITEMS[1])
    with pytest.raises(
        CheckpointError, match="a file holds replica 1 of gas 0 and seed 1 in the place of rep"
    ):
        run(two, MORE)
    with pytest.raises(CheckpointError, match="has files of another run; use an unchanged copy of it"):
        finished_run(two)


CHANGING = [
    (os, "link"), (os, "replace"), (Path, "mkdir"), (Path, "rmdir"), (Path, "unlink"), (Path, "write_text")
]  # fmt: skip


def test_killed_at_any_moment_they_are_whole_or_not_there(tmp_path, monkeypatch):
    """While they are put there, added to, and removed: what is counted can be read."""
    checkpoint = tmp_path / "checkpoint"
    checkpoint.mkdir()
    for name in ITEMS:
        (checkpoint / name).write_text(name)
    files, calls = [checkpoint / name for name in ITEMS], []
    for step in ("keep", "extend", "remove"):
        for count in itertools.count():
            kept = Kept(tmp_path, tmp_path / step / str(count))
            kept.folder.parent.mkdir(parents=True)
            if step != "keep":
                kept.keep(STUDY, 2, files[:4])
            with monkeypatch.context() as patch:
                kill_after(count, patch, *CHANGING)
                try:
                    if step == "remove":
                        kept.remove()
                    else:
                        kept.keep(*((STUDY, 2, files[:4]) if step == "keep" else (MORE, 2, files)))
                    break
                except Killed:
                    pass
            counted = (kept.manifest() or {"replicas": 0})["replicas"]
            assert counted in {"keep": (0, 2), "extend": (2, 3), "remove": (0, 2)}[step]
            assert all((kept.folder / name).read_text() == name for name in ITEMS[: 2 * counted])
            kept.keep(MORE, 2, files)  # as the next run does
            assert kept.manifest()["replicas"] == 3
            kept.remove()
            assert not kept.folder.exists()
        calls.append(count)
    assert min(calls) > 8
    assert not kept.folder.exists() and kept.remove() is None


def test_without_hard_links_they_are_copied(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", lambda *_: os.stat(tmp_path / "no such call"))
    (tmp_path / ITEMS[0]).write_text("one")
    Kept(tmp_path, tmp_path).keep(replace(STUDY, replicas=1), 1, [tmp_path / ITEMS[0]])
    assert (tmp_path / "replicas" / ITEMS[0]).read_text() == "one"


@dataclass(frozen=True, kw_only=True)
class Own(EquationOfState):
    """A study of one's own, which no file holds."""

    name = "own"


def test_a_study_of_ones_own_is_extended_too(tmp_path, began):
    """Sibling in test_combine: it is not combined."""
    own = Own(**vars(STUDY))
    run(tmp_path / "own", own)
    assert "study.npz" not in names(tmp_path / "own" / "replicas")
    run(tmp_path / "own", replace(own, replicas=3))
    assert began[4:] == [(1, 2), (0, 2)]
    direct = [replica.digest for own in run_study(MORE, Screen(True))[0] for replica in own]
    assert results(tmp_path / "own")[2] == hashlib.sha256("".join(direct).encode()).hexdigest()
