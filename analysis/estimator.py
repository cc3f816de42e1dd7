"""The shape that all estimators share: construct with parameters, add frames, read results, merge, plot."""

from __future__ import annotations

import contextlib
import copy
import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from analysis.brief import word
from analysis.correlation_times import LONG_RUN, velocity_correlation_times, warn_if_frozen
from analysis.reduced import Gas
from analysis.series import BlockSeries, block_length, estimate_from_runs, run_groups
from analysis.statistics import Estimate, TheoryCheck
from hardspheres.errors import HardSpheresError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene
    from hardspheres.simulation import Tallies

__all__ = [
    "PALETTE",
    "BlockEstimator",
    "Estimator",
    "NoDataError",
    "PlacesEstimator",
    "ReplicaEstimator",
    "TalliedEstimator",
    "require_same_simulation",
    "tallies_of",
]

FloatArray = NDArray[np.float64]

PALETTE = ("#1f77b4", "#c8403f", "#e8b23a", "#3d2466", "#7fc8d8")
"""Colours of species and of series in all figures, distinct with any colour vision.

The least distance in CIELAB is 26 under deuteranopia, protanopia and tritanopia as simulated by Machado,
Oliveira and Fernandes 2009 (doi 10.1109/TVCG.2009.113).
"""


NUMBERS = {"Estimate", "list[Estimate]", "ChiSquare"}
"""Types of the results whose values `repr` shows."""
MOST = 5  # of them


class NoDataError(HardSpheresError, RuntimeError):
    """A result was asked of an estimator that has not seen the data it needs."""


class Estimator(ABC):
    """Base of all estimators.

    Subclasses take their parameters in the constructor and keep them as attributes that cannot be assigned
    again, accumulate in `add`, and offer results as read-only properties. Every result, `checks` and `plot`
    raise `NoDataError` until there are enough data.
    """

    _gas: Gas | None = None

    @abstractmethod
    def add(self, frame: Any) -> Self:
        """Add one frame and return the estimator itself, so that calls chain."""

    @property
    @abstractmethod
    def checks(self) -> list[TheoryCheck]:
        """Results beside their theory; an empty list where there is no theory of this gas."""

    @abstractmethod
    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the results beside their theory into `ax`, or into a new figure, and return the Axes."""

    @abstractmethod
    def _take_in(self, other: Self) -> None:
        """Add the data of another estimator of the same gas, which is free to be used up."""

    def merge(self, other: Self) -> Self:
        """Take in what was measured in another, independent run of the same gas; return the estimator itself.

        Results are then those of the data of both runs, and their errors combine those of both: for two runs
        of equal length, 1/sqrt(2) of the error of one. The other estimator stays as it is. Frames that are
        added later go on with this one's own run.

        Parameters
        ----------
        other : Estimator
            Of the same class, with the same parameters.

        Raises
        ------
        ValueError
            If it is of another class or gas, has other parameters, or is this one.
        """
        self._require_like(other)
        if other._gas is not None:
            scene = vars(other).get("_scene")  # one, which never changes, serves both
            memo = {id(scene): vars(self).get("_scene") or scene} if scene else {}
            self._take_in(copy.deepcopy(other, memo))
            self._gas = self._gas or other._gas
        return self

    def _require_like(self, other: Estimator) -> None:
        """Raise ValueError unless another estimator can be merged with this one."""
        name = type(self).__name__
        if type(other) is not type(self):
            raise ValueError(f"a {name} cannot be merged with a {type(other).__name__}")
        if other is self:
            raise ValueError(f"a {name} cannot be merged with itself: its data would count twice")
        for parameter in (name for name in vars(self) if not name.startswith("_")):
            own, value = vars(self)[parameter], vars(other)[parameter]
            if not np.array_equal(own, value):
                both = "" if isinstance(own, np.ndarray) else f" ({own} and {value})"
                raise ValueError(f"two {name}s of different {parameter}{both} cannot be merged")
        difference = self._gas.difference(other._gas) if self._gas and other._gas else ""
        if difference:
            raise ValueError(f"a {name} of another gas cannot be merged: {difference}")

    @property
    def gas(self) -> Gas:
        """What was measured: size, density, temperature, species of the gas."""
        self._require(self._gas is not None, "gas", "add(frame)")
        assert self._gas is not None
        return self._gas

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; AttributeError where it is a parameter that has its value."""
        if not name.startswith("_") and name in vars(self):
            raise AttributeError(f"{name} of a {type(self).__name__} is read-only; construct another one")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        """Return of which gas how much was added, and the main results with their errors, if any."""
        name, added = type(self).__name__, self._added
        if added == "":
            return f"<{name}: nothing added yet>"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # reading the result itself gives the warning
            results = self._results() or self._checked()
        if not results:
            results = ["nothing added yet" if added is None else "no result yet"]
        what = f"{name} of {self._gas}" if self._gas else name
        return f"<{', '.join([what, added] if added else [what])}: {', '.join(results[:MOST])}>"

    @property
    def _added(self) -> str | None:
        """How much was added, in words, an empty string for nothing; None where this is not known."""
        return None

    def _results(self) -> list[str]:
        """Return the results that are numbers."""
        numbers = []
        for name in dict.fromkeys(name for kind in reversed(type(self).__mro__) for name in vars(kind)):
            result = getattr(type(self), name)
            if name.startswith("_") or not isinstance(result, property) or result.fget is None:
                continue
            if result.fget.__annotations__.get("return") not in NUMBERS:
                continue
            with contextlib.suppress(HardSpheresError, ValueError, ArithmeticError):
                value = getattr(self, name)
                numbers.append(f"{name} {word(value)}")
        return numbers

    def _checked(self) -> list[str]:
        """Return what stands beside theory, once each."""
        with contextlib.suppress(HardSpheresError, ValueError, ArithmeticError):
            return list(dict.fromkeys(f"{check.quantity} {check.measured}" for check in self.checks))
        return []

    def _require(self, ready: bool, what: str, call: str) -> None:
        if not ready:
            raise NoDataError(f"{type(self).__name__} has no {what} yet; call {call} first")


