"""Replicas: the same results in the same order whoever computes them, and nothing left running."""

import contextlib
import errno
import importlib
import itertools
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest

from hardspheres import SimulationError
from hardspheres.cores import available_cores
from studies.running import ensemble
from studies.running.ensemble import (
    prepare_workers,
    replica_seeds,
    run_replicas,
    worker_processes,
)
from studies.running.processes import pool_of_processes, starting, without_main
from studies.running.resuming import perform
from studies.running.stopping import STOPPING
from studies.study import _load, _Run, _Running
from studies.thermalisation import Thermalisation

if ensemble._can_be_forked():
    from studies.running import forking

forked = pytest.mark.skipif(not ensemble._can_be_forked(), reason="workers are fresh processes here")


def children(pid):
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, parent = entry.read_text().rpartition(")")[2].split()[:2]
            found += [int(entry.parent.name)] if int(parent) == pid and state != "Z" else []
    return found


def nobody_works():
    """Whether nothing runs but servers that wait."""
    servers = [each.process for each in forking._free] if ensemble._can_be_forked() else []
    return set(multiprocessing.active_children()) <= set(servers) and not any(
        children(each.pid) for each in servers
    )


def draw(seed):
    return seed.generate_state(4).tolist()


def fail_at_three(item):
    if item == 3:
        raise ArithmeticError("three")
    time.sleep(0.01)
    return item


def die(item):
    os._exit(1)


def test_first_seeds_do_not_depend_on_how_many_there_are():
    assert [draw(s) for s in replica_seeds(7, 3)] == [draw(s) for s in replica_seeds(7, 10)][:3]
    assert draw(replica_seeds(7, 1)[0]) != draw(replica_seeds(8, 1)[0])


def test_results_do_not_depend_on_the_workers():
    seeds = replica_seeds(1, 12)
    alone = run_replicas(draw, seeds, workers=1)
    assert run_replicas(draw, seeds, workers=2) == alone
    with ThreadPoolExecutor(3) as pool:
        assert run_replicas(draw, seeds, executor=pool) == alone


def test_every_finished_item_is_told():
    told = []
    run_replicas(abs, [1, -2, 3], workers=1, done=lambda: told.append(None))
    with ThreadPoolExecutor(2) as pool:
        run_replicas(abs, [1, -2, 3], executor=pool, done=lambda: told.append(None))
    assert len(told) == 6


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_comes_through_and_no_process_stays(workers):
    with pytest.raises(ArithmeticError, match="three"):
        run_replicas(fail_at_three, list(range(50)), workers=workers)
    assert nobody_works()


def test_a_worker_that_is_killed_is_reported():
    with pytest.raises(SimulationError, match="a worker process was killed"):
        run_replicas(die, [1, 2, 3], workers=2)
    assert nobody_works()


REFUSALS = [OSError(errno.EMFILE, "Too many open files"), OSError(errno.ENOMEM, "Cannot allocate memory")]
REFUSALS += [
    BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
    RuntimeError("can't start new thread"),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=str)
@pytest.mark.parametrize(("fork", "allowed"), [(True, 0), (False, 0), (False, 1)])
def test_workers_that_cannot_be_started_are_told_in_a_sentence(refusal, fork, allowed, monkeypatch):
    start, calls = BaseProcess.start, itertools.count()

    def limited(process):
        if next(calls) >= allowed:
            raise refusal
        start(process)

    if fork:
        monkeypatch.setenv("OF_THIS_TEST", str(refusal))  # so that it needs a server of its own
    else:
        monkeypatch.setattr(ensemble, "_can_be_forked", lambda: False)
    monkeypatch.setattr(BaseProcess, "start", limited)
    reason = getattr(refusal, "strerror", None) or str(refusal)
    with pytest.raises(
        SimulationError, match=f"3 worker processes cannot be started: {reason}; ask for fewer"
    ):
        run_replicas(abs, [1, 2, 3], workers=4)
    assert nobody_works()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of processes")
