"""What a caller passes to a simulation: numbers and ascending moments; SimulationError for others."""

import math
from collections.abc import Callable, Iterable, Iterator
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

from hardspheres.clock import FOREVER
from hardspheres.errors import SimulationError

__all__ = ["ascending", "finite", "whole"]


def finite(name: str, value: Any) -> float:
    """Return a finite number, or raise SimulationError."""
    try:
        number = float(value) if type(value) in (int, float) or _is_real(value) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SimulationError(f"{name} needs a finite number, not {value!r}")
    return number


def _is_real(value: Any) -> bool:
    """Whether this is one real number: not masked, a truth value, text or bytes, complex, or a duration."""
    if isinstance(value, np.ma.MaskedArray) or np.ndim(value) > 0:
        return False
    kind = np.asarray(value).dtype.kind
    return kind in "iuf" or (kind == "O" and isinstance(value, (Real, Decimal)))


def whole(name: str, value: Any) -> int:
    """Return a whole number of at least 0 that can be counted to, or raise SimulationError."""
    number = finite(name, value)
    if number != int(number) or not 0 <= number < FOREVER // 2:
        raise SimulationError(f"{name} needs a whole number of at least 0 and below 2^61, not {value!r}")
    return int(value)


def ascending(
    name: str, values: Iterable[float], first: float, goal: Callable[[float], Any] = float
) -> Iterable[Any]:
    """Return the goals at the moments ``frames(name=values)``, or raise SimulationError.

    Parameters
    ----------
    name : str
        Of the argument.
    values : iterable of float
        Ascending. A sequence is checked here; what an iterator gives, when it is due.
    first : float
        None may come before this one.
    goal : callable
        Turns a number into the goal of a run.
    """
    try:
        if isinstance(values, (str, bytes, bytearray)):
            raise TypeError
        given = iter(values)
    except TypeError:
        raise SimulationError(f"frames({name}=...) needs a sequence of numbers, not {values!r}") from None
    if given is values:  # an iterator, which gives each of them once
        return map(goal, _checked(name, given, first))
    if isinstance(values, range):
        for number in _checked(name, iter([*values[:2], *values[-1:]]), first):
            goal(number)
        return map(goal, values)
    return list(map(goal, _checked(name, given, first)))


def _checked(name: str, values: Iterator[Any], first: float) -> Iterator[float]:
    """Yield numbers; raise SimulationError at one that is none, below the one before, or too early."""
    last = None
    for value in values:
        number = finite(f"frames({name}=...)", value)
        if last is None and number < first:
            raise SimulationError(
                f"frames({name}=...) begins at {number}, but the simulation is at {first} already"
            )
        if last is not None and number < last:
            raise SimulationError(f"frames({name}=...) needs values in ascending order")
        last = number
        yield number
