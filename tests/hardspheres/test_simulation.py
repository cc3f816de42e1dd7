"""The public face of a simulation: running, frames, tallies, errors."""

import copy
import gc
import itertools
import math
import weakref

import numpy as np
import pytest
from scenes import gas

import hardspheres as hs
from hardspheres import patience


@pytest.fixture
def sim():
    return hs.Simulation(gas("3d", 100, 0.1))


def test_counts_and_clock(sim):
    assert (sim.time, sim.collisions, sim.collisions_per_particle) == (0.0, 0, 0.0)
    sim.run(collisions=250)
    assert sim.collisions == 250
    assert sim.collisions_per_particle == 5.0
    t = sim.time
    sim.run(time=1.25)
    assert sim.time == pytest.approx(t + 1.25, rel=1e-15)
    sim.run(time=0.0)
    sim.run(collisions=0)
    assert sim.time == pytest.approx(t + 1.25, rel=1e-15)


def test_time_keeps_its_resolution():
    """Two spheres a billion time units later still collide to rounding: time is epochs and a rest, not one number."""
    scene = hs.Scene([[1.0, 2.0], [5.0, 2.0]], [[0.0, 0.0], [-1.0, 0.0]], 0.5, 1.0, (8.0, 4.0), "wall")
    sim = hs.Simulation(scene)
    sim.run(time=1e6 + 0.375)
    # In units of one crossing (3 + 3 each way, exchanged): both bounce on one line; positions stay multiples of 1/8.
    assert np.array_equal(sim.positions * 8, np.rint(sim.positions * 8))
    assert sim.energy_drift == 0.0


def test_free_flight_is_exact_and_wraps():
    scene = hs.Scene([[1.0, 1.0, 1.0]], [[0.25, 0.5, -1.0]], box=(3.0, 4.0, 5.0))
    sim = hs.Simulation(scene)
    sim.run(time=17.0)
    assert np.array_equal(sim.unwrapped_positions, [[5.25, 9.5, -16.0]])
    assert np.array_equal(sim.positions, [[2.25, 1.5, 4.0]])


def test_a_particle_alone_between_walls():
    scene = hs.Scene([[1.0, 1.0]], [[1.0, 0.0]], 0.5, 1.0, (4.0, 4.0), "wall")
    sim = hs.Simulation(scene)
    sim.run(time=12.0)
    assert sim.wall_collisions == 4
    assert np.array_equal(sim.positions, [[1.0, 1.0]])
    assert np.array_equal(sim.tallies.wall_impulses, [[4.0, 4.0], [0.0, 0.0]])


def test_pressure_on_walls_is_force_over_the_area_that_centres_reach():
    scene = hs.Scene([[1.0, 1.0]], [[1.0, 0.0]], 0.5, 1.0, (4.0, 4.0), "wall")
    sim = hs.Simulation(scene)
    sim.run(time=12.0)
    assert np.array_equal(sim.wall_pressure, [[1 / 9, 1 / 9], [0.0, 0.0]])  # 2 m v every 6, over 4 - 1
    with pytest.raises(hs.SimulationError, match="no pressure yet"):
        _ = hs.Simulation(scene).wall_pressure


@pytest.mark.parametrize("n", [60, 500])
def test_pressure_on_walls_and_tensor_keep_clausius_theorem(n):
    """P_kk V t = A_k t [(L_k - R) p_high - R p_low] + G(t) - G(0), to round-off, for any run."""
    sim = hs.Simulation(gas("3d_walls", n, 0.2))
    sim.run(collisions=500)
    axis, box, radius = 1, sim.scene.box, 0.5

    def moment():
        return float(sim.scene.masses @ (sim.positions[:, axis] * sim.velocities[:, axis]))

    for collisions in (10, 5000):
        sim.reset_tallies()
        before, began = moment(), sim.time
        sim.run(collisions=collisions)
        took = sim.time - began
        pressure, area = sim.wall_pressure, box[0] * box[2]
        assert np.isnan(pressure[[0, 2]]).all()
        low, high = pressure[axis] * area * took
        inside = sim.pressure_tensor[axis, axis] * sim.scene.volume * took
        assert inside == pytest.approx(
            (box[axis] - radius) * high - radius * low + moment() - before, rel=1e-11
        )
    # sibling: the tensor is a mean over the whole box, and lower than what the walls feel
    assert sim.pressure_tensor[axis, axis] < 0.95 * pressure[axis].mean()


