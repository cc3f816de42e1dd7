"""GSD files in the schema of HOOMD: binary, for OVITO, HOOMD, freud and MDAnalysis. Needs the package gsd.

The schema counts positions from the centre of the box and holds numbers in single precision. So that a scene
comes back bit for bit, our files also have what single precision loses, as `log/particles/exact_...` and
`log/hardspheres/...`, which other programs show or skip. An exact number is taken if, rounded, it is the one
in the schema's own column. Where it is not, somebody has changed the column since: then the column counts,
and a sentence says so. Every axis of a box is periodic in this schema; which are walls is in our part.

A chunk that is equal to that of the first frame is not written again: readers take the first one for it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from hardspheres import __version__
from hardspheres.atoms import SINGLE, VELOCITY, FrameLike, symbols
from hardspheres.checks import inertia
from hardspheres.errors import TrajectoryError
from hardspheres.files.xyz import said

if TYPE_CHECKING:
    from hardspheres.scene import Scene

SUFFIX = ".gsd"
SCHEMA = "hoomd"
SCHEMA_VERSION = (1, 4)  # that of single precision, which every reader knows
OURS, PARTICLES = "log/hardspheres/", "log/particles/"
LABEL = PARTICLES + "label"
EXACT = tuple(f"{PARTICLES}exact_{name}" for name in ("position", "velocity", "radius", "mass"))
UNUSED = ("charge", "body", "moment_inertia", "orientation", "angmom")
TOPOLOGY = ("bonds", "angles", "dihedrals", "impropers", "constraints", "pairs")

Chunks = dict[str, NDArray[Any]]
Floats = NDArray[np.float64]


def package(path: Path) -> Any:
    """Return the package gsd; TrajectoryError where it is not installed."""
    try:
        import gsd.fl
        import gsd.hoomd
    except ImportError:
        raise TrajectoryError(f"{path} needs the package gsd: pip install 'hardspheres[gsd]'") from None
    return gsd


# Writing.


class Writer:
    """Frames to a file, each complete in it when `write` returns.

    Parameters
    ----------
    path : Path
        The file, replaced if it exists.
    append : bool
        Write after the frames that are there.
    """

    def __init__(self, path: Path, append: bool = False) -> None:
        self._file = opened(path, "r+" if append else "w")
        self._first = chunks_of(self._file, 0) if self._file.nframes else {}
        self._labels = LABEL in self._file.find_matching_chunk_names(LABEL)

    def write(self, state: "Scene | FrameLike", units: str | None) -> None:
        """Append a frame."""
        chunks = as_chunks(state, units)
        if self._labels and LABEL not in chunks:  # a chunk left out would count as that of the first frame
            chunks[LABEL] = np.zeros(len(chunks["particles/position"]), dtype=np.int64)
        self._labels = LABEL in chunks
        for name, chunk in chunks.items():
            if not _same(self._first.get(name), chunk):
                self._file.write_chunk(name, chunk)
        self._file.end_frame()
        self._file.flush()
        self._first = self._first or chunks

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _same(one: Any, two: NDArray[Any]) -> bool:
    return one is not None and one.dtype == two.dtype and np.array_equal(one, two)


def as_chunks(state: "Scene | FrameLike", units: str | None = None) -> Chunks:
    """Return all that is written of a frame, by name.

    Raises
    ------
    TrajectoryError
        When a number is not finite, or leaves the range of single precision.
    """
    scene: Scene = getattr(state, "scene", state)  # type: ignore[arg-type]
    exact = {"position": state.positions, "velocity": state.velocities, "radius": scene.radii}
    exact["mass"] = inertia(scene.masses)  # obstacles have mass 0: infinity is for no file
    if not all(np.isfinite(array).all() for array in exact.values()):
        raise TrajectoryError("a number is not finite; a file with it could not be read back")
    names = list(dict.fromkeys(symbols(scene)))
    width = max(map(len, names)) + 1
    letters = np.array([name.encode() for name in names], dtype=f"S{width}")
    kinds = np.array([names.index(symbol) for symbol in symbols(scene)], dtype=np.uint32)
    chunks = rounded(state.positions, state.velocities, scene.radii, exact["mass"], scene.box, scene.periodic)
    chunks |= {
        "configuration/step": np.array([getattr(state, "collisions", 0)], dtype=np.uint64),
        "configuration/dimensions": np.array([scene.dim], dtype=np.uint8),
        "particles/N": np.array([scene.n], dtype=np.uint32),
        "particles/types": letters.view(np.int8).reshape(len(names), width),
        "particles/typeid": kinds[scene.species],
        OURS + "time": np.array([getattr(state, "time", 0.0)], dtype=np.float64),
        OURS + "box": scene.box,
        OURS + "periodic": scene.periodic.astype(np.uint8),
        OURS + "labelled": np.array([scene.labels is not None], dtype=np.uint8),
    }
    chunks |= {f"{PARTICLES}exact_{name}": np.ascontiguousarray(array) for name, array in exact.items()}
    if scene.labels is not None:
        chunks[LABEL] = scene.labels
    if units is not None:
        chunks[OURS + "units"] = np.frombuffer(units.encode(), np.uint8)
    if getattr(state, "unwound", None) is not None:
        crossed = np.rint((state.unwrapped_positions - state.positions) / scene.box)  # type: ignore[union-attr]
        if np.abs(crossed).max() < np.iinfo(np.int32).max:
            chunks["particles/image"] += _three(crossed).astype(np.int32)
    return chunks


def rounded(
    positions: Floats,
    velocities: Floats,
    radii: Floats,
    masses: Floats,
    box: Floats,
    periodic: NDArray[np.bool_],
) -> Chunks:
    """Return the columns of the schema that are rounded to single precision, and images of what was wrapped.

    Raises
    ------
    TrajectoryError
        When a number leaves the range of single precision.
    """
    with np.errstate(over="ignore", under="ignore"):
        edges = box.astype(np.float32)
        places = (positions - 0.5 * box).astype(np.float32)
        wraps = periodic & (places >= np.float32(0.5) * edges)  # the upper face is the lower one
        chunks = {
            "configuration/box": np.array([*edges, *[0] * (6 - len(edges))], dtype=np.float32),
            "particles/position": _three(np.where(wraps, np.float32(-0.5) * edges, places)),
            "particles/velocity": _three(velocities.astype(np.float32)),
            "particles/diameter": (2.0 * radii).astype(np.float32),
            "particles/mass": masses.astype(np.float32),
            "particles/image": _three(wraps.astype(np.int32)),
        }
    tiny = np.finfo(np.float32).tiny
    positive = [edges, chunks["particles/diameter"], chunks["particles/mass"][masses > 0.0]]
    if not all(np.isfinite(chunk).all() for chunk in chunks.values()) or min(map(np.min, positive)) < tiny:
        raise TrajectoryError(
            "a length, speed or mass leaves the range of single precision, which .gsd has; write .xyz, or "
            "choose other units"
        )
    return chunks


def _three(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return vectors with z = 0 where there is none."""
    return np.ascontiguousarray(
        np.hstack([vectors, np.zeros((len(vectors), 3 - vectors.shape[1]), vectors.dtype)])
    )


