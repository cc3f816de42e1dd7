"""Values to files and back: numbers, texts, arrays, containers, and objects of known classes; nothing else.

A file is a sealed archive (`hardspheres.archive`) of two members: a tree in JSON, and the bytes of all arrays
in it. Reading one executes nothing and imports nothing: objects are made of classes that are loaded already
(dataclasses of this project, scenes and simulations among them, and estimators, also a user's own), without
calling their constructors. What is read equals what was written to the last bit; an array that appeared in
several places is one array again.
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

__all__ = ["NotStorable", "decode", "encode", "read", "write"]

OURS = {"hardspheres", "analysis", "studies"}
PLAIN = (type(None), bool, int, float, str)
NOT_STORED = "cannot be stored in a checkpoint; make it of numbers, arrays, lists and dicts"
KINDS = "biuf"  # of arrays: truth values, integers, floating point numbers


class NotStorable(CheckpointError, TypeError):
    """A value that no file can hold here."""


def _name(kind: type) -> str:
    module = "__main__" if kind.__module__ == "__mp_main__" else kind.__module__  # a script, in a worker
    return f"{module}.{kind.__qualname__}"


def _known(name: str) -> type | None:
    """Return the class of this name, None where it is not loaded, or not made to be stored."""
    module, _, own = name.rpartition(".")
    kind = vars(sys.modules[module]).get(own) if module in sys.modules else None
    if not isinstance(kind, type) or _name(kind) != name:
        return None
    if issubclass(kind, Estimator):  # of any module: all that it knows is in its `vars`
        return None if any(vars(base).get("__slots__") for base in kind.__mro__) else kind
    ours = module.partition(".")[0] in OURS
    return kind if ours and (is_dataclass(kind) or issubclass(kind, BlockSeries)) else None


def encode(value: Any) -> Arrays:
    """Return a value as the members of an archive.

    Parameters
    ----------
    value
        None, numbers, texts, arrays of numbers, lists, tuples, dicts and deques of such, scenes, simulations,
        estimators, and dataclasses of this project.

    Raises
    ------
    NotStorable
        If something else is in it.
    """
    arrays: dict[int, tuple[int, NDArray[Any]]] = {}  # by id: kept, so that no other array gets the same

    def place(array: NDArray[Any]) -> int:
        if array.dtype.kind not in KINDS:
            raise NotStorable(f"an array of {array.dtype} {NOT_STORED}")
        return arrays.setdefault(id(array), (len(arrays), array))[0]

    def tree(value: Any) -> Any:
        kind = type(value)
        if kind in PLAIN:
            return value
        if kind is list or kind is tuple:
            return {kind.__name__: [tree(each) for each in value]}
        if kind is dict:
            return {"dict": [[tree(key), tree(each)] for key, each in value.items()]}
        if kind is deque:
            return {"deque": [value.maxlen, [tree(each) for each in value]]}
        if kind is np.ndarray:
            return {"array": place(value)}
        if isinstance(value, np.generic):
            return {"scalar": place(np.asarray(value))}
        if kind is hs.Simulation:
            return {"simulation": {name: place(array) for name, array in value._arrays().items()}}
        if _known(_name(kind)) is not kind:
            raise NotStorable(f"a {_name(kind)} {NOT_STORED}")
        return {"object": [_name(kind), {name: tree(each) for name, each in _contents(value).items()}]}

    whole = {"tree": tree(value), "arrays": []}
    found = [array for _, array in arrays.values()]
    whole["arrays"] = [[a.dtype.newbyteorder("<").str, a.shape, a.flags.fnc] for a in found]
    members = {"tree": json.dumps(whole).encode(), "data": b"".join(a.tobytes("A") for a in found)}
    return {name: np.frombuffer(content, dtype=np.uint8) for name, content in members.items()}


def _contents(value: Any) -> dict[str, Any]:
    """Return what is stored of an object: the fields of a dataclass, without cached values."""
    if is_dataclass(value) and not isinstance(value, Estimator):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return dict(vars(value))


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
            dtype, count = np.dtype(name), math.prod(shape)
            if dtype.kind not in KINDS or min(shape, default=0) < 0:
                raise CheckpointError(f"it holds an array of {dtype} of shape {shape}")
            array = np.frombuffer(data, dtype, count, place) if count else np.zeros(0, dtype)
            arrays.append(array.reshape(shape, order="F" if by_columns else "C").copy(order="K"))
            place += count * dtype.itemsize
        return _value(whole["tree"], arrays)
    except CheckpointError:
        raise
    except Exception as error:  # a crafted file fails in its own way
        raise CheckpointError(f"it cannot be understood ({type(error).__name__})") from error


def _value(tree: Any, arrays: list[NDArray[Any]]) -> Any:
    if type(tree) in PLAIN:
        return tree
    ((kind, content),) = tree.items()
    match kind:
        case "list":
            return [_value(each, arrays) for each in content]
        case "tuple":
            return tuple(_value(each, arrays) for each in content)
        case "dict":
            return {_value(key, arrays): _value(each, arrays) for key, each in content}
        case "deque":
            return deque((_value(each, arrays) for each in content[1]), maxlen=content[0])
        case "array":
            return arrays[content]
        case "scalar":
            return arrays[content][()]
        case "simulation":
            return hs.Simulation._from_arrays({name: arrays[place] for name, place in content.items()})
        case "object":
            return _object(content[0], {name: _value(each, arrays) for name, each in content[1].items()})
    raise CheckpointError(f"it holds a {kind!r}, which this version does not know")


def _object(name: str, parts: dict[str, Any]) -> Any:
    kind = _known(name)
    if kind is None:
        raise CheckpointError(f"it holds an object of {name!r}, which is no class that is stored here")
    new: Any = object.__new__(kind)
    if issubclass(kind, Estimator) or not is_dataclass(kind):
        vars(new).update(parts)
        return new
    names = [field.name for field in fields(kind)]
    if set(parts) != set(names):
        raise CheckpointError(f"it holds a {name} of another version")
    if isinstance(new, hs.Scene):
        new.__setstate__(tuple(parts[part] for part in names))  # arrays read-only again
    else:
        for part, value in parts.items():
            object.__setattr__(new, part, value)
    return new


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