def test_frames(sim):
    times = [frame.time for frame in sim.frames(every=0.5, count=4)]
    assert times == [0.0, 0.5, 1.0, 1.5]
    frames = list(sim.frames(times=[1.5, 2.0]))
    assert [frame.time for frame in frames] == [1.5, 2.0]
    goals = [6.0, 7.0, 7.01]
    frames = list(sim.frames(collisions_per_particle=goals))
    assert [frame.collisions for frame in frames] == [300, 350, 351]
    assert frames[0].positions.shape == frames[0].velocities.shape == (100, 3)
    assert frames[0].scene is sim.scene


def test_a_frame_flies_the_particles_once(sim, monkeypatch):
    """Positions and velocities are of one flight. Sibling: asked for one by one, each is a flight of its own."""
    flights = []
    whole = type(sim._engine).flown
    monkeypatch.setattr(type(sim._engine), "flown", lambda engine: flights.append(1) or whole(engine))
    sim.run(collisions=30)
    frame = sim.frame()
    assert len(flights) == 1
    assert np.array_equal(frame.positions, sim.positions)
    assert np.array_equal(frame.velocities, sim.velocities)
    assert np.array_equal(frame.unwrapped_positions, sim.unwrapped_positions)
    assert len(flights) == 4


@pytest.mark.parametrize("held", [False, True])
def test_a_simulation_goes_with_its_last_holder(held):
    """Its arrays wait for no garbage collection: programs of ours run that rarely. Sibling: one in a circle does."""
    sim = hs.Simulation(gas("3d", 100, 0.1))
    sim.run(collisions=30)
    for frame in sim.frames(every=0.1, count=2):
        sim.check(), sim.status(), frame.tallies
    twin = copy.copy(sim)
    large = [weakref.ref(each._engine.arrays.row) for each in (sim, twin)]
    if held:
        sim.circle = twin.circle = [sim, twin]
    gc.disable()
    try:
        del sim, twin, frame
        assert [each() is not None for each in large] == [held, held]
    finally:
        gc.enable()


def test_any_number_of_frames_takes_no_memory(sim):
    """Moments are counted as they are due; a list of these would not fit in any machine."""
    sim.run(time=0.3)
    now, step = sim.time, 1e-3 / 3
    some = itertools.islice(sim.frames(every=step, count=2**60), 40)
    assert [frame.time for frame in some] == [now + k * step for k in range(40)]  # to the last bit
    for times in (range(1, 2**60), itertools.count(1), itertools.count(1.0)):
        twin = copy.copy(sim)
        assert [frame.time for frame in itertools.islice(twin.frames(times=times), 3)] == [1.0, 2.0, 3.0]
    for goals in (range(7, 2**50), itertools.count(7)):
        frames = itertools.islice(copy.copy(sim).frames(collisions_per_particle=goals), 3)
        assert [frame.collisions for frame in frames] == [350, 400, 450]


def test_an_iterator_is_checked_as_it_comes_and_all_else_at_once(sim):
    frames = sim.frames(times=iter([0.1, 0.3, 0.2]))
    assert [next(frames).time, next(frames).time] == [0.1, 0.3]
    with pytest.raises(hs.SimulationError, match="ascending"):
        next(frames)
    for times in ([0.4, 0.5, 0.4], range(5, 1, -1), range(-1, 9), [1.0, "2"], np.array([1.0, np.nan])):
        with pytest.raises(hs.SimulationError, match="ascending|already|finite"):
            sim.frames(times=times)
    with pytest.raises(hs.SimulationError, match="below 2"):
        sim.frames(collisions_per_particle=range(1, 2**70, 2**62))
    assert sim.time == 0.3
    assert list(sim.frames(times=[])) == list(sim.frames(times=range(0))) == []


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda sim: sim.run(), "either time"),
        (lambda sim: sim.run(time=1.0, collisions=1), "not both"),
        (lambda sim: sim.run(time=-1.0), "at least 0"),
        (lambda sim: sim.run(time=math.nan), "finite"),
        (lambda sim: sim.run(collisions=1.5), "whole number"),
        (lambda sim: sim.frames(), "needs one of"),
        (lambda sim: sim.frames(every=0.0, count=2), "above 0"),
        (lambda sim: sim.frames(times=[1.0, 0.5]), "ascending"),
        (lambda sim: sim.frames(times=[-1.0]), "already"),
        (lambda sim: sim.compressibility_factor, "no pressure yet"),
    ],
)
def test_senseless_requests_say_so(sim, call, message):
    with pytest.raises(hs.SimulationError, match=message):
        call(sim)


def test_one_particle_never_collides():
    sim = hs.Simulation(hs.Scene([[1.0, 1, 1]], [[1.0, 0, 0]], box=(3, 3, 3)))
    with pytest.raises(hs.SimulationError, match="one particle only"):
        sim.run(collisions=1)


