"""One run at a time in a folder, or several shards: a lock that ends with its holder, `kill -9` included.

Where there is no `fcntl` (Windows), or the file system has no locks, no run is refused.
"""

from __future__ import annotations

import os
from pathlib import Path

from hardspheres.temporary import placing
from studies.running.ownership import is_ordinary

try:
    import fcntl
except ImportError:  # no POSIX
    fcntl = None  # type: ignore[assignment]

__all__ = ["Lock"]


class Lock:
    """The right to write into a folder, alone or together with other shards.

    Parameters
    ----------
    path : Path
        A file in an existing folder, made where it is missing. It may be removed while the lock is held. No
        link is followed.
    """

    MARK = b"held by the run of hardspheres that writes here\n"

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle: int | None = None

    def acquire(self, shared: bool = False) -> bool:
        """Take the lock, alone or shared; return whether it was free, or held by this object already."""
        while self._handle is None:
            try:
                handle = self._opened()  # not inherited by workers
            except FileNotFoundError:  # removed by its last holder
                if not self.path.parent.is_dir():
                    raise
                continue
            try:
                if fcntl is not None:
                    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
                    fcntl.flock(handle, kind | fcntl.LOCK_NB)
                if os.fstat(handle).st_ino == os.stat(self.path).st_ino:
                    self._handle = handle
            except FileNotFoundError:  # removed by its last holder
                pass
            except BlockingIOError:
                os.close(handle)
                return False
            except OSError:  # a file system without locks
                self._handle = handle
            if self._handle is None:
                os.close(handle)
        return True

    def _opened(self) -> int:
        if not os.path.lexists(self.path):
            with placing(self.path) as temporary:
                temporary.write_bytes(self.MARK)
        return os.open(self.path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0))

    def is_held(self) -> bool:
        """Return whether this object holds the lock."""
        return self._handle is not None

    def is_ours(self) -> bool:
        """Return whether such a file is there, and was made by a lock."""
        return is_ordinary(self.path) and self.path.read_bytes() == self.MARK

    def release(self) -> None:
        """Release it; a second call does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
