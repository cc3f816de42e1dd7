"""A sweep: one study at several values of one of its options, a whole run of each, and one figure over it.

Each value has a seed of its own, made from the study's and the value, so that the errors of different values
are independent (gases from one seed would start alike), and a value keeps its numbers when others are added.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.statistics import Estimate, TheoryCheck
from hardspheres.errors import CheckpointError, HardSpheresError
from studies.answer import (
    Answer,
    Section,
    Table,
    deviation_cell,
    expected_cell,
    marks_of,
    measured_cell,
    names_of,
    number,
    say_sections,
    tidy,
)
from studies.config import parameters_of
from studies.options import Option, OptionError, in_words, options_of
from studies.page.sentences import over_many
from studies.page.write import Report, write_page
from studies.report import OutputError, OutputFolder, Screen, Summary, figure_style, jsonable
from studies.running.journal import Journal, elsewhere
from studies.running.ownership import REPORT, SUMMARY, is_ordinary, load_object
from studies.study import Study, conduct
from studies.until_error import Quiet, check_target, until_error

if TYPE_CHECKING:
    import typer
    from matplotlib.figure import Figure

__all__ = ["Point", "Swept", "conduct_sweep", "points_of", "sweep", "values_of"]

NO_QUANTITY = "a seed is no quantity, and independent runs are what --replicas are"
MOST = 1000  # values
TOLD = 8  # values that are told one by one
FEW = 4  # quantities that are all shown; of more, the main ones
_END = re.compile(r" at s = \S+$")
TABLE, FIGURE = "sweep.csv", "sweep.png"


@dataclass(frozen=True)
class Point:
    """A value of a sweep, and the study of it.

    Attributes
    ----------
    value
        Of the option; of a list with one element, that.
    text : str
        The same, as it is typed.
    study : Study
        With this value, and a seed of its own.
    """

    value: Any
    text: str
    study: Study

    def named(self, name: str) -> str:
        """Return NAME=VALUE, which is also what its folder is called, but for what no file can be."""
        return f"{name}={self.text}"


@dataclass(frozen=True, repr=False)
class Swept:
    """What a sweep gave: iterating gives each value with its answers.

    Attributes
    ----------
    study : Study
        The study, with the swept option at its default.
    name : str
        Of the option.
    points : sequence of Point
        The values.
    answers : sequence of list of Answer
        Of each value, one for each gas.
    """

    study: Study
    name: str
    points: Sequence[Point]
    answers: Sequence[Sequence[Answer]]

    def __repr__(self) -> str:
        """Return the study, the values, and what was measured."""
        span = f"{self.points[0].text} to {self.points[-1].text}"
        shown = ", ".join(self.quantities)
        return f"<Swept: {self.study.name} at {len(self.points)} values of {self.name}, {span}: {shown}>"

    def __iter__(self) -> Iterator[tuple[Any, Sequence[Answer]]]:
        """Yield each value with its answers."""
        return iter([(point.value, own) for point, own in zip(self.points, self.answers, strict=True)])

    @cached_property
    def alike(self) -> list[list[Answer]]:
        """The answers, with one name for what is measured at the end of runs of different lengths."""
        every = {found.quantity for own in self.answers for each in own for found in each.numbers}
        if len({_END.search(name)[0] for name in every if _END.search(name)}) < 2:  # type: ignore[index]
            return [list(own) for own in self.answers]
        return [
            [
                replace(
                    each,
                    numbers=[replace(f, quantity=_END.sub(" at the end", f.quantity)) for f in each.numbers],
                )
                for each in own
            ]
            for own in self.answers
        ]

    @property
    def several(self) -> bool:
        """Whether a value has several gases."""
        return any(len(own) > 1 for own in self.answers)

    @property
    def gases(self) -> list[str]:
        """What tells each gas of a value from its others."""
        most = max(map(len, self.alike))
        return [next(names_of(own)[k] for own in self.alike if k < len(own)) for k in range(most)]

    @property
    def quantities(self) -> list[str]:
        """What is shown of each gas: all numbers where they are few, else the main ones."""
        gases = sorted((each for own in self.alike for each in own), key=lambda each: -len(each.numbers))
        every = dict.fromkeys(found.quantity for each in gases for found in each.numbers)
        if len(every) <= FEW:
            return list(every)
        return list(dict.fromkeys(name for each in gases for name in _main(each)))

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of the file of all numbers: the value, then those of the study's table."""
        swept = [_in_a_cell(value) for value, answers in self for each in answers for _ in each.numbers]
        return {self.name.replace("-", "_"): swept} | tidy([each for own in self.answers for each in own])

    def table(self) -> Table:
        """Return what is shown: a row for each value and gas."""
        quantities, rows = self.quantities, []
        header = [self.name, *["gas"] * self.several]
        known = {
            name: any(math.isfinite(found.expected) for _, found in self.numbers(name)) for name in quantities
        }
        for name in quantities:
            header += [name, "theory", "z"] if known[name] else [name]
        for point, answers in zip(self.points, self.alike, strict=True):
            for each, gas in zip(answers, names_of(answers), strict=True):
                row = [point.text, *[gas] * self.several]
                own = {found.quantity: found for found in each.numbers}
                for name in quantities:
                    found = own.get(name, number(name, math.nan))
                    mark = "u" * (found.better_than_theory and math.isfinite(found.z))
                    cells = [measured_cell(found), expected_cell(found), deviation_cell(found.z, mark)]
                    row += cells if known[name] else cells[:1]
                rows.append(row)
        return Table(header, rows, keys=1 + self.several)

    def numbers(self, quantity: str) -> list[tuple[str, TheoryCheck]]:
        """Return a quantity at each value and of each gas, with what tells it from the others."""
        return [
            (f"{point.named(self.name)}, {gas}" if gas else point.named(self.name), found)
            for point, own in zip(self.points, self.alike, strict=True)
            for each, gas in zip(own, names_of(own), strict=True)
            for found in each.numbers
            if found.quantity == quantity
        ]

    def figure(self) -> Figure:
        """Return the quantities over the swept option, beside theory."""
        from studies.figures.sweep import figure

        return figure(self)

    def to_dataframe(self) -> Any:
        """Return all numbers as a pandas DataFrame; ImportError where pandas is missing."""
        from studies.answer import dataframe

        return dataframe(self.columns())


