"""Replicas over an executor that was given: its workers may be threads, or processes on other machines.

Workers that see the folder of the run keep results and states there, as those of this machine do; what others
return is kept by the process that conducts the study. A worker knows the folder by the token in it, which is
there while that process waits for results: where it has gone, the worker ends its work and writes nothing, so
that what is left of an old run cannot get into a new one. An item whose work writes files of its own is done
by the process that conducts the study.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import hardspheres as hs
from hardspheres.errors import SimulationError
from studies.running.journal import Shelf
from studies.running.resuming import Resumable, perform
from studies.running.stopping import asked_by, signals_held

__all__ = ["gather"]

LOOK = 1.0  # seconds after which a worker looks again for the token


@dataclass(frozen=True)
class Job:
    """What a worker calls: one item of `run_replicas`.

    Attributes
    ----------
    task, item, shelf, index
        As in `perform`.
    stop : callable, optional
        Returns whether to save and to end; by default, whether the token has gone.
    version : str
        Of the package where the job was made: another one may give other bits.
    """

    task: Callable[[Any], Any]
    item: Any
    shelf: Shelf | None
    index: int
    stop: Callable[[], bool] | None = None
    version: str = hs.__version__
    __name__ = "replica"  # on the pages of Dask

    def __call__(self) -> tuple[Any, float, bool]:
        """Return the result, the seconds that it took, and whether it is on the shelf."""
        if self.version != hs.__version__:
            raise SimulationError(
                f"a worker has hardspheres {hs.__version__}, not {self.version} as this process, and its "
                "results could differ; install the same version where the workers are"
            )
        began = time.perf_counter()
        shelf = self.shelf if self.shelf is not None and self.shelf.reachable() else None
        try:
            with asked_by(self.stop or _looking(shelf)):
                result = perform(self.task, self.item, shelf, self.index)
        except KeyboardInterrupt:
            if shelf is None or shelf.reachable():
                raise
            raise SimulationError("the run that asked for this has ended") from None  # a worker goes on
        return result, time.perf_counter() - began, shelf is not None


def _looking(shelf: Shelf | None) -> Callable[[], bool]:
    """Return what looks now and then whether a shelf is still that of a run that goes on."""
    looked = time.monotonic()

    def gone() -> bool:
        nonlocal looked
        if shelf is None or time.monotonic() - looked < LOOK:
            return False
        looked = time.monotonic()
        return not shelf.reachable()

    return gone


def gather(
    executor: Executor, jobs: Sequence[tuple[Any, ...]], told: Callable[[], None]
) -> list[tuple[Any, float]]:
    """Return results and seconds of jobs, in their order; what has come in before an error is kept.

    Parameters
    ----------
    executor : Executor
        Any; it is not shut down.
    jobs : sequence of tuple
        Arguments of `perform`: task, item, shelf, index.
    told : callable
        Called after each finished job.

    Raises
    ------
    SimulationError
        If the executor is broken, workers were killed, or a scheduler was lost.
    Exception
        Whatever a task raises first; the rest is cancelled, and threads have ended.
    """
    stop = threading.Event() if isinstance(executor, ThreadPoolExecutor) else None
    shelf: Shelf | None = jobs[0][2] if jobs else None
    futures: dict[Future[tuple[Any, float, bool]], int] = {}
    found: dict[int, tuple[Any, float]] = {}

    def take(future: Future[tuple[Any, float, bool]]) -> None:
        which, (result, seconds, kept) = futures[future], future.result()
        if shelf is not None and not kept:
            with signals_held():
                shelf.store(jobs[which][3], result)
        found[which] = result, seconds

    with contextlib.ExitStack() as stack:
        seen = shelf if shelf is None or stop else stack.enter_context(shelf.shared())
        try:
            for which, (task, item, _, index) in enumerate(jobs):
                if stop or not _writes(task, item):
                    # a job without arguments: Dask would look into them for results of its own
                    job = Job(task, item, seen, index, stop.is_set if stop else None)
                    futures[executor.submit(job)] = which
            for which in sorted({*range(len(jobs))} - {*futures.values()}):
                found[which] = Job(*jobs[which])()[:2]
                told()
            # An interrupt in `as_completed` can open a lock that a worker thread holds; this queue has none.
            finished: SimpleQueue[Future[Any]] = SimpleQueue()
            for future in futures:
                future.add_done_callback(finished.put)
            for _ in range(len(futures)):
                take(finished.get())
                told()
        except BaseException as error:
            if stop:
                stop.set()
            for future in futures:
                future.cancel()
            if stop:
                wait([future for future in futures if not future.cancelled()])
            for future, which in futures.items():
                if which not in found and future.done() and not _failed(future):
                    with contextlib.suppress(OSError):
                        take(future)
            if (sentence := _lost(error)) is not None:
                raise SimulationError(sentence) from error
            raise
    return [found[which] for which in range(len(jobs))]


def _writes(task: object, item: Any) -> bool:
    return isinstance(task, Resumable) and task.writes(item)


def _failed(future: Future[Any]) -> bool:
    return future.cancelled() or future.exception() is not None


def _lost(error: BaseException) -> str | None:
    """Return in a sentence what happened to the workers; None where it is the task that failed."""
    if isinstance(error, BrokenExecutor):
        return "a worker process was killed, perhaps out of memory; use fewer workers"
    if isinstance(error, CancelledError):
        return "the workers gave the runs up: their scheduler was lost, or somebody has cancelled them"
    if isinstance(error, ImportError):
        return (
            f"the workers cannot import what they are to run ({error}); install it where they are, and where "
            "their scheduler is"
        )
    if isinstance(error, RuntimeError) and isinstance(error.__cause__, ImportError):  # of a scheduler
        return _lost(error.__cause__)
    if type(error).__module__.partition(".")[0] != "distributed":
        return None
    if type(error).__name__ == "KilledWorker":
        return "several workers died one after another at the same run, perhaps out of memory; give them more"
    return f"the Dask cluster failed: {str(error).partition(chr(10))[0] or type(error).__name__}"
