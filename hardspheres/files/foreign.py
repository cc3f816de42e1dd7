"""Formats with units, which ASE converts to its own: Angstrom, u, eV, times of Angstrom sqrt(u/eV), 10.18 fs.

In such a file a velocity of 1 becomes 0.01 or 10, and a mass is guessed from a label. Both are wrong for a
gas in reduced units and do not show in the result, so the user has to choose.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hardspheres.atoms import SINGLE, Reading
from hardspheres.errors import TrajectoryError

AS_THEY_STAND = ("extxyz", "traj", "json", "db")  # ASE's own: numbers are read as they were written
LAMMPS = ("lammps-dump-text", "lammps-data")
READ_BY_ASE = {
    *("id", "type", "element", "q", "x", "y", "z", "xs", "ys", "zs", "xu", "yu", "zu", "xsu", "ysu", "zsu"),
    *("vx", "vy", "vz", "fx", "fy", "fz"),
}


Table = tuple[list[str], list[list[str]]]


@dataclass(frozen=True)
class Conversion:
    """What ASE multiplies lengths and velocities of a format by; whether the file has masses."""

    length: float = 1.0
    velocity: float = 1.0
    masses: bool = False


def conversions() -> dict[str, Conversion]:
    """Return the conversions of formats that were tried (a test reads a file of each)."""
    from ase.units import fs, nm

    per_ps = 1.0 / (1000.0 * fs)  # Angstrom
    return {
        "lammps-dump-text": Conversion(velocity=per_ps),
        "lammps-data": Conversion(velocity=per_ps, masses=True),
        "vasp": Conversion(velocity=1.0 / fs),
        "gromacs": Conversion(nm, nm * per_ps),
        "gromos": Conversion(nm),
        "aims": Conversion(velocity=per_ps),
        "cfg": Conversion(masses=True),
        "cif": Conversion(),
        "proteindatabank": Conversion(),
        "xsf": Conversion(),
        "res": Conversion(),
    }


def reader_options(form: str, reading: Reading) -> dict[str, Any]:
    """Return the arguments for ASE's reader of a format."""
    return {"units": "ASE"} if form in LAMMPS and reading.units == "reduced" else {}


def tables(form: str, path: Path) -> Iterator[Table]:
    """Yield names of columns and rows of each frame of a LAMMPS dump; nothing of other formats."""
    from ase.io.formats import open_with_compression

    if form != "lammps-dump-text":
        return
    table: Table | None = None
    inside = False
    with open_with_compression(str(path), "rb") as binary:
        for line in io.TextIOWrapper(binary, encoding="utf-8", errors="replace"):
            if line.startswith("ITEM:"):
                if inside and table is not None:
                    yield table
                inside = line.startswith("ITEM: ATOMS")
                table = (line.split()[2:], [])
            elif inside and table is not None and line.strip():
                table[1].append(line.split())
    if inside and table is not None:
        yield table


def taken(atoms: Any, form: str, path: Path, reading: Reading, table: Table | None) -> Any:
    """Return a structure in the units that the user wants.

    Parameters
    ----------
    atoms : ase.Atoms
        As ASE's reader made it; changed.
    form : str
        ASE's name of the format.
    path : Path
        The file.
    reading : Reading
        With the units, or none.
    table : tuple, optional
        Of this frame, from `tables`.

    Raises
    ------
    TrajectoryError
        Where that depends on units, and the user does not say which.
    """
    if form in AS_THEY_STAND:
        return atoms
    known = conversions()
    if form == "gromacs":
        _require_all(atoms, path)
    if form == "lammps-dump-text":
        _add_columns(atoms, path, table or ([], []))
    if form in LAMMPS and "type" in atoms.arrays:
        atoms.arrays["label"] = atoms.arrays.pop("type").astype(str)
    own_masses = known[form].masses if form in known else atoms.has("masses")
    own_masses = own_masses or "mass" in atoms.arrays
    if reading.units is None:
        _refuse(atoms, form, path, reading, own_masses)
    elif reading.units == "reduced" and form not in known:
        raise TrajectoryError(
            f"{path} is of the format {form}, and how ASE converts it is not known here; say --units ase "
            "(Angstrom, u, eV), or "
            "convert it to extended xyz"
        )
    raw = reading.units == "reduced" and form not in LAMMPS  # those were read as such
    length, velocity = (known[form].length, known[form].velocity) if raw else (1.0, 1.0)
    if atoms.has("momenta"):  # a column, so that masses do not matter
        atoms.arrays["velocities"] = atoms.get_velocities() / velocity
        del atoms.arrays["momenta"]
    atoms.set_positions(atoms.get_positions() / length, apply_constraint=False)
    atoms.set_cell(atoms.get_cell() / length)
    atoms.set_celldisp(atoms.get_celldisp() / length)
    if "mass" in atoms.arrays and atoms.has("masses"):
        del atoms.arrays["masses"]
    elif reading.units == "reduced" and reading.mass is None and not own_masses:
        atoms.set_masses(np.ones(len(atoms)))
    if reading.units is not None:
        atoms.info["units"] = reading.units
    return atoms


def _require_all(atoms: Any, path: Path) -> None:
    """Refuse a gromacs file that is cut short: ASE reads what is there."""
    from ase.io.formats import open_with_compression

    with open_with_compression(str(path), "rb") as lines:
        count = [next(lines, b""), next(lines, b"")][1].decode(errors="replace").strip()
    if count != str(len(atoms)):
        raise TrajectoryError(
            f"{path} says in line 2 that {count} particles follow, but there are {len(atoms)}; it is "
            "damaged or cut short"
        )


def _refuse(atoms: Any, form: str, path: Path, reading: Reading, own_masses: bool) -> None:
    """Refuse converted velocities and guessed masses, unless the user gives or draws others."""
    what = []
    if reading.velocities and atoms.has("momenta"):
        what.append("velocities are converted")
    if reading.mass is None:
        masses = dict(zip(atoms.get_chemical_symbols(), atoms.get_masses().tolist(), strict=True))
        if own_masses:
            what.append("masses are taken to be in u")
        elif set(masses) != {SINGLE}:
            first = ", ".join(f"{symbol} {mass:g}" for symbol, mass in list(masses.items())[:3])
            what.append(f"masses are guessed from labels ({first})")
    if what:
        raise TrajectoryError(
            f"{path} is of the format {form}, which ASE reads in units of its own: {' and '.join(what)}; "
            "say --units reduced "
            "(numbers as they stand in the file, masses 1 where it has none) or --units ase (Angstrom, u, eV)"
        )


def _add_columns(atoms: Any, path: Path, table: Table) -> None:
    """Add the columns of a LAMMPS dump that ASE leaves out (radius, mass...), in the order of the ids."""
    names, rows = table
    if len(rows) != len(atoms) or any(len(row) != len(names) for row in rows):
        raise TrajectoryError(
            f"{path}: the table after ITEM: ATOMS is no text of {len(atoms)} rows with {len(names)} "
            "values each; write the dump "
            "as text (dump custom), or convert it to extended xyz"
        )
    ids = [row[names.index("id")] for row in rows] if "id" in names else []
    if not all(value.isdigit() for value in ids):
        raise TrajectoryError(f"{path}: an id after ITEM: ATOMS is no integer")
    order = np.argsort([int(value) for value in ids], kind="stable") if ids else np.arange(len(rows))
    for column, name in enumerate(names):
        if name in READ_BY_ASE or name in atoms.arrays:
            continue
        try:
            values = np.array([float(row[column]) for row in rows])
        except ValueError:
            continue  # text
        atoms.set_array(name, values[order], float, ())
