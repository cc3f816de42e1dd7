"""Lorentz gas: a particle among fixed obstacles, its mean free path, diffusion and Lyapunov exponent.

The centre of a ball of radius r among balls of radius R moves as a point among balls of radius R + r: that
sum is what radius means here. Lengths are in any unit, n is the number of obstacles per volume.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside, packing_fraction

__all__ = [
    "FINITE_HORIZON",
    "billiard_lyapunov_exponent",
    "lorentz_diffusion",
    "lorentz_lyapunov_exponent",
    "machta_zwanzig_diffusion",
    "santalo_free_path",
]

FINITE_HORIZON = math.sqrt(3.0) / 4.0, 0.5
"""Radii over spacing of a triangular lattice between which no flight is endless and no discs overlap."""

# Sinai's billiard, a disc on a torus of edge 1: radii, and exponents per collision from a run of another
# program in tangent space.
_BILLIARD = (0.2, 0.3, 0.4), (3.21, 2.38, 1.70)
BILLIARD_UNCERTAINTY = 0.015
DILUTE_UP_TO = 0.3  # n times the volume of an obstacle


def santalo_free_path(free_volume: float, surface: float, dim: int) -> float:
    """Return the mean free path in a billiard, exact: pi A / P in 2D, 4 V / S in 3D.

    Santalo's formula; Chernov, J. Stat. Phys. 88, 1 (1997), doi 10.1007/BF02508462.

    Parameters
    ----------
    free_volume : float
        Volume that the centre of the particle can reach; in 2D area.
    surface : float
        Surface of the obstacles there; in 2D length of their edge.
    dim : {2, 3}
        Dimension d.
    """
    check_dim(dim)
    return (4.0 if dim == 3 else math.pi) * free_volume / surface


def machta_zwanzig_diffusion(radius: float, spacing: float = 1.0, speed: float = 1.0) -> Prediction:
    """Return D among the discs of a triangular lattice: random hops between triangles.

    Machta and Zwanzig, Phys. Rev. Lett. 50, 1959 (1983), doi 10.1103/PhysRevLett.50.1959: hops of a / sqrt(3)
    through three gaps w = a - 2 R, one in a time pi A / (3 w v) on average, A the free area of a triangle.
    Exact where the gaps are narrow.

    Parameters
    ----------
    radius, spacing : float
        R and a.
    speed : float
        v of the particle.

    Returns
    -------
    Prediction
        NaN where the horizon is infinite, or discs overlap. u = 5 % and 4 (w / R)^2, from how far runs of
        `hardspheres lorentz` were off at packing fractions 0.69 to 0.85.
    """
    known = only_inside(radius / spacing, inside_range("D", np.asarray(radius / spacing), *FINITE_HORIZON))
    gap = spacing * (1.0 - 2.0 * float(known))
    free = math.sqrt(3.0) / 4.0 * spacing**2 - 0.5 * math.pi * radius**2
    value = spacing**2 * gap * speed / (4.0 * math.pi * free)
    return Prediction(value, (0.05 + 4.0 * (gap / radius) ** 2) * value)


def lorentz_diffusion(density: float, radius: float, dim: int, speed: float = 1.0) -> Prediction:
    """Return D among obstacles at random, which may overlap.

    Boltzmann's 3 v / (16 n R) of discs and v / (3 pi n R^2) of spheres. That of discs is divided by 1 - 4/3 x
    ln x - 0.8775 x + 4.519 (x ln x)^2, x = n R^2 (van Leeuwen and Weijland 1967, doi
    10.1016/0031-8914(67)90258-5; as quoted by Hoefling and Franosch 2007, doi 10.1103/PhysRevLett.98.140601).

    Parameters
    ----------
    density, radius : float
        n and R.
    dim : {2, 3}
        Dimension d.
    speed : float
        v of the particle.

    Returns
    -------
    Prediction
        NaN above packing fraction 0.3 (overlaps counted twice). u: (x ln x)^2 in 2D, a third of the packing
        fraction in 3D, relative.
    """
    filled = _dilute(density, radius, dim)
    x = filled / math.pi
    if dim == 3:
        value, missed = speed / (3.0 * math.pi * density * radius**2), filled / 3.0
    else:
        missed = (x * math.log(x)) ** 2
        series = 1.0 - 4.0 / 3.0 * x * math.log(x) - 0.8775 * x + 4.519 * missed
        value = 3.0 * speed / (16.0 * density * radius) / series
    return Prediction(value, missed * value)


def lorentz_lyapunov_exponent(density: float, radius: float, dim: int) -> Prediction:
    """Return the largest Lyapunov exponent per collision among dilute obstacles at random.

    1 - ln 2 - C - ln(n R^2) in 2D (van Beijeren and Dorfman, Phys. Rev. Lett. 74, 4412 (1995)), and
    ln 4 - 1/2 - C - ln(pi n R^3) in 3D (van Beijeren, Latz and Dorfman, Phys. Rev. E 57, 4077 (1998)), C
    Euler's constant.

    Parameters
    ----------
    density, radius, dim
        As in `lorentz_diffusion`.

    Returns
    -------
    Prediction
        NaN above packing fraction 0.3. u = 2 x |ln x|, x the density under the logarithm: the next terms are
        of that order.
    """
    filled = _dilute(density, radius, dim)
    x = filled / math.pi if dim == 2 else 0.75 * filled
    constant = 1.0 - math.log(2.0) if dim == 2 else math.log(4.0) - 0.5
    return Prediction(constant - float(np.euler_gamma) - math.log(x), 2.0 * x * abs(math.log(x)))


def billiard_lyapunov_exponent(radius: float) -> Prediction:
    """Return the Lyapunov exponent per collision of Sinai's billiard, a disc on a torus of edge 1.

    From a tangent-space run of another program at three radii, with a parabola in ln R between them.

    Parameters
    ----------
    radius : float
        R; 0.2 to 0.4, NaN outside.

    Returns
    -------
    Prediction
        u = 1.5 %.
    """
    radii, exponents = np.log(_BILLIARD[0]), np.array(_BILLIARD[1])
    known = only_inside(radius, inside_range("the exponent", np.asarray(radius), *np.exp(radii[[0, -1]])))
    value = float(np.polyval(np.polyfit(radii, exponents, 2), np.log(known)))
    return Prediction(value, BILLIARD_UNCERTAINTY * value)


def _dilute(density: float, radius: float, dim: int) -> float:
    """Return the packing fraction of obstacles, NaN where they are too dense for these theories."""
    filled = packing_fraction(density, 2.0 * radius, dim)
    return float(
        only_inside(filled, inside_range("the theory of dilute obstacles", filled, 0.0, DILUTE_UP_TO))
    )
