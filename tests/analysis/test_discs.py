"""Pressures of discs where they melt: the digits of the table, what is not in it, and the coexistence from it."""

import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from analysis import theory
from analysis.theory.discs import _TABLES, SQUARE

BOX_870 = 29 / (30 * math.sqrt(0.75))
KNOWN = [  # number of discs, ratio of edges, packing fraction, pressure, standard error
    (870, 1.0, 0.67, 7.986779, 2.5e-5),
    (870, 1.0, 0.69, 8.969898, 7.5e-5),
    (870, BOX_870, 0.67, 7.986735, 2.6e-5),
    (870, 1 / BOX_870, 0.68, 8.513233, 3.7e-5),
    (870, BOX_870, 0.69, 8.969476, 9.7e-5),
    (224, 14 / (16 * math.sqrt(0.75)), 0.68, 8.49105, 1.9e-4),
    (224, 1.0, 0.69, 8.83348, 4.6e-4),
    (256**2, 1.0, 0.708, 9.18178, 2.1e-4),
    (256**2, math.sqrt(0.75), 0.708, 9.18178, math.hypot(2.1e-4, 1e-3)),
]


@pytest.mark.parametrize(("n", "ratio", "eta", "pressure", "error"), KNOWN)
def test_what_others_computed(n, ratio, eta, pressure, error):
    source, found = theory.disc_pressure(eta, n, ratio)
    assert (found.value, found.uncertainty) == (pressure, pytest.approx(error))
    assert source == ("Bernard, Krauth 2011" if n > 2e4 else "Li et al. 2022")
    places, pressures = theory.disc_pressures(n, ratio)
    assert pressure in pressures and len(places) == len(pressures)


@pytest.mark.parametrize(
    ("n", "ratio", "eta"), [(871, 1.0, 0.67), (870, 1.0, 0.671), (870, 1.05, 0.67), (224, 1.3, 0.69)]
)
def test_what_nobody_computed_is_none(n, ratio, eta):
    """Another number, density or, of few discs, shape of the box."""
    assert theory.disc_pressure(eta, n, ratio) is None
    assert not len(theory.disc_pressures(871)[0])


@pytest.mark.parametrize("table", [each for each in _TABLES if len(_TABLES[each][0]) > 10])
def test_no_digit_is_wrong(table):
    """Each point within its errors, and what curvature makes, of the cubic through its neighbours.

    Sibling: a pressure with two digits swapped.
    """
    places, pressures, errors = map(np.array, _TABLES[table])
    assert len(places) == len(pressures) == len(errors) and np.diff(places) == pytest.approx(0.002)
    assert np.all((errors < 0.01) & (errors > 1e-5))
    weights = np.array([-1, 4, 0, 4, -1]) / 6

    def largest(values):
        away = np.convolve(values, weights, "valid") - values[2:-2]
        own = np.sqrt(np.convolve(errors**2, weights**2, "valid") + errors[2:-2] ** 2)
        return (np.abs(away) - 3.0 * own).max()

    assert largest(pressures) < 0.012
    wrong = pressures.copy()
    wrong[4] += 0.09  # as 8.43 for 8.34
    assert largest(wrong) > 0.05


def test_the_coexistence_is_where_areas_are_equal():
    """Maxwell's rule on the pressures of 1024^2 discs. Sibling: 256^2, whose interface costs more."""

    def between(n):
        eta, pressure = map(np.array, _TABLES[n, SQUARE][:2])
        fine = np.linspace(eta[0], eta[-1], 4001)
        curve = PchipInterpolator(eta, pressure)(fine)

        def area(level):
            crossings = np.flatnonzero(np.diff(np.sign(curve - level)))
            part = slice(crossings[0], crossings[-1] + 1)
            return np.trapezoid((curve - level)[part], -1.0 / fine[part]), fine[part][[0, -1]]

        level = brentq(lambda p: area(p)[0], pressure[2:].min() + 1e-4, pressure[:-2].max() - 1e-4)
        return level, area(level)[1]

    pressure, (low, high) = between(1024**2)
    found, coexisting = theory.COEXISTENCE_PRESSURE, theory.COEXISTENCE
    assert abs(pressure - found.value) < found.uncertainty
    assert low == pytest.approx(coexisting[0], abs=5e-4) and high == pytest.approx(coexisting[1], abs=1e-3)
    assert abs(between(256**2)[0] - found.value) > 3 * found.uncertainty
