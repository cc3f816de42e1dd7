"""Reference solver: all pairs, every event, any number type. Slow and simple: the oracle of the tests.

To find the next event it looks at every pair in every image and at every wall, takes the earliest, and moves
all particles to its time. It has no cells, no lists, no queue and no stored events. With `mpmath.mpf` numbers
it has any precision wanted.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hardspheres.collision import contact_time, elastic_collision
from hardspheres.errors import SimulationError
from hardspheres.scene import Scene

__all__ = ["Event", "ReferenceSimulation"]

Number = Any
Collide = Callable[
    [Number, Sequence[Number], Number, Sequence[Number], Sequence[Number]], tuple[list[Number], list[Number]]
]


@dataclass(frozen=True)
class Event:
    """One event: its time and its two partners.

    Attributes
    ----------
    time : number
        Simulated time.
    first, second : int
        The particles, first < second; a wall counts as particle n + 2 axis + side (side 0 at 0, 1 at L).
    """

    time: Number
    first: int
    second: int


class ReferenceSimulation:
    """The dynamics of a scene by exhaustive search, O(N^2) for each event.

    Parameters
    ----------
    scene : Scene
        Initial state.
    number : callable
        Converts a float to the number type of the calculation: `float`, `mpmath.mpf`.
    sqrt : callable
        Square root for that type: `math.sqrt`, `mpmath.sqrt`.
    collide : callable
        The collision rule, with the signature of `hardspheres.collision.elastic_collision`. Tests insert a
        wrong one here.
    """

    def __init__(
        self,
        scene: Scene,
        number: Callable[[float], Number] = float,
        sqrt: Callable[[Number], Number] = math.sqrt,
        collide: Collide = elastic_collision,
    ) -> None:
        self.scene = scene
        self.sqrt = sqrt
        self.collide = collide
        self.time = number(0.0)
        self.collisions = 0
        self.positions = [[number(x) for x in row] for row in scene.positions.tolist()]
        self.velocities = [[number(v) for v in row] for row in scene.velocities.tolist()]
        self.radii = [number(r) for r in scene.radii.tolist()]
        self.masses = [number(m) for m in scene.masses.tolist()]
        self.box = [number(edge) for edge in scene.box.tolist()]
        self.gravity = [number(pull) for pull in scene.gravity.tolist()]
        self.still = [number(0.0)] * scene.dim
        self.periodic = [bool(p) for p in scene.periodic]

    def __repr__(self) -> str:
        """Return when it is, and of what."""
        when = f"time {float(self.time):.6g}, {self.collisions} collisions"
        return f"<ReferenceSimulation of {self.scene}: {when}>"

    @property
    def pulls(self) -> list[list[Number]]:
        """Acceleration of each particle; obstacles do not fall."""
        return [self.still if math.isinf(m) else self.gravity for m in self.scene.masses.tolist()]

    def separation(self, i: int, j: int) -> list[Number]:
        """x_i - x_j to the nearest image."""
        r = [x - y for x, y in zip(self.positions[i], self.positions[j], strict=True)]
        return [
            x - edge * math.floor(x / edge + 0.5) if periodic else x
            for x, edge, periodic in zip(r, self.box, self.periodic, strict=True)
        ]

    def pair_time(self, i: int, j: int, horizon: Number) -> Number:
        """Time until i and j touch, in any image; images that need longer than `horizon` are left out."""
        sigma2 = (self.radii[i] + self.radii[j]) ** 2
        near = self.separation(i, j)
        v = [a - b for a, b in zip(self.velocities[i], self.velocities[j], strict=True)]
        reach = [
            int(abs(u) * horizon / edge) + 1 if periodic else 0
            for u, edge, periodic in zip(v, self.box, self.periodic, strict=True)
        ]
        a = [k - m for k, m in zip(self.pulls[i], self.pulls[j], strict=True)]
        best = float("inf")
        for image in itertools.product(*(range(-k, k + 1) for k in reach)):
            r = [x + k * edge for x, k, edge in zip(near, image, self.box, strict=True)]
            if any(a):  # one of them falls
                best = min(best, curved_time(r, v, a, sigma2))
                continue
            b = sum(x * u for x, u in zip(r, v, strict=True))
            rr = sum(x * x for x in r)
            cross = sum((r[a] * v[c] - r[c] * v[a]) ** 2 for a, c in itertools.combinations(range(len(r)), 2))
            d = sum(u * u for u in v) * sigma2 - cross
            best = min(best, contact_time(b, rr - sigma2, self.sqrt(d) if d > 0 else 0.0))
        return best

    def wall_time(self, i: int, axis: int) -> tuple[Number, int]:
        """Time until i touches a wall of this axis, and on which side."""
        v, pull = self.velocities[i][axis], self.pulls[i][axis]
        if pull != 0:
            return min((self.fall_time(i, axis, side), side) for side in (0, 1))
        if self.periodic[axis] or v == 0:
            return float("inf"), 0
        side = int(v > 0)
        x = self.positions[i][axis]
        gap = self.box[axis] - self.radii[i] - x if side else x - self.radii[i]
        return max(gap, 0.0) / abs(v), side

    def fall_time(self, i: int, axis: int, side: int) -> Number:
        """Time until i, which falls, touches a wall: the roots of the quadratic as in a textbook."""
        x, v, pull = self.positions[i][axis], self.velocities[i][axis], self.pulls[i][axis]
        gap = self.box[axis] - self.radii[i] - x if side else x - self.radii[i]
        toward, pull = (v, pull) if side else (-v, -pull)
        square = toward * toward + 2 * pull * max(gap, 0.0)
        if square <= 0:
            return float("inf")
        roots = [(-toward + sign * self.sqrt(square)) / pull for sign in (-1, 1)]
        ahead = [t for t in roots if t >= 0 and toward + pull * t > 0]
        return min(ahead, default=float("inf"))

    def next_event(self, horizon: Number) -> tuple[Number, int, int]:
        """Earliest event within the horizon: time from now, lower and higher id; ties by the order of ids."""
        n = len(self.positions)
        found = (horizon, n, n)
        for i in range(n):
            for j in range(i + 1, n):
                found = min(found, (self.pair_time(i, j, horizon), i, j))
            for axis in range(len(self.box)):
                wait, side = self.wall_time(i, axis)
                found = min(found, (wait, i, n + 2 * axis + side))
        return found

    def fly(self, wait: Number) -> None:
        """Move all particles in free flight."""
        self.time = self.time + wait
        for x, v, pull in zip(self.positions, self.velocities, self.pulls, strict=True):
            x[:] = [a + b * wait + g * wait**2 / 2 for a, b, g in zip(x, v, pull, strict=True)]
            v[:] = [b + g * wait for b, g in zip(v, pull, strict=True)]

    def step(self) -> Event:
        """Go to the next event and execute it.

        Raises
        ------
        SimulationError
            When none comes within 1000 steps of the search, each of the time that the fastest particle needs
            for a box length.
        """
        n = len(self.positions)
        fastest = self.sqrt(max(sum(u * u for u in v) for v in self.velocities))
        horizon = min(self.box) / fastest if fastest > 0 else 1.0
        for _ in range(1000):
            wait, i, j = self.next_event(horizon)
            self.fly(wait)
            if i == n:
                continue
            if j >= n:
                axis = (j - n) // 2
                self.velocities[i][axis] = -self.velocities[i][axis]
            else:
                self.velocities[i], self.velocities[j] = self.collide(
                    self.masses[i],
                    self.velocities[i],
                    self.masses[j],
                    self.velocities[j],
                    self.separation(i, j),
                )
                self.collisions += 1
            return Event(self.time, i, j)
        raise SimulationError("no event within 1000 flights through the box; these particles may never meet")

    def events(self, count: int) -> Iterator[Event]:
        """Execute and yield so many events."""
        for _ in range(count):
            yield self.step()


def curved_time(r: list[Number], v: list[Number], a: list[Number], sigma2: Number) -> Number:
    """Time until |r + v t + a t^2/2|^2 comes down to sigma2: of all roots of the quartic the first such one.

    Eigenvalues give them roughly, and Newton's method, in the number type of the calculation, exactly.
    """

    def dot(one: list[Number], other: list[Number]) -> Number:
        return sum(x * y for x, y in zip(one, other, strict=True))

    quartic = [dot(a, a) / 4, dot(a, v), dot(v, v) + dot(a, r), 2 * dot(r, v), dot(r, r) - sigma2]
    if quartic[3] < 0 and quartic[4] <= 0:
        return 0.0
    slope = [k * c for k, c in zip((4, 3, 2, 1), quartic, strict=False)]
    best = float("inf")
    for root in np.roots([float(c) for c in quartic]):
        t = quartic[0] * 0 + float(root.real)
        if abs(root.imag) > 1e-5 * (1.0 + abs(root)):
            continue
        for _ in range(12):
            down = functools.reduce(lambda p, c: p * t + c, slope)
            t = t - functools.reduce(lambda p, c: p * t + c, quartic) / down if down != 0 else t
        if t > 0 and functools.reduce(lambda p, c: p * t + c, slope) < 0:
            best = min(best, t)
    return best
