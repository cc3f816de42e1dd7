"""Extended xyz: text that most programs read, one block of lines for each frame.

ASE defines the format: its functions read the columns. They are written here, under the header that ASE's
function would write (which takes a tenth of a second to import), in digits that are the fewest that read back
to the same float64, so a scene comes back bit for bit; a file is also divided into frames here, so that
nothing between them is ignored, and an error in one is reported in a sentence with its line.
"""

import io
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from hardspheres.atoms import VELOCITY
from hardspheres.columns import NAMES
from hardspheres.errors import TrajectoryError

SUFFIXES = (".xyz", ".extxyz")
COLUMNS = ("positions", "momenta", "masses", "radius", VELOCITY, "mass")  # the last two are what OVITO reads
PROPERTIES = "species:S:1:pos:R:3:momenta:R:3:masses:R:1:radius:R:1:Velo:R:3:mass:R:1"  # of these
INTEGERS = (*NAMES["labels"], *NAMES["id"])
KINDS: dict[str, Callable[[str], Any]] = {
    "S": str,
    "R": float,
    "I": lambda text: np.int64(int(text)),
    "L": {"T": 1, "F": 0, "True": 1, "False": 0}.__getitem__,
}
PLAIN = "species:S:1:pos:R:3"  # columns of a file whose header names none
SHOWN = 40  # characters of a file that a message quotes


def frame_text(atoms: Any) -> bytes:
    """Return one frame as a file has it.

    Parameters
    ----------
    atoms : ase.Atoms
        As `hardspheres.atoms.to_atoms` makes it.

    Raises
    ------
    TrajectoryError
        When a number is not finite.
    """
    from ase.data import chemical_symbols

    arrays = {**atoms.arrays, "mass": atoms.arrays["masses"]}
    labels = arrays.get("tags")
    table = np.column_stack([arrays[name] for name in COLUMNS])
    if not np.isfinite(table).all():
        raise TrajectoryError("a number is not finite; a file with it could not be read back")
    text = bytearray(
        b"]],"
    )  # so that each row [[...]] comes after five bytes, which become its line break and its symbol
    text += orjson.dumps(table[:, None, :], option=orjson.OPT_SERIALIZE_NUMPY)[1:-3]
    letters = np.frombuffer(text, np.uint8)
    row = np.flatnonzero(letters == ord("]"))[::2]
    np.copyto(letters, ord(" "), where=letters == ord(","))
    elements, kinds = np.unique(atoms.numbers, return_inverse=True)
    before = [b"\n" + chemical_symbols[element].encode().ljust(4) for element in elements]
    letters[row[:, None] + np.arange(5)] = np.frombuffer(b"".join(before), np.uint8).reshape(-1, 5)[kinds]
    lines = bytes(text)
    if labels is not None:
        rows = zip(lines.split(b"\n")[1:], labels.tolist(), strict=True)
        lines = b"".join(b"\n%s %d" % row for row in rows)
    return b"%d\n%s%s\n" % (len(atoms), header(atoms).encode(), lines)


def header(atoms: Any) -> str:
    """Return the second line of a frame, as `ase.io.extxyz.output_column_format` writes it."""
    lattice = " ".join(map(str, atoms.cell.array.ravel().tolist()))
    labels = "" if "tags" not in atoms.arrays else ":label:I:1"
    axes = " ".join("FT"[periodic] for periodic in atoms.pbc.tolist())
    info = " ".join(f"{key}={_quoted(str(value))}" for key, value in atoms.info.items())
    return f'Lattice="{lattice}" Properties={PROPERTIES}{labels} {info} pbc="{axes}"'


def _quoted(text: str) -> str:
    """Return a value as ASE writes it: in quotation marks where it would not be read as one."""
    escaped = text.replace('"', '\\"')
    return f'"{escaped}"' if set(text) & set(" \"'{}[]") else text


@dataclass(frozen=True)
class Frame:
    """The lines of one frame as they stand in the file, the first of them the `line`-th from 1."""

    line: int
    count: int
    header: str
    rows: list[str]
    vectors: list[str]


