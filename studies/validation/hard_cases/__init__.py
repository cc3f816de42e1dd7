"""Hard cases: scenes with exact answers, or where methods break; a table gives the correct digits."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from studies.answer import Section, Table
from studies.options import OptionError, option, word
from studies.page import Report, write_page
from studies.program import Program
from studies.report import OutputFolder, Screen
from studies.running.ownership import REPORT, SUMMARY
from studies.validation.hard_cases import (
    cradle,
    distances,
    exactly_solved,
    falling,
    galperin,
    grazing,
    obstacles,
    packing,
    ratios,
    reversal,
    symmetries,
)
from studies.validation.hard_cases.case import SIZES, Case, Size, keeping

__all__ = ["GROUPS", "Case", "HardCases"]

GROUPS: dict[str, ModuleType] = {
    "galperin": galperin,
    "cradle": cradle,
    "ratios": ratios,
    "grazing": grazing,
    "gravity": falling,
    "obstacles": obstacles,
    "packing": packing,
    "distances": distances,
    "reversal": reversal,
    "symmetries": symmetries,
    "exactly-solved": exactly_solved,
}
"""The groups by their names on the command line, in the order of the table."""

COLUMNS = ("case", "exact", "engine", "correct digits", "")


@dataclass(frozen=True, kw_only=True)
class HardCases(Program):
    """Scenes whose answer is exact, or where methods break."""

    name = "hard-cases"
    question = "Is the engine right where the answer is exact, or where methods break?"
    explanation = """
    Collisions that count digits of pi, cradles, wide ratios of mass and size, grazing collisions, gravity,
    obstacles, close packing, huge and tiny boxes, reversal, symmetries, solved gases. Writes a table of the
    exact answer, the engine's, and the number of correct digits. Every finished long run is kept; an
    interrupted one starts again.
    """
    files = ("hard_cases.csv",)
    reports = True

    size: str = option(
        "full",
        "small (a minute), full (some minutes) or long (hours).",
        **word("--size", *SIZES),
    )
    only: tuple[str, ...] = option(
        (),
        f"One group of cases: {', '.join(GROUPS)}; may be given several times.",
        several=True,
        shown="all eleven",
        **word("--only", *GROUPS),
    )

    @property
    def which(self) -> str:
        """What its folder is called after by default: its size."""
        return self.size

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run the cases, print a table for each group, write hard_cases.csv and summary.json."""
        for name in self.only:
            if name not in GROUPS:
                raise OptionError(f"--only {name} is not a group; there are {', '.join(GROUPS)}")
        size = next((size for size in SIZES if size == self.size), None)
        if size is None:
            raise OptionError(f"--size {self.size} is not known; there are {', '.join(SIZES)}")
        groups = {name: group for name, group in GROUPS.items() if not self.only or name in self.only}
        out.check(self)
        began = time.perf_counter()
        with out.running(self) as shelf:
            with keeping(shelf):
                rows = _table(size, groups, screen)
            summary = _written(self, size, rows, out, began)
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
        lines = [_cells(case) for case in done]
        screen.table(f"{group.TITLE} ({time.perf_counter() - started:.0f} s)", COLUMNS, lines, wrap=True)
        screen.say()
        rows += [(name, case) for case in done]
    return rows


def _cells(case: Case) -> list[str]:
    return [case.name, case.exact, case.engine, case.digits_text, "" if case.passed else "FAILED"]


def _section(name: str, rows: list[tuple[str, Case]]) -> Section:
    cells = [_cells(case) for group, case in rows if group == name]
    return Section(GROUPS[name].TITLE, [Table(COLUMNS, cells)])


def _written(
    study: HardCases, size: Size, rows: list[tuple[str, Case]], out: OutputFolder, began: float
) -> dict[str, Any]:
    """Write hard_cases.csv, report.html and summary.json; return the content of the latter."""
    failures = [f"{name}: {case.name}: {case.engine}" for name, case in rows if not case.passed]
    columns: dict[str, list[Any]] = {"group": [name for name, _ in rows]}
    for field in ("name", "exact", "engine", "error", "allowed", "digits", "passed"):
        columns["case" if field == "name" else field] = [getattr(case, field) for _, case in rows]
    out.write_csv("hard_cases.csv", columns)
    summary: dict[str, Any] = {
        **study.made(),
        "size": size,
        "cases": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
        "checks": {"passed": not failures, "failures": failures},
        "seconds": time.perf_counter() - began,
        "files": sorted({*out.files, REPORT, SUMMARY}),
    }
    page = Report(
        name=study.name,
        subject=f"Hard cases, {size}",
        question=study.asked,
        answer=[f"{len(rows) - len(failures)} of {len(rows)} cases passed."],
        sections=[_section(name, rows) for name in dict.fromkeys(group for group, _ in rows)],
        summary=summary,
    )
    write_page(out, page)
    out.write_json(SUMMARY, summary)
    return summary
