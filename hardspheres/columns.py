"""The quantities in the columns of a file, by the names that various programs use.

A name is compared in lower case. A quantity in two columns must be the same in both. Unused columns of
numbers are reported, so that nothing is ignored silently.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import TrajectoryError

Floats = NDArray[np.float64]

NAMES = {
    "momenta": ("momenta", "momentum"),
    "velocities": ("velo", "vel", "velocity", "velocities", "v"),
    "masses": ("masses", "mass"),
    "radii": ("radius", "radii"),
    "diameters": ("diameter", "diameters"),
    "species": ("label", "labels"),  # of text
    "labels": ("label", "labels", "tags"),  # of integers
    "id": ("id", "ids"),
}
VECTORS = ("momenta", "velocities")
COMPONENTS = ("vx", "vy", "vz")
AGREE = 1e-5  # relative: two columns of one quantity, one of them perhaps printed with few digits
OF_ATOMS = ("numbers", "positions")


@dataclass(frozen=True)
class Found:
    """Columns of one quantity: their names in the file, and their values, of the first of them."""

    names: tuple[str, ...]
    values: Any


def find(atoms: Any) -> dict[str, Found]:
    """Return the quantities that columns give, or else the header.

    Parameters
    ----------
    atoms : ase.Atoms
        Columns in ``arrays``, header in ``info``.

    Returns
    -------
    dict
        By the keys of `NAMES`. Vectors have shape (N, 3).

    Raises
    ------
    TrajectoryError
        Where columns have a wrong shape, or two of one quantity differ.
    """
    found = {}
    for quantity, names in NAMES.items():
        columns = {name: values for name, values in atoms.arrays.items() if str(name).lower() in names}
        if quantity == "species":
            columns = {name: values for name, values in columns.items() if values.dtype.kind not in "iuf"}
        if quantity == "labels":
            columns = _integers(columns)
        if quantity == "velocities":
            columns |= _components(atoms.arrays)
        if not columns and quantity not in ("species", "labels", "id", *VECTORS):
            columns = {name: values for name, values in atoms.info.items() if str(name).lower() in names}
        elif quantity in VECTORS:
            columns = {name: _vectors(name, values) for name, values in columns.items()}
        if columns:
            found[quantity] = _the_same(columns)
    return found


def unused(atoms: Any, used: set[str]) -> list[str]:
    """Return the names of columns of numbers that are not among those used."""
    results = {} if atoms.calc is None else atoms.calc.results  # ASE puts forces, charges... there
    columns = {**atoms.arrays, **{name: np.asarray(values) for name, values in results.items()}}
    return [
        name
        for name, values in columns.items()
        if name not in used | {*OF_ATOMS}
        and values.dtype.kind in "iufb"
        and values.shape[:1] == (len(atoms),)
    ]


def _integers(columns: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of labels; ASE's tags, which are 0 where nobody set them, only if one is not."""
    return {
        name: values
        for name, values in columns.items()
        if values.dtype.kind in "iu" and (str(name).lower() != "tags" or values.any())
    }


def _components(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return the columns vx, vy, vz as one."""
    there = {str(name).lower(): name for name in arrays if str(name).lower() in COMPONENTS}
    if not there:
        return {}
    if not {"vx", "vy"} <= there.keys():
        raise TrajectoryError(f'there is a column "{next(iter(there.values()))}", but not all of vx, vy, vz')
    shape = np.shape(arrays[there["vx"]])
    columns = [arrays[there[name]] if name in there else np.zeros(shape) for name in COMPONENTS]
    return {" ".join(there.values()): np.stack(columns, axis=-1)}


def _vectors(name: str, values: Any) -> Floats:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] != 3:
        raise TrajectoryError(
            f'the column "{name}" has shape {array.shape[1:] or (1,)} for each particle; it must be three '
            "numbers (in 2D the third is 0)"
        )
    return array.astype(np.float64)


def _the_same(columns: dict[str, Any]) -> Found:
    """Return columns of one quantity as one, after comparing them."""
    (first, values), *others = columns.items()
    for name, other in others:
        try:
            if {np.asarray(each).dtype.kind for each in (values, other)} <= {"i", "u"}:
                near = np.equal(values, other)
            else:
                one, two = np.asarray(values, float), np.asarray(other, float)
                floor = 1e-7 * np.abs(one).max(initial=0.0) if one.ndim == 2 else 0.0
                near = np.isclose(one, two, rtol=AGREE, atol=floor, equal_nan=True)
        except (TypeError, ValueError):  # text, or other shapes
            near = np.array(np.array_equal(values, other))
        if not near.all():
            which = f" for particle {np.argwhere(~near)[0][0]}" if near.ndim else ""
            raise TrajectoryError(f'"{first}" and "{name}" differ{which}; leave one of them out')
    return Found(tuple(part for name in columns for part in name.split()), values)
