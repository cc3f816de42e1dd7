"""Temporary files named after the process that writes them, so that those of killed processes are removed.

Process ids are comparable only within one machine since its boot, and within one container. The name contains
a digest of these; files with another digest are removed by age alone.
"""

import contextlib
import hashlib
import os
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

__all__ = [
    "neighbourhood",
    "placing",
    "remove_leftovers",
    "replacing",
    "still_runs",
    "temporarily",
    "temporary_beside",
]

OLD = 86400.0  # seconds since a file was last written, after which no process can still be writing it
NAME = re.compile(r"\.partial-([0-9a-f]{16})-(\d{1,10})-[0-9a-f]{8}(\.\w{1,10})?")


def temporary_beside(target: Path) -> Path:
    """Return a name that no other file has, in the same folder and with the same extension."""
    suffix = target.suffix if re.fullmatch(r"\.\w{1,10}", target.suffix) else ""
    return target.parent / f".partial-{neighbourhood()}-{os.getpid()}-{secrets.token_hex(4)}{suffix}"


@contextlib.contextmanager
def temporarily(target: Path) -> Iterator[Path]:
    """Yield a temporary name beside the target; its file, if it is still there, is removed at the end.

    What cannot be removed is left to `remove_leftovers`: whatever happened before matters more.
    """
    temporary = temporary_beside(target)
    try:
        yield temporary
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextlib.contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Yield a temporary name; its file replaces the target when the context ends without an error."""
    with temporarily(target) as temporary:
        yield temporary
        os.replace(temporary, target)


@contextlib.contextmanager
def placing(target: Path) -> Iterator[Path]:
    """Yield a temporary name; its file becomes the target when the context ends, if there is none by then."""
    with temporarily(target) as temporary:
        yield temporary
        try:
            os.link(temporary, target)  # whole or not at all, and in nobody's place
        except FileExistsError:
            pass
        except OSError:  # a file system without hard links
            if not os.path.lexists(target):
                os.replace(temporary, target)


def remove_leftovers(folder: Path, now: float) -> None:
    """Remove temporary files of ended processes from a folder.

    Parameters
    ----------
    folder : Path
        Where `temporary_beside` gave names.
    now : float
        Time on the clock of the file system, which may be that of another machine: when a file was just
        written there.
    """
    here = neighbourhood()
    with contextlib.suppress(OSError):
        for path in folder.glob(".partial-*"):
            with contextlib.suppress(OSError):
                name, found = NAME.fullmatch(path.name), path.lstat()
                if name is None or not stat.S_ISREG(found.st_mode):
                    continue
                if now - found.st_mtime > OLD or (name[1] == here and not still_runs(int(name[2]))):
                    path.unlink()


def neighbourhood() -> str:
    """Return digits that are equal for two processes exactly if their ids are comparable."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")
        container = os.readlink("/proc/self/ns/pid")
    except OSError:  # then no other process is known to share ids
        return secrets.token_hex(8)
    return hashlib.sha256(f"{os.uname().nodename} {boot} {container}".encode()).hexdigest()[:16]


def still_runs(pid: int) -> bool:
    """Return whether there is a process of this id; meaningful only within one `neighbourhood`."""
    try:
        os.kill(pid, 0)  # signal 0 only asks
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # of another user
        pass
    return True
