"""The disk cache of compiled kernels. No kernel is compiled from this file: editing it recompiles none.

    ROOT/hardspheres/DIGEST/KIND     kernels for one kind of scene; digest of sources and kind of processor
    ROOT/hardspheres/DIGEST/lock     held, shared, by every process that uses them

Machines of several kinds may share ROOT, and any number of processes may start on it at once. Numba alone
would keep kernels for two processors under one name, where both were compiled at once.

Cached kernels are executed. A folder is used only if no other user can have put them there: it is ours, and
every folder on the way to it belongs to us or to the system and is writable by no other user. ROOT is the
first such of what NUMBA_CACHE_DIR or XDG_CACHE_HOME names, or else the user's cache folder, and a private
folder among the temporary ones. Kernels that no process has used for 30 days are removed.
"""

import contextlib
import functools
import getpass
import hashlib
import multiprocessing
import os
import re
import stat
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import platformdirs
from numba.core.registry import cpu_target

try:
    import fcntl
except ImportError:  # no POSIX
    fcntl = None  # type: ignore[assignment]

__all__ = ["cache_folder", "cached_in"]

FORMULAS = ("collision", "falling", "gravity", "growth", "sums")  # compiled into kernels, and not among them
BESIDE = ("insertion",)  # compiled by themselves, as kernels are
UNUSED = 30 * 86400.0  # seconds without use after which kernels are removed
NAMES = (
    r"[0-9a-f]{16}",
    r"\w+",
    r"\w+_[0-9a-f]{40}",
    r".+\.nb[ic](\.tmp\.[0-9a-f]+)?",
)  # ours, level by level

config: Any = numba.config
_SETTING = threading.RLock()
_in_use: dict[Path, int] = {}


class _Unsafe(Exception):
    """Other users could have put kernels here."""


def cache_folder(tag: str) -> Path | None:
    """Return the folder for the compiled kernels of one specialisation; None if there is no usable one.

    Named by a digest of all sources that the kernels are compiled from: Numba looks only at the file of the
    outermost function, and would serve an old kernel after an edit of a function in another file. A warning
    says once which folder is not used, and why.
    """
    if config.BOUNDSCHECK:
        return None
    refused = []
    for home in _homes():
        try:
            folder = _folder(_pinned(home).resolve() / _digest() / tag)
            break
        except (_Unsafe, OSError, RuntimeError) as error:  # RuntimeError: no home, or links in a circle
            reason = getattr(error, "strerror", None) or error
            refused.append(f"{home} is not used for compiled kernels: {reason}")
    else:
        folder = None
    if refused:
        instead = f"{folder.parents[1]} is used" if folder else "they are compiled anew in every process"
        _warn(f"{'; '.join(refused)}; {instead}. Set NUMBA_CACHE_DIR to a folder that only you can write")
    return folder


@contextlib.contextmanager
def cached_in(folder: Path | None) -> Iterator[None]:
    """Cache kernels decorated inside in this folder; Numba's process-wide setting is restored afterwards.

    One thread at a time: others wait.
    """
    with _SETTING:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(folder or "")
        try:
            yield
        finally:
            config.CACHE_DIR = before


