"""GSD files: exact for us, single precision for others, and what other programs write."""

import os
import re
import sys

import gsd.fl
import gsd.hoomd
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import gas

import hardspheres as hs
from hardspheres.atoms import Reading, has_velocities
from hardspheres.files.reader import read_scene, read_structure

KINDS = ["3d", "2d", "3d_walls", "2d_mixture_walls", "3d_mixture"]
SPACING = 2.0**-24  # of single precision, relative


def frames(kind, count=3, n=60):
    scene = gas(kind, n, 0.1, seed=5)
    return list(hs.Simulation(scene).frames(every=0.7, count=count))


def write(path, states, **options):
    with hs.TrajectoryWriter(path, **options) as trajectory:
        for state in states:
            trajectory.write(state)
    return path


def now(frame):
    return frame.scene.with_state(frame.positions, frame.velocities)


def bits(scene):
    arrays = (scene.positions, scene.velocities, scene.radii, scene.masses, scene.box, scene.species)
    return *(array.tobytes() for array in arrays), scene.boundary


def everything(path):
    """Frames as gsd's own module reads them, to be changed and written again."""
    with gsd.hoomd.open(path) as trajectory:
        return list(trajectory)


def rewritten(path, change, precision="single"):
    """The file after another program changed its frames, and kept what it did not know."""
    states = everything(path)
    other = path.with_name("other.gsd")
    with gsd.hoomd.open(
        other, "w", **({} if precision == "single" else {"precision": precision})
    ) as trajectory:
        for state in states:
            change(state)
            trajectory.append(state)
    return other


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_comes_back_bit_for_bit(kind, tmp_path):
    """Control: without the exact columns, as a program that does not know them writes it, digits are lost."""
    states = frames(kind)
    path = write(tmp_path / "gas.gsd", states)
    read = list(hs.read_trajectory(path))
    assert [bits(scene) for scene in read] == [bits(now(state)) for state in states]
    lost = list(hs.read_trajectory(rewritten(path, lambda state: state.log.clear())))
    for scene, state in zip(lost, states, strict=True):
        assert np.array_equal(scene.velocities, state.velocities.astype(np.float32))
        assert not np.array_equal(scene.positions, state.positions)
        assert np.allclose(scene.box, state.scene.box, rtol=SPACING, atol=0)
        assert scene.boundary == ("periodic",) * scene.dim


@pytest.mark.parametrize("kind", KINDS)
def test_other_programs_find_it(kind, tmp_path):
    states = frames(kind)
    path = write(tmp_path / "gas.gsd", states, units="SI")
    for state, other in zip(states, everything(path), strict=True):
        scene, parts, (n, dim) = state.scene, other.particles, state.positions.shape
        box = scene.box
        assert (parts.N, other.configuration.dimensions, other.configuration.step) == (
            n,
            dim,
            state.collisions,
        )
        assert np.array_equal(other.configuration.box, np.float32([*box, *[0] * (6 - dim)]))
        assert parts.position.dtype == parts.velocity.dtype == np.float32
        apart = parts.position[:, :dim] + box / 2 - state.positions
        apart -= np.where(scene.periodic, box * np.rint(apart / box), 0)
        assert np.abs(apart).max() < SPACING * box.max() and not parts.position[:, dim:].any()
        assert np.all(np.abs(parts.position[:, :dim]) <= np.float32(box) / 2)
        unwrapped = parts.position[:, :dim] + box / 2 + parts.image[:, :dim] * box
        assert np.allclose(unwrapped, state.unwrapped_positions, atol=8 * SPACING * np.abs(unwrapped).max())
        assert np.array_equal(parts.velocity[:, :dim], np.float32(state.velocities))
        assert np.array_equal(parts.mass, np.float32(scene.masses))
        assert np.array_equal(parts.diameter, np.float32(2 * scene.radii))
        symbols = scene.to_atoms().get_chemical_symbols()
        assert [parts.types[kind] for kind in parts.typeid] == symbols
        assert other.log["hardspheres/time"].tolist() == [state.time]
    assert not states[-1].scene.periodic.any() or parts.image.any()  # control: some crossed the boundary
    atoms = read_structure(path)
    assert atoms.info["units"] == "SI" and atoms.info["time"] == states[-1].time
    assert atoms.info["collisions"] == states[-1].collisions > 0 == read_structure(path, 0).info["time"]


