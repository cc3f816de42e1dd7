"""Collision rates, mean free paths and free flights, also of few particles and of several species."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from analysis.theory.maxwell import finite_mean_speed, mean_speed, speed_pdf
from analysis.theory.mixtures import (
    mixture_collision_rates,
    mixture_contact_uncertainty,
    mixture_contact_values,
)
from analysis.theory.prediction import Prediction, check_dim, packing_fraction
from analysis.theory.state import (
    compressibility_factor,
    contact_value,
    finite_size_compressibility,
    finite_size_shift,
    virial_series,
)

__all__ = [
    "collision_rate",
    "collision_speed_factor",
    "compressibility_from_rate",
    "finite_size_collision_rate",
    "finite_size_mean_free_path",
    "finite_size_mixture_rates",
    "free_path_density",
    "free_path_moment",
    "free_path_survival",
    "free_time_density",
    "free_time_moment",
    "free_time_survival",
    "mean_free_path",
    "speed_dependent_free_path",
    "speed_dependent_rate",
]

FloatArray = NDArray[np.float64]

NODES, PANELS = 16, 24  # of the quadrature over speeds: in each panel, and how many panels


def collision_rate(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> FloatArray:
    """Return nu, the collisions per particle and time, each collision counted for both partners, [1/time].

    nu = 4 rho sigma^2 chi sqrt(pi kT/m) in 3D, 2 rho sigma chi sqrt(pi kT/m) in 2D; exact in equilibrium
    given chi, so that Z - 1 = (sigma/2d) sqrt(pi m/kT) nu. The gas has N nu/2 collisions per unit time.

    Parameters
    ----------
    eta : array_like
        Packing fraction.
    dim : {2, 3}
        Dimension d.
    diameter, mass, temperature : float
        sigma [length], m and kT.
    """
    excess = compressibility_factor(eta, dim).value - 1.0
    return np.asarray(excess * 2 * dim / diameter * math.sqrt(temperature / (math.pi * mass)))


def mean_free_path(eta: ArrayLike, dim: int, diameter: float = 1.0) -> FloatArray:
    """Return the mean free path <v>/nu, [length].

    1/(sqrt2 pi rho sigma^2 chi) in 3D, 1/(2 sqrt2 rho sigma chi) in 2D. Infinite at eta = 0.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(mean_speed(dim) / collision_rate(eta, dim, diameter))


# Rate and pressure of N particles ---------------------------------------------------------------------------


def collision_speed_factor(degrees_of_freedom: ArrayLike) -> FloatArray:
    """Return C_N < 1, the factor by which a fixed energy lowers the mean normal relative speed in collisions.

    C_N = Gamma((D+1)/2) / (Gamma(D/2) sqrt(D/2)) = 1 - 1/(4D) + ..., exact: the normal relative velocity of a
    colliding pair is a component of a vector uniform on a sphere in D dimensions, weighted in collisions with
    itself. The mean over collisions is sqrt(pi kT / 2 mu) C_N, mu the reduced mass, kT = 2E/D. The mean
    relative speed of all pairs, and with it the collision rate, is higher by 1/C_N.

    Parameters
    ----------
    degrees_of_freedom : array_like
        Degrees of freedom D.
    """
    half = np.asarray(degrees_of_freedom, dtype=np.float64) / 2
    few = np.minimum(half, 500.0)
    ratio = np.exp(special.gammaln(few + 0.5) - special.gammaln(few)) / np.sqrt(few)
    expansion = 1 - 1 / (8 * half) + 1 / (128 * half**2)  # the Gammas cancel where there are many
    return np.asarray(np.where(half > few, expansion, ratio))