def _main(answer: Answer) -> list[str]:
    """Return the main quantities of an answer; where it says that there is none, the first."""
    if answer.main is None or isinstance(answer.main, str):
        return [found.quantity for found in answer.numbers[:1]]
    return list(answer.main)


def _in_a_cell(value: Any) -> Any:
    return value if isinstance(value, (int, float)) and not isinstance(value, bool) else in_words(value)


def option_named(kind: type[Study], name: str) -> tuple[str, Option, Any]:
    """Return field, option and default of what a name means; OptionError where it cannot be swept."""
    wanted = name.strip().lstrip("-").replace("_", "-")
    for each, its in options_of(kind):
        if wanted not in (its.named(each.name).lstrip("-"), each.name.replace("_", "-")):
            continue
        if each.name == "seed" or not its.matters:
            why = NO_QUANTITY if its.matters else "no number depends on it"
            raise OptionError(f"--sweep {name}: {why}; give another option")
        return each.name, its, each.default
    raise OptionError(f"--sweep {name}: {kind.name} has no such option; --help lists all")


def values_of(text: str) -> tuple[str, list[str]]:
    """Return the name and the values that a text as NAME=V1,V2,... means.

    Parameters
    ----------
    text : str
        Values with commas between them, with semicolons where a value has commas itself, or first:last:count
        for evenly spaced numbers.

    Raises
    ------
    OptionError
        If it is none of these.
    """
    name, _, listed = text.partition("=")
    if not name.strip() or not listed.strip():
        raise OptionError(
            f"--sweep {text} is not understood; give an option and values, as in n=500,1000,2000"
        )
    span = re.fullmatch(r"([^:;,]+):([^:;,]+):(\d+)", listed)
    if span is None:
        return name, [part.strip() for part in listed.split(";" if ";" in listed else ",")]
    try:
        count = min(int(span[3]), MOST + 1)
        with np.errstate(invalid="ignore"):
            points = np.linspace(float(span[1]), float(span[2]), count)
    except ValueError:
        raise OptionError(f"--sweep {text}: expected first:last:count, as in n=500:2000:4") from None
    return name, [f"{value:.12g}" for value in points]


