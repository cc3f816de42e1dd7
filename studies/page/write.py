"""What is in a report, and its file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from studies.answer import Answer, Section, Table, marks_of, notes_of, sections
from studies.formats import in_format
from studies.page.citation import BIBTEX, HOW
from studies.page.sentences import answer_in_words
from studies.page.vector import inline_svg, titles
from studies.running.ownership import REPORT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.output import OutputFolder
    from studies.viewer.replay import Replay

__all__ = ["Report", "write_page", "write_report"]

VARYING = {"date", "machine", "time"}
"""What differs when the same run is repeated; marked with `data-varies` in the page."""

LONG = 32  # characters of a cell that may be broken
_ERROR_BAR = re.compile(r"\d\(\d+\)")
_NUMBER = re.compile(r"[-+]?(\d|inf|nan).*")


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a report shows, in the order of the page.

    Attributes
    ----------
    name : str
        Of the study.
    subject : str
        Which gas it is.
    question : str
        In a sentence.
    answer : sequence of str
        In a few sentences.
    notes : sequence of str
        What is to be known about the numbers.
    spent : sequence of str
        Notes about this run, which vary when it is repeated.
    figures : dict of Figure
        By the names of their files, without ending; they have the name of the gas.
    sections : sequence of Section
        Tables.
    legend : sequence of str
        What stands under the tables.
    summary : dict
        The content of summary.json: failed checks, and what made it (command, version, seed, machine, date,
        seconds, digest, files), as far as it is there.
    replay : Replay, optional
        A gas to be watched.
    parts : dict of str
        Reports of runs that it is made of, by their names.
    """

    name: str
    subject: str
    question: str
    answer: Sequence[str] = ()
    notes: Sequence[str] = ()
    spent: Sequence[str] = ()
    figures: Mapping[str, Figure] = field(default_factory=dict)
    sections: Sequence[Section] = ()
    legend: Sequence[str] = ()
    summary: Mapping[str, Any]
    replay: Replay | None = None
    parts: Mapping[str, str] = field(default_factory=dict)


def write_report(
    out: OutputFolder,
    *,
    name: str,
    question: str,
    answers: Sequence[Answer],
    subject: str,
    legend: Sequence[str] = (),
    figures: Mapping[str, Figure],
    summary: Mapping[str, Any],
    replay: Replay | None = None,
    replicas: int | None = None,
    spent: Sequence[str] = (),
) -> None:
    """Write report.html from answers: the same tables and sentences as on the screen.

    Parameters
    ----------
    out : OutputFolder
        Where.
    name, question, subject, figures, summary, replay
        As in `Report`.
    answers : sequence of Answer
        What was found.
    legend : sequence of str
        What columns mean; what z is, is added.
    replicas : int, optional
        Runs of each gas, where the word has a meaning.
    spent : sequence of str
        As in `Report`.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    write_page(
        out,
        Report(
            name=name,
            subject=subject,
            question=question,
            answer=answer_in_words(answers),
            notes=notes_of(answers),
            spent=spent,
            figures=figures,
            sections=sections(answers, replicas),
            legend=[*legend, *marks_of(answers)],
            summary=summary,
            replay=replay,
        ),
    )


def write_page(out: OutputFolder, report: Report) -> None:
    """Write report.html, see `Report`."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # not needed before

    engine = Environment(
        loader=PackageLoader("studies.page", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    engine.filters["kinds"] = _kinds
    checks = report.summary.get("checks", {})
    page = engine.get_template(REPORT).render(
        report=report,
        failures=checks.get("failures", ()),
        error_bars=any(_ERROR_BAR.search(sentence) for sentence in report.answer),
        passed=checks.get("passed", False),
        figures=list(_drawn(report, out.figure_format)),
        made=_made(report.summary),
        files=[each for each in report.summary.get("files", ()) if each != REPORT],
        how=HOW.split("`"),
        bibtex=BIBTEX,
    )
    with out.partial(REPORT) as path:
        path.write_text(page, encoding="utf-8")


@dataclass(frozen=True)
class _Drawn:
    """A figure of the page: where it also is, what it shows, and how wide it is by itself."""

    file: str
    caption: str
    svg: Any  # markup
    width: float


def _drawn(report: Report, form: str) -> Iterator[_Drawn]:
    from markupsafe import Markup

    for k, (name, figure) in enumerate(report.figures.items()):
        caption = ": ".join(filter(None, (name.replace("_", " "), titles(figure))))
        svg = inline_svg(figure, f"{caption}: {report.subject}", f"figure{k}-")
        yield _Drawn(in_format(f"{name}.png", form), caption, Markup(svg), float(figure.get_figwidth()))


def _kinds(table: Table) -> list[Any]:
    """Return the class of each column: n of numbers, t of long texts."""
    from markupsafe import Markup

    found = []
    for column in zip(*table.rows, strict=True):
        numeric = all(_NUMBER.fullmatch(cell) for cell in column if cell)
        long = max(map(len, column)) > LONG
        found.append(Markup(' class="n"' if numeric and not long else ' class="t"' if long else ""))
    return found


def _made(summary: Mapping[str, Any]) -> list[tuple[str, str, bool]]:
    """Return what made the results: term, text, and whether it varies when the same run is repeated."""
    found = {"version": f"hardspheres {summary['version']}"} if "version" in summary else {}
    found |= {name: str(summary[name]) for name in ("seed", "date") if name in summary}
    if machine := summary.get("machine"):
        parts = [machine["processor"], f"{machine['cores']} cores", machine["system"]]
        parts += [f"{name} {machine[name.lower()]}" for name in ("Python", "NumPy", "Numba")]
        found["machine"] = ", ".join(map(str, parts))
    seconds = summary.get("seconds")
    total = seconds.get("total") if isinstance(seconds, Mapping) else seconds
    if total is not None:
        found["time"] = f"{total:.3g} s"
    if "collisions" in summary:
        found["collisions"] = f"{summary['collisions']:,}".replace(",", "\u2009")
    checks = summary.get("checks", {})
    if "worst_energy_drift" in checks:
        found["worst energy drift, relative"] = f"{checks['worst_energy_drift']:.1e}"
        found["events out of order"] = str(checks["late_events"])
    if "digest" in summary:
        found["final state, SHA-256"] = summary["digest"]
    return [(term, text, term in VARYING) for term, text in found.items()]
