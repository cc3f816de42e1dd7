"""One row of the table of hard cases: the exact answer, the engine's, and the number of correct digits."""

from __future__ import annotations

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, Literal, ParamSpec, TypeVar

import numpy as np

from studies.running.journal import Shelf
from studies.running.resuming import perform

__all__ = ["EPS", "SIZES", "Case", "Size", "counted", "keeping", "kept", "pick"]

P = ParamSpec("P")

Size = Literal["small", "full", "long"]
T = TypeVar("T")
EPS = float(np.finfo(np.float64).eps)
SIZES: tuple[Size, ...] = ("small", "full", "long")

MOST_DIGITS = 16.0  # that a float64 has


@dataclass(frozen=True)
class Case:
    """A hard case and its result.

    Attributes
    ----------
    name : str
        What was tried.
    exact : str
        The exact answer, and its source.
    engine : str
        The engine's answer.
    error : float
        Deviation from the exact answer, relative to its natural scale; 0: every digit is correct. NaN fails.
    allowed : float
        The largest error that passes.
    """

    name: str
    exact: str
    engine: str
    error: float
    allowed: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether the error is within what is allowed."""
        return self.error <= self.allowed

    @property
    def digits(self) -> float:
        """Correct decimal digits: minus the logarithm of the error, from 0 to 16."""
        if self.error == 0.0:
            return MOST_DIGITS
        return min(max(-math.log10(self.error), 0.0), MOST_DIGITS) if self.error > 0.0 else 0.0

    @property
    def digits_text(self) -> str:
        """The digits as the table shows them."""
        return "all" if self.error == 0.0 else f"{self.digits:.1f}"


def counted(name: str, exact: int, measured: int, what: str) -> Case:
    """Return the case of a count that must be exact.

    Parameters
    ----------
    name : str
        What was tried.
    exact, measured : int
        The number, and what the engine counted.
    what : str
        What is counted.
    """
    off = abs(measured - exact) / max(abs(exact), 1)
    return Case(name, f"{exact} {what}", str(measured), float(off))


def pick(size: Size, choices: Sequence[T]) -> T:
    """Return the choice for a size, small, full or long."""
    return choices[SIZES.index(size)]


_numbered: ContextVar[tuple[Shelf, Iterator[int]] | None] = ContextVar("_numbered", default=None)


@contextlib.contextmanager
def _set(value: tuple[Shelf, Iterator[int]] | None) -> Iterator[None]:
    before = _numbered.set(value)
    try:
        yield
    finally:
        _numbered.reset(before)


def keeping(shelf: Shelf) -> contextlib.AbstractContextManager[None]:
    """Return a context in which results of `kept` functions are saved, by the number of the call."""
    return _set((shelf, itertools.count()))


def kept(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function that reuses the result of the same call in an interrupted run.

    Cases run in the same order every time, so a call is identified by its number; nested calls are not
    counted. Outside of `keeping` the function is unchanged.

    Parameters
    ----------
    function : callable
        Depends on nothing but its arguments, takes seconds or more, and gives a case, several, or numbers.
    """

    @functools.wraps(function)
    def recalled(*args: P.args, **options: P.kwargs) -> T:
        if (numbered := _numbered.get()) is None:
            return function(*args, **options)
        shelf, numbers = numbered
        index = next(numbers)
        if (found := shelf.result(index)) is not None:
            return found[0]  # type: ignore[no-any-return]

        def compute(_: Any) -> T:
            with _set(None):
                given = function(*args, **options)
                return list(given) if isinstance(given, Iterator) else given  # type: ignore[return-value]

        return perform(compute, None, shelf, index)

    return recalled
