"""Replicas: the same results in the same order whoever computes them, and nothing left running."""

import errno
import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.context import SpawnProcess

import pytest

from hardspheres import SimulationError
from studies.running.ensemble import (
    _starting,
    available_cores,
    replica_seeds,
    run_replicas,
    spawned_processes,
)
from studies.running.stopping import STOPPING


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
    assert not multiprocessing.active_children()


def test_a_worker_that_is_killed_is_reported():
    with pytest.raises(SimulationError, match="a worker process was killed"):
        run_replicas(die, [1, 2, 3], workers=2)
    assert not multiprocessing.active_children()


REFUSALS = [OSError(errno.EMFILE, "Too many open files"), OSError(errno.ENOMEM, "Cannot allocate memory")]
REFUSALS += [
    BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable"),
    RuntimeError("can't start new thread"),
]


@pytest.mark.parametrize("refusal", REFUSALS, ids=str)
@pytest.mark.parametrize("allowed", [0, 1])
def test_workers_that_cannot_be_started_are_told_in_a_sentence(refusal, allowed, monkeypatch):
    start, calls = SpawnProcess.start, itertools.count()

    def limited(process):
        if next(calls) >= allowed:
            raise refusal
        start(process)

    monkeypatch.setattr(SpawnProcess, "start", limited)
    reason = getattr(refusal, "strerror", None) or str(refusal)
    with pytest.raises(
        SimulationError, match=f"3 worker processes cannot be started: {reason}; ask for fewer"
    ):
        run_replicas(abs, [1, 2, 3], workers=4)
    assert not multiprocessing.active_children()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of processes")
@pytest.mark.parametrize(("limit", "enough"), [(12, False), (64, True)])
def test_few_open_files(limit, enough):
    """The real limit, in a process of its own."""
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
    with spawned_processes(1) as pool, monkeypatch.context() as patch:
        patch.setattr(pool, "_initializer", None)
        with _starting(1):
            early = pool.submit(heeded, 1)
        assert early.result() == [signal.SIGTERM]
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


def leave_a_file(path):
    time.sleep(0.02)
    path.touch()


def test_an_interrupt_leaves_no_work_to_a_worker_that_is_just_starting(tmp_path, monkeypatch):
    """Such a worker is not yet among the children that can be ended."""
    monkeypatch.setattr(multiprocessing, "active_children", list)
    with pytest.raises(KeyboardInterrupt), spawned_processes(2) as pool:
        for k in range(500):
            pool.submit(leave_a_file, tmp_path / str(k))
        raise KeyboardInterrupt
    assert len(list(tmp_path.iterdir())) < 100


def test_workers_are_counted():
    assert available_cores() >= 1
    with pytest.raises(ValueError, match="workers = 0"):
        run_replicas(abs, [1], workers=0)
