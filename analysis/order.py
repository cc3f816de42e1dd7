"""Whether a gas that started on a lattice has melted: bond-orientational order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.spatial import cKDTree

from analysis.estimator import Estimator, axes_or_new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame

__all__ = ["BondOrder"]

FloatArray = NDArray[np.float64]

CRYSTAL = {3: 0.2, 2: 0.35}


class BondOrder(Estimator):
    """Global bond-orientational order frame by frame: Q6 in 3D, |psi6| in 2D.

    Q6 = sqrt(4 pi/13 sum over m of |<Y_6m>|^2), averaged over the bonds of each particle to its 12 nearest
    neighbours (Steinhardt, Nelson and Ronchetti, Phys. Rev. B 28, 784 (1983), doi 10.1103/PhysRevB.28.784);
    psi6 = <exp(6 i theta)> over bonds to 6 nearest. 0.575 for face-centred cubic, 1 for the triangular
    lattice, of order 1/sqrt(N) in a fluid. Crystals in several orientations lower it: a small value does not
    prove a fluid. One species is meant; in a mixture neighbours are counted by distance all the same.
    """

    def __init__(self) -> None:
        self._s: list[float] = []
        self._values: list[float] = []
        self._dim = 3

    def add(self, frame: Frame) -> Self:
        """Take in one frame of at least 14 particles (8 in 2D) and return the estimator itself."""
        scene = frame.scene
        neighbours = 12 if scene.dim == 3 else 6
        if len(frame.positions) < neighbours + 2:
            raise ValueError(f"{len(frame.positions)} particles; bonds to {neighbours} neighbours need more")
        # cKDTree wraps axes with a positive period and leaves those with 0 open
        tree = cKDTree(frame.positions, boxsize=np.where(scene.periodic, scene.box, 0.0))
        near = tree.query(frame.positions, k=neighbours + 1)[1][:, 1:]
        bond = (frame.positions[near] - frame.positions[:, None]).reshape(-1, scene.dim)
        bond -= np.where(scene.periodic, scene.box * np.rint(bond / scene.box), 0.0)
        self._dim = scene.dim
        self._values.append(_q6(bond) if scene.dim == 3 else _psi6(bond))
        self._s.append(frame.collisions_per_particle)
        return self

    @property
    def values(self) -> FloatArray:
        """The order of each frame, (frames,)."""
        self._require(bool(self._values), "values", "add(frame)")
        return np.array(self._values)

    @property
    def collisions_per_particle(self) -> FloatArray:
        """Collisions per particle s of each frame, (frames,)."""
        self._require(bool(self._values), "values", "add(frame)")
        return np.array(self._s)

    @property
    def crystalline(self) -> bool:
        """Whether the last frame is ordered: Q6 above 0.2 in 3D, |psi6| above 0.35 in 2D.

        Fluids of 100 particles or more stay below that up to freezing; a crystal with a few per cent of
        vacancies is above.
        """
        return bool(self.values[-1] > CRYSTAL[self._dim])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the order of every frame against s, over the line that tells a crystal."""
        values = self.values
        axes = axes_or_new(ax)
        axes.axhline(CRYSTAL[self._dim], color="0.4", lw=1.5, label="crystalline above")
        axes.plot(self._s, values, ".", label="simulation")
        axes.set_xlabel("collisions per particle s")
        axes.set_ylabel("$Q_6$" if self._dim == 3 else r"$|\psi_6|$")
        axes.legend()
        return axes


def _q6(bond: FloatArray) -> float:
    cosine = bond[:, 2] / np.linalg.norm(bond, axis=1)
    angle = np.arctan2(bond[:, 1], bond[:, 0])
    total = 0.0
    for m in range(7):
        norm = math.factorial(6 - m) / math.factorial(6 + m)  # |Y_6m|^2 4 pi/13 over |P_6^m|^2
        mean = np.mean(special.lpmv(m, 6, cosine) * np.exp(1j * m * angle))
        total += (1.0 if m == 0 else 2.0) * norm * abs(mean) ** 2
    return math.sqrt(total)


def _psi6(bond: FloatArray) -> float:
    return float(abs(np.mean(np.exp(6j * np.arctan2(bond[:, 1], bond[:, 0])))))
