"""ASE in and out: what is written comes back, printed positions make legal scenes, and bad files get one sentence."""

import logging
import math
import os
import subprocess
import sys
from dataclasses import dataclass

import ase.io
import numpy as np
import pytest
from ase import Atoms
from ase.build import bulk
from ase.io.extxyz import output_column_format
from hypothesis import given, settings
from hypothesis import strategies as st

import hardspheres as hs
from hardspheres import temporary
from hardspheres.atoms import MIXTURE, VELOCITY, has_velocities, to_atoms
from hardspheres.cells import worst_overlap
from hardspheres.checks import contact_tolerance
from hardspheres.files import xyz
from hardspheres.files.reader import read_structure

FCC, TRIANGULAR = math.pi / math.sqrt(18), math.pi / math.sqrt(12)


@dataclass
class State:
    """A frame as the simulation gives it."""

    time: float
    collisions: int
    positions: np.ndarray
    velocities: np.ndarray
    scene: hs.Scene


def gas(name):
    half = np.arange(200) % 2
    arguments = {
        "spheres": {},
        "discs": {"dim": 2},
        "between walls": {"boundary": ("periodic", "wall", "wall")},
        "mixture": {"radii": np.where(half, 0.5, 0.2), "masses": np.where(half, 3.0, 0.7)},
        "discs between walls": {"dim": 2, "boundary": ("wall", "periodic"), "masses": 2.5},
    }
    return hs.random_gas(200, 0.1, seed=5, **arguments[name])


GASES = ["spheres", "discs", "between walls", "mixture", "discs between walls"]


def frames_of(scene, count=3):
    return [
        State(0.25 * k, 1000 * k, scene.positions, scene.velocities * (1 + k), scene) for k in range(count)
    ]


def same_bits(mine, theirs):
    return all(
        getattr(mine, field).tobytes() == getattr(theirs, field).tobytes()
        for field in ("positions", "velocities", "radii", "masses", "box", "species")
    )


@pytest.mark.parametrize("name", GASES)
def test_extended_xyz_comes_back_bit_for_bit(name, tmp_path):
    scene = gas(name)
    with hs.TrajectoryWriter(tmp_path / "gas.xyz") as trajectory:
        for frame in frames_of(scene):
            trajectory.write(frame)
    read = ase.io.read(tmp_path / "gas.xyz", index=":")
    assert len(read) == 3
    for k, atoms in enumerate(read):
        assert atoms.info["time"] == 0.25 * k and atoms.info["collisions"] == 1000 * k
        assert "units" not in atoms.info and atoms.info["dimension"] == scene.dim
        assert atoms.pbc.tolist() == [*scene.periodic.tolist(), *[False] * (3 - scene.dim)]
        momenta = scene.masses[:, None] * ((1 + k) * scene.velocities)
        assert np.array_equal(atoms.get_momenta()[:, : scene.dim], momenta)
        assert not atoms.positions[:, scene.dim :].any() and not atoms.get_velocities()[:, scene.dim :].any()
        again = hs.Scene.from_atoms(atoms)
        assert again.boundary == scene.boundary
        assert same_bits(again, scene.replace(velocities=(1 + k) * scene.velocities))
    for k, again in enumerate(hs.read_trajectory(tmp_path / "gas.xyz")):
        assert same_bits(again, scene.replace(velocities=(1 + k) * scene.velocities))


@settings(max_examples=25)
@given(st.integers(0, 2**32), st.integers(-40, 40), st.integers(-40, 40), st.sampled_from([2, 3]))
def test_any_units_come_back_bit_for_bit(tmp_path_factory, seed, length, mass, dim):
    """Metres and kilograms, random masses: with 8 decimals nothing of this was left."""
    rng = np.random.default_rng(seed)
    scale = 10.0**length
    scene = hs.Scene(
        (np.mgrid[[slice(3)] * dim].reshape(dim, -1).T + 0.5 + 0.1 * rng.random((3**dim, dim))) * scale,
        rng.normal(size=(3**dim, dim)) * 10.0 ** rng.integers(-12, 12),
        (0.4 - 0.1 * rng.random(3**dim)) * scale,
        10.0 ** (mass + rng.random(3**dim)),
        [3 * scale] * dim,
    )
    path = tmp_path_factory.getbasetemp() / "units.xyz"
    with hs.TrajectoryWriter(path) as trajectory:
        trajectory.write(scene)
    (again,) = hs.read_trajectory(path)
    assert same_bits(again, scene)


