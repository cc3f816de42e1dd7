"""The smallest gas: two spheres in a hard box, whose rates, pressure and wall forces are known exactly.

Two spheres can miss each other for long while bouncing to and fro, as in a billiard without a finite horizon: the
free times have a heavy tail, no error bar is normal, and those from blocks are some 30 % too small here.
"""

import math

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.pressure import Pressure
from analysis.series import BlockSeries, estimate_from_series


def measure(box, collisions, blocks=200):
    """Rates of pairs and walls from a run of two spheres of diameter 1 and mass 1 with energy 1."""
    dim = len(box)
    velocities = np.random.default_rng(1).standard_normal((2, dim))
    velocities *= math.sqrt(2 / (velocities**2).sum())
    places = np.array([[0.8] * dim, np.array(box) - 0.9])
    sim = hs.Simulation(hs.Scene(places, velocities, box=box, boundary="wall"))
    pressure, rows = Pressure(sim.scene), BlockSeries()
    pressure.add(sim.frame())
    for _ in range(blocks):
        sim.reset_tallies()
        sim.run(collisions=collisions // blocks)
        pressure.add(sim.frame())
        rows.add([sim.tallies.wall_collisions, sim.tallies.time])
    walls = estimate_from_series(rows.rows, lambda mean: mean[..., 0] / mean[..., 1])
    return pressure, walls


def check(box, collisions, precision):
    pressure, walls = measure(box, collisions)
    exact = theory.two_sphere_rates(box)
    pair = pressure.collision_rate  # per particle and time; with two particles that is the pair rate
    assert abs(pair.deviation(exact.pair)) < 4.5
    assert abs(walls.deviation(float(exact.wall.sum()))) < 4.5
    assert max(pair.standard_error / pair.value, walls.standard_error / walls.value) < precision
    # pressure from the rate, exact at N = 2, is that of the virial and of the walls
    assert abs(pressure.rate.value - pressure.virial.value) < 5 * pressure.virial.standard_error
    assert abs(pressure.walls.value - pressure.virial.value) < 5 * pressure.virial.standard_error
    # siblings: rates of another box, and without the finite-size factors
    other = theory.two_sphere_rates(np.array(box) * 1.01)
    assert abs(pair.deviation(other.pair)) > 5
    wrong = 1 + (pressure.rate.value - 1) / float(theory.collision_speed_factor(2 * len(box)))
    assert abs(wrong - pressure.virial.value) > 5 * pressure.virial.standard_error


def test_two_spheres():
    check((2.6, 3.1, 3.7), 200_000, 4e-3)


@pytest.mark.slow
@pytest.mark.parametrize("box", [(2.7, 3.6), (2.6, 3.1, 3.7)])
def test_two_discs_and_two_spheres_to_a_thousandth(box):
    check(box, 3_000_000, 1e-3)
