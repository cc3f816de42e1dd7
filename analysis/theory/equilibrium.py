"""Cumulants, H and the Kolmogorov-Smirnov distance of N particles at equilibrium: means and noise."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.prediction import check_dim

__all__ = [
    "cumulant_noise",
    "equilibrium_a2",
    "equilibrium_a3",
    "equilibrium_h",
    "ks_floor",
]

FloatArray = NDArray[np.float64]


def equilibrium_a2(degrees_of_freedom: ArrayLike) -> FloatArray:
    """Return the mean of a2 over N particles of fixed energy at equilibrium, -2/(D + 2).

    Here a2 = d<v^4>/((d+2)<v^2>^2) - 1. D is the number of degrees of freedom: d(N - 1) in a periodic box at
    rest, dN between walls. Exact for equal masses and one kind of boundary; it vanishes as -2/(dN), which is
    the bias of the estimator against an infinite gas.
    """
    return np.asarray(-2.0 / (np.asarray(degrees_of_freedom, dtype=np.float64) + 2.0))


def equilibrium_a3(degrees_of_freedom: ArrayLike) -> FloatArray:
    """Return the mean of a3 over N particles of fixed energy at equilibrium, -4/((D/2 + 1)(D/2 + 2)).

    See `equilibrium_a2`.
    """
    half = np.asarray(degrees_of_freedom, dtype=np.float64) / 2
    return np.asarray(-4.0 / ((half + 1) * (half + 2)))


def cumulant_noise(n: int, dim: int, order: Literal[2, 3] = 2) -> float:
    """Return the standard deviation of a2 or a3 of N independent Maxwellian particles.

    sqrt(8/(d(d+2)N)) for a2, sqrt(48/(d(d+2)(d+4)N)) for a3: the norms of the Sonine polynomials.
    """
    check_dim(dim)
    if order == 2:
        return math.sqrt(8 / (dim * (dim + 2) * n))
    return math.sqrt(48 / (dim * (dim + 2) * (dim + 4) * n))


def equilibrium_h(dim: int, mass: float = 1.0, temperature: float = 1.0) -> float:
    """Return H_eq, the integral of f ln f for Maxwell-Boltzmann velocities: -(d/2)(1 + ln(2 pi kT/m))."""
    check_dim(dim)
    return -dim / 2 * (1.0 + math.log(2.0 * math.pi * temperature / mass))


def ks_floor(n: int, dim: int) -> float:
    """Return the mean Kolmogorov-Smirnov distance of N equilibrium speeds from the Maxwell-Boltzmann law.

    0.715(5)/sqrt(N) in 3D, 0.735(5)/sqrt(N) in 2D, from 10 000 samples of N = 250 to 4000. Lower than the
    0.8687/sqrt(N) of independent draws, because the energy is conserved and the scale of the law is therefore
    that of the sample (the situation of Lilliefors' test).
    """
    check_dim(dim)
    return (0.715 if dim == 3 else 0.735) / math.sqrt(n)
