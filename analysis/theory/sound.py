"""Sound: its speed and damping in a fluid, and the decay of standing waves between walls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from analysis.theory.prediction import Prediction, packing_fraction
from analysis.theory.state import compressibility_factor, compressibility_slope
from analysis.theory.transport import bulk_viscosity, heat_conductivity, shear_viscosity

__all__ = ["momentum_correlation", "sound_damping", "sound_speed", "virial_correlation"]

WAVES = 64  # standing waves that are summed


def sound_speed(eta: ArrayLike, dim: int, mass: float = 1.0, temperature: float = 1.0) -> Prediction:
    """Return the speed of sound c, c^2 = (kT/m) (Z + eta Z' + (2/d) Z^2), [length/time].

    Thermodynamics: (dP/drho)_S/m of a fluid whose energy is kinetic, d kT/2 per particle.

    Parameters
    ----------
    eta : array_like
        Packing fraction; established up to 0.54 (3D), 0.66 (2D).
    dim : {2, 3}
        Dimension d.
    mass, temperature : float
        m and kT.

    Returns
    -------
    Prediction
        Z by `compressibility_factor`, and u from its relative uncertainty.
    """
    z = compressibility_factor(eta, dim)
    isothermal = z.value + np.asarray(eta, dtype=np.float64) * compressibility_slope(eta, dim)
    value = np.sqrt(temperature / mass * (isothermal + 2.0 / dim * z.value**2))
    return Prediction(value, z.uncertainty / z.value * value)


def sound_damping(
    eta: ArrayLike, dim: int, diameter: float = 1.0, mass: float = 1.0, temperature: float = 1.0
) -> Prediction:
    """Return Gamma; a wave of wave number k decays as exp(-Gamma k^2 t), [length^2/time].

    Gamma = [(2 (1 - 1/d) eta_E + zeta_E)/(rho m) + (gamma - 1) lambda_E/(rho c_P)]/2 with Enskog's transport
    coefficients, c_V = d/2, gamma = c_P/c_V = 1 + (2/d) Z^2/(Z + eta Z') (Hansen and McDonald, Theory of
    Simple Liquids, 8.5, doi 10.1016/C2010-0-66723-X). Infinite at eta = 0.

    Parameters
    ----------
    eta, dim, diameter, mass, temperature
        As in `sound_speed`, `shear_viscosity`.

    Returns
    -------
    Prediction
        u as the relative uncertainty of the viscosity; for waves that are long beside the mean free path.
    """
    e = np.asarray(eta, dtype=np.float64)
    rho = e / packing_fraction(1.0, diameter, dim)
    z = compressibility_factor(e, dim).value
    gamma = 1.0 + 2.0 / dim * z**2 / (z + e * compressibility_slope(e, dim))
    shear, bulk = (f(e, dim, diameter, mass, temperature) for f in (shear_viscosity, bulk_viscosity))
    heat = heat_conductivity(e, dim, diameter, mass, temperature).value
    with np.errstate(divide="ignore"):
        viscous = (2.0 * (1.0 - 1.0 / dim) * shear.value + bulk.value) / (rho * mass)
        value = 0.5 * (viscous + (gamma - 1.0) * heat / (rho * gamma * dim / 2.0))
    return Prediction(value, shear.uncertainty / shear.value * value)


def _left(time: float, k: ArrayLike, share: ArrayLike, speed: float, damping: float) -> float:
    """Return the share of standing waves that is left after a time; no decay rate exceeds c k."""
    waves, shares = np.asarray(k, dtype=np.float64), np.asarray(share, dtype=np.float64)
    fall = np.minimum(damping * waves**2, speed * waves)
    left = shares * np.exp(-fall * time) * np.cos(speed * waves * time)
    return float(left.sum() / shares.sum())


def virial_correlation(time: float, width: float, speed: float, damping: float) -> float:
    """Return the autocorrelation of G = sum of m x v, x from the middle between two walls, after a time.

    G is a sum of standing waves sin(2 pi n x / L) with variances as 1/n^2, each a damped oscillation: sum of
    6/(pi n)^2 cos(c k t) exp(-Gamma k^2 t), k = 2 pi n/L. Undamped it falls to -1/2, after half the time that
    sound takes from wall to wall.

    Parameters
    ----------
    time : float
        t >= 0.
    width : float
        L, how far centres can go from one wall to the other.
    speed, damping : float
        c and Gamma.
    """
    n = np.arange(1, WAVES + 1)
    return _left(time, 2.0 * math.pi * n / width, 1.0 / n**2, speed, damping)


def momentum_correlation(time: float, width: float, speed: float, damping: float) -> float:
    """Return the autocorrelation of the momentum from wall to wall after a time.

    As `virial_correlation`, with waves sin(pi n x / L), n odd. Undamped it is -1 after the time that sound
    takes from wall to wall.
    """
    n = np.arange(1, 2 * WAVES, 2)
    return _left(time, math.pi * n / width, 1.0 / n**2, speed, damping)
