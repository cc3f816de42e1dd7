"""Free expansion and the way back: beside an ideal gas, Enskog's diffusion and the Lyapunov exponent."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.calibration import calibrate
from studies.cli import main
from studies.expansion import Expansion
from studies.fluid import Fluid
from studies.half_full import HalfFull
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study
from studies.way_back import WayBack

from .test_every_study import small


def answered(**options):
    """The answer of a study of few small gases."""
    study = Expansion(**{"n": 200, "replicas": 12, "cells": 10, "seed": 3, "workers": 1} | options)
    (replicas,), _ = run_study(study, Screen(True))
    return study.answer(study.gases()[0], replicas)


def part(answer, curves, name):
    return answer.curves[curves].flat()[name]


@pytest.fixture(scope="module")
def dilute():
    """Hardly any collisions: Knudsen number 12."""
    return answered(packing_fraction=1e-4, transits=3.0, replicas=24)


@pytest.fixture(scope="module")
def collisional():
    return answered(packing_fraction=0.05, n=400, reverse_after=(2.0, 5.0, 30.0), transits=9.0)


def test_a_dilute_gas_expands_like_an_ideal_one(dilute):
    """False alarm 1e-3. Sibling: the same measurement beside a gas of 1.6 times its temperature."""
    assert dilute.failures == [] and dilute.details["knudsen_number"] > 10
    time, share = part(dilute, "spreading", "t"), part(dilute, "spreading", "right")
    error, z = part(dilute, "spreading", "right_error"), part(dilute, "spreading", "right_z")
    assert np.nanmax(np.abs(z)) < 4.0
    assert np.nanmax(np.abs(part(dilute, "spreading", "entropy_z"))) < 4.0
    assert abs(dilute["half-time, in transit times"].z) < 3.3
    half, gas = dilute.gas.half, dilute.gas
    edges = np.array([0.0, half - 0.5, 2 * half - 1.0])
    hot = theory.spread_shares(np.sqrt(1.6) * time * gas.half, edges, edges[2], half - 1.0)[:, 1]
    early = (time > 0) & (time < 1.1)
    assert ((hot - share)[early] / error[early]).max() > 5.0
    density, seen = part(dilute, "profiles", "density"), part(dilute, "profiles", "t") > 0
    seen &= density > 0.2
    off = (density - part(dilute, "profiles", "density_theory"))[seen]
    assert 0.5 < np.abs(off / part(dilute, "profiles", "density_error")[seen]).mean() < 1.3


def test_collisions_change_the_expansion_within_what_the_theory_allows(collisional):
    """Sibling: the theory without its uncertainty is off by more than 5 standard errors."""
    assert collisional.failures == []
    share, error, expected = (
        part(collisional, "spreading", f"right{end}") for end in ("", "_error", "_theory")
    )
    assert (np.abs(share - expected)[1:] / error[1:]).max() > 5.0
    z = part(collisional, "spreading", "right_z")
    assert np.nanmax(np.abs(z)) < 4.0
    assert np.isnan(z[part(collisional, "spreading", "s") > 6.5]).all()  # where it says nothing


def test_the_gas_ends_evenly_spread_and_as_hot_as_before(collisional):
    entropy = collisional["entropy at the end, per particle"]
    assert abs(entropy.z) < 3.5 and entropy.expected == pytest.approx(np.log(2.0))
    assert entropy.measured.value == pytest.approx(np.log(2.0), abs=0.002)
    assert abs(collisional["change of kT, relative"].measured.value) < 1e-14
    assert abs(collisional["variance in the right half, over free ones'"].z) < 3.5


def test_it_goes_back_for_as_long_as_the_arithmetic_remembers(collisional):
    """Sibling: reversed late, it does not come back."""
    s, left, back = (part(collisional, "returns", name) for name in ("reversed", "left", "left_on_return"))
    off = part(collisional, "returns", "off")
    assert s == pytest.approx([2.0, 5.0, 30.0], abs=0.006) and (left[1:] < 0.9).all()
    assert (back[:2] == 1.0).all() and off[0] < off[1] < 1e-2 and off[0] < 1e-8
    assert back[2] < 0.7 and off[2] > 1.0
    retraced = collisional["collisions per particle retraced"]
    assert abs(retraced.z) < 3.0 and 5.0 < retraced.measured.value < 10.0
    assert part(collisional, "returns", "entropy_on_return")[:2] == pytest.approx(0.0, abs=0.02)
    assert part(collisional, "returns", "entropy_on_return")[2] > 0.5
    # the share in the right half falls on the way back exactly as it rose
    second = part(collisional, "way_back", "reversed") == s[1]
    there = part(collisional, "way_back", "right")[second]
    assert there[-1] == 0.0 and (np.diff(there) < 0.01).all()


def test_velocities_that_are_not_reversed_do_not_bring_it_back(monkeypatch):
    """Sibling of the way back: the study itself says that it went wrong."""

    turn = WayBack.turn
    monkeypatch.setattr(
        WayBack, "turn", lambda self, scene: turn(self, scene.replace(velocities=-scene.velocities))
    )
    found = answered(packing_fraction=0.02, reverse_after=(1.0,), replicas=4, transits=3.0)
    failure, other = found.failures
    assert other.startswith("collisions per particle retraced is -")
    assert failure.startswith("reversed at s = 1") and failure.endswith("diameters from its start on return")
    assert part(found, "returns", "left_on_return")[0] < 0.9


def test_the_way_back_of_one_gas_is_its_way_there():
    """Against a simulation that is reversed by hand: the same bits."""
    gas = HalfFull(Fluid(100, 3, 0.02, ("wall", "periodic", "periodic")))
    before = hs.Simulation(gas.scene(np.random.SeedSequence(4)))
    before.run(collisions=200)
    opened = gas.opened(before.to_scene())
    assert opened.box.tolist() == (before.scene.box * [2, 1, 1]).tolist() and opened.labels is None
    back = WayBack(ahead=hs.Simulation(opened))
    for _ in back.go({0: False, 20: False, 100: True, 150: False, 200: True}, 10):
        pass
    assert back.turned == [2, 4] and back.reached == [0.0, 0.4, 2.0, 3.0, 4.0] and back.there == []
    for k, collisions in enumerate((100, 200)):
        sim = hs.Simulation(opened)
        sim.run(collisions=collisions)
        assert sim.time == back.times[back.turned[k]]
        by_hand = hs.Simulation(sim.to_scene().replace(velocities=-sim.velocities))
        by_hand.run(time=sim.time)
        off = by_hand.positions - opened.positions
        off -= np.where(opened.periodic, opened.box * np.rint(off / opened.box), 0.0)
        assert back.distance[k][-1] == np.sqrt((off**2).sum(axis=1).mean())
        assert back.distance[k][0] == 0.0 and 0.0 < back.distance[k][-1] < 1e-4
        assert back.s[k][-1] == pytest.approx(2 * collisions / 100, abs=0.021)
        assert back.crossed[k][-1] == 0.0 and back.counts[k].sum() == 100


@pytest.mark.slow
def test_its_error_bars_are_right():
    """40 studies of 12 gases; 1e-3 for each number. Sibling: errors half as large."""
    runs = {}
    for seed in range(40):
        dilute = {"packing_fraction": 2e-3, "n": 100, "cells": 4, "transits": 8.0, "reverse_after": (0.5,)}
        found = answered(**dilute, seed=seed)
        assert found.failures == []
        for each in found.numbers[:3]:
            runs.setdefault(each.quantity, []).append(each)
    for quantity, several in runs.items():
        measured = [each.measured for each in several]
        truth = several[0].expected if "time" not in quantity else np.mean([each.value for each in measured])
        assert calibrate(measured, truth).passed or "entropy" in quantity  # its error may be too large
        if "entropy" not in quantity:
            small = [replace(each, standard_error=0.5 * each.standard_error) for each in measured]
            assert not calibrate(small, truth).passed
        pulls = [(each.value - truth) / each.standard_error for each in measured]
        assert abs(np.mean(pulls)) < 4.0 * np.std(pulls) / np.sqrt(40) and np.std(pulls) < 1.7


@pytest.mark.parametrize("eta", [1e-4, 0.02])
def test_two_halves_mix(eta):
    """Dilute: as an ideal gas; with collisions: by Enskog's diffusion. Sibling: the other theory there."""
    found = answered(
        n=400, packing_fraction=eta, mix=True, reverse_after=(0.05,) if eta < 1e-3 else (1.0,), transits=6.0
    )
    assert found.failures == []
    z, time = part(found, "spreading", "right_z"), part(found, "spreading", "t")
    assert np.nanmax(np.abs(z)) < 4.0
    assert part(found, "returns", "left_on_return")[0] == 1.0
    free = theory.spread_shares(time, [0.0, 1.0, 2.0], 2.0, 1.0)[:, 1]
    off = np.abs(part(found, "spreading", "right") - free)[1:] / part(found, "spreading", "right_error")[1:]
    assert (off.max() > 4.5) == (eta > 1e-3)


