"""Rough rates of a gas, from which its epochs follow, and what both searches (`lists`, `windows`) need.

Only the length of an epoch affects the trajectory; everything else affects only the speed.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import SimulationError
from hardspheres.scene import Scene, heights, sphere_volume, squared_lengths

Floats = NDArray[np.float64]

OUT_OF_PACE = 16.0  # factor by which an epoch may be too long or too short before it is changed
SEARCHES = ("auto", "lists", "windows")  # the faster one, or by name
SPARSE_BELOW = {2: 0.31, 3: 0.24}  # packing fraction below which windows are faster than lists
SPARSE_IN_SMALL_BOX = {2: 0.4, 3: 0.36}  # the same where lists store image indices
EVENTS_PER_BUCKET = {False: 8, True: 32}  # more of them where their data are prefetched
MOST_ENTRIES = 2**31 - 1  # of a table: its places are kept in 32 bits
SLACK = 1e-6  # relative margin of cells against rounding


def power_of_two_below(x: float) -> float:
    """Largest power of two that is not above x > 0; scaling x by a power of two scales the result exactly."""
    return math.ldexp(1.0, math.frexp(x)[1] - 1)


def root_of_power_below(x: float, degree: int) -> float:
    """Power of two 2^floor(log2(x) / degree), an approximate root without rounding."""
    return math.ldexp(1.0, (math.frexp(x)[1] - 1) // degree)


def epoch_length(scene: Scene) -> float:
    """Length of the first epochs: a power of two, one to four times the time to fly the mean distance.

    It depends on the scene alone, and on it in a way that scales exactly: multiplying all lengths or times by
    a power of two multiplies it by a power of two. Later ones: `pace`.
    """
    v2 = mean_square(moving(scene.velocities, scene)) + fall_square(scene)
    return 1.0 if v2 == 0.0 else epoch_length_at(scene, v2)


def moving(values: Floats, scene: Scene) -> Floats:
    """Return what there is for each particle without obstacles."""
    return values if scene.n_moving == scene.n else values[~scene.obstacles]


def filled_fraction(scene: Scene) -> float:
    """Packing fraction with obstacles, as if none overlapped."""
    return float(np.sum(sphere_volume(scene.radii, scene.dim))) / scene.volume


def fall_square(scene: Scene) -> float:
    """Mean square speed that particles gain by falling down, or over four mean distances if that is more.

    So an epoch is short enough that no particle falls by many mean distances from rest in it. Sums are
    rounded exactly, once: they do not depend on their order.
    """
    if not scene.falls:
        return 0.0
    distance = root_of_power_below(scene.volume / scene.n, scene.dim)
    pulls = np.abs(scene.gravity).tolist()
    above = moving(heights(scene.positions, scene), scene)
    means = [math.fsum(along) / len(above) for along in above.T.tolist()]
    down = [2.0 * pull * mean for pull, mean in zip(pulls, means, strict=True)]
    return max(math.fsum(down), 8.0 * distance * math.fsum(pulls))


def energy_in_play(scene: Scene) -> float:
    """Kinetic energy that a gas has, or under gravity about that which it will have.

    A gas that fills a height of kT / mg above the floor has a kinetic energy of d / (d + 2) of the whole.
    """
    if not scene.falls:
        return scene.kinetic_energy
    share = scene.dim / (scene.dim + 2.0)
    return max(scene.kinetic_energy, share * (scene.kinetic_energy + scene.potential_energy))


def epoch_length_at(scene: Scene, v2: float) -> float:
    """Length of an epoch for a mean square speed above 0."""
    return 2.0 * root_of_power_below(scene.volume / scene.n_moving, scene.dim) / root_of_power_below(v2, 2)


def pace(scene: Scene, length: float) -> tuple[float, float]:
    """Mean square speeds between which this epoch length is within a factor 16 of the ideal one.

    The error of a contact is about a rounding of the time within an epoch times the speed. It would grow
    where light particles, slow at first, are accelerated by collisions with heavy ones; epochs are then
    shortened. They are never longer than the first ones.

    Returns
    -------
    lower, upper : float
        Another length is due below the one and from the other on; 0 and infinity where all masses are equal,
        since the mean square is then constant.
    """
    masses = moving(scene.masses, scene)
    if np.all(masses == masses[0]) or not (np.any(scene.velocities) or scene.falls):
        return 0.0, math.inf
    root = epoch_length_at(scene, 1.0) / length
    lower = 0.0 if OUT_OF_PACE * length > epoch_length(scene) else 2.0 * root / OUT_OF_PACE
    upper = root * OUT_OF_PACE
    return lower * lower, upper * upper


def mean_square(velocities: NDArray[np.float64]) -> float:
    """Mean square speed, with the power of two below it that the exactly rounded sum of squares gives.

    A sum in any order has an error below one rounding per term, as no term is negative. The exactly rounded
    sum is computed only where a power of two lies within that error; otherwise both give the same result.
    """
    squares = (velocities * velocities).ravel()
    n = len(velocities)
    total = float(np.sum(squares))
    off = 2.0 * len(squares) * float(np.finfo(np.float64).eps)
    low, high = total * (1.0 - off) / n, total * (1.0 + off) / n
    if off < 0.5 and 0.0 < low and high < math.inf and math.frexp(low)[1] == math.frexp(high)[1]:
        return total / n
    return math.fsum(squares.data) / n


def typical_speed(scene: Scene, energy: float) -> float:
    """Root mean square speed at equipartition of a kinetic energy (light particles move fast)."""
    masses = moving(scene.masses, scene)
    return math.sqrt(2.0 * energy / len(masses) * float(np.mean(1.0 / masses)))


def mean_cross_section(one: Floats, other: Floats, dim: int) -> float:
    """Mean cross section of a pair, one particle of each kind, pi (r1 + r2)^2 in 3D, from the radii."""
    r1, r2 = float(one.mean()), float(other.mean())
    if dim == 2:
        return 2.0 * (r1 + r2)
    return math.pi * (float(np.mean(one * one)) + 2.0 * r1 * r2 + float(np.mean(other * other)))


def collision_frequency(scene: Scene) -> float:
    """Approximate collisions per particle and time (Enskog with a simple contact value), for tuning only."""
    cross_section = mean_cross_section(scene.radii, scene.radii, scene.dim)
    speed = typical_speed(scene, energy_in_play(scene) if scene.falls else scene.thermal_energy)
    density = scene.n / scene.volume
    return math.sqrt(2.0) * density * cross_section * contact_value(scene) * speed


def contact_value(scene: Scene) -> float:
    """Approximate pair distribution at contact."""
    filled = min(filled_fraction(scene), 0.95)
    return (1.0 - 0.5 * filled) / (1.0 - filled) ** scene.dim


def collision_rate(scene: Scene, velocities: Floats) -> float:
    """Approximate pair collisions per unit time at these velocities, for any distribution of the energy.

    The sum over pairs of sigma^2 |v1 - v2| pi / V (2 sigma |v1 - v2| / V in 2D), with the approximate contact
    value, and with the sum of both speeds in place of |v1 - v2|. Speeds are relative to the mean velocity
    along periodic axes; summed over all pairs of equal spheres the result is then at most twice too large (by
    the triangle inequality, used twice). Wall collisions do not change it.
    """
    dim, n, r = scene.dim, scene.n, scene.radii
    drifts = scene.periodic & (scene.n_moving == n)  # obstacles hold what they meet at rest
    still = velocities - np.where(drifts, np.mean(velocities, axis=0), 0.0)
    w = np.sqrt(squared_lengths(still))
    # Sums over pairs of (r1 + r2) (w1 + w2), in 3D of (r1 + r2)^2 (w1 + w2), from sums over particles,
    # without self-pairs.
    r1, w0, w1 = float(np.sum(r)), float(np.sum(w)), float(np.sum(r * w))
    if dim == 2:
        area = 2.0 * (n * w1 + r1 * w0 - 2.0 * w1)
    else:
        r2, w2 = float(np.sum(r * r)), float(np.sum(r * r * w))
        area = math.pi * (n * w2 + 2.0 * r1 * w1 + r2 * w0 - 4.0 * w2)
    return contact_value(scene) * max(area, 0.0) / scene.volume


def set_cells(at: Any, scene: Scene, cells: Any, number: Any, count: Any) -> None:
    """Write the numbers of cells along each axis; in 2D there is one layer of them."""
    dim = scene.dim
    number[at.CELL_DENSITY : at.CELL_DENSITY + 3] = 1.0
    count[at.CELLS : at.CELLS + 3] = 1
    number[at.CELL_DENSITY : at.CELL_DENSITY + dim] = np.array(cells) / scene.box
    number[at.CELL_EDGE : at.CELL_EDGE + dim] = scene.box / np.array(cells)
    count[at.CELLS : at.CELLS + dim] = cells


def cells_per_axis(scene: Scene, width: float, particles: int) -> list[int]:
    """Cells along each axis, each at least `width` wide, and not many more than particles in all."""
    cells = [max(1, int(edge / (width * (1.0 + SLACK)))) for edge in scene.box.tolist()]
    most = max(2 * particles, 8)
    while math.prod(cells) > most:
        longest = cells.index(max(cells))
        excess = (math.prod(cells) / most) ** (1.0 / scene.dim)
        cells[longest] = max(1, min(cells[longest] - 1, int(cells[longest] / excess)))
    return cells


def require_countable(scene: Scene, entries: int, most: int = MOST_ENTRIES) -> None:
    """Raise SimulationError if a table has so many entries that their places cannot be told."""
    if max(entries, scene.n + 6) >= most:
        raise SimulationError(
            f"{scene.n} particles need a table of {entries} entries, more than the {most} that are counted; "
            "take fewer particles, or spread them more evenly"
        )
