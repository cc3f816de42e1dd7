"""What holds for every study: files agree, workers and interruptions change nothing, bad input is one sentence."""

import csv
import itertools
import json
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from studies.answer import to_dataframe
from studies.cli import main
from studies.combine import Combine
from studies.fluid import Fluid
from studies.options import OptionError, options_of
from studies.pressure import EquationOfState
from studies.registry import QUESTIONS, study_named
from studies.report import OutputFolder, Screen
from studies.running.encoding import encode
from studies.running.journal import Shelf
from studies.running.kept import finished_run
from studies.running.ownership import files_of
from studies.study import Study, _Run, _Running, conduct, run_study

from .pages import Page, masked

SMALL = {
    "barometer": {
        "n": 100,
        "dim": 2,
        "packing_fractions": (0.02,),
        "boundary": "wall",
        "mass_ratio": 4.0,
        "diameter_ratio": 1.0 + 1e-9,  # for the engine the kind of gas that tests of gravity compile
        "collisions_per_particle": 80.0,
        "cells": 6,
        "replicas": 4,
    },
    "diffusion": {"n": 64, "packing_fractions": (0.1,), "collisions_per_particle": 80.0, "replicas": 4},
    "pressure": {"n": 100, "packing_fractions": (0.05, 0.25), "collisions_per_particle": 10.0},
    "drop": {"n": 60, "dim": 2, "packing_fraction": 0.05, "diameter_ratio": 1.0 + 1e-9, "replicas": 4},
    "expansion": {
        "n": 100,
        "packing_fraction": 0.02,
        "transits": 4.0,
        "reverse_after": (2.0,),
        "replicas": 4,
        "cells": 4,
    },
    "lorentz": {"packing_fractions": (0.7,), "collisions_per_particle": 12_800.0, "replicas": 4},
    "free-path": {"n": 100, "packing_fractions": (0.05,), "collisions_per_particle": 20.0},
    "melting": {
        "n": 224,
        "packing_fractions": (0.69,),
        "collisions_per_particle": 400.0,
        "equilibration": 100.0,
        "replicas": 2,
    },
    "mixture": {"n": 100, "packing_fraction": 0.02, "relaxation_times": 18.0, "replicas": 4},
    "soak": {"n": 100, "dim": 2, "collisions": 5000},
    "transport": {"n": 64, "packing_fractions": (0.1,), "collisions_per_particle": 400.0, "replicas": 4},
    "thermalise": {"n": 100, "replicas": 4, "collisions_per_particle": 2.0, "frames": 5, "animate": True},
}
RESTARTED = ("stale_events", "list_renewals", "bytes_per_particle", "collisions_per_second")
STUDIES = [name for name in QUESTIONS if issubclass(study_named(name), Study)]


@pytest.fixture(scope="module", autouse=True)
def _same_memory():
    """The memory of the process is no result: here it is unknown. Each frame of a film costs time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.thermalisation.FILM_FRAMES", 6)
        patch.setattr("studies.validation.soak.resident", lambda: np.nan)
        yield


def small(name, **more):
    return study_named(name)(**{"seed": 5, "workers": 1} | SMALL[name] | more)


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


def typed(name):
    """The small study as it is typed."""
    kind, options = study_named(name), []
    flags = {each.name: its.named(each.name) for each, its in options_of(kind)}
    for option, value in {**SMALL[name], "seed": 5, "workers": 1}.items():
        text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        options += [flags[option]] if value is True else [flags[option], text]
    return [name, *options]


class Remembering(Screen):
    """A screen that also keeps what it shows."""

    def __init__(self):
        super().__init__(json_output=True)
        self.tables, self.sentences = [], []

    def say(self, text=""):
        super().say(text)
        self.sentences.append(text)

    def table(self, title, columns, rows, **options):
        super().table(title, columns, rows, **options)
        self.tables.append([list(columns), *map(list, rows)])


printed = {}  # what the studies of `finished` showed


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Folder and summary of every study, run once."""
    kept = {}

    def run(name):
        if name not in kept:
            out, screen = OutputFolder(tmp_path_factory.mktemp("runs") / name), Remembering()
            kept[name] = (out, *conduct(small(name), out, screen))
            printed[name] = screen
        return kept[name]

    return run


