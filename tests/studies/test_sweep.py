"""Sweeps: a whole run of each value with its own seed, taken over or resumed, and one table and figure over them."""

import csv
import json
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest

import hardspheres as hs
from analysis.statistics import Estimate
from analysis.theory import Prediction
from studies.answer import Answer, number
from studies.cli import main
from studies.fluid import Fluid
from studies.free_path import FreePaths
from studies.listing import runs_in
from studies.options import OptionError, in_words, options_of
from studies.output import OutputFolder
from studies.pressure import EquationOfState
from studies.registry import QUESTIONS, study_named
from studies.report import Screen
from studies.study import Study
from studies.sweep import Point, Swept, points_of, sweep, values_of
from studies.thermalisation import Thermalisation

from .pages import Page
from .test_screens import cut, overlapping

STUDY = EquationOfState(packing_fractions=(0.05,), collisions_per_particle=10.0, seed=5, workers=1)
TYPED = ["pressure", "--packing-fraction", 0.05, "--collisions-per-particle", 10, "--seed", 5, "--workers", 1]


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


@pytest.mark.parametrize(
    ("text", "name", "values"),
    [
        ("n=500,1000,2000", "n", ["500", "1000", "2000"]),
        ("n=500:2000:4", "n", ["500", "1000", "1500", "2000"]),
        ("packing-fraction=0.1:0.3:3", "packing-fraction", ["0.1", "0.2", "0.3"]),
        ("boundary=periodic;periodic,periodic,wall", "boundary", ["periodic", "periodic,periodic,wall"]),
        ("packing-fraction=0.1:0.2:2;0.3", "packing-fraction", ["0.1:0.2:2", "0.3"]),
        ("velocities=maxwell, beams", "velocities", ["maxwell", "beams"]),
    ],
)
def test_the_values_that_a_text_means(text, name, values):
    assert values_of(text) == (name, values)


def small(name):
    """A study of each kind, of a gas that makes sense."""
    return study_named(name)(replicas=4, seed=3)


SWEPT = {  # of each study an option of every kind that it has: numbers, words, truth values, lists
    "thermalise": {"n": (50, 100), "velocities": ("maxwell", "beams"), "animate": (False, True)},
    "pressure": {"packing_fraction": (0.1, 0.2), "boundary": ("periodic", ("periodic", "periodic", "wall"))},
    "free-path": {"gas": ("Ar", "Ne"), "mass-ratio": (1.0, 10.0)},
    "diffusion": {"dim": (2, 3), "collisions_per_particle": (80.0, 160.0)},
    "transport": {"dim": (2, 3), "mass-ratio": (1.0, 2.0)},
    "mixture": {"diameter-ratio": (1.5, 2.0), "temperature_ratio": (0.5, 2.0)},
    "expansion": {"mix": (False, True), "reverse-after": ((1.0,), (1.0, 2.0)), "cells": (10, 20)},
    "barometer": {
        "scale-heights": (2.0, 4.0),
        "packing_fraction": (0.01, 0.02),
        "boundary": ("periodic", "wall"),
    },
    "drop": {"mass-ratio": (1.0, 10.0), "dim": (2, 3), "scale_heights": (3.0, 5.0)},
    "lorentz": {"obstacles": ("square", "random"), "size": (0.1, 1.0), "packing_fraction": (0.1, 0.2)},
    "melting": {"n": (224, 870), "start": ("fluid", "crystal"), "equilibration": (0.0, 50.0)},
    "soak": {"collisions": (1000, 2000)},
}
NAMES = [name for name in QUESTIONS if issubclass(study_named(name), Study)]


