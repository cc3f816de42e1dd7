"""Transport coefficients of Enskog's theory, and the effect of a periodic box on diffusion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.collisions import collision_rate, quadrature
from analysis.theory.mixtures import mixture_contact_values
from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside, packing_fraction
from analysis.theory.state import contact_value

__all__ = [
    "bulk_viscosity",
    "enskog_diffusion",
    "heat_conductivity",
    "mutual_diffusion",
    "periodic_diffusion_correction",
    "periodic_diffusion_window",
    "shear_viscosity",
    "velocity_correlation_rate",
]

FloatArray = NDArray[np.float64]

# Converged Sonine expansions over the first term, by exact quadrature: diffusion, viscosity, conductivity.
_DIFFUSION = {3: 1.018954, 2: 1.02709}
_VISCOSITY = {3: 1.016034, 2: 1.02197}
_CONDUCTIVITY = {3: 1.02522, 2: 1.02972}
ENSKOG_RANGE = {3: (0.0, 0.494), 2: (0.0, 0.66)}
"""Packing fractions of the fluid, for which Enskog's coefficients are given; NaN outside."""
_YEH_HUMMER = 2.837297  # cubic lattice sum
# Of the infinite fluid of spheres, over Enskog's, as simulations found it at these packing fractions. D: this
# package, 64 to 16 384 spheres; public molecular dynamics (macioosch/dynamo-hard-spheres-sim) at 0.157 and
# 0.367. Viscosity: from the dependence of D on the box in the same runs. Last: the further reduction of D in
# a box of N particles, in units of D_E/N.
_TRUE_D = (
    (0.0, 0.1, 0.157, 0.2, 0.3, 0.367, 0.4, 0.47, 0.494),
    (1.0, 1.096, 1.19, 1.26, 1.34, 1.27, 1.17, 0.79, 0.65),
)
_TRUE_VISCOSITY = ((0.3, 0.367, 0.4, 0.47, 0.494), (1.0, 1.09, 1.14, 1.65, 1.9))
_BESIDES = ((0.1, 0.2, 0.3), (1.5, 1.2, 0.8))


def _density(eta: ArrayLike, dim: int, diameter: float) -> FloatArray:
    return np.asarray(np.asarray(eta, dtype=np.float64) / packing_fraction(1.0, diameter, dim))


