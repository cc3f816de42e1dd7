"""Options from a file: every option of every study survives the way through JSON, and what is wrong is one sentence."""

import json
import sys
from dataclasses import fields

import pytest

import hardspheres as hs
from studies.cli import main
from studies.commands import command_of
from studies.options import options_of
from studies.output import jsonable
from studies.registry import QUESTIONS, study_named
from studies.study import Study
from studies.thermalisation import Thermalisation

OF_FILES = {
    "file": "a file's name.xyz",
    "radius": {"A": 0.5, "B b": 1 / 3},
    "mass": 2.5,
    "units": "ase",
    "velocities_are": "reduced",
    "box": (9.0, 8.5),
    "boundary": ("periodic", "wall"),
    "dim": 2,
}
OF_STUDIES = {"seed": 2**31, "replicas": 7}
REAL = {"gas": "Ar", "temperature": 300.5, "pressure": 1e5, "diameter": 0.36}
TWO = {"mass_ratio": 1e-3, "diameter_ratio": 1.25, "fraction": 1 / 3}
OTHERS = {  # a value for every option that is not its default, whether they make sense together or not
    "thermalise": OF_STUDIES | REAL | TWO | {key: OF_FILES[key] for key in list(OF_FILES)[1:]} | {
        "n": 50, "packing_fraction": 0.1 + 0.2, "velocities": "two-temperatures", "temperature_ratio": 2.0,
        "collisions_per_particle": 2.5, "source": "a=b, c.xyz", "frames": 0, "animate": True,
    },
    "pressure": OF_STUDIES | TWO | {
        "packing_fractions": (0.1, 1 / 3), "n": 50, "dim": 2, "boundary": ("periodic", "wall"),
        "collisions_per_particle": 1e9, "suite": True, "until_error": None,
    },
    "free-path": OF_STUDIES | REAL | TWO | {
        "packing_fractions": (1e-3,), "n": 50, "dim": 2, "collisions_per_particle": 20.0,
    },
    "diffusion": OF_STUDIES | REAL | {
        "packing_fractions": (0.1,), "n": 50, "dim": 2, "collisions_per_particle": 80.0, "diameter": "kinetic",
    },
    "transport": OF_STUDIES | TWO | {
        "packing_fractions": (0.1,), "n": 50, "dim": 2, "collisions_per_particle": 800.0,
    },
    "mixture": OF_STUDIES | TWO | {
        "packing_fraction": 0.02, "n": 50, "dim": 2, "temperature_ratio": 0.5, "relaxation_times": 18.0,
    },
    "expansion": OF_STUDIES | {
        "packing_fraction": 0.02, "n": 50, "dim": 2, "mix": True, "boundary": "wall", "cells": 4,
        "transits": 7.0, "reverse_after": (0.5, 1 / 3),
    },
    "barometer": OF_STUDIES | TWO | {
        "packing_fractions": (0.02,), "n": 50, "dim": 2, "boundary": "wall", "scale_heights": 3.0, "cells": 10,
        "collisions_per_particle": 40.0,
    },
    "drop": OF_STUDIES | TWO | {
        "packing_fraction": 0.03, "n": 50, "dim": 2, "boundary": "periodic", "scale_heights": 3.0,
    },
    "lorentz": OF_STUDIES | {
        "obstacles": "random", "packing_fractions": (0.1, 1 / 3), "dim": 3, "n": 50, "size": 0.25,
        "collisions_per_particle": 1e4,
    },
    "melting": OF_STUDIES | {
        "packing_fractions": (2 / 3, 0.69), "n": 224, "starts": "fluid", "collisions_per_particle": 400.0,
        "equilibration": 0.0,
    },
    "view": OF_FILES | {"collisions_per_particle": 2.0},
    "analyse": OF_FILES,
    "bench": {
        "n": ((100,), (200, 300)), "dim": 2, "packing_fraction": ((0.1,), (0.2, 0.3)), "boundary": "wall",
        "diameter_ratio": 2.0, "mass_ratio": 3.0, "fraction": 0.25, "start": "fluid", "collisions": 10**12,
        "discard": 0.5, "against": "plain", "suite": "quick", "seed": 3, "threads": ((1, 2),),
    },
    "accuracy": {"packing_fractions": (0.3,), "n": 300, "dim": 2, "seed": 4, "quick": True},
    "accuracy-tables": {"rounds": 3, "known": "rounds.csv", "quick": True, "seed": 5},
    "combine": {"runs": ("one", "two")},
    "calibration": {"runs": 30, "seed": 5},
    "hard-cases": {"size": "small", "only": ("cradle", "ratios")},
    "verify": {"quick": True, "seed": 6},
    "soak": OF_STUDIES | {"collisions": 10**9 + 1, "n": 50, "dim": 2},
}  # fmt: skip
EXPANDED = {"expansion": {"reverse_after": (1 / 3, 0.5)}}  # sorted, as when it is typed


