"""What a study answers: numbers and curves with error bars beside theory, and their table, CSV and JSON."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.statistics import Estimate, TheoryCheck
from analysis.theory import Prediction
from studies.report import Z_MEANS, Screen, alarming, estimate_json

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "Answer",
    "Column",
    "Curves",
    "Gas",
    "Section",
    "Table",
    "alarms",
    "dataframe",
    "deviation_cell",
    "expected_cell",
    "heading",
    "marks_of",
    "measured_cell",
    "names_of",
    "notes_of",
    "number",
    "say_sections",
    "sections",
    "tidy",
    "to_dataframe",
    "write_tables",
]

FloatArray = NDArray[np.float64]
Gas = Any  # what a study measures; it has n, dim, packing_fraction, kind and scene(seed), and a text

WIDEST = 6  # quantities that stand side by side
SHOWN = 4  # by the `repr` of an answer
_U = "u"  # marks a measurement that is better than its theory
BETTER = f"{_U}: the measurement is better than the theory, whose uncertainty exceeds two standard errors"


def number(quantity: str, measured: Estimate | float, theory: str = "", expected: Any = None) -> TheoryCheck:
    """Return a measured number beside its theory.

    Parameters
    ----------
    quantity : str
        What was measured.
    measured : Estimate or float
        The result; a float is one without an error bar.
    theory : str, optional
        Name of the theory.
    expected : Prediction or float, optional
        Its value; none by default.
    """
    if not isinstance(measured, Estimate):
        measured = Estimate(float(measured), math.nan)
    if expected is None:
        expected = Prediction(math.nan, math.nan)
    elif not isinstance(expected, Prediction):
        expected = Prediction(float(expected), 0.0)
    return TheoryCheck(quantity, theory, measured, float(expected.value), float(expected.uncertainty))


def alarms(numbers: Sequence[TheoryCheck]) -> list[str]:
    """Return one sentence for each number that is beyond 5 standard errors from its theory."""
    return [
        f"{found.quantity} is {found.z:+.1f} standard errors from {found.theory or f'{found.expected:g}'}"
        for found in numbers
        if alarming(found.measured, found.expected, found.uncertainty)
    ]


@dataclass(frozen=True)
class Column:
    """One curve: values at all abscissae of its `Curves`.

    Attributes
    ----------
    value : (L,) array
        Measured.
    error : (L,) array
        Standard errors, NaN where they are unknown.
    theory, uncertainty : (L,) arrays, optional
        What theory says there, and its own uncertainty.
    z : (L,) array, optional
        Deviations as normal deviates, see `analysis.statistics.deviates`; without them a table has no theory.
    title : str, optional
        Of the printed column; by default its name.
    printed : bool
        Whether it is in the printed table, where there is one.
    brief : bool
        Whether theory is printed without its uncertainty, which z allows for anyway.
    """

    value: FloatArray
    error: FloatArray
    theory: FloatArray | None = None
    uncertainty: FloatArray | None = None
    z: FloatArray | None = None
    title: str | None = None
    printed: bool = True
    brief: bool = False

    def __repr__(self) -> str:
        """Return how many values there are, and where they lie."""
        beside = " beside theory" if self.theory is not None and np.isfinite(self.theory).any() else ""
        return f"<Column: {_span(self.value)}{beside}>"

    @property
    def better_than_theory(self) -> NDArray[np.bool_]:
        """Where the uncertainty of theory exceeds two standard errors, (L,); only where z is known."""
        if self.z is None or self.uncertainty is None:
            return np.zeros(len(self.value), dtype=bool)
        return np.isfinite(self.z) & (self.uncertainty > 2.0 * self.error)

    def parts(self, name: str) -> Iterator[tuple[str, FloatArray]]:
        """Yield the columns of a file under their names."""
        yield name, self.value
        for part in ("error", "theory", "uncertainty", "z"):
            if getattr(self, part) is not None:
                yield f"{name}_{part}", getattr(self, part)

    def cells(self, name: str) -> Iterator[tuple[str, list[str]]]:
        """Yield title and cells of each column of a table."""
        yield self.title or name, _cells(self.value, self.error)
        if self.theory is None or self.z is None or not np.isfinite(self.theory).any():
            return
        yield "theory", _cells(self.theory, None if self.brief else self.uncertainty)
        marks = np.where(self.better_than_theory, _U, "")
        yield "z", [deviation_cell(z, str(mark)) for z, mark in zip(self.z, marks, strict=True)]


@dataclass(frozen=True)
class Curves:
    """Curves over the same abscissae: one file, and a table where it is short.

    Attributes
    ----------
    axes : dict of (L,) array
        Abscissae by name: time, collisions per particle, species ...
    columns : dict of Column
        The curves by name.
    printed : bool
        Whether they are shown as a table, and are in the summary.
    beside : dict of (L,) array
        What has no error bar, for the file alone.
    """

    axes: Mapping[str, FloatArray]
    columns: Mapping[str, Column]
    printed: bool = False
    beside: Mapping[str, FloatArray] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return which curves they are, and over what."""
        over = ", ".join(f"{name} ({_span(axis)})" for name, axis in self.axes.items())
        return f"<Curves: {', '.join(self.columns)} over {over}>"

    def flat(self) -> dict[str, FloatArray]:
        """Return all columns of a file under their names."""
        found = {**self.axes, **self.beside}
        for name, column in self.columns.items():
            found |= dict(column.parts(name))
        return found

    def to_dataframe(self) -> DataFrame:
        """Return all columns of the file as a pandas DataFrame; ImportError where pandas is missing."""
        return dataframe(self.flat())

    def rows(self) -> tuple[list[str], list[list[str]]]:
        """Return header and rows of a printed table."""
        printed = [(name, [f"{x:.4g}" for x in axis]) for name, axis in self.axes.items()]
        for name, column in self.columns.items():
            if column.printed:
                printed += column.cells(name)
        return [title for title, _ in printed], [
            list(row) for row in zip(*(cells for _, cells in printed), strict=True)
        ]


