"""Equations of state of spheres, discs and mixtures together, to 1e-3 (slow) and 1e-4 (long)."""

import csv
import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import studies
from analysis import theory
from analysis.correlation_times import variance_growth, virial_block_length
from studies.cli import main
from studies.fluid import Fluid
from studies.pressure import EquationOfState
from studies.pressure_suite import GROUPS, Suite, run_suite
from studies.report import OutputFolder, Screen

RESULTS = Path(studies.__file__).parent / "results" / "equation_of_state"


def small():
    """The same kinds of fluid, few and small, that cost no kernels of their own."""
    return Suite(
        EquationOfState(precision=0.02, replicas=2, workers=1),
        {
            "spheres": (Fluid(n=108, packing_fraction=0.01), Fluid(n=108, packing_fraction=0.2)),
            "discs": (Fluid(n=100, dim=2, packing_fraction=0.2),),
            "mixtures": (Fluid(n=108, packing_fraction=0.3, diameter_ratio=1.25, mass_ratio=10.0),),
        },
    )


def test_a_small_suite(tmp_path):
    """Five standard errors of twelve numbers: false once in 1e5 seeds."""
    summary, sound = run_suite(small(), OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert sound
    names = {"summary.json", "equation_of_state.csv", "equation_of_state.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names == set(summary["files"])
    stored = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert stored["machine"]["processor"] and len(stored["date"]) == 10
    assert [len(group) for group in stored["states"].values()] == [2, 1, 1]
    with (tmp_path / "out" / "equation_of_state.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["dim"] for row in rows] == ["3", "3", "2", "3"]
    assert float(rows[3]["diameter_ratio"]) == 1.25
    for row in rows:
        assert float(row["z_virial_error"]) / float(row["z_virial"]) < 0.03
        for name in ("virial", "rate", "virial_minus_rate"):
            assert abs(float(row[f"z_{name}_deviation"])) < 5


def precise(precision, tmp_path, alarm):
    """Run the whole suite and return its states; every number within the precision and beside its theory."""
    suite = Suite(EquationOfState(precision=precision, seed=7))
    summary, sound = run_suite(suite, OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert sound, summary["checks"]["failures"]
    for group in summary["states"].values():
        right(group, precision, alarm)
    return summary["states"]


def right(group, precision, alarm):
    """Virial and rate to 1.25 times the precision, at their theory and at each other."""
    for state in group:
        assert set(state["measured"]) == {"virial", "rate"}
        for measured in state["measured"].values():
            assert measured["standard_error"] < 1.25 * precision * measured["value"], state
            assert abs(measured["deviation"]) < alarm, state
        assert abs(state["virial_minus_rate"]["deviation"]) < alarm, state


@pytest.mark.slow
def test_equations_of_state_to_one_part_in_a_thousand(tmp_path):
    """51 numbers of some 40 degrees of freedom: one beyond 4.5 standard errors once in 350 seeds."""
    states = precise(1e-3, tmp_path, 4.5)
    assert [len(states[name]) for name in ("spheres", "discs", "mixtures")] == [9, 5, 3]
    # siblings: the formulas that everyone knows, a packing fraction 0.5 % off, and one species for a mixture
    spheres, discs, mixtures = (states[name] for name in ("spheres", "discs", "mixtures"))
    dense = spheres[-1]["measured"]["rate"]
    other = float(theory.compressibility_factor(0.49 * 1.005, 3).value)
    assert abs(dense["value"] - other) > 5 * dense["standard_error"]
    disc = discs[3]["measured"]["rate"]
    assert float(theory.henderson(0.55)) - disc["value"] > 5 * disc["standard_error"]
    mixed = mixtures[1]["measured"]["virial"]
    assert float(theory.compressibility_factor(0.3, 3).value) - mixed["value"] > 50 * mixed["standard_error"]


@pytest.mark.long
def test_equations_of_state_to_one_part_in_ten_thousand(tmp_path):
    """`hardspheres pressure --suite --until-error 1e-4 --seed 7`."""
    precise(1e-4, tmp_path, 4.5)


def test_the_committed_figures_agree_with_theory():
    """What the long command left: seventeen states, with the precision that they claim and nothing far from theory."""
    summary = json.loads((RESULTS / "summary.json").read_text())
    assert summary["checks"]["passed"] and summary["date"] and summary["machine"]["processor"]
    assert (summary["seed"], summary["options"]["precision"]) == (7, 1e-4)
    asked = {
        name: [(str(fluid), fluid.packing_fraction) for fluid in group] for name, group in GROUPS.items()
    }
    for name, group in summary["states"].items():
        assert [(state["fluid"], state["packing_fraction"]) for state in group] == asked.pop(name)
        right(group, 1e-4, 4.5)
    assert not asked
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
    study = EquationOfState(precision=1e-3)
    thin, dense = Fluid(packing_fraction=0.01), Fluid(packing_fraction=0.49)
    assert study.length(thin) == 40.0
    assert study.length(dense) == pytest.approx(3000.0) == pytest.approx(10 * virial_block_length(0.49, 3))
    collisions = 2 * 4000 / 2 * replace(study, precision=1e-4).length(dense)
    assert collisions == pytest.approx(variance_growth(0.49, 3) * (1.25e4 * (1 - 1 / 12.17)) ** 2, rel=0.01)
    assert EquationOfState().length(thin) == 300.0 and EquationOfState().length(dense) == pytest.approx(
        3000.0
    )
    assert EquationOfState(collisions_per_particle=50.0).length(dense) == 50.0
    assert virial_block_length(0.1, 3) == 0.0 and virial_block_length(0.69, 2) == pytest.approx(2000)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--suite", "--n", "500"], "--suite has gases of its own"),
        (["--suite", "--until-error", "0"], "--until-error 0; expected 1e-6 to 0.1"),
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
