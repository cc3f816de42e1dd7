"""Balls that are let fall: the first fall, the end, bad input."""

import json
import sys

import numpy as np
import pytest

from studies.cli import main
from studies.drop import EARLY, FALLS, Drop
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study

from .test_every_study import small

DISCS = {"dim": 2, "diameter_ratio": 1.0 + 1e-9}  # with two masses the kind that tests of gravity compile


def answered(**options):
    study = Drop(**{"n": 100, "replicas": 12, "seed": 3, "workers": 1} | DISCS | options)
    (replicas,), _ = run_study(study, Screen(True))
    return study.answer(study.gases()[0], replicas)


def part(answer, name):
    return answer.curves["fall"].flat()[name]


@pytest.fixture(scope="module")
def fallen():
    return answered(packing_fraction=0.05)


def test_they_fall_as_galilei_says(fallen):
    """Before anything is hit all gain g^2 t^2, whatever their mass; energy across comes from collisions alone."""
    t, g, fall = part(fallen, "t"), fallen.details["g"], fallen.details["fall_time"]
    assert t[1] * fall == pytest.approx(FALLS * fall / EARLY)
    lost = [part(fallen, f"height_{k}")[0] - part(fallen, f"height_{k}")[1] for k in (1, 2)]
    assert lost == pytest.approx([0.5 * g * (t[1] * fall) ** 2] * 2, rel=0.1)
    assert part(fallen, "across")[1] < 0.01 * part(fallen, "along")[1]
    ratio = part(fallen, "temperature_2")[1] / part(fallen, "temperature_1")[1]
    assert ratio == pytest.approx(4.0, rel=0.1)  # energies go as masses, temperatures will be one


def test_they_end_at_the_temperature_of_their_energy(fallen):
    """False alarm 1e-3 each. Sibling: all the energy at the start for kinetic energy would be far too hot."""
    assert fallen.failures == []
    for quantity in (
        "kT at the end, over theory's",
        "kT along gravity over across",
        "kT of species 2 over 1",
        "a2 at the end",
    ):
        assert abs(fallen[quantity].z) < 3.5
    hot = fallen["kT at the end, over theory's"].measured
    known = fallen.gas.theory
    energy = 0.5 * float(np.dot(known.counts, known.weights)) * known.height
    assert abs(hot.deviation(2.0 * energy / known.freedom / known.temperature(energy))) > 10.0
    end, first = part(fallen, "height_2")[-10:].mean(), part(fallen, "height_1")[-10:].mean()
    assert end < 0.7 * first  # heavy ones below


def test_a_page_shows_a_few(tmp_path):
    out = OutputFolder(tmp_path / "out")
    summary, sound = conduct(small("drop"), out, Screen(json_output=True))
    assert sound and "gas.html" in summary["files"]
    head = json.loads((out.path / "gas.html").read_text().split('id="head">')[1].split("</script>")[0])
    assert head["n"] == 60 and head["gravity"][0] == 0.0 and head["gravity"][1] < 0.0


BAD = [
    (["--n", "10"], "--n 10 is too few for a temperature; ask for at least 16"),
    (["--packing-fraction", "0"], "--packing-fraction 0 must be positive"),
    (["--packing-fraction", "0.6"], "packing fraction 0.6 is above 0.494, where hard spheres freeze"),
    (["--replicas", "3"], "--replicas 3 gives no error bar"),
    (
        ["--scale-heights", "-1"],
        "--scale-heights -1 must be positive and finite: it is the height of the box",
    ),
    (["--boundary", "soft"], "--boundary soft is not known; it can be periodic or wall"),
]


@pytest.mark.parametrize(("options", "sentence"), BAD)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "drop", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not list(tmp_path.iterdir())
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
