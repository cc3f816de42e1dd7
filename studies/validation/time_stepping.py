"""Hard spheres by time steps: two common kinds of program, optimised as such programs are.

`BOUNCE`: move all particles by dt; pairs that then overlap and approach exchange momentum in place.
`BACK_UP`: the same, but such a pair is first moved back to its contact within the step, collides there, and
moves for the rest of the step.

Both collide by `hardspheres.collision`'s rule, so energy and momentum are as exact as the engine's; positions
and occurrence of collisions are not. Pairs that could overlap soon are found by cells and kept in a list
until a particle may have moved by half of the list's margin. They treat one kind of sphere in a periodic box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from hardspheres.cells import worst_overlap
from hardspheres.kernel.simd import jit, pointers
from hardspheres.kernel_cache import cache_folder, cached_in
from hardspheres.scene import kinetic_energy

__all__ = ["BACK_UP", "BOUNCE", "Count", "Stepper", "best_margin"]

FloatArray = NDArray[np.float64]

BOUNCE, BACK_UP = "bounce", "back-up"

part: Any = jit.called
pointer: Any = pointers.pointer
entry: Any = jit.entry_point

# Indices into the totals of `_advance`.
COLLISIONS, VIRIAL, MISSED, TESTS = range(4)
DONE, NO_ROOM, NO_MARGIN = range(3)  # what it returns
# Costs in ns that `best_margin` weighs: of a pair in the list and in the cells, and of a particle when lists
# are made.
LISTED, SEARCHED, SORTED = 1.5, 1.5, 40.0


@part
def _find_pairs(x, y, z, n, box, cells, reach, room, first, second, order, start, places):  # type: ignore[no-untyped-def]
    """List all pairs nearer than `reach`; return the numbers tried and listed, or -1 if too many.

    Particles are sorted into cells at least `reach` wide, so that those of three cells in a row along z are
    contiguous. With fewer than three cells along an axis every pair is tested.
    """
    lx, ly, lz = box
    cx, cy, cz = cells
    for i in range(n):
        x[i] -= lx * math.floor(x[i] / lx)
        y[i] -= ly * math.floor(y[i] / ly)
        z[i] -= lz * math.floor(z[i] / lz)
    reach2 = reach * reach
    found = 0
    if cx < 3 or cy < 3 or (cz < 3 and cz != 1):
        for i in range(n):
            for j in range(i + 1, n):
                dx = x[i] - x[j]
                dy = y[i] - y[j]
                dz = z[i] - z[j]
                dx -= lx * np.rint(dx / lx)
                dy -= ly * np.rint(dy / ly)
                dz -= lz * np.rint(dz / lz)
                if dx * dx + dy * dy + dz * dz < reach2:
                    if found == room:
                        return 0, -1
                    first[found] = i
                    second[found] = j
                    found += 1
        return n * (n - 1) // 2, found
    for k in range(cx * cy * cz + 1):
        start[k] = 0
    for i in range(n):
        a = min(int(x[i] / lx * cx), cx - 1)
        b = min(int(y[i] / ly * cy), cy - 1)
        c = min(int(z[i] / lz * cz), cz - 1)
        order[i] = (a * cy + b) * cz + c
        start[order[i]] += 1
    for k in range(1, cx * cy * cz + 1):
        start[k] += start[k - 1]
    for i in range(n - 1, -1, -1):
        slot = start[order[i]] - 1
        start[order[i]] = slot
        places[slot] = x[i]
        places[n + slot] = y[i]
        places[2 * n + slot] = z[i]
        places[4 * n + slot] = i
    near = 3 * n
    looked = 0
    for a in range(cx):
        for b in range(cy):
            for half in range(5):  # half of the columns around: each pair of columns once
                na, nb = (a + 1, b + half - 3) if half > 1 else (a, b + half)
                sx = sy = 0.0
                if na == cx:
                    na, sx = 0, lx
                if nb == cy:
                    nb, sy = 0, ly
                elif nb < 0:
                    nb, sy = cy - 1, -ly
                own, other = (a * cy + b) * cz, (na * cy + nb) * cz
                for c in range(cz):
                    for turn in range(3):  # the cells within the box as one run, then those around its ends
                        low, high, sz = max(c - 1, 0), min(c + 1, cz - 1), 0.0
                        if turn == 1:
                            if c > 0 or cz == 1 or half == 0:
                                continue
                            low, high, sz = cz - 1, cz - 1, -lz
                        elif turn == 2:
                            if c < cz - 1 or cz == 1:
                                continue
                            low, high, sz = 0, 0, lz
                        begin, end = start[other + low], start[other + high + 1]
                        for p in range(start[own + c], start[own + c + 1]):
                            if half == 0 and turn == 0:
                                begin = p + 1  # in the same column only later ones
                            px, py, pz = places[p] - sx, places[n + p] - sy, places[2 * n + p] - sz
                            hits = 0
                            for q in range(begin, end):
                                dx = px - places[q]
                                dy = py - places[n + q]
                                dz = pz - places[2 * n + q]
                                rr = dx * dx + dy * dy + dz * dz
                                places[near + q] = rr
                                hits += 1 if rr < reach2 else 0
                            looked += end - begin
                            if hits > 0:
                                if found + hits > room:
                                    return looked, -1
                                for q in range(begin, end):
                                    first[found] = int(places[4 * n + p])
                                    second[found] = int(places[4 * n + q])
                                    found += 1 if places[near + q] < reach2 else 0
    return looked, found


def _advance(state, box, cells, sigma, margin, dt, steps, back_up, audit, scratch, ids, total):  # type: ignore[no-untyped-def]
    """Do so many steps of dt and add to `total`. Returns DONE, NO_ROOM or NO_MARGIN.

    With `audit`, also count pairs that approached and passed each other within one step: they are found
    receding.
    """
    n = state.shape[1]
    room = ids.shape[1] - 1
    x, y, z = pointer(state[0]), pointer(state[1]), pointer(state[2])
    u, v, w = pointer(state[3]), pointer(state[4]), pointer(state[5])
    first, second = pointer(ids[0]), pointer(ids[1])
    places, order = pointer(scratch), pointer(ids[2])
    start = pointer(ids[3])
    lx, ly, lz = box
    ix, iy, iz = 1.0 / lx, 1.0 / ly, 1.0 / lz
    sigma2 = sigma * sigma
    pairs = 0
    fastest = 0.0
    flown = margin  # so that the first step makes a list
    for _ in range(steps):
        flown += 2.0 * math.sqrt(fastest) * dt
        if flown >= margin:
            looked, pairs = _find_pairs(
                x, y, z, n, box, cells, sigma + margin, room, first, second, order, start, places
            )
            if pairs < 0:
                return NO_ROOM
            fastest = 0.0
            for i in range(n):
                fastest = max(fastest, u[i] * u[i] + v[i] * v[i] + w[i] * w[i])
            flown = 2.0 * math.sqrt(fastest) * dt
            if flown > margin:
                return NO_MARGIN
            total[TESTS] += looked
        for i in range(n):
            x[i] += u[i] * dt
        for i in range(n):
            y[i] += v[i] * dt
        for i in range(n):
            z[i] += w[i] * dt
        total[TESTS] += pairs
        for p in range(pairs):
            i = first[p]
            j = second[p]
            dx = x[i] - x[j]
            dy = y[i] - y[j]
            dz = z[i] - z[j]
            dx -= lx * np.rint(dx * ix)
            dy -= ly * np.rint(dy * iy)
            dz -= lz * np.rint(dz * iz)
            rr = dx * dx + dy * dy + dz * dz
            if audit or rr < sigma2:
                du = u[i] - u[j]
                dv = v[i] - v[j]
                dw = w[i] - w[j]
                b = dx * du + dy * dv + dz * dw
                speed2 = du * du + dv * dv + dw * dw
                if b >= 0.0:
                    before = rr - 2.0 * b * dt + speed2 * dt * dt
                    if audit and b < speed2 * dt and before >= sigma2 and rr - b * b / speed2 < sigma2:
                        total[MISSED] += 1.0
                elif rr < sigma2:
                    back = 0.0
                    if back_up:
                        depth = sigma2 - rr
                        back = min(depth / (math.sqrt(b * b + speed2 * depth) - b), dt)
                        dx -= du * back
                        dy -= dv * back
                        dz -= dw * back
                        rr = dx * dx + dy * dy + dz * dz
                        b = dx * du + dy * dv + dz * dw
                    push = -b / rr  # of equal masses
                    total[COLLISIONS] += 1.0
                    total[VIRIAL] -= b
                    u[i] += push * dx
                    v[i] += push * dy
                    w[i] += push * dz
                    u[j] -= push * dx
                    v[j] -= push * dy
                    w[j] -= push * dz
                    if back_up:
                        x[i] += push * dx * back
                        y[i] += push * dy * back
                        z[i] += push * dz * back
                        x[j] -= push * dx * back
                        y[j] -= push * dy * back
                        z[j] -= push * dz * back
                    fastest = max(fastest, u[i] * u[i] + v[i] * v[i] + w[i] * w[i])
                    fastest = max(fastest, u[j] * u[j] + v[j] * v[j] + w[j] * w[j])
    return DONE


with cached_in(cache_folder("time_stepping")):
    advance: Any = entry(_advance)


def best_margin(density: float, dim: int, diameter: float, speed: float, dt: float) -> float:
    """Return by how much the list of pairs should reach beyond contact, so that a step costs least.

    Parameters
    ----------
    density : float
        Particles per volume.
    dim : int
        2 or 3.
    diameter : float
        Contact distance.
    speed : float
        Of the fastest particle.
    dt : float
        Length of a step.
    """
    margins = diameter * np.geomspace(0.01, 3.0, 60)
    ball = {2: math.pi, 3: 4.0 * math.pi / 3.0}[dim]
    listed = 0.5 * density * ball * (diameter + margins) ** dim
    searched = 0.5 * density * (3.0 * (diameter + margins)) ** dim
    steps = np.maximum(margins / (2.0 * speed * dt), 1.0)
    return float(margins[np.argmin(LISTED * listed + (SORTED + SEARCHED * searched) / steps)])


@dataclass(frozen=True)
class Count:
    """Counters of a stepper since `Stepper.reset`.

    Attributes
    ----------
    collisions : int
        Pair collisions.
    virial : float
        Sum of r.dp over them, [energy time].
    missed : int
        Pairs that passed each other undetected within one step, nearer than a diameter; 0 without audit.
    tests : int
        Pairs whose distance was computed.
    """

    collisions: int
    virial: float
    missed: int
    tests: int


class Stepper:
    """A gas simulated by time steps.

    Parameters
    ----------
    scene : Scene
        One kind of sphere or disc in a periodic box.
    dt : float
        Length of a step.
    method : str
        `BOUNCE` or `BACK_UP`.
    audit : bool
        Also count the pairs that pass through each other unseen; slower.

    Raises
    ------
    SceneError
        If the scene is a mixture or has walls.
    """

    def __init__(self, scene: hs.Scene, dt: float, method: str = BOUNCE, audit: bool = False) -> None:
        alike = np.ptp(scene.radii) == 0.0 and np.ptp(scene.masses) == 0.0
        if not (alike and scene.periodic.all()):
            raise hs.SceneError("time steps are for one kind of particle in a periodic box")
        if not 0.0 < dt < math.inf:
            raise hs.SceneError(f"a time step of {dt:g} must be a positive number")
        self.scene, self.dt, self.method, self.audit = scene, dt, method, audit
        self._state = np.zeros((6, scene.n))
        self._state[: scene.dim] = scene.positions.T
        self._state[3 : 3 + scene.dim] = scene.velocities.T
        self._box = np.ones(3)
        self._box[: scene.dim] = scene.box
        self._sigma = 2.0 * float(scene.radii[0])
        fastest = float(np.sqrt((scene.velocities**2).sum(axis=1).max()))
        self._margin = best_margin(scene.number_density, scene.dim, self._sigma, fastest, dt)
        self._room = 1024 + 8 * scene.n
        self._energy = scene.kinetic_energy
        self.reset()

    def reset(self) -> None:
        """Reset the counters."""
        self._total = np.zeros(4)

    def run(self, time: float) -> None:
        """Advance by a time, in steps of `dt`; the last one is shorter where they do not fill it."""
        whole = int(time / self.dt + 1e-6)
        self._step(whole, self.dt)
        rest = time - whole * self.dt
        if rest > 1e-6 * self.dt:
            self._step(1, rest)

    def _step(self, steps: int, dt: float) -> None:
        box = tuple(self._box.tolist())
        while steps > 0:
            cells = self._cells
            some = min(steps, max(1, 2_000_000 // self.scene.n))  # so that Ctrl-C works
            state, total = self._state.copy(), self._total.copy()
            ids = np.empty((4, max(self._room, self.scene.n, math.prod(cells)) + 2), np.int32)
            flags = (self.method == BACK_UP, self.audit, np.empty(5 * self.scene.n + 8), ids, total)
            outcome = advance(state, box, cells, self._sigma, self._margin, dt, some, *flags)
            if outcome == DONE:
                self._state, self._total = state, total
                steps -= some
            elif outcome == NO_ROOM:
                self._room *= 2
            else:
                self._margin *= 1.5

    @property
    def _cells(self) -> tuple[int, ...]:
        """Cells along each axis, each at least as wide as the cutoff of the list; about one per particle."""
        most = max(2 * self.scene.n, 27) ** (1.0 / self.scene.dim)
        cells = np.ones(3, np.int64)
        cells[: self.scene.dim] = np.maximum(
            np.minimum(self.scene.box / (self._sigma + self._margin), most), 1.0
        )
        return tuple(cells.tolist())

    @property
    def count(self) -> Count:
        """Counters since the last `reset`."""
        total = self._total
        mass = float(self.scene.masses[0])
        return Count(
            int(total[COLLISIONS]), float(total[VIRIAL]) * mass, int(total[MISSED]), int(total[TESTS])
        )

    @property
    def positions(self) -> FloatArray:
        """Positions, (N, d), wrapped or not."""
        return np.ascontiguousarray(self._state[: self.scene.dim].T)

    @property
    def velocities(self) -> FloatArray:
        """Velocities, (N, d)."""
        return np.ascontiguousarray(self._state[3 : 3 + self.scene.dim].T)

    @property
    def energy_drift(self) -> float:
        """Relative change of kinetic energy since the start."""
        return kinetic_energy(self.velocities, self.scene.masses) / self._energy - 1.0

    @property
    def worst_overlap(self) -> float:
        """Depth of the deepest overlap now, in diameters; 0 without overlaps."""
        positions, scene = np.mod(self.positions, self.scene.box), self.scene
        return max(worst_overlap(positions, scene.radii, scene.box, scene.periodic)[2], 0.0) / self._sigma
