"""Kernels found in a cache are executed: nobody else may be able to put them there. And old ones are removed, no more."""

import contextlib
import fcntl
import importlib.util
import os
import pickle
import stat
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

import hardspheres as hs
from hardspheres import kernel_cache
from hardspheres.kernel_cache import cache_folder, cached_in

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners of files")
DAY = 86400.0


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A root that is ours, named by the environment; the only other one is in a file."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "root"))
    (tmp_path / "file").touch()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file"))
    monkeypatch.setattr(kernel_cache, "_in_use", {})
    kernel_cache._warn.cache_clear()
    return tmp_path / "root"


def world(path):
    path.chmod(0o777)


def sticky(path):
    path.chmod(0o1777)


def group(path):
    path.chmod(0o770)


def link(path):
    path.rename(path.parent / "elsewhere")
    path.symlink_to(path.parent / "elsewhere")


def a_file(path):
    path.rename(path.parent / "elsewhere")
    path.touch()


def link_to_others(path):
    path.rename(path.parent / "elsewhere")
    (path.parent / "elsewhere").chmod(0o777)
    path.symlink_to(path.parent / "elsewhere")


def with_a_link(path):
    (path / "loop.run.nbi").symlink_to("/dev/null")


LEVELS = {"above": -1, "root": 0, "hardspheres": 1, "digest": 2, "kind": 3}
ATTACKS = [
    *[(level, attack) for level in LEVELS for attack in (world, group)],
    *[(level, attack) for level in list(LEVELS)[2:] for attack in (sticky, link_to_others, a_file)],
    ("digest", link),
    ("kind", link),
    ("kind", with_a_link),
]


@pytest.mark.parametrize(("level", "attack"), ATTACKS)
def test_a_folder_that_others_can_change_is_not_used_and_said_so_once(root, level, attack):
    folder = cache_folder("3d")
    assert folder.parents[2] == root
    attack([root.parent, root, root / "hardspheres", folder.parent, folder][LEVELS[level] + 1])
    kernel_cache._in_use.clear()
    with pytest.warns(RuntimeWarning, match=f"{root}/hardspheres is not used for compiled kernels: ") as said:
        assert cache_folder("3d") is None
    assert len(said) == 1 and "Set NUMBA_CACHE_DIR to a folder that only you can write" in str(
        said[0].message
    )
    with warnings.catch_warnings(action="error"):
        assert cache_folder("3d") is None


@pytest.mark.parametrize(
    ("level", "harmless"), [("above", sticky), ("root", sticky), ("root", link), ("hardspheres", link)]
)
def test_a_sticky_folder_is_safe_for_what_is_ours_in_it_and_links_count_as_what_they_name(
    root, level, harmless
):
    """Control of the test above."""
    folder = cache_folder("3d")
    harmless([root.parent, root, root / "hardspheres", folder.parent, folder][LEVELS[level] + 1])
    with warnings.catch_warnings(action="error"):
        assert cache_folder("3d").resolve() == folder.resolve()


def test_what_belongs_to_another_user_is_not_used(root, monkeypatch):
    cache_folder("3d")
    own = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: own + 1)
    with pytest.warns(RuntimeWarning, match="belongs to another user"):
        assert cache_folder("3d") is None


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("level", range(4))
def test_one_file_or_folder_of_another_user_is_enough(root, level):
    folder = cache_folder("3d")
    (folder / "kernel").mkdir()
    (folder / "kernel" / "loop.nbi").touch()
    victim = [folder / "kernel" / "loop.nbi", folder / "kernel", folder, folder.parent][level]
    os.chown(victim, 12345, -1)
    with pytest.warns(RuntimeWarning, match="another user"):
        assert cache_folder("3d") is None


def test_folders_are_made_for_us_alone_whatever_the_umask(root):
    before = os.umask(0)
    try:
        folder = cache_folder("3d")
    finally:
        os.umask(before)
    for level in [folder, *folder.parents[:3]]:
        assert stat.S_IMODE(level.stat().st_mode) == 0o700, level


def test_the_home_folder_is_understood(root, monkeypatch):
    monkeypatch.setenv("HOME", str(root))
    for name, value, expected in [
        ("NUMBA_CACHE_DIR", "~/a", root / "a" / "hardspheres"),
        ("XDG_CACHE_HOME", "~/b", root / "b" / "hardspheres"),
    ]:
        monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
        monkeypatch.setenv(name, value)
        assert cache_folder("3d").is_relative_to(expected)
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder("3d").is_relative_to(root)


