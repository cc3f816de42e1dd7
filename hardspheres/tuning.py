"""Parameters of the search: length of epochs, method, sizes of cells, displacement thresholds and windows.

Only the length of an epoch affects the trajectory; everything else affects only the speed.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import SimulationError
from hardspheres.scene import Scene

Floats = NDArray[np.float64]

# per list: fewer mean more rebuilds, more mean more expensive predictions
NEIGHBOURS_WANTED = {2: 13.0, 3: 14.0}
LEAD = 1.0  # mean free times by which the reference position is ahead of the particle
PATIENCE = 0.04  # lists rebuilt singly, per particle, after which all are rebuilt at once
NARROWED = 0.5  # least factor on the threshold, if lists then need not store image indices
SLACK = 1e-6  # relative margin of lists and segments against rounding
THERMAL_SPEED = 3.5  # windows: flights at up to this many sqrt(kT/m) are one segment
# One of these numbers of windows in an epoch is chosen.
WINDOWS_IN_AN_EPOCH = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
OUT_OF_PACE = 16.0  # factor by which an epoch may be too long or too short before it is changed
SEARCHES = ("auto", "lists", "windows")  # the faster one, or by name
SPARSE_BELOW = {2: 0.4, 3: 0.25}  # packing fraction below which windows are faster than lists
REG, PIECE, PAIR, CELL, COLL, NEWP, NEWC = (
    60.0,
    300.0,
    0.15,
    20.0,
    200.0,
    0.5,
    2.0,
)  # costs in ns: see `_Split.cost`
RUN, HEAD = 10.0, 3.0  # more such costs, of large particles


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
    v2 = mean_square(scene.velocities)
    return 1.0 if v2 == 0.0 else epoch_length_at(scene, v2)


def epoch_length_at(scene: Scene, v2: float) -> float:
    """Length of an epoch for a mean square speed above 0."""
    return 2.0 * root_of_power_below(scene.volume / scene.n, scene.dim) / root_of_power_below(v2, 2)


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
    if np.all(scene.masses == scene.masses[0]) or not np.any(scene.velocities):
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
    return math.sqrt(2.0 * energy / scene.n * float(np.mean(1.0 / scene.masses)))


def mean_cross_section(one: Floats, other: Floats, dim: int) -> float:
    """Mean cross section of a pair, one particle of each kind, pi (r1 + r2)^2 in 3D, from the radii."""
    r1, r2 = float(one.mean()), float(other.mean())
    if dim == 2:
        return 2.0 * (r1 + r2)
    return math.pi * (float(np.mean(one * one)) + 2.0 * r1 * r2 + float(np.mean(other * other)))


def collision_frequency(scene: Scene) -> float:
    """Approximate collisions per particle and time (Enskog with a simple contact value), for tuning only."""
    cross_section = mean_cross_section(scene.radii, scene.radii, scene.dim)
    speed = typical_speed(scene, scene.thermal_energy)
    return math.sqrt(2.0) * scene.number_density * cross_section * contact_value(scene) * speed


def contact_value(scene: Scene) -> float:
    """Approximate pair distribution at contact."""
    room = max(1.0 - scene.packing_fraction, 0.05)
    return (1.0 - 0.5 * scene.packing_fraction) / room**scene.dim


def collision_rate(scene: Scene, velocities: Floats) -> float:
    """Approximate pair collisions per unit time at these velocities, for any distribution of the energy.

    The sum over pairs of sigma^2 |v1 - v2| pi / V (2 sigma |v1 - v2| / V in 2D), with the approximate contact
    value, and with the sum of both speeds in place of |v1 - v2|. Speeds are relative to the mean velocity
    along periodic axes; summed over all pairs of equal spheres the result is then at most twice too large (by
    the triangle inequality, used twice). Wall collisions do not change it.
    """
    dim, n, r = scene.dim, scene.n, scene.radii
    still = velocities - np.where(scene.periodic, np.mean(velocities, axis=0), 0.0)
    w = np.sqrt(np.sum(still * still, axis=1))
    # Sums over pairs of (r1 + r2) (w1 + w2), in 3D of (r1 + r2)^2 (w1 + w2), from sums over particles,
    # without self-pairs.
    r1, w0, w1 = float(np.sum(r)), float(np.sum(w)), float(np.sum(r * w))
    if dim == 2:
        area = 2.0 * (n * w1 + r1 * w0 - 2.0 * w1)
    else:
        r2, w2 = float(np.sum(r * r)), float(np.sum(r * r * w))
        area = math.pi * (n * w2 + 2.0 * r1 * w1 + r2 * w0 - 4.0 * w2)
    return contact_value(scene) * max(area, 0.0) / scene.volume


def shell_width(scene: Scene) -> float:
    """Displacement threshold of the neighbour lists: the one that gives lists of about the wanted length.

    Smaller in a small box, if lists then need not store image indices.
    """
    ball = 4.0 * math.pi / 3.0 if scene.dim == 3 else math.pi

    a1, a2, a3 = (float(np.mean(scene.radii**k)) for k in (1, 2, 3))

    def neighbours(shell: float) -> float:
        r1, r2 = a1 + shell, a2 + shell * (2.0 * a1 + shell)  # moments of radius plus threshold
        r3 = a3 + shell * (3.0 * a2 + shell * (3.0 * a1 + shell))
        pairs = 2.0 * r3 + 6.0 * r1 * r2 if scene.dim == 3 else 2.0 * r2 + 2.0 * r1 * r1
        return ball * scene.number_density * pairs

    largest = 2.0 * float(scene.radii.max())
    low, high = 0.0, math.hypot(*scene.box.tolist())
    edges = scene.box[scene.periodic]
    if edges.size:
        high = min(high, 0.5 * (float(edges.min()) - largest) / (1.0 + 10.0 * SLACK))
    high = max(high, SLACK * largest)
    limit = high
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if neighbours(middle) < NEIGHBOURS_WANTED[scene.dim] else (low, middle)
    shell = min(limit, max(high, 0.05 * float(scene.radii.mean())))
    nameless = widest_shell_of_one_image(scene)
    return nameless if NARROWED * shell <= nameless < shell else shell


def widest_shell_of_one_image(scene: Scene) -> float:
    """Return the largest thresholds for which only one image of a pair can be near; infinity between walls.

    With three cells along an axis no two images of a particle are within the cutoff. Reference positions of
    neighbours are at most a contact distance and two thresholds apart, so particles at most a contact
    distance and four, which is less than half a box.
    """
    edges = scene.box[scene.periodic]
    if not edges.size:
        return math.inf
    edge, contact = float(edges.min()), 2.0 * float(scene.radii.max())
    return min((edge / 3.0 - contact) / 2.0, (edge / 2.0 - contact) / 4.0) * (1.0 - 20.0 * SLACK)


def cells_per_axis(scene: Scene, width: float, particles: int) -> list[int]:
    """Cells along each axis, each at least `width` wide, and not many more than particles in all."""
    cells = [max(1, int(edge / (width * (1.0 + SLACK)))) for edge in scene.box.tolist()]
    most = max(2 * particles, 8)
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
        Half-length of a trajectory segment.
    cells : list of int
        Cells along each axis.
    small_radius : float
        Largest radius of the particles that these cells are made for.
    large_cells : list of int
        Cells along each axis for the particles that are larger.
    """

    length: float
    stretch: float
    cells: list[int]
    small_radius: float
    large_cells: list[int]


