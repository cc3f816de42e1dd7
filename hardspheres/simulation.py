"""Simulation: a scene in motion. Runs it, shows it, tallies it; looking never changes it."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.clock import carried, recounted
from hardspheres.engine import Engine
from hardspheres.errors import SimulationError
from hardspheres.event_log import sink_of
from hardspheres.free_paths import MOST_SPECIES, FreePaths
from hardspheres.scene import Scene, kinetic_energy, returned_to_box, thermal_energy, total_momentum
from hardspheres.tuning import collision_frequency

Floats = NDArray[np.float64]

SLICE = 0.1  # seconds after which control comes back to Python
FOREVER = 2**62
PATIENCE = 1000.0  # expected times to the next collision without one, until `run(collisions=...)` gives up
# Where the sums keep the components of a symmetric tensor.
COMPONENTS = {2: ((0, 3), (3, 1)), 3: ((0, 3, 4), (3, 1, 5), (4, 5, 2))}


def _number(name: str, value: Any) -> float:
    """Return a finite number, or raise SimulationError."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if isinstance(value, str) or not math.isfinite(number):
        raise SimulationError(f"{name} needs a finite number, not {value!r}")
    return number


def _whole(name: str, value: Any) -> int:
    """Return a whole number of at least 0 that can be counted to, or raise SimulationError."""
    number = _number(name, value)
    if number != int(number) or not 0 <= number < FOREVER // 2:
        raise SimulationError(f"{name} needs a whole number of at least 0 and below 2^61, not {value!r}")
    return int(value)


@dataclass(frozen=True)
class Frame:
    """The gas at one moment.

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
    """

    time: float
    collisions: int
    collisions_per_particle: float
    positions: Floats
    velocities: Floats
    scene: Scene
    unwound: tuple[Floats, NDArray[np.integer[Any]]] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Return when it is, and of what."""
        return (
            f"<Frame of {self.scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle)>"
        )

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
        unwrapped: Floats = flown + turns * self.scene.box
        return unwrapped


@dataclass(frozen=True)
class Tallies:
    """What the engine counted since `reset_tallies`.

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


