"""Equations of state of spheres, discs and mixtures together, to 1e-3 (slow) and 1e-4 (long)."""

import csv
import json
import math
import sys
from pathlib import Path

import pytest

import studies
from analysis import theory
from analysis.correlation_times import variance_growth, virial_block_length
from analysis.pressure import Pressure
from studies.cli import main
from studies.fluid import Fluid
from studies.pressure import SUITE, EquationOfState
from studies.report import OutputFolder, Screen
from studies.study import conduct

RESULTS = Path(studies.__file__).parent / "results" / "equation_of_state"


WAYS = ("Z from the virial", "Z from the rate")
SMALL = (  # the same kinds of fluid, few and small, that cost no kernels of their own
    Fluid(n=108, packing_fraction=0.01),
    Fluid(n=108, packing_fraction=0.2),
    Fluid(n=100, dim=2, packing_fraction=0.2),
    Fluid(n=108, packing_fraction=0.3, diameter_ratio=1.25, mass_ratio=10.0),
)


def test_a_small_suite(tmp_path, monkeypatch, capsys):
    """Five standard errors of twelve numbers: false once in 1e5 seeds."""
    monkeypatch.setattr("studies.pressure.SUITE", SMALL)
    study = EquationOfState(suite=True, until_error=0.02, workers=1)
    summary, sound = conduct(study, OutputFolder(tmp_path / "out"), Screen())
    assert sound
    names = {"summary.json", "report.html", "equation_of_state.csv", "equation_of_state.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names == set(summary["files"])
    stored = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert stored["machine"]["processor"] and len(stored["date"]) == 10
    assert [state["gas"] for state in stored["states"]] == [str(gas) for gas in SMALL]
    told = capsys.readouterr().out  # a table for each kind
    assert told.count("2 x 108 hard spheres, periodic box, 2 packing fractions") == 1
    assert told.count("2 x 100 hard discs, periodic box, packing fraction 0.2") == 1
    assert "Z: 0.0" in told and "at most, asked for 0.02" in told
    with (tmp_path / "out" / "equation_of_state.csv").open() as handle:
        rows = [row for row in csv.DictReader(handle) if row["quantity"] in (*WAYS, "virial - rate")]
    assert [row["gas"] for row in rows] == [str(gas) for gas in SMALL for _ in range(3)]
    for row in rows:
        assert abs(float(row["z"])) < 5
        assert row["quantity"] not in WAYS or float(row["error"]) / float(row["value"]) < 0.03


def test_a_failure_names_the_fluid(tmp_path, monkeypatch, capsys):
    """Sibling of a suite that passes: discs whose collisions pass on only half of their momentum."""
    monkeypatch.setattr("studies.pressure.SUITE", SMALL)
    right = Pressure._from_virial

    def wrong(self, means):
        return right(self, means) * (0.5 if self.scene.dim == 2 else 1.0)

    monkeypatch.setattr(Pressure, "_from_virial", wrong)
    study = EquationOfState(suite=True, until_error=0.1, workers=1)
    summary, sound = conduct(study, OutputFolder(tmp_path / "out"), Screen())
    assert not sound
    for failure in summary["checks"]["failures"]:
        assert failure.startswith("100 hard discs, periodic box, packing fraction 0.2: ")
    assert "CHECK FAILED, 100 hard discs" in capsys.readouterr().out


def precise(precision, tmp_path, alarm):
    """Run the whole suite and return its states; every number within the precision and beside its theory."""
    study = EquationOfState(suite=True, seed=7).to_precision(precision)
    summary, sound = conduct(study, OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert sound, summary["checks"]["failures"]
    states = [{each["quantity"]: each for each in state["measured"]} for state in summary["states"]]
    for state in states:
        for name in WAYS:
            assert state[name]["standard_error"] < 1.25 * precision * state[name]["value"], state
        assert all(abs(state[name]["z"]) < alarm for name in (*WAYS, "virial - rate")), state
    return states


@pytest.mark.slow
def test_equations_of_state_to_one_part_in_a_thousand(tmp_path):
    """51 numbers of some 40 degrees of freedom: one beyond 4.5 standard errors once in 350 seeds."""
    states = precise(1e-3, tmp_path, 4.5)
    assert len(states) == 17
    # siblings: the formulas that everyone knows, a packing fraction 0.5 % off, and one species for a mixture
    dense, disc, mixed = (states[k][way] for k, way in ((8, WAYS[1]), (12, WAYS[1]), (15, WAYS[0])))
    other = float(theory.compressibility_factor(0.49 * 1.005, 3).value)
    assert abs(dense["value"] - other) > 5 * dense["standard_error"]
    assert float(theory.henderson(0.55)) - disc["value"] > 5 * disc["standard_error"]
    assert float(theory.compressibility_factor(0.3, 3).value) - mixed["value"] > 50 * mixed["standard_error"]


@pytest.mark.long
def test_equations_of_state_to_one_part_in_ten_thousand(tmp_path):
    """`hardspheres pressure --suite --until-error 1e-4 --seed 7`."""
    precise(1e-4, tmp_path, 4.5)


def test_the_committed_figures_agree_with_theory():
    """What the long command left: seventeen states, with the precision that they claim and nothing far from theory.

    Its files are of 22 November 2026 and have the form of that day.
    """
    summary = json.loads((RESULTS / "summary.json").read_text())
    assert summary["checks"]["passed"] and summary["date"] and summary["machine"]["processor"]
    assert (summary["seed"], summary["options"]["precision"]) == (7, 1e-4)
    states = [state for group in summary["states"].values() for state in group]
    assert [(state["fluid"], state["packing_fraction"]) for state in states] == [
        (str(fluid), fluid.packing_fraction) for fluid in SUITE
    ]
    for state in states:
        assert set(state["measured"]) == {"virial", "rate"}
        for measured in state["measured"].values():
            assert (
                measured["standard_error"] < 1.25e-4 * measured["value"] and abs(measured["deviation"]) < 4.5
            )
        assert abs(state["virial_minus_rate"]["deviation"]) < 4.5, state
    with (RESULTS / "equation_of_state.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 17
    # sibling: theory of today, against figures of states 0.1 % denser
    for row in rows[:9]:
        eta = float(row["packing_fraction"])
        expected = [float(theory.finite_size_compressibility(e, 3, 4000).value) for e in (eta, 1.001 * eta)]
        error = math.hypot(float(row["z_rate_error"]), float(row["z_theory_error"]))
        z = [(float(row["z_rate"]) - value) / error for value in expected]
        assert abs(z[0]) < 4.5 and (abs(z[1]) > 4.5 or eta < 0.15)


def test_a_run_is_as_long_as_its_precision_and_its_memory_ask():
    suite, usual = EquationOfState(suite=True), EquationOfState()
    thin, dense = Fluid(packing_fraction=0.01), Fluid(packing_fraction=0.49)
    assert suite.length(thin) == suite.to_precision(1e-3).length(thin) == 40.0
    assert suite.length(dense) == pytest.approx(3000.0) == pytest.approx(10 * virial_block_length(0.49, 3))
    collisions = 2 * 4000 / 2 * suite.to_precision(1e-4).length(dense)
    assert collisions == pytest.approx(variance_growth(0.49, 3) * (1.25e4 * (1 - 1 / 12.17)) ** 2, rel=0.01)
    assert usual.to_precision(1e-3) is None  # by more replicas
    assert usual.length(thin) == 300.0 and usual.length(dense) == pytest.approx(3000.0)
    for suite in (False, True):
        assert EquationOfState(suite=suite, collisions_per_particle=50.0).length(dense) == 50.0
    assert virial_block_length(0.1, 3) == 0.0 and virial_block_length(0.69, 2) == pytest.approx(2000)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--suite", "--n", "500"], "--suite has gases of its own; leave out the options that describe one"),
        (["--suite", "--packing-fraction", "0.2"], "--suite has gases of its own"),
        (["--suite", "--boundary", "wall"], "--suite has gases of its own"),
        (["--suite", "--mass-ratio", "2", "--fraction", "0.4"], "--suite has gases of its own"),
        (["--suite", "--until-error", "0.5"], "--until-error 0.5; expected 1e-6 to 0.1"),
        (
            ["--suite", "--until-error", "1e-3", "--collisions-per-particle", "50"],
            "both say how long; give one",
        ),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "pressure", *options, "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
