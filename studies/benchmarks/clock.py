"""Timing for `hardspheres bench`: short windows of a run, their statistics, and memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs

__all__ = ["Memory", "Ours", "Runner", "Timing", "Windows"]

FloatArray = NDArray[np.float64]


class Runner(Protocol):
    """What can be timed: our simulation, or a peer."""

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""

    def run(self, collisions: int) -> None:
        """Advance by so many pair collisions, or about so many."""

    def idle(self) -> None:
        """Do the fixed work of a call of `run`, without collisions."""


class Ours:
    """Our engine as a `Runner`."""

    name = "plain gas"

    def __init__(self, simulation: hs.Simulation) -> None:
        self.simulation = simulation

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""
        return self.simulation.collisions

    def run(self, collisions: int) -> None:
        """Advance by so many pair collisions."""
        self.simulation.run(collisions=collisions)

    def idle(self) -> None:
        """Advance by a single one."""
        self.simulation.run(collisions=1)

    def reset(self) -> None:
        """Start counting for the compressibility factor."""
        self.simulation.reset_tallies()

    @property
    def compressibility_factor(self) -> float:
        """Z since `reset`, from the virial."""
        return self.simulation.compressibility_factor


@dataclass
class Windows:
    """Short stretches of a run with the time each took: that of the event loop alone.

    A call with (almost) no collisions is timed right before each window and subtracted. In spheropack it
    includes a new search of all neighbours, which would otherwise count against it in short windows.

    Attributes
    ----------
    collisions : list of int
        Pair collisions in each.
    wall, cpu : list of float
        Seconds on the wall, and of the processor.
    idle : list of float
        Seconds of processor time that were subtracted.
    """

    collisions: list[int] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    idle: list[float] = field(default_factory=list)

    def time(self, runner: Runner, collisions: int) -> None:
        """Run for about so many collisions, and record the time."""
        idle = _timed(runner.idle)
        before = runner.collisions
        took = _timed(lambda: runner.run(collisions))
        self.collisions.append(runner.collisions - before)
        wall, cpu = (max(whole - part, 0.1 * whole) for whole, part in zip(took, idle, strict=True))
        self.wall.append(wall)  # at least a tenth: tiny windows are noisy, but must not be zero
        self.cpu.append(cpu)
        self.idle.append(idle[1])

    @property
    def cpu_rates(self) -> FloatArray:
        """Collisions per second of processor time, one per window."""
        return np.array(self.collisions) / np.maximum(self.cpu, 1e-9)

    @property
    def wall_rates(self) -> FloatArray:
        """Collisions per second on the wall, one per window."""
        return np.array(self.collisions) / np.maximum(self.wall, 1e-9)


def _timed(action: Callable[[], None]) -> tuple[float, float]:
    """Return the seconds that an action takes on the wall, and of the processor."""
    cpu, wall = time.process_time(), time.perf_counter()
    action()
    return time.perf_counter() - wall, time.process_time() - cpu


@dataclass(frozen=True)
class Timing:
    """Statistics of a set of windows, in collisions per second.

    Attributes
    ----------
    median, best, lower_quartile, upper_quartile : float
        Over the windows.
    standard_error : float
        Of the mean over the windows.
    """

    median: float
    best: float
    lower_quartile: float
    upper_quartile: float
    standard_error: float

    @classmethod
    def of(cls, rates: FloatArray) -> Timing:
        """Return the timing of windows with these rates."""
        low, middle, high = np.quantile(rates, [0.25, 0.5, 0.75])
        error = np.std(rates, ddof=1) / np.sqrt(len(rates)) if len(rates) > 1 else np.nan
        return cls(float(middle), float(np.max(rates)), float(low), float(high), float(error))


class Memory:
    """Growth of this process's resident memory since the object was made; known on Linux only."""

    def __init__(self) -> None:
        self.before = self._read("VmRSS")

    @staticmethod
    def _read(name: str) -> int | None:
        try:
            lines = Path("/proc/self/status").read_text().splitlines()
        except OSError:
            return None
        return next((1024 * int(line.split()[1]) for line in lines if line.startswith(name + ":")), None)

    @staticmethod
    def forget_peak() -> None:
        """Reset the peak to the present resident memory, after temporary arrays of the scene are freed."""
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:
            return

    def peak_growth(self) -> int | None:
        """Return by how many bytes the peak exceeds the initial resident memory."""
        peak = self._read("VmHWM")
        return None if peak is None or self.before is None else peak - self.before