class Simulation:
    """The event-driven dynamics of a scene.

    Every collision is found and executed in its order; between collisions particles fly freely, exactly. The same scene gives
    the same bits on every IEEE-754 machine, and nothing that looks at the simulation changes it. The method is told in
    `hardspheres.kernel`.

    Parameters
    ----------
    scene : Scene
        Where to start. It stays as it is.
    free_paths : bool, default False
        Tally every free flight, see `free_paths`; costs some 10 % of speed.
    log : callable or path, optional
        Where every event goes, see `hardspheres.event_log.event_dtype`: a function that takes chunks (structured arrays, in
        the order of execution), or the path of a ``.npy`` file, replaced if it is there. Events are handed over 8192 at a
        time, and the rest when `run` returns or a frame is due; there is nothing to close. A log tallies free flights too.

    Raises
    ------
    SimulationError
        If free paths are asked for and there are more than 32 species, or the log cannot be written.

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
    ) -> None:
        if not isinstance(scene, Scene):
            raise SimulationError(f"a simulation starts from a Scene, not from {scene!r:.60}")
        kinds = int(scene.species.max()) + 1
        if free_paths and kinds > MOST_SPECIES:
            raise SimulationError(
                f"free_paths=True tells up to {MOST_SPECIES} species apart, and this scene has {kinds}; leave it out, and use "
                "log=... for the path of each flight"
            )
        self.scene = scene
        sink = None if log is None else sink_of(log, scene.dim)
        self._engine = Engine(scene, flights=free_paths or sink is not None, sink=sink)
        self._at = self._engine.layout
        self._epoch = 0  # sim.time is two numbers: whole epochs, and the time within this one
        self._moment = 0.0
        self._budget = 2000 + scene.n
        self._energy = scene.kinetic_energy
        self._rate = 0.5 * scene.n * collision_frequency(scene)
        self._moving = False  # whether somebody is known to move relative to another
        self._since = (0, 0.0, 0, 0)  # where the tallies began: epoch, moment, collisions, hits of walls
        self.reset_tallies()

    # Running.

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
            When no collision is to come; when time stands still for 1000 N events; when the arguments make no sense.
        """
        if (time is None) == (collisions is None):
            raise SimulationError("run needs either time=... or collisions=..., and not both")
        self._keep_clock()  # an interrupt may have come before the last run could do that
        if time is not None:
            duration = _number("run(time=...)", time)
            if duration < 0:
                raise SimulationError(f"run(time={time}) must be a time of at least 0")
            self._run_until(*self._later(self._epoch, self._moment + duration))
        elif collisions is not None:
            self._run_collisions(self.collisions + _whole("run(collisions=...)", collisions))

    def _later(self, epoch: int, moment: float) -> tuple[int, float]:
        """Bring the time within an epoch into its range."""
        length = self._length
        later = carried(epoch, moment, length)
        if later[0] >= FOREVER:
            raise SimulationError(
                f"a time of {epoch * length + moment:.3g} is more than can be counted; {FOREVER * length:.3g} is"
            )
        return later

    @property
    def _length(self) -> float:
        return float(self._engine.arrays.number[self._at.EPOCH_LENGTH])

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

    def _keep_pace(self) -> None:
        """Change the length of the epochs where the last one left particles behind that are far faster or slower.

        Complete, or not at all: it ends with plain assignments, which nothing interrupts.
        """
        before, length = self._length, self._engine.due
        if length == before:
            return
        last = recounted(int(self._engine.arrays.counter[self._at.EPOCH]), 0.0, before, length)
        if last[0] >= FOREVER:
            raise SimulationError(
                f"at a time of {self.time:.3g} particles have become so fast that it can no longer be counted"
            )
        now = recounted(self._epoch, self._moment, before, length)
        epoch, moment, collisions, wall_collisions = self._since
        since = (*recounted(epoch, moment, before, length), collisions, wall_collisions)
        engine = self._engine.with_epochs(length)
        self._engine, (self._epoch, self._moment), self._since = engine, now, since

    def _keep_clock(self) -> None:
        """Set the time to that of the last event, where that is later than what was asked for before."""
        here = (
            int(self._engine.arrays.counter[self._at.EPOCH]),
            max(float(self._engine.arrays.number[self._at.NOW]), 0.0),
        )
        self._epoch, self._moment = max((self._epoch, self._moment), here)

    def _run_until(self, epoch: int, moment: float) -> None:
        if self._energy == 0.0:  # nobody moves: there is no need to pass through empty epochs
            self._engine.arrays.counter[self._at.EPOCH] = epoch
        try:
            while True:
                before = self._length
                self._keep_pace()
                epoch, moment = self._later(*recounted(epoch, moment, before, self._length))
                if self._slice(epoch, moment, FOREVER):
                    break
        except BaseException:
            self._keep_clock()
            raise
        else:
            self._epoch, self._moment = epoch, moment
        finally:
            self._engine.hand_over_log()

    def _run_collisions(self, goal: int) -> None:
        if goal > self.collisions:
            self._require_something_to_come()
        at = self._at
        start = int(self._engine.arrays.counter[at.EPOCH])
        try:
            while True:
                before = self._length
                self._keep_pace()
                start, _ = recounted(start, 0.0, before, self._length)
                if self._slice(FOREVER, 0.0, goal):
                    break
                count = self._engine.arrays.counter
                idle = int(count[at.EPOCH]) - max(int(count[at.LAST_PAIR_EPOCH]), start)
                if idle > self._patience:
                    raise SimulationError(
                        f"no two particles met for {idle * self._length:.3g} time units, over {PATIENCE:.0f} times the expected "
                        "time to a collision; these particles may never meet: use run(time=...)"
                    )
        finally:
            self._keep_clock()
            self._engine.hand_over_log()

    @property
    def _patience(self) -> int:
        """Epochs without a collision until `run(collisions=...)` gives up."""
        expected = self._rate * self._length  # collisions in an epoch
        return int(min(PATIENCE / expected + 10, FOREVER)) if expected > 0 else FOREVER

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
        times: Sequence[float] | None = None,
        collisions_per_particle: Sequence[float] | None = None,
    ) -> Iterator[Frame]:
        """Run, and yield the gas at chosen moments.

        Parameters
        ----------
        every, count : float and int, optional
            `count` frames, `every` apart in time, the first one now.
        times : sequence of float, optional
            At these times, ascending, none before now.
        collisions_per_particle : sequence of float, optional
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
                "collisions_per_particle", collisions_per_particle, self.collisions_per_particle
            )
            goals = [math.ceil(value * self.scene.n / 2 - 1e-9) for value in s]
            return self._frames_after([_whole("the number of collisions of a frame", goal) for goal in goals])
        if every is None or count is None:
            raise SimulationError("frames(every=..., count=...) needs both: how far apart, and how many")
        step, number = _number("frames(every=...)", every), _whole("frames(count=...)", count)
        if step <= 0:
            raise SimulationError(f"frames(every={every}) must be a time above 0")
        now = self.time
        return self._frames_at([now + k * step for k in range(number)])

    def _ascending(self, name: str, values: Sequence[float], first: float) -> list[float]:
        try:
            numbers = [_number(f"frames({name}=...)", value) for value in values]
        except TypeError:
            raise SimulationError(f"frames({name}=...) needs a sequence of numbers, not {values!r}") from None
        if numbers != sorted(numbers):
            raise SimulationError(f"frames({name}=...) needs values in ascending order")
        if numbers and numbers[0] < first:
            raise SimulationError(
                f"frames({name}=...) begins at {numbers[0]}, but the simulation is at {first} already"
            )
        return numbers

    def _frames_at(self, times: list[float]) -> Iterator[Frame]:
        for t in times:
            target = self._later(0, t)
            if target > (self._epoch, self._moment):
                self._run_until(*target)
            yield self.frame()

    def _frames_after(self, collisions: list[int]) -> Iterator[Frame]:
        for goal in collisions:
            if goal > self.collisions:
                self._run_collisions(goal)
            yield self.frame()

    def frame(self) -> Frame:
        """Return the gas as it is now."""
        flown = self._flown()
        return Frame(
            self.time,
            self.collisions,
            self.collisions_per_particle,
            returned_to_box(flown, self.scene.box, self.scene.periodic),
            self.velocities,
            self.scene,
            (flown, self._turns.copy()),
        )

    # Looking.

    @property
    def time(self) -> float:
        """Simulated time since the start."""
        return self._epoch * self._length + self._moment

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
        behind = self._epoch - int(self._engine.arrays.counter[at.EPOCH])
        dt = (behind * self._length + self._moment) - rows[:, at.T]
        flown: Floats = rows[:, at.X : at.X + dim] + rows[:, at.V : at.V + dim] * dt[:, None]
        return flown

    @property
    def positions(self) -> Floats:
        """Positions now, shape (N, d), on periodic axes within [0, L). A copy."""
        return returned_to_box(self._flown(), self.scene.box, self.scene.periodic)

    @property
    def unwrapped_positions(self) -> Floats:
        """Positions now, followed through the periodic boundaries from the start, shape (N, d)."""
        unwrapped: Floats = self._flown() + self._turns * self.scene.box
        return unwrapped

    @property
    def _turns(self) -> NDArray[np.integer[Any]]:
        turns: NDArray[np.integer[Any]] = self._engine.arrays.turns.reshape(self.scene.n, self.scene.dim)
        return turns

    @property
    def velocities(self) -> Floats:
        """Velocities now, shape (N, d). A copy."""
        v: Floats = self._rows[:, self._at.V : self._at.V + self.scene.dim].copy()
        return v

    @property
    def momentum(self) -> Floats:
        """Total momentum, shape (d,)."""
        return total_momentum(self.velocities, self.scene.masses)

    @property
    def thermal_energy(self) -> float:
        """Kinetic energy less that of the common motion along periodic axes."""
        return thermal_energy(self.velocities, self.scene.masses, self.scene.periodic)

    @property
    def temperature(self) -> float:
        """Temperature kT = 2 thermal_energy / degrees_of_freedom, in units of energy."""
        return 2 * self.thermal_energy / self.scene.degrees_of_freedom

    def to_scene(self) -> Scene:
        """Return the gas as it is now as a Scene, contacts as the engine left them."""
        return self.scene.with_state(self.positions, self.velocities)

    def to_atoms(self) -> Any:
        """Return the gas as it is now as an ASE Atoms object."""
        from hardspheres.trajectory import to_atoms

        return to_atoms(self.frame())

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

        save(self, path)

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        log: Callable[[NDArray[np.void]], object] | str | PathLike[str] | None = None,
    ) -> "Simulation":
        """Return the simulation in a checkpoint: running on from it gives what running on would have given, bit for bit.

        Parameters
        ----------
        path : path
            A file written by `save`. Nothing in it is executed.
        log : callable or path, optional
            Takes the events from now on (a new file); only where the simulation that was saved had a log or `free_paths`.

        Returns
        -------
        Simulation
            With the scene, clock, tallies and counters of the one that was saved.

        Raises
        ------
        CheckpointError
            When the file is missing, torn, altered, of another format version, or holds what no simulation leaves.
        """
        from hardspheres.checkpoint import load

        return load(cls, path, log)

    # Tallies.

    def reset_tallies(self) -> None:
        """Begin the tallies anew; time, collisions and the dynamics go on."""
        self._engine.arrays.total[: self._at.SUMS] = 0.0
        self._since = (self._epoch, self._moment, self.collisions, self.wall_collisions)
        if self._engine.flights:
            self._engine.flights.reset(self._engine.arrays, self._epoch, self._moment)

    def _sums(self, first: int) -> Floats:
        sums: Floats = self._engine.arrays.total[first : first + 2 * self.scene.dim].reshape(-1, 2).copy()
        return sums

    @property
    def tallies(self) -> Tallies:
        """What was counted since `reset_tallies`."""
        at, total = self._at, self._engine.arrays.total
        epoch, moment, collisions, wall_collisions = self._since
        passed = self._passed
        places = np.array(COMPONENTS[self.scene.dim])
        v, m = self.velocities, self.scene.masses
        # integral of K from t0 to t1 = K(t1) (t1 - t0) - sum over events of dK (t - t0)
        moments = (total[at.STRESS_EPOCHS + places] - epoch * total[at.STRESS + places]) * self._length + (
            total[at.STRESS_MOMENT + places] - moment * total[at.STRESS + places]
        )
        return Tallies(
            passed,
            self.collisions - collisions,
            self.wall_collisions - wall_collisions,
            total[at.VIRIAL + places],
            (v * m[:, None]).T @ v * passed - moments,
            self._sums(at.WALL_IMPULSE),
            self._sums(at.WALL_RADIUS_IMPULSE),
        )

    @property
    def _passed(self) -> float:
        epoch, moment, *_ = self._since
        return (self._epoch - epoch) * self._length + (self._moment - moment)

    @property
    def free_paths(self) -> FreePaths:
        """What was tallied of the free flights since `reset_tallies`; needs ``Simulation(scene, free_paths=True)``.

        Raises
        ------
        SimulationError
            If they are not tallied.
        """
        flights = self._engine.flights
        if flights is None:
            raise SimulationError(
                "free paths are not tallied; construct with Simulation(scene, free_paths=True)"
            )
        if int(self.scene.species.max()) >= MOST_SPECIES:
            raise SimulationError(
                f"free paths are tallied for up to {MOST_SPECIES} species only; read them from the log"
            )
        return flights.read(self._engine.arrays, self._epoch, self._moment, self._passed)

    @property
    def pressure_tensor(self) -> Floats:
        """Mean pressure tensor since `reset_tallies`, shape (d, d): (kinetic + virial) / (time V).

        The common motion along periodic axes is left out. Source: the virial of impulses, see `compressibility_factor`.
        """
        t = self._tallied()
        p = (
            np.where(self.scene.periodic, self.momentum, 0.0)
            if self.scene.n > 1
            else np.zeros(self.scene.dim)
        )
        drift = np.outer(p, p) / float(np.sum(self.scene.masses))
        result: Floats = ((t.kinetic + t.virial) / t.time - drift) / self.scene.volume
        return result

    @property
    def compressibility_factor(self) -> float:
        """Compressibility factor Z = P V / (2 K_th / d) = 1 + W / (2 K_th) since `reset_tallies`.

        W is the virial rate, the sum of r.dp over pair collisions per time; exact for any finite run in a periodic box
        (Alder and Wainwright 1960, doi:10.1063/1.1731425). With two or more particles K_th leaves out the common motion.
        """
        t = self._tallied()
        return 1.0 + float(np.trace(t.virial)) / (t.time * 2.0 * self.thermal_energy)

    def _tallied(self) -> Tallies:
        t = self.tallies
        if t.time <= 0 or self.thermal_energy == 0:
            raise SimulationError(
                "no pressure yet: run the simulation for some time first, with particles that move"
            )
        return t

    # Trust.

    @property
    def energy_drift(self) -> float:
        """Relative change of kinetic energy since the start; 0 for a gas at rest."""
        energy = kinetic_energy(self.velocities, self.scene.masses)
        return (energy - self._energy) / self._energy if self._energy > 0 else energy

    @property
    def momentum_drift(self) -> Floats:
        """Change of momentum since the start less the walls' impulses, over sum m |v|, shape (d,)."""
        given = self._engine.arrays.total[self._at.LEDGER : self._at.LEDGER + self.scene.dim]
        change = self.momentum - self.scene.momentum + given
        scale = float(np.sum(self.scene.masses * np.linalg.norm(self.velocities, axis=1)))
        drift: Floats = change / scale if scale > 0 else change
        return drift

    @property
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

    def check(self) -> None:
        """Verify everything that must hold at any moment; changes nothing.

        Energy and momentum, overlaps, clocks and counters; that each neighbour list names all within reach; and, up to 512
        particles, that every pending event is what the rows say, and that none is missing, by looking at all pairs.

        Raises
        ------
        InvariantError
            When energy or momentum has changed by more than rounding explains (relative; of sum m |v|): 1e-12, or half a unit
            in the last place for each event of a particle where that is more (few particles, many events); when a pair or
            wall overlaps by more than 1e-11 diameters (or rounding of coordinates, in a box of over 1e4 diameters); when an
            event is wrong, or not where the engine looks for it.
        """
        from hardspheres.invariants import verify

        verify(self)

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
            "time": self.time,
            "collisions": self.collisions,
            "collisions_per_particle": self.collisions_per_particle,
            "wall_collisions": self.wall_collisions,
            "temperature": self.temperature,
            "energy_drift": self.energy_drift,
            "momentum_drift": float(np.max(np.abs(self.momentum_drift))),
            "late_events": int(count[at.LATE]),
            "stale_events": int(count[at.STALE]),
            "method": self._engine.method,
            "cell_size": (1.0 / number[at.CELL_DENSITY : at.CELL_DENSITY + dim]).tolist(),
            "shell": float(number[at.SHELL]),
            "window": 2.0 * float(number[at.HALF_WINDOW]),
            "list_renewals": int(count[at.RENEWALS]),
            "epoch_length": self._length,
            "bytes_per_particle": self._engine.bytes / self.scene.n,
            "collisions_per_second": self._timed[0] / self._timed[1] if self._timed[0] else math.nan,
        }

    def __repr__(self) -> str:
        scene = self.scene
        return (
            f"<Simulation of {scene}: time {self.time:.6g}, {self.collisions} collisions "
            f"({self.collisions_per_particle:.4g} per particle), energy drift {self.energy_drift:.1e}>"
        )
