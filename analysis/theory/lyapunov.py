"""How fast a gas forgets where it came from: the largest Lyapunov exponent, and what rounding makes of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from analysis.theory.prediction import Prediction, check_dim, inside_range, only_inside

__all__ = ["lyapunov_exponent", "reversal_horizon"]

# Largest exponent per collision per particle of 1000 particles (500 from packing fraction 0.3 on in 3D) in a
# periodic box, in tangent space along the engine's own events, see `lyapunov_exponent`.
_EXPONENT = {
    3: (
        (0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.4, 0.49),
        (23.2, 19.7, 14.6, 10.9, 6.82, 3.83, 1.80, 1.02, 0.69, 0.484, 0.331),
    ),
    2: (
        (0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 0.65),
        (18.1, 14.5, 9.46, 5.90, 2.92, 1.75, 1.20, 0.668, 0.426),
    ),
}
LOST = 0.1
"""Diameters off the way there from which on it counts as lost."""
UNCERTAINTY = 0.1
FOLDS = 2.0  # e-folds by which the first roundings differ from one unit in the last place of the box


def lyapunov_exponent(eta: ArrayLike, dim: int) -> Prediction:
    """Return the largest Lyapunov exponent of a hard-sphere gas, per collision per particle.

    Computed for this package in tangent space (Dellago, Posch and Hoover 1996, doi
    10.1103/PhysRevE.53.1485), to 1 to 3 %, and interpolated between powers of eta. It grows slowly with N: in
    3D at eta = 0.01 it is 6.11(5) for 125 spheres and 6.82(10) for 1000.

    Parameters
    ----------
    eta : array_like
        Packing fraction; 0.0001 to 0.49 in 3D, 0.001 to 0.65 in 2D, NaN outside.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        u = 10 %, for other numbers of particles.
    """
    check_dim(dim)
    density, exponent = _EXPONENT[dim]
    e = np.asarray(eta, dtype=np.float64)
    e = only_inside(e, inside_range("the Lyapunov exponent", e, density[0], density[-1]))
    value = np.exp(np.interp(np.log(e), np.log(density), np.log(exponent)))
    return Prediction(value, UNCERTAINTY * value)


def reversal_horizon(eta: ArrayLike, dim: int, size: float) -> Prediction:
    """Return for how many collisions per particle a gas retraces its way after all velocities are reversed.

    ln(0.1/(eps size))/lambda: the rounding of coordinates, eps = 2.2e-16 of the box, grows as exp(lambda s)
    until particles are off by a tenth of a diameter, and begin to meet others than on the way there.

    Parameters
    ----------
    eta, dim
        As in `lyapunov_exponent`.
    size : float
        Longest edge of the box, in diameters.

    Returns
    -------
    Prediction
        u from that of the exponent, and two e-folds for the size of the first roundings.
    """
    exponent = lyapunov_exponent(eta, dim)
    folds = math.log(LOST / (np.finfo(np.float64).eps * size))
    value = folds / exponent.value
    return Prediction(value, np.hypot(UNCERTAINTY * value, FOLDS / exponent.value))
