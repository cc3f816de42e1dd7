"""Scenes and frames as ASE's Atoms, and back.

An Atoms object holds positions, momenta (mass times velocity; ASE has a unit of its own for velocities, and
none for momenta), masses, radii, box and boundaries, and in ``info`` `time`, `collisions` and `dimension`.
Momentum over mass may differ from the original velocity by a rounding, so the column `Velo` has the
velocities themselves; they are used where their products with the masses equal the momenta bit for bit. A 2D
gas lies in the plane z = 0 and has a zero third cell vector.

**Positions with few digits can overlap.** Two touching spheres whose coordinates were rounded to 8 decimals
(by other programs, and by this one before it wrote all digits) may end up 2.8e-8 too close (each of the 3
separations off by 1e-8, each radius by 5e-9). So `Scene.from_atoms` treats overlaps up to 3e-8 as rounding:
it reduces all radii by half of the worst overlap, logs a warning, and moves nothing. Larger ones are refused
as in any scene. Without any overlap, or with no more than the engine itself leaves at a contact (1e-11
diameters), every bit is as given.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres.cells import worst_overlap
from hardspheres.checks import (
    boundary_words,
    contact_tolerance,
    inertia,
    one_per_particle,
    worst_beyond_wall,
)
from hardspheres.columns import AGREE, NAMES, Found, find, unused
from hardspheres.errors import SceneError, TrajectoryError

if TYPE_CHECKING:
    from hardspheres.scene import Scene

Floats = NDArray[np.float64]

SINGLE = "X"  # ASE's unknown element, of mass 1
MIXTURE = (
    "O",
    "N",
    "S",
    "Cl",
    "I",
    "C",
    "P",
    "F",
    "B",
    "H",
)  # colours that differ in OVITO and ASE: red, blue, yellow...
VELOCITY = (
    "Velo"  # OVITO knows this spelling, and no reader tested takes it for Angstrom/fs, as one does "velo"
)
PRINTED = 1.5e-8  # most by which a radius is reduced: half of the overlap that 8 decimals can make
SINGLE_PRECISION = 2.0**-23  # the same of single precision, over the longest edge (see `_fitting`)
SMALL = 1e-4  # and never by more than this fraction of the smallest radius
LEFT = 1e-11  # largest overlap that the engine leaves, in diameters (`Simulation.check`)
FLAT = 1e-6  # tolerance for discs out of their plane, in smallest diameters and fastest speeds (--dim 2)
UNITS = ("reduced", "ase")
KEYS = {
    "lattice": "Lattice",
    "pbc": "pbc",
    "properties": "Properties",
}  # units in ASE's spelling

logger = logging.getLogger(__name__)


class FrameLike(Protocol):
    """What a writer needs of a frame: `hardspheres.Frame` has it."""

    @property
    def time(self) -> float:
        """Simulated time."""

    @property
    def collisions(self) -> int:
        """Pair collisions so far."""

    @property
    def positions(self) -> Floats:
        """Positions, (N, d)."""

    @property
    def velocities(self) -> Floats:
        """Velocities, (N, d)."""

    @property
    def scene(self) -> "Scene":
        """Radii, masses, species, box and boundary."""


@dataclass(frozen=True)
class Reading:
    """How to interpret a file where its content is ambiguous.

    Attributes
    ----------
    radius, mass : float, (N,) array_like or mapping, optional
        Of all particles, of each, or of each label (``{"A": 0.5, "B": 0.3}``), whatever the file has.
    units : {"reduced", "ase"}, optional
        "reduced": numbers as in the file, which is also needed for a column of velocities; "ase": as ASE
        converts those of formats with units (Angstrom, u, eV).
    box : (d,) array_like, optional
        Edges, for a file without a cell.
    boundary : str or sequence of str, optional
        Of `box`: as in `Scene`, periodic by default.
    dim : int, optional
        2: the file is of discs, whatever its third edge; positions may leave the plane by 1e-6 of the
        smallest diameter, velocities by 1e-6 of the fastest.
    velocities : bool
        False to ignore those of the file.
    """

    radius: ArrayLike | Mapping[str, float] | None = None
    mass: ArrayLike | Mapping[str, float] | None = None
    units: str | None = None
    box: ArrayLike | None = None
    boundary: str | Sequence[str] | None = None
    dim: int | None = None
    velocities: bool = True

    def __post_init__(self) -> None:
        if self.units not in (None, *UNITS):
            raise TrajectoryError(f"units are {self.units!r}; they must be reduced or ase")
        if self.dim not in (None, 2, 3):
            raise TrajectoryError(f"dim is {self.dim!r}; it must be 2 or 3")
        if self.boundary is not None and self.box is None:
            raise TrajectoryError(
                "a boundary goes with a box (--boundary with --box); a file with a cell has its own"
            )


def to_atoms(state: "Scene | FrameLike", units: str | None = None) -> Any:
    """Return a scene or a frame as an ASE Atoms object.

    Parameters
    ----------
    state : Scene or Frame
        What to convert. A scene counts as time 0.
    units : str, optional
        Name of the units, for ``info["units"]``: a label only, nothing is converted.

    Returns
    -------
    ase.Atoms
        Positions, momenta, masses, cell and pbc; radii in ``arrays["radius"]`` and, since ASE's ``.traj``
        drops that array, in ``info["radius"]`` once it is written there; velocities in ``arrays["Velo"]``;
        labels as tags, where there are some; `time`, `collisions`, `dimension` in ``info``. All particles are
        ``X`` where there is one species; up to ten species are called O, N, S, Cl, I, C, P, F, B, H in the
        order of `Scene.species` (colours only, the masses are the scene's); of more than ten all are ``X``.
        Obstacles have mass 0 and momentum 0 there, as files and ASE have no infinite mass; a mass of 0 is
        read as an obstacle's.
    """
    from ase import Atoms
    from ase.data import atomic_numbers

    scene: Scene = getattr(state, "scene", state)  # type: ignore[arg-type]
    time, collisions = (getattr(state, name, 0) for name in ("time", "collisions"))
    flat = np.zeros((scene.n, 3 - scene.dim))
    cell = np.zeros(3)
    cell[: scene.dim] = scene.box
    atoms: Any = Atoms(
        numbers=np.array([atomic_numbers[symbol] for symbol in symbols(scene)])[scene.species],
        positions=np.hstack([state.positions, flat]),
        cell=cell,
        pbc=[*scene.periodic.tolist(), *[False] * (3 - scene.dim)],
        masses=inertia(scene.masses),
        momenta=np.hstack([inertia(scene.masses)[:, None] * state.velocities, flat]),
        info={"time": float(time), "collisions": int(collisions), "dimension": scene.dim},
    )
    if units is not None:
        atoms.info["units"] = units
    if scene.labels is not None:
        atoms.set_tags(scene.labels)
    atoms.set_array("radius", scene.radii, float, ())
    atoms.set_array(VELOCITY, np.hstack([state.velocities, flat]), float, (3,))
    return atoms


def symbols(scene: "Scene") -> tuple[str, ...]:
    """Return what each species is called in files."""
    kinds = int(scene.species.max()) + 1
    return MIXTURE[:kinds] if 1 < kinds <= len(MIXTURE) else (SINGLE,) * kinds


def has_velocities(atoms: Any) -> bool:
    """Whether an Atoms object carries velocities or momenta (all zero counts: a gas at rest)."""
    return bool(find(atoms).keys() & {"momenta", "velocities"})


def scene_of(kind: "type[Scene]", atoms: Any, reading: Reading) -> "Scene":
    """Return the scene in an Atoms object; everything that was changed or not used is logged as a warning."""
    scene, notes = scene_and_notes(kind, atoms, reading)
    for note in notes:
        logger.warning(note)
    return scene


def scene_and_notes(kind: "type[Scene]", atoms: Any, reading: Reading) -> "tuple[Scene, list[str]]":
    """Return the scene in an Atoms object, and a sentence about everything that was changed or not used.

    Parameters
    ----------
    kind : type
        `Scene`, which this module cannot import: a scene has the methods `to_atoms` and `from_atoms`.
    atoms : ase.Atoms
        See `Scene.from_atoms`.
    reading : Reading
        How to interpret what is ambiguous.

    Raises
    ------
    TrajectoryError, SceneError
        As `Scene.from_atoms` does.
    """
    atoms = _in_order(atoms)
    found = find(atoms)
    read = [found[quantity].names for quantity in ("id", "species", "labels") if quantity in found]
    used = {name for names in read for name in names}
    used |= {name for name, values in atoms.arrays.items() if name == "tags" and not values.any()}
    notes: list[str] = []
    box, boundary = _box(atoms, reading)
    dim = len(box)
    positions = atoms.get_positions() - _origin(atoms)
    masses = _masses(atoms, found, reading, used, notes)
    velocities = _velocities(atoms, found, masses, reading, used)
    radii = _radii(atoms, found, reading, used)
    left_out = unused(atoms, used)
    if left_out:
        notes.append("not used: " + ", ".join(f'column "{name}"' for name in left_out))
    if atoms.constraints:
        notes.append("not used: constraints (move_mask); every particle moves")
    plane = ""
    if dim == 2:
        _require_flat(positions, velocities, FLAT if reading.dim == 2 else 0.0, radii)
    elif reading.dim is None and len(atoms) > 1 and _leaving(positions, velocities, FLAT, radii) is None:
        plane = "all particles stay in one plane along z: if they are discs, say so with --dim 2 (dim=2)"
        notes.append(plane)
    positions, velocities = np.array(positions[:, :dim]), np.array(velocities[:, :dim])
    rounding = SINGLE_PRECISION * float(box.max()) if atoms.info.get("precision") == "single" else PRINTED
    periodic = np.array([word == "periodic" for word in boundary])
    fixed = np.isinf(masses)
    make, reduced = _fitting(kind, positions, radii, box, periodic, fixed, max(rounding, PRINTED))
    if reduced is not radii:
        less = float((radii - reduced).max())
        notes.append(f"all radii made smaller by {less:.3g}, so that rounded positions do not overlap")
    labels = found["labels"].values if "labels" in found else None
    try:
        return make(positions, velocities, reduced, masses, box, boundary, labels), notes
    except SceneError as error:
        raise (SceneError(f"{error}; {plane}") if plane else error) from None


def _in_order(atoms: Any) -> Any:
    """Return the particles in the order of their ids, if they have some."""
    ids = [values for name, values in atoms.arrays.items() if str(name).lower() in NAMES["id"]]
    if not ids or ids[0].ndim != 1 or ids[0].dtype.kind not in "iu":
        return atoms
    ordered = atoms[np.argsort(ids[0], kind="stable")]
    ordered.calc = atoms.calc
    return ordered


def _box(atoms: Any, reading: Reading) -> tuple[Floats, tuple[str, ...]]:
    """Edge lengths of an orthogonal cell, and a word for each boundary; their number is the dimension."""
    for name in atoms.info:
        if str(name).lower() in KEYS and name not in (*KEYS.values(), "dimension"):
            raise TrajectoryError(
                f'the header has "{name}", which is not read; write {KEYS[str(name).lower()]}'
            )
    cell = np.array(atoms.cell.array if hasattr(atoms.cell, "array") else atoms.cell, dtype=np.float64)
    dimension = _dimension(atoms, reading)
    if reading.box is not None:
        return _own_box(cell, dimension, reading)
    edges: Floats = np.diagonal(cell).copy()
    if not cell.any():
        raise TrajectoryError(
            "there is no cell; give the box as an orthogonal cell (in extended xyz: Lattice=...), or as "
            "box=... (--box 10,10,10)"
        )
    if not np.isfinite(cell).all():
        raise TrajectoryError("the cell has an entry that is not finite; give an orthogonal cell")
    if np.any(np.abs(cell - np.diag(edges)) > 1e-12 * np.abs(edges).max()):
        raise TrajectoryError(
            f"the cell is not orthogonal along x, y, z (its vectors are {cell.tolist()}); only boxes with "
            "right angles work"
        )
    dim = dimension or (2 if edges[2] == 0 else 3)
    if np.any(edges[:dim] <= 0):
        raise TrajectoryError(f"the cell has edges {edges.tolist()}; all {dim} of them must be positive")
    return edges[:dim], tuple("periodic" if wraps else "wall" for wraps in atoms.pbc[:dim])


def _dimension(atoms: Any, reading: Reading) -> int | None:
    """Dimension that the header or the user gives."""
    given = next((value for name, value in atoms.info.items() if str(name).lower() == "dimension"), None)
    if given is None:
        return reading.dim
    number = np.asarray(given)
    if number.ndim or number.dtype.kind not in "iuf" or number not in (2, 3):
        words = " ".join(map(str, np.atleast_1d(number).ravel().tolist()))
        shown = words if number.ndim == 0 and not isinstance(given, str) else repr(words)
        raise TrajectoryError(f"dimension is {shown} in the header; it must be 2 or 3")
    if reading.dim not in (None, number):
        raise TrajectoryError(
            f"the header says dimension={int(number)}, so dim={reading.dim} (--dim) cannot be; leave it out"
        )
    return int(number)


def _own_box(cell: Floats, dimension: int | None, reading: Reading) -> tuple[Floats, tuple[str, ...]]:
    """Check the box that the user gives, and return it."""
    if cell.any():
        raise TrajectoryError("there is a cell already; leave out box (--box)")
    try:
        edges = np.array(reading.box, dtype=np.float64)
    except (TypeError, ValueError):
        edges = np.zeros(0)
    if edges.shape not in ((2,), (3,)) or not np.all(np.isfinite(edges) & (edges > 0)):
        raise TrajectoryError(f"box is {reading.box!r}; it must be two or three positive edge lengths")
    if dimension not in (None, len(edges)):
        raise TrajectoryError(f"box has {len(edges)} edges, but there are {dimension} dimensions")
    return edges, boundary_words(reading.boundary or "periodic", len(edges))


def _origin(atoms: Any) -> Floats:
    """First corner of the cell."""
    origin = np.array(atoms.get_celldisp(), dtype=np.float64).reshape(3)
    for name, value in atoms.info.items():
        if str(name).lower() == "origin":
            corner = np.asarray(value)
            if corner.shape != (3,) or corner.dtype.kind not in "iuf" or not np.isfinite(corner).all():
                raise TrajectoryError(f"{name} is {value!r} in the header; it must be three numbers")
            origin = origin + corner
    return origin


def _masses(
    atoms: Any, found: dict[str, Found], reading: Reading, used: set[str], notes: list[str]
) -> Floats:
    n = len(atoms)
    if reading.mass is not None:
        return one_per_particle(_by_label(atoms, found, reading.mass, "mass"), "masses", n, infinite=True)
    if "masses" in found:
        used.update(found["masses"].names)
        column = _number(found["masses"], n)
        still = column == 0.0
        if still.any():
            notes.append(f"{np.count_nonzero(still)} particles of mass 0 are obstacles, which nothing moves")
        return one_per_particle(np.where(still, np.inf, column), "masses", n, infinite=True)
    masses = one_per_particle(atoms.get_masses(), "masses", n)
    guessed = {
        s: m for s, m in zip(atoms.get_chemical_symbols(), masses.tolist(), strict=True) if s != SINGLE
    }
    if guessed:
        notes.append(
            "there are no masses, so those of the elements are taken: "
            + ", ".join(f"{symbol} {mass:g}" for symbol, mass in guessed.items())
            + " (mass=1, --mass 1 gives others)"
        )
    return masses


def _velocities(
    atoms: Any, found: dict[str, Found], masses: Floats, reading: Reading, used: set[str]
) -> Floats:
    """Velocities: momenta over masses, or the column of velocities from which the momenta were made."""
    momenta, velocities = found.get("momenta"), found.get("velocities")
    if not reading.velocities or (momenta is None and velocities is None):
        return np.zeros((len(atoms), 3))
    if momenta is not None:
        used.update(momenta.names)
        # An obstacle's momentum, which must be 0, stands for its velocity: the scene refuses any other.
        divisor = np.where(np.isinf(masses), 1.0, masses)[:, None]
        if velocities is None:
            return momenta.values / divisor  # type: ignore[no-any-return]
        product = inertia(masses)[:, None] * velocities.values
        if np.array_equal(product, momenta.values):
            used.update(velocities.names)
            return velocities.values  # type: ignore[no-any-return]
        if np.allclose(product, momenta.values, AGREE, AGREE * np.abs(momenta.values).max(initial=0.0)):
            used.update(velocities.names)
        return momenta.values / divisor  # type: ignore[no-any-return]
    assert velocities is not None
    named = str(atoms.info.get("units", "")).lower()
    if reading.units is None and named not in UNITS:
        said = f"; the header says units={atoms.info['units']}" if named else ""
        raise TrajectoryError(
            f'velocities are in a column "{velocities.names[0]}", whose unit differs between programs{said}; '
            "say that they are in the units of the lengths by --velocities-are reduced "
            '(units="reduced"), or give momenta, mass times velocity, in a column momenta'
        )
    used.update(velocities.names)
    return velocities.values  # type: ignore[no-any-return]


def _radii(atoms: Any, found: dict[str, Found], reading: Reading, used: set[str]) -> Floats:
    n = len(atoms)
    if reading.radius is not None:
        return one_per_particle(_by_label(atoms, found, reading.radius, "radius"), "radii", n)
    radii, diameters = found.get("radii"), found.get("diameters")
    if radii is not None and diameters is not None:
        one, two = np.asarray(_number(radii, n)), np.asarray(_number(diameters, n))
        if not np.allclose(2 * one, two, AGREE, 0.0):
            raise TrajectoryError(
                f'"{diameters.names[0]}" is not twice "{radii.names[0]}"; leave one of them out'
            )
    if radii is not None:
        used.update(radii.names, () if diameters is None else diameters.names)
        return one_per_particle(_number(radii, n), "radii", n)
    if diameters is not None:
        used.update(diameters.names)
        return 0.5 * one_per_particle(_number(diameters, n), "diameters", n)
    raise TrajectoryError(
        "there are no radii; give them in a column radius, or as radius=... (--radius 0.5, or of each "
        "label --radius A=0.5,B=0.3)"
    )


def _number(found: Found, n: int) -> Any:
    """Return values in a form for the checks of a scene: text as text, a header's list unchanged."""
    values = np.asarray(found.values)
    if values.dtype.kind == "O":
        values = values.astype(str)
    return values


def _by_label(atoms: Any, found: dict[str, Found], values: Any, name: str) -> Any:
    """Return the value of each particle's label in a mapping; anything else unchanged."""
    if not isinstance(values, Mapping):
        return values
    names = found["species"].values if "species" in found else atoms.get_chemical_symbols()
    if "labels" in found and not set(values) & set(names):
        names = found["labels"].values
    labels = [str(name) for name in names]
    kinds = dict.fromkeys(labels)
    for label in [*(label for label in kinds if label not in values), *(k for k in values if k not in kinds)]:
        what = "has no particle" if label in values else f"has no {name}"
        raise TrajectoryError(
            f"the label {label} {what}; labels are {', '.join(list(kinds)[:10])}, {name}: "
            f"{', '.join(map(str, values))}"
        )
    return np.array([values[label] for label in labels], dtype=np.float64)


def _leaving(positions: Floats, velocities: Floats, share: float, radii: Floats) -> str | None:
    """Return a sentence on a particle that is not in the plane of the first, or leaves it; else None."""
    height = np.abs(positions[:, 2] - positions[0, 2])
    out = int(np.argmax(height))
    if not height[out] <= share * 2.0 * radii.min():
        return f"particles 0 and {out} differ in z by {height[out]:.3g}"
    speed = np.abs(velocities[:, 2])
    out = int(np.argmax(speed))
    if not speed[out] <= share * np.abs(velocities).max():
        return f"particle {out} moves along z, at {speed[out]:.3g}"
    return None


def _require_flat(positions: Floats, velocities: Floats, share: float, radii: Floats) -> None:
    """Refuse a third dimension in a gas declared two-dimensional."""
    leaving = _leaving(positions, velocities, share, radii) if len(positions) else None
    if leaving is None:
        return
    if share:
        raise TrajectoryError(
            f"--dim 2 (dim=2) says two dimensions, but {leaving}; up to {share:g} of the smallest "
            "diameter, and of the fastest "
            "speed, count as rounding"
        )
    raise TrajectoryError(
        f"the header or a third cell vector of zero says two dimensions, but {leaving}; give three cell "
        "vectors, or, if that is "
        "rounding, say --dim 2 (dim=2)"
    )


def _fitting(
    kind: "type[Scene]",
    positions: Floats,
    radii: Floats,
    box: Floats,
    periodic: NDArray[np.bool_],
    fixed: NDArray[np.bool_],
    rounding: float,
) -> tuple[Any, Floats]:
    """Return the constructor that a scene needs, and the radii: smaller ones where positions were rounded.

    They are reduced by half of the worst overlap, where that is no more than `rounding`, what the digits of
    the file explain. In single precision a coordinate from the centre of the box is off by up to 2^-25 L, and
    L by 2^-24 L, so a separation across the boundary by sqrt(3) 2^-23 L; and a diameter, at most L/2, by
    2^-25 L. Half of that is 0.99 2^-23 L; what a wall sees is less.
    """
    if not np.isfinite(positions).all() or not len(positions):
        return kind, radii
    folded = np.where(periodic, np.mod(positions, box), positions)
    folded = np.where(periodic & (folded >= box), 0.0, folded)
    largest = 2 * float(radii.max())
    too_long = float(np.max(np.where(periodic, (2 * largest - box) / 4, (largest - box) / 2)))
    beyond = worst_beyond_wall(folded, np.where(fixed, 0.0, radii), box, periodic)[0]
    most = min(rounding, SMALL * float(radii.min()))
    if max(too_long, beyond) > most:  # the scene's own check gives the error
        return kind, radii
    overlap = worst_overlap(folded, radii, box, periodic, fixed)[2]
    left = max(contact_tolerance(box), LEFT * largest)
    if too_long <= 0 and beyond <= left and overlap <= left:
        return kind.as_left, radii
    excess = max(too_long, beyond, 0.5 * overlap)
    if excess > most:
        return kind, radii
    return kind, radii - excess * (1 + 1e-6)  # a little more than enough, for rounding
