"""Velocities in thermal units, in which all species look alike at equilibrium."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import drift, thermal_energy

if TYPE_CHECKING:
    from hardspheres import Frame

__all__ = ["reduced_velocities", "species_labels"]

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


def species_labels(frame: Frame) -> list[str]:
    """Return one label per species of a frame's scene, with its mass and diameter."""
    scene = frame.scene
    kinds, first = np.unique(scene.species, return_index=True)
    if len(kinds) == 1:
        return ["all"]
    return [f"m = {scene.masses[i]:.3g}, \u03c3 = {2 * scene.radii[i]:.3g}" for i in first]