def asked(study: Any, declared: Mapping[str, Any], ctx: typer.Context, text: str) -> tuple[str, list[Any]]:
    """Return the option and the values of --sweep.

    Parameters
    ----------
    study : Study
        Of which kind.
    declared, ctx
        As of `studies.config.parameters_of`.
    text : str
        What is typed, see `values_of`.

    Raises
    ------
    OptionError
        If it is no option, a value cannot be understood, or the option is also given by itself.
    """
    name, texts = values_of(text)
    field, its, _ = option_named(type(study), name)
    source = ctx.get_parameter_source(field)
    if source is not None and source.name == "COMMANDLINE":
        raise OptionError(f"{its.named(field)} and --sweep {text} both give it; leave out one of them")
    parameter = next(each for each in parameters_of(type(study), declared, ctx) if each.name == field)
    try:
        return its.named(field).lstrip("-"), [parameter.of_text(each) for each in texts]
    except OptionError as error:
        raise OptionError(f"--sweep {text}: {error}") from None


def points_of(
    study: Study, option: str, values: Sequence[Any], say: Callable[[str], object] = lambda remark: None
) -> tuple[str, Study, list[Point]]:
    """Return the studies of a sweep, all of them checked.

    Parameters
    ----------
    study : Study
        Everything but the swept option.
    option : str
        Its name, of the field or as on the command line.
    values : sequence
        At least two.
    say : callable, optional
        Takes remarks on files.

    Returns
    -------
    name : str
        Of the option on the command line, without dashes.
    base : Study
        The study with the option at its default.
    points : list of Point

    Raises
    ------
    OptionError
        If the option cannot be swept, or a value of it makes no sense.
    """
    field, its, default = option_named(type(study), option)
    name = its.named(field).lstrip("-")
    if not 2 <= len(values) <= MOST:
        count = f"{len(values)} value{'s' * (len(values) != 1)}"
        raise OptionError(f"--sweep {name} has {count}; ask for 2 to {MOST}")
    base, points, remarks = replace(study, **{field: default}), [], set()

    def once(remark: str) -> None:
        if remark not in remarks:
            remarks.add(remark)
            say(remark)

    for value in values:
        parser = its.more.get("parser")
        try:
            taken = parser(in_words(value)) if parser is not None else value
            text = in_words(taken)
            one = replace(base, **{field: taken}, seed=_seed(study.seed, name, text)).prepared(once)
            one.gases()
        except HardSpheresError as error:
            raise OptionError(f"--sweep {name}={in_words(value)}: {error}") from error
        alone = isinstance(taken, tuple) and len(taken) == 1
        points.append(Point(taken[0] if alone else taken, text, one))
    texts = [point.text for point in points]
    if twice := [text for text in texts if texts.count(text) > 1]:
        raise OptionError(f"--sweep {name} has {twice[0]} twice; give each value once")
    return name, base, points


def _seed(seed: int, name: str, text: str) -> int:
    """Return the seed of a value."""
    digest = hashlib.sha256(f"{name}={text}".encode()).digest()
    own = np.random.SeedSequence([seed, int.from_bytes(digest[:8], "little")])
    return int(own.generate_state(1)[0])


