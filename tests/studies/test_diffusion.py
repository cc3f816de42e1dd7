"""Self-diffusion end to end: physics in standard errors, with siblings that must fail, files and refusals."""

import csv
import json
import sys

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.theory import Prediction
from studies.cli import main
from studies.diffusion import SelfDiffusion, Slope, Walks, combine, self_diffusion
from studies.fluid import Fluid
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds, run_replicas


def measured(fluid, collisions_per_particle, replicas, seed, workers=1):
    """The state of one fluid."""
    items = [(fluid, one) for one in replica_seeds(seed, replicas)]
    walks = run_replicas(Walks(collisions_per_particle), items, workers=workers)
    return combine(fluid, walks, collisions_per_particle)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "diffusion-5")
    study = SelfDiffusion((0.1,), Fluid(n=64), 80.0, replicas=6, seed=5, workers=1)
    summary, sound = self_diffusion(study, out, Screen(json_output=True))
    return study, out, summary, sound


def test_all_files_are_there_and_agree(finished):
    """Velocities decay as Enskog says in the first mean free time: 5 standard errors, false once in 2000 runs."""
    _, out, summary, sound = finished
    assert sound and summary["checks"]["passed"]
    names = {"summary.json", "diffusion.csv", "correlations.csv", "diffusion.png"}
    assert {path.name for path in out.path.iterdir()} == names == set(summary["files"])
    stored = json.loads((out.path / "summary.json").read_text())
    assert stored["options"]["n"] == 64 and stored["version"] == hs.__version__
    (state,) = stored["states"]
    with (out.path / "diffusion.csv").open() as handle:
        (row,) = csv.DictReader(handle)
    assert float(row["d_box"]) == state["d_box"]["value"]
    assert float(row["d_infinite"]) == state["d_infinite"]["value"]
    assert float(row["d_infinite"]) == pytest.approx(float(row["d_box"]) + float(row["correction"]))
    both = float(row["d_box_error"]), float(row["correction_error"])
    assert float(row["d_infinite_error"]) == pytest.approx(np.hypot(*both))
    assert state["window_in_mean_free_times"] == [20.0, 30.0] and state["notes"] == []
    assert float(row["d_enskog"]) == float(theory.enskog_diffusion(0.1, 3).value)
    with (out.path / "correlations.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    for k, entry in enumerate(rows[:4], 1):
        assert float(entry["mean_free_times"]) == pytest.approx(0.25 * k)
        gap = float(entry["velocity_autocorrelation"]) - float(entry["velocity_autocorrelation_enskog"])
        assert abs(gap) < 5 * float(entry["velocity_autocorrelation_error"]) + 0.01
    assert len(rows) > 20


def test_a_wrong_theory_fails_the_check(finished, tmp_path, monkeypatch, capsys):
    """Sibling: three times Enskog's D is refused, in words and by the exit code."""
    right = theory.enskog_diffusion
    monkeypatch.setattr(
        theory,
        "enskog_diffusion",
        lambda *args: Prediction(3 * right(*args).value, right(*args).uncertainty),
    )
    study = SelfDiffusion((0.1,), Fluid(n=64), 80.0, replicas=6, seed=5, workers=1)
    _, sound = self_diffusion(study, OutputFolder(tmp_path / "out"), Screen())
    assert not sound
    assert "CHECK FAILED, packing fraction 0.1: D is -" in capsys.readouterr().out


def test_discs_have_no_infinite_limit():
    state = measured(Fluid(n=64, dim=2, packing_fraction=0.3), 80.0, 4, seed=2)
    assert state.infinite is None and state.correction is None and state.failures == ()
    assert np.isfinite(state.mean_square_displacement_error).all()


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
    study = SelfDiffusion((0.2,), Fluid(n=1000), 80.0, replicas=4, seed=5, workers=1)
    summary, sound = self_diffusion(study, OutputFolder(tmp_path / "out"), Screen())
    (state,) = summary["states"]
    assert sound and state["window_in_mean_free_times"][1] == 39.0
    (note,) = state["notes"]
    assert "too short for D of this box, the slope from 71 to 107 mean free times" in note
    assert note.split(";")[0] in " ".join(capsys.readouterr().out.split())
    d = state["d_infinite"]
    assert abs(d["value"] - 0.4043) < 4 * d["standard_error"]
    long = theory.periodic_diffusion_correction(0.2, (1000 * np.pi / 6 / 0.2) ** (1 / 3))
    assert state["correction"]["value"] > 1.1 * long.value  # sibling: that of a long run


@pytest.mark.slow
def test_the_correction_brings_boxes_together():
    """D at packing fraction 0.2 from N = 64, 250 and 2000: equal with the correction, p < 0.001 once in 300 seeds."""
    small = measured(Fluid(n=64, packing_fraction=0.2), 600.0, 24, seed=6)
    middle = measured(Fluid(n=250, packing_fraction=0.2), 600.0, 16, seed=8)
    large = measured(Fluid(n=2000, packing_fraction=0.2), None, 8, seed=7)
    for one, other in ((small, large), (middle, large), (small, middle)):
        print(one.here, other.here, one.infinite, other.infinite)
        assert one.infinite.p_value(other.infinite.value, other.infinite.standard_error) > 1e-3
        # sibling: without the correction the smaller box is too slow
        assert one.here.deviation(other.here.value, other.here.standard_error) < -3
    assert abs(large.infinite.deviation(0.4043, 0.0007)) < 3.5


@pytest.mark.slow
def test_workers_change_nothing(finished, tmp_path):
    study, _, summary, _ = finished
    other = SelfDiffusion((0.1,), study.fluid, 80.0, replicas=6, seed=5, workers=2)
    again, _ = self_diffusion(other, OutputFolder(tmp_path / "again"), Screen(json_output=True))
    assert again["states"] == summary["states"] and again["checks"] == summary["checks"]


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
