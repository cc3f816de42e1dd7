"""The true trajectory to fifty digits: the reference solver, with candidate pairs from double precision.

Every number that enters the trajectory is computed with `mpmath` and 50 digits. Double precision is used only
to exclude pairs that cannot be next: those whose estimated contact is well after the earliest one.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from hardspheres.collision import contact_time
from hardspheres.reference import ReferenceSimulation

__all__ = ["DIGITS", "Oracle"]

FloatArray = NDArray[np.float64]

DIGITS = 50
# relative: far above the error of contact times in double precision, except for grazing collisions
ROUNDING = 1e-9
GRAZING = 1e-12  # discriminants below this share of v^2 sigma^2 are not trusted


class Oracle(ReferenceSimulation):
    """`ReferenceSimulation` with 50 digits for equal particles in a periodic box, for many collisions.

    Parameters
    ----------
    scene : Scene
        One kind of particle; every axis periodic and longer than two diameters.

    Raises
    ------
    SceneError
        For any other scene.
    """

    def __init__(self, scene: hs.Scene) -> None:
        alike = np.ptp(scene.radii) == 0.0 and np.ptp(scene.masses) == 0.0
        if not (alike and scene.periodic.all() and scene.box.min() > 4.01 * scene.radii[0]):
            raise hs.SceneError(
                "the oracle follows one kind of particle in a periodic box longer than two diameters; ask "
                "for more particles"
            )
        with mpmath.workdps(DIGITS):
            super().__init__(scene, mpmath.mpf, mpmath.sqrt)
        self._pairs = np.triu_indices(scene.n, 1)
        self._sigma = 2.0 * float(scene.radii[0])
        self._box = scene.box

    def advance(self, collisions: int) -> None:
        """Follow so many pair collisions."""
        with mpmath.workdps(DIGITS):
            for _ in range(collisions):
                self.step()

    def between(self) -> float:
        """Return a time between the last collision and the next one."""
        with mpmath.workdps(DIGITS):
            return float(self.time + self.next_event(None)[0] / 2)

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities, (N, d), at a time between the last and the next collision."""
        with mpmath.workdps(DIGITS):
            wait = mpmath.mpf(time) - self.time
            rows = zip(self.positions, self.velocities, strict=True)
            positions = [[float(x + v * wait) for x, v in zip(*row, strict=True)] for row in rows]
        return np.array(positions), np.array(self.velocities, dtype=float)

    def next_event(self, horizon: Any) -> tuple[Any, int, int]:
        """Return the earliest event within the time in which pairs can meet in their nearest image only."""
        n = len(self.positions)
        x, v = np.array(self.positions, dtype=float), np.array(self.velocities, dtype=float)
        fastest = 2.0 * math.sqrt(float((v * v).sum(axis=1).max()))
        safe = 0.999 * (0.5 * float(self._box.min()) - self._sigma) / fastest
        i, j = self._pairs
        near = x[i] - x[j]
        near -= self._box * np.rint(near / self._box)
        waits = self._estimate(near, v[i] - v[j])
        found: tuple[Any, int, int] = (mpmath.mpf(safe), n, n)
        for pair in np.flatnonzero(
            waits <= min(float(waits.min()), safe) * (1.0 + ROUNDING) + ROUNDING * safe
        ):
            a, b = int(i[pair]), int(j[pair])
            found = min(found, (self._contact(a, b), a, b))
        return found

    def _estimate(self, r: FloatArray, u: FloatArray) -> FloatArray:
        """Return contact times in double precision, slightly early for grazing pairs."""
        b, rr, speed2 = (r * u).sum(axis=1), (r * r).sum(axis=1), (u * u).sum(axis=1)
        axes = itertools.combinations(range(r.shape[1]), 2)
        cross2 = sum((r[:, a] * u[:, c] - r[:, c] * u[:, a]) ** 2 for a, c in axes)
        d = speed2 * self._sigma**2 - cross2
        margin = GRAZING * speed2 * rr
        meets = (b < 0.0) & (d > -margin)
        gap = np.maximum(rr - self._sigma**2, 0.0)
        wait = np.where(meets, gap / np.where(meets, np.sqrt(np.maximum(d, 0.0)) - b, 1.0), np.inf)
        return np.where(np.abs(d) < margin, wait * (1.0 - 1e-5), wait)

    def _contact(self, i: int, j: int) -> Any:
        """Time until i touches the nearest image of j, with all digits."""
        r = self.separation(i, j)
        v = [a - b for a, b in zip(self.velocities[i], self.velocities[j], strict=True)]
        sigma2 = (self.radii[i] + self.radii[j]) ** 2
        b = sum(x * u for x, u in zip(r, v, strict=True))
        rr = sum(x * x for x in r)
        cross = sum((r[a] * v[c] - r[c] * v[a]) ** 2 for a, c in itertools.combinations(range(len(r)), 2))
        d = sum(u * u for u in v) * sigma2 - cross
        return contact_time(b, rr - sigma2, self.sqrt(d) if d > 0 else 0.0)
