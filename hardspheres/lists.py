"""The search of dense gases, as the engine plans it: neighbour lists (`kernel.dense`).

Everything here affects the speed only, never the trajectory.
"""

import math
from typing import Any

import numpy as np

from hardspheres.domains import divided
from hardspheres.scene import Scene
from hardspheres.tuning import (
    EVENTS_PER_BUCKET,
    SLACK,
    cells_per_axis,
    collision_frequency,
    power_of_two_below,
    require_countable,
    set_cells,
)

# Neighbours in a list: fewer mean more rebuilds, more mean more expensive predictions.
NEIGHBOURS_WANTED = {2: 13.0, 3: 14.0}
TINY = 1e-300  # in place of a collision frequency of zero
LEAD = 1.0  # mean free times by which the reference position is ahead of the particle
REBUILT_SINGLY = 0.04  # lists rebuilt singly, per particle, after which all are rebuilt at once
NARROWED = 0.5  # least factor on the threshold, if lists then need not store image indices
NEVER = 2**31 - 1  # so many single rebuilds that all are never rebuilt at once


class Lists:
    """Displacement thresholds, cells and calendar of the search by neighbour lists.

    Parameters
    ----------
    scene : Scene
        The gas.
    threads : int
        Threads that run it, if there is room for as many domains.

    Attributes
    ----------
    domains : Domains or None
        How it is divided among threads, if there are several.
    threshold : float
        Displacement threshold: how far a particle may go from its reference position.
    cells : list of int
        Cells along each axis; a particle's neighbours are in its own and those around it.
    images : bool
        Whether lists store the image index: more than one image of a pair can matter.
    """

    def __init__(self, scene: Scene, threads: int = 1) -> None:
        self.scene = scene
        self.threshold = displacement_threshold(scene)
        reach = 2.0 * self.threshold * (1.0 + SLACK) + 2.0 * float(scene.radii.max())
        self.cells = cells_per_axis(scene, reach, scene.n)
        few = bool(np.any(np.array(self.cells)[scene.periodic] < 3))
        self.images = few or self.threshold > widest_threshold_of_one_image(scene)
        self.domains = divided(self.cells, threads)

    def for_epochs(self, length: float) -> "Lists":
        """Return the search for epochs of another length: the same."""
        return self

    def plan(self, at: Any, number: Any, count: Any) -> None:
        """Write what the kernels need to know to the numbers and counters; the epoch is there already."""
        scene, n, cells = self.scene, self.scene.n, self.cells
        frequency, length = collision_frequency(scene), number[at.EPOCH_LENGTH]
        set_cells(at, scene, cells, number, count)
        number[at.DISPLACEMENT_THRESHOLD] = self.threshold
        number[at.LEAD] = LEAD / max(frequency, TINY)
        rounding = SLACK * float(np.max(scene.box / cells))  # of reference positions in their cells
        one_size = bool(np.all(scene.radii == scene.radii[0]))
        contact = 2.0 * scene.radii[0] if one_size else 0.0
        number[at.CUTOFF] = 2.0 * self.threshold * (1.0 + SLACK) + rounding + contact
        count[at.IMAGES] = int(self.images)
        lanes = at.CELL_LANES
        count[at.CELL_ROOM] = lanes * math.ceil(min(n, 1.5 * n / math.prod(cells) + 3) / lanes)
        count[at.LIST_ROOM] = 32
        count[at.REBUILD_THRESHOLD] = NEVER if self.images else math.ceil(REBUILT_SINGLY * n)
        per_bucket = EVENTS_PER_BUCKET[bool(count[at.BEYOND_CACHE])]
        count[at.BUCKETS] = max(16, int(power_of_two_below(max(8 * n / per_bucket, 1))))
        count[at.BLOCKS] = count[at.BUCKETS] // 2 + n // 3 + 64
        events = 2.0 * n * frequency * length / per_bucket
        count[at.EPOCH_BUCKETS] = int(power_of_two_below(min(max(events, 16.0), 2.0**40)))
        number[at.INVERSE_WIDTH] = count[at.EPOCH_BUCKETS] / length
        if self.domains:
            self.domains.plan(scene, at, number, count)

    def require_countable(self, at: Any, count: Any) -> None:
        """Raise SimulationError if tables are so long that their places cannot be told."""
        require_countable(self.scene, math.prod(self.cells) * int(count[at.CELL_ROOM]))

    def fill(self, at: Any, arrays: dict[str, Any]) -> None:
        """Fill the arrays that are not found from the rows."""
        if self.domains:
            self.domains.fill(at, arrays)

    @property
    def method(self) -> str:
        """The search in words."""
        return "neighbour lists" + (" that name the image" if self.images else "")

    @property
    def pairs_compared(self) -> float:
        """About how many pairs a complete search compares: those of all cells around, then all lists."""
        scene = self.scene
        around = scene.n * math.prod(min(3, cells) / cells for cells in self.cells)
        ball = {2: math.pi, 3: 4.0 * math.pi / 3.0}[scene.dim]
        listed = (
            scene.n
            / scene.volume
            * ball
            * (2.0 * float(scene.radii.mean()) + 2.0 * self.threshold) ** scene.dim
        )
        return scene.n * ((0.5 if self.images else 1.0) * around + listed)


def displacement_threshold(scene: Scene) -> float:
    """Displacement threshold that gives lists of about the wanted length.

    Smaller in a small box, if lists then need not store image indices.
    """
    ball = 4.0 * math.pi / 3.0 if scene.dim == 3 else math.pi

    a1, a2, a3 = (float(np.mean(scene.radii**k)) for k in (1, 2, 3))

    def neighbours(threshold: float) -> float:
        r1, r2 = a1 + threshold, a2 + threshold * (2.0 * a1 + threshold)  # moments of radius plus threshold
        r3 = a3 + threshold * (3.0 * a2 + threshold * (3.0 * a1 + threshold))
        pairs = 2.0 * r3 + 6.0 * r1 * r2 if scene.dim == 3 else 2.0 * r2 + 2.0 * r1 * r1
        return ball * (scene.n / scene.volume) * pairs

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
    wanted = min(limit, max(high, 0.05 * float(scene.radii.mean())))
    nameless = widest_threshold_of_one_image(scene)
    return nameless if NARROWED * wanted <= nameless < wanted else wanted


def widest_threshold_of_one_image(scene: Scene) -> float:
    """Return the largest threshold for which only one image of a pair can be near; infinity between walls.

    With three cells along an axis no two images of a particle are within the cutoff. Reference positions of
    neighbours are at most a contact distance and two thresholds apart, so particles at most a contact
    distance and four, which is less than half a box.
    """
    edges = scene.box[scene.periodic]
    if not edges.size:
        return math.inf
    edge, contact = float(edges.min()), 2.0 * float(scene.radii.max())
    return min((edge / 3.0 - contact) / 2.0, (edge / 2.0 - contact) / 4.0) * (1.0 - 20.0 * SLACK)