@pytest.mark.parametrize("name", NAMES)
def test_any_option_of_any_study_can_be_swept(name):
    """Each value has its own seed, which depends on the study's seed and on the value alone."""
    for option, values in SWEPT[name].items():
        swept, base, points = points_of(small(name), option, values)
        field = next(
            each.name for each, its in options_of(type(base)) if its.named(each.name) == f"--{swept}"
        )
        given = [in_words(value) for value in values]
        assert [in_words(each.value) for each in points] == [each.text for each in points] == given
        assert [in_words(getattr(each.study, field)) for each in points] == given
        *_, turned = points_of(small(name), option, values[::-1])
        *_, other = points_of(replace(small(name), seed=4), option, values)
        seeds, again, others = (
            {each.text: each.study.seed for each in found} for found in (points, turned, other)
        )
        assert seeds == again and len({*seeds.values(), *others.values()}) == 4


BAD = [
    ("n", "--sweep n is not understood; give an option and values, as in n=500,1000"),
    ("n=", "--sweep n= is not understood"),
    ("n=64", "--sweep n has 1 value; ask for 2 to 1000"),
    ("n=64,64", "--sweep n has 64 twice; give each value once"),
    ("n=64,many", "--sweep n=64,many: --n many is not a whole number"),
    ("n=64:65:3", "--sweep n=64:65:3: --n 64.5 is not a whole number"),
    ("n=a:b:3", "--sweep n=a:b:3: expected first:last:count"),
    ("n=64,1", "--sweep n=64,1: --n 1 is out of range; ask for at least 2"),
    ("dim=2,3,4", "--sweep dim=2,3,4: --dim 4 is out of range; ask for 2 to 3"),
    ("suite=no,yes", "--suite no is not true or false"),
    ("boundary=periodic,sticky", "--boundary sticky is not known; it can be periodic or wall"),
    ("packing-fraction=0.1,0.9", "--sweep packing-fraction=0.9: packing fraction 0.9 is above"),
    ("fraction=0.2,0.5", "--sweep fraction=0.2: --fraction needs --mass-ratio or --diameter-ratio"),
    ("particles=1,2", "--sweep particles: pressure has no such option; --help lists all"),
    ("out=a,b", "--sweep out: pressure has no such option"),
    ("seed=1,2", "--sweep seed: a seed is no quantity"),
    ("workers=1,2", "--sweep workers: no number depends on it"),
    ("n=64:1e9:100000", "--sweep n=64:1e9:100000: --n "),
]


