"""Whether a gas that started on a lattice has melted: bond-orientational order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

from analysis.per_frame import PerFrame
from analysis.statistics import Estimate, TheoryCheck
from hardspheres.compression import crystal_threshold
from hardspheres.order import bond_order

if TYPE_CHECKING:
    from hardspheres import Frame

__all__ = ["BondOrder"]


class BondOrder(PerFrame):
    """Global bond-orientational order frame by frame: Q6 in 3D, |psi6| in 2D, by `hardspheres.bond_order`.

    0.575 for face-centred cubic, 1 for the triangular lattice, of order 1/sqrt(N) in a fluid. Crystals in
    several orientations lower it: a small value does not prove a fluid. In a mixture the neighbours are those
    nearest by distance over contact distance.
    """

    _line = "crystalline above"
    _threshold = math.inf

    def _measure(self, frame: Frame) -> list[float]:
        self._threshold = crystal_threshold(frame.scene)
        return [bond_order(frame.scene.with_state(frame.positions, frame.velocities)).value]

    @property
    def order(self) -> Estimate:
        """Mean over frames, with its error."""
        return self._estimate(1)

    @property
    def last(self) -> float:
        """The order of the last frame."""
        self._require_values()
        return self._last

    @property
    def crystalline(self) -> bool:
        """Whether the last frame has ordered, as `hardspheres.compression.order_of_crystal` judges it.

        False where it cannot be judged: in mixtures, and for discs from a packing fraction of 0.70. The
        threshold is three times the order of dense fluids or more: of fewer than 49 spheres or 400 discs no
        crystal exceeds it.
        """
        return self.last > self._level()

    @property
    def checks(self) -> list[TheoryCheck]:
        """None: there is no theory of the order of a fluid."""
        self._require_values()
        return []

    def _take_in(self, other: Self) -> None:
        super()._take_in(other)
        self._threshold = min(self._threshold, other._threshold)

    def _level(self) -> float:
        return self._threshold

    @property
    def _ylabel(self) -> str:  # type: ignore[override]
        return "$Q_6$" if self.gas.dim == 3 else r"$|\psi_6|$"
