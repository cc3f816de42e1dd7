"""Imports run one way, studies -> analysis -> hardspheres, without circles; importing the package costs next to nothing."""

import ast
import graphlib
import importlib.util
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


def modules(package):
    """Source files of a package by the names of their modules."""
    files = sorted((ROOT / package).rglob("*.py"))
    parts = [(file, file.relative_to(ROOT).with_suffix("").parts) for file in files]
    return {".".join(name[:-1] if name[-1] == "__init__" else name): file for file, name in parts}


def needed(source, known, package):
    """Which of the known modules a file in a package imports, by their whole names; imports for types alone do not count."""

    def imports(node):
        for child in ast.iter_child_nodes(node):
            for_types = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
            if for_types:
                continue
            if isinstance(child, ast.Import):
                yield from (alias.name for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                module = importlib.util.resolve_name("." * child.level + (child.module or ""), package)
                names = (f"{module}.{alias.name}" for alias in child.names)
                yield from (name if name in known else module for name in names)
            yield from imports(child)

    return known & set(imports(ast.parse(source)))


def all_needed(package):
    """What each module of a package imports of that package."""
    files = modules(package)
    return {
        name: needed(
            file.read_text(encoding="utf-8"),
            {*files},
            name if file.name == "__init__.py" else name.rpartition(".")[0],
        )
        for name, file in files.items()
    }


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_no_module_needs_itself(package):
    """No circles, through imports inside functions either."""
    needs = all_needed(package)
    assert sum(map(len, needs.values())) > len(needs) > 10
    tuple(graphlib.TopologicalSorter(needs).static_order())  # raises CycleError, which names the circle


def test_rooms_of_the_studies():
    """A replica knows no study, a figure none but by its types, and no question leans on what validates the engine."""
    for name, others in all_needed("studies").items():
        room, *rooms = (f"{module}.".split(".")[1] for module in (name, *others))
        if room == "running":
            assert {*rooms} <= {"running", "registry", "formats", "options"}, (
                name
            )  # names of programs, files, options
        if room == "figures":
            assert {*rooms} <= {"figures", "fluid", "formats"}, name
        if room not in ("validation", "cli"):
            assert "validation" not in rooms, name


def test_the_check_of_circles_sees_a_circle():
    known = {"a", "a.b", "a.c", "a.d"}
    source = "from . import b\nif TYPE_CHECKING:\n    import a.d\nclass C:\n    def f():\n        from a.c import x\n"
    assert needed(source, known, "a") == {"a.b", "a.c"}
    assert needed("from ..c import x", known, "a.e") == {"a.c"}
    with pytest.raises(graphlib.CycleError):
        tuple(graphlib.TopologicalSorter({"a.b": {"a.c"}, "a.c": {"a.b"}}).static_order())


def run(code):
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout.split()


def test_importing_loads_neither_numba_nor_ase_nor_scipy():
    heavy = "{'numba', 'llvmlite', 'ase', 'scipy', 'matplotlib', 'numpy'} & set(sys.modules)"
    assert run(f"import sys, hardspheres as hs; dir(hs); hs.SceneError; print(*{heavy})") == []
    code = f"import sys, hardspheres as hs; hs.lattice_gas(10, 0.1, seed=1); print(*{heavy})"
    assert run(code) == ["numpy"]


def test_scipy_s_statistics_are_loaded_by_those_who_ask_for_a_distribution_only():
    """They take as long as all the rest of a study's imports; sibling: one who asks."""
    loaded = "print('scipy.stats' in sys.modules, 'scipy.interpolate' in sys.modules)"
    assert run(f"import studies.thermalisation, studies.pressure, sys; {loaded}") == ["False", "False"]
    asks = "from analysis import theory; theory.energy_share(10, 3)"
    assert run(f"import sys; {asks}; {loaded}")[0] == "True"


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


HEAVY = {"stats", "optimize", "integrate", "interpolate", "spatial", "signal"}  # of SciPy: 0.1 to 0.3 s each


def heavy_at_once(source):
    """Which of these a module imports whenever it is imported, and not where they are needed."""
    found = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "scipy":
            found |= {*node.module.split("."), *(alias.name for alias in node.names)} & HEAVY
        elif isinstance(node, ast.Import):
            found |= {part for alias in node.names for part in alias.name.split(".")[1:]} & HEAVY
    return found


def test_no_study_waits_for_parts_of_scipy_that_it_does_not_use():
    """Sibling: at the top of a file they are found."""
    for package in MAY_IMPORT:
        for file in sorted((ROOT / package).rglob("*.py")):
            if "validation" not in file.parts:  # which uses them all
                found = heavy_at_once(file.read_text(encoding="utf-8"))
                assert not found, (
                    f"{file.relative_to(ROOT)} imports {found} at once; import it where it is needed"
                )
    assert heavy_at_once("from scipy.stats import chi2\nimport scipy.optimize") == {"stats", "optimize"}
    assert not heavy_at_once("from scipy import special\ndef f():\n    from scipy import stats")
