"""A precision asked for: the pilot's arithmetic, honest error bars, and what is said when it is not reached."""

import json
import math
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

import hardspheres as hs
from studies import until_error as module
from studies.cli import main
from studies.diffusion import SelfDiffusion
from studies.report import OutputFolder, Screen
from studies.until_error import Number, Plan, main_numbers, until_error

TARGET = 0.02
NAMES = ("mean free path of 1", "mean free path of 2", "mean free time of 1")


@dataclass(frozen=True)
class Coins:
    """A study of random numbers of mean 1 and spread 0.2."""

    replicas: int = 6
    seed: int = 1

    def to_precision(self, target):
        """By more replicas, as most studies."""


def toss(study, out, screen, record=True, conclude=None):
    """Estimate the mean as studies do, from the spread of the replicas."""
    x = np.random.default_rng(study.seed).normal(1.0, 0.2, study.replicas)
    error = float(np.std(x, ddof=1)) / math.sqrt(study.replicas)
    estimate = {"value": float(x.mean()), "standard_error": error, "degrees_of_freedom": study.replicas - 1.0}
    state = {"packing_fraction": 0.1, "main": ["mean"], "measured": [{"quantity": "mean", **estimate}]}
    summary = {"study": "coins", "states": [state], "replicas": study.replicas}
    summary |= {"collisions": 100 * study.replicas, "collisions_per_second_and_core": 1000.0}
    if conclude is not None:
        screen.say(conclude(summary))
    out.create()
    out.write_json("summary.json", summary)
    return summary, True


def deviations(results):
    """How far the means are from 1, in their own standard errors."""
    return np.array([abs(r["value"] - 1.0) / r["standard_error"] for r in results])


def test_error_bars_are_honest_and_the_target_is_reached(tmp_path, capsys):
    """200 studies: 5 % are beyond 1.96 standard errors, 4.5 sigma of that count allowed; the target is missed seldom."""
    outs, screen = [OutputFolder(tmp_path / str(seed)) for seed in range(200)], Screen(json_output=True)
    found = [until_error(Coins(seed=k), TARGET, out, screen, run=toss)[0] for k, out in enumerate(outs)]
    capsys.readouterr()
    z = deviations([summary["states"][0]["measured"][0] for summary in found])
    assert np.sum(z > 1.96) < 0.05 * 200 + 4.5 * math.sqrt(200 * 0.05 * 0.95)
    reached = np.mean([summary["until_error"]["reached"] for summary in found])
    assert reached > 0.8  # 0.9 by the choice of the plan, less for the error's own noise
    assert max(summary["until_error"]["relative_error"] for summary in found) < 3.0 * TARGET
    stored = json.loads((outs[-1].path / "summary.json").read_text())
    assert stored["until_error"]["replicas"] == stored["replicas"]


def test_peeking_would_not_be():
    """Sibling: who adds numbers one by one until the error looks small enough has error bars that are too small."""
    results = []
    for seed in range(400):
        x = np.random.default_rng(seed).normal(1.0, 0.2, 400)
        for n in range(3, 400):
            error = np.std(x[:n], ddof=1) / math.sqrt(n)
            if error < 3.0 * TARGET:
                break
        results.append({"value": x[:n].mean(), "standard_error": error})
    assert np.sum(deviations(results) > 1.96) > 0.05 * 400 + 4.5 * math.sqrt(400 * 0.05 * 0.95)


def test_the_plan():
    exact = Number("Z", 4e-3, math.inf)
    plan = Plan.of([exact, Number("Z", 1e-3, math.inf)], 2, 1e-3)
    assert plan.number is exact and plan.needed == plan.allowed == 33  # 32 and what little is uncertain
    assert Plan.of([Number("Z", 4e-3, 8.0)], 2, 1e-3).needed == math.ceil(32 * 8.0 / chi2.ppf(0.1, 8.0))
    assert Plan.of([exact], 2, 0.1).needed == 4
    bounded = Plan.of([exact], 2, 1e-6)
    assert bounded.allowed == 2000 < bounded.needed
    with pytest.raises(hs.SceneError, match="no error bar; ask for more --replicas"):
        Plan.of([Number("Z", math.nan, 1.0)], 1, 1e-3)