def sweep(study: Study, option: str, values: Sequence[Any], screen: Screen | None = None) -> Swept:
    """Run a study at several values of an option, and return its answers; writes no files.

    >>> from studies.pressure import EquationOfState
    >>> found = sweep(EquationOfState(packing_fractions=(0.3,)), "n", (500, 1000))  # doctest: +SKIP
    >>> for n, answers in found:  # doctest: +SKIP
    ...     print(n, answers[0]["Z from the virial"])

    Parameters
    ----------
    study : Study
        Everything but the swept option.
    option : str
        Its name.
    values : sequence
        Two or more. Each has its own seed, made from that of the study and the value.
    screen : Screen, optional
        Where progress is shown.

    Returns
    -------
    Swept
        Iterating gives each value with its answers; `figure()` draws them.

    Raises
    ------
    HardSpheresError
        If a value makes no sense, before anything is run, or as `Study.answers` does.
    """
    shown = screen or Screen()
    name, base, points = points_of(study, option, values, shown.note)
    return Swept(base, name, points, [point.study.answers(shown) for point in points])


@dataclass(frozen=True)
class _Files:
    """What a sweep writes beside its parts, as `OutputFolder` asks for it."""

    files = (TABLE, FIGURE)
    reports = True


def conduct_sweep(
    study: Study,
    option: str,
    values: Sequence[Any],
    out: OutputFolder,
    screen: Screen,
    target: float | None = None,
) -> tuple[dict[str, Any], bool]:
    """Run a study at several values of an option, print what it gave and write its files.

    Each value is a whole run in a folder NAME=VALUE of its own. A finished one of the same options is taken
    as it is, an unfinished one is resumed where `out.resume` asks for it.

    Parameters
    ----------
    study, option, values
        As of `sweep`.
    out : OutputFolder
        Where; `resume` and `force` hold for each part.
    screen : Screen
        Where results and progress are shown.
    target : float, optional
        Relative standard error of the main number at each value, see `studies.until_error`.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        Whether no check failed at any value.

    Raises
    ------
    HardSpheresError
        As `sweep` does, or if a folder cannot be written.
    """
    began = time.perf_counter()
    name, base, points = points_of(study, option, values, screen.note)
    if target is not None:
        check_target(target)
    own = _folder_of_all(out, base, name)
    parts, kept = _parts(points, name, out, target)
    if out.resume and not kept and not (out.path / SUMMARY).exists():
        raise CheckpointError(f"{out.path} holds no part of a sweep, so there is nothing to resume")
    try:
        for k, (point, part) in enumerate(zip(points, parts, strict=True), 1):
            where = f"{point.named(name)} ({k} of {len(points)})"
            if part is None:
                screen.note(f"{where}: finished before")
                continue
            screen.note(f"{where}: running")
            quiet = Quiet(screen)
            if target is None:
                conduct(point.study, part, quiet)
            else:
                until_error(point.study, target, part, quiet)
    except BaseException as error:
        if not getattr(error, "__notes__", ()) and out.path.exists():
            error.add_note(
                f"what is finished is kept in {out.path}: the same command with --resume continues"
            )
        raise
    summaries = [_summary_in(out.path / _folder(point, name)) for point in points]
    found = Swept(base, name, points, [_answers(summary) for summary in summaries])
    summary = _summary(found, summaries, target)
    return _write(found, summary, own, screen, began)


def _folder(point: Point, name: str) -> str:
    """Return the name of the folder of a part: characters that are special in paths are replaced."""
    return re.sub(r"[^\w.,=+-]+", "_", point.named(name))


def _folder_of_all(out: OutputFolder, base: Study, name: str) -> OutputFolder:
    """Return the folder of the files of all values, checked: a sweep is only ever replaced by its like."""
    before = load_object(out.path / SUMMARY) or {}
    swept = before.get("sweep")
    like = before.get("study") == base.name and isinstance(swept, dict) and swept.get("option") == name
    if Journal(out.path, out.path.absolute()).unfinished():
        raise elsewhere(f"{out.path} holds an unfinished run that is no sweep")
    if out.resume and before and not like:
        what = f"no sweep of {base.name} over {name}"
        raise CheckpointError(f"{out.path} holds a run that is {what}, so there is nothing to resume")
    if like and not (out.resume or out.force):
        raise OutputError(
            f"{out.path} holds a finished sweep; add --resume to go on with other values, --force to run all "
            "again, or give another folder with --out"
        )
    own = OutputFolder(out.path, force=out.force or out.resume, figure_format=out.figure_format)
    own.check(_Files(), resumable=False)
    return own


