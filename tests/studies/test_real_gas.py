"""--gas: real gases in nm, ps, m/s and Pa, against SI arithmetic by hand; refusals."""

import csv
import json
import math
import sys
from pathlib import Path

import pytest

from hardspheres.gases import DIAMETERS, GASES, RealGas
from studies import real_fluid
from studies.cli import main
from studies.free_path import FreePaths
from studies.report import Screen
from studies.study import run_study

K, M, P, T = 1.380649e-23, 39.95e-3 / 6.02214076e23, 101325.0, 273.15
D = 0.34e-9
N = P / (K * T) / 1.0022  # two virial coefficients: 1 + 2/3 pi n d^3
BY_HAND = {
    "mean free path [nm]": 1e9 / (math.sqrt(2) * math.pi * N * D**2),
    "mean speed [m/s]": math.sqrt(8 * K * T / (math.pi * M)),
    "pressure [Pa]": P,
}
BY_HAND["mean free time [ps]"] = 1e3 * BY_HAND["mean free path [nm]"] / BY_HAND["mean speed [m/s]"]


@pytest.fixture(scope="module")
def replicas():
    study = FreePaths(gas="Ar", diameter="kinetic", n=200, collisions_per_particle=50.0, seed=5, workers=1)
    (own,), _ = run_study(study, Screen(json_output=True))
    return study, own


def agrees(study, own):
    """Whether all numbers with units are within 5 standard errors of those by hand; corrections of order 1/N are allowed for."""
    answer = study.answer(study.gases()[0], own)
    assert {found.quantity for found in answer.numbers if "[" in found.quantity} == set(BY_HAND)
    gaps = [
        abs(answer[name].measured.value - value)
        / math.hypot(answer[name].measured.standard_error, value / 400)
        for name, value in BY_HAND.items()
    ]
    return max(gaps) < 5


@pytest.mark.filterwarnings("ignore:.*samples are too few for an error bar")
def test_free_paths_of_argon_in_si(replicas):
    """Once in 4e5 runs of four numbers false; z is that of theory in the same units."""
    study, own = replicas
    assert agrees(study, own)
    answer = study.answer(study.gases()[0], own)
    assert not answer.failures and all(abs(found.z) < 5 for found in answer.numbers)
    for name, value in BY_HAND.items():
        assert answer[name].expected == pytest.approx(value, rel=4e-3)
    paths = own[0].estimators["paths"]
    assert [note for note in answer.notes[2:] if not note.startswith("mean speed: ")] == []
    assert paths.mean_speed[0].value == pytest.approx(
        paths.mean_free_path[0].value / paths.mean_free_time[0].value, rel=1e-4
    )
    assert answer.main == ["mean free path [nm]"]
    assert answer.notes[0].startswith(
        "the kinetic diameter (Breck 1974), 0.34 nm, gives a mean free path of 72.53 nm"
    )
    assert (
        "from the viscosity (CRC Handbook, Viscosity of gases), 0.3681 nm, would give 61.88 nm"
        in answer.notes[0]
    )
    assert "the mean speed in equilibrium 380.5 m/s" in answer.notes[0]


@pytest.mark.parametrize("name", ["mean free path", "mean free time", "mean speed", "pressure"])
def test_a_wrong_unit_is_seen(name, replicas, monkeypatch):
    """Sibling: a factor that is off by a fifth is far beyond the errors."""
    unit, factor = real_fluid.UNITS[name]
    monkeypatch.setitem(real_fluid.UNITS, name, (unit, 1.2 * factor))
    assert not agrees(*replicas)


SMALL = {
    "free-path": ["--n", "100", "--collisions-per-particle", "20"],
    "diffusion": ["--n", "64", "--collisions-per-particle", "80", "--replicas", "4"],
    "thermalise": ["--n", "1000", "--replicas", "4", "--collisions-per-particle", "5", "--frames", "3"],
}
NUMBERS = {
    "free-path": "mean free path [nm]",
    "diffusion": "D [mm^2/s]",
    "thermalise": "decay rate of a2 in time [1/ns]",
}


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


@pytest.mark.parametrize("name", SMALL)
def test_every_study_of_gases_takes_one(name, tmp_path, monkeypatch, capsys):
    """Names, units and the heading of the results; 100 molecules of nitrogen at 300 K and 2 bar."""
    out = tmp_path / "out"
    gas = ["--gas", "N2", "--temperature", "300", "--pressure", "2e5", "--seed", "5", "--workers", "1"]
    assert not command(monkeypatch, name, *gas, *SMALL[name], "--json", "--out", out)
    told = capsys.readouterr()
    (state,) = json.loads(told.out)["states"]
    assert "N2 molecules, 300 K, 200000 Pa, diameter 0.3727 nm, periodic box" in state["gas"]
    assert "N2 molecules, 300 K, 200000 Pa" in told.err
    measured = {each["quantity"]: each for each in state["measured"]}
    assert abs(measured[NUMBERS[name]]["z"]) < 5
    assert "gives a mean free path of 33" in state["notes"][0]
    if name == "diffusion":  # 1.018954 x 3/(8 n d^2) sqrt(kT / pi m), in SI
        thermal = math.sqrt(K * 300 / (math.pi * 28.014e-3 / 6.02214076e23))
        by_hand = 1e6 * 1.018954 * 3 / 8 * thermal / (2e5 / (K * 300) * 0.3727e-9**2)
        assert measured["D [mm^2/s]"]["expected"] == pytest.approx(by_hand, rel=3e-3)
    if name == "thermalise":
        with (out / "relaxation.csv").open() as handle:
            times = [float(row["time [ps]"]) for row in csv.DictReader(handle)]
        assert times[0] == 0.0 and 5 * 60 < times[-1] < 5 * 85  # 71 ps a collision
        lattice = (out / "trajectory.xyz").read_text().split('"')[1].split()
        assert float(lattice[0]) ** 3 == pytest.approx(1000 / (2e5 / (K * 300)) * 1e27, rel=6e-3)


