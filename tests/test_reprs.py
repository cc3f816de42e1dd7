"""`repr` of everything public: a line that tells what a person asks, never an error, never thousands of numbers."""

import importlib
import inspect
import pkgutil
import sys
import tracemalloc
from dataclasses import fields, is_dataclass, make_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import gas

import analysis
import hardspheres as hs
import studies
from analysis import theory
from analysis.brief import brief, word
from analysis.calibration import calibrate
from analysis.pressure import Pressure
from analysis.reduced import Gas
from analysis.series import BlockSeries, equilibration
from analysis.statistics import ChiSquare, Estimate, TheoryCheck
from analysis.theory.two_spheres import TwoSphereRates
from analysis.virial_identity import virial_identity
from hardspheres.frame import Tallies
from hardspheres.free_paths import FreePaths
from studies.answer import Answer, Column, Curves, number
from studies.diffusion import SelfDiffusion
from studies.program import Program
from studies.recording import Film
from studies.report import OutputFolder
from studies.study import Replica
from studies.thermalisation import Thermalisation

LONGEST = 300  # characters
MANY = r"Array|ndarray|list|dict|Mapping|Sequence|deque"  # types of any length
# What has nothing to tell, or is no object that a person is handed.
SILENT = {"Screen", "Quiet", "Moving", "App", "Studies", "Option", "Notices", "Table", "Section", "Report"}


def public():
    """All classes that the packages name in `__all__`; those of single commands only where they are options."""
    found = [getattr(hs, name) for name in hs.__all__] + [
        Tallies,
        FreePaths,
        hs.reference.ReferenceSimulation,
    ]
    inner = ("studies.benchmarks", "studies.validation", "studies.running")
    for package in (analysis, studies):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name.endswith("__main__"):
                continue
            loaded = importlib.import_module(module.name)
            names = [getattr(loaded, name) for name in getattr(loaded, "__all__", ())]
            of_module = [each for each in names if getattr(each, "__module__", "") == module.name]
            if module.name.startswith(inner):
                of_module = [
                    each for each in of_module if inspect.isclass(each) and issubclass(each, Program)
                ]
            found += of_module
    classes = [each for each in found if inspect.isclass(each) and not issubclass(each, BaseException)]
    return [each for each in dict.fromkeys(classes) if not inspect.isabstract(each)]


def unbounded(kind):
    """Whether its `repr` is that of every object, or a dataclass's own with fields of any length."""
    if kind.__repr__ is object.__repr__:
        return True
    code = getattr(inspect.unwrap(kind.__repr__), "__code__", None)
    made = is_dataclass(kind) and code is not None and code.co_filename == "<string>"  # by `dataclass`
    types = " ".join(str(each.type) for each in fields(kind) if each.repr) if made else ""
    return any(many in types for many in MANY.split("|"))


def test_no_public_class_shows_all_that_it_holds():
    """Sibling: dataclasses as they are made, of an array and of a number."""
    classes = [kind for kind in public() if kind.__name__ not in SILENT]
    assert {hs.Scene, Pressure, Answer, Film, Replica, Gas, SelfDiffusion} <= set(classes) and len(
        classes
    ) > 50
    assert [kind for kind in classes if unbounded(kind)] == []
    assert unbounded(make_dataclass("Wrong", [("values", "FloatArray")])) and unbounded(type("Wrong", (), {}))
    assert not unbounded(make_dataclass("Right", [("value", "float")]))


def lone():
    """One particle at rest: no temperature, nothing to come."""
    return hs.Scene([[5.0, 5.0, 5.0]], [[0.0, 0.0, 0.0]])


def many(n):
    """A gas of so many spheres, quickly made."""
    return hs.lattice_gas(n=n, packing_fraction=0.1, seed=1)


def replica(scene):
    """A run with all that it measured."""
    its = Replica(1, 3, hs.Simulation(scene), {"pressure": Pressure(scene)}, done=7)
    its.status = {str(k): k for k in range(1000)}
    return its


def answer(length=100_000):
    """Numbers and long curves."""
    line = np.linspace(0.0, 1.0, length)
    curves = Curves({"s": line}, {"a2": Column(line, line, theory=line)}, beside={"time": line})
    numbers = [number(f"Z {k}", Estimate(9.404114, 0.0083, 20), "KLM", 9.4) for k in range(50)]
    gas = SimpleNamespace(packing_fraction=0.1)
    return Answer(gas, numbers, {"relaxation": curves}, ["a note"], ["Z is far off"])


