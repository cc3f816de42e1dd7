"""A server process that imports what workers need once, and forks them: they are ready at once.

It is Python's own fork server, one of ours beside any that a program may have. What it is to load is told to
it in a variable of its environment, as Python hands it nothing but names of modules; workers never see the
variable. It ends with the process that started it, and with the workers.

A new one replaces it where workers would differ from fresh processes: when the environment or the allowed
processors have changed, or a file of a loaded module was edited.
"""

from __future__ import annotations

import atexit
import base64
import contextlib
import importlib
import io
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import types
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from multiprocessing import reduction
from multiprocessing.context import ForkServerContext, ForkServerProcess, set_spawning_popen
from multiprocessing.forkserver import ForkServer, read_signed
from multiprocessing.popen_forkserver import Popen
from multiprocessing.process import BaseProcess
from multiprocessing.resource_tracker import ensure_running
from multiprocessing.spawn import get_preparation_data
from multiprocessing.util import Finalize
from typing import Any

from studies.running.stopping import STOPPING

__all__ = ["Context", "ours", "server", "server_ended"]

VARIABLE = "HARDSPHERES_FORK_SERVER"
LONGEST = 90_000  # characters: Linux takes 131072 in a variable
WAIT = 2.0  # seconds
OTHERS = ("PYTHONPATH", "PYTHONSAFEPATH")  # by which the server is told, too

server_ended: int | None = None
"""In a worker: a file descriptor that reads end-of-file when the server has ended."""


class _Server(ForkServer):
    """A fork server that has loaded something.

    Parameters
    ----------
    load : callable
        Called in the server, without arguments; can be pickled. An error there means that less is loaded.
    """

    _forkserver_pid: int
    _forkserver_alive_fd: int

    def __init__(self, load: Callable[[], object]) -> None:
        super().__init__()
        self.set_forkserver_preload([__name__])
        self._surroundings, self._files = _surroundings(), _files()
        ensure_running()  # the process that cleans up: starting it unblocks signals
        # of the signals to a whole group, as batch systems send them, the server heeds none; workers heed
        # SIGTERM as soon as they can
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
        try:
            with _environment(_told(load)):
                self.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def usable(self) -> bool:
        """Return whether it runs, and its workers are as fresh processes would be."""
        edited = self._files != _files(self._files)
        return self._surroundings == _surroundings() and not edited and not _has_ended(self._forkserver_pid)

    def leave(self) -> int:
        """Let it end with its last worker, and return its process id."""
        os.close(self._forkserver_alive_fd)
        return self._forkserver_pid


_current: _Server | None = None
_leaving: list[int] = []  # servers that have not ended yet
_lock = threading.Lock()


def ours() -> Callable[[], object]:
    """Return what imports the modules of this project that are loaded here, none of the program's own."""
    packages = {"hardspheres", "analysis", "studies"}
    return partial(_import, [name for name in sys.modules if name.partition(".")[0] in packages])


def _import(names: Sequence[str]) -> None:
    for name in names:
        importlib.import_module(name)


def server(load: Callable[[], object] | None = None) -> _Server:
    """Return the server; start one that loads something, if there is none that can be used.

    Parameters
    ----------
    load : callable, optional
        By default `ours`.

    Raises
    ------
    OSError
        If the system refuses.
    """
    global _current
    with _lock:
        if _current is not None and not _current.usable():
            _leaving.append(_current.leave())
            _current = None
        _leaving[:] = [pid for pid in _leaving if not _has_ended(pid)]
        if _current is None:
            _current = _Server(load or ours())
        return _current


def _forget() -> None:
    """In a fork of this process: leave the server to this process."""
    global _current
    if _current is not None:
        _current.leave()
    _current = None
    _leaving.clear()


os.register_at_fork(after_in_child=_forget)


@atexit.register
def _wait() -> None:
    """Let the server end with this process, which is then told how much processor time all took."""
    if _current is not None:
        _leaving.append(_current.leave())
    deadline = time.monotonic() + WAIT
    while not all(map(_has_ended, _leaving)) and time.monotonic() < deadline:
        time.sleep(0.002)


def _has_ended(pid: int) -> bool:
    try:
        return os.waitpid(pid, os.WNOHANG)[0] != 0
    except ChildProcessError:  # somebody else has asked before
        return True


def _surroundings() -> tuple[Any, ...]:
    allowed = getattr(os, "sched_getaffinity", lambda _: ())
    return dict(os.environ), set(allowed(0))


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


def _told(load: Callable[[], object]) -> dict[str, str]:
    """Return the variables of the environment that tell the server what to load, and from where."""
    before = {name: os.environ.get(name) for name in OTHERS}
    path = [each or os.getcwd() for each in sys.path]
    for each in (load, ours()):
        told = base64.b64encode(pickle.dumps((before, path, pickle.dumps(each)))).decode()
        if len(told) < LONGEST:
            break
    # a folder of our name where the program was started is not ours
    return {VARIABLE: told, "PYTHONPATH": os.pathsep.join(path), "PYTHONSAFEPATH": "1"}


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        _restore(before)


def _restore(variables: dict[str, str | None]) -> None:
    for name, value in variables.items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value


def _close(*descriptors: int) -> None:
    for each in descriptors:
        os.close(each)


class _Popen(Popen):
    """A process that our server forks: `_launch` is Python's, but for the server."""

    _fds: list[int]

    def _launch(self, process_obj: BaseProcess) -> None:
        data = io.BytesIO()
        set_spawning_popen(self)
        try:
            reduction.dump(get_preparation_data(process_obj.name), data)
            reduction.dump(process_obj, data)
        finally:
            set_spawning_popen(None)
        self.sentinel, written = (_current or server()).connect_to_new_process(self._fds)
        self.finalizer = Finalize(self, _close, (os.dup(written), self.sentinel))
        with open(written, "wb") as pipe:
            pipe.write(data.getbuffer())
        self.pid = read_signed(self.sentinel)


class Worker(ForkServerProcess):
    """A process that our server forks."""

    @staticmethod
    def _Popen(process_obj: BaseProcess) -> Popen:
        return _Popen(process_obj)


class Context(ForkServerContext):
    """Where a pool gets its processes from: our server."""

    Process = Worker


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


def _tell(kind: type[BaseException], error: BaseException, trace: types.TracebackType | None) -> None:
    """In a worker that cannot begin: say why, unless it was given up, of which the process that asked tells.

    What it was to read is then incomplete, or semaphores have gone, which are no files and have no name.
    """
    given_up = isinstance(error, EOFError | pickle.UnpicklingError | FileNotFoundError)
    if not given_up or getattr(error, "filename", None) is not None:
        sys.__excepthook__(kind, error, trace)


def _serve(told: str) -> None:
    """Load what workers need, in the server, before any of them is forked."""
    global server_ended
    before, sys.path[:], load = pickle.loads(base64.b64decode(told))
    _restore({VARIABLE: None, **before})
    server_ended, kept = os.pipe()
    sys.excepthook = lambda *_: None  # the process that asks for a worker tells it in a sentence

    def in_worker() -> None:
        os.close(kept)
        sys.excepthook = _tell

    os.register_at_fork(after_in_child=in_worker)
    atexit.register(os._exit, 0)  # nothing is to be tidied up, which would take a second
    with contextlib.suppress(Exception), warnings.catch_warnings(action="ignore"):
        _load(load)
    os.chdir(os.sep)  # no folder is kept in use


if VARIABLE in os.environ and multiprocessing.parent_process() is None:
    _serve(os.environ[VARIABLE])