@dataclass(frozen=True)
class Answer:
    """What the replicas of one gas say together.

    Attributes
    ----------
    gas
        The gas.
    numbers : list of TheoryCheck
        Measured numbers, beside their theory where there is one, see `number`.
    curves : dict of Curves
        By the name of their file, without its ending.
    notes, failures : sequences of str
        What is to be known about the numbers; checks that failed.
    main : sequence of str, or str
        Quantities whose precision `--until-error` is about, the first of all by default; a text says why
        there is none.
    details : dict
        What else the summary tells, and what a figure needs.
    hidden : dict
        What only the figure needs.
    """

    gas: Gas
    numbers: Sequence[TheoryCheck]
    curves: Mapping[str, Curves] = field(default_factory=dict)
    notes: Sequence[str] = ()
    failures: Sequence[str] = ()
    main: Sequence[str] | str | None = None
    details: Mapping[str, Any] = field(default_factory=dict)
    hidden: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return which gas it is of, the first numbers, and what failed."""
        shown = [f"{found.quantity} {measured_cell(found)}" for found in self.numbers[:SHOWN]]
        more = len(self.numbers) - len(shown)
        shown += [f"{more} more"] * (more > 0) + [f"curves {name}" for name in self.curves]
        shown += [f"{len(self.failures)} FAILED"] * bool(self.failures)
        return f"<Answer on {self._title}: {', '.join(shown)}>"

    def _repr_html_(self) -> str:
        """Return the table of all numbers, with what is to be known about them, for a notebook."""
        header, rows, _ = _long([self])
        lines = [_html_row("th", header), *(_html_row("td", row) for row in rows)]
        said = [*(f"CHECK FAILED, {why}" for why in self.failures), *self.notes]
        remarks = "".join(f"<br>{html.escape(each)}" for each in said)
        return f"<p>{html.escape(self._title)}{remarks}</p><table>{''.join(lines)}</table>"

    @property
    def _title(self) -> str:
        density = getattr(self.gas, "packing_fraction", None)
        return f"{self.gas}" if density is None else f"{self.gas}, packing fraction {density:.4g}"

    def __getitem__(self, quantity: str) -> TheoryCheck:
        """Return the number of this name."""
        return next(found for found in self.numbers if found.quantity == quantity)

    @property
    def better_than_theory(self) -> bool:
        """Whether a printed z is marked: some measurement is more precise than its theory."""
        printed = [curves for curves in self.curves.values() if curves.printed]
        columns = [column for curves in printed for column in curves.columns.values() if column.printed]
        return any(found.better_than_theory for found in self.numbers) or any(
            column.better_than_theory.any() for column in columns
        )

    @property
    def label(self) -> str:
        """What tells this gas from others of its kind."""
        return f"packing fraction {self.gas.packing_fraction:g}"

    def to_dataframe(self) -> DataFrame:
        """Return the numbers as a pandas DataFrame; see `studies.answer.to_dataframe`, for several gases."""
        return to_dataframe([self])

    def summary(self) -> dict[str, Any]:
        """Return what summary.json tells of this gas."""
        main = [self.numbers[0].quantity] if self.main is None else self.main
        return {
            "gas": str(self.gas),
            "packing_fraction": self.gas.packing_fraction,
            "measured": [_number_json(found) for found in self.numbers],
            "main": main if isinstance(main, str) else list(main),
            **{name: curves.flat() for name, curves in self.curves.items() if curves.printed},
            **self.details,
            "notes": list(self.notes),
            "failures": list(self.failures),
        }


def _number_json(found: TheoryCheck) -> dict[str, Any]:
    return {
        "quantity": found.quantity,
        **estimate_json(found.measured),
        "theory": found.theory,
        "expected": found.expected,
        "uncertainty": found.uncertainty,
        "z": found.z,
        "better_than_theory": found.better_than_theory,
    }


def names_of(answers: Sequence[Answer]) -> list[str]:
    """Return what tells each gas from the others: packing fraction, and the kind where there are several."""
    if len(answers) == 1:
        return [""]
    kinds = _several_kinds(answers)
    return [f"{answer.gas}, {answer.label}" if kinds else answer.label for answer in answers]


def _several_kinds(answers: Sequence[Answer]) -> bool:
    return len({str(answer.gas) for answer in answers}) > 1


def tidy(answers: Sequence[Answer]) -> dict[str, list[Any]]:
    """Return the columns of the file of all numbers: one row for each.

    The first column names the gas where there are several kinds.
    """
    rows = [(answer.gas, found) for answer in answers for found in answer.numbers]
    return ({"gas": [str(gas) for gas, _ in rows]} if _several_kinds(answers) else {}) | {
        "packing_fraction": [gas.packing_fraction for gas, _ in rows],
        "quantity": [found.quantity for _, found in rows],
        "value": [found.measured.value for _, found in rows],
        "error": [found.measured.standard_error for _, found in rows],
        "theory": [found.theory for _, found in rows],
        "expected": [found.expected for _, found in rows],
        "uncertainty": [found.uncertainty for _, found in rows],
        "z": [found.z for _, found in rows],
    }


def to_dataframe(answers: Sequence[Answer], curves: str | None = None) -> DataFrame:
    """Return all numbers of several gases, or the curves of this name, as the file of the study has them.

    Parameters
    ----------
    answers : sequence of Answer
        As from `Study.answers`.
    curves : str, optional
        A name in `Answer.curves`.

    Raises
    ------
    ImportError
        If pandas is not installed: it is no dependency.
    """
    return dataframe(tidy(answers) if curves is None else curve_files(answers)[curves])


def dataframe(columns: Mapping[str, Any]) -> DataFrame:
    """Return columns as a pandas DataFrame; ImportError where pandas is missing."""
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "a DataFrame needs pandas, which is not installed here: pip install pandas"
        ) from error
    return pandas.DataFrame(columns)


def _place(answer: Answer, answers: Sequence[Answer]) -> dict[str, Any]:
    """Return what tells the gas of an answer from those of the others in a file of curves."""
    place: dict[str, Any] = {"gas": str(answer.gas)} if len({str(one.gas) for one in answers}) > 1 else {}
    return place | ({"packing_fraction": answer.gas.packing_fraction} if len(answers) > 1 else {})


def curve_files(answers: Sequence[Answer]) -> dict[str, dict[str, FloatArray]]:
    """Return the columns of each file of curves by its name: one gas after another."""
    files: dict[str, dict[str, FloatArray]] = {}
    for name in dict.fromkeys(name for answer in answers for name in answer.curves):
        parts = []
        for answer in answers:
            flat = answer.curves[name].flat()
            length = len(next(iter(flat.values())))
            parts.append({key: np.full(length, name) for key, name in _place(answer, answers).items()} | flat)
        files[name] = {key: np.concatenate([part[key] for part in parts]) for key in parts[0]}
    return files


def heading(answers: Sequence[Answer], replicas: int | None) -> str:
    """Return what was measured: replicas if any, the gas, and its packing fraction where there is one."""
    kind = f"{replicas} x {answers[0].gas}" if replicas else str(answers[0].gas)
    return f"{kind}, {answers[0].label}" if len(answers) == 1 else kind


def marks_of(answers: Sequence[Answer]) -> list[str]:
    """Return what z is, and the mark beside it where there is one, in sentences."""
    return [Z_MEANS] + [BETTER] * any(answer.better_than_theory for answer in answers)


def notes_of(answers: Sequence[Answer]) -> list[str]:
    """Return the notes of all gases, each with what tells its gas from the others."""
    return [
        f"{where}: {note}" if where else note
        for answer, where in zip(answers, names_of(answers), strict=True)
        for note in answer.notes
    ]


@dataclass(frozen=True)
class Table:
    """A table as it is shown, on the screen and on pages.

    Attributes
    ----------
    header : list of str
        Titles of the columns.
    rows : list of list of str
        Cells.
    keys : int
        How many of the first columns name a row.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    keys: int = 1


