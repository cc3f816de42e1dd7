"""Equations of state of the hard-sphere and hard-disc fluid, infinite and of N particles."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside

__all__ = [
    "carnahan_starling",
    "compressibility_factor",
    "compressibility_slope",
    "contact_value",
    "fcc_crystal",
    "finite_size_compressibility",
    "finite_size_shift",
    "henderson",
    "kolafa_labik_malijevsky",
    "virial_coefficients",
    "virial_discs",
    "virial_series",
]

FloatArray = NDArray[np.float64]
Ensemble = Literal["microcanonical", "canonical"]

_KLM = Polynomial(
    [1, 4, 6, 2.3647684, -0.8698551, 1.1062803, -1.1014221, 0.66605866, -0.03633431, 0]
    + [-0.20965164, 0, 0, 0, 0.10555569, 0, 0, 0, 0, 0, 0, 0, -0.00872380]
)
_DISCS = Polynomial(
    [1, 0, 0.12801774, 0.00181891, -0.05079442, -0.05297888, -0.03716416, -0.0216544, -0.014208, -0.0088832]
)
# B_n / B_2^(n-1) for n = 3 to 10 with the uncertainty in the last digits: Clisby and McCoy 2006, Table 1.
_REDUCED_VIRIALS = {
    3: [0.625, 0.2869495, 0.110252, 0.03888198, 0.01302354, 0.0041832, 0.0013094, 0.0004035],
    2: [0.78200443, 0.53223180, 0.33355604, 0.1988425, 0.1148728, 0.0649930, 0.0362193, 0.0199537],
}
_REDUCED_ERRORS = {
    3: [0.0, 0.0, 1e-6, 9.1e-7, 9.1e-7, 1.1e-6, 1.3e-6, 1.5e-6],
    2: [0.0, 0.0, 1e-8, 4.2e-6, 4.3e-6, 3.4e-6, 3.5e-6, 8.0e-6],
}
_EXACT_B4 = {
    3: (2707 * math.pi + 438 * math.sqrt(2) - 4131 * math.acos(1 / 3)) / (70 * math.pi),
    2: 16 - 36 * math.sqrt(3) / math.pi + 80 / math.pi**2,
}
_EXACT_B3 = {3: 10.0, 2: 16 / 3 - 4 * math.sqrt(3) / math.pi}
# Effect on Z - 1 of correlations between a particle and its periodic images: an envelope of simulations of 3
# to 256 particles at an edge of two diameters, and its decay per further diameter, by packing fraction.
_IMAGES = {3: 0.4, 2: 0.6}
_IMAGES_DECAY = {
    3: ((0.05, 0.1, 0.2, 0.3, 0.4, 0.45, 0.49), (4.0, 3.3, 2.6, 2.1, 1.6, 1.2, 1.0)),
    2: ((0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.65), (3.5, 3.0, 2.5, 2.0, 1.5, 0.95, 0.8)),
}
_KLM_RANGE = (0.0, 0.54)
_DISCS_RANGE = (0.0, 0.66)
_SERIES_RANGE = {3: (0.0, 0.5), 2: (0.0, 0.6)}
# Relative uncertainty of KLM: up to eta = 0.471 pooled simulations of 4e5 to 2e6 spheres agree to 0.4e-6 to
# 2.4e-6 (DynamO, github.com/macioosch/dynamo-hard-spheres-sim); beyond, what its authors state.
_KLM_VERIFIED_TO, _KLM_VERIFIED, _KLM_STATED = 0.471, 5e-6, 4e-5
# fcc crystal: Schultz and Kofke's fit, Z = 3/y + sum of c_i y^i with y = 1 - rho sigma^3/sqrt(2).
_FCC = Polynomial(
    [-0.4338711486444215, 0.390812049911003, 0.595451683236023, 18.59059648880398, -288.1675745716088]
    + [3206.943027086472, -21037.60905875148, 83177.92071175583, -180636.7967218044, 170205.791013758]
)
_FCC_RANGE = (0.5432, 0.7404)  # melting to just below close packing


def carnahan_starling(eta: ArrayLike) -> FloatArray:
    """Return Carnahan and Starling's Z = (1 + eta + eta^2 - eta^3)/(1 - eta)^3 of hard spheres.

    J. Chem. Phys. 51, 635 (1969), doi 10.1063/1.1672048. Off by up to 0.29 % (at eta = 0.37) against
    `kolafa_labik_malijevsky`; kept because everyone knows it.
    """
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("Carnahan and Starling's equation of state", e, *_KLM_RANGE)
    with np.errstate(divide="ignore"):
        return only_inside((1 + e + e**2 - e**3) / (1 - e) ** 3, inside)


def henderson(eta: ArrayLike) -> FloatArray:
    """Return Henderson's Z = (1 + eta^2/8)/(1 - eta)^2 of hard discs.

    Mol. Phys. 30, 971 (1975), doi 10.1080/00268977500102511. Against `virial_discs` off by 0.13 % at eta =
    0.4, 0.45 % at 0.5, 1.2 % at 0.6; kept because everyone knows it.
    """
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("Henderson's equation of state", e, *_DISCS_RANGE)
    with np.errstate(divide="ignore"):
        return only_inside((1 + e**2 / 8) / (1 - e) ** 2, inside)


def virial_coefficients(dim: int) -> Prediction:
    """Return b_2 to b_10 of Z = 1 + sum over n >= 2 of b_n eta^(n-1), with their uncertainties.

    b_n = (2^(d-1))^(n-1) B_n/B_2^(n-1). b_2 = 2^(d-1), b_3 and b_4 are exact, the others Monte Carlo
    integrals of Clisby and McCoy, J. Stat. Phys. 122, 15 (2006), doi 10.1007/s10955-005-8080-0.

    Parameters
    ----------
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        value and uncertainty of shape (9,).
    """
    check_dim(dim)
    powers = 2.0 ** ((dim - 1) * np.arange(2, 10))
    value = np.append(2.0 ** (dim - 1), powers * np.array(_REDUCED_VIRIALS[dim]))
    value[1], value[2] = _EXACT_B3[dim], _EXACT_B4[dim]
    return Prediction(value, np.append(0.0, powers * np.array(_REDUCED_ERRORS[dim])))


def virial_series(eta: ArrayLike, dim: int, order: int = 10) -> Prediction:
    """Return Z from the virial series cut after B_order.

    Parameters
    ----------
    eta : array_like
        Packing fraction; beyond 0.5 (3D) or 0.6 (2D) the terms left out are no longer a correction, and the
        result is NaN.
    dim : {2, 3}
        Dimension d.
    order : int, default 10
        Last coefficient taken, 3 to 10.

    Returns
    -------
    Prediction
        u combines the coefficients' uncertainties and the terms left out, taken as a geometric series that
        goes on with the ratio of the last two coefficients; all of that series is counted as uncertainty, and
        the value is too low by about it.

    Raises
    ------
    ValueError
        If `order` is not one of 3 to 10.
    """
    if not 3 <= order <= 10:
        raise ValueError(f"order = {order}; virial coefficients are known here from 3 to 10")
    b = virial_coefficients(dim)
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("the virial series", e, *_SERIES_RANGE[dim])
    terms = e[..., None] ** np.arange(1, order)
    value = 1.0 + terms @ b.value[: order - 1]
    noise = np.sqrt(terms**2 @ b.uncertainty[: order - 1] ** 2)
    ratio = np.minimum(b.value[order - 2] / b.value[order - 3] * e, 0.99)
    left_out = b.value[order - 2] * terms[..., -1] * ratio / (1.0 - ratio)
    return Prediction(only_inside(value, inside), only_inside(np.hypot(noise, left_out), inside))


def kolafa_labik_malijevsky(eta: ArrayLike) -> FloatArray:
    """Return Z of the hard-sphere fluid after Kolafa, Labik and Malijevsky.

    Phys. Chem. Chem. Phys. 6, 2335 (2004), doi 10.1039/B402792B. A polynomial in x = eta/(1 - eta) with the
    virial coefficients up to B6 imposed; stated inaccuracy 4e-5 relative up to rho sigma^3 = 1.03 (eta =
    0.54), the metastable branch above freezing (0.492) included; NaN beyond.
    """
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("the hard-sphere equation of state", e, *_KLM_RANGE)
    return only_inside(_KLM(np.where(inside, e, 0.0) / (1 - np.where(inside, e, 0.0))), inside)


def virial_discs(eta: ArrayLike) -> FloatArray:
    """Return Z = p(eta)/(1 - eta)^2 of the hard-disc fluid, p fixed by the virial coefficients up to B10.

    Coefficients: Clisby and McCoy, J. Stat. Phys. 122, 15 (2006), doi 10.1007/s10955-005-8080-0, resummed
    about the pole at eta = 1. Its uncertainty is in `compressibility_factor`; NaN above eta = 0.66, where the
    fluid ends.
    """
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("the hard-disc equation of state", e, *_DISCS_RANGE)
    with np.errstate(divide="ignore"):
        return only_inside(_DISCS(e) / (1 - e) ** 2, inside)


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
        NaN outside that range. 3D: `kolafa_labik_malijevsky`, u = 5e-6 Z up to eta = 0.471, 4e-5 Z beyond.
        2D: `virial_discs`, u the largest distance to the formulas of Luding (2001, doi
        10.1103/PhysRevE.63.042201) and of Liu (2020), both fitted to simulations: 6e-4 relative at 0.45, 5e-3
        at 0.65. In dilute gases u is what `virial_series` leaves open, where that is less: it vanishes with
        the density faster than Z - 1.
    """
    check_dim(dim)
    e = np.asarray(eta, dtype=np.float64)
    if dim == 3:
        value = kolafa_labik_malijevsky(e)
        uncertainty = np.where(e <= _KLM_VERIFIED_TO, _KLM_VERIFIED, _KLM_STATED) * value
    else:
        value = virial_discs(e)
        with np.errstate(divide="ignore", invalid="ignore"):
            luding = 1 + 2 * e * ((1 - 7 * e / 16) / (1 - e) ** 2 - (e**3 / 16) / (8 * (1 - e) ** 4))
            liu = (1 + e**2 / 8 + e**3 / 18 - 4 * e**4 / 21) / (1 - e) ** 2
            uncertainty = np.maximum(np.abs(luding - value), np.abs(liu - value))
    dilute = np.where((e >= 0.0) & (e <= _SERIES_RANGE[dim][1]), e, np.nan)
    series = virial_series(dilute, dim)  # NaN beyond its range
    return Prediction(value, np.fmin(uncertainty, np.abs(series.value - value) + series.uncertainty))


