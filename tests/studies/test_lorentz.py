"""A Lorentz gas: numbers beside theory on lattices and at random, bad input, the page."""

import json
import math
import sys

import numpy as np
import pytest

from studies.cli import main
from studies.lorentz import Lorentz
from studies.obstacle_course import ObstacleCourse
from studies.report import OutputFolder, Screen
from studies.study import conduct, run_study

from .test_every_study import small


def answered(**options):
    study = Lorentz(**{"replicas": 8, "seed": 3, "workers": 1, "collisions_per_particle": 5000.0} | options)
    gases = study.gases()
    replicas, _ = run_study(study, Screen(True))
    return study, [study.answer(gas, own) for gas, own in zip(gases, replicas, strict=True)]


def test_a_triangular_lattice():
    """Free path exact, D near that of random hops; two-sided at z = 3.5, false alarm 5e-4 each.

    Sibling: the free path for obstacles without the particle's radius, which the engine does not have.
    """
    study, (answer,) = answered(packing_fractions=(0.8,), size=0.2)
    assert answer.failures == []
    path, spread = answer["mean free path"], answer["diffusion coefficient"]
    assert abs(path.z) < 3.5 and abs(spread.z) < 3.5
    gas = answer.gas
    large, small = gas.radii
    assert small == pytest.approx(0.2 * large) and large + small == pytest.approx(gas.reach)
    cell = math.sqrt(3.0) / 2.0
    assert path.expected == pytest.approx((cell - math.pi * gas.reach**2) / (2.0 * gas.reach))
    alone = (cell - math.pi * large**2) / (2.0 * large)
    assert abs(path.measured.deviation(alone)) > 50.0
    assert 0.9 < answer["Lyapunov exponent per collision"].measured.value < 1.05
    assert "no diffusion" not in " ".join(study.legend([answer]))


def test_sinais_billiard():
    """Free path and exponent at two radii; no diffusion coefficient, since flights can be endless."""
    study, answers = answered(obstacles="square", packing_fractions=(0.2827, 0.5026))
    for answer, exponent in zip(answers, (2.38, 1.70), strict=True):
        assert answer.failures == []
        assert abs(answer["mean free path"].z) < 3.5
        found = answer["Lyapunov exponent per collision"]
        assert abs(found.z) < 3.5 and found.expected == pytest.approx(exponent, rel=2e-3)
        assert [each.quantity for each in answer.numbers] == [
            "mean free path",
            "Lyapunov exponent per collision",
        ]
    rising = [answers[0].curves["displacement"].flat()["diffusion"][k] for k in (8, -1)]
    assert rising[1] > 1.3 * rising[0]
    assert "no diffusion coefficient where flights can be endless" in " ".join(study.legend(answers))


def test_obstacles_at_random():
    """A few that overlap, others in each run: over all of them the mean free path is exact for so many.

    Beyond the range of other theories a note says so. Sibling: the free volume as if no obstacles overlapped.
    """
    _, (answer,) = answered(
        obstacles="random", n=16, packing_fractions=(0.5,), replicas=60, collisions_per_particle=600.0
    )
    path = answer["mean free path"]
    assert abs(path.z) < 3.5 and answer.failures == []
    gas = answer.gas
    assert path.expected == pytest.approx((16.0 - math.pi * gas.reach**2) / (32.0 * gas.reach))
    assert abs(path.measured.deviation((16.0 - 16.0 * math.pi * gas.reach**2) / (32.0 * gas.reach))) > 8.0
    assert len(answer.notes) == 2 and all("from 0 to 0.3" in note for note in answer.notes)


def test_starts_are_uniform_where_the_particle_fits():
    """Mean and share of a half of the places of 400 starts; none within reach of an obstacle."""
    gas = ObstacleCourse("random", 2, 0.4, 30, 0.1)
    scenes = [gas.scene(np.random.SeedSequence(4, spawn_key=(k,))) for k in range(400)]
    places = np.array([scene.positions[-1] for scene in scenes]) / gas.box
    assert abs(places.mean() - 0.5) < 4.0 / math.sqrt(12 * 800)
    for scene in scenes[:20]:
        assert scene.n_moving == 1 and np.linalg.norm(scene.velocities[-1]) == pytest.approx(1.0)
        apart = scene.positions[:-1] - scene.positions[-1]
        apart -= scene.box * np.rint(apart / scene.box)
        assert np.linalg.norm(apart, axis=1).min() > gas.reach
    counts = [scene.positions[:-1, 0].mean() for scene in scenes]
    assert np.std(counts) > 0.1  # other obstacles in each


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"obstacles": "random", "packing_fractions": (0.1,)}, {"obstacles": "square"}]
)
def test_in_3d(options):
    """Free path exact; D and exponent of obstacles at random near those of dilute ones."""
    more = {"dim": 3, "packing_fractions": (0.4,), "replicas": 12, "collisions_per_particle": 10_000.0}
    _, (answer,) = answered(**(more | options))
    assert answer.failures == []
    assert all(abs(found.z) < 3.5 for found in answer.numbers if np.isfinite(found.z))
    assert len(answer.numbers) == (3 if options["obstacles"] == "random" else 2)


def test_a_page_shows_the_particle(tmp_path):
    out = OutputFolder(tmp_path / "out")
    summary, sound = conduct(small("lorentz"), out, Screen(json_output=True))
    assert sound and "gas.html" in summary["files"]
    page = (out.path / "gas.html").read_text()
    assert "<title>1 among 16 obstacles: hard discs, periodic box" in page
    head = json.loads(page.split('id="head">')[1].split("</script>")[0])
    assert head["n"] == 17 and head["events"] == 200


BAD = [
    (
        ["--obstacles", "hexagonal"],
        "--obstacles hexagonal is not known; it can be triangular, square or random",
    ),
    (
        ["--dim", "3"],
        "--obstacles triangular is a lattice of discs; in 3D ask for square, which is simple cubic",
    ),
    (["--n", "100"], "--n 100 needs --obstacles random: a lattice is endless in any box"),
    (["--obstacles", "random", "--n", "10"], "--n 10 is out of range; ask for at least 16"),
    (
        ["--obstacles", "square", "--packing-fraction", "0.79"],
        "packing fraction 0.79 is above 0.78, just below pi/4",
    ),
    (["--size", "0"], "--size 0.0 is out of range; ask for 1e-06 to 1"),
    (["--replicas", "3"], "--replicas 3 gives no error bar"),
    (
        ["--collisions-per-particle", "100"],
        "--collisions-per-particle 100 is too short to see the particle diffuse",
    ),
]


@pytest.mark.parametrize(("options", "sentence"), BAD)
def test_bad_input_is_one_sentence(options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "lorentz", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == "" and sentence in told.err and told.err.count("\n") == 1
    assert not list(tmp_path.iterdir())
