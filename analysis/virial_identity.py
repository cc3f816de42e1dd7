"""Clausius' virial theorem for any run between walls, to round-off: a test of engine and tallies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.estimator import require_same_simulation, tallies_of

if TYPE_CHECKING:
    from hardspheres import Frame

__all__ = ["VirialIdentity", "virial_identity"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class VirialIdentity:
    """Both sides of the virial theorem along each wall axis, [energy time].

    Attributes
    ----------
    axes : (w,) int array
        The wall axes.
    inside : (w,) array
        Integral of sum m v_k^2 over time, and sum of r_k dp_k over collisions.
    walls : (w,) array
        L_k J_high - (R J)_high - (R J)_low: impulses on the walls, each with the place of the particle's
        centre.
    boundary : (w,) array
        G_k(end) - G_k(start), G_k = sum of m x_k v_k.
    """

    axes: NDArray[np.intp]
    inside: FloatArray
    walls: FloatArray
    boundary: FloatArray

    def __repr__(self) -> str:
        """Return how well both sides agree."""
        return f"<VirialIdentity along {len(self.axes)} axes between walls: residual {self.residual:.1e}>"

    @property
    def residual(self) -> float:
        """Largest |inside - walls - boundary| over |inside|: round-off, if engine and tallies are right."""
        return float(np.max(np.abs(self.inside - self.walls - self.boundary) / np.abs(self.inside)))


def virial_identity(start: Frame, end: Frame) -> VirialIdentity:
    """Return both sides of Clausius' virial theorem for a run between walls.

    Along every wall axis k, exactly, for any run of any gas: integral of sum m v_k^2 dt + sum over collisions
    of r_k dp_k = sum over collisions with the high wall of (L_k - R_i) J_i - sum over those with the low wall
    of R_i J_i + G_k(end) - G_k(start), G_k = sum of m x_k v_k, because the left side less the walls' part is
    the integral of dG_k/dt (Clausius, Phil. Mag. 40, 122 (1870)).

    Parameters
    ----------
    start, end : Frame
        Two frames of a simulation: the gas before and after the run.

    Raises
    ------
    ValueError
        If no axis has walls, the frames are of two simulations or of none, or the end is not after the start.
    """
    scene = start.scene
    axes = np.flatnonzero(~scene.periodic)
    if not len(axes):
        raise ValueError("the scene is periodic along every axis; the identity needs a wall axis")
    require_same_simulation(scene, end)
    if not end.time > start.time:
        raise ValueError(
            f"the end is at time {end.time:g}, the start at {start.time:g}; the start comes first"
        )

    def sides(frame: Frame) -> FloatArray:
        """Both sides, counted from the start of the simulation, and G, along the wall axes."""
        tallies = tallies_of(frame)
        inside = np.diag(tallies.kinetic) + np.diag(tallies.virial)
        walls = scene.box * tallies.wall_impulses[:, 1] - tallies.wall_radius_impulses.sum(axis=1)
        moment = np.einsum("i,ik,ik->k", scene.masses, frame.positions, frame.velocities)
        return np.array([inside, walls, moment])[:, axes]

    inside, walls, boundary = sides(end) - sides(start)
    return VirialIdentity(axes, inside, walls, boundary)
