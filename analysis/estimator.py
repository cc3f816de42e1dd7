"""The one shape of all estimators: construct with parameters, add frames, read results, plot."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self

from hardspheres.errors import HardSpheresError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Estimator", "NoDataError"]


class NoDataError(HardSpheresError, RuntimeError):
    """A result was asked of an estimator that has not seen the data it needs."""


class Estimator(ABC):
    """Base of all estimators.

    Subclasses take their parameters in the constructor, accumulate in `add`, and offer results as read-only
    properties, which raise `NoDataError` before there is anything to tell.
    """

    @abstractmethod
    def add(self, frame: Any) -> Self:
        """Take in one frame or one block of tallies and return the estimator itself, so that calls chain."""

    @abstractmethod
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the results beside their theory into `ax`, or into a new figure, and return the Axes."""

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
