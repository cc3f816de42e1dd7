"""The engine's state: the kernels' arrays of a scene, which grow as needed, and the clock."""

import copy
import math
from typing import Any

import numpy as np

from hardspheres.clock import FOREVER, recounted
from hardspheres.errors import SimulationError
from hardspheres.event_log import ROOM, Sink, as_events
from hardspheres.free_paths import FlightTallies
from hardspheres.memory import require_memory
from hardspheres.scene import Scene, momentum_flux
from hardspheres.tuning import (
    LEAD,
    PATIENCE,
    SLACK,
    WindowPlan,
    cells_per_axis,
    collision_frequency,
    epoch_length,
    epoch_length_at,
    pace,
    power_of_two_below,
    shell_width,
    widest_shell_of_one_image,
    window_plan,
)

EVENTS_PER_BUCKET = {False: 8, True: 32}  # more of them where their data are prefetched
CACHED = 16000  # particles that fit the caches of a core
CACHED_AT_ALL = 48000  # particles that fit the caches that cores share
MOST_ENTRIES = 2**31 - 1  # of a table: its places are kept in 32 bits
MOST_SEGMENTS = 2**26 - 2  # of windows: their slots have as many bits, see `kernel.dilute.pair_table`
COLUMN = 3.3  # width of a column of cells along x and z, in the overhang of segments
ALONG = 1.0  # width of a cell along y
OVERHANG_UNITS = 20  # units of bounding boxes in that overhang: see `kernel.layout`
WIDEST = 85  # units in a cell, at most
TINY = 1e-300  # in place of a collision frequency of zero
# In cells, of boxes that are not many cells long: single precision is off by a few 1e-6.
SEGMENT_MARGIN = 1e-4
# Where the sums keep the components of a symmetric tensor.
COMPONENTS = {2: np.array([[0, 3], [3, 1]]), 3: np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])}


def aligned(size: int, dtype: type) -> Any:
    """Return an array of zeros that begins at a cache line."""
    itemsize = np.dtype(dtype).itemsize
    raw = np.zeros(size * itemsize + 64, dtype=np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size * itemsize].view(dtype)


def image_shifts(cells: Any, widths: Any) -> Any:
    """Return the shifts of bounding boxes by image: -1, 0 or 1 box along each axis (two bits of its code)."""
    shifts = aligned(64, np.int64)
    ends = shifts.view(np.uint8).reshape(64, 8)
    for code in range(64):
        for d, units in enumerate((cells * widths).tolist()):
            box = units * min((code >> 2 * d & 3) - 1, 1)
            ends[code, d], ends[code, d + 3] = box % 256, -box % 256
    return shifts