@pytest.mark.parametrize("velocity", [0.0, 1.0])
def test_a_gas_without_relative_motion(velocity):
    scene = hs.Scene([[1.0, 1, 1], [2.0, 1, 1]], np.full((2, 3), velocity), box=(4, 4, 4))
    sim = hs.Simulation(scene)
    sim.run(time=1e3 if velocity else 1e12)
    assert sim.collisions == 0
    sim.check()
    with pytest.raises(hs.SimulationError, match="no particle moves relative to another"):
        sim.run(collisions=1)


def test_a_call_looks_at_the_velocities_once(sim, monkeypatch):
    """Whether anybody moves is asked before the first collision only: later calls cost the same at any size."""
    looks = []
    whole = patience._velocities
    monkeypatch.setattr(patience, "_velocities", lambda engine: looks.append(1) or whole(engine))
    for _ in range(5):
        sim.run(collisions=3)
    assert len(looks) == 1


def test_particles_that_pass_each_other_for_ever():
    scene = hs.Scene([[1.0, 1.0, 1.0], [2.2, 3.0, 1.0]], [[1.0, 0, 0], [-1.0, 0, 0]], box=(4, 4, 4))
    with pytest.raises(hs.SimulationError, match="may never meet"):
        hs.Simulation(scene).run(collisions=1)


def test_a_jammed_crystal_stands_still():
    grid = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
    velocities = np.random.default_rng(1).normal(size=grid.shape)
    sim = hs.Simulation(hs.Scene(grid, velocities, box=(3, 3, 3)))
    with pytest.raises(hs.SimulationError, match="time stands still"):
        sim.run(collisions=10**7)
    assert sim.energy_drift == pytest.approx(0.0, abs=1e-12)


def test_newtons_cradle_of_touching_balls():
    """One in, one out; simultaneous contacts are taken in the order of the ids."""
    x = np.column_stack([np.arange(2.0, 7.0), np.full(5, 5.0)])
    v = np.zeros_like(x)
    v[0, 0] = 1.0
    sim = hs.Simulation(hs.Scene(x, v, 0.5, 1.0, (20, 10), "wall"))
    sim.run(time=0.5)
    assert sim.collisions == 4
    assert np.array_equal(sim.velocities[:, 0], [0, 0, 0, 0, 1.0])


def test_one_at_rest_and_speeds_of_eighteen_decades():
    rng = np.random.default_rng(8)
    scene = gas("3d", 30, 0.05)
    velocities = rng.normal(size=scene.velocities.shape) * np.logspace(-9, 9, 30)[:, None]
    velocities[7] = 0.0
    sim = hs.Simulation(scene.replace(velocities=velocities))
    sim.run(collisions=3000)
    sim.check()


def test_tallies_against_an_independent_sum():
    """Virial and kinetic integral from the engine equal those computed from frames taken after every collision."""
    scene = gas("3d_mixture", 40, 0.15)
    sim = hs.Simulation(scene)
    virial, kinetic, before, t0 = np.zeros((3, 3)), np.zeros((3, 3)), sim.velocities, 0.0
    for _ in range(400):
        sim.run(collisions=1)
        after = sim.velocities
        i, j = np.flatnonzero(np.any(after != before, axis=1))
        r = sim.positions[i] - sim.positions[j]
        r -= scene.box * np.rint(r / scene.box)
        virial += np.outer(r, scene.masses[i] * (after[i] - before[i]))
        kinetic += (before * scene.masses[:, None]).T @ before * (sim.time - t0)
        before, t0 = after, sim.time
    np.testing.assert_allclose(sim.tallies.virial, virial, rtol=1e-9, atol=1e-9 * np.trace(virial))
    np.testing.assert_allclose(sim.tallies.kinetic, kinetic, rtol=1e-9, atol=1e-9 * np.trace(kinetic))
    z = sim.compressibility_factor
    assert z == pytest.approx(
        np.trace(sim.pressure_tensor) * scene.volume / (2 * sim.thermal_energy), rel=1e-12
    )


def test_tallies_begin_anew(sim):
    sim.run(collisions=5000)
    first = sim.tallies
    sim.reset_tallies()
    assert sim.tallies.collisions == 0 and sim.tallies.time == 0.0
    sim.run(collisions=100)
    assert sim.tallies.collisions == 100
    assert sim.tallies.time == pytest.approx(sim.time - first.time, rel=1e-12)
    assert np.trace(sim.tallies.kinetic) == pytest.approx(
        2 * sim.scene.kinetic_energy * sim.tallies.time, rel=1e-9
    )


def pieces(tallies):
    """All numbers in tallies, in one row."""
    return np.concatenate([np.ravel(piece) for piece in vars(tallies).values() if piece is not None])


