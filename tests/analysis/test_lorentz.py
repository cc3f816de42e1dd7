"""One particle among obstacles: its path from the events, free path, spreading and chaos; closed forms."""

import math
from dataclasses import fields

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.lorentz import LAGS, PLACES, SURVIVAL_AT, LorentzWalk
from analysis.theory import TheoryRangeWarning
from hardspheres.scene import sphere_volume


def billiard(reach=0.4, small=0.1, seed=1):
    """Sinai's billiard, four cells of it, with an obstacle and a particle of different radii."""
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi)
    places = [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [0.02, 0.03]]
    return hs.Scene(
        places,
        [[0.0, 0.0]] * 4 + [[math.cos(angle), math.sin(angle)]],
        [reach - small] * 4 + [small],
        [math.inf] * 4 + [2.0],
        (2.0, 2.0),
    )


def followed(scene, blocks, unit):
    """The walk of a scene, and the simulation that it ends with."""
    walk, chunks = LorentzWalk(0.5 * unit, unit), []
    simulation = hs.Simulation(scene, log=chunks.append, search="lists")
    for _ in range(blocks):
        start = simulation.frame()
        simulation.run(time=walk.block)
        walk.add(start, chunks)
        chunks.clear()
    return walk, simulation


def test_places_follow_from_the_events():
    """As the engine has them, through the boundaries, to a rounding. Sibling: an event less is another path."""
    scene, chunks, walk = billiard(), [], LorentzWalk(0.3, 0.6)
    simulation = hs.Simulation(scene, log=chunks.append, search="lists")
    simulation.run(time=3.7)
    chunks.clear()
    start = simulation.frame()
    simulation.run(time=walk.block)
    places = walk.places(start, chunks)
    again = hs.Simulation(scene, log=[].append, search="lists")  # compiled already
    again.run(time=start.time)
    seen = [frame.unwrapped_positions[-1] for frame in again.frames(every=walk.spacing, count=PLACES + 1)]
    assert np.abs(places - seen).max() < 1e-10
    assert np.abs(places).max() > 4.0
    missing = [np.delete(np.concatenate(chunks), 20)]
    assert np.abs(walk.places(start, missing) - seen).max() > 1.0


def test_displacements_and_flights_are_those_of_the_path():
    """One block beside plain sums; flights longer than any of SURVIVAL_AT are the last ones."""
    scene, chunks, walk = billiard(), [], LorentzWalk(0.3, 0.6)
    simulation = hs.Simulation(scene, log=chunks.append, search="lists")
    start = simulation.frame()
    simulation.run(time=walk.block)
    walk.add(start, chunks)
    places, events = walk.places(start, chunks), np.concatenate(chunks)
    plain = [
        np.mean([np.sum((places[k + lag] - places[k]) ** 2) for k in range(PLACES + 1 - lag)]) for lag in LAGS
    ]
    assert walk.mean_square_displacement == pytest.approx(plain, rel=1e-12)
    paths = np.diff(events["time"])
    longer = [np.sum(paths > 0.6 * x) for x in SURVIVAL_AT]
    assert (walk.flights.sum() - np.cumsum(walk.flights)[:-1]).tolist() == longer
    assert walk.flights.sum() == len(paths) == simulation.collisions - 1


def test_the_free_path_is_santalos_for_the_sum_of_both_radii():
    """Eight runs of five blocks, their spread as error; two-sided at 5 of t with 7: false alarm 1.6e-3.

    Sibling: with the obstacle's radius alone it would be more than 30 standard errors away.
    """
    exact = theory.santalo_free_path(4.0 - 4.0 * math.pi * 0.16, 8.0 * math.pi * 0.4, 2)
    assert exact == pytest.approx((1.0 - math.pi * 0.16) / 0.8)
    walks = [followed(billiard(seed=k), 5, exact)[0] for k in range(8)]
    rates = np.array([walk.collisions / walk.time for walk in walks])
    mean, error = rates.mean(), rates.std(ddof=1) / math.sqrt(len(rates))
    assert abs(mean * exact - 1.0) < 5.0 * error / mean
    alone = (1.0 - math.pi * 0.09) / 0.6
    assert abs(mean * alone - 1.0) > 30.0 * error / mean