def test_momenta_over_masses_alone_would_lose_bits():
    """Control: it is the column of velocities that keeps them."""
    scene = gas("mixture")
    atoms = scene.to_atoms()
    assert same_bits(hs.Scene.from_atoms(atoms), scene)
    del atoms.arrays[VELOCITY]
    lost = hs.Scene.from_atoms(atoms).velocities != scene.velocities
    assert 0.01 < lost.mean() < 0.5


def test_velocities_that_momenta_contradict_are_not_taken(caplog):
    atoms = gas("mixture").to_atoms()
    atoms.set_momenta(2 * atoms.get_momenta())  # as any program of ASE's may do
    again = hs.Scene.from_atoms(atoms)
    assert np.allclose(again.velocities, 2 * gas("mixture").velocities, rtol=1e-15, atol=0)
    assert 'not used: column "Velo"' in caplog.text


@pytest.mark.parametrize(("overlap", "taken"), [(5e-12, True), (1e-10, False)])
def test_what_the_engine_leaves_at_contacts_comes_back_bit_for_bit(overlap, taken, tmp_path, caplog):
    """Pairs overlap by roundings after collisions: `check` allows 1e-11 diameters in a frame, so a file may have it too."""
    apart = hs.Scene([[1, 1, 1], [3, 1, 1]], [[1, 0, 0], [0.3, 1, 0]], box=(6, 6, 6))
    left = apart.with_state(np.array([[1, 1, 1], [2 - overlap, 1, 1]]), apart.velocities)
    assert worst_overlap(left.positions, left.radii, left.box, left.periodic)[2] > contact_tolerance(left.box)
    with hs.TrajectoryWriter(tmp_path / "left.xyz") as trajectory:
        trajectory.write(left)
    (again,) = hs.read_trajectory(tmp_path / "left.xyz")
    assert same_bits(again, left) == taken and ("radii made smaller" in caplog.text) != taken


def test_units_are_named_only_by_the_user(tmp_path):
    with hs.TrajectoryWriter(tmp_path / "gas.xyz", units="SI") as trajectory:
        trajectory.write(gas("discs"))
    assert ase.io.read(tmp_path / "gas.xyz").info["units"] == "SI"
    assert (
        gas("discs").to_atoms(units="SI").info["units"] == "SI"
        and "units" not in gas("discs").to_atoms().info
    )


def test_a_number_that_is_not_finite_is_not_written(tmp_path):
    frame = frames_of(gas("discs"))[0]
    frame.velocities = frame.velocities + np.array([0, np.nan])
    with (
        hs.TrajectoryWriter(tmp_path / "gas.xyz") as trajectory,
        pytest.raises(hs.TrajectoryError, match="not finite"),
    ):
        trajectory.write(frame)
    assert (tmp_path / "gas.xyz").read_bytes() == b""


def test_the_header_names_the_columns_that_others_know(tmp_path):
    with hs.TrajectoryWriter(tmp_path / "gas.extxyz") as trajectory:
        trajectory.write(gas("spheres"))
    header = (tmp_path / "gas.extxyz").read_text().splitlines()[1]
    assert (
        "Properties=species:S:1:pos:R:3:momenta:R:3:masses:R:1:radius:R:1:Velo:R:3:mass:R:1 time=" in header
    )
    assert 'collisions=0 dimension=3 pbc="T T T"' in header and "Lattice=" in header