@dataclass(frozen=True)
class Section:
    """Tables of gases of one kind, under one title."""

    title: str
    tables: Sequence[Table]


def sections(answers: Sequence[Answer], replicas: int | None) -> list[Section]:
    """Return the tables of all numbers of all gases, and of the curves that are short.

    Parameters
    ----------
    answers : sequence of Answer
        Gases of one kind beside each other.
    replicas : int or None
        Runs of each gas; None where the word has no meaning.
    """
    found = []
    for _, group in groupby(answers, lambda answer: str(answer.gas)):
        same = list(group)
        count = f", {len(same)} packing fractions" if len(same) > 1 else ""
        tables = [
            Table(*curves.rows()) for answer in same for curves in answer.curves.values() if curves.printed
        ]
        numbers = Table(*(_wide(same) if _regular(same) else _long(same)))
        found.append(
            Section(heading(same, replicas) + count, [*tables, *([numbers] if numbers.rows else [])])
        )
    return found


def write_tables(screen: Screen, answers: Sequence[Answer], replicas: int | None) -> None:
    """Print all numbers of all gases, and the curves that are short."""
    say_sections(screen, sections(answers, replicas))


def say_sections(screen: Screen, shown: Sequence[Section]) -> None:
    """Print tables under their titles."""
    for section in shown:
        screen.say(section.title)
        screen.say()
        for table in section.tables:
            screen.table("", table.header, table.rows, keys=table.keys)
            screen.say()


