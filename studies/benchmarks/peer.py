"""spheropack, another event-driven engine, installed beside ours for comparison.

spheropack (PyPI, C++; `rejection_free.System` with `HardSpheres`) is event-driven as ours: free flight
between elastic collisions of equal masses.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import hardspheres as hs

__all__ = ["Spheropack", "require_spheropack"]


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
    """The peer, on the same gas.

    Parameters
    ----------
    scene : Scene
        Initial state: 3D, periodic, one species, in equilibrium.
    collision_rate : float
        Expected pair collisions of the whole gas per unit time; the peer runs for a time, not for a number of
        collisions.

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
        """Start counting for the compressibility factor."""
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
