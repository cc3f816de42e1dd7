"""What a study is, and the one conductor that runs them all.

A study is a frozen dataclass whose fields are its options. It says which gases it is about, which estimators
watch them, how a replica advances, what the replicas of a gas say together, and what its figure shows. The
rest is done here: replicas over processes, checkpoints, tables, files.
"""

from __future__ import annotations

import hashlib
import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

import hardspheres as hs
from hardspheres.cores import available_cores
from studies.answer import Answer, Gas, curve_files, heading, marks_of, names_of, notes_of, tidy, write_tables
from studies.fluid import broken, representatives
from studies.options import OptionError, executor, runs, seed, threads, workers
from studies.page import write_report
from studies.program import Program
from studies.recording import Recorder
from studies.report import (
    ALARM,
    OutputFolder,
    Screen,
    Summary,
    checks_of,
    engine_of,
    engine_rate,
    figure_style,
    say_checks,
    seconds_taken,
)
from studies.running.ensemble import preparing_workers, run_replicas
from studies.running.executors import executor_of, number_of_workers
from studies.running.ownership import REPORT, SUMMARY
from studies.running.resuming import Resumable
from studies.running.shards import SharedShelf, run_part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.viewer.replay import Replay

__all__ = ["Replica", "Study", "conduct", "results", "show_results"]

SOON_MADE = 20_000  # particles: a larger gas takes longer to make than its kernels to load


@dataclass
class Replica:
    """One run of one gas: its state, its checkpoint and its result.

    Attributes
    ----------
    root, index : int
        Seed of the study, and which of the runs of its gas this is.
    estimators : dict
        What was measured.
    done : int
        How far it has come, in steps of the study's own.
    seconds : float
        Wall time of making, running and measuring it.
    status : dict
        `Simulation.status` at the end.
    failure : str or None
        What `Simulation.check` found broken at the end.
    notes : list of str
        What the estimators had to say on the way.
    seen : dict
        What else the study wants to know of the gas at the end: plain values.
    digest : str
        Of the state at the end, see `digest_of`.
    gas : int
        Which of the gases of the study it is.
    """

    root: int
    index: int
    running: hs.Simulation | None
    estimators: dict[str, Any]
    done: int = 0
    seconds: float = 0.0
    status: dict[str, Any] = field(default_factory=dict)
    failure: str | None = None
    notes: list[str] = field(default_factory=list)
    seen: dict[str, Any] = field(default_factory=dict)
    digest: str = ""
    gas: int = 0

    def __repr__(self) -> str:
        """Return which run it is, how far it has come, and what it measured."""
        state = "running" if self.running is not None else self.failure or f"ended after {self.seconds:.1f} s"
        measured = ", ".join(f"{name}: {type(each).__name__}" for name, each in self.estimators.items())
        return f"<Replica {self.index} of seed {self.root}, step {self.done}, {state:.100}; {measured}>"

    @property
    def simulation(self) -> hs.Simulation:
        """The gas; not kept when the run has ended."""
        if self.running is None:
            raise RuntimeError("this run has ended, and its gas was not kept")
        return self.running

    @property
    def seed(self) -> np.random.SeedSequence:
        """Its source of random choices, independent of every other run's and of how many there are."""
        key = (self.index, self.gas) if self.gas else (self.index,)
        return np.random.SeedSequence(self.root, spawn_key=key)

    def finish(self, seconds: float) -> None:
        """Check the gas a last time, and let it go."""
        self.status, self.failure = self.simulation.status(), broken(self.simulation)
        self.digest = digest_of(self.simulation)
        self.seconds, self.running = seconds, None


def digest_of(simulation: hs.Simulation) -> str:
    """Return the SHA-256 of a state: equal for equal bits of all particles, the time and the counts."""
    arrays = (simulation.positions, simulation.velocities, simulation.unwrapped_positions)
    counts = (simulation.time, simulation.collisions, simulation.wall_collisions)
    parts = [np.ascontiguousarray(each, dtype="<f8").tobytes() for each in (*arrays, counts)]
    return hashlib.sha256(b"".join(parts)).hexdigest()


