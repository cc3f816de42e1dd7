"""Relaxation rates of a gas towards equilibrium: cumulants, temperatures, anisotropy."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.mixtures import mixture_collision_rates
from analysis.theory.prediction import Prediction, check_dim, inside_range
from analysis.theory.spline import cubic_spline

__all__ = [
    "anisotropy_decay",
    "anisotropy_rate",
    "near_equilibrium_rate",
    "sonine_rate",
    "temperature_equilibration",
    "temperature_equilibration_rate",
]

FloatArray = NDArray[np.float64]

# Linearised Boltzmann equation, 8 polynomials; direct simulation from a 20 % anisotropy (N = 1e5, 100 runs,
# errors 0.002) gave .667 .448 .205 .096 .042 in 3D and .608 .370 .141 .055 .022 in 2D.
_ANISOTROPY_S = [0.0, 0.5, 1.0, 2.0, 3.0, 4.0]
_ANISOTROPY = {3: [1.0, 0.671, 0.452, 0.206, 0.095, 0.044], 2: [1.0, 0.608, 0.372, 0.141, 0.055, 0.022]}
# How much faster the two-Maxwellian theory is than direct simulation, as a share of the logarithmic decay.
_NOT_MAXWELLIAN = {3: 0.04, 2: 0.08}


def sonine_rate(dim: int) -> float:
    """Return the decay rate of a small a2 per unit of s in the first Sonine approximation, 8/15 or 1/2.

    4(d-1)/(d(d+2)), 8/15 in 3D and 1/2 in 2D: the exact initial slope when a3 = 0 and a2 is small. It is not
    the rate of the late decay, see `near_equilibrium_rate`, nor of a start with equal speeds, see
    `boltzmann_equal_speeds`.
    """
    check_dim(dim)
    return 4 * (dim - 1) / (dim * (dim + 2))


def near_equilibrium_rate(dim: int) -> Prediction:
    """Return the slowest isotropic relaxation rate per unit of s of the linearised Boltzmann equation.

    0.475(1) in 3D, 0.436(1) in 2D: limits of the Sonine eigenvalues .5333 .4944 .4829 .4784 .4765 .4756 (3D)
    and .5 .4594 .4464 .4411 .4386 .4373 (2D), exact quadratures at 1 to 6 polynomials.
    """
    check_dim(dim)
    return Prediction(0.475 if dim == 3 else 0.436, 0.001)


def anisotropy_rate(dim: int) -> float:
    """Return the initial decay rate of a temperature anisotropy T_x - T per unit of s, 4/5 or 1.

    The exact slope at s = 0 of a gas that is Maxwellian with a slightly different temperature along x; the
    rate of the dilute gas's viscosity in the first Sonine approximation.
    """
    check_dim(dim)
    return 0.8 if dim == 3 else 1.0


def anisotropy_decay(s: ArrayLike, dim: int) -> Prediction:
    """Return (T_x - T)/(T_x - T)_0 of a gas that starts as a Maxwellian of different temperature along x.

    Linearised Boltzmann equation, for small anisotropies; in the homogeneous gas Enskog's theory is the same
    against s. In 3D the rate 4/5 exceeds the slowest collision rate 1/sqrt(2) of particles at rest, there is
    no discrete mode, and the decay slows down from 0.80 to 0.77 over 0 <= s <= 4.

    Parameters
    ----------
    s : array_like
        Collisions per particle, 0 to 4; a `TheoryRangeWarning` and NaN beyond.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        Between the tabulated s by a cubic spline of the logarithm; u = 0.003 times (1 - value), which covers
        the difference from direct simulation of a 20 % anisotropy.
    """
    check_dim(dim)
    points = np.asarray(s, dtype=np.float64)
    inside = inside_range("the decay of an anisotropy", points, 0.0, 4.0)
    logarithm = cubic_spline(_ANISOTROPY_S, np.log(_ANISOTROPY[dim]), points, -anisotropy_rate(dim))
    value = np.where(inside, np.exp(logarithm), np.nan)
    return Prediction(value, 0.003 * (1.0 - value))


def temperature_equilibration(
    time: ArrayLike,
    temperatures: ArrayLike,
    number_densities: ArrayLike,
    diameters: ArrayLike,
    masses: ArrayLike,
    dim: int,
) -> Prediction:
    """Return how the temperatures of species approach each other.

    dT_i/dt = -(8/d) sum over j of m_i m_j/(m_i + m_j)^2 nu_ij(T_i, T_j) (T_i - T_j), nu_ij from
    `mixture_collision_rates`: the mean energy that i loses to j in a collision is 4 m_i m_j/(m_i + m_j)^2
    k(T_i - T_j), exactly, while both are Maxwellian, in any dimension (an average over the collisions of two
    Maxwellians; a test draws it). The equation is exact for t -> 0. Later the species are not quite
    Maxwellian, and the decay is slower: against direct simulation of a dilute gas the logarithm of T_1 - T_2
    falls too fast by 2 to 8 % in 3D, 3 to 15 % in 2D.

    Parameters
    ----------
    time : (n,) array_like
        Times >= 0 since the temperatures were as given, ascending.
    temperatures : (k,) array_like
        kT_i at time 0.
    number_densities, diameters, masses : (k,) array_like
        Per species.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        (n, k) arrays of kT_i. u = 4 % (3D) or 8 % (2D) of the logarithmic decay of T_i - T, T the common
        temperature; the known deviation is towards a larger |T_i - T|. NaN where `mixture_contact_values` is.

    Raises
    ------
    ValueError
        If times descend or are negative.
    """
    check_dim(dim)
    t = np.atleast_1d(np.asarray(time, dtype=np.float64))
    if t.size == 0 or t[0] < 0.0 or np.any(np.diff(t) < 0.0):
        raise ValueError("times must be at least 0 and ascend")
    start = np.asarray(temperatures, dtype=np.float64)
    rho = np.asarray(number_densities, dtype=np.float64)

    def slope(_: float, now: FloatArray) -> FloatArray:
        rates = temperature_equilibration_rate(now, rho, diameters, masses, dim)
        return np.asarray(-(rates * np.subtract.outer(now, now)).sum(axis=1))

    from scipy import integrate

    last = float(t[-1])
    if not np.all(np.isfinite(slope(0.0, start))):  # too dense for the theory of mixtures
        value = np.full((t.size, start.size), np.nan)
    elif last == 0.0:
        value = np.tile(start, (t.size, 1))
    else:
        solution = integrate.solve_ivp(slope, (0.0, last), start, t_eval=t, rtol=1e-9, atol=1e-12)
        value = solution.y.T
    common = float(rho @ start / rho.sum())
    scale = np.where(start == common, 1.0, start - common)
    share = np.clip(np.abs((value - common) / scale), 1e-300, 1.0)
    return Prediction(value, _NOT_MAXWELLIAN[dim] * np.abs(np.log(share)) * np.abs(value - common))


def temperature_equilibration_rate(
    temperatures: ArrayLike, number_densities: ArrayLike, diameters: ArrayLike, masses: ArrayLike, dim: int
) -> FloatArray:
    """Return the rates at which T_i loses T_i - T_j to each other species, (k, k), [1/time].

    (8/d) m_i m_j/(m_i + m_j)^2 nu_ij(T_i, T_j); zero for i = j. Of two species T_1 - T_2 decays initially at
    the sum of the two rates. Arguments as in `temperature_equilibration`.
    """
    mass = np.asarray(masses, dtype=np.float64)
    shared = np.outer(mass, mass) / np.add.outer(mass, mass) ** 2
    rates = mixture_collision_rates(number_densities, diameters, mass, dim, temperatures)
    result: FloatArray = 8.0 / dim * shared * rates
    np.fill_diagonal(result, 0.0)
    return result
