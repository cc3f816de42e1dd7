"""A fluid in a tall box under gravity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.barometer import barometer_of
from analysis.theory import Barometer
from hardspheres.placement import place_at_random
from hardspheres.scene import sphere_volume
from studies.fluid import RANDOM_UP_TO, THEORY_UP_TO, Fluid, two_species

__all__ = ["Atmosphere"]

FloatArray = NDArray[np.float64]

ASPECT = 3.0  # height of the box over its width
DECAYED = 5.0  # decay times of the slowest wave that are discarded
FEWEST = 20.0  # collisions per particle that are, at least


@dataclass(frozen=True)
class Atmosphere:
    """A fluid between floor and lid, in units of the first species' diameter and mass, and kT.

    Attributes
    ----------
    fluid : Fluid
        Particles, mean packing fraction of the box, and boundaries, the last of them walls.
    scale_heights : float
        Height of the box over kT/(m g), m the mean mass.
    at_rest : bool
        Whether particles start at rest all over the box; kT is then what that energy gives.
    """

    fluid: Fluid
    scale_heights: float
    at_rest: bool = False

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.fluid.n

    @property
    def dim(self) -> int:
        """Dimension."""
        return self.fluid.dim

    @property
    def packing_fraction(self) -> float:
        """Mean packing fraction of the box."""
        return self.fluid.packing_fraction

    @property
    def kind(self) -> str:
        """What the engine is compiled for, in words."""
        return f"{self.fluid.kind}, gravity"

    @cached_property
    def sizes_and_masses(self) -> tuple[FloatArray, FloatArray]:
        """Radii and masses of all particles, (n,) each."""
        one = self.fluid
        sizes, masses = two_species(one.n, one.diameter_ratio, one.mass_ratio, one.fraction)
        return np.broadcast_to(sizes, one.n).astype(float), np.broadcast_to(masses, one.n).astype(float)

    @cached_property
    def box(self) -> FloatArray:
        """Edges."""
        volume = float(sphere_volume(self.sizes_and_masses[0], self.dim).sum()) / self.packing_fraction
        width = (volume / ASPECT) ** (1.0 / self.dim)
        return np.array([*[width] * (self.dim - 1), ASPECT * width])

    @property
    def g(self) -> float:
        """Acceleration, downwards."""
        return self.scale_heights / float(self.sizes_and_masses[1].mean() * self.box[-1])

    @cached_property
    def theory(self) -> Barometer:
        """The theory; of unequal diameters that of their mean volume, for a start and for what is refused."""
        radii, masses = self.sizes_and_masses
        kinds, counts = np.unique(masses, return_counts=True)
        mean = 2.0 * float(np.mean(radii**self.dim)) ** (1.0 / self.dim)
        periodic = np.array([word == "periodic" for word in self.fluid.boundary])
        freedom = self.dim * self.n - periodic.sum()
        found = barometer_of(
            self.box, periodic, counts, kinds * self.g, np.full(len(kinds), mean), freedom, self.dim - 1
        )
        assert found is not None
        return found

    @cached_property
    def slab(self) -> float:
        """Height up to which particles are placed evenly: their potential energy is then that at kT = 1."""
        if self.at_rest:
            return float(self.box[-1])
        known, radius = self.theory, float(self.sizes_and_masses[0].mean())
        heavy = float(np.dot(known.counts, known.weights))
        mean = (known.energy(1.0) - 0.5 * known.freedom) / heavy
        return min(2.0 * mean + 2.0 * radius, float(self.box[-1]))

    @property
    def rate(self) -> float:
        """Collisions per particle and time at the mean density."""
        return float(theory.collision_rate(self.packing_fraction, self.dim))

    @property
    def settling(self) -> float:
        """Time that is discarded: until waves between floor and lid have died out."""
        q = math.pi / float(self.box[-1])
        damped = float(theory.sound_damping(self.packing_fraction, self.dim).value) * q * q
        wave = float(theory.sound_speed(self.packing_fraction, self.dim).value) * q
        mu = self.fluid.mass_ratio  # of unequal masses it takes more collisions to share their energy
        return max(FEWEST * (1.0 + mu) ** 2 / (4.0 * mu) / self.rate, DECAYED / min(damped, wave))

    def check(self) -> None:
        """Raise SceneError where this is no fluid under gravity."""
        self.fluid.check()
        if not self.packing_fraction > 0.0:
            raise hs.SceneError(f"--packing-fraction {self.packing_fraction:g} must be positive")
        advice = "ask for less, or for fewer --scale-heights"
        what = f"packing fraction {self.packing_fraction:g}, {self.scale_heights:g} scale heights high,"
        limit, floor = THEORY_UP_TO[self.dim], self.theory.floor()
        if not floor <= limit:
            raise hs.SceneError(
                f"{what} is more than {limit:g} at the floor, where the fluid would freeze; {advice}"
            )
        start = self.packing_fraction * float(self.box[-1]) / self.slab
        if start > RANDOM_UP_TO[self.dim]:
            raise hs.SceneError(f"{what} is too dense to be placed at random; {advice}")

    def scene(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return particles evenly in the lower part of the box, with the energy of kT = 1; or at rest."""
        radii, masses = self.sizes_and_masses
        places, speeds = np.random.default_rng(seed), seed.spawn(1)[0]
        lower = np.append(self.box[:-1], self.slab)
        periodic = np.array([word == "periodic" for word in self.fluid.boundary])
        positions = place_at_random(radii, lower, periodic, places)
        still = hs.Scene(
            positions,
            np.zeros_like(positions),
            radii,
            masses,
            self.box,
            self.fluid.boundary,
            gravity=(*[0.0] * (self.dim - 1), -self.g),
        )
        if self.at_rest:
            return still
        kinetic = self.theory.energy(1.0) - still.potential_energy
        if not kinetic > 0.0:
            raise hs.SceneError(
                "the particles were placed so high that nothing is left to move them; ask for more particles"
            )
        temperature = 2.0 * kinetic / self.theory.freedom
        return still.replace(velocities=hs.draw_velocities(still, temperature=temperature, seed=speeds))

    def __str__(self) -> str:
        """Return the gas in words."""
        return f"{self.fluid}, {self.scale_heights:g} scale heights high"
