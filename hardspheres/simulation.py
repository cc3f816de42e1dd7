"""Simulation: a scene in motion. Runs it, shows it, tallies it; looking never changes it."""

import copy
import functools
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import partial
from numbers import Real
from os import PathLike
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hardspheres.clock import FOREVER, carried, recounted
from hardspheres.engine import Engine
from hardspheres.errors import SimulationError
from hardspheres.event_log import NpyStream, Sink, sink_of
from hardspheres.free_paths import MOST_SPECIES, FreePaths
from hardspheres.scene import (
    Scene,
    kinetic_energy,
    momentum_flux,
    read_only,
    returned_to_box,
    thermal_energy,
    total_momentum,
)
from hardspheres.tuning import SEARCHES, collision_rate, power_of_two_below

Floats = NDArray[np.float64]
Look = TypeVar("Look", bound=Callable[..., Any])

SLICE = 0.1  # seconds after which control comes back to Python
PATIENCE = 1000.0  # expected times to the next collision without one, until `run(collisions=...)` gives up,
LEAST_PATIENCE = 10  # but not in fewer epochs
ROWS_BETWEEN_LOOKS = 1 << 16  # it looks after as many epochs as take so many rows into the next one,
MOST_BETWEEN_LOOKS = 1 << 12  # but no more than these
RUNNING = (
    "this simulation is at work already, in another thread or in the call that this one comes from; wait until that has "
    "returned, or give each a copy of its own"
)


def _number(name: str, value: Any) -> float:
    """Return a finite number, or raise SimulationError."""
    try:
        number = float(value) if type(value) in (int, float) or _is_real(value) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise SimulationError(f"{name} needs a finite number, not {value!r}")
    return number


def _is_real(value: Any) -> bool:
    """Whether this is one real number: neither masked, nor truth, text or bytes, nor complex, nor a duration."""
    if isinstance(value, np.ma.MaskedArray) or np.ndim(value) > 0:
        return False
    kind = np.asarray(value).dtype.kind
    return kind in "iuf" or (kind == "O" and isinstance(value, (Real, Decimal)))


def _checked(name: str, values: Iterator[Any], first: float) -> Iterator[float]:
    """Yield numbers, or raise SimulationError where they are none, do not ascend, or the first comes too early."""
    last = None
    for value in values:
        number = _number(f"frames({name}=...)", value)
        if last is None and number < first:
            raise SimulationError(
                f"frames({name}=...) begins at {number}, but the simulation is at {first} already"
            )
        if last is not None and number < last:
            raise SimulationError(f"frames({name}=...) needs values in ascending order")
        last = number
        yield number


def _whole(name: str, value: Any) -> int:
    """Return a whole number of at least 0 that can be counted to, or raise SimulationError."""
    number = _number(name, value)
    if number != int(number) or not 0 <= number < FOREVER // 2:
        raise SimulationError(f"{name} needs a whole number of at least 0 and below 2^61, not {value!r}")
    return int(value)


def at_rest(look: Look) -> Look:
    """Refuse a look at a simulation that runs meanwhile: what it saw could be of two moments."""

    @functools.wraps(look)
    def guarded(self: "Simulation", *args: Any, **options: Any) -> Any:
        runs = self._runs
        if self._lock.locked():
            raise SimulationError(RUNNING)
        try:
            return look(self, *args, **options)
        finally:
            if self._runs != runs:
                raise SimulationError(RUNNING)

    return guarded  # type: ignore[return-value]


@dataclass(frozen=True)
class Tallies:
    """What the engine counted: in `Simulation.tallies` since `reset_tallies`, in `Frame.tallies` since the start.

    Arrays are read-only.

    Attributes
    ----------
    time : float
        Simulated time.
    collisions, wall_collisions : int
        Pair collisions, and hits of walls.
    virial : (d, d) float64 array
        Sum of r_a dp_b over pair collisions, r the separation at contact and dp the momentum passed along it, [energy time].
    kinetic : (d, d) float64 array
        Integral over time of sum m v_a v_b, [energy time].
    wall_impulses : (d, 2) float64 array
        Momentum that the particles gave to the lower and upper wall of each axis; 0 on periodic axes.
    wall_radius_impulses : (d, 2) float64 array
        The same, each hit times the particle's radius.
    """

    time: float
    collisions: int
    wall_collisions: int
    virial: Floats
    kinetic: Floats
    wall_impulses: Floats
    wall_radius_impulses: Floats

    def __repr__(self) -> str:
        """Return how much was counted, and the traces and sums of it."""
        return (
            f"<Tallies of a time of {self.time:.6g}: {self.collisions} collisions, {self.wall_collisions} with walls, "
            f"virial {np.trace(self.virial):.6g}, kinetic {np.trace(self.kinetic):.6g}>"
        )