@dataclass(frozen=True, kw_only=True)
class Study(Program):
    """A question about gases.

    Attributes
    ----------
    table : str
        The file of all numbers, without ending.
    """

    reports = True
    keeps = True
    to_an_error = True
    sweeps = True
    in_shards = True
    table: ClassVar[str]

    replicas: int = runs(2)
    seed: int = seed()
    workers: int | None = workers()
    threads: int = threads()
    executor: str | Executor | None = executor()

    def __post_init__(self) -> None:
        """Refuse options beyond their limits, and more threads than there are cores for them."""
        super().__post_init__()
        if self.threads > 1:
            self._require_cores()

    def _require_cores(self) -> None:
        """Raise OptionError unless this process may use a core for every thread of all runs at once."""
        if self.executor not in (None, "processes", "threads"):
            raise OptionError(
                f"--threads {self.threads} is for --executor processes or threads: workers elsewhere run "
                "a gas on one thread each; leave one of the two options out"
            )
        cores, needed = available_cores(), (self.processes or 1) * self.threads
        these = f"the {cores} cores" if cores > 1 else "the one core"
        if self.threads > cores:
            raise OptionError(
                f"--threads {self.threads} is more than {these} that this process may use; ask for at most "
                f"{cores}"
            )
        if needed > cores:
            raise OptionError(
                f"--workers {self.workers} with --threads {self.threads} needs {needed} cores, more than "
                f"{these} that this process may use; ask for fewer of one of them"
            )

    @property
    def processes(self) -> int | None:
        """How many runs go on at once; None: one on each core."""
        return 1 if self.workers is None and self.threads > 1 else self.workers

    @property
    def not_extendable(self) -> str:
        """Why a replica is not the same however many there are, as in "whose length depends on --replicas".

        Empty where it is: then more can be added to a run, and runs combined.
        """
        return ""

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run it, print its results and write its files, see `conduct`."""
        return conduct(self, out, screen)

    def answers(self, screen: Screen | None = None) -> list[Answer]:
        """Run it and return the answer of each gas; shows progress, prints no results and writes no files.

        >>> from studies.pressure import EquationOfState
        >>> study = EquationOfState(packing_fractions=(0.1, 0.2), n=500)
        >>> for answer in study.answers():  # doctest: +SKIP
        ...     print(answer["Z from the virial"])

        Parameters
        ----------
        screen : Screen, optional
            Where progress is shown: by default where people see it, a terminal or a notebook.

        Returns
        -------
        list of Answer
            `figure(answers)` draws them, `to_dataframe` of each makes tables of them. What a check found
            broken is among their `failures`.

        Raises
        ------
        HardSpheresError
            As `conduct` does, but for files.
        """
        screen = screen or Screen()
        study = self.prepared(screen.note)
        gases = study.gases()
        _compile(study, gases, screen)
        with executor_of(study.executor, study.processes, screen.note) as pool:
            replicas, _ = run_study(study, screen, executor=pool)
        found = []
        for gas, own in zip(gases, replicas, strict=True):
            answer = study.answer(gas, own)
            broken_ones = [f"replica {k}: {run.failure}" for k, run in enumerate(own) if run.failure]
            found.append(replace(answer, failures=[*broken_ones, *answer.failures]))
        return found

    def planned(self) -> dict[str, Any]:
        """Return what the manifest of an unfinished run tells: its gases in words, and how many runs."""
        gases = self.gases()
        watched = bool(self.recorders(gases[0]))
        return {
            "states": [{"gas": str(gas), "packing_fraction": gas.packing_fraction} for gas in gases],
            "replicas": self.replicas,
            "runs": len(gases) * self.replicas + watched,
        }

    @abstractmethod
    def gases(self) -> Sequence[Gas]:
        """Return the gases, easiest first; SceneError for options that make no sense."""

    def start(self, gas: Gas, seed: np.random.SeedSequence) -> hs.Simulation:
        """Return the beginning of a run of a gas."""
        return hs.Simulation(gas.scene(seed))

    @abstractmethod
    def estimators(self, gas: Gas, simulation: hs.Simulation) -> Mapping[str, Any]:
        """Return what measures it, with nothing added yet: estimators, or dataclasses of plain values."""

    @abstractmethod
    def advance(self, gas: Gas, replica: Replica) -> Iterator[None]:
        """Go on from `replica.done` to the end; yield often, wherever it may be saved."""

    @abstractmethod
    def answer(self, gas: Gas, replicas: Sequence[Replica]) -> Answer:
        """Return what all runs of a gas say together."""

    def legend(self, answers: Sequence[Answer]) -> Sequence[str]:
        """Return the sentences under the table: what its columns mean, which theory it is."""
        return ()

    def subject(self, answers: Sequence[Answer]) -> str:
        """Return what was measured, for the head of figures and of the report."""
        etas = [answer.gas.packing_fraction for answer in answers]
        several = f", packing fractions {min(etas):g} to {max(etas):g}" if len(etas) > 1 else ""
        return heading(answers, self.replicas) + several

    def figures(self, answers: Sequence[Answer]) -> Mapping[str, Figure]:
        """Return figures by the names of their files, without ending."""
        return {self.table: self.figure(answers)}

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return the one figure, where there is one."""
        raise NotImplementedError

    def recorders(self, gas: Gas) -> Mapping[str, Recorder]:
        """Return what looks at a second run of the first replica, for `show`; nothing by default.

        Looking changes no bit, so it is the same run again, and no checkpoint carries what is recorded but
        its own.
        """
        return {}

    def show(self, recorders: Mapping[str, Any], answers: Sequence[Answer], out: OutputFolder) -> None:
        """Write what the recorders saw; their own files are in `out.checkpoints`."""

    def replay(self) -> Replay | None:
        """Return a small gas of the kind that the study is about, or None.

        It is to be watched in the report, and alone as `gas.html`, which `files` then names.
        """
        return None

    def to_precision(self, target: float) -> Study | None:
        """Return the study that reaches a relative standard error by itself; None: by more replicas."""
        return None


