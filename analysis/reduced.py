"""Velocities in thermal units, in which all species look alike at equilibrium."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import drift, kinetic_energy, times_each

if TYPE_CHECKING:
    from hardspheres import Frame, Scene

__all__ = ["Gas", "reduced_velocities", "species_labels"]

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
    peculiar = frame.velocities - drift(frame.velocities, masses, periodic)
    temperature = 2.0 * kinetic_energy(peculiar, masses) / scene.degrees_of_freedom
    if not temperature > 0.0:
        raise ValueError(
            "nothing moves in this frame; a gas without thermal motion has no velocity distribution"
        )
    return times_each(np.sqrt(masses / temperature), peculiar), temperature


@dataclass(frozen=True, eq=False)
class Gas:
    """What an estimator keeps of the scene that a simulation starts from: all but the particles.

    Attributes
    ----------
    n, dim, box, boundary, volume, packing_fraction, temperature, degrees_of_freedom
        As those of the `hardspheres.Scene`.
    sizes : (k,) int array
        Number of particles of each species, in the order of `Scene.species`.
    diameters, masses : (k,) arrays
        Of one particle of each species.
    momentum_shares : (k,) array
        Share of the energy of one particle that a conserved momentum takes, m/M where all axes are periodic.
    """

    n: int
    dim: int
    box: FloatArray
    boundary: tuple[str, ...]
    volume: float
    packing_fraction: float
    temperature: float
    degrees_of_freedom: int
    sizes: NDArray[np.int64]
    diameters: FloatArray
    masses: FloatArray
    momentum_shares: FloatArray

    @classmethod
    def of(cls, scene: Scene) -> Gas:
        """Return the gas of a scene, found once; ValueError where it has obstacles."""
        if scene not in _FOUND:
            if scene.n_moving < scene.n:
                raise ValueError(
                    f"this scene has {scene.n - scene.n_moving} obstacles (infinite mass), and estimators "
                    "measure gases without; read what the simulation and its log tell"
                )
            first = np.unique(scene.species, return_index=True)[1]
            conserved = float(np.mean(scene.periodic)) if scene.n > 1 else 0.0
            masses = scene.masses[first]
            shares = conserved * masses / scene.masses.sum()
            same: dict[str, Any] = {field.name: getattr(scene, field.name) for field in fields(cls)[:8]}
            sizes, diameters = np.bincount(scene.species), 2.0 * scene.radii[first]
            _FOUND[scene] = cls(
                **same, sizes=sizes, diameters=diameters, masses=masses, momentum_shares=shares
            )
        return _FOUND[scene]

    def __str__(self) -> str:
        """Return what gas it is, in words."""
        species = f" of {len(self.sizes)} species" if len(self.sizes) > 1 else ""
        return f"{self.n} particles{species} in {self.dim}D at packing fraction {self.packing_fraction:.4g}"

    def __repr__(self) -> str:
        """Return what gas it is."""
        words = dict.fromkeys(self.boundary)
        return f"<Gas: {self}, {' and '.join(words)} box, temperature {self.temperature:.6g}>"

    @property
    def periodic(self) -> NDArray[np.bool_]:
        """Which axes are periodic, (d,)."""
        return np.array([word == "periodic" for word in self.boundary])

    @property
    def labels(self) -> list[str]:
        """One label per species, with its mass and diameter; "all" for a single one."""
        if len(self.sizes) == 1:
            return ["all"]
        pairs = zip(self.masses, self.diameters, strict=True)
        return [f"m = {mass:.3g}, \u03c3 = {diameter:.3g}" for mass, diameter in pairs]

    @property
    def mean_diameter(self) -> float:
        """Mean diameter of all particles."""
        return float(self.sizes @ self.diameters) / self.n

    @property
    def mean_a2(self) -> float:
        """Mean of a2 of all particles over gases at equilibrium, from `theory.finite_energy_law`.

        Exact at fixed energy of N particles of any masses; `theory.equilibrium_a2`, -2/(D + 2), where they
        are equal.
        """
        whole, free = self.dim * self.n, self.degrees_of_freedom
        fourth = float(self.sizes @ (1.0 - self.momentum_shares) ** 2) / self.n
        return fourth * whole**2 / (free * (free + 2.0)) - 1.0

    @property
    def species_degrees_of_freedom(self) -> FloatArray:
        """Degrees of freedom of each species, (k,)."""
        return np.asarray(self.dim * self.sizes * (1.0 - self.momentum_shares))

    def difference(self, other: Gas) -> str:
        """Return in what another gas differs, in words; an empty string where it does not."""
        for name, words in _COMPARED.items():
            own, value = getattr(self, name), getattr(other, name)
            exact = name in ("dim", "sizes", "boundary")
            if not (np.array_equal(own, value) if exact else np.allclose(own, value, rtol=1e-6, atol=0.0)):
                value, own = (f"{x:.6g}" if isinstance(x, float) else f"{x}" for x in (value, own))
                return f"{words} {value}; expected {own}"
        return ""


_FOUND: WeakKeyDictionary[Scene, Gas] = WeakKeyDictionary()
_COMPARED = {
    "dim": "dimension",
    "sizes": "particles of each species",
    "boundary": "boundary",
    "box": "box",
    "diameters": "diameters",
    "masses": "masses",
    "temperature": "temperature",
}


def species_labels(frame: Frame) -> list[str]:
    """Return one label per species of a frame's scene, with its mass and diameter."""
    return Gas.of(frame.scene).labels