def fcc_crystal(eta: ArrayLike) -> Prediction:
    """Return Z of the face-centred cubic crystal of hard spheres, without vacancies.

    Fit of Schultz and Kofke to simulations, from the source of etomica (HardSphereSolid). Z (1 - eta/eta_cp)
    tends to 3 at close packing.

    Parameters
    ----------
    eta : array_like
        Packing fraction, 0.543 (melting) to 0.7404; NaN outside.

    Returns
    -------
    Prediction
        u = 2e-4 Z: Speedy's formula (1998) is within 1.7e-4 of it.
    """
    e = np.asarray(eta, dtype=np.float64)
    inside = inside_range("the equation of state of the fcc crystal", e, *_FCC_RANGE)
    y = 1.0 - np.where(inside, e, 0.6) * 6.0 / (math.pi * math.sqrt(2.0))
    value = only_inside(3.0 / y + _FCC(y), inside)
    return Prediction(value, 2e-4 * value)


def contact_value(eta: ArrayLike, dim: int) -> FloatArray:
    """Return chi = g(sigma+) = (Z - 1)/(2^(d-1) eta), the pair distribution at contact, infinite system.

    At eta = 0 it is 1; the relative uncertainty is that of Z - 1.
    """
    e = np.asarray(eta, dtype=np.float64)
    excess = compressibility_factor(e, dim).value - 1.0
    volume = 2.0 ** (dim - 1) * e
    return np.asarray(np.where(e == 0, 1.0, excess / np.where(e == 0, 1.0, volume)))


