"""The study of free paths end to end: physics in standard errors, with siblings that must fail, files and refusals."""

import csv
import json
import sys

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from studies.cli import main
from studies.fluid import Fluid
from studies.free_path import FreePaths, Runs, combine, free_path
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds


def states_of(study):
    """The states of a study, in this process."""
    task, seeds = Runs(study.collisions_per_particle), replica_seeds(study.seed, study.replicas)
    return [combine(fluid, [task((fluid, seed)) for seed in seeds]) for fluid in study.fluids]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "free-path-5")
    study = FreePaths((0.002, 0.05), Fluid(n=200), 50.0, replicas=2, seed=5, workers=1)
    summary, sound = free_path(study, out, Screen(json_output=True))
    return study, out, summary, sound


def test_all_files_are_there_and_agree(finished):
    """Five standard errors are exceeded once in 1e5 runs of fourteen numbers."""
    _, out, summary, sound = finished
    assert sound and summary["checks"]["passed"]
    names = {"summary.json", "free_path.csv", "free_path_curves.csv", "free_path.png"}
    assert {path.name for path in out.path.iterdir()} == names == set(summary["files"])
    stored = json.loads((out.path / "summary.json").read_text())
    assert stored["options"]["n"] == 200 and stored["seed"] == 5 and stored["version"] == hs.__version__
    with (out.path / "free_path.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    numbers = [(state["packing_fraction"], m) for state in stored["states"] for m in state["measured"]]
    assert len(rows) == len(numbers) == 14
    for row, (eta, measured) in zip(rows, numbers, strict=True):
        assert (float(row["packing_fraction"]), row["quantity"]) == (eta, measured["quantity"])
        assert (
            float(row["value"]) == measured["value"] and float(row["error"]) == measured["standard_error"] > 0
        )
        assert abs(measured["deviation"]) < 5
    for eta, state in zip((0.002, 0.05), stored["states"], strict=True):
        mean, *_ = state["measured"]
        assert mean["quantity"] == "mean free path" and mean["standard_error"] < 0.03 * mean["value"]
        assert mean["expected"] == pytest.approx(float(theory.finite_size_mean_free_path(eta, 3, 200).value))
        assert state["flights"] == 2 * 2 * 5_000
    with (out.path / "free_path_curves.csv").open() as handle:
        curves = list(csv.DictReader(handle))
    survival = [row for row in curves if row["curve"].startswith("part of free paths")]
    assert len(survival) == 14
    z = [(float(r["value"]) - float(r["expected"])) / float(r["error"]) for r in survival[:5]]
    assert np.abs(z).max() < 5


def test_workers_change_nothing(finished, tmp_path):
    study, _, summary, _ = finished
    other = FreePaths(study.packing_fractions, study.fluid, 50.0, replicas=2, seed=5, workers=2)
    again, _ = free_path(other, OutputFolder(tmp_path / "again"), Screen(json_output=True))
    assert again["states"] == summary["states"] and again["checks"] == summary["checks"]


def test_a_gas_that_is_not_maxwellian_is_seen(monkeypatch):
    """Sibling: beams that have not met yet do not collide as often as a gas does; and the first flights are told of."""
    made = Fluid.scene
    monkeypatch.setattr(Fluid, "scene", lambda self, seed: made(self, seed, "beams"))
    monkeypatch.setattr(Fluid, "settled", 0)
    (state,) = states_of(FreePaths((0.2,), Fluid(n=10_000), 0.2, replicas=2))
    assert any("mean free time" in failure for failure in state.failures)
    assert any("began before the simulation" in note for note in state.notes)


@pytest.mark.slow
def test_a_mixture(tmp_path, capsys):
    fluid = Fluid(n=400, mass_ratio=10.0, diameter_ratio=2.0, fraction=0.25)
    study = FreePaths((0.01,), fluid, 200.0, replicas=2, workers=1)
    summary, sound = free_path(study, OutputFolder(tmp_path / "out"), Screen())
    told = capsys.readouterr().out
    assert sound and len(summary["species"]) == 2 and "nu 1-2" in told and "\u2026" not in told


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--packing-fractions", "0.3,0.55"], "0.55 is above 0.494, where hard spheres freeze"),
        (
            ["--packing-fractions", "0.67", "--dim", "2"],
            "0.67 is above 0.66, where the theory of this study ends",
        ),
        (["--packing-fractions", "x"], "--packing-fraction x is not understood"),
        (["--collisions-per-particle", "0.4"], "no error bar for 4000 particles; ask for at least 0.5"),
        (["--collisions-per-particle", "nan"], "--collisions-per-particle nan gives no error bar"),
        (["--diameter-ratio", "-1"], "must be positive"),
        (["--mass-ratio", "2", "--fraction", "0"], "--fraction 0 of 4000 particles leaves one species"),
        (["--fraction", "0.2"], "--fraction needs --mass-ratio or --diameter-ratio"),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "free-path", *options, "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