@pytest.mark.parametrize("name", GASES)
@pytest.mark.parametrize("units", [None, "reduced", "nm and ps", 'the "new" ones', "{a}", ""])
def test_the_header_is_the_one_that_ase_writes(name, units):
    """It is written here because ASE's function loads half of SciPy. Sibling: other columns, another header."""
    atoms = to_atoms(gas(name), units)
    labels = {"label": atoms.arrays["tags"]} if "tags" in atoms.arrays else {}
    arrays = {**atoms.arrays, "mass": atoms.arrays["masses"], "symbols": np.array(["X"]), **labels}
    known = [
        output_column_format(atoms, ["symbols", *columns, *labels], arrays)[0]
        for columns in (xyz.COLUMNS, xyz.COLUMNS[:-1])
    ]
    assert [xyz.header(atoms) == each for each in known] == [True, False]


def test_writing_xyz_loads_no_formats_of_others(tmp_path):
    """Sibling: reading does."""
    code = (
        "import sys, hardspheres as hs\n"
        "scene = hs.Scene([[1, 1, 1]], [[1, 0, 0]])\n"
        "with hs.TrajectoryWriter('one.xyz') as trajectory: trajectory.write(scene)\n"
        "before = 'ase.io' in sys.modules\n"
        "list(hs.read_trajectory('one.xyz'))\n"
        "print(before, 'ase.io' in sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.split() == ["False", "True"], done.stderr


@pytest.mark.parametrize("name", GASES)
def test_traj_keeps_every_bit(name, tmp_path):
    scene = gas(name)
    with hs.TrajectoryWriter(tmp_path / "gas.traj") as trajectory:
        for frame in frames_of(scene):
            trajectory.write(frame)
    for k, again in enumerate(hs.read_trajectory(tmp_path / "gas.traj")):
        for field in ("positions", "radii", "masses", "box", "species"):
            assert np.array_equal(getattr(again, field), getattr(scene, field))
        momenta = scene.masses[:, None] * ((1 + k) * scene.velocities)
        assert np.array_equal(again.velocities, momenta / scene.masses[:, None])
        if name in ("spheres", "discs", "between walls"):
            assert np.array_equal(again.velocities, (1 + k) * scene.velocities)
    assert k == 2
    assert ase.io.read(tmp_path / "gas.traj", index=1).info["time"] == 0.25


def test_symbols_tell_species_apart():
    assert set(to_atoms(gas("spheres")).get_chemical_symbols()) == {"X"}
    mixture = gas("mixture")
    assert to_atoms(mixture).get_chemical_symbols() == [MIXTURE[k] for k in mixture.species]
    many = hs.random_gas(200, 0.1, radii=np.linspace(0.2, 0.5, 200), seed=1).to_atoms()
    assert set(many.get_chemical_symbols()) == {"X"}
    assert many.get_masses().tolist() == [1.0] * 200


@pytest.mark.parametrize("extension", ["xyz", "traj"])
def test_each_frame_is_in_the_file_when_write_returns(extension, tmp_path):
    scene = gas("discs")
    path = tmp_path / f"gas.{extension}"
    trajectory = hs.TrajectoryWriter(path)
    for k in range(1, 4):
        trajectory.write(scene)
        assert len(ase.io.read(path, index=":")) == k
    trajectory.close()
    trajectory.close()
    with pytest.raises(hs.TrajectoryError, match="is closed"):
        trajectory.write(scene)


def test_writing_changes_nothing_of_the_frame(tmp_path):
    frame = frames_of(gas("mixture"))[0]
    before = frame.positions.copy(), frame.velocities.copy()
    with hs.TrajectoryWriter(tmp_path / "gas.traj") as trajectory:
        trajectory.write(frame)
    assert np.array_equal(frame.positions, before[0]) and np.array_equal(frame.velocities, before[1])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gas.pdb", "has the extension '.pdb'; a trajectory ends in"),
        ("gas", "has the extension ''"),
        ("missing/gas.xyz", "cannot be written: No such file"),
        ("missing/gas.traj", "cannot be written: No such file"),
    ],
)
def test_files_that_cannot_be_written(name, message, tmp_path):
    with pytest.raises(hs.TrajectoryError, match=message):
        hs.TrajectoryWriter(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_one_sentence(tmp_path):
    (tmp_path / "full.xyz").symlink_to("/dev/full")
    writer = hs.TrajectoryWriter(tmp_path / "full.xyz")
    with (
        pytest.raises(hs.TrajectoryError, match="full.xyz cannot be written: No space left"),
        writer as trajectory,
    ):
        trajectory.write(gas("discs"))


# Printed positions.


def printed(scene):
    """As files of other programs, and older ones of ours, have it: with 8 decimals."""
    atoms = to_atoms(scene)
    del atoms.arrays[VELOCITY]
    for name in ("positions", "momenta", "masses", "radius"):
        atoms.arrays[name] = np.round(atoms.arrays[name], 8)
    return atoms


@pytest.mark.parametrize("boundary", ["periodic", "wall"])
@pytest.mark.parametrize(("dim", "n", "most"), [(3, 500, FCC), (2, 418, TRIANGULAR)])
def test_a_printed_crystal_of_touching_spheres_is_a_legal_scene(boundary, dim, n, most, caplog):
    if boundary == "wall":
        with pytest.raises(hs.SceneError) as caught:
            hs.lattice_gas(n, 0.99 * most, dim=dim, boundary=boundary, seed=1)
        most = float(str(caught.value).split(" is the most")[0].split()[-1]) - 1e-6
    scene = hs.lattice_gas(n, most, dim=dim, boundary=boundary, seed=1)
    scene = scene.replace(positions=scene.positions + (0.123456789 if boundary == "periodic" else 0))
    caplog.set_level(logging.INFO, logger="hardspheres")
    atoms = printed(scene)
    again = hs.Scene.from_atoms(atoms)
    reduced = np.unique(scene.radii - again.radii)
    assert len(reduced) == 1 and 0 <= reduced[0] <= 1.5e-8
    if boundary == "periodic":
        assert reduced[0] > 1e-10 and "all radii made smaller by" in caplog.text
        with pytest.raises(hs.SceneError, match="overlap"):  # as printed it is none
            wrapped = np.mod(atoms.positions[:, :dim], scene.box)
            hs.Scene(wrapped, scene.velocities, box=scene.box)


def test_a_particle_printed_beyond_a_wall_is_met():
    r = 1 / 3
    edge = 2.0
    scene = hs.Scene([[r, r], [edge - r, edge - r]], np.zeros((2, 2)), r, box=(edge, edge), boundary="wall")
    again = hs.Scene.from_atoms(printed(scene))
    assert np.all(np.abs(again.radii - r) < 1.5e-8)


@settings(max_examples=40)
@given(st.integers(0, 2**32), st.sampled_from([2, 3]), st.floats(0, 2 * math.pi), st.floats(0, math.pi))
def test_any_touching_pair_survives_printing(seed, dim, phi, theta):
    rng = np.random.default_rng(seed)
    n = np.array([math.cos(phi), math.sin(phi)])
    if dim == 3:
        n = np.array([*(math.sin(theta) * n), math.cos(theta)])
    radii = 0.5 * 10 ** -rng.random(2)
    first = rng.random(dim) * 7.3
    scene = hs.Scene([first, first + radii.sum() * n], np.zeros((2, dim)), radii, box=(7.3,) * dim)
    assert np.all(np.abs(hs.Scene.from_atoms(printed(scene)).radii - radii) <= 2e-8 + 1e-15)


@pytest.mark.parametrize("overlap", [4e-8, 1e-3, 0.5])
def test_a_real_overlap_is_refused(overlap):
    atoms = Atoms("X2", [[1, 1, 1], [2 - overlap, 1, 1]], cell=[9, 9, 9], pbc=True)
    with pytest.raises(hs.SceneError, match="particles 0 and 1 overlap by"):
        hs.Scene.from_atoms(atoms, radius=0.5)


def test_small_units_are_not_taken_for_rounding():
    atoms = Atoms("X2", [[1e-9, 1e-9, 1e-9], [1.5e-9, 1e-9, 1e-9]], cell=[9e-9] * 3, pbc=True)
    with pytest.raises(hs.SceneError, match="overlap by 0.5 diameters"):
        hs.Scene.from_atoms(atoms, radius=0.5e-9)


# Structures that others made.


def test_a_structure_of_ones_own():
    atoms = bulk("Ar", "fcc", a=5.26, cubic=True).repeat(3)
    scene = hs.Scene.from_atoms(atoms, radius=1.7)
    assert (scene.n, scene.dim) == (108, 3)
    assert np.all(scene.masses == 39.95) or np.all(np.abs(scene.masses - 39.95) < 0.01)
    assert not has_velocities(atoms) and not scene.velocities.any()
    atoms.set_momenta(np.ones((108, 3)))
    assert has_velocities(atoms)
    assert np.allclose(hs.Scene.from_atoms(atoms, 1.7).velocities, 1 / 39.95, rtol=1e-3)


def test_radii_are_found_in_either_place_and_the_argument_wins():
    atoms = Atoms("X2", [[1, 1, 1], [4, 4, 4]], cell=[9, 9, 9], pbc=(1, 0, 1))
    for place, value in ((atoms.info, 0.3), (atoms.arrays, np.array([0.2, 0.4]))):
        for name in ("radii", "radius"):
            place[name] = value
            assert np.array_equal(hs.Scene.from_atoms(atoms).radii, np.full(2, 1.0) * value)
        assert hs.Scene.from_atoms(atoms, 0.1).radii.tolist() == [0.1, 0.1]
    assert hs.Scene.from_atoms(atoms).boundary == ("periodic", "wall", "periodic")


def test_an_origin_other_than_zero_is_taken_off():
    atoms = Atoms("X", [[-4.5, 0, 0]], cell=[10, 10, 10], celldisp=[-5, -5, -5], pbc=False)
    assert hs.Scene.from_atoms(atoms, 0.5).positions.tolist() == [[0.5, 5, 5]]


def test_two_dimensions_by_header_or_by_cell():
    flat = Atoms("X2", [[1, 1, 3], [4, 4, 3]], cell=[9, 8, 0], pbc=(1, 1, 0))
    assert hs.Scene.from_atoms(flat, 0.5).box.tolist() == [9, 8]
    flat.cell = [9, 8, 4]
    assert hs.Scene.from_atoms(flat, 0.5).dim == 3
    flat.info["dimension"] = 2
    assert hs.Scene.from_atoms(flat, 0.5).dim == 2


def bad(change):
    atoms = Atoms("X2", [[1, 1, 1], [4, 4, 4]], cell=[9, 9, 9], pbc=True)
    atoms.info["radius"] = 0.5
    change(atoms)
    return atoms


def array(name, value):
    return lambda atoms: atoms.set_array(name, np.array(value, dtype=float))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.info.clear(), "there are no radii; give them in a column radius"),
        (lambda a: a.set_cell(np.zeros((3, 3))), "there is no cell"),
        (lambda a: a.set_cell([[9, 0, 0], [1, 9, 0], [0, 0, 9]]), "the cell is not orthogonal"),
        (lambda a: a.set_cell([[0, 9, 0], [9, 0, 0], [0, 0, 9]]), "the cell is not orthogonal"),
        (lambda a: a.set_cell([-9, 9, 9]), "all 3 of them must be positive"),
        (lambda a: a.set_cell([9, math.nan, 9]), "the cell has an entry that is not finite"),
        (lambda a: a.set_cell([9, 9, 0]), "particles 0 and 1 differ in z"),
        (lambda a: a.info.update(dimension=4), "dimension is 4"),
        (lambda a: a.info.update(dimension="flat"), "dimension is 'flat'"),
        (lambda a: a.info.update(radius="big"), "radii hold text"),
        (lambda a: a.info.update(radius=[0.5] * 3), r"radii have shape \(3,\)"),
        (array("radius", [0.5, math.nan]), "the radius of particle 1 is nan"),
        (array("positions", [[1, 1, 1], [4, math.inf, 4]]), "the position of particle 1 along y is inf"),
        (array("momenta", [[1, 1, math.nan], [4, 1, 4]]), "the velocity of particle 0 along z is nan"),
        (array("masses", [1, -2]), "the mass of particle 1 is -2.0"),
        (array("velo", np.ones((2, 3))), 'velocities are in a column "velo"'),
        (lambda a: a.__delitem__([0, 1]), "at least one particle"),
        (lambda a: a.set_pbc([True, False, True]) or a.translate([0, -0.8, 0]), "beyond a wall along y"),
    ],
)
def test_bad_structures_get_one_clear_sentence(change, message):
    with pytest.raises((hs.TrajectoryError, hs.SceneError), match=message) as caught:
        hs.Scene.from_atoms(bad(change))
    assert "\n" not in str(caught.value)


