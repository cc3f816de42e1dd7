"""The gases that are timed: their initial states in equilibrium, and the pressure that identifies a fluid.

A benchmark of a crystal does not apply to a fluid, and fcc at packing fraction 0.49 does not melt in any
affordable run. So fluids start at random: placed one after another while that is quick, grown from small
spheres above. A large fluid is a relaxed small one repeated periodically, with new velocities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from hardspheres.memory import require_room_for
from studies.fluid import FREEZING, RELAXED, THEORY_UP_TO, Fluid, is_dense, maker, two_species

__all__ = ["STARTS", "Gas"]

FloatArray = NDArray[np.float64]

STARTS = ("auto", "lattice", "fluid")
REPEATED_FROM = 20_000  # particles; a smaller fluid is made in one piece
REPEATED_ABOVE = 0.05  # packing fraction; a more dilute gas is placed at random quickly at any size
PIECE = 4_000  # particles in the box that is repeated
MELTED = 50.0  # collisions per particle
AT_LEAST = 10.0  # collisions per particle, until neighbour lists are rebuilt regularly


@dataclass(frozen=True)
class Gas:
    """One state to measure.

    Attributes
    ----------
    n, dim, packing_fraction, boundary
        As in `hardspheres.random_gas`; the first species has diameter 1 and mass 1, kT = 1.
    diameter_ratio, mass_ratio : float
        Diameter and mass of the second species over the first's.
    fraction : float
        Number fraction of the second species; without effect when both ratios are 1.
    start : {"auto", "lattice", "fluid"}
        Initial state; "auto" is a lattice above freezing, and a fluid below.
    """

    n: int = 4000
    dim: int = 3
    packing_fraction: float = 0.3
    boundary: str | tuple[str, ...] = "periodic"
    diameter_ratio: float = 1.0
    fraction: float = 0.5
    start: str = "auto"
    mass_ratio: float = 1.0

    def __str__(self) -> str:
        """Return the gas in words, whatever its number of particles and packing fraction."""
        fluid = Fluid(
            self.n, self.dim, self.packing_fraction, self.boundary, self.diameter_ratio, self.mass_ratio
        )
        mixture = ""
        for name, ratio in (("diameters", self.diameter_ratio), ("masses", self.mass_ratio)):
            mixture += f", {name} 1:{ratio:g}" if ratio != 1.0 else ""
        return fluid.kind.replace(",", f"{mixture},", 1)

    @property
    def plain(self) -> Gas:
        """As many spheres of one kind at the same packing fraction, periodic, in 3D."""
        return Gas(self.n, packing_fraction=self.packing_fraction, start=self.start)

    @property
    def frozen(self) -> bool:
        """Whether the equilibrium state of one species at this density is no fluid."""
        return self.diameter_ratio == 1.0 and self.packing_fraction > FREEZING.get(self.dim, 1.0)

    @property
    def on_lattice(self) -> bool:
        """Whether the particles start on a lattice."""
        return self.start == "lattice" or (self.start == "auto" and self.frozen)

    @property
    def periodic(self) -> bool:
        """Whether all axes are periodic."""
        return self.boundary == "periodic" or set(self.boundary) == {"periodic"}

    @property
    def dense(self) -> bool:
        """Whether random placement would take too long."""
        return is_dense(self.dim, self.packing_fraction)

    @property
    def repeated(self) -> bool:
        """Whether the start is a small box repeated."""
        large = self.n >= REPEATED_FROM and self.packing_fraction > REPEATED_ABOVE
        return large and self.periodic and not self.on_lattice

    @property
    def discarded(self) -> float:
        """Collisions per particle to discard before timing."""
        if self.on_lattice:
            return AT_LEAST if self.frozen else MELTED
        return RELAXED if self.dense and not self.repeated else AT_LEAST

    def describe_start(self) -> str:
        """Return the initial state in words."""
        if self.on_lattice:
            return "crystal" if self.frozen else "lattice"
        made = "random, compressed" if self.dense else "random"
        return f"{made}, a relaxed box repeated" if self.repeated else made

    def species(self, n: int) -> tuple[Any, Any]:
        """Return radii and masses of n particles."""
        return two_species(n, self.diameter_ratio, self.mass_ratio, self.fraction)

    def scene(self, seed: int) -> hs.Scene:
        """Return the start that belongs to a seed.

        Raises
        ------
        SceneError
            If there is none.
        """
        require_room_for(self.n)
        return self._repeated(seed) if self.repeated else self._piece(self.n, self.packing_fraction, seed)

    def _piece(self, n: int, packing_fraction: float, seed: int) -> hs.Scene:
        make = hs.lattice_gas if self.on_lattice else maker(self.dim, self.packing_fraction)
        radii, masses = self.species(n)
        return make(
            n=n,
            packing_fraction=packing_fraction,
            dim=self.dim,
            boundary=self.boundary,
            radii=radii,
            masses=masses,
            seed=seed,
        )

    def _repeated(self, seed: int) -> hs.Scene:
        """Return periodic copies of a relaxed box, with particles in random order and new velocities.

        If n is no multiple, a few particles are left out at random and the copies are denser accordingly.
        """
        copies = max(2, round((self.n / PIECE) ** (1 / self.dim)))
        piece = math.ceil(self.n / copies**self.dim)
        radii, masses = (
            np.tile(np.broadcast_to(each, piece), copies**self.dim) for each in self.species(piece)
        )
        kept = np.random.default_rng([seed, copies]).permutation(len(radii))[: self.n]
        surplus = np.sum(radii**self.dim) / np.sum(radii[kept] ** self.dim)
        relaxed = hs.Simulation(self._piece(piece, self.packing_fraction * float(surplus), seed))
        relaxed.run(collisions=round((RELAXED if self.dense else MELTED) * piece / 2))
        box = relaxed.scene.box
        corners = np.indices((copies,) * self.dim).reshape(self.dim, -1).T * box
        positions = (corners[:, None, :] + relaxed.positions).reshape(-1, self.dim)[kept]
        scene = hs.Scene(positions, np.zeros_like(positions), radii[kept], masses[kept], copies * box)
        return scene.with_state(scene.positions, hs.draw_velocities(scene, "maxwell", seed=seed))

    def theory(self, scene: hs.Scene) -> theory.Prediction | None:
        """Return the compressibility factor of the fluid, None where no theory holds.

        One species: `analysis.theory.finite_size_compressibility`. Mixtures: `mixture_compressibility`,
        without a correction for n. Between walls and above freezing there is none.
        """
        if not scene.periodic.all() or self.packing_fraction > THEORY_UP_TO[self.dim]:
            return None
        if self.diameter_ratio == 1.0:
            return theory.finite_size_compressibility(scene.packing_fraction, self.dim, self.n)
        radii, counts = np.unique(scene.radii, return_counts=True)
        return theory.mixture_compressibility(counts / scene.volume, 2 * radii, self.dim)
