"""What a theory says, with its uncertainty and the range in which it was established."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Prediction",
    "TheoryRangeWarning",
    "packing_fraction",
]

FloatArray = NDArray[np.float64]


class TheoryRangeWarning(UserWarning):
    """A theory was asked for a value outside the range in which it was established; the answer is NaN."""


@dataclass(frozen=True)
class Prediction:
    """A theoretical value with its own uncertainty.

    Attributes
    ----------
    value : float or array
        The value; NaN outside the range of the theory.
    uncertainty : float or array
        Its standard uncertainty u in the same units; 0 where the statement is exact.
    """

    value: Any
    uncertainty: Any

    def __repr__(self) -> str:
        """Return the value and its uncertainty; of several, how many there are and where they lie."""
        values, uncertainties = np.asarray(self.value, float), np.asarray(self.uncertainty, float)
        if values.size == 1:
            return f"<Prediction {values.item():.8g} +- {float(uncertainties.flat[0]):.2g}>"
        known = values[np.isfinite(values)]
        span = f" from {known.min():.6g} to {known.max():.6g}" if known.size else ", none known"
        return f"<Prediction of {' x '.join(map(str, values.shape))} values{span}>"


def check_dim(dim: int) -> None:
    """Raise ValueError unless d is 2 or 3."""
    if dim not in (2, 3):
        raise ValueError(f"dim = {dim}; expected 2 or 3")


def inside_range(name: str, values: FloatArray, low: float, high: float) -> NDArray[np.bool_]:
    """Return which values lie in the range [low, high] of a theory; warn of others, where it gives NaN."""
    inside = (values >= low) & (values <= high)
    outside = values[~inside & ~np.isnan(values)]
    if outside.size:
        warnings.warn(
            f"{name} holds from {low:g} to {high:g} and gives no value (NaN) at {outside.flat[0]:g}",
            TheoryRangeWarning,
            stacklevel=3,
        )
    return np.asarray(inside)


def only_inside(value: ArrayLike, inside: NDArray[np.bool_]) -> FloatArray:
    """Return the value where a theory holds, NaN elsewhere."""
    return np.asarray(np.where(inside, value, np.nan))


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
    check_dim(dim)
    return np.asarray(math.pi / (2 * dim) * np.asarray(number_density) * np.asarray(diameter) ** dim)
