"""Closed forms and tables that measurements are compared with, each with its source and uncertainty.

Units are the caller's: lengths in any unit, temperatures as energies (k_B = 1). d is the dimension, N the
number of particles, sigma a diameter, rho = N/V, eta the packing fraction, s = 2 n_coll / N the collisions
per particle. All functions of packing fraction, speed or s take arrays and return arrays of the same shape.

A theory that is not exact comes as a `Prediction`, a value with a standard uncertainty. Asking for one
outside the range in which it was established gives a `TheoryRangeWarning`.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray
from scipy import interpolate, stats

__all__ = [
    "EqualSpeedsRelaxation",
    "Prediction",
    "TheoryRangeWarning",
    "boltzmann_equal_speeds",
    "carnahan_starling",
    "collision_rate",
    "component_cdf",
    "component_pdf",
    "compressibility_factor",
    "contact_value",
    "cumulant_noise",
    "energy_share",
    "equal_speeds_decay_rate",
    "equilibrium_a2",
    "equilibrium_a3",
    "equilibrium_h",
    "finite_size_compressibility",
    "finite_size_relaxation",
    "kolafa_labik_malijevsky",
    "ks_floor",
    "mean_free_path",
    "mean_speed",
    "mixture_collision_rates",
    "mixture_compressibility",
    "mixture_contact_values",
    "near_equilibrium_rate",
    "packing_fraction",
    "sonine_rate",
    "speed_cdf",
    "speed_pdf",
    "virial_discs",
]

FloatArray = NDArray[np.float64]


class TheoryRangeWarning(UserWarning):
    """A theory was asked for a value outside the range in which it was established."""


@dataclass(frozen=True)
class Prediction:
    """A theoretical value with its own uncertainty.

    Attributes
    ----------
    value : float or array
        What the theory says.
    uncertainty : float or array
        Its standard uncertainty u in the same units; 0 where the statement is exact.
    """

    value: Any
    uncertainty: Any


def _check_dim(dim: int) -> None:
    if dim not in (2, 3):
        raise ValueError(f"dim = {dim}; expected 2 or 3")


def _warn_outside(name: str, values: FloatArray, low: float, high: float) -> None:
    if values.size and (values.min() < low or values.max() > high):
        warnings.warn(
            f"{name} was established for {low:g} to {high:g}; asked at {values.min():g} to {values.max():g}",
            TheoryRangeWarning,
            stacklevel=3,
        )


def packing_fraction(number_density: ArrayLike, diameter: ArrayLike, dim: int) -> FloatArray:
    """Return eta = (pi/6) rho sigma^3 in 3D, (pi/4) rho sigma^2 in 2D.

    Parameters
    ----------
    number_density : array_like
        rho [1/length^d].
    diameter : array_like
        sigma [length].
    dim : {2, 3}
        Dimension d.
    """
    _check_dim(dim)
    return np.asarray(math.pi / (2 * dim) * np.asarray(number_density) * np.asarray(diameter) ** dim)


# Maxwell-Boltzmann ------------------------------------------------------------------------------------------


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
    _check_dim(dim)
    return np.asarray(stats.chi.pdf(speed, dim, scale=math.sqrt(temperature / mass)))


def speed_cdf(speed: ArrayLike, dim: int, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the Maxwell-Boltzmann probability of a speed below `speed`; arguments as in `speed_pdf`."""
    _check_dim(dim)
    return np.asarray(stats.chi.cdf(speed, dim, scale=math.sqrt(temperature / mass)))