@dataclass(frozen=True)
class _Run:
    """Which replica of which gas is to be run."""

    gas: Gas
    index: int
    which: int  # of the gases
    recording: bool = False


@dataclass(frozen=True)
class _Running(Resumable[_Run, Replica, Replica]):
    """The task of a worker process: one replica, from its start or its checkpoint to its end."""

    study: Study
    folder: Path
    tell: Callable[[str], object] | None = None  # why a gas runs on fewer threads, where that can be told

    def begin(self, item: _Run) -> Replica:
        """Make the gas and what measures it."""
        replica = Replica(self.study.seed, item.index, None, {}, gas=item.which)
        replica.running = simulation = self.study.start(item.gas, replica.seed)
        watching = self.study.recorders(item.gas) if item.recording else None
        replica.estimators = dict(watching or self.study.estimators(item.gas, simulation))
        return replica

    def steps(self, item: _Run, state: Replica) -> Iterator[None]:
        """Go on with it, on as many threads as it may have."""
        state.running = on_threads(state.simulation, self.study.threads)
        if self.tell and (why := why_fewer([state.running.status()])):
            self.tell(*why)
        with ExitStack() as open_files:
            for each in state.estimators.values():
                if isinstance(each, Recorder):
                    open_files.enter_context(each.recording(self.folder))
            yield from self.study.advance(item.gas, state)

    def writes(self, item: _Run) -> bool:
        """Return whether it is recorded."""
        return item.recording

    def result(self, item: _Run, state: Replica, seconds: float) -> Replica:
        """Return the replica, without its gas."""
        state.finish(seconds)
        if state.status["threads"] < self.study.threads:
            state.status["fewer_threads"] = state.status["fewer_threads"] or (
                f"threads={self.study.threads}: a gas that the study makes on the way runs on one thread"
            )
        return state


