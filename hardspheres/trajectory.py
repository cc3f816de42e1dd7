"""ASE in and out: scenes and frames as Atoms, trajectories frame by frame, and structures that others have made.

Extended xyz (``.xyz``, ``.extxyz``) is text with 8 decimals, for OVITO and for looking; ``.traj`` keeps every bit, takes half
the space and a hundredth of the time. Both hold positions, momenta (mass times velocity; ASE has a unit of its own for a
column of velocities, and none for momenta), masses, radii, box and boundaries, and in the header `time`, `collisions`,
``units=reduced`` and `dimension`. A 2D gas lies in the plane z = 0 and has a zero third cell vector.

**Printed positions can overlap.** Two touching spheres whose coordinates are rounded to 8 decimals may end up 2.8e-8 too
close (each of the 3 separations off by 1e-8, each radius by 5e-9). So `from_atoms` takes overlaps up to 3e-8 for rounding:
it makes all radii smaller, by half of the worst overlap, and moves nothing. Larger ones are refused like in any scene, and
scenes without any overlap, such as exact ones, keep every bit.
"""

import io
import logging
import os
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres.cells import worst_overlap
from hardspheres.errors import TrajectoryError
from hardspheres.scene import Scene, contact_tolerance, one_per_particle, worst_beyond_wall

Floats = NDArray[np.float64]

SINGLE = "X"  # ASE's unknown element, of mass 1
MIXTURE = (
    "O",
    "N",
    "S",
    "Cl",
    "I",
    "C",
    "P",
    "F",
    "B",
    "H",
)  # colours that OVITO and ASE tell apart: red, blue, yellow...
COLUMNS = ["symbols", "positions", "momenta", "masses", "radius"]
PRINTED = 1.5e-8  # most by which a radius is reduced: half of the overlap that 8 decimals can make
SMALL = 1e-4  # and never by more than this fraction of the smallest radius

logger = logging.getLogger(__name__)


class FrameLike(Protocol):
    """What a writer needs of a frame: `hardspheres.simulation.Frame` has it."""

    @property
    def time(self) -> float:
        """Simulated time."""

    @property
    def collisions(self) -> int:
        """Pair collisions so far."""

    @property
    def positions(self) -> Floats:
        """Positions, (N, d)."""

    @property
    def velocities(self) -> Floats:
        """Velocities, (N, d)."""

    @property
    def scene(self) -> Scene:
        """Radii, masses, species, box and boundary."""


def to_atoms(state: Scene | FrameLike) -> Any:
    """Return a scene or a frame as an ASE Atoms object.

    Parameters
    ----------
    state : Scene or Frame
        What to convert. A scene counts as time 0.

    Returns
    -------
    ase.Atoms
        Positions, momenta, masses, cell and pbc; radii in ``arrays["radius"]`` and, since ASE's ``.traj`` drops that array,
        in ``info["radius"]`` once it is written there; `time`, `collisions`, `units`, `dimension` in ``info``. All particles
        are ``X`` where there is one species; up to ten species are called O, N, S, Cl, I, C, P, F, B, H in the order of
        `Scene.species` (colours only, the masses are the scene's); of more than ten all are ``X``.
    """
    from ase import Atoms

    scene = state if isinstance(state, Scene) else state.scene
    time = 0.0 if isinstance(state, Scene) else float(state.time)
    collisions = 0 if isinstance(state, Scene) else int(state.collisions)
    kinds = int(scene.species.max()) + 1
    symbols = [SINGLE] * scene.n if not 1 < kinds <= len(MIXTURE) else [MIXTURE[k] for k in scene.species]
    flat = np.zeros((scene.n, 3 - scene.dim))
    cell = np.zeros(3)
    cell[: scene.dim] = scene.box
    atoms: Any = Atoms(
        symbols,
        positions=np.hstack([state.positions, flat]),
        cell=cell,
        pbc=[*scene.periodic.tolist(), *[False] * (3 - scene.dim)],
        masses=scene.masses,
        momenta=np.hstack([scene.masses[:, None] * state.velocities, flat]),
        info={"time": time, "collisions": collisions, "units": "reduced", "dimension": scene.dim},
    )
    atoms.set_array("radius", scene.radii, float, ())
    return atoms


def has_velocities(atoms: Any) -> bool:
    """Whether an Atoms object carries momenta (all zero counts: a gas at rest)."""
    return bool(atoms.has("momenta"))


