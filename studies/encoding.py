"""Values to files and back: numbers, texts, arrays, containers, and objects of our own classes; nothing else.

A file is an uncompressed ``.npz`` without pickles: the arrays, a tree in JSON that says what they are parts of, and a
SHA-256 of both. Reading one executes nothing and imports nothing: objects are made of classes that are loaded already
and that this module knows (dataclasses, estimators, scenes, simulations), without calling their constructors.
What is read equals what was written to the last bit; an array that appeared in several places is one array again.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import sys
import tempfile
import zipfile
from collections import deque
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.estimator import Estimator
from analysis.series import BlockSeries
from hardspheres.errors import CheckpointError

__all__ = ["decode", "encode", "read", "write", "write_whole"]

OURS = {"hardspheres", "analysis", "studies"}
PLAIN = (type(None), bool, int, float, str)
KINDS = "biuf"  # of arrays: truth values, integers, floating point numbers


def _name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def _known(name: str) -> type | None:
    """Return the class of this name, None where it is none of ours, not loaded, or not made to be stored."""
    module, _, own = name.rpartition(".")
    kind = vars(sys.modules[module]).get(own) if module in sys.modules else None
    if module.partition(".")[0] not in OURS or not isinstance(kind, type) or _name(kind) != name:
        return None
    return kind if is_dataclass(kind) or issubclass(kind, (Estimator, BlockSeries)) else None


def _contents(value: Any) -> dict[str, Any]:
    """Return what an object consists of; what it has derived and kept stays behind."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return dict(vars(value))


class _Encoder:
    """Turns values into a tree for JSON and a list of arrays."""

    def __init__(self) -> None:
        self.arrays: list[NDArray[Any]] = []
        self._seen: dict[int, tuple[int, Any]] = {}  # with the array, so that its id stays its own

    def tree(self, value: Any) -> Any:
        kind = type(value)
        if kind in PLAIN:
            return value
        if kind is list or kind is tuple:
            return {kind.__name__: [self.tree(entry) for entry in value]}
        if kind is dict:
            return {"dict": [[self.tree(key), self.tree(entry)] for key, entry in value.items()]}
        if kind is deque:
            return {"deque": [value.maxlen, [self.tree(entry) for entry in value]]}
        if kind is np.ndarray:
            return {"array": self._place(value)}
        if isinstance(value, np.generic):
            return {"scalar": self._place(np.asarray(value))}
        if kind is hs.Simulation:
            return {"simulation": self._place(_simulation_bytes(value))}
        if _known(_name(kind)) is kind:
            parts = {name: self.tree(part) for name, part in _contents(value).items()}
            return {"object": [_name(kind), parts]}
        raise TypeError(
            f"a {_name(kind)} cannot be stored; make it of numbers, arrays and dataclasses of ours"
        )

    def _place(self, array: NDArray[Any]) -> int:
        if array.dtype.kind not in KINDS:
            raise TypeError(f"an array of {array.dtype} cannot be stored; make it one of numbers")
        if id(array) not in self._seen:
            self._seen[id(array)] = (len(self.arrays), array)
            self.arrays.append(array)
        return self._seen[id(array)][0]


def _decoded(tree: Any, arrays: list[NDArray[Any]]) -> Any:
    if type(tree) in PLAIN:
        return tree
    ((kind, content),) = tree.items()

    def several(entries: list[Any]) -> list[Any]:
        return [_decoded(entry, arrays) for entry in entries]

    if kind == "list":
        return several(content)
    if kind == "tuple":
        return tuple(several(content))
    if kind == "dict":
        return {_decoded(key, arrays): _decoded(entry, arrays) for key, entry in content}
    if kind == "deque":
        return deque(several(content[1]), maxlen=content[0])
    if kind == "array":
        return arrays[content]
    if kind == "scalar":
        return arrays[content][()]
    if kind == "simulation":
        return _simulation(arrays[content])
    if kind == "object":
        return _object(content[0], {name: _decoded(part, arrays) for name, part in content[1].items()})
    raise CheckpointError(f"it holds a {kind!r}, which this version does not know")


def _object(name: str, parts: dict[str, Any]) -> Any:
    kind = _known(name)
    if kind is None:
        raise CheckpointError(f"it holds an object of {name!r}, which is no class that is stored here")
    new: Any = object.__new__(kind)
    if not is_dataclass(kind):
        vars(new).update(parts)
        return new
    if set(parts) != {field.name for field in fields(kind)}:
        raise CheckpointError(f"it holds a {name} of another version")
    if isinstance(new, hs.Scene):
        new.__setstate__(tuple(parts[field.name] for field in fields(new)))  # arrays read-only again
        return new
    for part, value in parts.items():
        object.__setattr__(new, part, value)
    return new


def _simulation_bytes(simulation: hs.Simulation) -> NDArray[np.uint8]:
    with _scratch() as path:
        simulation.save(path)
        return np.frombuffer(path.read_bytes(), dtype=np.uint8)


def _simulation(content: NDArray[np.uint8]) -> hs.Simulation:
    with _scratch() as path:
        path.write_bytes(content.tobytes())
        return hs.Simulation.load(path)


@contextlib.contextmanager
def _scratch() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="hardspheres-") as folder:
        yield Path(folder) / "simulation.npz"


def _digest(tree: bytes, arrays: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the SHA-256 of everything in a file."""
    total = hashlib.sha256(tree)
    for array in arrays:
        total.update(f"{array.dtype.str} {array.shape} {array.flags.f_contiguous}".encode())
        total.update(array.tobytes("A"))
    return np.frombuffer(total.digest(), dtype=np.uint8)


def encode(value: Any) -> bytes:
    """Return a value as the content of a file.

    Parameters
    ----------
    value
        None, numbers, texts, arrays of numbers, lists, tuples, dicts and deques of such, scenes, simulations, estimators,
        and dataclasses of this project.

    Raises
    ------
    TypeError
        If something else is in it.
    """
    encoder = _Encoder()
    tree = json.dumps(encoder.tree(value)).encode()
    arrays = [np.asarray(array, order="A") for array in encoder.arrays]
    whole = io.BytesIO()
    members: dict[str, Any] = {"tree": np.frombuffer(tree, dtype=np.uint8), "digest": _digest(tree, arrays)}
    members |= {f"a{index}": array for index, array in enumerate(arrays)}
    np.savez(whole, **members)
    return whole.getvalue()


def decode(content: bytes) -> Any:
    """Return the value that `encode` turned into these bytes.

    Raises
    ------
    CheckpointError
        If the bytes were altered, are not all there, or hold what this version does not know.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as members:
            tree = members["tree"].tobytes()
            arrays = [members[f"a{index}"] for index in range(len(members.files) - 2)]
            if members["digest"].tobytes() != _digest(tree, arrays).tobytes():
                raise CheckpointError("its checksum is wrong")
        return _decoded(json.loads(tree), arrays)
    except CheckpointError:
        raise
    except (zipfile.BadZipFile, EOFError, OSError) as error:
        raise CheckpointError("it is damaged or not all there") from error
    except Exception as error:  # a crafted file fails in its own way
        raise CheckpointError(f"it cannot be understood ({type(error).__name__})") from error


def write_whole(path: Path, content: bytes, *, durable: bool) -> None:
    """Write a file under another name and rename it: there is the old one or the new one, never a torn one.

    Parameters
    ----------
    path : Path
        The file.
    content : bytes
        What it shall hold.
    durable : bool
        Wait until the disk has it, so that a power failure cannot tear it either.

    Raises
    ------
    OSError
        If it cannot be written; the old one stays.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("wb") as handle:
            handle.write(content)
            if durable:
                handle.flush()
                os.fsync(handle.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write(path: Path, value: Any, *, durable: bool = False) -> None:
    """Write a value into a file, see `encode` and `write_whole`."""
    write_whole(path, encode(value), durable=durable)


def read(path: Path) -> Any:
    """Return the value in a file.

    Raises
    ------
    CheckpointError
        If the file is damaged, or holds what this version does not know.
    FileNotFoundError
        If there is none.
    """
    content = path.read_bytes()
    try:
        return decode(content)
    except CheckpointError as error:
        raise CheckpointError(f"{path} cannot be used: {error}") from error
