"""The checkpoint folder of a study: results of what is finished, and the state of what is running.

    DIR/checkpoint/lock              held by the run that writes here DIR/checkpoint/manifest.json     study,
    version and options; there is something to resume once it exists DIR/checkpoint/done-0007.npz     the
    result of item 7 DIR/checkpoint/running-0007.npz  the state of item 7, saved at an interval
    DIR/checkpoint/finished.json     the former manifest, while the rest is being removed

Every file is written atomically, so that `kill -9` loses only the work since the last one. When the study has
finished they are removed, and the folder if it is then empty.

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

__all__ = ["FOLDER", "Journal", "OutputError", "Shelf", "options_of", "unfinished_run"]

FOLDER = "checkpoint"
OURS = re.compile(rf"(done|running)-\d{{4,}}\.npz|\.?trajectory\.xyz(\.\w+)?|{NAME.pattern}")
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
        """Save the result of an item; its state is no longer needed."""
        # there are many, and the checksum reveals a torn one
        write(self._path("done", index), result, durable=False)
        self._path("running", index).unlink(missing_ok=True)

    def state(self, index: int) -> Any:
        """Return the state of an item that was running, None where there is none, or its file is damaged."""
        found = _whole(self._path("running", index))
        return None if found is None else found[0]

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


@contextlib.contextmanager
def _said() -> Iterator[None]:
    try:
        yield
    except OutputError:  # has the message already
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
        if field.name in skip or value is None:
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
            option = field.metadata.get("option")
            name = option.named(field.name) if option else f"--{field.name.replace('_', '-')}"
            found[name] = list(value) if isinstance(value, tuple) else value
    return found


def _words(value: Any) -> str:
    """Return an option's value as it is written on the command line."""
    if value is None:
        return "not given"
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


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
        self.shelf = Shelf((place or out.absolute()) / FOLDER, every)
        self._lock = Lock(self.shelf.folder / "lock")
        name = getattr(study, "name", type(study).__module__.rpartition(".")[2])
        self._manifest = {"study": name, "version": hs.__version__, "options": options_of(study)}

    @property
    def _manifest_path(self) -> Path:
        return self.shelf.folder / "manifest.json"

    @property
    def _finished_path(self) -> Path:
        return self.shelf.folder / "finished.json"

    def check(self) -> None:
        """Raise the errors that `open` would raise, without making anything.

        Raises
        ------
        OutputError
            If another run writes into the folder, or it is not ours.
        CheckpointError
            If there is nothing to resume, or something else; or an unfinished run where none is to be
            resumed.
        """
        with _said():
            if os.path.lexists(self.shelf.folder):
                self._take(make=False)
        self._lock.release()
        self._refuse()

    def _take(self, make: bool) -> None:
        """Take the lock of a folder that is ours."""
        folder = self.shelf.folder
        if folder.is_symlink() or not folder.is_dir():
            what = "a link" if folder.is_symlink() else "a file"
            raise OutputError(
                f"{folder} is {what}, not the folder of a run of hardspheres; give another folder with --out"
            )
        there = os.path.lexists(self._lock.path)
        if not there:
            self._require_ours()
        if (there or make) and not self._lock.acquire():
            raise OutputError(
                f"another run writes into {self.out}; give another folder with --out, or wait for it"
            )
        try:
            self._require_ours()
        except BaseException:
            self._lock.release()
            raise

    def _require_ours(self) -> None:
        """Refuse a folder with files but without our manifest, unless a run of ours was about to write it.

        Refuse one of ours, too, in which something that is no file has the name of one of ours, so that
        nothing is written through a link.
        """
        for path in self.shelf.folder.iterdir():
            own = OURS.fullmatch(path.name) or path in (
                self._lock.path,
                self._manifest_path,
                self._finished_path,
            )
            if own and os.path.lexists(path) and not is_ordinary(path):
                what = "a link" if path.is_symlink() else "not a file"
                raise OutputError(
                    f"{path} is {what}, so not of a run of hardspheres; give another folder with --out"
                )
        if _manifest(self._manifest_path) or _manifest(self._finished_path):
            return
        names = {path.name for path in self.shelf.folder.iterdir()}
        if names and self._lock.is_ours():
            names = {name for name in names - {"lock"} if not NAME.fullmatch(name)}
        if self._manifest_path.name in names:
            raise OutputError(
                f"{self._manifest_path} cannot be understood, so {self.shelf.folder} is not of a run of "
                "hardspheres; give another folder with --out"
            )
        if names:
            raise OutputError(
                f"{self.shelf.folder} is not of a run of hardspheres: it holds {min(names)}; give another "
                "folder with --out"
            )

    def unfinished(self) -> bool:
        """Return whether there is something to resume."""
        return _manifest(self._manifest_path) is not None

    def _refuse(self) -> None:
        there = self.unfinished()
        if there and not self.resume and not self.force:
            raise unfinished_run(self.out)
        if self.resume and not there:
            raise CheckpointError(f"{self.out} holds no unfinished run, so there is nothing to resume")
        if self.resume:
            self._require_same()

    def _require_same(self) -> None:
        before = _manifest(self._manifest_path)
        assert before is not None
        now = json.loads(json.dumps(self._manifest))
        for what in ("study", "version"):
            if before[what] != now[what]:
                raise CheckpointError(
                    f"{self.out} holds an unfinished run of another {what}: {before[what]}, not {now[what]}"
                )
        for name in {**before["options"], **now["options"]}:
            old, new = before["options"].get(name), now["options"].get(name)
            if old != new:
                raise CheckpointError(
                    f"{self.out} holds an unfinished run with {name} {_words(old)}, not {_words(new)}; "
                    "resume it with its original options"
                )

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
        with _said():
            if not os.path.lexists(self.shelf.folder):
                self.shelf.folder.mkdir(exist_ok=True)
            self._take(make=True)
        try:
            self._refuse()
            before = _manifest(self._manifest_path) or {}
            self.own = {str(name) for name in before.get("own", ())}
            if not self.resume:
                self._begin(claim(self.own))
            yield self.shelf
            self._discard()
        except BaseException as error:
            if self._manifest_path.exists():
                error.add_note(
                    f"what was done is kept in {self.out / FOLDER}: the same command with --resume continues"
                )
            raise
        finally:
            try:
                if not self._manifest_path.exists():
                    self._remove_folder()
            finally:
                self._lock.release()

    def may_write(self, name: str) -> None:
        """Record that a file in the output folder is this run's, before it is written."""
        if name not in self.own:
            self.own.add(name)
            self._write_manifest()

    def _begin(self, own: set[str]) -> None:
        self._discard()
        self.own = own
        self._write_manifest()
        with _said():
            self._finished_path.unlink(missing_ok=True)

    def _write_manifest(self) -> None:
        temporary = temporary_beside(self._manifest_path)
        with _said():
            try:
                content = {**self._manifest, "own": sorted(self.own)}
                temporary.write_text(json.dumps(content, indent=2), encoding="utf-8")
                os.replace(temporary, self._manifest_path)
            finally:
                temporary.unlink(missing_ok=True)

    def _discard(self) -> None:
        """Remove results and states: first what makes the folder resumable, last what marks it as ours."""
        with _said():
            if self._manifest_path.exists():
                os.replace(self._manifest_path, self._finished_path)
            for path in list(self.shelf.folder.iterdir()):
                # checked again: a removal cannot be undone
                if OURS.fullmatch(path.name) and is_ordinary(path):
                    path.unlink()

    def _remove_folder(self) -> None:
        """Remove the folder, unless it holds other files: then they and our mark stay."""
        with contextlib.suppress(OSError):
            left = {path.name for path in self.shelf.folder.iterdir()}
            if left <= {"lock", self._finished_path.name}:
                self._finished_path.unlink(missing_ok=True)
            if self._lock.is_ours():
                self._lock.path.unlink()
            self.shelf.folder.rmdir()


def _manifest(path: Path) -> dict[str, Any] | None:
    """Return the manifest that a run of ours has written, None where there is none."""
    found = load_object(path) or {}
    kinds = {"study": str, "version": str, "options": dict}
    return found if all(isinstance(found.get(name), kind) for name, kind in kinds.items()) else None
