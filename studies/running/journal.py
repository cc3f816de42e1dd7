"""The checkpoint folder of a study: results of what is finished, and the state of what is running.

    DIR/checkpoint/lock              held by the run that writes here; its content marks the folder as ours
    DIR/checkpoint/manifest.json     study, version and options; there is something to resume while it exists
    DIR/checkpoint/done-0007.npz     the result of item 7
    DIR/checkpoint/running-0007.npz  the state of item 7, saved at an interval
    DIR/checkpoint/token-HEX         by which workers elsewhere know the run, see `studies.running.elsewhere`

and those of `studies.running.shards`, where several processes run a study.

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
import secrets
import stat
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import hardspheres as hs
from hardspheres.errors import CheckpointError, HardSpheresError
from hardspheres.temporary import NAME, placing, replacing
from studies.running.encoding import read, write
from studies.running.locking import Lock
from studies.running.ownership import is_ordinary, load_object
from studies.running.presence import NAMED, STALE, present_in

__all__ = [
    "FOLDER",
    "Journal",
    "OutputError",
    "Shelf",
    "about",
    "difference",
    "elsewhere",
    "not_written",
    "read_sealed",
    "require_same",
    "write_sealed",
]

FOLDER = "checkpoint"
OF_A_RUN = re.compile(
    r"(done|running)-\d{4,}\.npz|token-[0-9a-f]{32}|\.?trajectory\.xyz(\.\w+)?"
    rf"|claim-\d{{4,}}|{NAMED.pattern}"
)
REMOVED = re.compile(f"{OF_A_RUN.pattern}|{NAME.pattern}")


class OutputError(HardSpheresError, OSError):
    """The output folder cannot be made or written, or another run writes into it."""


def elsewhere(sentence: str) -> OutputError:
    """Return the error for a folder that cannot be used."""
    return OutputError(f"{sentence}; give another folder with --out")


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
    earlier : Path, optional
        Another folder, with results of a run that this one extends.
    token : str
        Where workers may be elsewhere, or go on when the run has ended: the file that `shared` has put into
        the folder. Nothing is written where it is not found.
    """

    folder: Path
    every: float = 60.0
    earlier: Path | None = None
    token: str = ""

    @contextlib.contextmanager
    def shared(self) -> Iterator[Shelf]:
        """Yield the shelf for workers elsewhere; it is theirs while the context lasts."""
        token = f"token-{secrets.token_hex(16)}"
        path = self.folder / token
        with not_written():
            path.touch()
        try:
            yield replace(self, token=token)
        finally:
            with contextlib.suppress(OSError):  # it is removed with the rest
                path.unlink()

    def reachable(self) -> bool:
        """Return whether this process can write here, for a run that goes on."""
        there = os.path.exists(self.folder / self.token) and os.access(self.folder, os.W_OK)
        return there or not self.token

    def _path(self, what: str, index: int) -> Path:
        return self.folder / f"{what}-{index:04d}.npz"

    def finished(self, numbers: Iterable[int]) -> list[Path]:
        """Return the files of the results of items."""
        return [self._path("done", number) for number in numbers]

    def result(self, index: int) -> tuple[Any] | None:
        """Return the result of an item in a tuple, None where it is not finished, or its file damaged."""
        path = self._path("done", index)
        found = _whole(path)
        return _whole(self.earlier / path.name) if found is None and self.earlier is not None else found

    def store(self, index: int, result: Any) -> None:
        """Save the result of an item; its state is no longer needed."""
        if not self.reachable():
            return
        # there are many, and the checksum reveals a torn one
        write(self._path("done", index), result, durable=False)
        with contextlib.suppress(OSError):  # it is not read any more, and is removed in the end
            self._path("running", index).unlink()

    def state(self, index: int) -> Any:
        """Return the state of an item that was running, None where there is none, or its file is damaged."""
        return (_whole(self._path("running", index)) or (None,))[0]

    def save(self, index: int, state: Any) -> None:
        """Save the state of a running item, replacing the one before."""
        if self.reachable():
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


