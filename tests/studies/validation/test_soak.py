"""The long run in miniature: its figures are right, and it notices what it is there to notice."""

import csv
import gc
import json
from pathlib import Path

import numpy as np
import pytest

import hardspheres as hs
import studies
from studies.report import OutputFolder, Screen
from studies.validation import soak as soaking
from studies.validation.soak import COLUMNS, Soak, Soaking, growth_exponent, resident, soak

STUDY = Soak(n=200, dim=2, collisions=100_000, workers=1)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("soak"))
    summary, sound = soak(STUDY, out, Screen(json_output=True))
    return out, summary, sound


def test_a_short_soak_is_sound_and_stores_its_figures(finished):
    """The memory may grow by less than 1 MB here too."""
    out, summary, sound = finished
    assert sound, summary["checks"]
    assert {path.name for path in out.path.iterdir()} == {"soak.csv", "summary.json"} == set(summary["files"])
    fluid, mixture = json.loads((out.path / "summary.json").read_text())["gases"]
    assert fluid["collisions"] == 100_000 and mixture["collisions"] == 10_000
    assert fluid["wall_collisions"] == 0 and mixture["wall_collisions"] > 1000
    with (out.path / "soak.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert list(rows[0]) == ["gas", *COLUMNS] and len(rows) == 200
    for index, gas in enumerate((fluid, mixture)):
        own = [row for row in rows if row["gas"] == str(index)]
        for name in ("energy_drift", "momentum_drift", "worst_overlap"):
            assert gas[name] == max(abs(float(row[name])) for row in own) < 1e-12
        assert gas["late_events"] == 0 and float(own[-1]["collisions"]) == gas["collisions"]
    assert summary["machine"]["cores"] >= 1 and summary["date"].startswith("20")


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
    (gas, _), (seed,) = STUDY.gases, np.random.SeedSequence(1).spawn(1)
    found = Soaking()((soaking.Gas(gas.fluid, 1000), seed))
    assert len(found.failures) == 102 and "kinetic energy changed by 1e-06" in found.failures[0]
    assert found.failures[-2:] == ("3 events were out of order", "resident memory grew by 1.8 MB")
    assert found.worst("worst_overlap") == 1e-9


def test_memory_is_seen():
    gc.collect()
    before = resident()
    if np.isnan(before):
        pytest.skip("the resident memory of a process is known on Linux only")
    ballast = np.ones(16_000_000)
    assert resident() - before > 0.8 * ballast.nbytes


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
