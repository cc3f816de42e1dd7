"""Melting discs: two starts in one box, pressures beside Monte Carlo, and words that say when a run is too short."""

import math
import sys

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.hexatic import local_order
from analysis.statistics import Estimate
from studies.cli import main
from studies.figures.melting import order_colours
from studies.fluid import Fluid
from studies.melting import ORDER, ORDERS, PRESSURE, PRESSURES, TIME, Melting
from studies.two_starts import Discs


def answered(**options):
    study = Melting(**{"workers": 1, "seed": 4} | options)
    return study, study.answers()


def seed(index):
    return np.random.SeedSequence(7, spawn_key=(index,))


@pytest.mark.parametrize(
    ("n", "columns", "rows"), [(224, 14, 16), (870, 29, 30), (4096, 64, 64), (65536, 256, 256)]
)
def test_the_box_holds_the_lattice_whole(n, columns, rows):
    """Of Li et al. for 870 discs; each disc of the crystal has six neighbours at one distance."""
    discs = Discs(n, packing_fraction=0.7)
    assert discs.lattice == (columns, rows) and discs.ratio == pytest.approx(
        columns / (rows * math.sqrt(0.75))
    )
    assert math.pi / 4.0 * n / discs.box.prod() == pytest.approx(0.7, rel=1e-12)
    if n < 1000:
        scene = discs.scene(seed(1))
        assert local_order(scene.positions, scene.box) == pytest.approx(1.0, abs=1e-9)


def test_starts_alternate_in_the_same_box():
    """Fluid, crystal, fluid ...; the fluid has no order, and another seed is another fluid."""
    discs = Discs(224, packing_fraction=0.7)
    scenes = [discs.scene(seed(k)) for k in range(3)]
    orders = [abs(local_order(scene.positions, scene.box).mean()) for scene in scenes]
    assert orders[1] == pytest.approx(1.0) and max(orders[::2]) < 0.6 and orders[0] != orders[2]
    for scene in scenes:
        assert scene.box.tolist() == discs.box.tolist() and scene.temperature == pytest.approx(1.0)
        hs.Simulation(scene).check()
    alone = Discs(224, packing_fraction=0.7, starts=("crystal",))
    assert [alone.start_of(seed(k)) for k in range(3)] == ["crystal"] * 3


@pytest.fixture(scope="module")
def small():
    """224 discs at 0.67, from both starts: a fluid that has melted and forgotten both."""
    return answered(n=224, packing_fractions=(0.67,), collisions_per_particle=24_000.0, equilibration=3000.0)


def test_a_small_fluid_has_the_pressure_of_monte_carlo_from_both_starts(small):
    """Two-sided at z = 3.5 for each of three numbers, false alarm 1.4e-3. Sibling: that at 0.68 is far away."""
    study, (answer,) = small
    found = answer[PRESSURE]
    assert found.theory == "Li et al. 2022" and found.expected == 7.979479
    assert abs(found.z) < 3.5 and abs(answer[PRESSURES].z) < 3.5 and abs(answer[ORDERS].z) < 3.5
    assert found.measured.standard_error < 0.05 and answer.failures == []
    assert abs(found.measured.deviation(theory.disc_pressure(0.68, 224)[1].value)) > 8.0
    assert answer.details["long_enough"] and answer.notes[0].startswith("long enough: Psi6 lasts for ")
    assert answer[TIME].measured.value < 24_000.0 / 20.0
    assert "theory: Li et al. 2022, as many discs" in study.legend([answer])[0]
    both = answer.details["starts"]
    assert list(both) == ["fluid", "crystal"] and both["fluid"] != both["crystal"]


def test_curves_go_from_the_start_to_the_end(small):
    """|Psi6| from either start, 1 of the crystal; g6 of both together and of each."""
    _, (answer,) = small
    path = answer.curves["order"].flat()
    measured = path["measured"].astype(bool)
    assert path["collisions_per_particle"][0] == 0.0 and path["collisions_per_particle"][-1] == 27_000.0
    assert path["collisions_per_particle"][measured][0] == 3000.0 and np.all(np.diff(measured) >= 0)
    assert path["crystal"][0] == pytest.approx(1.0) and path["fluid"][0] < 0.7
    both = [path[name][measured].mean() for name in ("fluid", "crystal")]
    assert answer[ORDER].measured.value == pytest.approx(np.mean(both), rel=0.02)
    g6 = answer.curves["g6"].flat()
    assert list(g6) == ["r", "g6", "g6_error", "g6_fluid", "g6_fluid_error", "g6_crystal", "g6_crystal_error"]
    assert g6["g6"][0] > 0.25 > abs(g6["g6"][-1]) and np.all(g6["g6_error"] > 0.0)


def test_too_short_a_run_says_so_and_fails_no_check():
    """At 0.72, a crystal that never turns: z beside Monte Carlo is shown, and is no failure. Sibling: above."""
    _, (answer,) = answered(
        n=224, packing_fractions=(0.72,), collisions_per_particle=300.0, equilibration=0.0
    )
    assert not answer.details["long_enough"] and answer.failures == []
    assert answer.notes[0].startswith("too short: Psi6 lasts for ")
    assert "pressure and order may be those of the start" in answer.notes[0]
    assert answer[PRESSURE].theory == "Li et al. 2022"