def _homes() -> Iterator[Path]:
    """Yield candidates for the cache folder: by the environment or the user's cache, then a temporary one."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    yield Path(base, "hardspheres") if base else platformdirs.user_cache_path("hardspheres", appauthor=False)
    with contextlib.suppress(OSError):
        user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
        yield Path(tempfile.gettempdir()) / f"cache-{user}" / "hardspheres"


@functools.cache
def _pinned(home: Path) -> Path:
    """Return the absolute path, fixed at the first call: the working directory may change."""
    return home.expanduser().absolute()


def _digest() -> str:
    here = Path(__file__).parent
    processor = cpu_target.target_context.codegen().magic_tuple()  # triple, name and features
    digest = hashlib.sha256("\n".join([numba.__version__, *map(str, processor)]).encode())
    names = (f"{name}.py" for name in (*FORMULAS, *BESIDE))
    for source in [*(here / name for name in names), *sorted((here / "kernel").rglob("*.py"))]:
        digest.update(source.relative_to(here).as_posix().encode() + source.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def _warn(text: str) -> None:
    if multiprocessing.parent_process() is None:  # which has given the warning already
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def _folder(folder: Path) -> Path:
    """Make HOME/DIGEST/KIND, mark it as in use, and return it.

    Raises
    ------
    _Unsafe
        If another user can change its content, or could.
    OSError
        If it cannot be made or written.
    """
    kernels, home = folder.parent, folder.parents[1]
    for level in [*reversed(folder.parents), folder]:
        _make(level)
        _require_safe(level, level == home or home in level.parents, kernels in (level, *level.parents))
    _require_own(folder)
    with tempfile.TemporaryFile(dir=folder):
        pass
    _hold(kernels)
    folder.mkdir(mode=0o700, exist_ok=True)  # if it was being removed
    with contextlib.suppress(OSError):
        _clean(home)
    return folder


def _make(folder: Path) -> None:
    if not folder.exists():
        folder.mkdir(mode=0o700, exist_ok=True)


def _require_safe(folder: Path, ours: bool, private: bool) -> None:
    """Refuse a folder that others can change; where links were resolved there are none left."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise _Unsafe(f"{folder} is not a folder")
    if not hasattr(os, "getuid"):
        return
    trusted = {os.getuid()} if ours else {os.getuid(), 0, os.stat("/").st_uid}
    if found.st_uid not in trusted:
        raise _Unsafe(f"{folder} belongs to another user")
    sticky = not ours and found.st_mode & stat.S_ISVTX  # as /tmp: no user can rename the files of another
    if found.st_mode & (0o077 if private else 0o022) and not sticky:
        raise _Unsafe(f"other users can {'enter' if private else 'write into'} {folder}")


def _require_own(folder: Path) -> None:
    """Refuse a private folder with content from before it was private."""
    if not hasattr(os, "getuid"):
        return
    with os.scandir(folder) as entries:
        for entry in entries:
            try:
                owner = entry.stat(follow_symlinks=False).st_uid
            except FileNotFoundError:  # another process has just given the file its name, or removed it
                continue
            if entry.is_symlink() or owner != os.getuid():
                raise _Unsafe(f"{entry.path} is a link or belongs to another user")
            if entry.is_dir():
                _require_own(Path(entry.path))


def _hold(folder: Path) -> None:
    """Mark the kernels as used now and, until this process ends, as in use, so that none removes them."""
    os.utime(folder)
    while fcntl is not None and folder not in _in_use:
        folder.mkdir(mode=0o700, exist_ok=True)
        path = folder / "lock"
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError:
            return
        try:
            fcntl.flock(handle, fcntl.LOCK_SH)
            if os.fstat(handle).st_ino == path.stat().st_ino:
                _in_use[folder] = handle
                return
        except FileNotFoundError:
            pass  # removed meanwhile, the folder too
        except OSError:  # a file system without locks
            os.close(handle)
            return
        os.close(handle)


def _clean(home: Path) -> None:
    """Remove kernels that no process has used for long."""
    for folder in home.iterdir():
        found = folder.lstat()
        old = time.time() - found.st_mtime > UNUSED
        if old and re.fullmatch(NAMES[0], folder.name) and stat.S_ISDIR(found.st_mode):
            with contextlib.suppress(OSError):
                _remove(folder)


def _remove(folder: Path) -> None:
    """Remove the kernels of one digest: nothing in use, and no file but Numba's."""
    if fcntl is None:
        return
    lock = folder / "lock"
    handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # OSError: in use, or a file system without locks
        for path in folder.iterdir():
            _remove_ours(path, NAMES[1:])
        if list(folder.iterdir()) == [lock]:
            lock.unlink()
            folder.rmdir()
    finally:
        os.close(handle)


def _remove_ours(path: Path, names: tuple[str, ...]) -> None:
    """Remove a folder level by level as far as names are ours; links are neither followed nor removed."""
    if not re.fullmatch(names[0], path.name) or path.is_symlink():
        return
    if len(names) == 1 and path.is_file():
        path.unlink()
    elif len(names) > 1 and path.is_dir():
        for each in path.iterdir():
            _remove_ours(each, names[1:])
        with contextlib.suppress(OSError):  # something else is in it
            path.rmdir()
