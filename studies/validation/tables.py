"""Accuracy tables: what this package measures beside the best numbers that are known, and at what cost.

Everything is measured in rounds of independent runs. Each finished round is a few lines of rounds.csv, and
the tables are made of all rounds that there are: early ones are complete, and later ones more precise.
"""

from __future__ import annotations

import csv
import json
import math
import re
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import groupby
from pathlib import Path
from typing import Any

from scipy import stats

from analysis.statistics import Estimate, TheoryCheck, pool_replicas
from hardspheres.cores import available_cores
from studies.layout import wrapped
from studies.options import OptionError, option, seed, workers
from studies.program import Program
from studies.report import OutputFolder, Screen, seconds_taken, today
from studies.running.ensemble import run_replicas
from studies.running.ownership import SUMMARY
from studies.running.shards import run_part
from studies.validation.tables_measured import MEASURED, QUICK, Measured, measure

__all__ = ["BEGIN", "END", "AccuracyTables", "Line", "Row", "alarm", "between_marks", "markdown", "pooled"]

ROUNDS, TABLES = "rounds.csv", "tables.json"
BEGIN, END = "<!-- accuracy tables: begin -->", "<!-- accuracy tables: end -->"
FALSE_ALARM = 0.01
"""Probability that a right program on other seeds has a row beyond the alarm, all rows together."""
COLUMNS = (
    "observable",
    "gas, packing fraction",
    "measured",
    "reference",
    "z",
    "relative difference",
    "relative error",
    "collisions",
    "core s",
)


@dataclass(frozen=True)
class Line:
    """One number of one round.

    Attributes
    ----------
    measurement, round : str, int
        Which; a round gives several numbers.
    quantity : str
        What was measured.
    value, standard_error, degrees_of_freedom : float
        The number, see `Estimate`.
    expected, uncertainty, reference : float, float, str
        The best known value, its standard uncertainty, and who measured or derived it.
    collisions, core_seconds : int, float
        Of the round.
    date : str
        YYYY-MM-DD of UTC.
    """

    measurement: str
    round: int
    quantity: str
    value: float
    standard_error: float
    degrees_of_freedom: float
    expected: float
    uncertainty: float
    reference: str
    collisions: int
    core_seconds: float
    date: str


