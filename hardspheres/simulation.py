"""Simulation: a scene in motion. Runs it, shows it, tallies it; looking never changes it."""

import copy
import math
import warnings
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hardspheres import __version__, atoms, checkpoint, invariants
from hardspheres.archive import Arrays, read_archive, write_archive
from hardspheres.arguments import ascending, finite, whole
from hardspheres.checks import inertia
from hardspheres.clock import FOREVER, carried, recounted
from hardspheres.engine import ALONE, Engine, How
from hardspheres.errors import CheckpointError, SimulationError
from hardspheres.event_log import NpyStream, Sink, sink_of
from hardspheres.exclusive import Exclusive, at_rest
from hardspheres.frame import Frame, Tallies
from hardspheres.free_paths import MOST_SPECIES, FreePaths
from hardspheres.patience import Patience
from hardspheres.scene import (
    Scene,
    kinetic_energy,
    potential_energy,
    read_only,
    returned_to_box,
    squared_lengths,
    squares_at_floor,
    thermal_energy,
    total_momentum,
)
from hardspheres.slices import Slices
from hardspheres.tuning import SEARCHES

__all__ = ["Frame", "Simulation", "Tallies"]

Floats = NDArray[np.float64]
CURVED = (
    "free paths are tallied along straight flights, and under gravity none is straight; leave free_paths out "
    "(log=... has the time of each event)"
)
# Of status, with several threads: windows that stand, those undone before, events put off to a later round.
OF_THREADS = {"windows": "WINDOWS", "windows_undone": "REDONE", "events_put_off": "LEFT_OVER"}
Log = Callable[[NDArray[np.void]], object] | str | PathLike[str]


