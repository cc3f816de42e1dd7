"""What every study shows on the screen, and the parts that all summaries have."""

from __future__ import annotations

import contextlib
import datetime
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from studies import notebook
from studies.figures.style import COLOURS, figure_style
from studies.layout import table_blocks, wrapped
from studies.output import OutputError, OutputFolder, jsonable

if TYPE_CHECKING:
    from analysis.statistics import Estimate

__all__ = [
    "ALARM",
    "COLOURS",
    "Z_MEANS",
    "OutputError",
    "OutputFolder",
    "Screen",
    "Summary",
    "alarming",
    "checks_of",
    "engine_of",
    "engine_rate",
    "estimate_json",
    "figure_style",
    "jsonable",
    "machine",
    "say_checks",
    "seconds_taken",
    "today",
]

Z_MEANS = "z: standard errors from theory, its own uncertainty and few replicas allowed for"
"""What the column z of all tables is: `Estimate.z`."""

ALARM = 5.0
"""Deviation from theory, in standard errors, at which a study's check has failed."""
_ALARM_P = 5.7e-7  # of as large a deviation by chance, when the error is known

WORTH_SAYING = 1.0  # seconds of compilation
NARROWEST, IN_FILES = 20, 120  # characters in a line: the least of a terminal, and of tables in files
IN_NOTEBOOKS = 100  # which break longer lines within words

RESTARTED = {
    "stale_events",
    "list_renewals",
    "bytes_per_particle",
    "collisions_per_second",
    "threads",
    "fewer_threads",
    "thread_windows",
    "thread_windows_undone",
    "thread_events_put_off",
}  # of this process alone


def _console(stderr: bool = False) -> Console:
    """Return a console that does not wrap lines; in a notebook one that prints plain text, as `print` does.

    Left to itself rich makes an output of its own of every line there, or takes it for a terminal.
    """
    terminal = False if notebook.in_notebook() else None
    return Console(
        stderr=stderr, highlight=False, soft_wrap=True, force_jupyter=False, force_terminal=terminal
    )


def _width(console: Console) -> int | None:
    """Return the width of the terminal; None where there is none (a file or a pipe, and no $COLUMNS)."""
    if notebook.in_notebook():
        return IN_NOTEBOOKS
    looked_at = console.is_terminal or os.environ.get("COLUMNS", "").isdigit()
    return max(console.width, NARROWEST) if looked_at else None


