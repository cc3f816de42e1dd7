"""The engine's state: the kernels' arrays of a scene, which grow as needed, and the clock."""

import copy
import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from hardspheres.checks import inertia
from hardspheres.clock import FOREVER, recounted
from hardspheres.cores import available_cores, idle_cores
from hardspheres.crew import Crew
from hardspheres.domains import too_small
from hardspheres.errors import SimulationError
from hardspheres.event_log import ROOM, Sink, as_events
from hardspheres.event_order import in_order
from hardspheres.free_paths import FlightTallies
from hardspheres.kernel.arrays import OF_RUN, OF_SEARCH, allocated, bytes_of, record
from hardspheres.lists import Lists
from hardspheres.memory import require_memory
from hardspheres.scene import Scene, energy_flux, momentum_flux, squares_at_floor
from hardspheres.sums import accumulated, add_to
from hardspheres.tally_units import per_unit, tally_units, write_tally_units
from hardspheres.tuning import epoch_length, epoch_length_at, pace
from hardspheres.windows import Windows, windows_for

CACHED = 16000  # particles that fit the caches of a core
CACHED_AT_ALL = 48000  # particles that fit the caches that cores share
# Where the sums keep the components of a symmetric tensor.
COMPONENTS = {2: np.array([[0, 2], [2, 1]]), 3: np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])}


class How(NamedTuple):
    """How a simulation is computed; no bit depends on it.

    Attributes
    ----------
    search : str
        One of `tuning.SEARCHES`.
    threads : int
        Threads that may be at work; fewer are where there are fewer idle cores, or where they cannot share
        the gas.
    """

    search: str = "auto"
    threads: int = 1

    def threads_for(self, two_grids: bool) -> tuple[int, str | None]:
        """Return how many threads to use, if the gas is large enough, and why they are fewer."""
        if self.threads == 1:
            return 1, None
        if two_grids:
            return 1, (
                f"threads={self.threads}: this gas runs on one thread, because its large particles, among "
                "many small ones, are in a grid of their own"
            )
        idle = idle_cores()
        if idle < self.threads:
            many = "thread" if idle == 1 else "threads"
            sentence = (
                f"threads={self.threads}: this gas runs on {idle} {many}, as {idle} of the "
                f"{available_cores()} cores that this process may use {'is' if idle == 1 else 'are'} idle"
            )
            return idle, sentence
        return self.threads, None


