"""The study of thermalisation: physics against the Boltzmann equation, with siblings that must fail, and its files."""

import math
from dataclasses import replace

import ase.io
import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.relaxation import RelaxationCurve
from analysis.statistics import compare_with_theory
from hardspheres.collision import elastic_collision
from hardspheres.errors import CheckpointError
from hardspheres.files import read_scene
from hardspheres.reference import ReferenceSimulation
from studies.report import OutputFolder, Screen
from studies.running.ensemble import replica_seeds
from studies.study import conduct, run_study
from studies.thermalisation import Thermalisation, sampling_points


def relaxation(monkeypatch, s, **options):
    """The curve of all replicas of a study that is sampled at these s."""
    monkeypatch.setattr("studies.thermalisation.sampling_points", lambda end, n: s)
    study = Thermalisation(collisions_per_particle=s[-1], **({"workers": 1} | options))
    (replicas,), _ = run_study(study, Screen(True))
    assert not any(replica.failure for replica in replicas)
    curve = RelaxationCurve()
    for replica in replicas:
        curve.merge(replica.estimators["curve"])
    return curve


def sonine_p_value(curve):
    """p of the near-equilibrium exponential a2(0) exp(-8s/15), exp(-s/2) in 2D, which is wrong from this start."""
    wrong = -2 / (curve.dim + 2) * np.exp(-theory.sonine_rate(curve.dim) * curve.s)
    return compare_with_theory(curve.a2_samples[:, 1:], wrong[1:]).p_value


@pytest.mark.parametrize("dim", [2, 3])
def test_equal_speeds_relax_as_the_boltzmann_equation_says(dim, monkeypatch):
    """40 000 particles in 40 replicas; p < 0.001 once in 1000 seeds."""
    s = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0)
    curve = relaxation(monkeypatch, s, n=1000, dim=dim, replicas=40, seed=dim)
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
def test_relaxation_at_full_size(dim, monkeypatch):
    """400 000 particles in 100 replicas at packing fraction 0.005: the same statements, three times as sharp."""
    s = sampling_points(10.0, 4000)
    curve = relaxation(monkeypatch, s, n=4000, dim=dim, replicas=100, seed=10 + dim, workers=None)
    comparison = curve.compare()
    print(f"{dim}D: {comparison.chi_square}, rate {curve.fit_rate()}")
    assert comparison.chi_square.p_value > 1e-3
    assert np.nanmax(np.abs(comparison.h_z)) < 4.5
    expected = theory.equal_speeds_decay_rate(dim)
    assert abs(curve.fit_rate().deviation(expected.value, expected.uncertainty)) < 4
    assert sonine_p_value(curve) < 1e-9


def told(folder, capsys, **options):
    its = {"collisions_per_particle": 3.0, "replicas": 8, "frames": 0, "workers": 1} | options
    summary, _ = conduct(Thermalisation(**its), OutputFolder(folder), Screen())
    return summary["states"][0], capsys.readouterr().out


def test_beams_are_shown_along_their_direction(tmp_path, capsys):
    """The table, the file and the figure have T_par/T beside the Boltzmann equation; along x (sibling) it is another."""
    state, text = told(tmp_path / "beams", capsys, n=500, packing_fraction=0.001, velocities="beams")
    assert "T_par/T  theory     z" in text and "not in equilibrium yet at s = 3: a2" in text
    table = state["relaxation"]
    assert table["temperature_parallel"][0] == pytest.approx(3.0)
    assert np.nanmax(np.abs(table["temperature_parallel_z"])) < 4
    assert table["temperature_x"][0] == pytest.approx(3 * hs.velocities.BEAM_DIRECTION[3][0] ** 2, rel=0.02)
    assert not state["thermal"]["passed"] and "a2" in state["thermal"]["not_yet"]


def test_a_mixture_of_two_temperatures_is_not_thermal_yet(tmp_path, capsys):
    """a2, KS and H of all together are noise when T1 still differs from T2; at equilibrium (sibling) nothing is said of it."""
    mixed = {"n": 200, "mass_ratio": 7.0, "diameter_ratio": 0.6}
    state, text = told(tmp_path / "mixture", capsys, velocities="two-temperatures", **mixed)
    assert "not in equilibrium yet at s = 3: T1/T, T2/T" in text
    assert state["thermal"]["not_yet"] == ["T1/T", "T2/T"]
    state, text = told(tmp_path / "calm", capsys, velocities="maxwell", **mixed)
    assert state["thermal"]["passed"] and "is indistinguishable from one in equilibrium" in text


