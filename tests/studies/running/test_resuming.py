"""A task that is interrupted at every pause, and goes on from what was saved, gives the same bits as one that is not."""

import math
import signal

import numpy as np
import pytest

import hardspheres as hs
from studies import mixture, thermalisation
from studies.diffusion import SelfDiffusion
from studies.fluid import Fluid
from studies.free_path import Runs
from studies.pressure import EquationOfState, States
from studies.running.encoding import decode, encode
from studies.running.ensemble import replica_seeds, run_replicas
from studies.running.journal import Shelf
from studies.running.resuming import Resumable, perform, until
from studies.running.stopping import STOPPING
from studies.study import _Run, _Running
from studies.validation.soak import Gas, Soaking

(SEED,) = replica_seeds(7, 1)


class Interrupted(Exception):
    pass


class Interrupting:
    """A shelf in memory that keeps the state of every k-th pause only, and interrupts the run there."""

    every = 0.0

    def __init__(self, period):
        self.period, self.pauses, self.saved = period, 0, None

    def state(self, index):
        return None if self.saved is None else decode(self.saved)

    def save(self, index, state):
        self.pauses += 1
        if self.pauses % self.period == 0:
            self.saved = encode(state)
            raise Interrupted

    def store(self, index, result):
        self.saved = encode(result)


def in_pieces(task, item, every=1):
    """The result of a task that is thrown away at every k-th pause, with all that it did not save."""
    shelf, times = Interrupting(every), 0
    while True:
        try:
            return perform(task, item, shelf), times
        except Interrupted:
            times += 1


def mixed():
    study = mixture.Mixture(Fluid(100, 3, 0.01, "periodic", 2.0, 10.0), relaxation_times=1.0)
    return mixture.Equilibrations(study, study.times(study.start(SEED))), SEED


def diffusing(folder):
    study = SelfDiffusion(packing_fractions=(0.3,), n=100, collisions_per_particle=90.0)
    return _Running(study, folder), _Run(study.gases()[0], 0)


def relaxing(folder):
    recipe, s = thermalisation.Recipe(n=100), (0.0, 1.0, 2.0)
    return thermalisation.Replicas(recipe, s, folder / "trajectory.xyz", (0.0, 0.7, 2.0), (0.0, 1.5)), (
        0,
        SEED,
    )


TASKS = {
    "pressure": lambda folder: (
        States(EquationOfState(collisions_per_particle=3.0)),
        (Fluid(100, packing_fraction=0.3), SEED),
    ),
    "free-path": lambda folder: (Runs(60.0), (Fluid(100, packing_fraction=0.1), SEED)),
    "diffusion": lambda folder: diffusing(folder),
    "mixture": lambda folder: mixed(),
    "thermalise": relaxing,
    "soak": lambda folder: (Soaking(), (Gas(Fluid(100, packing_fraction=0.3), 20_000), SEED)),
}


def bits(result):
    """A result without its timings, and without what the search begins anew after a restart."""
    parts = {name: value for name, value in vars(result).items() if name != "seconds"}
    parts["status"] = {
        k: v
        for k, v in result.status.items()
        if k not in ("stale_events", "list_renewals", "bytes_per_particle", "collisions_per_second")
    }
    if "samples" in parts:
        parts["samples"] = parts["samples"][:, :-1]  # the last column is the memory of the machine
    return {name: content.tobytes() for name, content in encode(parts).items()}


@pytest.mark.parametrize("name", TASKS)
def test_interrupted_at_every_pause(name, tmp_path, monkeypatch):
    monkeypatch.setattr("studies.running.resuming.PAUSE", 700)
    task, item = TASKS[name](tmp_path)
    whole = task(item)
    files = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    pieces, times = in_pieces(task, item, every={"diffusion": 40, "free-path": 30, "soak": 7}.get(name, 1))
    assert times > 5
    assert bits(pieces) == bits(whole)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


class Forgetful(States):
    """Loses what was counted of a block when it is taken up again."""

    def steps(self, item, state):
        if state.done:
            state.pressure._before[1] = 0.0  # of the virial
        yield from super().steps(item, state)


def test_a_task_that_forgets_something_is_found_out(monkeypatch):
    """Sibling: the same comparison, of a task whose state is not complete."""
    monkeypatch.setattr("studies.running.resuming.PAUSE", 50)
    item, study = (Fluid(100, packing_fraction=0.3), SEED), EquationOfState(collisions_per_particle=300.0)
    assert bits(in_pieces(Forgetful(study), item, every=80)[0]) != bits(Forgetful(study)(item))
    assert bits(in_pieces(States(study), item, every=80)[0]) == bits(States(study)(item))


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
