"""Labels: the user's numbers, which follow particles through everything and decide nothing."""

import copy
import logging
import pickle
import re

import ase.io
import numpy as np
import pytest
from scenes import everything, gas

import hardspheres as hs
from hardspheres import archive
from studies.running.encoding import decode, encode

N = 60
LABELS = np.arange(N)[::-1] - 3
LARGE = np.where(np.arange(N) % 2, 2**62 + 1, -(2**63))


def labelled(kind="3d", labels=LABELS):
    return gas(kind, N, 0.1, seed=5).replace(labels=labels)


def same(scene, labels=LABELS):
    return scene.labels.dtype == np.int64 and scene.labels.tolist() == labels.tolist()


def test_labels_are_a_read_only_copy():
    given = LABELS.astype(np.int16)
    start = gas("3d", N, 0.1, seed=5)
    scene = hs.Scene(start.positions, start.velocities, box=start.box, labels=given)
    given[:] = 0
    assert same(scene) and not scene.labels.flags.writeable
    assert start.labels is None and scene.replace(labels=None).labels is None
    assert ", 60 labels" in repr(scene) and "label" not in repr(start)
    assert ", 1 label," in repr(start.replace(labels=[7] * N))


@pytest.mark.parametrize("kind", ["3d", "3d_mixture"])
def test_they_decide_nothing(kind):
    """Every bit that a user can see is that without labels; control: radii do decide."""
    seen = []
    for scene in (labelled(kind, None), labelled(kind), labelled(kind, np.zeros(N, int))):
        sim = hs.Simulation(scene)
        sim.run(collisions=300)
        seen.append(everything(sim))
    assert seen[0] == seen[1] == seen[2]
    other = labelled(kind).replace(radii=labelled(kind).radii * 0.999)
    sim = hs.Simulation(other)
    sim.run(collisions=300)
    assert everything(sim) != seen[0]


def test_they_follow_a_simulation(tmp_path):
    sim = hs.Simulation(labelled(labels=LARGE))
    sim.run(collisions=100)
    sim.save(tmp_path / "checkpoint")
    scenes = [sim.to_scene(), sim.frame().scene, copy.copy(sim).scene, copy.deepcopy(sim).scene]
    scenes += [pickle.loads(pickle.dumps(sim)).scene, hs.Simulation.load(tmp_path / "checkpoint").scene]
    scenes += [decode(encode(sim)).scene, decode(encode(sim.scene)), sim.with_log(len).scene]
    scenes += [copy.deepcopy(sim.scene), sim.scene.replace(masses=2.0), hs.Scene.from_atoms(sim.to_atoms())]
    for scene in scenes:
        assert same(scene, LARGE) and not scene.labels.flags.writeable


def test_a_state_that_the_engine_left_can_be_labelled():
    """Other labels alone check nothing else: a contact may overlap by rounding, which a new scene may not."""
    apart = hs.Scene([[1, 1, 1], [3, 1, 1]], [[1, 0, 0], [0.3, 1, 0]], box=(6, 6, 6))
    left = apart.with_state(np.array([[1, 1, 1], [2 - 5e-12, 1, 1]]), apart.velocities)
    assert left.replace(labels=[0, 1]).labels.tolist() == [0, 1]
    with pytest.raises(hs.SceneError, match="overlap"):
        left.replace(labels=[0, 1], masses=2.0)


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (3, "labels have shape (); they must be one integer for each of the 60 particles"),
        ("left", "labels have shape ()"),
        ([1] * (N - 1), "labels have shape (59,)"),
        ([[1]] * N, "labels have shape (60, 1)"),
        ([1] * (N - 1) + [2.0], "the label of particle 59 is 2.0; labels are integers"),
        (np.ones(N), "the label of particle 0 is 1.0; labels are integers"),
        ([0, True] + [1] * (N - 2), "the label of particle 1 is True; labels are integers"),
        (LABELS > 5, "the label of particle 0 is True; labels are integers"),
        (["left"] * N, "the label of particle 0 is 'left'; labels are integers"),
        ([1] * (N - 1) + [None], "the label of particle 59 is None"),
        (
            [2**63] + [1] * (N - 1),
            "the label of particle 0 is 9223372036854775808; labels have at most 64 bits",
        ),
        (np.full(N, 2**63, np.uint64), "labels have at most 64 bits"),
        (np.ma.array(LABELS, mask=LABELS > 5), "labels are a masked array"),
    ],
)
def test_what_is_no_label_is_refused(labels, message):
    with pytest.raises(hs.SceneError, match=re.escape(message)):
        labelled(labels=labels)


# Checkpoints.


def test_a_checkpoint_without_labels_has_none(tmp_path):
    """Also the way files were before there were labels."""
    hs.Simulation(labelled(labels=None)).save(tmp_path / "plain")
    assert "labels" not in archive.read_archive(tmp_path / "plain")
    assert hs.Simulation.load(tmp_path / "plain").scene.labels is None