@dataclass(frozen=True)
class Row:
    """One number of all rounds, beside its reference.

    Attributes
    ----------
    measurement, quantity, value, standard_error, degrees_of_freedom, expected, uncertainty, reference
        As in `Line`.
    state, others : str
        The gas; what other programs give.
    rounds, collisions, core_seconds : int, int, float
        How many rounds there are, and what they took; the rows of one measurement share them.
    first, last : str
        Dates of the rounds.
    """

    measurement: str
    quantity: str
    state: str
    value: float
    standard_error: float
    degrees_of_freedom: float
    expected: float
    uncertainty: float
    reference: str
    others: str
    rounds: int
    collisions: int
    core_seconds: float
    first: str
    last: str

    @property
    def check(self) -> TheoryCheck:
        """The measurement beside its reference."""
        freedom = self.degrees_of_freedom
        measured = Estimate(self.value, self.standard_error, freedom + 1.0, freedom)
        return TheoryCheck(self.quantity, self.reference, measured, self.expected, self.uncertainty)

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as it is printed, an entry for each of `COLUMNS`."""
        check = self.check
        reference = (
            f"{Estimate(self.expected, self.uncertainty)}" if self.uncertainty else f"{self.expected:.7g}"
        )
        return (
            self.quantity,
            self.state,
            str(check.measured),
            f"{reference}, {self.reference}{f'; {self.others}' if self.others else ''}",
            f"{check.z:+.1f}",
            _power(f"{self.value / self.expected - 1.0:+.1e}"),
            _power(f"{abs(self.standard_error / self.value):.1e}"),
            _power(f"{self.collisions:.1e}"),
            f"{self.core_seconds:.0f}",
        )


def _power(text: str) -> str:
    """Return a number like 3.0e-05 as 3.0e-5, and 2.0e+09 as 2.0e9."""
    return re.sub(r"e([+-])0*", lambda found: "e" + found[1].replace("+", ""), text)


def read_lines(path: Path) -> list[Line]:
    """Return the rounds in a file; OptionError where it is none."""
    kinds = {each.name: {"str": str, "int": int, "float": float}[str(each.type)] for each in fields(Line)}
    try:
        with path.open(encoding="utf-8", newline="") as handle:
            reader = csv.DictReader(handle)
            if reader.fieldnames != list(kinds):
                raise ValueError
            return [Line(**{name: kinds[name](row[name]) for name in kinds}) for row in reader]
    except OSError as error:
        raise OptionError(f"--known {path} cannot be read: {error.strerror}") from error
    except (ValueError, TypeError, csv.Error) as error:
        raise OptionError(
            f"--known {path} is no {ROUNDS} of this version; name one that accuracy-tables wrote"
        ) from error


def pooled(lines: Iterable[Line], table: Mapping[str, Measured]) -> list[Row]:
    """Return the mean of all rounds of each quantity, in the order of the measurements.

    Errors are those of the rounds' own, or of their spread where that is larger, see `pool_replicas`.
    """
    order = {name: k for k, name in enumerate(table)}
    known = sorted(lines, key=lambda line: (order[line.measurement], line.round))  # which keeps quantities
    rows = []
    for name, its in groupby(known, key=lambda line: line.measurement):
        own = list(its)
        for quantity in dict.fromkeys(line.quantity for line in own):
            of = [line for line in own if line.quantity == quantity]
            freedom = [line.degrees_of_freedom for line in of]
            found = pool_replicas(
                [
                    Estimate(line.value, line.standard_error, df + 1.0, df)
                    for line, df in zip(of, freedom, strict=True)
                ]
            )
            rows.append(
                Row(
                    name,
                    quantity,
                    table[name].state,
                    found.value,
                    found.standard_error,
                    found.degrees_of_freedom,
                    of[0].expected,
                    of[0].uncertainty,
                    of[0].reference,
                    table[name].others,
                    len(of),
                    sum(line.collisions for line in of),
                    sum(line.core_seconds for line in of),
                    min(line.date for line in of),
                    max(line.date for line in of),
                )
            )
    return rows


def alarm(count: int) -> float:
    """Return |z| beyond which one of so many right rows lies by chance in `FALSE_ALARM` of all seeds."""
    return float(stats.norm.isf(FALSE_ALARM / (2.0 * count)))


def failures_of(rows: Sequence[Row]) -> list[str]:
    """Return a sentence for each row that is beyond the alarm, or has no error bar."""
    limit = alarm(max(len(rows), 1))
    return [
        f"{row.state}: {row.quantity} is {row.check.z:+.1f} standard errors from {row.reference}"
        for row in rows
        if not abs(row.check.z) < limit
    ]


def markdown(rows: Sequence[Row], made: Mapping[str, Any]) -> str:
    """Return the section of the README between its marks."""
    worst = max(rows, key=lambda row: abs(row.check.z))
    dates = sorted({row.first for row in rows} | {row.last for row in rows})
    when = dates[0] if len({*dates}) == 1 else f"{dates[0]} to {dates[-1]}"
    unique = {row.measurement: row for row in rows}.values()
    total, seconds = sum(row.collisions for row in unique), sum(row.core_seconds for row in unique)
    where = f"{made['machine']['processor']}, {made['machine']['system']}"
    head = (
        f"Measured {when}, {where}: {_power(f'{total:.1e}')} collisions in {seconds / 3600:.1f} hours of one "
        f"core. Largest |z| of {len(rows)} rows: {abs(worst.check.z):.1f}; one beyond "
        f"{alarm(len(rows)):.1f} has a probability of {FALSE_ALARM:.0%}."
    )
    lines = [
        *wrapped(head, 110),
        "",
        f"| {' | '.join(COLUMNS)} |",
        f"|{'---|' * len(COLUMNS)}",
    ]
    before = ""
    for row in rows:
        cells = list(row.cells)
        if row.measurement == before:  # the cost is that of all its rows
            cells[-2:] = "", ""
        lines.append(f"| {' | '.join(cells)} |".replace("<", "&lt;"))
        before = row.measurement
    return "\n".join(lines) + "\n"


def between_marks(text: str, section: str | None = None) -> str:
    """Return what stands between the marks in a text; with a section, the text with that in its place."""
    head, begin, rest = text.partition(BEGIN)
    old, end, tail = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the text has no {BEGIN} and {END}")
    return old.strip("\n") + "\n" if section is None else f"{head}{BEGIN}\n\n{section}\n{END}{tail}"


def stored(folder: Path) -> tuple[list[Row], dict[str, Any]]:
    """Return the rows that a run left in a folder, and what made them."""
    content = json.loads((folder / TABLES).read_text(encoding="utf-8"))
    for row in content["rows"]:
        row |= {name: math.inf for name, its in row.items() if its is None}  # degrees of freedom
    return [Row(**row) for row in content["rows"]], content["made"]


@dataclass(frozen=True)
class _Round:
    """The task of a worker process: one round of one measurement, unless it is known."""

    quick: bool
    root: int
    known: Sequence[Line]

    def __call__(self, item: tuple[str, int]) -> list[Line]:
        """Return its lines."""
        if there := [line for line in self.known if (line.measurement, line.round) == item]:
            return there
        began = time.process_time()
        checks, collisions = measure(item, QUICK if self.quick else MEASURED, self.root)
        spent = round(time.process_time() - began, 2)
        return [
            Line(
                *item,
                check.quantity,
                check.measured.value,
                check.measured.standard_error,
                check.measured.degrees_of_freedom,
                check.expected,
                check.uncertainty,
                check.theory,
                collisions,
                spent,
                today(),
            )
            for check in checks
        ]


@dataclass(frozen=True, kw_only=True)
class AccuracyTables(Program):
    """Every observable beside the best number that is known for it."""

    name = "accuracy-tables"
    question = "How accurate is each number, beside the best that is known?"
    explanation = f"""
    Pressure of spheres and discs, contact value, free paths, relaxation and diffusion beside literature,
    exact results and other programs, with the cost of each. A round takes some minutes of one core;
    {ROUNDS} and {TABLES} are written as it goes, and errors fall as the root of their number. A run with
    --known {ROUNDS} adds rounds to these.
    """
    files = (ROUNDS, TABLES)
    in_shards = True

    rounds: int = option(30, "Independent runs of each pressure; a fifth as many of all else.", at_least=1)
    known: str | None = option(None, f"A {ROUNDS} of this version: rounds in it are not run again.")
    quick: bool = option(False, "Tiny gases, to see that it works.")
    seed: int = seed()
    workers: int | None = workers()

    @property
    def _table(self) -> dict[str, Measured]:
        return QUICK if self.quick else MEASURED

    def _known(self) -> list[Line]:
        lines = read_lines(Path(self.known)) if self.known is not None else []
        if other := {line.measurement for line in lines} - {*self._table}:
            raise OptionError(
                f"--known {self.known} has rounds of {min(other)!r}, which are not measured "
                f"{'with' if self.quick else 'without'} --quick; name a file of the same kind of run"
            )
        names = Counter((line.measurement, line.round, line.quantity) for line in lines)
        if twice := [name for name, count in names.items() if count > 1]:
            measurement, number, quantity = twice[0]
            raise OptionError(
                f"--known {self.known} has {quantity!r} of round {number} of {measurement!r} twice; leave one"
            )
        return lines

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run all rounds that are not known, or those of a shard; sound where no row is beyond `alarm`."""
        began = time.perf_counter()
        known = self._known()
        out.check(self)
        items = [
            (name, number)
            for number in range(self.rounds)
            for name, each in self._table.items()
            if number % each.every == 0
        ]
        there = {(line.measurement, line.round) for line in known}
        beyond = [line for line in known if (line.measurement, line.round) not in items]
        with screen.compiling("the gases of all tables"):
            for name in dict.fromkeys(item[0] for item in items if item not in there):
                self._table[name].load()
        ready = time.perf_counter()
        task = _Round(self.quick, self.seed, known)
        if out.shard is not None:
            with out.shared(self) as shared:
                run_part(task, list(enumerate(items)), shared, screen, workers=self.workers)
            return {}, True
        with out.running(self) as shelf, screen.progress("rounds", len(items)) as advance:
            kept: dict[int, list[Line]] = {}

            def told() -> None:
                advance()
                finished = [shelf.result(index) if index not in kept else None for index in range(len(items))]
                new = {index: result[0] for index, result in enumerate(finished) if result is not None}
                kept.update(new)
                if new:
                    self._write(out, [*beyond, *(line for index in sorted(kept) for line in kept[index])])

            found = run_replicas(
                task,
                items,
                workers=self.workers,
                done=told,
                shelf=shelf,
                note=screen.note,
            )
            ran = time.perf_counter()
            rows = self._write(out, [*beyond, *(line for lines in found for line in lines)])
            failures = failures_of(rows)
            summary: dict[str, Any] = {
                **self.made(),
                "seed": self.seed,
                "workers": available_cores() if self.workers is None else self.workers,
                "rows": [asdict(row) for row in rows],
                "checks": {"passed": not failures, "failures": failures, "alarm": alarm(len(rows))},
                "files": sorted({*out.files, SUMMARY}),
                "seconds": seconds_taken(began, ready, ran, work="rounds"),
            }
            out.write_json(SUMMARY, summary)
        screen.table("", COLUMNS, [row.cells for row in rows], keys=2)
        screen.say(
            "z: standard errors from the reference, its own uncertainty and few rounds allowed for; one "
            f"beyond {alarm(len(rows)):.1f} has a probability of {FALSE_ALARM:.0%}; relative error: one "
            "standard error"
        )
        for failure in failures:
            screen.say(f"CHECK FAILED, {failure}")
        screen.say(f"written to {out.path}: {', '.join(summary['files'])}")
        return summary, not failures

    def _write(self, out: OutputFolder, lines: Sequence[Line]) -> list[Row]:
        """Write both files from all rounds that there are, and return the rows."""
        rows = pooled(lines, self._table)
        names = [each.name for each in fields(Line)]
        out.write_csv("rounds.csv", {name: [getattr(line, name) for line in lines] for name in names})
        out.write_json("tables.json", {"made": self.made(), "rows": [asdict(row) for row in rows]})
        return rows


def main(folder: Path, readme: Path) -> None:
    """Put the tables that a run left in a folder between the marks of a README."""
    text = between_marks(readme.read_text(encoding="utf-8"), markdown(*stored(folder)))
    readme.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