class Engine:
    """Arrays and kernels of one simulation. Holds no physics: everything here follows from the rows.

    Parameters
    ----------
    scene : Scene
        Initial state.
    growth : (float, float), optional
        The radii are those of the scene times a scale: its initial value, and its rate of growth. It must not
        exceed 1, for which the lists are made.
    flights : bool
        Tally free flights.
    logs : bool
        Keep a log of events, which `sink` receives; needs `flights`.
    search : str
        One of `tuning.SEARCHES`; spheres that grow have lists.

    Attributes
    ----------
    arrays : Arrays
        What the kernels work on; `number`, `counter`, `total` are addressed by the names in `kernel.layout`.
    layout : module
        Those names, for this kind of scene.
    flights : FlightTallies or None
        The layout of the tallies of flights.
    sink : callable or None
        Receives chunks of the event log; set by the owner of one.
    now : (int, float)
        The time: whole epochs, and the time within this one. It is the end of the last run, or that of its
        last event.
    since : (int, float, int, int)
        Where the tallies began: epoch, time within it, pair collisions, wall collisions.
    earlier : array
        What was tallied from the start up to there, as `tallied` gives it.
    """

    def __init__(
        self,
        scene: Scene,
        growth: tuple[float, float] | None = None,
        flights: bool = False,
        logs: bool = False,
        search: str = "auto",
    ) -> None:
        from hardspheres.kernel import specialise

        sizes = bool(np.any(scene.radii != scene.radii[0]))
        masses = bool(np.any(scene.masses != scene.masses[0]))
        length = epoch_length(scene)
        plan = window_plan(scene, length, search) if growth is None else None
        self.kernels: Any = specialise(
            scene.dim,
            not bool(scene.periodic.all()),
            sizes,
            masses,
            plan is not None,
            growth is not None,
            flights,
        )
        self.layout: Any = self.kernels.layout
        self.scene = scene
        self.flights = FlightTallies(scene, self.layout) if flights else None
        self.sink: Sink | None = None
        at = self.layout
        n, dim = scene.n, scene.dim

        row = aligned((n + 1) * at.ROW, np.float64)
        row[n * at.ROW :] = math.nan
        table = row[: n * at.ROW].reshape(n, at.ROW)
        table[:, at.X : at.X + dim] = scene.positions
        # Without negative zeros: a sum with zero keeps or loses their sign depending on its order. No
        # collision creates one.
        table[:, at.V : at.V + dim] = scene.velocities + 0.0
        if sizes:
            table[:, at.RADIUS] = scene.radii

        flight, units = self.flights.prepared(length) if self.flights else (np.zeros(1), np.zeros(0))
        sums, counts = self.flights.room if self.flights else (0, 0)
        number = np.append(np.zeros(at.NUMBERS), units)
        count = np.zeros(at.COUNTERS + counts, dtype=np.int64)
        sigma = 2.0 * float(scene.radii[0])
        number[at.BOX : at.BOX + dim] = scene.box
        number[at.INVERSE : at.INVERSE + dim] = np.where(scene.periodic, 1.0 / scene.box, 0.0)
        number[at.SIGMA2] = sigma * sigma
        number[at.COMMON_RADIUS] = scene.radii[0]
        number[at.MASS] = scene.masses[0]
        number[at.REDUCED] = 0.5 * scene.masses[0]
        number[at.LAST_ADVANCE] = -length
        number[at.SCALE], number[at.GROWTH] = growth or (1.0, 0.0)
        count[at.N] = n
        count[at.HEAP_ROOM] = 1024 + n // 16
        count[at.BEYOND_CACHE] = int(n > CACHED)
        count[at.BEYOND_ALL] = int(n > CACHED_AT_ALL)
        count[at.SPECIES_COUNT] = len(units) // 3
        count[at.LOG_ROOM] = ROOM if logs else 0
        self._plan(plan, length, number, count)

        scratch = aligned(at.LANES * 16, np.float64)
        event = aligned(n * at.EVENT + 1, np.int64)
        self.arrays: Any = at.Arrays(
            row=row,
            event=event,
            event_float=event.view(np.float64),
            version=np.zeros(n, dtype=np.int32),
            mass=np.array(scene.masses if masses else scene.masses[:1]),
            image_counts=np.zeros(n * dim, dtype=np.int64),
            flight=flight,
            log=aligned(int(count[at.LOG_ROOM]) * at.LOG_ROW + 1, np.float64),
            where=np.zeros(n, dtype=np.int32),
            scratch=scratch,
            scratch_int=scratch.view(np.int64),
            number=number,
            counter=count,
            total=np.zeros(at.FLIGHT_SUMS + sums),
            **self._searching_arrays(count, self.blocks),
        )
        self.now = (0, 0.0)
        self.since = (0, 0.0, 0, 0)
        self.earlier = np.zeros(2 * dim * dim + 4 * dim)
        self._afresh = True
        self._handed_over: tuple[Any, Any] = (None, None)  # the arrays, and what kernels take in their place
        self.paused = False  # whether the last run ended because its budget of work ran out

    def _plan(self, plan: WindowPlan | None, length: float, number: Any, count: Any) -> None:
        """Choose everything that depends on the length of an epoch."""
        at, scene = self.layout, self.scene
        number[at.EPOCH_LENGTH] = length
        number[at.ORDER_TOLERANCE] = 4.0 * math.ulp(length)
        number[at.LOWER_MEAN_SQUARE], number[at.UPPER_MEAN_SQUARE] = pace(scene, length)
        number[at.MEAN_SQUARE] = math.nan
        self.large = np.flatnonzero(scene.radii > plan.small_radius) if plan else np.zeros(0, dtype=np.int64)
        if plan is None:
            self._plan_lists(scene, number, count)
        else:
            self._plan_windows(scene, plan, number, count)

    def _plan_lists(self, scene: Scene, number: Any, count: Any) -> None:
        """Choose shells, cells and calendar of the list method."""
        at, n = self.layout, scene.n
        per_bucket = EVENTS_PER_BUCKET[n > CACHED]
        shell = shell_width(scene)
        cells = cells_per_axis(scene, 2.0 * shell * (1.0 + SLACK) + 2.0 * float(scene.radii.max()), n)
        self._set_cells(scene, cells, number, count)
        one_size = bool(np.all(scene.radii == scene.radii[0]))
        number[at.DISPLACEMENT_THRESHOLD] = shell
        number[at.LEAD] = LEAD / max(collision_frequency(scene), TINY)
        rounding = SLACK * float(np.max(scene.box / cells))  # of the centres in their cells
        number[at.CUTOFF] = (
            2.0 * shell * (1.0 + SLACK) + rounding + (2.0 * scene.radii[0] if one_size else 0.0)
        )
        # Where more than one image of a pair can matter, lists store the image index.
        few = bool(np.any(np.array(cells)[scene.periodic] < 3))
        count[at.IMAGES] = int(few or shell > widest_shell_of_one_image(scene))
        lanes = at.CELL_LANES
        count[at.CELL_ROOM] = lanes * math.ceil(min(n, 1.5 * n / self.cells + 3) / lanes)
        count[at.LIST_ROOM] = 32
        count[at.REBUILD_THRESHOLD] = MOST_ENTRIES if count[at.IMAGES] else math.ceil(PATIENCE * n)
        count[at.BUCKETS] = max(16, int(power_of_two_below(max(8 * n / per_bucket, 1))))
        self.blocks = int(count[at.BUCKETS]) // 2 + n // 3 + 64
        length = number[at.EPOCH_LENGTH]
        events = 2.0 * n * collision_frequency(scene) * length / per_bucket
        count[at.EPOCH_BUCKETS] = int(power_of_two_below(min(max(events, 16.0), 2.0**40)))
        number[at.INVERSE_WIDTH] = count[at.EPOCH_BUCKETS] / length

    def _plan_windows(self, scene: Scene, plan: WindowPlan, number: Any, count: Any) -> None:
        """Choose windows, cells and buckets of the window method."""
        at, n = self.layout, scene.n
        reach = plan.stretch + plan.small_radius
        grid = np.maximum(scene.box / (COLUMN * reach), 1.0).astype(np.int64)
        grid[1] = max(1, int(scene.box[1] / (ALONG * reach)))
        self._set_cells(scene, grid.tolist(), number, count)
        edge = float(np.max(scene.box / plan.cells))
        number[at.HALF_WINDOW] = 0.5 * plan.length
        number[at.HALF_LENGTH] = plan.stretch
        number[at.SEGMENT_UNIT] = 1.0 / edge
        number[at.SEGMENT_MARGIN] = SEGMENT_MARGIN * (1.0 + max(plan.cells) / 256.0)
        windows = round(number[at.EPOCH_LENGTH] / plan.length)
        collisions = 0.5 * n * collision_frequency(scene) * plan.length
        per_bucket = EVENTS_PER_BUCKET[n > CACHED]
        buckets = int(power_of_two_below(min(max(2.0 * collisions / per_bucket, 1.0), 2.0**30)))
        number[at.INVERSE_WIDTH] = windows * buckets / number[at.EPOCH_LENGTH]
        count[at.WINDOW_BUCKETS] = count[at.BUCKETS] = buckets
        count[at.EPOCH_BUCKETS] = windows * buckets
        count[at.SEGMENT_ROOM] = n + n // 4 + 1024
        count[at.OVERFLOW_ROOM] = n // 3 + 1024
        count[at.NEAR_ROOM] = 1024
        # Segments reach OVERHANG_UNITS units beyond their cells, or fewer where cells are wide.
        widths = np.minimum(np.floor(OVERHANG_UNITS * scene.box / (grid * reach)), WIDEST)
        beyond = np.ceil(reach * widths * grid / scene.box) + 1.0
        count[at.WIDTH : at.WIDTH + scene.dim] = widths
        count[at.OVERHANG : at.OVERHANG + scene.dim] = beyond
        density = widths * grid / scene.box
        number[at.UNIT_DENSITY : at.UNIT_DENSITY + scene.dim] = density
        number[at.SEGMENT_OVERHANG : at.SEGMENT_OVERHANG + scene.dim] = beyond / density
        count[at.CONTACT_ROOM] = n // 2 + 1024
        self.blocks = buckets + n // 8 + 256
        number[at.SMALL_RADIUS] = plan.small_radius
        number[at.LARGEST] = scene.radii.max()
        number[at.LARGE_DENSITY : at.LARGE_DENSITY + 3] = 1.0
        number[at.LARGE_DENSITY : at.LARGE_DENSITY + scene.dim] = np.array(plan.large_cells) / scene.box
        count[at.LARGE] = len(self.large)
        count[at.LARGE_CELLS : at.LARGE_CELLS + 3] = 1
        count[at.LARGE_CELLS : at.LARGE_CELLS + scene.dim] = plan.large_cells

    def _set_cells(self, scene: Scene, cells: list[int], number: Any, count: Any) -> None:
        at, dim = self.layout, scene.dim
        number[at.CELL_DENSITY : at.CELL_DENSITY + 3] = 1.0  # in 2D one layer of cells
        count[at.CELLS : at.CELLS + 3] = 1
        number[at.CELL_DENSITY : at.CELL_DENSITY + dim] = np.array(cells) / scene.box
        number[at.CELL_EDGE : at.CELL_EDGE + dim] = scene.box / np.array(cells)
        count[at.CELLS : at.CELLS + dim] = cells
        self.cells = math.prod(cells)

    def _searching_arrays(self, count: Any, blocks: int) -> dict[str, Any]:
        """Allocate everything that the search needs and that can be found again from the rows."""
        at = self.layout
        n, dim, sparse = int(count[at.N]), self.scene.dim, bool(count[at.WINDOW_BUCKETS])
        lists, windows = int(not sparse), int(sparse)
        room, cell_room = int(count[at.LIST_ROOM]), int(count[at.CELL_ROOM])
        sorted_room, contacts = int(count[at.SEGMENT_ROOM]), int(count[at.CONTACT_ROOM])
        heap = int(count[at.HEAP_ROOM])
        columns = math.prod(count[[at.CELLS, at.CELLS + 2]].tolist())
        heads = (columns + 1) * math.ceil(int(count[at.CELLS + 1]) / at.CELLS_OF_OVERFLOW) * windows
        heads += math.prod(count[at.LARGE_CELLS : at.LARGE_CELLS + 3].tolist())
        table = at.AROUND * cell_room + at.CELL_LANES
        places, overflow = self.cells * cell_room, int(count[at.OVERFLOW_ROOM])
        for entries, most in (
            (max(places, contacts, n + 6), MOST_ENTRIES),
            (sorted_room + overflow, MOST_SEGMENTS),
        ):
            if entries >= most:
                raise SimulationError(
                    f"{n} particles in {self.cells} cells need a table of {entries} entries, more "
                    f"than the {most} that are counted; take fewer particles, or spread them more evenly"
                )
        listed = n * room * (1 + dim * int(count[at.IMAGES])) + places * at.CELL_COLUMNS
        needed = (
            4 * listed
            + 44 * (sorted_room + n * windows)
            + 36 * overflow
            + 32 * contacts
            + 64 * blocks
            + n * (8 * (at.ROW + at.EVENT) + 32)
        )
        require_memory(needed, f"the tables to search among {n} particles", SimulationError)
        pairs = int(count[at.NEAR_ROOM]) + 32
        unsorted = aligned(at.SEGMENT * (n + 8) * windows + 8, np.float32)
        segments = aligned(at.SEGMENT * (sorted_room + overflow + 2), np.float32)
        cell_places = aligned(self.cells * at.CELL_COLUMNS * cell_room + 1, np.float32)
        around = aligned(at.CELL_COLUMNS * table * lists + 1, np.float32)
        return {
            "unsorted": unsorted,
            "unsorted_words": unsorted.view(np.int32),
            "segments": segments,
            "segment_words": segments.view(np.int32),
            "neighbours": aligned(n * room + 1, np.int32),
            "images": np.zeros(n * room * dim * int(count[at.IMAGES]) + 1, dtype=np.int32),
            "cell_count": np.zeros(self.cells + int(count[at.CELLS + 1]) + 1, dtype=np.int32),
            "cell_places": cell_places,
            "cell_ids": cell_places.view(np.int32),
            "near": aligned((table + room) * lists + 1, np.int32),
            "around": around,
            "around_ids": around.view(np.int32),
            "buckets": np.zeros(int(count[at.BUCKETS]) + 1, dtype=np.int64),
            "blocks": aligned(blocks * at.BLOCK + 1, np.int64),
            "waiting_slot": np.full(at.WAITING, -1, dtype=np.int64),
            "waiting_entry": np.zeros(at.WAITING, dtype=np.int64),
            "heap_time": np.zeros(heap),
            "heap_key": np.zeros(heap, dtype=np.int64),
            "heap_entry": np.zeros(heap, dtype=np.int64),
            "order": np.append(
                np.setdiff1d(np.arange(n * windows, dtype=np.int32), self.large), np.zeros(8, dtype=np.int32)
            ),
            "large": np.append(self.large, 0).astype(np.int32),
            "unsorted_boxes": aligned((n + 8) * windows + 1, np.int64),
            "boxes": aligned(sorted_room + overflow + 18, np.int64),
            "cell_of_segment": np.zeros(sorted_room + 1, dtype=np.int32),
            **self._columns(count),
            "image_shifts": image_shifts(count[at.CELLS : at.CELLS + dim], count[at.WIDTH : at.WIDTH + dim]),
            "pair_slot": aligned(pairs, np.int32),
            "pair_own": aligned(pairs, np.uint32),
            "own_slots": aligned(8, np.int32),
            "pair_segments": aligned(128, np.float32),
            "passed": aligned(pairs, np.int32),
            "changed": np.zeros(16, dtype=np.int64),
            "places": np.zeros(32, dtype=np.int64),
            "overflow_first": np.zeros(heads + 1, dtype=np.int32),
            "overflow_next": np.zeros(overflow + 1, dtype=np.int32),
            "contacts": aligned(contacts * at.CONTACT + 1, np.int64),
        }

    def _columns(self, count: Any) -> dict[str, Any]:
        """Return the table of columns of cells; all those one cell beyond a wall are one empty column."""
        nx, _, nz = count[self.layout.CELLS : self.layout.CELLS + 3].tolist()
        x, z = (np.arange(-1, cells + 1) for cells in (nx, nz))
        periodic = dict(enumerate(self.scene.periodic.tolist()))
        outside = (x % nx != x)[:, None] & (not periodic[0]) | (z % nz != z) & (not periodic.get(2, False))
        column = np.where(outside, nx * nz, (x % nx)[:, None] * nz + z % nz)
        code = self.layout.SAME - self.layout.IMAGE[0] * (x[:, None] // nx) - self.layout.IMAGE[2] * (z // nz)
        return {"column": column.astype(np.int32).ravel(), "column_code": code.astype(np.int32).ravel()}

    def _make_room(self) -> None:
        """Double whatever ran out; the search then starts again from the rows. Complete, or not at all."""
        at, count, blocks = self.layout, self.arrays.counter.copy(), self.blocks
        if count[at.SHORT_LISTS]:
            count[at.LIST_ROOM] *= 2
            count[at.SEGMENT_ROOM] *= 2
            count[at.OVERFLOW_ROOM] *= 2
        if count[at.SHORT_CELLS]:
            count[at.CELL_ROOM] *= 2
        if count[at.SHORT_QUEUE]:
            count[at.HEAP_ROOM] *= 2
            count[at.CONTACT_ROOM] *= 2
            count[at.NEAR_ROOM] *= 2
            blocks *= 2
        count[[at.SHORT_LISTS, at.SHORT_CELLS, at.SHORT_QUEUE]] = 0
        self.arrays = self.arrays._replace(**self._searching_arrays(count, blocks))
        self.arrays.counter[:] = count  # after the arrays: never room in the books that is not there
        self.blocks = blocks

    @property
    def length(self) -> float:
        """Length of an epoch."""
        return float(self.arrays.number[self.layout.EPOCH_LENGTH])

    @property
    def last_event(self) -> tuple[int, float]:
        """Time of the last event: its epoch, and the time within that one."""
        at, arrays = self.layout, self.arrays
        return int(arrays.counter[at.EPOCH]), max(float(arrays.number[at.NOW]), 0.0)

    def keep_clock(self) -> None:
        """Set the time to that of the last event, if that is later."""
        self.now = max(self.now, self.last_event)

    @property
    def passed(self) -> float:
        """Time since the tallies began."""
        (epoch, moment), (first, begun, *_) = self.now, self.since
        return (epoch - first) * self.length + (moment - begun)

    def tallied(self) -> Any:
        """Return what was tallied since `since`, in one row.

        Virial and kinetic tensor, (d, d) each; wall impulses, and these times radii, (d, 2) each: as in
        `simulation.Tallies`.
        """
        at, dim = self.layout, self.scene.dim
        v = self.rows[:, at.V : at.V + dim].copy()
        row = self.tallied_by_events()
        row[dim * dim : 2 * dim * dim] += (momentum_flux(v, self.scene.masses) * self.passed).ravel()
        return row

    def tallied_by_events(self) -> Any:
        """Return what `tallied` does, less the part of the kinetic tensor that needs all velocities.

        The integral of K from t0 to t1 is K(t1) (t1 - t0) - sum over events of dK (t - t0): the first term is
        missing.
        """
        at, total, dim = self.layout, self.arrays.total, self.scene.dim
        epoch, moment, *_ = self.since
        places = COMPONENTS[dim]
        moments = (total[at.STRESS_EPOCHS + places] - epoch * total[at.STRESS + places]) * self.length + (
            total[at.STRESS_MOMENT + places] - moment * total[at.STRESS + places]
        )
        walls = [total[first : first + 2 * dim] for first in (at.WALL_IMPULSE, at.WALL_RADIUS_IMPULSE)]
        return np.concatenate([total[at.VIRIAL + places].ravel(), -moments.ravel(), *walls])

    def reset_tallies(self) -> None:
        """Begin the tallies anew; what there was is added to `earlier`.

        The kernels' sums begin at 0 again, so that short stretches late in a long run keep all their digits.
        """
        at, arrays = self.layout, self.arrays
        self.earlier = self.earlier + self.tallied()
        arrays.total[: at.SUMS] = 0.0
        self.since = (*self.now, int(arrays.counter[at.PAIRS]), int(arrays.counter[at.WALL_HITS]))
        if self.flights:
            self.flights.reset(arrays, *self.now)

    @property
    def due(self) -> float:
        """Length of epochs from now on, by the mean square speed at the beginning of this one."""
        at, number, epoch = self.layout, self.arrays.number, int(self.arrays.counter[self.layout.EPOCH])
        length, v2 = self.length, float(number[at.MEAN_SQUARE])
        if v2 >= number[at.UPPER_MEAN_SQUARE]:
            return epoch_length_at(self.scene, v2)
        if v2 < number[at.LOWER_MEAN_SQUARE] and epoch % 16 == 0:
            longest = min(epoch_length_at(self.scene, v2), epoch_length(self.scene))
            return min(longest, length * (epoch & -epoch))  # it begins at a multiple of the longer one
        return length

    def in_pace(self) -> "Engine":
        """Return this engine, or one with another epoch length if speeds have changed much."""
        length = self.due
        if length == self.length:
            return self
        if recounted(self.last_event[0], 0.0, self.length, length)[0] >= FOREVER:
            epoch, moment = self.now
            raise SimulationError(
                f"at time {epoch * self.length + moment:.3g} particles have become so fast that epochs can "
                "no longer be counted"
            )
        return self.with_epochs(length)

    def with_epochs(self, length: float) -> "Engine":
        """Return this engine, at the start of an epoch, with epochs longer or shorter by a power of two.

        Rows and times are unchanged; counts of epochs are converted to the new length.
        """
        at, old, before = self.layout, self.arrays, self.length
        number, count, total, flight = (a.copy() for a in (old.number, old.counter, old.total, old.flight))
        other = copy.copy(self)
        plan = window_plan(self.scene, length, "windows") if count[at.WINDOW_BUCKETS] else None
        other._plan(plan, length, number, count)
        for epoch in (at.EPOCH, at.LAST_PAIR_EPOCH):
            count[epoch], _ = recounted(int(count[epoch]), 0.0, before, length)
        count[at.BUCKET] = 0
        total[at.STRESS_EPOCHS : at.WALL_IMPULSE] *= before / length
        if self.flights:
            self.flights.recount(flight, before, length)
        other.arrays = old._replace(
            number=number,
            counter=count,
            total=total,
            flight=flight,
            **other._searching_arrays(count, other.blocks),
        )
        other.now = recounted(*self.now, before, length)
        other.since = (*recounted(*self.since[:2], before, length), *self.since[2:])
        other._afresh = True
        return other

    def run(self, stop_epoch: int, stop_time: float, stop_pairs: int, budget: int) -> bool:
        """Execute events up to a time or a number of pair collisions; False if the budget ran out first."""
        # An interrupt before the result is known costs only a new search.
        afresh, self._afresh = self._afresh, True
        if self._handed_over[0] is not self.arrays:
            self._handed_over = self.arrays, self.kernels.handed_over(self.arrays)
        arrays = self._handed_over[1]
        status = self.kernels.run(
            arrays, self.cells, self.blocks, afresh, stop_epoch, stop_time, stop_pairs, budget
        )
        self.paused = status == self.kernels.PAUSED
        if status == self.kernels.NO_ROOM:
            self._make_room()
            return False
        if status == self.kernels.EPOCH_LENGTH_DUE:  # the epoch has begun, and nothing of it is known yet
            return False
        self._afresh = False
        if status == self.kernels.LOG_FULL:
            self.hand_over_log()
            return False
        if status == self.kernels.STANDS_STILL:
            raise SimulationError(
                f"time stands still: {1000 * self.scene.n} events without progress at "
                f"{self.arrays.counter[self.layout.PAIRS]} collisions; the particles touch on all sides (a "
                "jammed packing), so give them room"
            )
        return bool(status == self.kernels.DONE)

    def hand_over_log(self) -> None:
        """Pass the buffered events to the sink, in a chunk of their own; at most once, also on failure."""
        at, arrays = self.layout, self.arrays
        logged = int(arrays.counter[at.LOGGED])
        if self.sink is not None and logged:
            events = as_events(arrays.log[: logged * at.LOG_ROW].reshape(logged, at.LOG_ROW), at)
            arrays.counter[at.LOGGED] = 0
            self.sink(events)

    @property
    def rows(self) -> Any:
        """The canonical state, one row for each particle (a view)."""
        return self.arrays.row.reshape(-1, self.layout.ROW)[: self.scene.n]

    def state(self) -> dict[str, Any]:
        """Return the arrays from which everything else can be computed (views): see `kernel.layout`."""
        at = self.layout
        arrays = {name: getattr(self.arrays, array) for name, array in at.STATE_ARRAYS.items()}
        numbers, counters = list(at.STATE_NUMBERS), list(at.STATE_COUNTERS)
        if self.flights:
            arrays |= self.flights.state()
        return arrays | {
            "row": self.rows,
            "earlier": self.earlier,
            "numbers": self.arrays.number[numbers],
            "counters": self.arrays.counter[counters],
            "counts": self.arrays.counter[at.COUNTERS :],  # of flights
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a state from `state`, checked by the caller; everything else is computed from it."""
        at, arrays = self.layout, self.arrays
        for name, array in self.state().items():
            array[...] = state[name]
        arrays.number[list(at.STATE_NUMBERS)] = state["numbers"]
        arrays.counter[list(at.STATE_COUNTERS)] = state["counters"]
        # The search begins in the bucket of the last event: all coming events lie there or later.
        last = int(arrays.counter[at.EPOCH_BUCKETS]) - 1
        arrays.counter[at.BUCKET] = min(
            int(max(arrays.number[at.NOW], 0.0) * arrays.number[at.INVERSE_WIDTH]), last
        )
        self._afresh = True

    @property
    def method(self) -> str:
        """The search method in words."""
        if self.arrays.counter[self.layout.WINDOW_BUCKETS]:
            return "windows of time" + ", two grids" * bool(len(self.large))
        images = bool(self.arrays.counter[self.layout.IMAGES])
        return "neighbour lists" + (" that name the image" if images else "")

    @property
    def bytes(self) -> int:
        """Memory of the kernels' arrays."""
        places = {a.ctypes.data: a.nbytes for a in self.arrays}  # some share memory
        return sum(places.values())
