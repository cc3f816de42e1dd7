"""Work that can be interrupted at any moment and resumed, with the same result to the last bit.

A `Resumable` task keeps its progress in a state of plain values, estimators and simulations, and pauses
wherever that state is complete. `perform` saves it at intervals, and when it is asked to stop. Results must
not depend on where it paused.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar

import hardspheres as hs
from studies.running.journal import Shelf
from studies.running.stopping import signals_held

__all__ = ["Measuring", "Resumable", "in_blocks", "perform", "until"]

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

    def writes(self, item: Item) -> bool:
        """Return whether the work on an item writes files of its own, which a worker elsewhere cannot."""
        return False

    def __call__(self, item: Item) -> Result:
        """Do all the work, without saving."""
        return perform(self, item)


def perform(task: Callable[[Item], Result], item: Item, shelf: Shelf | None = None, index: int = 0) -> Result:
    """Return the result of a task, and keep it on a shelf.

    Parameters
    ----------
    task : callable
        From an item to its result. A `Resumable` one continues from the state on the shelf, and is saved
        there at intervals and when a signal asks it to stop.
    item
        What to do.
    shelf : Shelf, optional
        Where to keep it.
    index : int, default 0
        Number of the item on the shelf.
    """
    result = _in_steps(task, item, shelf, index) if isinstance(task, Resumable) else task(item)
    if shelf is not None:
        with signals_held():
            shelf.store(index, result)
    return result


def _in_steps(task: Resumable[Item, State, Result], item: Item, shelf: Shelf | None, index: int) -> Result:
    began = time.perf_counter()
    state, earlier = (shelf and shelf.state(index)) or (task.begin(item), 0.0)
    began -= earlier
    saved, stop = time.perf_counter(), False
    with signals_held() as stopping:
        for _ in task.steps(item, state):
            stop = stopping()
            if shelf is not None and (stop or time.perf_counter() - saved >= shelf.every):
                shelf.save(index, (state, time.perf_counter() - began))
                saved = time.perf_counter()
            if stop:
                break
    if stop:  # by a signal whose handler returned
        raise KeyboardInterrupt
    return task.result(item, state, time.perf_counter() - began)


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
