"""Whether this process is the command line's own, and not a program or notebook that has imported us."""

import threading

__all__ = ["alone", "claim"]

_ours = False


def claim() -> None:
    """Say that this process is ours."""
    global _ours
    _ours = True


def alone() -> bool:
    """Return whether it is ours and has no other thread: then a fork of it is as good as a fresh one."""
    return _ours and threading.active_count() == 1
