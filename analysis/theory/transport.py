"""Transport coefficients of Enskog's theory, and what a periodic box does to diffusion."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.collisions import collision_rate
from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside, packing_fraction
from analysis.theory.state import contact_value

__all__ = [
    "bulk_viscosity",
    "enskog_diffusion",
    "heat_conductivity",
    "periodic_diffusion_correction",
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
        Enskog leaves out correlated collisions. In the infinite 3D fluid the true D is 12 % above D_E at eta
        = 0.1 and 30 % at 0.2, and falls below it near freezing: u = min(1.5 eta, 0.3) D_E. In 2D D has no
        limit, it grows as the logarithm of the size of the box; the same u is given and means little.
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


def periodic_diffusion_correction(
    eta: ArrayLike,
    box_length: float,
    diameter: float = 1.0,
    mass: float = 1.0,
    temperature: float = 1.0,
) -> Prediction:
    """Return what to add to D measured in a cubic periodic box to have that of the infinite fluid.

    D = D_L + 2.837297 kT / (6 pi eta_s L) (Yeh and Hummer, J. Phys. Chem. B 108, 15873 (2004), doi
    10.1021/jp0477147) with Enskog's shear viscosity eta_s. In 3D only: in 2D there is no infinite limit.
    Measured at eta = 0.2 it brings N = 32 to 500 together to 1 %.

    Parameters
    ----------
    eta : array_like
        Packing fraction.
    box_length : float
        L [length].
    diameter, mass, temperature : float
        sigma, m and kT.

    Returns
    -------
    Prediction
        u from that of the viscosity.
    """
    viscosity = shear_viscosity(eta, 3, diameter, mass, temperature)
    value = _YEH_HUMMER * temperature / (6 * math.pi * viscosity.value * box_length)
    return Prediction(value, value * viscosity.uncertainty / viscosity.value)
