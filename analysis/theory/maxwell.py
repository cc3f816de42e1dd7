"""Maxwell-Boltzmann distributions of velocities, and the exact ones of N particles of fixed energy."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from analysis.theory.prediction import check_dim

__all__ = [
    "component_cdf",
    "component_pdf",
    "energy_cdf",
    "energy_pdf",
    "energy_share",
    "finite_energy_law",
    "finite_mean_speed",
    "mean_speed",
    "speed_cdf",
    "speed_pdf",
]

FloatArray = NDArray[np.float64]


def speed_pdf(speed: ArrayLike, dim: int, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the Maxwell-Boltzmann density of speeds, [1/speed]; exact for infinitely many particles.

    4 pi v^2 (m/2 pi kT)^(3/2) exp(-m v^2/2kT) in 3D, (m v/kT) exp(-m v^2/2kT) in 2D. With N particles of
    fixed energy the density differs by O(1/N); `energy_share` is exact there.

    Parameters
    ----------
    speed : array_like
        Speeds v >= 0.
    dim : {2, 3}
        Dimension d.
    mass, temperature : float
        Mass of the species and kT.
    """
    check_dim(dim)
    scale = math.sqrt(temperature / mass)
    x = np.asarray(speed, dtype=np.float64) / scale
    shell = math.sqrt(2.0 / math.pi) * x * x if dim == 3 else x
    return np.asarray(np.where(x < 0.0, 0.0, shell * np.exp(-0.5 * x * x)) / scale)