def component_pdf(component: ArrayLike, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the density of one velocity component, normal with variance kT/m, [1/speed]."""
    return np.asarray(stats.norm.pdf(component, scale=math.sqrt(temperature / mass)))


def component_cdf(component: ArrayLike, mass: float = 1.0, temperature: float = 1.0) -> FloatArray:
    """Return the Maxwell-Boltzmann probability of a velocity component below `component`."""
    return np.asarray(stats.norm.cdf(component, scale=math.sqrt(temperature / mass)))


def mean_speed(dim: int, mass: float = 1.0, temperature: float = 1.0) -> float:
    """Return <v> = sqrt(8 kT / pi m) in 3D, sqrt(pi kT / 2 m) in 2D, [speed]."""
    _check_dim(dim)
    return math.sqrt(2.0 * temperature / mass) * math.gamma((dim + 1) / 2) / math.gamma(dim / 2)


def energy_share(n: int, dim: int, boundary: Literal["periodic", "wall"] = "periodic") -> Any:
    """Return the exact distribution of one particle's share of a fixed kinetic energy, equal masses.

    With all momenta free (walls on every axis) the share is Beta(d/2, d(N-1)/2); with total momentum zero
    (periodic on every axis) it is (N-1)/N times Beta(d/2, d(N-2)/2): the uniform distribution on a sphere in
    velocity space.

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
    _check_dim(dim)
    fewest = 3 if boundary == "periodic" else 2
    if n < fewest:
        raise ValueError(f"n = {n}; the energy share is spread over values for n >= {fewest} only")
    if boundary == "periodic":
        return stats.beta(dim / 2, dim * (n - 2) / 2, scale=(n - 1) / n)
    return stats.beta(dim / 2, dim * (n - 1) / 2)


# Equations of state -----------------------------------------------------------------------------------------

_KLM = Polynomial(
    [1, 4, 6, 2.3647684, -0.8698551, 1.1062803, -1.1014221, 0.66605866, -0.03633431, 0]
    + [-0.20965164, 0, 0, 0, 0.10555569, 0, 0, 0, 0, 0, 0, 0, -0.00872380]
)
_DISCS = Polynomial(
    [1, 0, 0.12801774, 0.00181891, -0.05079442, -0.05297888, -0.03716416, -0.0216544, -0.014208, -0.0088832]
)
_KLM_RANGE = (0.0, 0.54)
_DISCS_RANGE = (0.0, 0.66)


def carnahan_starling(eta: ArrayLike) -> FloatArray:
    """Return Carnahan and Starling's Z = (1 + eta + eta^2 - eta^3)/(1 - eta)^3 of hard spheres.

    J. Chem. Phys. 51, 635 (1969), doi 10.1063/1.1672048. Off by up to 0.29 % (at eta = 0.37) against
    `kolafa_labik_malijevsky`; kept because everyone knows it.
    """
    e = np.asarray(eta, dtype=np.float64)
    return np.asarray((1 + e + e**2 - e**3) / (1 - e) ** 3)


def kolafa_labik_malijevsky(eta: ArrayLike) -> FloatArray:
    """Return Z of the hard-sphere fluid after Kolafa, Labik and Malijevsky.

    Phys. Chem. Chem. Phys. 6, 2335 (2004), doi 10.1039/B402792B. A polynomial in x = eta/(1 - eta) with the
    virial coefficients up to B6 imposed; stated inaccuracy 4e-5 relative up to rho sigma^3 = 1.03 (eta =
    0.54), the metastable branch above freezing (0.492) included.
    """
    e = np.asarray(eta, dtype=np.float64)
    _warn_outside("the hard-sphere equation of state", e, *_KLM_RANGE)
    return np.asarray(_KLM(e / (1 - e)))


def virial_discs(eta: ArrayLike) -> FloatArray:
    """Return Z = p(eta)/(1 - eta)^2 of the hard-disc fluid, p fixed by the virial coefficients up to B10.

    Coefficients: Clisby and McCoy, J. Stat. Phys. 122, 15 (2006), doi 10.1007/s10955-005-8080-0, resummed
    about the pole at eta = 1. Its uncertainty is in `compressibility_factor`; not to be used above eta =
    0.66, where the fluid ends.
    """
    e = np.asarray(eta, dtype=np.float64)
    _warn_outside("the hard-disc equation of state", e, *_DISCS_RANGE)
    return np.asarray(_DISCS(e) / (1 - e) ** 2)


def compressibility_factor(eta: ArrayLike, dim: int) -> Prediction:
    """Return the best known Z = P V / N kT of the infinite hard-sphere or hard-disc fluid.

    Parameters
    ----------
    eta : array_like
        Packing fraction; established up to 0.54 (3D), 0.66 (2D).
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        3D: `kolafa_labik_malijevsky`, u = 4e-5 Z. 2D: `virial_discs`, u the largest distance to the formulas
        of Luding (2001, doi 10.1103/PhysRevE.63.042201) and of Liu (2020), both fitted to simulations: 2e-4
        relative at 0.3, 5e-3 at 0.65.
    """
    _check_dim(dim)
    e = np.asarray(eta, dtype=np.float64)
    if dim == 3:
        value = kolafa_labik_malijevsky(e)
        return Prediction(value, 4e-5 * value)
    value = virial_discs(e)
    luding = 1 + 2 * e * ((1 - 7 * e / 16) / (1 - e) ** 2 - (e**3 / 16) / (8 * (1 - e) ** 4))
    liu = (1 + e**2 / 8 + e**3 / 18 - 4 * e**4 / 21) / (1 - e) ** 2
    return Prediction(value, np.maximum(np.abs(luding - value), np.abs(liu - value)))


def contact_value(eta: ArrayLike, dim: int) -> FloatArray:
    """Return chi = g(sigma+) = (Z - 1)/(2^(d-1) eta), the pair distribution at contact, infinite system.

    At eta = 0 it is 1; the relative uncertainty is that of Z - 1.
    """
    e = np.asarray(eta, dtype=np.float64)
    excess = compressibility_factor(e, dim).value - 1.0
    volume = 2.0 ** (dim - 1) * e
    return np.asarray(np.where(e > 0, excess / np.where(e > 0, volume, 1.0), 1.0))


def finite_size_compressibility(
    eta: ArrayLike, dim: int, n: int, ensemble: Literal["microcanonical", "canonical"] = "microcanonical"
) -> Prediction:
    """Return Z of N particles in a periodic box.

    Canonical: Z_N = Z - (rho/2N) d ln[d(rho Z)/d rho]/d rho (Lebowitz and Percus, Phys. Rev. 124, 1673
    (1961), doi 10.1103/PhysRev.124.1673). Microcanonical with total momentum zero, kT = 2K/d(N-1), Z = P
    V/(2K/d): Z - 1 = (N/(N-1)) (Z_N - 1), which is what an event-driven simulation measures. To leading order
    in eta the two steps cancel.

    Parameters
    ----------
    eta : array_like
        Packing fraction.
    dim : {2, 3}
        Dimension d.
    n : int
        Number of particles N >= 2.
    ensemble : {"microcanonical", "canonical"}
        Which of the two.

    Returns
    -------
    Prediction
        Good to 1e-3 for eta <= 0.3 at any N >= 32, above that for N >= 256 only, where the box's periodic
        images matter less; this is added to the uncertainty as a tenth of the correction.
    """
    infinite = compressibility_factor(eta, dim)
    e = np.asarray(eta, dtype=np.float64)
    if dim == 3:
        x = e / (1 - e)
        slope = _KLM.deriv()(x) * (1 + x) ** 2
        curvature = _KLM.deriv(2)(x) * (1 + x) ** 4 + 2 * _KLM.deriv()(x) * (1 + x) ** 3
    else:
        p, p1, p2 = _DISCS(e), _DISCS.deriv()(e), _DISCS.deriv(2)(e)
        slope = p1 / (1 - e) ** 2 + 2 * p / (1 - e) ** 3
        curvature = p2 / (1 - e) ** 2 + 4 * p1 / (1 - e) ** 3 + 6 * p / (1 - e) ** 4
    inverse_compressibility = infinite.value + e * slope
    canonical = infinite.value - e / (2 * n) * (2 * slope + e * curvature) / inverse_compressibility
    value = canonical if ensemble == "canonical" else 1.0 + n / (n - 1) * (canonical - 1.0)
    uncertainty = np.hypot(infinite.uncertainty, 0.1 * np.abs(value - infinite.value))
    return Prediction(value, uncertainty)


# Collision rates --------------------------------------------------------------------------------------------


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


def mixture_contact_values(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> FloatArray:
    """Return g_ij at contact in a mixture: BMCSL in 3D, Jenkins-Mancini in 2D.

    3D: Boublik (1970, doi 10.1063/1.1673824), Mansoori et al. (1971, doi 10.1063/1.1675048); 2D: Jenkins and
    Mancini (1987, doi 10.1115/1.3172990). For one species they reduce to Carnahan-Starling and Henderson; Z -
    1 is good to about 0.3 % (3D, eta < 0.4) and 0.5 % (2D, eta < 0.5).

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
    _check_dim(dim)
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    reduced = np.outer(sigma, sigma) / np.add.outer(sigma, sigma)
    if dim == 3:
        z2, z3 = (math.pi / 6 * float(rho @ sigma**power) for power in (2, 3))
        free = 1.0 - z3
        return np.asarray(1 / free + 3 * z2 * reduced / free**2 + 2 * (z2 * reduced) ** 2 / free**3)
    z1, z2 = (math.pi / 4 * float(rho @ sigma**power) for power in (1, 2))
    free = 1.0 - z2
    return np.asarray(1 / free + 9 / 8 * z1 * reduced / free**2)


def mixture_compressibility(number_densities: ArrayLike, diameters: ArrayLike, dim: int) -> Prediction:
    """Return Z of a mixture from `mixture_contact_values`; u = 0.3 % (3D), 0.5 % (2D) of Z - 1.

    Z = 1 + (2 pi/3) rho sum x_i x_j sigma_ij^3 g_ij in 3D, 1 + (pi/2) rho sum x_i x_j sigma_ij^2 g_ij in 2D.
    """
    rho = np.asarray(number_densities, dtype=np.float64)
    sigma = np.asarray(diameters, dtype=np.float64)
    contact = np.add.outer(sigma, sigma) / 2
    weights = np.outer(rho, rho) / rho.sum() * contact**dim * mixture_contact_values(rho, sigma, dim)
    excess = (2 * math.pi / 3 if dim == 3 else math.pi / 2) * float(weights.sum())
    return Prediction(1.0 + excess, (0.003 if dim == 3 else 0.005) * excess)


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


# Cumulants, H and their noise at equilibrium ----------------------------------------------------------------


def equilibrium_a2(free_momenta: ArrayLike) -> FloatArray:
    """Return the mean of a2 over N particles of fixed energy at equilibrium, -2/(D + 2).

    Here a2 = d<v^4>/((d+2)<v^2>^2) - 1. D counts the free momenta: d(N - 1) in a periodic box at rest, dN
    between walls. Exact for equal masses and one kind of boundary; it vanishes as -2/(dN), which is the bias
    of the estimator against an infinite gas.
    """
    return np.asarray(-2.0 / (np.asarray(free_momenta, dtype=np.float64) + 2.0))


def equilibrium_a3(free_momenta: ArrayLike) -> FloatArray:
    """Return the mean of a3 over N particles of fixed energy at equilibrium, -4/((D/2 + 1)(D/2 + 2)).

    See `equilibrium_a2`.
    """
    half = np.asarray(free_momenta, dtype=np.float64) / 2
    return np.asarray(-4.0 / ((half + 1) * (half + 2)))


def cumulant_noise(n: int, dim: int, order: Literal[2, 3] = 2) -> float:
    """Return the standard deviation of a2 or a3 of N independent Maxwellian particles.

    sqrt(8/(d(d+2)N)) for a2, sqrt(48/(d(d+2)(d+4)N)) for a3: the norms of the Sonine polynomials.
    """
    _check_dim(dim)
    if order == 2:
        return math.sqrt(8 / (dim * (dim + 2) * n))
    return math.sqrt(48 / (dim * (dim + 2) * (dim + 4) * n))


def equilibrium_h(dim: int, mass: float = 1.0, temperature: float = 1.0) -> float:
    """Return H_eq, the integral of f ln f for Maxwell-Boltzmann velocities: -(d/2)(1 + ln(2 pi kT/m))."""
    _check_dim(dim)
    return -dim / 2 * (1.0 + math.log(2.0 * math.pi * temperature / mass))


def ks_floor(n: int, dim: int) -> float:
    """Return the mean Kolmogorov-Smirnov distance of N equilibrium speeds from the Maxwell-Boltzmann law.

    0.715(5)/sqrt(N) in 3D, 0.735(5)/sqrt(N) in 2D, from 10 000 samples of N = 250 to 4000. Lower than the
    0.8687/sqrt(N) of independent draws, because the energy is conserved and the scale of the law is therefore
    that of the sample (the situation of Lilliefors' test).
    """
    _check_dim(dim)
    return (0.715 if dim == 3 else 0.735) / math.sqrt(n)


def sonine_rate(dim: int) -> float:
    """Return the decay rate of a small a2 per unit of s in the first Sonine approximation, 8/15 or 1/2.

    4(d-1)/(d(d+2)), 8/15 in 3D and 1/2 in 2D: the exact initial slope when a3 = 0 and a2 is small. It is not
    the rate of the late decay, see `near_equilibrium_rate`, nor of a start with equal speeds, see
    `boltzmann_equal_speeds`.
    """
    _check_dim(dim)
    return 4 * (dim - 1) / (dim * (dim + 2))


def near_equilibrium_rate(dim: int) -> Prediction:
    """Return the slowest isotropic relaxation rate per unit of s of the linearised Boltzmann equation.

    0.475(1) in 3D, 0.436(1) in 2D: limits of the Sonine eigenvalues .5333 .4944 .4829 .4784 .4765 .4756 (3D)
    and .5 .4594 .4464 .4411 .4386 .4373 (2D), exact quadratures at 1 to 6 polynomials.
    """
    _check_dim(dim)
    return Prediction(0.475 if dim == 3 else 0.436, 0.001)


# Relaxation from equal speeds -------------------------------------------------------------------------------

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
_INTERPOLATION = 1e-3  # of KS and of H, relative; of a2 and a3 it hides behind the tables' errors

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


def boltzmann_equal_speeds(s: ArrayLike, dim: int) -> EqualSpeedsRelaxation:
    """Return the relaxation of a dilute gas of one species from equal speeds in random directions.

    Valid for eta -> 0 and N -> infinity; to first order a finite density changes only the time per collision,
    not the curve against s. a2(0) = -2/(d+2) and the initial slopes da2/ds = 24/175 (3D), 32/225 (2D) are
    exact. The relative decay rate rises from 12/35 (3D), 64/225 (2D) towards that of `near_equilibrium_rate`:
    exp(-8s/15) is not this curve.

    Event-driven gases of 3e6 particles show how dilute is dilute: over 2 <= s <= 5 their a2 decayed at
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
    _check_dim(dim)
    points = np.atleast_1d(np.asarray(s, dtype=np.float64))
    _warn_outside("the Boltzmann relaxation from equal speeds", points, 0.0, 10.0)
    inside = (points >= 0.0) & (points <= 10.0)
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
        ends = ((1, slope), "not-a-knot") if slope is not None else "not-a-knot"
        spline = interpolate.CubicSpline(knots, np.log(np.abs(values)), bc_type=ends)
        return np.where(inside, np.exp(spline(points)), np.nan)

    a2 = -curve([0.0, *_S], [a2_start, *_A2[dim]], _INITIAL_SLOPE[dim] / a2_start)
    a3 = -curve([0.0, *_S], [a3_start, *_A3[dim]])
    ks = curve([0.0, *_S_FINE], [ks_start, *_KS[dim]])
    tabulated = points >= _S_FINE[0]
    h = np.where(tabulated, curve(_S_FINE, _H[dim]), np.where(points == 0.0, h_start, np.nan))
    lost = 1.0 - a2 / a2_start  # how much of the start is forgotten: the table's noise grows with it
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


def finite_size_relaxation(a2: ArrayLike, a2_start: float, free_momenta: float) -> Prediction:
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
    free_momenta : float
        D, see `equilibrium_a2`.
    """
    infinite = np.asarray(a2, dtype=np.float64)
    shift = (1.0 - infinite / a2_start) * equilibrium_a2(free_momenta)
    return Prediction(infinite + shift, np.abs(shift) / 2)