LINE = np.linspace(0.0, 1.0, 10_000)
EXAMPLES = {  # what is shown, and the words that must be in it
    "scene": (lambda: gas("3d_mixture", 500, 0.1), "500 particles", "3D", "2 species", "periodic", "0.1", "temperature=1"),
    "simulation": (lambda: hs.Simulation(gas("3d", 500, 0.1)), "500 particles", "time 0", "0 collisions", "per particle"),
    "frame": (lambda: hs.Simulation(gas("3d", 500, 0.1)).frame(), "500 particles", "time 0", "0 collisions"),
    "tallies": (lambda: hs.Simulation(gas("3d", 500, 0.1)).tallies, "time of 0", "0 collisions"),
    "at rest": (lambda: hs.Simulation(lone()), "1 particles", "temperature=0"),
    "reference": (lambda: hs.reference.ReferenceSimulation(gas("3d", 20, 0.1)), "20 particles", "time 0"),
    "gas": (lambda: Gas.of(gas("3d_mixture", 500, 0.1)), "500 particles of 2 species in 3D", "0.1"),
    "estimate": (lambda: Estimate(9.404114, 0.0083, 20, 19), "<Estimate 9.404(8), 19 degrees of freedom>"),
    "estimate without error": (lambda: Estimate(9.4, np.nan), "<Estimate 9.4(nan)>"),
    "check": (lambda: number("Z", Estimate(9.404114, 0.0083, 20), "KLM", 9.4), "Z 9.404(8), KLM 9.4", "z = +0.5"),
    "no theory": (lambda: TheoryCheck("Z", "", Estimate(9.404114, 0.0083), np.nan, np.nan), "<TheoryCheck: Z 9.404(8)>"),
    "chi-square": (lambda: ChiSquare(14.0, 16, 100, 0.741), "14.0 for 16 points", "p = 0.741"),
    "prediction": (lambda: theory.compressibility_factor(0.3, 3), "<Prediction 3.9839835 +- 2e-05>"),
    "predictions": (lambda: theory.Prediction(LINE, LINE), "10000 values from 0 to 1"),
    "no prediction": (lambda: theory.Prediction(np.full(5, np.nan), 0.0), "5 values, none known"),
    "curve": (lambda: theory.boltzmann_equal_speeds(LINE, 3), "s 10000 values"),
    "beams": (lambda: theory.boltzmann_beams(LINE, 3), "a2 10000 values"),
    "flights": (lambda: theory.FreeFlights([0.1], [1.0], [1.0], 3), "dim 3", "species 0"),
    "series": (lambda: BlockSeries(64), "0 samples"),
    "equilibration": (lambda: equilibration(np.random.default_rng(1).normal(size=100)), "reached"),
    "calibration": (lambda: calibrate([Estimate(float(k), 1.0) for k in range(-5, 6)], 0.0), "11 runs", "NOT"),
    "replica": (lambda: replica(gas("3d", 500, 0.1)), "Replica 3 of seed 1", "running", "pressure: Pressure"),
    "answer": (answer, "packing fraction 0.1", "Z 0 9.404(8)", "46 more", "curves relaxation", "1 FAILED"),
    "answer to nothing": (lambda: Answer(None, []), "Answer"),
    "curves": (lambda: answer().curves["relaxation"], "a2 over s (100000 values from 0 to 1)"),
    "column": (lambda: answer().curves["relaxation"].columns["a2"], "100000 values", "beside theory"),
    "study": (lambda: SelfDiffusion(n=108, replicas=4), "SelfDiffusion(replicas=4, seed=1", "n=108"),
    "options": (Thermalisation, "Thermalisation(replicas=100, seed=1, collisions_per_particle=10.0"),
    "film": (lambda: Film([0.0] * 1000, [LINE] * 1000, [LINE] * 1000), "s 1000 entries"),
    "folder": (lambda: OutputFolder("runs/x"), "runs/x", "nothing written yet"),
}  # fmt: skip


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_repr_tells_what_a_person_asks(name):
    make, *words = EXAMPLES[name]
    text = repr(make())
    assert len(text) <= LONGEST and "\n" not in text and "object at 0x" not in text
    assert [each for each in words if each not in text] == []


def test_the_repr_of_a_study_makes_it_again():
    study = SelfDiffusion(n=108, replicas=4, packing_fractions=(0.1,))
    assert eval(repr(study), {"SelfDiffusion": SelfDiffusion}) == study


def test_what_is_written_out_of_a_value_is_short():
    assert [word(x) for x in (1 / 3, np.array(0.5), np.array([1.0, 2.0]), LINE, [1, 2], [1] * 9, "x" * 500)] == [
        "0.333333", "0.5", "[1, 2]", "10000 values", "[1, 2]", "9 entries", "x" * 97 + "...",
    ]  # fmt: skip


def work_of_repr(thing):
    """Python calls and bytes that a `repr` takes, the second time: a scene keeps its packing fraction."""
    repr(thing)
    calls = [0]
    sys.setprofile(lambda *_: calls.__setitem__(0, calls[0] + 1))
    try:
        repr(thing)
    finally:
        sys.setprofile(None)
    tracemalloc.start()
    repr(thing)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return calls[0], peak


def test_a_repr_looks_at_each_particle_once_or_never():
    """No more calls for 1e5 particles than for 1e3, memory of a few numbers each at most; sibling: one that forms all pairs."""
    found = []
    for n in (1000, 100_000):
        sim = hs.Simulation(many(n))
        found.append([work_of_repr(thing) for thing in (sim.scene, sim, sim.frame(), sim.tallies)])
    for (few, _), (calls, peak) in zip(*found, strict=True):
        assert calls <= few + 10 < 500 and peak < 100 * 100_000
    pairs = type("Pairs", (), {"__repr__": lambda self: str(np.subtract.outer(LINE, LINE).max())})()
    assert work_of_repr(pairs)[1] > 100 * len(LINE)


def test_an_answer_is_a_table_in_a_notebook():
    """Every number, its marks, what failed and what is to be known; sibling: words that are no HTML."""
    its = answer(10)
    page = its._repr_html_()
    assert page.count("<tr>") == 51 and "<td>9.404(8)</td><td>9.4</td><td>+0.5</td>" in page
    assert "<br>CHECK FAILED, Z is far off<br>a note" in page
    assert "<br>a &lt; b" in replace(its, notes=["a < b"])._repr_html_()


def test_the_residual_of_the_virial_theorem_is_shown():
    start, end = hs.Simulation(gas("2d_mixture_walls", 50, 0.1)).frames(times=[0.0, 5.0])
    assert "VirialIdentity along 2 axes" in repr(virial_identity(start, end))
    assert brief(TwoSphereRates(1.0, np.ones(3))) == "<TwoSphereRates: pair 1, wall [1, 1, 1]>"
