"""Any trajectory: temperatures, velocities beside Maxwell and Boltzmann, drift, g(r), and error bars that hold."""

import csv
import json
import sys
import warnings
from functools import cache

import ase.io
import numpy as np
import pytest
from ase import Atoms
from scenes import gas
from scipy import stats

import hardspheres as hs
from analysis.correlation_times import MeasuredCollisions
from analysis.maxwell_test import MaxwellTest
from analysis.moments import VelocityMoments
from hardspheres.files import Reading
from studies.analyse import GasInFile, answer_of, findings
from studies.cli import main
from studies.registry import study_named


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "analyse", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


@cache
def frames(kind="3d", n=500, eta=0.2, every=1.0, count=20, **start):
    """Frames of a gas in equilibrium, or from its start where a start is given."""
    sim = hs.Simulation(gas(kind, n, eta, **start))
    if not start:
        sim.run(collisions=5 * n)
    return list(sim.frames(every=every, count=count))


def written(path, given, change=lambda k, frame: {}):
    """The frames as a trajectory, each with some arrays of its scene replaced."""
    with hs.TrajectoryWriter(path) as trajectory:
        for k, frame in enumerate(given):
            scene = frame.scene.with_state(frame.positions, frame.velocities)
            trajectory.write(scene.replace(**changes) if (changes := change(k, scene)) else scene)
    return path


def analysed(path, **reading):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return answer_of(findings(GasInFile(str(path), Reading(**reading))))


def largest(answer):
    return max(abs(each.z) for each in answer.numbers if np.isfinite(each.z))


def said(answer):
    return "\n".join(answer.notes)


# A gas in equilibrium, and others.


def test_a_gas_in_equilibrium_is_found_to_be_one(tmp_path):
    """No number is off by 4 standard errors (11 of them: a false alarm in 1400), no p-value below 0.001."""
    answer = analysed(written(tmp_path / "gas.xyz", frames()))
    assert largest(answer) < 4
    assert float(answer["kT"].measured) == pytest.approx(1.0, rel=1e-12)
    assert answer["kT"].measured.standard_error == 0.0  # the energy is conserved
    assert "kT has no error bar, and does not drift" in said(answer)
    assert "total momentum is zero along x, y, z" in said(answer)
    assert "speeds: Maxwell-Boltzmann" in said(answer) and "axes: one temperature" in said(answer)
    assert str(answer.gas) == "gas.xyz: 20 frames of 500 hard spheres, periodic box"
    assert answer.label == "packing fraction 0.2"
    assert answer.verdict == "Nothing in the velocities tells this gas from one in equilibrium."


def test_equal_speeds_are_not_maxwellian(tmp_path):
    start = frames(n=500, eta=0.01, every=2.0, count=5, velocities="equal-speeds")
    answer = analysed(written(tmp_path / "gas.xyz", start))
    assert "speeds: not Maxwell-Boltzmann (p = 0.0005)" in said(answer)
    assert answer["a2"].z < -5
    assert answer.verdict.startswith("This gas is not in equilibrium: speeds, velocities along x, ")
    assert float(answer["KS distance of speeds"].measured) > 5 * answer["KS distance of speeds"].expected


def test_a_heated_axis_is_found(tmp_path):
    hot = written(
        tmp_path / "hot.xyz", frames(), lambda k, scene: {"velocities": scene.velocities * (1.1, 1.0, 1.0)}
    )
    answer = analysed(hot)
    assert answer["kT along x / kT"].z > 5 and answer["kT along y / kT"].z < -2
    assert "axes: different temperatures" in said(answer)
    assert "not in equilibrium: axes have different temperatures" in answer.verdict


def test_species_of_different_temperatures_are_found(tmp_path):
    given = frames("3d_mixture", n=400, eta=0.1, every=3.0)
    assert "species: one temperature" in said(answer := analysed(written(tmp_path / "gas.xyz", given)))
    assert largest(answer) < 4
    assert {"g at contact, species 1 and 2", "a2 of species 2"} <= {each.quantity for each in answer.numbers}

    def hotter(k, scene):
        return {"velocities": scene.velocities * np.where(scene.species == 0, 1.1, 1.0)[:, None]}

    answer = analysed(written(tmp_path / "hot.xyz", given, hotter))
    assert answer["kT of species 1 / kT"].z > 5 and "species: different temperatures" in said(answer)
    assert "species have different temperatures" in answer.verdict


