"""Invariants of a simulation: conservation laws, no overlap, consistent clocks, and no missed event.

The search for events is compared with an exhaustive one, with the same formulas in NumPy: every stored event
equals, to the last bit, the one computed from the two rows, and no contact precedes the events stored for its
two particles.
"""

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.cells import CellGrid, distances, worst_overlap
from hardspheres.checks import contact_tolerance, inertia
from hardspheres.collision import discriminant_2d, discriminant_3d
from hardspheres.errors import InvariantError
from hardspheres.falling import falling_contact_time
from hardspheres.gravity import climbed_speed, impact_time
from hardspheres.scene import Scene, returned_to_box, squared_lengths, squares_at_floor

if TYPE_CHECKING:
    from hardspheres.engine import Engine
    from hardspheres.simulation import Simulation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ALL_PAIRS_UP_TO = 512  # particles up to which all pairs are tried
STAMP_BITS = 0xFFFFFFFF


def verify(sim: "Simulation", engine: "Engine") -> None:
    """Raise InvariantError for the first invariant that does not hold; see `Simulation.check`.

    Parameters
    ----------
    sim : Simulation
        At any moment; it is not changed.
    engine : Engine
        Its engine.

    Raises
    ------
    InvariantError
        Naming what broke, by how much, and what is allowed.
    """
    _counters_make_sense(engine)
    _energy_and_momentum_are_kept(sim)
    _obstacles_are_where_they_were(engine)
    if sim.scene.falls:
        _falls_fit_the_rows(engine)
    _no_overlaps(sim)
    if not engine._afresh:  # otherwise everything else is computed from the rows before the next event
        search = _Search(engine)
        if engine.arrays.counter[engine.layout.WINDOW_BUCKETS] == 0:
            search.lists_are_complete()
        if sim.scene.n <= ALL_PAIRS_UP_TO:
            search.no_event_is_missing()


def _require(holds: Any, sentence: str) -> None:
    if not holds:
        raise InvariantError(sentence)


def _counters_make_sense(engine: "Engine") -> None:
    at, count, rows = engine.layout, engine.arrays.counter, engine.rows
    for name in ("EPOCH", "PAIRS", "WALL_HITS", "OUT_OF_ORDER", "STALE", "REBUILDS", "INSTANT_EVENTS"):
        value = int(count[getattr(at, name)])
        _require(0 <= value < 2**62, f"the counter {name} is {value}; it must lie between 0 and 2^62")
    _require(np.isfinite(rows).all(), "a row holds a value that is not finite")
    (last, now), (epoch, moment) = engine.last_event, engine.now
    _require(
        (last, now) <= (epoch, moment),
        f"the last event, at {now} of epoch {last}, lies after the simulation's time, {moment} of epoch "
        f"{epoch}",
    )
    t = rows[:, at.T]
    late = int(np.argmax(t))
    _require(
        t.min() >= 0.0 and t[late] <= now, f"row {late} is of time {t[late]}, after the last event at {now}"
    )


def _falls_fit_the_rows(engine: "Engine") -> None:
    """Require of each particle the speed at the floor that follows from its row, to the rounding of rows."""
    scene, at, rows = engine.scene, engine.layout, engine.rows
    x, v = rows[:, at.X : at.X + scene.dim], rows[:, at.V : at.V + scene.dim]
    kept = engine.arrays.fall.reshape(v.shape)
    off = np.abs(kept - squares_at_floor(scene, x, v)) * (scene.gravity != 0.0)
    allowed = 1e-9 * kept + 1e-9 * float(scene.radii.min()) * np.abs(scene.gravity)
    _require(np.all(off <= allowed), "the speed of a particle at the floor does not fit its row")


def _obstacles_are_where_they_were(engine: "Engine") -> None:
    """Require of obstacles the rows that they began with."""
    scene, at = engine.scene, engine.layout
    rows = engine.rows[scene.obstacles]
    there = np.array_equal(rows[:, at.X : at.X + scene.dim], scene.positions[scene.obstacles])
    _require(there and not rows[:, at.V : at.T + 1].any(), "an obstacle has moved")