def frames(path: Path) -> Iterator[Frame]:
    """Yield the frames of a file, which may have blank lines between them, and none may be cut short.

    Raises
    ------
    TrajectoryError
        Where a frame should begin and does not, or ends too soon.
    """
    from ase.io.formats import open_with_compression

    with open_with_compression(str(path), "rb") as binary:
        lines = io.TextIOWrapper(binary, encoding="utf-8", errors="replace")
        number, frame, ahead = 0, 0, ""
        while True:
            first = ahead or lines.readline()
            ahead = ""
            number += 1
            if not first:
                return
            if not first.strip():
                continue
            begin = number
            if not re.fullmatch("[0-9]{1,18}", first.strip()):
                before = f"{frame} frame{'s' * (frame != 1)} before it" if frame else "a frame begins with it"
                raise TrajectoryError(
                    f"{path}, line {number}: the number of particles should stand here ({before}), but it "
                    f"is {_shown(first)}"
                )
            count = int(first)
            header = lines.readline()
            rows = list(islice(lines, count))
            if len(rows) < count or not header:
                raise TrajectoryError(
                    f"{path} says in line {number} that {count} particles follow where {len(rows)} lines "
                    "do; it is damaged or "
                    f"cut short{f'; whole frames before: {frame}' if frame else ''}"
                )
            number += 1 + count
            vectors: list[str] = []
            while (ahead := lines.readline()).lstrip().startswith("VEC"):
                vectors.append(ahead)
                number += 1
            frame += 1
            yield Frame(begin, count, header.rstrip("\r\n"), rows, vectors)


def to_structure(path: Path, frame: Frame) -> tuple[Any, list[str]]:
    """Return a frame as ASE reads it, and sentences about everything changed or not used.

    Labels that are no elements (1, A, Type_1) become a column `label`; ASE reads them as X, of mass 1.

    Raises
    ------
    TrajectoryError
        Naming the line that is wrong.
    """
    from ase.io.extxyz import key_val_str_to_dict, read_extxyz

    parsed: Any = key_val_str_to_dict
    if not frame.count:
        raise TrajectoryError(f"{path} holds no particles in the frame of line {frame.line}")
    where = f"{path}, line {frame.line + 1}"
    header = frame.header.strip()
    try:
        info = parsed(header) if header else {}
    except Exception as error:  # it fails in many ways
        if "Lattice" in str(error):
            raise TrajectoryError(
                f"{where}: Lattice must be nine numbers, three for each cell vector"
            ) from error
        raise TrajectoryError(f"{where}: the header cannot be read ({said(error)})") from error
    _check_header(where, info)
    named = "Properties" in info
    columns = _columns(where, str(info.get("Properties", PLAIN)))
    notes = _check_rows(path, frame, columns, named)
    names = [name for name, _, _ in columns]
    if "species" in names and not _are_elements(frame, columns):
        names[names.index("species")] = "labels" if "label" in names else "label"
    integers = [
        name for name, kind, width in columns if name.lower() in INTEGERS and (kind, width) == ("I", 1)
    ]
    info["Properties"] = ":".join(
        f"{name}:{'S' if name in integers else kind}:{width}"  # ASE reads only 32 bits of an integer
        for name, (_, kind, width) in zip(names, columns, strict=True)
    )
    ends = "" if frame.rows[-1].endswith("\n") else "\n"
    text = io.StringIO("".join([f"{frame.count}\n{header}\n", *frame.rows, ends, *frame.vectors]))
    try:
        (atoms,) = read_extxyz(text, index=slice(None), properties_parser=lambda _: info)
        for name in integers:
            values = [KINDS["I"](value) for value in atoms.arrays.pop(name)]
            atoms.set_array(name, np.array(values), np.int64, ())
    except Exception as error:  # it fails in many ways
        fault = _fault(path, frame, columns) or f"{where}: ASE cannot read this frame ({said(error)})"
        raise TrajectoryError(fault) from error
    if ends:
        notes.append("the file ends within a line: if it was cut short, so may be the last number")
    return atoms, notes


