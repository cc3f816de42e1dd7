"""The accuracy tables in miniature: rounds, interruptions, more rounds; and the committed tables."""

import json
import math
import shutil
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import studies
from analysis import theory
from analysis.statistics import Estimate
from studies.cli import main
from studies.fluid import Fluid
from studies.report import OutputFolder, Screen
from studies.running.shards import Shard
from studies.two_starts import canonical_pressure
from studies.validation import tables
from studies.validation.tables import (
    AccuracyTables,
    alarm,
    between_marks,
    failures_of,
    markdown,
    pooled,
    read_lines,
    stored,
)
from studies.validation.tables_measured import MEASURED, QUICK, Crystal, measure

FOLDER = Path(studies.__file__).parent
RESULTS, README = FOLDER / "results" / "tables", FOLDER / "README.md"
SMALL = {name: QUICK[name] for name in ("spheres", "melted", "a2")}


def same(lines):
    """What does not depend on the day and on the machine's speed."""
    return [replace(line, core_seconds=0.0, date="") for line in lines]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Conduct a miniature; returns its folder, its summary and whether it was sound."""

    def conduct(name="", resume=False, shard=None, **more):
        folder = tmp_path_factory.mktemp("tables") if not name else Path(name)
        out = OutputFolder(folder, resume=resume)
        out.shard = shard
        study = AccuracyTables(**{"quick": True, "workers": 1, "seed": 3} | more)
        return folder, *study.conduct(out, Screen(json_output=True))

    return conduct


@pytest.fixture(scope="module")
def two_rounds(run):
    return run(rounds=2)


def test_every_miniature_is_right(two_rounds):
    """One of 15 rows is beyond the alarm by chance in 1 % of seeds."""
    folder, summary, sound = two_rounds
    assert sound and summary["checks"] == {"passed": True, "failures": [], "alarm": alarm(15)}
    assert {path.name for path in folder.iterdir()} == {"rounds.csv", "tables.json", "summary.json"}
    assert summary["options"] == {"rounds": 2, "known": None, "quick": True, "seed": 3}  # for --config
    lines = read_lines(folder / "rounds.csv")
    assert {line.measurement for line in lines} == set(QUICK)
    rows, made = stored(folder)
    assert rows == pooled(lines, QUICK) and [asdict(row) for row in rows] == summary["rows"]
    assert {row.measurement: row.rounds for row in rows}["spheres"] == 2 and made["study"] == summary["study"]
    assert all(row.collisions > 100 and row.core_seconds > 0.0 for row in rows)


def test_interrupted_or_extended_it_gives_the_same(run, tmp_path, monkeypatch):
    """Sibling: a round of another seed is another number."""
    monkeypatch.setattr(tables, "QUICK", SMALL)
    whole, _, _ = run(rounds=2)
    first, _, _ = run(rounds=1)
    more, _, _ = run(rounds=2, known=str(first / "rounds.csv"))
    lines = same(read_lines(whole / "rounds.csv"))
    assert same(read_lines(more / "rounds.csv")) == lines
    assert read_lines(more / "rounds.csv")[:6] == read_lines(first / "rounds.csv")  # with their day and cost
    fewer, _, _ = run(rounds=1, known=str(whole / "rounds.csv"))  # nothing known is lost
    assert stored(fewer)[0] == stored(whole)[0]

    def stopped(item, *rest):
        if item == ("spheres", 1):
            raise KeyboardInterrupt
        return measure(item, *rest)

    monkeypatch.setattr(tables, "measure", stopped)
    with pytest.raises(KeyboardInterrupt):
        run(str(tmp_path), rounds=2)
    early = stored(tmp_path)[0]  # the tables of the first round are there, whole
    assert [row.quantity for row in early] == [row.quantity for row in stored(first)[0]]
    monkeypatch.setattr(tables, "measure", measure)
    run(str(tmp_path), resume=True, rounds=2)
    assert same(read_lines(tmp_path / "rounds.csv")) == lines
    other = measure(("spheres", 0), QUICK, 4)[0][0]
    assert other.measured.value != lines[0].value


def test_shards_are_gathered_to_the_same(run, tmp_path, monkeypatch):
    """The second of two began first; the gathering runs nothing. Sibling: it runs what no shard has."""
    monkeypatch.setattr(tables, "QUICK", SMALL)
    lines = same(read_lines(run(rounds=2)[0] / "rounds.csv"))
    assert run(str(tmp_path), shard=Shard(2, 2), rounds=2)[1:] == ({}, True)
    assert not (tmp_path / "rounds.csv").exists()
    shutil.copytree(tmp_path, tmp_path / "half")
    run(str(tmp_path), shard=Shard(1, 2), rounds=2)
    with monkeypatch.context() as patch:
        patch.setattr(tables, "measure", None)
        run(str(tmp_path), resume=True, rounds=2)
        with pytest.raises(TypeError):
            run(str(tmp_path / "half"), resume=True, rounds=2)
    assert same(read_lines(tmp_path / "rounds.csv")) == lines


def test_more_rounds_are_more_precise():
    """24 rounds of noise: mean and error; one drifting round makes the error that of the spread."""
    noise = np.random.default_rng(1).normal(2.0, 0.1, 24)
    line = tables.Line("spheres", 0, "Z", 2.0, 0.1, 30.0, 2.0, 0.0, "", 10, 1.0, "2026-01-01")
    lines = [replace(line, round=k, value=float(x)) for k, x in enumerate(noise)]
    (row,) = pooled(lines[::-1], QUICK)
    assert row.value == pytest.approx(noise.mean()) and row.rounds == 24 and row.collisions == 240
    assert row.standard_error == pytest.approx(0.1 / math.sqrt(24)) and abs(row.check.z) < 4.0
    (spread,) = pooled([*lines[:-1], replace(lines[-1], value=5.0)], QUICK)
    assert spread.standard_error > 0.1


# What is measured.


@pytest.mark.parametrize("eta", [0.60, 0.69])
def test_the_crystal_fits_its_box(eta):
    scene = Crystal(packing_fraction=eta).scene(np.random.SeedSequence(1))
    assert scene.packing_fraction == pytest.approx(eta, rel=1e-12) and scene.n == 870
    assert scene.box[1] / scene.box[0] == pytest.approx(30 * math.sqrt(3) / 2 / 29, rel=1e-12)
    apart = scene.positions[:, None] - scene.positions
    apart -= scene.box * np.rint(apart / scene.box)
    distance = np.sqrt((apart**2).sum(axis=-1)) + 9.0 * np.eye(870)
    spacing = math.sqrt(math.pi / (2 * math.sqrt(3) * eta))
    assert distance.min() == pytest.approx(spacing, rel=1e-12)
    assert ((distance < 1.001 * spacing).sum(axis=1) == 6).all()


def test_the_pressure_of_discs_is_canonical():
    """As Monte Carlo has it. Sibling: Z at fixed energy is another number at N = 100."""
    fluid = Fluid(100, 2, 0.5)
    fixed = float(theory.finite_size_compressibility(0.5, 2, 100).value)
    canonical = float(theory.finite_size_compressibility(0.5, 2, 100, "canonical").value)
    per_z = 4 * 0.5 / math.pi
    found = canonical_pressure(Estimate(fixed, 1e-3), fluid.packing_fraction, fluid.n)
    assert found.value == pytest.approx(per_z * canonical, rel=1e-12)
    assert found.standard_error == pytest.approx(per_z * 0.99e-3)
    assert abs(found.value / (per_z * fixed) - 1) > 5e-3


def test_a_round_is_named_by_its_seed():
    assert measure(("spheres", 0), QUICK, 1) == measure(("spheres", 0), QUICK, 1)
    assert measure(("spheres", 0), QUICK, 1) != measure(("spheres", 1), QUICK, 1)


# The committed tables.


def test_the_committed_tables():
    """The readme shows what is stored, that is the mean of all rounds, and no row is wrong."""
    rows, made = stored(RESULTS)
    assert rows == pooled(read_lines(RESULTS / "rounds.csv"), MEASURED)
    assert {row.measurement for row in rows} == set(MEASURED)
    assert failures_of(rows) == []
    text = README.read_text(encoding="utf-8")
    assert between_marks(text) == markdown(rows, made)
    assert between_marks(between_marks(text, "new\n")) == "new\n"


def test_a_broken_row_fails():
    """Sibling of the above: a value six errors off, and a readme with another digit."""
    rows, made = stored(RESULTS)
    for k in (0, len(rows) - 1):
        off = 6.0 * math.hypot(rows[k].standard_error, rows[k].uncertainty)
        freedom = math.inf  # few of them allow more than six
        wrong = replace(rows[k], value=rows[k].expected + off, degrees_of_freedom=freedom)
        changed = [*rows[:k], wrong, *rows[k + 1 :]]
        assert [rows[k].quantity in failure for failure in failures_of(changed)] == [True]
        assert markdown(changed, made) != between_marks(README.read_text(encoding="utf-8"))
    assert failures_of([replace(rows[0], standard_error=math.nan)])
    with pytest.raises(ValueError, match="no <!--"):
        between_marks("a text without marks")


def test_references_are_those_of_today():
    """Pressures of spheres: theory for so many particles. Discs: Li et al. 2022, table of square boxes."""
    rows = {row.measurement: row for row in stored(RESULTS)[0]}
    for eta in (0.1, 0.3, 0.45):
        z = theory.finite_size_compressibility(eta, 3, 4000)
        row = rows[f"spheres, {eta:g}"]
        assert (row.expected, row.uncertainty) == pytest.approx((float(z.value), float(z.uncertainty)))
    assert (rows["discs, 0.67"].expected, rows["discs, 0.67"].uncertainty) == (7.986779, 25e-6)


ROUNDS_TWICE = (
    "measurement,round,quantity,value,standard_error,degrees_of_freedom,expected,uncertainty,reference,"
    "collisions,core_seconds,date\n"
    + "two discs,0,pair rate,0.5,0.1,9.0,0.5,0.0,exact,10,1.0,2026-01-01\n"
    * 2
)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--rounds", "0"], "--rounds 0 is out of range; ask for at least 1"),
        (["--known", "nowhere.csv"], "--known nowhere.csv cannot be read: No such file or directory"),
        (["--known", "other.csv"], "--known other.csv is no rounds.csv of this version"),
        (["--known", "twice.csv"], "--known twice.csv has 'pair rate' of round 0 of 'two discs' twice"),
        (["--known", "big.csv", "--quick"], "--known big.csv has rounds of 'Lyapunov, 0.01', which are not"),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("other.csv").write_text("a,b\n1,2\n")
    Path("big.csv").write_bytes((RESULTS / "rounds.csv").read_bytes())
    Path("twice.csv").write_text(ROUNDS_TWICE)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "accuracy-tables", *options, "--out", "out"])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not Path("out").exists()
    assert told.err.startswith(f"error: {sentence}") and told.err.count("\n") == 1


@pytest.mark.long
def test_a_whole_round(tmp_path):
    """Some minutes; one of 46 rows is beyond the alarm by chance in 1 % of seeds."""
    study = AccuracyTables(rounds=1, seed=2)
    summary, sound = study.conduct(OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert sound, summary["checks"]["failures"]
    assert {row["measurement"] for row in summary["rows"]} == set(MEASURED)


def test_the_command_prints_its_tables(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tables, "QUICK", {"spheres": QUICK["spheres"]})
    options = ["--quick", "--rounds", "1", "--workers", "1", "--json", "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", ["hardspheres", "accuracy-tables", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 0 and json.loads(told.out)["checks"]["passed"]
    assert "Z, virial" in told.err and "Kolafa" in told.err
