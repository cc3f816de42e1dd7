"""A particle among fixed obstacles in a periodic box: a Lorentz gas."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from hardspheres.scene import sphere_volume

__all__ = ["ARRANGEMENTS", "ObstacleCourse"]

FloatArray = NDArray[np.float64]

ARRANGEMENTS = "triangular", "square", "random"
CLEAR = 1e-9  # relative: how far from contact the particle starts
LIMITS: dict[tuple[str, int], tuple[float, str]] = {  # packing fraction, and what is beyond
    ("triangular", 2): (
        0.85,
        "where the particle stays between three discs for too long to diffuse in this study",
    ),
    ("square", 2): (0.78, "just below pi/4, where discs of a square lattice touch and lock the particle in"),
    ("square", 3): (0.52, "just below pi/6, where spheres of a cubic lattice touch"),
    ("random", 2): (0.5, "where obstacles at random often lock the particle in"),
    ("random", 3): (0.5, "where this study of obstacles at random ends"),
}


@dataclass(frozen=True)
class ObstacleCourse:
    """One particle of speed and mass 1 among obstacles; the unit of length is given by the arrangement.

    Attributes
    ----------
    arrangement : str
        One of ARRANGEMENTS: lattices of spacing 1 (square: in 3D simple cubic), or obstacles at random, which
        may overlap, one per unit of volume.
    dim : int
        Dimension.
    packing_fraction : float
        Obstacles per volume times the volume of a ball of radius `reach`.
    obstacles : int
        How many there are in the box; of a lattice, 0 for a few cells.
    size : float
        Diameter of the particle over that of an obstacle.
    """

    arrangement: str
    dim: int
    packing_fraction: float
    obstacles: int
    size: float

    @cached_property
    def lattice(self) -> tuple[FloatArray, FloatArray]:
        """Places of the obstacles of a lattice, (n, d), and the box."""
        if self.arrangement == "triangular":
            rows = math.sqrt(3.0)
            corners = [(i, j * rows) for i in range(4) for j in range(2)]
            return np.array([*corners, *((x + 0.5, y + 0.5 * rows) for x, y in corners)]), np.array(
                [4.0, 2.0 * rows]
            )
        edge = 4 if self.dim == 2 else 3
        grid = np.meshgrid(*[np.arange(float(edge))] * self.dim, indexing="ij")
        return np.stack(grid, axis=-1).reshape(-1, self.dim), np.full(self.dim, float(edge))

    @property
    def count(self) -> int:
        """Number of obstacles."""
        return self.obstacles or len(self.lattice[0])

    @property
    def n(self) -> int:
        """Number of obstacles and the particle."""
        return self.count + 1

    @property
    def kind(self) -> str:
        """What the engine is compiled for, in words."""
        return f"hard {self.balls} among obstacles, periodic box"

    @property
    def balls(self) -> str:
        """What obstacles are called."""
        return "spheres" if self.dim == 3 else "discs"

    @cached_property
    def box(self) -> FloatArray:
        """Edges."""
        return np.full(self.dim, self.obstacles ** (1.0 / self.dim)) if self.obstacles else self.lattice[1]

    @property
    def density(self) -> float:
        """Obstacles per volume."""
        return self.count / float(np.prod(self.box))

    @property
    def reach(self) -> float:
        """Radius of an obstacle and of the particle together."""
        return float(
            (self.packing_fraction / self.density / sphere_volume(1.0, self.dim)) ** (1.0 / self.dim)
        )

    @property
    def radii(self) -> tuple[float, float]:
        """Radius of an obstacle, and of the particle."""
        return self.reach / (1.0 + self.size), self.reach * self.size / (1.0 + self.size)

    @property
    def free_path(self) -> float:
        """Mean free path, exact.

        Of obstacles at random it is the mean over time and over all arrangements of so many: wherever the
        particle is, they are anywhere but within reach.
        """
        ball = sphere_volume(self.reach, self.dim)
        volume, surface = float(np.prod(self.box)), self.count * ball * self.dim / self.reach
        return theory.santalo_free_path(
            volume - (ball if self.obstacles else self.count * ball), surface, self.dim
        )

    @property
    def finite_horizon(self) -> bool:
        """Whether no flight is endless."""
        return self.arrangement == "random" or (
            self.arrangement == "triangular" and self.reach > theory.FINITE_HORIZON[0]
        )

    @property
    def diffusion(self) -> tuple[str, Any]:
        """Name of the theory of D, and what it says."""
        if self.arrangement == "triangular":
            return "Machta-Zwanzig", theory.machta_zwanzig_diffusion(self.reach)
        return "Boltzmann, dilute", theory.lorentz_diffusion(self.density, self.reach, self.dim)

    @property
    def exponent(self) -> tuple[str, Any]:
        """Name of the theory of the Lyapunov exponent per collision, and what it says, None if nothing."""
        if self.arrangement == "random":
            exponent = theory.lorentz_lyapunov_exponent(self.density, self.reach, self.dim)
            return "kinetic theory, dilute", exponent
        if (self.arrangement, self.dim) == ("square", 2):
            return "another program, interpolated", theory.billiard_lyapunov_exponent(self.reach)
        return "", None

    def check(self) -> None:
        """Raise SceneError where there is no such course."""
        if (self.arrangement, self.dim) not in LIMITS:
            raise hs.SceneError(
                f"--obstacles {self.arrangement} is a lattice of discs; in 3D ask for square, which is "
                "simple cubic, or random"
            )
        limit, beyond = LIMITS[self.arrangement, self.dim]
        if self.packing_fraction > limit:
            raise hs.SceneError(
                f"packing fraction {self.packing_fraction:g} is above {limit:g}, {beyond}; ask for less"
            )

    def scene(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return the particle anywhere that it fits, flying in any direction: this is equilibrium."""
        random, box = np.random.default_rng(seed), self.box
        place = random.uniform(0.0, box)
        if self.obstacles:
            places = random.uniform(0.0, box, (self.count, self.dim))
            while (near := self._reached(place, places)).any():
                places[near] = random.uniform(0.0, box, (int(near.sum()), self.dim))
        else:
            places = self.lattice[0]
            while self._reached(place, places).any():
                place = random.uniform(0.0, box)
        heading = random.normal(size=self.dim)
        still = np.zeros_like(places)
        large, small = self.radii
        return hs.Scene(
            np.concatenate([places, place[None]]),
            np.concatenate([still, heading[None] / np.linalg.norm(heading)]),
            np.append(np.full(self.count, large), small),
            np.append(np.full(self.count, math.inf), 1.0),
            box,
        )

    def _reached(self, place: FloatArray, obstacles: FloatArray) -> NDArray[np.bool_]:
        apart = obstacles - place
        apart -= self.box * np.rint(apart / self.box)
        return np.asarray(np.sum(apart * apart, axis=1) <= (self.reach * (1.0 + CLEAR)) ** 2)

    def __str__(self) -> str:
        """Return it in words."""
        where = "at random" if self.arrangement == "random" else f"on a {self.arrangement} lattice"
        if (self.arrangement, self.dim) == ("square", 3):
            where = "on a simple cubic lattice"
        return f"1 particle among {self.count} {self.balls} {where}, periodic box"
