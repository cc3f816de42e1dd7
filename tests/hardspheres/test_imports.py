"""Imports run one way, studies -> analysis -> hardspheres, and importing the package costs next to nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import hardspheres

ROOT = Path(hardspheres.__file__).parents[1]
MAY_IMPORT = {
    "hardspheres": {"hardspheres"},
    "analysis": {"hardspheres", "analysis"},
    "studies": {"hardspheres", "analysis", "studies"},
}


def imported(source, package):
    """Top-level packages of ours that a source file imports, also inside functions and relatively."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield package if node.level else node.module.split(".")[0]


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_run_one_way(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for file in files:
        ours = {*imported(file.read_text(encoding="utf-8"), package)} & {*MAY_IMPORT, "tests"}
        assert ours <= MAY_IMPORT[package], f"{file.relative_to(ROOT)} imports {ours - MAY_IMPORT[package]}"


def test_the_check_of_imports_sees_an_import():
    source = (
        "def f():\n    from studies.cli import main\n    import analysis.theory as t\n    from . import x\n"
    )
    assert set(imported(source, "hardspheres")) == {"studies", "analysis", "hardspheres"}


def run(code):
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


def test_importing_loads_neither_numba_nor_ase_nor_scipy():
    heavy = "{'numba', 'llvmlite', 'ase', 'scipy', 'matplotlib', 'numpy'} & set(sys.modules)"
    assert run(f"import sys, hardspheres as hs; dir(hs); hs.SceneError; print(*{heavy})") == []
    code = f"import sys, hardspheres as hs; hs.random_gas(10, 0.1, seed=1); print(*{heavy})"
    assert run(code) == ["numpy"]


def test_every_public_name_is_there_and_no_other():
    for name in hardspheres.__all__:
        assert getattr(hardspheres, name) is not None
        assert name in dir(hardspheres)
    assert {name for name in dir(hardspheres) if not name.startswith("_")} == set(hardspheres.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'Scenery'"):
        _ = hardspheres.Scenery


def test_python_m_hardspheres_is_the_command():
    """Found as pip recorded it; sibling: where it did not, the command says so."""
    for module, option in (("hardspheres", "--version"), ("studies", "--version")):
        done = subprocess.run(
            [sys.executable, "-m", module, option], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stdout) == (0, f"hardspheres {hardspheres.__version__}\n"), done.stderr
    code = (
        "import importlib.metadata as m, runpy; m.entry_points = lambda **_: ()\n"
        "runpy.run_module('hardspheres', run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1 and done.stderr.startswith("error: the command line is not installed")
