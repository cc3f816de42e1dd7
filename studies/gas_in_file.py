"""The gas in a trajectory of any program, read frame by frame, with what the file lacks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.correlation_times import MeasuredCollisions
from hardspheres.atoms import has_velocities, scene_and_notes
from hardspheres.columns import find
from hardspheres.files import Reading, structures
from studies.fluid import kind_of

__all__ = ["GasInFile"]

POINT = 1e-6  # diameter of a particle of unknown radius, in mean distances
SAME = 1e-6  # relative difference of masses, radii and edges that is taken for rounding


class GasInFile:
    """Frames of a file, one after another: `frames` reads them, and the attributes tell what was there.

    Parameters
    ----------
    path : str
        Any file that ASE reads.
    reading : Reading
        How to interpret it; a radius of 0 stands for points.

    Attributes
    ----------
    scene : Scene
        The first frame, in a box and with radii that mean nothing where the file has none.
    points : bool
        Whether the user takes all particles as points.
    moving, boxed, sized : bool
        Whether there are velocities, a box, and radii.
    at_rest : bool
        Whether there are velocities, and all of them are zero.
    steady : bool
        Whether the box is the same in all frames.
    n_frames : int
        How many frames there were.
    notes : list of str
        What was changed or not used, once each.
    clock : MeasuredCollisions
        How far velocities decorrelate between frames.
    """

    def __init__(self, path: str, reading: Reading) -> None:
        self.path, self.points = path, isinstance(reading.radius, (int, float)) and not reading.radius
        self._reading = replace(reading, radius=None) if self.points else reading
        self.moving = self.boxed = self.sized = False
        self.steady, self.at_rest = True, False
        self.notes: list[str] = []
        self.clock = MeasuredCollisions()
        self._scene: hs.Scene | None = None
        self._times: list[float] = []

    @property
    def scene(self) -> hs.Scene:
        """The first frame."""
        assert self._scene is not None
        return self._scene

    @property
    def n_frames(self) -> int:
        """Number of frames read."""
        return len(self._times)

    @property
    def times(self) -> NDArray[np.float64] | None:
        """Times of all frames; None where the file has none, or they do not increase."""
        found = np.array(self._times)
        return found if len(found) < 2 or bool(np.all(np.diff(found) > 0.0)) else None

    # What a study wants to know of a gas.

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.scene.n

    @property
    def dim(self) -> int:
        """Dimension."""
        return self.scene.dim

    @property
    def packing_fraction(self) -> float:
        """Packing fraction; NaN where it is not known."""
        return float(self.scene.packing_fraction) if self.boxed and self.sized and self.steady else math.nan

    @property
    def kind(self) -> str:
        """Spheres or discs, how many species, and the boundary, in words."""
        words = kind_of(self.scene)
        if not self.sized:
            words = words.replace("hard spheres", "particles in 3D").replace("hard discs", "particles in 2D")
        return words if self.boxed else words.split(",")[0]

    def __str__(self) -> str:
        """Return the gas in words."""
        frames = f"{self.n_frames} frame{'s' * (self.n_frames != 1)}"
        text = f"{Path(self.path).name}: {frames} of {self.n} {self.kind}"
        times = self.times
        if times is not None and len(times) > 1:
            text += f", time {times[0]:.4g} to {times[-1]:.4g}"
        return text

    def __repr__(self) -> str:
        """Return which file it is, and how much of it was read."""
        return f"<GasInFile {self.path}: {self.n_frames} frames read>"

    def frames(self) -> Iterator[hs.Frame]:
        """Yield each frame; its time is its index, and its collisions per particle those of `clock`.

        Raises
        ------
        TrajectoryError, SceneError
            Where the file cannot be read, or the frames are not of one gas.
        """
        for index, (atoms, notes) in enumerate(self._structures()):
            scene, more = self._taken(atoms, index)
            self.notes += [note for note in [*notes, *more] if note not in self.notes]
            if self._scene is None:
                self._scene = scene
            else:
                self._require_same(scene, index)
            time = atoms.info.get("time", math.nan)
            self._times.append(float(time) if isinstance(time, (int, float)) else math.nan)
            s = self.clock.add(self.scene, scene.velocities) if self.moving else float(index)
            yield hs.Frame(float(index), 0, s, scene.positions, scene.velocities, self.scene)
        if self._scene is None:
            raise hs.TrajectoryError(f"{self.path} holds no frame")

    def _structures(self) -> Iterator[tuple[Any, list[str]]]:
        """Yield the frames as they stand; of a file without velocities masses do not matter."""
        frames = structures(self.path, self._reading)
        try:
            first = next(frames, None)
        except hs.TrajectoryError:
            if self._reading.mass is not None or self._reading.units is not None:
                raise
            reading = replace(self._reading, mass=1.0, velocities=False)
            frames = structures(self.path, reading)
            first = next(frames, None)
            if first is None or has_velocities(first[0]):
                raise
            self._reading = reading
        if first is not None:
            yield first
            yield from frames

    def _taken(self, atoms: Any, index: int) -> tuple[hs.Scene, list[str]]:
        """Return the scene of a frame; where box or radii are missing, with some that mean nothing."""
        try:
            columns = find(atoms)
            has = {
                "velocities": has_velocities(atoms)
                and any(
                    np.any(columns[name].values) for name in ("momenta", "velocities") if name in columns
                ),
                "a box": self._reading.box is not None or bool(np.any(atoms.cell)),
                "radii": not self.points
                and (self._reading.radius is not None or bool(columns.keys() & {"radii", "diameters"})),
            }
            before = {"velocities": self.moving, "a box": self.boxed, "radii": self.sized}
            if self._scene is None:
                self.moving, self.boxed, self.sized = has.values()
                self.at_rest = has_velocities(atoms) and not self.moving
            elif has != before:
                odd = next(name for name in has if has[name] != before[name])
                one, other = ("has", "have none") if has[odd] else ("has no", "have them")
                raise hs.TrajectoryError(f"frame {index} {one} {odd}, and those before {other}")
            return scene_and_notes(hs.Scene, atoms, self._completed(atoms))
        except (hs.SceneError, hs.TrajectoryError) as error:
            where = f"{self.path}: " if self.path not in str(error) else ""
            frame = f"frame {index}: " if index and f"frame {index}" not in str(error) else ""
            hint = "; --radius 0 takes all particles as points" if " overlap by " in str(error) else ""
            raise type(error)(f"{where}{frame}{error}{hint}") from error

    def _completed(self, atoms: Any) -> Reading:
        """Return how to read a frame, with a box and a radius where there are none."""
        reading = self._reading
        places = atoms.get_positions()
        dim = int(reading.dim or atoms.info.get("dimension", 3))
        if not self.boxed:
            extent = 4.0 * float(np.ptp(places, axis=0).max(initial=0.0)) + 1.0
            reading = replace(reading, box=(extent,) * dim, boundary=None)
        if not self.sized or not self.boxed:
            edges = np.asarray(reading.box) if reading.box is not None else np.diagonal(atoms.cell.array)
            edges = edges[edges > 0.0] if len(edges) else np.ones(1)
            spacing = float(np.prod(edges) / max(len(atoms), 1)) ** (1.0 / len(edges))
            reading = replace(reading, radius=max(POINT * spacing, 1e-9 * float(edges.max())) / 2.0)
        return reading

    def _require_same(self, scene: hs.Scene, index: int) -> None:
        """Refuse a frame of another gas; notice another box."""
        first = self.scene
        if (scene.n, scene.dim) != (first.n, first.dim):
            raise hs.TrajectoryError(
                f"{self.path}: frame {index} has {scene.n} particles in {scene.dim} dimensions, the first "
                f"has {first.n} in {first.dim}; give a file of one gas, whose particles stay the same"
            )
        if not np.allclose(scene.masses, first.masses, rtol=SAME, atol=0.0):
            raise hs.TrajectoryError(
                f"{self.path}: masses in frame {index} differ from those in the first; give a file in which "
                "every particle keeps its place or has an id"
            )
        if self.sized and not np.allclose(scene.radii, first.radii, rtol=SAME, atol=0.0):
            raise hs.TrajectoryError(
                f"{self.path}: radii in frame {index} differ from those in the first; give a file in which "
                "they stay the same"
            )
        if self.boxed and scene.boundary != first.boundary:
            raise hs.TrajectoryError(
                f"{self.path}: the boundary changes in frame {index}; give one gas at a time"
            )
        if self.boxed and not np.allclose(scene.box, first.box, rtol=SAME, atol=0.0):
            self.steady = False
