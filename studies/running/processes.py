"""Processes of a pool: how they start, heed signals, and end."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import types
from collections.abc import Collection, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from multiprocessing.process import BaseProcess

from hardspheres.errors import SimulationError
from studies.running.stopping import STOPPING, signals_held

__all__ = ["PATIENCE", "masked", "needs_main", "pool_of_processes", "starting", "without_main"]

PATIENCE = 5.0  # seconds in which a worker may save its state


@contextlib.contextmanager
def pool_of_processes(workers: int, context: BaseContext) -> Iterator[Executor]:
    """Yield a pool of children of this process."""
    before = set(multiprocessing.active_children())
    with starting(workers):
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_prepare_worker)
    try:
        yield pool
    except BaseException:
        _end(set(multiprocessing.active_children()) - before)
        # a worker that is just being started is no child yet: it must find nothing to do
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


@contextlib.contextmanager
def starting(workers: int | None) -> Iterator[None]:
    """Start processes with all signals but SIGTERM blocked; turn failures of the system into one sentence.

    A terminal sends its signals to all, also to workers that do not yet ignore them, and to the process that
    cleans up after them. Other threads of this process heed them: they take effect when all are started, as
    what is half started cannot be ended.
    """
    with signals_held(), masked(set(STOPPING) - {signal.SIGTERM}):
        try:
            yield
        except BrokenExecutor:
            raise
        except (OSError, RuntimeError, ImportError) as error:  # a thread; semaphores, where are none
            reason = getattr(error, "strerror", None) or error
            raise SimulationError(
                f"{workers or 'the'} worker processes cannot be started: {reason}; ask for fewer with "
                "--workers, or raise the limits (ulimit -n, ulimit -u)"
            ) from error


@contextlib.contextmanager
def masked(signals: Iterable[int]) -> Iterator[None]:
    """Block signals in this thread, and so in processes that it starts, which may unblock them."""
    mask = getattr(signal, "pthread_sigmask", lambda *_: ())
    before = mask(getattr(signal, "SIG_BLOCK", 0), signals)
    try:
        yield
    finally:
        mask(getattr(signal, "SIG_SETMASK", 0), before)


def needs_main(work: object) -> bool:
    """Return whether workers need what the program's main module defines; work may be pickled already."""
    return b"__main__" in (work if isinstance(work, bytes) else pickle.dumps(work))


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Start processes that do not import the program's main module, which would run a script once more."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _prepare_worker() -> None:
    for number in STOPPING:  # it is the parent that terminates
        signal.signal(number, signal.SIG_DFL if number == signal.SIGTERM else signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _end(children: Collection[BaseProcess]) -> None:
    deadline = time.monotonic() + PATIENCE
    for child in children:
        child.terminate()  # which waits for what is being saved, see `studies.running.stopping`
    for child in children:
        child.join(max(deadline - time.monotonic(), 0.0))
    for child in children:
        child.kill()