def _regular(answers: Sequence[Answer]) -> bool:
    """Return whether all gases have the same few quantities, so that each can be a row."""
    names = {tuple(found.quantity for found in answer.numbers) for answer in answers}
    return len(answers) > 1 and len(names) == 1 and len(names.pop()) <= WIDEST


def _wide(answers: Sequence[Answer]) -> tuple[list[str], list[list[str]], int]:
    """Return header, rows and number of key columns of a table with one row for each gas."""
    columns = {"packing fraction": [f"{answer.gas.packing_fraction:.4g}" for answer in answers]}
    count, titles, cells = len(answers[0].numbers), list(columns), list(columns.values())
    for k in range(count):
        found = [answer.numbers[k] for answer in answers]
        titles.append(found[0].quantity)
        cells.append([measured_cell(each) for each in found])
        if any(math.isfinite(each.z) for each in found):
            titles.append("z")
            cells.append([deviation_cell(each.z, _U * each.better_than_theory) for each in found])
        expected = [expected_cell(each) for each in found]
        last = k + 1 == count or expected != [expected_cell(answer.numbers[k + 1]) for answer in answers]
        if last and any(cell not in ("", "0") for cell in expected):
            titles.append("theory")
            cells.append(expected)
    return titles, [list(row) for row in zip(*cells, strict=True)], 1


