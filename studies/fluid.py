"""Initial states of fluids: one or two species, placed at random or, where dense, grown.

A fluid that is not dense is placed one particle after another. A dense one is grown from small spheres,
because a lattice near freezing does not melt in any affordable run (fcc at packing fraction 0.49, for one).
The length of equilibration before any measurement follows one rule, `Fluid.discarded`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.correlation_times import virial_block_length
from analysis.statistics import TheoryCheck
from hardspheres import gases
from hardspheres.compression import order_of_crystal
from hardspheres.memory import require_room_for
from hardspheres.scene import sphere_volume

__all__ = [
    "FREEZING",
    "LONGEST",
    "RANDOM_UP_TO",
    "RELAXED",
    "THEORY_UP_TO",
    "Boundary",
    "Fluid",
    "box_of",
    "broken",
    "check_length",
    "check_spread",
    "collisions_at",
    "is_dense",
    "kind_of",
    "maker",
    "number_fraction",
    "ordered",
    "representatives",
    "two_species",
]

FloatArray = NDArray[np.float64]
Boundary = str | tuple[str, ...]

LONGEST = 1e9
"""Largest number of collisions per particle of a study: years of computing."""

FREEZING = {2: 0.70, 3: gases.FREEZING}
"""Packing fractions up to which the fluid counts as the state in equilibrium. Spheres: see `gases.FREEZING`;
discs freeze at 0.70 (Engel et al. 2013, doi 10.1103/PhysRevE.87.042134)."""
THEORY_UP_TO = {2: 0.66, 3: 0.494}
RANDOM_UP_TO = {2: 0.45, 3: 0.30}  # packing fractions: random placement nears its limit above
RELAXED = (
    # collisions per particle after growth; each moves half a diameter or more
    100.0
)
ENOUGH_TO_COMPILE = 2000  # particles from which on the method of search is that of larger gases
ENOUGH_TO_SHARE = 8000  # from which on two threads can share a dense gas
SETTLED = 20.0  # collisions per particle after random placement


def is_dense(dim: int, packing_fraction: float) -> bool:
    """Return whether random placement would take too long."""
    return packing_fraction > RANDOM_UP_TO.get(dim, 0.0)


def maker(dim: int, packing_fraction: float) -> Callable[..., hs.Scene]:
    """Return the maker of a fluid of this density: `random_gas`, or `compressed_gas` where dense."""
    return hs.compressed_gas if is_dense(dim, packing_fraction) else hs.random_gas


def two_species(
    n: int, diameter_ratio: float = 1.0, mass_ratio: float = 1.0, fraction: float = 0.5
) -> tuple[FloatArray | float, FloatArray | float]:
    """Return radii and masses of n particles, the last of which are a second species.

    Parameters
    ----------
    n : int
        Number of particles.
    diameter_ratio, mass_ratio : float
        Of the second species over the first's, which has diameter 1 and mass 1.
    fraction : float
        Number fraction of the second species.

    Returns
    -------
    radii, masses : (n,) arrays
        Single numbers where both ratios are 1.

    Raises
    ------
    SceneError
        If there is not enough memory for so many particles.
    """
    if diameter_ratio == mass_ratio == 1.0:
        return 0.5, 1.0
    require_room_for(n)
    second = np.arange(n) >= n - round(fraction * n)
    return np.where(second, 0.5 * diameter_ratio, 0.5), np.where(second, mass_ratio, 1.0)


@dataclass(frozen=True)
class Fluid:
    """A fluid to measure, in reduced units: the first species has diameter 1 and mass 1, and kT is 1.

    Attributes
    ----------
    n, dim, packing_fraction, boundary
        As in `hardspheres.random_gas`.
    diameter_ratio, mass_ratio : float
        Diameter and mass of the second species over the first's.
    fraction : float
        Number fraction of the second species; without effect when both ratios are 1.
    """

    n: int = 4000
    dim: int = 3
    packing_fraction: float = 0.3
    boundary: Boundary = "periodic"
    diameter_ratio: float = 1.0
    mass_ratio: float = 1.0
    fraction: float = 0.5

    @property
    def mixed(self) -> bool:
        """Whether there are two species."""
        return (self.diameter_ratio, self.mass_ratio) != (1.0, 1.0)

    @property
    def units(self) -> dict[str, float]:
        """Diameter and mass of the first species, and kT: arguments of the functions of `analysis.theory`."""
        return {"diameter": 1.0, "mass": 1.0, "temperature": 1.0}

    def named(self, quantity: str) -> str:
        """Return the name of a measured number in an answer: with its unit, where it has one."""
        return quantity

    def in_units(self, numbers: Iterable[TheoryCheck]) -> list[TheoryCheck]:
        """Return numbers as an answer has them: converted and named where they have units."""
        return list(numbers)

    @property
    def remarks(self) -> list[str]:
        """What is to be known of the fluid beside any result."""
        return []

    @property
    def species(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Number densities, diameters and masses of the species, each (k,)."""
        second = round(self.fraction * self.n) if self.mixed else 0
        kinds = 2 if self.mixed else 1
        counts = np.array([self.n - second, second], dtype=float)[:kinds]
        diameters, masses = np.array([1.0, self.diameter_ratio])[:kinds], np.array([1.0, self.mass_ratio])
        diameters, masses = diameters * self.units["diameter"], masses[:kinds] * self.units["mass"]
        volume = float(counts @ sphere_volume(diameters / 2, self.dim)) / self.packing_fraction
        return counts / volume, diameters, masses

    @property
    def dense(self) -> bool:
        """Whether it starts by growth."""
        return is_dense(self.dim, self.packing_fraction)

    @property
    def periodic(self) -> bool:
        """Whether all axes are periodic."""
        return self.boundary == "periodic" or set(self.boundary) == {"periodic"}

    @property
    def discarded(self) -> float:
        """Collisions per particle to discard before any measurement."""
        return max(RELAXED, virial_block_length(self.packing_fraction, self.dim)) if self.dense else SETTLED

    @property
    def kind(self) -> str:
        """What the engine is compiled for, in words."""
        return _kind(self.dim, 2 if self.mixed else 1, self.boundary)

    def check(self) -> None:
        """Raise SceneError where this is no fluid, or has too many particles for the memory."""
        require_room_for(self.n)
        limit = FREEZING.get(self.dim, 1.0)
        kind = "spheres" if self.dim == 3 else "discs"
        if self.packing_fraction > limit:
            raise hs.SceneError(
                f"packing fraction {self.packing_fraction:g} is above {limit:g}, where hard {kind} freeze; "
                "this study is of fluids, ask for less"
            )

    def check_within(self, theory: str) -> None:
        """Raise SceneError where this is no fluid, or is denser than the range of this theory."""
        self.check()
        limit = THEORY_UP_TO[self.dim]
        if self.packing_fraction > limit:
            raise hs.SceneError(
                f"packing fraction {self.packing_fraction:g} is above {limit:g}, where {theory} ends; ask "
                "for less"
            )

    def scene(self, seed: np.random.SeedSequence, velocities: str = "maxwell") -> hs.Scene:
        """Return the start that belongs to a seed.

        Raises
        ------
        SceneError
            If there is none.
        """
        radii, masses = two_species(self.n, self.diameter_ratio, self.mass_ratio, self.fraction)
        return maker(self.dim, self.packing_fraction)(
            n=self.n,
            packing_fraction=self.packing_fraction,
            dim=self.dim,
            boundary=self.boundary,
            velocities=velocities,
            temperature=self.units["temperature"],
            radii=radii * self.units["diameter"],
            masses=masses * self.units["mass"],
            seed=seed,
        )

    @property
    def settled(self) -> int:
        """Pair collisions by which a run from `scene` has completed `discarded`."""
        return math.ceil(self.discarded * self.n / 2)

    def settle(self, simulation: hs.Simulation) -> int:
        """Run for `discarded` and return how many pair collisions that were."""
        simulation.run(collisions=self.settled)
        return simulation.collisions

    def __str__(self) -> str:
        """Return the fluid in words."""
        text = f"{self.n} hard {'spheres' if self.dim == 3 else 'discs'}"
        if self.mixed:
            text += f", diameters 1:{self.diameter_ratio:g}, masses 1:{self.mass_ratio:g}"
            text += f", {self.fraction:g} of them of the second species"
        return f"{text}, {box_of(self.boundary)}"


