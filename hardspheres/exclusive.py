"""One thread at a time: whoever comes to a simulation while it runs is refused at once."""

import functools
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from hardspheres.errors import SimulationError

__all__ = ["Exclusive", "at_rest"]

Look = TypeVar("Look", bound=Callable[..., Any])
Result = TypeVar("Result")

RUNNING = (
    "this simulation is at work already, in another thread or in the call that this one comes from; wait "
    "until that has returned, or give each a copy of its own"
)


class Exclusive:
    """Base of an object that one call at a time may change, and that nobody sees while it changes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # of the call that changes it
        self._runs = 0  # how often that has begun

    def _alone(self, work: Callable[[], Result]) -> Result:
        """Do work that changes the object, unless another call is at it: then refuse at once."""
        runs = self._runs
        if not self._lock.locked():
            with self._lock:  # taken and given back in C: no interrupt comes in between
                if self._runs == runs:
                    self._runs += 1
                    return work()
        raise SimulationError(RUNNING)


def at_rest(look: Look) -> Look:
    """Refuse a look at an object that changes meanwhile: what it saw could be of two moments."""

    @functools.wraps(look)
    def guarded(self: Exclusive, *args: Any, **options: Any) -> Any:
        runs = self._runs
        if self._lock.locked():
            raise SimulationError(RUNNING)
        try:
            return look(self, *args, **options)
        finally:
            if self._runs != runs:
                raise SimulationError(RUNNING)

    return guarded  # type: ignore[return-value]
