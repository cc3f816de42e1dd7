"""--threads: the files of one thread, whatever happens on the way; told where there are fewer; never too many."""

import json
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from matplotlib.figure import Figure

import hardspheres as hs
from hardspheres import engine
from hardspheres.domains import divided
from hardspheres.lists import Lists
from studies.cli import main
from studies.commands import command_of
from studies.fluid import Fluid, representatives
from studies.options import OptionError
from studies.pressure import EquationOfState
from studies.report import OutputFolder, Screen
from studies.study import conduct, on_threads, run_study

SMALLEST = 6000  # spheres that two threads can share
LARGE = EquationOfState(
    packing_fractions=(0.3,), n=SMALLEST, collisions_per_particle=6.0, replicas=1, seed=5, workers=1
)
SMALL = replace(LARGE, n=100, packing_fractions=(0.05, 0.25), replicas=2)
ALONE = "threads=2: this gas of 100 particles runs on 1 thread, as each needs a part of the box"


@pytest.fixture(autouse=True)
def _cores(monkeypatch):
    """Two cores, both idle, on any machine; nothing is drawn."""
    monkeypatch.setattr(engine, "idle_cores", lambda: 99)
    monkeypatch.setattr("studies.study.available_cores", lambda: 2)
    monkeypatch.setattr(EquationOfState, "figures", lambda self, answers: {})
    monkeypatch.setattr(EquationOfState, "replay", lambda self: None)


def result(folder):
    """The bytes of all tables, and what the summary says of the results."""
    summary = json.loads((folder / "summary.json").read_text())
    tables = {path.name: path.read_bytes() for path in folder.glob("*.csv")}
    assert tables
    return tables, {name: summary[name] for name in ("digest", "states", "options", "command", "engine")}


def test_two_threads_write_the_files_of_one_also_where_a_run_is_extended(tmp_path):
    """A second replica by another number of threads than the first. Sibling: without it all files differ."""
    screen, found = Screen(json_output=True), []
    steps = [("one", 2, 1), ("two", 2, 2), ("both", 1, 2), ("both", 2, 1)]  # folder, replicas, threads
    for folder, replicas, threads in steps:
        study = replace(LARGE, replicas=replicas, threads=threads)
        summary, _ = conduct(study, OutputFolder(tmp_path / folder), screen)
        found.append(result(tmp_path / folder))
        assert summary["threads"] == ([1, 2] if len(found) == 4 else [threads])
        assert summary["fewer_threads"] == [] and summary["workers"] == 1
        if len(found) < 4:
            per_core = summary["collisions_per_second_and_core"]
            assert summary["collisions_per_second"] == pytest.approx(threads * per_core)
    one, two, half, both = found
    assert one == two == both
    assert one[0].keys() == half[0].keys() and one[0] != half[0] and one[1]["digest"] != half[1]["digest"]


@pytest.mark.parametrize("threads", [(1, 2), (2, 1)])
def test_a_run_is_resumed_by_another_number_of_threads(threads, tmp_path, monkeypatch):
    """And gives the files of a run that was not interrupted. Sibling: it is a resumed run, on those threads."""
    monkeypatch.setattr("studies.running.resuming.PAUSE", 20_000)
    whole, at = EquationOfState.advance, []

    def advance(self, gas, replica):
        at.append((replica.simulation.threads, replica.simulation.collisions))
        for pauses, _ in enumerate(whole(self, gas, replica), 1):
            yield
            if pauses == 2 and len(at) == 1:
                raise KeyboardInterrupt

    conduct(LARGE, OutputFolder(tmp_path / "whole"), Screen(json_output=True))
    monkeypatch.setattr(EquationOfState, "advance", advance)
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        conduct(replace(LARGE, threads=threads[0]), OutputFolder(out, checkpoint_every=0.0), Screen(True))
    conduct(replace(LARGE, threads=threads[1]), OutputFolder(out, resume=True), Screen(True))
    assert at == [(threads[0], 0), (threads[1], 40_000)]
    assert result(out) == result(tmp_path / "whole")


