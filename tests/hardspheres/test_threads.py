"""Threads, processes, and the cache of compiled kernels: the same bits as alone, and never a stale kernel."""

import ast
import contextlib
import hashlib
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest
from scenes import everything, gas, run_alone

import hardspheres as hs
from hardspheres import kernel_cache
from hardspheres.kernel import specialise

PACKAGE = Path(hs.__file__).parent


def run(scene):
    sim = hs.Simulation(scene)
    for _ in range(20):
        sim.run(collisions=500)
    return everything(sim)


@pytest.mark.parametrize(
    "kinds", [("3d", "3d"), ("3d", "2d_mixture_walls")], ids=["same kernel", "two kernels"]
)
def test_two_threads_give_the_same_bits_as_alone(kinds):
    scenes = [gas(kind, 300, 0.1, seed=seed) for seed, kind in enumerate(kinds)]
    alone = [run(scene) for scene in scenes]
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(run, scenes))
    assert together == alone
    assert alone[0] != alone[1]


def test_a_thread_runs_while_another_is_within_the_kernel():
    """One call of the kernel holds no lock of the interpreter: runs in a second thread begin and end meanwhile."""
    long, short = (hs.Simulation(gas("3d", 300, 0.1, seed=seed)) for seed in (1, 2))
    for sim in (long, short):
        sim.run(collisions=10)
    span = []

    def one_call():
        span.append(time.perf_counter())
        long._engine.run(2**62, 0.0, 2**62, 3_000_000)
        span.append(time.perf_counter())

    thread = threading.Thread(target=one_call)
    thread.start()
    runs = []
    while thread.is_alive():
        began = time.perf_counter()
        short.run(collisions=10)
        runs.append((began, time.perf_counter()))
    thread.join()
    assert sum(span[0] < began and end < span[1] for began, end in runs) > 3


def test_threads_that_load_kernels_at_once(monkeypatch):
    """Each gets its own constants, whoever comes first; the same kind is loaded once."""
    flags = [
        (dim, walls, False, False, sparse)
        for dim in (2, 3)
        for walls in (False, True)
        for sparse in (False, True)
    ]
    for name in [
        name
        for name in sys.modules
        if name.startswith("hardspheres.kernel.") and "d" in name.split(".")[2][1:2]
    ]:
        monkeypatch.delitem(sys.modules, name)
    start, cached_in = threading.Barrier(16), kernel_cache.cached_in

    @contextlib.contextmanager
    def slowly(folder):
        with cached_in(folder):
            time.sleep(0.02)  # so that others would come in between
            yield

    def load(flag):
        start.wait()
        return specialise(*flag)

    monkeypatch.setattr(kernel_cache, "cached_in", slowly)
    with ThreadPoolExecutor(16) as pool:
        modules = list(pool.map(load, flags * 2))
    for flag, module, again in zip(flags, modules[:8], modules[8:], strict=True):
        assert module is again
        own = sys.modules[module.__name__.replace("loop", "flags")]
        assert (own.DIM, own.WALLS, own.SIZES, own.MASSES, own.SPARSE) == flag
        assert module.at.DIM == flag[0]
        if module.run.stats.cache_path:
            assert Path(module.run.stats.cache_path).parent.name == module.__name__.split(".")[2]


def test_replicas_in_spawned_processes_give_the_same_bits():
    seeds = [1, 2, 3, 4]
    alone = [run_alone(seed) for seed in seeds]
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert list(pool.map(run_alone, seeds)) == alone


# The cache.


def sources(folder):
    names = [f"{name}.py" for name in (*kernel_cache.FORMULAS, *kernel_cache.BESIDE)]
    return [*(folder / name for name in names), *sorted((folder / "kernel").rglob("*.py"))]


def test_an_edit_of_any_kernel_file_makes_a_new_cache(tmp_path, monkeypatch):
    copy = tmp_path / "hardspheres"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(kernel_cache, "__file__", str(copy / "kernel_cache.py"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    folders = [kernel_cache.cache_folder("3d")]
    assert kernel_cache.cache_folder("3d") == folders[0]
    for source in sources(copy):
        source.write_bytes(source.read_bytes() + b"# an edit\n")
        folders.append(kernel_cache.cache_folder("3d"))
    monkeypatch.setattr(kernel_cache.numba, "__version__", "99.0")
    folders.append(kernel_cache.cache_folder("3d"))
    assert len(set(folders)) == len(folders) == len(sources(copy)) + 2 > 30


def test_kernels_are_compiled_from_these_files_alone():
    """What a kernel takes from elsewhere in the package would not be in the digest."""
    taken = set()
    for source in sources(PACKAGE):
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.ImportFrom)
                and (node.module or "").startswith("hardspheres")
                and not node.level
            ):
                names = (
                    [node.module]
                    if node.module != "hardspheres"
                    else [f"hardspheres.{a.name}" for a in node.names]
                )
                taken |= {name for name in names if not f"{name}.".startswith("hardspheres.kernel.")}
    # `kernel_cache` says where kernels are kept; none of them calls it.
    assert taken == {f"hardspheres.{name}" for name in (*kernel_cache.FORMULAS, "kernel_cache")}