def test_a_study_says_where_it_knows_nothing():
    """Waves in a dense gas outlast a short run; nothing is lost on a short way back."""
    found = answered(packing_fraction=0.2, transits=1.0, reverse_after=(2.0,), replicas=4, n=100)
    assert np.isnan(found["entropy at the end, per particle"].expected)
    assert any("waves have not died out at the end" in note for note in found.notes)
    assert any(note.startswith("every way back was retraced") for note in found.notes)
    assert {each.quantity for each in found.numbers} == {
        "half-time, in transit times",
        "entropy at the end, per particle",
        "variance in the right half, over free ones'",
        "change of kT, relative",
    }


BAD = [
    (["--packing-fraction", "0.6"], "packing fraction 0.6 is above 0.494, where hard spheres freeze"),
    (["--packing-fraction", "0"], "--packing-fraction 0 must be positive"),
    (["--packing-fraction", "nan"], "--packing-fraction nan must be positive"),
    (["--packing-fraction", "1e-300"], "the box edge along x is 8.05996e+100, where rounding moves"),
    (["--packing-fraction", "1e-300", "--mix"], "the box edge along x is 8.05996e+100, where rounding moves"),
    (["--n", "10"], "--n 10 is too few for densities; ask for at least 16"),
    (["--cells", "7"], "--cells 7 is odd; the middle of the box must be an edge of cells"),
    (["--replicas", "3"], "--replicas 3 gives no error bar"),
    (
        ["--reverse-after", "500"],
        "--reverse-after 500 is later than the run, which has about 15 collisions per",
    ),
    (["--reverse-after", "2,x"], "--reverse-after 2,x is not understood; give numbers, as in 2,4,8"),
    (["--reverse-after", "0,2"], "--reverse-after 0,2: each must be positive, a number of collisions per"),
    (["--transits", "-1"], "--transits -1 must be positive and finite: it is how long to run"),
    (["--transits", "1e9"], "--transits 1e+09 would never end; ask for at most 100000"),
    (["--boundary", "soft"], "--boundary soft is not known; it can be periodic or wall"),
]


@pytest.mark.parametrize(("options", "sentence"), BAD)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "expansion", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not list(tmp_path.iterdir())
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1


def test_files_and_page(tmp_path):
    out = OutputFolder(tmp_path / "out")
    summary, sound = conduct(small("expansion"), out, Screen(json_output=True))
    assert sound and {"gas.html", "returns.csv", "way_back.csv"} <= set(summary["files"])
    assert summary["states"][0]["knudsen_number"] == pytest.approx(small("expansion").gases()[0].knudsen)
    page = (out.path / "gas.html").read_text()
    head = json.loads(page.split('id="head">')[1].split("</script>")[0])
    assert head["n"] == 100 and head["box"][0] == pytest.approx(2.0 * head["box"][1])
    assert head["periodic"] == [False, True, True]
