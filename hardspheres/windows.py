"""The search of dilute gases, as the engine plans it: windows of time (`kernel.dilute`), and their grid.

Everything here affects the speed only, never the trajectory.

Lengths are in units of the *reach*: how far a segment of a trajectory reaches from its middle, at most, its
particle's radius included. A segment is in the cell that holds its middle. Cells are COLUMN wide along x and
z and ALONG along y, where they follow each other in memory: so the segments near one stand in few contiguous
runs, one for each column. A particle that has collided keeps its slot in a cell as long as its new segment
reaches no further than OVERHANG outside of that cell. So a segment is compared with all columns, and in each
with all cells, within OVERHANG of its bounding box. Boxes are compared in bytes, of units that divide the
overhang into OVERHANG_UNITS.
"""

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres import tuning
from hardspheres.domains import Domains, divided
from hardspheres.errors import SimulationError
from hardspheres.kernel.layout import CELLS_OF_OVERFLOW
from hardspheres.lists import Lists
from hardspheres.scene import Scene, squared_lengths
from hardspheres.tuning import (
    EVENTS_PER_BUCKET,
    cells_per_axis,
    collision_frequency,
    energy_in_play,
    mean_cross_section,
    power_of_two_below,
    require_countable,
    set_cells,
    typical_speed,
)

Floats = NDArray[np.float64]

SPEEDS = (3.5, 4.1)  # flights at up to one of these, in sqrt(kT/m), are one segment
# One of these numbers of windows in an epoch is chosen.
WINDOWS_IN_AN_EPOCH = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)

MOST_FALLEN = 0.25  # of the length of a segment, from its middle: how far its frame may fall in the meantime

COLUMN, ALONG, OVERHANG = 3.3, 1.0, 1.0  # see above
ROOM = 2.1  # least edge of a periodic box, in widths of two segments side by side
OVERHANG_UNITS = 20
WIDEST = 85  # units in a cell, at most: a third of what a byte can tell apart
# Rounding of single precision, in segments' units of two reaches, in boxes that are not many of these long.
SEGMENT_MARGIN = 1e-4

# Costs in ns, measured: of a particle in a window, of each further segment of its flight, of each segment
# near it, of a cell; of a collision, and for it of each further segment, of each segment near it and of each
# new one. Fast particles collide more often than others.
PARTICLE, SEGMENT, PAIR, CELL = 60.0, 300.0, 0.18, 27.0
COLLISION, NEW_SEGMENT, NEW_PAIR, NEW_NEAR = 200.0, 3500.0, 0.62, 2.5
LIST = 8.0  # of an overflow list that a particle is compared with
FEWEST_MOVING = 1.0 / 64.0  # particles over all: a window costs time for each obstacle, wherever it is
MOST_SEGMENTS = 2**26 - 2  # their slots have as many bits, see `kernel.dilute.pair_table`


