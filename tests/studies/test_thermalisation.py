"""The study end to end: the physics against the Boltzmann equation, with siblings that must fail, and its files."""

import csv
import json
import math

import ase.io
import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.relaxation import RelaxationCurve
from analysis.statistics import compare_with_theory
from hardspheres.collision import elastic_collision
from hardspheres.files import Reading
from hardspheres.reference import ReferenceSimulation
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds, run_replicas
from studies.thermalisation import Recipe, Replicas, Thermalisation, sampling_points, thermalise


def relaxation(recipe, s, replicas, seed, workers=1):
    results = run_replicas(
        Replicas(recipe, s), list(enumerate(replica_seeds(seed, replicas))), workers=workers
    )
    assert not any(result.failure for result in results)
    curve = RelaxationCurve()
    for result in results:
        curve.merge(result.curve)
    return curve


def sonine_p_value(curve):
    """p of the near-equilibrium exponential a2(0) exp(-8s/15), exp(-s/2) in 2D, which is wrong from this start."""
    wrong = -2 / (curve.dim + 2) * np.exp(-theory.sonine_rate(curve.dim) * curve.s)
    return compare_with_theory(curve.a2_samples[:, 1:], wrong[1:]).p_value


@pytest.mark.parametrize("dim", [2, 3])
def test_equal_speeds_relax_as_the_boltzmann_equation_says(dim):
    """40 000 particles in 40 replicas; p < 0.001 once in 1000 seeds."""
    s = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0)
    curve = relaxation(Recipe(n=1000, dim=dim), s, replicas=40, seed=dim)
    comparison = curve.compare()
    assert comparison.chi_square.p_value > 1e-3
    assert np.nanmax(np.abs(comparison.a2_z)) < 4
    assert np.nanmax(np.abs(comparison.ks_z)) < 4.5
    assert np.nanmax(np.abs(comparison.h_z)) < 4.5
    expected = theory.equal_speeds_decay_rate(dim)
    assert abs(curve.fit_rate().deviation(expected.value, expected.uncertainty)) < 4
    assert sonine_p_value(curve) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_relaxation_at_full_size(dim):
    """400 000 particles in 100 replicas at packing fraction 0.005: the same statements, three times as sharp."""
    curve = relaxation(
        Recipe(n=4000, dim=dim), sampling_points(10.0, 4000), replicas=100, seed=10 + dim, workers=None
    )
    comparison = curve.compare()
    print(f"{dim}D: {comparison.chi_square}, rate {curve.fit_rate()}")
    assert comparison.chi_square.p_value > 1e-3
    assert np.nanmax(np.abs(comparison.h_z)) < 4.5
    expected = theory.equal_speeds_decay_rate(dim)
    assert abs(curve.fit_rate().deviation(expected.value, expected.uncertainty)) < 4
    assert sonine_p_value(curve) < 1e-9


def told(recipe, folder, capsys, end=3.0, replicas=8):
    study = Thermalisation(recipe, collisions_per_particle=end, replicas=replicas, frames=0, workers=1)
    summary, _ = thermalise(study, OutputFolder(folder), Screen())
    return summary, capsys.readouterr().out


def test_beams_are_shown_along_their_direction(tmp_path, capsys):
    """The table, the file and the figure have T_par/T beside the Boltzmann equation; along x (sibling) it is another."""
    summary, text = told(
        Recipe(n=500, packing_fraction=0.001, velocities="beams"), tmp_path / "beams", capsys
    )
    assert "T_par/T  theory     z" in text and "not in equilibrium yet at s = 3: " in text
    table = summary["relaxation"]
    assert table["temperature_parallel"][0] == pytest.approx(3.0)
    assert np.nanmax(np.abs(table["temperature_parallel_z"])) < 4
    assert table["temperature_x"][0] == pytest.approx(3 * hs.velocities.BEAM_DIRECTION[3][0] ** 2, rel=0.02)
    late = {check["quantity"]: check for check in summary["thermal"]["checks"]}
    assert not summary["thermal"]["passed"] and not late["a2"]["thermal"]