def compressibility_slope(eta: ArrayLike, dim: int) -> FloatArray:
    """Return dZ/deta of `compressibility_factor`, NaN outside its range."""
    check_dim(dim)
    return _slope_and_curvature(np.asarray(eta, dtype=np.float64), dim)[0]


def _slope_and_curvature(eta: FloatArray, dim: int) -> tuple[FloatArray, FloatArray]:
    low, high = _KLM_RANGE if dim == 3 else _DISCS_RANGE
    e = np.where((eta >= low) & (eta <= high), eta, np.nan)
    if dim == 3:
        x = e / (1 - e)
        slope = _KLM.deriv()(x) * (1 + x) ** 2
        curvature = _KLM.deriv(2)(x) * (1 + x) ** 4 + 2 * _KLM.deriv()(x) * (1 + x) ** 3
    else:
        p, p1, p2 = _DISCS(e), _DISCS.deriv()(e), _DISCS.deriv(2)(e)
        slope = p1 / (1 - e) ** 2 + 2 * p / (1 - e) ** 3
        curvature = p2 / (1 - e) ** 2 + 4 * p1 / (1 - e) ** 3 + 6 * p / (1 - e) ** 4
    return np.asarray(slope), np.asarray(curvature)


def finite_size_compressibility(
    eta: ArrayLike,
    dim: int,
    n: int,
    ensemble: Ensemble = "microcanonical",
    edge: float | None = None,
) -> Prediction:
    """Return Z of N particles in a periodic box: `compressibility_factor` plus `finite_size_shift`.

    Parameters
    ----------
    eta, dim, n, ensemble, edge
        As in `finite_size_shift`.

    Returns
    -------
    Prediction
        u of both; that of the shift alone where that is exact for any N, for two and three particles.
    """
    infinite = compressibility_factor(eta, dim)
    shift = finite_size_shift(eta, dim, n, ensemble, edge)
    exact = np.asarray(shift.uncertainty) == 0.0
    return Prediction(
        infinite.value + shift.value,
        np.where(exact, 0.0, np.hypot(infinite.uncertainty, shift.uncertainty)),
    )


