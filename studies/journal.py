"""The checkpoint folder of a study: results of what is finished, and the state of what is running.

    DIR/checkpoint/lock              held by the run that writes here
    DIR/checkpoint/manifest.json     study, version and options; there is something to resume once it exists
    DIR/checkpoint/done-0007.npz     the result of item 7
    DIR/checkpoint/running-0007.npz  the state of item 7, saved at an interval

Every file is written whole or not at all, so that `kill -9` costs what was done since the last one and no more. The folder
is removed when the study has finished.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import hardspheres as hs
from hardspheres.errors import CheckpointError, HardSpheresError
from studies.encoding import read, write
from studies.locking import Lock

__all__ = ["FOLDER", "Journal", "OutputError", "Shelf", "options_of"]

FOLDER = "checkpoint"
NOT_COMPARED = {"workers"}  # an option without influence on the results


class OutputError(HardSpheresError, OSError):
    """The output folder cannot be made or written, or another run writes into it."""


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
        """Keep the result of an item; its state is no longer needed."""
        write(self._path("done", index), result, durable=False)  # there are many, and the checksum tells
        self._path("running", index).unlink(missing_ok=True)

    def state(self, index: int) -> Any:
        """Return the state of an item that was running, None where there is none, or its file is damaged."""
        found = _whole(self._path("running", index))
        return None if found is None else found[0]

    def save(self, index: int, state: Any) -> None:
        """Keep the state of an item that is running, in place of the one before."""
        write(self._path("running", index), state)


def _whole(path: Path) -> tuple[Any] | None:
    """Return what a file holds in a tuple, None where it is missing or damaged: then that item is run again."""
    if not path.exists():
        return None
    try:
        return (read(path),)
    except CheckpointError as error:
        warnings.warn(f"{error}; what it held is computed again", stacklevel=2)
        return None


@contextlib.contextmanager
def _said() -> Iterator[None]:
    try:
        yield
    except OutputError:  # says it already
        raise
    except OSError as error:
        where = f"{error.filename} " if error.filename else ""
        raise OutputError(f"the checkpoint {where}cannot be written: {error.strerror or error}") from error


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


class Journal:
    """The checkpoint folder of one study, seen by the process that conducts it.

    Parameters
    ----------
    out : Path
        The study's output folder.
    study : dataclass
        Its options.
    every : float
        Seconds of wall time between two states of an item that is running.
    resume : bool
        Whether to go on with what is there.
    """

    def __init__(self, out: Path, study: Any, every: float, resume: bool) -> None:
        self.out, self.resume = out, resume
        self.shelf = Shelf((out / FOLDER).absolute(), every)
        self._lock = Lock(self.shelf.folder / "lock")
        name = type(study).__module__.rpartition(".")[2]
        self._manifest = {"study": name, "version": hs.__version__, "options": options_of(study)}

    @property
    def _manifest_path(self) -> Path:
        return self.shelf.folder / "manifest.json"

    def check(self) -> None:
        """Refuse what `open` would refuse, and make nothing.

        Raises
        ------
        OutputError
            If another run writes into the folder.
        CheckpointError
            If there is nothing to resume, or something else; or an unfinished run where none is to be resumed.
        """
        with _said():
            if self._lock.path.exists():
                self._take_lock()
        self._lock.release()
        self._refuse()

    def _take_lock(self) -> None:
        if not self._lock.acquire():
            raise OutputError(
                f"another run writes into {self.out}; give another folder with --out, or wait for it"
            )

    def _refuse(self) -> None:
        there = self._manifest_path.exists()
        if there and not self.resume:
            raise CheckpointError(
                f"{self.out} holds an unfinished run; add --resume to go on with it, or remove {self.out / FOLDER} to begin "
                "anew"
            )
        if self.resume and not there:
            raise CheckpointError(f"{self.out} holds no unfinished run, so there is nothing to resume")
        if self.resume:
            self._require_same()

    def _require_same(self) -> None:
        try:
            before = json.loads(self._manifest_path.read_text(encoding="utf-8"))
            study, version, options = before["study"], before["version"], dict(before["options"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise CheckpointError(
                f"{self._manifest_path} cannot be understood; remove {self.out / FOLDER}"
            ) from error
        now = json.loads(json.dumps(self._manifest))
        for what, old, new in (("study", study, now["study"]), ("version", version, now["version"])):
            if old != new:
                raise CheckpointError(
                    f"{self.out} holds an unfinished run of another {what}: {old}, not {new}"
                )
        for name in {**options, **now["options"]}:
            old, new = options.get(name), now["options"].get(name)
            if old != new:
                raise CheckpointError(
                    f"{self.out} holds an unfinished run with {name} {_words(old)}, not {_words(new)}; resume it with the "
                    "options that it was begun with"
                )

    @contextlib.contextmanager
    def open(self) -> Iterator[Shelf]:
        """Hold the folder while the context lasts; remove it when that ends well.

        An error that leaves something to resume gets a note that says so.

        Raises
        ------
        OutputError, CheckpointError
            As `check` does, or if the folder cannot be made.
        """
        with _said():
            self.shelf.folder.mkdir(exist_ok=True)
            self._take_lock()
        try:
            self._refuse()
            if not self.resume:
                self._begin()
            yield self.shelf
            self._remove()
        except BaseException as error:
            if self._manifest_path.exists():
                error.add_note(
                    f"what was done is kept in {self.out / FOLDER}: the same command with --resume goes on"
                )
            raise
        finally:
            if not self._manifest_path.exists():
                shutil.rmtree(self.shelf.folder, ignore_errors=True)
            self._lock.release()

    def _begin(self) -> None:
        with _said():
            for path in self.shelf.folder.iterdir():  # left by a run that was killed while it removed them
                if path != self._lock.path:
                    path.unlink()
            temporary = self._manifest_path.with_suffix(".partial")
            temporary.write_text(json.dumps(self._manifest, indent=2), encoding="utf-8")
            os.replace(temporary, self._manifest_path)

    def _remove(self) -> None:
        with _said():
            self._manifest_path.unlink()  # first, and alone: from now on there is nothing to resume
