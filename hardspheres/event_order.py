"""The events that several threads have logged, in the order in which one thread executes them."""

import heapq
from collections import defaultdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["in_order"]

Floats = NDArray[np.float64]


def in_order(rows: Floats, at: Any, changes: NDArray[np.bool_]) -> Floats:
    """Return rows of the kernels' logs, each thread's in the order of execution, as one thread logs them.

    That is by time, and at one instant the lowest ids first of those events whose particles have had all
    their earlier events.

    Parameters
    ----------
    rows : (events, at.LOG_ROW) array
        One thread's after another's.
    at : module
        The kernels' layout.
    changes : (N,) bool array
        Which particles an event changes: all but obstacles.
    """
    low, high = (rows[:, k].astype(np.int64) for k in (at.LOG_FIRST, at.LOG_SECOND))
    order = np.lexsort((high, low, rows[:, at.LOG_MOMENT], rows[:, at.LOG_EPOCH]))
    when = rows[order][:, [at.LOG_EPOCH, at.LOG_MOMENT]]
    begins = np.flatnonzero(np.any(when[1:] != when[:-1], axis=1)) + 1
    for first, last in zip([0, *begins.tolist()], [*begins.tolist(), len(rows)], strict=True):
        if last > first + 1:
            group = order[first:last]
            # In one round only one thread has a particle: then the order of execution is that of the rows.
            executed = group[np.lexsort((group, rows[group, at.LOG_ROUND]))]
            order[first:last] = _by_turns(executed.tolist(), low, high, changes)
    in_turn: Floats = rows[order]
    return in_turn


def _by_turns(executed: list[int], low: Any, high: Any, changes: Any) -> list[int]:
    """Return events of one instant, given in an order in which they can happen, lowest ids first."""
    queues: dict[int, list[int]] = defaultdict(list)
    members = {}
    for event in executed:
        members[event] = [i for i in (low[event], high[event]) if i < len(changes) and changes[i]]
        for i in members[event]:
            queues[i].append(event)
    done: dict[int, int] = defaultdict(int)

    def ready(event: int) -> bool:
        return all(queues[i][done[i]] == event for i in members[event])

    waiting = [(low[event], high[event], event) for event in executed if ready(event)]
    heapq.heapify(waiting)
    found = []
    while waiting:
        *_, event = heapq.heappop(waiting)
        found.append(event)
        for i in members[event]:
            done[i] += 1
        for i in members[event]:
            if done[i] < len(queues[i]):
                after = queues[i][done[i]]
                entry = (low[after], high[after], after)
                if ready(after) and entry not in waiting:
                    heapq.heappush(waiting, entry)
    return found