def test_a_drift_is_found_and_its_significance(tmp_path):
    """Of gases at a fluctuating temperature, as those of a thermostat are."""
    rng = np.random.default_rng(5)
    scales = 1.0 + rng.normal(size=20) * 0.03

    def changed(rate):
        def change(k, scene):
            return {"velocities": scene.velocities * np.sqrt(scales[k] * (1.0 + rate * (k - 9.5) / 19))}

        return change

    steady = analysed(written(tmp_path / "steady.xyz", frames(), changed(0.0)))
    assert abs(steady["change of kT / kT"].z) < 3 and "no more than chance" in said(steady)
    assert 0.004 < steady["kT"].measured.standard_error < 0.012  # 0.03 over the root of 20
    drifts = analysed(written(tmp_path / "drifts.xyz", frames(), changed(0.2)))
    assert drifts["change of kT / kT"].z > 3.3 and "a drift, so that its mean is that of no" in said(drifts)
    assert "kT drifts" in drifts.verdict and "kT drifts" not in steady.verdict
    assert float(drifts["change of kT / kT"].measured) == pytest.approx(0.2, abs=0.06)


def test_digits_of_the_file_are_no_fluctuation(tmp_path):
    """Six digits, as other programs print: the energy is conserved, the momentum zero. Sibling: a thermostat."""

    def printed(k, scene):
        return {"velocities": np.vectorize(lambda v: float(f"{v:.6g}"))(scene.velocities)}

    answer = analysed(written(tmp_path / "gas.xyz", frames()[:10], printed))
    assert 1e-9 < answer.hidden["found"].moments.energy_spread < 1e-5
    assert answer["kT"].measured.standard_error == 0.0 and "total momentum is zero along x, y, z" in said(
        answer
    )
    assert not any("momentum" in each.quantity or "change" in each.quantity for each in answer.numbers)

    def thermostat(k, scene):
        return {"velocities": scene.velocities * (1.0 + 0.001 * (k % 3)) + 0.001 * (k % 2)}

    answer = analysed(written(tmp_path / "warm.xyz", frames()[:10], thermostat))
    assert answer["kT"].measured.standard_error > 1e-4 and "momentum along x" in str(answer.numbers)


def test_a_gas_that_moves_as_a_whole(tmp_path):
    moving = analysed(
        written(tmp_path / "gas.xyz", frames(), lambda k, scene: {"velocities": scene.velocities + (1, 0, 0)})
    )
    assert float(moving["momentum along x"].measured) == pytest.approx(500**0.5)
    assert float(moving["kT"].measured) == pytest.approx(1.0)
    assert "total momentum is zero along y, z" in said(moving) and largest(moving) < 4


def test_the_contact_value_tells_a_wrong_radius(tmp_path):
    path = written(tmp_path / "gas.xyz", frames(eta=0.3, every=2.0))
    assert abs(analysed(path)["g at contact"].z) < 4
    assert analysed(path, radius=0.48)["g at contact"].z < -5
    with pytest.raises(hs.SceneError, match=r"gas\.xyz: particles .* overlap by .*; --radius 0 takes all"):
        analysed(path, radius=0.6)
    points = analysed(path, radius=0)
    assert points.label.startswith("number density ") and not points.gas.sized
    r, g = points.curves["pair_distribution"].axes["r"], points.curves["pair_distribution"].columns["g"].value
    assert g[r < 0.95].max() == 0.0 and g[(r > 1.0) & (r < 1.1)].max() > 1.5


# Error bars.


def moments_of(given, thin=1):
    found, clock, test = VelocityMoments(), MeasuredCollisions(), MaxwellTest()
    for k, frame in enumerate(given[::thin]):
        s = clock.add(frame.scene, frame.velocities)
        known = hs.Frame(float(k), 0, s, frame.positions, frame.velocities, frame.scene)
        found.add(known)
        test.add(known)
    return found, test


