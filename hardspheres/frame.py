"""What a simulation shows: the gas at one moment, and what was counted up to it."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import SimulationError
from hardspheres.free_paths import FreePaths
from hardspheres.scene import Scene, energy_flux, momentum_flux, read_only

__all__ = ["Frame", "Tallies"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Tallies:
    """What the engine counted.

    In `Simulation.tallies` since `reset_tallies`, in `Frame.tallies` from the start. Arrays are read-only.

    Attributes
    ----------
    time : float
        Simulated time.
    collisions, wall_collisions : int
        Pair collisions, and wall collisions.
    virial : (d, d) float64 array
        Sum of r_a dp_b over pair collisions, r the separation at contact and dp the momentum passed along it,
        [energy time].
    kinetic : (d, d) float64 array
        Integral over time of sum m v_a v_b, [energy time].
    wall_impulses : (d, 2) float64 array
        Momentum that the particles gave to the lower and upper wall of each axis; 0 on periodic axes.
    wall_radius_impulses : (d, 2) float64 array
        The same, each wall collision times the particle's radius.
    heat_transfer : (d,) float64 array, optional
        Sum of r_a dE over pair collisions, r from the centre that loses kinetic energy dE to the one that
        gains it, [energy length]; None unless the simulation has ``heat=True``.
    heat_flux : (d,) float64 array, optional
        Integral over time of sum v_a m v^2/2, [energy length]; as `heat_transfer`.
    """

    time: float
    collisions: int
    wall_collisions: int
    virial: Floats
    kinetic: Floats
    wall_impulses: Floats
    wall_radius_impulses: Floats
    heat_transfer: Floats | None = None
    heat_flux: Floats | None = None

    def __repr__(self) -> str:
        """Return how much was counted, and the traces and sums of it."""
        return (
            f"<Tallies of a time of {self.time:.6g}: {self.collisions} collisions, {self.wall_collisions} "
            f"with walls, virial {np.trace(self.virial):.6g}, kinetic {np.trace(self.kinetic):.6g}>"
        )


@dataclass(frozen=True)
class Frame:
    """The gas at one moment. The arrays in a frame of a simulation are read-only.

    Attributes
    ----------
    time : float
        Simulated time.
    collisions : int
        Pair collisions since the simulation was made.
    collisions_per_particle : float
        s = 2 collisions / N.
    positions : (N, d) float64 array
        Positions, on periodic axes within [0, L).
    velocities : (N, d) float64 array
        Velocities.
    scene : Scene
        Where the simulation started: radii, masses, box, boundary.
    unwound : tuple of positions, image counts and box, optional
        All that `unwrapped_positions` are made of, when they are asked for. None in a frame that no
        simulation made.
    counted : tuple of tallies, time, velocities and masses, optional
        All that `tallies` are made of, when they are asked for: they lack what the velocities add to the
        kinetic tensor and the heat flux in this time.
    free_paths : FreePaths, optional
        As `tallies`, of free flights, where the simulation tallies them. Otherwise None.
    """

    time: float
    collisions: int
    collisions_per_particle: float
    positions: Floats
    velocities: Floats
    scene: Scene
    unwound: tuple[Floats, NDArray[np.integer[Any]], Floats] | None = field(default=None, repr=False)
    counted: tuple[Tallies, float, Floats, Floats] | None = field(default=None, repr=False)
    free_paths: FreePaths | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Return when it is, and of what."""
        return (
            f"<Frame of {self.scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle)>"
        )

    @cached_property
    def tallies(self) -> Tallies | None:
        """What was counted since the start of the simulation, whatever `Simulation.reset_tallies` did.

        The difference of two frames is what was counted between them, to a rounding of the whole. None in a
        frame that no simulation made.
        """
        if self.counted is None:
            return None
        by_events, passed, velocities, masses = self.counted
        now = momentum_flux(velocities, masses) * passed
        whole = replace(by_events, kinetic=read_only(by_events.kinetic + now))
        if by_events.heat_flux is None:
            return whole
        flux = by_events.heat_flux + energy_flux(velocities, masses) * passed
        return replace(whole, heat_flux=read_only(flux))

    @property
    def unwrapped_positions(self) -> Floats:
        """Positions followed through the periodic boundaries from the start, shape (N, d).

        Raises
        ------
        SimulationError
            In a frame that no simulation made, such as one that was read from a file.
        """
        if self.unwound is None:
            raise SimulationError(
                "no simulation made this frame, so it is not known how often its particles crossed the "
                "periodic boundaries"
            )
        flown, images, box = self.unwound
        unwrapped: Floats = read_only(flown + images * box)
        return unwrapped
