"""The report of a run: what it says, that it is one file which loads nothing, and how it looks in a browser."""

import json
import math
import re
import shlex
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import jinja2
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import gas

import hardspheres as hs
import studies
from analysis.statistics import Estimate
from analysis.theory import Prediction
from studies.answer import Answer, Column, Curves, number
from studies.commands import command_of
from studies.figures.style import save
from studies.fluid import Fluid
from studies.formats import FORMATS
from studies.page import write_report
from studies.page.citation import BIBTEX, HOW
from studies.page.sentences import answer_in_words
from studies.page.vector import inline_svg, titles
from studies.registry import QUESTIONS, study_named
from studies.report import OutputError, OutputFolder
from studies.study import digest_of

from . import browser as chromium
from .pages import Page, masked

ROOT = Path(studies.__file__).parent.parent
HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>&amp;"
SUMMARY = {
    "command": "hardspheres pressure --seed 1 --n 100",
    "version": "0.0",
    "seed": 1,
    "date": "2026-01-01",
    "machine": {"processor": "P", "cores": 2, "system": "Linux", "python": "3", "numpy": "2", "numba": "0"},
    "seconds": {"total": 1.5},
    "collisions": 123456,
    "digest": "d" * 64,
    "checks": {"passed": True, "failures": []},
    "files": ["summary.json", "report.html", "a.csv", "odd name#1.csv"],
}


def drawn(title="A panel"):
    figure = Figure(figsize=(3, 2))
    axes = figure.subplots()
    axes.errorbar([1, 2], [3, 4], [0.1, 0.2], fmt="o", label="points")
    axes.set_title(title)
    axes.legend()
    return figure


def answered(eta=0.1, value=1.5, **more):
    numbers = [
        number("Z", Estimate(value, 0.01), "KLM", Prediction(1.52, 1e-4)),
        number("bare", 0.25),
        number("D", Estimate(2.0, 0.1), "Enskog", Prediction(2.1, 0.5)),
    ]
    curve = Column(np.array([1.0, 2.0]), np.array([0.1, 0.2]), np.array([1.1, 2.1]), z=np.array([-1.0, -0.5]))
    curves = {"course": Curves({"t": np.array([0.0, 1.0])}, {"y": curve}, printed=True)}
    return Answer(Fluid(100, 3, eta), numbers, curves, **more)


def report(out, answers, summary=SUMMARY, **more):
    """Text of the report of some answers."""
    options = {"name": "pressure", "question": "How much?", "subject": "4 x 100 hard spheres"}
    options |= {"legend": ["Z: what it is"], "figures": {}}
    folder = OutputFolder(out)
    folder.create()
    (out / "report.html").unlink(missing_ok=True)
    write_report(folder, answers=answers, summary=summary, **(options | more))
    return (folder.path / "report.html").read_text(encoding="utf-8")


def test_it_says_all_in_order(tmp_path):
    """Title, question, answer, failed checks, notes, figures, tables, legend, what made it, how to cite."""
    checks = {"passed": False, "failures": ["Z is +7.0 standard errors from KLM", "energy is lost"]}
    figures = {"one": drawn(), "two": drawn("Another")}
    more = {"figures": figures, "spent": ["reached"]}
    text = report(tmp_path, [answered(notes=["too short"])], SUMMARY | {"checks": checks}, **more)
    page = Page(text)
    order = [
        "4 x 100 hard spheres",
        "How much?",
        "Z = 1.500(10), 2.0 standard errors below theory (KLM), 1.52000(10).",
        "By chance alone a deviation would be that large in 4.6 % of such studies.",
        "2 checks FAILED, see below.",
        "CHECK FAILED",
        "Z is +7.0 standard errors from KLM",
        "energy is lost",
        "too short",
        "reached",
        "one: A panel",
        "two: Another",
        "Z: what it is",
        "u: the measurement is better than the theory",
        "hardspheres pressure --seed 1 --n 100",
        "P, 2 cores, Linux, Python 3, NumPy 2, Numba 0",
        "1.5 s",
        "d" * 64,
        "How to cite",
        " ".join(BIBTEX.split()),
    ]
    places = [page.text.find(" ".join(words.split())) for words in order]
    assert -1 not in places, order[places.index(-1)]
    assert places[1:] == sorted(places[1:])
    course, numbers = page.tables
    assert course == [
        ["t", "y", "theory", "z"],
        ["0", "1.00(10)", "1.1000", "-1.0"],
        ["1", "2.0(2)", "2.1000", "-0.5"],
    ]
    assert numbers[1] == ["Z", "1.500(10)", "1.52000(10)", "-2.0", ""] and numbers[3][-1] == "u"
    assert page.scopes.count(("th", "col")) == 8 and page.scopes.count(("th", "row")) == 5
    assert "All checks passed" not in page.text
    assert page.links == ["one.png", "two.png", "summary.json", "a.csv", "odd%20name%231.csv"]