ALONE = How()


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
    how : How
        How the work is done; spheres that grow have lists, and one thread.
    heat : bool
        Tally the heat flux; not where spheres grow or fall.

    Attributes
    ----------
    arrays : Arrays
        What the kernels work on; `number`, `counter`, `total` are addressed by the names in `kernel.layout`.
    how : How
        How the work was to be done.
    search : Lists or Windows
        How it finds the coming events.
    threads : int
        Threads that are at work.
    shortfall : str or None
        Why these are fewer than asked for, in a sentence.
    layout : module
        Those names, for this kind of scene.
    flights : FlightTallies or None
        The layout of the tallies of flights.
    heat : bool
        Whether the heat flux is tallied.
    sink : callable or None
        Receives chunks of the event log; set by the owner of one.
    now : (int, float)
        The time: whole epochs, and the time within this one. It is the end of the last run, or that of its
        last event.
    units : TallyUnits
        Scales of what is tallied.
    per_unit : array
        1 / the unit of each of the kernels' sums that is none of flights.
    since : (int, float, int, int)
        Where the tallies began: epoch, time within it, pair collisions, wall collisions.
    total_then, integral_then : arrays
        What the kernels' sums and integrals were then; those go on from the start.
    """

    def __init__(
        self,
        scene: Scene,
        growth: tuple[float, float] | None = None,
        flights: bool = False,
        logs: bool = False,
        how: How = ALONE,
        heat: bool = False,
    ) -> None:
        from hardspheres.kernel import specialise

        sizes = bool(np.any(scene.radii != scene.radii[0]))
        masses = bool(np.any(scene.masses != scene.masses[0]))
        length = epoch_length(scene)
        self.how = how
        windows = windows_for(scene, length, self.how.search) if growth is None else None
        two_grids = windows is not None and len(windows.large) > 0
        threads, self.shortfall = (1, None) if growth else self.how.threads_for(two_grids)
        self.search: Lists | Windows = windows.on(threads) if windows else Lists(scene, threads)
        domains = self.search.domains
        self.threads = domains.threads if domains else 1
        if self.threads < threads:
            self.shortfall = too_small(scene.n, threads, self.threads)
        self.kernels: Any = specialise(
            scene.dim,
            not bool(scene.periodic.all()),
            sizes,
            masses,
            windows is not None,
            growth is not None,
            flights,
            scene.falls,
            scene.n_moving < scene.n,
            heat,
            domains is not None,
        )
        self.layout: Any = self.kernels.at
        self.scene = scene
        self.flights = FlightTallies(scene, self.layout) if flights else None
        self.heat = heat
        self.sink: Sink | None = None
        at = self.layout
        n, dim = scene.n, scene.dim

        flight, units = self.flights.prepared(length) if self.flights else (np.zeros(0), np.zeros(0))
        number = np.append(np.zeros(at.NUMBERS), units)
        count = np.zeros(at.COUNTERS, dtype=np.int64)
        sigma = 2.0 * float(scene.radii[0])
        number[at.BOX : at.BOX + dim] = scene.box
        number[at.INVERSE : at.INVERSE + dim] = np.where(scene.periodic, 1.0 / scene.box, 0.0)
        number[at.SIGMA2] = sigma * sigma
        number[at.COMMON_RADIUS] = scene.radii[0]
        number[at.MASS] = scene.masses[0]
        number[at.REDUCED] = 0.5 * scene.masses[0]
        number[at.LAST_ADVANCE] = -length
        if scene.falls:
            number[at.PULL : at.PULL + dim] = scene.gravity
            number[at.WEIGHT : at.WEIGHT + dim] = math.fsum(inertia(scene.masses).tolist()) * scene.gravity
        number[at.SCALE], number[at.GROWTH] = growth or (1.0, 0.0)
        count[at.N] = n
        count[at.HEAP_ROOM] = 1024 + n // 16
        count[at.BEYOND_CACHE] = int(n > CACHED)
        count[at.BEYOND_ALL] = int(n > CACHED_AT_ALL)
        count[at.SPECIES_COUNT] = len(units) // at.FLIGHT_UNIT
        count[at.LOG_ROOM] = ROOM if logs else 0
        self.units = tally_units(scene)
        self._plan(length, number, count)
        searching = self._searching_arrays(count)
        self.arrays: Any = record(searching | allocated(OF_RUN, at, count))
        self.arrays.number[:] = number
        self.arrays.counter[: at.COUNTERS] = count
        self.arrays.flight[: len(flight)] = flight
        self.arrays.mass[:] = scene.masses if masses else scene.masses[0]
        self.arrays.row[n * at.ROW :] = math.nan
        self.rows[:, at.X : at.X + dim] = scene.positions
        # Without negative zeros: a sum with zero keeps or loses their sign depending on its order. No
        # collision creates one.
        self.rows[:, at.V : at.V + dim] = scene.velocities + 0.0
        if sizes:
            self.rows[:, at.RADIUS] = scene.radii
        if scene.falls:
            self.arrays.fall[:] = squares_at_floor(scene, scene.positions, scene.velocities).ravel()
        self.now = (0, 0.0)
        self.since = (0, 0.0, 0, 0)
        self.total_then, self.integral_then = self.arrays.total.copy(), self.arrays.integral.copy()
        self._afresh = True
        self._handed_over: tuple[Any, Any] = (None, None)  # the arrays, and what kernels take in their place
        self._crew: Crew | None = None
        self.paused = False  # whether the last run ended because its budget of work ran out

    def _plan(self, length: float, number: Any, count: Any) -> None:
        """Write everything that depends on the length of an epoch to numbers and counters."""
        at, scene = self.layout, self.scene
        number[at.EPOCH_LENGTH], number[at.PER_EPOCH] = length, 1.0 / length
        number[at.ORDER_TOLERANCE] = 4.0 * math.ulp(length)
        number[at.LOWER_MEAN_SQUARE], number[at.UPPER_MEAN_SQUARE] = pace(scene, length)
        number[at.MEAN_SQUARE] = math.nan
        write_tally_units(at, self.units, length, number)
        self.per_unit = per_unit(at, number)
        self.search.plan(at, number, count)

    def _searching_arrays(self, count: Any) -> dict[str, Any]:
        """Allocate everything that the search needs and that can be found again from the rows."""
        at = self.layout
        self.search.require_countable(at, count)
        needed = bytes_of(OF_RUN + OF_SEARCH, at, count)
        require_memory(needed, f"the tables to search among {self.scene.n} particles", SimulationError)
        arrays = allocated(OF_SEARCH, at, count)
        self.search.fill(at, arrays)
        return arrays

    def _make_room(self) -> None:
        """Double whatever ran out; the search then starts again from the rows. Complete, or not at all."""
        at, count = self.layout, self.arrays.counter.copy()
        for short, rooms in at.ROOMS.items():
            if count[short]:
                count[short] = 0
                count[rooms] *= 2
        self.arrays = self.arrays._replace(**self._searching_arrays(count))
        self.arrays.counter[:] = count  # after the arrays: never room in the books that is not there

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
        `simulation.Tallies`. Where heat is tallied, then heat transfer and flux, (d,) each.
        """
        dim, (_, v) = self.scene.dim, self.flown()
        row = self.tallied_by_events()
        row[dim * dim : 2 * dim * dim] += (momentum_flux(v, self.scene.masses) * self.passed).ravel()
        if self.heat:
            row[-dim:] += energy_flux(v, self.scene.masses) * self.passed
        return row

    def flown(self) -> tuple[Any, Any]:
        """Positions and velocities now, positions as the rows count them: perhaps out of the box."""
        at, rows, dim = self.layout, self.rows, self.scene.dim
        x, v, dt = rows[:, at.X : at.X + dim], rows[:, at.V : at.V + dim].copy(), self._since_rows[:, None]
        if not self.scene.falls:
            return x + v * dt, v
        pull = self.scene.accelerations
        return x + (v + 0.5 * pull * dt) * dt, v + pull * dt

    @property
    def _since_rows(self) -> Any:
        """Time since each row was written."""
        at, (epoch, moment) = self.layout, self.now
        behind = epoch - int(self.arrays.counter[at.EPOCH])
        return (behind * self.length + moment) - self.rows[:, at.T]

    def _fallen(self) -> Any:
        """Return what flights since their rows add to the sums of `kernel.common.tallies`."""
        at, scene, dt = self.layout, self.scene, self._since_rows[:, None, None]
        v = self.rows[:, at.V : at.V + scene.dim]
        t = self.rows[:, at.T, None, None]
        mass = inertia(scene.masses)[:, None, None]
        c = v[:, :, None] * scene.gravity
        c = mass * (c + np.swapaxes(c, 1, 2))
        p = mass * np.multiply.outer(scene.gravity, scene.gravity)
        change = (c + p * dt) * dt
        moment = np.sum(change * t + (0.5 * c + 2.0 / 3.0 * p * dt) * dt * dt, axis=0)
        places, sums = COMPONENTS[scene.dim], np.zeros(at.SUMS)
        sums[at.STRESS + places], sums[at.STRESS_MOMENT + places] = np.sum(change, axis=0), moment
        return sums

    def blocks(self, total: Any) -> list[Any]:
        """Return the parts of an array of sums, views of shape (..., 2, n): whole numbers and fractions."""
        at = self.layout
        of_flights = total[at.FLIGHT_SUMS :].reshape(-1, 2, at.FLIGHT_SUM)
        return [total[: at.FLIGHT_SUMS].reshape(2, at.SUMS), of_flights]

    def sums(self, from_start: bool = False) -> Any:
        """Return what the kernels' sums that are none of flights have become since `since`, or the start.

        Rounded once: the differences of whole numbers and of fractions are exact.
        """
        at = self.layout
        then = 0.0 if from_start else self.total_then[: at.FLIGHT_SUMS]
        whole, fraction = (self.arrays.total[: at.FLIGHT_SUMS] - then).reshape(2, at.SUMS)
        return (whole + fraction) / self.per_unit

    def tallied_by_events(self, from_start: bool = False) -> Any:
        """Return what `tallied` does, less what of kinetic tensor and heat flux needs all velocities.

        The integral of K from t0 to t1 is K(t1) (t1 - t0) plus that of K - K(t1): the first term is missing.
        The second has no use for what K was at the start.
        """
        at, dim, arrays = self.layout, self.scene.dim, self.arrays
        epoch, moment = (0, 0.0) if from_start else self.since[:2]
        # Between the beginnings of the two epochs.
        passed = (int(arrays.counter[at.EPOCH]) - epoch) * self.length
        changed = self.sums(from_start)
        all_changed = changed if from_start else self.sums(from_start=True)
        if self.scene.falls:
            fallen = self._fallen()
            changed, all_changed = changed + fallen, all_changed + fallen
        value, rest = (arrays.integral - (0.0 if from_start else self.integral_then)).reshape(2, at.INTEGRALS)
        integral = value + rest

        def part(first: int, changes: int, moments: int, places: Any) -> Any:
            until = integral[first + places] - passed * all_changed[changes + places]
            return until + (moment * changed[changes + places] - changed[moments + places])

        axes, places = np.arange(dim), COMPONENTS[dim]
        kinetic = part(at.STRESS_INTEGRAL, at.STRESS, at.STRESS_MOMENT, places)
        walls = [changed[first : first + 2 * dim] for first in (at.WALL_IMPULSE, at.WALL_RADIUS_IMPULSE)]
        heat = []
        if self.heat:
            flux = part(at.HEAT_INTEGRAL, at.HEAT_FLUX, at.HEAT_MOMENT, axes)
            heat = [changed[at.HEAT_TRANSFER + axes], flux]
        return np.concatenate([changed[at.VIRIAL + places].ravel(), kinetic.ravel(), *walls, *heat])

    def reset_tallies(self) -> None:
        """Begin the tallies anew. The kernels' sums go on: differences of them are exact."""
        at, arrays = self.layout, self.arrays
        self.total_then, self.integral_then = arrays.total.copy(), arrays.integral.copy()
        if self.scene.falls:  # of the flights under way, what there was until now does not count
            add_to(self.total_then, 0, at.SUMS, self._fallen() * self.per_unit)
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
        number, count, flight = (a.copy() for a in (old.number, old.counter, old.flight))
        other = copy.copy(self)
        other.search = self.search.for_epochs(length)
        other._plan(length, number, count)
        for epoch in (at.EPOCH, at.LAST_PAIR_EPOCH):
            count[epoch], _ = recounted(int(count[epoch]), 0.0, before, length)
        count[at.BUCKET] = 0
        if self.flights:
            self.flights.recount(flight, before, length)
        other.arrays = old._replace(
            number=number,
            counter=count,
            flight=flight,
            **other._searching_arrays(count),
        )
        other.now = recounted(*self.now, before, length)
        other.since = (*recounted(*self.since[:2], before, length), *self.since[2:])
        other.total_then, other.integral_then = self._then(other.since[1])
        other._afresh = True
        return other

    def _then(self, moment: float) -> tuple[Any, Any]:
        """Return `total_then` and `integral_then` for a `since` at another moment of an epoch.

        The integral up to `since` is the same: up to the beginning of its epoch, plus the sum times the
        moment in it, less the sum's moment.
        """
        at, total, integral = self.layout, self.total_then.copy(), self.integral_then.copy()
        sums = (total[: at.SUMS] + total[at.SUMS : at.FLIGHT_SUMS]) / self.per_unit
        parts = [(at.STRESS_INTEGRAL, at.STRESS, at.STRESS_MOMENT, at.TENSOR)]
        parts += [(at.HEAT_INTEGRAL, at.HEAT_FLUX, at.HEAT_MOMENT, 3)] if self.heat else []
        for first, changes, moments, n in parts:
            more = sums[changes : changes + n] * (self.since[1] - moment) - sums[moments : moments + n]
            value, rest = integral.reshape(2, at.INTEGRALS)[:, first : first + n]  # views
            value[:], rest[:] = accumulated(value, rest, more, 0.0)
            total[: at.FLIGHT_SUMS].reshape(2, at.SUMS)[:, moments : moments + n] = 0.0
        return total, integral

    def run(self, stop_epoch: int, stop_time: float, stop_pairs: int, budget: int) -> bool:
        """Execute events up to a time or a number of pair collisions; False if the budget ran out first."""
        # An interrupt before the result is known costs only a new search.
        afresh, self._afresh = self._afresh, True
        if self._handed_over[0] is not self.arrays:
            self._handed_over = self.arrays, self._caller()
        status = self._handed_over[1](afresh, stop_epoch, stop_time, stop_pairs, budget)
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
        if status == self.kernels.RESTS:
            who = int(self.arrays.counter[self.layout.RESTING]) - 1
            self.arrays.counter[self.layout.RESTING] = 0
            on = "a wall" if self.scene.n_moving == self.scene.n else "a wall or an obstacle"
            raise SimulationError(
                f"particle {who} has come to rest on {on} that gravity pulls it to, at "
                f"{self.arrays.counter[self.layout.PAIRS]} collisions: its bounces have become lower than "
                "the rounding of its radius, and there would be no end of them; start from other positions"
            )
        return bool(status == self.kernels.DONE)

    def _caller(self) -> Any:
        """Return what runs the present arrays."""
        if self.layout.THREADS:
            self.hand_over_log()
            self._crew = Crew(self.kernels, self.arrays, self.blocks)
            return self._crew.run
        return partial(self.kernels.run, self.kernels.handed_over(self.arrays))

    def hand_over_log(self) -> None:
        """Pass the buffered events to the sink, in a chunk of their own; at most once, also on failure."""
        at, arrays = self.layout, self.arrays
        rows = self._crew.log if self._crew else []
        if logged := int(arrays.counter[at.LOGGED]):
            rows.append(arrays.log[: logged * at.LOG_ROW].reshape(logged, at.LOG_ROW))
        if self.sink is not None and rows:
            events = np.concatenate(rows)
            if self._crew:
                events = in_order(events, at, ~self.scene.obstacles)
            rows.clear()
            arrays.counter[at.LOGGED] = 0
            self.sink(as_events(events, at))

    @property
    def rows(self) -> Any:
        """The canonical state, one row for each particle (a view)."""
        return self.arrays.row.reshape(-1, self.layout.ROW)[: self.scene.n]

    @property
    def versions(self) -> Any:
        """How often each row has changed through events."""
        at, n = self.layout, self.scene.n
        return self.arrays.row_int[at.VERSION :: at.ROW][:n] if at.VERSION_IN_ROW else self.arrays.version[:n]

    def state(self) -> dict[str, Any]:
        """Return the arrays from which everything else can be computed (views): see `kernel.layout`."""
        at = self.layout
        kept = (array for array in OF_RUN if array.kept and array.length(at, self.arrays.counter))
        arrays = {array.kept: getattr(self.arrays, array.name) for array in kept}
        numbers, counters = list(at.STATE_NUMBERS), list(at.STATE_COUNTERS)
        if self.flights:
            arrays |= self.flights.state()
        return arrays | {
            "row": self._rows_without_versions,
            "total_then": self.total_then,
            "integral_then": self.integral_then,
            "numbers": self.arrays.number[numbers],
            "counters": self.arrays.counter[counters],
            "counts": self.arrays.counter[at.COUNTERS :],  # of flights
        }

    @property
    def _rows_without_versions(self) -> Any:
        """The rows, or a copy without what threads keep in them."""
        if not self.layout.VERSION_IN_ROW:
            return self.rows
        rows = self.rows.copy()
        rows[:, self.layout.VERSION] = 0.0
        return rows

    def restore(self, state: dict[str, Any]) -> None:
        """Restore a state from `state`, checked by the caller; everything else is computed from it."""
        at, arrays = self.layout, self.arrays
        for name, array in self.state().items():
            array[...] = state[name]
        self.rows[...] = state["row"]
        arrays.number[list(at.STATE_NUMBERS)] = state["numbers"]
        arrays.counter[list(at.STATE_COUNTERS)] = state["counters"]
        # The search begins in the bucket of the last event: all coming events lie there or later.
        last = int(arrays.counter[at.EPOCH_BUCKETS]) - 1
        arrays.counter[at.BUCKET] = min(
            int(max(arrays.number[at.NOW], 0.0) * arrays.number[at.INVERSE_WIDTH]), last
        )
        self._afresh = True

    @property
    def bytes(self) -> int:
        """Memory of the kernels' arrays."""
        return bytes_of(OF_RUN + OF_SEARCH, self.layout, self.arrays.counter)
