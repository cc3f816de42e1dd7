"""How the engine searches: the scene's unit of time, the method, and the sizes of cells, shells and windows.

Only `epoch_length` enters the trajectory; everything else decides how fast it is found.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import Scene

NEIGHBOURS_WANTED = {2: 11.0, 3: 14.0}  # per list: fewer means more renewals, more means dearer predictions
SLACK = 1e-6  # by which lists and lines reach further than they must, so that rounding never matters
THERMAL_SPEEDS = (
    2.2,
    2.6,
    3.0,
    3.5,
)  # flights up to this many sqrt(kT/m) are registered in one piece: one is chosen
WINDOWS_IN_AN_EPOCH = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)  # likewise
SPARSE_BELOW = {2: 0.3, 3: 0.25}  # packing fraction below which windows are faster than lists


def power_of_two_below(x: float) -> float:
    """Largest power of two that is not above x > 0; scaling x by a power of two scales the result exactly."""
    return math.ldexp(1.0, math.frexp(x)[1] - 1)


def root_of_power_below(x: float, degree: int) -> float:
    """Power of two 2^floor(log2(x) / degree), rounded down in the exponent: a coarse root without rounding."""
    return math.ldexp(1.0, (math.frexp(x)[1] - 1) // degree)


def epoch_length(scene: Scene) -> float:
    """Length of an epoch: about one to four times the time to fly the mean distance between particles, a power of two.

    It depends on the scene alone, and on it in a way that scales exactly: multiplying all lengths or times by a power of two
    multiplies it by a power of two.
    """
    spacing = root_of_power_below(scene.volume / scene.n, scene.dim)
    v2 = mean_square(scene.velocities)
    if v2 == 0.0:
        return 1.0
    return 2.0 * spacing / root_of_power_below(v2, 2)


def mean_square(velocities: NDArray[np.float64]) -> float:
    """Mean square speed, with the power of two below it that the exactly rounded sum of squares gives.

    A sum in whatever order is off by less than one rounding for each term, as no term is negative. Only where a power of
    two is that near is the exactly rounded sum computed; otherwise both have the same.
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
    """Root mean square speed of the particles, once a kinetic energy is shared out equally (light ones move fast)."""
    return math.sqrt(2.0 * energy / scene.n * float(np.mean(1.0 / scene.masses)))


def collision_frequency(scene: Scene) -> float:
    """Rough number of collisions per particle and time (Enskog with a crude contact value), for tuning only."""
    sigma = 2.0 * float(scene.radii.mean())
    room = max(1.0 - scene.packing_fraction, 0.05)
    chi = (1.0 - 0.5 * scene.packing_fraction) / room**scene.dim
    cross_section = math.pi * sigma * sigma if scene.dim == 3 else 2.0 * sigma
    speed = typical_speed(scene, scene.thermal_energy)
    return math.sqrt(2.0) * scene.number_density * cross_section * chi * speed


def shell_width(scene: Scene) -> float:
    """How far a particle may go before its neighbour list is renewed: as far as leaves lists of about the wanted length."""
    ball = 4.0 * math.pi / 3.0 if scene.dim == 3 else math.pi

    a1, a2, a3 = (float(np.mean(scene.radii**k)) for k in (1, 2, 3))

    def neighbours(shell: float) -> float:
        r1, r2 = a1 + shell, a2 + shell * (2.0 * a1 + shell)  # moments of the radii and the shell together
        r3 = a3 + shell * (3.0 * a2 + shell * (3.0 * a1 + shell))
        pairs = 2.0 * r3 + 6.0 * r1 * r2 if scene.dim == 3 else 2.0 * r2 + 2.0 * r1 * r1
        return ball * scene.number_density * pairs

    largest = 2.0 * float(scene.radii.max())
    low, high = 0.0, float(np.linalg.norm(scene.box))
    edges = scene.box[scene.periodic]
    if edges.size:
        high = min(high, 0.5 * (float(edges.min()) - largest) / (1.0 + 10.0 * SLACK))
    high = max(high, SLACK * largest)
    limit = high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if neighbours(middle) < NEIGHBOURS_WANTED[scene.dim] else (low, middle)
    return min(limit, max(high, 0.05 * float(scene.radii.mean())))


def cells_per_axis(scene: Scene, width: float) -> list[int]:
    """Cells along each axis, each at least `width` wide, and not many more than particles in all."""
    cells = [max(1, int(edge / (width * (1.0 + SLACK)))) for edge in scene.box.tolist()]
    most = max(2 * scene.n, 8)
    while math.prod(cells) > most:
        longest = cells.index(max(cells))
        excess = (math.prod(cells) / most) ** (1.0 / scene.dim)
        cells[longest] = max(1, min(cells[longest] - 1, int(cells[longest] / excess)))
    return cells


@dataclass(frozen=True)
class WindowPlan:
    """Windows for a dilute gas.

    Attributes
    ----------
    length : float
        Length of a window in time, a whole fraction of an epoch.
    stretch : float
        How far a registered piece of a flight reaches from its middle.
    cells : list of int
        Cells along each axis.
    """

    length: float
    stretch: float
    cells: list[int]


def share_faster(speed: float, dim: int) -> float:
    """Share of the particles that Maxwell and Boltzmann have faster than this many sqrt(kT/m)."""
    tail = math.exp(-0.5 * speed * speed)
    return tail if dim == 2 else math.erfc(speed / math.sqrt(2.0)) + math.sqrt(2.0 / math.pi) * speed * tail


def window_plan(scene: Scene) -> WindowPlan | None:
    """Return the windows that cost least, or None where lists serve better or the box is too small for them."""
    largest = 2.0 * float(scene.radii.max())
    now = np.sum(scene.velocities * scene.velocities, axis=1)
    rms = max(math.sqrt(float(np.mean(now))), typical_speed(scene, scene.kinetic_energy))
    if scene.packing_fraction > SPARSE_BELOW[scene.dim] or rms == 0.0 or math.sqrt(np.max(now)) > 50.0 * rms:
        return None
    frequency, epoch = collision_frequency(scene), epoch_length(scene)
    plans = {}
    for parts, speeds in itertools.product(WINDOWS_IN_AN_EPOCH, THERMAL_SPEEDS):
        length = epoch / parts
        stretch = 0.5 * speeds * rms / math.sqrt(scene.dim) * length
        cells = [int(edge / ((largest + 2.0 * stretch) * (1.0 + 1e-3))) for edge in scene.box.tolist()]
        if any(c < (3 if periodic else 1) for c, periodic in zip(cells, scene.periodic, strict=True)):
            continue
        occupancy = scene.n / math.prod(cells)
        around = occupancy * 3**scene.dim
        collisions = frequency * length
        in_pieces = share_faster(speeds, scene.dim)
        # Measured, in ns: registering a line (and more of them for a flight in pieces) and comparing it with half the lines
        # around, passing by a cell, and for each collision comparing the new lines with all around, those of this window too.
        cost = 50.0 + 300.0 * in_pieces + 0.6 * around + 15.0 / occupancy
        cost += collisions * (200.0 + around * (1.0 + 8.0 * collisions))
        cost /= length
        plans[cost] = WindowPlan(length, stretch, cells)
    return plans[min(plans)] if plans else None
