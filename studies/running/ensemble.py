"""Replicas over any `concurrent.futures` executor, with the same results in the same order."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from contextlib import nullcontext
from functools import partial
from typing import Any, TypeVar

import numpy as np

from hardspheres.cores import available_cores
from hardspheres.errors import SimulationError
from studies.running import ours
from studies.running.elsewhere import gather
from studies.running.journal import Shelf
from studies.running.processes import needs_main, pool_of_processes, starting, without_main
from studies.running.resuming import perform

__all__ = [
    "prepare_workers",
    "preparing_workers",
    "replica_seeds",
    "run_replicas",
    "worker_processes",
]

Item = TypeVar("Item")
Result = TypeVar("Result")

NOT_IN_A_FILE = (
    "worker processes cannot import what is defined in a notebook or at a prompt, so the runs go one after "
    "another; put it into a file and import it from there, to use all cores"
)
UNGUARDED = (
    'a program that defines what its workers do must start them under `if __name__ == "__main__":`, as each '
    "of them runs the rest of it"
)


def replica_seeds(seed: int, count: int) -> list[np.random.SeedSequence]:
    """Return independent seeds, one per replica; the first k do not depend on how many there are.

    Parameters
    ----------
    seed : int
        Non-negative.
    count : int
        How many.
    """
    return np.random.SeedSequence(seed).spawn(count)


def prepare_workers(workers: int | None, load: Callable[[], object]) -> None:
    """Begin to load what worker processes will need, while this process does something else.

    Without effect where nothing can be loaded beforehand: workers then load it themselves.

    Parameters
    ----------
    workers : int or None
        As in `run_replicas`.
    load : callable
        Called without arguments in a process that workers are made from, before they are; can be pickled.
        It may call kernels: those that are in the cache are loaded, and it ends where one would be compiled.

    Raises
    ------
    SimulationError
        If the system refuses a process.
    """
    count = available_cores() if workers is None else workers
    if count < 2 or not _can_be_forked():
        return
    from studies.running.forking import prepare

    with starting(count):
        prepare(load)


@contextlib.contextmanager
def preparing_workers(workers: int | None, load: Callable[[], object]) -> Iterator[None]:
    """Have workers ready soon after the context, in which this process loads what they need.

    They are forks of this process where it is ours alone; elsewhere something else calls `load` meanwhile, as
    in `prepare_workers`, with the same arguments and errors.
    """
    count = available_cores() if workers is None else workers
    forks = count > 1 and ours.alone() and _can_be_forked()
    if not forks:
        prepare_workers(workers, load)
    yield
    if forks:
        from studies.running.forking import fork

        with starting(count):
            fork()


def _can_be_forked() -> bool:
    """Return whether workers can be forks of a process that has loaded libraries: not those of macOS."""
    return sys.platform != "darwin" and "fork" in multiprocessing.get_all_start_methods()


@contextlib.contextmanager
def worker_processes(workers: int) -> Iterator[Executor]:
    """Yield a pool of worker processes, none of which outlives the context or this process.

    They are forks of a process that has loaded what they need, see `prepare_workers`; fresh ones elsewhere.

    Ctrl-C and the end of a terminal reach this process alone: workers ignore them, and are asked by this
    process to save their state and to end. A worker that has not ended after `PATIENCE` is killed.

    Parameters
    ----------
    workers : int
        How many processes.
    """
    if _can_be_forked():
        from studies.running.forking import Pool

        with Pool(workers) as forks:
            yield forks
    else:
        with pool_of_processes(workers, multiprocessing.get_context("spawn")) as pool:
            yield pool


def run_replicas(
    task: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    numbers: Sequence[int] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    done: Callable[[], None] | None = None,
    shelf: Shelf | None = None,
    note: Callable[[str], object] = warnings.warn,
    spent: list[float] | None = None,
) -> list[Result]:
    """Apply a task to every item and return the results in the order of the items.

    Compile kernels, and cache them on disk, beforehand: call the task's kernels once in this process.

    Parameters
    ----------
    task : callable
        Depends on nothing but its item, so that the results are the same for any number of workers; can be
        pickled.
    items : sequence
        For example the seeds of `replica_seeds`.
    numbers : sequence of int, optional
        Of the items on the shelf; by default their places.
    workers : int, optional
        Number of processes, all available cores by default; with one everything runs in this process.
    executor : Executor, optional
        Used instead of processes of our own; it is not shut down.
    done : callable, optional
        Called without arguments after each finished item.
    shelf : Shelf, optional
        Where results are kept; those that are there already are not computed again, and a `Resumable` task
        continues from its saved state.
    note : callable
        Is told in a sentence why there are no workers, where the task is defined in no file.
    spent : list, optional
        Takes the seconds that each item took where it was computed.

    Returns
    -------
    list

    Raises
    ------
    ValueError
        If `workers` is less than one.
    SimulationError
        If worker processes cannot be started, or one ended too early, for example when out of memory.
    Exception
        Whatever the task raises first; the rest is cancelled.
    """
    count = available_cores() if workers is None else workers
    if count < 1:
        raise ValueError(f"workers = {count}; expected at least 1")
    told = done or (lambda: None)
    places = range(len(items)) if numbers is None else numbers
    kept = [None if shelf is None else shelf.result(number) for number in places]
    jobs = [
        (task, item, shelf, number)
        for item, number, found in zip(items, places, kept, strict=True)
        if found is None
    ]
    for _ in range(len(items) - len(jobs)):
        told()
    fresh: list[tuple[Result, float]] = []
    several = executor is None and min(count, len(jobs)) > 1
    main = several and needs_main((task, list(items)))
    if main and not os.path.isfile(getattr(sys.modules["__main__"], "__file__", None) or ""):
        note(NOT_IN_A_FILE)
        several = False
    if executor is not None:
        fresh = gather(executor, jobs, told)
    elif several:
        try:
            prepare_workers(min(count, len(jobs)), partial(_import, (task, items)))
            with worker_processes(min(count, len(jobs))) as pool:
                fresh = _collect(pool, jobs, told, hidden=not main)
        except SimulationError as error:
            if main:
                error.add_note(UNGUARDED)
            raise
    else:
        for job in jobs:
            fresh.append(_timed(*job))
            told()
    if spent is not None:
        spent += [seconds for _, seconds in fresh]
    results = (result for result, _ in fresh)
    return [next(results) if found is None else found[0] for found in kept]


def _timed(*job: Any) -> tuple[Any, float]:
    began = time.perf_counter()
    return perform(*job), time.perf_counter() - began


def _import(task: object) -> None:
    """Do nothing: where the task has arrived, what it needs is imported."""


def _collect(
    executor: Executor,
    jobs: Sequence[tuple[Any, ...]],
    told: Callable[[], None],
    hidden: bool = False,
) -> list[Any]:
    futures: list[Future[Any]] = []
    try:
        count = getattr(executor, "_max_workers", None)
        with starting(count), without_main() if hidden else nullcontext():
            for job in jobs:
                futures.append(executor.submit(_timed, *job))
        for future in as_completed(futures):
            future.result()
            told()
        return [future.result() for future in futures]
    except BrokenExecutor as error:
        raise SimulationError(
            "a worker process was killed, perhaps out of memory; use fewer workers"
        ) from error
