"""One run at a time in a folder: a lock that the system releases however its holder ends, `kill -9` included.

Where there is no `fcntl` (Windows), or the file system has no locks, no run is refused.
"""

from __future__ import annotations

import os
from pathlib import Path

try:
    import fcntl
except ImportError:  # no POSIX
    fcntl = None  # type: ignore[assignment]

__all__ = ["Lock"]


class Lock:
    """The exclusive right to write into a folder.

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

    def acquire(self) -> bool:
        """Take the lock; return whether it was free."""
        while True:
            try:
                handle = self._opened()  # not inherited by workers
            except (FileNotFoundError, FileExistsError):
                if not self.path.parent.is_dir():
                    raise
                continue  # made or removed by another
            try:
                if fcntl is not None:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.fstat(handle).st_ino == os.stat(self.path).st_ino:
                    self._handle = handle
                    return True
            except BlockingIOError:
                os.close(handle)
                return False
            except FileNotFoundError:
                pass  # removed by its last holder
            except OSError:  # a file system without locks
                self._handle = handle
                return True
            os.close(handle)

    def _opened(self) -> int:
        plain = getattr(os, "O_NOFOLLOW", 0)
        if os.path.lexists(self.path):
            return os.open(self.path, os.O_RDWR | plain)
        handle = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_EXCL | plain, 0o666)
        try:
            os.write(handle, self.MARK)
        except OSError:
            os.close(handle)
            self.path.unlink(missing_ok=True)
            raise
        return handle

    def is_ours(self) -> bool:
        """Return whether such a file is there, and was made by a lock."""
        return self.path.is_file() and not self.path.is_symlink() and self.path.read_bytes() == self.MARK

    def release(self) -> None:
        """Release it; a second call does nothing."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