def taken(name, monkeypatch, *options):
    """The study that a command makes of these options, which is not run."""
    kind, seen = study_named(name), []
    with monkeypatch.context() as patch:
        patch.setattr(kind, "prepared", lambda self, say: self)
        patch.setattr(kind, "conduct", lambda self, out, screen: (seen.append(self), ({}, True))[1])
        command_of(kind)([*map(str, options)], standalone_mode=False)
    return seen[0]


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_option_survives_the_way_through_a_summary(name, tmp_path, monkeypatch):
    """Each of another value than its default; sibling: without the file all have their defaults."""
    kind = study_named(name)
    every = {each.name: each for each, _ in options_of(kind)}
    assert set(OTHERS[name]) == {each.name for each, its in options_of(kind) if its.matters}
    for option, value in OTHERS[name].items():
        assert value != every[option].default or option == "until_error"
    study = kind(**OTHERS[name] | EXPANDED.get(name, {}))
    content = {"study": name, "version": hs.__version__, "options": study.chosen}
    (tmp_path / "summary.json").write_text(json.dumps(jsonable(content)))
    for file in (tmp_path / "summary.json", tmp_path):
        assert taken(name, monkeypatch, "--config", file) == study
    argument = ["x.xyz"] if {"file", "runs"} & {*every} and name != "calibration" else []
    assert taken(name, monkeypatch, *argument) != study


@pytest.mark.parametrize("name", QUESTIONS)
def test_every_option_survives_the_way_through_toml(name, tmp_path, monkeypatch):
    """As it is typed, names with dashes or underscores."""
    kind, lines = study_named(name), []
    for k, (each, its) in enumerate(options_of(kind)):
        value = OTHERS[name].get(each.name)
        if value is not None:
            flag = each.name if its.argument else its.named(each.name).lstrip("-")
            lines.append(f"{flag if k % 2 else flag.replace('-', '_')} = {toml(value)}\n")
    (tmp_path / "run.toml").write_text("".join(lines))
    study = kind(**OTHERS[name] | EXPANDED.get(name, {}))
    assert taken(name, monkeypatch, "--config", tmp_path / "run.toml") == study


def toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(each)}" for key, each in value.items()) + "}"
    return json.dumps(value)


