"""Peers that run in turn with our engine: spheropack on the same gas, or our own engine on a plain one.

Speeds of a machine vary by a third from minute to minute, so only runs in turn are compared.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

import hardspheres as hs
from studies.benchmarks.clock import Ours, Timing, Windows
from studies.benchmarks.gas import Gas
from studies.benchmarks.peer import Spheropack, require_spheropack

__all__ = ["PEERS", "Rival", "require_peer"]

PEERS = ("spheropack", "plain")
DISCARDED = 2.0  # collisions per particle, from a state in equilibrium; spheropack's rate shows no start-up
DISCARDED_AT_LEAST = 5_000  # collisions
IDLE_SHARE = 3.0  # windows are at least this many times as long as a run for no time


def require_peer(name: str, gas: Gas) -> None:
    """Raise HardSpheresError if there is no such peer, it is not installed, or it cannot run this gas."""
    if name not in PEERS:
        raise hs.HardSpheresError(f"--against {name} is not known; it can be {' or '.join(PEERS)}")
    if name == "spheropack":
        require_spheropack()
        if gas.dim != 3 or not gas.periodic or (gas.diameter_ratio, gas.mass_ratio) != (1.0, 1.0):
            raise hs.HardSpheresError(
                "--against spheropack compares periodic gases of one kind of sphere in 3D; others run "
                "--against plain"
            )


class Rival:
    """A peer on the same gas, or our own engine on the plain one, to run in turn with us.

    Parameters
    ----------
    name : str
        One of `PEERS`.
    gas : Gas
        What is timed; for spheropack 3D, periodic, one species.
    simulation : Simulation
        That gas in equilibrium.
    seed : int
        Of the plain gas.
    """

    def __init__(self, name: str, gas: Gas, simulation: hs.Simulation, seed: int) -> None:
        self.runner: Spheropack | Ours
        if name == "plain":
            self.runner = Ours(_in_equilibrium(gas.plain, seed))
        else:
            tallies = simulation.tallies
            self.runner = Spheropack(simulation.to_scene(), tallies.collisions / tallies.time)
        self.windows, last = Windows(), Windows()
        half = max(round(DISCARDED * gas.n / 4), DISCARDED_AT_LEAST // 2)
        self.runner.run(half)
        last.time(self.runner, half)
        self.runner.reset()
        self._rate, self._idle = float(last.cpu_rates[0]), last.idle[0]

    def window(self, seconds: float) -> None:
        """Run for about so much processor time."""
        enough = max(seconds, IDLE_SHARE * self._idle)
        self.windows.time(self.runner, max(100, round(self._rate * enough)))

    def columns(self) -> dict[str, Any]:
        """Return the windows."""
        windows = self.windows
        columns = {"collisions": windows.collisions, "seconds": windows.wall, "cpu_seconds": windows.cpu}
        return {f"peer_{name}": column for name, column in columns.items()}

    def compare(self, ours: Windows) -> dict[str, Any]:
        """Return its rates, and the ratios of ours to them by processor time."""
        rates = self.windows.cpu_rates
        our, their = Timing.of(ours.cpu_rates), Timing.of(rates)
        return {
            "name": self.runner.name,
            "collisions": sum(self.windows.collisions),
            "idle_cpu_seconds_per_call": float(np.median(self.windows.idle)),
            "cpu": asdict(their),
            "wall": asdict(Timing.of(self.windows.wall_rates)),
            "compressibility_factor": self.runner.compressibility_factor,
            "ratio_of_medians": our.median / their.median,
            "ratio_of_bests": our.best / their.best,
            "ratio_quartiles": np.quantile(ours.cpu_rates / rates, [0.25, 0.75]).tolist(),
        }


def _in_equilibrium(gas: Gas, seed: int) -> hs.Simulation:
    """Return a gas in equilibrium."""
    simulation = hs.Simulation(gas.scene(seed))
    simulation.run(collisions=round(gas.discarded * gas.n / 2))
    return simulation