def test_a_coordinate_on_the_upper_face_is_written_on_the_lower_one(tmp_path):
    """It is rounded up to L/2, where HOOMD says that the particle is outside."""
    box = np.array([10.1, 10.1, 10.1])
    edge = np.nextafter(10.1, 0)
    scene = hs.Scene(
        [[edge, 5, 5], [5, 5, edge - 0.5]], np.zeros((2, 3)), box=box, boundary=("periodic", "wall", "wall")
    )
    path = write(tmp_path / "edge.gsd", [scene])
    (frame,) = everything(path)
    assert frame.particles.position[0, 0] == -np.float32(10.1) / 2 and frame.particles.image[0].tolist() == [
        1,
        0,
        0,
    ]
    assert [bits(again) for again in hs.read_trajectory(path)] == [bits(scene)]


def test_what_does_not_change_is_written_once(tmp_path):
    path = write(tmp_path / "gas.gsd", frames("3d_mixture"))
    with gsd.fl.open(str(path), "r") as file:
        second = {name for name in file.find_matching_chunk_names("") if file.chunk_exists(1, name)}
    moving = {"log/particles/exact_position", "log/particles/exact_velocity", "log/hardspheres/time"}
    moving |= {"particles/position", "particles/velocity", "configuration/step"}
    assert second - {"particles/image"} == moving


def test_another_gas_in_one_file(tmp_path):
    """Numbers, labels and boundaries that change within a file, and change back."""
    first, other = gas("3d", 60, 0.1), gas("2d_mixture_walls", 30, 0.1).replace(labels=np.arange(30))
    states = [
        first,
        other,
        other.replace(labels=None),
        first.replace(masses=2.0),
        first.replace(labels=[1] * 60),
        first,
    ]
    path = write(tmp_path / "gas.gsd", states)
    read = list(hs.read_trajectory(path))
    assert [bits(scene) for scene in read] == [bits(state) for state in states]
    assert [None if s.labels is None else s.labels.tolist() for s in read] == [
        None if s.labels is None else s.labels.tolist() for s in states
    ]
    assert [frame.log["particles/label"].sum() for frame in everything(path)[1:]] == [435, 0, 0, 60, 0]


# Files that somebody has changed.


@pytest.mark.parametrize(
    ("change", "which"),
    [
        (lambda s: s.particles.velocity.__imul__(2), "velocities"),
        (lambda s: s.particles.mass.__imul__(2), "masses"),
        (lambda s: s.particles.diameter.__imul__(0.5), "radii"),
        (lambda s: s.particles.position.__imul__(0.999999), "positions"),
        (lambda s: s.configuration.box[:3].__imul__(2), "positions, box"),
    ],
)
def test_a_column_that_was_changed_counts(change, which, tmp_path, caplog):
    """And only that one: the rest stays exact."""

    def changing(state):
        state.particles.mass, state.particles.diameter = (
            state.particles.mass.copy(),
            state.particles.diameter.copy(),
        )
        change(state)

    (state,) = frames("3d_mixture", 1)
    path = rewritten(write(tmp_path / "gas.gsd", [state]), changing)
    (scene,) = hs.read_trajectory(path)
    assert f"changed since this package wrote them, so less exact: {which}" in caplog.text
    exact = now(state)
    parts = {"positions": 0.999999, "velocities": 2, "masses": 2, "radii": 0.5, "box": 2}
    for name, factor in parts.items():
        value, written = getattr(scene, name), getattr(exact, name)
        if name in which.split(", "):
            assert not np.array_equal(value, written)
            if name != "positions":
                assert np.allclose(value, factor * written, rtol=2 * SPACING)
        else:
            assert np.array_equal(value, written)


def test_nothing_is_said_of_a_copy(tmp_path, caplog):
    (state,) = frames("3d_walls", 1)
    path = write(tmp_path / "gas.gsd", [state])
    for precision in ("single", "double")[: 1 + hasattr(gsd.hoomd.HOOMDTrajectory, "precision")]:
        (scene,) = hs.read_trajectory(rewritten(path, lambda _: None, precision))
        assert bits(scene) == bits(now(state)) and not caplog.text