class Windows:
    """Windows of a length in time, and the grid for the segments of the flights in them.

    Parameters
    ----------
    scene : Scene
        The gas.
    length : float
        Length of a window in time, a whole fraction of an epoch.
    rms, speed : float
        Root mean square speed, and how many sqrt(kT/m) the fastest flights of one segment have.
    small_radius : float
        Particles with a larger radius are in a coarse grid of their own.

    Attributes
    ----------
    half_length : float
        How far a segment reaches from its middle, without the radius, at most.
    reach : float
        The unit of length of the grid.
    cells, widths, overhang : (d,) int64 arrays
        Cells along each axis, their widths and the overhang in units of bounding boxes.
    large : int64 array
        The particles in the coarse grid.
    large_cells : list of int
        Coarse cells along each axis.
    domains : Domains or None
        How it is divided among threads, if there are several.
    """

    def __init__(self, scene: Scene, length: float, rms: float, speed: float, small_radius: float) -> None:
        self.scene, self.length, self.speed, self.small_radius = scene, length, speed, small_radius
        self.half_length = 0.5 * length * speed * rms / math.sqrt(scene.dim)
        self.reach = self.half_length + small_radius
        widths = np.where(np.arange(scene.dim) == 1, ALONG, COLUMN) * self.reach
        self.cells = np.maximum(scene.box / widths, 1.0).astype(np.int64)
        self.edges = scene.box / self.cells
        units = OVERHANG_UNITS / (OVERHANG * self.reach)
        self.widths = np.minimum(np.floor(units * self.edges), WIDEST).astype(np.int64)
        self.unit_density = self.widths / self.edges
        self.overhang = (np.ceil(OVERHANG * self.reach * self.unit_density) + 1.0).astype(np.int64)
        large = np.flatnonzero(scene.radii > small_radius)
        self.large = large[np.argsort(~scene.obstacles[large], kind="stable")]  # obstacles first
        both = float(scene.radii.max()) + self.reach + self.half_length
        self.large_cells = cells_per_axis(scene, both, len(self.large))
        self.domains: Domains | None = None

    def on(self, threads: int) -> "Windows":
        """Return these windows for several threads, if there is room for as many domains."""
        self.domains = divided(self._columns, threads)
        return self

    @property
    def _columns(self) -> list[int]:
        """How many columns of cells there are along x and z."""
        x, _, z = [*self.cells.tolist(), 1][:3]
        return [x, z]

    @property
    def fall(self) -> float:
        """How far particles fall from rest in half a window, along any axis at most."""
        return 0.125 * float(np.max(np.abs(self.scene.gravity))) * self.length * self.length

    @property
    def possible(self) -> bool:
        """Whether the box is large enough: no segment may touch two images of another.

        So two that have collided do not meet again in the same window, round the box.
        """
        width = 2.0 * (float(self.scene.radii.max()) + self.half_length)
        return bool(np.all(self.scene.box >= np.where(self.scene.periodic, ROOM, 1.001) * width))

    def near(self, half: float) -> float:
        """Segments of small particles in the cells that a box of this half-width reaches, on average."""
        scene = self.scene
        reached = np.minimum(self.edges + 2.0 * (half + OVERHANG * self.reach), scene.box)
        return (scene.n - len(self.large)) * float(np.prod(reached / scene.box))

    @property
    def typical_half_width(self) -> float:
        """Half of a bounding box along an axis, on average."""
        return self.small_radius + math.sqrt(2.0 / math.pi) / self.speed * self.half_length

    @property
    def pairs_compared(self) -> float:
        """About how many pairs of boxes are compared where a window begins: those of small ones once each."""
        small, large = self.scene.n - len(self.large), len(self.large)
        return small * 0.5 * self.near(self.typical_half_width) + large * self.near(self.half_width_of_large)

    @property
    def half_width_of_large(self) -> float:
        """Half of the box in which a large particle is compared with all cells: no overhang is added."""
        radii = self.scene.radii[self.large]
        mean = float(radii.mean()) if len(radii) else 0.0
        return mean + self.small_radius + 2.0 * self.half_length - OVERHANG * self.reach

    def cost(self, frequency: float, share: float) -> float:
        """Approximate cost per particle and time.

        From a collision frequency, and the share of large particles in collisions.
        """
        in_segments = share_faster(self.speed, self.scene.dim)
        scene, small, large = self.scene, self.scene.n - len(self.large), len(self.large)
        collisions = frequency * self.length  # of a particle, in a window
        near, with_new = self.near(self.typical_half_width), NEW_PAIR + NEW_NEAR * collisions
        window = PARTICLE + SEGMENT * in_segments + PAIR * near + CELL * float(np.prod(self.cells)) / small
        collision = COLLISION + NEW_SEGMENT * in_segments + near * with_new
        if large:
            half = self.half_width_of_large
            wide = 1.0 + 2.0 * (half + OVERHANG * self.reach) / self.edges
            lists = float(np.prod(wide)) * (1.0 / float(wide[1]) + 1.0 / CELLS_OF_OVERFLOW)
            search = COLLISION + LIST * lists + self.near(half) * with_new
            window = (small * window + large * search) / scene.n
            collision += 3**scene.dim * (LIST + NEW_NEAR * large / math.prod(self.large_cells))
            collision = (1.0 - share) * collision + share * search
        return (window + collisions * collision) / self.length

    def for_epochs(self, length: float) -> "Windows":
        """Return the windows for epochs of another length."""
        found = cheapest_windows(self.scene, length)
        if isinstance(found, str):  # it was possible for the epochs of the scene
            raise SimulationError(f"windows have become impossible: {found}")
        if self.domains:  # the kernels are those of threads, even if one has to do all
            found.domains = found.on(self.domains.threads).domains or Domains(found._columns, 1, (1, 1))
        return found

    def plan(self, at: Any, number: Any, count: Any) -> None:
        """Write what the kernels need to know to the numbers and counters; the epoch is there already."""
        scene, n, dim, epoch = self.scene, self.scene.n, self.scene.dim, number[at.EPOCH_LENGTH]
        set_cells(at, scene, self.cells, number, count)
        number[at.HALF_WINDOW] = 0.5 * self.length
        number[at.HALF_LENGTH] = self.half_length
        unit = 2.0 * self.reach
        number[at.SEGMENT_UNIT] = 1.0 / unit
        number[at.SEGMENT_MARGIN] = SEGMENT_MARGIN * (1.0 + float(scene.box.max()) / unit / 256.0)
        count[at.WIDTH : at.WIDTH + dim] = self.widths
        count[at.OVERHANG : at.OVERHANG + dim] = self.overhang
        number[at.UNIT_DENSITY : at.UNIT_DENSITY + dim] = self.unit_density
        number[at.SEGMENT_OVERHANG : at.SEGMENT_OVERHANG + dim] = self.overhang / self.unit_density

        windows = round(epoch / self.length)
        collisions = 0.5 * n * collision_frequency(scene) * self.length
        per_bucket = EVENTS_PER_BUCKET[bool(count[at.BEYOND_CACHE])]
        buckets = int(power_of_two_below(min(max(2.0 * collisions / per_bucket, 1.0), 2.0**30)))
        count[at.WINDOW_BUCKETS] = count[at.BUCKETS] = buckets
        count[at.EPOCH_BUCKETS] = windows * buckets
        number[at.INVERSE_WIDTH] = windows * buckets / epoch
        count[at.BLOCKS] = buckets + n // 8 + 256
        count[at.SEGMENT_ROOM] = n + n // 4 + 1024
        count[at.OVERFLOW_ROOM] = n // 3 + 1024
        count[at.NEAR_ROOM] = 1024
        count[at.CONTACT_ROOM] = n // 2 + 1024

        number[at.SMALL_RADIUS], number[at.LARGEST] = self.small_radius, scene.radii.max()
        number[at.LARGE_DENSITY : at.LARGE_DENSITY + 3] = 1.0
        number[at.LARGE_DENSITY : at.LARGE_DENSITY + dim] = np.array(self.large_cells) / scene.box
        count[at.LARGE] = len(self.large)
        count[at.LARGE_CELLS : at.LARGE_CELLS + 3] = 1
        count[at.LARGE_CELLS : at.LARGE_CELLS + dim] = self.large_cells
        if self.domains:
            self.domains.plan_windows(scene, self.length, at, number, count)

    def require_countable(self, at: Any, count: Any) -> None:
        """Raise SimulationError if tables are so long that their places cannot be told."""
        require_countable(self.scene, max(int(count[at.CONTACT_ROOM]), math.prod(self.cells.tolist())))
        require_countable(self.scene, int(count[at.SEGMENT_ROOM] + count[at.OVERFLOW_ROOM]), MOST_SEGMENTS)

    def fill(self, at: Any, arrays: dict[str, Any]) -> None:
        """Fill the arrays that do not follow from the rows: order of particles, columns, shifts of boxes."""
        if self.domains:
            self.domains.fill(at, arrays)
        small = np.delete(np.arange(self.scene.n), self.large)
        arrays["order"][: len(small)], arrays["large"][:-1] = small, self.large
        self._fill_columns(at, arrays["column"], arrays["column_code"])
        ends = arrays["image_shifts"].view(np.uint8).reshape(64, 8)
        for code, (d, units) in itertools.product(range(64), enumerate((self.cells * self.widths).tolist())):
            shift = units * min((code >> 2 * d & 3) - 1, 1)  # -1, 0 or 1 box: two bits of the code
            ends[code, d], ends[code, d + 3] = shift % 256, -shift % 256

    def _fill_columns(self, at: Any, column: Any, code: Any) -> None:
        """Fill the table of columns of cells; all those one cell beyond a wall are one empty column."""
        periodic = [*self.scene.periodic.tolist(), False]
        nx, _, nz = [*self.cells.tolist(), 1][:3]
        x, z = (np.arange(-1, cells + 1) for cells in (nx, nz))
        outside = (x % nx != x)[:, None] & (not periodic[0]) | (z % nz != z) & (not periodic[2])
        column[:] = np.where(outside, nx * nz, (x % nx)[:, None] * nz + z % nz).ravel()
        code[:] = (at.SAME - at.IMAGE[0] * (x[:, None] // nx) - at.IMAGE[2] * (z // nz)).ravel()

    @property
    def method(self) -> str:
        """The search in words."""
        return "windows of time" + ", two grids" * bool(len(self.large))


def windows_for(scene: Scene, epoch: float, search: str = "auto") -> Windows | None:
    """Return the cheapest windows for epochs of this length, or None where neighbour lists are used.

    Parameters
    ----------
    scene : Scene
        The gas.
    epoch : float
        Length of an epoch.
    search : str
        One of `tuning.SEARCHES`. With "auto", lists are used where they are faster, or where windows are
        impossible.

    Raises
    ------
    SimulationError
        With "windows", where they are impossible.
    """
    # Cells for lists are sized for the largest particles: with unequal sizes, windows stay faster up to a
    # higher density.
    crowding = tuning.filled_fraction(scene) * float(scene.radii.mean() / scene.radii.max())
    limit = tuning.SPARSE_IN_SMALL_BOX if Lists(scene).images else tuning.SPARSE_BELOW
    crowded = crowding > limit[scene.dim]
    lonely = scene.n_moving < FEWEST_MOVING * scene.n
    if search == "lists" or (search == "auto" and (crowded or lonely)):
        return None
    found = cheapest_windows(scene, epoch)
    if isinstance(found, Windows):
        return found
    if search == "windows":
        raise SimulationError(f'search="windows" cannot be used here: {found}; take "lists" or "auto"')
    return None


def cheapest_windows(scene: Scene, epoch: float) -> Windows | str:
    """Return the cheapest windows for epochs of this length, or the reason why there are none."""
    if scene.falls and scene.n_moving < scene.n:
        return "paths of falling particles towards obstacles are curved, and windows compare straight ones"
    now = squared_lengths(scene.velocities)
    rms = max(math.sqrt(float(np.sum(now)) / scene.n_moving), typical_speed(scene, energy_in_play(scene)))
    if rms == 0.0:
        return "no particle moves"
    if math.sqrt(np.max(now)) > 50.0 * rms:
        return f"particle {int(np.argmax(now))} is more than 50 times as fast as a typical one"
    frequency = collision_frequency(scene)
    slow, *faster = SPEEDS
    best, least = None, math.inf
    for small_radius in splits(scene):
        share = share_of_large(scene, small_radius)
        for length in (epoch / parts for parts in WINDOWS_IN_AN_EPOCH):
            if PARTICLE / length + COLLISION * frequency >= least:  # what the rest costs at least
                break
            windows = Windows(scene, length, rms, slow, small_radius)
            possible = windows.possible and windows.fall <= MOST_FALLEN * windows.half_length
            cost = windows.cost(frequency, share) if possible else math.inf
            if cost < least:
                best, least = windows, cost
    if best is None:
        return (
            "the box is too small: well over two of the largest diameter must fit along each periodic axis, "
            "and well over one between walls"
        )
    # Longer segments are near more others, but fewer flights have several.
    share = share_of_large(scene, best.small_radius)
    for speed in faster:
        windows = Windows(scene, best.length, rms, speed, best.small_radius)
        if windows.possible and windows.cost(frequency, share) < least:
            best, least = windows, windows.cost(frequency, share)
    return best


def splits(scene: Scene) -> list[float]:
    """Return radii that may divide small and large particles: no large ones, or few enough to pay."""
    radii = np.unique(scene.radii)
    if len(radii) > 8:
        radii = np.unique(
            np.quantile(scene.radii, (0.5, 0.8, 0.9, 0.96, 0.98, 0.99, 0.996, 1.0), method="lower")
        )
    return [float(r) for r in radii if np.mean(scene.radii > r) <= 0.5]


def share_of_large(scene: Scene, small_radius: float) -> float:
    """Fraction of large particles among all that collide."""
    dim, small = scene.dim, scene.radii[scene.radii <= small_radius]
    large = scene.radii[scene.radii > small_radius]
    if not len(large):
        return 0.0
    both = len(small) * len(large) * mean_cross_section(small, large, dim)
    alike = len(large) ** 2 * mean_cross_section(large, large, dim)
    return (alike + both) / (alike + 2.0 * both + len(small) ** 2 * mean_cross_section(small, small, dim))


def share_faster(speed: float, dim: int) -> float:
    """Fraction of particles faster than this many sqrt(kT/m) in a Maxwell-Boltzmann distribution."""
    tail = math.exp(-0.5 * speed * speed)
    return tail if dim == 2 else math.erfc(speed / math.sqrt(2.0)) + math.sqrt(2.0 / math.pi) * speed * tail
