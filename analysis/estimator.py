"""The interface that all estimators share: construct with parameters, add frames, read results, plot."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self

from hardspheres.errors import HardSpheresError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PALETTE", "Estimator", "NoDataError"]

PALETTE = ("#1f77b4", "#c8403f", "#e8b23a", "#3d2466", "#7fc8d8")
"""Colours of species and of series in all figures, distinct with any colour vision.

The least distance in CIELAB is 26 under deuteranopia, protanopia and tritanopia as simulated by Machado,
Oliveira and Fernandes 2009 (doi 10.1109/TVCG.2009.113).
"""


NUMBERS = {"int", "Estimate", "Estimate | None", "ChiSquare"}
"""Types of the results whose values `repr` shows."""


class NoDataError(HardSpheresError, RuntimeError):
    """A result was asked of an estimator that has not seen the data it needs."""


class Estimator(ABC):
    """Base of all estimators.

    Subclasses take their parameters in the constructor, accumulate in `add`, and offer results as read-only
    properties, which raise `NoDataError` until there are enough data.
    """

    @abstractmethod
    def add(self, frame: Any) -> Self:
        """Add one frame or one block of tallies and return the estimator itself, so that calls chain."""

    @abstractmethod
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the results beside their theory into `ax`, or into a new figure, and return the Axes."""

    def __repr__(self) -> str:
        """Return the class name with the values of scalar results, or else the names of available results."""
        numbers, names, missing = [], [], False
        for name in dict.fromkeys(name for kind in reversed(type(self).__mro__) for name in vars(kind)):
            result = getattr(type(self), name)
            if name.startswith("_") or not isinstance(result, property) or result.fget is None:
                continue
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # reading the result itself gives the warning
                    value = getattr(self, name)
            except (HardSpheresError, ValueError) as error:
                missing |= isinstance(error, NoDataError)
                continue
            if result.fget.__annotations__["return"] not in NUMBERS:
                names.append(name)
            elif value is not None and value != 0:
                numbers.append(f"{name} {value}")
        seen = ", ".join(numbers or names) or "nothing added yet"
        more = "; nothing more yet" if names and missing and not numbers else ""
        return f"<{type(self).__name__}: {seen}{more}>"

    def _require(self, ready: bool, what: str, call: str) -> None:
        if not ready:
            raise NoDataError(f"{type(self).__name__} has no {what} yet; call {call} first")


def axes_or_new(ax: Axes | None, **options: Any) -> Axes:
    """Return `ax`, or the Axes of a new pyplot figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    new: Axes = pyplot.subplots(layout="constrained", **options)[1]
    return new