def test_particles_that_somebody_added(tmp_path, caplog):
    """The exact numbers are of others then; box and walls still hold."""
    (state,) = frames("3d_walls", 1)

    def fewer(frame):
        parts = frame.particles
        parts.N = 50
        for name in (
            "position",
            "velocity",
            "mass",
            "diameter",
            "typeid",
            "image",
            "charge",
            "body",
            "moment_inertia",
        ):
            setattr(parts, name, getattr(parts, name)[:50])
        parts.orientation, parts.angmom = parts.orientation[:50], parts.angmom[:50]

    (scene,) = hs.read_trajectory(rewritten(write(tmp_path / "gas.gsd", [state]), fewer))
    assert (
        scene.n == 50
        and scene.boundary == state.scene.boundary
        and "less exact: positions, vel" in caplog.text
    )


# Files of other programs.


def frame_of(positions, box, **columns):
    frame = gsd.hoomd.Frame()
    frame.configuration.box = box
    frame.particles.N, frame.particles.position = len(positions), positions
    for name, values in columns.items():
        setattr(frame.particles, name, values)
    return frame


def written_by_others(path, *states, **options):
    with gsd.hoomd.open(path, "w", **options) as trajectory:
        for state in states:
            trajectory.append(state)
    return path


TWO = [[-4, 0, 0], [3, 1, 2]]
CUBE = [10, 10, 10, 0, 0, 0]


def test_a_file_of_hoomd(tmp_path, caplog):
    """What the second frame does not say is as in the first one."""
    first = frame_of(
        TWO,
        CUBE,
        types=["A", "B"],
        typeid=[0, 1],
        diameter=[1, 0.5],
        mass=[2, 3],
        velocity=[[1, 0, 0], [0, 1, 0]],
    )
    first.configuration.step = 7
    second = frame_of([[-3, 0, 0], [3, 2, 2]], CUBE)
    second.configuration.step = 9
    path = written_by_others(tmp_path / "hoomd.gsd", first, second)
    one, two = hs.read_trajectory(path)
    for scene in (one, two):
        assert scene.radii.tolist() == [0.5, 0.25] and scene.masses.tolist() == [2, 3]
        assert scene.velocities.tolist() == [[1, 0, 0], [0, 1, 0]] and scene.labels is None
        assert scene.boundary == ("periodic",) * 3 and scene.box.tolist() == [10, 10, 10]
    assert one.positions.tolist() == [[1, 5, 5], [8, 6, 7]] and two.positions.tolist() == [
        [2, 5, 5],
        [8, 7, 7],
    ]
    assert not caplog.text
    (one, _) = hs.read_trajectory(path, {"A": 0.1, "B": 0.2})
    assert one.radii.tolist() == [0.1, 0.2]
    with pytest.raises(hs.TrajectoryError, match="the label C has no particle; labels are A, B"):
        list(hs.read_trajectory(path, {"A": 0.1, "B": 0.2, "C": 0.3}))
    assert read_scene(path, Reading(), 0)[0].positions[0].tolist() == [1, 5, 5]
    with pytest.raises(hs.TrajectoryError, match=r"hoomd.gsd holds no frame of index 2"):
        read_structure(path, 2)


def test_defaults_of_the_format(tmp_path, caplog):
    """No velocities are no velocities; that all diameters are 1 is said, unless shapes or the user say other."""
    path = written_by_others(tmp_path / "plain.gsd", frame_of(TWO, CUBE))
    atoms = read_structure(path)
    assert not has_velocities(atoms)
    (scene,) = hs.read_trajectory(path)
    assert scene.radii.tolist() == [0.5, 0.5] and scene.masses.tolist() == [1, 1]
    assert "there are no diameters, so that of the format is taken, 1 (--radius gives others)" in caplog.text
    caplog.clear()
    shaped = frame_of(TWO, CUBE, types=["A", "B"], typeid=[0, 1])
    shaped.particles.type_shapes = [{"type": "Sphere", "diameter": 0.6}, {"type": "Sphere", "diameter": 0.4}]
    (scene,) = hs.read_trajectory(written_by_others(tmp_path / "shapes.gsd", shaped))
    assert scene.radii.tolist() == [0.3, 0.2] and not caplog.text