def run(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


BAD = [
    (
        2,
        ["--threads", 3],
        "--threads 3 is more than the 2 cores that this process may use; ask for at most 2",
    ),
    (
        1,
        ["--threads", 2],
        "--threads 2 is more than the one core that this process may use; ask for at most 1",
    ),
    (
        2,
        ["--threads", 2, "--workers", 2],
        "--workers 2 with --threads 2 needs 4 cores, more than the 2 cores that this process may use",
    ),
    (
        2,
        ["--threads", 2, "--workers", 2, "--executor", "threads"],
        "--workers 2 with --threads 2 needs 4 cores, more than the 2 cores that this process may use",
    ),
    (2, ["--threads", 2, "--executor", "mpi"], "--threads 2 is for --executor processes or threads: workers"),
    (2, ["--threads", 0], "--threads 0 is out of range; ask for at least 1"),
    (2, ["--threads", 2, "--sweep", "threads=1,2"], "--sweep threads: no number depends on it"),
]


@pytest.mark.parametrize(("cores", "options", "sentence"), BAD)
def test_too_many_threads_are_one_sentence(cores, options, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("studies.study.available_cores", lambda: cores)
    code = run(monkeypatch, "pressure", *options)
    told = capsys.readouterr()
    assert code == 2 and told.out == "" and not [*tmp_path.iterdir()]
    assert told.err.startswith(f"error: {sentence}") and told.err.count("\n") == 1


def test_an_ensemble_has_no_more_threads_than_cores(monkeypatch):
    """One run at a time unless --workers says more; sibling: with one thread each, as many as there are cores."""
    monkeypatch.setattr("studies.study.available_cores", lambda: 6)
    assert replace(LARGE, workers=None, threads=2).processes == 1
    assert replace(LARGE, workers=None).processes is None
    assert replace(LARGE, workers=3, threads=2).processes == 3
    with pytest.raises(
        OptionError, match="--workers 4 with --threads 2 needs 8 cores, more than the 6 cores"
    ):
        replace(LARGE, workers=4, threads=2)
    with ThreadPoolExecutor(1) as pool, pytest.raises(OptionError, match="is for --executor processes or th"):
        replace(LARGE, workers=None, threads=2, executor=pool)


def test_a_sweep_and_a_pilot_say_it_once_too(tmp_path, monkeypatch, capsys):
    """Several runs with one reason. Sibling: another gas has its own."""
    monkeypatch.setattr("studies.sweep.Swept.figure", lambda self: Figure())
    few = ["pressure", "--packing-fraction", 0.25, "--replicas", 4, "--threads", 2]
    short = ["--collisions-per-particle", 10, "--until-error", 0.5, "--out"]
    assert run(monkeypatch, *few, "--sweep", "n=100,101", *short, tmp_path / "sweep") == 0
    told = capsys.readouterr().err
    assert told.count(ALONE) == told.count(ALONE.replace("100", "101")) == 1


@pytest.mark.parametrize("executor", ["processes", "threads"])
def test_gases_that_threads_cannot_share_say_so_once(executor, tmp_path, capsys):
    """Of two replicas of two gases, one reason; siblings: one thread, and no raw warning."""
    study = replace(SMALL, executor=executor)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        for threads, count in ((2, 1), (1, 0)):
            out = OutputFolder(tmp_path / f"{threads}")
            summary, _ = conduct(replace(study, threads=threads), out, Screen())
            told = capsys.readouterr().err
            assert told.count(ALONE) == count
            assert sum(ALONE in why for why in summary["fewer_threads"]) == count
            assert summary["threads"] == [1]
    assert result(tmp_path / "1") == result(tmp_path / "2")


def test_a_gas_that_the_study_makes_on_the_way_is_told(monkeypatch):
    """It has one thread: no part of a study knows of threads. Sibling: the gas of the conductor."""
    whole = EquationOfState.advance

    def advance(self, gas, replica):
        replica.running = hs.Simulation(replica.simulation.to_scene())
        yield from whole(self, gas, replica)

    for on_the_way in (False, True):
        if on_the_way:
            monkeypatch.setattr(EquationOfState, "advance", advance)
        (((replica,),), _) = run_study(replace(LARGE, threads=2), Screen(True))
        assert replica.status["threads"] == 2 - on_the_way
        why = "threads=2: a gas that the study makes on the way runs on one thread" if on_the_way else None
        assert replica.status["fewer_threads"] == why


def test_the_kernels_that_threads_need_are_compiled_beforehand(tmp_path, monkeypatch):
    """Small gases that stand for dense ones can be shared, too; sibling: for one thread they are smaller."""
    ran, whole = [], hs.Simulation.run

    def noted(simulation, **how):
        ran.append(simulation.threads)
        whole(simulation, **how)

    monkeypatch.setattr(hs.Simulation, "run", noted)
    conduct(replace(LARGE, threads=2), OutputFolder(tmp_path / "out"), Screen(True))
    assert ran[0] == 2 and {*ran} == {2}
    for dim, eta in ((2, 0.69), (3, 0.31), (3, 0.49)):
        dense = Fluid(n=10**6, dim=dim, packing_fraction=eta)
        (one,), (two,) = representatives([dense]), representatives([dense], threads=2)
        lists = Lists(hs.lattice_gas(n=two.n, packing_fraction=eta, dim=dim, seed=1))
        assert divided(lists.cells, 2) and one.n < two.n


def test_a_simulation_is_put_on_threads_in_silence():
    """As `Simulation.on_threads` is asked to; sibling: by default it warns."""
    simulation = hs.Simulation(hs.random_gas(100, 0.25, seed=1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert on_threads(simulation, 1) is simulation
        assert on_threads(simulation, 2).status()["fewer_threads"].startswith(ALONE)
    with pytest.warns(UserWarning, match="runs on 1 thread"):
        simulation.on_threads(2)


def test_the_option_stands_beside_the_workers():
    """In the panel of the run itself."""
    params = {param.name: param for param in command_of(EquationOfState).params}
    names = [*params]
    assert names.index("threads") == names.index("workers") + 1
    assert params["threads"].rich_help_panel == params["workers"].rich_help_panel == "The run itself"