def test_a_mixture_of_two_temperatures_is_not_thermal_yet(tmp_path, capsys):
    """a2, KS and H of all together are noise when T1 still differs from T2; at equilibrium (sibling) nothing is said of it."""
    mixed = Recipe(n=200, velocities="two-temperatures", mass_ratio=7.0, diameter_ratio=0.6)
    summary, text = told(mixed, tmp_path / "mixture", capsys)
    assert (
        "not in equilibrium yet at s = 3: " in text and "T1/T = " in text.split("not in equilibrium yet")[1]
    )
    assert [check["thermal"] for check in summary["thermal"]["checks"]] == [True, False, False]
    calm = Recipe(n=200, velocities="maxwell", mass_ratio=7.0, diameter_ratio=0.6)
    summary, text = told(calm, tmp_path / "calm", capsys)
    assert summary["thermal"]["passed"] and "is indistinguishable from one in equilibrium" in text


def test_two_replicas_make_no_discovery(tmp_path, capsys):
    """All z of a table of two replicas are within 4; in standard errors (sibling) some are far beyond."""
    summary, _ = told(Recipe(n=500), tmp_path / "two", capsys, end=5.0, replicas=2)
    table = {name: np.array(column, float) for name, column in summary["relaxation"].items()}
    assert np.nanmax(np.abs([table["a2_z"], table["ks_z"]])) < 4
    error = np.where(table["a2_error"] > 0, table["a2_error"], np.nan)
    assert np.nanmax(np.abs(table["a2"] - table["a2_boltzmann"])[1:] / error[1:]) > 4


def always_head_on(m1, v1, m2, v2, r):
    """Collide along the relative velocity instead of the line of centres: conserves all that a collision conserves."""
    g = [b - a for a, b in zip(v1, v2, strict=True)]
    return elastic_collision(m1, v1, m2, v2, g)


@pytest.mark.parametrize(("collide", "accepted"), [(elastic_collision, True), (always_head_on, False)])
def test_the_comparison_sees_a_broken_collision_rule(collide, accepted):
    """480 particles in 20 replicas of the plain solver: enough to reject a rule by which nothing relaxes."""
    curve = RelaxationCurve()
    for seed in replica_seeds(5, 20):
        gas = {"n": 24, "packing_fraction": 0.02, "boundary": "wall", "velocities": "equal-speeds"}
        scene = hs.random_gas(**gas, seed=seed)  # walls: the solver need not look into other images
        solver = ReferenceSimulation(scene, collide=collide)
        for collisions in (0, 12, 24):
            while solver.collisions < collisions:
                solver.step()
            state = [np.array(solver.positions), np.array(solver.velocities)]
            curve.add(hs.Frame(float(solver.time), collisions, collisions / 12, *state, scene))
    chi_square = curve.compare().chi_square
    assert (chi_square.p_value > 1e-3) is accepted
    if not accepted:
        assert chi_square.p_value < 1e-9


def test_two_temperatures_become_one():
    recipe = Recipe(
        n=1000, packing_fraction=0.02, velocities="two-temperatures", mass_ratio=4.0, diameter_ratio=0.5
    )
    curve = relaxation(recipe, (0.0, 10.0, 20.0), replicas=4, seed=3)
    start, middle, end = curve.temperature_by_species
    assert start[0] / start[1] == pytest.approx(3.0, rel=1e-2)
    assert abs(middle[0] - middle[1]) < 0.5 * abs(start[0] - start[1])
    noise = math.sqrt(2 / 3 / 2000)  # of a species' temperature
    assert np.abs(end - 1).max() < 5 * noise


def test_maxwell_stays_maxwell():
    curve = relaxation(Recipe(n=1000, velocities="maxwell"), (0.0, 1.0, 2.0), replicas=20, seed=4)
    comparison = curve.compare("equilibrium")
    assert comparison.chi_square.p_value > 1e-3
    assert np.abs(comparison.h_z).max() < 4.5
    assert np.abs(comparison.ks_z).max() < 4.5


def test_sampling_points():
    assert sampling_points(10.0, 4000)[:5] == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert len(sampling_points(10.0, 4000)) == 17
    assert sampling_points(0.4, 4000)[-1] == 0.4 and len(sampling_points(0.4, 4000)) == 9
    for end in (0.3, 1.0, 4.7, 10.0, 33.0, 500.0):
        points = sampling_points(end, 4000)
        assert points[0] == 0.0 and points[-1] == end
        assert list(points) == sorted(set(points)) and len(points) < 60


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = OutputFolder(tmp_path_factory.mktemp("runs") / "thermalise-5")
    recipe = Recipe(n=200, dim=3)
    study = Thermalisation(
        recipe, replicas=8, seed=5, workers=1, frames=5, animate=True, collisions_per_particle=2.0
    )
    summary, sound = thermalise(study, out, Screen(json_output=True))
    return study, out, summary, sound