VERDICTS = [  # correlation time, deviations of pressure and order, both starts?
    (
        100.0,
        0.5,
        -1.0,
        "both",
        True,
        "long enough: Psi6 lasts for 100 collisions per particle, a run holds 100 such times",
    ),
    (
        10.0,
        0.5,
        -1.0,
        "both",
        True,
        "long enough: Psi6 lasts for at most 10 collisions per particle, a run holds",
    ),
    (600.0, 0.5, -1.0, "both", False, "too short: Psi6 lasts for 600 collisions per particle or more"),
    (
        100.0,
        5.0,
        -1.0,
        "both",
        False,
        "too short: the starts do not agree, P, fluid - crystal is +5.0 standard",
    ),
    (100.0, 0.5, -4.0, "both", False, "too short: the starts do not agree, |Psi6|, fluid - crystal is -4.0"),
    (100.0, 0.0, 0.0, "crystal", False, "Psi6 lasts for 100 collisions per particle, but there is one start"),
]


@pytest.mark.parametrize(("time", "pressure", "order", "starts", "enough", "words"), VERDICTS)
def test_the_verdict(time, pressure, order, starts, enough, words):
    from studies.answer import number

    study = Melting(collisions_per_particle=10_000.0, starts=starts)
    numbers = [
        number(PRESSURES, Estimate(pressure, 1.0), expected=0.0),
        number(ORDERS, Estimate(order, 1.0), expected=0.0),
    ]
    beside = numbers if starts == "both" else []
    found, said = study._verdict(Estimate(time, 1.0), False, beside)
    assert found == enough and said.startswith(words)
    found, said = study._verdict(Estimate(time, 1.0), True, beside)  # blocks of another number are too long
    assert not found and said.startswith("too short: ")


BAD = [
    (
        ["--n", "1000"],
        "--n 1000 discs make no whole triangular lattice in a nearly square box; ask for 992 = 31 x 32 or",
    ),
    (["--n", "12"], "--n 12 is out of range; ask for at least 64"),
    (
        ["--packing-fraction", "0.3"],
        "packing fraction 0.3 is below 0.6, far in the fluid; discs melt near 0.7",
    ),
    (["--replicas", "1"], "--start both needs --replicas 2 or more: one from a fluid, one from a crystal"),
    (["--start", "glass"], "--start glass is not known; it can be both, crystal or fluid"),
    (["--collisions-per-particle", "5"], "--collisions-per-particle 5 is too short for any order to change"),
    (["--equilibration", "-1"], "--equilibration -1.0 is out of range; ask for 0 to 1000000000"),
    (["--equilibration", "1e12"], "--equilibration 1000000000000.0 is out of range; ask for 0 to 1000000000"),
]


@pytest.mark.parametrize(("options", "sentence"), BAD)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "melting", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and told.err.count("\n") == 1
    assert told.err.startswith("error: ") and sentence in told.err
    assert list(tmp_path.iterdir()) == []


def test_colours_tell_the_direction_and_nothing_is_dark():
    """Equal lightness at all directions, the same colour after 60 degrees, dark without order."""
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = order_colours(np.exp(1j * angle))
    linear = np.where(circle <= 0.04045, circle / 12.92, ((circle + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    assert circle[0] == pytest.approx(circle[-1]) and np.ptp(luminance) < 0.12
    apart = np.linalg.norm(circle[:-1] - np.roll(circle[:-1], 12, axis=0), axis=1)
    assert apart.min() > 0.25  # opposite directions
    assert order_colours(np.zeros(1, complex)).max() < 0.25 < luminance.min() + 0.01
    assert np.all((circle >= 0.0) & (circle <= 1.0))


def test_figures_of_many_discs_and_of_one_start(tmp_path, monkeypatch):
    """A single density from a single start; gaps are dark only where a disc is some pixels wide."""
    one = {"starts": "crystal", "replicas": 1, "collisions_per_particle": 100.0, "equilibration": 0.0}
    study, answers = answered(n=870, packing_fractions=(0.7,), **one)
    assert [each.quantity for each in answers[0].numbers][:2] == [PRESSURE, ORDER]
    assert "one start" in answers[0].notes[0] or "too short" in answers[0].notes[0]
    darkest = []
    for pixels in (520, 100):
        monkeypatch.setattr("studies.figures.melting.PIXELS", pixels)
        figure = study.figure(answers)
        figure.savefig(tmp_path / "many.png")
        darkest.append(float(figure.axes[0].images[0].get_array().min()))
    assert darkest[0] < 0.09 < darkest[1]


def test_kernels_are_compiled_with_few_discs():
    """Of a whole lattice, too."""
    from studies.fluid import representatives

    (few,) = representatives([Discs(65536, packing_fraction=0.7)])
    assert isinstance(few, Fluid) and few.n == 2000 and few.lattice == (40, 50)


@pytest.mark.slow
def test_pressures_of_870_discs_are_those_of_monte_carlo():
    """Li et al. 2022 at 0.67, 0.68 and 0.69, in their box, from both starts, which agree.

    Nine numbers two-sided at z = 3.5: false alarm 4e-3. Sibling: pressures of 224 discs at 0.68 and 0.69, and
    of the neighbouring density.
    """
    _, answers = answered(
        n=870, packing_fractions=(0.67, 0.68, 0.69), collisions_per_particle=60_000.0, equilibration=10_000.0
    )
    for answer, expected in zip(answers, (7.986735, 8.513233, 8.969476), strict=True):
        found = answer[PRESSURE]
        assert found.expected == expected and abs(found.z) < 3.5
        assert found.measured.standard_error < 0.03
        assert abs(answer[PRESSURES].z) < 3.5 and abs(answer[ORDERS].z) < 3.5
        assert answer.failures == []
        wrong = theory.disc_pressure(answer.gas.packing_fraction + 0.01, 870, answer.gas.ratio)[1].value
        assert found.measured.deviation(wrong) < -6.0
    few = theory.disc_pressure(0.69, 224)[1].value
    assert answers[-1][PRESSURE].measured.deviation(few) > 4.0
