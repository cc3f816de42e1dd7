"""Temperature equilibration: physics in standard errors, with siblings that must fail, and refusals."""

import sys

import numpy as np
import pytest
from scipy import stats

from analysis import theory
from analysis.temperatures import TemperatureEquilibration
from studies.cli import main
from studies.mixture import Mixture
from studies.report import Screen
from studies.study import run_study

TINY = {"n": 200, "packing_fraction": 0.02, "mass_ratio": 4.0, "diameter_ratio": 0.5, "replicas": 16}


def replicas_of(study):
    """The study, its gas and the replicas, without its files."""
    (replicas,), _ = run_study(study, Screen(json_output=True))
    return study, *study.gases(), replicas


@pytest.fixture(scope="module")
def finished():
    return replicas_of(Mixture(relaxation_times=1.5, seed=5, workers=1, **TINY))


def test_temperatures_and_rates_agree_with_theory(finished):
    """Six deviations from theory and two rates, as normal deviates: beyond 5 once in 2e5 runs."""
    study, gas, replicas = finished
    answer = study.answer(gas, replicas)
    curves = answer.curves["temperatures"].flat()
    first, second = curves["temperature_1"], curves["temperature_2"]
    assert first[0] / second[0] == pytest.approx(3.0, rel=0.02)
    np.testing.assert_allclose(first + second, 2.0, atol=0.02)  # the energy of all is conserved
    assert np.nanmax(np.abs(curves["difference_z"])) < 5 and answer.failures == []
    names = ["rate of temperature equilibration", "collisions per particle and time"]
    assert [found.quantity for found in answer.numbers] == names and answer.main == names[:1]
    assert all(abs(found.z) < 5 for found in answer.numbers)


def test_wrong_masses_in_theory_fail_the_check(finished, monkeypatch):
    """Sibling: the theory of a mixture with masses 1:30 instead of 1:4."""
    study, gas, replicas = finished
    right = theory.temperature_equilibration
    monkeypatch.setattr(
        theory,
        "temperature_equilibration",
        lambda time, start, densities, diameters, _, dim: right(
            time, start, densities, diameters, np.array([1.0, 30.0]), dim
        ),
    )
    assert any(why.startswith("T1 - T2 is") for why in study.answer(gas, replicas).failures)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_times_of_measurement_are_those_of_the_gas(dim):
    """From options alone, to rounding as from the densities and first temperatures of a gas; sibling: without 1/N."""
    study = Mixture(n=50, dim=dim, packing_fraction=0.05, fraction=0.2, replicas=4)
    (gas,) = study.gases()
    scene = gas.scene(np.random.SeedSequence(1), velocities="two-temperatures")
    counts, first = np.bincount(scene.species), np.unique(scene.species, return_index=True)[1]
    kinetic = np.bincount(scene.species, scene.masses * (scene.velocities**2).sum(axis=1))
    share = counts * (1.0 - scene.masses[first] / scene.masses.sum())
    species = (counts / scene.volume, 2.0 * scene.radii[first], scene.masses[first])

    def rate(start):
        return float(theory.temperature_equilibration_rate(start, *species, dim).sum())

    times = study.times(gas)
    assert len(times) == 17 and times[0] == 0.0
    assert times[4] == pytest.approx(1.0 / rate(kinetic / (dim * share)), rel=1e-12)
    assert times[4] != pytest.approx(1.0 / rate(kinetic / (dim * counts)), rel=1e-3)


def test_a_rate_that_is_lost_in_noise_is_no_main_number(finished, monkeypatch):
    """Two of five gases start the other way round: their spread hides the difference."""
    study, gas, replicas = finished
    right = TemperatureEquilibration.samples.fget
    turned = np.array([[[-1.0]]] * 2 + [[[1.0]]] * 14)

    def samples(self):
        found = right(self)
        middle = found.mean(axis=2, keepdims=True)
        return middle + turned[: len(found)] * (found - middle)

    monkeypatch.setattr(TemperatureEquilibration, "samples", property(samples))
    answer = study.answer(gas, replicas[:5])
    assert [found.quantity for found in answer.numbers] == ["collisions per particle and time"]
    assert "lost in the noise" in answer.main


@pytest.mark.slow
def test_temperatures_follow_the_two_maxwellians():
    """80 gases of 2000 spheres, masses 1:10, diameters 1:2: each p above 1e-4, false once in 500 seeds."""
    study, gas, replicas = replicas_of(Mixture(replicas=80, seed=8))
    answer = study.answer(gas, replicas)
    z = answer.curves["temperatures"].columns["difference"].z
    print(*answer.numbers, z)
    assert answer.failures == []
    assert all(found.p_value > 1e-4 for found in answer.numbers)
    assert np.nanmax(np.abs(z)) < float(stats.t(79).isf(5e-5))
    # the known deviation is towards a slower decay; without it and its uncertainty the measurement still is close
    rate = answer.numbers[0]
    assert 0.9 < rate.measured.value / rate.expected < 1.05
    # sibling: the rate of masses 1:5 at the same densities
    alike = Mixture(mass_ratio=5.0)
    other = alike.times(*alike.gases())[4]
    assert abs(rate.measured.deviation(1.0 / other, 0.04 / other)) > 5


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--mass-ratio", "1", "--diameter-ratio", "1"], "the gas has one species"),
        (["--fraction", "0"], "--fraction 0 of 2000 particles leaves 0 of one species"),
        (["--temperature-ratio", "1"], "--temperature-ratio 1 leaves nothing to equilibrate"),
        (["--relaxation-times", "nan"], "--relaxation-times nan is out of range; ask for 0.5 to 100"),
        (["--packing-fraction", "0.6"], "0.6 is above 0.494, where hard spheres freeze"),
        (["--packing-fraction", "-1"], "must be a number between 0 and 1"),
        (["--replicas", "1"], "--replicas 1 gives no error bar"),
        (["--mass-ratio", "-2"], "must be positive"),
    ],
)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "argv", ["hardspheres", "mixture", *options, "--out", str(out)])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and not out.exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