def finite_size_shift(
    eta: ArrayLike,
    dim: int,
    n: int,
    ensemble: Ensemble = "microcanonical",
    edge: float | None = None,
) -> Prediction:
    """Return Z of N particles in a periodic box, less that of the infinite fluid.

    Canonical: Z_N = Z - (rho/2N) d ln[d(rho Z)/d rho]/d rho (Lebowitz and Percus, Phys. Rev. 124, 1673
    (1961), doi 10.1103/PhysRev.124.1673). Microcanonical with total momentum zero, kT = 2K/d(N-1), Z = P
    V/(2K/d): Z - 1 = (N/(N-1)) (Z_N - 1), which is what an event-driven simulation measures. To leading order
    in eta the two steps cancel.

    Two and three particles are treated exactly, as long as no box edge is shorter than N diameters: with y =
    v0/V, v0 the volume from which a particle excludes another's centre, the configurations are Q = 1 - y for
    two and 1 - 3y + (3 - 3 B3/v0^2) y^2 for three, and Z_N = 1 - (y/N) d ln Q/dy. So Z = 1 + v0/(V - v0) for
    two, microcanonically.

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
    edge : float, optional
        Shortest edge of the box, in diameters; that of a cube or square by default.

    Returns
    -------
    Prediction
        u = 0 for two and three particles as above. Otherwise what the formula leaves out: the next order in
        1/N, a part sqrt(0.1^2 + (0.6/N)^2) of the shift (at low density 4 to 16 particles lack 0.6/N of it);
        and the effect of correlations between a particle and its own images, where the box is small and the
        fluid dense: (Z - 1) A exp(-k (L - 2)), L the edge in diameters, an envelope of what simulations of 3
        to 256 particles show. In 3D A = 0.4, k = 3.3 at eta = 0.1, 2.1 at 0.3, 1.0 at 0.49; in 2D A = 0.6, k
        = 2.5 at 0.3, 0.95 at 0.6.
    """
    infinite = compressibility_factor(eta, dim)
    e = np.asarray(eta, dtype=np.float64)
    slope, curvature = _slope_and_curvature(e, dim)
    inverse_compressibility = infinite.value + e * slope
    canonical = infinite.value - e / (2 * n) * (2 * slope + e * curvature) / inverse_compressibility
    shift = _in_ensemble(canonical, n, ensemble) - infinite.value
    with np.errstate(divide="ignore", invalid="ignore"):
        edges = np.asarray((math.pi / (2 * dim) * n / e) ** (1 / dim) if edge is None else edge)
    missed = np.hypot(
        math.hypot(0.1, 0.6 / n) * shift,
        (infinite.value - 1.0) * _image_order(e, edges, dim),
    )
    if n > 3:
        return Prediction(shift, missed)
    exact = edges >= n
    few = _in_ensemble(_few(e, dim, n), n, ensemble) - infinite.value
    return Prediction(np.where(exact, few, shift), np.where(exact, 0.0, missed))


def _in_ensemble(canonical: FloatArray, n: int, ensemble: Ensemble) -> FloatArray:
    return np.asarray(canonical if ensemble == "canonical" else 1.0 + n / (n - 1) * (canonical - 1.0))


def _few(e: FloatArray, dim: int, n: int) -> FloatArray:
    """Return the largest relative shift of Z - 1 by correlations between a particle and its images."""
    y = 2.0**dim * e / n
    square = 0.0 if n == 2 else 3.0 - 0.75 * _EXACT_B3[dim] / 4.0 ** (dim - 1)  # B3/v0^2 = B3/B2^2 / 4
    linear = 1.0 if n == 2 else 3.0
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 + y / n * (linear - 2 * square * y) / (1 - linear * y + square * y**2))


def _image_order(e: FloatArray, edges: FloatArray, dim: int) -> FloatArray:
    """Return the largest shift of Z, relative to Z - 1, by correlations between a particle and its images."""
    decay = np.interp(e, *_IMAGES_DECAY[dim])
    return np.asarray(_IMAGES[dim] * np.exp(-decay * (edges - 2.0)))
