"""Who runs in turn with us: spheropack on the same gas and on that of the yardstick, or our own engine on a plain gas.

Rates of a machine drift by a third from minute to minute, so only what ran in turn is compared.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

import hardspheres as hs
from studies.benchmarks.clock import Ours, Timing, Windows
from studies.benchmarks.gas import Gas
from studies.benchmarks.peer import YARDSTICK_N, Spheropack, require_spheropack, yardstick

__all__ = ["PEERS", "Rivals", "require_peer"]

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


@dataclass
class _Rival:
    """A runner, its rough rate, the seconds of a run that does nothing, and its windows."""

    runner: Spheropack | Ours
    rate: float
    idle: float
    windows: Windows = field(default_factory=Windows)

    @classmethod
    def of(cls, runner: Spheropack | Ours, n: int) -> _Rival:
        """Return a runner of a gas in equilibrium, its start-up done."""
        last = Windows()
        half = max(round(DISCARDED * n / 4), DISCARDED_AT_LEAST // 2)
        runner.run(half)
        last.time(runner, half)
        runner.reset()
        return cls(runner, float(last.cpu_rates[0]), last.idle[0])


class Rivals:
    """The peer, and the peer on the yardstick's gas, each to run in turn with us.

    Parameters
    ----------
    name : str
        One of `PEERS`.
    gas : Gas
        What is timed; for spheropack 3D, periodic, one species.
    simulation : Simulation
        That gas in equilibrium.
    seed : int
        Of other gases.
    same : bool
        Whether the peer runs a gas of as many particles at all; a million take spheropack minutes.
    """

    def __init__(self, name: str, gas: Gas, simulation: hs.Simulation, seed: int, same: bool) -> None:
        self.name, self.stick = name, None
        self.peer: _Rival | None = None
        self.measure: _Rival | None = None
        if name == "plain":
            self.peer = _Rival.of(Ours(_in_equilibrium(gas.plain, seed)), gas.n)
            return
        self.stick = yardstick(gas.n, gas.packing_fraction)
        if same:
            self.peer = _spheropack(simulation)
        if self.stick is not None:
            of_stick = Gas(YARDSTICK_N, packing_fraction=self.stick.packing_fraction)
            here = same and gas.plain == of_stick
            self.measure = self.peer if here else _spheropack(_in_equilibrium(of_stick, seed))

    def window(self, seconds: float) -> None:
        """Run each for about so much processor time."""
        for rival in {id(rival): rival for rival in (self.peer, self.measure) if rival is not None}.values():
            enough = max(seconds, IDLE_SHARE * rival.idle)
            rival.windows.time(rival.runner, max(100, round(rival.rate * enough)))

    def columns(self) -> dict[str, Any]:
        """Return the windows of the same gas."""
        if self.peer is None:
            return {}
        windows = self.peer.windows
        columns = {"collisions": windows.collisions, "seconds": windows.wall, "cpu_seconds": windows.cpu}
        return {f"peer_{name}": column for name, column in columns.items()}

    def compare(self, ours: Windows) -> dict[str, Any]:
        """Return the ratios of our rates to theirs, by processor time: the peer's, and those estimated for the C code."""
        our = Timing.of(ours.cpu_rates)
        result: dict[str, Any] = {"name": self.name, "cpu": None}
        if self.peer is not None:
            rates = self.peer.windows.cpu_rates
            their = Timing.of(rates)
            result |= {
                "name": self.peer.runner.name,
                "collisions": sum(self.peer.windows.collisions),
                "idle_cpu_seconds_per_call": float(np.median(self.peer.windows.idle)),
                "cpu": asdict(their),
                "wall": asdict(Timing.of(self.peer.windows.wall_rates)),
                "compressibility_factor": self.peer.runner.compressibility_factor,
                "ratio_of_medians": our.median / their.median,
                "ratio_of_bests": our.best / their.best,
                "ratio_quartiles": np.quantile(ours.cpu_rates / rates, [0.25, 0.75]).tolist(),
            }
        result["fastest_published"] = None
        if self.stick is not None and self.measure is not None:
            at, factor = Timing.of(self.measure.windows.cpu_rates), self.stick.factor
            result["fastest_published"] = {
                "estimated": True,
                "doi": "10.1140/epje/s10189-022-00180-8",
                "yardstick_packing_fraction": self.stick.packing_fraction,
                "factor": factor,
                "collisions_per_second": factor * at.median,
                "ratio_of_medians": our.median / (factor * at.median),
                "ratio_of_bests": our.best / (factor * at.best),
            }
        return result


def _spheropack(simulation: hs.Simulation) -> _Rival:
    """Return spheropack on a gas where the simulation has left it."""
    tallies = simulation.tallies
    return _Rival.of(Spheropack(simulation.to_scene(), tallies.collisions / tallies.time), simulation.scene.n)


@lru_cache(maxsize=8)
def _in_equilibrium(gas: Gas, seed: int) -> hs.Simulation:
    """Return a gas in equilibrium."""
    simulation = hs.Simulation(gas.scene(seed))
    simulation.run(collisions=round(gas.discarded * gas.n / 2))
    return simulation
