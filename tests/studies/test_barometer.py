"""The barometer: profiles beside hydrostatics, mixtures that sort, bad input."""

import sys

import numpy as np
import pytest

from analysis.barometer import HeightProfile
from analysis.calibration import calibrate
from studies.barometer import BarometerStudy
from studies.cli import main
from studies.report import Screen
from studies.study import run_study

DISCS = {"dim": 2, "boundary": "wall", "diameter_ratio": 1.0 + 1e-9}  # the kind that tests of gravity compile


def answered(**options):
    study = BarometerStudy(**{"n": 100, "replicas": 8, "seed": 3, "workers": 1, "cells": 10} | options)
    (replicas,), _ = run_study(study, Screen(True))
    return study.answer(study.gases()[0], replicas)


def part(answer, name):
    return answer.curves["profile"].flat()[name]


def test_discs_of_two_masses_sort():
    """Heavy ones below, both beside hydrostatics; false alarm 1e-3. Sibling: the law of each other's mass."""
    found = answered(**DISCS, packing_fractions=(0.03,), mass_ratio=4.0, collisions_per_particle=60.0)
    assert found.failures == []
    light, heavy = (found[f"mean height, m = {mass}, σ = 1"] for mass in (1, 4))
    assert abs(light.z) < 3.5 and abs(heavy.z) < 3.5
    assert light.measured.value > 1.8 * heavy.measured.value
    assert abs(found["imbalance of forces, relative"].measured.value) < 1e-12
    assert abs(found["on the lid, over the weight"].z) < 3.5
    for k in (1, 2):
        assert np.nanmax(np.abs(part(found, f"density_{k}_z"))) < 4.5
        assert np.nanmax(np.abs(part(found, f"temperature_{k}_z"))) < 4.5
    off = part(found, "density_1") - part(found, "density_2_theory")
    assert np.nanmax(np.abs(off / part(found, "density_1_error"))) > 10.0
    assert np.isnan(part(found, "density_1_z")[[0, -1]]).all()  # layers at floor and lid are not compared


def test_a_wrong_weight_is_found(monkeypatch):
    """Sibling: beside weights that are a tenth too large, the study itself says that it failed."""
    right = HeightProfile.weights.fget
    monkeypatch.setattr(HeightProfile, "weights", property(lambda self: 1.1 * right(self)))
    found = answered(**DISCS, packing_fractions=(0.03,), mass_ratio=4.0, collisions_per_particle=20.0)
    assert any(sentence.startswith("floor and lid carry -9.1e-02") for sentence in found.failures)


def test_slices_with_hardly_any_particles_are_not_compared():
    """Four replicas in which nobody was so high agree on 0. Sibling: lower slices are compared."""
    few = {"n": 32, "replicas": 4, "collisions_per_particle": 200.0, "mass_ratio": 2.0, "scale_heights": 20.0}
    found = answered(**DISCS, packing_fractions=(0.005,), **few)
    assert found.failures == []
    z = part(found, "density_1_z")
    assert np.isnan(z[6:]).all() and np.isfinite(z[1])


def test_unequal_diameters_have_no_theory_and_say_so():
    found = answered(
        dim=2, boundary="wall", diameter_ratio=0.6, mass_ratio=0.2, packing_fractions=(0.03,), replicas=4,
        collisions_per_particle=20.0,
    )  # fmt: skip
    assert found.notes == ["no theory here of species of different diameters at one height"]
    assert found.failures == []
    assert abs(found["imbalance of forces, relative"].measured.value) < 1e-12
    assert np.isnan(part(found, "density_1_theory")).all()


@pytest.mark.slow
@pytest.mark.parametrize("eta", [0.002, 0.08])
def test_spheres_beside_hydrostatics(eta):
    """The equation of state from one column, too. Sibling: the barometric law, and an ideal gas's Z."""
    found = answered(packing_fractions=(eta,), n=1000, replicas=12, cells=24, collisions_per_particle=200.0)
    assert found.failures == []
    z, error = part(found, "density_z"), part(found, "density_error")
    seen = np.isfinite(z)
    assert seen.sum() > 12 and np.abs(z[seen]).max() < 4.5
    assert np.abs(part(found, "compressibility_z")[seen]).max() < 4.5
    if eta > 0.01:
        height = part(found, "z")[seen]
        law = np.exp(-height * 4.0 / found.gas.box[-1])
        law *= part(found, "density")[seen].sum() / law.sum()
        assert np.abs((part(found, "density")[seen] - law) / error[seen]).max() > 20.0
        ideal = (part(found, "compressibility") - 1.0) / part(found, "compressibility_error")
        assert ideal[seen].max() > 20.0


@pytest.mark.slow
def test_its_error_bars_are_right():
    """24 studies of 8 gases; 1e-3 for each number."""
    runs = {}
    for seed in range(24):
        found = answered(
            **DISCS, packing_fractions=(0.02,), n=50, collisions_per_particle=40.0, seed=seed, mass_ratio=2.0
        )
        for each in found.numbers[:5]:
            runs.setdefault(each.quantity, []).append(each)
    for several in runs.values():
        assert calibrate([each.measured for each in several], several[0].expected).passed


FROZEN = ["--packing-fraction", "0.1", "--scale-heights", "100"]
BAD = [
    (
        FROZEN,
        "packing fraction 0.1, 100 scale heights high, is more than 0.494 at the floor, where the fluid",
    ),
    (FROZEN, "would freeze; ask for less, or for fewer --scale-heights"),
    (
        ["--packing-fraction", "0.4"],
        "packing fraction 0.4, 4 scale heights high, is too dense to be placed at",
    ),
    (["--packing-fraction", "0"], "--packing-fraction 0 has 0; expected numbers between 0 and 1"),
    (
        ["--scale-heights", "0"],
        "--scale-heights 0 must be positive and finite: it is the height of the box over",
    ),
    (["--n", "10"], "--n 10 is too few for a profile; ask for at least 16"),
    (["--cells", "1"], "--cells 1 is out of range; ask for 2 to 1000"),
    (["--replicas", "3"], "--replicas 3 gives no error bar"),
    (
        ["--collisions-per-particle", "2"],
        "--collisions-per-particle 2 is too short for a profile; ask for at",
    ),
    (["--fraction", "0.2"], "--fraction needs --mass-ratio or --diameter-ratio"),
    (["--boundary", "soft"], "--boundary soft is not known; it can be periodic or wall"),
]


@pytest.mark.parametrize(("options", "sentence"), BAD)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "barometer", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not list(tmp_path.iterdir())
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