class Screen:
    """Printed output of a study: results on standard output, progress and notes on standard error.

    Sentences are broken between words, and tables laid out so that no cell is cut, see `studies.layout`. In a
    notebook notes are printed like results (standard error looks like a failure there), and progress is an
    output that is replaced in place and emptied at the end.

    Parameters
    ----------
    json_output : bool, default False
        Keep standard output free for one JSON object; then everything else goes to standard error.
    width : int, optional
        Characters in a line; by default those of the terminal, 100 in a notebook. In files, sentences are
        not wrapped and tables are 120 wide.

    Attributes
    ----------
    told : set of str
        What `note_once` has printed.
    """

    def __init__(self, json_output: bool = False, width: int | None = None) -> None:
        self.json_output = json_output
        self.notebook = notebook.in_notebook()
        self.errors = _console(stderr=json_output or not self.notebook)
        self.results = self.errors if json_output else _console()
        self._given = width
        self.told: set[str] = set()

    @property
    def _animated(self) -> bool:
        """Whether progress can be drawn over what was drawn before."""
        return self.errors.is_terminal and not notebook.from_notebook()

    def _print(self, console: Console, text: str, style: str = "") -> None:
        for line in wrapped(text, self._given or _width(console)):
            console.print(line, markup=False, style=style)

    def say(self, text: str = "") -> None:
        """Print a line of results."""
        self._print(self.results, text)

    def note(self, text: str) -> None:
        """Print a line about the progress."""
        self._print(self.errors, text, style="dim")

    def note_once(self, text: str) -> None:
        """Print a line about the progress that several runs may have to say."""
        if text not in self.told:
            self.told.add(text)
            self.note(text)

    def table(
        self,
        title: str,
        columns: Sequence[str],
        rows: Sequence[Sequence[str]],
        *,
        keys: int = 1,
        wrap: bool = False,
    ) -> None:
        """Print a table; where it is too wide, in several blocks.

        Parameters
        ----------
        title : str
            A line above it, or "".
        columns, rows : sequences
            Titles and cells.
        keys : int, default 1
            How many of the first columns name a row: they are repeated in every block.
        wrap : bool, default False
            Break cells between words instead.
        """
        if title:
            self.say(title)
        width = self._given or _width(self.results) or IN_FILES
        for index, (header, body) in enumerate(table_blocks(columns, rows, width, keys, wrap)):
            if index:
                self.results.print()
            for line in header:
                self.results.print(line, markup=False, style="bold")
            for line in body:
                self.results.print(line, markup=False)

    @contextlib.contextmanager
    def working(self, text: str) -> Iterator[None]:
        """Show what is being done while the context lasts, where it can be taken away again."""
        if self.notebook:
            with notebook.message(f"{text} ..."):
                yield
            return
        if not self._animated:
            yield
            return
        with self.errors.status("\n".join(wrapped(text, max(self.errors.width - 3, NARROWEST)))):
            yield

    @contextlib.contextmanager
    def compiling(self, what: str) -> Iterator[None]:
        """Report compilation: what for, while the context lasts, and afterwards how long it took, if it did.

        Parameters
        ----------
        what : str
            The gases, in words.
        """
        from numba.core import event

        seconds: list[float] = []
        text = f"compiling the engine for {what}: about 10 s, once for each kind of gas on this machine"
        with self.working(text), event.install_timer("numba:compile", seconds.append):
            yield
        if sum(seconds) > WORTH_SAYING:
            self.note(
                f"compiled the engine for {what} in {sum(seconds):.0f} s; it is kept, so that the next gas "
                "of this kind starts at once (a kind: dimension, boundaries, one species or more, dilute or "
                "dense)"
            )

    @contextlib.contextmanager
    def progress(self, text: str, total: int) -> Iterator[Callable[[], None]]:
        """Show a progress bar on standard error or in a notebook, nothing when neither can be drawn on.

        Yields
        ------
        callable
            To be called after each step, without arguments.
        """
        if self.notebook:
            with notebook.bar(text, total) as advance:
                yield advance
            return
        if not self._animated:
            yield lambda: None
            return
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=self.errors, transient=True) as progress:
            task = progress.add_task(text, total=total)
            yield lambda: progress.advance(task)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Print the summary as the one JSON object on standard output, if that was asked for."""
        if self.json_output:
            sys.stdout.write(json.dumps(jsonable(summary), indent=2) + "\n")
            sys.stdout.flush()


class Summary(dict[str, Any]):
    """The content of summary.json: a dict that a prompt or a notebook shows in a line."""

    def __repr__(self) -> str:
        """Return what was done, whether it was sound, and where to look."""
        states, sound = len(self["states"]), self["checks"]["passed"]
        return (
            f"<Summary of {self['study']}, seed {self['seed']}: {states} gas{'es' * (states > 1)}, "
            f"{self['collisions']} collisions, checks {'passed' if sound else 'FAILED'}; a dict of "
            f"{', '.join(self)}>"
        )


def estimate_json(estimate: Estimate) -> dict[str, float]:
    """Return the entry of an estimate in a summary."""
    return {
        "value": estimate.value,
        "standard_error": estimate.standard_error,
        "n_effective": estimate.n_effective,
        "degrees_of_freedom": estimate.degrees_of_freedom,
    }


def alarming(measured: Estimate, expected: float, uncertainty: float) -> bool:
    """Return whether a measurement is beyond 5 standard errors from what was expected.

    An error that is itself estimated from few values allows more than 5: the probability is that of 5 known
    standard errors, 6e-7, by Student's t. A theory that is not known (NaN) raises no alarm.
    """
    return measured.p_value(expected, uncertainty) < _ALARM_P


def checks_of(statuses: Sequence[Mapping[str, Any]], failures: Sequence[str]) -> dict[str, Any]:
    """Return the "checks" of a summary.

    Parameters
    ----------
    statuses : sequence of dict
        `Simulation.status` of every run at its end.
    failures : sequence of str
        One sentence for each failure.
    """
    return {
        "passed": not failures,
        "failures": list(failures),
        "worst_energy_drift": max(abs(status["energy_drift"]) for status in statuses),
        "worst_momentum_drift": max(abs(status["momentum_drift"]) for status in statuses),
        "late_events": sum(status["late_events"] for status in statuses),
    }


def engine_rate(statuses: Sequence[Mapping[str, Any]]) -> float:
    """Return the collisions per second of the event loop, over all timed runs with these final statuses."""
    timed = [status for status in statuses if status["collisions_per_second"] > 0.0]
    seconds = sum(status["collisions"] / status["collisions_per_second"] for status in timed)
    return sum(status["collisions"] for status in timed) / seconds if timed else math.nan


def engine_of(status: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry of the engine in a summary, independent of interruptions of the run."""
    return {name: value for name, value in status.items() if name not in RESTARTED}


