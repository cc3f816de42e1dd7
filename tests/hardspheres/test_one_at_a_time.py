"""One thread at a time has a simulation: whoever comes while it runs is refused at once, and nothing is torn."""

import copy
import pickle
import threading

import numpy as np
import pytest
from scenes import everything, gas

import hardspheres as hs
from hardspheres import engine
from hardspheres.simulation import Simulation

REFUSED = {
    "run": lambda sim: sim.run(collisions=1),
    "frames": lambda sim: next(sim.frames(times=[0.0])),
    "frame": lambda sim: sim.frame(),
    "reset": lambda sim: sim.reset_tallies(),
    "save": lambda sim: sim.save("nowhere"),
    "pickle": pickle.dumps,
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "on_threads": lambda sim: sim.on_threads(1),
    "with_log": lambda sim: sim.with_log(lambda events: None),
    "check": lambda sim: sim.check(),
    "status": lambda sim: sim.status(),
    "repr": repr,
    "to_scene": lambda sim: sim.to_scene(),
    "to_atoms": lambda sim: sim.to_atoms(),
} | {
    name: (lambda sim, name=name: getattr(sim, name))
    for name in (
        *(
            "time",
            "positions",
            "unwrapped_positions",
            "velocities",
            "momentum",
            "thermal_energy",
            "temperature",
        ),
        *("tallies", "free_paths", "pressure_tensor", "compressibility_factor", "wall_pressure"),
        *("energy_drift", "momentum_drift", "worst_overlap"),
    )
}
ALLOWED = (
    "scene",
    "threads",
    "collisions",
    "wall_collisions",
    "obstacle_collisions",
    "collisions_per_particle",
)


class Held:
    """A log that stops the run it belongs to until it is let go."""

    def __init__(self):
        self.inside, self.go = threading.Event(), threading.Event()

    def __call__(self, events):
        self.inside.set()
        self.go.wait()


@pytest.fixture(scope="module")
def held():
    """A simulation that another thread is running."""
    log = Held()
    sim = hs.Simulation(gas("3d", 40, 0.1, seed=3), log=log)
    thread = threading.Thread(target=sim.run, kwargs={"collisions": 200})
    thread.start()
    log.inside.wait()
    yield sim
    log.go.set()
    thread.join()
    sim.check()
    assert sim.collisions == 200


def test_everything_public_is_refused_or_known_to_be_safe():
    mine = {name for name in vars(Simulation) if not name.startswith("_")}
    assert mine == {*REFUSED, *ALLOWED, "load", "reset_tallies"} - {
        "pickle",
        "copy",
        "deepcopy",
        "repr",
        "reset",
    }


@pytest.mark.parametrize("name", REFUSED)
def test_another_thread_is_refused(held, name):
    with pytest.raises(hs.SimulationError, match="at work already, .* wait until .* copy") as caught:
        REFUSED[name](held)
    assert "\n" not in str(caught.value)


def test_counts_are_told(held):
    assert held.collisions == 200 == held.collisions_per_particle * held.scene.n / 2
    assert held.wall_collisions == held.obstacle_collisions == 0


@pytest.mark.parametrize("guarded", [True, False])
def test_a_run_within_its_own_log(guarded, monkeypatch):
    """Refused, and what was begun goes on; sibling: unguarded the inner run carries the outer one far beyond its end."""
    refusals = []

    def log(events):
        if not refusals:
            refusals.append(None)
            try:
                sim.run(time=10.0)
            except hs.SimulationError as error:
                refusals[0] = error

    monkeypatch.setattr(engine, "ROOM", 16)  # events until the log is called, long before the run is over
    if not guarded:
        monkeypatch.setattr(Simulation, "_alone", lambda sim, work: work())
    sim, alone = (hs.Simulation(gas("3d", 40, 0.1, seed=3), log=each) for each in (log, lambda events: None))
    for each in (sim, alone):
        each.run(collisions=50)
        each.check()
    assert isinstance(refusals[0], hs.SimulationError) is guarded
    assert (everything(sim) == everything(alone)) is guarded
    assert (sim.collisions == 50) is guarded


def test_a_look_into_which_a_run_comes_is_refused(monkeypatch):
    sim, flown = hs.Simulation(gas("3d", 40, 0.1, seed=3)), engine.Engine.flown
    assert np.array_equal(sim.positions, sim.positions)

    def disturbed(mine):
        places = flown(mine)
        monkeypatch.setattr(engine.Engine, "flown", flown)
        sim.run(collisions=1)
        return places

    for look in (lambda: sim.positions, sim.frame, sim.to_scene):
        monkeypatch.setattr(engine.Engine, "flown", disturbed)
        with pytest.raises(hs.SimulationError, match="at work already"):
            look()
        look()  # and nothing is left locked


def test_two_that_come_at_the_same_time(monkeypatch):
    """The second passed the first look at the lock before the first took it: it waits for nothing but to be refused."""
    sim = hs.Simulation(gas("3d", 40, 0.1, seed=3))

    class Late:
        """A lock that somebody else had just between being looked at and being taken."""

        def __init__(self, lock):
            self.lock = lock

        def locked(self):
            return False

        def __enter__(self):
            sim._lock = self.lock
            sim.run(collisions=5)
            return self.lock.__enter__()

        def __exit__(self, *error):
            self.lock.__exit__(*error)

    sim._lock = Late(sim._lock)
    with pytest.raises(hs.SimulationError, match="at work already"):
        sim.run(collisions=7)
    assert sim.collisions == 5
    sim.run(collisions=7)
    assert sim.collisions == 12


def test_an_error_or_interrupt_leaves_nothing_locked():
    def log(events):
        raise KeyboardInterrupt

    sim = hs.Simulation(gas("3d", 40, 0.1, seed=3), log=log)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            sim.run(collisions=10)
        sim.check()
    assert sim.collisions == 20
