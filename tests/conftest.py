"""Settings that every test shares."""

import os
import signal

import pytest
from hypothesis import settings

from studies.running.stopping import STOPPING

settings.register_profile("hardspheres", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("hardspheres")

# Readline, which pytest's debugger loads, invents a window where there is none.
for name in ("COLUMNS", "LINES"):
    os.environ.pop(name, None)


# The power does not fail here: nothing in this process waits for the disk. That files are synchronised has tests.
os.fsync = os.fstat


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Undo what a command that ended in this process did to signals: it ignores them, as its process is about to exit."""
    before = {number: signal.getsignal(number) for number in STOPPING}
    try:
        return (yield)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.fixture
def heard():
    """Signals have their usual effect, here and in child processes, also where the tests were started with some ignored (nohup)."""
    usual = {"SIGINT": signal.default_int_handler, "SIGTERM": signal.SIG_DFL, "SIGHUP": signal.SIG_DFL}
    known = {getattr(signal, name): handler for name, handler in usual.items() if hasattr(signal, name)}
    before = {number: signal.signal(number, handler) for number, handler in known.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