@pytest.mark.parametrize(
    ("labels", "message"), [(LABELS[:-1], "shape (59,)"), (1.0 * LABELS, "particle 0 is 56.0")]
)
def test_a_checkpoint_with_bad_labels_is_refused(labels, message, tmp_path):
    hs.Simulation(labelled()).save(tmp_path / "checkpoint")
    archive.write_archive(
        tmp_path / "bad", archive.read_archive(tmp_path / "checkpoint") | {"labels": labels}
    )
    with pytest.raises(hs.CheckpointError, match=re.escape(message)):
        hs.Simulation.load(tmp_path / "bad")


# Files.


@pytest.mark.parametrize("suffix", ["xyz", "traj", "gsd"])
@pytest.mark.parametrize("kind", ["3d", "2d_mixture_walls"])
@pytest.mark.parametrize("labels", [LABELS, LARGE], ids=["small", "large"])
def test_files_keep_them(suffix, kind, labels, tmp_path):
    """With and without labels in one file; without them the file is what it was."""
    scene, path = labelled(kind, labels), tmp_path / f"gas.{suffix}"
    with hs.TrajectoryWriter(path) as trajectory:
        trajectory.write(scene)
        trajectory.write(hs.Simulation(scene).frame())
        trajectory.write(scene.replace(labels=None))
    first, second, third = hs.read_trajectory(path)
    assert same(first, labels) and same(second, labels) and third.labels is None
    assert first.positions.tobytes() == scene.positions.tobytes()
    if suffix == "xyz":
        lines = path.read_text().splitlines()
        assert "mass:R:1:label:I:1 time=" in lines[1] and "label" not in lines[2 * (N + 2) + 1]
        assert [line.rpartition(" ")[0] for line in lines[2 : N + 2]] == lines[2 * (N + 2) + 2 :]


def test_ase_reads_them(tmp_path):
    for suffix in ("xyz", "traj"):
        with hs.TrajectoryWriter(tmp_path / f"gas.{suffix}") as trajectory:
            trajectory.write(labelled())
    assert np.array_equal(ase.io.read(tmp_path / "gas.xyz").arrays["label"], LABELS)
    assert np.array_equal(ase.io.read(tmp_path / "gas.traj").get_tags(), LABELS)
    assert not labelled(labels=None).to_atoms().has("tags")


def test_labels_that_are_all_zero_survive_where_they_are_a_column(tmp_path):
    with hs.TrajectoryWriter(tmp_path / "gas.xyz") as trajectory:
        trajectory.write(labelled(labels=0 * LABELS))
    (again,) = hs.read_trajectory(tmp_path / "gas.xyz")
    assert same(again, 0 * LABELS)


def test_tags_are_labels_unless_all_are_zero(tmp_path, caplog):
    atoms = labelled(labels=None).to_atoms()
    atoms.set_tags(0)
    assert hs.Scene.from_atoms(atoms).labels is None and not caplog.text
    atoms.set_tags(LABELS)
    assert same(hs.Scene.from_atoms(atoms))
    ase.io.write(tmp_path / "tags.xyz", atoms)  # as ASE writes it: a column tags
    (again,) = hs.read_trajectory(tmp_path / "tags.xyz")
    assert same(again)
    atoms.set_array("label", LABELS + (LABELS == 0))
    with pytest.raises(
        hs.TrajectoryError, match='"tags" and "label" differ for particle 56; leave one of them out'
    ):
        hs.Scene.from_atoms(atoms)


def test_a_label_follows_its_id(tmp_path):
    (tmp_path / "ids.xyz").write_text(
        '2\nLattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:id:I:1:label:I:1 radius=0.5\n'
        "X 1 1 1 5000000002 7\nX 5 5 5 5000000001 8\n"
    )
    (scene,) = hs.read_trajectory(tmp_path / "ids.xyz")
    assert scene.labels.tolist() == [8, 7] and scene.positions[0].tolist() == [5, 5, 5]


def test_integers_and_names_are_two_things(tmp_path, caplog):
    """Names that are no elements are species, beside a column of integers; radii by either."""
    path = tmp_path / "both.xyz"
    path.write_text(
        '2\nLattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:label:I:1\nbig 1 1 1 7\nsmall 5 5 5 8\n'
    )
    for radius in ({"big": 0.5, "small": 0.3}, {"7": 0.5, "8": 0.3}):
        (scene,) = hs.read_trajectory(path, radius, mass=1)
        assert scene.labels.tolist() == [7, 8] and scene.radii.tolist() == [0.5, 0.3]
    caplog.set_level(logging.WARNING)
    path.write_text(path.read_text().replace("label:I", "label:R"))
    (scene,) = hs.read_trajectory(path, 0.5)
    assert scene.labels is None and 'not used: column "label"' in caplog.text


@pytest.mark.parametrize("value", ["1.5", "x", str(2**63)])
def test_a_label_that_is_no_integer_is_named_with_its_line(value, tmp_path):
    path = tmp_path / "bad.xyz"
    path.write_text(
        f'1\nLattice="9 0 0 0 9 0 0 0 9" Properties=species:S:1:pos:R:3:label:I:1\nX 1 1 1 {value}\n'
    )
    with pytest.raises(hs.TrajectoryError, match=f"line 3: '{value}' in the column label is not an integer"):
        list(hs.read_trajectory(path, 0.5))