@pytest.fixture(scope="module")
def many():
    """kT along x and a2 of 80 small gases, from frames close together; with naive errors as well."""
    found = []
    for seed in range(80):
        sim = hs.Simulation(gas("3d", 40, 0.05, seed=seed))
        sim.run(collisions=200)
        moments, test = moments_of(list(sim.frames(every=0.3, count=40)))
        x, a2 = moments.table["kT_x_over_kT"], moments.table["a2_1"]
        checks = {check.quantity: check for check in moments.checks}
        naive = [
            (series.mean() - truth) / (series.std(ddof=1) / 40**0.5)
            for series, truth in ((x, 1.0), (a2, float(moments.expected_a2[0])))
        ]
        found.append(
            [
                checks["kT along x / kT"].z,
                checks["a2"].z,
                *naive,
                moments.effective_frames,
                test.p_values[0, 0],
            ]
        )
    return np.array(found).T


def test_error_bars_of_frames_close_together_hold(many):
    """The spread of z is 1 within 3 standard errors of a spread, sqrt(1/160) each. Sibling: naive errors."""
    x, a2, naive_x, naive_a2, effective, p = many
    assert 3.0 < effective.mean() < 6.0  # of 40
    for z in (x, a2):
        assert abs(z.mean()) < 3 / 80**0.5
        assert abs(np.sqrt(np.mean(z**2)) - 1.0) < 0.24
    assert np.std(naive_x) > 2 and np.std(naive_a2) > 2
    assert stats.kstest(p, "uniform").pvalue > 1e-3


def test_dense_and_sparse_frames_of_one_gas_agree():
    """The same time covered with ten times the frames: as many independent ones, errors within a third."""
    dense = frames(n=200, eta=0.05, every=0.1, count=400)
    few, many = moments_of(dense, 10)[0], moments_of(dense)[0]
    assert many.n_frames == 400 and few.n_frames == 40
    assert many.effective_frames == pytest.approx(few.effective_frames, rel=0.15)
    for one, other in zip(few.along_axes, many.along_axes, strict=True):
        assert one.standard_error == pytest.approx(other.standard_error, rel=0.35)
        assert abs(one.value - other.value) < 2 * one.standard_error
    # control: frames far apart count all
    assert moments_of(frames(n=200, eta=0.05, every=30.0, count=12))[0].effective_frames > 11


def test_frames_too_close_together_are_said(tmp_path):
    close = analysed(written(tmp_path / "gas.xyz", frames(every=0.02, count=30)))
    assert "mean free times apart (the velocities of successive ones are correlated by 0.9" in said(close)
    assert "30 frames count as " in said(close)
    assert close["kT along x / kT"].measured.n_effective < 4
    same = analysed(written(tmp_path / "same.xyz", frames()[:1] * 9))
    assert "9 frames count as 1," in said(same)
    assert same["a2"].measured.standard_error == pytest.approx((8 / 15 / 500) ** 0.5)


def test_one_frame_has_errors_from_its_particles(tmp_path):
    path = tmp_path / "gas.traj"
    written(path, frames()[:1])
    answer = analysed(path)
    assert answer["kT"].measured.standard_error == pytest.approx((2 / 1497) ** 0.5)
    assert "one frame: errors of velocities are the noise of so many particles" in said(answer)
    assert largest(answer) < 4
    assert "change of kT / kT" not in [each.quantity for each in answer.numbers]


# Files of other programs.


def test_the_same_gas_from_other_programs(tmp_path):
    """A .traj of ASE and a dump of LAMMPS say what the xyz file says."""
    given = frames()[:6]
    path = written(tmp_path / "gas.xyz", given)
    expected = analysed(path)
    structures = ase.io.read(path, ":")
    with ase.io.Trajectory(tmp_path / "gas.traj", "w") as trajectory:
        for atoms in structures:
            plain = Atoms(
                atoms.numbers, atoms.positions, cell=atoms.cell, pbc=True, masses=atoms.get_masses()
            )
            plain.set_momenta(atoms.get_momenta())
            trajectory.write(plain)
    lines = []
    for k, frame in enumerate(given):
        edge = float(frame.scene.box[0])
        lines += ["ITEM: TIMESTEP", str(k), "ITEM: NUMBER OF ATOMS", "500", "ITEM: BOX BOUNDS pp pp pp"]
        lines += [f"0 {edge!r}"] * 3 + ["ITEM: ATOMS id type x y z vx vy vz"]
        table = np.hstack([frame.positions, frame.velocities]).tolist()
        lines += [f"{i + 1} 1 {' '.join(map(repr, row))}" for i, row in enumerate(table)]
    (tmp_path / "gas.lammpstrj").write_text("\n".join([*lines, ""]))
    for name, reading in (("gas.traj", {}), ("gas.lammpstrj", {"units": "reduced"})):
        other = analysed(tmp_path / name, radius=0.5, **reading)
        for one in expected.numbers:
            assert other[one.quantity].measured.value == pytest.approx(one.measured.value, abs=1e-9), name
    unsized = analysed(tmp_path / "gas.traj")
    assert "no radii in the file, so no contact value" in said(unsized)
    assert "g at contact" not in [each.quantity for each in unsized.numbers]