def box_of(boundary: Boundary) -> str:
    """Return the box in words."""
    words = [boundary] if isinstance(boundary, str) else boundary
    if len(set(words)) == 1:
        return f"{words[0]} box"
    walled = ", ".join(axis for axis, word in zip("xyz", words, strict=False) if word == "wall")
    return f"box with walls along {walled}, periodic else"


def _kind(dim: int, species: int, boundary: Boundary) -> str:
    mixture = "" if species == 1 else f" of {'two' if species == 2 else species} species"
    return f"hard {'spheres' if dim == 3 else 'discs'}{mixture}, {box_of(boundary)}"


def kind_of(scene: hs.Scene) -> str:
    """Return what the engine is compiled for, in words."""
    return _kind(scene.dim, len(np.unique(scene.species[~scene.obstacles])), scene.boundary)


def ordered(simulation: hs.Simulation) -> bool:
    """Return whether equal particles show the bond order of a crystal, see `hardspheres.compressed_gas`."""
    return order_of_crystal(simulation.to_scene()) is not None


def broken(simulation: hs.Simulation) -> str | None:
    """Return the violation that `Simulation.check` finds, or None."""
    try:
        simulation.check()
    except hs.InvariantError as error:
        return str(error)
    return None


def check_length(collisions_per_particle: float, fewest: float, why: str) -> None:
    """Raise SceneError where a run is too short, or too long to be intended.

    Parameters
    ----------
    collisions_per_particle : float
        As on the command line.
    fewest : float
        Collisions per particle that are needed.
    why : str
        What a shorter run cannot give.
    """
    said = f"--collisions-per-particle {collisions_per_particle:g}"
    if collisions_per_particle > LONGEST:
        raise hs.SceneError(f"{said} would never end; ask for at most {LONGEST:g}")
    if not collisions_per_particle >= fewest:
        enough = f"{math.ceil(fewest)}" if fewest >= 100 else f"{fewest:.3g}"
        raise hs.SceneError(f"{said} {why}; ask for at least {enough}")