def _round(rate: float) -> str:
    """Return a rate to two digits."""
    return f"{float(f'{rate:.2g}'):,.0f}".replace(",", " ")


def say_checks(screen: Screen, summary: Mapping[str, Any], out: OutputFolder, earlier: bool = False) -> None:
    """Print how much was done, partly in `earlier` runs, what failed, and where the files are."""
    checks = summary["checks"]
    done = ", those of earlier runs included; this one took" if earlier else " in"
    screen.say(
        f"{summary['collisions']} collisions{done} {summary['seconds']['total']:.0f} s; worst energy drift "
        f"{checks['worst_energy_drift']:.1e}, events out of order {checks['late_events']}"
    )
    engine, study = summary["engine_collisions_per_second"], summary["collisions_per_second"]
    known = f"{_round(engine)} of the engine's event loop alone, " if math.isfinite(engine) else ""
    least, most = min(summary["threads"]), max(summary["threads"])
    where = f"of a gas on {least} to {most} threads" if least < most else f"of a gas on {most} threads"
    screen.say(
        f"collisions per second {where if most > 1 else 'and core'}: {known}{_round(study)} of the study, "
        "gases and measurements included"
    )
    if (summary["workers"] or 0) > 1 and "workers_busy" in summary["seconds"]:
        busy = summary["seconds"]["workers_busy"]
        screen.say(f"{summary['workers']} workers, busy {100 * busy:.0f} % of the time")
    for failure in checks["failures"]:
        screen.say(f"CHECK FAILED, {failure}")
    screen.say(f"written to {out.path}: {', '.join(summary['files'])}")


def seconds_taken(began: float, ready: float, ran: float, work: str = "runs") -> dict[str, float]:
    """Return how long the parts of a study took, up to now, for its summary.

    Parameters
    ----------
    began, ready, ran : float
        `time.perf_counter()` at the start, when all was compiled, and when the work was done.
    work : str
        What the work is called.
    """
    now = time.perf_counter()
    return {
        "setup_and_compilation": ready - began,
        work: ran - ready,
        "analysis_and_figures": now - ran,
        "total": now - began,
    }


def today() -> str:
    """Return the date, as YYYY-MM-DD of UTC."""
    return datetime.datetime.now(datetime.UTC).date().isoformat()


def machine() -> dict[str, Any]:
    """Return a description of the machine."""
    import numba

    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }
