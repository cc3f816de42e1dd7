"""Values to files and back: numbers, texts, arrays, containers, and objects of our own classes; nothing else.

A file is a sealed archive (`hardspheres.archive`) of two members: a tree in JSON, and the bytes of all arrays
in it. Reading one executes nothing and imports nothing: objects are made of classes that are loaded already
and that this module knows (dataclasses, estimators, scenes, simulations), without calling their constructors.
What is read equals what was written to the last bit; an array that appeared in several places is one array
again.
"""

from __future__ import annotations

import json
import math
import sys
from collections import deque
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.estimator import Estimator
from analysis.series import BlockSeries
from hardspheres.archive import Arrays, read_archive, write_archive
from hardspheres.errors import CheckpointError

__all__ = ["decode", "encode", "read", "write"]

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
    """Return the fields of an object, without cached values."""
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return dict(vars(value))


class _Encoder:
    """Converts values to a tree for JSON and a list of arrays."""

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
            return {"simulation": {name: self._place(array) for name, array in value._arrays().items()}}
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
        return hs.Simulation._from_arrays({name: arrays[index] for name, index in content.items()})
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


def encode(value: Any) -> Arrays:
    """Return a value as the members of an archive.

    Parameters
    ----------
    value
        None, numbers, texts, arrays of numbers, lists, tuples, dicts and deques of such, scenes, simulations,
        estimators, and dataclasses of this project.

    Raises
    ------
    TypeError
        If something else is in it.
    """
    encoder = _Encoder()
    whole = {"tree": encoder.tree(value), "arrays": [_described(array) for array in encoder.arrays]}
    data = b"".join(array.tobytes("A") for array in encoder.arrays)
    return {
        "tree": np.frombuffer(json.dumps(whole).encode(), dtype=np.uint8),
        "data": np.frombuffer(data, dtype=np.uint8),
    }


def _described(array: NDArray[Any]) -> list[Any]:
    by_columns = array.flags.f_contiguous and not array.flags.c_contiguous
    return [array.dtype.newbyteorder("<").str, list(array.shape), by_columns]


def decode(members: Arrays) -> Any:
    """Return the value that `encode` turned into these members.

    Raises
    ------
    CheckpointError
        If they hold what this version does not know.
    """
    try:
        whole = json.loads(members["tree"].tobytes())
        data, arrays, place = members["data"].tobytes(), [], 0
        for name, shape, by_columns in whole["arrays"]:
            dtype = np.dtype(name)
            if dtype.kind not in KINDS or min(shape, default=0) < 0:
                raise CheckpointError(f"it holds an array of {dtype} of shape {shape}")
            count = math.prod(shape)
            array = np.frombuffer(data, dtype, count, place) if count else np.zeros(0, dtype)
            arrays.append(array.reshape(shape, order="F" if by_columns else "C").copy(order="K"))
            place += count * dtype.itemsize
        return _decoded(whole["tree"], arrays)
    except CheckpointError:
        raise
    except Exception as error:  # a crafted file fails in its own way
        raise CheckpointError(f"it cannot be understood ({type(error).__name__})") from error


def write(path: Path, value: Any, *, durable: bool = True) -> None:
    """Write a value to a file atomically, see `encode` and `write_archive`.

    Raises
    ------
    CheckpointError
        If the file cannot be written; the old one stays.
    """
    write_archive(path, encode(value), durable=durable)


def read(path: Path) -> Any:
    """Return the value in a file.

    Raises
    ------
    CheckpointError
        If there is none, or it is damaged, or holds what this version does not know.
    """
    members = read_archive(path)
    try:
        return decode(members)
    except CheckpointError as error:
        raise CheckpointError(f"{path} cannot be used: {error}") from error
