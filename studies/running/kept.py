"""Replicas of a finished study, kept beside its results: more of them extend it, other seeds join it.

    DIR/replicas/manifest.json   study, version, options, how many gases, and how many replicas of each
    DIR/replicas/study.npz       the study itself, where its class is of this package
    DIR/replicas/done-0007.npz   the result of item 7: of g gases, replica r of gas k is item r g + k

The manifest comes first and marks the folder as ours; it counts replicas only when all their files are there.
They are links to those of the checkpoint folder, or copies where a file system has no links, so that an
interruption loses nothing. Only files with the names above are ever removed, one by one.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hardspheres.errors import CheckpointError
from hardspheres.temporary import NAME, replacing
from studies.options import options_of
from studies.registry import QUESTIONS, study_named
from studies.running.encoding import NotStorable, read, write
from studies.running.journal import (
    OutputError,
    about,
    difference,
    not_written,
    read_sealed,
    write_sealed,
)
from studies.running.ownership import SUMMARY, is_ordinary, load_object

__all__ = ["FOLDER", "LARGE", "Finished", "Kept", "finished_run"]

FOLDER, MANIFEST, STUDY = "replicas", "manifest.json", "study.npz"
OURS = re.compile(rf"done-\d{{4,}}\.npz|manifest\.json|study\.npz|{NAME.pattern}")
REPLICAS, SEED = "--replicas", "--seed"
LARGE = 50_000_000
"""Bytes of all replicas together from which on they are kept only if that is asked for."""


def _about(study: Any) -> dict[str, Any]:
    """Return what a manifest says of a study, but for the number of its replicas."""
    content = about(study)
    content["options"].pop(REPLICAS, None)
    return content


class Kept:
    """The folder of a study's replicas, for the run that holds the lock of the checkpoint folder.

    Parameters
    ----------
    out : Path
        The study's output folder, as it is called.
    place : Path
        The same, absolute.
    """

    def __init__(self, out: Path, place: Path) -> None:
        self.out, self.folder = out, place / FOLDER

    def manifest(self) -> dict[str, Any] | None:
        """Return the manifest; None where there is none of ours."""
        kinds = {"study": str, "version": str, "options": dict, "replicas": int, "gases": int}
        return None if self.folder.is_symlink() else read_sealed(self.folder / MANIFEST, **kinds)

    def require_ours(self) -> None:
        """Refuse a folder of this name that is somebody else's."""
        if not os.path.lexists(self.folder):
            return
        whole = self.folder.is_dir() and not self.folder.is_symlink()
        found = list(self.folder.iterdir()) if whole else [self.folder]
        known = [path for path in found if OURS.fullmatch(path.name)]
        alien = [path for path in known if not is_ordinary(path) and os.path.lexists(path)]
        if self.manifest() is None:  # an empty one is nobody's
            alien += [path for path in found if not NAME.fullmatch(path.name)]
        if alien:
            raise OutputError(
                f"{min(alien)} is not of a run of hardspheres, whose replicas would be kept there; give "
                "another folder with --out, or --no-keep"
            )

    def replicas_for(self, study: Any, finished: bool) -> int:
        """Return how many replicas of a study are there already, for it to go on with.

        Parameters
        ----------
        study : Study
            What is asked for.
        finished : bool
            Whether there are results too.

        Raises
        ------
        OutputError
            If they are of another study, or as many as are asked for, or more, or cannot be extended.
        """
        found = self.manifest()
        if found is None or not found["replicas"]:
            return 0
        there, asked = int(found["replicas"]), int(study.replicas)
        other = difference(found, _about(study))
        if not other and there > asked:
            other = f"with {REPLICAS} {there}, not {asked}"
        elif not other and there < asked:
            other = study.not_extendable
        if other:
            raise OutputError(
                f"{self.out} holds a finished run {other}; give another folder with --out, or --force to "
                "replace it"
            )
        if there == asked and finished:
            raise OutputError(
                f"{self.out} holds this finished run already; ask for more than {REPLICAS} {there} to "
                "extend it, give another folder with --out, or --force to run it again"
            )
        return there

    def size(self, files: Iterable[Path]) -> int:
        """Return the bytes of these files of the checkpoint folder, or of those kept before."""
        return sum(self._newest(path).stat().st_size for path in files)

    def _newest(self, path: Path) -> Path:
        return path if path.exists() else self.folder / path.name

    def keep(self, study: Any, gases: int, files: Iterable[Path]) -> None:
        """Keep replicas, or add to those that are kept.

        Parameters
        ----------
        study : Study
            What they are of.
        gases : int
            How many it is about.
        files : iterable of Path
            Those of all items in the checkpoint folder; what is not there is kept already.
        """
        self.require_ours()
        content = {**_about(study), "gases": gases, "replicas": 0}
        with not_written(self.out / FOLDER):
            self.folder.mkdir(exist_ok=True)
            if not (self.manifest() or content)["replicas"]:
                write_sealed(self.folder / MANIFEST, content)
            for path in filter(Path.exists, files):
                with replacing(self.folder / path.name) as temporary:
                    try:
                        os.link(path, temporary)
                    except OSError:  # a file system without hard links
                        shutil.copyfile(path, temporary)
            with contextlib.suppress(NotStorable):
                unset = {each.name: each.default for each, its in options_of(study) if not its.matters}
                write(self.folder / STUDY, replace(study, **unset))
            write_sealed(self.folder / MANIFEST, {**content, "replicas": study.replicas})

    def remove(self) -> None:
        """Remove what is kept, if it is ours: first what counts it, last what marks the folder.

        The mark stays where there are other files.
        """
        found = self.manifest()
        if found is None:
            return
        with not_written(self.out / FOLDER):
            write_sealed(self.folder / MANIFEST, {**found, "replicas": 0})
            for path in list(self.folder.iterdir()):
                if OURS.fullmatch(path.name) and path.name != MANIFEST and is_ordinary(path):
                    path.unlink()
            if list(self.folder.iterdir()) == [self.folder / MANIFEST]:
                (self.folder / MANIFEST).unlink()
                self.folder.rmdir()