def test_a_relative_folder_is_pinned(root, monkeypatch):
    monkeypatch.chdir(root.parent)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "relative")
    kernel_cache._pinned.cache_clear()
    folder = cache_folder("3d")
    assert folder.is_relative_to(root.parent / "relative")
    root.mkdir()
    monkeypatch.chdir(root)
    assert cache_folder("3d") == folder and not list(root.iterdir())


class Planted:
    """Unpickled, it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def compiled(source, folder):
    """What a fresh process would load: a function compiled, or taken from the cache."""
    spec = importlib.util.spec_from_file_location("planted", source)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with cached_in(folder):
        function = numba.njit(cache=folder is not None)(module.double)
    assert function(2) == 4


def test_a_planted_kernel_is_not_loaded(root):
    """The attack itself; with the folder given by hand it succeeds."""
    source, executed = root.parent / "planted.py", root.parent / "executed"
    source.write_text("def double(x):\n    return 2 * x\n")
    folder = cache_folder("3d")
    compiled(source, folder)
    (index,) = folder.rglob("*.nbi")
    index.write_bytes(pickle.dumps(Planted(executed)))
    folder.parent.chmod(0o777)
    with pytest.warns(RuntimeWarning, match="other users can enter"):
        compiled(source, cache_folder("3d"))
    assert not executed.exists()
    compiled(source, folder)
    assert executed.exists()


# Several machines and processes.


def test_every_kind_of_processor_has_kernels_of_its_own(root, monkeypatch):
    """Though both begin with an empty cache. Sibling: in one folder Numba keeps one of the two, for both."""
    source = root.parent / "planted.py"
    source.write_text("def double(x):\n    return 2 * x\n")
    by_hand = root.parent / "by_hand"
    codegen, found = kernel_cache.cpu_target.target_context.codegen(), []
    triple, processor, features = codegen.magic_tuple()
    monkeypatch.setattr(IndexDataCacheFile, "_load_index", lambda self: {})  # as it was when both began
    for kind in ((triple, processor, features), (triple, "generic", ""), (triple, processor, "-avx2")):
        monkeypatch.setattr(codegen, "magic_tuple", lambda kind=kind: kind)
        found.append(cache_folder("3d"))
        assert cache_folder("3d") == found[-1]
        compiled(source, found[-1])
        compiled(source, by_hand)
    assert len(set(found)) == len({folder.parent for folder in found}) == 3
    assert [len(list(folder.rglob("*.nbc"))) for folder in (*found, by_hand)] == [1, 1, 1, 1]


def test_a_file_that_another_process_has_just_renamed_is_no_danger(root, monkeypatch):
    """Numba writes under another name first. Sibling: one that stays, of another user."""
    folder, scandir = cache_folder("3d"), os.scandir

    class Written:
        path = str(folder / "loop.run-150.py311.1.nbc.tmp.0f")
        owner = None

        def stat(self, follow_symlinks):
            if self.owner is None:
                raise FileNotFoundError(self.path)
            return os.stat_result([0o600, 0, 0, 1, self.owner, 0, 0, 0, 0, 0])

        def is_symlink(self):
            return False

        is_dir = is_symlink

    @contextlib.contextmanager
    def with_it(path):
        with scandir(path) as entries:
            yield [*entries, Written()] if Path(path) == folder else entries

    monkeypatch.setattr(kernel_cache.os, "scandir", with_it)
    with warnings.catch_warnings(action="error"):
        assert cache_folder("3d") == folder
    monkeypatch.setattr(Written, "owner", os.getuid() + 1)
    with pytest.warns(RuntimeWarning, match="is a link or belongs to another user"):
        assert cache_folder("3d") is None


# Old kernels.


def kernels(home, digest, age):
    """Kernels as Numba leaves them, last used some days ago."""
    folder = home / digest / "3d" / ("kernel_" + "0" * 40)
    folder.mkdir(parents=True)
    for name in ("loop.run-150.py311.nbi", "loop.run-150.py311.1.nbc", "loop.run-150.py311.1.nbc.tmp.0f"):
        (folder / name).write_bytes(b"kernel")
    os.utime(home / digest, (time.time() - age,) * 2)
    return home / digest


def test_kernels_unused_for_long_are_removed_and_no_others(root):
    home = cache_folder("3d").parents[1]
    old, young = kernels(home, "0" * 16, 31 * DAY), kernels(home, "1" * 16, 29 * DAY)
    kept = cache_folder("3d").parent
    assert sorted(home.iterdir()) == sorted([young, kept])
    os.utime(kept, (0, 0))
    assert cache_folder("3d").parent == kept and time.time() - kept.stat().st_mtime < DAY
    assert not old.exists()


def test_kernels_in_use_are_never_removed(root):
    home = cache_folder("3d").parents[1]
    old = kernels(home, "0" * 16, 1000 * DAY)
    kernel_cache._hold(old)  # as another process that began long ago
    os.utime(old, (0, 0))
    cache_folder("3d")
    assert len(list(old.rglob("*.nb*"))) == 3
    os.close(kernel_cache._in_use.pop(old))
    os.utime(old, (0, 0))
    cache_folder("3d")
    assert not old.exists()


def test_what_is_not_a_kernel_is_never_removed(root):
    """In a folder of kernels, beside it, and behind links."""
    home = cache_folder("3d").parents[1]
    mixed, linked = kernels(home, "0" * 16, 31 * DAY), kernels(root, "target", 31 * DAY)
    (mixed / "3d" / "thesis.tex").write_text("years of work")
    (mixed / "linked").symlink_to(linked / "3d")
    (home / ("2" * 16)).symlink_to(linked)
    (home / "notes").mkdir()
    os.utime(mixed, (0, 0))
    os.utime(home / "notes", (0, 0))
    cache_folder("3d")
    assert (mixed / "3d" / "thesis.tex").read_text() == "years of work"
    assert not list(mixed.rglob("*.nb?")) and (mixed / "linked").is_symlink()
    assert len(list(linked.rglob("*.nb*"))) == 3
    assert (home / ("2" * 16)).is_symlink() and (home / "notes").is_dir()


def test_a_folder_that_is_just_being_removed_is_made_again(root, monkeypatch):
    """The lock that was waited for is not the one that counts, once its file has gone."""
    folder = cache_folder("3d").parent
    os.close(kernel_cache._in_use.pop(folder))
    flock, calls = fcntl.flock, []

    def removed_meanwhile(handle, how):
        flock(handle, how)
        if not calls:
            (folder / "lock").unlink()
        calls.append(how)

    monkeypatch.setattr(kernel_cache.fcntl, "flock", removed_meanwhile)
    assert cache_folder("3d").parent == folder
    assert len(calls) == 2 and (folder / "lock").exists()


LOADS = """
import sys
import numba
import hardspheres as hs
sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.3, seed=1))
sim.run(collisions=100)
print(sim.time)
print("numba.np.arraymath" in sys.modules)
numba.njit(lambda x: x + 1)(1)
print("numba.np.arraymath" in sys.modules)
"""


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT or numba.config.BOUNDSCHECK), reason="nothing is cached")
def test_a_cached_kernel_is_loaded_without_what_compiles_one():
    """It is the same kernel. Control: one that is compiled needs that."""
    sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.3, seed=1))
    sim.run(collisions=100)  # so that it is in the cache
    done = subprocess.run([sys.executable, "-c", LOADS], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(sim.time), "False", "True"]


def test_threads_take_turns_with_the_setting_of_the_cache(tmp_path):
    """Without turns the other thread's folder would be seen; sibling: both are seen, each by its own."""
    inside, tried, seen = threading.Event(), threading.Event(), []

    def other():
        inside.wait()
        tried.set()
        with cached_in(tmp_path / "other"):
            seen.append(kernel_cache.config.CACHE_DIR)

    before = kernel_cache.config.CACHE_DIR
    thread = threading.Thread(target=other)
    thread.start()
    with cached_in(tmp_path / "ours"):
        inside.set()
        tried.wait()
        thread.join(0.05)
        seen.append(kernel_cache.config.CACHE_DIR)
    thread.join()
    assert seen == [str(tmp_path / "ours"), str(tmp_path / "other")]
    assert kernel_cache.config.CACHE_DIR == before
