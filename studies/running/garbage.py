"""When a program of ours looks for garbage in circles: rarely, and not at its end.

What is large here, simulations and their frames, is in no circle of references and goes with its last holder.
Imports and figures make objects by the hundred thousand that stay; looking through them again and again, and
once more at the end, was a fifth of what a short study took.
"""

import atexit
import gc

__all__ = ["collect_rarely"]

THRESHOLDS = 50_000, 20, 20


def collect_rarely() -> None:
    """Let this process, which is ours and no one's library, collect garbage rarely."""
    gc.set_threshold(*THRESHOLDS)
    atexit.register(gc.freeze)
