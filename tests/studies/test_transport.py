"""Transport coefficients end to end: physics in standard errors, with siblings that must fail, and refusals."""

import csv
import sys

import numpy as np
import pytest

from analysis import theory
from analysis.theory import Prediction
from studies.cli import main
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study
from studies.transport import Transport

SMALL = {"packing_fractions": (0.1,), "n": 64, "collisions_per_particle": 400.0, "seed": 5, "workers": 1}
NAMES = ["shear viscosity", "bulk viscosity", "heat conductivity"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "transport-5")
    summary, sound = conduct(Transport(**SMALL, replicas=6), out, Screen(json_output=True))
    return out, summary, sound


def test_all_coefficients_beside_enskog_and_in_both_ways(finished):
    """5 standard errors; the integrals are of the same samples and agree far better than that with the slopes."""
    out, summary, sound = finished
    assert sound
    (state,) = summary["states"]
    slopes, integrals = state["measured"][::2], state["measured"][1::2]
    assert [found["quantity"] for found in slopes] == NAMES
    for slope, integral in zip(slopes, integrals, strict=True):
        assert slope["expected"] > 0.0 and integral["quantity"] == f"{slope['quantity']}, Green-Kubo"
        assert abs(slope["value"] - integral["value"]) < 1.5 * slope["standard_error"]
    with (out.path / "integrals.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    first = rows[0]
    assert float(first["mean_free_times"]) == pytest.approx(0.25)
    bulk = float(theory.bulk_viscosity(0.1, 3).value)  # nearly all of it comes from single collisions
    assert float(first["bulk_viscosity"]) == pytest.approx(bulk, rel=0.2)
    shear = float(theory.shear_viscosity(0.1, 3).value)  # and only a part of this one does
    assert float(first["shear_viscosity"]) < 0.5 * shear


def test_a_wrong_theory_fails_the_check(tmp_path, monkeypatch, capsys):
    """Sibling: five times Enskog's viscosity is refused, in words and by the exit code."""
    right = theory.shear_viscosity

    def wrong(*args, **units):
        return Prediction(5 * right(*args, **units).value, right(*args, **units).uncertainty)

    monkeypatch.setattr(theory, "shear_viscosity", wrong)
    _, sound = conduct(Transport(**SMALL, replicas=6), OutputFolder(tmp_path / "out"), Screen())
    assert not sound
    assert "CHECK FAILED, shear viscosity is -" in capsys.readouterr().out


def test_a_mixture_has_mutual_diffusion():
    """Enskog's D_12, whose uncertainty it has, within 5 standard errors; viscosities without a theory."""
    study = Transport(**SMALL, replicas=4, mass_ratio=7.0, diameter_ratio=0.6)
    (replicas,), _ = run_study(study, Screen(json_output=True))
    answer = study.answer(study.gases()[0], replicas)
    assert [found.quantity for found in answer.numbers[::2]] == [*NAMES[:2], "mutual diffusion"]
    assert not answer.failures and np.isnan(answer["shear viscosity"].expected)
    assert abs(answer["mutual diffusion"].z) < 5.0
    assert "mutual diffusion" in " ".join(study.legend([answer]))
    assert len(study.figure([answer]).axes) == 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("eta", "name", "known", "uncertainty"),
    [
        (0.3 * np.pi / 6, "shear viscosity", 0.30, 0.02),
        (0.5 * np.pi / 6, "shear viscosity", 0.58, 0.06),
        (0.5 * np.pi / 6, "heat conductivity", 2.3, 0.2),
        (0.7 * np.pi / 6, "shear viscosity", 1.32, 0.03),
    ],
)
def test_literature(eta, name, known, uncertainty):
    """rho = 0.5: DynamO's tests (Lue 2005, doi 10.1063/1.1834498); others: from the box dependence of D.

    4 standard errors. Sibling: Enskog's viscosity at rho = 0.7, which is 25 % too small.
    """
    study = Transport(packing_fractions=(eta,), n=256, collisions_per_particle=2000.0, replicas=8, seed=7)
    (replicas,), _ = run_study(study, Screen(json_output=True))
    found = study.answer(study.gases()[0], replicas)[name].measured
    assert abs(found.z(known, uncertainty)) < 4.0 and found.standard_error < 0.06 * known


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--collisions-per-particle", "50"], "is no length for a slope; ask for at least 400"),
        (["--packing-fractions", "0.6"], "above 0.494, where hard spheres freeze"),
        (["--fraction", "0.5"], "--fraction needs --mass-ratio or --diameter-ratio"),
        (["--mass-ratio", "2", "--fraction", "0.001", "--n", "100"], "leaves none of one species"),
        (["--replicas", "2"], "gives no error bar"),
    ],
)
def test_bad_input_is_one_sentence(monkeypatch, capsys, tmp_path, options, words):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "transport", *options, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    said = " ".join(capsys.readouterr().err.split())
    assert words in said and "Traceback" not in said and not (tmp_path / "out").exists()