@pytest.mark.parametrize(("kind", "heat"), [("3d_walls", False), ("2d_mixture_walls", False), ("3d", True)])
def test_frames_count_from_the_start(kind, heat):
    """Whatever is reset; what lies between two frames is what was counted since a reset at the first, to rounding of the whole."""
    sim, whole = (hs.Simulation(gas(kind, 60, 0.1), heat=heat) for _ in range(2))
    for step in ({"collisions": 700}, {"time": 0.3}, {"collisions": 2000}, {"collisions": 90}):
        sim.reset_tallies()
        before = sim.frame()
        sim.run(**step)
        whole.run(**step)
        first, last, block = pieces(before.tallies), pieces(sim.frame().tallies), pieces(sim.tallies)
        rounding = 1e-13 * np.abs(last).max()
        np.testing.assert_allclose(last - first, block, rtol=1e-10, atol=rounding)
        np.testing.assert_allclose(last, pieces(whole.tallies), rtol=1e-10, atol=rounding)
        np.testing.assert_array_equal(pieces(whole.frame().tallies), pieces(whole.tallies))
    assert last[1] == sim.collisions > block[1]  # sibling: since the reset it is another number
    assert sim.frame().free_paths is None
    assert hs.Frame(0.0, 0, 0.0, before.positions, before.velocities, sim.scene).tallies is None


@pytest.mark.parametrize("kind", ["3d_walls", "2d_mixture_walls"])
def test_pressure_identity_between_walls(kind):
    """2K + W = walls' work + change of sum m r.v over time, for any run, to rounding (per wall axis, Clausius' virial)."""
    scene = gas(kind, 60, 0.1)
    sim = hs.Simulation(scene)
    for collisions in (500, 40, 1):
        sim.reset_tallies()

        def g():
            return np.sum(scene.masses[:, None] * sim.unwrapped_positions * sim.velocities, axis=0)

        before = g()
        sim.run(collisions=collisions)
        t = sim.tallies
        change = g() - before
        for axis in np.flatnonzero(~scene.periodic):
            high = t.wall_impulses[axis, 1]
            low_r, high_r = t.wall_radius_impulses[axis]
            left = t.kinetic[axis, axis] + t.virial[axis, axis]
            right = (scene.box[axis] * high - high_r) - low_r + change[axis]
            assert left == pytest.approx(right, rel=1e-11)
            # Sibling: without the boundary term the identity fails.
            assert left != pytest.approx(right - change[axis], rel=1e-6)


def test_to_scene_goes_on_from_here(sim):
    sim.run(collisions=1000)
    later = hs.Simulation(sim.to_scene())
    later.run(collisions=100)
    later.check()
    assert later.scene.temperature == pytest.approx(sim.temperature, rel=1e-13)


def test_status_tells_method_and_exactness(sim):
    sim.run(collisions=1000)
    status = sim.status()
    assert status["late_events"] == 0
    assert abs(status["energy_drift"]) < 1e-14
    assert status["bytes_per_particle"] > 100
    assert status["method"] == "windows of time"
    assert status["collisions_per_second"] > 1e3
    dense = hs.Simulation(gas("3d", 100, 0.3)).status()
    assert "neighbour lists" in dense["method"]
    assert sim.status()["version"] == hs.__version__


def test_check_names_what_broke(sim):
    sim.run(collisions=100)
    sim.check()
    row = sim._engine.arrays.row
    row[sim._at.V] += 1e-6
    with pytest.raises(hs.InvariantError, match="kinetic energy"):
        sim.check()
    row[sim._at.V] -= 1e-6
    other = hs.Simulation(sim.scene)
    other._engine.arrays.row[0:3] = other._engine.arrays.row[8:11] + 0.3
    with pytest.raises(hs.InvariantError, match="overlap"):
        other.check()


def test_reprs_are_a_line_that_tells_what_a_person_would_ask(sim):
    """`status` has the rest; sibling: the repr is another at another moment."""
    before = repr(sim)
    sim.run(collisions=1000)
    text, frame = repr(sim), sim.frame()
    assert text.startswith("<Simulation of Scene(") and "\n" not in text and text != before
    assert f"time {sim.time:.6g}, 1000 collisions" in text and "energy drift" in text
    assert repr(frame).startswith("<Frame of Scene(") and "1000 collisions" in repr(frame)
    assert "1000 collisions" in repr(sim.tallies)
    assert all(len(line) < 250 for line in (text, repr(frame), repr(sim.tallies)))


def test_flights_are_told_in_a_line():
    sim = hs.Simulation(gas("3d", 100, 0.1), free_paths=True)
    sim.run(collisions=500)
    assert len(repr(sim.free_paths)) < 100 and "flights of 100 particles" in repr(sim.free_paths)