def keep_frames(path: Path, copy: Path, count: int) -> int:
    """Copy the first frames of a file if it has so many, and return how many whole ones it has."""
    with Reader(path) as old:
        there = len(old)
        if there < count:
            return there
        with opened(copy, "w") as new:
            for frame in range(count):
                for name, chunk in old.chunks(frame).items():
                    new.write_chunk(name, chunk)
                new.end_frame()
    return there


# Reading.


class Reader:
    """The frames of a file as structures.

    Raises
    ------
    TrajectoryError
        When it is no GSD file of HOOMD's schema, or is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path, module = path, package(path)
        with _told(path):
            self._file = opened(path, "r")
            self._trajectory = module.hoomd.HOOMDTrajectory(self._file)

    def __len__(self) -> int:
        return int(self._file.nframes)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def chunks(self, index: int) -> Chunks:
        """Return the chunks that stand in a frame."""
        with _told(self._path):
            return chunks_of(self._file, index)

    def structure(self, index: int) -> tuple[Any, list[str]]:
        """Return a frame as an Atoms object, and sentences about what was changed or is not used."""
        with _told(self._path):
            frame = self._trajectory[index]
            if not frame.particles.N:
                raise TrajectoryError(f"{self._path} holds no particles in frame {index}")
            return _structure(frame, self._given(index))

    def __iter__(self) -> Iterator[tuple[Any, list[str]]]:
        return map(self.structure, range(len(self)))

    def _given(self, index: int) -> set[str]:
        """Return the names of the chunks that this frame or the first one has."""
        names = self._file.find_matching_chunk_names("")
        return {name for name in names if any(self._file.chunk_exists(k, name) for k in {0, index})}


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn whatever a damaged file makes the package raise into one sentence."""
    try:
        yield
    except TrajectoryError:
        raise
    except Exception as error:  # it fails in its own ways
        why = said(error).split(" in: ")[0].replace(str(path), path.name)
        raise TrajectoryError(
            f"{path} cannot be read as a trajectory of HOOMD ({why}); it is damaged, cut short or of another "
            "format"
        ) from error


def opened(path: Path, mode: str) -> Any:
    """Open a file of the schema by the package's own lower layer, chunk by chunk."""
    return package(path).fl.open(str(path), mode, f"hardspheres {__version__}", SCHEMA, list(SCHEMA_VERSION))


def chunks_of(file: Any, frame: int) -> Chunks:
    """Return the chunks that stand in a frame."""
    names = [name for name in file.find_matching_chunk_names("") if file.chunk_exists(frame, name)]
    return {name: file.read_chunk(frame, name) for name in names}