@dataclass(frozen=True)
class Frame:
    """The gas at one moment. The arrays in a frame of a simulation are read-only.

    Attributes
    ----------
    time : float
        Simulated time.
    collisions : int
        Pair collisions since the simulation was made.
    collisions_per_particle : float
        s = 2 collisions / N.
    positions : (N, d) float64 array
        Positions, on periodic axes within [0, L).
    velocities : (N, d) float64 array
        Velocities.
    scene : Scene
        Where the simulation started: radii, masses, box, boundary.
    unwound : pair of (N, d) arrays, optional
        What `unwrapped_positions` is made of when it is asked for: positions not returned to the box since the last epoch,
        and how often they were before. None in a frame that no simulation made.
    counted : Tallies and float, optional
        What `tallies` are made of when they are asked for: without, and of how long, what the present velocities add.
    free_paths : FreePaths, optional
        As `tallies`, of free flights, where the simulation tallies them. Otherwise None.
    """

    time: float
    collisions: int
    collisions_per_particle: float
    positions: Floats
    velocities: Floats
    scene: Scene
    unwound: tuple[Floats, NDArray[np.integer[Any]]] | None = field(default=None, repr=False)
    counted: tuple[Tallies, float] | None = field(default=None, repr=False)
    free_paths: FreePaths | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Return when it is, and of what."""
        return (
            f"<Frame of {self.scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle)>"
        )

    @property
    def tallies(self) -> Tallies | None:
        """What was counted since the start of the simulation, whatever `Simulation.reset_tallies` did.

        The difference of two frames is what was counted between them, to a rounding of the whole. None in a frame
        that no simulation made.
        """
        if self.counted is None:
            return None
        by_events, passed = self.counted
        now = momentum_flux(self.velocities, self.scene.masses) * passed
        return replace(by_events, kinetic=read_only(by_events.kinetic + now))

    @property
    def unwrapped_positions(self) -> Floats:
        """Positions followed through the periodic boundaries from the start, shape (N, d).

        Raises
        ------
        SimulationError
            In a frame that no simulation made, such as one that was read from a file.
        """
        if self.unwound is None:
            raise SimulationError(
                "no simulation made this frame, so nobody knows how often its particles went round the box"
            )
        flown, turns = self.unwound
        unwrapped: Floats = read_only(flown + turns * self.scene.box)
        return unwrapped


class Simulation:
    """The event-driven dynamics of a scene.

    Every collision is found and executed in its order; between collisions particles fly freely, exactly. The same scene gives
    the same bits on every IEEE-754 machine, and nothing that looks at the simulation changes it. The method is told in
    `hardspheres.kernel`.

    `pickle` and `copy` give an independent simulation that goes on with the same bits. Arrays that it shows are read-only.

    One thread at a time has it. While it runs, another one (or its own log function) may ask for `collisions`, `wall_collisions`
    and `collisions_per_particle`, which are counted up to then; everything else is refused at once, as it could be of two moments.

    Parameters
    ----------
    scene : Scene
        Where to start. It stays as it is.
    free_paths : bool, default False
        Tally every free flight, see `free_paths`; costs some 10 % of speed.
    log : callable or path, optional
        Where every event goes, see `hardspheres.event_log.event_dtype`: a function that takes chunks (structured arrays, in
        the order of execution), or the path of a ``.npy`` file, replaced if it is there. Events are handed over 8192 at a
        time, and the rest when `run` returns or a frame is due; there is nothing to close. A log tallies free flights too. A
        simulation with a path has no copies; a function goes along (pickled, or copied, as Python does that).
    search : str, default "auto"
        How collision partners are found: "lists" (neighbour lists, for dense gases), "windows" (windows of time, for dilute
        ones), or "auto", the faster of the two. All give the same bits; `status` tells which one is used. A copy searches
        in the same way.

    Raises
    ------
    SimulationError
        If free paths are asked for and there are more than 32 species, or the log cannot be written; if windows are asked for
        and impossible: no particle moves, one is more than 50 times as fast as a typical one, or the box is too small; from
        every method, if the simulation is at work already.

    Examples
    --------
    >>> import hardspheres as hs
    >>> sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.1, seed=1))
    >>> sim.run(collisions=1000)
    >>> sim.collisions
    1000
    """

    _timed = (0, 0.0)  # collisions in this process, and seconds that they took

    def __init__(
        self,
        scene: Scene,
        *,
        free_paths: bool = False,
        log: Callable[[NDArray[np.void]], object] | str | PathLike[str] | None = None,
        search: str = "auto",
    ) -> None:
        if not isinstance(scene, Scene):
            raise SimulationError(f"a simulation starts from a Scene, not from {scene!r:.60}")
        if not isinstance(free_paths, (bool, np.bool_)):
            raise SimulationError(f"free_paths is {free_paths!r}; it must be True or False")
        if not isinstance(search, str) or search not in SEARCHES:
            raise SimulationError(f'search is {search!r}; it must be "auto", "lists" or "windows"')
        kinds = int(scene.species.max()) + 1
        if free_paths and kinds > MOST_SPECIES:
            raise SimulationError(
                f"free_paths=True tells up to {MOST_SPECIES} species apart, and this scene has {kinds}; leave it out, and use "
                "log=... for the path of each flight"
            )
        self._lock = threading.Lock()  # of the one that runs it
        self._runs = 0  # how often that has begun
        self._scene = scene
        self._search = search
        logs = log is not None
        self._engine = Engine(scene, flights=free_paths or logs, logs=logs, search=search)
        if logs:  # after all that may be refused: it begins its file anew
            self._engine.sink = sink_of(log, scene.dim)
        self._at = self._engine.layout
        self._budget = 2000 + scene.n
        self._energy = scene.kinetic_energy
        most = max(ROWS_BETWEEN_LOOKS / scene.n, 1)
        self._stride = int(power_of_two_below(min(most, MOST_BETWEEN_LOOKS)))  # epochs between two looks
        self._moving = False  # whether somebody is known to move relative to another

    @property
    def scene(self) -> Scene:
        """Where it started."""
        return self._scene

    # Running.

    def _alone(self, work: Callable[[], Any]) -> Any:
        """Do work that changes the simulation, unless another call is at it: then refuse at once."""
        runs = self._runs
        if not self._lock.locked():
            with self._lock:  # taken and given back in C: no interrupt comes in between
                if self._runs == runs:
                    self._runs += 1
                    return work()
        raise SimulationError(RUNNING)

    def run(self, *, time: float | None = None, collisions: int | None = None) -> None:
        """Advance by a time or by a number of pair collisions.

        Control returns to Python about every 0.1 s, so that Ctrl-C works; the simulation is then at the last event that it
        executed, and can go on.

        Parameters
        ----------
        time : float, optional
            How long, >= 0.
        collisions : int, optional
            How many pair collisions, >= 0; the time is then that of the last one.

        Raises
        ------
        SimulationError
            When no collision is to come; when there was none for 1000 times as long as one takes at the present speeds (which the
            rows alone decide); when time stands still for 1000 N events; when the arguments make no sense; when it runs already.
        """
        self._alone(partial(self._run, time, collisions))

    def _run(self, time: float | None, collisions: int | None) -> None:
        if (time is None) == (collisions is None):
            raise SimulationError("run needs either time=... or collisions=..., and not both")
        self._engine.keep_clock()  # an interrupt may have come before the last run could do that
        if time is not None:
            duration = _number("run(time=...)", time)
            if duration < 0:
                raise SimulationError(f"run(time={time}) must be a time of at least 0")
            epoch, moment = self._engine.now
            self._run_until(*self._later(epoch, moment + duration))
        elif collisions is not None:
            self._run_collisions(self.collisions + _whole("run(collisions=...)", collisions))

    def _later(self, epoch: int, moment: float) -> tuple[int, float]:
        """Bring the time within an epoch into its range."""
        length = self._engine.length
        later = carried(epoch, moment, length)
        if later[0] >= FOREVER:
            raise SimulationError(
                f"a time of {epoch * length + moment:.3g} is more than can be counted; {FOREVER * length:.3g} is"
            )
        return later

    def _slice(self, epoch: int, moment: float, pairs: int) -> bool:
        """Run for about SLICE seconds; True when the goal is reached."""
        ready = getattr(self._engine.kernels.run, "signatures", True)  # else it is loaded or compiled first
        budget, before = self._budget, self.collisions
        began = time.perf_counter()
        reached = self._engine.run(epoch, moment, pairs, budget)
        took = time.perf_counter() - began
        if ready:
            self._timed = (self._timed[0] + self.collisions - before, self._timed[1] + took)
        if self._engine.paused:
            self._budget = int(budget * min(max(SLICE / max(took, 1e-6), 0.5), 2.0)) + 1
        return reached

    def _run_until(self, epoch: int, moment: float) -> None:
        if self._energy == 0.0:  # nobody moves: there is no need to pass through empty epochs
            self._engine.arrays.counter[self._at.EPOCH] = epoch
        try:
            while True:
                before = self._engine.length
                self._engine = self._engine.in_pace()
                epoch, moment = self._later(*recounted(epoch, moment, before, self._engine.length))
                if self._slice(epoch, moment, FOREVER):
                    break
        except BaseException:
            self._engine.keep_clock()
            raise
        else:
            self._engine.now = epoch, moment
        finally:
            self._engine.hand_over_log()

    def _run_collisions(self, goal: int) -> None:
        if goal > self.collisions:
            self._require_something_to_come()
        look = 0  # the epoch at whose beginning it looks next whether there are collisions at all
        try:
            while True:
                before = self._engine
                self._engine = before.in_pace()
                if self._engine is not before:
                    look = 0
                look = max(look, self._next_look())
                if self._slice(look, 0.0, goal):
                    if self.collisions >= goal:
                        break
                    self._require_meetings()
                    look += self._stride
        finally:
            self._engine.keep_clock()
            self._engine.hand_over_log()

    def _next_look(self) -> int:
        """First multiple of the stride among the epochs to come at which too long may have passed without a collision."""
        at, arrays = self._at, self._engine.arrays
        begun = int(arrays.number[at.NOW] > 0.0)
        epoch = max(
            int(arrays.counter[at.EPOCH]) + begun, int(arrays.counter[at.LAST_PAIR_EPOCH]) + LEAST_PATIENCE
        )
        return -(-epoch // self._stride) * self._stride

    def _require_meetings(self) -> None:
        """Raise SimulationError at the beginning of an epoch if no pair has collided for far longer than expected.

        Speeds stay until the next collision of two, so only the rows decide, wherever a run began, stopped or was loaded.
        """
        at, count = self._at, self._engine.arrays.counter
        idle = int(count[at.EPOCH]) - int(count[at.LAST_PAIR_EPOCH])
        if idle < LEAST_PATIENCE:
            return
        v = self._rows[:, at.V : at.V + self.scene.dim]
        if idle * self._engine.length * collision_rate(self.scene, v) > PATIENCE:
            raise SimulationError(
                f"no two particles met for {idle * self._engine.length:.3g} time units, over {PATIENCE:.0f} times the expected "
                "time to a collision; these particles may never meet: use run(time=...)"
            )

    def _require_something_to_come(self) -> None:
        """Raise SimulationError where it is certain that no two particles will ever meet.

        Collisions and walls keep the energy of relative motion, so who moves now will always do.
        """
        if self._moving:
            return
        periodic = self.scene.periodic
        if self.scene.n == 1:
            raise SimulationError("no collision is to come: there is one particle only; use run(time=...)")
        v = self._rows[:, self._at.V : self._at.V + self.scene.dim]
        if not np.any(np.where(periodic, v - v[0], v)):
            raise SimulationError(
                "no collision is to come: no particle moves relative to another; give them velocities, or use run(time=...)"
            )
        self._moving = True

    def frames(
        self,
        *,
        every: float | None = None,
        count: int | None = None,
        times: Iterable[float] | None = None,
        collisions_per_particle: Iterable[float] | None = None,
    ) -> Iterator[Frame]:
        """Run, and yield the gas at chosen moments.

        Moments are counted as they come: any number takes no memory. A sequence is checked here; what an iterator gives, when it
        is due.

        Parameters
        ----------
        every, count : float and int, optional
            `count` frames, `every` apart in time, the first one now.
        times : iterable of float, optional
            At these times, ascending, none before now.
        collisions_per_particle : iterable of float, optional
            Right after the collision that makes s = 2 collisions / N reach each of these values, ascending; 0 is the start.

        Yields
        ------
        Frame
            Looking does not change the dynamics: any set of frames gives the same trajectory.

        Raises
        ------
        SimulationError
            When the arguments make no sense, and as `run` does.
        """
        given = [
            every is not None or count is not None,
            times is not None,
            collisions_per_particle is not None,
        ]
        if sum(given) != 1:
            raise SimulationError(
                "frames needs one of: every=... with count=..., times=..., collisions_per_particle=..."
            )
        if times is not None:
            return self._frames_at(self._ascending("times", times, self.time))
        if collisions_per_particle is not None:
            s = self._ascending(
                "collisions_per_particle", collisions_per_particle, self.collisions_per_particle, self._goal
            )
            return self._frames_after(s)
        if every is None or count is None:
            raise SimulationError("frames(every=..., count=...) needs both: how far apart, and how many")
        step, number = _number("frames(every=...)", every), _whole("frames(count=...)", count)
        if step <= 0:
            raise SimulationError(f"frames(every={every}) must be a time above 0")
        now = self.time
        return self._frames_at(now + k * step for k in range(number))

    def _goal(self, collisions_per_particle: float) -> int:
        """Pair collisions after which each particle has had so many."""
        goal = math.ceil(collisions_per_particle * self.scene.n / 2 - 1e-9)
        return _whole("the number of collisions of a frame", goal)

    def _ascending(
        self, name: str, values: Iterable[float], first: float, goal: Callable[[float], Any] = float
    ) -> Iterable[Any]:
        """Return goals at ascending numbers, none before the first, as they are wanted; those of a sequence are checked now."""
        try:
            if isinstance(values, (str, bytes, bytearray)):
                raise TypeError
            given = iter(values)
        except TypeError:
            raise SimulationError(f"frames({name}=...) needs a sequence of numbers, not {values!r}") from None
        if given is values:  # an iterator, which gives each of them once
            return map(goal, _checked(name, given, first))
        if isinstance(values, range):
            for number in _checked(name, iter([*values[:2], *values[-1:]]), first):
                goal(number)
            return map(goal, values)
        return list(map(goal, _checked(name, given, first)))

    def _frames_at(self, times: Iterable[float]) -> Iterator[Frame]:
        for t in times:
            self._alone(partial(self._reach, t))
            yield self.frame()

    def _reach(self, t: float) -> None:
        target = self._later(0, t)
        if target > self._engine.now:
            self._run_until(*target)

    def _frames_after(self, collisions: Iterable[int]) -> Iterator[Frame]:
        for goal in collisions:
            if goal > self.collisions:
                self._alone(partial(self._run_collisions, goal))
            yield self.frame()

    @at_rest
    def frame(self) -> Frame:
        """Return the gas as it is now."""
        flown = self._flown()
        return Frame(
            self._time,
            self.collisions,
            self.collisions_per_particle,
            read_only(returned_to_box(flown, self.scene.box, self.scene.periodic)),
            self.velocities,
            self.scene,
            (read_only(flown), read_only(self._turns.copy())),
            (
                self._tallies(self._engine.tallied_by_events() + self._engine.earlier, self._time, 0, 0),
                self._engine.passed,
            ),
            self._flights(from_start=True) if self._tells_flights else None,
        )

    # Looking.

    @property
    @at_rest
    def time(self) -> float:
        """Simulated time since the start."""
        return self._time

    @property
    def _time(self) -> float:
        epoch, moment = self._engine.now
        return epoch * self._engine.length + moment

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""
        return int(self._engine.arrays.counter[self._at.PAIRS])

    @property
    def wall_collisions(self) -> int:
        """Hits of walls since the start."""
        return int(self._engine.arrays.counter[self._at.WALL_HITS])

    @property
    def collisions_per_particle(self) -> float:
        """Collisions per particle s = 2 collisions / N: each counts for both partners."""
        return 2 * self.collisions / self.scene.n

    @property
    def _rows(self) -> Floats:
        rows: Floats = self._engine.rows
        return rows

    def _flown(self) -> Floats:
        """Positions now, as the rows count them: up to an epoch's flight out of the box on periodic axes."""
        at, dim = self._at, self.scene.dim
        rows = self._rows
        epoch, moment = self._engine.now
        behind = epoch - int(self._engine.arrays.counter[at.EPOCH])
        dt = (behind * self._engine.length + moment) - rows[:, at.T]
        flown: Floats = rows[:, at.X : at.X + dim] + rows[:, at.V : at.V + dim] * dt[:, None]
        return flown

    @property
    @at_rest
    def positions(self) -> Floats:
        """Positions now, shape (N, d), on periodic axes within [0, L). A copy, read-only."""
        positions: Floats = read_only(returned_to_box(self._flown(), self.scene.box, self.scene.periodic))
        return positions

    @property
    @at_rest
    def unwrapped_positions(self) -> Floats:
        """Positions now, followed through the periodic boundaries from the start, shape (N, d). A copy, read-only."""
        unwrapped: Floats = read_only(self._flown() + self._turns * self.scene.box)
        return unwrapped

    @property
    def _turns(self) -> NDArray[np.integer[Any]]:
        counts: NDArray[np.integer[Any]] = self._engine.arrays.image_counts
        return counts.reshape(self.scene.n, self.scene.dim)

    @property
    @at_rest
    def velocities(self) -> Floats:
        """Velocities now, shape (N, d). A copy, read-only."""
        v: Floats = read_only(self._rows[:, self._at.V : self._at.V + self.scene.dim].copy())
        return v

    @property
    @at_rest
    def momentum(self) -> Floats:
        """Total momentum, shape (d,). Read-only."""
        return total_momentum(self.velocities, self.scene.masses)

    @property
    @at_rest
    def thermal_energy(self) -> float:
        """Kinetic energy less that of the common motion along periodic axes."""
        return thermal_energy(self.velocities, self.scene.masses, self.scene.periodic)

    @property
    @at_rest
    def temperature(self) -> float:
        """Temperature kT = 2 thermal_energy / degrees_of_freedom, in units of energy."""
        return 2 * self.thermal_energy / self.scene.degrees_of_freedom

    @at_rest
    def to_scene(self) -> Scene:
        """Return the gas as it is now as a Scene, contacts as the engine left them."""
        return self.scene.with_state(self.positions, self.velocities)

    @at_rest
    def to_atoms(self, units: str | None = None) -> Any:
        """Return the gas as it is now as an ASE Atoms object; see `hardspheres.files.to_atoms`."""
        from hardspheres.files import to_atoms

        return to_atoms(self.frame(), units)

    # Stopping and going on.

    def save(self, path: str | PathLike[str]) -> None:
        """Write a checkpoint, from which `load` goes on to the last bit.

        Parameters
        ----------
        path : path
            The file. It is replaced whole once the new one is safely on disk, so a crash leaves the old one or the new one.

        Raises
        ------
        CheckpointError
            When the file cannot be written; an older one is then as it was.
        """
        from hardspheres.checkpoint import save

        self._alone(partial(save, self, path))

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        log: Callable[[NDArray[np.void]], object] | str | PathLike[str] | None = None,
        search: str = "auto",
    ) -> "Simulation":
        """Return the simulation in a checkpoint: running on from it gives what running on would have given, bit for bit.

        Parameters
        ----------
        path : path
            A file written by `save`. Nothing in it is executed.
        log : callable or path, optional
            Takes the events from now on (a new file); only where the simulation that was saved had a log or `free_paths`.
        search : str, default "auto"
            As of `Simulation`. A checkpoint does not store it: any search goes on with the same bits.

        Returns
        -------
        Simulation
            With the scene, clock, tallies and counters of the one that was saved.

        Raises
        ------
        CheckpointError
            When the file is missing, torn, altered, of another format version, or holds what no simulation leaves.
        SimulationError
            When `log` or `search` cannot be used, as of `Simulation`.
        """
        from hardspheres.checkpoint import load

        return load(cls, path, log, search)

    def __copy__(self) -> "Simulation":
        return self._duplicate(lambda part: part)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Simulation":
        return self._duplicate(lambda part: copy.deepcopy(part, memo))

    def _duplicate(self, copied: Callable[[Any], Any]) -> "Simulation":
        make, parts = self.__reduce__(copied)
        duplicate: Simulation = make(*parts)
        return duplicate

    def __reduce__(self, copied: Callable[[Any], Any] = lambda part: part) -> tuple[Any, ...]:
        from hardspheres.checkpoint import restored, to_arrays

        def parts() -> tuple[Any, ...]:
            arrays = {name: array.copy() for name, array in to_arrays(self).items()}
            return type(self), copied(self.scene), arrays, copied(self._log()), self._search

        return restored, self._alone(parts)

    def _log(self) -> Sink | None:
        """Return the function that a copy would log to."""
        sink = self._engine.sink
        if isinstance(sink, NpyStream):
            raise SimulationError(
                f"two simulations cannot write one log, and this one writes {sink.path}; save it, and load it with another log=..."
            )
        return sink

    # Tallies.

    def reset_tallies(self) -> None:
        """Begin `tallies` and what is made of them anew; time, collisions, dynamics and the frames' tallies go on."""
        self._alone(lambda: self._engine.reset_tallies())  # the engine as it is once no other thread runs it

    @property
    @at_rest
    def tallies(self) -> Tallies:
        """What was counted since `reset_tallies`. `Frame.tallies` has what was counted from the start."""
        engine = self._engine
        return self._tallies(engine.tallied(), engine.passed, *engine.since[2:])

    def _tallies(self, sums: Floats, time: float, collisions: int, wall_collisions: int) -> Tallies:
        """Return a row of sums by name, of this time, counted from so many collisions on."""
        dim, sums = self.scene.dim, read_only(sums)
        tensors, walls = sums[: 2 * dim * dim].reshape(2, dim, dim), sums[2 * dim * dim :].reshape(2, dim, 2)
        collisions, wall_collisions = self.collisions - collisions, self.wall_collisions - wall_collisions
        return Tallies(time, collisions, wall_collisions, *tensors, *walls)

    @property
    @at_rest
    def free_paths(self) -> FreePaths:
        """What was tallied of the free flights since `reset_tallies`; needs ``Simulation(scene, free_paths=True)``.

        Raises
        ------
        SimulationError
            If they are not tallied.
        """
        if self._engine.flights is None:
            raise SimulationError(
                "free paths are not tallied; construct with Simulation(scene, free_paths=True)"
            )
        if not self._tells_flights:
            raise SimulationError(
                f"free paths are tallied for up to {MOST_SPECIES} species only; read them from the log"
            )
        return self._flights()

    @property
    def _tells_flights(self) -> bool:
        """Whether flights are tallied, and by species."""
        return self._engine.flights is not None and int(self.scene.species.max()) < MOST_SPECIES

    def _flights(self, from_start: bool = False) -> FreePaths:
        engine = self._engine
        passed = self._time if from_start else engine.passed
        return engine.flights.read(engine.arrays, engine.now, passed, from_start)  # type: ignore[union-attr]

    @property
    @at_rest
    def pressure_tensor(self) -> Floats:
        """Mean pressure tensor since `reset_tallies`, shape (d, d): (kinetic + virial) / (time V). Read-only.

        The common motion along periodic axes is left out. Source: the virial of impulses, see `compressibility_factor`.
        Between walls it is the mean over the box, layers at the walls with all else, and the volume V is that of the box,
        part of which no centre can reach: in narrow boxes far less than what a wall feels. That is `wall_pressure`.
        """
        t = self._tallied()
        p = (
            np.where(self.scene.periodic, self.momentum, 0.0)
            if self.scene.n > 1
            else np.zeros(self.scene.dim)
        )
        drift = np.outer(p / float(np.sum(self.scene.masses)), p)
        result: Floats = read_only(((t.kinetic + t.virial) / t.time - drift) / self.scene.volume)
        return result

    @property
    @at_rest
    def compressibility_factor(self) -> float:
        """Compressibility factor Z = P V / (2 K_th / d) = 1 + W / (2 K_th) since `reset_tallies`.

        W is the virial rate, the sum of r.dp over pair collisions per time; exact for any finite run in a periodic box
        (Alder and Wainwright 1960, doi:10.1063/1.1731425). With two or more particles K_th leaves out the common motion.
        Between walls it is a mean over the box, whose volume V counts the half diameter at each wall that no centre can
        reach; what the walls feel is `wall_pressure`.
        """
        t = self._tallied()
        return 1.0 + float(np.trace(t.virial)) / (t.time * 2.0 * self.thermal_energy)

    @property
    @at_rest
    def wall_pressure(self) -> Floats:
        """Mean pressure on the lower and upper wall of each axis since `reset_tallies`, (d, 2); NaN on periodic axes. Read-only.

        Force over area: momentum given to the wall per time, over the part of it that centres can reach, the product of L
        - 2R along the other wall axes and L along periodic ones, R the mean radius. By the contact theorem kT times the mean
        density of centres at the wall, at any density. For one diameter sigma its mean over both walls and `pressure_tensor`
        are tied by Clausius' virial theorem, P_kk V = (L_k - sigma) F_k, but for what the run's two ends differ by.

        Raises
        ------
        SimulationError
            Before anything was run.
        """
        t, periodic = self._tallied(), self.scene.periodic
        reach = np.where(periodic, self.scene.box, self.scene.box - 2.0 * float(np.mean(self.scene.radii)))
        areas = np.array([math.prod(np.delete(reach, axis).tolist()) for axis in range(self.scene.dim)])
        forces = np.where(periodic, np.nan, 1.0)[:, None] * t.wall_impulses / t.time
        pressure: Floats = read_only(forces / areas[:, None])
        return pressure

    def _tallied(self) -> Tallies:
        t = self.tallies
        if t.time <= 0 or self.thermal_energy == 0:
            raise SimulationError(
                "no pressure yet: run the simulation for some time first, with particles that move"
            )
        return t

    # Trust.

    @property
    @at_rest
    def energy_drift(self) -> float:
        """Relative change of kinetic energy since the start; 0 for a gas at rest."""
        energy = kinetic_energy(self.velocities, self.scene.masses)
        return (energy - self._energy) / self._energy if self._energy > 0 else energy

    @property
    @at_rest
    def momentum_drift(self) -> Floats:
        """Change of momentum since the start less the walls' impulses, over sum m |v|, shape (d,). Read-only."""
        given = self._engine.arrays.total[self._at.LEDGER : self._at.LEDGER + self.scene.dim]
        change = self.momentum - self.scene.momentum + given
        scale = float(np.sum(self.scene.masses * np.linalg.norm(self.velocities, axis=1)))
        drift: Floats = read_only(change / scale if scale > 0 else change)
        return drift

    @property
    @at_rest
    def worst_overlap(self) -> float:
        """Depth of the deepest overlap now, between particles or with a wall, in contact distances (diameters)."""
        from hardspheres.cells import worst_overlap

        positions, radii, scene = self.positions, self.scene.radii, self.scene
        i, j, depth = worst_overlap(positions, radii, scene.box, scene.periodic)
        deepest = depth / float(radii[i] + radii[j]) if depth > 0 else 0.0
        walls = ~scene.periodic
        if walls.any():
            beyond = np.maximum(radii[:, None] - positions, positions + radii[:, None] - scene.box)[:, walls]
            deepest = max(deepest, float(np.max(beyond / (2.0 * radii[:, None]))))
        return deepest

    @at_rest
    def check(self) -> None:
        """Verify everything that must hold at any moment; changes nothing.

        Energy and momentum, overlaps, clocks and counters; that each neighbour list names all within reach; and, up to 512
        particles, that every pending event is what the rows say, and that none is missing, by looking at all pairs.

        Raises
        ------
        InvariantError
            When energy or momentum has changed by more than rounding explains (relative; of sum m |v|): 1e-12, or 12 eps / (d N)
            for each collision where that is more (many collisions of few particles; why: `invariants.allowed_drift`); when a pair or
            wall overlaps by more than 1e-11 diameters (or rounding of coordinates, in a box of over 1e4 diameters); when an
            event is wrong, or not where the engine looks for it.
        """
        from hardspheres.invariants import verify

        verify(self, self._engine)

    @at_rest
    def status(self) -> dict[str, Any]:
        """Return where the simulation is, how it searches, and how exact and fast it has been.

        "collisions_per_second" is of the event loop alone in this process; NaN before anything was timed.
        """
        from hardspheres import __version__

        at, count, number = self._at, self._engine.arrays.counter, self._engine.arrays.number
        dim = self.scene.dim
        return {
            "version": __version__,
            "particles": self.scene.n,
            "dimension": dim,
            "packing_fraction": self.scene.packing_fraction,
            "boundary": list(self.scene.boundary),
            "time": self._time,
            "collisions": self.collisions,
            "collisions_per_particle": self.collisions_per_particle,
            "wall_collisions": self.wall_collisions,
            "temperature": self.temperature,
            "energy_drift": self.energy_drift,
            "momentum_drift": float(np.max(np.abs(self.momentum_drift))),
            "late_events": int(count[at.OUT_OF_ORDER]),
            "stale_events": int(count[at.STALE]),
            "method": self._engine.search.method,
            "cell_size": (1.0 / number[at.CELL_DENSITY : at.CELL_DENSITY + dim]).tolist(),
            "shell": float(number[at.DISPLACEMENT_THRESHOLD]),
            "window": 2.0 * float(number[at.HALF_WINDOW]),
            "pairs_compared": self._engine.search.pairs_compared,
            "list_renewals": int(count[at.REBUILDS]),
            "epoch_length": self._engine.length,
            "bytes_per_particle": self._engine.bytes / self.scene.n,
            "collisions_per_second": self._timed[0] / self._timed[1] if self._timed[0] else math.nan,
        }

    def __repr__(self) -> str:
        scene = self.scene
        return (
            f"<Simulation of {scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle), energy drift {self.energy_drift:.1e}>"
        )