def test_positions_alone_give_pairs_alone(tmp_path):
    """A XDATCAR never has velocities; masses of its elements do not matter then."""
    rng = np.random.default_rng(1)
    given = [Atoms("Ar100", rng.random((100, 3)) * 10, cell=[10] * 3, pbc=True) for _ in range(8)]
    ase.io.write(tmp_path / "XDATCAR", given, format="vasp-xdatcar")
    answer = analysed(tmp_path / "XDATCAR")
    assert answer.verdict == "No velocities in the file: nothing but g(r)."
    assert list(answer.curves) == ["pair_distribution"] and answer.numbers == []
    g = answer.curves["pair_distribution"].columns["g"]
    z = (g.value - 0.99) / g.error
    assert np.abs(z[20:]).max() < 4.5  # an ideal gas of 100
    rest = written(
        tmp_path / "rest.xyz", frames()[1:2], lambda k, scene: {"velocities": 0 * scene.velocities}
    )
    answer = analysed(rest)
    assert (
        answer.verdict == "All particles are at rest: nothing but g(r)." and abs(answer["g at contact"].z) < 4
    )


def test_what_is_missing_is_said_and_the_rest_measured(tmp_path):
    rng = np.random.default_rng(2)
    boxless = Atoms("X50", rng.random((50, 3)))
    boxless.set_momenta(rng.normal(size=(50, 3)))
    ase.io.write(tmp_path / "boxless.xyz", boxless)
    answer = analysed(tmp_path / "boxless.xyz")
    assert "no g(r): the box is not known; --box 10,10,10 gives its edges" in said(answer)
    assert answer.label == "box unknown" and largest(answer) < 4
    boxed = analysed(tmp_path / "boxless.xyz", box=(1, 1, 1))
    assert "pair_distribution" in boxed.curves and boxed["kT"].measured == answer["kT"].measured
    walls = analysed(written(tmp_path / "walls.xyz", frames("2d_mixture_walls", n=100, eta=0.1, every=5.0)))
    assert "no g(r): the box has walls" in said(walls) and largest(walls) < 4
    assert walls["momentum along x"].measured.standard_error > 0.1
    grown = written(
        tmp_path / "grown.xyz", frames()[:3], lambda k, scene: {"box": scene.box * (1.0 + 0.01 * (k == 2))}
    )
    answer = analysed(grown)
    assert "no g(r): the box is not the same in all frames" in said(answer)
    assert answer.label == "box not constant" and largest(answer) < 4


def bad_files(tmp_path):
    """Commands that are refused, and the sentence."""
    (tmp_path / "empty.xyz").write_text("")
    yield "empty.xyz", "is empty"
    yield "none.xyz", "there is no file"
    ase.io.write(tmp_path / "bare.xyz", Atoms("X2", [[0, 0, 0], [1, 1, 1]]))
    yield (
        "bare.xyz",
        "there are no velocities, and there is no g(r): the box is not known; --box 10,10,10 gives",
    )
    hs.TrajectoryWriter(tmp_path / "one.xyz").write(hs.Scene([[1.0, 1, 1]], [[1.0, 0, 0]], box=(5, 5, 5)))
    yield "one.xyz", "holds one particle; a gas has two or more"
    two = [scene for n in (40, 30) for scene in [gas("3d", n, 0.05)]]
    with hs.TrajectoryWriter(tmp_path / "two.xyz") as trajectory:
        for scene in two:
            trajectory.write(scene)
    yield "two.xyz", "frame 1 has 30 particles in 3 dimensions, the first has 40 in 3; give a file of one gas"
    heavy = two[0].replace(masses=np.where(np.arange(40) == 3, 2.0, 1.0))
    with hs.TrajectoryWriter(tmp_path / "heavy.xyz") as trajectory:
        trajectory.write(two[0])
        trajectory.write(heavy)
    yield "heavy.xyz", "masses in frame 1 differ from those in the first"
    with hs.TrajectoryWriter(tmp_path / "stops.xyz") as trajectory:
        trajectory.write(two[0])
        trajectory.write(two[0].replace(velocities=0 * two[0].velocities))
    yield "stops.xyz", "frame 1 has no velocities, and those before have them"
    atoms = two[0].to_atoms()
    del atoms.arrays["Velo"]
    atoms.arrays["momenta"][7, 1] = np.nan
    ase.io.write(tmp_path / "nan.xyz", atoms, columns=["symbols", "positions", "momenta", "masses", "radius"])
    yield "nan.xyz", "velocity of particle 7 along y is nan; it must be finite"