@pytest.fixture
def nowhere(tmp_path, monkeypatch):
    """Neither home nor cache nor temporary folder can be written: all lie in a file."""
    (tmp_path / "file").touch()
    for name in ("HOME", "USERPROFILE", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "file" / "x"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "file" / "x"))
    return tmp_path


@pytest.mark.filterwarnings("ignore:.* not used for compiled kernels")
def test_without_any_folder_there_is_no_cache(nowhere, monkeypatch):
    assert kernel_cache.cache_folder("3d") is None
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert kernel_cache.cache_folder("3d") is None
    monkeypatch.setattr(tempfile, "tempdir", str(nowhere))  # sibling: a temporary folder will do
    assert kernel_cache.cache_folder("3d").is_relative_to(nowhere)


@pytest.mark.filterwarnings("ignore:.* not used for compiled kernels")
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="owners of files")
def test_a_temporary_cache_that_others_can_write_is_not_used(nowhere, monkeypatch):
    """Kernels found in a cache are executed."""
    monkeypatch.setattr(tempfile, "tempdir", str(nowhere))
    private = nowhere / f"cache-{os.getuid()}"
    private.mkdir()
    private.chmod(0o777)
    assert kernel_cache.cache_folder("3d") is None
    private.chmod(0o700)
    assert kernel_cache.cache_folder("3d") is not None


PROGRAM = """
import json, sys, tempfile, hashlib
{prelude}
import hardspheres as hs
sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.05, seed=1))
sim.run(collisions=500)
stats = sim._engine.kernels.run.stats
print(json.dumps([hs.__file__, hashlib.sha256(sim._engine.rows.tobytes()).hexdigest(),
                  sum(stats.cache_hits.values()), sum(stats.cache_misses.values())]))
"""


def child(cache, path, prelude="", **more):
    env = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
    env |= {"XDG_CACHE_HOME": str(cache), "HOME": str(cache), "PYTHONPATH": str(path), "PYTHONSAFEPATH": "1"}
    env |= more
    command = [sys.executable, "-B", "-c", PROGRAM.format(prelude=prelude)]
    return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def result(process):
    out, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors[-2000:]
    assert "Traceback" not in errors
    return json.loads(out)


@pytest.mark.slow
def test_an_install_folder_that_is_read_only_and_nowhere_to_write(tmp_path):
    """Nothing is ever written beside the sources; with no folder for a cache at all the kernels are compiled each time."""
    copy = tmp_path / "installed" / "hardspheres"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for each in [copy, *copy.rglob("*")]:
        each.chmod(0o555 if each.is_dir() else 0o444)
    before = sorted(copy.rglob("*"))
    (tmp_path / "file").touch()
    nowhere = tmp_path / "file" / "x"
    without = child(nowhere, copy.parent, f"tempfile.tempdir = {str(nowhere)!r}")
    where, digest, hits, misses = result(without)
    assert where.startswith(str(copy))
    assert (hits, misses) == (0, 1)
    assert sorted(copy.rglob("*")) == before
    sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.05, seed=1))
    sim.run(collisions=500)
    assert digest == hashlib.sha256(sim._engine.rows.tobytes()).hexdigest()


@pytest.mark.slow
def test_processes_that_compile_at_once(tmp_path):
    """Three begin with an empty cache, for two kinds of processors; all are right.

    The next one of each kind finds a kernel that is, and that was made for it.
    """
    kinds = [{}, {"NUMBA_CPU_NAME": "generic"}]
    started = [child(tmp_path, PACKAGE.parent, **kind) for kind in (kinds[0], *kinds)]
    results = [result(process) for process in started]
    assert len({digest for _, digest, _, _ in results}) == 1
    assert [(hits, misses) for *_, hits, misses in results] == [(0, 1)] * 3
    for kind in kinds:
        _, digest, hits, misses = result(child(tmp_path, PACKAGE.parent, **kind))
        assert (digest, hits, misses) == (results[0][1], 1, 0)
    assert len(list(tmp_path.rglob("lock"))) == len(kinds)
    assert not list(tmp_path.rglob("*.tmp.*"))
