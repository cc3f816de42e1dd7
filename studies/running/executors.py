"""Executors by name: what `--executor` may say.

`processes` of this machine are the default, see `studies.running.ensemble`; `threads` are those of this
process; `dask:ADDRESS` are the workers of a Dask cluster, `mpi` the other processes of an MPI job.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

from hardspheres.cores import available_cores
from studies.options import OptionError, executor_named

__all__ = ["executor_of", "number_of_workers"]

ANSWER = 10.0  # seconds in which a scheduler must answer
INSTALL = "pip install 'hardspheres[cluster]'"


@contextlib.contextmanager
def executor_of(
    which: str | Executor | None, workers: int | None, note: Callable[[str], object]
) -> Iterator[Executor | None]:
    """Yield an executor by its name, or the one that was given, which is not shut down.

    Parameters
    ----------
    which : str, Executor or None
        "processes" (None too), "threads", "dask:ADDRESS" or "mpi".
    workers : int or None
        How many processes or threads of this machine; all others have workers of their own.
    note : callable
        Is told in a sentence what the study waits for.

    Yields
    ------
    Executor or None
        None: processes, which `run_replicas` makes itself.

    Raises
    ------
    OptionError
        If there is no such executor, a package is missing, or no scheduler answers.
    """
    name = executor_named(which) if isinstance(which, str) else which
    if name is None or name == "processes":
        yield None
        return
    if name != "threads" and workers is not None:
        raise OptionError(
            f"--workers {workers} is for processes and threads, and this executor has workers of its own; "
            "leave it out"
        )
    if isinstance(name, Executor):
        yield name
    elif name == "threads":
        with ThreadPoolExecutor(available_cores() if workers is None else workers) as pool:
            yield pool
    else:
        with _mpi() if name == "mpi" else _dask(name.partition(":")[2], note) as executor:
            yield executor


def number_of_workers(executor: Executor | None, workers: int | None) -> int | None:
    """Return how many runs go on at once, None where an executor does not tell."""
    if executor is None:
        return available_cores() if workers is None else workers
    with contextlib.suppress(Exception):  # a scheduler that has ended since
        client = getattr(executor, "_client", None)  # of Dask
        found = getattr(executor, "_max_workers", None) if client is None else sum(client.nthreads().values())
        return int(found) or None if found is not None else None
    return None


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep what Dask, and what it is made of, log from the screen: what fails is told in a sentence."""
    own = {"distributed", "tornado", "asyncio"}
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in own]
    heard = [log for log in map(logging.getLogger, names) if not log.disabled]
    for log in heard:
        log.disabled = True
    try:
        yield
    finally:
        for log in heard:
            log.disabled = False


@contextlib.contextmanager
def _dask(address: str, note: Callable[[str], object]) -> Iterator[Executor]:
    try:
        import distributed
    except ImportError as error:
        raise OptionError(f"--executor dask needs Dask ({error}): {INSTALL}") from None
    dask: Any = distributed
    from_file = address.endswith(".json")
    if from_file and not os.path.isfile(address):
        raise OptionError(f"--executor dask:{address}: there is no such file of a scheduler")
    try:
        from_file or dask.comm.get_address_host_port(address)
    except ValueError as error:
        raise OptionError(
            f"--executor dask:{address} has no address of a scheduler ({error}); give the one that "
            "`dask scheduler` prints, as in dask:tcp://host:8786"
        ) from None
    with _silence():
        where = {"scheduler_file": address} if from_file else {"address": address}
        try:
            client: Any = dask.Client(**where, timeout=ANSWER, set_as_default=False, name="hardspheres")
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise OptionError(
                f"no Dask scheduler answers at {address}; start one with `dask scheduler`, and give the "
                "address that it prints, as in dask:tcp://host:8786"
            ) from error
        try:
            if not client.nthreads():
                note(f"the Dask scheduler at {address} has no workers yet; the runs wait for the first")
            yield client.get_executor(pure=False)
        finally:
            with contextlib.suppress(Exception):  # that it has ended is known by now
                client.close(timeout=2.0)


@contextlib.contextmanager
def _mpi() -> Iterator[Executor]:
    try:
        from mpi4py import futures
    except (ImportError, RuntimeError) as error:
        raise OptionError(f"--executor mpi needs mpi4py ({error}): {INSTALL}") from None
    if not any(word.endswith("mpi4py.futures") for word in sys.orig_argv):
        # without it every process of the job would conduct the study
        raise OptionError(
            "--executor mpi needs processes to run in: start it as "
            "`mpiexec -n 4 python -m mpi4py.futures -m hardspheres ... --executor mpi`"
        )
    try:
        pool = futures.MPIPoolExecutor()
    except (ImportError, RuntimeError) as error:
        raise OptionError(f"--executor mpi needs an MPI library: {error}") from None
    with pool:
        yield pool
