"""spheropack, the engine that anyone can install beside ours, and what it tells about the fastest published code.

spheropack (PyPI, C++; `rejection_free.System` with `HardSpheres`) moves hard spheres from collision to collision as
we do: particles fly straight, every contact is an elastic collision of equal masses.

The fastest published code is Smallenburg's C (2022, doi 10.1140/epje/s10189-022-00180-8). It is no package, so
its speed here is estimated: the better of its variants was measured once beside spheropack, in turn on one core, at N =
4000, and was `C_OVER_SPHEROPACK` times as fast; for other N that is scaled by `C_SPEED`, its own rates of
that day. At packing fraction 0.001 it runs at 0.18 times its rate at 0.01. Such ratios carry over between machines to
about 15 %, to 20 % at a million particles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

import hardspheres as hs

__all__ = ["YARDSTICK_N", "Spheropack", "Yardstick", "require_spheropack", "yardstick"]

YARDSTICK_N = 4000

C_OVER_SPHEROPACK = {0.01: 3.4, 0.1: 4.0, 0.3: 2.65, 0.49: 5.6}
"""Rate of the C code over spheropack's, N = 4000, by packing fraction."""

C_SPEED = {
    0.01: {500: 0.256, 4000: 0.261, 32_000: 0.169, 256_000: 0.093, 1_048_576: 0.079},
    0.1: {500: 0.716, 4000: 0.767, 32_000: 0.555, 256_000: 0.352, 1_048_576: 0.215},
    0.3: {500: 0.602, 4000: 0.647, 32_000: 0.476, 256_000: 0.293, 1_048_576: 0.206},
    0.49: {500: 1.033, 4000: 1.192, 32_000: 0.879, 256_000: 0.543, 1_048_576: 0.341},
}
"""Million collisions per second of the C code, by packing fraction and N, all measured on one machine."""

C_DILUTE = 0.18  # its rate at packing fraction 0.001 over that at 0.01, N = 4000


@dataclass(frozen=True)
class Yardstick:
    """Where to run spheropack so that the rate of the C code follows, and by which factor.

    Attributes
    ----------
    packing_fraction : float
        Of the yardstick, at N = 4000.
    factor : float
        Rate of the C code at the state in question over that of spheropack at the yardstick.
    """

    packing_fraction: float
    factor: float


def yardstick(n: int, packing_fraction: float) -> Yardstick | None:
    """Return the yardstick of a 3D periodic state of one species, None where the C code was not measured."""
    if (n, packing_fraction) == (YARDSTICK_N, 0.001):
        return Yardstick(0.01, C_DILUTE * C_OVER_SPHEROPACK[0.01])
    speeds = C_SPEED.get(packing_fraction, {})
    if n not in speeds:
        return None
    return Yardstick(packing_fraction, C_OVER_SPHEROPACK[packing_fraction] * speeds[n] / speeds[YARDSTICK_N])


def require_spheropack() -> Any:
    """Return the peer's module.

    Raises
    ------
    HardSpheresError
        If it is not installed.
    """
    try:
        import spheropack
        import spheropack.rejection_free
    except ImportError:
        raise hs.HardSpheresError(
            "spheropack is not installed; install it with pip install 'hardspheres[bench]'"
        ) from None
    return spheropack


class Spheropack:
    """The peer at work on the same gas.

    Parameters
    ----------
    scene : Scene
        Where to start: 3D, periodic, one species, in equilibrium.
    collision_rate : float
        Expected pair collisions of the whole gas per unit time; the peer runs for times, not for collisions.

    Raises
    ------
    HardSpheresError
        If the peer is missing.
    """

    def __init__(self, scene: hs.Scene, collision_rate: float) -> None:
        module = require_spheropack()
        rf = module.rejection_free
        self.name = f"spheropack {getattr(module, '__version__', '')}".strip()
        self.diameter = 2.0 * float(scene.radii[0])
        self.mass = float(scene.masses[0])
        self.collision_rate = collision_rate
        self.system: Any = rf.System(
            np.array(scene.positions),
            box=module.PeriodicBox(scene.box.tolist()),
            potential=rf.HardSpheres(self.diameter),
            seed=1,
        )
        self.system.set_velocities(np.array(scene.velocities))
        self.reset()

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""
        return int(self.system.n_reflections)

    def run(self, collisions: int) -> None:
        """Run for the time in which about so many pair collisions happen."""
        self.system.run(collisions / self.collision_rate)

    def idle(self) -> None:
        """Run for no time: every run begins with a new search of all neighbours."""
        self.system.run(0.0)

    def reset(self) -> None:
        """Begin to count for the compressibility factor."""
        self._since = (self.collisions, float(self.system.time))

    @property
    def compressibility_factor(self) -> float:
        """Z = 1 + (sigma/2d) sqrt(pi m/kT) nu from the collisions per particle and time nu since `reset`.

        The same relation as in `analysis.theory.collision_rate`; exact in equilibrium, for many particles.
        """
        collisions, time = self._since
        v = np.asarray(self.system.velocities)
        n = len(v)
        kT = self.mass * float(np.sum((v - v.mean(axis=0)) ** 2)) / (3 * (n - 1))
        nu: float = 2.0 * (self.collisions - collisions) / n / (float(self.system.time) - time)
        return 1.0 + self.diameter / 6.0 * math.sqrt(math.pi * self.mass / kT) * nu