def test_two_replicas_make_no_discovery(tmp_path, capsys):
    """All z of a table of two replicas are within 4; in standard errors (sibling) some are far beyond."""
    state, _ = told(tmp_path / "two", capsys, n=500, collisions_per_particle=5.0, replicas=2)
    table = {name: np.array(column, float) for name, column in state["relaxation"].items()}
    assert np.nanmax(np.abs([table["a2_z"], table["ks_z"]])) < 4
    error = np.where(table["a2_error"] > 0, table["a2_error"], np.nan)
    assert np.nanmax(np.abs(table["a2"] - table["a2_theory"])[1:] / error[1:]) > 4


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


def test_two_temperatures_become_one(monkeypatch):
    hot = {"velocities": "two-temperatures", "mass_ratio": 4.0, "diameter_ratio": 0.5}
    s = (0.0, 10.0, 20.0)
    curve = relaxation(monkeypatch, s, n=1000, packing_fraction=0.02, replicas=4, seed=3, **hot)
    start, middle, end = curve.temperature_by_species
    assert start[0] / start[1] == pytest.approx(3.0, rel=1e-2)
    assert abs(middle[0] - middle[1]) < 0.5 * abs(start[0] - start[1])
    noise = math.sqrt(2 / 3 / 2000)  # of a species' temperature
    assert np.abs(end - 1).max() < 5 * noise


def test_maxwell_stays_maxwell(monkeypatch):
    curve = relaxation(monkeypatch, (0.0, 1.0, 2.0), n=1000, velocities="maxwell", replicas=20, seed=4)
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
    study = Thermalisation(
        n=200, replicas=4, seed=5, workers=1, frames=5, animate=True, collisions_per_particle=2.0
    )
    summary, sound = conduct(study, out, Screen(json_output=True))
    assert sound
    return study, out, summary


def test_the_trajectory_is_that_of_the_first_replica(finished):
    study, out, _ = finished
    images = ase.io.read(out.path / "trajectory.xyz", index=":")
    assert len(images) == 5
    scene = study.gases()[0].scene(replica_seeds(5, 8)[0])
    np.testing.assert_allclose(images[0].get_positions(), scene.positions, atol=1e-8)
    np.testing.assert_allclose(images[0].get_velocities(), scene.velocities, atol=1e-8)
    assert images[-1].info["collisions"] == 200
    assert (out.path / "gas.gif").read_bytes()[:6] == b"GIF89a"


def test_looking_changes_nothing(finished, tmp_path):
    """Without trajectory and animation: the same numbers to the last bit, and no file of either."""
    study, out, summary = finished
    blind, folder = replace(study, frames=0, animate=False), OutputFolder(tmp_path / "again")
    again, _ = conduct(blind, folder, Screen(json_output=True))
    np.testing.assert_equal(again["states"], summary["states"])
    assert set(summary["files"]) - set(again["files"]) == {"gas.gif", "trajectory.xyz"}
    assert (folder.path / "relaxation.csv").read_bytes() == (out.path / "relaxation.csv").read_bytes()


def test_a_failed_check_is_told(tmp_path, monkeypatch, capsys):
    def broken(self):
        raise hs.InvariantError("kinetic energy changed by 1e-3")

    monkeypatch.setattr(hs.Simulation, "check", broken)
    study = Thermalisation(n=200, replicas=2, workers=1, frames=0, collisions_per_particle=0.5)
    summary, sound = conduct(study, OutputFolder(tmp_path / "out"), Screen())
    assert not sound and not summary["checks"]["passed"]
    assert "CHECK FAILED, replica 0: kinetic energy changed by 1e-3" in capsys.readouterr().out


