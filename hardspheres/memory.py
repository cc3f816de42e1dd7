"""Available memory: too large numbers of particles are refused before anything is allocated."""

import os
from pathlib import Path

from hardspheres.errors import HardSpheresError, SceneError

SMALL = 1 << 28  # bytes that are always granted
MAKING = 300  # bytes for each particle while a scene is made, measured at a million particles
UNITS = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB", "ZB", "YB")


def available_memory() -> int | None:
    """Return how many bytes this process may still allocate, None where the system does not say."""
    known = [_from_kernel(), _from_container()]
    if known[0] is None:
        try:
            known[0] = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        except (AttributeError, ValueError, OSError):
            pass
    return min((number for number in known if number is not None), default=None)


def _from_kernel() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    return None


def _from_container() -> int | None:
    try:
        return int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii"))
    except (OSError, ValueError):  # no such limit; "max" is none either
        return None


def in_words(number: int) -> str:
    """Return a number of bytes in human-readable form: three digits and a unit."""
    power = min((len(str(number)) - 1) // 3, len(UNITS) - 1)
    return f"{number / 1000**power:.3g} {UNITS[power]}"


def require_memory(
    needed: int, what: str, error: type[HardSpheresError], remedy: str = "ask for fewer"
) -> None:
    """Raise an error if something needs more memory than is available.

    Parameters
    ----------
    needed : int
        Bytes.
    what : str
        Beginning of the sentence, as in "n = 4000: so many particles".
    error : type
        The error to raise.
    remedy : str
        End of the sentence.

    Raises
    ------
    HardSpheresError
        Of that type, with the number of bytes needed and available.
    """
    if needed <= SMALL:
        return
    available = available_memory()
    if available is not None and needed > available:
        raise error(
            f"{what} need about {in_words(needed)} of memory ({needed} bytes), and {in_words(available)} are "
            f"available; {remedy}"
        )


def require_room_for(n: int) -> None:
    """Raise SceneError if so many particles do not fit in the available memory.

    Parameters
    ----------
    n : int
        Number of particles asked for.
    """
    require_memory(MAKING * n, f"n = {n}: so many particles", SceneError)