def _long(answers: Sequence[Answer]) -> tuple[list[str], list[list[str]], int]:
    """Return header, rows and number of key columns of a table with one row for each number."""
    rows = []
    for answer in answers:
        for k, found in enumerate(answer.numbers):
            eta = "" if k else f"{answer.gas.packing_fraction:.4g}"
            mark = _U * (found.better_than_theory and math.isfinite(found.z))
            rows.append(
                [
                    eta,
                    found.quantity,
                    measured_cell(found),
                    expected_cell(found),
                    deviation_cell(found.z),
                    mark,
                ]
            )
    header = ["packing fraction", "quantity", "measured", "theory", "z", ""]
    if not any(row[-1] for row in rows):
        header, rows = header[:-1], [row[:-1] for row in rows]
    if len(answers) == 1:
        return header[1:], [row[1:] for row in rows], 1
    return header, rows, 2


def _html_row(tag: str, cells: Sequence[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _span(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    span = f" from {known.min():.4g} to {known.max():.4g}" if known.size else ", none known"
    return f"{len(values)} values{span}"


def measured_cell(found: TheoryCheck) -> str:
    """Return what was measured as tables show it, with its error in parentheses."""
    return _cell(found.measured.value, found.measured.standard_error)


def expected_cell(found: TheoryCheck) -> str:
    """Return the value of theory as tables show it, with its uncertainty; empty without a theory."""
    return _cell(found.expected, found.uncertainty)


def deviation_cell(z: float, mark: str = "") -> str:
    """Return a deviation in standard errors as tables show it; empty where it is not known."""
    return f"{z:+.1f} {mark}".rstrip() if math.isfinite(z) else ""


def _cells(values: FloatArray, errors: FloatArray | None) -> list[str]:
    """Return the numbers of a column; those without an error bar have four decimals, if that is enough."""
    if errors is None:
        errors = np.full(len(values), math.nan)
    bare = ~(errors > 1e-12) & np.isfinite(values) & ((np.abs(values) >= 1e-3) | (values == 0.0))
    return [
        f"{value:.4f}" if alone else _cell(value, error)
        for value, error, alone in zip(values, errors, bare, strict=True)
    ]


def _cell(value: float, error: float) -> str:
    """Return a number with its error in parentheses, or alone where it has none."""
    if not math.isfinite(value):
        return ""
    if math.isfinite(error) and error > 1e-12:
        return str(Estimate(float(value), float(error)))
    return f"{value:.4f}".rstrip("0").rstrip(".") if abs(value) >= 1e-3 or value == 0.0 else f"{value:.1e}"