class _Split:
    """Small and large particles, divided at one radius, and what a window costs with them.

    Parameters
    ----------
    scene : Scene
        The gas.
    small_radius : float
        Largest radius of the small ones.
    """

    def __init__(self, scene: Scene, small_radius: float) -> None:
        self.scene = scene
        self.small_radius = small_radius
        small, large = scene.radii[scene.radii <= small_radius], scene.radii[scene.radii > small_radius]
        self.small, self.large = len(small), len(large)
        self.large_radius = float(large.mean()) if len(large) else 0.0
        self.largest = float(scene.radii.max())
        self.share_of_large = self._share_of_large(small, large)

    def _share_of_large(self, small: Floats, large: Floats) -> float:
        """Return the fraction of large particles among all that collide."""
        if not len(large):
            return 0.0
        dim = self.scene.dim
        both = len(small) * len(large) * mean_cross_section(small, large, dim)
        alike = len(large) ** 2 * mean_cross_section(large, large, dim)
        share: float = (alike + both) / (
            alike + 2.0 * both + len(small) ** 2 * mean_cross_section(small, small, dim)
        )
        return share

    def plan(self, length: float, stretch: float) -> WindowPlan | None:
        """Return the cells for windows of this length, or None where the box is too small for them."""
        scene = self.scene
        cells = self._cells(2.0 * self.small_radius + 2.0 * stretch)
        coarse = self._cells(2.0 * self.largest + 2.0 * stretch)
        if any(c < (3 if periodic else 1) for c, periodic in zip(coarse, scene.periodic, strict=True)):
            return None
        reach = self.largest + self.small_radius + 2.0 * stretch
        return WindowPlan(length, stretch, cells, self.small_radius, cells_per_axis(scene, reach, self.large))

    def _cells(self, width: float) -> list[int]:
        return [int(edge / (width * (1.0 + 1e-3))) for edge in self.scene.box.tolist()]

    def cost(self, plan: WindowPlan, collisions: float, in_pieces: float) -> float:
        """Approximate cost of a window per particle, in ns, from collision rates and segments per flight."""
        dim, n = self.scene.dim, self.scene.n
        occupancy = self.small / math.prod(plan.cells)
        around: float = occupancy * 3**dim
        # Measured: storing a segment (several for a long flight) and comparing it with half of the segments
        # around, visiting a cell, and for each collision comparing the new segments with all around.
        opening: float = REG + PIECE * in_pieces + PAIR * around + CELL / occupancy
        collision: float = COLL + around * (NEWP + NEWC * collisions)
        if not self.large:
            return opening + collisions * collision
        # A large particle is compared with the segments in a box of rows, which are mostly contiguous, and
        # with the overflow list of each row.
        reach = self.large_radius + self.small_radius + 2.0 * plan.stretch
        wide = [
            2.0 * reach * c / edge + 1.0 for c, edge in zip(plan.cells, self.scene.box.tolist(), strict=True)
        ]
        met: float = occupancy * math.prod(wide)
        columns: float = math.prod(wide) / (wide[1] * (3.0 if dim == 3 else 1.0))
        search: float = COLL + columns * (RUN + HEAD * wide[1]) + met * (NEWP + NEWC * collisions)
        opening = (self.small * opening + self.large * search) / n
        collision += 3**dim * (HEAD + NEWC * self.large / math.prod(plan.large_cells))
        share: float = self.share_of_large
        return opening + collisions * ((1.0 - share) * collision + share * search)


