"""Galperin's billiard: collisions of two balls and a wall that count the digits of pi.

A light ball rests near a wall and a heavy one, 100^k times its mass, approaches along the line. The
collisions of the two and those of the light one with the wall are floor(pi 10^k) in all (G. Galperin, Regul.
Chaotic Dyn. 8, 375 (2003), doi:10.1070/RD2003v008n04ABEH000252): any missed or extra collision changes the
count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import hardspheres as hs
from studies.validation.hard_cases.case import Case, Size, counted, kept, pick

TITLE = "Galperin's billiard"


def billiard(mass_ratio: float) -> hs.Scene:
    """Return two discs in a channel so long that the count ends before the heavy one meets the far wall.

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
    """Return the number of collisions, and whether the balls then separate for ever."""
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
