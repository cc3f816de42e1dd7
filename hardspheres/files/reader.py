"""Structures and trajectories from files: extended xyz (`xyz`), GSD (`hoomd`), all else through ASE."""

import os
import warnings
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import ArrayLike

from hardspheres.atoms import Reading, logger, scene_and_notes
from hardspheres.errors import HardSpheresError, SceneError, TrajectoryError
from hardspheres.files import foreign, hoomd, xyz
from hardspheres.scene import Scene

Item = TypeVar("Item")


def read_structure(path: str | os.PathLike[str], index: int = -1, **reading: Any) -> Any:
    """Read one structure from a ``.gsd`` file or any that ASE reads.

    Parameters
    ----------
    path : str or path-like
        The file.
    index : int
        Which of its frames; the last by default.
    **reading
        Fields of `hardspheres.atoms.Reading`; of them `units` matters here, for formats that have units
        of their own.

    Returns
    -------
    ase.Atoms
        The structure; `Scene.from_atoms` makes it a scene.

    Raises
    ------
    TrajectoryError
        When there is no such file or frame, ASE cannot read it, or it depends on units that are not given.
    """
    return _structure(path, index, Reading(**reading))[0]


def read_scene(path: str | os.PathLike[str], reading: Reading, index: int = -1) -> tuple[Scene, list[str]]:
    """Read the scene in one frame of a file, and a sentence about everything changed or not used.

    Parameters
    ----------
    path : str or path-like
        A ``.gsd`` file, or any that ASE reads.
    reading : Reading
        How to interpret what is ambiguous in the file.
    index : int
        Which of its frames; the last by default.

    Raises
    ------
    TrajectoryError
        As `read_structure` and `Scene.from_atoms` do.
    SceneError
        When the frame is no valid scene.
    """
    atoms, notes = _structure(path, index, reading)
    with _named(path):
        scene, more = scene_and_notes(Scene, atoms, reading)
    return scene, notes + more


def read_trajectory(
    path: str | os.PathLike[str], radius: ArrayLike | Mapping[str, float] | None = None, **reading: Any
) -> Iterator[Scene]:
    """Read a trajectory frame by frame.

    Parameters
    ----------
    path : str or path-like
        A ``.gsd`` file, or one that ASE reads.
    radius : float, (N,) array_like or mapping of labels to floats, optional
        Radii, whatever the file has.
    **reading
        Other fields of `hardspheres.atoms.Reading`.

    Yields
    ------
    Scene
        Each frame, by `Scene.from_atoms`. Everything changed or not used is logged once, as a warning.

    Raises
    ------
    TrajectoryError
        When there is no such file, or ASE cannot read it.
    SceneError
        When a frame is no valid scene.
    """
    how, said = Reading(radius, **reading), set()
    for atoms, notes in structures(path, how):
        with _named(path):
            scene, more = scene_and_notes(Scene, atoms, how)
        for note in [*notes, *more]:
            if note not in said:
                said.add(note)
                logger.warning("%s: %s", path, note)
        yield scene


@contextmanager
def _named(path: str | os.PathLike[str]) -> Iterator[None]:
    """Put the name of the file before an error about its content."""
    try:
        yield
    except (SceneError, TrajectoryError) as error:
        if os.fspath(path) in str(error):
            raise
        raise type(error)(f"{os.fspath(path)}: {error}") from error


def _structure(path: str | os.PathLike[str], index: int, reading: Reading) -> tuple[Any, list[str]]:
    from ase import Atoms
    from ase.io import read

    file, form = existing(path), _format(path)
    if form == "extxyz":
        frame = _one_of(xyz.frames(file), index)
        if frame is None:
            raise TrajectoryError(f"{file} holds no frame{'' if index == -1 else f' of index {index}'}")
        return xyz.to_structure(file, frame)
    if form == "gsd":
        with hoomd.Reader(file) as frames:
            place = index if index >= 0 else index + len(frames)
            if not 0 <= place < len(frames):
                raise TrajectoryError(f"{file} holds no frame{'' if index == -1 else f' of index {index}'}")
            return frames.structure(place)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # readers that guess, warn
            options = foreign.reader_options(form, reading)
            atoms = read(file, index=index, format=form, do_not_split_by_at_sign=True, **options)
    except Exception as error:  # every reader fails in its own way
        raise unreadable(file, error, form) from error
    if not isinstance(atoms, Atoms) or not len(atoms):
        raise TrajectoryError(f"{file} holds no particles")
    return foreign.taken(atoms, form, file, reading, _one_of(foreign.tables(form, file), index)), []