def test_the_table_of_the_readme():
    """Diameters and mean free paths of all gases, to the last digit."""
    lines = (Path(__file__).parents[2] / "studies" / "README.md").read_text(encoding="utf-8").splitlines()
    table = lines[next(k for k, line in enumerate(lines) if line.startswith("| 273.15 K, 101325 Pa")) :]
    head, _, *rows = ([cell.strip() for cell in line.split("|")[2:-1]] for line in table[:6])
    assert head == [*GASES]
    gases = [RealGas(formula, size=size) for size in DIAMETERS for formula in GASES]
    said = (
        [f"{gas.diameter:.3f}" for gas in gases],
        [f"{real_fluid.mean_free_path(gas):.1f}" for gas in gases],
    )
    assert (rows[0] + rows[2], rows[1] + rows[3]) == said


def test_without_a_gas_nothing_has_units():
    study = FreePaths(n=200, packing_fractions=(0.002,), collisions_per_particle=20.0, workers=1)
    gas = study.gases()[0]
    assert gas.units == {"diameter": 1.0, "mass": 1.0, "temperature": 1.0}
    assert gas.named("mean free path") == "mean free path" and gas.remarks == []


EXCLUDED = [
    ("free-path", ["--packing-fraction", "0.1"], "--packing-fraction has no effect with --gas, whose density follows"),
    ("diffusion", ["--packing-fraction", "0.1,0.3"], "--packing-fraction has no effect with --gas, whose density"),
    ("thermalise", ["--packing-fraction", "0.1"], "--packing-fraction has no effect with --gas, whose density follows"),
    ("free-path", ["--dim", "2"], "--dim has no effect with --gas, which has three dimensions"),
    ("thermalise", ["--dim", "2"], "--dim has no effect with --gas, which has three dimensions"),
    ("free-path", ["--mass-ratio", "2"], "--mass-ratio has no effect with --gas, which has one kind of molecule"),
    ("free-path", ["--fraction", "0.2"], "--fraction has no effect with --gas, which has one kind of molecule"),
    ("thermalise", ["--diameter-ratio", "2"], "--diameter-ratio has no effect with --gas, which has one kind"),
    ("thermalise", ["--from", "gas.xyz"], "--from has no effect with --gas, which makes its own structure"),
    ("free-path", ["--temperature", "-3"], "--temperature -3 must be positive and finite: it is the temperature of"),
    ("thermalise", ["--temperature", "-3"], "temperature is -3.0; it must be positive and finite, in kelvin"),
    ("diffusion", ["--pressure", "nan"], "--pressure nan must be positive and finite: it is the pressure of --gas"),
    ("diffusion", ["--pressure", "1e9"], "freeze at 8.9e+08 Pa and 273.15 K, and the pressure is 1e+09 Pa; ask"),
    ("diffusion", ["--diameter", "big"], "--diameter big is not known; it can be viscosity or kinetic, or a number"),
    ("free-path", ["--diameter", "-1"], 'diameter is -1.0; it must be "viscosity", "kinetic", or nm between'),
    ("free-path", ["--temperature", "77"], "the diameter of Ar from its viscosity is known from 200 to 500 K"),
]  # fmt: skip
WITHOUT = [
    ("free-path", ["--temperature", "300"], "--temperature goes with --gas, as in --gas Ar"),
    ("diffusion", ["--pressure", "1e5"], "--pressure goes with --gas, as in --gas Ar"),
    ("thermalise", ["--diameter", "kinetic"], "--diameter goes with --gas, as in --gas Ar"),
    ("free-path", ["--gas", "argon"], "the gas 'argon' is not in the table (did you mean Ar?); known are He, Ne, Ar"),
]  # fmt: skip
BAD = [(name, ["--gas", "Ar", *more], sentence) for name, more, sentence in EXCLUDED] + WITHOUT


@pytest.mark.parametrize(("name", "options", "sentence"), BAD)
def test_bad_input_is_one_sentence(name, options, sentence, tmp_path, monkeypatch, capsys):
    code = command(monkeypatch, name, *options, "--out", tmp_path / "out")
    told = capsys.readouterr()
    assert code == 2 and told.out == "" and not (tmp_path / "out").exists()
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
