"""Whether a gas that started on a lattice has melted: bond-orientational order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from analysis.estimator import Estimator, axes_or_new
from analysis.series import BlockSeries
from hardspheres.order import NEIGHBOURS, bond_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["BondOrder"]

FloatArray = NDArray[np.float64]

CRYSTAL = {3: 0.2, 2: 0.35}


class BondOrder(Estimator):
    """Global bond-orientational order frame by frame: Q6 in 3D, |psi6| in 2D, by `hardspheres.bond_order`.

    0.575 for face-centred cubic, 1 for the triangular lattice, of order 1/sqrt(N) in a fluid. Crystals in
    several orientations lower it: a small value does not prove a fluid. In a mixture the neighbours are those
    nearest by distance over contact distance.
    """

    def __init__(self) -> None:
        self._rows = BlockSeries()  # s, order
        self._last = 0.0
        self._dim = 3

    def add(self, frame: Frame) -> Self:
        """Take in one frame of at least 14 particles (8 in 2D) and return the estimator itself."""
        scene = frame.scene
        neighbours = NEIGHBOURS[scene.dim]
        if len(frame.positions) < neighbours + 2:
            raise ValueError(f"{len(frame.positions)} particles; bonds to {neighbours} neighbours need more")
        self._dim = scene.dim
        self._last = bond_order(scene.with_state(frame.positions, frame.velocities)).value
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
    def crystalline(self) -> bool:
        """Whether the last frame is ordered: Q6 above 0.2 in 3D, |psi6| above 0.35 in 2D.

        Fluids of 100 particles or more stay below that up to freezing; a crystal with a few per cent of
        vacancies is above.
        """
        self._require(len(self._rows) > 0, "values", "add(frame)")
        return bool(self._last > CRYSTAL[self._dim])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the order of every frame against s, with the threshold of a crystal."""
        values = self.values
        axes = axes_or_new(ax)
        axes.axhline(CRYSTAL[self._dim], color="0.4", lw=1.5, label="crystalline above")
        axes.plot(self.collisions_per_particle, values, ".", label="simulation")
        axes.set_xlabel("collisions per particle s")
        axes.set_ylabel("$Q_6$" if self._dim == 3 else r"$|\psi_6|$")
        axes.legend()
        return axes
