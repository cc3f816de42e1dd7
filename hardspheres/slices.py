"""Slices of about 0.1 s: how long a call of the kernels lasts, so that Ctrl-C works, and what was timed."""

import time

from hardspheres.engine import Engine

__all__ = ["Slices"]

SLICE = 0.1  # seconds after which control comes back to Python


class Slices:
    """Runs an engine slice by slice; how long a slice lasts changes no bit.

    Parameters
    ----------
    n : int
        Number of particles, for a first guess of the work in a slice.

    Attributes
    ----------
    budget : int
        Work in the next slice, in the kernels' units.
    timed : (int, float)
        Pair collisions, and the seconds that they took; slices that load or compile kernels do not count.
    """

    def __init__(self, n: int) -> None:
        self.budget = 2000 + n
        self.timed = (0, 0.0)

    def run(self, engine: Engine, epoch: int, moment: float, pairs: int) -> bool:
        """Run for about SLICE seconds; True when the time or the number of pair collisions is reached."""
        ready = getattr(engine.kernels.run, "signatures", True)  # else it is loaded or compiled first
        before = engine.arrays.counter[engine.layout.PAIRS]
        began = time.perf_counter()
        reached = engine.run(epoch, moment, pairs, self.budget)
        took = time.perf_counter() - began
        if ready:
            done = int(engine.arrays.counter[engine.layout.PAIRS] - before)
            self.timed = (self.timed[0] + done, self.timed[1] + took)
        if engine.paused:
            self.budget = int(self.budget * min(max(SLICE / max(took, 1e-6), 0.5), 2.0)) + 1
        return reached