def _parts(
    points: Sequence[Point], name: str, out: OutputFolder, target: float | None
) -> tuple[list[OutputFolder | None], int]:
    """Return the folder of each value, checked, None where it is finished; and how many were begun before."""
    parts: list[OutputFolder | None] = []
    kept = 0
    names = [_folder(point, name) for point in points]
    for point, own in zip(points, names, strict=True):
        if names.count(own) > 1:
            raise OptionError(f"--sweep {name} has two values whose folder is {own}; give one of them")
        path = out.path / own
        begun = Journal(path, path.absolute()).unfinished() is not None
        finished = not begun and not out.force and _is_finished(point.study, path, target)
        kept += begun or finished
        if finished:
            parts.append(None)
            continue
        part = out.within(own, resume=out.resume and begun)
        part.check(point.study)
        parts.append(part)
    return parts, kept


def _is_finished(study: Study, path: Path, target: float | None) -> bool:
    """Return whether a folder holds the finished run of a study; OutputError for one of other options."""
    summary = load_object(path / SUMMARY)
    if summary is None:
        return False
    made = json.loads(json.dumps(jsonable(study.made())))
    now, before = made["options"], summary.get("options")
    what = {"study", "version"}
    if not isinstance(before, dict) or any(summary.get(each) != made[each] for each in what):
        return False
    if target is not None:
        now = now | {"replicas": before.get("replicas"), "until_error": target}
    reached = summary.get("until_error")
    if isinstance(reached, dict):
        before = before | {"until_error": reached.get("asked")}
    if before.get("replicas") != now.get("replicas"):  # the folder says what becomes of these
        return False
    flags = {each.name: its.named(each.name) for each, its in options_of(study)}
    for each in {**before, **now}:
        if before.get(each) != now.get(each):
            flag = flags.get(each, "--until-error")
            old, new = (
                "not given" if value is None else in_words(value)
                for value in (before.get(each), now.get(each))
            )
            raise OutputError(
                f"{path} holds a finished run with {flag} {old}, and now it is {new}; give another folder "
                "with --out, or --force to replace it"
            )
    return all(is_ordinary(path / str(each)) for each in summary.get("files", ()))


def _summary_in(path: Path) -> dict[str, Any]:
    found = load_object(path / SUMMARY)
    if found is None:
        raise OutputError(f"{path / SUMMARY} is gone: something else writes into {path.parent}")
    return found


@dataclass(frozen=True)
class _Gas:
    """A gas of which only the words are known."""

    words: str
    packing_fraction: float

    def __str__(self) -> str:
        return self.words


def _answers(summary: Mapping[str, Any]) -> list[Answer]:
    """Return the answers of a finished run: their numbers, and what is to be known about them."""
    return [
        Answer(
            _Gas(state["gas"], state["packing_fraction"]),
            [_number(found) for found in state["measured"]],
            notes=state["notes"],
            failures=state["failures"],
            main=state["main"],
        )
        for state in summary["states"]
    ]


def _number(found: Mapping[str, Any]) -> TheoryCheck:
    """Return a number of a summary, in which NaN and infinity are null."""
    known = {key: math.nan if value is None else value for key, value in found.items()}
    freedom = math.inf if found["degrees_of_freedom"] is None else found["degrees_of_freedom"]
    measured = Estimate(known["value"], known["standard_error"], known["n_effective"], freedom)
    return TheoryCheck(found["quantity"], found["theory"], measured, known["expected"], known["uncertainty"])


