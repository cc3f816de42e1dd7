"""Work that can be interrupted at any moment and resumed, with the same result to the last bit.

A `Resumable` task keeps its progress in a state of plain values, estimators and simulations, and pauses
wherever that state is complete. `perform` saves it at intervals, and when it is asked to stop. Results must
not depend on where it paused.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import hardspheres as hs
from studies.running.journal import Shelf
from studies.running.stopping import signals_held

__all__ = ["Measuring", "Recorded", "Resumable", "in_blocks", "perform", "until"]

Item = TypeVar("Item")
State = TypeVar("State")
Result = TypeVar("Result")

PAUSE = 100_000  # collisions between two pauses: a fraction of a second


class Resumable(ABC, Generic[Item, State, Result]):
    """A task for `run_replicas` that can be resumed after an interruption."""

    @abstractmethod
    def begin(self, item: Item) -> State:
        """Return the initial state of the work on an item."""

    @abstractmethod
    def steps(self, item: Item, state: State) -> Iterator[None]:
        """Continue from a state and change it in place; yield often, wherever it is complete."""

    @abstractmethod
    def result(self, item: Item, state: State, seconds: float) -> Result:
        """Return the result, given the last state and the wall time that it took."""

    def __call__(self, item: Item) -> Result:
        """Do all the work, without saving."""
        return perform(self, item, lambda: None, lambda state: None, every=float("inf"))


@dataclass
class _Kept:
    """What is saved of an item that is running."""

    state: Any
    seconds: float


def perform(
    task: Resumable[Item, State, Result],
    item: Item,
    load: Callable[[], Any],
    save: Callable[[Any], None],
    every: float,
) -> Result:
    """Work on one item from its saved state.

    Parameters
    ----------
    task, item
        What to do.
    load : callable
        Returns the last argument of `save`, None where there is none.
    save : callable
        Keeps its argument.
    every : float
        Seconds between two calls of it.
    """
    began = time.perf_counter()
    kept = load() or _Kept(task.begin(item), 0.0)
    began -= kept.seconds
    saved, stopped = time.monotonic(), True
    with signals_held() as stopping:
        for _ in task.steps(item, kept.state):
            stop = stopping()
            if stop or time.monotonic() - saved >= every:
                kept.seconds = time.perf_counter() - began
                save(kept)
                saved = time.monotonic()
            if stop:
                break
        else:
            stopped = False
    if stopped:  # by a signal whose handler returned
        raise KeyboardInterrupt
    return task.result(item, kept.state, time.perf_counter() - began)


@dataclass(frozen=True)
class Recorded(Generic[Item, Result]):
    """A task whose results, and intermediate states if it has any, are kept on a shelf.

    Attributes
    ----------
    task : callable
        From an item to its result; `Resumable` if it can continue from a state.
    shelf : Shelf
        Where.
    """

    task: Callable[[Item], Result]
    shelf: Shelf

    def __call__(self, numbered: tuple[int, Item]) -> Result:
        """Return the result of an item with its number."""
        index, item = numbered
        if isinstance(self.task, Resumable):
            result: Result = perform(
                self.task,
                item,
                lambda: self.shelf.state(index),
                lambda state: self.shelf.save(index, state),
                self.shelf.every,
            )
        else:
            result = self.task(item)
        with signals_held():
            self.shelf.store(index, result)
        return result


def until(simulation: hs.Simulation, collisions: int) -> Iterator[None]:
    """Run up to a total of pair collisions, with pauses."""
    while simulation.collisions < collisions:
        simulation.run(collisions=min(collisions - simulation.collisions, PAUSE))
        yield


class Measuring(Protocol):
    """A state with a simulation and the number of blocks measured."""

    done: int

    @property
    def simulation(self) -> hs.Simulation:
        """The gas."""


def in_blocks(state: Measuring, ends: Sequence[int], add: Callable[[hs.Frame], object]) -> Iterator[None]:
    """Run up to the first of these totals of pair collisions and on to each of the others, with pauses.

    Parameters
    ----------
    state : Measuring
        The state to continue from.
    ends : sequence of int
        Ascending.
    add : callable
        Takes a frame at each of them: what is measured begins at the first one, and blocks end at the others.
    """
    simulation, start = state.simulation, ends[0]
    yield from until(simulation, start)
    if simulation.collisions == start:  # no pause comes between this frame and later collisions
        add(simulation.frame())
    for end in ends[1 + state.done :]:
        yield from until(simulation, end)
        add(simulation.frame())
        state.done += 1
