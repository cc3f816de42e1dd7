"""Self-diffusion end to end: physics in standard errors, with siblings that must fail, and refusals."""

import csv
import sys

import numpy as np
import pytest

from analysis import theory
from analysis.theory import Prediction
from studies.cli import main
from studies.diffusion import SelfDiffusion, Slope
from studies.fluid import Fluid
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study

SMALL = {"packing_fractions": (0.1,), "n": 64, "collisions_per_particle": 80.0, "seed": 5, "workers": 1}


def measured(**options):
    """The answer of a study of one gas."""
    study = SelfDiffusion(workers=1, **options)
    (replicas,), _ = run_study(study, Screen(json_output=True))
    return study.answer(study.gases()[0], replicas)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "diffusion-5")
    summary, sound = conduct(SelfDiffusion(**SMALL, replicas=6), out, Screen(json_output=True))
    return out, summary, sound


def test_velocities_decay_as_enskog_says(finished):
    """In the first mean free time: 5 standard errors, false once in 2000 runs; D of the infinite fluid adds up."""
    out, summary, sound = finished
    assert sound
    (state,) = summary["states"]
    box, correction, infinite = state["measured"]
    assert infinite["value"] == pytest.approx(box["value"] + correction["value"])
    both = box["standard_error"], correction["standard_error"]
    assert infinite["standard_error"] == pytest.approx(np.hypot(*both))
    assert state["window_in_mean_free_times"] == (20.0, 30.0) and state["notes"] == []
    assert infinite["expected"] == float(theory.enskog_diffusion(0.1, 3).value)
    with (out.path / "correlations.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    for k, entry in enumerate(rows[:4], 1):
        assert float(entry["mean_free_times"]) == pytest.approx(0.25 * k)
        gap = float(entry["velocity_autocorrelation"]) - float(entry["velocity_autocorrelation_theory"])
        assert abs(gap) < 5 * float(entry["velocity_autocorrelation_error"]) + 0.01
    assert len(rows) > 20


def test_a_wrong_theory_fails_the_check(finished, tmp_path, monkeypatch, capsys):
    """Sibling: three times Enskog's D is refused, in words and by the exit code."""
    right = theory.enskog_diffusion
    monkeypatch.setattr(
        theory,
        "enskog_diffusion",
        lambda *args, **units: Prediction(3 * right(*args, **units).value, right(*args, **units).uncertainty),
    )
    _, sound = conduct(SelfDiffusion(**SMALL, replicas=6), OutputFolder(tmp_path / "out"), Screen())
    assert not sound
    assert "CHECK FAILED, D is -" in capsys.readouterr().out


def test_discs_have_no_infinite_limit():
    answer = measured(n=64, dim=2, packing_fractions=(0.3,), collisions_per_particle=80.0, replicas=4, seed=2)
    assert [found.quantity for found in answer.numbers] == ["D of this box"] and not answer.failures
    assert np.isfinite(answer.curves["correlations"].columns["mean_square_displacement"].error).all()


def test_the_slope_is_taken_where_the_box_says():
    """4 to 6 times the time in which the slowest mode of the box decays, and a run that goes with it."""
    small, usual = Slope.of(Fluid(n=64, packing_fraction=0.1), None), Slope.of(Fluid(n=1000), None)
    assert small.window == (20.0, 30.0) and small.length == 200.0 and small.note is None
    begin, end = usual.window
    assert end == pytest.approx(usual.needed[1], rel=0.05) and begin == pytest.approx(2 / 3 * end, rel=0.05)
    assert (
        400 < usual.length == 3 * usual.needed[1] < 500 and usual.note is None
    )  # twice what it was: affordable
    large = Slope.of(Fluid(n=100_000), None)  # would take 10 000
    assert large.length == 2000.0 and large.window[1] == pytest.approx(1000.0, rel=0.01)
    assert (
        "from 2236 to 3354 mean free times" in large.note and "--collisions-per-particle 6708" in large.note
    )
    assert Slope.of(Fluid(n=1000, dim=2), None).window == (19.5, 39.0)
    for slope in (small, usual, large):
        moments = slope.moments
        assert moments[0] == 0 and moments[-1] * 0.25 <= slope.length + 0.25
        assert set(range(0, moments[-1], slope.stride)) <= set(moments)


def test_a_run_too_short_for_its_box_says_so(tmp_path, capsys):
    """1000 spheres at 0.2 for 80 mean free times: the rest of the tail is added, and told; once in 1e4 false."""
    study = SelfDiffusion(**SMALL | {"packing_fractions": (0.2,), "n": 1000}, replicas=4)
    summary, sound = conduct(study, OutputFolder(tmp_path / "out"), Screen())
    (state,) = summary["states"]
    assert sound and state["window_in_mean_free_times"][1] == 39.0
    (note,) = state["notes"]
    assert "too short for D of this box, the slope from 71 to 107 mean free times" in note
    assert note.split(";")[0] in " ".join(capsys.readouterr().out.split())
    _, correction, d = state["measured"]
    assert abs(d["value"] - 0.4043) < 4 * d["standard_error"]
    long = theory.periodic_diffusion_correction(0.2, (1000 * np.pi / 6 / 0.2) ** (1 / 3))
    assert correction["value"] > 1.1 * long.value  # sibling: that of a long run


@pytest.mark.slow
def test_the_correction_brings_boxes_together():
    """D at packing fraction 0.2 from N = 64, 250 and 2000: equal with the correction, p < 0.001 once in 300 seeds."""
    at = {"packing_fractions": (0.2,)}
    small = measured(n=64, collisions_per_particle=600.0, replicas=24, seed=6, **at)
    middle = measured(n=250, collisions_per_particle=600.0, replicas=16, seed=8, **at)
    large = measured(n=2000, replicas=8, seed=7, **at)
    for one, other in ((small, large), (middle, large), (small, middle)):
        here, there = one["D of this box"].measured, other["D of this box"].measured
        infinite, beside = one["D"].measured, other["D"].measured
        print(here, there, infinite, beside)
        assert infinite.p_value(beside.value, beside.standard_error) > 1e-3
        # sibling: without the correction the smaller box is too slow
        assert here.deviation(there.value, there.standard_error) < -3
    assert abs(large["D"].measured.deviation(0.4043, 0.0007)) < 3.5


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--packing-fractions", "0.1,0.5"], "0.5 is above 0.494, where hard spheres freeze"),
        (["--packing-fractions", "0.68", "--dim", "2"], "0.68 is above 0.66, where Enskog's theory ends"),
        (["--collisions-per-particle", "10"], "ask for at least 80"),
        (["--collisions-per-particle", "inf"], "--collisions-per-particle inf would never end"),
        (["--replicas", "2"], "--replicas 2 gives no error bar"),
        (["--n", "2", "--packing-fractions", "0.3"], "ask for more particles or a lower packing fraction"),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "diffusion", *options, "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
