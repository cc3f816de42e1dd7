"""Who runs: a file that names host and process of a shard, and whose time is renewed while it runs.

A lock that is free proves nothing on a file system whose locks are known to one host alone (BeeGFS by
default, NFS with `nolock`, many of FUSE). So a process of this host is asked for, and one of another host has
ended when its file has not been renewed for `STALE` seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import re
import secrets
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hardspheres.temporary import neighbourhood, placing, still_runs

__all__ = ["NAMED", "STALE", "Presence", "announce", "present_in", "renewing"]

NAMED = re.compile(r"shard-\d{4,}-[0-9a-f]{8}")
BEAT = 10.0  # seconds between two renewals
STALE = 120.0  # without one, after which the process is taken to have ended
LOOK = 0.5  # between two looks at one that may be renewed


@dataclass(frozen=True)
class Presence:
    """What the file of a shard says.

    Attributes
    ----------
    path : Path
        The file.
    shard, host : str
        Which one, and where.
    process : int
        Its id there.
    where : str
        Equal for processes whose ids can be compared, see `hardspheres.temporary`.
    renewed : float
        When, on the clock of the file system.
    """

    path: Path
    shard: str
    host: str
    process: int
    where: str
    renewed: float

    def __str__(self) -> str:
        """Return it in words."""
        return f"shard {self.shard} (host {self.host}, process {self.process})"

    @classmethod
    def of(cls, path: Path) -> Presence | None:
        """Return what a file says, None where it is missing or says nothing."""
        try:
            with path.open(encoding="utf-8") as file:  # opened, so that NFS asks the server for its time
                said, renewed = json.load(file), os.fstat(file.fileno()).st_mtime
            return cls(path, said["shard"], said["host"], int(said["process"]), said["where"], renewed)
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            return None

    def ended(self, clock: Path) -> bool:
        """Return whether that is known without a second look.

        Parameters
        ----------
        clock : Path
            A file on the same file system, whose time is set.
        """
        if self.where == neighbourhood() and not still_runs(self.process):
            return True
        return _now(clock) - self.renewed > STALE

    def goes_on(self, clock: Path) -> bool:
        """Return whether the shard still runs; waits until it is renewed, or has not been for too long."""
        began = time.monotonic()
        left = STALE - (_now(clock) - self.renewed)
        while not self.ended(clock) and time.monotonic() - began <= left:
            time.sleep(LOOK)
            seen = Presence.of(self.path)
            if seen is None or seen.renewed != self.renewed:
                return seen is not None
        return False


def _now(clock: Path) -> float:
    """Return the time on the clock of the file system, which may be that of another machine."""
    try:
        os.utime(clock)
        return clock.stat().st_mtime
    except OSError:
        return time.time()


def present_in(folder: Path, clock: Path) -> list[Presence]:
    """Return the shards in a folder that are not known to have ended."""
    found = [Presence.of(path) for path in sorted(folder.glob("shard-*")) if NAMED.fullmatch(path.name)]
    return [each for each in found if each is not None and not each.ended(clock)]


def announce(folder: Path, number: int, shard: str) -> Path:
    """Write the file that says in a folder that this process runs a shard, and return it.

    Parameters
    ----------
    folder : Path
        Where.
    number : int
        Of the shard, for the name of the file.
    shard : str
        Which one, in words.
    """
    path = folder / f"shard-{number:04d}-{secrets.token_hex(4)}"
    who = {"shard": shard, "host": platform.node(), "process": os.getpid(), "where": neighbourhood()}
    with placing(path) as temporary:
        temporary.write_text(json.dumps(who), encoding="utf-8")
    return path


@contextlib.contextmanager
def renewing(path: Path) -> Iterator[None]:
    """Renew such a file while the context lasts, and remove it at the end."""
    ended = threading.Event()

    def renew() -> None:
        while not ended.wait(BEAT):
            with contextlib.suppress(OSError):
                os.utime(path)

    threading.Thread(target=renew, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        with contextlib.suppress(OSError):
            path.unlink()
