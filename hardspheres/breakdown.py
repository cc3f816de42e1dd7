"""Where the time of the event loop goes: a second thread looks, many times a second, at what it is at.

The kernel notes which part it is in (`kernel.layout.PART`), one number in memory that nobody waits for; so
the plain kernel is measured, undisturbed. `hardspheres bench` prints the result.
"""

import threading
import time
from collections import Counter
from types import TracebackType
from typing import Self

from hardspheres.simulation import Simulation

__all__ = ["PARTS", "Breakdown"]

# What each part is, with lists and with windows.
PARTS = {
    "prediction": ("predictions of next events", "searches after collisions"),
    "renewal": ("renewal of lists", "openings of windows"),
    "calendar": ("calendar", "queue of contacts"),
    "execution": ("execution", "execution"),
}
PERIOD = 0.0005  # seconds between two looks
_COUNTED = {"stale_events": "STALE", "list_renewals": "REBUILDS", "renewals_of_all_lists": "REBUILDS_OF_ALL"}


class Breakdown:
    """Looks at a simulation while it runs, in a `with` block; no bit of the trajectory depends on it.

    Parameters
    ----------
    simulation : Simulation
        What runs within the block, in this process.

    Attributes
    ----------
    looks : Counter
        How often the loop was seen in each of `PARTS`.
    """

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.looks: Counter[str] = Counter()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Self:
        """Begin to look."""
        self._before = self._counts()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Look no more."""
        self._over.set()
        self._thread.join()
        self._after = self._counts()

    def _look(self) -> None:
        at = self.simulation._engine.layout
        names = {getattr(at, part.upper()): part for part in PARTS}
        while not self._over.is_set():
            time.sleep(PERIOD)
            self.looks[names[int(self.simulation._engine.arrays.counter[at.PART])]] += 1

    def _counts(self) -> dict[str, int]:
        at, counter = self.simulation._engine.layout, self.simulation._engine.arrays.counter
        return {name: int(counter[getattr(at, slot)]) for name, slot in _COUNTED.items()} | {
            "collisions": self.simulation.collisions
        }

    @property
    def shares(self) -> dict[str, float]:
        """Share of time of each part; all are 0 before the first look."""
        looks = max(self.looks.total(), 1)
        return {part: self.looks[part] / looks for part in PARTS}

    @property
    def per_collision(self) -> dict[str, float]:
        """Stale events, lists renewed singly, and renewals of all lists, per pair collision in the block."""
        collisions = max(self._after["collisions"] - self._before["collisions"], 1)
        return {name: (self._after[name] - self._before[name]) / collisions for name in _COUNTED}