class Simulation(Exclusive):
    """The event-driven dynamics of a scene.

    Every collision is found and executed in its order; between collisions particles fly freely, exactly. The
    same scene gives the same bits on every IEEE-754 machine, and nothing that looks at the simulation changes
    it. The method is told in `hardspheres.kernel`.

    `pickle` and `copy` give an independent simulation that goes on with the same bits. Arrays that it shows
    are read-only.

    One thread at a time has it. While it runs, another one (or its own log function) may ask for
    `collisions`, `wall_collisions` and `collisions_per_particle`, which are counted up to then; everything
    else is refused at once, as it could be of two moments.

    Parameters
    ----------
    scene : Scene
        Where to start. It stays as it is.
    free_paths : bool, default False
        Tally every free flight, see `free_paths`; costs some 10 % of speed.
    log : callable or path, optional
        Where every event goes, see `hardspheres.event_log.event_dtype`: a function that takes chunks
        (structured arrays, in the order of execution), or the path of a ``.npy`` file, replaced if it is
        there. Events are handed over 8192 at a time, and the rest when `run` returns or a frame is due; there
        is nothing to close. A log tallies free flights too. A simulation with a path has no copies; a
        function goes along (pickled, or copied, as Python does that).
    heat : bool, default False
        Tally the heat flux too: `Tallies.heat_transfer` and `Tallies.heat_flux`.
    search : str, default "auto"
        How collision partners are found: "lists" (neighbour lists, for dense gases), "windows" (windows of
        time, for dilute ones), or "auto", the faster of the two. All give the same bits; `status` tells which
        one is used. A copy searches in the same way.
    threads : int, default 1
        Threads that run this one gas together, with the bits of one; never more than there are idle cores.
        They pay from some 20 000 particles on. A gas that they cannot share says why, in a warning, and runs
        on fewer: a small one, or one with a few large particles among many small ones. A log's chunks are
        then of any size. In an ensemble leave it at 1, and run the replicas side by side.

    Raises
    ------
    SimulationError
        If free paths are asked for and there are more than 32 species, or gravity; if the heat flux is asked
        for and there are gravity or obstacles; if the log cannot be written; if windows are asked for and
        impossible: no particle moves, one is more than 50 times as fast as a typical one, or the box is too
        small; from every method, if the simulation is at work already.

    Examples
    --------
    >>> import hardspheres as hs
    >>> sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.1, seed=1))
    >>> sim.run(collisions=1000)
    >>> sim.collisions
    1000
    """

    def __init__(
        self,
        scene: Scene,
        *,
        free_paths: bool = False,
        heat: bool = False,
        log: Log | None = None,
        search: str = "auto",
        threads: int = 1,
    ) -> None:
        if not isinstance(scene, Scene):
            raise SimulationError(f"a simulation starts from a Scene, not from {scene!r:.60}")
        if not isinstance(free_paths, (bool, np.bool_)):
            raise SimulationError(f"free_paths is {free_paths!r}; it must be True or False")
        if not isinstance(heat, (bool, np.bool_)):
            raise SimulationError(f"heat is {heat!r}; it must be True or False")
        _require_search(search)
        kinds = int(scene.species.max()) + 1
        if free_paths and scene.falls:
            raise SimulationError(CURVED)
        if heat and scene.falls:
            raise SimulationError(
                "the heat flux is tallied where velocities change in collisions alone, and under gravity "
                "they change all the time; leave heat out"
            )
        if heat and scene.n_moving < scene.n:
            raise SimulationError(
                "the heat flux is tallied where collisions pass energy on, and an obstacle takes none; "
                "leave heat out"
            )
        if free_paths and kinds > MOST_SPECIES:
            raise SimulationError(
                f"free_paths=True tells up to {MOST_SPECIES} species apart, and this scene has {kinds}; "
                "leave it out, and use log=... for the path of each flight"
            )
        logs = log is not None
        how = How(search, _required_threads(threads))
        engine = Engine(scene, flights=free_paths or logs, logs=logs, how=how, heat=bool(heat))
        self._take(engine, log)

    def _take(self, engine: Engine, log: Log | None, warn: bool = True) -> None:
        """Run this engine from now on."""
        super().__init__()
        self._engine, self._at = engine, engine.layout
        if engine.shortfall and warn:
            warnings.warn(engine.shortfall, stacklevel=4)
        self._energy = engine.scene.kinetic_energy + engine.scene.potential_energy
        self._slices, self._patience = Slices(engine.scene.n), Patience(engine.scene)
        if log is not None:  # after all that may be refused: it begins its file anew
            engine.sink = sink_of(log, engine.scene.dim)

    @classmethod
    def _of(cls, engine: Engine, log: Log | None, warn: bool = True) -> Self:
        simulation = cls.__new__(cls)
        simulation._take(engine, log, warn)
        return simulation

    @property
    def scene(self) -> Scene:
        """Where it started."""
        return self._engine.scene

    # Running.

    def run(self, *, time: float | None = None, collisions: int | None = None) -> None:
        """Advance by a time or by a number of pair collisions.

        Control returns to Python about every 0.1 s, so that Ctrl-C works; the simulation is then at the last
        event that it executed, and can go on.

        Parameters
        ----------
        time : float, optional
            How long, >= 0.
        collisions : int, optional
            How many pair collisions, >= 0; the time is then that of the last one.

        Raises
        ------
        SimulationError
            When no collision is to come; when there was none for 1000 times as long as one takes at the
            present speeds (which the rows alone decide); when time stands still for 1000 N events; when the
            arguments make no sense; when it runs already.
        """
        self._alone(partial(self._run, time, collisions))

    def _run(self, time: float | None, collisions: int | None) -> None:
        if (time is None) == (collisions is None):
            raise SimulationError("run needs either time=... or collisions=..., and not both")
        self._engine.keep_clock()  # an interrupt may have come before the last run could do that
        if time is not None:
            duration = finite("run(time=...)", time)
            if duration < 0:
                raise SimulationError(f"run(time={time}) must be a time of at least 0")
            epoch, moment = self._engine.now
            self._run_until(*self._later(epoch, moment + duration))
        elif collisions is not None:
            self._run_collisions(self.collisions + whole("run(collisions=...)", collisions))

    def _later(self, epoch: int, moment: float) -> tuple[int, float]:
        """Bring the time within an epoch into its range."""
        length = self._engine.length
        later = carried(epoch, moment, length)
        if later[0] >= FOREVER:
            raise SimulationError(
                f"a time of {epoch * length + moment:.3g} is more than can be counted; "
                f"{FOREVER * length:.3g} is"
            )
        return later

    def _run_until(self, epoch: int, moment: float) -> None:
        if self._energy == 0.0:  # no particle moves: there is no need to pass through empty epochs
            self._engine.arrays.counter[self._at.EPOCH] = epoch
        try:
            while True:
                before = self._engine.length
                self._engine = self._engine.in_pace()
                epoch, moment = self._later(*recounted(epoch, moment, before, self._engine.length))
                if self._slices.run(self._engine, epoch, moment, FOREVER):
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
            self._patience.require_motion(self._engine)
        check = 0  # the epoch at whose beginning patience is checked next
        try:
            while True:
                before = self._engine
                self._engine = before.in_pace()
                if self._engine is not before:
                    check = 0
                check = max(check, self._patience.next_check(self._engine))
                if self._slices.run(self._engine, check, 0.0, goal):
                    if self.collisions >= goal:
                        break
                    self._patience.check(self._engine)
                    check += self._patience.stride
        finally:
            self._engine.keep_clock()
            self._engine.hand_over_log()

    def frames(
        self,
        *,
        every: float | None = None,
        count: int | None = None,
        times: Iterable[float] | None = None,
        collisions_per_particle: Iterable[float] | None = None,
    ) -> Iterator[Frame]:
        """Run, and yield the gas at chosen moments.

        Moments are counted as they come: any number takes no memory. A sequence is checked here; what an
        iterator gives, when it is due.

        Parameters
        ----------
        every, count : float and int, optional
            `count` frames, `every` apart in time, the first one now.
        times : iterable of float, optional
            At these times, ascending, none before now.
        collisions_per_particle : iterable of float, optional
            Right after the collision that makes s = 2 collisions / N reach each of these values, ascending; 0
            is the start.

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
            return self._frames_at(ascending("times", times, self.time))
        if collisions_per_particle is not None:
            s = ascending(
                "collisions_per_particle", collisions_per_particle, self.collisions_per_particle, self._goal
            )
            return self._frames_after(s)
        if every is None or count is None:
            raise SimulationError("frames(every=..., count=...) needs both: how far apart, and how many")
        step, number = finite("frames(every=...)", every), whole("frames(count=...)", count)
        if step <= 0:
            raise SimulationError(f"frames(every={every}) must be a time above 0")
        now = self.time
        return self._frames_at(now + k * step for k in range(number))

    def _goal(self, collisions_per_particle: float) -> int:
        """Pair collisions after which each particle has had so many; with obstacles, twice as many."""
        share = 2 if self.scene.n_moving == self.scene.n else 1
        goal = math.ceil(collisions_per_particle * self.scene.n_moving / share - 1e-9)
        return whole("the number of collisions of a frame", goal)

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
            if self.scene.n_moving < self.scene.n:
                self._alone(partial(self._run_partners, goal))
            elif goal > self.collisions:
                self._alone(partial(self._run_collisions, goal))
            yield self.frame()

    def _run_partners(self, goal: int) -> None:
        """Run until those that move have had so many collisions in all: two in each, one at an obstacle."""
        while (missing := goal - (2 * self.collisions - self.obstacle_collisions)) > 0:
            self._run_collisions(self.collisions + -(-missing // 2))

    @at_rest
    def frame(self) -> Frame:
        """Return the gas as it is now."""
        scene, engine = self.scene, self._engine
        flown, velocities = map(read_only, engine.flown())
        by_events = self._tallies(engine.tallied_by_events(from_start=True), self._time, 0, 0)
        return Frame(
            self._time,
            self.collisions,
            self.collisions_per_particle,
            read_only(returned_to_box(flown, scene.box, scene.periodic)),
            velocities,
            scene,
            (flown, read_only(self._images.copy()), scene.box),
            (by_events, self._time, velocities, scene.masses),
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
    def threads(self) -> int:
        """Threads that run it."""
        return self._engine.threads

    @property
    def collisions(self) -> int:
        """Pair collisions since the start, those with obstacles included."""
        return int(self._engine.arrays.counter[self._at.PAIRS])

    @property
    def obstacle_collisions(self) -> int:
        """Those of the pair collisions that were with an obstacle, since the start."""
        if self.scene.n_moving == self.scene.n:
            return 0
        return int(self._engine.arrays.counter[self._at.OBSTACLE_HITS])

    @property
    def wall_collisions(self) -> int:
        """Hits of walls since the start."""
        return int(self._engine.arrays.counter[self._at.WALL_HITS])

    @property
    def collisions_per_particle(self) -> float:
        """Collisions per particle s = 2 collisions / N: each counts for both partners.

        Obstacles are no partners, and N leaves them out: the mean number of collisions of those that move.
        """
        return (2 * self.collisions - self.obstacle_collisions) / self.scene.n_moving

    @property
    def _rows(self) -> Floats:
        rows: Floats = self._engine.rows
        return rows

    def _flown(self) -> Floats:
        """Positions now, as the rows count them: up to an epoch's flight out of the box on periodic axes."""
        flown: Floats = self._engine.flown()[0]
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
        """Positions now, followed through the periodic boundaries, shape (N, d). A copy, read-only."""
        unwrapped: Floats = read_only(self._flown() + self._images * self.scene.box)
        return unwrapped

    @property
    def _images(self) -> NDArray[np.integer[Any]]:
        counts: NDArray[np.integer[Any]] = self._engine.arrays.image_counts
        return counts.reshape(self.scene.n, self.scene.dim)

    @property
    @at_rest
    def velocities(self) -> Floats:
        """Velocities now, shape (N, d). A copy, read-only."""
        v: Floats = read_only(self._engine.flown()[1])
        return v

    @property
    @at_rest
    def momentum(self) -> Floats:
        """Total momentum of all but obstacles, shape (d,). Read-only."""
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
        """Return the gas as it is now as an ASE Atoms object; see `hardspheres.atoms.to_atoms`."""
        return atoms.to_atoms(self.frame(), units)

    # Stopping and going on.

    def save(self, path: str | PathLike[str]) -> None:
        """Write a checkpoint, from which `load` goes on to the last bit.

        Parameters
        ----------
        path : path
            The file. It is replaced whole once the new one is safely on disk, so a crash leaves the old one
            or the new one.

        Raises
        ------
        CheckpointError
            When the file cannot be written; an older one is then as it was.
        """
        self._alone(lambda: write_archive(path, self._arrays()))

    def _arrays(self) -> Arrays:
        """Return the arrays of a checkpoint (views)."""
        self._engine.keep_clock()
        self._engine = self._engine.in_pace()
        return checkpoint.to_arrays(self._engine)

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        log: Log | None = None,
        search: str = "auto",
        threads: int = 1,
    ) -> Self:
        """Return the simulation in a checkpoint, which goes on to the same bits as the one that was saved.

        Parameters
        ----------
        path : path
            A file written by `save`. Nothing in it is executed.
        log : callable or path, optional
            Takes the events from now on (a new file); only where the simulation that was saved had a log or
            `free_paths`.
        search : str, default "auto"
            As of `Simulation`. A checkpoint does not store it: any search goes on with the same bits.
        threads : int, default 1
            As of `Simulation`; not stored either.

        Returns
        -------
        Simulation
            With the scene, clock, tallies and counters of the one that was saved.

        Raises
        ------
        CheckpointError
            When the file is missing, torn, altered, of another format version, or holds what no simulation
            leaves.
        SimulationError
            When `log`, `search` or `threads` cannot be used, as of `Simulation`.
        """
        _require_search(search)
        how = How(search, _required_threads(threads))
        arrays = read_archive(path)
        try:
            return cls._from_arrays(arrays, log, how)
        except CheckpointError as error:
            raise CheckpointError(f"{path} cannot be used: {error}") from None

    @classmethod
    def _from_arrays(cls, arrays: Arrays, log: Log | None = None, how: How = ALONE) -> Self:
        """Return the simulation that consists of these arrays; CheckpointError where there is none."""
        return cls._of(checkpoint.from_arrays(arrays, log is not None, how), log)

    @classmethod
    def _restored(cls, scene: Scene, arrays: Arrays, log: Sink | None, how: How) -> Self:
        """Return a copy: arrays are those of another simulation, and need no check."""
        return cls._of(checkpoint.restored(scene, arrays, log is not None, how), log)

    def with_log(self, log: Log) -> "Simulation":
        """Return an independent copy that goes on with the same bits and logs its events from now on.

        Parameters
        ----------
        log : callable or path
            As of `Simulation`.

        Returns
        -------
        Simulation
            The copy; this one goes on as if there were none.

        Raises
        ------
        SimulationError
            If the log cannot be used.
        """
        sink = sink_of(log, self.scene.dim)
        return type(self)._restored(self.scene, self._alone(self._copied_arrays), sink, self._engine.how)

    def on_threads(self, threads: int, *, warn: bool = True) -> "Simulation":
        """Return a copy that so many threads run, without a log; it goes on with the same bits.

        Parameters
        ----------
        threads : int
            As of `Simulation`.
        warn : bool, default True
            Whether a warning says why they are fewer, as "fewer_threads" of `status` does.

        Raises
        ------
        SimulationError
            If that is no number of threads.
        """
        how = self._engine.how._replace(threads=_required_threads(threads))
        arrays = self._alone(self._copied_arrays)
        return type(self)._of(checkpoint.restored(self.scene, arrays, False, how), None, warn)

    def __copy__(self) -> "Simulation":
        return self._duplicate(lambda part: part)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Simulation":
        return self._duplicate(lambda part: copy.deepcopy(part, memo))

    def _duplicate(self, copied: Callable[[Any], Any]) -> "Simulation":
        make, parts = self.__reduce__(copied)
        duplicate: Simulation = make(*parts)
        return duplicate

    def __reduce__(self, copied: Callable[[Any], Any] = lambda part: part) -> tuple[Any, ...]:
        def parts() -> tuple[Any, ...]:
            return copied(self.scene), self._copied_arrays(), copied(self._log()), self._engine.how

        return type(self)._restored, self._alone(parts)

    def _copied_arrays(self) -> Arrays:
        return {name: array.copy() for name, array in self._arrays().items()}

    def _log(self) -> Sink | None:
        """Return the function that a copy would log to."""
        sink = self._engine.sink
        if isinstance(sink, NpyStream):
            raise SimulationError(
                f"two simulations cannot write one log, and this one writes {sink.path}; save it, and load "
                "it with another log=..."
            )
        return sink

    # Tallies.

    def reset_tallies(self) -> None:
        """Begin `tallies` and what is made of them anew; dynamics, counts and frames' tallies go on."""
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
        of_walls, of_heat = 2 * dim * dim, 2 * dim * dim + 4 * dim
        tensors, walls = sums[:of_walls].reshape(2, dim, dim), sums[of_walls:of_heat].reshape(2, dim, 2)
        heat = sums[of_heat:].reshape(-1, dim)  # empty where it is not tallied
        collisions, wall_collisions = self.collisions - collisions, self.wall_collisions - wall_collisions
        return Tallies(time, collisions, wall_collisions, *tensors, *walls, *heat)

    @property
    @at_rest
    def free_paths(self) -> FreePaths:
        """What was tallied of free flights since `reset_tallies`; needs ``Simulation(..., free_paths=True)``.

        Raises
        ------
        SimulationError
            If they are not tallied.
        """
        if self.scene.falls:
            raise SimulationError(CURVED)
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
        flights = self._engine.flights is not None and not self.scene.falls
        return flights and int(self.scene.species.max()) < MOST_SPECIES

    def _flights(self, from_start: bool = False) -> FreePaths:
        engine = self._engine
        passed = self._time if from_start else engine.passed
        then = None if from_start else engine.total_then
        return engine.flights.read(engine.arrays, engine.now, passed, then)  # type: ignore[union-attr]

    @property
    @at_rest
    def pressure_tensor(self) -> Floats:
        """Mean pressure tensor since `reset_tallies`, shape (d, d): (kinetic + virial) / (time V). Read-only.

        The common motion along periodic axes is left out. Source: the virial of impulses, see
        `compressibility_factor`. Between walls it is the mean over the box, layers at the walls with all
        else, and the volume V is that of the box, part of which no centre can reach: in narrow boxes far less
        than what a wall feels. That is `wall_pressure`.
        """
        t = self._tallied()
        result: Floats = read_only(((t.kinetic + t.virial) / t.time - self._drift) / self.scene.volume)
        return result

    @property
    def _drift(self) -> Floats:
        """Part of the momentum flux that is due to the common motion along periodic axes, (d, d)."""
        if self.scene.n == 1 or self.scene.n_moving < self.scene.n:
            return np.zeros((self.scene.dim, self.scene.dim))
        p = np.where(self.scene.periodic, self.momentum, 0.0)
        return np.outer(p / float(np.sum(self.scene.masses)), p)

    @property
    @at_rest
    def compressibility_factor(self) -> float:
        """Compressibility factor Z = P V / (2 K_th / d) = 1 + W / (2 K_th) since `reset_tallies`.

        W is the virial rate, the sum of r.dp over pair collisions per time; exact for any finite run in a
        periodic box (Alder and Wainwright 1960, doi:10.1063/1.1731425). With two or more particles K_th
        leaves out the common motion. Between walls it is a mean over the box, whose volume V counts the half
        diameter at each wall that no centre can reach; what the walls feel is `wall_pressure`. Under gravity
        K_th is its mean over time.
        """
        t = self._tallied()
        kinetic = t.time * 2.0 * self.thermal_energy
        if self.scene.falls:
            kinetic = float(np.trace(t.kinetic - self._drift * t.time))
        return 1.0 + float(np.trace(t.virial)) / kinetic

    @property
    @at_rest
    def wall_pressure(self) -> Floats:
        """Mean pressure on the lower and upper wall of each axis since `reset_tallies`, (d, 2). Read-only.

        NaN on periodic axes. Force over area: momentum given to the wall per time, over the part of it that
        centres can reach, the product of L - 2R along the other wall axes and L along periodic ones, R the
        mean radius. By the contact theorem kT times the mean density of centres at the wall, at any density.
        For one diameter sigma its mean over both walls and `pressure_tensor` are tied by Clausius' virial
        theorem, P_kk V = (L_k - sigma) F_k, but for what the run's two ends differ by.

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
        if t.time <= 0 or (np.trace(t.kinetic) if self.scene.falls else self.thermal_energy) == 0:
            raise SimulationError(
                "no pressure yet: run the simulation for some time first, with particles that move"
            )
        return t

    # Trust.

    @property
    @at_rest
    def energy_drift(self) -> float:
        """Relative change of energy since the start; 0 for a gas at rest.

        Under gravity the potential energy, from the walls that it pulls to, counts too.
        """
        flown, velocities = self._engine.flown()
        energy = kinetic_energy(velocities, self.scene.masses) + potential_energy(flown, self.scene)
        return (energy - self._energy) / self._energy if self._energy > 0 else energy

    @property
    @at_rest
    def momentum_drift(self) -> Floats:
        """Change of momentum less the impulses of walls, obstacles and gravity, over sum m |v|, (d,).

        Read-only.
        """
        engine, at, dim = self._engine, self._at, self.scene.dim
        given = engine.sums(from_start=True)[at.LEDGER : at.LEDGER + dim]
        if self.scene.falls:  # earlier epochs are in the ledger
            behind = engine.now[0] - int(engine.arrays.counter[at.EPOCH])
            weight = engine.arrays.number[at.WEIGHT : at.WEIGHT + dim]
            given = given - weight * (behind * engine.length + engine.now[1])
        change = self.momentum - self.scene.momentum + given
        flown, velocities = engine.flown()
        if self.scene.falls:  # speeds at the floor: at the top of its flight a ball has none
            velocities = np.sqrt(squares_at_floor(self.scene, flown, velocities))
        scale = float(np.sum(inertia(self.scene.masses) * np.sqrt(squared_lengths(velocities))))
        drift: Floats = read_only(change / scale if scale > 0 else change)
        return drift

    @property
    @at_rest
    def worst_overlap(self) -> float:
        """Depth of the deepest overlap now, of particles or with a wall, in contact distances (diameters)."""
        return invariants.deepest_overlap(self.positions, self.scene)

    @at_rest
    def check(self) -> None:
        """Verify everything that must hold at any moment; changes nothing.

        Energy and momentum, overlaps, clocks and counters; that each neighbour list names all within reach;
        and, up to 512 particles, that every pending event is what the rows say, and that none is missing, by
        looking at all pairs.

        Raises
        ------
        InvariantError
            When energy or momentum has changed by more than rounding explains (relative; of sum m |v|):
            1e-12, or 12 eps / (d N) for each collision where that is more (many collisions of few particles;
            why: `invariants.allowed_drift`); when a pair or wall overlaps by more than 1e-11 diameters (or
            rounding of coordinates, in a box of over 1e4 diameters); when an event is wrong, or not where the
            engine looks for it.
        """
        invariants.verify(self, self._engine)

    @at_rest
    def status(self) -> dict[str, Any]:
        """Return where the simulation is, how it searches, and how exact and fast it has been.

        "collisions_per_second" is of the event loop alone in this process; NaN before anything was timed.
        """
        at, count, number = self._at, self._engine.arrays.counter, self._engine.arrays.number
        dim, (collisions, seconds) = self.scene.dim, self._slices.timed
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
            "obstacle_collisions": self.obstacle_collisions,
            "temperature": self.temperature,
            "energy_drift": self.energy_drift,
            "momentum_drift": float(np.max(np.abs(self.momentum_drift))),
            "late_events": int(count[at.OUT_OF_ORDER]),
            "stale_events": int(count[at.STALE]),
            "method": self._engine.search.method,
            "threads": self.threads,
            "fewer_threads": self._engine.shortfall,
            **{
                f"thread_{name}": int(count[getattr(at, slot)]) if at.THREADS else 0
                for name, slot in OF_THREADS.items()
            },
            "cell_size": (1.0 / number[at.CELL_DENSITY : at.CELL_DENSITY + dim]).tolist(),
            "shell": float(number[at.DISPLACEMENT_THRESHOLD]),
            "window": 2.0 * float(number[at.HALF_WINDOW]),
            "pairs_compared": self._engine.search.pairs_compared,
            "list_renewals": int(count[at.REBUILDS]),
            "epoch_length": self._engine.length,
            "bytes_per_particle": self._engine.bytes / self.scene.n,
            "collisions_per_second": collisions / seconds if collisions else math.nan,
        }

    def __repr__(self) -> str:
        scene = self.scene
        return (
            f"<Simulation of {scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle), energy drift {self.energy_drift:.1e}>"
        )


def _require_search(search: object) -> None:
    if not isinstance(search, str) or search not in SEARCHES:
        raise SimulationError(f'search is {search!r}; it must be "auto", "lists" or "windows"')


def _required_threads(threads: object) -> int:
    """Return a number of threads, at least 1; SimulationError for anything else."""
    count = whole("threads", threads)
    if count < 1:
        raise SimulationError(f"threads is {count}; it must be at least 1")
    return count
