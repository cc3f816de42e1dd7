"""Galperin's billiard: two balls and a wall that count out the digits of pi.

A light ball rests near a wall and a heavy one, 100^k times its mass, comes in along the line. They hit each
other, and the light one the wall, floor(pi 10^k) times in all (G. Galperin, Regul. Chaotic Dyn. 8, 375
(2003), doi:10.1070/RD2003v008n04ABEH000252): one collision too many or too few is seen at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import hardspheres as hs
from studies.validation.hard_cases.case import Case, Size, counted, kept, pick

TITLE = "Galperin's billiard"


def billiard(mass_ratio: float) -> hs.Scene:
    """Return the two discs in a channel long enough that the heavy one is through before it meets the far wall.

    Parameters
    ----------
    mass_ratio : float
        Of the heavy ball to the light one.
    """
    return hs.Scene(
        [[2.0, 2.0], [3.5, 2.0]], [[0.0, 0.0], [-1.0, 0.0]], [0.25, 0.5], [1.0, mass_ratio], (40, 4), "wall"
    )


@kept
def hits(mass_ratio: float) -> tuple[int, bool]:
    """Return the number of hits, and whether the balls then part for ever, the light one not faster than the heavy one."""
    simulation = hs.Simulation(billiard(mass_ratio))
    simulation.run(time=30.0)
    light, heavy = simulation.velocities[:, 0]
    return simulation.collisions + simulation.wall_collisions, 0.0 <= light <= heavy


def cases(size: Size) -> Iterator[Case]:
    """Yield one case for each mass ratio."""
    for k in range(pick(size, (5, 7, 8))):
        count, over = hits(100.0**k)
        name = f"mass ratio 100^{k}" + ("" if over else " (not over)")
        yield counted(name, int(math.pi * 10**k), count, "hits")