def _summary(found: Swept, summaries: Sequence[dict[str, Any]], target: float | None) -> Summary:
    """Return the content of summary.json, but for files and seconds."""
    separator = ";" if any("," in point.text for point in found.points) else ","
    text = f"{found.name}={separator.join(point.text for point in found.points)}"
    precisely = {} if target is None else {"until_error": target}
    made, checks = found.study.made(), [summary["checks"] for summary in summaries]
    words = ["--sweep", text, *(["--until-error", in_words(target)] if precisely else [])]
    states = [
        {found.name.replace("-", "_"): _in_a_cell(value)}
        | {key: state[key] for key in ("gas", "packing_fraction", "measured", "main", "notes", "failures")}
        for (value, _), summary in zip(found, summaries, strict=True)
        for state in summary["states"]
    ]
    failures = [
        f"{point.named(found.name)}: {why}"
        for point, own in zip(found.points, checks, strict=True)
        for why in own["failures"]
    ]
    return Summary(
        made
        | {"command": f"{made['command']} {shlex.join(words)}"}
        | {"options": made["options"] | precisely | {"sweep": text}, "seed": found.study.seed}
        | {
            "sweep": {
                "option": found.name,
                "values": [point.value for point in found.points],
                "seeds": [point.study.seed for point in found.points],
                "folders": [_folder(point, found.name) for point in found.points],
                "digests": [summary["digest"] for summary in summaries],
            },
            "states": states,
            "collisions": sum(summary["collisions"] for summary in summaries),
            "checks": {
                "passed": all(each["passed"] for each in checks),
                "failures": failures,
                "worst_energy_drift": max(each["worst_energy_drift"] for each in checks),
                "worst_momentum_drift": max(each["worst_momentum_drift"] for each in checks),
                "late_events": sum(each["late_events"] for each in checks),
            },
            "digest": hashlib.sha256("".join(each["digest"] for each in summaries).encode()).hexdigest(),
            "files": [],
            "seconds": {"parts": sum(each["seconds"]["total"] for each in summaries)},
        }
    )


def _write(
    found: Swept, summary: Summary, out: OutputFolder, screen: Screen, began: float
) -> tuple[dict[str, Any], bool]:
    """Write the files of all values, print what they say, and return the summary."""
    texts = [point.text for point in found.points]
    span, values = f"{texts[0]} to {texts[-1]}", ", ".join(texts)
    if len(texts) > TOLD:
        values = f"{span} ({len(texts)} values)"
    first = Study.subject(found.points[0].study, found.answers[0])
    subject = f"{found.study.name} over {found.name} = {values}; the first: {first}"
    section = Section(subject, [found.table()])
    theories = dict.fromkeys(
        each.theory for name in found.quantities for _, each in found.numbers(name) if each.theory
    )
    answers = [each for own in found.answers for each in own]
    legend = [
        *([f"theory: {', '.join(theories)}; its uncertainty in parentheses"] if theories else []),
        f"a whole run of each value, with its own seed: errors are independent; all numbers are in {TABLE}",
        *marks_of(answers),
    ]
    notes = [
        f"{point.named(found.name)}: {note}"
        for point, own in zip(found.points, found.answers, strict=True)
        for note in dict.fromkeys(note for each in own for note in each.notes)
    ]
    out.create()
    out.write_csv(TABLE, found.columns())
    with screen.working("drawing"), figure_style():
        drawn = found.figure()
        out.save_figure(FIGURE, drawn, subject)
    summary["files"] = sorted({*out.files, REPORT, SUMMARY})
    summary["seconds"]["total"] = time.perf_counter() - began
    where = f"at {len(texts)} values of {found.name}, {span}"
    write_page(
        out,
        Report(
            name=found.study.name,
            subject=subject,
            question=found.study.asked,
            answer=[over_many(name, found.numbers(name), where) for name in found.quantities],
            notes=notes,
            figures={"sweep": drawn},
            sections=[section],
            legend=legend,
            summary=summary,
            parts={
                point.named(found.name): f"{_folder(point, found.name)}/{REPORT}" for point in found.points
            },
        ),
    )
    out.write_json(SUMMARY, summary)
    say_sections(screen, [section])
    for sentence in legend:
        screen.say(sentence)
    for failure in summary["checks"]["failures"]:
        screen.say(f"CHECK FAILED, {failure}")
    screen.say(f"{summary['collisions']} collisions in {summary['seconds']['parts']:.0f} s")
    folders = summary["sweep"]["folders"]
    screen.say(
        f"written to {out.path}: {', '.join(summary['files'])}; of each value a folder, {folders[0]}/ to "
        f"{folders[-1]}/"
    )
    return summary, bool(summary["checks"]["passed"])