def test_a_run_that_passed_says_so_and_nothing_of_failures(tmp_path):
    page = Page(report(tmp_path, [answered()]))
    assert "All checks passed." in page.text and "FAILED" not in page.text and "Notes" not in page.text


def test_it_loads_nothing(tmp_path):
    """Sibling: a figure as matplotlib writes it names addresses."""
    text = report(tmp_path, [answered()], figures={"one": drawn()})
    page = Page(text)
    outside = [what for what in page.loads if not re.fullmatch(r"#\S+|data:,|url\(#\S+\)", what)]
    assert outside == [] and not re.search(r"https?://(?!www\.w3\.org/(2000/svg|1999/xlink)\")", text)
    assert "default-src 'none'" in text
    save(drawn(), tmp_path / "raw.svg", "svg")
    assert "https://matplotlib.org" in (tmp_path / "raw.svg").read_text()


def hostile(out):
    gas = replace(Fluid(100, 3, 0.1), boundary=HOSTILE)
    found = answered(notes=[HOSTILE], failures=[HOSTILE])
    found = replace(found, gas=gas, numbers=[replace(found.numbers[0], quantity=HOSTILE, theory=HOSTILE)])
    checks = {"passed": False, "failures": [HOSTILE]}
    summary = SUMMARY | {"checks": checks, "files": [HOSTILE], "command": f"hardspheres x --from {HOSTILE}"}
    figures = {"one": drawn("a < b & c")}
    return report(out, [found], summary, name=HOSTILE, question=HOSTILE, subject=HOSTILE, figures=figures)


def test_hostile_names_are_text(tmp_path, monkeypatch):
    """Sibling: without escaping the same names are elements."""
    page = Page(hostile(tmp_path / "escaped"))
    assert page.names.count("script") == page.names.count("img") == 0
    assert page.text.count(HOSTILE) >= 8 and any(HOSTILE in label for label in page.labels)
    plain = jinja2.Environment
    monkeypatch.setattr(jinja2, "Environment", lambda **named: plain(**(named | {"autoescape": False})))
    with pytest.raises(AssertionError):
        assert "img" not in Page(hostile(tmp_path / "plain")).names


def test_figures_beside_each_other_share_no_id(tmp_path):
    """Sibling: as matplotlib writes them, two of a kind share all of them."""
    page = Page(report(tmp_path, [answered()], figures={"one": drawn(), "two": drawn()}))
    assert page.ids and len(set(page.ids)) == len(page.ids)
    for prefix in ("a", "b"):
        svg = inline_svg(drawn(), 'it\'s "A" < B', prefix)
        used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
        assert used and used == set(Page(svg).ids) and all(name.startswith(prefix) for name in used)
    save(drawn(), tmp_path / "raw.svg", "svg")
    assert "figure_1" in Page((tmp_path / "raw.svg").read_text().partition("<svg")[2].join(["<svg", ""])).ids


def test_a_caption_names_the_panels():
    figure = Figure()
    for k, axes in enumerate(figure.subplots(3, 4).flat):
        axes.set_title("$a_2$" if k == 0 else f"panel {k}", loc="left")
    assert titles(figure) == "; ".join(["a_2", *(f"panel {k}" for k in range(1, 12))])
    for k, axes in enumerate(figure.axes):
        axes.set_title(f"more {k}", loc="right")
    assert titles(figure) == "24 panels"


