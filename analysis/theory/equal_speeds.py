"""The relaxation of a dilute gas from equal speeds: the Boltzmann equation's tables."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.brief import brief
from analysis.theory.equilibrium import equilibrium_a2
from analysis.theory.maxwell import speed_cdf
from analysis.theory.prediction import Prediction, check_dim, inside_range
from analysis.theory.spline import cubic_spline

__all__ = [
    "H_BINS",
    "KS_BINS",
    "SPEED_LIMIT",
    "EqualSpeedsRelaxation",
    "boltzmann_equal_speeds",
    "equal_speeds_decay_rate",
    "finite_size_relaxation",
]

FloatArray = NDArray[np.float64]

# Direct simulation Monte Carlo of the space-homogeneous Boltzmann equation. a2, a3: N = 1e5 particles, 300
# runs (errors below 1.4e-4 in 3D, 1.7e-4 in 2D). ks, h: N = 1e5, 600 runs, independent of the first; its a2
# agrees with the first within the errors. tests/analysis/conftest.py holds such a solver and
# tests/analysis/test_theory.py runs it against these numbers.
_S = [0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9, 10]
_S_FINE = [0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7, 8, 9, 10]
_A2 = {
    3: [-0.33532, -0.27860, -0.22952, -0.18775, -0.15270, -0.12348, -0.09933]
    + [-0.07976, -0.05084, -0.03204, -0.02018, -0.01254, -0.00789, -0.00495],
    2: [-0.43176, -0.36952, -0.31371, -0.26431, -0.22118, -0.18396, -0.15241]
    + [-0.12568, -0.08461, -0.05600, -0.03697, -0.02430, -0.01590, -0.01013],
}
_A3 = {
    3: [-0.35151, -0.26774, -0.20236, -0.15222, -0.11416, -0.08548, -0.06399]
    + [-0.04795, -0.02734, -0.01581, -0.00919, -0.00544, -0.00328, -0.00196],
    2: [-0.53571, -0.42610, -0.33603, -0.26317, -0.20490, -0.15903, -0.12334]
    + [-0.09540, -0.05732, -0.03454, -0.02117, -0.01304, -0.00795, -0.00513],
}
_KS = {
    3: [0.49509, 0.40398, 0.33016, 0.27035, 0.18456, 0.13169, 0.09672, 0.07232]
    + [0.05478, 0.04191, 0.02509, 0.01512, 0.00919, 0.00564, 0.00351, 0.00224],
    2: [0.51875, 0.42794, 0.35487, 0.29715, 0.21435, 0.15909, 0.12038, 0.09247]
    + [0.07177, 0.05609, 0.03469, 0.02185, 0.01392, 0.00896, 0.00570, 0.00366],
}
_H = {
    3: [3.255, 2.316, 1.663, 1.1983, 0.6222, 0.3209, 0.1639, 0.08290]
    + [0.04163, 0.02091, 0.005508, 0.001637, 0.000548, 0.000198, 0.0000755, 0.0000295],
    2: [3.168, 2.269, 1.642, 1.1939, 0.6334, 0.3354, 0.1771, 0.09332]
    + [0.04942, 0.02641, 0.00804, 0.002774, 0.001053, 0.000424, 0.000173, 0.0000706],
}
_H_ERROR = {
    3: [1e-4, 2e-4, 1e-4, 2e-4, 1e-4, 7e-5, 5e-5, 5e-5, 4e-5, 3e-5, 1e-5, 8e-6, 5e-6, 3e-6, 2e-6, 9e-7],
    2: [1e-4, 2e-4, 2e-4, 2e-4, 1e-4, 1e-4, 8e-5, 5e-5, 4e-5, 3e-5, 2e-5, 9e-6, 7e-6, 4e-6, 3e-6, 2e-6],
}
_A2_LATE_ERROR = {3: 1.4e-4, 2: 1.7e-4}
_A3_LATE_ERROR = {3: 1.3e-4, 2: 1.8e-4}
_KS_ERROR = 5e-5
_INITIAL_SLOPE = {3: 24 / 175, 2: 32 / 225}
_INTERPOLATION = 1e-3  # of KS and of H, relative; for a2 and a3 it is below the tables' errors

SPEED_LIMIT = {2: 6.0, 3: 5.0}
"""Upper end of the speed histograms behind KS and H, in thermal speeds sqrt(kT/m), by dimension."""
KS_BINS = 1280
"""Equal bins between 0 and `SPEED_LIMIT` on whose edges the pooled Kolmogorov-Smirnov distance is taken."""
H_BINS = 320
"""Equal bins between 0 and `SPEED_LIMIT` on which H is coarse-grained."""


@dataclass(frozen=True)
class EqualSpeedsRelaxation:
    """A dilute gas relaxing from equal speeds in random directions, from the Boltzmann equation.

    Attributes
    ----------
    s : (n,) array
        Collisions per particle.
    a2, a3, ks, h : (n,) arrays
        Fourth and sixth cumulants, Kolmogorov-Smirnov distance of the speeds, H - H_eq coarse-grained on
        `H_BINS` bins. NaN where nothing is known: s > 10, and h for 0 < s < 0.25.
    a2_error, a3_error, ks_error, h_error : (n,) arrays
        Standard uncertainties.
    """

    s: FloatArray
    a2: FloatArray
    a2_error: FloatArray
    a3: FloatArray
    a3_error: FloatArray
    ks: FloatArray
    ks_error: FloatArray
    h: FloatArray
    h_error: FloatArray

    __repr__ = brief


def boltzmann_equal_speeds(s: ArrayLike, dim: int) -> EqualSpeedsRelaxation:
    """Return the relaxation of a dilute gas of one species from equal speeds in random directions.

    Valid for eta -> 0 and N -> infinity; to first order a finite density changes only the time per collision,
    not the curve against s. a2(0) = -2/(d+2) and the initial slopes da2/ds = 24/175 (3D), 32/225 (2D) are
    exact. The relative decay rate rises from 12/35 (3D), 64/225 (2D) towards that of `near_equilibrium_rate`:
    exp(-8s/15) is not this curve.

    The dilute limit, tested by event-driven gases of 3e6 particles: over 2 <= s <= 5 their a2 decayed at
    0.433(2) in 3D and 0.385(2) in 2D at eta = 0.005, at 0.379(2) in 2D at eta = 0.001. With 4e5 particles the
    difference is within one standard error.

    A fraction exp(-s) of the particles has not yet collided and keeps its speed to the last bit, so that f
    has a spike and H is infinite at every s until the velocities are coarse-grained. Here that is a histogram
    of the speeds with `H_BINS` equal bins up to `SPEED_LIMIT`; half as wide bins give 18 % more at s = 0.5
    and 30 % more at s = 4.

    Parameters
    ----------
    s : array_like
        Collisions per particle, 0 to 10; a `TheoryRangeWarning` and NaN beyond.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    EqualSpeedsRelaxation
        Between the tabulated s by cubic splines of the logarithms. Uncertainties are those of the tables: a2
        from 3e-5 at s = 0.5 to 1.4e-4 (3D), 1.7e-4 (2D); KS 5e-5, H 1e-5 to 2e-4, both with 1e-3 of the value
        for the interpolation.
    """
    check_dim(dim)
    points = np.atleast_1d(np.asarray(s, dtype=np.float64))
    inside = inside_range("the Boltzmann relaxation from equal speeds", points, 0.0, 10.0)
    a2_start = -2.0 / (dim + 2)
    a3_start = -(dim**2 / ((dim + 2) * (dim + 4)) - 1.0 - 3.0 * a2_start)
    edges = np.linspace(0.0, SPEED_LIMIT[dim], KS_BINS + 1)
    shell = math.sqrt(dim)
    law = speed_cdf(edges, dim)
    ks_start = float(np.abs((edges >= shell) - law).max())
    coarse = law[:: KS_BINS // H_BINS]
    home = int(shell / SPEED_LIMIT[dim] * H_BINS)
    h_start = -math.log(coarse[home + 1] - coarse[home])

    def curve(knots: list[float], values: list[float], slope: float | None = None) -> FloatArray:
        return np.where(inside, np.exp(cubic_spline(knots, np.log(np.abs(values)), points, slope)), np.nan)

    a2 = -curve([0.0, *_S], [a2_start, *_A2[dim]], _INITIAL_SLOPE[dim] / a2_start)
    a3 = -curve([0.0, *_S], [a3_start, *_A3[dim]])
    ks = curve([0.0, *_S_FINE], [ks_start, *_KS[dim]])
    tabulated = points >= _S_FINE[0]
    h = np.where(tabulated, curve(_S_FINE, _H[dim]), np.where(points == 0.0, h_start, np.nan))
    lost = 1.0 - a2 / a2_start  # how far a2 has decayed: the table's noise grows with it
    moved = np.where(points > 0.0, 1.0, 0.0)
    h_noise = np.exp(np.interp(points, _S_FINE, np.log(_H_ERROR[dim])))
    return EqualSpeedsRelaxation(
        s=points,
        a2=a2,
        a2_error=moved * np.maximum(3e-5, _A2_LATE_ERROR[dim] * lost),
        a3=a3,
        a3_error=moved * np.maximum(3e-5, _A3_LATE_ERROR[dim] * lost),
        ks=ks,
        ks_error=moved * np.hypot(_KS_ERROR, _INTERPOLATION * ks),
        h=h,
        h_error=moved * np.hypot(h_noise, _INTERPOLATION * h),
    )


def equal_speeds_decay_rate(dim: int, window: tuple[float, float] = (2.0, 5.0)) -> Prediction:
    """Return the mean decay rate of a2 over a window after a start with equal speeds, per unit of s.

    ln[a2(s1)/a2(s2)]/(s2 - s1) of `boltzmann_equal_speeds`: 0.4355(8) in 3D, 0.3797(7) in 2D over 2 <= s <=
    5.

    Parameters
    ----------
    dim : {2, 3}
        Dimension d.
    window : (float, float)
        s1 < s2, within 0 to 10.
    """
    first, last = window
    table = boltzmann_equal_speeds([first, last], dim)
    relative = table.a2_error / np.abs(table.a2)
    rate = math.log(table.a2[0] / table.a2[1]) / (last - first)
    return Prediction(rate, float(np.hypot(*relative)) / (last - first))


def finite_size_relaxation(a2: ArrayLike, a2_start: float, degrees_of_freedom: float) -> Prediction:
    """Return a2 of a finite gas of fixed energy that relaxes as `a2` does in an infinite one.

    A finite gas relaxes to `equilibrium_a2` and not to 0: a2 + (1 - a2/a2_start) equilibrium_a2. Exact for
    Maxwell molecules, whose moments relax by one exponential (Kac's master equation); for hard spheres half
    of the correction is taken as its uncertainty. It is -1.7e-4 at the end for N = 4000 in 3D.

    Parameters
    ----------
    a2 : array_like
        Cumulant of the infinite gas.
    a2_start : float
        Its value at s = 0, the same for both.
    degrees_of_freedom : float
        D, see `equilibrium_a2`.
    """
    infinite = np.asarray(a2, dtype=np.float64)
    shift = (1.0 - infinite / a2_start) * equilibrium_a2(degrees_of_freedom)
    return Prediction(infinite + shift, np.abs(shift) / 2)
