"""Sealed archives: named arrays in one NumPy .npz file, written atomically and checked by SHA-256 when read.

The file is a plain zip of .npy members, uncompressed (random digits do not compress), so `numpy.load` opens
it too. The comment at its end is the SHA-256 of every byte before. Members are float64, int64 or uint8,
little-endian; nothing is ever unpickled, and declared sizes are checked against the bytes in the file.
"""

import contextlib
import hashlib
import io
import math
import os
import stat
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import CheckpointError
from hardspheres.memory import require_memory
from hardspheres.temporary import remove_leftovers, replacing

__all__ = ["Arrays", "read_archive", "write_archive"]

Arrays = dict[str, NDArray[Any]]

SEAL = b"sha256 "
DIGEST = 64  # hexadecimal digits
TYPES = ("<f8", "<i8", "|u1")
MOST_MEMBERS = 100


def write_archive(path: str | os.PathLike[str], arrays: Arrays, *, durable: bool = True) -> None:
    """Write named arrays to a file atomically: after a crash it is either the old one or the new one.

    Parameters
    ----------
    path : path
        The file, replaced if it exists.
    arrays : dict of str to array
        Arrays of float64, int64 or uint8. The same arrays give the same bytes.
    durable : bool, default True
        Wait for the disk. Otherwise a power failure may leave an incomplete file (detected by its checksum);
        a crash of the process cannot.

    Raises
    ------
    CheckpointError
        When the file cannot be written; nothing is then left behind, and an older file is as it was.
    """
    target = _as_path(path)
    try:
        if target.exists() and not target.is_file():
            raise CheckpointError(f"{target} is no ordinary file; give the checkpoint another name")
        with replacing(target) as temporary, open(temporary, "x+b") as file:
            remove_leftovers(target.parent, os.fstat(file.fileno()).st_mtime)
            _write_members(file, arrays)
            _seal(file)
            if durable:
                file.flush()
                os.fsync(file.fileno())
    except OSError as error:
        why = error.strerror or error
        raise CheckpointError(
            f"the checkpoint {target} cannot be written: {why}; make room, or give another path"
        ) from error
    if durable:  # the new name too, where the system can
        with contextlib.suppress(OSError):
            folder = os.open(target.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def read_archive(path: str | os.PathLike[str]) -> Arrays:
    """Return the arrays of an archive, read-only, after a check of its checksum.

    Raises
    ------
    CheckpointError
        When the file cannot be read, is no such archive, is cut short or altered, or holds anything but plain
        arrays.
    """
    source = _as_path(path)
    try:
        found = os.stat(source)
        if not stat.S_ISREG(found.st_mode):
            raise CheckpointError(f"{source} is no ordinary file; name a checkpoint")
        require_memory(4 * found.st_size, f"{source} and its arrays", CheckpointError, "use a larger machine")
        content = source.read_bytes()
    except OSError as error:
        raise CheckpointError(f"the checkpoint {source} cannot be read: {error.strerror or error}") from error
    body, digest = content[:-DIGEST], content[-DIGEST:]
    if not content:
        raise CheckpointError(f"{source} is empty, not a checkpoint")
    if not content.startswith(b"PK"):
        raise CheckpointError(f"{source} is not a checkpoint: it does not begin as one")
    if not body.endswith(SEAL):
        raise CheckpointError(f"{source} is not a checkpoint, or its end is missing; use an older one")
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise CheckpointError(f"{source} is damaged: its checksum does not match; use an older one")
    try:
        return _members(content)
    except Exception as error:  # the checksum holds, so the file is ours, or forged to fail in any way
        why = str(error) or type(error).__name__
        raise CheckpointError(f"{source} is not a checkpoint as this package writes them: {why}") from error


def _as_path(path: str | os.PathLike[str]) -> Path:
    try:
        name = os.fspath(path)
        if not isinstance(name, str) or not name or "\0" in name:
            raise TypeError
    except TypeError:
        raise CheckpointError(f"a checkpoint needs the name of a file, not {path!r}") from None
    return Path(name)


def _write_members(file: io.BufferedRandom, arrays: Arrays) -> None:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        archive.comment = SEAL + b"0" * DIGEST
        for name, array in arrays.items():
            plain = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
            # No time stamp: the same arrays give the same file.
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, plain, version=(1, 0), allow_pickle=False)


def _seal(file: io.BufferedRandom) -> None:
    """Write the digest of all bytes before it over the last ones."""
    file.truncate(file.seek(0, os.SEEK_END) - DIGEST)
    file.seek(0)
    digest = hashlib.file_digest(file, "sha256")
    file.write(digest.hexdigest().encode())


def _members(content: bytes) -> Arrays:
    """Return the arrays; exceptions of any type mean an invalid file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
        if len(members) > MOST_MEMBERS or len({member.filename for member in members}) < len(members):
            raise ValueError("too many members, or two of the same name")
        if any(member.compress_type != zipfile.ZIP_STORED for member in members):
            raise ValueError("a member is compressed")
        if sum(member.file_size for member in members) > len(content):
            raise ValueError("its members are larger than the file")
        return {
            member.filename.removesuffix(".npy"): _array(member.filename, archive.read(member))
            for member in members
        }


def _array(name: str, content: bytes) -> NDArray[Any]:
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name} is of another version of .npy")
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.str not in TYPES or by_columns:
        raise ValueError(f"{name} holds {dtype}, not plain numbers row by row")
    if math.prod(shape) * dtype.itemsize != len(content) - stream.tell():
        raise ValueError(f"{name} declares the shape {shape}, which is not what it holds")
    return np.frombuffer(content, dtype, math.prod(shape), stream.tell()).reshape(shape)
