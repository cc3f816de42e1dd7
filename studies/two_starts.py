"""Discs near melting in one box, from two starts: a crystal, and a fluid grown in the box of the crystal."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.statistics import Estimate
from hardspheres.compression import EASY, MARGIN, Compression
from hardspheres.memory import require_room_for
from hardspheres.placement import place_at_random
from hardspheres.velocities import POSITIONS, stream
from studies.fluid import Fluid
from studies.options import OptionError

__all__ = ["Discs", "canonical_pressure"]

FloatArray = NDArray[np.float64]

LEAST, MOST = 0.60, 0.80  # packing fractions
LONGEST = 1.25  # one edge of the box over the other
ROW = math.sqrt(0.75)  # spacings from one row of the triangular lattice to the next


@dataclass(frozen=True)
class Discs(Fluid):
    """Equal discs in a nearly square periodic box that holds the triangular lattice whole.

    Attributes
    ----------
    n : int
        A number of columns times an even number of rows.
    starts : tuple of str
        "crystal" or "fluid", in turn for one replica after another.
    """

    n: int = 870
    dim: int = 2
    packing_fraction: float = 0.70
    starts: tuple[str, ...] = ("fluid", "crystal")

    @cached_property
    def lattice(self) -> tuple[int, int] | None:
        """Columns and rows of the lattice, in the box nearest to a square; None where there is none."""
        return _lattice(self.n)

    @property
    def ratio(self) -> float:
        """Width of the box over its height."""
        columns, rows = self._whole()
        return columns / (rows * ROW)

    def _whole(self) -> tuple[int, int]:
        assert self.lattice is not None
        return self.lattice

    @property
    def box(self) -> FloatArray:
        """Edges of the box, (2,)."""
        columns, rows = self._whole()
        return np.array([self._spacing * columns, self._spacing * rows * ROW])

    @property
    def _spacing(self) -> float:
        """Distance of neighbours in the crystal."""
        return math.sqrt(math.pi / (2.0 * math.sqrt(3.0) * self.packing_fraction))

    def check(self) -> None:
        """Raise OptionError where the lattice is not whole, or this is far from melting."""
        require_room_for(self.n)
        if not LEAST <= (eta := self.packing_fraction) <= MOST:
            where = (
                f"above {MOST:g}, far in the solid" if eta > MOST else f"below {LEAST:g}, far in the fluid"
            )
            raise OptionError(
                f"packing fraction {eta:g} is {where}; discs melt near 0.7, ask for {LEAST:g} to {MOST:g}"
            )
        if self.lattice is None:
            near = [
                next(filter(_lattice, found)) for found in (range(self.n, 0, -1), itertools.count(self.n))
            ]
            said = " or ".join("{} = {} x {}".format(n, *(_lattice(n) or ())) for n in near)
            raise OptionError(
                f"--n {self.n} discs make no whole triangular lattice in a nearly square box; ask for {said}"
            )

    def start_of(self, seed: np.random.SeedSequence) -> str:
        """Return which start a replica has, given its seed."""
        return self.starts[(seed.spawn_key or (0,))[0] % len(self.starts)]

    def scene(self, seed: np.random.SeedSequence, velocities: str = "maxwell") -> hs.Scene:
        """Return the start that belongs to a seed."""
        made = self._crystal() if self.start_of(seed) == "crystal" else self._fluid(seed)
        still = hs.Scene(made, np.zeros_like(made), 0.5, 1.0, self.box, "periodic")
        return still.replace(velocities=hs.draw_velocities(still, velocities, temperature=1.0, seed=seed))

    def _crystal(self) -> FloatArray:
        """Return the places of the triangular lattice."""
        columns, _ = self._whole()
        row, column = np.divmod(np.arange(self.n), columns)
        across = column + 0.5 * (row % 2) + 0.25
        return self._spacing * np.column_stack([across, (row + 0.5) * ROW])

    def _fluid(self, seed: np.random.SeedSequence) -> FloatArray:
        """Return places at random at a lower density, grown to their size as in `compressed_gas`."""
        full = np.full(self.n, 0.5 * (1.0 + MARGIN))
        small = full * math.sqrt(EASY[2] / self.packing_fraction)
        both = np.array([True, True])
        places = place_at_random(small, self.box, both, stream(seed, POSITIONS))
        still = hs.Scene(places, np.zeros_like(places), small, 1.0, self.box, "periodic")
        moving = hs.draw_velocities(still, "maxwell", temperature=1.0, seed=seed)
        growing = Compression(still.replace(velocities=moving), full)
        while growing.scale < 1.0:
            growing.grow()
        return growing.scene.positions

    def __str__(self) -> str:
        """Return the discs and their box in words."""
        columns, rows = self._whole()
        return f"{self.n} hard discs, periodic box {columns} : {rows} \u221a3/2"


def _lattice(n: int) -> tuple[int, int] | None:
    """Return columns and rows of n sites in the box nearest to a square, or None; rows are even."""
    middle = math.sqrt(n / ROW)
    rows = [r for r in range(2, math.ceil(2.0 * middle), 2) if n % r == 0]
    fits = [(abs(math.log(n / r / (r * ROW))), n // r, r) for r in rows]
    nearest = min(fits, default=(math.inf, 0, 0))
    return nearest[1:] if nearest[0] <= math.log(LONGEST) else None


def canonical_pressure(z: Estimate, packing_fraction: float, n: int) -> Estimate:
    """Return beta P (2r)^2 of n discs at fixed temperature, given Z at fixed energy and momentum 0.

    Z - 1 = N/(N - 1) (Z_N - 1), exactly.
    """
    per_z, share = 4.0 * packing_fraction / math.pi, (n - 1) / n
    value = per_z * (1.0 + share * (z.value - 1.0))
    return Estimate(value, per_z * share * z.standard_error, z.n_effective, z.degrees_of_freedom)
