"""Output of every study: a folder with tables, figures of one style, and summary.json.

Files are written atomically: each under another name in the same folder, and then renamed.
"""

from __future__ import annotations

import contextlib
import csv
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hardspheres.temporary import remove_leftovers, temporary_beside
from studies.figures.style import COLOURS, figure_style, name_gas
from studies.layout import table_blocks, wrapped
from studies.running.journal import FOLDER, Journal, OutputError, Shelf, unfinished_run
from studies.running.ownership import (
    SUMMARY,
    WRITTEN,
    every_file,
    files_of_finished_run,
    is_ordinary,
    load_object,
    strange_file,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.statistics import Estimate

__all__ = [
    "ALARM",
    "COLOURS",
    "Z_MEANS",
    "OutputError",
    "OutputFolder",
    "Screen",
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
]

Z_MEANS = "z: standard errors from theory, its own uncertainty and few replicas allowed for"
"""What the column z of all tables is: `Estimate.z`."""

ALARM = 5.0
"""Deviation from theory, in standard errors, at which a study's check has failed."""
_ALARM_P = 5.7e-7  # of as large a deviation by chance, when the error is known

WORTH_SAYING = 1.0  # seconds of compilation
NARROWEST, IN_FILES = 20, 120  # characters in a line: the least of a terminal, and of tables in files

RESTARTED = {
    "stale_events",
    "list_renewals",
    "bytes_per_particle",
    "collisions_per_second",
}  # of this process alone


def jsonable(value: Any) -> Any:
    """Return a value as JSON can hold it: arrays as lists, NaN and infinities as null, paths as text."""
    if isinstance(value, Mapping):
        return {str(key): jsonable(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, (list, tuple)):
        return [jsonable(entry) for entry in value]
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


class OutputFolder:
    """The folder that a study writes into.

    Parameters
    ----------
    path : str or path-like
        Where; nothing is written before `create` or `running`. A relative path refers to the present working
        directory.
    checkpoint_every : float, default 60
        Seconds of wall time between two checkpoints of a run.
    resume : bool, default False
        Continue the unfinished run in the folder.
    force : bool, default False
        Replace the run in the folder. Its files stay until the first result of the new one is written; then
        its summary is removed, and when the new summary is written, so are all its files that have not been
        replaced.

    Attributes
    ----------
    path : Path
        The folder.
    files : list of str
        Names of the files written so far.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        checkpoint_every: float = 60.0,
        resume: bool = False,
        force: bool = False,
    ) -> None:
        self.path, self._place = Path(path), Path(path).absolute()
        self.checkpoint_every, self.resume, self.force = checkpoint_every, resume, force
        self.files: list[str] = []
        self._own: set[str] | None = None  # names of files that may be replaced
        self._open_journal: Journal | None = None

    def _journal(self, study: Any) -> Journal:
        return Journal(self.path, study, self.checkpoint_every, self.resume, self.force, self._place)

    def _claim(self, names: Iterable[str], unfinished: Iterable[str] = ()) -> set[str]:
        """Return the files that may be replaced; refuse others, and a finished run without force."""
        old = files_of_finished_run(self._place)
        if old is not None and not self.force:
            raise OutputError(
                f"{self.path} holds a finished run; give another folder with --out, or --force to replace it"
            )
        own = (old or set()) | set(unfinished)
        if strange := strange_file(self._place, {SUMMARY, *names}, own):
            raise OutputError(
                f"{self.path / strange} is not of a finished run, and would be replaced; give another folder "
                "with --out, or move it away"
            )
        return own

    def check(self, study: Any = None, *, resumable: bool = True) -> None:
        """Raise an error if the folder cannot be used; create nothing.

        Parameters
        ----------
        study : dataclass, optional
            Options of the study that is going to run, see `running`.
        resumable : bool, default True
            Whether it keeps checkpoints.

        Raises
        ------
        OutputError
            If the folder cannot be written, or another run writes into it; if it holds a finished run that is
            not to be replaced, or files of others in the place of those that the study writes.
        CheckpointError
            If it holds an unfinished run that is not to be resumed, or none where one is.
        """
        try:
            nowhere = next(
                (p for p in [self.path, *self.path.parents] if p.is_symlink() and not p.exists()), None
            )
        except OSError as error:
            raise OutputError(
                f"{self.path} cannot be a folder: {error.strerror}; give another one with --out"
            ) from error
        if nowhere is not None:
            raise OutputError(
                f"{nowhere} is a link to {os.readlink(nowhere)}, where there is nothing; give another folder "
                "with --out"
            )
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} exists and is not a folder; give another one with --out")
        parent = next(p for p in [self.path, *self.path.absolute().parents] if p.exists())
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(f"{parent} cannot be written to; give another folder with --out")
        if study is not None and resumable:
            self._journal(study).check()
        unfinished = load_object(self._place / FOLDER / "manifest.json") is not None
        if unfinished and not (resumable and (self.resume or self.force)):
            raise unfinished_run(self.path)
        if not (unfinished or self.resume):
            self._own = self._claim(_files(study))

    @contextlib.contextmanager
    def running(self, study: Any) -> Iterator[Shelf]:
        """Make and lock the folder, with its checkpoints, while the context lasts.

        Parameters
        ----------
        study : dataclass
            Options of the study.

        Yields
        ------
        Shelf
            Where `run_replicas` keeps its results.

        Raises
        ------
        OutputError, CheckpointError
            As `check` does.
        """
        self.create()
        journal = self._journal(study)
        with journal.open(lambda unfinished: self._claim(_files(study), unfinished)) as shelf:
            self._own, self._open_journal = journal.own, journal
            try:
                yield shelf
            finally:
                self._open_journal = None

    def create(self) -> None:
        """Make the folder and its parents."""
        try:
            self._place.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path} cannot be made: {error.strerror}") from error

    @contextlib.contextmanager
    def partial(self, name: str) -> Iterator[Path]:
        """Yield a temporary path that becomes the file `name` when the context ends without an error.

        Parameters
        ----------
        name : str
            File name within the folder; the temporary one has the same extension.
        """
        temporary = temporary_beside(self._place / name)
        try:
            yield temporary
            self._put(temporary, name)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"{self.path / name} cannot be written: {error.strerror or error}") from error
        finally:
            temporary.unlink(missing_ok=True)

    @property
    def checkpoints(self) -> Path:
        """The checkpoint folder, which is there while a study runs."""
        return self._place / FOLDER

    def adopt(self, path: Path) -> None:
        """Move a finished file from the checkpoint folder to its place, where it may be already."""
        if path.exists() or not (self._place / path.name).exists():
            try:
                self._put(path, path.name)
            except OutputError:
                raise
            except OSError as error:
                raise OutputError(f"{self.path / path.name} cannot be written: {error.strerror}") from error
        elif path.name not in self.files:
            self.files.append(path.name)

    def _put(self, path: Path, name: str) -> None:
        """Move a whole file to its place, replacing only our own; the summary comes last."""
        if self._own is None:
            self._own = self._claim([name])
        if name not in self._own:
            if strange := strange_file(self._place, [name], ()):
                raise OutputError(
                    f"{self.path / strange} is not of this run, and is not replaced; move it away"
                )
            if self._open_journal is not None:
                self._open_journal.may_write(name)
            self._own.add(name)
        if not self.files:
            self._remove(SUMMARY)
        if name == SUMMARY:  # the last file of a run: nothing that is stale or half-written stays behind
            remove_leftovers(self._place, path.stat().st_mtime)
            for stale in self._own - {SUMMARY, *self.files}:
                self._remove(stale)
        os.replace(path, self._place / name)
        if name not in self.files:
            self.files.append(name)

    def _remove(self, name: str) -> None:
        """Remove a file of an earlier run: one that studies write, and that is a file itself."""
        if name in (self._own or ()) and is_ordinary(self._place / name) and name in every_file():
            (self._place / name).unlink()

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON object, see `jsonable`."""
        with self.partial(name) as path:
            path.write_text(json.dumps(jsonable(content), indent=2) + "\n", encoding="utf-8")

    def write_csv(self, name: str, columns: Mapping[str, Any]) -> None:
        """Write columns of equal length under their names, numbers as the shortest text that reads back."""
        arrays = {key: np.asarray(column).tolist() for key, column in columns.items()}
        with self.partial(name) as path, path.open("w", encoding="utf-8", newline="") as handle:
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(arrays)
            writer.writerows(zip(*arrays.values(), strict=True))

    def save_figure(self, name: str, figure: Figure, gas: str) -> None:
        """Write a figure as PNG, with the name of the gas above it."""
        with self.partial(name) as path, figure_style():
            name_gas(figure, gas)
            figure.savefig(path, format="png")


def _files(study: Any) -> tuple[str, ...]:
    """Return what a study writes beside its summary."""
    module = type(study).__module__.rpartition(".")[2]
    return tuple(getattr(study, "files", WRITTEN.get(module, ())))


def _console(stderr: bool = False) -> Console:
    """Return a console that does not wrap lines."""
    return Console(stderr=stderr, highlight=False, soft_wrap=True)


def _width(console: Console) -> int | None:
    """Return the width of the terminal; None where there is none (a file or a pipe, and no $COLUMNS)."""
    looked_at = console.is_terminal or os.environ.get("COLUMNS", "").isdigit()
    return max(console.width, NARROWEST) if looked_at else None


class Screen:
    """Printed output of a study: results on standard output, progress and notes on standard error.

    Sentences are broken between words, and tables laid out so that no cell is cut, see `studies.layout`.

    Parameters
    ----------
    json_output : bool, default False
        Keep standard output free for one JSON object; then everything else goes to standard error.
    width : int, optional
        Characters in a line; by default those of the terminal. In files, sentences are not wrapped and tables
        are 120 wide.
    """

    def __init__(self, json_output: bool = False, width: int | None = None) -> None:
        self.json_output = json_output
        self.errors = _console(stderr=True)
        self.results = self.errors if json_output else _console()
        self._given = width

    def _print(self, console: Console, text: str, style: str = "") -> None:
        for line in wrapped(text, self._given or _width(console)):
            console.print(line, markup=False, style=style)

    def say(self, text: str = "") -> None:
        """Print a line of results."""
        self._print(self.results, text)

    def note(self, text: str) -> None:
        """Print a line about the progress."""
        self._print(self.errors, text, style="dim")

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
        """Show on a terminal what is being done while the context lasts; silent elsewhere."""
        if not self.errors.is_terminal:
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
        """Show a progress bar on standard error, nothing when that is not a terminal.

        Yields
        ------
        callable
            To be called after each step, without arguments.
        """
        if not self.errors.is_terminal:
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


def say_checks(screen: Screen, summary: Mapping[str, Any], out: OutputFolder) -> None:
    """Print how much was done, what failed, and where the files are."""
    checks = summary["checks"]
    screen.say(
        f"{summary['collisions']} collisions in {summary['seconds']['total']:.0f} s; worst energy drift "
        f"{checks['worst_energy_drift']:.1e}, events out of order {checks['late_events']}"
    )
    engine, study = summary["engine_collisions_per_second"], summary["collisions_per_second_and_core"]
    known = f"{_round(engine)} of the engine's event loop alone, " if math.isfinite(engine) else ""
    screen.say(
        f"collisions per second and core: {known}{_round(study)} of the study, gases and measurements "
        "included"
    )
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