@pytest.mark.parametrize("lz", [0, 1])
def test_discs(lz, tmp_path):
    """HOOMD's present versions have no third edge, older ones one of any length."""
    frame = frame_of(
        [[-4, 0, 0], [3, 1, 0]], [10, 8, lz, 0, 0, 0], diameter=[1, 1], velocity=[[1, 2, 0], [0, 0, 0]]
    )
    frame.configuration.dimensions = 2
    (scene,) = hs.read_trajectory(written_by_others(tmp_path / "discs.gsd", frame))
    assert scene.box.tolist() == [10, 8] and scene.positions.tolist() == [[1, 4], [8, 5]]
    assert scene.velocities[0].tolist() == [1, 2]


@pytest.mark.skipif(not hasattr(gsd.hoomd.HOOMDTrajectory, "precision"), reason="an older gsd")
def test_double_precision(tmp_path):
    """As HOOMD may write it today."""
    places = np.random.default_rng(1).random((2, 3)) * [1, 1, 3] + [[0, 0, -4], [0, 0, 1]]
    path = written_by_others(
        tmp_path / "double.gsd", frame_of(places, CUBE, diameter=np.array([0.1, 0.3])), precision="double"
    )
    (scene,) = hs.read_trajectory(path)
    assert np.array_equal(scene.positions, places + 5) and scene.radii.tolist() == [0.05, 0.15]
    assert "precision" not in read_structure(path).info


@pytest.mark.parametrize("dim", [2, 3])
def test_touching_spheres_in_single_precision_are_a_scene(dim, tmp_path, caplog):
    """Rounding makes them overlap, by more than printed decimals explain; what it does not explain is refused."""
    scene = hs.lattice_gas(n={2: 418, 3: 500}[dim], packing_fraction={2: 0.9, 3: 0.74}[dim], dim=dim, seed=1)
    crystal = scene.replace(positions=scene.positions + 0.123456789)
    grown = crystal.replace(radii=crystal.radii * (1 + 1e-9))
    del crystal
    nearest = min(
        np.linalg.norm(d - grown.box * np.rint(d / grown.box))
        for d in grown.positions[1:] - grown.positions[0]
    )
    touching = grown.replace(radii=0.5 * nearest * (1 - 1e-12))
    path = rewritten(write(tmp_path / "gas.gsd", [touching]), lambda state: state.log.clear())
    (again,) = hs.read_trajectory(path)
    less = touching.radii[0] - again.radii[0]
    assert (
        1.5e-8 < less <= 1.01 * 2 * SPACING * touching.box.max()
        and "all radii made smaller by" in caplog.text
    )

    def larger(state):
        state.log.clear()
        state.particles.diameter = np.full(
            state.particles.N, np.float32(2 * touching.radii[0]) + 8 * SPACING * touching.box.max()
        )

    with pytest.raises(hs.SceneError, match="overlap by"):
        list(hs.read_trajectory(rewritten(tmp_path / "gas.gsd", larger)))


def test_what_is_not_used_is_said(tmp_path, caplog):
    frame = frame_of(TWO, CUBE, diameter=[0.5, 0.5], charge=[1, -1])
    frame.bonds.N, frame.bonds.group, frame.bonds.types, frame.bonds.typeid = 1, [[0, 1]], ["bond"], [0]
    frame.log["particles/energy"], frame.log["pressure"] = np.ones(2), np.ones(1)
    frame.log["particles/label"] = np.array([4, 5], dtype=np.int32)
    (scene,) = hs.read_trajectory(written_by_others(tmp_path / "more.gsd", frame))
    assert "not used: charge, bonds, log/particles/energy" in caplog.text
    assert scene.labels.tolist() == [4, 5]


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (frame_of(TWO, [10, 10, 10, 0.1, 0, 0]), "the cell is not orthogonal along x, y, z"),
        (frame_of(TWO, CUBE, diameter=[1, -1]), "the radius of particle 1 is -0.5"),
        (frame_of([[0, 0, 0], [np.nan, 1, 1]], CUBE), "the position of particle 1 along x is nan"),
        (frame_of([[0, 0, 0], [0.5, 0, 0]], CUBE), "particles 0 and 1 overlap by 0.5 diameters"),
        (frame_of(TWO, CUBE, typeid=[0, 5]), "cannot be read as a trajectory of HOOMD (IndexError"),
    ],
)
def test_bad_frames_get_one_sentence(frame, message, tmp_path):
    path = written_by_others(tmp_path / "bad.gsd", frame)
    with pytest.raises((hs.TrajectoryError, hs.SceneError), match=re.escape(message)) as caught:
        list(hs.read_trajectory(path))
    assert "\n" not in str(caught.value) and "bad.gsd" in str(caught.value)


# Files that are none, or not whole.


def other_schema(path, schema, version):
    with gsd.fl.open(str(path), "w", "test", schema, version) as file:
        file.write_chunk("a", np.arange(3))
        file.end_frame()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (bytes(range(256)) * 9, "Not a GSD file: bad.gsd); it is damaged, cut short or of another format"),
        (b"2\ntext\nX 0 0 0\nX 1 1 1\n", "Not a GSD file"),
        (1, "Corrupt GSD file"),
        (500, "Corrupt GSD file"),
        (-200, "Not a GSD file"),
        (("other", [1, 0]), "has incorrect schema: other"),
        (("hoomd", [9, 0]), "Incompatible hoomd schema version (9, 0));"),
        (("hoomd", [1, 4]), "holds no particles in frame 0"),
        (None, "holds no frame"),
    ],
)
def test_a_file_that_is_no_trajectory_gets_one_sentence(content, message, tmp_path):
    path = tmp_path / "bad.gsd"
    if isinstance(content, tuple):
        other_schema(path, *content)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        write(path, frames("2d", 2) if content else [])
        path.write_bytes(path.read_bytes()[: -content if content else None])
    for reader in (read_structure, lambda path: list(hs.read_trajectory(path))):
        with pytest.raises(hs.TrajectoryError, match=re.escape(message)) as caught:
            reader(path)
        assert "\n" not in str(caught.value) and str(caught.value).startswith(str(path))


@settings(max_examples=40, deadline=None)
@given(st.binary(min_size=1, max_size=40), st.integers(0, 20000), st.integers(0, 3000))
def test_altered_bytes_never_escape_as_another_error(tmp_path_factory, noise, where, cut):
    path = tmp_path_factory.getbasetemp() / "altered.gsd"
    write(path, [hs.lattice_gas(4, 0.1, seed=1)])
    whole = bytearray(path.read_bytes())
    where %= len(whole)
    whole[where : where + len(noise)] = noise
    path.write_bytes(whole[: len(whole) - max(cut - 2700, 0)])
    try:
        list(hs.read_trajectory(path))
    except (hs.TrajectoryError, hs.SceneError) as error:
        assert "\n" not in str(error)


def test_each_frame_is_in_the_file_when_write_returns(tmp_path):
    path = tmp_path / "gas.gsd"
    trajectory = hs.TrajectoryWriter(path)
    for k, state in enumerate(frames("2d"), 1):
        trajectory.write(state)
        assert len(everything(path)) == k
    assert repr(trajectory) == f"<TrajectoryWriter of {path}, open>"
    trajectory.close()
    trajectory.close()
    assert repr(trajectory) == f"<TrajectoryWriter of {path}, closed>"
    with pytest.raises(hs.TrajectoryError, match="is closed"):
        trajectory.write(state)
    write(path, frames("2d", 1))  # replaced, as any trajectory
    assert len(everything(path)) == 1


@pytest.mark.parametrize("keep", [1, 3])
def test_writing_goes_on_after_a_kill_within_a_frame(keep, tmp_path, monkeypatch):
    """Three frames are whole; of the fourth all chunks are there, but not its end."""
    states = [
        state.scene.replace(labels=range(60)) if k % 2 else state for k, state in enumerate(frames("3d", 6))
    ]
    whole, killed = write(tmp_path / "whole.gsd", states), tmp_path / "killed.gsd"
    trajectory = hs.TrajectoryWriter(killed)
    for state in states[:3]:
        trajectory.write(state)

    class Dies:
        def __init__(self, file):
            self.file = file

        def __getattr__(self, name):
            return getattr(self.file, name)

        def end_frame(self):
            killed.with_suffix(".copy").write_bytes(killed.read_bytes())
            raise KeyboardInterrupt

    monkeypatch.setattr(trajectory._gsd, "_file", Dies(trajectory._gsd._file))
    with pytest.raises(KeyboardInterrupt):
        trajectory.write(states[3])
    os.replace(killed.with_suffix(".copy"), killed)
    assert [bits(s) for s in hs.read_trajectory(killed)] == [bits(s) for s in hs.read_trajectory(whole)][:3]
    write(killed, states[keep:], keep=keep)
    read, expected = list(hs.read_trajectory(killed)), list(hs.read_trajectory(whole))
    assert [bits(scene) for scene in read] == [bits(scene) for scene in expected]
    assert [scene.labels is None for scene in read] == [k % 2 == 0 for k in range(6)]
    assert len(everything(killed)) == 6
    assert {path.name for path in tmp_path.iterdir()} == {"whole.gsd", "killed.gsd"}


def test_frames_that_are_not_there_cannot_be_kept(tmp_path):
    path = write(tmp_path / "short.gsd", frames("2d", 1))
    before = path.read_bytes()
    with pytest.raises(hs.TrajectoryError, match="has 1 whole frames, so 2 of them cannot be kept"):
        hs.TrajectoryWriter(path, keep=2)
    path.write_bytes(before[:-10])
    with pytest.raises(hs.TrajectoryError, match="Corrupt GSD file"):
        hs.TrajectoryWriter(path, keep=1)
    assert path.read_bytes() == before[:-10]
    with pytest.raises(hs.TrajectoryError, match="there is no file"):
        hs.TrajectoryWriter(tmp_path / "absent.gsd", keep=1)
    with pytest.raises(hs.TrajectoryError, match="cannot be written: No such file"):
        hs.TrajectoryWriter(tmp_path / "missing" / "gas.gsd")
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_full_disk_is_one_sentence_and_leaves_what_was_whole(tmp_path):
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    trajectory, states = hs.TrajectoryWriter(tmp_path / "gas.gsd"), frames("3d", 2)
    trajectory.write(states[0])
    resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / "gas.gsd").stat().st_size + 100, hard))
    try:
        with (
            pytest.raises(hs.TrajectoryError, match=r"gas.gsd cannot be written: File too large"),
            trajectory,
        ):
            trajectory.write(states[1])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [bits(scene) for scene in hs.read_trajectory(tmp_path / "gas.gsd")] == [bits(now(states[0]))]


def test_what_single_precision_cannot_hold_is_refused(tmp_path):
    """Metres and kilograms of an atom it holds."""
    atoms = hs.lattice_gas(
        n=20, packing_fraction=0.1, radii=1.7e-10, masses=6.6e-26, temperature=4e-21, seed=1
    )
    path = write(tmp_path / "gas.gsd", [atoms])
    assert [bits(scene) for scene in hs.read_trajectory(path)] == [bits(atoms)]
    for factor in (1e-40, 1e40):
        with pytest.raises(
            hs.TrajectoryError, match="leaves the range of single precision, which .gsd has; write .xyz"
        ):
            write(path, [atoms.replace(masses=factor)])
    (state,) = frames("2d", 1)
    broken = type(
        "State", (), {"time": 0.0, "collisions": 0, "positions": state.positions, "scene": state.scene}
    )
    broken.velocities = state.velocities * np.nan
    with pytest.raises(hs.TrajectoryError, match="a number is not finite"):
        write(path, [broken])


@pytest.mark.parametrize(
    "use", [hs.TrajectoryWriter, read_structure, lambda path: next(hs.read_trajectory(path))]
)
def test_without_the_package_one_sentence_says_what_to_install(use, tmp_path, monkeypatch):
    path = write(tmp_path / "gas.gsd", frames("2d", 1))
    before = path.read_bytes()
    for name in ("gsd", "gsd.fl", "gsd.hoomd"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(hs.TrajectoryError) as caught:
        use(path)
    assert str(caught.value) == f"{path} needs the package gsd: pip install 'hardspheres[gsd]'"
    assert path.read_bytes() == before
