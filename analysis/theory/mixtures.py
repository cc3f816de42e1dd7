"""Mixtures of species with different diameters and masses: contact values, pressure, rates, free paths."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.maxwell import mean_speed
from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside, packing_fraction
from analysis.theory.state import compressibility_factor, contact_value

__all__ = [
    "mixture_collision_rates",
    "mixture_compressibility",
    "mixture_contact_uncertainty",
    "mixture_contact_values",
    "mixture_mean_free_paths",
    "pairs_of_few",
]

FloatArray = NDArray[np.float64]

# Error at diameters 1:2 of Z - 1, which grows as the square of the logarithm of their ratio, and of g_ij - 1,
# which grows as the logarithm.
_MISSED, _CONTACTS_MISSED = {3: 0.0016, 2: 0.001}, {3: 0.013, 2: 0.025}


def mixture_contact_values(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> FloatArray:
    """Return g_ij at contact in a mixture, consistent with `mixture_compressibility`.

    3D: Boublik (1970, doi 10.1063/1.1673824) and Mansoori et al. (1971, doi 10.1063/1.1675048) have the
    better ratios between pairs, Santos, Yuste and Lopez de Haro the better Z: g_ij - 1/(1 - eta) of the
    former, times the one number that gives the latter's Z. 2D: those of Santos, Yuste and Lopez de Haro, to
    which the same recipe leads from Jenkins and Mancini's (1987, doi 10.1115/1.3172990). For one species
    `contact_value`.

    Parameters
    ----------
    number_densities, diameters : (k,) array_like
        rho_i [1/length^d] and sigma_i [length].
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    (k, k) array
        NaN, with a `TheoryRangeWarning`, above freezing (eta = 0.494, 0.66). For the uncertainty see
        `mixture_contact_uncertainty`.
    """
    rho, sigma, eta = _checked(number_densities, diameters, dim)
    free = 1.0 - eta
    known = _santos_yuste_lopez_de_haro(rho, sigma, dim, eta)
    if dim == 2:
        return known
    reduced = np.outer(sigma, sigma) / np.add.outer(sigma, sigma)
    z2 = math.pi / 6 * float(rho @ sigma**2)
    beyond = 3 * z2 * reduced / free**2 + 2 * (z2 * reduced) ** 2 / free**3
    weights = np.outer(rho, rho) * (np.add.outer(sigma, sigma) / 2) ** dim
    scale = float((weights * (known - 1 / free)).sum()) / float((weights * beyond).sum())
    return np.asarray(1 / free + scale * beyond)


def mixture_contact_uncertainty(diameters: ArrayLike, dim: int) -> float:
    """Return the relative uncertainty of each g_ij - 1 of `mixture_contact_values`.

    1.3 % (3D) or 2.5 % (2D) times log2(largest/smallest diameter): from the rates between species of 2000
    particles at eta = 0.3 (3D) and 0.5 (2D), where g_ij was off by up to 0.7 and 1.4 % (half of each, 1:2),
    1.4 and 4.5 % (a tenth of large ones, 1:5). Those errors cancel in Z.

    Parameters
    ----------
    diameters : (k,) array_like
        sigma_i [length].
    dim : {2, 3}
        Dimension d.
    """
    check_dim(dim)
    return _CONTACTS_MISSED[dim] * _octaves(np.asarray(diameters, dtype=np.float64))


def _checked(
    number_densities: ArrayLike, diameters: ArrayLike, dim: int
) -> tuple[FloatArray, FloatArray, float]:
    """Return densities and diameters as arrays, and the packing fraction, NaN where the theory ends."""
    check_dim(dim)
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    eta = np.asarray((packing_fraction(1.0, sigma, dim) * rho).sum())
    inside = inside_range("the theory of mixtures", eta, 0.0, 0.494 if dim == 3 else 0.66)
    return rho, sigma, float(only_inside(eta, inside))


def _santos_yuste_lopez_de_haro(rho: FloatArray, sigma: FloatArray, dim: int, eta: float) -> FloatArray:
    """Return g_ij = 1/(1 - eta) + (chi - 1/(1 - eta)) <sigma^(d-1)>/<sigma^d> sigma_i sigma_j/sigma_ij."""
    free = 1.0 - eta
    mean = float(rho @ sigma ** (dim - 1)) / float(rho @ sigma**dim)
    apart = np.outer(sigma, sigma) / (np.add.outer(sigma, sigma) / 2)
    return np.asarray(1 / free + (float(contact_value(eta, dim)) - 1 / free) * mean * apart)


def mixture_compressibility(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> Prediction:
    """Return Z of a mixture from that of one species, after Santos, Yuste and Lopez de Haro.

    Mol. Phys. 96, 1 (1999), doi 10.1080/00268979909482932, built on `compressibility_factor`: Z = 1 + (2
    pi/3) rho sum x_i x_j sigma_ij^3 g_ij in 3D, 1 + (pi/2) rho sum x_i x_j sigma_ij^2 g_ij in 2D, with g_ij =
    1/(1 - eta) + (chi - 1/(1 - eta)) (<sigma^(d-1)>/<sigma^d>) sigma_i sigma_j/sigma_ij, chi the contact
    value of one species at the
      same eta.

    Parameters
    ----------
    number_densities, diameters, dim
        As in `mixture_contact_values`.

    Returns
    -------
    Prediction
        u = 0.16 % (3D) or 0.1 % (2D) of Z - 1 times log2(largest/smallest diameter)^2, besides that of one
        species: its known error is, in 3D (eta = 0.3), 0.15 % at 1:2 and 0.84(8) % at 1:5, in 2D (0.5) 0.04 %
        at 1:1.4 and 0.50(9) % at 1:5. NaN above freezing.
    """
    rho, sigma, eta = _checked(number_densities, diameters, dim)
    contact = np.add.outer(sigma, sigma) / 2
    weights = np.outer(rho, rho) / rho.sum() * contact**dim * mixture_contact_values(rho, sigma, dim)
    excess = (2 * math.pi / 3 if dim == 3 else math.pi / 2) * float(weights.sum())
    pure = compressibility_factor(eta, dim)
    own = float(pure.uncertainty) / float(pure.value - 1.0) if eta > 0.0 else 0.0
    return Prediction(1.0 + excess, math.hypot(own, _MISSED[dim] * _octaves(sigma) ** 2) * excess)


def _octaves(sigma: FloatArray) -> float:
    return math.log2(float(sigma.max() / sigma.min()))


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
        (k,) arrays; u from `mixture_contact_uncertainty`, taken as that of the mean over partners.
    """
    mass = np.asarray(masses, dtype=np.float64)
    rates = mixture_collision_rates(number_densities, diameters, mass, dim)
    total = rates.sum(axis=1)
    g = mixture_contact_values(number_densities, diameters, dim)
    excess = (rates * (1.0 - 1.0 / g)).sum(axis=1) / total
    value = np.array([mean_speed(dim, float(m)) for m in mass]) / total
    return Prediction(value, mixture_contact_uncertainty(diameters, dim) * excess * value)


def pairs_of_few(counts: ArrayLike, diameters: ArrayLike, volume: float, dim: int) -> float:
    """Return the factor on Z - 1 of few particles in a periodic box that counts the actual number of pairs.

    N/(N - 1) times the sum of N_i (N_j - delta_ij) sigma_ij^d g_ij over that of N_i N_j sigma_ij^d g_ij, in
    units of kT = 2 K/d(N - 1): no particle meets itself. 1 for one species; exact in the dilute gas, where
    one large particle among small ones meets no other large one.

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