@pytest.mark.parametrize("name", STUDIES)
def test_its_files_agree(name, finished):
    out, summary, sound = finished(name)
    kind = study_named(name)
    assert sound and summary["checks"]["passed"] and summary["study"] == kind.name == name
    there = {path.name for path in out.path.iterdir() if path.name != "replicas"}
    assert there == set(summary["files"]) and there <= {"summary.json", *files_of(kind)}
    assert "report.html" in there
    assert f"{kind.table}.csv" in there
    stored = json.loads((out.path / "summary.json").read_text())
    assert stored["states"] == json.loads(json.dumps(stored["states"], allow_nan=False))  # strict JSON
    with (out.path / f"{kind.table}.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    columns = ["packing_fraction", "quantity", "value", "error", "theory", "expected", "uncertainty", "z"]
    assert list(rows[0])[-8:] == columns
    found = [(state["packing_fraction"], each) for state in stored["states"] for each in state["measured"]]
    assert len(rows) == len(found)
    for row, (eta, each) in zip(rows, found, strict=True):
        assert float(row["packing_fraction"]) == eta and row["quantity"] == each["quantity"]
        pairs = {"value": "value", "error": "standard_error", "expected": "expected", "z": "z"}
        for column, entry in pairs.items():
            number = np.nan if each[entry] is None else each[entry]
            np.testing.assert_array_equal(float(row[column]), number)
    for state in stored["states"]:
        main_ones = state["main"]
        assert isinstance(main_ones, str) or set(main_ones) <= {q["quantity"] for q in state["measured"]}


@pytest.mark.parametrize("name", STUDIES)
def test_answers_in_python_are_the_tables_of_the_files(name, finished, monkeypatch):
    """To the last digit, numbers and curves, with no folder to write into. Sibling: a digit more."""
    out, *_ = finished(name)
    monkeypatch.setattr(OutputFolder, "create", None)
    answers = small(name).answers(Screen(json_output=True))

    def text(frame):
        return frame.to_csv(index=False, lineterminator="\n", na_rep="nan")

    numbers = to_dataframe(answers)
    written = (out.path / f"{study_named(name).table}.csv").read_text()
    assert text(numbers) == written
    if len(answers) == 1:
        assert text(answers[0].to_dataframe()) == written
    numbers["value"] *= 1.0 + 1e-15
    assert text(numbers) != written
    for curves in dict.fromkeys(curves for answer in answers for curves in answer.curves):
        whole = to_dataframe(answers, curves)
        assert text(whole) == (out.path / f"{curves}.csv").read_text()
        if len(answers) == 1:
            assert text(answers[0].curves[curves].to_dataframe()) == text(whole)


@pytest.mark.parametrize("name", STUDIES)
def test_its_report_says_what_was_printed(name, finished):
    """Every table cell by cell, every sentence but those of the run itself, and what made it."""
    out, summary, _ = finished(name)
    text = (out.path / "report.html").read_text(encoding="utf-8")
    page, shown = Page(text), printed[name]
    assert page.tables == shown.tables and shown.tables
    said = shown.sentences[: next(k for k, s in enumerate(shown.sentences) if "collisions in" in s)]
    missing = [
        sentence for sentence in said if " ".join(sentence.split()) not in page.text + str(page.labels)
    ]
    assert not missing
    assert summary["command"] in page.text and summary["digest"] in page.text
    assert set(page.links) == {name for name in summary["files"] if name != "report.html"}
    assert study_named(name).question in page.text and "All checks passed." in page.text
    assert page.names.count("svg") == sum(file.endswith(".png") for file in summary["files"])
    assert len(text) < 1e6 and len(set(page.ids)) == len(page.ids)
    assert not [what for what in page.loads if not what.startswith(("#", "data:", "url(#"))]


@pytest.mark.parametrize("name", STUDIES)
def test_the_command_line_does_the_same(name, finished, tmp_path, monkeypatch, capsys):
    """The same numbers, and JSON alone on standard output, which is the summary."""
    out, *_ = finished(name)
    capsys.readouterr()
    monkeypatch.setattr(sys, "argv", ["hardspheres", *typed(name), "--json", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code in (0, None), told.err
    printed = json.loads(told.out)
    assert printed == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert printed["states"] == json.loads((out.path / "summary.json").read_text())["states"]
    kind = study_named(name)
    assert (tmp_path / "out" / f"{kind.table}.csv").read_bytes() == (
        out.path / f"{kind.table}.csv"
    ).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_workers_change_nothing(name, finished, tmp_path):
    out, summary, _ = finished(name)
    other = OutputFolder(tmp_path / "again")
    again, _ = conduct(small(name, workers=2), other, Screen(json_output=True))
    assert again["checks"] == summary["checks"]
    if name == "soak":  # it measures the memory of each process
        return
    np.testing.assert_equal(again["states"], summary["states"])
    assert again["digest"] == summary["digest"]
    for path in out.path.glob("*.*"):
        if path.suffix in (".csv", ".xyz", ".png"):
            assert path.read_bytes() == (other.path / path.name).read_bytes()
    pages = [(folder.path / "report.html").read_text(encoding="utf-8") for folder in (out, other)]
    assert masked(pages[0]) == masked(pages[1]) and pages[0] != pages[1]


@pytest.mark.parametrize("name", STUDIES)
def test_a_replica_does_not_depend_on_how_many_there_are(name, finished):
    """The last of each gas, of a study with one more: so that a run can be extended. Sibling below."""
    out, *_ = finished(name)
    kept = finished_run(out.path)
    study = replace(kept.study, replicas=kept.study.replicas + 1)
    assert not study.not_extendable
    for k, (gas, own) in enumerate(zip(study.gases(), kept.replicas, strict=True)):
        again = _Running(study, out.path)(_Run(gas, len(own) - 1, k))
        if name != "soak":  # it measures the memory of each process
            assert bits(again) == bits(own[-1]) != bits(own[0]) or len(own) == 1
        assert again.digest == own[-1].digest


def test_a_study_whose_replicas_depend_on_how_many_there_are_says_so():
    """Those of the suite share a length."""
    fluid = Fluid(n=108, packing_fraction=0.2)
    few, many = (EquationOfState(suite=True, until_error=0.004, replicas=count) for count in (2, 4))
    assert few.length(fluid) > many.length(fluid) and few.not_extendable
    same = [EquationOfState(replicas=count) for count in (2, 4)]
    assert len({study.length(fluid) for study in same}) == 1 and not same[0].not_extendable


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_two_seeds_are_combined(name, finished, tmp_path):
    """All files but what is recorded of one run; as many collisions as both."""
    out, one, _ = finished(name)
    other, _ = conduct(small(name, seed=6), OutputFolder(tmp_path / "other"), Screen(json_output=True))
    both = OutputFolder(tmp_path / "both")
    combined = Combine(runs=(str(out.path), str(tmp_path / "other")))
    summary, _ = combined.conduct(both, Screen(json_output=True))
    assert summary["collisions"] == one["collisions"] + other["collisions"]
    assert set(one["files"]) - set(summary["files"]) <= {"trajectory.xyz", "gas.html", "gas.gif"}
    gases = [finished_run(out.path).study.gases(), summary["states"]]
    assert len(gases[0]) == len(gases[1])


class Interrupted(Exception):
    pass


def bits(replica):
    """A replica without its timings, and without what the search begins anew after a restart."""
    status = {key: value for key, value in replica.status.items() if key not in RESTARTED}
    bare = replace(replica, seconds=0.0, status=status)
    return {name: content.tobytes() for name, content in encode(bare).items()}


def counted(study, monkeypatch):
    """Count how often the replicas of a study pause; the list grows while they run."""
    whole, pauses = type(study).advance, []

    def advance(self, gas, replica):
        for _ in whole(self, gas, replica):
            pauses.append(gas)
            yield

    monkeypatch.setattr(type(study), "advance", advance)
    return pauses


def in_pieces(study, folder, every, monkeypatch):
    """Replicas of a study that is thrown away after every so many pauses, of which it was saved at three."""
    whole, save, calls = type(study).advance, Shelf.save, itertools.count(1)

    def advance(self, gas, replica):
        for pauses, _ in enumerate(whole(self, gas, replica)):
            if pauses == every:
                raise Interrupted
            yield

    def now_and_then(shelf, *state):
        if next(calls) % max(1, every // 3) == 0:
            save(shelf, *state)

    monkeypatch.setattr(type(study), "advance", advance)
    monkeypatch.setattr(Shelf, "save", now_and_then)
    (folder / "checkpoint").mkdir(parents=True)
    times = 0
    while True:
        try:
            shelf = Shelf(folder / "checkpoint", 0.0)
            return run_study(study, Screen(True), shelf, folder, record=True), times
        except Interrupted:
            times += 1


def same(one, other):
    (replicas, recorded), (others, other_recorded) = one, other
    pairs = [(a, b) for x, y in zip([*replicas], [*others], strict=True) for a, b in zip(x, y, strict=True)]
    if recorded is not None:
        pairs.append((recorded, other_recorded))
    return all(bits(a) == bits(b) for a, b in pairs)


@pytest.mark.parametrize("name", STUDIES)
def test_interrupted_often_it_gives_the_same_bytes(name, tmp_path, monkeypatch):
    """Sibling: a study that forgets what it had added when it was interrupted."""
    monkeypatch.setattr("studies.running.resuming.PAUSE", 300)
    study = small(name)
    study = replace(study, replicas=max(1, min(study.replicas, 4)))
    (tmp_path / "whole").mkdir()
    with monkeypatch.context() as patch:
        pauses = counted(study, patch)
        whole = run_study(study, Screen(True), None, tmp_path / "whole", record=True)
    pieces, times = in_pieces(study, tmp_path / "pieces", max(1, len(pauses) // 12), monkeypatch)
    assert times > 5
    assert same(pieces, whole)
    recorded = {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    assert recorded == {
        path.name: path.read_bytes() for path in (tmp_path / "pieces").iterdir() if path.is_file()
    }


def test_a_study_that_forgets_something_is_found_out(tmp_path, monkeypatch):
    kind, study = study_named("diffusion"), small("diffusion", replicas=4)
    whole = run_study(study, Screen(True))
    remembering = kind.advance

    def forgetful(self, gas, replica):
        if replica.done:
            replica.estimators = dict(self.estimators(gas, replica.simulation))
        yield from remembering(self, gas, replica)

    monkeypatch.setattr(kind, "advance", forgetful)
    assert not same(in_pieces(study, tmp_path, 100, monkeypatch)[0], whole)


BAD = [
    (["--replicas", "0"], "--replicas 0 is out of range; ask for 1 to 1000000"),
    (["--workers", "0"], "--workers 0 is out of range; ask for at least 1"),
    (["--seed", "-1"], "--seed -1 is out of range; ask for at least 0"),
    (["--dim", "4"], "--dim 4 is out of range; ask for 2 to 3"),
    (["--out", ""], "--out is empty; name a folder for the results"),
    (["--out", "a-file/below"], "a-file cannot be written to; give another folder with --out"),
    (["--resume"], "holds no unfinished run, so there is nothing to resume"),
    (["--resume", "--force"], "--resume continues a run and --force replaces it; give one of them"),
]
OF_GASES = [
    (["--packing-fraction", "0.9"], "packing fraction 0.9 is above"),
    (["--until-error", "2"], "--until-error 2 must be between 0 and 1"),
]
OF_SHARDS = [
    (["--shard", "4/3"], "--shard 4/3 is not understood; give k/n with k from 1 to n, as in 2/3"),
    (["--shard", "1/3", "--resume"], "--shard 1/3 with --resume: a shard goes on by itself"),
    (["--shard", "1/3", "--force"], "--shard 1/3 with --force: it would remove what other shards have done"),
    (["--shard", "1/3", "--json"], "--shard 1/3 with --json: a shard has no results to print"),
]
OF_BOTH = [(["--shard", "1/3", "--until-error", "1e-3"], "with --until-error: its pilot would be run by")]
BAD_HERE = [
    (name, *row)
    for name in STUDIES
    for kind in [study_named(name)]
    for row in BAD + OF_GASES * kind.to_an_error + (OF_SHARDS + OF_BOTH * kind.to_an_error) * kind.in_shards
    if row[0][0] != "--dim" or "dim" in {each.name for each in fields(kind)}
]


@pytest.mark.parametrize(("name", "options", "sentence"), BAD_HERE)
def test_bad_input_is_one_sentence(name, options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").write_text("mine")
    code = command(monkeypatch, name, *options)
    told = capsys.readouterr()
    assert code == 2 and told.out == ""
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a-file"]


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_option_has_help(name):
    kind = study_named(name)
    described = {each.name for each, its in options_of(kind) if its.help.endswith((".", "same"))}
    assert described == {each.name for each, _ in options_of(kind)}
    if issubclass(kind, Study):
        assert described == {each.name for each in fields(kind) if each.repr}
    assert QUESTIONS[name][1].endswith(".") and kind.explanation.strip().endswith(".")


def test_limits_hold_in_python_too():
    with pytest.raises(OptionError, match="--n 1 is out of range; ask for at least 2"):
        study_named("diffusion")(n=1)