def from_atoms(atoms: Any, radius: ArrayLike | None = None) -> Scene:
    """Return the scene in an ASE Atoms object.

    Parameters
    ----------
    atoms : ase.Atoms
        Positions; an orthogonal cell, whose first corner is the origin (or ``celldisp``); pbc, where False means a wall;
        masses (ASE's own for the element where none are given); momenta (particles are at rest without, see
        `has_velocities`). Two-dimensional where ``info["dimension"]`` says so, or the third cell vector is zero.
    radius : float or (N,) array_like, optional
        Radii. Without it they are taken from ``arrays["radius"]``, ``arrays["radii"]``, ``info["radius"]`` or
        ``info["radii"]``, whichever is there first.

    Returns
    -------
    Scene
        The scene. Where spheres overlap each other or a wall by no more than 8 printed decimals explain (3e-8 between two
        spheres, in the unit of length of the file, and a ten-thousandth of the smallest diameter), all radii are reduced by
        half of the worst overlap, which is logged; positions and velocities are as given. Without overlap beyond the
        tolerance of `Scene` every bit is as given (velocities are momenta over masses, so where a mass is no power of two
        their last bit may differ from the one that was written).

    Raises
    ------
    TrajectoryError
        When there is no orthogonal cell, no radius, or velocities are in a column whose unit is not known.
    SceneError
        When what is there makes no legal scene.
    """
    box, dim = _box(atoms)
    positions = np.array(atoms.get_positions() - atoms.get_celldisp().reshape(1, 3), dtype=np.float64)
    masses = one_per_particle(atoms.get_masses(), "masses", len(atoms))
    velocities = atoms.get_momenta() / masses[:, None]
    for name in ("velo", "vel", "velocity", "velocities"):
        if not has_velocities(atoms) and name in atoms.arrays:
            raise TrajectoryError(
                f'velocities are in a column "{name}", whose unit differs between programs; give momenta, mass times '
                "velocity, in a column momenta"
            )
    if dim == 2:
        _require_flat(positions, velocities)
    boundary = ["periodic" if wraps else "wall" for wraps in atoms.pbc[:dim]]
    positions, velocities = positions[:, :dim], velocities[:, :dim]
    radii = one_per_particle(_radius(atoms) if radius is None else radius, "radii", len(atoms))
    if np.isfinite(positions).all() and len(atoms):
        radii = _within_print(positions, radii, box, np.asarray(atoms.pbc[:dim], dtype=np.bool_))
    return Scene(positions, velocities, radii, masses, box, boundary)


def _box(atoms: Any) -> tuple[Floats, int]:
    """Edge lengths of an orthogonal cell, and the dimension."""
    cell = np.array(atoms.cell.array if hasattr(atoms.cell, "array") else atoms.cell, dtype=np.float64)
    edges: Floats = np.diagonal(cell).copy()
    if not cell.any():
        raise TrajectoryError(
            "there is no cell; give the box as an orthogonal cell (in extended xyz: Lattice=...)"
        )
    if not np.isfinite(cell).all():
        raise TrajectoryError("the cell has an entry that is not finite; give an orthogonal cell")
    if np.any(np.abs(cell - np.diag(edges)) > 1e-12 * edges.max()):
        raise TrajectoryError(
            f"the cell is not orthogonal along x, y, z (its vectors are {cell.tolist()}); only boxes with right angles work"
        )
    dimension = atoms.info.get("dimension", 2 if edges[2] == 0 else 3)
    if dimension not in (2, 3):
        raise TrajectoryError(f"dimension is {dimension!r} in the header; it must be 2 or 3")
    if np.any(edges[:dimension] <= 0):
        raise TrajectoryError(
            f"the cell has edges {edges.tolist()}; all {dimension} of them must be positive"
        )
    return edges[:dimension], int(dimension)


def _require_flat(positions: Floats, velocities: Floats) -> None:
    """Refuse a third dimension in a gas whose header or cell says that it has two."""
    off_plane = np.flatnonzero(positions[:, 2] != positions[:1, 2])
    if len(off_plane):
        raise TrajectoryError(
            "the header or a third cell vector of zero says two dimensions, but particles 0 and "
            f"{off_plane[0]} differ in z; give three cell vectors, or positions in one plane"
        )
    moving = np.flatnonzero(velocities[:, 2])
    if len(moving):
        raise TrajectoryError(
            "the header or a third cell vector of zero says two dimensions, but particle "
            f"{moving[0]} moves along z; give three cell vectors, or velocities in the plane"
        )


