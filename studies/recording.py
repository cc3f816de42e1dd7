"""What looks at a run and keeps what it saw: a trajectory in a file, or frames of a film."""

from __future__ import annotations

import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.brief import brief
from analysis.velocities import reduced_velocities
from hardspheres.temporary import replacing

__all__ = ["Film", "Recorder", "Trajectory"]


class Recorder(ABC):
    """Takes frames of one run, and can be saved between any two: subclasses are dataclasses."""

    @abstractmethod
    def add(self, frame: hs.Frame) -> None:
        """Take the next frame."""

    @contextmanager
    def recording(self, folder: Path) -> Iterator[None]:
        """Hold open what is written into a folder while frames come."""
        yield


@dataclass
class Trajectory(Recorder):
    """Writes every frame to a file of the folder, `FILE`.

    Attributes
    ----------
    written : int
        Whole frames in the file; what a killed run wrote after them is cut off.
    """

    FILE = "trajectory.xyz"

    written: int = 0
    _writer = None  # while frames come; no field, so it is not saved

    def add(self, frame: hs.Frame) -> None:
        """Write the next frame."""
        if self._writer is None:
            raise RuntimeError("frames can be added within recording(folder) only")
        self._writer.write(frame)
        self.written += 1

    @contextmanager
    def recording(self, folder: Path) -> Iterator[None]:
        """Hold the file open, after the frames that have been written."""
        path = folder / self.FILE
        if self.written:  # a process that was taken for dead may write on into the old file
            with replacing(path) as copy:
                shutil.copyfile(path, copy)
        with hs.TrajectoryWriter(path, keep=self.written) as self._writer:
            try:
                yield
            finally:
                self._writer = None


@dataclass
class Film(Recorder):
    """Keeps what an animation shows.

    Attributes
    ----------
    s : list of float
        Collisions per particle of each frame.
    positions, speeds : lists of (N, d) and (N,) arrays
        Positions, and speeds in thermal speeds.
    """

    s: list[float] = field(default_factory=list)
    positions: list[NDArray[np.float32]] = field(default_factory=list)
    speeds: list[NDArray[np.float32]] = field(default_factory=list)

    __repr__ = brief

    def add(self, frame: hs.Frame) -> None:
        """Keep the next frame."""
        self.s.append(frame.collisions_per_particle)
        self.positions.append(frame.positions.astype(np.float32))
        self.speeds.append(np.linalg.norm(reduced_velocities(frame)[0], axis=1).astype(np.float32))
