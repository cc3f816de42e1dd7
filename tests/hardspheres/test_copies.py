"""Copies of simulations: independent, and they go on with the same bits. What a simulation shows is read-only."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest
from scenes import everything, flight_bits, gas, tallied_bits

import hardspheres as hs
from hardspheres import checkpoint

WAYS = {
    "pickle": lambda sim: pickle.loads(pickle.dumps(sim)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}
KINDS = ("3d", "3d_mixture", "2d_mixture_walls")


def half_way(kind, **options):
    sim = hs.Simulation(gas(kind, 60, 0.1, seed=4), **options)
    sim.run(collisions=300)
    sim.reset_tallies()
    sim.run(time=0.37)
    return sim


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("way", WAYS)
def test_a_copy_goes_on_with_the_same_bits(way, kind):
    sim = half_way(kind)
    before, twin = everything(sim), WAYS[way](sim)
    assert everything(twin) == before and type(twin) is type(sim)
    twin.run(collisions=200)
    twin.check()
    assert everything(sim) == before != everything(twin)  # neither moves the other
    sim.run(collisions=200)
    sim.check()
    assert everything(sim) == everything(twin)


@pytest.mark.parametrize("way", WAYS)
def test_with_shorter_epochs(way):
    """Where epochs have changed their length a copy has the new one."""
    heavy = np.arange(8) % 2 == 0
    scene = gas("3d_mixture", 8, 0.02, masses=np.where(heavy, 1e10, 1.0))
    sim = hs.Simulation(scene.replace(velocities=scene.velocities * np.where(heavy, 1e5, 0.0)[:, None]))
    usual = sim.status()["epoch_length"]
    sim.run(collisions=2000)
    twin = WAYS[way](sim)
    assert twin.status()["epoch_length"] == sim.status()["epoch_length"] < usual
    for each in (sim, twin):
        each.run(collisions=200)
    assert everything(twin) == everything(sim)


@pytest.mark.parametrize("what", ["row", "turns", "total", "counters"])
def test_whatever_is_lost_is_missed(what, monkeypatch):
    """Sibling: a copy without one of the arrays is another simulation."""
    sim, whole = half_way("3d"), checkpoint.to_arrays

    def without(engine):
        arrays = whole(engine)
        return arrays | {what: np.zeros_like(arrays[what])}

    monkeypatch.setattr(checkpoint, "to_arrays", without)
    assert everything(copy.copy(sim)) != everything(sim)


class Kept:
    """A log that keeps what it gets."""

    def __init__(self):
        self.events = []

    def __call__(self, events):
        self.events += events["time"].tolist()


def test_a_function_of_a_log_goes_along():
    sim = half_way("3d", log=Kept())
    log = sim._engine.sink
    seen = len(log.events)
    assert seen >= 300
    shallow, deep, pickled = copy.copy(sim), copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))
    logs = [each._engine.sink for each in (shallow, deep, pickled)]
    assert logs[0] is log and log not in logs[1:]
    for each in (deep, pickled):
        each.run(collisions=50)
        each.check()
        assert len(each._engine.sink.events) == seen + 50
    assert len(log.events) == seen
    sim.run(collisions=50)
    assert log.events == logs[1].events == logs[2].events
    assert flight_bits(sim.free_paths) == flight_bits(deep.free_paths) == flight_bits(pickled.free_paths)


@pytest.mark.parametrize("way", WAYS)
def test_a_log_in_a_file_has_one_writer(way, tmp_path):
    sim = half_way("3d", log=tmp_path / "log.npy")
    with pytest.raises(
        hs.SimulationError, match=r"two .* cannot write one log, and this one writes .*log\.npy; save it"
    ):
        WAYS[way](sim)
    sim.run(collisions=1)
    sim.check()


def shown(sim):
    """Every array that looks like state, by name."""
    frame, tallies = sim.frame(), sim.tallies
    for owner in (sim, sim.scene, frame, tallies, frame.tallies, sim.free_paths, frame.free_paths):
        names = {name for name in dir(type(owner)) if isinstance(getattr(type(owner), name), property)} | {
            *vars(owner)
        }
        for name in sorted(name for name in names if not name.startswith("_")):
            value = getattr(owner, name)
            if isinstance(value, np.ndarray):
                yield f"{type(owner).__name__}.{name}", value
    yield from (("flown", frame.unwound[0]), ("images", frame.unwound[1]))


def test_what_looks_like_state_is_read_only():
    sim = half_way("3d", free_paths=True)
    before, names = everything(sim), []
    for name, array in shown(sim):
        names.append(name)
        assert not array.flags.writeable, name
        with pytest.raises(ValueError, match="read-only"):
            array[(0,) * array.ndim] = 1
    assert everything(sim) == before
    assert len(names) > 35 and {"Simulation.velocities", "Frame.unwrapped_positions", "Tallies.virial"} <= {
        *names
    }
    with pytest.raises(AttributeError):
        sim.scene = sim.to_scene()


def test_a_frame_keeps_what_was_counted_when_it_is_changed():
    """Tallies and unwrapped positions are of the run, whatever scene or velocities a frame is given later."""
    sim = half_way("3d_mixture")
    frame, scene = sim.frame(), sim.scene
    other = scene.replace(masses=2.0 * scene.masses, box=2.0 * scene.box)
    changed = dataclasses.replace(frame, scene=other, velocities=0.0 * frame.velocities)
    assert tallied_bits(changed.tallies) == tallied_bits(frame.tallies)
    assert np.array_equal(changed.unwrapped_positions, frame.unwrapped_positions)
    # Sibling: the kinetic tensor of the run shows the mass.
    heavy = hs.Simulation(scene.replace(masses=2.0 * scene.masses))
    heavy.run(time=sim.time)
    np.testing.assert_allclose(
        heavy.frame().tallies.kinetic, 2.0 * frame.tallies.kinetic, rtol=1e-9, atol=1e-9
    )


def test_copies_of_scenes():
    scene = gas("2d_mixture_walls", 20, 0.1)
    for twin in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        for name in ("positions", "velocities", "radii", "masses", "box", "periodic", "species"):
            array = getattr(twin, name)
            assert np.array_equal(array, getattr(scene, name)) and not array.flags.writeable
        assert twin.boundary == scene.boundary
