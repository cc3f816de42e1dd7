"""Runs of different seeds, combined: exactly the answer of all their replicas; what is no such set is refused."""

import json
import shutil
import sys
from dataclasses import dataclass, replace

import pytest
from matplotlib.figure import Figure

from hardspheres import HardSpheresError
from studies import cli
from studies.answer import tidy
from studies.combine import Combine
from studies.pressure import EquationOfState
from studies.report import OutputFolder, Screen
from studies.running.encoding import write
from studies.running.kept import FOLDER, finished_run
from studies.running.ownership import SUMMARY
from studies.study import conduct, run_study

STUDY = EquationOfState(
    packing_fractions=(0.05, 0.1), n=60, collisions_per_particle=15.0, replicas=2, workers=1
)
OTHER = replace(STUDY, seed=7, replicas=1)


@dataclass(frozen=True, kw_only=True)
class Own(EquationOfState):
    """A study of one's own, which no file holds."""

    name = "own"


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """They have tests of their own, and cost time."""
    drawn = {"equation_of_state": Figure(figsize=(1, 1))}
    monkeypatch.setattr(EquationOfState, "figures", lambda *_: drawn)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of finished runs: seeds 1 and 7, and what cannot be combined with them."""
    place = tmp_path_factory.mktemp("combine")
    studies = {
        "one": (STUDY, None),
        "seven": (OTHER, None),
        "again": (replace(STUDY, replicas=1), None),
        "smaller": (replace(OTHER, n=61, packing_fractions=(0.05,)), None),
        "lost": (OTHER, False),
        "own": (Own(**vars(OTHER)), None),
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EquationOfState, "figures", lambda *_: {"equation_of_state": Figure(figsize=(1, 1))})
        for name, (study, keep) in studies.items():
            conduct(study, OutputFolder(place / name, keep=keep), Screen(json_output=True))
    forged = place / "forged"  # the replicas of one, under another seed
    shutil.copytree(place / "one", forged)
    for path in (forged / FOLDER).glob("done-*"):
        k = int(path.stem[5:])
        write(path, replace(finished_run(place / "one").replicas[k % 2][k // 2], root=3))
    write(forged / FOLDER / "study.npz", replace(STUDY, seed=3))
    (place / "nothing").mkdir()
    return place


def combined(monkeypatch, capsys, runs, *names, out="all"):
    """Exit code, standard output and standard error of the command."""
    monkeypatch.chdir(runs)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "combine", *names, "--json", "--out", str(out)])
    capsys.readouterr()
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code or 0, *capsys.readouterr()


def test_it_is_the_answer_of_all_replicas_to_the_last_digit(runs, tmp_path, monkeypatch, capsys):
    """In any order of the folders. Sibling: the answer of one run."""
    code, printed, told = combined(monkeypatch, capsys, runs, "seven", "one", out=tmp_path / "all")
    assert code == 0, told
    study = replace(STUDY, replicas=3)
    replicas = [a + b for a, b in zip(*(run_study(s, Screen(True))[0] for s in (STUDY, OTHER)), strict=True)]
    answers = [study.answer(gas, own) for gas, own in zip(study.gases(), replicas, strict=True)]
    direct = OutputFolder(tmp_path / "direct")
    direct.create()
    direct.write_csv("equation_of_state.csv", tidy(answers))
    table = (tmp_path / "all" / "equation_of_state.csv").read_bytes()
    assert table == (tmp_path / "direct" / "equation_of_state.csv").read_bytes()
    assert table != (runs / "one" / "equation_of_state.csv").read_bytes()
    combined(monkeypatch, capsys, runs, "one", "seven", out=tmp_path / "turned")
    assert table == (tmp_path / "turned" / "equation_of_state.csv").read_bytes()

    summary = json.loads(printed)
    assert summary == json.loads((tmp_path / "all" / SUMMARY).read_text())
    assert (summary["study"], summary["of"], summary["seed"]) == ("combine", "pressure", [1, 7])
    assert summary["command"] == "hardspheres combine seven one"
    assert summary["combined"] == [
        {"run": "one", "seed": 1, "replicas": 2},
        {"run": "seven", "seed": 7, "replicas": 1},
    ]
    assert {path.name for path in (tmp_path / "all").iterdir()} == set(summary["files"])
    said = "combined from one (seed 1, 2 replicas), seven (seed 7, 1 replica)"
    assert said in told and said in (tmp_path / "all" / "report.html").read_text(encoding="utf-8")
    _, _, told = combined(monkeypatch, capsys, runs, str(tmp_path / "all"), "one", out=tmp_path / "more")
    assert "all was combined itself; name the folders that it was combined from\n" in told


REFUSED = {
    "alone": (["one"], "one alone is nothing to combine; name the folders of two or more runs"),
    "the same folder": (["one", "./one"], "one is named twice, and would count twice; name each run once"),
    "the same seed": (["one", "again"], "one and again both have --seed 1, so that the same replicas would"),
    "other options": (
        ["one", "smaller"],
        "smaller holds a run with --packing-fraction 0.05, not 0.05,0.1 as",
    ),
    "none kept": (
        ["one", "lost"],
        "lost holds a finished run, but not its replicas; run it again with --keep",
    ),
    "no run": (["one", "nothing"], "nothing holds no finished run; name the --out of one"),
    "one's own": (["one", "own"], "own holds a run of own, which is no study of this package; extend it by"),
    "forged": (
        ["one", "forged"],
        "one and forged hold the same replica, bit for bit, which would count twice",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_combined_is_refused_in_a_sentence(what, runs, monkeypatch, capsys):
    names, sentence = REFUSED[what]
    code, printed, told = combined(monkeypatch, capsys, runs, *names)
    assert code == 2 and printed == ""
    assert told.startswith(f"error: {sentence}") and told.count("\n") == 1
    assert not (runs / "all").exists()


def test_the_runs_themselves_are_never_replaced(runs, monkeypatch, capsys):
    for out, sentence in (
        ("one", "--out one is one of the runs to be combined; give another folder"),
        ("lost", "lost holds a finished run; give another folder with --out, or --force to replace it"),
    ):
        before = (runs / out / SUMMARY).read_bytes()
        code, _, told = combined(monkeypatch, capsys, runs, "one", "seven", out=out)
        assert code == 2 and told == f"error: {sentence}\n"
        assert (runs / out / SUMMARY).read_bytes() == before


def test_runs_of_one_length_for_all_are_refused(runs, tmp_path, monkeypatch):
    monkeypatch.chdir(runs)
    monkeypatch.setattr(EquationOfState, "not_extendable", "whose length depends on --replicas")
    with pytest.raises(
        HardSpheresError, match="one holds a run whose length depends on --replicas; it cannot be"
    ):
        Combine(runs=("one", "seven")).conduct(OutputFolder(tmp_path), Screen(True))


def test_its_default_folder_is_named_after_the_runs():
    assert str(Combine(runs=("runs/a", "runs/b")).folder(None).path) == "runs/combine-a-b"
    assert Combine(runs=tuple(f"runs/number-{k}" for k in range(9))).which == "9-runs"