def _radius(atoms: Any) -> Any:
    for place in (atoms.arrays, atoms.info):
        for name in ("radius", "radii"):
            if name in place:
                return place[name]
    raise TrajectoryError("there are no radii; give them in a column radius, or as radius=... (--radius)")


def _within_print(positions: Floats, radii: Floats, box: Floats, periodic: NDArray[np.bool_]) -> Floats:
    """Radii reduced by half of the worst overlap, where that is no more than 8 printed decimals explain."""
    folded = np.where(periodic, np.mod(positions, box), positions)
    folded = np.where(periodic & (folded >= box), 0.0, folded)
    largest = 2 * float(radii.max())
    too_long = float(np.max(np.where(periodic, (2 * largest - box) / 4, (largest - box) / 2)))
    beyond = worst_beyond_wall(folded, radii, box, periodic)[0]
    most = min(PRINTED, SMALL * float(radii.min()))
    if max(too_long, beyond) > most:  # the scene will say what is wrong
        return radii
    overlap = worst_overlap(folded, radii, box, periodic)[2]
    tolerance = contact_tolerance(box)
    excess = max(too_long, beyond, 0.5 * overlap)
    if (too_long <= 0 and beyond <= tolerance and overlap <= tolerance) or excess > most:
        return radii
    logger.info("radii reduced by %.3g so that printed positions do not overlap", excess)
    return radii - excess * (1 + 1e-6)  # a little more than enough, for rounding