def splits(scene: Scene) -> list[_Split]:
    """Return ways to divide the particles into small and large ones: no large ones, or few enough to pay."""
    radii = np.unique(scene.radii)
    if len(radii) > 8:
        radii = np.unique(
            np.quantile(scene.radii, (0.5, 0.8, 0.9, 0.96, 0.98, 0.99, 0.996, 1.0), method="lower")
        )
    return [_Split(scene, float(r)) for r in radii if np.mean(scene.radii > r) <= 0.5]


def share_faster(speed: float, dim: int) -> float:
    """Fraction of particles faster than this many sqrt(kT/m) in a Maxwell-Boltzmann distribution."""
    tail = math.exp(-0.5 * speed * speed)
    return tail if dim == 2 else math.erfc(speed / math.sqrt(2.0)) + math.sqrt(2.0 / math.pi) * speed * tail


def window_plan(scene: Scene, epoch: float, search: str = "auto") -> WindowPlan | None:
    """Return the cheapest windows for epochs of this length, or None where neighbour lists are used.

    Parameters
    ----------
    scene : Scene
        The gas.
    epoch : float
        Length of an epoch.
    search : str
        One of SEARCHES. With "auto", lists are used where they are faster, or where windows are impossible.

    Raises
    ------
    SimulationError
        With "windows", where they are impossible.
    """
    # Cells for lists are sized for the largest particles: with unequal sizes, windows stay faster up to a
    # higher density.
    crowding = scene.packing_fraction * float(scene.radii.mean() / scene.radii.max())
    if search == "lists" or (search == "auto" and crowding > SPARSE_BELOW[scene.dim]):
        return None
    plan = _cheapest_windows(scene, epoch)
    if isinstance(plan, WindowPlan):
        return plan
    if search == "windows":
        raise SimulationError(f'search="windows" cannot be used here: {plan}; take "lists" or "auto"')
    return None


def _cheapest_windows(scene: Scene, epoch: float) -> WindowPlan | str:
    """Return the cheapest windows, or the reason why there are none."""
    now = np.sum(scene.velocities * scene.velocities, axis=1)
    rms = max(math.sqrt(float(np.mean(now))), typical_speed(scene, scene.kinetic_energy))
    if rms == 0.0:
        return "no particle moves"
    if math.sqrt(np.max(now)) > 50.0 * rms:
        return f"particle {int(np.argmax(now))} is more than 50 times as fast as a typical one"
    frequency = collision_frequency(scene)
    plans = {}
    in_pieces = share_faster(THERMAL_SPEED, scene.dim)
    for split, parts in itertools.product(splits(scene), WINDOWS_IN_AN_EPOCH):
        length = epoch / parts
        plan = split.plan(length, 0.5 * THERMAL_SPEED * rms / math.sqrt(scene.dim) * length)
        if plan is not None:
            plans[split.cost(plan, frequency * length, in_pieces) / length] = plan
    if plans:
        return plans[min(plans)]
    return (
        "the box is too small: well over three of the largest diameter must fit along each periodic axis, "
        "and well over one between walls"
    )