def allowed_drift(sim: "Simulation", events: int) -> float:
    """Return bounds on the rounding errors of energy (relative) and momentum (over sum m |v|).

    Roundings differ from one collision to the next, so that errors are random walks: 1e-12 is never reached.
    Where contact directions hardly change (near close packing, chains between walls) roundings repeat, and
    errors add up linearly. Then r.r is off by up to three half units in the last place, and the impulse by
    1.5 eps. That changes the energy by four times as much of E_n, the energy of the relative motion along the
    line of centres, which is kT = 2 E / (d N) for the average collision of particles that share the energy E:
    12 eps / (d N) of E. N is the effective number of particles that share it: (1 + 2/d) E^2 over the sum of
    squares of the particles' energies, which is N in equilibrium, at the start or now, whichever is less.

    Parameters
    ----------
    sim : Simulation
        At any moment.
    events : int
        Collisions so far.

    Returns
    -------
    float
        The larger of the two, relative.
    """
    scene = sim.scene
    sharing = min(
        float(scene.n_moving), *(_sharing(scene.masses, v) for v in (scene.velocities, sim.velocities))
    )
    return max(1e-12, 12.0 * float(np.finfo(np.float64).eps) * events / (scene.dim * sharing))


def _sharing(masses: Floats, velocities: Floats) -> float:
    """Effective number that share the kinetic energy: N in equilibrium, at most 3 if one has all."""
    energies = inertia(masses) * squared_lengths(velocities)
    most = float(np.max(energies))
    if most == 0.0:
        return math.inf
    parts = energies / most  # their squares stay in range
    shared, squares = float(np.sum(parts)), float(np.sum(parts * parts))
    return (1.0 + 2.0 / len(velocities[0])) * shared * shared / squares


def _energy_and_momentum_are_kept(sim: "Simulation") -> None:
    # Walls reverse a velocity component without rounding; but under gravity every flight is rounded.
    falls = sim.scene.falls
    events = sim.collisions
    if falls:
        events += sim.wall_collisions + sim.scene.n * int(sim._engine.arrays.counter[sim._at.EPOCH])
    energy, allowed = sim.energy_drift, allowed_drift(sim, events)
    which = "energy" if falls else "kinetic energy"
    _require(
        abs(energy) <= allowed,
        f"{which} changed by {energy:.3g} relative to the start; {allowed:.3g} is allowed",
    )
    allowed = allowed_drift(sim, events if falls else sim.collisions + sim.wall_collisions)
    for axis, momentum in zip("xyz", sim.momentum_drift.tolist(), strict=False):
        _require(
            abs(momentum) <= allowed,
            f"momentum along {axis} changed by {momentum:.3g} of sum m |v|; {allowed:.3g} is allowed",
        )


def deepest_overlap(positions: Floats, scene: Scene) -> float:
    """Depth of the deepest overlap, between particles or with a wall, in contact distances (diameters)."""
    radii, walls = scene.radii, ~scene.periodic
    i, j, depth = worst_overlap(positions, radii, scene.box, scene.periodic, scene.obstacles)
    deepest = depth / float(radii[i] + radii[j]) if depth > 0 else 0.0
    if walls.any():
        beyond = np.maximum(radii[:, None] - positions, positions + radii[:, None] - scene.box)[:, walls]
        beyond = (beyond / (2.0 * radii[:, None]))[~scene.obstacles]
        deepest = max(deepest, float(np.max(beyond)))
    return deepest


def _no_overlaps(sim: "Simulation") -> None:
    allowed = max(1e-11, contact_tolerance(sim.scene.box) / float(sim.scene.radii.min()))
    overlap = sim.worst_overlap
    _require(overlap <= allowed, f"particles overlap by {overlap:.3g} diameters; {allowed:.3g} is allowed")


def _impact_times(toward: Floats, gap: Floats, pull: float, root: Floats) -> Floats:
    """`hardspheres.gravity.impact_time` for arrays."""
    pairs = zip(toward.tolist(), gap.tolist(), root.tolist(), strict=True)
    return np.array([impact_time(u, c, pull, r) for u, c, r in pairs])


