"""`hardspheres verify`: the golden digests hold here, and whatever is wrong is found, named, and exit code 1."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from llvmlite import binding

import hardspheres as hs
from hardspheres.collision import elastic_collision
from hardspheres.engine import Engine
from hardspheres.reference import ReferenceSimulation
from studies import cli
from studies.validation import calibration_runs, verify
from studies.validation.golden import GOLDEN
from studies.validation.processor import compiled_for, vectors_of
from studies.validation.verify import Found, digests_of, verdict

QUICK = [golden for golden in GOLDEN if golden.quick]
BOTH = QUICK[0]


@pytest.mark.parametrize("golden", QUICK, ids=lambda golden: golden.name)
def test_golden_digests(golden):
    assert digests_of(golden).verdict == "ours"


@pytest.mark.slow
@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_all_golden_digests(golden):
    assert digests_of(golden).verdict == "ours"


def test_they_are_twenty_and_the_quick_ones_of_all_kinds():
    scenes = [golden.make() for golden in QUICK]
    assert len({golden.name for golden in GOLDEN}) == len(GOLDEN) == 20 and len(QUICK) == 8
    assert {scene.dim for scene in scenes} == {2, 3}
    assert {bool(scene.periodic.all()) for scene in scenes} == {True, False}
    assert {bool(np.ptp(scene.masses)) for scene in scenes} == {True, False}


def test_one_bit_of_a_start_is_seen():
    def other():
        scene = BOTH.make()
        positions = scene.positions.copy()
        positions[7, 1] = np.nextafter(positions[7, 1], 0.0)
        return scene.replace(positions=positions)

    found = digests_of(replace(BOTH, make=other))
    assert found.verdict == "THE START DIFFERS" and found.start != BOTH.start
    assert BOTH.end not in found.ends.values()


@pytest.mark.parametrize(
    ("searches", "sentence"),
    [(("lists", "windows"), "THE DYNAMICS DIFFERS"), (("windows",), "THE SEARCHES DIFFER")],
)
def test_one_bit_of_a_constant_of_the_kernels_is_seen(searches, sentence, monkeypatch):
    """The square of the diameter, one rounding larger, in both searches or in one."""
    plan = Engine._plan

    def planned(self, length, number, count):
        plan(self, length, number, count)
        if type(self.search).__name__.lower() in searches:
            number[self.layout.SIGMA2] = np.nextafter(number[self.layout.SIGMA2], np.inf)

    monkeypatch.setattr(Engine, "_plan", planned)
    assert digests_of(BOTH).verdict.startswith(sentence)


def test_what_breaks_is_named(monkeypatch):
    def broken(_):
        raise hs.InvariantError("a thing broke")

    monkeypatch.setattr(hs.Simulation, "check", broken)
    assert digests_of(BOTH).verdict == "BROKEN, lists: a thing broke; windows: a thing broke"


def test_verdicts():
    good = Found("good", "a", {"lists": "b"}, "ours")
    start, end = (
        replace(good, name="one", verdict="THE START DIFFERS"),
        replace(good, name="two", verdict="THE D"),
    )
    version = f"hardspheres {hs.__version__}"
    ours = f"All 2 digests are those of {version}: numbers from this machine are ours to the last bit"
    assert verdict([good, good], []) == f"{ours}."
    assert verdict([good, good], ["energy: lost"]) == f"{ours}, but 1 other check failed (energy: lost)."
    told = verdict([good, start], [])
    assert told.startswith(f"1 of 2 gases start elsewhere than those of {version} (one): NumPy ")
    assert told.endswith("the dynamics of the other 1 is ours to the last bit.")
    told = verdict([good, start, end], [])
    assert told.startswith(f"1 of 3 digests are not those of {version} (two): the dynamics differs")


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "verify", "--quick", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code or 0


def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verify, "GOLDEN", QUICK[-1:])
    monkeypatch.setattr(verify, "QUICK_ORACLES", ())
    assert command(monkeypatch) == 0
    told = capsys.readouterr().out
    last = f"All 1 digests are those of hardspheres {hs.__version__}: numbers from this machine are ours to the last bit."
    assert told.endswith(f"{last}\n") and "FAILED" not in told
    assert all(f"\n{word}" in f"\n{told}" for word in ("machine  ", "compiled  ", "versions  "))
    assert not list(tmp_path.iterdir())

    monkeypatch.setattr(verify, "_oracles", lambda *_: ())
    monkeypatch.setattr(verify, "_invariants", lambda *_: ())
    monkeypatch.setattr(verify, "GOLDEN", [replace(QUICK[-1], end="0123456789abcdef")])
    assert command(monkeypatch, "--json", "--out", "here") == 1
    summary = json.loads(capsys.readouterr().out)
    assert summary == json.loads((tmp_path / "here" / "summary.json").read_text())
    assert summary["checks"] == {"passed": False, "failures": [f"{QUICK[-1].name}: THE DYNAMICS DIFFERS"]}
    assert "do not trust numbers from this machine" in summary["verdict"]
    assert command(monkeypatch, "--out", "here") == 2
    assert "here holds a finished run" in capsys.readouterr().err


def test_a_broken_rule_is_seen(monkeypatch):
    """Collisions that turn a millionth too little, in the solver beside which the engine is set; sibling: the right one."""
    monkeypatch.setattr(verify, "QUICK_ORACLES", ("mixture of discs between walls",))
    assert all(case.passed for case in verify._oracles(True))

    def broken(m1, v1, m2, v2, r):
        w1, w2 = elastic_collision(m1, v1, m2, v2, r)
        return [a + 1e-6 * (b - a) for a, b in zip(w1, v1, strict=True)], w2

    monkeypatch.setattr(
        verify, "ReferenceSimulation", lambda scene: ReferenceSimulation(scene, collide=broken)
    )
    assert not any(case.passed for case in list(verify._oracles(True))[:1])


def test_wrong_error_bars_are_seen(monkeypatch):
    """Half of what they should be. Sibling: as they are; a false alarm at one of 1e4 seeds."""
    (case,) = verify._calibration(True, 1)
    assert case.passed
    measure = calibration_runs.measure

    def small(item):
        return {
            name: replace(its, standard_error=its.standard_error / 2) for name, its in measure(item).items()
        }

    monkeypatch.setattr(calibration_runs, "measure", small)
    (case,) = verify._calibration(True, 1)
    assert not case.passed


@pytest.mark.skipif("x86_64" not in binding.get_process_triple(), reason="names of processors")
def test_vectors_are_read_from_machine_code():
    triple = compiled_for()[0]
    found = [
        vectors_of(triple, name, "") for name in ("x86-64-v4", "x86-64-v3", "haswell", "x86-64", "generic")
    ]
    assert found == ["AVX-512", "AVX2", "AVX2", "generic", "generic"]
    assert vectors_of(triple, "x86-64", "+avx2") == "AVX2"