def on_threads(simulation: hs.Simulation, threads: int) -> hs.Simulation:
    """Return a simulation on so many threads, or as many of them as it can have; no bit depends on it."""
    return simulation if threads == 1 else simulation.on_threads(threads, warn=False)


def why_fewer(statuses: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return why gases run on fewer threads than they should, each reason once, given their statuses."""
    return [*dict.fromkeys(why for status in statuses if (why := status.get("fewer_threads")))]


def run_study(
    study: Study,
    screen: Screen,
    shelf: Any = None,
    folder: Path = Path(),
    record: bool = False,
    spent: list[float] | None = None,
    executor: Executor | None = None,
) -> tuple[list[list[Replica]], Replica | None]:
    """Run all replicas of all gases of a study.

    Parameters
    ----------
    study : Study
        What to run.
    screen : Screen
        Where progress is shown.
    shelf : Shelf, optional
        Where replicas are kept, see `run_replicas`.
    folder : Path, optional
        Where recorders write.
    record : bool, default False
        Whether the first replica is run once more, watched by the study's recorders.
    spent : list, optional
        Takes the seconds of each run, as in `run_replicas`.
    executor : Executor, optional
        What runs them, as in `run_replicas`.

    Returns
    -------
    replicas : list of list of Replica
        Of each gas.
    recorded : Replica or None
        The second run of the first one.

    A shard gets neither: what it runs stays on its shelf.
    """
    gases, count = study.gases(), study.replicas
    runs = [_Run(gas, r, k) for k, gas in enumerate(gases) for r in range(count)]
    numbers = [run.index * len(gases) + run.which for run in runs]  # of a replica always the same
    if record and study.recorders(gases[0]):
        runs.append(_Run(gases[0], 0, 0, recording=True))
        numbers.append(len(numbers))
    here = study.processes == 1 and executor is None
    task = _Running(replace(study, executor=None), folder, screen.note_once if here else None)
    # what takes longest is last here and runs first, so that all workers finish together: dense gases, and
    # the run that is watched
    if isinstance(shelf, SharedShelf):
        numbered = list(zip(numbers[::-1], runs[::-1], strict=True))
        run_part(task, numbered, shelf, screen, workers=study.processes)
        return [], None
    if shelf is not None and study.threads == 1 and (study.workers or available_cores()) > 1:
        _begin_to_draw()  # on a core that is idle
    with screen.progress("runs", len(runs)) as advance:
        found = run_replicas(
            task,
            runs[::-1],
            numbers=numbers[::-1],
            workers=study.processes,
            executor=executor,
            done=advance,
            shelf=shelf,
            note=screen.note,
            spent=spent,
        )[::-1]
    for run, its in zip(runs, found, strict=True):
        if (its.root, its.index, its.gas) != (study.seed, run.index, run.which):
            raise hs.CheckpointError(
                f"a file holds replica {its.index} of gas {its.gas} and seed {its.root} in the place of "
                f"replica {run.index} of gas {run.which} and seed {study.seed}; start again with --force"
            )
    recorded = found.pop() if runs[-1].recording else None
    for why in why_fewer([its.status for its in found]) if study.threads > 1 else ():
        screen.note_once(why)
    return [found[k * count : (k + 1) * count] for k in range(len(gases))], recorded


def _begin_to_draw() -> None:
    """Import what draws figures, while this process only waits for its workers; tell of no failure yet."""

    def work() -> None:
        with suppress(Exception):
            import_module("matplotlib.backends.backend_agg")

    with suppress(RuntimeError):  # no more threads
        threading.Thread(target=work).start()  # to its end: a compiled module cannot be left half made


def _compile(study: Study, gases: Sequence[Gas], screen: Screen) -> None:
    """Compile all that the gases of a study need, while what its workers are made from is loaded."""
    few = representatives(gases, study.threads)
    own = study.executor in (None, "processes")
    soon = partial(_load, study, [gas for gas in few if gas.n <= SOON_MADE])
    with (
        preparing_workers(study.processes, soon) if own else nullcontext(),
        screen.compiling("; ".join(dict.fromkeys(gas.kind for gas in gases))),
    ):
        _load(study, few)


def _load(study: Study, gases: Sequence[Gas]) -> None:
    """Load or compile the kernels of some gases."""
    for gas in gases:
        simulation = study.start(gas, np.random.SeedSequence(0, spawn_key=(0,)))
        on_threads(simulation, study.threads).run(collisions=1)


def conduct(
    study: Study,
    out: OutputFolder,
    screen: Screen,
    *,
    record: bool = True,
    conclude: Callable[[dict[str, Any]], str] | None = None,
) -> tuple[dict[str, Any], bool]:
    """Run a study, print its results and write its files.

    Parameters
    ----------
    study : Study
        What to do.
    out : OutputFolder
        Where the files go; made only after everything has been checked.
    screen : Screen
        Where results and progress are shown.
    record : bool, default True
        Whether to write what is recorded of the first replica, such as a trajectory.
    conclude : callable, optional
        Takes the summary before it is written, may add to it, and returns what it means, in a sentence.

    Returns
    -------
    summary : dict
        The content of summary.json; nothing for a shard, which only runs its part.
    sound : bool
        Whether no check failed: invariants in every replica, and what the study itself demands.

    Raises
    ------
    HardSpheresError
        If options make no sense, a gas cannot be made or never collides, or the folder cannot be written.
    """
    began = time.perf_counter()
    study = study.prepared(screen.note)
    gases = study.gases()
    out.check(study)
    _compile(study, gases, screen)
    ready = time.perf_counter()
    if out.shard is not None:
        with out.shared(study) as shelf:
            run_study(study, screen, shelf, shelf.folder, record)
        return {}, True
    with executor_of(study.executor, study.processes, screen.note) as pool, out.running(study) as shelf:
        if out.there:
            screen.note(f"{out.there} of {study.replicas} replicas were there")
        spent: list[float] = []
        replicas, recorded = run_study(study, screen, shelf, shelf.folder, record, spent, pool)
        found = results(
            study,
            replicas,
            out,
            screen,
            (began, ready, time.perf_counter()),
            workers=number_of_workers(pool, study.processes),
            spent=sum(spent),
            recorded=recorded,
            replay=study.replay,
            conclude=conclude,
        )
        not_kept = out.keep_replicas(study, len(gases), shelf)
    show_results(study, found, out, screen, earlier=out.resume or out.there > 0)
    if not_kept:
        screen.note(not_kept)
    return found.summary, bool(found.summary["checks"]["passed"])


@dataclass(frozen=True)
class Results:
    """What replicas of all gases say, as it was written.

    Attributes
    ----------
    answers : list of Answer
        Of each gas.
    summary : dict
        The content of summary.json.
    verdict : list of str
        What it means, where `conclude` has said it.
    """

    answers: list[Answer]
    summary: dict[str, Any]
    verdict: list[str]


def results(
    study: Study,
    replicas: Sequence[Sequence[Replica]],
    out: OutputFolder,
    screen: Screen,
    times: tuple[float, float, float],
    *,
    workers: int | None = None,
    spent: float = 0.0,
    recorded: Replica | None = None,
    replay: Callable[[], Replay | None] = lambda: None,
    conclude: Callable[[dict[str, Any]], str] | None = None,
) -> Results:
    """Write the files of a study, given its replicas of each gas.

    Parameters
    ----------
    study, out, screen, conclude
        As in `conduct`.
    replicas : sequence of sequences of Replica
        Of each gas.
    times : (float, float, float)
        When the study began, when all was compiled, when the replicas were there: as in `seconds_taken`.
    workers : int, optional
        How many there were, where that is known.
    spent : float
        Seconds that they worked.
    recorded : Replica, optional
        The first run, watched by the study's recorders.
    replay : callable
        Returns a gas to be watched, or None.
    """
    gases = study.gases()
    answers = [study.answer(gas, own) for gas, own in zip(gases, replicas, strict=True)]
    out.write_csv(f"{study.table}.csv", tidy(answers))
    for name, columns in curve_files(answers).items():
        out.write_csv(f"{name}.csv", columns)
    with screen.working("drawing"), figure_style():
        figures = study.figures(answers)
        for name, figure in figures.items():
            out.save_figure(f"{name}.png", figure, study.subject(answers))
        if recorded is not None:
            study.show(recorded.estimators, answers, out)
    if (watched := replay()) is not None:
        with screen.working("running a gas to be watched"), out.partial("gas.html") as path:
            path.write_text(watched.html, encoding="utf-8")
    summary = Summary(summary_of(study, answers, replicas, out) | {"workers": workers})
    summary["seconds"] = seconds_taken(*times)
    if spent and workers:  # not all of it was there before
        summary["seconds"]["workers_busy"] = spent / (workers * (times[2] - times[1]))
    verdict = [conclude(summary)] if conclude is not None else []
    with screen.working("writing the report"):
        write_report(
            out,
            name=study.name,
            question=study.asked,
            answers=answers,
            subject=study.subject(answers),
            legend=study.legend(answers),
            figures=figures,
            summary=summary,
            replay=watched,
            replicas=study.replicas,
            spent=verdict,
        )
    out.write_json(SUMMARY, summary)
    return Results(answers, summary, verdict)


def summary_of(
    study: Study, answers: Sequence[Answer], replicas: Sequence[Sequence[Replica]], out: OutputFolder
) -> dict[str, Any]:
    """Return the content of summary.json, but for the seconds."""
    failures = []
    for answer, where, own in zip(answers, names_of(answers), replicas, strict=True):
        broken_ones = [f"replica {k}: {run.failure}" for k, run in enumerate(own) if run.failure]
        failures += [f"{where}: {why}" if where else why for why in (*broken_ones, *answer.failures)]
    runs = [run for own in replicas for run in own]
    statuses = [run.status for run in runs]
    collisions = sum(status["collisions"] for status in statuses)
    threads = [status.get("threads", 1) for status in statuses]
    core_seconds = sum(run.seconds * its for run, its in zip(runs, threads, strict=True))
    return {
        **study.made(),
        "seed": study.seed,
        "workers": study.processes,
        "threads": sorted({*threads}),
        "fewer_threads": why_fewer(statuses),
        "n": answers[0].gas.n,
        "dim": answers[0].gas.dim,
        "states": [answer.summary() for answer in answers],
        "collisions": collisions,
        "collisions_per_second": collisions / sum(run.seconds for run in runs),
        "collisions_per_second_and_core": collisions / core_seconds,
        "engine_collisions_per_second": engine_rate(statuses),
        "checks": checks_of(statuses, failures) | {"alarm_in_standard_errors": ALARM},
        "engine": engine_of(statuses[0]),
        "digest": hashlib.sha256("".join(run.digest for run in runs).encode()).hexdigest(),
        "files": sorted({*out.files, REPORT, SUMMARY}),
        "seconds": {},
    }


def show_results(
    study: Study, found: Results, out: OutputFolder, screen: Screen, earlier: bool = False
) -> None:
    """Print what was found; `earlier` tells that replicas of an earlier run are among it."""
    write_tables(screen, found.answers, study.replicas)
    for sentence in (*study.legend(found.answers), *marks_of(found.answers), *notes_of(found.answers)):
        screen.say(sentence)
    say_checks(screen, found.summary, out, earlier)
    for sentence in found.verdict:
        screen.say(sentence)
