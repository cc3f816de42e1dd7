"""What a person sees of every study: tables that cut no number in a narrow window, figures whose words never overlap.

Every study is run once in small. Its tables are then laid out at several widths, and its figures measured.
"""

import itertools
import re
import sys
from types import SimpleNamespace

import pytest
from rich.console import Console

import hardspheres as hs
from studies.bench import Bench, bench
from studies.bench_gas import Gas
from studies.bench_suite import Suite as BenchSuite
from studies.bench_suite import run_suite as run_bench_suite
from studies.calibration import Calibrations, calibration
from studies.diffusion import SelfDiffusion, self_diffusion
from studies.fluid import Fluid
from studies.free_path import FreePaths, free_path
from studies.hard_cases import groups_named, hard_cases
from studies.layout import table_blocks, wrapped
from studies.mixture import Mixture, mixture
from studies.pressure import EquationOfState, equation_of_state
from studies.pressure_suite import Suite, run_suite
from studies.report import OutputFolder, Screen
from studies.soak import Soak, soak
from studies.thermalisation import Recipe, Thermalisation, thermalise

MIXED = Fluid(n=200, packing_fraction=0.02, mass_ratio=4.0, diameter_ratio=0.5)
WALLS = Fluid(n=200, packing_fraction=0.1, boundary=("periodic", "wall", "periodic"))
SUITE = Suite(
    EquationOfState(precision=0.02, replicas=2, workers=1),
    {
        "spheres": (Fluid(n=108, packing_fraction=0.01), Fluid(n=108, packing_fraction=0.2)),
        "mixtures": (Fluid(n=108, packing_fraction=0.3, diameter_ratio=1.25, mass_ratio=10.0),),
    },
)


def relaxing(recipe, **more):
    return lambda out, screen: thermalise(
        Thermalisation(recipe, replicas=4, workers=1, frames=0, collisions_per_particle=2.0, **more),
        out,
        screen,
    )


STUDIES = {
    "thermalise": relaxing(Recipe(n=200)),
    "thermalise-mixture": relaxing(
        Recipe(
            n=200, packing_fraction=0.02, mass_ratio=10.0, diameter_ratio=0.5, velocities="two-temperatures"
        )
    ),
    "pressure": lambda *to: equation_of_state(
        EquationOfState((0.01, 0.25), Fluid(n=200), 40.0, workers=1), *to
    ),
    "pressure-walls": lambda *to: equation_of_state(EquationOfState((0.05, 0.1), WALLS, 40.0, workers=1), *to),
    "pressure-suite": lambda *to: run_suite(SUITE, *to),
    "free-path": lambda *to: free_path(FreePaths((0.002, 0.05), Fluid(n=200), 50.0, workers=1), *to),
    "free-path-mixture": lambda *to: free_path(FreePaths((0.02,), MIXED, 200.0, workers=1), *to),
    "diffusion": lambda *to: self_diffusion(
        SelfDiffusion((0.1,), Fluid(n=64), 80.0, replicas=6, workers=1), *to
    ),
    "mixture": lambda *to: mixture(Mixture(MIXED, relaxation_times=1.5, replicas=8, workers=1), *to),
    "calibration": lambda *to: calibration(Calibrations(20, workers=1, families=("series",)), *to),
    "hard-cases": lambda *to: hard_cases("small", groups_named(["cradle"]), *to),
    "soak": lambda *to: soak(Soak(n=200, dim=2, collisions=20_000, workers=1), *to),
    "bench": lambda *to: bench(Bench(Gas(n=128, packing_fraction=0.3), collisions=2000), *to),
    "bench-suite": lambda *to: run_bench_suite(
        BenchSuite("mini", (64, 128), (0.05, 0.2), window_seconds=0.001, peer_up_to=0), Bench(Gas()), *to
    ),
}


class Recording(Screen):
    """A screen that remembers its tables and sentences instead of showing them."""

    def __init__(self):
        super().__init__()
        self.tables, self.sentences = [], []

    def say(self, text=""):
        self.sentences.append(text)

    note = say

    def table(self, title, columns, rows, **options):
        self.tables.append((title, columns, rows, options))


class Keeping(OutputFolder):
    """A folder that also keeps its figures, as they were saved."""

    def __init__(self, path):
        super().__init__(path)
        self.figures = {}

    def save_figure(self, name, figure, *words, **more):
        super().save_figure(name, figure, *words, **more)
        self.figures[name] = figure


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """Tables, sentences and figures of a study, run once."""
    kept = {}

    def run(name):
        if name not in kept:
            screen, out = Recording(), Keeping(tmp_path_factory.mktemp(name))
            STUDIES[name](out, screen)
            kept[name] = SimpleNamespace(
                tables=screen.tables, sentences=screen.sentences, figures=out.figures, files=out.files
            )
        return kept[name]

    return run


def shown(width, tables=(), sentences=()):
    """Lines that a terminal of this width would show."""
    screen = Screen(width=width)
    screen.results = screen.errors = Console(file=sys.stdout, highlight=False, soft_wrap=True, width=width)
    with screen.results.capture() as captured:
        for title, columns, rows, options in tables:
            screen.table(title, columns, rows, **options)
        for sentence in sentences:
            screen.say(sentence)
    return captured.get().split("\n")


def cut(lines, tables):
    """Words of titles and cells that do not stand whole, each between blanks, in these lines."""
    words = {word for line in lines for word in line.split()}
    cells = itertools.chain.from_iterable([*columns, *itertools.chain(*rows)] for _, columns, rows, _ in tables)
    wanted = {word for cell in cells for word in cell.split()}
    return {word for word in wanted if word not in words and f"{word}:" not in words and f"{word}," not in words}


@pytest.mark.parametrize("width", [40, 60, 80, 100])
@pytest.mark.parametrize("name", STUDIES)
def test_no_cell_is_cut_and_no_line_too_long(name, width, seen):
    study = seen(name)
    assert study.tables
    lines = shown(width, study.tables, study.sentences)
    assert cut(lines, study.tables) == set()
    for line in lines:
        assert len(line) <= width or " " not in line.strip()  # a path alone on its line may be longer
    said = " ".join(" ".join(shown(width, (), study.sentences)).split())
    assert said == " ".join(" ".join(study.sentences).split())  # broken between words alone