def _structure(frame: Any, given: set[str]) -> tuple[Any, list[str]]:
    """Return a frame as an Atoms object; the chunks not `given` have the defaults of the schema."""
    from ase import Atoms
    from ase.data import atomic_numbers

    parts, log, dim = frame.particles, frame.log, int(frame.configuration.dimensions)
    (columns, notes), exact, ours = _columns(frame, given), _exact(frame), not given.isdisjoint(EXACT)
    numbers = columns | exact
    elements = all(name in atomic_numbers for name in parts.types)
    kinds = np.array([atomic_numbers[name if elements else SINGLE] for name in parts.types])
    atoms: Any = Atoms(
        kinds[parts.typeid], numbers["positions"], cell=numbers["box"], masses=numbers["masses"]
    )
    atoms.set_array("radius", numbers["radii"], float, ())
    atoms.set_pbc(True)
    if not elements:
        atoms.set_array("labels", np.array(parts.types)[parts.typeid])
    if ours or "particles/velocity" in given:
        atoms.set_momenta(numbers["masses"][:, None] * numbers["velocities"])
        atoms.set_array(VELOCITY, numbers["velocities"], float, (3,))
    if ours:
        atoms.set_pbc([*(log["hardspheres/periodic"] == 1), *[False] * (3 - dim)])
        atoms.info |= {"time": float(log["hardspheres/time"][0]), "collisions": int(frame.configuration.step)}
        if "hardspheres/units" in log:
            atoms.info["units"] = log["hardspheres/units"].tobytes().decode()
        changed = [name for name in columns if name not in exact]
        if changed:
            notes.append(f"changed since this package wrote them, so less exact: {', '.join(changed)}")
    if ours or dim == 2:
        atoms.info["dimension"] = dim
    if parts.position.dtype == np.float32 and not {"positions", "radii", "box"} <= exact.keys():
        atoms.info["precision"] = "single"
    labels = log.get("particles/label")
    if np.shape(labels) == (len(atoms),) and log.get("hardspheres/labelled", [1])[0]:
        atoms.set_array("label", labels)
    return atoms, notes


def _columns(frame: Any, given: set[str]) -> tuple[dict[str, Floats], list[str]]:
    """Return the columns of the schema, with positions from the corner of the box, and what is not used."""
    parts, notes = frame.particles, []
    lx, ly, lz, xy, xz, yz = np.asarray(frame.configuration.box, dtype=np.float64)
    cell = np.array([[lx, 0, 0], [xy * ly, ly, 0], [xz * lz, yz * lz, lz]])
    diameters = np.asarray(parts.diameter, dtype=np.float64)
    if "particles/diameter" not in given:
        shapes = [shape.get("diameter") for shape in parts.type_shapes]
        if len(shapes) == len(parts.types) and None not in shapes:  # as HOOMD's hard spheres are written
            diameters = np.array(shapes, dtype=np.float64)[parts.typeid]
        elif given.isdisjoint(EXACT):
            notes.append("there are no diameters, so that of the format is taken, 1 (--radius gives others)")
    unused = [name for name in UNUSED if f"particles/{name}" in given]
    unused += [name for name in TOPOLOGY if getattr(frame, name).N]
    unused += sorted(name for name in given if name.startswith(PARTICLES) and name not in (*EXACT, LABEL))
    if unused:
        notes.append("not used: " + ", ".join(unused))
    columns = {
        "positions": parts.position + 0.5 * cell.sum(axis=0),
        "velocities": np.asarray(parts.velocity, dtype=np.float64),
        "radii": 0.5 * diameters,
        "masses": np.asarray(parts.mass, dtype=np.float64),
        "box": cell,
    }
    return columns, notes


def _exact(frame: Any) -> dict[str, Floats]:
    """Return the exact numbers, of a file of ours, that still are its columns once they are rounded."""
    parts, log, found = frame.particles, frame.log, {}
    n, dim = int(parts.N), int(frame.configuration.dimensions)
    own = [log.get(name.removeprefix("log/")) for name in (*EXACT, OURS + "box", OURS + "periodic")]
    if [np.shape(array) for array in own] != [(n, dim), (n, dim), (n,), (n,), (dim,), (dim,)]:
        return {}
    positions, velocities, radii, masses, box, periodic = own
    again = rounded(positions, velocities, radii, masses, box, periodic == 1)

    def holds(name: str, column: Any) -> bool:
        return np.array_equal(np.asarray(column, dtype=np.float32), again[name])

    if holds("configuration/box", frame.configuration.box):
        found["box"] = np.diag([*box, *[0.0] * (3 - dim)])
        if holds("particles/position", parts.position):
            found["positions"] = _three(positions)
    if holds("particles/velocity", parts.velocity):
        found["velocities"] = _three(velocities)
    if holds("particles/diameter", parts.diameter):
        found["radii"] = radii
    if holds("particles/mass", parts.mass):
        found["masses"] = masses
    return found
