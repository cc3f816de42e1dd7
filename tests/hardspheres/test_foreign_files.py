"""Files that other programs wrote: nothing lost, nothing misread, and what cannot be known is asked for "
"in one sentence."""

import gzip

import ase.io
import numpy as np
import pytest

import hardspheres as hs
from hardspheres.files import Reading, read_scene, read_structure

LATTICE = 'Lattice="9 0 0 0 9 0 0 0 9"'
HEAD = f"{LATTICE} Properties=species:S:1:pos:R:3"


def xyz(columns="", rows=("", ""), header="", labels="XX", places=("1 1 1", "5 5 5")):
    """Two particles in extended xyz."""
    lines = [f"{label} {place} {row}" for label, place, row in zip(labels, places, rows, strict=True)]
    return "\n".join(["2", f"{HEAD}{columns} {header}", *lines, ""])


def scene_of(tmp_path, content, name="file.xyz", **reading):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_scene(path, Reading(**reading))


# Names.


@pytest.mark.parametrize("name", ["radius", "radii", "Radius"])
def test_names_of_radii(name, tmp_path):
    scene, notes = scene_of(tmp_path, xyz(f":{name}:R:1", ("0.5", "0.3")))
    assert scene.radii.tolist() == [0.5, 0.3] and not notes


@pytest.mark.parametrize("name", ["diameter", "Diameter"])
def test_a_diameter_is_two_radii(name, tmp_path):
    assert scene_of(tmp_path, xyz(f":{name}:R:1", ("1", "0.6")))[0].radii.tolist() == [0.5, 0.3]
    both = xyz(":radius:R:1:diameter:R:1", ("0.5 1", "0.3 0.6"))
    assert scene_of(tmp_path, both)[0].radii.tolist() == [0.5, 0.3]
    with pytest.raises(hs.TrajectoryError, match='"diameter" is not twice "radius"'):
        scene_of(tmp_path, both.replace("0.6", "0.5"))
    assert scene_of(tmp_path, xyz(header="diameter=0.8"))[0].radii.tolist() == [0.4, 0.4]


@pytest.mark.parametrize("name", ["mass", "masses", "Mass"])
def test_names_of_masses(name, tmp_path):
    scene, notes = scene_of(tmp_path, xyz(f":{name}:R:1:radius:R:1", ("2 0.5", "3 0.5")))
    assert scene.masses.tolist() == [2, 3] and not notes


def test_two_columns_of_one_quantity_must_agree(tmp_path):
    text = xyz(":mass:R:1:masses:R:1:radius:R:1", ("2 2 0.5", "3 3 0.5"))
    assert scene_of(tmp_path, text)[0].masses.tolist() == [2, 3]
    with pytest.raises(hs.TrajectoryError, match='"mass" and "masses" differ for particle 1'):
        scene_of(tmp_path, text.replace("3 3", "3 4"))


VELOCITIES = ("0.5 1 2 3", "0.5 -1 -2 -4")


@pytest.mark.parametrize(
    "columns",
    [f"{name}:R:3" for name in ("velo", "vel", "velocities", "velocity", "Velocity", "v")]
    + ["vx:R:1:vy:R:1:vz:R:1"],
)
def test_velocities_are_taken_where_somebody_says_their_unit(columns, tmp_path):
    text = xyz(f":radius:R:1:{columns}", VELOCITIES)
    with pytest.raises(
        hs.TrajectoryError, match="whose unit differs between programs; say .*--velocities-are reduced"
    ):
        scene_of(tmp_path, text)
    scene, notes = scene_of(tmp_path, text, units="reduced")
    assert scene.velocities.tolist() == [[1, 2, 3], [-1, -2, -4]] and not notes
    named, _ = scene_of(tmp_path, text.replace(LATTICE, LATTICE + " units=reduced"))
    assert np.array_equal(named.velocities, scene.velocities)
    with pytest.raises(hs.TrajectoryError, match="the header says units=metal"):
        scene_of(tmp_path, text.replace(LATTICE, LATTICE + " units=metal"))
    unused, notes = scene_of(tmp_path, text, velocities=False)  # as --velocities does, which draws others
    assert not unused.velocities.any() and len(notes) == 1 and notes[0].startswith("not used: column ")