def compressibility_from_rate(
    pair_rates: ArrayLike,
    diameters: ArrayLike,
    masses: ArrayLike,
    temperature: float,
    degrees_of_freedom: int,
) -> FloatArray:
    """Return Z of a gas at equilibrium from its collision rates.

    Z - 1 = C_N / (D kT) sum over pairs of species of Gamma_ij sigma_ij sqrt(2 pi mu_ij kT), exact for any N,
    density, mixture and boundary as long as the velocities are at equilibrium; Gamma_ij counts every
    collision between i and j once, mu is the reduced mass. For one species in a periodic box that is Z - 1 =
    N/(N-1) (sigma/2d) sqrt(pi m/kT) nu C_N with nu = 2 Gamma/N. See `collision_speed_factor`.

    Parameters
    ----------
    pair_rates : (..., k, k) array_like
        Gamma_ij [1/time], symmetric; each unlike pair is in both entries and is used once.
    diameters, masses : (k,) array_like
        Per species.
    temperature : float
        kT = 2 K_th / D.
    degrees_of_freedom : int
        D.

    Returns
    -------
    (...) array
    """
    sigma = np.asarray(diameters, dtype=np.float64)
    mass = np.asarray(masses, dtype=np.float64)
    contact = np.add.outer(sigma, sigma) / 2
    reduced = np.outer(mass, mass) / np.add.outer(mass, mass)
    passed = np.triu(contact * np.sqrt(2 * math.pi * reduced * temperature))
    total = np.einsum("...ij,ij->...", np.asarray(pair_rates, dtype=np.float64), passed)
    return np.asarray(
        1.0 + collision_speed_factor(degrees_of_freedom) * total / (degrees_of_freedom * temperature)
    )


def finite_size_collision_rate(
    eta: ArrayLike,
    dim: int,
    n: int,
    diameter: float = 1.0,
    mass: float = 1.0,
    temperature: float = 1.0,
    edge: float | None = None,
) -> Prediction:
    """Return nu of N particles of fixed energy in a periodic box, kT = 2 K_th/d(N - 1), [1/time].

    The rate that gives `finite_size_compressibility` by `compressibility_from_rate`, which is exact; see
    there for the limits of the former.

    Parameters
    ----------
    eta : array_like
        Packing fraction.
    dim : {2, 3}
        Dimension d.
    n : int
        Number of particles N >= 2.
    diameter, mass, temperature : float
        sigma [length], m and kT.
    edge : float, optional
        As in `finite_size_shift`.

    Returns
    -------
    Prediction
        u from that of Z.
    """
    finite = finite_size_compressibility(eta, dim, n, edge=edge)
    speed = collision_speed_factor(dim * (n - 1))
    per_excess = (n - 1) / n * 2 * dim / diameter * math.sqrt(temperature / (math.pi * mass)) / speed
    return Prediction((finite.value - 1.0) * per_excess, finite.uncertainty * per_excess)


def finite_size_mean_free_path(
    eta: ArrayLike, dim: int, n: int, diameter: float = 1.0, edge: float | None = None
) -> Prediction:
    """Return the mean free path <v>/nu of N particles of fixed energy in a periodic box, [length].

    `finite_mean_speed` over `finite_size_collision_rate`; arguments as there, eta > 0.
    """
    rate = finite_size_collision_rate(eta, dim, n, diameter, edge=edge)
    value = finite_mean_speed(dim * (n - 1), dim, 1.0 / n) / rate.value
    return Prediction(value, value * rate.uncertainty / rate.value)


def finite_size_mixture_rates(
    counts: ArrayLike,
    volume: float,
    diameters: ArrayLike,
    masses: ArrayLike,
    dim: int,
    temperature: float = 1.0,
    degrees_of_freedom: int | None = None,
    edge: float | None = None,
) -> Prediction:
    """Return nu_ij, how often one of few particles of species i meets species j, at fixed energy, [1/time].

    nu_ij = (N_j - delta_ij) / V times the rate with one partner in a unit of volume. Their relative velocity
    is a component of a vector uniform on a sphere in D dimensions; its projection on the total momentum
    vanishes for any masses (1/sqrt(m_i) sqrt(m_i) - 1/sqrt(m_j) sqrt(m_j) = 0). Momentum conservation
    therefore does not change <|v_i - v_j|>, and with fixed energy it is Maxwell's over
    `collision_speed_factor`. The contact value is that of `mixture_contact_values` (of one diameter
    `contact_value`) times (Z_N - 1)/(Z - 1) of one species (`finite_size_shift`). Two particles: exactly
    V/(V - v0).

    Parameters
    ----------
    counts : (k,) array_like
        How many particles of each species.
    volume : float
        V [length^d].
    diameters, masses : (k,) array_like
        Per species.
    dim : {2, 3}
        Dimension d.
    temperature : float, default 1
        kT = 2 K_th/D.
    degrees_of_freedom : int, optional
        D; d(N - 1), that of a periodic box, by default.
    edge : float, optional
        Shortest edge of the box, in mean diameters.

    Returns
    -------
    Prediction
        (k, k) arrays. u = 0 for two particles; otherwise that of the contact values and of the shift; in a
        mixture of diameters the whole shift counts as uncertainty.
    """
    number, sigma = np.asarray(counts, dtype=np.float64), np.asarray(diameters, dtype=np.float64)
    density, n = number / volume, round(float(number.sum()))
    partners = (number - np.eye(len(number))) / number
    speed = 1.0 / collision_speed_factor(dim * (n - 1) if degrees_of_freedom is None else degrees_of_freedom)
    rates = mixture_collision_rates(density, sigma, masses, dim, temperature) * partners * speed
    g = mixture_contact_values(density, sigma, dim)
    contact = np.add.outer(sigma, sigma) / 2
    if (
        n == 2
        and degrees_of_freedom is None
        and (volume ** (1 / dim) if edge is None else edge * sigma.mean()) >= 2 * (contact.max())
    ):
        excluded = packing_fraction(1.0, 2 * contact, dim)  # a ball of radius sigma_ij
        return Prediction(rates / g * volume / (volume - excluded), np.zeros_like(rates))
    eta = float((packing_fraction(1.0, sigma, dim) * density).sum())
    bulk = float(compressibility_factor(eta, dim).value) - 1.0
    shift = finite_size_shift(eta, dim, n, edge=edge)
    few, few_uncertainty = float(shift.value) / bulk, float(shift.uncertainty) / bulk
    if np.ptp(sigma) == 0.0:
        rates = rates / g * float(contact_value(eta, dim))
        relative = np.full_like(rates, math.hypot(few_uncertainty, _excess_uncertainty(eta, dim)))
    else:
        relative = np.hypot(
            mixture_contact_uncertainty(sigma, dim) * (1.0 - 1.0 / g), math.hypot(few, few_uncertainty)
        )
    return Prediction(rates * (1.0 + few), rates * relative)


