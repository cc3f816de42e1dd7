"""What estimators warn of reaches a person in the study's words, and nothing else does."""

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import hardspheres as hs
from analysis.free_path import FreePath
from analysis.series import ShortSeriesWarning, estimate_from_series
from studies.noticing import Notices, too_short
from studies.pressure import EquationOfState
from studies.report import Screen
from studies.study import run_study


def test_a_short_run_names_quantity_and_option():
    """A dense fluid of 60 collisions per particle; sibling: a thin one, which is long enough."""
    study = EquationOfState(
        packing_fractions=(0.05, 0.25), n=200, collisions_per_particle=60.0, replicas=1, workers=1
    )
    gases, (replicas, _) = study.gases(), run_study(study, Screen())
    notes = {}
    for gas, own in zip(gases, replicas, strict=True):
        own[0].estimators["pressure"]._least_block = 30.0 if gas.packing_fraction > 0.2 else 0.0
        notes[gas.packing_fraction] = study.answer(gas, own).notes
    assert notes[0.05] == []
    (note,) = notes[0.25]
    assert "60 collisions per particle are too few" in note
    assert note.endswith("ask for --collisions-per-particle 250 or more")


def test_the_length_asked_for_is_enough():
    assert too_short(0.0, 60.0) == []
    assert too_short(8.0625, 60.0)[0].endswith("--collisions-per-particle 490 or more")
    rng = np.random.default_rng(1)
    correlated = np.convolve(rng.standard_normal(4000), np.ones(20) / 20, "same")
    notices = Notices()
    with notices.of("the series"):
        estimate_from_series(correlated[:300])
    assert 1.0 < notices.times < 6.0 and notices.notes == []
    with warnings.catch_warnings():  # sibling: as long as was asked for, and half as much again
        warnings.simplefilter("error", ShortSeriesWarning)
        estimate_from_series(correlated[: int(300 * notices.times * 1.5)])


def test_ours_become_notes_and_others_pass_on():
    notices = Notices()

    def measure():
        with notices.of("the ratio"):
            _ = np.float64(1.0) / np.float64(0.0)
            for _ in range(2):
                warnings.warn(hs_warning("spread too far"), stacklevel=1)

    with pytest.warns(RuntimeWarning, match="divide by zero"):
        measure()
    assert notices.notes == ["the ratio: spread too far"] and notices.times == 0.0


def hs_warning(text):
    from analysis.series import DriftWarning
    from analysis.statistics import Estimate

    return DriftWarning(text, Estimate(1.0, 0.1))


def test_survival_of_flights_that_few_blocks_have_is_no_matter_of_rounding():
    """24 blocks: without the one block that has all the long flights, their number is 0 but for rounding, and has no logarithm."""
    sim = hs.Simulation(hs.random_gas(n=100, packing_fraction=0.1, seed=0), free_paths=True)
    sim.run(collisions=1000)
    paths = FreePath(sim.to_scene())
    for frame in sim.frames(collisions_per_particle=range(20, 45)):
        paths.add(frame)
    counts = paths._rows("path_counts")
    mean = counts.mean(axis=0)
    left = np.cumsum((mean + (mean - counts) / 23)[:, ::-1], axis=1)
    assert left.min() < 0.0  # sibling: what the logarithm was taken of
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        survival = paths.survival([0.5, 5.0, 9.0])
    assert survival[0].value == pytest.approx(np.exp(-0.5), rel=0.05)


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script of CI")
def test_ci_sees_warnings_of_programs_and_not_those_of_pytest(tmp_path):
    check = Path(__file__).parents[2] / ".ci" / "no_warnings"
    program = "import numpy as np; print('Z, virial'); np.log(np.array([-1.0]))"
    printed = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    pytests = "  /x/y.py:12: RuntimeWarning: invalid value encountered in log\n3 passed, 1 warning in 2.00s\n"
    pip = "WARNING: Running pip as the 'root' user\n"
    note = "packing fraction 0.1: invalid value encountered in log\n"
    for log, code in ((printed.stdout + pytests + pip, 0), (printed.stderr, 1), (note, 1)):
        (tmp_path / "log").write_text(log)
        done = subprocess.run([check, tmp_path / "log"], capture_output=True, text=True, check=False)
        assert done.returncode == code, (log, done)