def options_of(study: Any) -> dict[str, Any]:
    """Return the options of a study that matter, by their names on the command line.

    Parameters
    ----------
    study : dataclass
        Numbers, texts, tuples, dicts, scenes, and dataclasses of such.
    """
    found: dict[str, Any] = {}
    for field in fields(study):
        value, option = getattr(study, field.name), field.metadata.get("option")
        if value is None or (option and not option.matters):
            continue
        if isinstance(value, hs.Scene):
            arrays = (value.positions, value.velocities, value.radii, value.masses, value.box)
            digest = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
            found["the structure that it starts from"] = f"{digest[:12]} {' '.join(value.boundary)}"
        elif is_dataclass(value):
            found |= options_of(value)
        elif isinstance(value, dict):
            found[f"--{field.name}"] = repr(value)
        else:
            name = option.named(field.name) if option else f"--{field.name.replace('_', '-')}"
            found[name] = list(value) if isinstance(value, tuple) else value
    return found


def _words(value: Any) -> str:
    """Return an option's value as it is written on the command line."""
    if value is None:
        return "not given"
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def about(study: Any) -> dict[str, Any]:
    """Return what a manifest says of a study."""
    name = getattr(study, "name", type(study).__module__.rpartition(".")[2])
    planned: dict[str, Any] = getattr(study, "planned", dict)()
    content = planned | {"study": name, "version": hs.__version__, "options": options_of(study)}
    return dict(json.loads(json.dumps(content)))  # as it is read


def _seal(manifest: Mapping[str, Any]) -> str:
    """Return the digest of what a manifest says."""
    return hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()


def _is_no_file(path: Path) -> bool:
    """Return whether something is there that is not an ordinary file, nor removed by others meanwhile."""
    try:
        return not stat.S_ISREG(path.lstat().st_mode)
    except FileNotFoundError:
        return False


def difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """Return in which way one manifest is not of the study of another; an empty text where it is."""
    for what in ("study", "version"):
        if before[what] != now[what]:
            return f"of another {what}: {before[what]}, not {now[what]}"
    for name in {**before["options"], **now["options"]}:
        old, new = before["options"].get(name), now["options"].get(name)
        if old != new:
            return f"with {name} {_words(old)}, not {_words(new)}"
    return ""


