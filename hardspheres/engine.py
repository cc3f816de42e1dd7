"""The engine's state: a scene turned into the kernels' arrays, with room found for them and a search tuned to the density."""

import math
from typing import Any

import numpy as np

from hardspheres.errors import SimulationError
from hardspheres.scene import Scene

NEIGHBOURS_WANTED = {2: 11.0, 3: 14.0}  # per list: fewer means more renewals, more means dearer predictions
EVENTS_PER_BUCKET = 8
SLACK = 1e-6  # by which lists reach further than the shells, so that rounding never matters


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
    v2 = math.fsum((scene.velocities * scene.velocities).ravel().tolist()) / scene.n
    if v2 == 0.0:
        return 1.0
    return 2.0 * spacing / root_of_power_below(v2, 2)


def collision_frequency(scene: Scene) -> float:
    """Rough number of collisions per particle and time (Enskog with a crude contact value), for tuning only."""
    sigma = 2.0 * float(scene.radii.mean())
    speed = math.sqrt(2.0 * scene.kinetic_energy / float(scene.masses.sum()))
    room = max(1.0 - scene.packing_fraction, 0.05)
    chi = (1.0 - 0.5 * scene.packing_fraction) / room**scene.dim
    cross_section = math.pi * sigma * sigma if scene.dim == 3 else 2.0 * sigma
    return math.sqrt(2.0) * scene.number_density * cross_section * chi * speed


def shell_width(scene: Scene) -> float:
    """How far a particle may go before its neighbour list is renewed: as far as leaves lists of about the wanted length."""
    ball = 4.0 * math.pi / 3.0 if scene.dim == 3 else math.pi

    def neighbours(shell: float) -> float:
        r1, r2, r3 = (float(np.mean((scene.radii + shell) ** k)) for k in (1, 2, 3))
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


def aligned(size: int, dtype: type) -> Any:
    """Return an array of zeros that begins at a cache line."""
    itemsize = np.dtype(dtype).itemsize
    raw = np.zeros(size * itemsize + 64, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size * itemsize].view(dtype)