class _Search:
    """The events stored in the engine, and those that follow from its rows."""

    def __init__(self, engine: "Engine") -> None:
        self.at, self.arrays, self.scene = engine.layout, engine.arrays, engine.scene
        self.versions = engine.versions
        at, rows, dim = self.at, engine.rows, self.scene.dim
        self.n = self.scene.n
        self.x, self.v, self.t = rows[:, at.X : at.X + dim], rows[:, at.V : at.V + dim], rows[:, at.T]
        _, self.now = engine.last_event
        self.squares = engine.arrays.fall.reshape(self.n, dim) if self.scene.falls else np.zeros(0)
        self.pulls = self.scene.accelerations
        self.one_size = bool(np.all(self.scene.radii == self.scene.radii[0]))

    # Lists.

    def lists_are_complete(self) -> None:
        """Every pair within the contact distance and two displacement thresholds is in both lists."""
        at, scene = self.at, self.scene
        events = self.arrays.event_float[: self.n * at.EVENT].reshape(self.n, at.EVENT)
        centres = returned_to_box(
            events[:, at.REFERENCE : at.REFERENCE + scene.dim], scene.box, scene.periodic
        )
        lists = self.arrays.neighbours[: self.n * int(self.arrays.counter[at.LIST_ROOM])].reshape(self.n, -1)
        _require(
            lists.min() >= 0 and lists.max() <= self.n,
            "a neighbour list names a particle that does not exist",
        )
        shells = 2.0 * float(self.arrays.number[at.DISPLACEMENT_THRESHOLD])
        grid = CellGrid(centres, scene.box, scene.periodic, shells + 2.0 * float(scene.radii.max()))
        for i, j in grid.pairs():
            gap = distances(centres, centres, i, j, scene.box, scene.periodic)
            near = gap < shells + scene.radii[i] + scene.radii[j]
            i, j = i[near], j[near]
            for one, other in ((i, j), (j, i)):
                missing = ~np.any(lists[one] == other[:, None], axis=1) & ~scene.obstacles[one]
                missing = np.flatnonzero(missing)
                if len(missing):
                    a, b = int(one[missing[0]]), int(other[missing[0]])
                    raise InvariantError(
                        f"particle {b} is within reach of {a}, but not in its neighbour list"
                    )

    # Contacts.

    def times(self, i: Ints, j: Ints, image: Floats) -> Floats:
        """Contact times of pairs in given images, as `kernel.common.contact_times` computes them."""
        x, u, later = self._apart(i, j)
        x = x - self.scene.box * image
        sigma = 2.0 * self.scene.radii[i] if self.one_size else self.scene.radii[i] + self.scene.radii[j]
        sigma2 = sigma * sigma
        b, rr = x[:, 0] * u[:, 0] + x[:, 1] * u[:, 1], x[:, 0] * x[:, 0] + x[:, 1] * x[:, 1]
        if self.scene.dim == 3:
            b, rr = b + x[:, 2] * u[:, 2], rr + x[:, 2] * x[:, 2]
            d = discriminant_3d(x[:, 0], x[:, 1], x[:, 2], u[:, 0], u[:, 1], u[:, 2], sigma2)
        else:
            d = discriminant_2d(x[:, 0], x[:, 1], u[:, 0], u[:, 1], sigma2)
        root, c = np.sqrt(np.maximum(d, 0.0)), rr - sigma2
        meet = (b < 0.0) & ((c <= 0.0) | (root > 0.0))
        wait = np.full(len(b), math.inf)
        np.divide(np.maximum(c, 0.0), root - b, out=wait, where=meet)
        if self.scene.falls:
            fixed, horizon = self.scene.obstacles, float(self.arrays.number[self.at.EPOCH_LENGTH])
            pulls, still = self.pulls[i] - self.pulls[j], np.zeros(3 - self.scene.dim)
            for k in np.flatnonzero(fixed[i] != fixed[j]).tolist():
                of_pair = [number for part in (x, u, pulls) for number in np.append(part[k], still).tolist()]
                of_pair += [float(sigma2[k]), horizon - float(later[k])]
                wait[k] = falling_contact_time(*of_pair)
        times: Floats = later + wait
        return times

    def _apart(self, i: Ints, j: Ints) -> tuple[Floats, Floats, Floats]:
        """Separation and relative velocity at the later of the two local times, and that time."""
        later = np.maximum(self.t[i], self.t[j])
        there_i, v_i = self._flown(i, later)
        there_j, v_j = self._flown(j, later)
        return there_i - there_j, v_i - v_j, later

    def _flown(self, i: Ints, when: Floats) -> tuple[Floats, Floats]:
        """Positions and velocities of these at a time."""
        dt = (when - self.t[i])[:, None]
        if not self.scene.falls:
            return self.x[i] + self.v[i] * dt, self.v[i]
        pull = self.pulls[i]
        return self.x[i] + (self.v[i] + 0.5 * pull * dt) * dt, self.v[i] + pull * dt

    def nearest_image(self, i: Ints, j: Ints, when: Any) -> Floats:
        """Image, in boxes, in which a pair is nearest at some time; 0 on wall axes."""
        x, u, later = self._apart(i, j)
        ago = np.asarray(when - later)
        image: Floats = np.where(self.scene.periodic, np.rint((x + u * ago[:, None]) / self.scene.box), 0.0)
        return image

    def images_around(self) -> list[tuple[int, ...]]:
        """Return the steps from an image to those beside it."""
        return list(itertools.product(*[(-1, 0, 1) if p else (0,) for p in self.scene.periodic]))

    def all_contacts(self, until: float) -> tuple[Ints, Ints, Floats]:
        """Contacts of pairs before a time, in the nearest image and the adjacent ones within reach."""
        i, j = np.triu_indices(self.n, 1)
        nearest = self.nearest_image(i, j, np.full(len(i), self.now))
        x, u, later = self._apart(i, j)
        x = x + u * (self.now - later)[:, None] - self.scene.box * nearest
        sigma = self.scene.radii[i] + self.scene.radii[j]
        path = np.abs(u) * max(until - self.now, 0.0) + 1.001 * sigma[:, None]
        path += np.abs(self.pulls[i] - self.pulls[j]) * until * until
        reached = {step: np.abs(x - self.scene.box * step) <= path for step in (-1, 0, 1)}
        found = []
        for steps in self.images_around():
            some = np.flatnonzero(
                np.logical_and.reduce([reached[step][:, axis] for axis, step in enumerate(steps)])
            )
            times = self.times(i[some], j[some], nearest[some] + np.array(steps))
            soon = times < until
            found.append((i[some][soon], j[some][soon], times[soon]))
        first, second, time = (np.concatenate(part) for part in zip(*found, strict=True))
        return first, second, time

    def walls(self) -> tuple[Floats, Ints]:
        """Time of each particle's next wall collision, and which wall (n + 2 axis + side)."""
        best, which = np.full(self.n, math.inf), np.full(self.n, -2)
        radii, box = self.scene.radii, self.scene.box
        for axis in np.flatnonzero(~self.scene.periodic):
            x, v, pull = self.x[:, axis], self.v[:, axis], float(self.scene.gravity[axis])
            if pull != 0.0:
                for side, toward, gap in ((0, -v, x - radii), (1, v, (box[axis] - radii) - x)):
                    if (pull > 0.0) == (side == 1):
                        root = np.sqrt(self.squares[:, axis])
                    else:  # the wall opposite, which it rises to
                        root = np.vectorize(climbed_speed, otypes=[float])(
                            self.squares[:, axis], box[axis] - 2.0 * radii, abs(pull)
                        )
                    times = self.t + _impact_times(
                        toward, np.maximum(gap, 0.0), pull if side else -pull, root
                    )
                    which = np.where(times < best, self.n + 2 * axis + side, which)
                    best = np.minimum(times, best)
                continue
            gap = np.where(v > 0.0, (box[axis] - radii) - x, x - radii)
            with np.errstate(divide="ignore", invalid="ignore"):
                times = np.where(v != 0.0, self.t + np.maximum(gap, 0.0) / np.abs(v), math.inf)
            sooner = times < best
            best = np.where(sooner, times, best)
            which = np.where(sooner, self.n + 2 * axis + (v > 0.0), which)
        best[self.scene.obstacles] = math.inf
        return best, which

    def are_what_the_rows_say(self, i: Ints, partner: Ints, time: Floats) -> None:
        """Require every stored event to be a contact, or a wall, at exactly the time that the rows give."""
        walls, which = self.walls()
        is_pair = partner < self.n
        right = ~is_pair & (time == walls[i]) & (partner == which[i])
        pairs = np.flatnonzero(is_pair)
        a, b, when = i[pairs], partner[pairs], time[pairs]
        image = self.nearest_image(a, b, when)
        for steps in self.images_around():
            right[pairs] |= self.times(a, b, image + np.array(steps)) == when
        if not right.all():
            k = int(np.argmin(right))
            raise InvariantError(
                f"the event of {i[k]} with {partner[k]} is stored for {time[k]}, but their rows say otherwise"
            )

    # Pending events.

    def no_event_is_missing(self) -> None:
        """Compare the stored events with all coming ones."""
        if self.arrays.counter[self.at.WINDOW_BUCKETS]:
            self._windows()
        else:
            self._lists()

    def chain(self, slot: int) -> list[int]:
        """Entries of a bucket."""
        found, block = [], int(self.arrays.buckets[slot])
        while block >= 0:
            line = self.arrays.blocks[block * self.at.BLOCK : (block + 1) * self.at.BLOCK].tolist()
            found += line[1 : 1 + (line[0] & 7)]
            block = line[0] >> 3
        return found

    def _lists(self) -> None:
        at, arrays = self.at, self.arrays
        events = arrays.event[: self.n * at.EVENT].reshape(self.n, at.EVENT)
        time = arrays.event_float[: self.n * at.EVENT].reshape(self.n, at.EVENT)[:, at.TIME]
        partner = events[:, at.PARTNER]
        known = np.where((partner >= 0) & (partner < self.n), partner, 0)
        counts = (partner >= self.n) | (
            (partner >= 0) & (self.versions[known] == events[:, at.PARTNER_VERSION])
        )
        some = np.flatnonzero(counts)
        self.are_what_the_rows_say(some, partner[some], time[some])
        until = float(arrays.number[at.EPOCH_LENGTH])
        first, second, contact = self.all_contacts(until)
        for i, j, t in zip(first, second, contact, strict=True):
            _require(
                min(time[i], time[j]) <= t,
                f"particles {i} and {j} meet at {t}, but neither has an event before {min(time[i], time[j])}",
            )
        walls, _ = self.walls()
        _require(np.all((time <= walls) | (walls >= until)), "a wall comes before the next event")
        self._shells(time, until)
        self._calendar(time, events[:, at.STAMP], until)

    def _shells(self, time: Floats, until: float) -> None:
        """No particle exceeds the displacement threshold of its list before its next event."""
        at, dim = self.at, self.scene.dim
        centres = self.arrays.event_float[: self.n * at.EVENT].reshape(self.n, at.EVENT)
        centres = centres[:, at.REFERENCE : at.REFERENCE + dim]
        # Seen from a frame that falls since the epoch began.
        x, v = self.x, self.v
        if self.scene.falls:
            pull, t = self.scene.gravity, self.t[:, None]
            x, v = x - 0.5 * pull * t * t, v - pull * t
        there = x + v * (np.minimum(time, until) - self.t)[:, None]
        if self.scene.falls and self.scene.n_moving < self.scene.n:  # these do not fall
            there, _ = self._flown(np.arange(self.n), np.minimum(time, until))
        gone = np.sqrt(np.sum((there - centres) ** 2, axis=1))
        shell = float(self.arrays.number[at.DISPLACEMENT_THRESHOLD])
        slack = 1e-7 * shell + contact_tolerance(self.scene.box)
        far = int(np.argmax(gone))
        _require(
            gone[far] <= shell + slack,
            f"particle {far} exceeds the displacement threshold of its list before its next event",
        )

    def _calendar(self, time: Floats, stamp: Ints, until: float) -> None:
        """Each particle's event is in its bucket."""
        at, arrays = self.at, self.arrays
        count = arrays.counter
        cycle, bucket = int(count[at.BUCKETS]), int(count[at.BUCKET])
        places: dict[int, set[int]] = {}
        for entry in arrays.heap_entry[: int(count[at.HEAP_LENGTH])].tolist():
            places.setdefault(entry, set()).add(-1)
        for slot in range(cycle + 1):
            for tile in range(int(count[at.TILES]) if at.THREADS else 1):
                for entry in self.chain(tile * (cycle + 1) + slot):
                    if not at.THREADS or self._tile(entry >> 32) == tile:
                        places.setdefault(entry, set()).add(slot)
        for entry, slot in zip(arrays.waiting_entry.tolist(), arrays.waiting_slot.tolist(), strict=True):
            if slot >= 0:
                places.setdefault(entry, set()).add(slot)
        present = bucket & (cycle - 1) if at.THREADS else -1  # what is due is opened by each window anew
        for i in np.flatnonzero(time < until).tolist():
            due = int(max(time[i], 0.0) * float(arrays.number[at.INVERSE_WIDTH]))
            allowed = {present} if due <= bucket else {due & (cycle - 1)}
            if due >= (bucket // cycle + 1) * cycle:
                allowed.add(cycle)
            _require(
                places.get(i << 32 | int(stamp[i]), set()) & allowed,
                f"the next event of particle {i}, at {time[i]}, is not in the calendar where it should be",
            )

    def _tile(self, i: int) -> int:
        """Tile in which a particle is, where threads share the gas."""
        at = self.at
        return int(self.arrays.event[i * at.EVENT + at.TILE_WORD] >> at.TILE_SHIFT & at.TILE_BITS)

    def _contacts(self) -> tuple[list[tuple[int, int]], int, int, float]:
        """Return pending contacts and their buckets, -1 in the heap; the present bucket.

        Then how many buckets a window has, and a unit of time.
        """
        at, count = self.at, self.arrays.counter
        size, bucket = int(count[at.WINDOW_BUCKETS]), int(count[at.BUCKET])
        pending = [(c, -1) for c in self.arrays.heap_entry[: int(count[at.HEAP_LENGTH])].tolist()]
        for slot in range(bucket % size + 1, size):
            pending += [(c, slot) for c in self.chain(slot)]
        return pending, bucket, size, float(self.arrays.number[at.INVERSE_WIDTH])

    def _contacts_in_tiles(self) -> tuple[list[tuple[int, int]], int, int, float]:
        """Return the same where threads share the gas: all contacts are in the buckets of tiles."""
        at, count = self.at, self.arrays.counter
        size, tick, tables = int(count[at.BUCKET_TICKS]), int(count[at.TICK]), int(count[at.BUCKETS]) + 1
        pending = [
            (c, slot)
            for tile in range(int(count[at.TILES]))
            for slot in range(tick % size, size)
            for c in self.chain(tile * tables + slot)
        ]
        return pending, tick, size, float(self.arrays.number[at.TICKS])

    def _windows(self) -> None:
        at, arrays = self.at, self.arrays
        number = arrays.number
        pending, bucket, size, per_time = self._contacts_in_tiles() if at.THREADS else self._contacts()
        last = bucket - bucket % size + size - 1
        numbers = np.array([c for c, _ in pending], dtype=np.int64)
        entries = arrays.contacts.reshape(-1, at.CONTACT)[numbers]
        when, pair, versions = entries[:, 0].view(np.float64), entries[:, 1], entries[:, 2]
        i, j = pair >> 32, pair & STAMP_BITS
        version = self.versions.astype(np.int64)
        now = version[i] << 32
        now |= np.where(j < self.n, version[np.minimum(j, self.n - 1)] & STAMP_BITS, 0)
        valid = np.flatnonzero(now == versions)
        self.are_what_the_rows_say(i[valid], j[valid], when[valid])
        due = np.minimum((np.maximum(when, 0.0) * per_time).astype(np.int64), last)
        slots = np.array([slot for _, slot in pending], dtype=np.int64)
        wrong = (slots >= 0) & ((due < bucket) | (due % size != slots)) | (slots < 0) & (due > bucket)
        _require(not wrong[valid].any(), "a contact of this window is not in the bucket where it should be")
        noted = set(zip(i[valid].tolist(), j[valid].tolist(), when[valid].tolist(), strict=True))
        until = float(number[at.MIDDLE] + number[at.HALF_WINDOW])
        to_come = list(zip(*(part.tolist() for part in self.all_contacts(until)), strict=True))
        walls, which = self.walls()
        to_come += [(k, int(which[k]), float(walls[k])) for k in np.flatnonzero(walls < until).tolist()]
        for a, b, t in to_come:
            _require(
                (a, b, t) in noted,
                f"{a} and {b} meet at {t}, within this window, but that contact is not stored",
            )
