"""What a person sees of every study: tables that cut no number in a narrow window, figures whose words never overlap.

Every study is run once in small. Its tables are then laid out at several widths, and its figures measured.
"""

import itertools
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from rich.console import Console

import hardspheres as hs
from analysis.estimator import PALETTE
from studies.benchmarks.bench import Bench, bench
from studies.benchmarks.gas import Gas
from studies.benchmarks.suite import Suite as BenchSuite
from studies.benchmarks.suite import run_suite as run_bench_suite
from studies.diffusion import SelfDiffusion
from studies.expansion import Expansion
from studies.figures.style import LIMIT, falling
from studies.fluid import Fluid
from studies.free_path import FreePaths
from studies.layout import table_blocks, wrapped
from studies.mixture import Mixture
from studies.pressure import EquationOfState
from studies.report import OutputFolder, Screen
from studies.study import conduct
from studies.thermalisation import Thermalisation
from studies.validation.calibration import Calibrations
from studies.validation.hard_cases import HardCases
from studies.validation.soak import Soak

from .test_every_study import small

MIXED = {"n": 200, "packing_fraction": 0.02, "mass_ratio": 4.0, "diameter_ratio": 0.5}
UNLIKE = Fluid(n=108, packing_fraction=0.3, diameter_ratio=1.25, mass_ratio=10.0)
SUITE = (Fluid(n=108, packing_fraction=0.01), Fluid(n=108, packing_fraction=0.2), UNLIKE)


def suite(*to):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.pressure.SUITE", SUITE)
        return conduct(EquationOfState(suite=True, until_error=0.02, workers=1), *to)


def relaxing(**options):
    study = Thermalisation(n=200, replicas=4, workers=1, frames=0, collisions_per_particle=2.0, **options)
    return lambda *to: conduct(study, *to)


def flying(**options):
    return lambda out, screen: conduct(FreePaths(workers=1, **options), out, screen)