class Engine:
    """Arrays and kernels of one simulation. Holds no physics: everything here follows from the rows.

    Parameters
    ----------
    scene : Scene
        Where to start.

    Attributes
    ----------
    arrays : Arrays
        What the kernels work on; `number`, `count`, `total` are addressed by the names in `kernel.layout`.
    layout : module
        Those names, for this kind of scene.
    """

    def __init__(self, scene: Scene) -> None:
        from hardspheres.kernel import specialise

        sizes = bool(np.any(scene.radii != scene.radii[0]))
        masses = bool(np.any(scene.masses != scene.masses[0]))
        self.kernels: Any = specialise(scene.dim, not bool(scene.periodic.all()), sizes, masses)
        self.layout: Any = self.kernels.layout
        self.scene = scene
        at = self.layout
        n, dim = scene.n, scene.dim

        row = aligned(n * at.ROW, np.float64)
        table = row.reshape(n, at.ROW)
        table[:, at.X : at.X + dim] = scene.positions
        table[:, at.V : at.V + dim] = scene.velocities
        if sizes:
            table[:, at.RADIUS] = scene.radii

        number = np.zeros(at.NUMBERS)
        count = np.zeros(at.COUNTERS, dtype=np.int64)
        shell = shell_width(scene)
        sigma = 2.0 * float(scene.radii[0])
        length = epoch_length(scene)
        number[at.BOX : at.BOX + dim] = scene.box
        number[at.INVERSE : at.INVERSE + dim] = np.where(scene.periodic, 1.0 / scene.box, 0.0)
        number[at.EPOCH_LENGTH] = length
        number[at.SHELL] = shell
        number[at.REACH] = 2.0 * shell * (1.0 + SLACK) + (0.0 if sizes else sigma)
        number[at.SIGMA2] = sigma * sigma
        number[at.CORE] = scene.radii[0]
        number[at.MASS] = scene.masses[0]
        number[at.REDUCED] = scene.masses[0] * scene.masses[0] / (scene.masses[0] + scene.masses[0])
        number[at.LATE_BY] = 4.0 * math.ulp(length)
        number[at.STANDSTILL] = -length

        cells = cells_per_axis(scene, 2.0 * shell * (1.0 + SLACK) + 2.0 * float(scene.radii.max()))
        number[at.CELL_DENSITY : at.CELL_DENSITY + dim] = np.array(cells) / scene.box
        count[at.N] = n
        count[at.CELLS : at.CELLS + dim] = cells
        # With four cells per axis only one image of a pair can matter; below that, lists say which image they mean.
        count[at.IMAGES] = int(
            any(c < 4 for c, periodic in zip(cells, scene.periodic, strict=True) if periodic)
        )
        self.cells = math.prod(cells)
        count[at.CELL_ROOM] = 8 * math.ceil(min(n, 1.5 * n / self.cells + 3) / 8)
        count[at.LIST_ROOM] = 32
        count[at.BUCKETS] = max(16, int(power_of_two_below(max(n / 4, 1))))
        count[at.AGENDA_ROOM] = 1024 + n // 16
        self.chunks = int(count[at.BUCKETS]) + n // 2 + 64
        rate = max(2.0 * n * collision_frequency(scene) * length / EVENTS_PER_BUCKET, 16.0)
        number[at.INVERSE_WIDTH] = power_of_two_below(min(rate, 2.0**40)) / length

        scratch = aligned(self.layout.BLOCK * 16, np.float64)
        event = aligned(n * at.EVENT, np.int64)
        self.arrays: Any = at.Arrays(
            row=row,
            event=event,
            event_float=event.view(np.float64),
            mass=np.array(scene.masses if masses else scene.masses[:1]),
            turns=np.zeros(n * dim, dtype=np.int32),
            where=np.zeros(n, dtype=np.int32),
            scratch=scratch,
            scratch_int=scratch.view(np.int64),
            number=number,
            counter=count,
            total=np.zeros(at.SUMS),
            **self._searching_arrays(count),
        )
        self._afresh = True

    def _searching_arrays(self, count: Any) -> dict[str, Any]:
        """Allocate everything that the search needs and that can be found again from the rows."""
        at = self.layout
        n, dim = int(count[at.N]), self.scene.dim
        room, cell_room = int(count[at.LIST_ROOM]), int(count[at.CELL_ROOM])
        return {
            "neighbours": aligned(n * room, np.int32),
            "images": np.zeros(n * room * dim if count[at.IMAGES] else 1, dtype=np.int32),
            "cell_count": np.zeros(self.cells, dtype=np.int32),
            "cell_ids": np.zeros(self.cells * cell_room, dtype=np.int32),
            "cell_centres": aligned(self.cells * (dim + 1) * cell_room, np.float64),
            "buckets": np.zeros(int(count[at.BUCKETS]) + 1, dtype=np.int64),
            "chunks": aligned(self.chunks * at.CHUNK, np.int64),
            "agenda_time": np.zeros(int(count[at.AGENDA_ROOM])),
            "agenda_key": np.zeros(int(count[at.AGENDA_ROOM]), dtype=np.int64),
            "agenda_entry": np.zeros(int(count[at.AGENDA_ROOM]), dtype=np.int64),
        }

    def _make_room(self) -> None:
        """Double whatever ran out; the search then starts again from the rows."""
        at, count = self.layout, self.arrays.counter
        if count[at.SHORT_LISTS]:
            count[at.LIST_ROOM] *= 2
        if count[at.SHORT_CELLS]:
            count[at.CELL_ROOM] *= 2
        if count[at.SHORT_QUEUE]:
            count[at.AGENDA_ROOM] *= 2
            self.chunks *= 2
        count[[at.SHORT_LISTS, at.SHORT_CELLS, at.SHORT_QUEUE]] = 0
        self.arrays = self.arrays._replace(**self._searching_arrays(count))

    def run(self, stop_epoch: int, stop_time: float, stop_pairs: int, budget: int) -> bool:
        """Execute events up to a time or a number of pair collisions; False where the budget of work ran out first."""
        status = self.kernels.run(
            self.arrays, self.cells, self.chunks, self._afresh, stop_epoch, stop_time, stop_pairs, budget
        )
        self._afresh = status == self.kernels.NO_ROOM
        if self._afresh:
            self._make_room()
        elif status == self.kernels.STANDS_STILL:
            raise SimulationError(
                f"time stands still: {1000 * self.scene.n} events without progress at "
                f"{self.arrays.counter[self.layout.PAIRS]} collisions; the particles touch on all sides (a jammed packing), "
                "so give them room"
            )
        return bool(status == self.kernels.DONE)

    @property
    def bytes(self) -> int:
        """Memory of the kernels' arrays."""
        shared = {"event_float", "scratch_int"}
        return sum(a.nbytes for name, a in self.arrays._asdict().items() if name not in shared)