@pytest.mark.parametrize(("limit", "enough"), [(12, False), (20, False), (64, True)])
def test_few_open_files(limit, enough):
    """The real limit, in a process of its own; the second one stops not this process, but what forks workers."""
    program = (
        f"import resource, studies.running.ensemble as e; resource.setrlimit(resource.RLIMIT_NOFILE, ({limit},) * 2)\n"
        "try: print(e.run_replicas(abs, [-1, -2, -3, -4], workers=4))\n"
        "except e.SimulationError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""
    sentence = "4 worker processes cannot be started: Too many open files; ask for fewer with --workers, or"
    assert done.stdout.startswith("[1, 2, 3, 4]" if enough else sentence)


def heeded(_):
    """Signals that would end this process."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    return [n for n in STOPPING if n not in blocked and signal.getsignal(n) == signal.SIG_DFL]


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.usefixtures("heard")
def test_of_the_signals_of_a_terminal_workers_heed_none(monkeypatch):
    """Not even before they ignore them: blocked from their first moment on. The parent heeds all, as before."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    assert run_replicas(heeded, [1, 2], workers=2) == [[signal.SIGTERM]] * 2
    with pool_of_processes(1, multiprocessing.get_context("spawn")) as pool, monkeypatch.context() as patch:
        patch.setattr(pool, "_initializer", None)
        with starting(1):
            early = pool.submit(heeded, 1)
        assert early.result() == [signal.SIGTERM]
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


def leave_a_file(path):
    time.sleep(0.02)
    path.touch()


@pytest.mark.parametrize("method", ["spawn", pytest.param("fork", marks=forked)])
def test_an_interrupt_leaves_no_work_to_a_worker_that_is_just_starting(method, tmp_path, monkeypatch):
    """Such a worker is not yet among the children that can be ended."""
    monkeypatch.setattr(multiprocessing, "active_children", list)
    monkeypatch.setattr(ensemble, "_can_be_forked", lambda: method == "fork")
    with pytest.raises(KeyboardInterrupt), worker_processes(2) as pool:
        for k in range(500):
            pool.submit(leave_a_file, tmp_path / str(k))
        raise KeyboardInterrupt
    assert len(list(tmp_path.iterdir())) < 100


SLOW = """
import sys
import time
from functools import partial
from studies.exits import run_program
from studies.running import ours
from studies.running.ensemble import prepare_workers, run_replicas
def main():
    if "ours" in sys.argv:
        ours.claim()
    prepare_workers(2, partial(time.sleep, 1.0))
    print("begun", flush=True)
    run_replicas(time.sleep, [100.0] * 2, workers=2)
if __name__ == "__main__":
    run_program(main)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize(("times", "whose"), [(1, "a script's"), (2, "a script's"), (1, "ours")])
@pytest.mark.parametrize(
    ("number", "code", "sentence"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")],
)
def test_a_signal_while_workers_start_ends_all_with_one_sentence(
    number, code, sentence, times, whose, tmp_path
):
    """To all processes, once or by an impatient person; what workers are made from is loading meanwhile."""
    (tmp_path / "program.py").write_text(SLOW)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    run = subprocess.Popen([sys.executable, tmp_path / "program.py", whose], start_new_session=True, **pipes)
    assert run.stdout.readline() == "begun\n"
    for _ in range(times):
        time.sleep(0.05)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, number)
    assert run.communicate(timeout=60) == ("", f"{sentence}\n")  # no process of it holds a pipe any more
    assert run.returncode == code


def test_workers_are_counted():
    assert available_cores() >= 1
    with pytest.raises(ValueError, match="workers = 0"):
        run_replicas(abs, [1], workers=0)


def test_seconds_of_each_item_are_told():
    """Sibling: what is on the shelf took none."""
    spent = []
    assert run_replicas(abs, [-1, -2, -3], workers=1, spent=spent) == [1, 2, 3]
    with ThreadPoolExecutor(1) as pool:
        run_replicas(time.sleep, [0.01], executor=pool, spent=spent)
    assert len(spent) == 4 and min(spent) >= 0.0 and spent[-1] >= 0.01


def test_where_nothing_can_be_forked_workers_are_fresh_processes(monkeypatch):
    monkeypatch.setattr(ensemble, "_can_be_forked", lambda: False)
    prepare_workers(2, die)
    assert run_replicas(parent_of, [1, 2], workers=2) == [os.getpid()] * 2


def parent_of(_):
    return os.getppid()


FORKS = """
import sys, threading
import studies
from studies.running import ours
from studies.running.ensemble import preparing_workers, run_replicas
if __name__ == "__main__":
    if "ours" in sys.argv:
        ours.claim()
    if "busy" in sys.argv:
        threading.Thread(target=threading.Event().wait, daemon=True).start()
    with preparing_workers(2, bool):
        studies.loaded = "here"
    print(*run_replicas(eval, ["__import__('studies').__dict__.get('loaded')"] * 2, workers=2))
"""


@forked
@pytest.mark.parametrize(
    ("process", "found"), [("ours", "here"), ("a script's", "None"), ("ours busy", "None")]
)
def test_workers_of_the_command_line_are_forks_of_it(process, found, tmp_path):
    """They have what it has loaded. Siblings: it is a script's, or it has another thread."""
    (tmp_path / "program.py").write_text(FORKS)
    command = [sys.executable, tmp_path / "program.py", *process.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{found} {found}\n", "")


LOADED = "set(__import__('sys').modules)"
KERNELS = (
    "sum(len(each.overloads) for each in __import__('gc').get_objects()"
    " if isinstance(each, __import__('numba').core.dispatcher.Dispatcher))"
)


@forked
@pytest.mark.parametrize("loaded", [True, False])
def test_workers_import_and_compile_nothing(loaded, monkeypatch):
    """After a replica they have the modules and kernels that they began with. Sibling: nothing was prepared."""
    monkeypatch.setenv("OF_THIS_TEST", str(loaded))  # so that it has a server of its own
    study = Thermalisation(n=200, replicas=2, collisions_per_particle=2.0, seed=1)
    gases = study.gases()
    _load(study, gases)
    prepare_workers(2, partial(_load, study, gases) if loaded else bool)
    with worker_processes(1) as pool, without_main():
        before = [pool.submit(eval, each).result() for each in (LOADED, KERNELS)]
        replica = pool.submit(perform, _Running(study, Path()), _Run(gases[0], 0, 0)).result()
        modules, kernels = (pool.submit(eval, each).result() for each in (LOADED, KERNELS))
    assert replica.failure is None and kernels > 0
    assert (modules - before[0] == set()) is loaded
    assert (kernels == before[1]) is loaded


@forked
def test_the_server_compiles_nothing():
    """That would take as long as in the process that compiles. Sibling: what needs no compilation is called."""
    with pytest.raises(RuntimeError, match="not in the cache"):
        forking._load(pickle.dumps(call_a_kernel))
    forking._load(pickle.dumps(bool))


def call_a_kernel():
    import numba

    numba.njit(lambda x: x + 1)(1)


def about(name):
    """Parent process, working folder, what was asked for, and which package is ours."""
    return os.getppid(), os.getcwd(), os.environ.get(name), sys.modules["studies"].__file__


@forked
def test_workers_have_the_environment_of_now(tmp_path, monkeypatch):
    """As fresh processes do, whatever the server was started with; sibling: unchanged, it is the same server."""
    import studies

    (tmp_path / "studies").mkdir()
    (tmp_path / "studies" / "__init__.py").write_text("raise ArithmeticError")  # not ours
    monkeypatch.chdir(tmp_path)
    found = []
    for value in ("one", "one", "two"):
        monkeypatch.setenv("OF_THIS_TEST", value)
        first, second = run_replicas(about, ["OF_THIS_TEST"] * 2, workers=2)
        assert first == second and first[1:] == (str(tmp_path), value, studies.__file__)
        found.append(first[0])
    assert found[0] == found[1] != found[2] and os.getpid() not in found


@forked
def test_a_module_that_was_edited_is_loaded_anew(tmp_path, monkeypatch):
    """A notebook reloads it; sibling: without an edit it is not, though its file may be of the future."""
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "edited_module.py"
    path.write_text("def task(x): return x + 1")
    os.utime(path, (time.time() + 1e6,) * 2)
    module, servers = importlib.import_module("edited_module"), set()
    for _ in range(2):
        assert run_replicas(module.task, [1, 2], workers=2) == [2, 3]
        servers |= set(run_replicas(parent_of, [1, 2], workers=2))
    assert len(servers) == 1
    path.write_text("def task(x): return x + 10  # longer")
    importlib.reload(module)
    assert run_replicas(module.task, [1, 2], workers=2) == [11, 12]
    sys.modules.pop("edited_module")


def kill_the_server(folder):
    (folder / str(os.getpid())).touch()
    if len(list(folder.iterdir())) == 2:
        os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(100)


def gone(pids, seconds=20):
    """Whether processes end in time."""
    deadline = time.monotonic() + seconds
    while (there := [pid for pid in pids if Path(f"/proc/{pid}").exists()]) and time.monotonic() < deadline:
        time.sleep(0.01)
    return not there


@forked
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_killed_server_takes_its_workers_along_and_is_replaced(tmp_path):
    with pytest.raises(SimulationError, match="a worker process was killed"):
        run_replicas(kill_the_server, [tmp_path] * 2, workers=2)
    workers = [int(path.name) for path in tmp_path.iterdir()]
    assert len(workers) == 2 and gone(workers)
    assert run_replicas(abs, [-1, -2], workers=2) == [1, 2]


ENDLESS = """
import os, time
from pathlib import Path
from studies.running.ensemble import run_replicas
def task(folder):
    for pid in os.getpid(), os.getppid():
        (folder / str(pid)).touch()
    time.sleep(100)
if __name__ == "__main__":
    run_replicas(task, [Path("pids")] * 2, workers=2)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_nothing_outlives_a_killed_parent(tmp_path):
    """Neither workers nor what forks them."""
    (tmp_path / "pids").mkdir()
    (tmp_path / "program.py").write_text(ENDLESS)
    run = subprocess.Popen([sys.executable, "program.py"], cwd=tmp_path, start_new_session=True)
    pids, deadline = set(), time.monotonic() + 60
    while len(pids) < 3 and time.monotonic() < deadline:
        pids = {int(path.name) for path in (tmp_path / "pids").iterdir()}
        time.sleep(0.01)
    run.kill()
    run.wait()
    assert len(pids) == 3 and gone(pids)


WAITING = """
import sys, time
import studies.study
from studies.output import OutputFolder
from studies.report import Screen
from studies.thermalisation import Thermalisation
def runs(*_, **more):  # of workers: this process waits for them
    end = time.monotonic() + (20 if {workers} > 1 else 0.0)
    while "matplotlib.backends.backend_agg" not in sys.modules and time.monotonic() < end:
        time.sleep(0.01)
    print("matplotlib.backends.backend_agg" in sys.modules)
    raise SystemExit
studies.study.run_replicas = runs
study = Thermalisation(n=100, replicas=2, workers={workers})
study.conduct(OutputFolder("out"), Screen())
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_what_draws_is_imported_while_workers_run(workers, tmp_path):
    """Sibling: without workers there is no waiting to be used."""
    done = subprocess.run(
        [sys.executable, "-c", WAITING.format(workers=workers)],
        check=False,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=120,
    )
    assert done.stdout.splitlines()[-1:] == [str(workers > 1)], done.stderr