class TrajectoryWriter:
    """Write frames to a file as they come; nothing is kept in memory.

    Use it in a ``with`` block, or call `close`. Each frame is complete in the file when `write` returns.

    Parameters
    ----------
    path : str or path-like
        ``.xyz`` or ``.extxyz`` for extended xyz, ``.traj`` for ASE's binary format; replaced if it exists.
    keep : int, default 0
        Keep so many frames of the file that exists and write on after them; what follows them, such as a frame that was
        half written when a run was killed, is cut off.

    Raises
    ------
    TrajectoryError
        When the extension is another one, the file cannot be written, or it has fewer frames than are to be kept.

    Examples
    --------
    >>> with TrajectoryWriter("gas.xyz") as trajectory:  # doctest: +SKIP
    ...     for frame in sim.frames(every=0.1, count=100):
    ...         trajectory.write(frame)
    """

    def __init__(self, path: str | os.PathLike[str], *, keep: int = 0) -> None:
        self.path = Path(path)
        if self.path.suffix not in (".xyz", ".extxyz", ".traj"):
            raise TrajectoryError(
                f"{self.path} has the extension {self.path.suffix!r}; a trajectory ends in .xyz, .extxyz or .traj"
            )
        try:
            self._open(keep)
        except OSError as error:
            raise self._unwritable(error) from error

    def _open(self, keep: int) -> None:
        self._text: io.TextIOWrapper | None = None
        self._binary: Any = None
        if self.path.suffix == ".traj":
            self._binary = _binary_after(self.path, keep)
        else:
            end = _end_of_frames(self.path, keep) if keep else 0
            self._text = self.path.open("a" if keep else "w", encoding="utf-8", newline="\n")
            if keep:
                self._text.truncate(end)

    def write(self, frame: Scene | FrameLike) -> None:
        """Append a frame or a scene.

        Raises
        ------
        TrajectoryError
            When the file is closed or cannot be written (disk full).
        """
        from ase.io.extxyz import write_xyz

        atoms = to_atoms(frame)
        try:
            if self._text is not None:
                whole = io.StringIO()  # so that a frame reaches the file in one piece
                write_xyz(whole, [atoms], columns=COLUMNS)
                self._text.write(whole.getvalue())
                self._text.flush()
            elif self._binary is not None:
                atoms.info["radius"] = atoms.arrays.pop("radius")
                self._binary.write(atoms)
            else:
                raise TrajectoryError(f"{self.path} is closed; no more frames can be written")
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        handles = [handle for handle in (self._text, self._binary) if handle is not None]
        self._text = self._binary = None
        try:
            for handle in handles:
                handle.close()
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> TrajectoryError:
        return TrajectoryError(f"{self.path} cannot be written: {error.strerror or error}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except TrajectoryError:
            if error is None:  # after a failed write the first error is the one to show
                raise


def _too_short(path: Path, there: int, keep: int) -> TrajectoryError:
    return TrajectoryError(f"{path} has {there} whole frames, so {keep} of them cannot be kept")


def _end_of_frames(path: Path, count: int) -> int:
    """Return the length in bytes of the first frames of an xyz file."""
    with path.open("rb") as handle:
        for frame in range(count):
            head = handle.readline()
            rest = int(head) + 1 if head.strip().isdigit() else 0
            lines = [handle.readline() for _ in range(rest)]
            if not lines or not lines[-1].endswith(b"\n"):
                raise _too_short(path, frame, count)
        return handle.tell()


def _binary_after(path: Path, keep: int) -> Any:
    """Return ASE's writer after the first frames of a file, which are copied: the format cannot be cut."""
    import ase.io.trajectory as ase_trajectory

    open_writer: Any = ase_trajectory.TrajectoryWriter
    if not keep:
        return open_writer(str(path), "w")
    copy = path.with_name(f".{path.name}.kept")
    try:
        with open_writer(str(copy), "w") as writer, _binary_frames(path) as frames:
            if len(frames) < keep:
                raise _too_short(path, len(frames), keep)
            for index in range(keep):
                writer.write(frames[index])
        os.replace(copy, path)
    finally:
        copy.unlink(missing_ok=True)
    return open_writer(str(path), "a")


def _binary_frames(path: Path) -> Any:
    import ase.io.trajectory as ase_trajectory

    reader: Any = ase_trajectory.TrajectoryReader
    try:
        return reader(str(_existing(path)))
    except TrajectoryError:
        raise
    except Exception as error:  # a torn header fails in its own way
        raise _unreadable(str(path), error) from error


def read_structure(path: str | os.PathLike[str], index: int = -1) -> Any:
    """Read one structure from any file that ASE reads.

    Parameters
    ----------
    path : str or path-like
        The file.
    index : int
        Which of its frames; the last by default.

    Returns
    -------
    ase.Atoms
        The structure; `from_atoms` makes it a scene.

    Raises
    ------
    TrajectoryError
        When there is no such file or frame, or ASE cannot read it.
    """
    from ase import Atoms
    from ase.io import read

    file = _existing(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # readers that guess, warn
            atoms = read(file, index=index, do_not_split_by_at_sign=True)
    except Exception as error:  # every reader fails in its own way
        raise _unreadable(file, error) from error
    if not isinstance(atoms, Atoms) or not len(atoms):
        raise TrajectoryError(f"{file} holds no particles")
    return atoms


def read_trajectory(path: str | os.PathLike[str], radius: ArrayLike | None = None) -> Iterator[Scene]:
    """Read a trajectory frame by frame.

    Parameters
    ----------
    path : str or path-like
        A file that ASE reads.
    radius : float or (N,) array_like, optional
        Radii where the file has none.

    Yields
    ------
    Scene
        Each frame, by `from_atoms`.

    Raises
    ------
    TrajectoryError
        When there is no such file, or ASE cannot read it.
    SceneError
        When a frame is no legal scene.
    """
    from ase.io import iread

    file = _existing(path)
    frames = iread(file, index=":", do_not_split_by_at_sign=True)
    while True:
        try:
            atoms = next(frames)
        except StopIteration:
            return
        except Exception as error:  # every reader fails in its own way
            raise _unreadable(file, error) from error
        yield from_atoms(atoms, radius)


def _existing(path: str | os.PathLike[str]) -> str:
    file = Path(path)
    try:
        if file.is_dir():
            raise TrajectoryError(f"{file} is a folder; give a file")
        if not file.exists():
            raise TrajectoryError(f"there is no file {file}")
        if file.stat().st_size == 0:
            raise TrajectoryError(f"{file} is empty")
        if file.suffix in (".xyz", ".extxyz"):
            _require_room_for_counts(file)
    except OSError as error:
        raise TrajectoryError(
            f"{file} cannot be read: {error.strerror or error}; give another file"
        ) from error
    return str(file)


def _require_room_for_counts(file: Path) -> None:
    """Refuse an xyz file with a frame of more particles than bytes; ASE would look for them, line by line."""
    size = file.stat().st_size
    with file.open("rb") as handle:
        while line := handle.readline():
            try:
                count = int(line)
            except ValueError:
                return  # no frame begins here: ASE finds words for that
            left = size - handle.tell()
            if count > left:
                raise TrajectoryError(
                    f"{file} says that {count} particles follow where {left} bytes do; it is damaged or cut short"
                )
            for _ in range(count + 1):
                handle.readline()


def _unreadable(file: str, error: Exception) -> TrajectoryError:
    said = ": ".join(filter(None, (type(error).__name__, " ".join(str(error).split()))))
    return TrajectoryError(f"{file} cannot be read by ASE ({said})")