@pytest.mark.parametrize("name", ["momenta", "momentum"])
def test_names_of_momenta(name, tmp_path):
    text = xyz(f":radius:R:1:mass:R:1:{name}:R:3", ("0.5 2 1 2 3", "0.5 4 -1 -2 -4"))
    scene, notes = scene_of(tmp_path, text)
    assert scene.velocities.tolist() == [[0.5, 1, 1.5], [-0.25, -0.5, -1]] and not notes


def test_what_is_not_used_is_named_once(tmp_path, caplog):
    text = xyz(":radius:R:1:forces:R:3:sigma:R:1:name:S:1", ("0.5 0 0 0 1 a", "0.5 0 0 0 1 b"))
    (tmp_path / "three.xyz").write_text(3 * text)
    assert len(list(hs.read_trajectory(tmp_path / "three.xyz"))) == 3
    assert caplog.text.count("sigma") == caplog.text.count("forces") == 1 and '"name"' not in caplog.text
    caplog.clear()
    hs.Scene.from_atoms(ase.io.read(tmp_path / "three.xyz"))
    assert caplog.text.count("sigma") == 1
    (tmp_path / "plain.xyz").write_text("1\nby hand\nX 1 1 1 0.5 7\n")
    _, notes = read_scene(tmp_path / "plain.xyz", Reading(radius=0.5, box=(9, 9, 9)))
    assert notes == ["not used: what stands in columns 5 to 6, which no Properties name"]


def test_masses_of_elements_are_said(tmp_path):
    scene, notes = scene_of(tmp_path, xyz(":radius:R:1", ("0.5", "0.5"), labels=("He", "H")))
    assert scene.masses.tolist() == [4.002602, 1.008]
    assert notes[0].startswith("there are no masses, so those of the elements are taken: He 4.0026, H 1.008")
    scene, notes = scene_of(tmp_path, xyz(":radius:R:1", ("0.5", "0.5"), labels=("He", "H")), mass=1.0)
    assert scene.masses.tolist() == [1, 1] and not notes


def test_particles_stand_in_the_order_of_their_ids(tmp_path):
    scene, notes = scene_of(tmp_path, xyz(":id:I:1:radius:R:1", ("2 0.2", "1 0.1")))
    assert scene.radii.tolist() == [0.1, 0.2] and scene.positions[0].tolist() == [5, 5, 5] and not notes


def test_constraints_are_not_silently_dropped(tmp_path):
    _, notes = scene_of(tmp_path, xyz(":radius:R:1:move_mask:L:1", ("0.5 T", "0.5 F")))
    assert notes == ["not used: constraints (move_mask); every particle moves"]


# Labels.


@pytest.mark.parametrize("labels", [("1", "2"), ("A", "B"), ("Type_1", "Type_2"), ("small", "X")])
@pytest.mark.parametrize("header", [f"{HEAD}", f"{LATTICE}"])
def test_labels_that_are_no_elements(labels, header, tmp_path):
    text = f"2\n{header}\n{labels[0]} 1 1 1\n{labels[1]} 5 5 5\n"
    scene, notes = scene_of(tmp_path, text, radius=dict(zip(labels, (0.5, 0.3), strict=True)))
    assert scene.radii.tolist() == [0.5, 0.3] and scene.masses.tolist() == [1, 1] and not notes
    with pytest.raises(
        hs.TrajectoryError, match=f"the label {labels[1]} has no radius; labels are {labels[0]}, "
    ):
        scene_of(tmp_path, text, radius={labels[0]: 0.5})
    with pytest.raises(hs.TrajectoryError, match="the label Z has no particle; labels are"):
        scene_of(tmp_path, text, radius={labels[0]: 0.5, labels[1]: 0.5, "Z": 1})


def test_elements_are_labels_too(tmp_path):
    scene, _ = scene_of(
        tmp_path, xyz(labels=("He", "H")), radius={"He": 0.5, "H": 0.3}, mass={"He": 4, "H": 1}
    )
    assert scene.radii.tolist() == [0.5, 0.3] and scene.masses.tolist() == [4, 1]


# Frames.


