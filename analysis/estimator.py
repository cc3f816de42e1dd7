"""The interface that all estimators share: construct with parameters, add frames, read results, plot."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import HardSpheresError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene
    from hardspheres.simulation import Tallies

__all__ = ["PALETTE", "Estimator", "NoDataError", "TalliedEstimator", "require_same_simulation", "tallies_of"]

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
        """Add one frame and return the estimator itself, so that calls chain."""

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


class TalliedEstimator(Estimator):
    """Base of estimators of what the engine counts: a block lies between one frame and the next."""

    scene: Scene
    _followed: Scene | None = None  # where the simulation started whose frames have come
    _before: NDArray[np.float64] | None = None  # what was counted up to the last of them, its time first

    def _require_next(self, frame: Frame) -> Tallies:
        """Return the tallies of a frame; ValueError unless it goes on from those that have come."""
        tallies = tallies_of(frame)
        of_frame, own = (
            (np.bincount(scene.species).tolist(), scene.dim) for scene in (frame.scene, self.scene)
        )
        if of_frame != own:
            raise ValueError(
                f"the frame has {of_frame[0]} particles of each species in {of_frame[1]} dimensions; "
                f"the scene has {own[0]} in {own[1]}"
            )
        if self._followed is None or self._before is None:
            return tallies
        require_same_simulation(self._followed, frame)
        if not frame.time > self._before[0]:
            raise ValueError(
                f"the frame is at time {frame.time:g}, the one before at {self._before[0]:g}; "
                "add each frame once, in the order of time"
            )
        return tallies

    def _since_last(self, frame: Frame, counted: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return what was counted since the last frame, given the counts since the start, or None."""
        before, self._before = self._before, counted
        if self._followed is None:
            self._followed = frame.scene
        return None if before is None else counted - before


def tallies_of(frame: Frame) -> Tallies:
    """Return what was counted up to a frame; ValueError where nothing was."""
    tallies = getattr(frame, "tallies", None)
    if tallies is None or not hasattr(frame, "scene"):
        raise ValueError(
            "only frames of a simulation have tallies, those of sim.frames(...) and sim.frame(); this is "
            f"{frame!r:.200}"
        )
    known: Tallies = tallies
    return known


def require_same_simulation(start: Scene, frame: Frame) -> None:
    """Raise ValueError unless the simulation of a frame started from this scene."""
    if frame.scene is start:
        return
    arrays = ("positions", "velocities", "radii", "masses", "box")
    if frame.scene.boundary != start.boundary or not all(
        np.array_equal(getattr(frame.scene, name), getattr(start, name)) for name in arrays
    ):
        raise ValueError(
            "the frame is of another simulation than the one before; each simulation needs an estimator of "
            "its own"
        )


def axes_or_new(ax: Axes | None, **options: Any) -> Axes:
    """Return `ax`, or the Axes of a new pyplot figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    new: Axes = pyplot.subplots(layout="constrained", **options)[1]
    return new