def enskog_diffusion(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> Prediction:
    """Return Enskog's coefficient of self-diffusion D_E, [length^2/time].

    D_E = 3/(8 rho sigma^2 chi) sqrt(kT/pi m) x 1.018954 in 3D, 1/(2 rho sigma chi) sqrt(kT/pi m) x 1.02709 in
    2D (Chapman and Cowling, chapters 10 and 16; the factors are the converged Sonine series). Infinite at eta
    = 0.

    Parameters
    ----------
    eta : array_like
        Packing fraction; established up to 0.494 (3D), 0.66 (2D), NaN beyond.
    dim : {2, 3}
        Dimension d.
    diameter, mass, temperature : float
        sigma, m and kT.

    Returns
    -------
    Prediction
        Enskog leaves out correlated collisions. In the infinite 3D fluid the true D is 9.6 % above D_E at eta
        = 0.1, 26 % at 0.2, 34 % at 0.3, and falls below it near freezing, by 21 % at 0.47: u = min(1.5 eta,
        0.3) D_E. In 2D D has no limit, it grows as the logarithm of the size of the box; the same u is given
        but has no firm basis.
    """
    check_dim(dim)
    e = np.asarray(eta, dtype=np.float64)
    e = only_inside(e, inside_range("Enskog's theory", e, *ENSKOG_RANGE[dim]))
    rho = _density(e, dim, diameter)
    prefactor = 3 / 8 if dim == 3 else 1 / 2
    with np.errstate(divide="ignore"):
        value = (
            prefactor
            / (rho * diameter ** (dim - 1) * contact_value(e, dim))
            * math.sqrt(temperature / (math.pi * mass))
            * _DIFFUSION[dim]
        )
    return Prediction(value, np.minimum(1.5 * e, 0.3) * value)


def shear_viscosity(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> Prediction:
    """Return Enskog's shear viscosity, [mass length^(2-d)/time].

    eta_E = eta_0 b (1/y + 4/5 + 0.7615 y) in 3D, eta_0 b (1/y + 1 + 0.8729 y) in 2D; b = 2^(d-1) eta, y = b
    chi = Z - 1; eta_0 = (5/16 sigma^2) sqrt(m kT/pi) x 1.016034 in 3D, (1/2 sigma) sqrt(m kT/pi) x 1.02197 in
    2D (Chapman and Cowling, chapter 16; 2D: Gass, J. Chem. Phys. 54, 1898 (1971), doi 10.1063/1.1675116).

    Parameters
    ----------
    eta, dim, diameter, mass, temperature
        As in `enskog_diffusion`.

    Returns
    -------
    Prediction
        u = 10 % up to eta = 0.4, where it was compared with simulation; above that it is too small by up to a
        factor of 2 near freezing, and u = 50 %. At eta = 0 the value of the dilute gas, exact.
    """
    first = 5 / (16 * diameter**2) if dim == 3 else 1 / (2 * diameter)
    dilute = first * math.sqrt(mass * temperature / math.pi) * _VISCOSITY.get(dim, math.nan)
    linear, square = (0.8, 0.7615) if dim == 3 else (1.0, 0.8729)
    return _dense(eta, dim, dilute, linear, square)


def heat_conductivity(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> Prediction:
    """Return Enskog's heat conductivity (k_B = 1), [length^(2-d)/time].

    lambda_E = lambda_0 b (1/y + 6/5 + 0.7574 y) in 3D, lambda_0 b (1/y + 3/2 + 0.8716 y) in 2D; lambda_0 =
    (75/64 sigma^2) sqrt(kT/pi m) x 1.02522 in 3D, (2/sigma) sqrt(kT/pi m) x 1.02972 in 2D. Sources and
    arguments as in `shear_viscosity`, the uncertainty as there.
    """
    first = 75 / (64 * diameter**2) if dim == 3 else 2 / diameter
    dilute = first * math.sqrt(temperature / (math.pi * mass)) * _CONDUCTIVITY.get(dim, math.nan)
    linear, square = (1.2, 0.7574) if dim == 3 else (1.5, 0.8716)
    return _dense(eta, dim, dilute, linear, square)


def _dense(eta: ArrayLike, dim: int, dilute: float, linear: float, square: float) -> Prediction:
    """Enskog's increase with density: dilute x (1/chi + linear b + square b^2 chi)."""
    check_dim(dim)
    e = np.asarray(eta, dtype=np.float64)
    e = only_inside(e, inside_range("Enskog's theory", e, *ENSKOG_RANGE[dim]))
    chi, b = contact_value(e, dim), 2.0 ** (dim - 1) * e
    value = dilute * (1 / chi + linear * b + square * b**2 * chi)
    relative = np.where(e > 0.4, 0.5, np.minimum(e, 0.1))
    return Prediction(value, relative * value)


def bulk_viscosity(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> Prediction:
    """Return Enskog's bulk viscosity rho m nu sigma^2/d^2, [mass length^(2-d)/time].

    (4 sqrt(pi)/9) rho^2 sigma^4 chi sqrt(m kT) in 3D, (sqrt(pi)/2) rho^2 sigma^3 chi sqrt(m kT) in 2D. Source
    and arguments as in `shear_viscosity`; u = 10 %.
    """
    rate = collision_rate(eta, dim, diameter, mass, temperature)
    value = _density(eta, dim, diameter) * mass * rate * diameter**2 / dim**2
    return Prediction(value, 0.1 * value)


def mutual_diffusion(
    number_densities: ArrayLike,
    diameters: ArrayLike,
    masses: ArrayLike,
    dim: int,
    temperature: float = 1.0,
) -> Prediction:
    """Return Enskog's coefficient of mutual diffusion of two species, that of Maxwell and Stefan.

    D_12 = 3/(8 rho sigma_12^2 chi_12) sqrt(kT/2 pi mu) in 3D, 1/(2 rho sigma_12 chi_12) sqrt(kT/2 pi mu) in
    2D: the first Sonine term (Chapman and Cowling, chapters 9 and 16), with the exact initial decay rate of
    the relative current. mu is the reduced mass, sigma_12 the mean diameter, rho that of all particles. The
    flux is driven by chemical potentials; Fick's coefficient is this one times the thermodynamic factor.

    Parameters
    ----------
    number_densities, diameters, masses : (2,) array_like
        Of each species.
    dim : {2, 3}
        Dimension d.
    temperature : float
        kT.

    Returns
    -------
    Prediction
        [length^2/time]. NaN above freezing. u: further Sonine terms add between 2 % (equal masses) and 13 %
        (light particles among heavy ones), in quadrature with what `enskog_diffusion` leaves out.
    """
    rho, sigma, m = (np.asarray(each, dtype=np.float64) for each in (number_densities, diameters, masses))
    if not rho.shape == sigma.shape == m.shape == (2,):
        raise ValueError("mutual diffusion is of two species; give two densities, diameters and masses")
    chi = float(mixture_contact_values(rho, sigma, dim)[0, 1])
    reduced, between = float(m[0] * m[1] / m.sum()), 0.5 * float(sigma.sum())
    value = (3 / 8 if dim == 3 else 1 / 2) / (float(rho.sum()) * between ** (dim - 1) * chi)
    value *= math.sqrt(temperature / (2 * math.pi * reduced)) * _DIFFUSION[dim]
    eta = float(np.sum(packing_fraction(rho, sigma, dim)))
    unequal = 0.1 * abs(float(m[0] - m[1])) / float(m.sum())
    return Prediction(value, math.hypot(min(1.5 * eta, 0.3), unequal) * value)


def velocity_correlation_rate(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> FloatArray:
    """Return the initial decay rate of <v(0).v(t)>/<v^2>, (2/d) nu, [1/time].

    Exact at any density given chi, since a particle loses <g_n^2>/2 = 2kT/m of its v.v(t) in its first
    collision. Enskog's theory has the correlation go on as exp(-(2/d) nu t) to within 3 % of its integral;
    the true one has a slow tail, t^(-d/2).

    Parameters
    ----------
    eta, dim, diameter, mass, temperature
        As in `enskog_diffusion`.
    """
    return np.asarray(2.0 / dim * collision_rate(eta, dim, diameter, mass, temperature))


def periodic_diffusion_window(
    eta: float,
    box_length: float,
    diameter: float = 1.0,
    mass: float = 1.0,
    temperature: float = 1.0,
) -> tuple[float, float]:
    """Return the lags where the slope of the mean square displacement is D of a cubic periodic box, [time].

    4 to 6 times the larger of five mean free times and L^2/(4 pi^2 (D + nu)), the decay time of the slowest
    mode of the momentum that a sphere transfers to the fluid, nu = eta_s/(rho m) and D by Enskog. Earlier
    slopes are too small in a large box: they leave out part of the tail t^(-3/2) of the velocity
    autocorrelation.

    Parameters
    ----------
    eta, box_length, diameter, mass, temperature
        As in `periodic_diffusion_correction`.
    """
    spread = float(enskog_diffusion(eta, 3, diameter, mass, temperature).value)
    spread += float(shear_viscosity(eta, 3, diameter, mass, temperature).value) / _mass_density(
        eta, diameter, mass
    )
    slowest = box_length**2 / (4.0 * math.pi**2 * spread)
    scale = max(5.0 / float(collision_rate(eta, 3, diameter, mass, temperature)), slowest)
    return 4.0 * scale, 6.0 * scale


def periodic_diffusion_correction(
    eta: float,
    box_length: float,
    diameter: float = 1.0,
    mass: float = 1.0,
    temperature: float = 1.0,
    window: tuple[float, float] | None = None,
) -> Prediction:
    """Return what to add to D measured in a cubic periodic box to have that of the infinite fluid.

    D = D_L + 2.837297 kT / (6 pi L (eta_s + rho m D)) + b D_E / N, in 3D only: in 2D there is no infinite
    limit. The second term is that of Yeh and Hummer (J. Phys. Chem. B 108, 15873 (2004), doi
    10.1021/jp0477147) extended to particles that diffuse as fast as momentum does: in a mode k of the flow
    that a particle has caused, its velocity decays as exp(-(D + nu) k^2 t), nu = eta_s/(rho m); they assumed
    D << nu. The last term is a further correction for boxes of a few hundred particles: b = 1.5 up to eta =
    0.1, 1.2 at 0.2, 0.8 from 0.3 on. With both, boxes of 64 to 16 384 spheres give the same D to 0.2 % at eta
    = 0.1, 0.2 and 0.3.

    D_L is the slope of the mean square displacement over `periodic_diffusion_window`. What a shorter window,
    or one in a larger box, leaves out of the tail is added by the same modes: (2 kT tau / 3 m N) times the
    sum of exp(-n^2 t/tau) / n^2 over all integer vectors n but 0, averaged over the window, tau = L^2/(4 pi^2
    (D + nu)).

    Parameters
    ----------
    eta : float
        Packing fraction.
    box_length : float
        L [length].
    diameter, mass, temperature : float
        sigma, m and kT.
    window : (float, float), optional
        Lags of the slope [time]; `periodic_diffusion_window` by default.

    Returns
    -------
    Prediction
        The second term uses the D and the viscosity of simulations: Enskog's D times 1.096 at eta = 0.1, 1.26
        at 0.2, 1.34 at 0.3, 0.79 at 0.47; Enskog's viscosity up to 0.3, 1.14 times it at 0.4, 1.65 at 0.47.
        u: 3 % of it up to eta = 0.3, growing to 20 % at 0.494; a third of the last term; and of what the
        window leaves out 5/s and 16 % more (50 % at 0.494), s the mean free times before it.
    """
    density = _mass_density(eta, diameter, mass)
    enskog = float(enskog_diffusion(eta, 3, diameter, mass, temperature).value)
    viscosity = float(shear_viscosity(eta, 3, diameter, mass, temperature).value)
    viscosity *= float(np.interp(eta, *_TRUE_VISCOSITY))
    spread = float(np.interp(eta, *_TRUE_D)) * enskog + viscosity / density
    box = _YEH_HUMMER * temperature / (6 * math.pi * box_length * density * spread)
    few = float(np.interp(eta, *_BESIDES)) * enskog * mass / (density * box_length**3)
    tau = box_length**2 / (4 * math.pi**2 * spread)
    begin, end = window or periodic_diffusion_window(eta, box_length, diameter, mass, temperature)
    tail = box * _left_out(begin / tau, end / tau) / (math.pi * _YEH_HUMMER)
    relative = float(np.interp(eta, (0.3, 0.494), (0.03, 0.2)))
    early = 0.1 + 2 * relative + 5 / (begin * float(collision_rate(eta, 3, diameter, mass, temperature)))
    return Prediction(box + few + tail, math.hypot(relative * box, few / 3, tail * early))


def _mass_density(eta: float, diameter: float, mass: float) -> float:
    return float(_density(eta, 3, diameter)) * mass


def _left_out(begin: float, end: float) -> float:
    """Return the mean over t of the sum of exp(-n^2 t)/n^2 over all integer vectors n but 0.

    For small t by Poisson's rule: -2.837297 pi + 2 pi^(3/2)/sqrt(t) + t, good to 1e-5 below 0.7.
    """
    nodes, weights = quadrature()
    t = begin + (end - begin) * nodes
    squares = np.arange(-6, 7) ** 2
    many = np.bincount(np.add.outer(np.add.outer(squares, squares), squares).ravel())[1:37]
    n2 = np.arange(1.0, 37.0)
    late = np.exp(-np.multiply.outer(t, n2)) @ (many / n2)
    early = t + 2 * math.pi**1.5 / np.sqrt(t) - math.pi * _YEH_HUMMER
    return float(weights @ np.where(t < 0.7, early, late))
