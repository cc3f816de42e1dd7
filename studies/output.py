"""The output folder of a study: tables, figures and summary.json, whole or not at all, in nobody's place.

Files are written atomically: each under another name in the same folder, and then renamed.
"""

from __future__ import annotations

import contextlib
import csv
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hardspheres.errors import CheckpointError
from hardspheres.temporary import remove_leftovers, temporarily
from studies.figures.style import figure_style, name_gas, save
from studies.formats import FORMATS, in_format
from studies.options import MANY
from studies.running.journal import (
    FOLDER,
    Journal,
    OutputError,
    Shelf,
    about,
    elsewhere,
    not_written,
    require_same,
)
from studies.running.kept import LARGE, REPLICAS, Kept
from studies.running.ownership import (
    SUMMARY,
    every_file,
    files_of,
    files_of_finished_run,
    is_ordinary,
)
from studies.running.presence import announce, renewing
from studies.running.shards import Shard, SharedShelf

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["OutputError", "OutputFolder", "jsonable"]


def jsonable(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, NaN and infinities as null, paths as text."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple)):
        return [jsonable(entry) for entry in value]
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


class OutputFolder:
    """The folder that a study writes into.

    Parameters
    ----------
    path : str or path-like
        Where; nothing is written before `create` or `running`. A relative path refers to the present working
        directory.
    checkpoint_every : float, default 60
        Seconds of wall time between two checkpoints of a run.
    resume : bool, default False
        Continue the unfinished run in the folder.
    force : bool, default False
        Replace the run in the folder. Its files stay until the first result of the new one is written; then
        its summary is removed, and when the new summary is written, so are all its files that have not been
        replaced.
    figure_format : str, default "png"
        Of figures: "png", "svg" or "pdf".
    keep : bool, optional
        Whether a study's replicas stay beside its results, see `studies.running.kept`; by default where they
        take at most 50 MB together, or an earlier run has kept some.

    Attributes
    ----------
    path : Path
        The folder.
    figure_format : str
        Of figures.
    shard : Shard or None
        The part of the study that is run beside others, see `shared`; by default all is run, alone.
    files : list of str
        Names of the files written so far.
    there : int
        Replicas of an earlier run that this one extends.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        checkpoint_every: float = 60.0,
        resume: bool = False,
        force: bool = False,
        figure_format: str = "png",
        keep: bool | None = None,
    ) -> None:
        if figure_format not in FORMATS:
            raise OutputError(f"figure_format {figure_format!r} is not known; it can be png, svg or pdf")
        self.figure_format = figure_format
        self.path, self._place = Path(path), Path(path).absolute()
        self.checkpoint_every, self.resume, self.force = checkpoint_every, resume, force
        self.keep, self.there = keep, 0
        self.shard: Shard | None = None
        self.files: list[str] = []
        self._names: tuple[str, ...] = ()  # that the study writes beside its summary, figures as .png
        self._own: set[str] | None = None  # names of files that may be replaced
        self._journal, self._kept = Journal(self.path, self._place), Kept(self.path, self._place)
        self._manifest: dict[str, Any] | None = None  # while a run is in the journal

    def __repr__(self) -> str:
        """Return where it is, and what has been written into it."""
        return f"<OutputFolder {self.path}: {', '.join(self.files) or 'nothing written yet'}>"

    def within(self, name: str, *, resume: bool) -> OutputFolder:
        """Return the folder of this name in it, for a run with the same settings."""
        return OutputFolder(
            self.path / name,
            checkpoint_every=self.checkpoint_every,
            resume=resume,
            force=self.force,
            figure_format=self.figure_format,
            keep=self.keep,
        )

    @property
    def checkpoints(self) -> Path:
        """The checkpoint folder, which is there while a study runs."""
        return self._journal.folder

    def check(self, study: Any = None, *, resumable: bool = True, replicas: bool = True) -> None:
        """Raise an error if the folder cannot be used; create nothing.

        Parameters
        ----------
        study : dataclass, optional
            Options of the study that is going to run, see `running`.
        resumable : bool, default True
            Whether it keeps checkpoints.
        replicas : bool, default True
            Whether the number of its replicas is decided; else it may be that of what is there, or more.

        Raises
        ------
        OutputError
            If the folder cannot be written, or another run writes into it; if it holds a finished run that is
            not to be replaced, or files of others in the place of those that the study writes.
        CheckpointError
            If it holds an unfinished run that is not to be resumed, or none where one is.
        """
        self._require_writable()
        if study is not None and resumable:
            with self._journal.held(make=False, shared=self.shard is not None):
                self._agree(study, replicas)
        elif self._journal.unfinished():
            raise self._unfinished()
        else:
            self._names = files_of(study)
            self._own = self._claim()

    @contextlib.contextmanager
    def running(self, study: Any) -> Iterator[Shelf]:
        """Make and lock the folder, with its checkpoints, while the context lasts.

        Parameters
        ----------
        study : dataclass
            Options of the study.

        Yields
        ------
        Shelf
            Where `run_replicas` keeps its results.

        Raises
        ------
        OutputError, CheckpointError
            As `check` does.
        """
        self.create()
        with self._journal.held(make=True):
            self._own = self._agree(study)
            self._manifest = about(study) | ({"there": self.there} if self.there else {})
            try:
                if not self.resume:
                    self._journal.discard()
                self._record()
                earlier = self._kept.folder if self.there else None
                yield Shelf(self.checkpoints, self.checkpoint_every, earlier)
                self._journal.discard(finished=True)
            except BaseException as error:
                if self._journal.unfinished():
                    error.add_note(
                        f"what was done is kept in {self.path / FOLDER}: the same command with --resume "
                        "continues"
                    )
                raise
            finally:
                self._manifest = None

    def keep_replicas(self, study: Any, gases: int, shelf: Shelf) -> str:
        """Keep all replicas of a finished study, if that is wanted; return why not, if that must be told.

        Parameters
        ----------
        study : Study
            What was run.
        gases : int
            How many it is about.
        shelf : Shelf
            Where its results are.
        """
        files = shelf.finished(range(study.replicas * gases))
        if self.keep is False or (self.keep is None and study.not_extendable):
            self._kept.remove()
        elif self.keep or self.there or (size := self._kept.size(files)) <= LARGE:
            self._kept.keep(study, gases, files)
        else:
            return f"the replicas take {size / 1e6:.0f} MB and were not kept; --keep keeps them"
        return ""

    @contextlib.contextmanager
    def shared(self, study: Any) -> Iterator[SharedShelf]:
        """Make the folder, and hold it together with other shards of the study, while the context lasts.

        What is kept stays, to be gathered by a run with `resume`.

        Parameters
        ----------
        study : dataclass
            Options of the study.

        Yields
        ------
        SharedShelf
            Where `run_part` keeps its results.

        Raises
        ------
        OutputError, CheckpointError
            As `check` does.
        """
        assert self.shard is not None
        self.create()
        with self._journal.held(make=True, shared=True):
            self._journal.begin({**about(study), "own": sorted(self._agree(study))})
            self._agree(study)  # with the one that was first
            try:
                with not_written():
                    presence = announce(self.checkpoints, self.shard.number, str(self.shard))
                with renewing(presence):
                    yield SharedShelf(
                        self.checkpoints, self.checkpoint_every, shard=self.shard, presence=presence
                    )
            except BaseException as error:
                error.add_note(
                    f"what was done is kept in {self.path / FOLDER}: the same command goes on, and so does "
                    "the one with --resume that gathers"
                )
                raise

    def create(self) -> None:
        """Make the folder and its parents."""
        try:
            self._place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path} cannot be made: {error.strerror}") from error

    @contextlib.contextmanager
    def partial(self, name: str) -> Iterator[Path]:
        """Yield a temporary path that becomes the file `name` when the context ends without an error.

        Parameters
        ----------
        name : str
            File name within the folder; the temporary one has the same extension.
        """
        with temporarily(self._place / name) as temporary, not_written(self.path / name):
            yield temporary
            self._put(temporary, name)

    def adopt(self, path: Path) -> None:
        """Move a finished file from the checkpoint folder to its place, where it may be already."""
        if path.exists() or not (self._place / path.name).exists():
            with not_written(self.path / path.name):
                self._put(path, path.name)
        elif path.name not in self.files:
            self.files.append(path.name)

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON object, see `jsonable`."""
        with self.partial(name) as path:
            path.write_text(json.dumps(jsonable(content), indent=2) + "\n", encoding="utf-8")

    def write_csv(self, name: str, columns: Mapping[str, Any]) -> None:
        """Write columns of equal length under their names, numbers as the shortest text that reads back."""
        arrays = {key: np.asarray(column).tolist() for key, column in columns.items()}
        with self.partial(name) as path, path.open("w", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(arrays)
            writer.writerows(zip(*arrays.values(), strict=True))

    def save_figure(self, name: str, figure: Figure, gas: str) -> None:
        """Write a figure with the name of the gas above it; in a file of this name, ending as its format."""
        with self.partial(in_format(name, self.figure_format)) as path:
            with figure_style():
                name_gas(figure, gas)
            save(figure, path, self.figure_format)

    def _require_writable(self) -> None:
        """Refuse a path at which no folder can be made, or none written to."""
        above = [self.path, *self.path.absolute().parents]
        try:
            nowhere = next((path for path in above if path.is_symlink() and not path.exists()), None)
        except OSError as error:
            raise OutputError(
                f"{self.path} cannot be a folder: {error.strerror}; give another one with --out"
            ) from error
        if nowhere is not None:
            raise elsewhere(f"{nowhere} is a link to {os.readlink(nowhere)}, where there is nothing")
        if self.path.exists() and not self.path.is_dir():
            raise elsewhere(f"{self.path} exists and is not a folder")
        parent = next(path for path in above if path.exists())
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise elsewhere(f"{parent} cannot be written to")

    def _agree(self, study: Any, replicas: bool = True) -> set[str]:
        """Return the files that a run may replace; refuse what is in its way, or not what it resumes."""
        if not replicas:
            study = replace(study, replicas=MANY)
        self._names, before = files_of(study), self._journal.unfinished()
        keeps = getattr(study, "keeps", False)
        if keeps and self.keep is not False:
            self._kept.require_ours()
        if not (self.resume or (self.shard and before)):
            if before and not self.force:
                raise self._unfinished()
            if keeps and not self.force:
                finished = files_of_finished_run(self._place, tuple) is not None
                self.there = self._kept.replicas_for(study, finished)
            return self._claim(before["own"] if before else ())
        if before is None:
            raise CheckpointError(f"{self.path} holds no unfinished run, so there is nothing to resume")
        now = about(study)
        if not replicas:
            now["options"][REPLICAS] = before["options"].get(REPLICAS)
        require_same(self.path, before, now)
        self.there = self._kept.replicas_for(study, False) if before.get("there") else 0
        return set(map(str, before["own"]))

    def _unfinished(self) -> CheckpointError:
        return CheckpointError(
            f"{self.path} holds an unfinished run; add --resume to continue it or --force to start again, or "
            "give another folder with --out"
        )

    def _record(self) -> None:
        """Write into the manifest which files are this run's."""
        if self._manifest is not None:
            self._journal.write({**self._manifest, "own": sorted(self._own or ())})

    def _claim(self, unfinished: Iterable[str] = ()) -> set[str]:
        """Return the files that may be replaced; refuse others, and a finished run without force."""
        old = files_of_finished_run(self._place, self._known)
        if old is not None and self.shard:
            raise OutputError(
                f"{self.path} holds a finished run, so there is nothing left for a shard to do; give another "
                "folder with --out"
            )
        if old is not None and not self.force and not self.there:
            raise OutputError(
                f"{self.path} holds a finished run; give another folder with --out, or --force to replace it"
            )
        own = (old or set()).union(map(str, unfinished))
        wanted = {in_format(name, self.figure_format) for name in self._names}
        for name in sorted({SUMMARY, *wanted} - own):
            if os.path.lexists(self._place / name):
                raise OutputError(
                    f"{self.path / name} is not of a finished run, and would be replaced; give another "
                    "folder with --out, or move it away"
                )
        return own

    def _known(self) -> frozenset[str]:
        """Return the names of all files that may ever be replaced or removed."""
        return every_file().union(in_format(name, form) for name in self._names for form in FORMATS)

    def _put(self, path: Path, name: str) -> None:
        """Move a whole file to its place, replacing only our own; the summary comes last."""
        if self._own is None:
            self._names = (*self._names, name)
            self._own = self._claim()
        if name not in self._own:
            if os.path.lexists(self._place / name):
                raise OutputError(f"{self.path / name} is not of this run, and is not replaced; move it away")
            self._own.add(name)
            self._record()
        if not self.files:
            self._remove(SUMMARY)
        if name == SUMMARY:  # the last file of a run: nothing that is stale or half-written stays behind
            remove_leftovers(self._place, path.stat().st_mtime)
            for stale in self._own - {SUMMARY, *self.files}:
                self._remove(stale)
            if not self.there:
                self._kept.remove()
        os.replace(path, self._place / name)
        if name not in self.files:
            self.files.append(name)

    def _remove(self, name: str) -> None:
        """Remove a file of an earlier run: one that studies write, and that is a file itself."""
        if name in (self._own or ()) and is_ordinary(self._place / name) and name in self._known():
            (self._place / name).unlink()
