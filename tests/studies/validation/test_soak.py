"""The long run in miniature: its figures are right, and it notices what it is there to notice."""

import csv
import gc
import json
import mmap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hardspheres as hs
import studies
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study
from studies.validation import soak as soaking
from studies.validation.soak import COLUMNS, Soak, growth_exponent, resident

STUDY = Soak(n=200, dim=2, collisions=100_000, workers=1)


def test_a_short_soak_is_sound_and_stores_its_figures(tmp_path, monkeypatch):
    """The memory may grow by 16 MB: so early in a run, and after other tests, it is not steady to 1 MB yet."""
    out = OutputFolder(tmp_path / "soak")
    monkeypatch.setattr(soaking, "MOST_GROWTH", 2**24)
    summary, sound = conduct(STUDY, out, Screen(json_output=True))
    assert sound, summary["checks"]
    with (out.path / "invariants.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert set(COLUMNS) < set(rows[0]) and len(rows) == 200
    for state, collisions in zip(summary["states"], (100_000, 10_000), strict=True):
        found = {each["quantity"]: each["value"] for each in state["measured"]}
        assert found["collisions"] == collisions and (found["collisions with walls"] > 1000) == (
            collisions == 10_000
        )
        own = [row for row in rows if row["gas"] == state["gas"]]
        worst = {name: max(abs(float(row[name])) for row in own) for name in COLUMNS[2:6]}
        assert found["change of energy, relative"] == worst["energy_drift"] < 1e-12
        assert found["change of momentum, relative"] == worst["momentum_drift"] < 1e-12
        assert found["deepest overlap, in contact distances"] == worst["worst_overlap"] < 1e-12
        assert found["events out of order"] == 0 and float(own[-1]["collisions"]) == collisions


class Broken(hs.Simulation):
    """A simulation whose energy, overlaps and punctuality are not what they should be."""

    worst_overlap = 1e-9

    @property
    def energy_drift(self):
        return 1e-6

    def status(self):
        return super().status() | {"late_events": 3}


def test_what_breaks_is_told(monkeypatch):
    monkeypatch.setattr(hs, "Simulation", Broken)
    memory = iter(np.arange(1, 1000) * 2e4)
    monkeypatch.setattr(soaking, "resident", lambda: next(memory))
    monkeypatch.setattr(soaking, "encode", lambda state: None)
    study = replace(STUDY, collisions=1000)
    (first, _), _ = run_study(study, Screen(json_output=True))
    failures = study.answer(study.gases()[0], first).failures
    assert len(failures) == 102 and "kinetic energy changed by 1e-06" in failures[0]
    assert failures[-2:] == ["3 events were out of order", "resident memory grew by 1.8 MB"]
    assert first[0].estimators["invariants"].worst("worst_overlap") == 1e-9


def test_memory_is_seen():
    gc.collect()
    before = resident()
    if np.isnan(before):
        pytest.skip("the resident memory of a process is known on Linux only")
    with mmap.mmap(-1, 2**27) as ballast:  # of the system, not what earlier tests have given back
        ballast.write(b"1" * 2**27)
        assert resident() - before > 0.8 * 2**27


def test_growth_is_told_from_a_walk_and_a_drift():
    """In 1000 random walks the exponent stayed between 0.25 and 0.70 in all but 2."""
    generator = np.random.default_rng(1)
    walk = np.cumsum(generator.normal(size=100))
    assert 0.25 < growth_exponent(walk) < 0.7
    assert growth_exponent(walk + 5.0 * np.arange(100)) > 0.95
    assert np.isnan(growth_exponent(np.zeros(100))) and np.isnan(growth_exponent(walk[:10]))


def test_the_committed_soak_is_a_random_walk():
    """1e9 collisions of `hardspheres soak`: rounding errors add up as a walk, and stay below 10 eps sqrt(n) / N."""
    folder = Path(studies.__file__).parent / "results" / "soak"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["checks"]["passed"] and summary["date"] and summary["machine"]["processor"]
    assert [gas["collisions"] for gas in summary["gases"]] == [1_000_000_000, 100_000_000]
    with (folder / "soak.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    for index, gas in enumerate(summary["gases"]):
        own = [row for row in rows if row["gas"] == str(index)]
        for name in ("energy", "momentum"):
            drift = np.array([float(row[f"{name}_drift"]) for row in own])
            assert gas[f"{name}_drift"] == np.abs(drift).max()
            assert (
                gas[f"{name}_growth_exponent"] == growth_exponent(drift)
                and 0.25 < growth_exponent(drift) < 0.7
            )
        collisions = np.array([float(row["collisions"]) for row in own])
        energy = np.array([float(row["energy_drift"]) for row in own])
        assert np.all(
            np.abs(energy) < 10.0 * np.finfo(float).eps * np.sqrt(collisions) / summary["options"]["n"]
        )
        assert gas["late_events"] == 0 and gas["worst_overlap"] < 1e-14 and gas["memory_growth"] < 1e6