def check_spread(replicas: int) -> None:
    """Raise SceneError where there are too few replicas for error bars that come from their spread."""
    if replicas < 4:
        raise hs.SceneError(
            f"--replicas {replicas} gives no error bar, which comes from their spread; ask for at least 4"
        )


def collisions_at(s: float, n: int) -> int:
    """Return after how many pair collisions s collisions per particle are reached."""
    return math.ceil(s * n / 2 - 1e-9)


def number_fraction(fraction: float | None, diameter_ratio: float, mass_ratio: float) -> float:
    """Return --fraction, 0.5 where it is not given; SceneError where there is no second species."""
    if fraction is not None and diameter_ratio == mass_ratio == 1.0:
        raise hs.SceneError("--fraction needs --mass-ratio or --diameter-ratio")
    return 0.5 if fraction is None else fraction


def representatives(gases: Sequence[Any], threads: int = 1) -> list[Any]:
    """Return gases that need every kernel that all of them need: of each kind a few, dense ones small.

    Parameters
    ----------
    gases : sequence of Fluid
        By ascending packing fraction within each kind; a gas of another class stands for itself.
    threads : int
        That run each of them.
    """
    enough = ENOUGH_TO_COMPILE if threads == 1 else ENOUGH_TO_SHARE
    found = []
    for kind in dict.fromkeys(gas.kind for gas in gases):
        same = [gas for gas in gases if gas.kind == kind]
        easy = [gas for gas in same if not (isinstance(gas, Fluid) and gas.dense)]
        dense = [replace(gas, n=min(gas.n, enough)) for gas in same if gas not in easy]
        found += [*easy[:1], *easy[-1:], *dense[:1]]
    return list(dict.fromkeys(found))