def test_what_varies_is_marked(tmp_path):
    """Another day, machine and time; sibling: another result is seen."""
    first = report(tmp_path, [answered()], spent=["in 1 s"])
    other = SUMMARY | {"date": "2027-02-02", "machine": SUMMARY["machine"] | {"cores": 64}, "seconds": 7.0}
    again = report(tmp_path, [answered()], other, spent=["in 2 s"])
    assert first != again and masked(first) == masked(again)
    assert masked(report(tmp_path, [answered(value=1.51)], spent=[""])) != masked(first)


def test_the_answer_in_words():
    many = [answered(eta, value) for eta, value in ((0.1, 1.53), (0.2, 1.49), (0.3, 1.52), (0.4, 1.51))]
    told = answer_in_words(many)
    assert told == [
        (
            "Z in 4 gases, packing fractions 0.1 to 0.4, to 0.7 % or better (one standard error). The largest "
            "deviation is at packing fraction 0.2: 1.490(10), 3.0 standard errors below theory (KLM), 1.52000(10)."
        ),
        "By chance alone the largest of 4 deviations would be that large in 1.1 % of such studies.",
    ]
    two = answer_in_words(many[:2])
    assert two[0].startswith("Packing fraction 0.1: Z = 1.530(10), 1.0 standard errors above theory (KLM), ")
    assert len(two) == 3 and two[1].startswith("Packing fraction 0.2: ")
    only = replace(many[0], main=["D"])
    assert (
        "0.2 standard errors below theory (Enskog), 2.1(5), whose own uncertainty"
        in answer_in_words([only])[0]
    )
    bare = replace(many[0], main=["bare"])
    assert answer_in_words([bare])[0].startswith("Bare = 0.25; Z = 1.530(10), ")
    nothing = replace(many[0], numbers=[number("a2", Estimate(math.nan, math.nan))])
    assert answer_in_words([nothing]) == ["a2 = not known."]
    assert answer_in_words([replace(nothing, numbers=[])]) == []
    timed = replace(many[0], numbers=[number("half-time, in transits", Estimate(0.5, 0.1))])
    assert answer_in_words([timed]) == ["Half-time, in transits = 0.50(10)."]
    zero = [replace(one, numbers=[number("x", Estimate(0.0, 0.1))]) for one in many]
    assert answer_in_words(zero) == ["x in 4 gases, packing fractions 0.1 to 0.4."]


# What made it.


COMMANDS = {
    "thermalise": {
        "n": 50,
        "boundary": ("periodic", "wall", "wall"),
        "animate": True,
    },
    "pressure": {"packing_fractions": (0.1, 1 / 3), "seed": 7, "suite": True},
    "free-path": {"mass_ratio": 10.0, "fraction": 0.25},
    "diffusion": {"replicas": 5, "workers": 2},
    "mixture": {"relaxation_times": 18.0},
    "hard-cases": {"size": "small", "only": ("cradle", "ratios")},
    "soak": {"collisions": 10**9},
    "accuracy": {"quick": True, "packing_fractions": (0.3,)},
    "bench": {"n": ((100,), (200,)), "packing_fraction": ((0.1,), (0.2, 0.3)), "suite": "quick"},
    "view": {"file": "a file's name.xyz", "radius": 0.25},
}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_command_gives_the_same_study(name, monkeypatch):
    kind, seen = study_named(name), []
    study = kind(**COMMANDS[name])
    monkeypatch.setattr(kind, "conduct", lambda self, out, screen: (seen.append(self), ({}, True))[1])
    program, command, *options = shlex.split(study.command)
    assert (program, command) == ("hardspheres", name)
    command_of(kind)(options, standalone_mode=False)
    assert replace(seen[0], **({"workers": 2} if name == "diffusion" else {})) == study


def test_labels_of_a_file_are_typed_as_they_are_read():
    study = study_named("thermalise")(source="a b.xyz", radius={"A": 0.5, "B": 0.3}, box=(9.0, 8.5))
    told = "hardspheres thermalise --seed 1 --from 'a b.xyz' --radius A=0.5,B=0.3 --box 9,8.5"
    assert study.command == told


