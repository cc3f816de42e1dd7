"""The calibration of error bars, end to end: every estimator, and wrong error bars that must not pass."""

import csv
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import studies
from studies.cli import main
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds
from studies.validation.calibration import Calibrations, rows_of
from studies.validation.calibration_runs import FAMILIES, measure

RESULTS = Path(studies.__file__).parent / "results" / "calibration"


def right(entry):
    """Whether a row's spread is within 4.5 standard errors and its p above 1e-4: false once in 10 000 rows."""
    apart = abs(entry["spread"] - entry["spread_expected"]) / entry["spread_error"]
    return apart < 4.5 and entry["p_value"] > 1e-4


def test_series_and_walls_are_calibrated(tmp_path):
    """40 runs of 12 estimators; one of them is not `right` by chance in 0.2 % of seeds."""
    study = Calibrations(runs=40, seed=2, workers=1, families=("walls", "series"))
    out = OutputFolder(tmp_path / "out")
    summary, sound = study.conduct(out, Screen(json_output=True))
    assert sound == summary["checks"]["passed"] and all(right(entry) for entry in summary["rows"])
    names = {"summary.json", "report.html", "calibration.csv", "calibration.png"}
    assert {path.name for path in out.path.iterdir()} == names == set(summary["files"])
    stored = json.loads((out.path / "summary.json").read_text())
    with (out.path / "calibration.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert [row["estimator"] for row in rows] == [row["estimator"] for row in stored["rows"]]
    assert len(rows) == 12
    for row, entry in zip(rows, stored["rows"], strict=True):
        assert float(row["spread"]) == entry["spread"] and int(row["runs"]) == 40


def test_every_family_runs():
    for name, family in FAMILIES.items():
        if name in ("spheres", "series"):
            estimates = measure((name, np.random.SeedSequence(1)))
            assert set(family.truths) <= set(estimates)
            for estimate in estimates.values():
                assert estimate.standard_error > 0 and estimate.degrees_of_freedom > 4
            assert measure((name, np.random.SeedSequence(1))) == estimates


def test_wrong_error_bars_and_wrong_values_fail():
    """Sibling: errors 30 % too small, 40 % too large, and a value 0.6 standard errors off."""
    runs = [measure(("series", seed)) for seed in replica_seeds(3, 150)]
    name = "mean, automatic blocks"
    assert next(row for row in rows_of("series", runs) if row.name == name).result.passed
    for change in (
        lambda e: replace(e, standard_error=0.7 * e.standard_error),
        lambda e: replace(e, standard_error=1.4 * e.standard_error),
        lambda e: replace(e, value=e.value + 0.6 * e.standard_error),
    ):
        (row,) = rows_of("series", [{name: change(run[name])} for run in runs])
        assert not row.result.passed


@pytest.mark.long
def test_every_estimator_is_calibrated(tmp_path):
    """The whole command: one of 50 estimators is not `right` by chance in 0.5 % of seeds."""
    study = Calibrations(runs=200, seed=1)
    summary, _ = study.conduct(OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert all(right(entry) for entry in summary["rows"]), summary["checks"]["failures"]
    assert len(summary["rows"]) == 50 and all(row["runs"] == 200 for row in summary["rows"])


def test_the_committed_calibration():
    """What the long command left: every estimator, none with a wrong error bar."""
    summary = json.loads((RESULTS / "summary.json").read_text())
    assert summary["checks"]["passed"] and summary["families"] == {k: f.text for k, f in FAMILIES.items()}
    assert len(summary["rows"]) == 50 and all(row["runs"] == 200 for row in summary["rows"])
    for name, family in FAMILIES.items():
        rows = {row["estimator"]: row for row in summary["rows"] if row["runs_of"] == name}
        assert all(right(row) and row["calibrated"] for row in rows.values())
        for estimator, (truth, source) in family.truths.items():  # theory of today
            assert rows[estimator]["source"] == source
            assert rows[estimator]["truth"] == pytest.approx(truth, rel=1e-9)


def test_bad_input_is_one_sentence(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "calibration", "--runs", "5", "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err == ("error: --runs 5 are too few to detect a wrong error bar; ask for at least 20\n")
