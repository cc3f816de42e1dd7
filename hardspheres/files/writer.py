"""Frames to a file as they come: extended xyz, ASE's own binary format `.traj`, or `.gsd`."""

import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from hardspheres.atoms import VELOCITY, FrameLike, to_atoms
from hardspheres.errors import TrajectoryError
from hardspheres.files import hoomd
from hardspheres.files.reader import binary_frames, existing
from hardspheres.files.xyz import SUFFIXES, frame_text
from hardspheres.scene import Scene
from hardspheres.temporary import remove_leftovers, replacing


class TrajectoryWriter:
    """Write frames to a file as they come; nothing is kept in memory.

    Use it in a ``with`` block, or call `close`. Each frame is complete in the file when `write` returns.

    Extended xyz (``.xyz``, ``.extxyz``) has every number with the fewest digits that read back to the same
    float64: the scene that is read is the one that was written, bit for bit. Columns are species, pos,
    momenta, masses, radius, Velo and mass, which OVITO reads, and label where there are labels; the header
    has `time`, `collisions` and `dimension`. ``.traj`` is ASE's own; it holds momenta and masses, whose ratio
    may be a rounding off the velocity where a mass is no power of two. ``.gsd`` is for OVITO, HOOMD, freud
    and MDAnalysis, which read single precision; what that loses stands beside it, so that the scene comes
    back bit for bit. It needs the package gsd: ``pip install 'hardspheres[gsd]'``.

    Parameters
    ----------
    path : str or path-like
        ``.xyz`` or ``.extxyz`` for extended xyz, ``.traj`` for ASE's binary format, ``.gsd`` for HOOMD's;
        replaced if it exists.
    keep : int, default 0
        Keep so many frames of an existing file and append to them; the rest, such as an incomplete frame of a
        killed run, is cut off.
    units : str, optional
        Name of the units for the header, ``units=...``: a label only, nothing is converted.

    Raises
    ------
    TrajectoryError
        When the extension is another one, the file cannot be written, it has fewer frames than are to be
        kept, or a ``.gsd`` file is asked for and the package gsd is not installed.

    Examples
    --------
    >>> with TrajectoryWriter("gas.xyz") as trajectory:  # doctest: +SKIP
    ...     for frame in sim.frames(every=0.1, count=100):
    ...         trajectory.write(frame)
    """

    def __init__(self, path: str | os.PathLike[str], *, keep: int = 0, units: str | None = None) -> None:
        self.path = Path(path)
        self.units = units
        if self.path.suffix not in (*SUFFIXES, ".traj", hoomd.SUFFIX):
            raise TrajectoryError(
                f"{self.path} has the extension {self.path.suffix!r}; a trajectory ends in .xyz, .extxyz, "
                ".traj or .gsd"
            )
        try:
            self._open(keep)
        except OSError as error:
            raise self._unwritable(error) from error

    def _open(self, keep: int) -> None:
        self._text: IO[bytes] | None = None
        self._binary: Any = None
        self._gsd: hoomd.Writer | None = None
        if self.path.suffix == hoomd.SUFFIX:
            self._gsd = _gsd_after(self.path, keep)
        elif self.path.suffix == ".traj":
            self._binary = _binary_after(self.path, keep)
        else:
            end = _end_of_frames(self.path, keep) if keep else 0
            self._text = self.path.open("ab" if keep else "wb")
            if keep:
                self._text.truncate(end)

    def __repr__(self) -> str:
        """Return which file it is, and whether it is open."""
        return f"<TrajectoryWriter of {self.path}, {'open' if self._handles() else 'closed'}>"

    def _handles(self) -> list[Any]:
        return [each for each in (self._text, self._binary, self._gsd) if each is not None]

    def write(self, frame: Scene | FrameLike) -> None:
        """Append a frame or a scene.

        Raises
        ------
        TrajectoryError
            When the file is closed or cannot be written (disk full).
        """
        try:
            if self._gsd is not None:
                self._gsd.write(frame, self.units)
                return
            atoms = to_atoms(frame, self.units)
            if self._text is not None:
                self._text.write(frame_text(atoms))  # in one piece
                self._text.flush()
            elif self._binary is not None:
                atoms.info["radius"] = atoms.arrays.pop("radius")
                del atoms.arrays[VELOCITY]
                self._binary.write(atoms)
            else:
                raise TrajectoryError(f"{self.path} is closed; no more frames can be written")
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        handles = self._handles()
        self._text = self._binary = self._gsd = None
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
    with replacing(path) as copy, open_writer(str(copy), "w") as writer, binary_frames(path) as frames:
        remove_leftovers(path.parent, copy.stat().st_mtime)
        if len(frames) < keep:
            raise _too_short(path, len(frames), keep)
        for index in range(keep):
            writer.write(frames[index])
    return open_writer(str(path), "a")


def _gsd_after(path: Path, keep: int) -> hoomd.Writer:
    """Return a writer after the first frames of a file, which are copied, as for `.traj`."""
    if keep:
        with replacing(path) as copy:
            there = hoomd.keep_frames(existing(path), copy, keep)
            if there < keep:
                raise _too_short(path, there, keep)
            remove_leftovers(path.parent, copy.stat().st_mtime)
    return hoomd.Writer(path, append=bool(keep))
