"""The units in which tallies are summed (`hardspheres.sums`): powers of two that the scene decides.

A sum holds multiples of 2^-47 units exactly while it stays below 2^53. With the unit of energy 2^-8 of what a
particle has on average (twice its kinetic energy, or what it can gain by falling), and likewise for momentum
and what is made of the two and a length or time:

- a typical term, 2^8 units, is rounded to 2^-48 units, 2^-56 of itself: less than float64 has rounded it;
- all energy in one of 10^9 particles makes one term of 2^38 units, which is exact, too;
- 10^12 typical terms (2^40) of one sign add up to 2^48 units.

Masses that differ by a factor of 2^12 cost 6 of these bits. Paths l and free times have units of their own,
for each species: V / (N sigma^(d-1)), and the time for that. In a dilute gas <l>, <l^2>, <l^3> are less than
half, all, and all of these, and their sums count 2^11, 2^12, 2^11 units in one of these; so those of the
2 x 10^12 flights of 10^12 collisions stay below 2^53. Flights of dense gases are a tenth as long: a cube is
rounded to 2^-45 of itself, which the sum of many does not show. There is no longest flight: one of 10^4 such
units makes a sum of cubes that is rounded as float64 is.

Units scale as lengths, times and masses do if these are multiplied by powers of two.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import Scene
from hardspheres.tuning import fall_square, mean_square, moving, power_of_two_below

__all__ = ["TallyUnits", "per_unit", "tally_units", "write_tally_units"]

Floats = NDArray[np.float64]
SPARE = 2.0**8  # units in a typical term


class TallyUnits(NamedTuple):
    """Powers of two about what a particle typically has."""

    energy: float
    momentum: float
    length: float


def mean(values: Floats) -> float:
    """Mean of positive numbers, rounded once, so that it does not depend on their order."""
    first = float(values[0])
    return first if np.all(values == first) else math.fsum(values.data) / len(values)


def tally_units(scene: Scene) -> TallyUnits:
    """Return the scales of energy, momentum and contact distance of a scene; energy is 1 where none moves."""
    masses = np.ascontiguousarray(moving(scene.masses, scene))
    mass = mean(masses)
    both = [
        mean_square(moving(scene.velocities, scene) * np.sqrt(masses)[:, None]),
        mass * fall_square(scene),
    ]
    energy = max([power_of_two_below(one) for one in both if one > 0.0], default=1.0)
    both_exponents = math.frexp(energy)[1] + math.frexp(mass)[1] - 2  # their product may be too small
    momentum = math.ldexp(1.0, both_exponents // 2)
    return TallyUnits(energy, momentum, 2.0 * power_of_two_below(mean(scene.radii)))


def flight_units(scene: Scene, kinds: NDArray[np.int32]) -> Floats:
    """Return powers of two about the paths and free times in a dilute gas, of each species, (k, 2)."""
    energy, radius = tally_units(scene).energy, mean(scene.radii)
    found = []
    for k in np.unique(kinds, return_index=True)[1].tolist():
        path, across = scene.volume / scene.n, float(scene.radii[k]) + radius
        for _ in range(scene.dim - 1):
            path /= across
        mass = float(scene.masses[k])
        time = path / math.sqrt(energy / mass) if mass < math.inf else 1.0  # no obstacle has flights
        found.append([power_of_two_below(1.5 * path), power_of_two_below(1.5 * time)])
    return np.array(found)


def write_tally_units(at: Any, units: TallyUnits, length: float, number: Any) -> None:
    """Write 1 / the unit of each kind of sum to the numbers of kernels; `length` is that of an epoch."""
    energy, momentum, contact = units
    speed = energy / momentum
    number[at.PER_IMPULSE] = SPARE / momentum
    number[at.PER_VIRIAL] = SPARE / momentum / contact
    number[at.PER_STRESS] = SPARE / energy
    number[at.PER_STRESS_MOMENT] = SPARE / energy / length
    number[at.PER_HEAT_TRANSFER] = SPARE / energy / contact
    number[at.PER_HEAT_FLUX] = SPARE / energy / speed
    number[at.PER_HEAT_MOMENT] = SPARE / energy / speed / length


def per_unit(at: Any, number: Any) -> Floats:
    """Return 1 / the unit of each sum that is none of flights."""
    kinds = {
        at.VIRIAL: at.PER_VIRIAL,
        at.STRESS: at.PER_STRESS,
        at.STRESS_MOMENT: at.PER_STRESS_MOMENT,
        at.WALL_IMPULSE: at.PER_IMPULSE,
        at.WALL_RADIUS_IMPULSE: at.PER_VIRIAL,
    }
    if at.HEAT:
        kinds |= {
            at.HEAT_TRANSFER: at.PER_HEAT_TRANSFER,
            at.HEAT_FLUX: at.PER_HEAT_FLUX,
            at.HEAT_MOMENT: at.PER_HEAT_MOMENT,
        }
    kinds[at.LEDGER] = at.PER_IMPULSE
    ends = [*list(kinds)[1:], at.SUMS]
    counts = [end - first for first, end in zip(kinds, ends, strict=True)]
    return np.repeat(number[list(kinds.values())], counts)
