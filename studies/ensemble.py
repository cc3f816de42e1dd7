"""Replicas over any `concurrent.futures` executor: same results, same order, whoever computes them."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from typing import TypeVar

import numpy as np

from hardspheres.errors import SimulationError

__all__ = ["available_cores", "replica_seeds", "run_replicas", "spawned_processes"]

Item = TypeVar("Item")
Result = TypeVar("Result")


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


def available_cores() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def spawned_processes(workers: int) -> Iterator[Executor]:
    """Yield a pool of spawned worker processes, none of which outlives the context.

    Ctrl-C reaches this process alone: workers ignore it and are ended from here.

    Parameters
    ----------
    workers : int
        How many processes.
    """
    before = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_ignore_interrupts)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        pool.shutdown(
            cancel_futures=True
        )  # a worker just being started is no child yet: it shall find nothing to do
        raise
    pool.shutdown()


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_replicas(
    task: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    done: Callable[[], None] | None = None,
) -> list[Result]:
    """Apply a task to every item and return the results in the order of the items.

    What is compiled should be compiled, and cached on disk, before: call the task's kernels once in this
    process.

    Parameters
    ----------
    task : callable
        Depends on nothing but its item, so that the results are the same for any number of workers; can be
        pickled.
    items : sequence
        For example the seeds of `replica_seeds`.
    workers : int, optional
        Number of processes, all available cores by default; with one everything runs in this process.
    executor : Executor, optional
        Used instead of processes of our own; it is not shut down.
    done : callable, optional
        Called without arguments after each finished item.

    Returns
    -------
    list

    Raises
    ------
    ValueError
        If `workers` is less than one.
    SimulationError
        If a worker process was killed from outside, for example for want of memory.
    Exception
        Whatever the task raises first; the rest is cancelled.
    """
    count = available_cores() if workers is None else workers
    if count < 1:
        raise ValueError(f"workers = {count}; expected at least 1")
    if executor is not None:
        return _collect(task, items, executor, done, cancel=True)
    if min(count, len(items)) > 1:
        with spawned_processes(min(count, len(items))) as pool:
            return _collect(task, items, pool, done, cancel=False)  # the pool is ended instead
    results = []
    for item in items:
        results.append(task(item))
        if done is not None:
            done()
    return results


def _collect(
    task: Callable[[Item], Result],
    items: Sequence[Item],
    executor: Executor,
    done: Callable[[], None] | None,
    cancel: bool,
) -> list[Result]:
    futures = [executor.submit(task, item) for item in items]
    try:
        for future in as_completed(futures):
            future.result()
            if done is not None:
                done()
    except BrokenExecutor as error:
        raise SimulationError(
            "a worker process was killed, perhaps for want of memory; use fewer workers"
        ) from error
    except BaseException:
        for future in futures if cancel else ():
            future.cancel()
        raise
    return [future.result() for future in futures]
