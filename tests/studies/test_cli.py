"""The command line as a person meets it: exit codes, one sentence for each mistake, JSON alone on standard output."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from ase.build import bulk
from ase.io import write
from typer.testing import CliRunner

from studies.cli import app, main

COMMAND = [sys.executable, "-m", "studies.cli"]


def hardspheres(*options, cwd=None):
    return subprocess.run(
        [*COMMAND, *map(str, options)], capture_output=True, text=True, cwd=cwd, timeout=120, check=False
    )


def test_help_and_version_load_nothing_heavy():
    code = (
        "import sys, studies.cli as cli\n"
        "sys.argv = ['hardspheres', {!r}]\n"
        "try: cli.main()\n"
        "except SystemExit as end: assert end.code in (0, None), end.code\n"
        "heavy = {{'numba', 'ase', 'matplotlib', 'scipy', 'jinja2'}} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    for option in ("--help", "--version"):
        done = subprocess.run(
            [sys.executable, "-c", code.format(option)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("hardspheres 0.")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--boundary", "sticky"], "--boundary sticky is not known; it can be periodic or wall"),
        (["--packing-fraction", "0.8"], "0.8 is above close packing"),
        (["--n", "1"], "there is one particle only"),
        (["--temperature", "0"], "no particle moves"),
        (["--radius", "1"], "--radius goes with --from"),
        (["--box", "9,9,9"], "--box goes with --from"),
        (["--units", "ase"], "--units goes with --from"),
        (["--velocities-are", "reduced"], "--velocities-are goes with --from"),
        (
            ["--from", "argon.xyz", "--radius", "A=0.5"],
            "the label Ar has no radius; labels are Ar, radius: A",
        ),
        (["--from", "argon.xyz", "--radius", "A=big"], "--radius: 'big' is no number"),
        (["--from", "argon.xyz", "--radius", "A=1,2"], "--radius A=1,2 is not as in A=0.5,B=0.3"),
        (["--from", "argon.xyz", "--radius", "1", "--box", "9,9,9"], "there is a cell already"),
        (["--from", "argon.xyz", "--radius", "1", "--box", "9,x"], "--box: 'x' is no number"),
        (["--from", "argon.xyz", "--radius", "1", "--dim", "2"], "says two dimensions, but particles 0 and"),
        (
            ["--from", "argon.xyz", "--radius", "1", "--boundary", "wall"],
            "--boundary has no effect with --from",
        ),
        (["--fraction", "0.2"], "--fraction needs --mass-ratio or --diameter-ratio"),
        (
            ["--mass-ratio", "-1"],
            "--mass-ratio -1 must be positive and finite: it is the mass of a second species",
        ),
        (["--diameter-ratio", "x"], "--diameter-ratio x must be positive and finite"),
        (["--boundary", ""], "--boundary  is not known"),
        (["--packing-fraction", "0.1,0.2"], "names several, but this study is of one gas; give one number"),
        (["--packing-fractions", "much"], "--packing-fraction much is not a number"),
        (["--temperature-ratio", "2"], "--temperature-ratio goes with --velocities two-temperatures"),
        (
            ["--velocities", "two-temperatures", "--temperature-ratio", "-2"],
            "--temperature-ratio -2 must be positive",
        ),
        (["--replicas", "2000000"], "--replicas 2000000 is out of range; ask for 1 to 1000000"),
        (["--velocities", "slow"], "--velocities slow is not known; it can be maxwell, equal-speeds, two-"),
        (["--collisions-per-particle", "0"], "--collisions-per-particle 0 must be positive"),
        (["--from", "absent.xyz"], "there is no file absent.xyz"),
        (["--from", "text.txt"], "cannot be read by ASE"),
        (["--from", "argon.xyz"], "there are no radii"),
        (["--from", "argon.xyz", "--radius", "2.5"], "overlap by"),
        (["--from", "oblique.cif", "--radius", "0.5"], "masses are guessed from labels"),
        (["--from", "oblique.cif", "--radius", "0.5", "--units", "ase"], "not orthogonal"),
        (["--from", "argon.xyz", "--radius", "1", "--n", "100"], "--n has no effect with --from"),
        (["--out", "text.txt"], "text.txt exists and is not a folder"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(options, sentence, tmp_path, monkeypatch, capsys):
    """In this process; in one of its own below."""
    (tmp_path / "text.txt").write_text("not a structure")
    write(tmp_path / "argon.xyz", bulk("Ar", "fcc", a=5.3, cubic=True).repeat(3))
    write(tmp_path / "oblique.cif", bulk("Ar", "fcc", a=5.3).repeat(3))
    before = set(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "thermalise", "--replicas", "2", *options])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2
    assert told.err.startswith("error: ") and sentence in told.err
    assert told.err.count("\n") == 1 and told.out == ""
    assert set(tmp_path.iterdir()) == before


def test_bad_input_of_a_process(tmp_path):
    """A process writes the same, and nothing else on its way out."""
    done = hardspheres("thermalise", "--from", "absent.xyz", "--radius", "1", cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == "" and not list(tmp_path.iterdir())
    assert done.stderr.startswith("error: there is no file absent.xyz") and done.stderr.count("\n") == 1


@pytest.mark.parametrize("options", [["--temperature", "warm"], ["--nonsense"]])
def test_bad_options_exit_2(options, tmp_path):
    done = hardspheres("thermalise", *options, cwd=tmp_path)
    assert done.returncode == 2 and "Error" in done.stderr and done.stdout == ""
    assert not list(tmp_path.iterdir())


def test_json_is_the_summary_and_alone_on_standard_output(tmp_path):
    options = [
        "--n",
        100,
        "--replicas",
        2,
        "--workers",
        1,
        "--collisions-per-particle",
        1,
        "--seed",
        3,
        "--json",
    ]
    done = hardspheres("thermalise", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "runs" / "thermalise-3"
    assert json.loads(done.stdout) == json.loads((folder / "summary.json").read_text())
    assert "2 x 100 hard spheres" in done.stderr


def test_a_structure_of_ones_own(tmp_path):
    """Labels that are no elements, no cell, a column that nobody knows: all of it is taken, or named."""
    places = [(x, y, z) for x in (1, 4) for y in (1, 4) for z in (1, 4)]
    rows = [f"{'AB'[k % 2]} {x} {y} {z} 7\n" for k, (x, y, z) in enumerate(places)]
    (tmp_path / "mine.xyz").write_text("8\nby hand\n" + "".join(rows))
    options = ["--from", "mine.xyz", "--radius", "A=0.5,B=0.5", "--box", "6,6,6"]
    options += [
        "--boundary",
        "periodic,periodic,wall",
        "--replicas",
        2,
        "--workers",
        1,
        "--collisions-per-particle",
        2,
    ]
    done = hardspheres("thermalise", *options, "--out", "own", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "mine.xyz: not used: what stands in column 5, which no Properties name" in done.stderr
    assert "2 x 8 hard spheres" in done.stdout and "box with walls along z, periodic else" in done.stdout
    assert (tmp_path / "own" / "summary.json").exists()


@pytest.mark.usefixtures("heard")
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_study_ends_quietly(number, code, tmp_path):
    options = ["thermalise", "--replicas", "500", "--workers", "2", "--out", str(tmp_path / "out")]
    run = subprocess.Popen([*COMMAND, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "out").exists() and time.monotonic() < deadline:  # made once everything is compiled
        time.sleep(0.05)
    time.sleep(0.5)
    run.send_signal(number)
    _, errors = run.communicate(timeout=30)
    assert run.returncode == code
    assert "Traceback" not in errors
    assert not list((tmp_path / "out").glob(".partial*"))


COMMANDS = [
    "thermalise",
    "bench",
    "pressure",
    "free-path",
    "diffusion",
    "transport",
    "mixture",
    "view",
    "analyse",
    "accuracy",
    "accuracy-tables",
    "calibration",
    "hard-cases",
    "verify",
    "soak",
    "list",
]


def helped(command, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    done = CliRunner().invoke(app, [command, "--help"])
    assert done.exit_code == 0
    return done.output


@pytest.mark.parametrize("command", COMMANDS)
def test_help_cuts_no_option_and_groups_them(command, monkeypatch):
    """Every option whole at 80 columns, in a panel, with choices listed; sibling: 40 columns, where some are cut."""
    text = helped(command, monkeypatch, 80)
    assert "\u2026" not in text and max(map(len, text.split("\n"))) <= 80
    own = text.split(" Options ")[1].split("\u256f")[0]
    assert own.count("--") == 1  # --help: all others stand in panels of their own
    alone = ("accuracy-tables", "calibration", "hard-cases", "verify", "list")
    assert "The gas" in text or command in alone
    assert "Results" in text
    if command == "thermalise":
        assert "\u2026" in helped(command, monkeypatch, 40)
        flat = " ".join(text.replace("\u2502", " ").split())
        for words in ("maxwell: in equilibrium", "equal-speeds: one speed", "beams: half of them"):
            assert words in re.sub(r"(--\S+|NUMBER|WORD)\s", "", flat)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["hard-cases", "--size", "tiny"], "--size tiny is not known; it can be small, full or long"),
        (["hard-cases", "--only", "pi"], "--only pi is not known; it can be galperin, cradle, "),
        (["bench", "--start", "warm"], "--start warm is not known; it can be auto, lattice or fluid"),
        (["bench", "--against", "lammps"], "--against lammps is not known; it can be spheropack or plain"),
        (["bench", "--suite", "all"], "--suite all is not known; it can be quick, full or prices"),
        (["bench", "--mass-ratio", "0"], "--mass-ratio 0 must be positive"),
        (["bench", "--boundary", "wall,sticky"], "--boundary wall,sticky is not known"),
        (["mixture", "--packing-fractions", "0.1:0.2:3"], "names several, but this study is of one gas"),
    ],
)
def test_words_are_checked_before_anything_heavy(options, sentence):
    """In a process of its own, where nothing heavy was imported when the sentence was said."""
    code = (
        "import sys, studies.cli as cli\n"
        f"sys.argv = ['hardspheres', *{options!r}]\n"
        "try: cli.main()\n"
        "except SystemExit as end: assert end.code == 2, end.code\n"
        "heavy = {'numba', 'ase', 'matplotlib'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
    assert sentence in done.stderr


def test_both_spellings_of_the_packing_fraction_are_one_option(monkeypatch):
    """A list where a study takes several; sibling: another option of that kind has one spelling."""
    seen = []
    monkeypatch.setattr(
        "studies.pressure.EquationOfState.conduct", lambda study, *_: (seen.append(study), ({}, True))[1]
    )
    for option in ("--packing-fraction", "--packing-fractions"):
        done = CliRunner().invoke(app, ["pressure", option, "0.1,0.3"])
        assert done.exit_code == 0, done.output
    assert [study.packing_fractions for study in seen] == [(0.1, 0.3)] * 2
    assert CliRunner().invoke(app, ["pressure", "--mass-ratios", "2"]).exit_code == 2


def test_a_mixture_of_masses_can_be_timed():
    from studies.benchmarks.gas import Gas

    gas = Gas(n=100, packing_fraction=0.05, mass_ratio=5.0)
    assert set(gas.scene(1).masses) == {1.0, 5.0} and set(gas.scene(1).radii) == {0.5}
    assert "masses 1:5" in str(gas) and "masses" not in str(Gas(n=100))


def test_version_and_completion():
    """-V, and what the shell asks for: words of an option."""
    assert CliRunner().invoke(app, ["-V"]).output == CliRunner().invoke(app, ["--version"]).output
    assert "--install-completion" in CliRunner().invoke(app, ["--help"]).output
    asked = {
        "_HARDSPHERES_COMPLETE": "complete_bash",
        "COMP_WORDS": "hardspheres bench --start ",
        "COMP_CWORD": "3",
    }
    done = subprocess.run(
        [sys.executable, "-c", "from studies.cli import app; app(prog_name='hardspheres')"],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | asked,
    )
    assert done.stdout.split() == ["auto", "lattice", "fluid"], done.stderr
