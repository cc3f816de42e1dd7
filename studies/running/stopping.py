"""Ctrl-C, SIGTERM and SIGHUP are deferred until the state can be saved."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ["STOPPING", "asked_by", "signals_held"]

STOPPING = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]  # which end a program


_own = threading.local()


@contextlib.contextmanager
def asked_by(asks: Callable[[], bool]) -> Iterator[None]:
    """Let this thread be asked to stop by more than signals, which reach none but the main thread.

    Parameters
    ----------
    asks : callable
        Returns whether to stop; `signals_held` then says that a signal is pending.
    """
    before = getattr(_own, "asks", None)
    _own.asks = asks
    try:
        yield
    finally:
        _own.asks = before


@contextlib.contextmanager
def signals_held() -> Iterator[Callable[[], bool]]:
    """Hold SIGINT, SIGTERM and SIGHUP back while the context lasts; they take effect when it ends.

    A second Ctrl-C takes effect at once. Signals that are ignored stay so, and outside the main thread, where
    Python delivers none, nothing is held.

    Yields
    ------
    callable
        Returns whether a signal is pending, or the thread is asked to stop, see `asked_by`.
    """
    waiting: list[int] = []
    asks = getattr(_own, "asks", None) or (lambda: False)
    if threading.current_thread() is not threading.main_thread():
        yield asks
        return

    def hold(number: int, frame: Any) -> None:
        previous = before[signal.Signals(number)]
        if number == signal.SIGINT and number in waiting and callable(previous):
            previous(number, frame)
        waiting.append(number)

    handlers = {number: signal.getsignal(number) for number in STOPPING}
    before = {number: own for number, own in handlers.items() if own not in (signal.SIG_IGN, None)}
    for number in before:
        signal.signal(number, hold)
    try:
        yield lambda: bool(waiting) or asks()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if waiting:
        signal.raise_signal(waiting[0])
