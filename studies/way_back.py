"""The way back of a gas after all its velocities were reversed, and how long it is that of the way there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.brief import brief
from analysis.expansion import cell_counts, in_upper_half
from analysis.statistics import (
    TheoryCheck,
    deviates,
    estimate_from_jackknife,
    estimate_from_replicas,
    replica_mean,
)
from analysis.theory.lyapunov import FOLDS, LOST, UNCERTAINTY
from hardspheres.scene import to_nearest_image
from studies.answer import Column, Curves, number
from studies.half_full import AXIS, HalfFull
from studies.running.resuming import until

__all__ = ["WayBack", "came_back", "retraced", "returns", "way_back"]

FloatArray = NDArray[np.float64]

RETURNED = 1e-3  # diameters that count as back at the start


@dataclass
class WayBack:
    """One gas on its way there, and back again after all its velocities were reversed, several times.

    Attributes
    ----------
    ahead, running : Simulation or None
        The gas on its way there, and on the way back that it is on now.
    there : list of (N, d) array
        Positions on the way there, at each of the stops, as long as they are needed.
    times, reached : lists of float
        Of the stops: time and collisions per particle since the opening.
    turned : list of int
        The stops at which velocities were reversed.
    s, crossed, distance : lists of list of float
        Of each way back, at each stop again from the last on: collisions per particle since the reversal,
        share of the followed particles in the upper half, root mean square distance from where they were.
    counts : list of array
        Followed particles in each cell at the end of each way back, when all should be where they started.
    """

    ahead: hs.Simulation | None = None
    running: hs.Simulation | None = None
    there: list[FloatArray] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    reached: list[float] = field(default_factory=list)
    turned: list[int] = field(default_factory=list)
    s: list[list[float]] = field(default_factory=list)
    crossed: list[list[float]] = field(default_factory=list)
    distance: list[list[float]] = field(default_factory=list)
    counts: list[FloatArray] = field(default_factory=list)

    __repr__ = brief

    def go(self, stops: Mapping[int, bool], cells: int) -> Iterator[None]:
        """Go on, from stop to stop and back; pause wherever this may be saved.

        Parameters
        ----------
        stops : mapping of int to bool
            Pair collisions of each stop, 0 first, and whether velocities are reversed there.
        cells : int
            Along x, for `counts`.
        """
        for goal, reverse in [*stops.items()][len(self.times) - (self.running is not None) :]:
            if self.running is None:
                assert self.ahead is not None
                yield from until(self.ahead, goal)
                self.there.append(self.ahead.positions)
                self.times.append(self.ahead.time)
                self.reached.append(self.ahead.collisions_per_particle)
                if reverse:
                    self.turn(self.ahead.to_scene())
            while self.running is not None:
                self.look(cells)
                yield
            yield
        self.ahead, self.there = None, []

    def turn(self, scene: hs.Scene) -> None:
        """Reverse all velocities of a gas, in a gas of its own."""
        self.running = hs.Simulation(scene.with_state(scene.positions, -scene.velocities))
        self.turned.append(len(self.times) - 1)
        for each in (self.s, self.crossed, self.distance):
            each.append([])

    def look(self, cells: int) -> None:
        """Go back to the next stop, and take in where everybody is."""
        assert self.running is not None
        stop = len(self.times) - 1 - len(self.s[-1])
        (frame,) = self.running.frames(times=[self.times[-1] - self.times[stop]])
        labels = frame.scene.labels
        followed = frame.positions if labels is None else frame.positions[labels == 0]
        counts = cell_counts(followed, frame.scene, AXIS, cells)
        off = to_nearest_image(frame.positions - self.there[stop], frame.scene)
        self.s[-1].append(frame.collisions_per_particle)
        self.crossed[-1].append(float(in_upper_half(counts) / counts.sum()))
        self.distance[-1].append(math.sqrt(float(np.mean(np.sum(off * off, axis=1)))))
        if stop == 0:
            self.counts.append(counts)
            self.running = None


def retraced(gas: HalfFull, back: Sequence[WayBack]) -> list[TheoryCheck]:
    """Return for how many collisions per particle the last way back is that there, where it is not for all.

    Until the root mean square distance from it is a tenth of a diameter, between two stops on the logarithm.
    """
    quantity, found = "collisions per particle retraced", []
    for one in back:
        s, distance = np.array(one.s[-1]), np.array(one.distance[-1])
        beyond = int(np.argmax(distance > LOST))
        if beyond > 0:
            low, high = _log_off(gas, distance[beyond - 1 : beyond + 1])
            share = (math.log(LOST) - low) / (high - low)
            found.append(s[beyond - 1] + share * (s[beyond] - s[beyond - 1]))
    if len(found) < len(back):  # some came all the way back
        return []
    expected = gas.horizon if math.isfinite(float(gas.horizon.value)) else None
    return [number(quantity, estimate_from_replicas(found), "Lyapunov exponent", expected)]


def returns(gas: HalfFull, back: Sequence[WayBack]) -> tuple[Curves, list[str]]:
    """Return how much came back from each reversal, and a sentence where it should have and did not."""
    time, s = _turned(back)
    count = len(s)
    left_then = replica_mean([[1.0 - one.crossed[k][0] for k in range(count)] for one in back])
    left = replica_mean([[1.0 - one.crossed[k][-1] for k in range(count)] for one in back])
    log_off, log_error = replica_mean(
        [[_log_off(gas, one.distance[k][-1]) for k in range(count)] for one in back]
    )
    off = np.exp(log_off)
    horizon = float(gas.horizon.value)
    growth = s / horizon * math.log(LOST / gas.rounding)
    small = s < horizon
    # two e-folds of the first roundings, 10 % of the exponent, 20 % where it is that of a denser gas at first
    doubt = np.hypot(FOLDS, UNCERTAINTY * (1.0 if gas.mix else 2.0) * growth)
    log_expected = math.log(gas.rounding) + growth
    z = deviates(np.where(small, log_off - log_expected, np.nan), log_error, doubt, len(back) - 1.0)
    sure = horizon - 3.0 * float(gas.horizon.uncertainty)
    failures = [
        f"reversed at s = {s[k]:.3g}, the gas is {off[k]:.1e} diameters from its start on return"
        for k in range(count)
        if s[k] < sure and off[k] > RETURNED
    ]
    entropies = [
        estimate_from_jackknife(np.array([one.counts[k] for one in back]), _entropy) for k in range(count)
    ]
    entropy, entropy_error = (
        np.array([getattr(each, name) for each in entropies]) for name in ("value", "standard_error")
    )
    columns = {
        "left": Column(*left_then, title="left"),
        "left_on_return": Column(*left, title="on return"),
        "entropy_on_return": Column(entropy, entropy_error, title="S"),
        "off": Column(off, off * log_error, np.where(small, np.exp(log_expected), np.nan), z=z, title="off"),
    }
    return Curves({"reversed": s, "t": time / gas.half}, columns, printed=True), failures


def came_back(returns: Curves) -> str:
    """Return in a sentence how much of the gas was in the left half again."""
    left = returns.columns["left_on_return"].value
    told = [
        f"{100 * share:.3g} % at s = {s:.3g}" for s, share in zip(returns.axes["reversed"], left, strict=True)
    ]
    return f"in the left half again, by collisions per particle at the reversal: {', '.join(told)}"


def _log_off(gas: HalfFull, distance: Any) -> Any:
    """Return logarithms of distances; less than a rounding of the box, or nothing, counts as one."""
    return np.log(np.maximum(distance, gas.rounding))


def _turned(back: Sequence[WayBack]) -> tuple[FloatArray, FloatArray]:
    """Return mean time of each reversal, and collisions per particle by then: those of all ways back."""
    stops = back[0].turned
    return np.mean([one.times for one in back], axis=0)[stops], np.array(back[0].reached)[stops]


def _entropy(counts: FloatArray) -> float:
    return float(theory.spread_entropy(counts))


def way_back(gas: HalfFull, back: Sequence[WayBack]) -> Curves:
    """Return each way back, stop by stop: the time since the opening that is retraced, and how well."""
    times = np.mean([one.times for one in back], axis=0) / gas.half
    parts = []
    for k, (stop, s) in enumerate(zip(back[0].turned, _turned(back)[1], strict=True)):
        since, crossed, distance = (
            np.array([getattr(one, name)[k] for one in back]) for name in ("s", "crossed", "distance")
        )
        log_off, log_error = replica_mean(_log_off(gas, distance))
        off = np.exp(log_off)
        rows = (np.full(stop + 1, s), times[stop::-1], since.mean(axis=0))
        parts.append([*rows, *replica_mean(crossed), off, off * log_error])
    reversed_at, retraced, since, share, error, off, off_error = (
        np.concatenate(rows) for rows in zip(*parts, strict=True)
    )
    axes = {"reversed": reversed_at, "t_retraced": retraced, "s_since": since}
    return Curves(axes, {"right": Column(share, error), "off": Column(off, off_error)})