def test_the_main_numbers_are_those_that_the_answers_name():
    found = [
        {"quantity": name, "value": 4.0, "standard_error": 0.02, "degrees_of_freedom": 9.0} for name in NAMES
    ]
    states = [{"packing_fraction": eta, "main": NAMES[:2], "measured": found} for eta in (0.01, 0.1)]
    numbers = main_numbers({"states": states})
    assert [number.name for number in numbers] == [
        f"{name} at packing fraction {eta}" for eta in (0.01, 0.1) for name in NAMES[:2]
    ]
    assert numbers[0].relative_error == pytest.approx(5e-3)
    states[1]["main"] = "a decay rate, and there is none"
    with pytest.raises(hs.SceneError, match="--until-error needs a decay rate, and there is none"):
        main_numbers({"states": states})


def test_a_real_study(tmp_path, capsys):
    study = SelfDiffusion(
        packing_fractions=(0.05,), n=64, collisions_per_particle=80.0, replicas=4, seed=5, workers=1
    )
    out = OutputFolder(tmp_path / "diffusion")
    summary, sound = until_error(study, 0.05, out, Screen())
    told = capsys.readouterr()
    found = summary["until_error"]
    assert sound and found["replicas"] == summary["options"]["replicas"] > 4
    assert found["relative_error"] < 0.1 and found["core_seconds"]["study"] > 0
    assert "asked for 0.05: " in told.out and "the pilot took" in told.out
    assert "pilot: 4 replicas give D of this box" in told.err
    assert sorted(path.name for path in out.path.iterdir()) == sorted(["replicas", *summary["files"]])
    assert json.loads((out.path / "summary.json").read_text())["until_error"]["asked"] == 0.05
    report = (out.path / "report.html").read_text(encoding="utf-8")
    assert "asked for 0.05: " in report and summary["command"].count(f"--replicas {found['replicas']}") == 1


def test_interrupted_it_is_resumed(tmp_path, monkeypatch):
    """With the digest of the whole; sibling: without resume the unfinished run is refused."""
    study = SelfDiffusion(
        packing_fractions=(0.05,), n=64, collisions_per_particle=80.0, replicas=4, seed=5, workers=1
    )
    monkeypatch.setattr(SelfDiffusion, "figures", lambda self, answers: {})
    screen, advance = Screen(json_output=True), SelfDiffusion.advance
    whole, _ = until_error(study, 0.1, OutputFolder(tmp_path / "whole"), screen)

    def interrupted(self, gas, replica):
        if self.seed == 5 and replica.index == 1:  # not of the pilot
            raise InterruptedError
        yield from advance(self, gas, replica)

    with monkeypatch.context() as patch:
        patch.setattr(SelfDiffusion, "advance", interrupted)
        with pytest.raises(InterruptedError) as caught:
            until_error(study, 0.1, OutputFolder(tmp_path / "out"), screen)
    assert len(caught.value.__notes__) == 1 and f"kept in {tmp_path / 'out'}" in caught.value.__notes__[0]
    with pytest.raises(hs.CheckpointError, match="add --resume to continue it"):
        until_error(study, 0.1, OutputFolder(tmp_path / "out"), screen)
    summary, _ = until_error(study, 0.1, OutputFolder(tmp_path / "out", resume=True), screen)
    assert summary["digest"] == whole["digest"] and summary["options"] == whole["options"]


def test_an_interrupted_pilot_is_not_said_to_be_kept(tmp_path, monkeypatch):
    """Nor is a folder made; sibling: the run after it, above, says where it is kept."""
    study = SelfDiffusion(packing_fractions=(0.05,), n=64, replicas=4, workers=1)
    monkeypatch.setattr(SelfDiffusion, "estimators", None)
    with pytest.raises(TypeError) as caught:
        until_error(study, 0.1, OutputFolder(tmp_path / "out"), Screen(json_output=True))
    assert not getattr(caught.value, "__notes__", []) and not list(tmp_path.iterdir())


def test_what_cannot_be_reached_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(module, "MOST", 3)
    summary, _ = until_error(Coins(), 1e-4, OutputFolder(tmp_path / "coins"), Screen(), run=toss)
    told = capsys.readouterr().out
    assert "NOT reached: that needs about" in told and "no more than 18 (3 times the pilot) are run" in told
    assert summary["replicas"] == 18 and not summary["until_error"]["reached"]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["diffusion", "--until-error", "-1"], "--until-error -1 must be between 0 and 1"),
        (
            [
                "thermalise",
                "--n",
                "100",
                "--replicas",
                "4",
                "--collisions-per-particle",
                "1",
                "--until-error",
                "0.1",
            ],
            "needs a decay rate of a2, and there is none",
        ),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(
        sys, "argv", ["hardspheres", *options, "--workers", "1"][: None if len(options) > 3 else -2]
    )
    sys.argv += ["--out", str(out)]
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
