"""The hard cases pass as miniatures, in full in the slow tier; a gas with a flaw fails every group."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import hardspheres as hs
from studies.cli import app
from studies.report import OutputFolder, Screen
from studies.running.journal import Shelf
from studies.running.ownership import REPORT
from studies.validation import hard_cases
from studies.validation.hard_cases import GROUPS, HardCases, cradle, symmetries
from studies.validation.hard_cases.case import Case, keeping, kept
from studies.validation.hard_cases.grazing import meets, passing

from ..pages import masked


def failed(cases):
    return [f"{case.name}: {case.engine}" for case in cases if not case.passed]


@pytest.mark.parametrize("name", GROUPS)
def test_miniatures(name, tmp_path):
    """Also from the shelf, where they have something there."""
    with keeping(Shelf(tmp_path)):
        found = list(GROUPS[name].cases("small"))
    assert not failed(found)
    if list(tmp_path.iterdir()):
        with keeping(Shelf(tmp_path)):
            assert list(GROUPS[name].cases("small")) == found


@pytest.mark.slow
@pytest.mark.parametrize("name", GROUPS)
def test_in_full(name):
    assert not failed(GROUPS[name].cases("full"))


@pytest.mark.long
@pytest.mark.parametrize("name", GROUPS)
def test_at_length(name):
    assert not failed(GROUPS[name].cases("long"))


class Lossy(hs.Simulation):
    """A gas of which some particles that have just changed get a part of their old velocity back."""

    LOSS = 1e-2

    def run(self, *, time=None, collisions=None):
        pieces = 32
        for piece in range(pieces):
            before = self.velocities
            if time is not None:
                super().run(time=time / pieces)
            else:
                super().run(collisions=collisions * (piece + 1) // pieces - collisions * piece // pieces)
            at, dim = self._at, self.scene.dim
            self._rows[:, at.V : at.V + dim] += self.LOSS * (before - self.velocities)
            self._engine._afresh = True


@pytest.mark.parametrize(
    "name",
    [
        "galperin",
        "cradle",
        "ratios",
        "packing",
        "distances",
        "reversal",
        "exactly-solved",
        "gravity",
        "obstacles",
    ],
)
def test_a_lossy_gas_fails(name, monkeypatch):
    """Sibling of every group that has a conserved or counted answer."""
    monkeypatch.setattr(hs, "Simulation", Lossy)
    if name == "obstacles":  # 2000 losses: more would bring the one disc to a halt
        monkeypatch.setattr(Lossy, "LOSS", 1e-5)
    done = []
    for case in GROUPS[name].cases("small"):
        done.append(case)
        if not case.passed:
            return
    pytest.fail(f"all of {len(done)} passed")


def test_a_wrong_size_misses_grazing_collisions():
    """Sibling of grazing: spheres 1e-12 larger meet where they should not."""
    scene = passing(13, False, np.random.default_rng(1))
    larger = hs.Simulation(scene.replace(radii=scene.radii * (1 + 1e-12)))
    larger.run(time=6.0)
    assert not meets(scene) and larger.collisions == 1


def test_a_symmetry_that_is_none_is_seen():
    """Sibling of symmetries: a gas seen by somebody who speeds up; units that are no power of two."""
    scene = hs.random_gas(n=16, packing_fraction=0.2, seed=3)
    assert not symmetries.same_bits(scene, 3.0, 1.0, 100)
    other = scene.replace(velocities=scene.velocities * (1 + 1e-4 * np.arange(16)[:, None]))
    one, two = symmetries.sequence(scene, 136), symmetries.sequence(other, 136)
    assert one != two


@pytest.mark.parametrize("name", symmetries.TRANSFORMATIONS)
def test_symmetries_of_other_gases(name):
    scene = hs.random_gas(n=12, packing_fraction=0.2, seed=17)
    assert symmetries.agreement(scene, name, 60, 5) == 60


def test_command(tmp_path):
    done = CliRunner().invoke(
        app, ["hard-cases", "--size", "small", "--only", "cradle", "--out", str(tmp_path)]
    )
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["checks"]["passed"] and len(summary["cases"]) == 5
    assert (tmp_path / "hard_cases.csv").read_text().startswith("group,case,exact,engine,error")


def test_what_was_done_is_not_done_again(tmp_path, monkeypatch):
    """Interrupted between two runs of one case; the files are those of a run that was not."""
    done = []

    @kept
    def part(k):
        if k == 3 and not done.count(3):
            done.append(k)
            raise KeyboardInterrupt
        done.append(k)
        return part(k - 3) + k if k > 3 else k  # what is called within is not kept by itself

    @kept
    def two(k):
        yield from (Case(f"{k} {part(k)}", "0", "0", 0.0) for _ in range(2))

    def cases(size):
        yield Case(f"{part(1)} {part(5)} {part(3)}", "0", "0", 0.0)
        yield from two(4)

    monkeypatch.setitem(hard_cases.GROUPS, "cradle", SimpleNamespace(TITLE="Any", cases=cases))
    command, out = ["hard-cases", "--only", "cradle", "--out", str(tmp_path / "out")], tmp_path / "out"
    assert CliRunner().invoke(app, command).exit_code == 130 and done == [1, 5, 2, 3]
    assert sorted(path.name for path in (out / "checkpoint").glob("done*")) == [
        f"done-000{k}.npz" for k in (0, 1)
    ]
    done[:] = [3]
    assert CliRunner().invoke(app, [*command, "--resume"]).exit_code == 0 and done == [3, 3, 4, 1, 4, 1]
    assert CliRunner().invoke(app, [*command[:-1], str(tmp_path / "whole")]).exit_code == 0
    files = [
        {path.name: path.read_bytes() for path in folder.iterdir()} for folder in (out, tmp_path / "whole")
    ]
    for each in files:
        each["summary.json"] = json.loads(each["summary.json"]) | {"seconds": None}
        each[REPORT] = masked(each[REPORT].decode())
    assert len(files[0]) == 3 and files[0] == files[1]


def test_a_failed_case_is_exit_code_1(tmp_path, monkeypatch):
    monkeypatch.setattr(cradle, "cases", lambda size: [Case("a", "1", "2", 1.0)])
    done = CliRunner().invoke(app, ["hard-cases", "--only", "cradle", "--out", str(tmp_path)])
    assert done.exit_code == 1 and "FAILED" in done.output


def test_unknown_names_are_refused(tmp_path):
    with pytest.raises(hs.HardSpheresError, match="not a group"):
        HardCases(only=("nonsense",)).conduct(OutputFolder(tmp_path), Screen())
    with pytest.raises(hs.HardSpheresError, match="not known"):
        HardCases(size="huge").conduct(OutputFolder(tmp_path), Screen())