def _columns(where: str, properties: str) -> list[tuple[str, str, int]]:
    """Return name, kind and width of the columns that a header names."""
    fields = properties.split(":")
    columns = []
    for k in range(0, len(fields), 3):
        name, kind, width = (*fields[k : k + 3], "", "")[:3]
        if not name or kind not in KINDS or not re.fullmatch("[1-9][0-9]{0,3}", width):
            raise TrajectoryError(
                f"{where}: Properties are not name:kind:number with S, R, I or L for the kind, and so on, "
                "but have "
                f"{_shown(':'.join(fields[k : k + 3]))}"
            )
        columns.append((name, kind, int(width)))
    names = [name for name, _, _ in columns]
    for name in names:
        if names.count(name) > 1:
            raise TrajectoryError(f'{where}: Properties name "{name}" twice; rename one of the two columns')
    place = next((column for column in columns if column[0] == "pos"), None)
    if place is None or place[1:] != ("R", 3):
        stands = "no pos" if place is None else ":".join(map(str, place))
        raise TrajectoryError(
            f"{where}: positions must be a column pos:R:3 of Properties, but there is {stands}; a 2D gas "
            "has z = 0 and "
            "dimension=2"
        )
    return columns


def _check_header(where: str, info: dict[str, Any]) -> None:
    pbc = np.asarray(info.get("pbc", True))
    if pbc.dtype.kind not in "biu" or pbc.shape not in ((), (3,)):
        raise TrajectoryError(
            f"{where}: pbc is {_shown(str(info['pbc']))}; it must be T or F for each of three axes, as in "
            'pbc="T T F"'
        )


def _check_rows(path: Path, frame: Frame, columns: list[tuple[str, str, int]], named: bool) -> list[str]:
    """Refuse rows with too few values, or too many for the header; report columns beyond it."""
    width = sum(width for _, _, width in columns)
    widths = [len(row.split()) for row in frame.rows]
    for k, found in enumerate(widths):
        if found < width or (named and found > width):
            raise TrajectoryError(
                f"{path}, line {frame.line + 2 + k}: there are {found} values, but the columns "
                f"{', '.join(name for name, _, _ in columns)} take {width}"
            )
    if max(widths) > width:
        beyond = (
            f"column {width + 1}" if max(widths) == width + 1 else f"columns {width + 1} to {max(widths)}"
        )
        return [f"not used: what stands in {beyond}, which no Properties name"]
    return []


def _fault(path: Path, frame: Frame, columns: list[tuple[str, str, int]]) -> str | None:
    """Return a sentence on a value of the wrong kind for its column; None if there is none."""
    kinds = [(name, kind) for name, kind, width in columns for _ in range(width)]
    wanted = {"R": "a number", "I": "an integer", "L": "T or F"}
    for k, row in enumerate(frame.rows):
        for value, (name, kind) in zip(row.split(), kinds, strict=False):
            try:
                KINDS[kind](value)
            except (KeyError, ValueError, OverflowError):
                line = frame.line + 2 + k
                return f"{path}, line {line}: {_shown(value)} in the column {name} is not {wanted[kind]}"
    return None


def _are_elements(frame: Frame, columns: list[tuple[str, str, int]]) -> bool:
    from ase.data import atomic_numbers

    place = 0
    for name, _, width in columns:
        if name == "species":
            break
        place += width
    labels = {row.split(None, place + 1)[place] for row in frame.rows}
    return all(label.capitalize() in atomic_numbers for label in labels)


def _shown(text: str) -> str:
    short = text.strip()
    return ascii(short if len(short) <= SHOWN else short[:SHOWN] + "...")


def said(error: Exception) -> str:
    """Return what an error of another program says, in one line."""
    words = " ".join(str(error).split())
    return ": ".join(filter(None, (type(error).__name__, words[:200])))
