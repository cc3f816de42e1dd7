"""Speed against error end to end: the engine is right, time steps are seen to be wrong, and a wrong engine would be seen."""

import csv
import json
import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from studies.cli import main
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds
from studies.running.ownership import REPORT, SUMMARY
from studies.validation import accuracy as study_module
from studies.validation import accuracy_few, accuracy_long
from studies.validation.accuracy import Accuracy, answers, compare
from studies.validation.accuracy_answer import Curve, rounding_floor
from studies.validation.accuracy_few import ENGINE, lyapunov_exponent
from studies.validation.time_stepping import BACK_UP, BOUNCE, Stepper

from ..pages import masked

SMALL = Accuracy(
    packing_fractions=(0.3,),
    n=500,
    seed=2,
    scenes=2,
    followed=1,
    seconds=0.05,
    few_steps=(0.1, 1e-2, 1e-4),
    long_steps=(0.1, 0.03),
)


@pytest.fixture(scope="module")
def state():
    return compare(SMALL)[0]


@pytest.fixture(scope="module")
def finished(state, tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "accuracy-2")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_module, "compare", lambda *_: [state])
        summary, sound = SMALL.conduct(out, Screen(json_output=True))
    return out, summary, sound


def test_the_engine_is_right_and_all_files_are_there(finished):
    """Five standard errors are exceeded once in 8e5 runs of two numbers."""
    out, summary, sound = finished
    assert sound and summary["checks"]["failures"] == []
    assert {path.name for path in out.path.iterdir()} == {*Accuracy.files, REPORT, SUMMARY}
    stored = json.loads((out.path / "summary.json").read_text())
    assert len(stored["answers"]) == 6 and all("packing fraction 0.3, " in text for text in stored["answers"])
    with (out.path / "accuracy.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["method"] for row in rows[:2]] == ["engine", "all pairs, float64"]
    assert len(rows) == 2 + 2 * 4  # engine, reference, and each time step of either run
    engine = rows[0]
    assert float(engine["trajectory_error_worst"]) < 1e-13 and float(engine["overlap"]) < 1e-13
    assert abs(float(engine["pressure_error"])) < 5.0 * float(engine["pressure_error_error"])
    horizon = stored["states"][0]["horizon"]
    assert horizon["missed"] == 0 and horizon["collisions"] > 300
    assert horizon["collisions_per_particle"] == pytest.approx(horizon["expected"], rel=0.25)


def test_time_steps_are_seen_to_be_wrong(finished):
    """At dt = 0.1 bouncing balls lose almost half of the collisional pressure and miss collisions that the audit counts."""
    _, summary, _ = finished
    rows = {(row["method"], row["dt"]): row for row in summary["states"][0]["rows"]}
    coarse, finer = rows["bouncing balls", 0.1], rows["bouncing balls", 0.03]
    for row in (coarse, finer):
        assert row["pressure_error"] < -10.0 * row["pressure_error_error"]
        assert row["free_path_error"] > 5.0 * row["free_path_error_error"]
    assert coarse["pressure_error"] == pytest.approx(-0.45, abs=0.03)
    assert finer["pressure_error"] == pytest.approx(-0.163, abs=0.03)
    assert coarse["missed_per_collision"] == pytest.approx(0.02, rel=0.5)
    assert coarse["overlap"] > 0.2
    assert abs(rows["with back-up", 0.03]["pressure_error"]) < 0.03
    assert rows["bouncing balls", 1e-4]["trajectory_error"] == pytest.approx(1.4e-4, rel=2.0)
    assert all(row["energy_drift"] < 1e-12 for row in rows.values() if not math.isnan(row["energy_drift"]))


def settled(n):
    """The gas of the study."""
    return study_module._settled(SMALL.fluid(0.3, n), np.random.SeedSequence(1))


def test_errors_do_not_depend_on_how_fast_the_machine_is(state):
    again = accuracy_long.long_runs(settled_as_in_study(), SMALL.long_steps, SMALL.seconds)
    for key, long in again.items():
        before = state.engine_long if key[0] == ENGINE else state.long[key]
        assert (long.pressure, long.free_path, long.missed) == (
            before.pressure,
            before.free_path,
            before.missed,
        )


def settled_as_in_study():
    """The scene of the fixture's long runs."""
    seed = replica_seeds(SMALL.seed, SMALL.scenes + 1)[0]
    return study_module._settled(SMALL.fluid(0.3, SMALL.n), seed)


def test_an_engine_off_the_true_trajectory_fails(state, monkeypatch):
    """Sibling: beside an oracle whose balls are a hundred-thousandth smaller the engine is found wrong."""

    class Wrong(accuracy_few.Oracle):
        def __init__(self, scene):
            super().__init__(scene.replace(radii=scene.radii * (1.0 - 1e-5)))

    monkeypatch.setattr(accuracy_few, "Oracle", Wrong)
    few = accuracy_few.beside_oracle(settled(32), 1.0, [], False)
    (sentence,) = replace(state, few=few).failures
    assert "left the true trajectory" in sentence


def test_a_wrong_pressure_fails(state, monkeypatch):
    """Sibling: against a Z - 1 that is 10 % larger, and a collision rate too, the engine's long run is found wrong."""
    exact = accuracy_long.Exact.of

    def wrong(scene):
        return replace(exact(scene), z=1.1 * exact(scene).z - 0.1, rate=1.1 * exact(scene).rate)

    monkeypatch.setattr(accuracy_long.Exact, "of", wrong)
    long = accuracy_long.long_runs(settled(500), [], 0.05)
    failures = replace(state, long=long).failures
    assert any("Z - 1 is" in failure for failure in failures)
    assert any("mean free path is" in failure for failure in failures)


def test_the_audit_of_missed_collisions_sees_them(state):
    """Nobody passes through another in the engine; bouncing balls with long steps do, seen as the stepper itself sees it."""
    assert state.engine_long.missed == 0.0 and state.engine_long.audited > 3000
    scene, dt = settled(500), 0.1
    stepper, states = Stepper(scene, dt, BOUNCE, audit=True), []
    for _ in range(200):
        states.append((np.mod(stepper.positions, scene.box), stepper.velocities))
        stepper.run(dt)
    count = stepper.count
    seen = accuracy_long.passed_through(states, scene, dt)
    assert 20 < 0.2 * count.missed < seen <= count.missed  # some of the pairs hit another in the same step


def test_scenes_that_were_finished_are_not_run_again(state, tmp_path, monkeypatch):
    """Interrupted and resumed, with the fixture's numbers for every run: the files are those of a run that was not."""
    asked = []

    def few(scene, *_):
        asked.append(scene)
        return {
            key: accuracy_few.Few(**{name: values[-1:] for name, values in vars(each).items()})
            for key, each in state.few.items()
        }

    def interrupting(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(study_module, "beside_oracle", few)
    monkeypatch.setattr(study_module, "followed", lambda *_: state.horizons[0])
    monkeypatch.setattr(study_module, "long_runs", lambda *_: state.long)
    monkeypatch.setattr(study_module, "engine_test_seconds", lambda *_: state.engine_test)
    screen, out = Screen(json_output=True), tmp_path / "out"
    SMALL.conduct(OutputFolder(tmp_path / "whole"), screen)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(study_module, "followed", interrupting)
        SMALL.conduct(OutputFolder(out), screen)
    kept = sorted(path.name for path in (out / "checkpoint").iterdir())
    assert kept == ["done-0000.npz", "done-0001.npz", "lock", "manifest.json"]
    SMALL.conduct(OutputFolder(out, resume=True), screen)
    assert len(asked) == 2 * SMALL.scenes
    files = [
        {path.name: path.read_bytes() for path in folder.iterdir()} for folder in (tmp_path / "whole", out)
    ]
    for each in files:
        each["summary.json"] = json.loads(each["summary.json"]) | {"seconds": None}
        each[REPORT] = masked(each[REPORT].decode())
    assert len(files[0]) == 4 and files[0] == files[1]


def test_what_an_error_costs():
    """On a power law, dt^2 at a cost of 1/dt, need is known in closed form."""
    dt = [0.1, 0.03, 0.01]
    curve = Curve(dt, [10.0 * step**2 for step in dt], [1e-5] * 3, [1e-6 / step for step in dt])
    assert curve.order == pytest.approx(2.0)
    inside, beyond = curve.need(4e-3), curve.need(1e-5)
    assert (
        inside.dt == pytest.approx(0.02) and inside.seconds == pytest.approx(5e-5) and not inside.extrapolated
    )
    assert beyond.dt == pytest.approx(1e-3) and beyond.seconds == pytest.approx(1e-3) and beyond.extrapolated
    assert curve.need(0.5).dt == 0.1
    noisy = Curve(dt, [0.1, 2e-3, 1e-3], [1e-3] * 3, [1e-6 / step for step in dt])
    assert noisy.seen == [0] and math.isnan(noisy.order)
    assert noisy.need(5e-3).dt == 0.03  # certain to two standard errors
    assert noisy.need(1e-3) is None  # lost in noise
    floor, at = rounding_floor(2.0, 8e-16)
    assert at == pytest.approx(2e-8) and floor == pytest.approx(8e-8)
    assert floor <= min(2.0 * step + 8e-16 / step for step in np.geomspace(1e-9, 1e-6, 301))


def test_lyapunov_exponents_are_interpolated():
    assert lyapunov_exponent(0.1, 3) == pytest.approx(1.69)
    assert 0.448 < lyapunov_exponent(0.3, 3) < 0.974
    assert math.isnan(lyapunov_exponent(0.6, 3))


@pytest.mark.slow
def test_the_order_of_the_errors():
    """Z of bouncing balls to first order, missed collisions to second; with back-up Z is better, at no time step the path."""
    study = Accuracy(
        packing_fractions=(0.3,), n=2000, seed=3, scenes=4, seconds=1.0, long_steps=(0.1, 0.03, 0.01, 0.003)
    )
    (state,) = compare(study)
    assert state.failures == []
    bounce, back_up = state.pressure_curve(BOUNCE), state.pressure_curve(BACK_UP)
    assert bounce.order == pytest.approx(1.0, abs=0.25)
    assert back_up.error[1] < 0.1 * bounce.error[1]
    missed = [state.long[BOUNCE, dt].missed for dt in (0.1, 0.03)]
    assert math.log(missed[0] / missed[1]) / math.log(0.1 / 0.03) == pytest.approx(2.0, abs=0.6)
    assert state.trajectory_curve(BOUNCE).order == pytest.approx(1.0, abs=0.25)
    worst = state.trajectory_curve(BACK_UP, worst=True)
    engine = max(few.trajectory[0] for (name, _), few in state.few.items() if name == ENGINE)
    assert min(worst.error) > 3.0 * engine
    assert all(sentence.startswith("packing fraction 0.3, ") for sentence in answers(state))


@pytest.mark.slow
@pytest.mark.parametrize(("dim", "eta"), [(3, 0.01), (3, 0.2), (2, 0.1)])
def test_the_horizon_is_that_of_the_lyapunov_exponent(dim, eta):
    """Mean of three scenes of 32; the exponent is that of 100 or 125 particles, so 20 % are allowed."""
    study = Accuracy(packing_fractions=(eta,), dim=dim)
    seeds = np.random.SeedSequence(5).spawn(3)
    found = [accuracy_few.followed(study.fluid(eta, 32).scene(seed)) for seed in seeds]
    expected = math.log(0.01 / 1e-16) / lyapunov_exponent(eta, dim)
    assert np.mean([each.horizon for each in found]) == pytest.approx(expected, rel=0.2)
    assert np.mean([each.growth for each in found]) == pytest.approx(lyapunov_exponent(eta, dim), rel=0.2)
    assert all(each.missed == 0 for each in found)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--packing-fractions", "0.55"], "0.55 is above 0.494"),
        (["--packing-fractions", "1e-6"], "ask for at least 1e-4"),
        (["--n", "50"], "--n 50 is too few for an exact pressure"),
        (["--packing-fractions", "x"], "--packing-fraction x is not understood"),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "accuracy", *options, "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