def speed_cdf(speed: ArrayLike, dim: int, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the Maxwell-Boltzmann probability of a speed below `speed`; arguments as in `speed_pdf`."""
    check_dim(dim)
    x = np.maximum(np.asarray(speed, dtype=np.float64), 0.0) / math.sqrt(temperature / mass)
    return np.asarray(special.gammainc(dim / 2, 0.5 * x * x))


def component_pdf(component: ArrayLike, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the density of one velocity component, normal with variance kT/m, [1/speed]."""
    scale = math.sqrt(temperature / mass)
    x = np.asarray(component, dtype=np.float64) / scale
    return np.asarray(np.exp(-0.5 * x * x) / (math.sqrt(2.0 * math.pi) * scale))


def component_cdf(component: ArrayLike, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the Maxwell-Boltzmann probability of a velocity component below `component`."""
    return np.asarray(special.ndtr(np.asarray(component, dtype=np.float64) / math.sqrt(temperature / mass)))


def mean_speed(dim: int, mass: float = 1.0, temperature: float = 1.0) -> float:
    """Return <v> = sqrt(8 kT / pi m) in 3D, sqrt(pi kT / 2 m) in 2D, [speed]."""
    check_dim(dim)
    return math.sqrt(2.0 * temperature / mass) * math.gamma((dim + 1) / 2) / math.gamma(dim / 2)


def energy_share(n: int, dim: int, boundary: Literal["periodic", "wall"] = "periodic") -> Any:
    """Return the exact distribution of one particle's share of a fixed kinetic energy, equal masses.

    Without conserved momentum (walls on every axis) the share is Beta(d/2, d(N-1)/2); with total momentum
    zero (periodic on every axis) it is (N-1)/N times Beta(d/2, d(N-2)/2): the uniform distribution on a
    sphere in velocity space.

    Parameters
    ----------
    n : int
        Number of particles N; at least 3 in a periodic box, 2 between walls.
    dim : {2, 3}
        Dimension d.
    boundary : {"periodic", "wall"}
        The same on every axis.

    Returns
    -------
    scipy.stats frozen distribution
        Of m v^2 / 2 divided by the total kinetic energy; has `pdf`, `cdf`, `moment`.
    """
    check_dim(dim)
    fewest = 3 if boundary == "periodic" else 2
    if n < fewest:
        raise ValueError(f"n = {n}; the energy share is spread over values for n >= {fewest} only")
    from scipy import stats  # which takes long to import: only for those who ask for a distribution

    if boundary == "periodic":
        return stats.beta(dim / 2, dim * (n - 2) / 2, scale=(n - 1) / n)
    return stats.beta(dim / 2, dim * (n - 1) / 2)


def energy_pdf(energy: ArrayLike, dim: int, temperature: float = 1.0) -> FloatArray:
    """Return the density of one particle's kinetic energy, N -> infinity, [1/energy].

    A gamma distribution with shape d/2 and scale kT, whatever the mass: 2 sqrt(e/pi) exp(-e) in 3D and
    exp(-e) in 2D, e in units of kT.

    Parameters
    ----------
    energy : array_like
        Kinetic energies >= 0.
    dim : {2, 3}
        Dimension d.
    temperature : float
        kT.
    """
    check_dim(dim)
    e = np.asarray(energy, dtype=np.float64) / temperature
    below = np.maximum(e, 0.0)
    density = 2.0 * np.sqrt(below / math.pi) * np.exp(-below) if dim == 3 else np.exp(-below)
    return np.asarray(np.where(e < 0.0, 0.0, density) / temperature)


def energy_cdf(energy: ArrayLike, dim: int, temperature: float = 1.0) -> FloatArray:
    """Return the probability of an energy below `energy`, N -> infinity; arguments as in `energy_pdf`."""
    check_dim(dim)
    return np.asarray(special.gammainc(dim / 2, np.maximum(np.asarray(energy, float), 0.0) / temperature))


def finite_energy_law(
    degrees_of_freedom: int, dim: int, momentum_share: float = 0.0, temperature: float = 1.0
) -> Any:
    """Return the exact distribution of one particle's kinetic energy at fixed total energy D kT / 2.

    Microcanonically the velocities, scaled by the roots of the masses, are uniform on a sphere in D
    dimensions, D the degrees of freedom, so that a particle's share of the energy is (1 - q) Beta(d/2, (D -
    d)/2). Where the momentum is fixed at zero, q = m/M is the particle's share of the mass; otherwise q = 0.
    `energy_share` is the case of equal masses.

    Parameters
    ----------
    degrees_of_freedom : int
        D > d: d(N - 1) in a periodic box, dN between walls.
    dim : {2, 3}
        Dimension d.
    momentum_share : float, default 0
        q: m/M in a box periodic along every axis, 0 between walls. With some axes periodic the law has no
        such closed form; m/M times their fraction gives the exact mean, and the shape to order 1/N^2.
    temperature : float
        kT = 2 E / D.

    Returns
    -------
    scipy.stats frozen distribution
        Of the energy [energy]; has `pdf`, `cdf`, `moment`.

    Raises
    ------
    ValueError
        Unless D > d and 0 <= q < 1.
    """
    from scipy import stats

    _check_law(degrees_of_freedom, dim, momentum_share)
    most = (1.0 - momentum_share) * degrees_of_freedom * temperature / 2
    return stats.beta(dim / 2, (degrees_of_freedom - dim) / 2, scale=most)


def _check_law(degrees_of_freedom: int, dim: int, momentum_share: float) -> None:
    check_dim(dim)
    if degrees_of_freedom <= dim or not 0.0 <= momentum_share < 1.0:
        raise ValueError(
            f"degrees_of_freedom = {degrees_of_freedom}, momentum_share = {momentum_share:g}; expected more "
            f"than {dim} free momenta, and a share from 0 to below 1"
        )


def finite_mean_speed(
    degrees_of_freedom: int,
    dim: int,
    momentum_share: float = 0.0,
    mass: float = 1.0,
    temperature: float = 1.0,
) -> float:
    """Return the exact mean speed of a particle at fixed total energy D kT / 2, [speed].

    sqrt((1 - q) D kT/m) Gamma((d+1)/2) Gamma(D/2) / (Gamma(d/2) Gamma((D+1)/2)), the mean of the root of
    `finite_energy_law`; `mean_speed` (1 + 1/(4D) - q/2 + ...).

    Parameters
    ----------
    degrees_of_freedom, dim, momentum_share, temperature
        As in `finite_energy_law`; D = d, two particles, too.
    mass : float
        Mass m of the particle.
    """
    if degrees_of_freedom != dim:  # two particles at rest together have one speed
        _check_law(degrees_of_freedom, dim, momentum_share)
    ratio = math.lgamma(degrees_of_freedom / 2) - math.lgamma((degrees_of_freedom + 1) / 2)
    factor = math.sqrt(degrees_of_freedom / 2) * math.exp(ratio) * math.sqrt(1.0 - momentum_share)
    return mean_speed(dim, mass, temperature) * factor
