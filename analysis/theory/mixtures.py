"""Mixtures of species with different diameters and masses: contact values, pressure, rates, free paths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.maxwell import mean_speed
from analysis.theory.prediction import Prediction, check_dim, packing_fraction, warn_outside

__all__ = [
    "mixture_collision_rates",
    "mixture_compressibility",
    "mixture_contact_values",
    "mixture_mean_free_paths",
    "pairs_of_few",
]

FloatArray = NDArray[np.float64]


def mixture_contact_values(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> FloatArray:
    """Return g_ij at contact in a mixture: BMCSL in 3D, Jenkins-Mancini in 2D.

    3D: Boublik (1970, doi 10.1063/1.1673824), Mansoori et al. (1971, doi 10.1063/1.1675048); 2D: Jenkins and
    Mancini (1987, doi 10.1115/1.3172990). For one species they reduce to Carnahan-Starling and Henderson; Z -
    1 is good to about 0.3 % (3D, eta < 0.4) and 0.5 % (2D, eta < 0.5), to some 2 % up to freezing in 2D,
    above which a `TheoryRangeWarning` comes (0.494, 0.66).

    Parameters
    ----------
    number_densities, diameters : (k,) array_like
        rho_i [1/length^d] and sigma_i [length].
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    (k, k) array
    """
    check_dim(dim)
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    eta = np.asarray((packing_fraction(1.0, sigma, dim) * rho).sum())
    warn_outside("the contact values of mixtures", eta, 0.0, 0.494 if dim == 3 else 0.66)
    reduced = np.outer(sigma, sigma) / np.add.outer(sigma, sigma)
    if dim == 3:
        z2, z3 = (math.pi / 6 * float(rho @ sigma**power) for power in (2, 3))
        free = 1.0 - z3
        return np.asarray(1 / free + 3 * z2 * reduced / free**2 + 2 * (z2 * reduced) ** 2 / free**3)
    z1, z2 = (math.pi / 4 * float(rho @ sigma**power) for power in (1, 2))
    free = 1.0 - z2
    return np.asarray(1 / free + 9 / 8 * z1 * reduced / free**2)


def mixture_compressibility(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> Prediction:
    """Return Z of a mixture from `mixture_contact_values`.

    u = 0.3 % of Z - 1 in 3D, 0.5 % in 2D and 2 % there above eta = 0.5.

    Z = 1 + (2 pi/3) rho sum x_i x_j sigma_ij^3 g_ij in 3D, 1 + (pi/2) rho sum x_i x_j sigma_ij^2 g_ij in 2D.
    """
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    contact = np.add.outer(sigma, sigma) / 2
    weights = np.outer(rho, rho) / rho.sum() * contact**dim * mixture_contact_values(rho, sigma, dim)
    excess = (2 * math.pi / 3 if dim == 3 else math.pi / 2) * float(weights.sum())
    crowded = float((packing_fraction(1.0, sigma, dim) * rho).sum()) > 0.5
    return Prediction(1.0 + excess, (0.003 if dim == 3 else 0.02 if crowded else 0.005) * excess)


def mixture_collision_rates(
    number_densities: ArrayLike,
    diameters: ArrayLike,
    masses: ArrayLike,
    dim: int,
    temperatures: ArrayLike = 1.0,
) -> FloatArray:
    """Return nu_ij, the rate at which one particle of species i meets species j, [1/time].

    nu_ij = c_d rho_j sigma_ij^(d-1) g_ij sqrt(kT_i/m_i + kT_j/m_j), c_3 = sqrt(8 pi), c_2 = sqrt(2 pi): exact
    given g_ij while every species is Maxwellian. Pair events per volume and time are rho_i nu_ij, halved for
    i = j.

    Parameters
    ----------
    number_densities, diameters, masses : (k,) array_like
        Per species.
    dim : {2, 3}
        Dimension d.
    temperatures : float or (k,) array_like
        kT of each species.

    Returns
    -------
    (k, k) array
    """
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    spread = np.broadcast_to(np.asarray(temperatures, dtype=np.float64), rho.shape) / np.asarray(masses)
    contact = np.add.outer(sigma, sigma) / 2
    factor = math.sqrt(8 * math.pi) if dim == 3 else math.sqrt(2 * math.pi)
    g = mixture_contact_values(rho, sigma, dim)
    return np.asarray(factor * rho * contact ** (dim - 1) * g * np.sqrt(np.add.outer(spread, spread)))


def mixture_mean_free_paths(
    number_densities: ArrayLike, diameters: ArrayLike, masses: ArrayLike, dim: int
) -> Prediction:
    """Return l_i = <v_i> / sum over j of nu_ij, the mean free path of each species, [length].

    At one temperature, on which it does not depend. See `mixture_collision_rates`.

    Parameters
    ----------
    number_densities, diameters, masses : (k,) array_like
        Per species.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        (k,) arrays; u = 0.3 % (3D) or 0.5 % (2D) of g_ij - 1, taken as that of the mean over partners.
    """
    mass = np.asarray(masses, dtype=np.float64)
    rates = mixture_collision_rates(number_densities, diameters, mass, dim)
    total = rates.sum(axis=1)
    g = mixture_contact_values(number_densities, diameters, dim)
    excess = (rates * (1.0 - 1.0 / g)).sum(axis=1) / total
    value = np.array([mean_speed(dim, float(m)) for m in mass]) / total
    return Prediction(value, (0.003 if dim == 3 else 0.005) * excess * value)


def pairs_of_few(counts: ArrayLike, diameters: ArrayLike, volume: float, dim: int) -> float:
    """Return by how much Z - 1 of few particles in a periodic box differs, for the pairs that there are.

    N/(N - 1) times the sum of N_i (N_j - delta_ij) sigma_ij^d g_ij over that of N_i N_j sigma_ij^d g_ij, in units of
    kT = 2 K/d(N - 1): no particle meets itself. 1 for one species; exact in the dilute gas, where one large particle
    among small ones meets no other large one.

    Parameters
    ----------
    counts, diameters : (k,) array_like
        How many of each species, and sigma_i [length].
    volume : float
        V [length^d].
    dim : {2, 3}
        Dimension d.
    """
    number, sigma = np.asarray(counts, dtype=np.float64), np.asarray(diameters, dtype=np.float64)
    weights = (np.add.outer(sigma, sigma) / 2) ** dim * mixture_contact_values(number / volume, sigma, dim)
    pairs = np.outer(number, number) - np.diag(number)
    n = float(number.sum())
    return n / (n - 1.0) * float((pairs * weights).sum()) / float((np.outer(number, number) * weights).sum())