def test_the_command_of_a_study_of_ones_own(monkeypatch):
    """A file is run by its name, a class of a notebook by its module, each word by itself."""
    own = type("Own", (study_named("free-path"),), {"__module__": "__main__", "name": "own"})
    for file, words in (("/some/own.py", ["own.py"]), (None, ["-m", "__main__"])):
        monkeypatch.setattr(sys.modules["__main__"], "__file__", file, raising=False)
        assert shlex.split(own().command) == ["python", *words, "--seed", "1"]


def test_the_digest_knows_every_bit():
    """The same run has it again; sibling: one with another seed, or one collision more."""
    one, same, other = (hs.Simulation(gas("3d", 40, 0.1, seed=seed)) for seed in (1, 1, 2))
    for simulation in (one, same, other):
        simulation.run(collisions=100)
    assert digest_of(one) == digest_of(same) != digest_of(other)
    assert re.fullmatch("[0-9a-f]{64}", digest_of(one))
    same.run(collisions=1)
    assert digest_of(one) != digest_of(same)


def test_questions_and_citation_are_those_of_the_readmes():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"```bibtex\n{BIBTEX}```" in readme and HOW in " ".join(readme.split())
    table = (ROOT / "studies" / "README.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| `([a-z-]+)` \| (.*?\?) \|", table, re.MULTILINE))
    assert told.items() >= {("pressure", "What is the equation of state of the fluid?")}
    for name in QUESTIONS:
        question = study_named(name).question
        assert question == told.get(name, question)
        assert question or name not in told


# Formats of figures.


def test_the_same_figure_gives_the_same_bytes(tmp_path):
    """Sibling: without a fixed salt and with the date it does not."""
    for form in FORMATS:
        for name in ("one", "two"):
            save(drawn(), tmp_path / f"{name}.{form}", form)
        one, two = ((tmp_path / f"{name}.{form}").read_bytes() for name in ("one", "two"))
        assert one == two and one[:4] in (b"\x89PNG", b"<?xm", b"%PDF")
    for name in ("one", "two"):
        drawn().savefig(tmp_path / f"{name}.svg")
    assert (tmp_path / "one.svg").read_bytes() != (tmp_path / "two.svg").read_bytes()
    assert matplotlib.rcParams["svg.hashsalt"] is None


@dataclass
class Drawing:
    """A study with one figure."""

    name, files, reports = "drawing", ("drawing.csv", "drawing.png"), True


def run(out, form, **more):
    folder = OutputFolder(out, figure_format=form, **more)
    folder.check(Drawing(), resumable=False)
    folder.create()
    folder.save_figure("drawing.png", drawn(), "a gas")
    with folder.partial("report.html") as path:
        path.write_text("a page")
    folder.write_json(
        "summary.json", {"study": "drawing", "version": "0", "files": [*folder.files, "summary.json"]}
    )
    return sorted(path.name for path in out.iterdir())


def test_another_format_leaves_nothing_of_the_one_before(tmp_path):
    assert run(tmp_path / "out", "png") == ["drawing.png", "report.html", "summary.json"]
    for form in ("svg", "pdf", "png"):
        found = run(tmp_path / "out", form, force=True)
        assert found == [f"drawing.{form}", "report.html", "summary.json"]
        assert json.loads((tmp_path / "out" / "summary.json").read_text())["files"] == found


def test_a_run_resumed_in_another_format_leaves_one_figure(tmp_path):
    with pytest.raises(KeyboardInterrupt), (folder := OutputFolder(tmp_path)).running(Drawing()):
        folder.save_figure("drawing.png", drawn(), "a gas")
        raise KeyboardInterrupt
    with (folder := OutputFolder(tmp_path, resume=True, figure_format="pdf")).running(Drawing()):
        folder.save_figure("drawing.png", drawn(), "a gas")
        folder.write_json("summary.json", {})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["drawing.pdf", "summary.json"]