class BlockEstimator(Estimator):
    """Base of estimators that keep a row per frame or block, in bounded memory, and a series per run."""

    _blocks: BlockSeries
    _others: tuple[BlockSeries, ...] = ()  # of runs that were merged

    def _take_in(self, other: Self) -> None:
        self._others = (*self._others, other._blocks, *other._others)

    @property
    def _added(self) -> str:
        return counted(sum(series.n_samples for series in (self._blocks, *self._others)), "frame")

    def _series(self) -> list[BlockSeries]:
        """Return the series of all runs that have rows."""
        return [series for series in (self._blocks, *self._others) if len(series)]

    def _pooled(
        self,
        runs: Sequence[FloatArray],
        statistic: Callable[[FloatArray], FloatArray] | None = None,
        shortest: Sequence[int] | None = None,
    ) -> Estimate:
        """Return a function of the mean row of all runs, given the rows of each; see `estimate_from_runs`."""
        weights = [series.n_samples for series in self._series()]
        return estimate_from_runs(runs, statistic, shortest, weights)

    def _errors_of_rows(
        self, along: FloatArray, of: Callable[[FloatArray], FloatArray] = lambda rows: rows
    ) -> FloatArray:
        """Return standard errors of the mean row, from blocks as long as a weighted sum of it asks for.

        Parameters
        ----------
        along : array
            The weights, of a row's shape.
        of : callable
            Makes rows whose mean has the errors from the rows that are kept; by default these themselves.
        """
        series, variances, samples = self._series(), [], []
        runs = [each.rows for each in series]
        for group in run_groups(runs):
            rows = np.concatenate([runs[k] for k in group])
            length = min(block_length(np.tensordot(rows, along, along.ndim)), len(rows) // 2)
            blocks = len(rows) // length
            kept = of(rows[len(rows) - blocks * length :])
            means = kept.reshape(blocks, length, *kept.shape[1:]).mean(axis=1)
            variances.append((means.std(axis=0, ddof=1) / math.sqrt(blocks)) ** 2)
            samples.append(sum(series[k].n_samples for k in group))
        weights = np.array(samples) / sum(samples)
        return np.asarray(np.sqrt(np.tensordot(weights**2, np.array(variances), 1)))

    @property
    def _mean(self) -> FloatArray:
        """Mean row of all samples of all runs."""
        series = self._series()
        return over_runs([run.mean for run in series], [run.n_samples for run in series])


class PlacesEstimator(BlockEstimator):
    """Base of estimators of where particles are: a row per frame, of one gas."""

    @abstractmethod
    def _begin(self, scene: Scene) -> None:
        """Take the gas of the first frame; ValueError where it cannot be measured."""

    def _follow(self, frame: Frame) -> Scene:
        """Return the scene of a frame; ValueError unless it has as many particles as the first."""
        if self._gas is None:
            self._begin(frame.scene)
        elif len(frame.positions) != self._gas.n:
            raise ValueError(
                f"frame has {len(frame.positions)} particles; expected {self._gas.n}, as in the first"
            )
        return frame.scene

    @property
    def _frames(self) -> int:
        return sum(series.n_samples for series in self._series())

    def _require_frames(self) -> None:
        self._require(bool(self._series()), "frames", "add(frame)")


def over_runs(means: Sequence[FloatArray], weights: Sequence[float]) -> FloatArray:
    """Return the mean over runs, weighted; that of a single run as it is."""
    return means[0] if len(means) == 1 else np.asarray(np.average(means, axis=0, weights=weights))


class TalliedEstimator(BlockEstimator):
    """Base of estimators of what the engine counts: a block lies between one frame and the next."""

    _gas: Gas
    _followed: Scene | None = None  # where the simulation started whose frames have come
    _before: FloatArray | None = None  # what was counted up to the last of them, its time first

    def __init__(self, scene: Scene, rows: int, what: str) -> None:
        if not scene.thermal_energy > 0.0:
            raise ValueError(f"nothing moves in this scene; a gas without thermal motion has no {what}")
        self._scene, self._gas = scene, Gas.of(scene)
        self._blocks = BlockSeries(rows)
        self._correlation_times = velocity_correlation_times(scene)

    @property
    def _added(self) -> str:
        return counted(self.n_blocks, "block") or counted(int(self._followed is not None), "frame")

    @property
    def scene(self) -> Scene:
        """The scene that was given."""
        return self._scene

    @property
    def n_blocks(self) -> int:
        """How many blocks there are, in each run one less than frames."""
        return sum(series.n_samples for series in self._series())

    def _reach(self) -> FloatArray:
        """Edges of the volume that centres of particles of mean radius can reach, (d,), [length]."""
        scene = self.scene
        return np.asarray(scene.box - np.where(scene.periodic, 0.0, 2.0 * float(scene.radii.mean())))

    def _density_between_walls(self) -> float:
        """Packing fraction in this volume, at most as dense as fluids are."""
        scene = self.scene
        denser: float = scene.packing_fraction * scene.volume / math.prod(self._reach().tolist())
        return min(denser, 0.54 if scene.dim == 3 else 0.66)

    def _require_blocks(self) -> None:
        self._require(sum(map(len, self._series())) >= 2, "two blocks", "add(frame) with three frames")

    def _from_blocks(
        self,
        runs: Sequence[FloatArray],
        statistic: Callable[[FloatArray], FloatArray],
        collisions: Sequence[FloatArray],
        least: float = 0.0,
    ) -> Estimate:
        """Return a function of the mean row of all runs; warn where velocities of a species hardly changed.

        Parameters
        ----------
        runs : sequence of arrays
            Rows of each run.
        statistic : callable
            As in `estimate_from_series`.
        collisions : sequence of arrays
            Collisions of particles in each of the rows, mean over the samples of the row.
        least : float
            Least length of a block in collisions per particle; velocity correlation times are longer.
        """
        shortest = []
        for series, counts in zip(self._series(), collisions, strict=True):
            per_row, longest = float(counts.mean()) * series.samples_per_row / self.scene.n, least
            if len(self._correlation_times) > 1:
                slowest = float(self._correlation_times.max())
                if per_row * len(counts) < LONG_RUN * slowest:
                    warn_if_frozen(self._correlation_times, per_row * len(counts))
                else:
                    longest = max(least, slowest)
            shortest.append(max(math.ceil(longest / per_row), 1) if per_row > 0.0 else 1)
        return self._pooled(runs, statistic, shortest)

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


class ReplicaEstimator(Estimator):
    """Base of estimators that average over replicas, independent gases that differ in their random start.

    Add the frames of one replica in order, then those of the next: a frame that does not advance begins a new
    replica. All replicas must be sampled alike. Errors come from the spread of the replicas.
    """

    def __init__(self) -> None:
        self._replicas: list[Any] = []
        self._own: int | None = None  # the replica that frames go on with

    def _take_in(self, other: Self) -> None:
        self._replicas += other._replicas

    def _continued(self, place: float, attribute: str, new: Callable[[], Any]) -> Any:
        """Return the replica of a frame at this time or s, a new one where it does not advance."""
        if self._begins(place, attribute):
            self._replicas.append(new())
            self._own = len(self._replicas) - 1
        assert self._own is not None
        return self._replicas[self._own]

    def _begins(self, place: float, attribute: str) -> bool:
        """Return whether a frame at this time or s is the first of another replica."""
        return self._own is None or place <= getattr(self._replicas[self._own], attribute)[-1]

    @property
    def _added(self) -> str:
        return counted(self.n_replicas, "replica")

    @property
    def n_replicas(self) -> int:
        """Number of replicas R."""
        return len(self._replicas)


def counted(number: int, what: str) -> str:
    """Return how many there are, in words; an empty string for none."""
    return f"{number} {what}{'s' * (number > 1)}" if number else ""


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


def labelled(axes: Axes, x: str, y: str) -> Axes:
    """Label the axes, show the legend and return the Axes."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.legend()
    return axes
