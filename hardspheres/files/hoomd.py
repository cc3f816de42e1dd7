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
from hardspheres.errors import TrajectoryError
from hardspheres.files.xyz import said

if TYPE_CHECKING:
    from hardspheres.scene import Scene

SUFFIX = ".gsd"
SCHEMA = "hoomd"
SCHEMA_VERSION = (1, 4)  # that of single precision, which every reader knows
OURS, PARTICLES = "log/hardspheres/", "log/particles/"
LABEL = PARTICLES + "label"
ROUNDED = ("position", "velocity", "diameter", "mass")
EXACT = tuple(f"{PARTICLES}exact_{name}" for name in ("position", "velocity", "radius", "mass"))
OWN = (*EXACT, LABEL)
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
        raise TrajectoryError(
            f"{path} needs the package gsd, which is not installed: pip install 'hardspheres[gsd]'"
        ) from None
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
    exact["mass"] = scene.masses
    if not all(np.isfinite(array).all() for array in exact.values()):
        raise TrajectoryError("a number is not finite; a file with it could not be read back")
    names = list(dict.fromkeys(symbols(scene)))
    width = max(map(len, names)) + 1
    letters = np.array([name.encode() for name in names], dtype=f"S{width}")
    kinds = np.array([names.index(symbol) for symbol in symbols(scene)], dtype=np.uint32)
    chunks = rounded(state.positions, state.velocities, scene.radii, scene.masses, scene.box, scene.periodic)
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
    positive = [edges, chunks["particles/diameter"], chunks["particles/mass"]]
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
    """Copy the first frames of a file, and return how many whole ones it has."""
    with Reader(path) as old:
        there = len(old)
        if there >= count:
            new = opened(copy, "w")
            for frame in range(count):
                for name, chunk in chunks_of(old.file, frame).items():
                    new.write_chunk(name, chunk)
                new.end_frame()
            new.close()
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
        self.path = path
        self.file = opened(path, "r")
        with _told(path):
            self._trajectory = package(path).hoomd.HOOMDTrajectory(self.file)

    def __len__(self) -> int:
        return int(self.file.nframes)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def structure(self, index: int) -> tuple[Any, list[str]]:
        """Return a frame as an Atoms object, and sentences about what was changed or is not used."""
        with _told(self.path):
            frame = self._trajectory[index]
            if not frame.particles.N:
                raise TrajectoryError(f"{self.path} holds no particles in frame {index}")
            return _structure(frame, self._given(index))

    def __iter__(self) -> Iterator[tuple[Any, list[str]]]:
        return map(self.structure, range(len(self)))

    def _given(self, index: int) -> set[str]:
        """Return the names of the chunks that this frame or the first one has."""
        names = self.file.find_matching_chunk_names("")
        return {name for name in names if any(self.file.chunk_exists(k, name) for k in {0, index})}


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn whatever a damaged file makes the package raise into one sentence."""
    try:
        yield
    except TrajectoryError:
        raise
    except Exception as error:  # it fails in its own ways
        raise TrajectoryError(
            f"{path} cannot be read as a GSD file of HOOMD's schema ({said(error)}); it is damaged, cut "
            "short or of another format"
        ) from error


def opened(path: Path, mode: str) -> Any:
    """Open a file of the schema by the package's own layer; OSError where the system refuses."""
    gsd, version = package(path), list(SCHEMA_VERSION)
    try:
        return gsd.fl.open(str(path), mode, f"hardspheres {__version__}", SCHEMA, version)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error)) from error
    except Exception:
        with _told(path):
            raise


def chunks_of(file: Any, frame: int) -> Chunks:
    """Return the chunks that stand in a frame."""
    names = [name for name in file.find_matching_chunk_names("") if file.chunk_exists(frame, name)]
    return {name: file.read_chunk(frame, name) for name in names}


