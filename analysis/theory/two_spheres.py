"""Two equal discs or spheres in a hard box: the smallest gas, whose collision rates are known exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.brief import brief
from analysis.theory.prediction import check_dim

__all__ = ["TwoSphereRates", "two_sphere_rates"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TwoSphereRates:
    """Long-time mean rates of two equal spheres in a box.

    Attributes
    ----------
    pair : float
        Collisions of the two with each other, [1/time].
    wall : (d,) array
        Collisions of both spheres with the two walls of each axis, [1/time].
    """

    pair: float
    wall: FloatArray

    __repr__ = brief


def two_sphere_rates(
    box: ArrayLike, diameter: float = 1.0, mass: float = 1.0, energy: float = 1.0
) -> TwoSphereRates:
    """Return the exact rates of two equal discs or spheres in a box with hard walls on every axis.

    The dynamics is ergodic (Simanyi, Ergod. Theory Dyn. Syst. 19, 741 (1999), doi 10.1017/S0143385799133935),
    so that rates are averages over the energy shell. With a_k = L_k - sigma, R^2 = 2E/m, u = Gamma(d) /
    (sqrt(pi) Gamma(d + 1/2)) and Q(sigma) the volume of overlapping pairs of centres, the free volume is prod
    a^2 - Q;

        pair rate = Q'(sigma) / (prod a^2 - Q) sqrt(2) R u / 2,
        wall rate along k = 4 w_k / (prod a^2 - Q) R u / 2,

    w_k the free volume with one centre fixed on a wall of axis k. 2D: Q = pi s^2 ab - 4/3 s^3 (a + b) +
    s^4/2, w_x = a b^2 - (pi s^2 b / 2 - 2 s^3/3). 3D: Q = 4/3 pi s^3 abc - pi/2 s^4 (ab + bc + ca) + 8/15 s^5
    (a + b + c) - s^6/6, w_x = a (bc)^2 - (2/3 pi s^3 bc - pi/4 s^4 (b + c) + 4/15 s^5).

    Parameters
    ----------
    box : (d,) array_like
        Edge lengths, each more than two diameters.
    diameter, mass, energy : float
        sigma, the mass of each, and their total kinetic energy.

    Returns
    -------
    TwoSphereRates

    Raises
    ------
    ValueError
        If the spheres cannot pass each other along some axis, where the formulas do not hold.
    """
    edges = np.asarray(box, dtype=np.float64)
    dim = len(edges)
    check_dim(dim)
    s, a = float(diameter), edges - diameter
    if not np.all(a > s):
        raise ValueError(f"box = {edges.tolist()}; every edge must be longer than two diameters, {2 * s:g}")
    area, sides = float(np.prod(a)), float(a.sum())
    if dim == 2:
        overlap = math.pi * s**2 * area - 4 / 3 * s**3 * sides + s**4 / 2
        slope = 2 * math.pi * s * area - 4 * s**2 * sides + 2 * s**3
    else:
        faces = float(a[0] * a[1] + a[1] * a[2] + a[2] * a[0])
        overlap = (
            4 / 3 * math.pi * s**3 * area - math.pi / 2 * s**4 * faces + 8 / 15 * s**5 * sides - s**6 / 6
        )
        slope = 4 * math.pi * s**2 * area - 2 * math.pi * s**3 * faces + 8 / 3 * s**4 * sides - s**5
    free = area**2 - overlap
    speed = math.sqrt(2 * energy / mass) * math.gamma(dim) / (math.sqrt(math.pi) * math.gamma(dim + 0.5)) / 2
    wall = np.array([4 * _beside_a_wall(a, k, s) / free * speed for k in range(dim)])
    return TwoSphereRates(slope / free * math.sqrt(2) * speed, wall)


def _beside_a_wall(a: FloatArray, axis: int, s: float) -> float:
    """Return w_k: the free volume of the pair with one centre on a given wall of an axis."""
    across = np.delete(a, axis)
    full = float(a[axis] * np.prod(across) ** 2)
    if len(a) == 2:
        return full - (math.pi * s**2 * float(across[0]) / 2 - 2 * s**3 / 3)
    face, rim = float(np.prod(across)), float(across.sum())
    return full - (2 * math.pi / 3 * s**3 * face - math.pi / 4 * s**4 * rim + 4 / 15 * s**5)