STUDIES = {
    "thermalise": relaxing(),
    "thermalise-mixture": relaxing(
        packing_fraction=0.02, mass_ratio=10.0, diameter_ratio=0.5, velocities="two-temperatures"
    ),
    "pressure": lambda *to: conduct(
        EquationOfState(packing_fractions=(0.01, 0.25), n=200, collisions_per_particle=40.0, workers=1), *to
    ),
    "pressure-walls": lambda *to: conduct(
        EquationOfState(
            packing_fractions=(0.05, 0.1),
            n=200,
            boundary=("periodic", "wall", "periodic"),
            collisions_per_particle=40.0,
            workers=1,
        ),
        *to,
    ),
    "pressure-suite": suite,
    "free-path": flying(packing_fractions=(0.002, 0.05), n=200, collisions_per_particle=50.0),
    "free-path-mixture": flying(
        packing_fractions=(0.3,), n=108, diameter_ratio=1.25, mass_ratio=10.0, collisions_per_particle=200.0
    ),
    "diffusion": lambda *to: conduct(
        SelfDiffusion(packing_fractions=(0.1,), n=64, collisions_per_particle=80.0, replicas=6, workers=1),
        *to,
    ),
    "mixture": lambda *to: conduct(Mixture(**MIXED, relaxation_times=1.5, replicas=8, workers=1), *to),
    "expansion": lambda *to: conduct(
        Expansion(n=100, packing_fraction=0.02, transits=4.0, replicas=4, cells=4, workers=1), *to
    ),
    "barometer": lambda *to: conduct(small("barometer"), *to),
    "drop": lambda *to: conduct(small("drop"), *to),
    "lorentz": lambda *to: conduct(small("lorentz"), *to),
    "melting": lambda *to: conduct(small("melting"), *to),
    "calibration": Calibrations(runs=20, workers=1, families=("series",)).conduct,
    "hard-cases": HardCases(size="small", only=("cradle",)).conduct,
    "soak": lambda *to: conduct(Soak(n=200, dim=2, collisions=20_000, workers=1), *to),
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
    cells = itertools.chain.from_iterable(
        [*columns, *itertools.chain(*rows)] for _, columns, rows, _ in tables
    )
    wanted = {word for cell in cells for word in cell.split()}
    return {
        word for word in wanted if word not in words and f"{word}:" not in words and f"{word}," not in words
    }


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


def words_of(figure):
    """Texts and legends of a figure with their boxes, as they are drawn."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    items = [*figure.legends, *filter(None, (figure._suptitle, figure._supxlabel, figure._supylabel))]
    for axes in figure.axes:
        if axes.get_visible():
            items += [child for child in axes.get_children() if isinstance(child, Legend)]
            items += [*axes.texts, axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label]
            for axis in (axes.xaxis, axes.yaxis):
                low, high = sorted(axis.get_view_interval())
                items += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    shown = [item for item in items if item.get_visible() and (isinstance(item, Legend) or item.get_text())]
    return [
        ("legend" if isinstance(item, Legend) else item.get_text(), item.get_window_extent(renderer))
        for item in shown
    ]


def overlapping(figure):
    """Pairs of texts and legends of a figure that cover each other, and those that stick out of it."""
    boxes, whole = words_of(figure), figure.bbox
    bad = [(name, "edge") for name, box in boxes if box.x0 < -1 or box.y0 < -1]
    bad += [(name, "edge") for name, box in boxes if box.x1 > whole.x1 + 1 or box.y1 > whole.y1 + 1]
    for (first, a), (second, b) in itertools.combinations(boxes, 2):
        if min(a.x1, b.x1) - max(a.x0, b.x0) > 1 and min(a.y1, b.y1) - max(a.y0, b.y0) > 1:
            bad.append((first, second))
    return bad


DRAWN = [name for name in STUDIES if name not in ("hard-cases", "soak", "bench")]


@pytest.mark.parametrize("name", DRAWN)
def test_words_of_figures_never_overlap(name, seen):
    figures = seen(name).figures
    assert figures
    for figure in figures.values():
        assert overlapping(figure) == []


def test_an_overlap_is_seen():
    """Sibling: a text over a legend, and one beyond the edge."""
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], label="a line")
    axes.legend(loc="upper left")
    assert overlapping(figure) == []
    axes.text(0.05, 0.93, "covers it", transform=axes.transAxes)
    assert ("legend", "covers it") in overlapping(figure)
    axes.text(0.9, 0.5, "far beyond the edge of the figure", transform=axes.transAxes, in_layout=False)
    assert ("far beyond the edge of the figure", "edge") in overlapping(figure)


@pytest.mark.parametrize("name", DRAWN)
def test_figures_name_the_gas_and_have_numbers_on_their_axes(name, seen):
    for figure in seen(name).figures.values():
        gas = figure._suptitle.get_text().replace("\n", " ")
        assert re.search("spheres|discs|particles|series", gas)
        if name not in ("calibration", "bench-suite"):
            assert re.search(r"\d+ x \d+ ", gas)  # replicas and particles
        if name != "calibration":  # which has one label for all panels
            first = next(axes for axes in figure.axes if axes.get_visible())
            for axis in (first.xaxis, first.yaxis):
                assert axis.label.get_text() or any(axes.xaxis.label.get_text() for axes in figure.axes)
        first = next(axes for axes in figure.axes if axes.get_visible())
        assert any(label.get_text() for label in first.get_yticklabels())


# Machado, Oliveira and Fernandes 2009, doi 10.1109/TVCG.2009.113, severity 1: linear RGB as others see it
VISIONS = {
    "all cones": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.3039],
    ],
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
)


def linear(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def cielab(rgb):
    f = np.cbrt(XYZ @ rgb / (XYZ @ np.ones(3)))  # none is dark enough for the linear part
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def least_distance(colours, vision):
    seen = [cielab(np.clip(np.array(VISIONS[vision]) @ linear(colour), 1e-3, 1)) for colour in colours]
    return min(np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2))


@pytest.mark.parametrize("vision", VISIONS)
def test_the_palette_is_told_apart_with_any_colour_vision(vision):
    assert least_distance(PALETTE, vision) > 25
    if vision != "all cones":  # sibling: the palette that was here before
        assert least_distance(["#1f77b4", "#d1495b", "#e0a030", "#3a8f6b", "#7b5ea7"], vision) < 12


def test_what_is_lost_in_noise_is_an_upper_limit():
    """From the first lost point on all are limits; siblings: the high one among them, which would seem to rise, and a clear fall."""
    s, error = np.arange(8.0), np.full(8, 0.01)
    fall = np.array([1.0, 0.3, 0.1, 0.015, 0.03, -0.004, 0.002, 0.025])
    figure = Figure()
    lost, clear = figure.subplots(1, 2)
    for axes, y in ((lost, fall), (clear, np.exp(-s / 4))):
        axes.set_yscale("log")
        falling(axes, s, y, error, noise=0.01)
    points = lost.containers[0].lines[0].get_ydata()
    assert list(points) == [1.0, 0.3, 0.1] and LIMIT in lost.get_legend_handles_labels()[1]
    limits = lost.containers[1].lines[0].get_ydata()
    assert list(limits) == pytest.approx([0.035, 0.05, 0.02, 0.022, 0.045])
    assert len(clear.containers) == 1 and not clear.get_legend_handles_labels()[1]
    assert len(clear.containers[0].lines[0].get_ydata()) == 8


def test_a_cut_cell_and_a_broken_word_are_seen():
    """Sibling: a table as it was, cut at the width, and a number in it that ends in dots."""
    tables = [("", ["density", "Z"], [["0.001234", "1.523(4)"]], {})]
    assert cut(["density Z", "0.001234 1.523(4)"], tables) == set()
    assert cut(["density Z", "0.00\u2026 1.523(4)"], tables) == {"0.001234"}
    header, body = table_blocks(["density", "Z", "z"], [["0.001234", "1.523(4)", "+0.3"]], 18)[0]
    assert header == [" density         Z"] and body == ["0.001234  1.523(4)"]
    assert wrapped("measured beside theory", 10) == ["measured", "beside", "theory"]
    assert wrapped("measured beside theory", None) == ["measured beside theory"]


def test_a_terminal_of_80_columns_and_a_file(monkeypatch, capsys):
    """$COLUMNS is the width of a person's window; into a file sentences go whole."""
    sentence = "one sentence of many words that a person reads in a window, and a program in a file " * 2
    Screen().say(sentence)
    assert capsys.readouterr().out.rstrip("\n") == sentence.rstrip("\n")
    monkeypatch.setenv("COLUMNS", "80")
    Screen().say(sentence)
    assert max(map(len, capsys.readouterr().out.split("\n"))) <= 80


def contrast(colour, ground):
    """WCAG contrast of two colours."""
    light, dark = sorted((float(XYZ[1] @ linear(c)) for c in (colour, ground)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_slow_spheres_stand_out_from_the_ground():
    """Also the farthest; sibling: the colours of before, whose slowest were nearly the ground."""
    from studies.figures.thermalisation import _FARTHEST, _GROUND, _SPEEDS

    def far(colour):
        return _FARTHEST * np.array(colour[:3]) + (1 - _FARTHEST) * np.array(to_rgb(_GROUND))

    speeds = [contrast(far(_SPEEDS(v)), _GROUND) for v in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert speeds[0] > 3.0 and speeds == sorted(speeds)
    assert contrast(colormaps["plasma"](0.0)[:3], _GROUND) < 1.5


def test_a_film_says_what_it_leaves_out_and_how_large_spheres_are():
    from studies.figures.thermalisation import View

    whole = View.of(hs.lattice_gas(n=216, packing_fraction=0.1, seed=1))
    assert whole.words == "the whole box, seen along z; spheres drawn to scale" and whole.scale == 1.0
    corner = View.of(hs.lattice_gas(n=4000, packing_fraction=0.1, seed=1))
    assert corner.words.startswith("a corner with 7.5 % of the box")
    thin = hs.random_gas(n=100, packing_fraction=1e-4, dim=2, radii=np.repeat([0.5, 1.0], 50), seed=1)
    seen = View.of(thin)
    assert seen.words == f"the whole box; discs drawn {0.006 * thin.box[0] / 0.5:.2g} times too large"


def test_a_film_shows_the_whole_run(tmp_path):
    """Sibling: a film of six collisions per particle, as it was."""
    study = Thermalisation(n=100, replicas=1, workers=1, frames=0, collisions_per_particle=9.0, animate=True)
    films = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "studies.figures.thermalisation.animation",
            lambda film, scene, answer, path, gas: (films.append(film), path.write_bytes(b""))[0],
        )
        conduct(study, OutputFolder(tmp_path), Recording())
    assert films[0].s[0] == 0.0 and films[0].s[-1] == pytest.approx(9.0, abs=0.03)
