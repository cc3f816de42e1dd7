"""Compressibility factor of the engine's virial against the equation of state of Kolafa, Labik and Malijevsky (2004,
doi:10.1039/B402792B), with the finite-size correction of `finite_size_compressibility`; limits of 3 standard errors
(false alarm 0.3 % each, fixed seeds).
"""

import numpy as np
import pytest

import hardspheres as hs
from analysis import theory
from analysis.statistics import estimate_from_blocks


def measure(n, eta, equilibration, collisions, blocks=40, dim=3):
    """Z with its error from blocks; equilibration and length in collisions per particle and collisions."""
    sim = hs.Simulation(hs.lattice_gas(n=n, packing_fraction=eta, dim=dim, seed=21))
    sim.run(collisions=equilibration * n // 2)
    series = []
    for _ in range(blocks):
        sim.reset_tallies()
        sim.run(collisions=collisions // blocks)
        series.append(sim.compressibility_factor)
    return estimate_from_blocks(np.array(series), blocks // 2)


def deviation(measured, n, eta, dim=3):
    expected = theory.finite_size_compressibility(eta, dim, n)
    return measured.deviation(float(expected.value), float(expected.uncertainty))


@pytest.mark.parametrize(("dim", "eta"), [(3, 0.1), (3, 0.3), (2, 0.3)])
def test_compressibility_of_a_small_gas(dim, eta):
    z = measure(500, eta, 100, 400_000, dim=dim)
    assert abs(deviation(z, 500, eta, dim)) < 3
    assert z.standard_error / z.value < 3e-3
    # Siblings: a packing fraction 2 % larger is told apart, and so is a gas that is too small by a tenth in radius.
    assert abs(deviation(z, 500, 1.02 * eta, dim)) > 3
    assert abs(deviation(z, 500, 0.9**dim * eta, dim)) > 10