def _excess_uncertainty(eta: float, dim: int) -> float:
    """Relative uncertainty of Z - 1 of the infinite fluid.

    In a dilute gas the stated uncertainty of an equation of state, relative to Z, does not bound that of Z -
    1; the virial series, exact at eta -> 0, gives it there.
    """
    bulk = compressibility_factor(eta, dim)
    uncertainty = float(bulk.uncertainty)
    if eta <= (0.5 if dim == 3 else 0.6):
        series = virial_series(eta, dim)
        uncertainty = min(uncertainty, abs(float(series.value - bulk.value)) + float(series.uncertainty))
    return uncertainty / float(bulk.value - 1.0)


# Flights of the dilute gas ----------------------------------------------------------------------------------


def speed_dependent_rate(
    speed: ArrayLike, eta: float, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> FloatArray:
    """Return nu(v), the collision rate of a particle with speed v, [1/time].

    With c = v/sqrt(2kT/m) and nu the mean rate: nu(v)/nu = [exp(-c^2) + (2c + 1/c) (sqrt(pi)/2) erf(c)] /
    2 sqrt(2) in 3D; nu(v)/nu = exp(-c^2/2) [(1 + c^2) I0(c^2/2) + c^2 I1(c^2/2)] / sqrt(2) in 2D (Chapman and
    Cowling, The Mathematical Theory of Non-Uniform Gases, 5.4). Exact given chi in a homogeneous gas at
    equilibrium. nu(0)/nu = 1/sqrt(2).

    Parameters
    ----------
    speed : array_like
        Speeds v >= 0.
    eta : float
        Packing fraction.
    dim : {2, 3}
        Dimension d.
    diameter, mass, temperature : float
        sigma, m and kT.
    """
    c = np.asarray(speed, dtype=np.float64) / math.sqrt(2 * temperature / mass)
    return np.asarray(relative_rate(c, dim) * collision_rate(eta, dim, diameter, mass, temperature))


def speed_dependent_free_path(
    speed: ArrayLike, eta: float, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> FloatArray:
    """Return lambda(v) = v / nu(v), [length]; arguments as in `speed_dependent_rate`.

    It grows from 0 to sqrt(2) mean free paths for a particle much faster than the others.
    """
    rate = speed_dependent_rate(speed, eta, dim, diameter, mass, temperature)
    return np.asarray(np.asarray(speed, dtype=np.float64) / rate)


def relative_rate(c: FloatArray, dim: int) -> FloatArray:
    """Return nu(v)/nu of one species, c = v/sqrt(2kT/m); see `speed_dependent_rate`."""
    check_dim(dim)
    if dim == 3:
        small = c < 1e-4
        safe = np.where(small, 1.0, c)
        tail = np.where(
            small, 1.0 + 5 * c**2 / 3, (safe + 0.5 / safe) * math.sqrt(math.pi) * special.erf(safe)
        )
        return np.asarray((np.exp(-(c**2)) + tail) / (2 * math.sqrt(2)))
    x = c**2 / 2
    return np.asarray(((1 + c**2) * special.ive(0, x) + c**2 * special.ive(1, x)) / math.sqrt(2))


@lru_cache(maxsize=1)
def quadrature() -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of Gauss and Legendre on [0, 1], in panels."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    places = np.add.outer(np.arange(PANELS), (nodes + 1.0) / 2).ravel() / PANELS
    return places, np.tile(weights / 2 / PANELS, PANELS)


@lru_cache(maxsize=2)
def _flights(dim: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Speeds in units of the mean, their rates in units of the mean, and the weights of flights at them."""
    nodes, weights = quadrature()
    speed = 12.0 * nodes  # 0 to 12 thermal speeds
    rate = relative_rate(speed / math.sqrt(2), dim)
    share = 12.0 * weights * speed_pdf(speed, dim) * rate
    return speed / mean_speed(dim), rate, share


def _flight_average(x: ArrayLike, dim: int, power: int, of_time: bool) -> FloatArray:
    """Average of a^power exp(-a x) over flights, a the rate per mean path, or per mean time."""
    speed, rate, share = _flights(dim)
    per = rate if of_time else rate / speed
    points = np.asarray(x, dtype=np.float64)
    return np.asarray(np.exp(-np.multiply.outer(points, per)) @ (share * per**power))


def free_path_survival(x: ArrayLike, dim: int, eta: float = 0.0) -> Prediction:
    """Return the probability that a free path is longer than x mean free paths.

    S(x) = integral of f(v) (nu(v)/nu) exp(-nu(v) x l / v) dv over speeds (Visco, van Wijland and Trizac,
    Phys. Rev. E 77, 041117 (2008), doi 10.1103/PhysRevE.77.041117). Exact for eta -> 0. At finite density it
    is Enskog's approximation, in units of the mean free path there; successive collisions with the same
    neighbours change it by a relative amount of order eta, which is the uncertainty.

    Parameters
    ----------
    x : array_like
        Length over mean free path, >= 0.
    dim : {2, 3}
        Dimension d.
    eta : float, default 0
        Packing fraction, for the uncertainty.
    """
    value = _flight_average(x, dim, 0, of_time=False)
    return Prediction(value, eta * value)


def free_path_density(x: ArrayLike, dim: int, eta: float = 0.0) -> Prediction:
    """Return the probability density of free paths, per mean free path; see `free_path_survival`.

    At x = 0 it is 1.09213 in 3D and 1.21930 in 2D, not 1 as for an exponential.
    """
    value = _flight_average(x, dim, 1, of_time=False)
    return Prediction(value, eta * value)


def free_time_survival(x: ArrayLike, dim: int, eta: float = 0.0) -> Prediction:
    """Return the probability of a free time longer than x mean free times; see `free_path_survival`."""
    value = _flight_average(x, dim, 0, of_time=True)
    return Prediction(value, eta * value)


def free_time_density(x: ArrayLike, dim: int, eta: float = 0.0) -> Prediction:
    """Return the probability density of free times, per mean free time; see `free_path_survival`."""
    value = _flight_average(x, dim, 1, of_time=True)
    return Prediction(value, eta * value)


def free_path_moment(order: int, dim: int, eta: float = 0.0) -> Prediction:
    """Return <l^k> / <l>^k of free paths: 2.101218 (3D), 2.159816 (2D) for k = 2, where an exponential has 2.

    <l^k> = k! integral of f (nu(v)/nu) (v/nu(v))^k dv; see `free_path_survival`.

    Parameters
    ----------
    order : int
        k >= 1.
    dim : {2, 3}
        Dimension d.
    eta : float, default 0
        Packing fraction; u = (k - 1) eta times the value.
    """
    value = math.factorial(order) * float(_flight_average(0.0, dim, -order, of_time=False))
    return Prediction(value, (order - 1) * eta * value)


def free_time_moment(order: int, dim: int, eta: float = 0.0) -> Prediction:
    """Return <t^k> / <t>^k of free times: 2.076131 (3D), 2.108441 (2D) for k = 2; see `free_path_moment`."""
    value = math.factorial(order) * float(_flight_average(0.0, dim, -order, of_time=True))
    return Prediction(value, (order - 1) * eta * value)
