"""Hard cases: scenes with exact answers, or where methods break; a table gives the correct digits."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import hardspheres as hs
from studies.report import OutputFolder, Screen
from studies.validation.hard_cases import (
    cradle,
    distances,
    exactly_solved,
    galperin,
    grazing,
    packing,
    ratios,
    reversal,
    symmetries,
)
from studies.validation.hard_cases.case import SIZES, Case, Size, keeping

__all__ = ["GROUPS", "Case", "groups_named", "hard_cases"]

GROUPS: dict[str, ModuleType] = {
    "galperin": galperin,
    "cradle": cradle,
    "ratios": ratios,
    "grazing": grazing,
    "packing": packing,
    "distances": distances,
    "reversal": reversal,
    "symmetries": symmetries,
    "exactly-solved": exactly_solved,
}
"""The groups by their names on the command line, in the order of the table."""

COLUMNS = ("case", "exact", "engine", "correct digits", "")


@dataclass(frozen=True)
class HardCases:
    """Options of the study, as on the command line (`hardspheres hard-cases --help`).

    Attributes
    ----------
    size : str
        "small", "full" or "long".
    only : tuple of str
        The groups.
    """

    size: Size
    only: tuple[str, ...]


def groups_named(names: Sequence[str] | None) -> dict[str, ModuleType]:
    """Return some of the groups, or all of them.

    Raises
    ------
    HardSpheresError
        If there is no group of a name.
    """
    for name in names or ():
        if name not in GROUPS:
            raise hs.HardSpheresError(f"--only {name} is not a group; there are {', '.join(GROUPS)}")
    return {name: group for name, group in GROUPS.items() if not names or name in names}


def size_named(name: str) -> Size:
    """Return a size by its name.

    Raises
    ------
    HardSpheresError
        If there is none of this name.
    """
    for size in SIZES:
        if size == name:
            return size
    raise hs.HardSpheresError(f"--size {name} is not known; there are {', '.join(SIZES)}")


def hard_cases(
    size: Size, groups: dict[str, ModuleType], out: OutputFolder, screen: Screen
) -> tuple[dict[str, Any], bool]:
    """Run the cases, print a table for each group, write hard_cases.csv and summary.json.

    Parameters
    ----------
    size : str
        "small", "full" or "long".
    groups : dict
        Some of `GROUPS`.
    out : OutputFolder
        Where the files go.
    screen : Screen
        Where the tables go.

    Returns
    -------
    summary : dict
        Content of summary.json.
    sound : bool
        Whether every case passed.
    """
    study = HardCases(size, tuple(groups))
    out.check(study)
    began = time.perf_counter()
    with out.running(study) as shelf:
        with keeping(shelf):
            rows = _table(size, groups, screen)
        summary = _written(size, rows, out, began)
    failures = summary["checks"]["failures"]
    screen.say(f"{len(rows) - len(failures)} of {len(rows)} cases passed in {summary['seconds']:.0f} s")
    for failure in failures:
        screen.say(f"CHECK FAILED, {failure}")
    screen.say(f"written to {out.path}: {', '.join(out.files)}")
    return summary, not failures


def _table(size: Size, groups: dict[str, ModuleType], screen: Screen) -> list[tuple[str, Case]]:
    """Run the cases group by group, print each, and return them with the names of their groups."""
    rows = []
    for name, group in groups.items():
        started = time.perf_counter()
        with screen.working(f"{group.TITLE} ..."):
            done: list[Case] = list(group.cases(size))
        lines = [(c.name, c.exact, c.engine, c.digits_text, "" if c.passed else "FAILED") for c in done]
        screen.table(f"{group.TITLE} ({time.perf_counter() - started:.0f} s)", COLUMNS, lines, wrap=True)
        screen.say()
        rows += [(name, case) for case in done]
    return rows


def _written(size: Size, rows: list[tuple[str, Case]], out: OutputFolder, began: float) -> dict[str, Any]:
    """Write hard_cases.csv and summary.json; return the content of the latter."""
    failures = [f"{name}: {case.name}: {case.engine}" for name, case in rows if not case.passed]
    columns: dict[str, list[Any]] = {"group": [name for name, _ in rows]}
    for field in ("name", "exact", "engine", "error", "allowed", "digits", "passed"):
        columns["case" if field == "name" else field] = [getattr(case, field) for _, case in rows]
    out.write_csv("hard_cases.csv", columns)
    summary: dict[str, Any] = {
        "study": "hard-cases",
        "size": size,
        "cases": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
        "checks": {"passed": not failures, "failures": failures},
        "seconds": time.perf_counter() - began,
        "version": hs.__version__,
        "files": [*out.files, "summary.json"],
    }
    out.write_json("summary.json", summary)
    return summary