def test_what_cannot_be_analysed_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys):
    for name, sentence in bad_files(tmp_path):
        assert command(monkeypatch, tmp_path / name, "--out", tmp_path / "out") == 2
        told = capsys.readouterr()
        assert sentence in told.err and told.err.count("\n") == 1 and not told.out
        assert not (tmp_path / "out").exists()


# The command.


def test_the_command_prints_and_writes_everything(tmp_path, monkeypatch, capsys):
    """Exit code 0 also for a gas that is not Maxwellian: that is a result. JSON is that of summary.json."""
    path = written(tmp_path / "gas.xyz", frames(eta=0.01, every=2.0, count=5, velocities="equal-speeds"))
    out = tmp_path / "out"
    assert command(monkeypatch, path, "--out", out, "--json") == 0
    told = capsys.readouterr()
    summary = json.loads(told.out)
    assert summary == json.loads((out / "summary.json").read_text())
    assert summary["study"] == "analyse" and summary["n"] == 500 and summary["frames"] == 5
    assert {each.name for each in out.iterdir()} == set(summary["files"])
    assert set(summary["files"]) == {"summary.json", "report.html", *study_named("analyse").files}
    assert "not Maxwell-Boltzmann (p = 0.0005)" in told.err and "KS distance of speeds" in told.err
    assert min(summary["states"][0]["ks_p_values"][0]) == pytest.approx(1 / 2001)
    with (out / "analysis.csv").open() as handle:
        rows = {row["quantity"]: row for row in csv.DictReader(handle)}
    assert float(rows["kT"]["value"]) == pytest.approx(1.0) and float(rows["a2"]["z"]) < -5
    with (out / "speeds.csv").open() as handle:
        density = np.array([float(row["density"]) for row in csv.DictReader(handle)])
    assert density.sum() * 5 / 60 == pytest.approx(1.0)
    assert "gas.xyz: 5 frames of 500 hard spheres" in (out / "report.html").read_text()
    assert command(monkeypatch, path, "--out", out) == 2
    assert "holds a finished run" in capsys.readouterr().err
    assert command(monkeypatch, path, "--out", out, "--force") == 0


def test_it_reads_one_frame_at_a_time(tmp_path):
    """Ten times the frames take no more memory. Control: to hold them all would."""
    import tracemalloc

    peaks = []
    for count in (3, 30):
        path = written(tmp_path / f"{count}.xyz", frames()[:3] * (count // 3))
        analysed(path)
        tracemalloc.start()
        findings(GasInFile(str(path), Reading()))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]
    assert 27 * 500 * 6 * 8 > 0.3 * peaks[0]


@pytest.mark.parametrize(("species", "tests"), [(2, 1), (3, 3)])
def test_the_bound_for_unequal_species_counts_tests(species, tests):
    """Of two species both deviations are one; of three, three tests by Bonferroni (with two, 1.4 times too many alarms)."""
    masses = 1.0 + np.arange(120) % species
    scene = hs.lattice_gas(n=120, packing_fraction=0.05, masses=masses, boundary="wall", seed=1)
    moments = VelocityMoments().add(hs.Simulation(scene).frame())
    p_values = [check.p_value for check in moments.checks if check.quantity.startswith("kT of")]
    assert len(p_values) == species and max(p_values) < 1.0
    assert moments.equal_species == min(1.0, tests * min(p_values))
    if species == 2:
        assert p_values[0] == pytest.approx(p_values[1], rel=1e-6)