@pytest.mark.parametrize("between", ["", "\n", "\n\n \n"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_blank_lines_between_frames_are_no_end(between, end, tmp_path):
    frames = [xyz(":radius:R:1", (f"0.{k}", f"0.{k}"), f"time={k}") for k in (1, 2, 3)]
    path = tmp_path / "three.xyz"
    path.write_bytes((between + between.join(frames) + between).replace("\n", end).encode())
    assert [scene.radii[0] for scene in hs.read_trajectory(path)] == [0.1, 0.2, 0.3]
    assert read_structure(path).info["time"] == 3 and read_structure(path, 1).info["time"] == 2
    with gzip.open(tmp_path / "three.xyz.gz", "wb") as packed:
        packed.write(path.read_bytes())
    assert len(list(hs.read_trajectory(tmp_path / "three.xyz.gz"))) == 3


def test_control_ase_alone_takes_the_first_for_the_last(tmp_path):
    path = tmp_path / "three.xyz"
    path.write_text("\n".join(xyz(":radius:R:1", ("0.5", "0.5"), f"time={k}") for k in (1, 2, 3)))
    assert ase.io.read(path).info["time"] == 1


def test_what_stands_between_frames_is_refused(tmp_path):
    whole = xyz(":radius:R:1", ("0.5", "0.5"))
    with pytest.raises(
        hs.TrajectoryError, match=r"line 5: the number of particles should stand here \(1 frame before it\)"
    ):
        scene_of(tmp_path, whole + "X 7 7 7 0.5\n" + whole)


def test_a_file_that_ends_within_a_line(tmp_path):
    whole = xyz(":radius:R:1", ("0.5", "0.25"))
    assert scene_of(tmp_path, whole)[1] == []
    scene, notes = scene_of(tmp_path, whole[:-2])
    assert scene.radii[1] == 0.2 and notes[0].startswith("the file ends within a line")


# Headers.


def test_an_origin_is_honoured(tmp_path):
    text = xyz(
        ":radius:R:1", ("0.5", "0.5"), 'pbc="F F F" Origin="-4.5 -4.5 -4.5"', places=("-4 -4 -4", "0 0 0")
    )
    scene, _ = scene_of(tmp_path, text)
    assert scene.positions.tolist() == [[0.5] * 3, [4.5] * 3]
    with pytest.raises(hs.TrajectoryError, match="Origin is .* in the header; it must be three numbers"):
        scene_of(tmp_path, text.replace("-4.5 -4.5 -4.5", "here"))
    with pytest.raises(hs.SceneError, match="beyond a wall"):  # control
        scene_of(tmp_path, text.replace("Origin", "Other"))


def test_a_dimension_may_be_written_with_a_point(tmp_path):
    text = xyz(":radius:R:1", ("0.5", "0.5"), "dimension=2.0", places=("1 1 0", "5 5 0"))
    assert scene_of(tmp_path, text)[0].dim == 2


RADII = (":radius:R:1", ("0.5", "0.5"))
WRONG = {
    "two dimensions": (xyz(*RADII, 'dimension="2 3"'), "dimension is '2 3' in the header; it must be 2 or 3"),
    "dimension T": (xyz(*RADII, "dimension"), "dimension is True in the header"),
    "negative edges": (xyz(*RADII).replace("9 0 0 0 9 0 0 0 9", "-9 0 0 0 -9 0 0 0 -9"), "all 3 of them must be positive"),
    "oblique": (xyz(*RADII).replace("9 0 0 0", "9 0 0 -1"), "the cell is not orthogonal"),
    "eight numbers": (xyz(*RADII).replace("0 0 0 9", "0 0 9"), "line 2: Lattice must be nine numbers"),
    "PBC": (xyz(*RADII, 'PBC="F F F"'), 'the header has "PBC", which is not read; write pbc'),
    "pbc in words": (xyz(*RADII, 'pbc="p p f"'), "line 2: pbc is 'p p f'; it must be T or F"),
    "two pbc": (xyz(*RADII, 'pbc="T T"'), "line 2: pbc is"),
    "pos:R:2": (xyz(*RADII).replace("pos:R:3", "pos:R:2"), "line 2: positions must be a column pos:R:3 .* there is pos:R:2"),
    "no pos": (xyz(*RADII).replace("pos:R:3", "place:R:3"), "there is no pos"),
    "Properties": (xyz(*RADII).replace("pos:R:3", "pos:Q:3"), "Properties are not name:kind:number"),
    "cut Properties": (xyz(*RADII).replace("radius:R:1", "radius:R"), "Properties are not name:kind:number"),
    "twice": (xyz(":radius:R:1:radius:R:1", ("1 1", "1 1")), 'Properties name "radius" twice'),
    "too many": (xyz(":radius:R:1", ("0.5", "0.5 7")), "line 4: there are 6 values, but the columns .* take 5"),
    "too few": (xyz(":radius:R:1", ("0.5", "")), "line 4: there are 4 values"),
    "Fortran": (xyz(":radius:R:1", ("0.5", "5d-1")), "line 4: '5d-1' in the column radius is not a number"),
    "no integer": (xyz(":id:I:1:radius:R:1", ("1 0.5", "1.5 0.5")), "line 4: '1.5' in the column id is not an integer"),
    "vx alone": (xyz(":radius:R:1:vx:R:1", ("0.5 1", "0.5 1")), 'there is a column "vx", but not all of vx, vy, vz'),
    "flat velocities": (xyz(":radius:R:1:velo:R:2", ("0.5 1 1", "0.5 1 1")), "it must be three numbers"),
    "text": (xyz(":radius:S:1", ("big", "small")), "radii hold text"),
    "nan": (xyz(":radius:R:1", ("0.5", "nan")), "the radius of particle 1 is nan"),
    "blank": ("\n \n", "holds no frame"),
    "nobody": ("0\n\n", "holds no particles"),
    "cut": (xyz(*RADII)[:-15], "says in line 1 that 2 particles follow where 1 lines do"),
    "endless": (b"9" * 30 + b"\n", "line 1: the number of particles should stand here"),
    "junk": (bytes(range(256)) * 9, "line 1: the number of particles should stand here"),
    "no cell": ("1\n\nX 1 1 1\n", "there is no cell; .*--box 10,10,10"),
    "no radii": (xyz(), "there are no radii; .*--radius A=0.5,B=0.3"),
}  # fmt: skip


@pytest.mark.parametrize("row", WRONG)
def test_what_is_wrong_is_said_in_one_sentence_with_its_place(row, tmp_path):
    content, sentence = WRONG[row]
    with pytest.raises((hs.TrajectoryError, hs.SceneError), match=sentence) as caught:
        scene_of(tmp_path, content)
    assert "file.xyz" in str(caught.value) and "\n" not in str(caught.value)
    assert not any(
        word in str(caught.value) for word in ("KeyError", "ValueError", "IndexError", "TypeError")
    )


# Two dimensions, and boxes.

FLAT = xyz(*RADII, places=("1 1 0", "5 5 0")).replace('0 0 9"', '0 0 1"')


def test_a_flat_file_with_three_edges_is_of_discs_if_the_user_says_so(tmp_path):
    with pytest.raises(hs.SceneError, match="edge along z is 1.0.*if they are discs, say so with --dim 2"):
        scene_of(tmp_path, FLAT)
    assert scene_of(tmp_path, FLAT, dim=2)[0].box.tolist() == [9, 9]
    scene, notes = scene_of(tmp_path, FLAT.replace('0 0 1"', '0 0 9"'))
    assert scene.dim == 3 and "say so with --dim 2" in notes[0]
    assert scene_of(tmp_path, FLAT.replace('0 0 1"', '0 0 9"'), dim=3)[1] == []


@pytest.mark.parametrize(("height", "taken"), [(1e-8, True), (0.99e-6, True), (1.01e-6, False), (0.1, False)])
def test_noise_in_z_is_taken_up_to_a_millionth_of_a_diameter(height, taken, tmp_path):
    text = FLAT.replace("5 5 0", f"5 5 {height}").replace('0 0 1"', '0 0 0"')
    with pytest.raises(hs.TrajectoryError, match="particles 0 and 1 differ in z by .*, say --dim 2"):
        scene_of(tmp_path, text)
    if taken:
        assert scene_of(tmp_path, text, dim=2)[0].dim == 2
    else:
        with pytest.raises(
            hs.TrajectoryError, match="says two dimensions, but .* 1e-06 of the smallest diameter"
        ):
            scene_of(tmp_path, text, dim=2)


def test_motion_in_z_is_taken_up_to_a_millionth_of_the_fastest(tmp_path):
    text = xyz(":radius:R:1:momenta:R:3", ("0.5 1 2 1e-7", "0.5 0 1 0"), places=("1 1 0", "5 5 0"))
    assert scene_of(tmp_path, text, dim=2)[0].velocities.tolist() == [[1, 2], [0, 1]]
    with pytest.raises(hs.TrajectoryError, match="particle 0 moves along z, at 1e-05"):
        scene_of(tmp_path, text.replace("1e-7", "1e-5"), dim=2)


def test_a_box_for_a_file_without_one(tmp_path):
    text = xyz(*RADII).replace(LATTICE, "")
    scene, _ = scene_of(tmp_path, text, box=(9, 8, 7))
    assert scene.box.tolist() == [9, 8, 7] and scene.boundary == ("periodic",) * 3
    walls, _ = scene_of(tmp_path, text, box=(9, 8, 7), boundary=("wall", "periodic", "wall"))
    assert walls.boundary == ("wall", "periodic", "wall")
    discs, _ = scene_of(tmp_path, text.replace("1 1 1", "1 1 5"), box=(9, 8))
    assert discs.box.tolist() == [9, 8]
    for box, sentence in [
        ((9,), "two or three"),
        ((9, -1, 9), "positive"),
        ("wide", "two or three"),
        ((9, 9), "differ in z"),
    ]:
        with pytest.raises(hs.TrajectoryError, match=sentence):
            scene_of(tmp_path, text, box=box)
    with pytest.raises(hs.TrajectoryError, match="there is a cell already"):
        scene_of(tmp_path, xyz(*RADII), box=(9, 9, 9))
    with pytest.raises(hs.TrajectoryError, match="a boundary goes with a box"):
        scene_of(tmp_path, xyz(*RADII), boundary="wall")
    with pytest.raises(hs.TrajectoryError, match="says dimension=3, so dim=2"):
        scene_of(tmp_path, xyz(*RADII, "dimension=3"), dim=2)


# Formats with units of their own. Each file has velocities (1, 2, 3) and (-1, -2, -3), places 1 and 5, edges 9.

DUMP = """ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp pp ff
0 9
0 9
0 9
ITEM: ATOMS id type x y z vx vy vz{names}
2 2 5 5 5 -1 -2 -3{second}
1 1 1 1 1 1 2 3{first}
"""
PLAIN = DUMP.format(step=0, names="", first="", second="")
FULL = DUMP.format(step=0, names=" radius mass ix", first=" 0.1 2.5 0", second=" 0.1 2.5 0") + DUMP.format(
    step=1, names=" radius mass ix", first=" 0.5 2.5 0", second=" 0.25 4.5 1"
)
POSCAR = "two\n1.0\n9 0 0\n0 9 0\n0 0 9\nAr\n2\nCartesian\n1 1 1\n5 5 5\n\n1 2 3\n-1 -2 -3\n"
GRO = """two
    2
    1ARG     Ar    1   1.000   1.000   1.000  1.0000  2.0000  3.0000
    2ARG     Ar    2   5.000   5.000   5.000 -1.0000 -2.0000 -3.0000
   9.00000   9.00000   9.00000
"""
AIMS = """lattice_vector 9 0 0
lattice_vector 0 9 0
lattice_vector 0 0 9
atom 1 1 1 Ar
  velocity 1 2 3
atom 5 5 5 Ar
  velocity -1 -2 -3
"""
DATA = """LAMMPS data file

2 atoms
1 atom types
0 9 xlo xhi
0 9 ylo yhi
0 9 zlo zhi

Masses

1 2.5

Atoms # atomic

1 1 1 1 1
2 1 5 5 5

Velocities

1 1 2 3
2 -1 -2 -3
"""
CFG = (
    "Number of particles = 2\nA = 1.0 Angstrom\n"
    + "".join(f"H0({i},{j}) = {9 * (i == j)} A\n" for i in (1, 2, 3) for j in (1, 2, 3))
    + f"entry_count = 6\n2.5\nAr\n{1 / 9} {1 / 9} {1 / 9} 1 2 3\n{5 / 9} {5 / 9} {5 / 9} -1 -2 -3\n"
)
G96 = """TITLE
two
END
POSITION
    1 ARG   Ar         1    1.000000000    1.000000000    1.000000000
    1 ARG   Ar         2    5.000000000    5.000000000    5.000000000
END
BOX
    9.000000000    9.000000000    9.000000000
END
"""
PDB = """CRYST1    9.000    9.000    9.000  90.00  90.00  90.00 P 1
ATOM      1   Ar MOL     1       1.000   1.000   1.000  1.00  0.00          AR
ATOM      2   Ar MOL     1       5.000   5.000   5.000  1.00  0.00          AR
"""
XSF = "CRYSTAL\nPRIMVEC\n9 0 0\n0 9 0\n0 0 9\nPRIMCOORD\n2 1\n18 1 1 1\n18 5 5 5\n"
RES = (
    "TITL two 0 729 0 0 0 2 (P1) n - 1\nCELL 1.0 9 9 9 90 90 90\nLATT -1\nSFAC Ar\n"
    f"Ar 1 {1 / 9:.12f} {1 / 9:.12f} {1 / 9:.12f} 1.0\nAr 1 {5 / 9:.12f} {5 / 9:.12f} {5 / 9:.12f} 1.0\nEND\n"
)
# Name of the file: content, whether it has velocities, its masses, units of time and length in ASE's.
FORMATS = {
    "plain.lammpstrj": (PLAIN, True, None, 98.22694788, 1),
    "full.dump": (FULL, True, [2.5, 4.5], 98.22694788, 1),
    "two.lammps-data": (DATA, True, [2.5, 2.5], 98.22694788, 1),
    "POSCAR": (POSCAR, True, None, 0.09822694788, 1),
    "two.gro": (GRO, True, None, 98.22694788, 10),
    "geometry.in": (AIMS, True, None, 98.22694788, 1),
    "two.cfg": (CFG, True, [2.5, 2.5], 1, 1),
    "two.g96": (G96, False, None, 1, 10),
    "two.pdb": (PDB, False, None, 1, 1),
    "two.xsf": (XSF, False, None, 1, 1),
    "two.res": (RES, False, None, 1, 1),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_with_units_are_read_only_in_the_units_that_the_user_names(name, tmp_path):
    content, moving, masses, time, length = FORMATS[name]
    with pytest.raises(
        hs.TrajectoryError, match="reads in units of its own: .*say --units reduced .*or --units ase"
    ) as caught:
        scene_of(tmp_path, content, name, radius=0.1)
    assert ("velocities are converted" in str(caught.value)) == moving
    places, velocities = np.array([[1.0] * 3, [5.0] * 3]), np.array([[1.0, 2, 3], [-1, -2, -3]]) * moving
    scene, _ = scene_of(tmp_path, content, name, radius=0.1, units="reduced")
    np.testing.assert_allclose(scene.positions, places, rtol=1e-11)
    np.testing.assert_allclose(scene.velocities, velocities, rtol=1e-14)
    np.testing.assert_allclose(scene.box, 9, rtol=1e-14)
    assert scene.masses.tolist() == (masses or [1, 1])
    scene, _ = scene_of(tmp_path, content, name, radius=0.1, units="ase")
    np.testing.assert_allclose(scene.positions, length * places, rtol=1e-11)
    np.testing.assert_allclose(scene.velocities, length / time * velocities, rtol=1e-8)
    if masses is None:
        own = [1.008, 4.002602] if name == "plain.lammpstrj" else [39.948] * 2
        assert scene.masses.tolist() == own
    drawn, _ = scene_of(tmp_path, content, name, radius=0.1, mass=3.0, velocities=False)
    assert drawn.masses.tolist() == [3, 3] and not drawn.velocities.any()


def test_a_mass_of_the_users_does_not_change_the_velocities_of_a_format(tmp_path):
    scene, _ = scene_of(tmp_path, GRO, "two.gro", radius=0.1, units="reduced", mass=7.0)
    np.testing.assert_allclose(scene.velocities[0], [1, 2, 3], rtol=1e-14)


def test_columns_of_a_lammps_dump_that_ase_leaves_out(tmp_path):
    scene, notes = scene_of(tmp_path, FULL, "full.dump", units="reduced")
    assert scene.radii.tolist() == [0.5, 0.25] and scene.masses.tolist() == [2.5, 4.5]
    assert scene.boundary == ("periodic", "periodic", "wall") and notes == ['not used: column "ix"']
    frames = list(hs.read_trajectory(tmp_path / "full.dump", units="reduced"))
    assert [frame.radii.tolist() for frame in frames] == [[0.1, 0.1], [0.5, 0.25]]
    by_type = {"units": "reduced", "radius": {"1": 0.5, "2": 0.3}, "mass": {"1": 2, "2": 3}}
    scene, notes = scene_of(tmp_path, PLAIN, "plain.dump", **by_type)
    assert scene.radii.tolist() == [0.5, 0.3] and scene.masses.tolist() == [2, 3] and not notes


def test_cut_files_of_others_are_refused(tmp_path):
    with pytest.raises(
        hs.TrajectoryError, match="says in line 2 that 2 particles follow, but there are 1; .* cut short"
    ):
        scene_of(tmp_path, GRO[: GRO.index("   9.0")], "cut.gro", units="reduced", radius=0.1, box=(9, 9, 9))
    for cut in (FULL[:-12], POSCAR[:40], AIMS[:-20], XSF[:-6]):
        with pytest.raises(hs.TrajectoryError, match="cannot be read by ASE as|after ITEM: ATOMS"):
            name = next(name for name, row in FORMATS.items() if row[0].startswith(cut[:30]))
            scene_of(tmp_path, cut, name, units="reduced", radius=0.1)
    with pytest.raises(hs.TrajectoryError, match="damaged or cut short; whole frames before: 1"):
        scene_of(tmp_path, (2 * xyz(*RADII))[:-20])


def test_blank_lines_in_a_dump(tmp_path):
    scene, _ = scene_of(
        tmp_path, FULL.replace("ITEM: TIMESTEP", "\nITEM: TIMESTEP"), "full.dump", units="reduced"
    )
    assert scene.radii.tolist() == [0.5, 0.25]


def test_how_an_untried_format_converts_is_not_guessed(tmp_path):
    structure = ase.Atoms("Ar2", [[1, 1, 1], [5, 5, 5]], cell=[9, 9, 9], pbc=True)
    ase.io.write(tmp_path / "two.xtl.struct", structure, format="struct")
    with pytest.raises(hs.TrajectoryError, match="of the format struct, .* not known here; say --units ase"):
        read_scene(tmp_path / "two.xtl.struct", Reading(radius=0.1, units="reduced"))
    for units in ("SI", ""):
        with pytest.raises(hs.TrajectoryError, match="they must be reduced or ase"):
            Reading(units=units)


# Others read what we write.


def test_the_reader_in_c_finds_the_same_numbers(tmp_path):
    """It takes a column "velo" for Angstrom/fs and makes other momenta of it: ours is called Velo "
    "(control below)."""
    scene = hs.random_gas(50, 0.1, seed=3, masses=np.linspace(0.3, 3, 50), velocities="maxwell")
    path = tmp_path / "gas.xyz"
    with hs.TrajectoryWriter(path) as trajectory:
        trajectory.write(scene)
    for form in ("extxyz", "cextxyz"):
        atoms = ase.io.read(path, format=form)
        assert np.array_equal(atoms.positions, scene.positions) and np.array_equal(
            atoms.get_masses(), scene.masses
        )
        assert np.array_equal(atoms.get_momenta(), scene.masses[:, None] * scene.velocities)
        assert np.array_equal(atoms.arrays["radius"], scene.radii) and atoms.info["dimension"] == 3
        assert np.array_equal(np.diag(atoms.cell.array), scene.box) and atoms.pbc.all()
    path.write_text(path.read_text().replace(":Velo:", ":velo:"))
    assert not np.allclose(ase.io.read(path, format="cextxyz").get_velocities(), scene.velocities, rtol=0.5)
