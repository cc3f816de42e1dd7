"""The reference solver in rational numbers: without rounding, simultaneous events are simultaneous."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation

__all__ = ["rational_simulation"]

DIGITS = 10**60


def _root(square: Fraction) -> Fraction:
    """Return the square root: exact where it is rational, else to 60 digits (for later times only)."""
    top, bottom = math.isqrt(square.numerator), math.isqrt(square.denominator)
    if top * top == square.numerator and bottom * bottom == square.denominator:
        return Fraction(top, bottom)
    return Fraction(math.isqrt(square.numerator * DIGITS**2 // square.denominator), DIGITS)


class _Rational(ReferenceSimulation):
    """`ReferenceSimulation` whose times of "now" are rational too, and exactly 0."""

    def pair_time(self, i: int, j: int, horizon: Any) -> Any:
        time = super().pair_time(i, j, horizon)
        return time if time == math.inf else Fraction(time)

    def wall_time(self, i: int, axis: int) -> tuple[Any, int]:
        time, side = super().wall_time(i, axis)
        return (time if time == math.inf else Fraction(time)), side


def rational_simulation(scene: hs.Scene) -> ReferenceSimulation:
    """Return the reference solver of a scene, in exact arithmetic."""
    return _Rational(scene, Fraction, _root)


def as_floats(rows: Sequence[Sequence[Any]]) -> list[list[float]]:
    """Return rows of numbers of any kind as floats."""
    return [[float(x) for x in row] for row in rows]