def test_a_file_with_velocities_is_run_once(finished, tmp_path, capsys):
    """Without error bars, which is said; sibling: other velocities are drawn, and replicas differ."""
    file = str(finished[1].path / "trajectory.xyz")
    short = {"frames": 0, "collisions_per_particle": 1.0, "workers": 1}
    study = Thermalisation(source=file, replicas=5, **short)
    summary, sound = conduct(study, OutputFolder(tmp_path / "kept"), Screen(json_output=True))
    assert sound and summary["n"] == 200 and summary["options"]["replicas"] == 1
    assert math.isnan(summary["states"][0]["relaxation"]["ks_error"][0])
    assert summary["states"][0]["placement"] == summary["states"][0]["start"] == "file"
    assert "running one, without error bars" in capsys.readouterr().err
    drawn = Thermalisation(source=file, velocities="equal-speeds", temperature=2.0, replicas=3)
    assert drawn.prepared(print).replicas == 3
    assert capsys.readouterr().out == f'{file}: not used: column "momenta", column "Velo"\n'
    scenes = [drawn.gases()[0].scene(seed) for seed in replica_seeds(1, 3)]
    assert all(scene.temperature == pytest.approx(2.0) for scene in scenes)
    np.testing.assert_array_equal(scenes[0].positions, scenes[1].positions)
    assert not np.array_equal(scenes[0].velocities, scenes[1].velocities)
    with pytest.raises(hs.SceneError, match="--temperature needs --velocities"):
        Thermalisation(source=file, temperature=2.0).prepared(print)


def test_a_file_is_read_once_and_a_changed_one_is_not_resumed(finished, tmp_path, monkeypatch):
    """Sibling: the same file, touched but not changed, is."""
    file = tmp_path / "start.xyz"
    whole = (finished[1].path / "trajectory.xyz").read_text().splitlines(keepends=True)
    first, last = whole[: len(whole) // 5], whole[-len(whole) // 5 :]
    file.write_text("".join(first))
    times = []
    monkeypatch.setattr(
        "studies.thermalisation.read_scene", lambda *given: (times.append(1), read_scene(*given))[1]
    )
    study = Thermalisation(source=str(file), collisions_per_particle=1.0, workers=1, frames=2)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Thermalisation, "answer", interrupted)
        conduct(study, OutputFolder(tmp_path / "out"), Screen(True))
    assert len(times) == 1
    file.write_text("".join(last))
    again = OutputFolder(tmp_path / "out", resume=True)
    with pytest.raises(CheckpointError, match="with the structure that it starts from .*, not "):
        conduct(study, again, Screen(True))
    file.write_text("".join(first))
    assert conduct(study, again, Screen(True))[1]


def interrupted(*_):
    raise KeyboardInterrupt


def test_a_ratio_of_temperatures_reaches_the_gas():
    """Hot over cold, exactly; sibling: the ratio that is the default."""
    hot = {"velocities": "two-temperatures", "mass_ratio": 4.0, "n": 200}
    for study, ratio in (
        (Thermalisation(**hot), 3.0),
        (Thermalisation(temperature_ratio=9.0, **hot), 9.0),
    ):
        (gas,) = study.gases()
        made = gas.scene(np.random.SeedSequence(1))
        for scene in (made, replace(gas, base=made).scene(np.random.SeedSequence(2))):
            energy = scene.masses * (scene.velocities**2).sum(axis=1)
            assert energy[scene.masses == 1.0].mean() / energy[scene.masses == 4.0].mean() == pytest.approx(
                ratio
            )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"radius": 1.0}, "--radius goes with --from"),
        ({"velocities_are": "reduced"}, "--velocities-are goes with --from"),
        ({"fraction": 0.2}, "--fraction needs --mass-ratio or --diameter-ratio"),
        ({"temperature_ratio": 2.0}, "--temperature-ratio goes with --velocities two-temperatures"),
        (
            {"source": "absent.xyz", "n": 100},
            "--n has no effect with --from, which gives the whole structure",
        ),
        ({"source": "absent.xyz", "boundary": "wall"}, "--boundary has no effect with --from"),
        ({"source": "absent.xyz", "boundary": "wall", "box": (9.0, 9.0, 9.0)}, "there is no file absent.xyz"),
        ({"collisions_per_particle": math.nan}, "--collisions-per-particle nan must be positive"),
    ],
)
def test_options_that_make_no_sense_together_are_refused(options, sentence):
    with pytest.raises(hs.HardSpheresError, match=sentence):
        Thermalisation(**options).gases()
