"""When `run(collisions=...)` gives up: a function of the scene and the rows, whoever asks, in whatever steps, and after load."""

import itertools

import numpy as np
import pytest
from scenes import everything, gas

import hardspheres as hs
from hardspheres import patience
from hardspheres.engine import Engine
from hardspheres.tuning import collision_frequency, collision_rate


def unequal(seed):
    """Twenty spheres, equally fast, with masses over twelve decades: the energy is shared out over very many collisions only."""
    rng = np.random.default_rng(seed)
    scene = gas("3d_mixture", 20, 1e-6, seed=seed, masses=10.0 ** rng.uniform(-6, 6, 20))
    return scene.replace(velocities=rng.normal(size=(20, 3)))


def verdict(sim, steps):
    """Run until it gives up; return what it says, and when."""
    with pytest.raises(hs.SimulationError, match="may never meet") as caught:
        for step in steps:
            sim.run(**step)
    return str(caught.value), sim.time, everything(sim)


FOR_EVER = {"collisions": 10**6}


def in_slices(budget, run=Engine.run):
    """Return an `Engine.run` that comes back after so much work, as a slow machine's does."""

    def sliced(engine, epoch, moment, pairs, more):
        done = run(engine, epoch, moment, pairs, min(more, budget))
        engine.paused = False  # so that the budget stays as it is
        return done

    return sliced


def never():
    """Two spheres that pass each other for ever."""
    return hs.Scene([[1.0, 1.0, 1.0], [2.2, 3.0, 1.0]], [[1.0, 0, 0], [-1.0, 0, 0]], box=(4, 4, 4))


@pytest.mark.parametrize("seed", range(2))
def test_unequal_masses_get_there_in_any_slices(seed, monkeypatch):
    """The scene of which the first simulation in a process got there, and the next one gave up after one collision."""
    whole, parts = hs.Simulation(unequal(seed)), hs.Simulation(unequal(seed))
    for sim in (whole, parts):
        sim._patience.stride = 64  # as in the sibling below
    whole.run(collisions=100)
    monkeypatch.setattr(Engine, "run", in_slices(20_000))
    parts.run(collisions=100)
    assert everything(parts) == everything(whole)


def test_a_rate_that_assumes_equipartition_gives_up(monkeypatch):
    """Sibling: energy that light particles do not have yet would make them fast."""
    monkeypatch.setattr(
        patience, "collision_rate", lambda scene, v: 0.5 * scene.n * collision_frequency(scene)
    )
    for seed in range(3):
        sim = hs.Simulation(unequal(seed))
        sim._patience.stride = 64  # which looks more often
        with pytest.raises(hs.SimulationError, match="may never meet"):
            sim.run(collisions=100)


@pytest.mark.parametrize(
    ("scene", "most"),
    [(never(), patience.PATIENCE), (gas("3d", 2, 1e-6), 2.0)],
    ids=["never", "after some collisions"],
)
def test_the_verdict_is_the_same_in_any_steps_and_after_load(scene, most, tmp_path, monkeypatch):
    """Also with so little patience that it gives up between two collisions."""
    monkeypatch.setattr(patience, "PATIENCE", most)
    sim = hs.Simulation(scene)
    expected = verdict(sim, [FOR_EVER])
    assert verdict(sim, [FOR_EVER]) == expected  # asked again, it says so again
    assert (sim.collisions > 0) is (most < 1000)
    end = expected[1]
    for steps in (
        [*[{"collisions": 1}] * 10, FOR_EVER],
        [{"time": 0.123 * end}, FOR_EVER],
        [*[{"time": 0.3 * end}] * 3, FOR_EVER],
    ):
        assert verdict(hs.Simulation(scene), steps) == expected
    for part in (0.01, 0.5, 0.99):
        sim = hs.Simulation(scene)
        sim.run(time=part * end)
        sim.save(tmp_path / "checkpoint.npz")
        assert verdict(hs.Simulation.load(tmp_path / "checkpoint.npz"), [FOR_EVER]) == expected
    monkeypatch.setattr(Engine, "run", in_slices(3000))
    sim = hs.Simulation(scene)
    assert verdict(sim, [FOR_EVER]) == expected
    sim.run(time=end)  # time may pass all the same
    assert sim.time == pytest.approx(2 * end)


def test_looks_are_seldom_and_cost_nothing():
    """Epochs between two looks: a power of two, and many rows in all."""
    strides = [hs.Simulation(gas("3d", n, 0.1))._patience.stride for n in (2, 64, 100, 4000)]
    assert strides == [4096, 1024, 512, 16]


# The rate.


def pairs_rate(scene, v):
    """Collision rate of spheres at these velocities, spread out evenly: the sum over all pairs."""
    total = 0.0
    for i, j in itertools.combinations(range(scene.n), 2):
        sigma, speed = scene.radii[i] + scene.radii[j], np.linalg.norm(v[i] - v[j])
        total += speed * (np.pi * sigma**2 if scene.dim == 3 else 2.0 * sigma)
    return total / scene.volume


@pytest.mark.parametrize("kind", ["3d", "2d", "3d_mixture"])
def test_the_rate_is_that_of_all_pairs_or_up_to_twice_as_much(kind):
    rng = np.random.default_rng(2)
    scene = gas(kind, 30, 1e-3)
    clouds = np.repeat([[2.0] * scene.dim, [-3.0] * scene.dim], [9, 21], axis=0)
    for v in (
        rng.normal(size=(30, scene.dim)),
        rng.normal(size=(30, scene.dim)) * 10.0 ** rng.uniform(-6, 6, 30)[:, None],
        clouds,
        clouds + 1e-3 * rng.normal(size=(30, scene.dim)),
        np.eye(30, scene.dim),
    ):
        ratio = collision_rate(scene, v) / pairs_rate(scene, v)
        assert 0.99 < ratio < 2.5
        assert collision_rate(scene, v + 7.0) == pytest.approx(collision_rate(scene, v), rel=1e-6)
    assert collision_rate(scene, np.ones((30, scene.dim))) == 0.0


def test_hits_of_walls_do_not_change_the_rate():
    scene = gas("2d_mixture_walls", 30, 1e-3)
    flips = np.where(np.random.default_rng(3).random(scene.velocities.shape) < 0.5, 1.0, -1.0)
    assert collision_rate(scene, scene.velocities) == collision_rate(scene, scene.velocities * flips)
