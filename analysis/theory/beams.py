"""The relaxation of a dilute gas from two opposite beams: the Boltzmann equation's table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.brief import brief
from analysis.theory.prediction import check_dim, inside_range
from analysis.theory.spline import cubic_spline

__all__ = ["BeamsRelaxation", "boltzmann_beams"]

FloatArray = NDArray[np.float64]

# Direct simulation Monte Carlo of the space-homogeneous Boltzmann equation, N = 1e5, 60 runs; an independent
# one gave .875(1), .425(1) for the anisotropy at s = 1, 2 in 3D and -.3279(2) for a2 at 1.
# tests/analysis/conftest.py holds such a solver.
_S = [0.0, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6, 7]
_ANISOTROPY = {
    3: [
        2.0,
        1.58597,
        1.28697,
        1.05681,
        0.87495,
        0.60725,
        0.42546,
        0.29955,
        0.21184,
        0.15021,
        0.10682,
        0.05314,
        0.0259,
        0.01236,
    ],
    2: [
        1.0,
        0.77717,
        0.61473,
        0.49159,
        0.39578,
        0.25957,
        0.17215,
        0.11461,
        0.07722,
        0.05165,
        0.03459,
        0.01588,
        0.00769,
        0.00313,
    ],
}
_A2 = {
    3: [
        -0.4,
        -0.39163,
        -0.37373,
        -0.35165,
        -0.32793,
        -0.27979,
        -0.23469,
        -0.1942,
        -0.15917,
        -0.12953,
        -0.1048,
        -0.06785,
    ]
    + [-0.0432, -0.0271],
    2: [
        -0.5,
        -0.49092,
        -0.47115,
        -0.44641,
        -0.41955,
        -0.36468,
        -0.31221,
        -0.26476,
        -0.22243,
        -0.1856,
        -0.15386,
        -0.10457,
    ]
    + [-0.06991, -0.04651],
}
_ANISOTROPY_ERROR, _A2_ERROR, _INTERPOLATION, _LAG = 5e-4, 3.5e-4, 1e-3, 0.03


@dataclass(frozen=True)
class BeamsRelaxation:
    """Relaxation of a dilute gas from two opposite beams of equal size and speed, by the Boltzmann equation.

    Attributes
    ----------
    s : (n,) array
        Collisions per particle.
    anisotropy, a2 : (n,) arrays
        Temperature along the beams over that of all directions, less 1; fourth cumulant. NaN beyond s = 7.
    anisotropy_error, a2_error : (n,) arrays
        Standard uncertainties of the solution of the equation.
    lag : (n,) array
        By how much the anisotropy of a gas may differ from it, however dilute: parallel particles keep their
        distances, so that each finds what those ahead of it have left, and there is no molecular chaos. Gases
        of 4000 spheres or discs at packing fraction 0.005 are less isotropic by up to this, at s = 1.5 to 2:
        3 % of the anisotropy times the share of it that is lost. Beams with a thermal spread of a tenth of
        their speed follow the equation.
    """

    s: FloatArray
    anisotropy: FloatArray
    anisotropy_error: FloatArray
    a2: FloatArray
    a2_error: FloatArray
    lag: FloatArray

    __repr__ = brief


def boltzmann_beams(s: ArrayLike, dim: int) -> BeamsRelaxation:
    """Return the relaxation of a dilute gas of one species from two opposite beams.

    Valid for eta -> 0 and N -> infinity, and for beams that do not fly along an axis of a periodic box, where
    a particle that missed all others would fly through the same cylinder again
    (`hardspheres.draw_velocities`).

    Parameters
    ----------
    s : array_like
        Collisions per particle, 0 to 7; a `TheoryRangeWarning` and NaN beyond.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    BeamsRelaxation
        Between the tabulated s by cubic splines of the logarithms; u = 5e-4 of the anisotropy and 3.5e-4 of
        a2, and 1e-3 of the value for the interpolation; exact at s = 0.
    """
    check_dim(dim)
    points = np.atleast_1d(np.asarray(s, dtype=np.float64))
    inside = inside_range("the Boltzmann relaxation from beams", points, 0.0, _S[-1])

    def curve(values: list[float], error: float) -> tuple[FloatArray, FloatArray]:
        value = np.where(inside, np.exp(cubic_spline(_S, np.log(np.abs(values)), points)), np.nan)
        lost = np.where(
            points > 0.0, 1.0 - value / abs(values[0]), 0.0
        )  # the table's noise grows as the anisotropy decays
        return np.sign(values[0]) * value, np.hypot(error * lost, _INTERPOLATION * value * (points > 0.0))

    anisotropy, a2 = curve(_ANISOTROPY[dim], _ANISOTROPY_ERROR), curve(_A2[dim], _A2_ERROR)
    lag = _LAG * anisotropy[0] * (1.0 - anisotropy[0] / (dim - 1))
    return BeamsRelaxation(points, *anisotropy, *a2, lag)