def run(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


def test_what_is_typed_wins_and_a_file_may_say_where(tmp_path, monkeypatch):
    """Sibling: the same without options beside the file."""
    file, seen = tmp_path / "run.toml", []
    file.write_text(f'n = 50\nseed = 3\nout = "{tmp_path}/here"\nforce = true\nworkers = 1\nformat = "svg"\n')
    monkeypatch.setattr(
        Thermalisation, "conduct", lambda self, out, screen: (seen.append((self, out)), ({}, True))[1]
    )
    assert run(monkeypatch, "thermalise", "--seed", 4, "--config", file, "--format", "pdf") == 0
    assert run(monkeypatch, "thermalise", "--config", file) == 0
    (study, out), (plain, usual) = seen
    assert (study.n, study.seed, study.workers) == (50, 4, 1) and (plain.n, plain.seed) == (50, 3)
    assert out.path == usual.path == tmp_path / "here" and out.force
    assert (out.figure_format, usual.figure_format) == ("pdf", "svg")


SUMMARY = {"study": "thermalise", "version": hs.__version__, "options": {}}
BAD = {
    "unknown.toml": ("particles = 50\n", "unknown.toml: thermalise has no option particles; --help lists all"),
    "twice.toml": ("mass-ratio = 2\nmass_ratio = 3\n", "--mass-ratio is given twice, once as mass_ratio"),
    "type.toml": ('n = "many"\n', "type.toml: --n many: a whole number is expected"),
    "float.toml": ("n = 50.5\n", "--n 50.5: a whole number is expected"),
    "truth.toml": ("n = true\n", "--n true: a whole number is expected"),
    "flag.toml": ("animate = 1\n", "--animate 1: true or false is expected"),
    "text.toml": ("from = 3\n", "--from 3: a text is expected"),
    "date.toml": ("n = 2020-01-01\n", '--n "2020-01-01": a whole number is expected'),
    "table.toml": ("[box]\nx = {y = 1}\n", "--box {\"x\": {\"y\": 1}}: a text or numbers is expected"),
    "range.toml": ("replicas = 0\n", "range.toml: --replicas 0 is out of range; ask for 1 to 1000000"),
    "every.toml": ("checkpoint-every = -1.0\n", "--checkpoint-every -1 is out of range; ask for at least 0"),
    "word.toml": ('velocities = "slow"\n', "word.toml: --velocities slow is not known; it can be maxwell"),
    "positive.toml": ("mass_ratio = -1\n", "positive.toml: --mass-ratio -1 must be positive and finite"),
    "several.toml": ("packing-fraction = [0.1, 0.2]\n", "--packing-fraction 0.1,0.2 names several"),
    "labels.toml": ('radius = {"A=1,B" = 2}\n', "--radius A=1,B=2: labels with ',' or '=' cannot be told apart"),
    "together.toml": ("fraction = 0.2\n", "--fraction needs --mass-ratio or --diameter-ratio; options that are not"),
    "study.toml": ('study = "pressure"\n', "is of the study pressure, and this is thermalise"),
    "syntax.toml": ("n = \n", "--config syntax.toml is not TOML: "),
    "binary.toml": (b"\xff\xfe", "--config binary.toml is not TOML: 'utf-8' codec"),
    "torn.json": (json.dumps(SUMMARY)[:-9], "--config torn.json is not JSON: "),
    "list.json": ("[]", "list.json is no summary of a run with options"),
    "foreign.json": ('{"study": "cats"}', "foreign.json is no summary of a run with options"),
    "other.json": (
        json.dumps(SUMMARY | {"study": "pressure"}),
        "--config other.json is of the study pressure, and this is thermalise; that is hardspheres pressure --con",
    ),
    "deep.json": ("[" * 100_000, "--config deep.json is not JSON: "),
    "option.json": (json.dumps(SUMMARY | {"options": {"n": "x"}}), "option.json: --n x: a whole number is expect"),
    "absent.toml": (None, "--config absent.toml cannot be read: No such file"),
    "a-folder": (None, "summary.json cannot be read: No such file"),
}  # fmt: skip


@pytest.mark.parametrize("file", BAD)
def test_what_is_wrong_with_a_file_is_one_sentence(file, tmp_path, monkeypatch, capsys):
    content, sentence = BAD[file]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-folder").mkdir()
    if content is not None:
        (tmp_path / file).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = set(tmp_path.iterdir())
    code = run(monkeypatch, "thermalise", "--config", file)
    told = capsys.readouterr()
    assert code == 2 and told.out == "" and set(tmp_path.iterdir()) == before
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
    assert file in told.err


def test_another_version_is_remarked(tmp_path, monkeypatch, capsys):
    """Sibling: this version says nothing."""
    monkeypatch.setattr(Thermalisation, "conduct", lambda self, out, screen: ({}, True))
    for version, count in (("0.0.1", 1), (hs.__version__, 0)):
        (tmp_path / "summary.json").write_text(json.dumps(SUMMARY | {"version": version}))
        assert run(monkeypatch, "thermalise", "--config", tmp_path) == 0
        assert (
            capsys.readouterr().err.count(f"is of hardspheres 0.0.1, and this is {hs.__version__}") == count
        )


def labelled(folder):
    """A gas in a file whose labels have radii and masses by --radius and --mass."""
    places = [(x, y, z) for x in (1, 4) for y in (1, 4) for z in (1, 4)]
    rows = [f"{'AB'[k % 2]} {x} {y} {z}\n" for k, (x, y, z) in enumerate(places)]
    (folder / "mine.xyz").write_text("8\nby hand\n" + "".join(rows))
    sizes = ["--radius", "A=0.5,B=0.3", "--mass", "A=1,B=7", "--box", "6,6,6"]
    return [
        "thermalise",
        "--from",
        folder / "mine.xyz",
        *sizes,
        "--frames",
        0,
        "--collisions-per-particle",
        1,
    ]


REPEATED = {
    "of labels in a file": labelled,
    "a real gas": lambda folder: ["diffusion", "--gas", "Ar", "--n", 64, "--collisions-per-particle", 80],
}


@pytest.mark.parametrize("case", REPEATED)
def test_a_run_repeated_from_its_summary_gives_the_same_bytes(case, tmp_path, monkeypatch, capsys):
    """The digest, the command and every table; sibling: another seed beside the file."""
    name, *options = REPEATED[case](tmp_path)
    monkeypatch.setattr(study_named(name), "figures", lambda self, answers: {})
    monkeypatch.setattr(study_named(name), "replay", lambda self: None)
    first, again, other = (tmp_path / folder for folder in ("first", "again", "other"))
    few = ["--replicas", 4, "--seed", 5, "--workers", 1]
    assert run(monkeypatch, name, *options, *few, "--out", first) == 0
    assert run(monkeypatch, name, "--config", first / "summary.json", "--workers", 1, "--out", again) == 0
    told = ["--config", first, "--seed", 6, "--workers", 1, "--out", other]
    assert run(monkeypatch, name, *told) == 0
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (first, again, other)]
    for key in ("digest", "command", "options", "states"):
        assert summaries[0][key] == summaries[1][key]
        assert summaries[0][key] != summaries[2][key]
    for path in first.glob("*.csv"):
        assert path.read_bytes() == (again / path.name).read_bytes() != (other / path.name).read_bytes()


def test_every_summary_of_a_study_has_its_options():
    """What --config reads; a study of one's own has them, too."""
    for name in QUESTIONS:
        kind = study_named(name)
        if issubclass(kind, Study):
            hidden = {each.name for each in fields(kind) if not each.repr}
            hidden |= {each.name for each, its in options_of(kind) if not its.matters}
            assert set(kind().made()["options"]) == {each.name for each in fields(kind)} - hidden
            assert {"workers", "executor"} <= hidden
            assert ("threads" in hidden) == (name not in ("mixture", "expansion", "lorentz"))
