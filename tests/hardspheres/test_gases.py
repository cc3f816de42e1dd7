"""Real gases: each number against SI arithmetic by hand, viscosities, reference equations and the equation of state."""

import math

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from hardspheres import gases
from hardspheres.gases import GASES, PASCAL, TEMPERATURES, RealGas
from studies.real_fluid import RealFluid

K, U = 1.380649e-23, 1.66053907e-27  # J/K, kg


@pytest.mark.parametrize("formula", GASES)
def test_spheres_have_the_viscosity_of_the_gas(formula):
    """Enskog's theory at vanishing density gives the table back; sibling: 1.6 % off without the Sonine factor."""
    for temperature, micro in zip(TEMPERATURES, GASES[formula].viscosities, strict=True):
        gas = RealGas(formula, temperature)
        reduced = float(theory.shear_viscosity(1e-9, 3, gas.diameter, gas.mass, gas.kT).value)
        assert reduced * U / (1e-9 * 1e-12) == pytest.approx(1e-6 * micro, rel=1e-6)


def test_without_the_sonine_factor_the_viscosity_is_wrong(monkeypatch):
    monkeypatch.setattr(gases, "SONINE", 1.0)
    with pytest.raises(AssertionError):
        test_spheres_have_the_viscosity_of_the_gas("Ar")


REFERENCE = {  # uPa s at 273.15 K, and where they come from
    "Ar": (21.00, "Lemmon and Jacobsen 2004, doi 10.1023/B:IJOT.0000022327.04529.f3"),
    "N2": (16.61, "the same"),
    "O2": (19.12, "the same"),
    "H2": (8.38, "Muzny, Huber and Kazakov 2013, doi 10.1021/je301273j"),
    "CO2": (13.70, "Laesecke and Muzny 2017, doi 10.1063/1.4977429"),
    "He": (18.69, "Arp, McCarty and Friend 1998, NIST TN 1334"),
}


@pytest.mark.parametrize("formula", REFERENCE)
def test_between_its_temperatures_the_table_is_good_to_half_a_per_cent(formula):
    value, source = REFERENCE[formula]
    assert 1e6 * RealGas(formula).viscosity == pytest.approx(value, rel=5e-3), source


@pytest.mark.parametrize(("size", "diameter", "path"), [("viscosity", 0.3681, 61.9), ("kinetic", 0.34, 72.5)])
def test_argon_by_hand(size, diameter, path):
    """In SI: density, mean free path, speeds and temperature of the scene that is made."""
    scene = hs.real_gas("Ar", temperature=273.15, pressure=101325, n=200, diameter=size, seed=1)
    d, m = 2e-9 * scene.radii, scene.masses * U
    assert np.allclose(d, diameter * 1e-9, rtol=1e-4) and np.allclose(m, 39.95e-3 / 6.02214076e23, rtol=1e-6)
    density = scene.n / np.prod(scene.box * 1e-9)
    z = 1.0 + 2.0 / 3.0 * math.pi * density * d[0] ** 3  # two virial coefficients
    assert density * K * 273.15 * z == pytest.approx(101325, rel=1e-5)
    assert 1e9 / (math.sqrt(2) * math.pi * density * d[0] ** 2) == pytest.approx(path, rel=3e-3)
    energy = 0.5 * float(m @ ((scene.velocities * 1e3) ** 2).sum(axis=1))
    assert energy == pytest.approx(1.5 * (scene.n - 1) * K * 273.15, rel=1e-7)
    assert scene.dim == 3 and scene.periodic.all()


@pytest.mark.parametrize("pressure", [1e-7, 1.0, 101325.0, 1e7, 8e8])
def test_the_density_gives_the_pressure(pressure):
    """Carnahan and Starling are within 0.3 % of the equation of state that studies compare with."""
    gas = RealGas("Ar", pressure=pressure)
    z = float(theory.compressibility_factor(gas.packing_fraction, 3).value)
    assert gas.number_density * gas.kT * z * PASCAL == pytest.approx(pressure, rel=3e-3)
    exact = float(theory.carnahan_starling(gas.packing_fraction))
    assert gas.number_density * gas.kT * exact * PASCAL == pytest.approx(pressure, rel=1e-12)


def test_a_study_starts_from_the_same_scene():
    """What studies measure is `hs.real_gas`, to the last bit."""
    gas = RealGas("N2", 300.0, 1e5, "kinetic")
    ours = RealFluid.of(50, gas).scene(np.random.SeedSequence(3))
    alone = hs.real_gas("N2", temperature=300.0, pressure=1e5, n=50, diameter="kinetic", seed=3)
    for name in ("positions", "velocities", "radii", "masses", "box"):
        assert getattr(ours, name).tobytes() == getattr(alone, name).tobytes()


def test_what_is_dense_is_grown(monkeypatch):
    called = []
    monkeypatch.setattr(gases, "compressed_gas", lambda **named: called.append(named["packing_fraction"]))
    hs.real_gas("Ar", pressure=3e8, n=50, seed=1)
    assert 0.30 < called[0] < 0.494
    assert hs.real_gas("Ar", pressure=1e6, n=50, seed=1).n == 50 and len(called) == 1


BAD = {
    "unknown": (("argon",), {}, r"the gas 'argon' is not in the table \(did you mean Ar\?\); known are He, Ne"),
    "misspelt": (("co2",), {}, r"did you mean CO2\?"),
    "nothing like it": (("UF6?!",), {}, "the gas 'UF6[?]!' is not in the table; known are"),
    "no text": ((18,), {}, "the gas 18 is not in the table; known are"),
    "cold": (("Ar",), {"temperature": -1.0}, "temperature is -1.0; it must be positive and finite, in kelvin"),
    "true": (("Ar",), {"temperature": True}, "temperature is True; it must be positive"),
    "nan": (("Ar",), {"pressure": math.nan}, "pressure is nan; it must be positive and finite, in Pa"),
    "absurd": (("Ar",), {"pressure": 10**400}, "it must be positive and finite, in Pa"),
    "beyond the table": (("Ar",), {"temperature": 77.0}, "known from 200 to 500 K, not at 77 K; give a diameter"),
    "picometres": (("Ar",), {"diameter": 340.0}, "diameter is 340.0; it must be .* or nm between 0.01 and 10"),
    "a word": (("Ar",), {"diameter": "breck"}, "diameter is 'breck'; it must be \"viscosity\", \"kinetic\""),
    "frozen": (("Ar",), {"pressure": 1e9}, "freeze at 8.9e[+]08 Pa and 273.15 K, and the pressure is 1e[+]09 Pa; ask"),
    "no particles": (("Ar",), {"n": 0}, "n is 0; a scene needs at least one particle"),
    "two dense ones": (("Ar",), {"n": 2, "pressure": 1e8}, "too short for the largest particle"),
}  # fmt: skip


@pytest.mark.parametrize("row", BAD)
def test_bad_input_is_one_sentence(row):
    gas, named, sentence = BAD[row]
    with pytest.raises(hs.SceneError, match=sentence) as caught:
        hs.real_gas(*gas, **{"n": 10, "seed": 1} | named)
    assert "\n" not in str(caught.value)


def test_the_largest_pressure_that_is_named_is_taken():
    assert RealGas("Ar", pressure=8.9e8).packing_fraction == pytest.approx(0.494, abs=1e-3)
    assert RealGas("Ar", 77.0, size="kinetic").diameter == 0.34
    assert RealGas("Ar", 77.0, size=0.4).diameter == 0.4
