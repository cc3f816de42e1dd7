"""Whether a gas that started on a lattice has melted: bond-orientational order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis.estimator import Estimator, axes_or_new
from analysis.series import BlockSeries
from hardspheres.compression import crystal_threshold
from hardspheres.order import bond_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["BondOrder"]

FloatArray = NDArray[np.float64]


class BondOrder(Estimator):
    """Global bond-orientational order frame by frame: Q6 in 3D, |psi6| in 2D, by `hardspheres.bond_order`.

    0.575 for face-centred cubic, 1 for the triangular lattice, of order 1/sqrt(N) in a fluid. Crystals in
    several orientations lower it: a small value does not prove a fluid. In a mixture the neighbours are those
    nearest by distance over contact distance.
    """

    def __init__(self) -> None:
        self._rows = BlockSeries()  # s, order
        self._last = 0.0
        self._threshold = math.inf
        self._dim = 3

    def add(self, frame: Frame) -> Self:
        """Take in one frame of at least two particles and return the estimator itself."""
        scene = frame.scene
        self._last = bond_order(scene.with_state(frame.positions, frame.velocities)).value
        self._threshold, self._dim = crystal_threshold(scene), scene.dim
        self._rows.add([frame.collisions_per_particle, self._last])
        return self

    @property
    def values(self) -> FloatArray:
        """The order of each frame, (frames,); beyond 1023 frames means over as many neighbours as needed."""
        return self._column(1)

    @property
    def collisions_per_particle(self) -> FloatArray:
        """Collisions per particle s of each of `values`."""
        return self._column(0)

    def _column(self, index: int) -> FloatArray:
        self._require(len(self._rows) > 0, "values", "add(frame)")
        return np.asarray(self._rows.rows[:, index])

    @property
    def last(self) -> float:
        """The order of the last frame."""
        self._require(len(self._rows) > 0, "values", "add(frame)")
        return self._last

    @property
    def crystalline(self) -> bool:
        """Whether the last frame has ordered, as `hardspheres.compression.order_of_crystal` judges it.

        False where it cannot be judged: in mixtures, and for discs from a packing fraction of 0.70. The
        threshold is three times the order of dense fluids or more: of fewer than 49 spheres or 400 discs no
        crystal exceeds it.
        """
        return self.last > self._threshold

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the order of every frame against s, with the threshold of a crystal."""
        values = self.values
        axes = axes_or_new(ax)
        if math.isfinite(self._threshold):
            axes.axhline(self._threshold, color="0.4", lw=1.5, label="crystalline above")
        axes.plot(self.collisions_per_particle, values, ".", label="simulation")
        axes.set_xlabel("collisions per particle s")
        axes.set_ylabel("$Q_6$" if self._dim == 3 else r"$|\psi_6|$")
        axes.legend()
        return axes