def test_motion_out_of_the_plane_is_refused():
    atoms = Atoms("X", [[1, 1, 0]], cell=[9, 9, 0], momenta=[[0, 0, 1]])
    with pytest.raises(hs.TrajectoryError, match="particle 0 moves along z"):
        hs.Scene.from_atoms(atoms, 0.5)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.xyz", None, "there is no file"),
        ("empty.xyz", b"", "is empty"),
        ("binary.xyz", bytes(range(256)) * 9, "line 1: the number of particles should stand here"),
        ("binary.traj", bytes(range(256)) * 9, "cannot be read by ASE"),
        ("unknown.what", b"hello there", "cannot be read by ASE"),
        ("short.xyz", b"3\ncomment\nX 0 0 0\n", "says in line 1 that 3 particles follow where 1 lines do"),
        (
            "column.xyz",
            b"1\nProperties=species:S:1:pos:R:3:radius:R:1\nX 0 0 0\n",
            "line 3: there are 4 values, but the",
        ),
        ("words.xyz", b"1\n\nX zero one two\n", "line 3: 'zero' in the column pos is not a number"),
        ("none.xyz", b"0\n\n", "holds no particles"),
        ("at@sign.xyz", b"1\n\nX zero one two\n", "at@sign.xyz, line 3"),
    ],
)
def test_unreadable_files_get_one_clear_sentence(name, content, message, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(hs.TrajectoryError, match=message) as caught:
        read_structure(tmp_path / name)
    assert "\n" not in str(caught.value) and name in str(caught.value)
    with pytest.raises((hs.TrajectoryError, hs.SceneError)):
        list(hs.read_trajectory(tmp_path / name))


def test_a_folder_is_no_structure_and_the_last_frame_is_read(tmp_path):
    with pytest.raises(hs.TrajectoryError, match="is a folder"):
        read_structure(tmp_path)
    with hs.TrajectoryWriter(tmp_path / "gas.xyz") as trajectory:
        for frame in frames_of(gas("discs")):
            trajectory.write(frame)
    assert read_structure(tmp_path / "gas.xyz").info["time"] == 0.5
    assert read_structure(tmp_path / "gas.xyz", index=0).info["time"] == 0.0
    with pytest.raises(hs.TrajectoryError, match="gas.xyz holds no frame of index 3"):
        read_structure(tmp_path / "gas.xyz", index=3)
    assert read_structure(tmp_path / "gas.xyz", index=-3).info["time"] == 0.0


@settings(max_examples=60)
@given(st.binary(max_size=200), st.integers(0, 600))
def test_altered_bytes_never_escape_as_another_error(tmp_path_factory, noise, where):
    path = tmp_path_factory.getbasetemp() / "altered.xyz"
    with hs.TrajectoryWriter(path) as trajectory:
        trajectory.write(hs.lattice_gas(4, 0.1, seed=1))
    whole = path.read_bytes()
    path.write_bytes(whole[:where] + noise + whole[where + len(noise) :])
    try:
        hs.Scene.from_atoms(read_structure(path))
    except (hs.TrajectoryError, hs.SceneError) as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("suffix", ["xyz", "traj"])
@pytest.mark.parametrize("cut", [0, 1, 7, 500])
def test_writing_goes_on_after_the_frames_that_are_kept(suffix, cut, tmp_path):
    """A run that was killed has written three frames and a part of the fourth, of which the last are `cut` bytes missing."""
    frames = list(hs.Simulation(hs.random_gas(n=20, packing_fraction=0.1, seed=1)).frames(every=0.5, count=6))
    whole, killed = tmp_path / f"whole.{suffix}", tmp_path / f"killed.{suffix}"
    for path, count in ((whole, 6), (killed, 4)):
        with hs.TrajectoryWriter(path) as trajectory:
            for frame in frames[:count]:
                trajectory.write(frame)
    killed.write_bytes(killed.read_bytes()[: killed.stat().st_size - cut])
    with hs.TrajectoryWriter(killed, keep=3) as trajectory:
        for frame in frames[3:]:
            trajectory.write(frame)
    if suffix == "xyz":
        assert killed.read_bytes() == whole.read_bytes()
    scenes = [list(hs.read_trajectory(path)) for path in (whole, killed)]
    assert len(scenes[0]) == len(scenes[1]) == 6
    for mine, theirs in zip(*scenes, strict=True):
        assert mine.positions.tobytes() == theirs.positions.tobytes()
        assert mine.velocities.tobytes() == theirs.velocities.tobytes()
    assert {path.name for path in tmp_path.iterdir()} == {whole.name, killed.name}


def test_the_copy_of_kept_frames_has_a_name_of_its_own(tmp_path, monkeypatch):
    """A file that is called as the copy once was stays, and an interrupt leaves the old file and nothing else."""
    path, mine = tmp_path / "gas.traj", tmp_path / ".gas.traj.kept"
    mine.write_text("mine")
    with hs.TrajectoryWriter(path) as trajectory:
        for _ in range(2):
            trajectory.write(hs.random_gas(n=20, packing_fraction=0.1, seed=1))
    before, seen, replace = path.read_bytes(), [], os.replace

    def interrupted(copy, target):
        seen.append((os.path.basename(copy), target))
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        hs.TrajectoryWriter(path, keep=1)
    assert path.read_bytes() == before and {*tmp_path.iterdir()} == {path, mine}
    monkeypatch.setattr(os, "replace", replace)
    hs.TrajectoryWriter(path, keep=1).close()
    assert len(list(hs.read_trajectory(path))) == 1
    assert mine.read_text() == "mine" and {*tmp_path.iterdir()} == {path, mine}
    assert temporary.NAME.fullmatch(seen[0][0]) and seen[0][1] == path  # so that a killed writer's is removed


@pytest.mark.parametrize("suffix", ["xyz", "traj"])
def test_frames_that_are_not_there_cannot_be_kept(suffix, tmp_path):
    path = tmp_path / f"short.{suffix}"
    with hs.TrajectoryWriter(path) as trajectory:
        trajectory.write(hs.random_gas(n=20, packing_fraction=0.1, seed=1))
    before = path.read_bytes()
    with pytest.raises(hs.TrajectoryError, match="has 1 whole frames, so 2 of them cannot be kept"):
        hs.TrajectoryWriter(path, keep=2)
    assert path.read_bytes() == before
    with pytest.raises(hs.TrajectoryError):
        hs.TrajectoryWriter(tmp_path / f"absent.{suffix}", keep=1)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