def test_all_files_are_there_and_agree(finished):
    _, out, summary, sound = finished
    assert sound and summary["checks"]["passed"]
    names = {
        "summary.json",
        "relaxation.csv",
        "distributions.png",
        "relaxation.png",
        "trajectory.xyz",
        "gas.gif",
    }
    assert {path.name for path in out.path.iterdir()} == names == set(summary["files"])
    stored = json.loads((out.path / "summary.json").read_text())
    assert stored["seed"] == 5 and stored["version"] == hs.__version__ and stored["options"]["n"] == 200
    assert stored["seconds"]["total"] > 0
    with (out.path / "relaxation.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    assert {"s", "a2", "a2_error", "a2_boltzmann", "ks", "h", "h_boltzmann"} <= set(rows[0])
    np.testing.assert_array_equal([float(row["a2"]) for row in rows], stored["relaxation"]["a2"])
    assert (out.path / "gas.gif").read_bytes()[:6] == b"GIF89a"


def test_the_trajectory_is_that_of_the_first_replica(finished):
    study, out, *_ = finished
    images = ase.io.read(out.path / "trajectory.xyz", index=":")
    assert len(images) == 5
    scene = study.recipe.scene(replica_seeds(5, 8)[0])
    np.testing.assert_allclose(images[0].get_positions(), scene.positions, atol=1e-8)
    np.testing.assert_allclose(images[0].get_velocities(), scene.velocities, atol=1e-8)
    assert images[-1].info["collisions"] == 200


def test_looking_and_workers_change_nothing(finished, tmp_path):
    """Without trajectory and animation, in two processes: the same numbers to the last bit."""
    study, _, summary, _ = finished
    other = Thermalisation(study.recipe, replicas=8, seed=5, workers=2, frames=0, collisions_per_particle=2.0)
    again, _ = thermalise(other, OutputFolder(tmp_path / "again"), Screen(json_output=True))
    for name, column in summary["relaxation"].items():
        np.testing.assert_array_equal(again["relaxation"][name], column, err_msg=name)
    assert again["checks"] == summary["checks"]


def test_a_failed_check_is_told(finished, tmp_path, monkeypatch, capsys):
    def broken(self):
        raise hs.InvariantError("kinetic energy changed by 1e-3")

    monkeypatch.setattr(hs.Simulation, "check", broken)
    study = Thermalisation(Recipe(n=200), replicas=2, workers=1, frames=0, collisions_per_particle=0.5)
    summary, sound = thermalise(study, OutputFolder(tmp_path / "out"), Screen())
    assert not sound and not summary["checks"]["passed"]
    assert "CHECK FAILED, replica 0: kinetic energy changed by 1e-3" in capsys.readouterr().out


def test_a_file_with_velocities_is_run_once(finished, tmp_path):
    _, out, *_ = finished
    file = str(out.path / "trajectory.xyz")
    study = Thermalisation.from_file(
        file, Reading(), None, None, replicas=5, frames=0, collisions_per_particle=1.0, workers=1
    )
    assert study.replicas == 1 and study.recipe.placement == "file"
    summary, sound = thermalise(study, OutputFolder(tmp_path / "kept"), Screen(json_output=True))
    assert sound and summary["n"] == 200 and math.isnan(summary["relaxation"]["ks_error"][0])
    drawn = Thermalisation.from_file(file, Reading(), "equal-speeds", 2.0, replicas=3)
    assert drawn.replicas == 3
    scenes = [drawn.recipe.scene(seed) for seed in replica_seeds(1, 3)]
    assert all(scene.temperature == pytest.approx(2.0) for scene in scenes)
    np.testing.assert_array_equal(scenes[0].positions, scenes[1].positions)
    assert not np.array_equal(scenes[0].velocities, scenes[1].velocities)
    with pytest.raises(hs.SceneError, match="--temperature needs --velocities"):
        Thermalisation.from_file(file, Reading(), None, 2.0)
