"""The checkpoint folder of a study: results of what is finished, and the state of what is running.

    DIR/checkpoint/lock              held by the run that writes here; its content marks the folder as ours
    DIR/checkpoint/manifest.json     study, version and options; there is something to resume while it exists
    DIR/checkpoint/done-0007.npz     the result of item 7
    DIR/checkpoint/running-0007.npz  the state of item 7, saved at an interval

Every file is written atomically, so that `kill -9` loses only the work since the last one. When the study has
finished they are removed, the manifest first and the lock last, and the folder if it is then empty.

A folder of this name that was not made by this package is refused. Only files with the names above are ever
removed, one by one, and links are not followed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import hardspheres as hs
from hardspheres.errors import CheckpointError, HardSpheresError
from hardspheres.temporary import NAME, temporary_beside
from studies.running.encoding import read, write
from studies.running.locking import Lock
from studies.running.ownership import is_ordinary, load_object

__all__ = [
    "FOLDER",
    "Journal",
    "OutputError",
    "Shelf",
    "not_written",
    "options_of",
    "unfinished_in",
    "unfinished_run",
]

FOLDER, MANIFEST = "checkpoint", "manifest.json"
REMOVED = re.compile(rf"(done|running)-\d{{4,}}\.npz|\.?trajectory\.xyz(\.\w+)?|{NAME.pattern}")
NOT_COMPARED = {"workers"}  # an option without influence on the results


class OutputError(HardSpheresError, OSError):
    """The output folder cannot be made or written, or another run writes into it."""


@contextlib.contextmanager
def not_written(what: object = "") -> Iterator[None]:
    """Turn what the system says of a file, by default one of the checkpoint, into one sentence."""
    try:
        yield
    except OutputError:  # has the message already
        raise
    except OSError as error:
        name = what or " ".join(filter(None, ("the checkpoint", error.filename)))
        raise OutputError(f"{name} cannot be written: {error.strerror or error}") from error


@dataclass(frozen=True)
class Shelf:
    """Where results and states of items are kept, by number; what a worker process needs to know.

    Attributes
    ----------
    folder : Path
        The checkpoint folder.
    every : float
        Seconds of wall time between two states of an item that is running.
    """

    folder: Path
    every: float = 60.0

    def _path(self, what: str, index: int) -> Path:
        return self.folder / f"{what}-{index:04d}.npz"

    def result(self, index: int) -> tuple[Any] | None:
        """Return the result of an item in a tuple, None where it is not finished, or its file damaged."""
        return _whole(self._path("done", index))

    def store(self, index: int, result: Any) -> None:
        """Save the result of an item; its state is no longer needed."""
        # there are many, and the checksum reveals a torn one
        write(self._path("done", index), result, durable=False)
        self._path("running", index).unlink(missing_ok=True)

    def state(self, index: int) -> Any:
        """Return the state of an item that was running, None where there is none, or its file is damaged."""
        return (_whole(self._path("running", index)) or (None,))[0]

    def save(self, index: int, state: Any) -> None:
        """Save the state of a running item, replacing the one before."""
        write(self._path("running", index), state)


def _whole(path: Path) -> tuple[Any] | None:
    """Return the content of a file in a tuple; None where it is missing or damaged and must be redone."""
    if not path.exists():
        return None
    try:
        return (read(path),)
    except CheckpointError as error:
        warnings.warn(f"{error}; what it held is computed again", stacklevel=2)
        return None


def options_of(study: Any, skip: set[str] = NOT_COMPARED) -> dict[str, Any]:
    """Return the options of a study by their names on the command line.

    Parameters
    ----------
    study : dataclass
        Numbers, texts, tuples, dicts, scenes, and dataclasses of such.
    skip : set of str
        Names of fields that do not count.
    """
    found: dict[str, Any] = {}
    for field in fields(study):
        value = getattr(study, field.name)
        if field.name in skip:
            continue
        if isinstance(value, hs.Scene):
            arrays = (value.positions, value.velocities, value.radii, value.masses, value.box)
            digest = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
            found["the structure that it starts from"] = f"{digest[:12]} {' '.join(value.boundary)}"
        elif is_dataclass(value):
            found |= options_of(value, skip)
        elif isinstance(value, dict):
            found[f"--{field.name}"] = repr(value)
        else:
            name = "from" if field.name == "source" else field.name.replace("_", "-")
            found[f"--{name}"] = list(value) if isinstance(value, tuple) else value
    return found


def _words(value: Any) -> str:
    """Return an option's value as it is written on the command line."""
    if value is None:
        return "not given"
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def unfinished_in(out: Path) -> dict[str, Any] | None:
    """Return the manifest of the unfinished run in an output folder, None where there is none."""
    found = load_object(out / FOLDER / MANIFEST) or {}
    kinds = {"study": str, "version": str, "options": dict, "own": list}
    return found if all(isinstance(found.get(name), kind) for name, kind in kinds.items()) else None


