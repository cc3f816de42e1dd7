"""What the compiled kernels must be: free of reference counts, vectorised, strict, cached, and never stale."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hardspheres as hs
from hardspheres.kernel.arrays import TYPES

PROGRAM = """
import json, re, sys
import hardspheres as hs
sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.3, seed=1))
sim.run(collisions=10)
run = sim._engine.kernels.run
asm = "".join(run.inspect_asm().values()) if not run.stats.cache_hits else ""
particles = sys.modules[sim._engine.kernels.__name__.replace("loop", "common.particles")]
parts = list(particles.nearest.overloads.values())
print(json.dumps({
    "hits": sum(run.stats.cache_hits.values()),
    "misses": sum(run.stats.cache_misses.values()),
    "references": len(re.findall("NRT_incref", asm)),
    "vector_roots": len(re.findall("vsqrtpd|fsqrt|sqrtpd", asm)),
    "fused": len(re.findall("vfm(add|sub)|fmadd|fmla", asm)),
    "calls_for_roots": len(re.findall(r"call\\S*\\s+sqrt", asm)),
    "parts": len(parts),
    "executable_parts": sum(hasattr(part.library, "get_pointer_to_function") for part in parts),
}))
"""


def child(program, cache, *path):
    """Run a program in a fresh interpreter with its own kernel cache; returns the JSON that it prints."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
    env |= {
        "XDG_CACHE_HOME": str(cache),
        "PYTHONPATH": os.pathsep.join(map(str, path)),
        "PYTHONSAFEPATH": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", program], env=env, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def compiled(cache):
    return child(PROGRAM, cache)


def test_no_reference_counts_and_vector_arithmetic(compiled):
    """Only the entry holds references to its arguments; the prediction takes its square roots in vectors, nothing is fused."""
    assert compiled["misses"] == 1
    assert compiled["references"] <= 2
    assert compiled["vector_roots"] >= 1
    assert compiled["calls_for_roots"] == 0
    assert compiled["fused"] == 0


def test_the_next_process_finds_the_kernel(cache, compiled):
    again = child(PROGRAM, cache)
    assert (again["hits"], again["misses"]) == (1, 0)
    assert len(list(Path(cache).rglob("*.nbc"))) == 1


def uses(combinations):
    """Program that runs these specialisations and tells which kernels were compiled and which were found."""
    return f"""
import json, sys
import numpy as np
import hardspheres as hs
from hardspheres.engine import Engine, How
hits = misses = 0
for dim, walls, sizes, masses, sparse, grows, flights in {combinations!r}:
    odd = np.arange(64) % 2
    scene = hs.random_gas(
        n=64, packing_fraction=0.05, dim=dim, boundary="wall" if walls else "periodic", seed=1,
        radii=np.where(odd, 0.4, 0.5) if sizes else 0.5, masses=np.where(odd, 1.0, 2.0) if masses else 1.0,
    )
    growth, search = (0.9, 0.001) if grows else None, "windows" if sparse else "lists"
    engine = Engine(scene, growth, flights, how=How(search))
    assert bool(engine.arrays.counter[engine.layout.WINDOW_BUCKETS]) == sparse
    engine.run(2**62, 0.0, 1, 10**6)
    stats = engine.kernels.run.stats
    hits += sum(stats.cache_hits.values())
    misses += sum(stats.cache_misses.values())
print(json.dumps([hits, misses]))
"""


def test_the_next_process_finds_every_kernel_of_this_suite():
    """The kinds that the default tests compile, in the usual cache: a second process compiles none of them."""
    kinds = [
        (3, False, False, False),
        (2, False, False, False),
        (3, True, False, False),
        (2, True, True, True),
        (3, False, True, True),
    ]
    combinations = [(*kind, sparse, False, False) for kind in kinds for sparse in (False, True)]
    program = uses([*combinations, (*kinds[0], True, False, True), (*kinds[4], False, False, True)])
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    child(program, base, Path(hs.__file__).parent.parent)
    assert child(program, base, Path(hs.__file__).parent.parent) == [12, 0]


@pytest.mark.long
def test_the_next_process_finds_every_kernel_there_is(tmp_path):
    """All specialisations: twenty minutes of compilation."""
    flags = list(itertools.product((2, 3), *[(False, True)] * 4))
    program = uses(
        [(*flag, False, free) for flag in flags for free in (False, True)]
        + [(*flag[:4], False, True, False) for flag in flags if not flag[4]]
    )
    assert child(program, tmp_path, Path(hs.__file__).parent.parent) == [0, 80]
    assert child(program, tmp_path, Path(hs.__file__).parent.parent) == [80, 0]


def test_an_edit_anywhere_in_the_kernels_makes_a_new_cache(tmp_path):
    """Numba itself looks at the outermost function's file only."""
    copy = tmp_path / "hardspheres"
    shutil.copytree(Path(hs.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    program = "import json, hardspheres.kernel_cache as c; print(json.dumps([c.__file__, str(c.cache_folder('3d'))]))"
    folders = set()
    edits = ("kernel/common/particles.py", "kernel/flags.py", "collision.py", "growth.py", "sums.py")
    for edited in (None, *edits):
        if edited:
            with open(copy / edited, "a", encoding="utf-8") as file:
                file.write("# an edit\n")
        where, folder = child(program, tmp_path / "cache", tmp_path)
        assert where.startswith(str(tmp_path))
        folders.add(folder)
    assert len(folders) == 6


def test_another_packages_cache_is_left_alone():
    import numba

    from hardspheres.kernel import specialise

    before = numba.config.CACHE_DIR
    specialise(3, False, False, False, False)
    assert before == numba.config.CACHE_DIR


def test_parts_are_compiled_once_and_only_into_the_kernel(compiled):
    """One part is called with three constants: no code for each, and none outside of the kernel."""
    assert compiled["parts"] == 1
    assert compiled["executable_parts"] == 0


@pytest.mark.parametrize("search", ["lists", "windows"])
def test_arrays_have_the_types_that_kernels_take_them_for(search):
    """Kernels know only where an array is, and trust the record for its type."""
    sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.05, seed=1), search=search, free_paths=True)
    arrays = sim._engine.arrays
    assert {name: array.dtype.type for name, array in arrays._asdict().items()} == TYPES
    assert all(array.flags.c_contiguous and array.flags.aligned for array in arrays)
