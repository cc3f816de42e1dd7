"""Hard discs where they melt: pressures of finite boxes, from Monte Carlo programs, and the transition.

In units of kT over the square of a diameter: beta P (2r)^2 = 4 eta Z / pi. All are of periodic boxes at fixed
temperature, in which Z depends on the number of discs and, where there are few, on the shape of the box.

- 224, 870 and 128^2 discs: Li, Nishikawa, Hoellmer, Carillo, Maggs, Krauth, J. Chem. Phys. 157, 234111
  (2022), doi 10.1063/5.0126437.
- 256^2, 512^2 and 1024^2 discs: Bernard, Krauth, Phys. Rev. Lett. 107, 155704 (2011), doi
  10.1103/PhysRevLett.107.155704. Two other programs, one of them event-driven, agree (Engel et al., Phys.
  Rev. E 87, 042134 (2013), doi 10.1103/PhysRevE.87.042134).

Digits are those of the authors' data, which Li et al. keep beside all earlier ones (github.com, repository
jellyfysh/HistoricDisks).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from analysis.theory.prediction import Prediction

__all__ = ["COEXISTENCE", "COEXISTENCE_PRESSURE", "HEXATIC_UP_TO", "disc_pressure", "disc_pressures"]

FloatArray = NDArray[np.float64]

COEXISTENCE = (0.700, 0.716)
"""Packing fractions between which a large box holds liquid and hexatic together (Bernard, Krauth 2011)."""
COEXISTENCE_PRESSURE = Prediction(9.185, 0.0005)
"""beta P (2r)^2 there: the equal areas under and over the pressures of 1024^2 discs below.

They give 9.1850 between packing fractions 0.6999 and 0.7165. Those of 512^2 and 256^2 discs give 9.1845 and
9.1830: with fewer discs the interface between both phases counts for more.
"""
HEXATIC_UP_TO = 0.720
"""Packing fraction at which the hexatic becomes a solid, continuously (Bernard, Krauth 2011).

