"""`hardspheres list`: which runs are in a folder, what they were about, and whether they are finished."""

from __future__ import annotations

import datetime
import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from studies.options import OptionError
from studies.registry import QUESTIONS
from studies.report import Screen
from studies.running.journal import FOLDER, Journal
from studies.running.locking import Lock
from studies.running.ownership import SUMMARY, is_ordinary, load_object

__all__ = ["Run", "list_runs", "runs_in"]

USUAL = "runs"
HEADER = ("folder", "study", "gas", "replicas", "date", "state")


@dataclass(frozen=True)
class Run:
    """A run in a folder.

    Attributes
    ----------
    folder, study, gas : str
        Where, which, and of what, in words.
    replicas : int or None
        Runs of each gas, where the word has a meaning.
    date : str
        Of its summary, or of the beginning of what is not finished, YYYY-MM-DD; empty where it is not known.
    state : str
        "finished", "unfinished" or "damaged".
    told : str
        The state in words.
    done, runs : int or None
        Of what is not finished: how many runs are done, and of how many.
    """

    folder: str
    study: str
    gas: str
    replicas: int | None
    date: str
    state: str
    told: str
    done: int | None = None
    runs: int | None = None


def runs_in(folder: Path) -> list[Run]:
    """Return the runs in a folder, and in the folders in it, newest first; folders of others are passed over.

    Raises
    ------
    OSError
        If the folder cannot be listed.
    """
    found = []
    for path in (folder, *(each for each in sorted(folder.iterdir()) if each.is_dir())):
        try:
            run = _run_in(path)
        except OSError:  # of others, who let nobody read it
            continue
        if run is not None:
            found.append((run.date, _changed(path), run))
    return [run for *_, run in sorted(found, key=lambda each: each[:2], reverse=True)]


def _changed(path: Path) -> float:
    """Return when the summary of a folder, or its checkpoint, was last written."""
    times = [each.stat().st_mtime for each in (path / SUMMARY, path / FOLDER) if each.exists()]
    return max(times, default=0.0)


def _run_in(path: Path) -> Run | None:
    """Return the run in a folder, None where there is none of ours."""
    checkpoint = path / FOLDER
    if (manifest := Journal(path, path).unfinished()) is not None:
        return _unfinished(path, manifest)
    if Lock(checkpoint / "lock").is_ours() and (checkpoint / "manifest.json").exists():
        return _damaged(path, "", f"{FOLDER}/manifest.json cannot be understood")
    summary = load_object(path / SUMMARY)
    if summary is None:
        return _torn(path)
    files, version = summary.get("files"), summary.get("version")
    if not (isinstance(summary.get("study"), str) and isinstance(version, str) and isinstance(files, list)):
        return None
    missing = [name for name in files if not is_ordinary(path / str(name))]
    if missing:
        told = f"{missing[0]} is missing" + f", and {len(missing) - 1} more" * (len(missing) > 1)
        state, told = "damaged", f"damaged: {told}"
    else:
        failed = not _of(summary, "checks").get("passed", True)
        state, told = "finished", "finished, CHECK FAILED" if failed else "finished"
    replicas = _of(summary, "options").get("replicas")
    swept = _of(summary, "sweep").get("option")
    study = f"{summary['study']} over {swept}" if swept else summary["study"]
    date = str(summary.get("date", ""))
    return Run(str(path), study, _gas(summary.get("states")), replicas, date, state, told)


def _unfinished(path: Path, manifest: Mapping[str, Any]) -> Run:
    checkpoint = path / FOLDER
    done = sum(re.fullmatch(r"done-\d{4,}\.npz", each.name) is not None for each in checkpoint.iterdir())
    runs, replicas = manifest.get("runs"), manifest.get("replicas")
    told = f"unfinished, {done} of {runs} done" if runs is not None else f"unfinished, {done} done"
    written = (checkpoint / "manifest.json").stat().st_mtime
    gas, date = _gas(manifest.get("states")), _day(written)
    return Run(str(path), manifest["study"], gas, replicas, date, "unfinished", told, done, runs)


def _day(seconds: float) -> str:
    return datetime.datetime.fromtimestamp(seconds, datetime.UTC).date().isoformat()


def _damaged(path: Path, study: str, why: str) -> Run:
    return Run(str(path), study, "", None, _day(_changed(path)), "damaged", f"damaged: {why}")


def _torn(path: Path) -> Run | None:
    """Return a run whose summary is damaged, None where it is not clear that it was one of ours."""
    if not is_ordinary(path / SUMMARY):
        return None
    names = "|".join(QUESTIONS)
    study = re.search(rf'"study": "({names})"', _beginning(path / SUMMARY))
    report = re.search(rf"<p>hardspheres ({names})</p>", _beginning(path / "report.html", 100_000))
    if not (study or report):
        return None
    named = (study or report)[1]  # type: ignore[index]
    return _damaged(path, named, f"{SUMMARY} cannot be understood")


def _beginning(path: Path, size: int = 1000) -> str:
    if not is_ordinary(path):
        return ""
    with path.open("rb") as file:
        return file.read(size).decode("utf-8", "replace")


def _of(summary: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return an object in a summary, empty where there is none."""
    found = summary.get(name)
    return found if isinstance(found, dict) else {}


def _gas(states: Any) -> str:
    """Return the gases of a run in words: the first kind, and what tells the others from it."""
    given = [each for each in states if isinstance(each, dict)] if isinstance(states, list) else []
    kinds = list(dict.fromkeys(str(each["gas"]) for each in given if "gas" in each))
    etas = [each["packing_fraction"] for each in given if isinstance(each.get("packing_fraction"), float)]
    words = kinds[:1] + [f"and {len(kinds) - 1} more"] * (len(kinds) > 1)
    if etas and min(etas) == max(etas):
        words.append(f"packing fraction {etas[0]:.4g}")
    elif etas:
        words.append(f"packing fractions {min(etas):.4g} to {max(etas):.4g}")
    return ", ".join(words)


def list_runs(folder: str | None, screen: Screen) -> None:
    """Print which runs are in a folder.

    Parameters
    ----------
    folder : str or None
        By default `runs`, which need not be there.
    screen : Screen
        Where.

    Raises
    ------
    OptionError
        If there is no such folder.
    """
    path = Path(folder or USUAL)
    try:
        found = runs_in(path) if folder is not None or path.exists() else []
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise OptionError(f"{path} cannot be listed: {why}; give a folder with runs in it") from None
    if found:
        screen.table("", HEADER, [_cells(run, path) for run in found], wrap=True)
    else:
        screen.say(f"there are no runs in {path}; each study leaves one in runs, or in the folder of --out")
    screen.finish({"folder": os.fspath(path), "runs": [asdict(run) for run in found]})


def _cells(run: Run, folder: Path) -> list[str]:
    name = os.path.relpath(run.folder, folder) if Path(run.folder) != folder else run.folder
    replicas = "" if run.replicas is None else str(run.replicas)
    return [name, run.study, run.gas, replicas, run.date, run.told]
