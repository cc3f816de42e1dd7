"""Ownership of files in an output folder: only those of a run of ours may ever be replaced."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from studies.formats import FORMATS, in_format
from studies.registry import QUESTIONS, study_named

__all__ = [
    "REPORT",
    "SUMMARY",
    "every_file",
    "files_of",
    "files_of_finished_run",
    "is_ordinary",
    "load_object",
]

SUMMARY, REPORT = "summary.json", "report.html"


def files_of(study: Any) -> tuple[str, ...]:
    """Return what a study writes beside its summary, figures as .png: its `files`, and its report if any."""
    return (*getattr(study, "files", ()), *[REPORT] * getattr(study, "reports", False))


@functools.cache
def every_file() -> frozenset[str]:
    """Return all names of files that the studies of this package write, figures in every format."""
    names = {SUMMARY}.union(*(files_of(study_named(name)) for name in QUESTIONS))
    return frozenset(in_format(name, form) for name in names for form in FORMATS)


def is_ordinary(path: Path) -> bool:
    """Return whether there is an ordinary file of this name, not a link to one."""
    return path.is_file() and not path.is_symlink()


def load_object(path: Path) -> dict[str, Any] | None:
    """Return the JSON object in an ordinary file, None where there is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if is_ordinary(path) else None
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def files_of_finished_run(folder: Path, known: Callable[[], Iterable[str]]) -> set[str] | None:
    """Return which of the known names are files of the finished run in a folder; None where there is none.

    The names are asked for only where there is one: to know them all takes loading every study.
    """
    summary = load_object(folder / SUMMARY) or {}
    files = summary.get("files")
    ours = isinstance(summary.get("study"), str) and isinstance(summary.get("version"), str)
    if not ours or not isinstance(files, list) or SUMMARY not in files:
        return None
    return {name for name in known() if name in files and is_ordinary(folder / name)}