@dataclass(frozen=True)
class Finished:
    """A finished run whose replicas are kept.

    Attributes
    ----------
    path : Path
        Its folder.
    about : dict
        Its manifest.
    study : Study
        What was run.
    replicas : list of list of Replica
        Of each gas.
    """

    path: Path
    about: dict[str, Any]
    study: Any
    replicas: list[list[Any]]


def finished_run(path: Path) -> Finished:
    """Return the study of a folder, and all of its replicas.

    Raises
    ------
    CheckpointError
        If there are none, or a file is damaged.
    """
    kept = Kept(path, path.absolute())
    found, summary = kept.manifest(), load_object(path / SUMMARY)
    if found is None or not found["replicas"]:
        if summary is None or not {"study", "version"} <= summary.keys():
            raise CheckpointError(f"{path} holds no finished run; name the --out of one")
        if "combined" in summary:
            raise CheckpointError(f"{path} was combined itself; name the folders that it was combined from")
        raise CheckpointError(
            f"{path} holds a finished run, but not its replicas; run it again with --keep and --force"
        )
    if found["study"] not in QUESTIONS or not is_ordinary(kept.folder / STUDY):
        raise CheckpointError(
            f"{path} holds a run of {found['study']}, which is no study of this package; extend it by asking "
            f"for more {REPLICAS} instead"
        )
    study_named(found["study"])  # what is read is made of classes that are loaded
    study = read(kept.folder / STUDY)
    gases, count = int(found["gases"]), int(found["replicas"])
    replicas = [
        [read(kept.folder / f"done-{r * gases + k:04d}.npz") for r in range(count)] for k in range(gases)
    ]
    for k, own in enumerate(replicas):
        for r, replica in enumerate(own):
            if (replica.root, replica.index, replica.gas) != (study.seed, r, k):
                raise CheckpointError(f"{kept.folder} has files of another run; use an unchanged copy of it")
    return Finished(path, found, study, replicas)
