"""The event log: every event at full precision, in chunks, to a function or a `.npy` file of any length."""

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import SimulationError

__all__ = ["event_dtype"]

Events = NDArray[np.void]
Sink = Callable[[Events], object]

ROOM = 8192  # events in a chunk


def event_dtype(dim: int) -> np.dtype[np.void]:
    """Return the type of an event in the log.

    Fields: ``time``, since the start of the simulation; ``i`` and ``j``, the particles, i < j, a wall counts
    as particle n + 2 axis + side (side 0 at 0, 1 at L); ``normal`` (d,), the unit vector from j, or from the
    wall, to i; ``impulse``, the momentum transfer: i gains impulse * normal, j loses it; ``free_path`` (2,),
    what i and j flew since their last collision with a particle: at a wall that of i so far, since a wall
    does not end a free path, and NaN; NaN too where a particle has not collided with another since the start,
    and under gravity, where flights are not straight.
    """
    return np.dtype(
        [
            ("time", "<f8"),
            ("i", "<i4"),
            ("j", "<i4"),
            ("normal", "<f8", (dim,)),
            ("impulse", "<f8"),
            ("free_path", "<f8", (2,)),
        ]
    )


def as_events(rows: NDArray[np.float64], at: Any) -> Events:
    """Return the kernels' rows as structured array."""
    events = np.empty(len(rows), dtype=event_dtype(int(at.DIM)))
    events["time"] = rows[:, at.LOG_TIME]
    events["i"], events["j"] = rows[:, at.LOG_FIRST], rows[:, at.LOG_SECOND]
    # Without negative zeros, which depend on the order in which the search finds the two particles.
    events["normal"] = rows[:, at.LOG_NORMAL : at.LOG_NORMAL + at.DIM] + 0.0
    events["impulse"] = rows[:, at.LOG_IMPULSE]
    events["free_path"] = rows[:, at.LOG_PATHS : at.LOG_PATHS + 2]
    return events


class NpyStream:
    """A `.npy` file that grows and is readable at any moment, also after a kill, with all events reported.

    Each chunk is appended, and only then the length in the header is rewritten, in one piece (NumPy leaves
    room for it). The file is not held open in between: there is nothing to close.

    Parameters
    ----------
    path : str or path-like
        Ends in ``.npy``. A file that is there already is replaced. A relative path refers to the working
        directory at the time of this call.
    dtype : numpy.dtype
        Of an event.

    Raises
    ------
    SimulationError
        If the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], dtype: np.dtype[np.void]) -> None:
        self.path, self.dtype, self.written = Path(path), dtype, 0
        self._place, self._failure = self.path.absolute(), ""
        if self.path.suffix != ".npy":
            raise SimulationError(
                f"log={os.fspath(path)!r} must end in .npy, or be a function that takes chunks"
            )
        self._write(os.O_WRONLY | os.O_CREAT | os.O_TRUNC, b"")

    def _header(self, events: int) -> bytes:
        header = io.BytesIO()
        description = {"descr": self.dtype.descr, "fortran_order": False, "shape": (events,)}
        np.lib.format.write_array_header_1_0(header, description)  # type: ignore[no-untyped-call]
        return header.getvalue()

    def _write(self, flags: int, data: bytes) -> None:
        """Append data, then update the header. After a failed write the log is closed: it has no gaps."""
        if self._failure:
            raise SimulationError(self._failure)
        written = self.written + len(data) // self.dtype.itemsize
        header = self._header(written)
        try:
            file = os.open(self._place, flags | getattr(os, "O_BINARY", 0), 0o666)
            try:
                for start, content in ((len(header) + self.written * self.dtype.itemsize, data), (0, header)):
                    os.lseek(file, start, os.SEEK_SET)
                    while content:
                        content = content[os.write(file, content) :]
            finally:
                os.close(file)
        except OSError as error:
            self._failure = (
                f"the log {self.path} cannot be written: {error.strerror}; "
                f"it ends after {self.written} events"
            )
            raise SimulationError(self._failure) from error
        self.written = written

    def __call__(self, events: Events) -> None:
        """Append a chunk."""
        self._write(os.O_WRONLY, events.tobytes())


def sink_of(log: Any, dim: int) -> Sink:
    """Return the receiver of the chunks: a function as it is, for a path a file.

    Raises
    ------
    SimulationError
        If it is neither, or the file cannot be written.
    """
    if callable(log):
        return log  # type: ignore[no-any-return]
    if isinstance(log, (str, os.PathLike)):
        return NpyStream(log, event_dtype(dim))
    raise SimulationError(
        f"log={log!r} must be a path that ends in .npy, or a function that takes chunks of events"
    )