def unfinished_run(out: Path) -> CheckpointError:
    """Return the message for an unfinished run that is in the way."""
    return CheckpointError(
        f"{out} holds an unfinished run; add --resume to continue it or --force to start again, or give "
        "another folder with --out"
    )


class Journal:
    """The checkpoint folder of one study, for the process that conducts it.

    Parameters
    ----------
    out : Path
        The study's output folder.
    study : dataclass
        Its options.
    every : float
        Seconds of wall time between two states of an item that is running.
    resume : bool
        Whether to continue the run in the folder.
    force : bool, default False
        Whether to start again where there is something to resume.
    place : Path, optional
        The output folder with its whole path, where `out` is how it is called.

    Attributes
    ----------
    own : set of str
        Files in the output folder that this run may replace: those of an earlier one, and what it has written
        itself.
    """

    def __init__(
        self,
        out: Path,
        study: Any,
        every: float,
        resume: bool,
        force: bool = False,
        place: Path | None = None,
    ) -> None:
        self.out, self.resume, self.force = out, resume, force
        self.own: set[str] = set()
        self._place = place or out.absolute()
        self.shelf = Shelf(self._place / FOLDER, every)
        self._lock, self._manifest = Lock(self.shelf.folder / "lock"), self.shelf.folder / MANIFEST
        name = getattr(study, "name", type(study).__module__.rpartition(".")[2])
        about = {"study": name, "version": hs.__version__, "options": options_of(study)}
        self._about: dict[str, Any] = json.loads(json.dumps(about))  # as it reads when it is resumed

    def check(self, claim: Callable[[set[str]], set[str]] = set) -> None:
        """Raise the errors that `open` would raise, without making anything.

        Raises
        ------
        OutputError
            If another run writes into the folder, or it is not ours.
        CheckpointError
            If there is nothing to resume, or something else; or an unfinished run where none is to be
            resumed.
        """
        with self._held(claim, make=False):
            pass

    @contextlib.contextmanager
    def open(self, claim: Callable[[set[str]], set[str]] = set) -> Iterator[Shelf]:
        """Hold the folder while the context lasts; remove it at the end unless there was an error.

        An error that leaves something to resume gets a note that says so.

        Parameters
        ----------
        claim : callable, optional
            Called before a run begins, with the files of an unfinished run that it takes the place of;
            returns all that it may replace, or raises.

        Raises
        ------
        OutputError, CheckpointError
            As `check` does, or if the folder cannot be made.
        """
        with self._held(claim, make=True):
            try:
                if not self.resume:
                    self._discard()
                    self._write_manifest()
                yield self.shelf
                self._discard()
            except BaseException as error:
                if self._manifest.exists():
                    error.add_note(
                        f"what was done is kept in {self.out / FOLDER}: the same command with --resume "
                        "continues"
                    )
                raise

    def may_write(self, name: str) -> None:
        """Record that a file in the output folder is this run's, before it is written."""
        if name not in self.own:
            self.own.add(name)
            self._write_manifest()

    @contextlib.contextmanager
    def _held(self, claim: Callable[[set[str]], set[str]], make: bool) -> Iterator[None]:
        """Hold the lock of a folder that is ours and in which this run may begin."""
        folder = self.shelf.folder
        try:
            with not_written():
                if make and not os.path.lexists(folder):
                    folder.mkdir(exist_ok=True)
                if os.path.lexists(folder):
                    self._take(make)
            before = unfinished_in(self._place)
            self._require_agreement(before)
            own = {str(name) for name in before["own"]} if before else set()
            self.own = own if self.resume else claim(own)
            yield
        finally:
            try:
                if make and self._lock.is_held() and not self._manifest.exists():
                    self._remove_folder()
            finally:
                self._lock.release()

    def _take(self, make: bool) -> None:
        """Take the lock of a folder that is ours."""
        folder = self.shelf.folder
        if folder.is_symlink() or not folder.is_dir():
            what = "a link" if folder.is_symlink() else "a file"
            raise OutputError(
                f"{folder} is {what}, not the folder of a run of hardspheres; give another folder with --out"
            )
        there = os.path.lexists(self._lock.path)
        for ready in (there, make):  # a lock is made only in what is known to be ours
            if ready and not self._lock.acquire():
                raise OutputError(
                    f"another run writes into {self.out}; give another folder with --out, or wait for it"
                )
            self._require_ours()

    def _require_ours(self) -> None:
        """Refuse a folder with files but neither a manifest nor a lock of ours.

        Refuse one of ours, too, in which something that is no file has the name of one of ours, so that
        nothing is written through a link.
        """
        folder, found = self.shelf.folder, list(self.shelf.folder.iterdir())
        for path in found:
            ours = REMOVED.fullmatch(path.name) or path in (self._lock.path, self._manifest)
            if ours and os.path.lexists(path) and not is_ordinary(path):
                what = "a link" if path.is_symlink() else "not a file"
                raise OutputError(
                    f"{path} is {what}, so not of a run of hardspheres; give another folder with --out"
                )
        if unfinished_in(self._place):
            return
        if self._manifest.exists():
            raise OutputError(
                f"{self._manifest} cannot be understood, so {folder} is not of a run of hardspheres; give "
                "another folder with --out"
            )
        others = [path.name for path in found if not NAME.fullmatch(path.name)]
        if others and not self._lock.is_ours():
            raise OutputError(
                f"{folder} is not of a run of hardspheres: it holds {min(others)}; give another folder with "
                "--out"
            )

    def _require_agreement(self, before: dict[str, Any] | None) -> None:
        """Refuse what cannot be resumed, and what is to be resumed and not begun again."""
        if before is None:
            if self.resume:
                raise CheckpointError(f"{self.out} holds no unfinished run, so there is nothing to resume")
            return
        if not self.resume:
            if not self.force:
                raise unfinished_run(self.out)
            return
        for what in ("study", "version"):
            if before[what] != self._about[what]:
                raise CheckpointError(
                    f"{self.out} holds an unfinished run of another {what}: {before[what]}, not "
                    f"{self._about[what]}"
                )
        old, new = before["options"], self._about["options"]
        for name in {**old, **new}:
            if old.get(name) != new.get(name):
                raise CheckpointError(
                    f"{self.out} holds an unfinished run with {name} {_words(old.get(name))}, not "
                    f"{_words(new.get(name))}; resume it with its original options"
                )

    def _write_manifest(self) -> None:
        temporary = temporary_beside(self._manifest)
        with not_written():
            try:
                content = {**self._about, "own": sorted(self.own)}
                temporary.write_text(json.dumps(content, indent=2), encoding="utf-8")
                os.replace(temporary, self._manifest)
            finally:
                temporary.unlink(missing_ok=True)

    def _discard(self) -> None:
        """Remove results and states, first what makes the folder resumable; the lock marks it as ours."""
        with not_written():
            self._manifest.unlink(missing_ok=True)
            for path in list(self.shelf.folder.iterdir()):
                # checked again: a removal cannot be undone
                if REMOVED.fullmatch(path.name) and is_ordinary(path):
                    path.unlink()

    def _remove_folder(self) -> None:
        """Remove the folder, unless it holds other files: then they and our lock stay."""
        with contextlib.suppress(OSError):
            if self._lock.is_ours() and list(self.shelf.folder.iterdir()) == [self._lock.path]:
                self._lock.path.unlink()
                self.shelf.folder.rmdir()
