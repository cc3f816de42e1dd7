"""Who runs a shard is known from a file: at once on the same host, by whether it is renewed on another."""

import json
import os
import platform
import subprocess
import sys
import threading
import time

import pytest

from hardspheres.temporary import neighbourhood
from studies.running import presence
from studies.running.presence import NAMED, Presence, announce, present_in, renewing

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="ids of processes cannot be compared")


@pytest.fixture
def soon(monkeypatch):
    """Seconds become hundredths."""
    for name, value in (("BEAT", 0.05), ("STALE", 0.4), ("LOOK", 0.01)):
        monkeypatch.setattr(presence, name, value)


def of_another_host(path, **more):
    """As if another host had written it."""
    said = json.loads(path.read_text())
    path.write_text(json.dumps(said | {"where": "0" * 16, "host": "node7"} | more))
    return path


def ended_process():
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        pass
    return ended.pid


def test_it_names_host_and_process_while_it_lasts(tmp_path):
    path = announce(tmp_path, 2, "2/3")
    assert NAMED.fullmatch(path.name)
    with renewing(path):
        (found,) = present_in(tmp_path, path)
        assert str(found) == f"shard 2/3 (host {platform.node()}, process {os.getpid()})"
    assert not list(tmp_path.iterdir())


@linux
def test_a_process_of_this_host_that_was_killed_is_known_to_have_ended_at_once(tmp_path):
    path = announce(tmp_path, 1, "1/3")
    said = json.loads(path.read_text())
    assert said["where"] == neighbourhood()
    assert not Presence.of(path).ended(path)
    path.write_text(json.dumps(said | {"process": ended_process()}))
    assert Presence.of(path).ended(path)
    began = time.monotonic()
    assert not Presence.of(path).goes_on(path) and time.monotonic() - began < presence.LOOK
    assert present_in(tmp_path, path) == []
    of_another_host(path)  # sibling: the same id on another host says nothing
    assert not Presence.of(path).ended(path)


def test_one_of_another_host_runs_while_it_is_renewed(tmp_path, soon):
    path = of_another_host(announce(tmp_path, 1, "1/3"))
    with renewing(path):
        assert Presence.of(path).goes_on(path)
        time.sleep(2 * presence.STALE)
        assert Presence.of(path).goes_on(tmp_path / "no clock")


@pytest.mark.usefixtures("soon")
def test_one_of_another_host_that_is_not_renewed_has_ended(tmp_path):
    """By the clock of the file system at once where it is old; else after a while of watching."""
    path, clock = of_another_host(announce(tmp_path, 1, "1/3")), tmp_path / "clock"
    clock.touch()
    began = time.monotonic()
    assert not Presence.of(path).goes_on(clock)
    assert 0.5 * presence.STALE < time.monotonic() - began
    began = time.monotonic()
    assert Presence.of(path).ended(clock) and not Presence.of(path).goes_on(clock)
    assert time.monotonic() - began < 0.5 * presence.STALE


@pytest.mark.usefixtures("soon")
def test_one_that_ends_while_it_is_watched_has_ended(tmp_path):
    path = of_another_host(announce(tmp_path, 1, "1/3"))
    seen = Presence.of(path)
    threading.Timer(0.1, path.unlink).start()
    assert not seen.goes_on(tmp_path / "no clock")


def test_a_file_that_says_nothing_is_nobody(tmp_path):
    path = tmp_path / "shard-0001-01234567"
    for text in ("", "[]", "{}", '{"shard": 1}', "\0", "[" * 10_000):
        path.write_text(text)
        assert Presence.of(path) is None and present_in(tmp_path, path) == []
    path.write_bytes(b"\xff\xfe")
    assert Presence.of(path) is None and Presence.of(tmp_path / "none") is None
