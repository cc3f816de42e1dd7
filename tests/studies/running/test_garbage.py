"""Programs of ours collect garbage rarely; a program that imports us decides for itself."""

import gc
import subprocess
import sys

import pytest

from studies.running.ensemble import _can_be_forked, run_replicas
from studies.running.garbage import THRESHOLDS


@pytest.mark.parametrize(
    ("code", "rarely"),
    [
        ("from studies.__main__ import main; sys.argv = ['hardspheres', '--version']; main()", True),
        ("import studies.cli, studies.study", False),
    ],
)
def test_a_program_of_ours_collects_garbage_rarely(code, rarely):
    before = gc.get_threshold()
    said = "import atexit, gc, sys; atexit.register(lambda: print(gc.get_freeze_count() > 0, *gc.get_threshold()));"
    done = subprocess.run([sys.executable, "-c", said + code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    expected = " ".join(map(str, (rarely, *(THRESHOLDS if rarely else before))))
    assert done.stdout.splitlines()[-1] == expected
    assert THRESHOLDS != before


def thresholds(_):
    return gc.get_threshold()


@pytest.mark.skipif(not _can_be_forked(), reason="workers are fresh processes here")
def test_so_do_workers():
    """Sibling: this process, which is no program of ours."""
    assert run_replicas(thresholds, range(2), workers=2) == [THRESHOLDS] * 2
    assert gc.get_threshold() != THRESHOLDS
