"""Whatever runs the replicas, the bytes are the same; what is lost on the way is told in a sentence, and the rest kept."""

import importlib
import json
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import pytest

import hardspheres as hs
from hardspheres import SimulationError
from studies.answer import to_dataframe
from studies.cli import main
from studies.options import OptionError
from studies.report import OutputFolder, Screen
from studies.running import elsewhere, executors
from studies.running.elsewhere import Job
from studies.running.ensemble import run_replicas
from studies.running.executors import executor_of, number_of_workers
from studies.running.journal import Shelf, options_of
from studies.study import conduct
from studies.thermalisation import Thermalisation
from studies.validation.calibration import Calibrations

from .test_resuming import Sums

STUDY = Thermalisation(n=100, replicas=4, frames=3, collisions_per_particle=2.0, seed=5)
COMMAND = [sys.executable, "-m", "hardspheres"]


def written(study, folder):
    """Digest, numbers and every table and trajectory that a study leaves."""
    out = OutputFolder(folder)
    summary, sound = conduct(study, out, Screen(json_output=True))
    assert sound and not out.checkpoints.exists()
    return summary, bytes_in(folder)


def bytes_in(folder):
    summary = json.loads((folder / "summary.json").read_text())
    found = {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".csv", ".xyz")}
    assert found
    return found | {name: summary[name] for name in ("digest", "states", "options", "command")}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What one worker in this process leaves."""
    return written(replace(STUDY, workers=1), tmp_path_factory.mktemp("alone") / "out")[1]


# By name.


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("slurm", "--executor slurm is not known; it can be processes, threads, dask:ADDRESS or mpi"),
        ("dask", "--executor dask lacks the address of a scheduler, as in dask:tcp://host:8786, or its file"),
        ("dask:", "--executor dask: lacks the address"),
        ("dask:host", "--executor dask:host has no address of a scheduler"),
        ("dask:foo://host:8786", "--executor dask:foo://host:8786 has no address of a scheduler"),
        ("dask:none.json", "--executor dask:none.json: there is no such file of a scheduler"),
        ("dask:127.0.0.1:1", "no Dask scheduler answers at 127.0.0.1:1; start one with `dask scheduler`"),
        ("mpi", "start it as `mpiexec -n 4 python -m mpi4py.futures -m hardspheres ... --executor mpi`"),
    ],
)
def test_what_cannot_run_them_is_one_sentence(text, sentence, tmp_path, monkeypatch, capsys):
    """On the command line and in Python, and nothing is written."""
    for name in ["distributed"] * text.startswith("dask:") + ["mpi4py"] * (text == "mpi"):
        pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(executors, "ANSWER", 0.2)
    monkeypatch.setattr(sys, "argv", ["hardspheres", "thermalise", "--n", "100", "--executor", text])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code == 2 and told.out == ""
    assert told.err.startswith("error: ") and sentence in told.err and told.err.count("\n") == 1
    for study in (replace(STUDY, executor=text), Calibrations(executor=text, runs=20, families=("series",))):
        with pytest.raises(OptionError) as error:
            study.conduct(OutputFolder("out"), Screen(True))
        assert sentence in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "package"), [("dask:host:8786", "distributed"), ("mpi", "mpi4py")])
def test_a_package_that_is_missing_is_named(name, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(OptionError, match=rf"{package}.*pip install 'hardspheres\[cluster\]'"), opened(name):
        pass


def opened(which, workers=None):
    return executor_of(which, workers, pytest.fail)


def test_workers_are_of_this_machine_only():
    """Siblings: as many processes and threads as are asked for."""
    with pytest.raises(OptionError, match="--workers 3 is for processes and threads"), opened("mpi", 3):
        pass
    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(OptionError, match="--workers 3"), opened(pool, 3):
            pass
        with opened(pool) as same:
            assert same is pool and number_of_workers(same, None) == 2
    for name in (None, "processes"):
        with opened(name, 3) as none:
            assert none is None and number_of_workers(none, 3) == 3
    with opened("threads", 3) as threads:
        assert number_of_workers(threads, 3) == 3
    assert number_of_workers(Unpickled(), None) is None


def test_an_executor_is_no_part_of_what_is_run():
    """Not of the command, nor of what must be the same when a run is resumed."""
    other = replace(STUDY, executor="threads", workers=3)
    assert other.command == STUDY.command and options_of(other) == options_of(STUDY)


# Threads, and executors of one's own.


def numbers(study):
    """The table of a study, as it is written."""
    found = to_dataframe(study.answers(Screen(json_output=True)))
    return {"thermalisation.csv": found.to_csv(index=False, lineterminator="\n", na_rep="nan").encode()}


@pytest.mark.parametrize("workers", [1, 3])
def test_threads_give_the_same_bytes(workers, alone):
    """Sibling: another seed gives others."""
    study = replace(STUDY, executor="threads", workers=workers)
    assert numbers(study).items() <= alone.items()
    assert not numbers(replace(study, seed=6)).items() <= alone.items()


def test_an_executor_of_ones_own(alone):
    """It is told to a study in Python, and goes on afterwards."""
    with ThreadPoolExecutor(2) as pool:
        assert numbers(replace(STUDY, executor=pool)).items() <= alone.items()
        assert pool.submit(abs, -1).result() == 1


class Unpickled(Executor):
    """As if the workers were elsewhere: nothing but bytes comes to them and back."""

    def __init__(self, broken_after=math.inf, error=None):
        self.calls, self.broken_after, self.error = 0, broken_after, error

    def submit(self, function, *args):
        future = Future()
        self.calls += 1
        if self.calls > self.broken_after:
            future.set_exception(self.error)
        else:
            future.set_result(pickle.loads(pickle.dumps(pickle.loads(pickle.dumps(function))())))
        return future


def test_what_is_recorded_is_run_here(alone, tmp_path):
    """A worker elsewhere could not write the trajectory into the folder."""
    assert "trajectory.xyz" in alone
    executor = Unpickled()
    summary, found = written(replace(STUDY, executor=executor), tmp_path / "out")
    assert found == alone and executor.calls == STUDY.replicas and summary["workers"] is None


# Who keeps results.


@pytest.mark.parametrize("seen", [True, False])
def test_results_are_kept_by_whoever_sees_the_folder(seen, tmp_path, monkeypatch):
    """Workers, or this process; never both."""
    stores, store, reachable = [], Shelf.store, Shelf.reachable

    def counted(shelf, index, result):
        stores.append(bool(shelf.token))
        store(shelf, index, result)

    monkeypatch.setattr(Shelf, "store", counted)
    monkeypatch.setattr(Shelf, "reachable", lambda shelf: reachable(shelf) and (seen or not shelf.token))
    shelf = Shelf(tmp_path, math.inf)
    assert run_replicas(Sums(), [12, 999], executor=Unpickled(), shelf=shelf) == [3, 27]
    assert stores == [seen] * 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["done-0000.npz", "done-0001.npz"]


def test_a_shelf_is_reached_with_its_token_only(tmp_path):
    shelf = Shelf(tmp_path)
    assert shelf.reachable()
    with shelf.shared() as one:
        assert one.reachable() and pickle.loads(pickle.dumps(one)).reachable()
        assert not replace(one, folder=tmp_path / "elsewhere").reachable()
        with shelf.shared() as other:
            assert other.reachable() and one.reachable()  # two runs may share a folder
        assert not other.reachable()
    assert not one.reachable() and not other.reachable() and not list(tmp_path.iterdir())


class Losing(Sums):
    """The run that asks for it ends in the middle of an item."""

    def steps(self, item, state):
        for _ in super().steps(item, state):
            for token in self.folder.glob("token-*"):
                token.unlink()
            yield


def test_a_worker_writes_nothing_for_a_run_that_has_ended(tmp_path, monkeypatch):
    """It ends, which is no reason for it to die. Siblings: a run that goes on; one that ended before."""
    monkeypatch.setattr(elsewhere, "LOOK", 0.0)
    shelf, task = Shelf(tmp_path, 0.0), Losing()
    task.folder = tmp_path
    with shelf.shared() as seen:
        assert Job(Sums(), 12, seen, 0)()[0::2] == (3, True)
        with pytest.raises(SimulationError, match="the run that asked for this has ended"):
            Job(task, 34, seen, 1)()
        assert Job(Sums(), 56, seen, 2)()[0::2] == (11, False)
    assert [path.name for path in tmp_path.iterdir()] == ["done-0000.npz"]


def test_a_token_that_was_left_is_removed(tmp_path):
    """By a run that was killed."""
    out = OutputFolder(tmp_path / "out")
    with out.running(STUDY) as shelf:
        (shelf.folder / f"token-{0:032x}").touch()
    assert not list(out.path.iterdir())


def test_another_version_is_refused(monkeypatch):
    job = pickle.dumps(Job(abs, -1, None, 0))
    assert pickle.loads(job)()[0] == 1
    monkeypatch.setattr(hs, "__version__", "99.0")
    with pytest.raises(
        SimulationError, match="a worker has hardspheres 99.0, not .* install the same version"
    ):
        pickle.loads(job)()


# What is lost.

KilledWorker = type("KilledWorker", (Exception,), {"__module__": "distributed.scheduler"})
CommClosedError = type("CommClosedError", (OSError,), {"__module__": "distributed.comm.core"})


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (BrokenExecutor(), "a worker process was killed, perhaps out of memory; use fewer workers"),
        (CancelledError(), "the workers gave the runs up: their scheduler was lost"),
        (KilledWorker("x"), "several workers died one after another at the same run, perhaps out of memory"),
        (CommClosedError("in <TCP>: closed"), "the Dask cluster failed: in <TCP>: closed"),
        (
            ModuleNotFoundError("No module named 'mine'"),
            r"the workers cannot import .*\(No module named 'mine'\)",
        ),
    ],
    ids=lambda each: type(each).__name__,
)
def test_lost_workers_are_a_sentence_and_what_came_in_is_kept(error, sentence, tmp_path, monkeypatch):
    """Also what came in together with the failure; sibling: an error of the task itself comes through."""
    out = OutputFolder(tmp_path / "out")
    with pytest.raises(SimulationError, match=sentence) as told, out.running(STUDY) as shelf:
        monkeypatch.setattr(Shelf, "reachable", lambda shelf: not shelf.token)  # kept by this process
        run_replicas(Sums(), [12, 34, 56], executor=Unpickled(2, error), shelf=shelf)
    assert "the same command with --resume continues" in told.value.__notes__[0]
    kept = Shelf(out.checkpoints)
    assert [kept.result(k) for k in range(3)] == [(3,), (7,), None]
    with pytest.raises(ArithmeticError):
        run_replicas(Sums(), [12, 34, 56], executor=Unpickled(0, ArithmeticError()), shelf=kept)


class Endless(Sums):
    """Never ends by itself, unless the item has one digit."""

    summed = threading.Event()  # of item 12

    def steps(self, item, state):
        yield from super().steps(item, state)
        if item == 12:
            self.summed.set()
        while item > 9:
            time.sleep(0.001)
            yield


def test_an_interrupt_ends_threads_which_save_their_state(tmp_path):
    """Signals do not reach them. What has not begun does not begin."""

    def interrupt():
        assert Endless.summed.wait(60.0)
        raise KeyboardInterrupt

    shelf = Shelf(tmp_path, math.inf)
    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(KeyboardInterrupt):
            run_replicas(Endless(), [12, 3, 45, 67], executor=pool, shelf=shelf, done=interrupt)
        names = sorted(path.name for path in tmp_path.iterdir())  # nothing is written any more
    assert names[0] == "done-0001.npz" and "running-0000.npz" in names and len(names) < 4
    assert shelf.state(0)[0] == {"left": 0, "sum": 3}
    assert names == sorted(path.name for path in tmp_path.iterdir())


# Clusters: a scheduler and workers, each in a process of its own.


class Cluster:
    """A Dask scheduler and workers of one thread each."""

    def __init__(self, folder, workers, *options):
        self.file = folder / "scheduler.json"
        self.name = f"dask:{self.file}"
        self.log = (folder / "log").open("wb")
        no_pages, self.processes = "--no-dashboard", []
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", no_pages)
        own = ["--nthreads", "1", no_pages, "--local-directory", folder / "scratch", *options]
        self.workers = [self._start("worker", *own) for _ in range(workers)]

    def _start(self, what, *options):
        command = [sys.executable, "-m", "dask", what, "--scheduler-file", self.file, *options]
        run = subprocess.Popen(
            list(map(str, command)), stdout=self.log, stderr=self.log, cwd=self.file.parent
        )
        self.processes.append(run)
        if what == "scheduler":
            wait_for(self.file.exists)
        return run

    def close(self):
        for run in reversed(self.processes):
            run.kill()
            run.wait()
        self.log.close()


def wait_for(condition, seconds=120):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture
def cluster(tmp_path):
    """Start a cluster."""
    pytest.importorskip("distributed")
    made = []

    def start(workers, *options):
        (tmp_path / "cluster").mkdir()
        made.append(Cluster(tmp_path / "cluster", workers, *options))
        return made[-1]

    yield start
    for each in made:
        each.close()


def test_a_cluster_of_one_worker_gives_the_same_bytes(cluster, alone, tmp_path, monkeypatch):
    """Miniature of the slow tests. Sibling: work that is defined where no worker can import it."""
    dask = cluster(1, "--no-nanny")
    summary, found = written(replace(STUDY, executor=dask.name), tmp_path / "out")
    assert found == alone and summary["workers"] == 1
    (tmp_path / "only_here.py").write_text("def task(x): return x")
    monkeypatch.syspath_prepend(tmp_path)
    task = importlib.import_module("only_here").task
    cannot = pytest.raises(SimulationError, match="the workers cannot import .*No module named 'only_here'")
    with opened(dask.name) as pool, cannot:
        run_replicas(task, [1, 2], executor=pool)


LONG = ["thermalise", "--n", "2000", "--replicas", "16", "--collisions-per-particle", "100", "--frames", "3"]


def start(*options):
    run = [*COMMAND, *map(str, options)]
    return subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(*options):
    run = start(*options)
    told = run.communicate(timeout=600)
    return run.returncode, *told


@pytest.fixture(scope="module")
def long_alone(tmp_path_factory):
    """What the long study leaves, run by one worker in the process itself."""
    out = tmp_path_factory.mktemp("long") / "out"
    code, _, errors = finish(*LONG, "--workers", 1, "--out", out)
    assert code == 0, errors
    return bytes_in(out)


@pytest.mark.slow
def test_four_workers_of_which_one_is_killed_give_the_same_bytes(cluster, long_alone, tmp_path):
    """Killed while it works; what it did is done by another. Sibling: it is missing at the end."""
    from distributed import Client

    dask, out = cluster(4, "--no-nanny"), tmp_path / "out"
    with Client(scheduler_file=str(dask.file), set_as_default=False) as client:
        client.wait_for_workers(4)
        process = client.run(os.getpid)
        run = start(*LONG, "--executor", dask.name, "--out", out, "--checkpoint-every", 0)
        wait_for(lambda: len(list(out.glob("checkpoint/done-*"))) > 3)
        victim = next(address for address, tasks in client.processing().items() if tasks)
        os.kill(process[victim], signal.SIGKILL)
        assert out.joinpath("checkpoint").exists()
        printed, errors = run.communicate(timeout=600)
    assert run.returncode == 0, errors
    assert bytes_in(out) == long_alone and "3 workers, busy" in printed


@pytest.mark.slow
def test_a_lost_scheduler_is_a_sentence_and_the_run_is_resumed(cluster, long_alone, tmp_path):
    """By another executor, with the same bytes."""
    dask, out = cluster(2, "--no-nanny"), tmp_path / "out"
    run = start(*LONG, "--executor", dask.name, "--out", out)
    wait_for(lambda: len(list(out.glob("checkpoint/done-*"))) > 3)
    dask.scheduler.kill()
    printed, errors = run.communicate(timeout=120)
    assert run.returncode == 2 and printed == "" and errors.strip().count("\n") == 0
    assert errors.startswith("error: the workers gave the runs up: their scheduler was lost")
    assert errors.endswith("the same command with --resume continues\n")
    kept = {path: path.stat().st_mtime_ns for path in out.glob("checkpoint/done-*")}
    assert len(kept) > 3 and not list(out.glob("checkpoint/token-*"))
    code, _, errors = finish(*LONG, "--executor", "threads", "--workers", 2, "--out", out, "--resume")
    assert code == 0, errors
    assert bytes_in(out) == long_alone


@pytest.mark.slow
def test_a_run_that_kills_every_worker_is_a_sentence(cluster):
    """Dask gives it up after four of them."""
    dask = cluster(1)  # with a nanny, which starts a worker again
    given_up = pytest.raises(SimulationError, match="several workers died one after another at the same run")
    with executor_of(dask.name, None, print) as pool, given_up:
        run_replicas(os._exit, [1], executor=pool)


@pytest.mark.slow
@pytest.mark.usefixtures("heard")
@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("executor", ["threads", "dask"])
def test_ctrl_c_is_a_sentence_and_the_run_is_resumed(executor, cluster, long_alone, tmp_path):
    name, out = executor if executor == "threads" else cluster(2, "--no-nanny").name, tmp_path / "out"
    run = start(*LONG, "--executor", name, "--out", out)
    wait_for(lambda: len(list(out.glob("checkpoint/done-*"))) > 3)
    run.send_signal(signal.SIGINT)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == 130 and errors.startswith("interrupted; what was done is kept in ")
    assert errors.count("\n") == 1
    code, _, errors = finish(*LONG, "--workers", 2, "--out", out, "--resume")
    assert code == 0, errors
    assert bytes_in(out) == long_alone


MPIEXEC = shutil.which("mpiexec", path=f"{os.path.dirname(sys.executable)}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.slow
@pytest.mark.skipif(MPIEXEC is None, reason="no MPI")
def test_an_mpi_job_gives_the_same_bytes(alone, tmp_path):
    """Sibling: every process of a job would conduct the study."""
    pytest.importorskip("mpi4py")
    options = ["thermalise", "--n", 100, "--replicas", 4, "--frames", 3, "--collisions-per-particle", 2]
    options += ["--seed", 5, "--executor", "mpi", "--out", tmp_path / "out"]

    def job(*python):
        command = [MPIEXEC, "-n", "3", sys.executable, *python, "-m", "hardspheres", *map(str, options)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)

    done = job("-m", "mpi4py.futures")
    assert done.returncode == 0, done.stderr
    assert bytes_in(tmp_path / "out") == alone and "2 workers, busy" in done.stdout
    shutil.rmtree(tmp_path / "out")
    refused = job()
    assert refused.returncode == 2 and refused.stderr.count("--executor mpi needs processes to run in") == 3
    assert not (tmp_path / "out").exists()