@pytest.mark.parametrize("name", ["drawing.svg", "report.html"])
def test_files_of_others_are_in_the_way_in_the_format_asked_for(name, tmp_path):
    """Sibling: a picture in another format is in nobody's way."""
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"{name} is not of a finished run, and would be replaced"):
        run(tmp_path, "svg")
    if name == "drawing.svg":
        assert run(tmp_path, "png") == ["drawing.png", "drawing.svg", "report.html", "summary.json"]
    assert (tmp_path / name).read_text() == "mine"


def test_an_unknown_format_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys):
    from studies.cli import main

    with pytest.raises(OutputError, match="figure_format 'jpg' is not known; it can be png, svg or pdf"):
        OutputFolder(tmp_path, figure_format="jpg")
    for options, sentence in [
        (["pressure", "--format", "jpg"], "--format jpg is not known; it can be png, svg or pdf"),
        (["bench", "--format", "svg"], "--format svg goes with --suite: a single state has no figure"),
    ]:
        monkeypatch.setattr("sys.argv", ["hardspheres", *options, "--out", str(tmp_path / "out")])
        with pytest.raises(SystemExit) as end:
            main()
        told = capsys.readouterr().err
        assert end.value.code == 2 and told == f"error: {sentence}\n"
    assert list(tmp_path.iterdir()) == []


# In a browser.


CONTRAST = """
const luminance = (text) => {
  const c = text.match(/[\\d.]+/g).slice(0, 3).map(x => x / 255).map(x => x <= .03928 ? x / 12.92 : ((x + .055) / 1.055) ** 2.4);
  return .2126 * c[0] + .7152 * c[1] + .0722 * c[2];
};
const ground = (e) => {
  for (; e; e = e.parentElement) {
    const c = getComputedStyle(e).backgroundColor;
    if (!/, 0\\)$/.test(c) && c !== "transparent") return c;
  }
};
let worst = [99, ""];
for (const e of document.querySelectorAll("body *")) {
  if (e.closest("svg") || ![...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) || !e.offsetParent) continue;
  const [a, b] = [luminance(getComputedStyle(e).color), luminance(ground(e))].sort((x, y) => y - x);
  if ((a + .05) / (b + .05) < worst[0]) worst = [(a + .05) / (b + .05), e.outerHTML.slice(0, 80)];
}
return worst;
"""


@pytest.mark.slow
@pytest.mark.skipif(bool(chromium.missing()), reason=chromium.missing() or "there is a browser")
def test_the_report_in_a_browser(tmp_path):
    """No message; no page wider than a phone; contrast 4.5 in light and dark; the gas starts with a click; paper."""
    checks = {"passed": False, "failures": ["energy is lost"]}
    replay = studies.view(gas("3d", 40, 0.1), 2)
    many = [answered(eta) for eta in (0.1, 0.2, 0.3, 0.4)]
    report(
        tmp_path,
        many,
        SUMMARY | {"checks": checks},
        replay=replay,
        legend=["a" * 90],
        figures={"one": drawn()},
    )
    with chromium.browser() as window:
        for scheme in ("light", "dark"):
            window.media(scheme=scheme)
            for width in (1200, 400):
                window.open(tmp_path / "report.html", width, 900)
                seen = window.run("return [document.documentElement.scrollWidth, innerWidth]")
                assert seen[0] <= seen[1] == width
                worst, where = window.run(CONTRAST)
                assert worst >= 4.5, (scheme, where)
        paper = window.run("return getComputedStyle(document.querySelector('.sheet')).backgroundColor")
        assert paper == "rgb(255, 255, 255)"  # figures are dark on light, here too
        window.media("print", scheme)
        shown = "return [document.body, document.querySelector('.watch')].map(e => getComputedStyle(e)"
        assert window.run(f"{shown}.backgroundColor)")[0] == "rgb(255, 255, 255)"
        assert window.run(f"{shown}.display)")[1] == "none"
        window.media(scheme=scheme)
        assert window.run("return document.getElementById('gas').hidden")
        window.run("document.getElementById('watch').click()")
        frame = window.call("POST", "/element", {"using": "css selector", "value": "iframe"})
        window.call("POST", "/frame", {"id": frame})
        assert window.run("return replay.gas.done") == 0
        assert window.run("return document.querySelectorAll('canvas').length") >= 3
        window.call("POST", "/frame", {"id": None})
        assert window.messages() == []