def _one_of(items: Iterator[Item], index: int) -> Item | None:
    """Return the item of an index, as of a list, or None if there is none."""
    if index >= 0:
        return next(islice(items, index, None), None)
    last = deque(items, maxlen=-index)
    return last[0] if len(last) == -index else None


def structures(path: str | os.PathLike[str], reading: Reading) -> Iterator[tuple[Any, list[str]]]:
    """Yield each frame of a file as ASE's Atoms, and sentences about everything changed or not used."""
    from ase.io import iread

    file, form = existing(path), _format(path)
    if form == "extxyz":
        for frame in xyz.frames(file):
            yield xyz.to_structure(file, frame)
        return
    if form == "gsd":
        with hoomd.Reader(file) as frames_of_file:
            if not len(frames_of_file):
                raise TrajectoryError(f"{file} holds no frame")
            yield from frames_of_file
        return
    options = foreign.reader_options(form, reading)
    frames = iread(file, index=":", format=form, do_not_split_by_at_sign=True, **options)
    tables = foreign.tables(form, file)
    while True:
        try:
            atoms = next(frames)
        except StopIteration:
            return
        except Exception as error:  # every reader fails in its own way
            raise unreadable(file, error, form) from error
        yield foreign.taken(atoms, form, file, reading, next(tables, None)), []


def _format(path: str | os.PathLike[str]) -> str:
    """Return ASE's name of the format of a file, or gsd, which ASE does not read."""
    from ase.io.formats import UnknownFileTypeError, filetype, ioformats

    file = Path(path)
    if file.suffix in xyz.SUFFIXES:
        return "extxyz"
    if file.suffix == hoomd.SUFFIX:
        return "gsd"
    try:
        form = filetype(str(file))
        known = form in ioformats and ioformats[form].can_read
    except (UnknownFileTypeError, OSError, ValueError, UnicodeDecodeError):
        known = False
    if not known:
        raise TrajectoryError(
            f"{file} cannot be read by ASE: it is of no format that it knows; convert it to extended xyz "
            "(.xyz)"
        )
    return "extxyz" if form == "xyz" else str(form)


def binary_frames(path: Path) -> Any:
    """Return ASE's reader of a `.traj` file.

    Raises
    ------
    TrajectoryError
        When it is none.
    """
    import ase.io.trajectory as ase_trajectory

    reader: Any = ase_trajectory.TrajectoryReader
    try:
        return reader(str(existing(path)))
    except HardSpheresError:
        raise
    except Exception as error:  # a torn header fails in its own way
        raise unreadable(path, error, "traj") from error


def existing(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that exists and is not empty.

    Raises
    ------
    TrajectoryError
        When it is not.
    """
    file = Path(path)
    try:
        if file.is_dir():
            raise TrajectoryError(f"{file} is a folder; give a file")
        if not file.exists():
            raise TrajectoryError(f"there is no file {file}")
        if file.stat().st_size == 0:
            raise TrajectoryError(f"{file} is empty")
        with file.open("rb"):
            pass
    except OSError as error:
        raise TrajectoryError(
            f"{file} cannot be read: {error.strerror or error}; give another file"
        ) from error
    return file


def unreadable(file: str | os.PathLike[str], error: Exception, form: str) -> TrajectoryError:
    """Return the error for a file that ASE's reader of its format could not read."""
    return TrajectoryError(
        f"{file} cannot be read by ASE as {form} ({xyz.said(error)}); it is damaged or of another format"
    )
