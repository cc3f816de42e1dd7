"""Velocities in thermal units, in which all species look alike at equilibrium."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import drift, thermal_energy

if TYPE_CHECKING:
    from hardspheres import Frame, Scene

__all__ = ["Species", "mean_a2", "reduced_velocities", "species_labels"]

FloatArray = NDArray[np.float64]


def reduced_velocities(frame: Frame) -> tuple[FloatArray, float]:
    """Return the velocities in thermal units and the temperature they refer to.

    Parameters
    ----------
    frame : Frame
        A moment of a simulation.

    Returns
    -------
    c : (N, d) array
        (v - u) sqrt(m/kT), dimensionless.
    temperature : float
        kT = 2 K_th / D, [energy].

    Raises
    ------
    ValueError
        If nothing moves.
    """
    scene = frame.scene
    masses, periodic = scene.masses, scene.periodic
    temperature = 2.0 * thermal_energy(frame.velocities, masses, periodic) / scene.degrees_of_freedom
    if not temperature > 0.0:
        raise ValueError(
            "nothing moves in this frame; a gas without thermal motion has no velocity distribution"
        )
    peculiar = frame.velocities - drift(frame.velocities, masses, periodic)
    return peculiar * np.sqrt(masses / temperature)[:, None], temperature


@dataclass(frozen=True)
class Species:
    """What a scene has of each species, in the order of `Scene.species`.

    Attributes
    ----------
    sizes : (k,) int array
        Number of particles.
    diameters, masses : (k,) arrays
        Of one particle.
    momentum_shares : (k,) array
        Share of the energy of one particle that a conserved momentum takes, m/M where all axes are periodic.
    """

    sizes: NDArray[np.int64]
    diameters: FloatArray
    masses: FloatArray
    momentum_shares: FloatArray

    @classmethod
    def of(cls, scene: Scene) -> Species:
        """Return the species of a scene, found once."""
        if scene in _FOUND:
            return _FOUND[scene]
        first = np.unique(scene.species, return_index=True)[1]
        conserved = float(np.mean(scene.periodic)) if scene.n > 1 else 0.0
        masses = scene.masses[first]
        shares = conserved * masses / scene.masses.sum()
        found = cls(np.bincount(scene.species), 2.0 * scene.radii[first], masses, shares)
        _FOUND[scene] = found
        return found


_FOUND: WeakKeyDictionary[Scene, Species] = WeakKeyDictionary()


def mean_a2(scene: Scene) -> float:
    """Return the mean of a2 of all particles over gases at equilibrium, from `theory.finite_energy_law`.

    Exact at fixed energy of N particles of any masses; `theory.equilibrium_a2`, -2/(D + 2), where they are
    equal.
    """
    species = Species.of(scene)
    whole, free = scene.dim * scene.n, scene.degrees_of_freedom
    fourth = float(species.sizes @ (1.0 - species.momentum_shares) ** 2) / scene.n
    return fourth * whole**2 / (free * (free + 2.0)) - 1.0


class HasScene(Protocol):
    """A frame, or an estimator."""

    @property
    def scene(self) -> Scene:
        """The gas."""
        ...


def species_labels(frame: HasScene) -> list[str]:
    """Return one label per species of a frame's scene, with its mass and diameter."""
    species = Species.of(frame.scene)
    if len(species.sizes) == 1:
        return ["all"]
    pairs = zip(species.masses, species.diameters, strict=True)
    return [f"m = {mass:.3g}, \u03c3 = {diameter:.3g}" for mass, diameter in pairs]
