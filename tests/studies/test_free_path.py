"""The study of free paths: physics in standard errors, with siblings that must fail, and refusals."""

import sys

import numpy as np
import pytest

from analysis import theory
from studies.cli import main
from studies.fluid import Fluid
from studies.free_path import FreePaths
from studies.report import Screen
from studies.study import run_study


def answers_of(**options):
    """The answers of a study, without its files."""
    study = FreePaths(workers=1, **options)
    replicas, _ = run_study(study, Screen(json_output=True))
    return [study.answer(gas, own) for gas, own in zip(study.gases(), replicas, strict=True)]


@pytest.fixture(scope="module")
def answers():
    return answers_of(packing_fractions=(0.002, 0.05), n=200, collisions_per_particle=50.0, seed=5)


def test_means_moments_and_survival_agree_with_theory(answers):
    """Five standard errors are exceeded once in 1e5 runs of fourteen numbers and ten points."""
    for eta, answer in zip((0.002, 0.05), answers, strict=True):
        assert answer.failures == [] and answer.details["flights"] == 2 * 2 * 5_000
        assert answer.main == ["mean free path"] and len(answer.numbers) == 7
        assert all(abs(found.z) < 5 for found in answer.numbers)
        mean = answer["mean free path"]
        assert mean.measured.standard_error < 0.03 * mean.measured.value
        assert mean.expected == pytest.approx(float(theory.finite_size_mean_free_path(eta, 3, 200).value))
        for of in ("path", "time"):
            column = answer.curves[f"free_{of}_survival"].columns["survival"]
            doubt = (
                eta * column.theory
            )  # neighbours are met again, as in the moments: 3 standard errors at 0.05
            z = (column.value - column.theory) / np.hypot(column.error, doubt)
            assert len(z) == 7 and np.abs(z[:5]).max() < 5
        speeds = answer.curves["free_path_by_speed"]
        fast, slow = (np.argmin(np.abs(speeds.axes["thermal_speeds"] - v)) for v in (2.4, 0.6))
        path = speeds.columns["free_path"].value
        assert path[fast] > 1.1 and path[slow] < 0.7  # who is fast flies far: 1.2 and 0.5 in theory


def test_a_gas_that_is_not_maxwellian_is_seen(monkeypatch):
    """Sibling: beams that have not met yet do not collide as often as a gas does; the first flights are told of."""
    made = Fluid.scene
    monkeypatch.setattr(Fluid, "scene", lambda self, seed: made(self, seed, "beams"))
    monkeypatch.setattr(Fluid, "settled", 0)
    (answer,) = answers_of(packing_fractions=(0.2,), n=10_000, collisions_per_particle=0.2)
    assert any("mean free time" in failure for failure in answer.failures)
    assert any("began before the simulation" in note for note in answer.notes)


@pytest.mark.slow
def test_a_mixture():
    mixed = {"n": 400, "mass_ratio": 10.0, "diameter_ratio": 2.0, "fraction": 0.25}
    (answer,) = answers_of(packing_fractions=(0.01,), collisions_per_particle=200.0, **mixed)
    assert answer.failures == [] and len(answer.details["species"]) == 2
    assert answer.main == ["mean free path of species 1", "mean free path of species 2"]
    assert "nu 1-2" in [found.quantity for found in answer.numbers]
    species = answer.curves["free_path_survival"].axes["species"]
    assert species.tolist() == [1] * 7 + [2] * 7


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
