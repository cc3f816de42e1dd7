"""A task that is interrupted at every pause, and goes on from what was saved, gives the same bits as one that is not."""

import math
import signal

import numpy as np
import pytest

import hardspheres as hs
from studies.running.ensemble import replica_seeds, run_replicas
from studies.running.journal import Shelf
from studies.running.resuming import Resumable, until
from studies.running.stopping import STOPPING

(SEED,) = replica_seeds(7, 1)


class Sums(Resumable):
    """Adds up an item's digits, one at each step."""

    def begin(self, item):
        return {"left": item, "sum": 0}

    def steps(self, item, state):
        while state["left"]:
            state["left"], digit = divmod(state["left"], 10)
            state["sum"] += digit
            yield

    def result(self, item, state, seconds):
        return state["sum"]


class Signalling(Sums):
    """Sends a signal in the middle of the second item."""

    def __init__(self, number):
        self.number = number

    def steps(self, item, state):
        for _ in super().steps(item, state):
            if item == 999 and state["sum"] == 9:
                signal.raise_signal(self.number)
            yield


class Stopped(BaseException):
    """What a signal does, other than Ctrl-C."""


def stop(*_):
    raise Stopped


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_waits_for_a_pause_and_what_is_finished_is_not_done_again(number, tmp_path, monkeypatch):
    shelf = Shelf(tmp_path, math.inf)
    if number != signal.SIGINT:
        signal.signal(number, stop)
    with pytest.raises(KeyboardInterrupt if number == signal.SIGINT else Stopped):
        run_replicas(Signalling(number), [12, 999, 55], workers=1, shelf=shelf)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["done-0000.npz", "running-0001.npz"]
    assert shelf.state(1)[0] == {"left": 99, "sum": 9}
    begun, told = [], []
    monkeypatch.setattr(Sums, "begin", lambda self, item: begun.append(item) or {"left": item, "sum": 0})
    found = run_replicas(Sums(), [12, 999, 55], workers=1, shelf=shelf, done=lambda: told.append(1))
    assert found == [3, 27, 10] and begun == [55] and len(told) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"done-000{k}.npz" for k in range(3)]


def test_a_damaged_file_counts_as_missing_and_is_named(tmp_path):
    shelf = Shelf(tmp_path, math.inf)
    run_replicas(Sums(), [12, 34], workers=1, shelf=shelf)
    path = tmp_path / "done-0001.npz"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.warns(UserWarning, match=r"done-0001.npz.*computed again"):
        assert run_replicas(Sums(), [12, 34], workers=1, shelf=shelf) == [3, 7]


def test_any_task_keeps_its_results(tmp_path):
    """Also one that is no `Resumable`: a plain function."""
    shelf = Shelf(tmp_path, math.inf)
    assert run_replicas(math.sqrt, [4.0, 9.0], workers=1, shelf=shelf) == [2.0, 3.0]
    assert run_replicas(math.cos, [4.0, 9.0], workers=1, shelf=shelf) == [2.0, 3.0]


def test_running_in_parts_changes_nothing(monkeypatch):
    monkeypatch.setattr("studies.running.resuming.PAUSE", 37)
    scene = hs.random_gas(n=100, packing_fraction=0.3, seed=1)
    parts, whole = hs.Simulation(scene), hs.Simulation(scene)
    assert len(list(until(parts, 1000))) == math.ceil(1000 / 37)
    whole.run(collisions=1000)
    assert parts.positions.tobytes() == whole.positions.tobytes() and parts.time == whole.time
    np.testing.assert_array_equal(parts.tallies.virial, whole.tallies.virial)
