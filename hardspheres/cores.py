"""How many cores this process may use, and how many of them nobody else does."""

import os
import time
from pathlib import Path

__all__ = ["available_cores", "idle_cores"]

LOOK = 0.05  # seconds
BUSY = 0.5  # share of that time in which a core was at work, from which it counts as busy
STAT = Path("/proc/stat")  # Linux only
IDLE = (3, 4)  # columns: idle, waiting for a disk


def available_cores() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def idle_cores() -> int:
    """Return how many of them are idle while this thread waits for a moment, at least 1.

    All, where the system does not tell.
    """
    before = _times()
    if not before:
        return available_cores()
    time.sleep(LOOK)
    idle = 0
    for core, (there, spare) in _times().items():
        passed = there - before[core][0] if core in before else 0
        idle += passed == 0 or spare - before[core][1] > BUSY * passed
    return max(1, idle)


def _times() -> dict[int, tuple[int, int]]:
    """Return of each core that this process may use its time, and its idle time, in the system's ticks."""
    try:
        allowed = os.sched_getaffinity(0)
        lines = [line.split() for line in STAT.read_text().splitlines() if line.startswith("cpu")]
        times = {int(name[3:]): [int(part) for part in parts[:8]] for name, *parts in lines if name != "cpu"}
    except (AttributeError, OSError, ValueError):
        return {}
    return {
        core: (sum(parts), sum(parts[k] for k in IDLE)) for core, parts in times.items() if core in allowed
    }