As they and Engel et al. are quoted; no table here depends on it.
"""

SQUARE, TRIANGULAR = 1.0, 2.0 / math.sqrt(3.0)  # longer edge over the shorter one: 1 : 1 and 1 : sqrt(3)/2
LARGE = 128**2  # discs from which on the shape of the box hardly matters,
SHAPE = 1e-3  # as boxes 1 : 1 and 1 : sqrt(3)/2 of 128^2 and 512^2 discs differ by their errors, this or less
SAME_SHAPE = 0.02  # of the logarithm of the ratio of edges: what is lost goes with its square

# By number of discs and ratio of edges: packing fractions, pressures, standard errors.
_EVEN = 0.002
_TABLES: dict[tuple[int, float], tuple[list[float], list[float], list[float]]] = {
    (224, SQUARE): (
        [0.670 + _EVEN * k for k in range(27)],
        [7.979479, 8.08531, 8.18999, 8.29315, 8.39390, 8.49105, 8.58244, 8.66582, 8.73803]
        + [8.79579, 8.83348, 8.84651, 8.83344, 8.7966, 8.74504, 8.6876, 8.6436, 8.6262]
        + [8.6175, 8.6305, 8.6721, 8.7378, 8.7984, 8.8869, 8.9570, 9.0844, 9.1798],
        [5.8e-5, 1.1e-4, 1.3e-4, 1.6e-4, 2.1e-4, 1.9e-4, 1.5e-4, 2.4e-4, 4.4e-4]
        + [2.6e-4, 4.6e-4, 5.5e-4, 7.9e-4, 1.1e-3, 9.7e-4, 1.2e-3, 2.0e-3, 2.1e-3]
        + [2.9e-3, 4.4e-3, 4.3e-3, 5.3e-3, 4.5e-3, 7.3e-3, 4.6e-3, 9.9e-3, 6.5e-3],
    ),
    (870, SQUARE): (
        [0.670 + _EVEN * k for k in range(25)],
        [7.986779, 8.093305, 8.199729, 8.305464, 8.410215, 8.513249, 8.613949, 8.711343, 8.804458]
        + [8.891164, 8.969898, 9.03666, 9.089054, 9.12212, 9.13414, 9.12966, 9.11472, 9.09681]
        + [9.08175, 9.07174, 9.06469, 9.0541, 9.0310, 9.0272, 9.0507],
        [2.5e-5, 3.5e-5, 2.5e-5, 4.6e-5, 2.7e-5, 3.7e-5, 6.8e-5, 6.8e-5, 5.2e-5]
        + [3.4e-5, 7.5e-5, 1.1e-4, 8.3e-5, 1.6e-4, 2.2e-4, 1.5e-4, 1.6e-4, 3.5e-4]
        + [3.1e-4, 3.6e-4, 4.3e-4, 1.3e-3, 3.2e-3, 4.9e-3, 4.0e-3],
    ),
    (870, 29.0 / (30.0 * math.sqrt(0.75))): (
        [0.670 + _EVEN * k for k in range(25)],
        [7.986735, 8.093337, 8.199758, 8.305473, 8.410175, 8.513233, 8.614020, 8.711363, 8.804295]
        + [8.890990, 8.969476, 9.036875, 9.08915, 9.12293, 9.13490, 9.12956, 9.11236, 9.09028]
        + [9.06621, 9.04532, 9.0272, 9.0122, 9.0158, 9.0450, 9.0818],
        [2.6e-5, 3.5e-5, 2.4e-5, 3.4e-5, 3.5e-5, 3.7e-5, 4.1e-5, 6.5e-5, 6.2e-5]
        + [7.3e-5, 9.7e-5, 6.0e-5, 1.2e-4, 1.2e-4, 1.5e-4, 1.7e-4, 2.1e-4, 3.8e-4]
        + [3.4e-4, 8.9e-4, 1.0e-3, 2.2e-3, 1.8e-3, 2.6e-3, 4.8e-3],
    ),
    (128**2, SQUARE): (
        [0.698, 0.704, 0.708, 0.712, 0.716],
        [9.17405, 9.18558, 9.17630, 9.16554, 9.1587],
        [4.9e-4, 8.0e-4, 7.4e-4, 9.0e-4, 1.0e-3],
    ),
    (128**2, TRIANGULAR): (
        [0.698, 0.704, 0.708, 0.712, 0.716],
        [9.17441, 9.18700, 9.17512, 9.16590, 9.1560],
        [5.7e-4, 9.1e-4, 8.8e-4, 9.4e-4, 1.8e-3],
    ),
    (256**2, SQUARE): (
        [0.698 + _EVEN * k for k in range(12)],
        [9.17080, 9.18846, 9.19240, 9.18870, 9.18584, 9.18178]
        + [9.17904, 9.17687, 9.17582, 9.17791, 9.18577, 9.2266],
        [2.5e-4, 2.5e-4, 2.4e-4, 2.7e-4, 2.9e-4, 2.1e-4, 2.1e-4, 2.9e-4, 2.9e-4, 2.6e-4, 6.1e-4, 1.6e-3],
    ),
    (512**2, SQUARE): (
        [0.698 + _EVEN * k for k in range(12)],
        [9.16998, 9.18599, 9.18993, 9.18829, 9.18564, 9.18416]
        + [9.18211, 9.18104, 9.18027, 9.18230, 9.19366, 9.23246],
        [1.4e-4, 1.9e-4, 3.3e-4, 3.3e-4, 3.2e-4, 2.8e-4, 2.8e-4, 2.6e-4, 2.1e-4, 2.6e-4, 1.4e-4, 7.0e-4],
    ),
    (1024**2, SQUARE): (
        [0.698 + _EVEN * k for k in range(12)],
        [9.169311, 9.18545, 9.18800, 9.18692, 9.18553, 9.18502]
        + [9.18425, 9.18354, 9.18218, 9.18336, 9.19495, 9.22765],
        [7.3e-5, 1.1e-4, 1.4e-4, 1.2e-4, 1.1e-4, 1.0e-4, 1.1e-4, 1.1e-4, 1.3e-4, 1.2e-4, 2.0e-4, 2.5e-4],
    ),
}


def disc_pressure(packing_fraction: float, n: int, ratio: float = 1.0) -> tuple[str, Prediction] | None:
    """Return beta P (2r)^2 of so many discs in a periodic box at fixed temperature, where it was computed.

    Parameters
    ----------
    packing_fraction : float
        One of a table: nothing is interpolated.
    n : int
        Number of discs: 224, 870, or 128, 256, 512 or 1024 squared.
    ratio : float
        One edge of the box over the other.

    Returns
    -------
    (source, Prediction) or None
        With its standard error, to which 1e-3 is added (in squares) where large boxes have another shape than
        this one. None where there is no number. A gas at fixed energy and momentum 0, as ours is, has
        Z - 1 = N/(N - 1) (Z_N - 1), Z_N at fixed temperature.
    """
    apart, places, values, errors = _nearest(n, ratio)
    near = np.flatnonzero(np.abs(places - packing_fraction) < 1e-6)
    if not len(near) or (apart > SAME_SHAPE and n < LARGE):
        return None
    shape = SHAPE if apart > SAME_SHAPE else 0.0
    source = "Li et al. 2022" if n <= LARGE else "Bernard, Krauth 2011"
    return source, Prediction(float(values[near[0]]), math.hypot(float(errors[near[0]]), shape))


def disc_pressures(n: int, ratio: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return packing fractions and pressures of so many discs in the box nearest to this shape, if any."""
    return _nearest(n, ratio)[1:3]


def _nearest(n: int, ratio: float) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Return how far the shape of a box is from the nearest one with so many discs, and its table."""
    of_n = {shape: its for (count, shape), its in _TABLES.items() if count == n}
    own = max(ratio, 1.0 / ratio)
    apart = {abs(math.log(own / shape)): its for shape, its in of_n.items()}
    nearest = min(apart, default=math.inf)
    places, values, errors = apart.get(nearest, ([], [], []))
    return nearest, np.array(places), np.array(values), np.array(errors)
