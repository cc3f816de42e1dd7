"""When `run(collisions=...)` gives up: where no collision can come, or none has come for very long.

Speeds stay as they are until two particles collide, so that only the scene and the rows decide, wherever a
run began, stopped, or was loaded.
"""

import numpy as np
from numpy.typing import NDArray

from hardspheres.engine import Engine
from hardspheres.errors import SimulationError
from hardspheres.scene import Scene
from hardspheres.tuning import collision_rate, power_of_two_below

__all__ = ["Patience"]

PATIENCE = 1000.0  # expected times to the next collision that may pass without one,
OBSTACLES_OVERLAP = 1000.0  # times as many with obstacles: the estimate takes none for covered by others
LEAST_PATIENCE = 10  # but not fewer epochs
ROWS_BETWEEN_CHECKS = 1 << 16  # it is checked after as many epochs as take so many rows into the next one,
MOST_BETWEEN_CHECKS = 1 << 12  # but no more than these


class Patience:
    """Knows when the collisions of a scene have been awaited for long enough.

    Parameters
    ----------
    scene : Scene
        Where the simulation started.

    Attributes
    ----------
    stride : int
        Epochs between two checks.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        most = max(ROWS_BETWEEN_CHECKS / scene.n, 1)
        self.stride = int(power_of_two_below(min(most, MOST_BETWEEN_CHECKS)))
        self._moving = False  # whether a particle is known to move relative to another

    def require_motion(self, engine: Engine) -> None:
        """Raise SimulationError where it is certain that no two particles will ever collide.

        Collisions and walls keep the energy of relative motion, so a gas that moves now always will.
        """
        if self._moving:
            return
        if self.scene.n == 1:
            raise SimulationError("no collision is to come: there is one particle only; use run(time=...)")
        if self.scene.falls:  # those that fall together are parted by the floor
            self._moving = True
            return
        v = _velocities(engine)
        drifts = self.scene.periodic & (self.scene.n_moving == self.scene.n)
        if not np.any(np.where(drifts, v - v[0], v)):
            raise SimulationError(
                "no collision is to come: no particle moves relative to another; give them velocities, or "
                "use run(time=...)"
            )
        self._moving = True

    def next_check(self, engine: Engine) -> int:
        """First multiple of the stride among the coming epochs at whose beginning patience may have ended."""
        at, arrays = engine.layout, engine.arrays
        begun = int(arrays.number[at.NOW] > 0.0)
        epoch = max(
            int(arrays.counter[at.EPOCH]) + begun, int(arrays.counter[at.LAST_PAIR_EPOCH]) + LEAST_PATIENCE
        )
        return -(-epoch // self.stride) * self.stride

    def check(self, engine: Engine) -> None:
        """Raise SimulationError at the beginning of an epoch if no pair has collided for far too long."""
        at, count = engine.layout, engine.arrays.counter
        idle = int(count[at.EPOCH]) - int(count[at.LAST_PAIR_EPOCH])
        if idle < LEAST_PATIENCE:
            return
        patience = PATIENCE * (OBSTACLES_OVERLAP if self.scene.n_moving < self.scene.n else 1.0)
        if idle * engine.length * collision_rate(self.scene, _velocities(engine)) > patience:
            raise SimulationError(
                f"no two particles met for {idle * engine.length:.3g} time units, over {patience:.0f} times "
                "the expected time to a collision; these particles may never meet: use run(time=...)"
            )


def _velocities(engine: Engine) -> NDArray[np.float64]:
    rows: NDArray[np.float64] = engine.rows
    return rows[:, engine.layout.V : engine.layout.V + engine.scene.dim]