@pytest.mark.parametrize(("text", "sentence"), BAD)
def test_bad_input_is_one_sentence_before_anything_is_run(text, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(Study, "start", None)
    monkeypatch.chdir(tmp_path)
    code = command(monkeypatch, "pressure", "--sweep", text)
    told = capsys.readouterr()
    assert code == 2 and told.out == "" and not list(tmp_path.iterdir())
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1


def test_an_option_is_not_given_twice(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, "pressure", "--sweep", "n=64,100", "--n", 64) == 2
    assert "--n and --sweep n=64,100 both give it; leave out one of them" in capsys.readouterr().err
    assert command(monkeypatch, "pressure", "--sweep", "n=64,100", "--resume", "--out", "nowhere") == 2
    assert "nowhere holds no part of a sweep, so there is nothing to resume" in capsys.readouterr().err
    assert command(monkeypatch, "pressure", "--sweep", "n=64,100", "--until-error", 2) == 2
    assert capsys.readouterr().err.startswith("error: --until-error 2 must be between 0 and 1")
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A sweep of two values, run once."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    with pytest.MonkeyPatch.context() as patch:
        assert command(patch, *TYPED, "--sweep", "n=64,100", "--out", out) == 0
    return out


def numbers(path):
    with path.open() as handle:
        return list(csv.DictReader(handle))


def test_its_files(finished):
    """The table has every number of the parts, the report a link to each, the summary what made them."""
    assert {path.name for path in finished.iterdir()} == {
        "summary.json", "sweep.csv", "sweep.png", "report.html", "n=64", "n=100",
    }  # fmt: skip
    rows = numbers(finished / "sweep.csv")
    parts = [numbers(finished / f"n={n}" / "equation_of_state.csv") for n in (64, 100)]
    assert [row["n"] for row in rows] == ["64"] * len(parts[0]) + ["100"] * len(parts[1])
    for row, part in zip(rows, [*parts[0], *parts[1]], strict=True):
        assert {key: row[key] for key in part} == part
    summary = json.loads((finished / "summary.json").read_text())
    assert summary["study"] == "pressure" and summary["checks"]["passed"]
    own = [
        json.loads((finished / folder / "summary.json").read_text()) for folder in summary["sweep"]["folders"]
    ]
    assert summary["sweep"]["digests"] == [each["digest"] for each in own]
    assert summary["sweep"]["seeds"] == [each["seed"] for each in own]
    assert summary["command"].endswith("--sweep n=64,100")
    page = Page((finished / "report.html").read_text(encoding="utf-8"))
    assert {"n%3D64/report.html", "n%3D100/report.html"} <= set(page.links)
    assert "Z from the virial at 2 values of n, 64 to 100" in page.text and summary["command"] in page.text
    (run,) = [run for run in runs_in(finished) if run.folder == str(finished)]
    assert (run.study, run.told) == ("pressure over n", "finished")


def test_in_python_it_gives_the_same_numbers(finished, monkeypatch):
    """To the last digit, and writes nothing. Sibling: another seed."""
    monkeypatch.setattr(OutputFolder, "create", None)
    rows = numbers(finished / "sweep.csv")
    for study, same in ((STUDY, True), (replace(STUDY, seed=6), False)):
        found = sweep(study, "n", (64, 100), Screen(json_output=True))
        assert [n for n, _ in found] == [64, 100]
        values = [each.measured.value for _, answers in found for each in answers[0].numbers]
        assert (values == [float(row["value"]) for row in rows]) == same
    assert list(found.columns()) == list(rows[0])


def test_a_part_is_a_run_of_its_own(finished, tmp_path, monkeypatch):
    """Repeated from its summary, it has the same digest and table."""
    part, again = finished / "n=100", tmp_path / "again"
    assert command(monkeypatch, "pressure", "--config", part, "--workers", 1, "--out", again) == 0
    tables = [(folder / "equation_of_state.csv").read_bytes() for folder in (part, again)]
    assert tables[0] == tables[1]


class Stopped(Exception):
    pass


def digests(out):
    return json.loads((out / "summary.json").read_text())["sweep"]["digests"]


def test_interrupted_it_goes_on_and_takes_what_is_finished(finished, tmp_path, monkeypatch, capsys):
    """The same digests as of the whole. Siblings: without --resume, and with another length."""
    out, whole, begun = tmp_path / "out", EquationOfState.advance, []

    def advance(self, gas, replica):
        begun.append(gas.n)
        for k, _ in enumerate(whole(self, gas, replica)):
            if gas.n == 100 and replica.index == 0 and k == 5:
                raise Stopped
            yield

    options = [*TYPED, "--sweep", "n=64,100", "--out", out]
    with monkeypatch.context() as patch:
        patch.setattr(EquationOfState, "advance", advance)
        patch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
        with pytest.raises(Stopped):
            main()
    assert sorted({*begun}) == [64, 100] and not (out / "summary.json").exists()
    assert (out / "n=100" / "checkpoint" / "done-0001.npz").exists()
    assert [(run.told, run.runs) for run in runs_in(out)] == [
        ("unfinished, 1 of 2 done", 2),
        ("finished", None),
    ]
    capsys.readouterr()
    assert command(monkeypatch, *options) == 2
    assert "n=100 holds an unfinished run; add --resume to continue it" in capsys.readouterr().err
    longer = ["11" if word == 10 else word for word in options]
    assert command(monkeypatch, *longer, "--resume") == 2
    assert (
        "n=64 holds a finished run with --collisions-per-particle 10, and now it is 11"
        in capsys.readouterr().err
    )
    begun.clear()
    with monkeypatch.context() as patch:
        patch.setattr(EquationOfState, "advance", lambda *to: (begun.append(to[1].n), whole(*to))[1])
        assert command(monkeypatch, *options, "--resume") == 0
    assert begun == [100] and digests(out) == digests(finished)
    assert "n=64 (1 of 2): finished before" in capsys.readouterr().err


def test_values_are_added_and_a_sweep_is_repeated_from_its_summary(finished, tmp_path, monkeypatch, capsys):
    """Siblings: a finished sweep is not replaced, nor is a run of another kind."""
    out = tmp_path / "out"
    assert command(monkeypatch, "pressure", "--config", finished, "--workers", 1, "--out", out) == 0
    assert digests(out) == digests(finished)
    capsys.readouterr()
    wider = [*TYPED, "--sweep", "n=64,100,50", "--out", out]
    assert command(monkeypatch, *wider) == 2
    assert "holds a finished sweep; add --resume to go on with other values" in capsys.readouterr().err
    assert command(monkeypatch, *wider, "--resume", "--json") == 0
    told = capsys.readouterr()
    assert json.loads(told.out)["sweep"]["digests"][:2] == digests(finished)
    assert told.err.count("finished before") == 2 and digests(out) == json.loads(told.out)["sweep"]["digests"]
    for folder in (out / "n=64", out):
        other = ["free-path", "--sweep", "n=64,100", "--resume", "--out", folder]
        assert command(monkeypatch, *other) == 2
        assert "is no sweep of free-path over n, so there is nothing to resume" in capsys.readouterr().err


def test_a_failed_check_at_one_value_fails_the_sweep(tmp_path, monkeypatch, capsys):
    whole = EquationOfState.answer

    def answer(self, gas, replicas):
        found = whole(self, gas, replicas)
        return replace(found, failures=["it is broken"]) if gas.n == 100 else found

    monkeypatch.setattr(EquationOfState, "answer", answer)
    assert command(monkeypatch, *TYPED, "--sweep", "n=64,100", "--out", tmp_path / "out") == 1
    assert "CHECK FAILED, n=100: it is broken" in capsys.readouterr().out
    assert "n=100: it is broken" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


# The table and the figure, of numbers that were made up.


def made_up(study, option, values, quantities=("Z",), gases=1, theory="Enskog", y=lambda k: 1.0 + k):
    """A sweep that was never run."""
    name, base, points = points_of(study, option, values)
    answers = []
    for k, _ in enumerate(points):
        own = [Fluid(n=100, packing_fraction=0.1 * (gas + 1)) for gas in range(gases)]
        numbers = [
            number(
                each, Estimate(y(k), 0.1, 10, 9), theory, Prediction(y(k) * 1.05, 0.05) if theory else None
            )
            for each in quantities
        ]
        answers.append([Answer(gas, numbers) for gas in own])
    return Swept(base, name, points, answers)


LONG = ("collisions per particle and time", "rate of temperature equilibration", "mean free time of 1 [ps]")
FIGURES = {
    "one": made_up(STUDY, "n", (64, 100, 200)),
    "over decades": made_up(STUDY, "n", (64, 512, 4096, 32768), LONG[:1]),
    "many, over decades": made_up(STUDY, "n", tuple(64 * 2**k for k in range(12))),
    "several gases": made_up(STUDY, "n", (64, 100), gases=3),
    "words": made_up(Thermalisation(), "velocities", ("maxwell", "equal-speeds", "beams"), LONG[:2]),
    "lists": made_up(STUDY, "boundary", ("periodic", ("periodic", "periodic", "wall")), LONG),
    "no theory": made_up(STUDY, "mass-ratio", (1.0, 2.0, 5.0), LONG[:2], theory=""),
    "a real gas": made_up(FreePaths(gas="Ar"), "temperature", (250.0, 300.0, 400.0), LONG),
    "steep": made_up(STUDY, "n", (64, 100, 200), y=lambda k: 10.0**k),
    "main ones of many": made_up(STUDY, "n", (64, 100), [f"quantity {k}" for k in range(6)]),
}


@pytest.mark.parametrize("case", FIGURES)
def test_words_of_its_figure_never_overlap(case):
    drawn = FIGURES[case].figure()
    drawn.suptitle("a gas")
    assert overlapping(drawn) == []
    for axes in drawn.axes:
        assert axes.get_ylabel()


def test_scales_of_its_figure():
    """Logarithmic over more than a decade, and where a quantity is steep; words stand beside each other."""
    first = {case: found.figure().axes[0] for case, found in FIGURES.items()}
    assert first["one"].get_xscale() == first["one"].get_yscale() == "linear"
    assert first["over decades"].get_xscale() == "log"
    assert list(first["over decades"].get_xticks()) == [64, 512, 4096, 32768]
    assert first["steep"].get_yscale() == "log"
    words = FIGURES["words"].figure().axes[-1].get_xticklabels()
    assert [text.get_text() for text in words] == ["maxwell", "equal-speeds", "beams"]
    assert len(FIGURES["no theory"].figure().axes) == 2 and len(FIGURES["words"].figure().axes) == 4
    assert len(FIGURES["main ones of many"].figure().axes) == 2
    labels = FIGURES["a real gas"].figure().axes[-1].get_xlabel()
    assert labels == "temperature [K]"


@pytest.mark.parametrize("width", [40, 80])
@pytest.mark.parametrize("case", FIGURES)
def test_its_table_can_be_read_in_a_narrow_window(case, width, capsys):
    table = FIGURES[case].table()
    Screen(width=width).table("", table.header, table.rows, keys=table.keys)
    lines = capsys.readouterr().out.split("\n")
    assert max(map(len, lines)) <= width and cut(lines, [("", table.header, table.rows, {})]) == set()


def test_what_is_measured_at_the_end_is_one_quantity():
    """Whenever that was; sibling: at the same s, which is told."""
    for ends, name in (((2.0, 4.0), "a2 at the end"), ((2.0, 2.0), "a2 at s = 2")):
        points = [Point(s, f"{s:g}", Thermalisation()) for s in (2.0, 4.0)]
        gas = Fluid(n=100)
        own = [[Answer(gas, [number(f"a2 at s = {end:g}", Estimate(0.1, 0.01))])] for end in ends]
        found = Swept(Thermalisation(), "collisions-per-particle", points, own)
        assert found.quantities == [name] and len(found.numbers(name)) == 2
        assert found.columns()["quantity"] == [f"a2 at s = {end:g}" for end in ends]


def test_a_prompt_shows_it_in_a_line():
    told = "<Swept: thermalise at 3 values of velocities, maxwell to beams: " + ", ".join(LONG[:2]) + ">"
    assert repr(FIGURES["words"]) == told


def test_one_seed_for_all_values_would_give_errors_that_are_not_independent():
    """Gases from one seed start alike: their first velocities are the same; sibling: seeds of the values."""
    _, _, points = points_of(FreePaths(packing_fractions=(0.1,)), "n", (64, 100))

    def velocities(seeds):
        scenes = [
            point.study.gases()[0].scene(np.random.SeedSequence(seed, spawn_key=(0,)))
            for point, seed in zip(points, seeds, strict=True)
        ]
        return [scene.velocities[:64].ravel() for scene in scenes]

    own = velocities([point.study.seed for point in points])
    assert abs(np.corrcoef(own)[0, 1]) < 4.5 / math.sqrt(192)  # once in 1e5
    same = velocities([1, 1])
    assert np.corrcoef(same)[0, 1] > 0.5


def test_a_study_that_is_no_study_has_no_sweep(monkeypatch, capsys):
    assert command(monkeypatch, "analyse", "x.xyz", "--sweep", "n=1,2") == 2
    assert re.search("No such option", capsys.readouterr().err)
    with pytest.raises(OptionError, match="has 1 value"):
        sweep(STUDY, "n", (64,))
    with pytest.raises(hs.HardSpheresError, match="--sweep n=1: --n 1 is out of range"):
        sweep(STUDY, "n", (64, 1))