def test_the_exponent_is_that_of_the_billiard():
    """Beside another program's; 3 %, where blocks of 64 collisions give 1 %. Sibling: those of other radii."""
    exact = (1.0 - math.pi * 0.16) / 0.8
    walk, _ = followed(billiard(), 90, exact)
    found = walk.growth / walk.stretched
    known = theory.billiard_lyapunov_exponent(0.4)
    assert walk.stretched == 45 * 64
    assert found == pytest.approx(known.value, rel=0.03)
    assert abs(found - theory.billiard_lyapunov_exponent(0.37).value) > 0.06


def test_a_block_without_collisions_is_counted():
    """A flight along a corridor: ballistic, no flights, no exponent."""
    scene = billiard(0.2, 0.05)
    along = scene.replace(velocities=[[0.0, 0.0]] * 4 + [[1.0, 0.0]])
    walk, _ = followed(along, 1, 1.0)
    assert (walk.blocks, walk.collisions, walk.stretched, walk.flights.sum()) == (1, 0, 0, 0)
    assert walk.mean_square_displacement == pytest.approx((0.5 * LAGS) ** 2)


def test_walks_are_plain_values():
    """What checkpoints keep."""
    assert {type(getattr(LorentzWalk(0.1, 0.2), each.name)) for each in fields(LorentzWalk)} == {
        float,
        int,
        np.ndarray,
    }


# Closed forms.


def test_santalo():
    """A ball's mean chord is 4/3 R, a disc's pi/2 R."""
    assert theory.santalo_free_path(sphere_volume(2.0, 3), 16.0 * math.pi, 3) == pytest.approx(8.0 / 3.0)
    assert theory.santalo_free_path(sphere_volume(2.0, 2), 4.0 * math.pi, 2) == pytest.approx(math.pi)


def test_machta_and_zwanzig():
    """Hops of a / sqrt(3), one in pi A / 3 w; scaled with length and speed; only with a finite horizon."""
    radius, gap = 0.47, 0.06
    free = math.sqrt(3.0) / 4.0 - 0.5 * math.pi * radius**2
    hop = (1.0 / 3.0) / 4.0 / (math.pi * free / (3.0 * gap))
    assert float(theory.machta_zwanzig_diffusion(radius).value) == pytest.approx(hop)
    assert float(theory.machta_zwanzig_diffusion(3.0 * radius, 3.0, 2.0).value) == pytest.approx(6.0 * hop)
    with pytest.warns(TheoryRangeWarning):
        assert math.isnan(theory.machta_zwanzig_diffusion(0.43).value)


def test_dilute_obstacles():
    """Boltzmann's D is 3/8 and 1/3 of the mean free path where there are few; denser ones have no number."""
    few = 1e-9
    assert theory.lorentz_diffusion(few, 1.0, 2).value * few == pytest.approx(3.0 / 16.0, rel=1e-6)
    assert theory.lorentz_diffusion(few, 2.0, 3, 3.0).value * few == pytest.approx(1.0 / (4.0 * math.pi))
    assert theory.lorentz_diffusion(0.05, 1.0, 2).value < 0.85 * 3.0 / 16.0 / 0.05
    exponents = [theory.lorentz_lyapunov_exponent(few, 1.0, dim).value for dim in (2, 3)]
    assert exponents == pytest.approx([20.4530, 19.8879], abs=1e-3)
    for law in (theory.lorentz_diffusion, theory.lorentz_lyapunov_exponent):
        with pytest.warns(TheoryRangeWarning):
            assert math.isnan(law(0.2, 1.0, 2).value)
    with pytest.warns(TheoryRangeWarning):
        assert math.isnan(theory.billiard_lyapunov_exponent(0.45).value)