def _structure(frame: Any, given: set[str]) -> tuple[Any, list[str]]:
    """Return a frame as an Atoms object; the chunks not `given` have the defaults of the schema."""
    from ase import Atoms
    from ase.data import atomic_numbers

    parts, log, dim = frame.particles, frame.log, int(frame.configuration.dimensions)
    columns, notes = _columns(frame, given)
    exact = _exact(frame)
    changed = [name for name in columns if exact and name not in exact]
    if changed:
        notes.append(
            f"changed since they were written exactly, so read in single precision: {', '.join(changed)}"
        )
    numbers = columns | exact
    names = np.array(parts.types)
    elements = all(name in atomic_numbers for name in parts.types)
    kinds = np.array([atomic_numbers[name if elements else SINGLE] for name in parts.types])
    atoms: Any = Atoms(
        kinds[parts.typeid], numbers["positions"], cell=numbers["box"], pbc=True, masses=numbers["masses"]
    )
    if not elements:
        atoms.set_array("labels", names[parts.typeid])
    if exact:
        atoms.set_pbc(_three(log["hardspheres/periodic"][None])[0] == 1)
        atoms.info |= {"time": float(log["hardspheres/time"][0]), "collisions": int(frame.configuration.step)}
        if "hardspheres/units" in log:
            atoms.info["units"] = log["hardspheres/units"].tobytes().decode()
    if exact or dim == 2:
        atoms.info["dimension"] = dim
    if len(exact) < len(columns) and parts.position.dtype == np.float32:
        atoms.info["precision"] = "single"
    if exact or "particles/velocity" in given:
        atoms.set_momenta(numbers["masses"][:, None] * numbers["velocities"])
        atoms.set_array(VELOCITY, numbers["velocities"], float, (3,))
    atoms.set_array("radius", numbers["radii"], float, ())
    if "particles/label" in log and log.get("hardspheres/labelled", [1])[0]:
        atoms.set_array("label", log["particles/label"])
    return atoms, notes


def _columns(frame: Any, given: set[str]) -> tuple[dict[str, Floats], list[str]]:
    """Return the columns of the schema, with positions from the corner of the box, and what is not used."""
    parts = frame.particles
    lx, ly, lz, xy, xz, yz = np.asarray(frame.configuration.box, dtype=np.float64)
    cell = np.array([[lx, 0, 0], [xy * ly, ly, 0], [xz * lz, yz * lz, lz]])
    diameters, notes = np.asarray(parts.diameter, dtype=np.float64), []
    if "particles/diameter" not in given:
        shapes = [shape.get("diameter") for shape in parts.type_shapes]
        if len(shapes) == len(parts.types) and None not in shapes:  # as HOOMD's hard spheres are written
            diameters = np.array(shapes, dtype=np.float64)[parts.typeid]
        elif not any(name.startswith(PARTICLES + "exact") for name in given):
            notes.append(
                "there are no diameters, so the default of the format is taken, 1 (--radius gives others)"
            )
    columns = {
        "positions": parts.position + 0.5 * cell.sum(axis=0),
        "velocities": np.asarray(parts.velocity, dtype=np.float64),
        "radii": 0.5 * diameters,
        "masses": np.asarray(parts.mass, dtype=np.float64),
        "box": cell,
    }
    unused = [name for name in UNUSED if f"particles/{name}" in given]
    unused += [name for name in TOPOLOGY if getattr(frame, name).N]
    unused += [name for name in sorted(given) if name.startswith(PARTICLES) and name not in OWN]
    return columns, [*notes, *(["not used: " + ", ".join(unused)] if unused else [])]


def _exact(frame: Any) -> dict[str, Floats]:
    """Return the exact numbers, of a file of ours, that still are its columns once they are rounded."""
    parts, log, n = frame.particles, frame.log, int(frame.particles.N)
    dim = int(frame.configuration.dimensions)
    names = ("hardspheres/box", "hardspheres/periodic", "hardspheres/time")
    shapes: dict[str, tuple[int, ...]] = {f"particles/exact_{name}": (n,) for name in ("radius", "mass")}
    shapes |= {f"particles/exact_{name}": (n, dim) for name in ("position", "velocity")}
    shapes |= dict(zip(names, [(dim,), (dim,), (1,)], strict=True))
    if any(np.shape(log.get(name)) != shape for name, shape in shapes.items()):
        return {}
    x, v, radii, masses = (
        log[f"particles/exact_{name}"] for name in ("position", "velocity", "radius", "mass")
    )
    box, periodic, _ = (log[name] for name in names)
    again = rounded(x, v, radii, masses, box, periodic == 1)
    edges, (columns, ours) = frame.configuration.box, (vars(parts), {})
    same = {name: np.array_equal(np.float32(columns[name]), again[f"particles/{name}"]) for name in ROUNDED}
    if np.array_equal(np.float32(edges), again["configuration/box"]):
        ours["box"] = np.diag(_three(box[None])[0])
        if same["position"]:
            ours["positions"] = _three(x)
    if same["velocity"]:
        ours["velocities"] = _three(v)
    if same["diameter"]:
        ours["radii"] = radii
    if same["mass"]:
        ours["masses"] = masses
    return ours
