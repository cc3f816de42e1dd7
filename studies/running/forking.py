"""A process that loads what workers need once, and forks them: they are ready at once.

This process starts a server, the server forks the workers: `multiprocessing` as documented. Jobs and results
pass through the server as bytes that it does not read. But for a connection, server and workers need nothing
that belongs to this process, so that they end quietly whenever it ends.

The server starts afresh, and loads what workers need once more; but of the command line, while it has no
other threads, it is a fork itself, which saves a second.

A new server replaces an old one where workers would differ from fresh processes: when the environment, the
folder or the allowed processors have changed, or a file of a loaded module was edited.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
import types
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, InvalidStateError
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.resource_tracker import ensure_running
from typing import Any

from hardspheres.errors import SimulationError
from studies.running import ours
from studies.running.garbage import collect_rarely
from studies.running.processes import (
    PATIENCE,
    masked,
    needs_main,
    pool_of_processes,
    starting,
    without_main,
)
from studies.running.stopping import STOPPING

__all__ = ["Pool", "prepare"]

BEGUN, ENDED = "begun", "ended"  # what a server says besides results
FINISH, STOP = "finish", "stop"  # what it is told besides jobs


class _Server:
    """A process that forks workers, for one pool at a time.

    Parameters
    ----------
    main : bool
        Whether it imports the program's main module; a fork has it.
    """

    def __init__(self, main: bool) -> None:
        fork = ours.alone()
        self.main, self._surroundings, self._files = main or fork, _surroundings(), _files()
        context: Any = multiprocessing.get_context("fork" if fork else "spawn")
        self.connection, its = context.Pipe()
        self.process = context.Process(target=_serve, args=(its, self.connection if fork else None))
        if not fork:
            ensure_running()  # the process that cleans up after them: when it starts, it unblocks signals
        with contextlib.nullcontext() if self.main else without_main(), masked(STOPPING), _quiet_forks():
            self.process.start()
        its.close()

    def usable(self, main: bool) -> bool:
        """Return whether it runs, and its workers are as fresh processes would be."""
        if not self.process.is_alive() or self._surroundings != _surroundings() or main > self.main:
            return False
        return self._files == _files(self._files)

    def load(self, load: bytes) -> None:
        """Let it call something, before the next pool."""
        self._files = {**_files(), **self._files}
        self.connection.send(load)

    def end(self) -> None:
        """End it at once; its workers notice."""
        self.process.kill()
        self.process.join()


_free: list[_Server] = []  # of which any thread may take one


def _all_free() -> Iterator[_Server]:
    with contextlib.suppress(IndexError):
        while True:
            yield _free.pop()


def _take(main: bool) -> _Server:
    """Return a server that can be used and is in no pool."""
    for server in _all_free():
        if server.usable(main):
            return server
        server.end()
    return _Server(main)


@atexit.register
def _end() -> None:
    for server in _all_free():
        server.end()


def _forget() -> None:
    """In a fork of this process: leave servers to this process."""
    for server in _all_free():
        server.connection.close()


os.register_at_fork(after_in_child=_forget)


def fork() -> None:
    """Let workers be forks of this process as it is now, if it is ours alone."""
    if ours.alone():
        for server in _all_free():
            server.end()
        _free.append(_Server(main=True))


def prepare(load: Callable[[], object]) -> None:
    """Begin to load what workers need, see `prepare_workers`."""
    server, told = _take(needs_main(load)), False
    try:
        with contextlib.suppress(OSError):  # it has ended; the pool will start another one
            server.load(pickle.dumps(load))
            told = True
    finally:
        if told:
            _free.append(server)
        else:
            server.end()


def _surroundings() -> tuple[Any, ...]:
    allowed = getattr(os, "sched_getaffinity", lambda _: ())
    return dict(os.environ), os.getcwd(), list(sys.path), set(allowed(0))


def _files(paths: Iterable[str] | None = None) -> dict[str, int]:
    """Return when files were last changed: by default those of all modules that are loaded here."""
    if paths is None:
        modules = [module for module in list(sys.modules.values()) if isinstance(module, types.ModuleType)]
        paths = filter(None, {vars(module).get("__file__") for module in modules})
    found = {}
    for path in paths:
        with contextlib.suppress(OSError):
            found[path] = os.stat(path).st_mtime_ns
    return found


class Pool(Executor):
    """Worker processes that a server forks when there is something to do.

    Parameters
    ----------
    workers : int
        How many.
    """

    def __init__(self, workers: int) -> None:
        self._max_workers = workers
        self._server: _Server | None = None
        self._messages: queue.SimpleQueue[Any] = queue.SimpleQueue()  # an interrupt never halves one
        self._futures: dict[int, Future[Any]] = {}
        self._begun = threading.Event()
        self._lost: BaseException | None = None
        self._threads: list[threading.Thread] = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a function called in a worker."""
        work, number, future = pickle.dumps((function, args, kwargs)), len(self._futures), Future[Any]()
        if self._server is None:
            self._server = _take(needs_main(work))
            for target in (self._read, self._write):
                thread = threading.Thread(target=target, args=(self._server.connection,), daemon=True)
                thread.start()
                self._threads.append(thread)
            self._messages.put(self._max_workers)
        self._futures[number] = future
        self._messages.put((number, work))
        if self._lost is not None:
            _lose(future, self._lost)
        return future

    def _write(self, connection: Connection) -> None:
        message = None
        with contextlib.suppress(OSError):  # of the server's end the reader tells
            while message not in (FINISH, STOP):
                message = self._messages.get()
                connection.send(message)

    def _read(self, connection: Connection) -> None:
        try:
            while (message := connection.recv()) != ENDED:
                if message == BEGUN:
                    self._begun.set()
                elif isinstance(message, SimulationError):
                    raise message
                else:
                    number, found = message
                    _tell(self._futures[number], found)
        except (EOFError, OSError, SimulationError) as error:
            unknown = BrokenExecutor("the process that forks workers has ended")
            self._lost = error if isinstance(error, SimulationError) else unknown
            for future in list(self._futures.values()):
                _lose(future, self._lost)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for the end of all work, or end the workers: they save their states, see `PATIENCE`."""
        if self._server is None:
            return
        server, self._server = self._server, None
        self._messages.put(STOP if cancel_futures else FINISH)
        ended = False
        try:
            if self._begun.is_set() or not cancel_futures:
                ended = self._ended(PATIENCE + 1.0 if cancel_futures else None)
        finally:
            if ended and self._lost is None:
                _free.append(server)
            else:
                server.end()
                self._ended(1.0)  # no worker is left then, either

    def _ended(self, timeout: float | None) -> bool:
        """Wait for what was said to be the last, and return whether it was said."""
        for thread in self._threads:
            thread.join(timeout)
        return not any(thread.is_alive() for thread in self._threads)

    def __exit__(self, kind: object, *_: object) -> None:
        """Shut it down, at once after an error."""
        self.shutdown(cancel_futures=kind is not None)


def _tell(future: Future[Any], found: bytes | BaseException) -> None:
    """Complete a future with what a worker or the server has found."""
    if not future.set_running_or_notify_cancel():
        return
    try:
        result, error, trace = pickle.loads(found) if isinstance(found, bytes) else (None, found, "")
    except Exception as broken:  # noqa: BLE001  what cannot be read fails in its own way
        result, error, trace = None, broken, ""
    if error is None:
        future.set_result(result)
    else:
        error.__cause__ = error.__cause__ or (RuntimeError(f"\n{trace}") if trace else None)
        future.set_exception(error)


def _lose(future: Future[Any], error: BaseException) -> None:
    with contextlib.suppress(InvalidStateError):  # it is complete
        future.set_exception(error)


# In the server and its workers.


def _serve(connection: Connection, of_the_program: Connection | None) -> None:
    """Load what is to be loaded and hold pools, until the program ends; a fork has both ends of the line."""
    if of_the_program is not None:
        of_the_program.close()
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    _ignore_forks()
    collect_rarely()  # the workers too, which are its forks
    while True:
        message = _next(connection)
        if isinstance(message, bytes):
            with contextlib.suppress(Exception), warnings.catch_warnings(action="ignore"):
                _load(message)
        else:
            _hold(connection, message)


def _ignore_forks() -> None:
    """Let Python not warn of forks of a process with threads: those of libraries take no harm."""
    warnings.filterwarnings("ignore", ".*fork", DeprecationWarning)


@contextlib.contextmanager
def _quiet_forks() -> Iterator[None]:
    with warnings.catch_warnings():
        _ignore_forks()
        yield


def _next(connection: Connection) -> Any:
    try:
        return connection.recv()
    except (EOFError, OSError):  # the program has ended; to tidy up would take a second
        os._exit(0)


def _load(load: bytes) -> None:
    """Call what was pickled, up to where it would compile something."""
    from numba.core import event

    class Refusal(event.Listener):
        def on_start(self, _: Any) -> None:
            raise RuntimeError(
                "not in the cache; the process that starts the study compiles it, and workers load it"
            )

        def on_end(self, _: Any) -> None:
            pass

    with event.install_listener("numba:compile", Refusal()):
        pickle.loads(load)()


class _Stopped(Exception):
    """The program wants workers to end now."""


def _hold(connection: Connection, workers: int) -> None:
    """Hold a pool of forked workers until it is to end."""
    one_at_a_time = threading.Lock()

    def say(message: object) -> None:
        with one_at_a_time, contextlib.suppress(OSError):  # the program has ended
            connection.send(message)

    def done(number: int, future: Future[bytes]) -> None:
        if not future.cancelled():
            say((number, future.exception() or future.result()))

    try:
        with pool_of_processes(workers, multiprocessing.get_context("fork")) as pool:
            while (message := _next(connection)) != FINISH:
                if message == STOP:
                    raise _Stopped
                number, work = message
                try:
                    with starting(workers):
                        pool.submit(_call, work).add_done_callback(partial(done, number))
                except BrokenExecutor as error:
                    say((number, error))
                say(BEGUN)
    except _Stopped:
        pass
    except SimulationError as error:  # no workers
        say(error)
        os._exit(0)
    say(ENDED)


def _call(work: bytes) -> bytes:
    """In a worker: call what was pickled; return result, error and its traceback, pickled."""
    try:
        function, args, kwargs = pickle.loads(work)
        return pickle.dumps((function(*args, **kwargs), None, ""))
    except Exception as error:  # noqa: BLE001  whatever the task raises
        return pickle.dumps((None, error, traceback.format_exc()))