def require_same(out: Path, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """Raise CheckpointError unless two manifests say the same of the study: one found, one of now."""
    if other := difference(before, now):
        advice = "; resume it with its original options" * other.startswith("with ")
        raise CheckpointError(f"{out} holds an unfinished run {other}{advice}")


def read_sealed(path: Path, **kinds: type) -> dict[str, Any] | None:
    """Return a manifest that has entries of these types; None where it is damaged, or not ours."""
    found = load_object(path) or {}
    if found.pop("sha256", None) != _seal(found):
        return None
    return found if all(isinstance(found.get(name), kind) for name, kind in kinds.items()) else None


def write_sealed(path: Path, content: Mapping[str, Any]) -> None:
    """Write a manifest."""
    with replacing(path) as temporary:
        _write_sealed(temporary, content)


def _write_sealed(path: Path, content: Mapping[str, Any]) -> None:
    sealed = {**content, "sha256": _seal(content)}
    path.write_text(json.dumps(sealed, indent=2), encoding="utf-8")


class Journal:
    """The checkpoint folder of a study, for the process that conducts it.

    Parameters
    ----------
    out : Path
        The study's output folder, as it is called.
    place : Path
        The same, absolute.
    """

    def __init__(self, out: Path, place: Path) -> None:
        self.out, self.folder = out, place / FOLDER
        self._lock, self._manifest = Lock(self.folder / "lock"), self.folder / "manifest.json"

    def unfinished(self) -> dict[str, Any] | None:
        """Return the manifest of the run that can be resumed, None where there is none."""
        return read_sealed(self._manifest, study=str, version=str, options=dict, own=list)

    @contextlib.contextmanager
    def held(self, make: bool, shared: bool = False) -> Iterator[None]:
        """Hold the lock of the folder while the context lasts, and make it if need be.

        At the end it is removed if there is nothing to resume, nor any other file, unless it is shared.

        Parameters
        ----------
        make : bool
            Whether to make the folder, and a lock in it, where there is none.
        shared : bool, default False
            Whether others that share it may hold it at the same time.

        Raises
        ------
        OutputError
            If another run holds it, or it is not ours, or cannot be made.
        """
        try:
            with not_written():
                if make and not os.path.lexists(self.folder):
                    self.folder.mkdir(exist_ok=True)
                if os.path.lexists(self.folder):
                    self._take(make, shared)
            yield
        finally:
            try:
                alone = make and not shared
                if alone and self._lock.is_held() and not self._manifest.exists():
                    self._remove_folder()
            finally:
                self._lock.release()

    def write(self, content: Mapping[str, Any]) -> None:
        """Write the manifest."""
        with not_written():
            write_sealed(self._manifest, content)

    def begin(self, content: Mapping[str, Any]) -> None:
        """Write the manifest unless there is one, after everything of runs before has been removed."""
        with not_written():
            left = [path for path in self.folder.iterdir() if OF_A_RUN.fullmatch(path.name)]
            if self._manifest.exists():  # looked for after them: they may be of a shard that has begun
                return
            for path in filter(is_ordinary, left):
                path.unlink(missing_ok=True)
            with placing(self._manifest) as temporary:
                _write_sealed(temporary, content)

    def discard(self, finished: bool = False) -> None:
        """Remove results and states, first what makes the folder resumable; the lock marks it as ours.

        Parameters
        ----------
        finished : bool, default False
            Whether the study is: then what cannot be removed is told in a warning, and the next run tries
            again. Before a run it is an error, because the run would take old results for its own.
        """
        with not_written():
            self._manifest.unlink(missing_ok=True)
            for path in list(self.folder.iterdir()):
                # checked again: a removal cannot be undone
                if not (REMOVED.fullmatch(path.name) and is_ordinary(path)):
                    continue
                try:
                    path.unlink()
                except OSError as error:
                    if not finished:
                        raise
                    what = f"the run is finished, but {path} cannot be removed: {error.strerror}"
                    warnings.warn(f"{what}; remove it by hand", stacklevel=2)

    def _take(self, make: bool, shared: bool) -> None:
        """Take the lock of a folder that is ours."""
        if self.folder.is_symlink() or not self.folder.is_dir():
            what = "a link" if self.folder.is_symlink() else "a file"
            raise elsewhere(f"{self.folder} is {what}, not the folder of a run of hardspheres")
        there = os.path.lexists(self._lock.path)
        for ready in (there, make):  # a lock is made only in what is known to be ours
            if ready and not self._lock.acquire(shared):
                for shard in present_in(self.folder, self._lock.path):
                    raise self._shared_with(shard)
                raise OutputError(
                    f"another run writes into {self.out}; give another folder with --out, or wait for it"
                )
            self._require_ours()
        for shard in [] if shared else present_in(self.folder, self._lock.path):
            # where there are no locks, or each host has its own
            what = f"{shard} did not say that it has ended; waiting up to {STALE:.0f} s for a sign of it"
            warnings.warn(what, stacklevel=2)
            if shard.goes_on(self._lock.path):
                raise self._shared_with(shard)

    def _shared_with(self, shard: object) -> OutputError:
        return OutputError(
            f"{shard} still writes into {self.out}; wait until it has ended, or give another folder "
            "with --out"
        )

    def _require_ours(self) -> None:
        """Refuse a folder with files but neither a manifest nor a lock of ours.

        Refuse one of ours, too, in which something that is no file has the name of one of ours, so that
        nothing is written through a link.
        """
        found = list(self.folder.iterdir())
        for path in found:
            ours = REMOVED.fullmatch(path.name) or path in (self._lock.path, self._manifest)
            if ours and _is_no_file(path):
                what = "a link" if path.is_symlink() else "not a file"
                raise elsewhere(f"{path} is {what}, so not of a run of hardspheres")
        if self._manifest.exists():  # looked for first: another shard may be making it
            if self.unfinished():
                return
            raise elsewhere(
                f"{self._manifest} cannot be understood, so {self.folder} is not of a run of hardspheres"
            )
        others = [path.name for path in found if not NAME.fullmatch(path.name)]
        if others and not self._lock.is_ours():
            raise elsewhere(f"{self.folder} is not of a run of hardspheres: it holds {min(others)}")

    def _remove_folder(self) -> None:
        """Remove the folder, unless it holds other files: then they and our lock stay."""
        with contextlib.suppress(OSError):
            if self._lock.is_ours() and list(self.folder.iterdir()) == [self._lock.path]:
                self._lock.path.unlink()
                self.folder.rmdir()
