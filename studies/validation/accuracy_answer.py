"""What exactness costs, in words: how long a time step may be for a given error, and what no time step reaches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Curve", "Need", "rounding_floor"]

SEEN = 3.0  # standard errors from which on an error counts as seen
SMALL = 0.2  # errors below follow a power of dt,
MODEL = 0.05  # to this relative accuracy


@dataclass(frozen=True)
class Need:
    """What a method needs for an error.

    Attributes
    ----------
    dt : float
        The time step.
    seconds : float
        Processor time per true collision.
    extrapolated : bool
        Whether the error of a step as short was not measured, or not told from noise.
    """

    dt: float
    seconds: float
    extrapolated: bool


@dataclass(frozen=True)
class Curve:
    """Error and cost of one method against the time step.

    Attributes
    ----------
    dt, error, noise, seconds : sequences of float
        Time steps, descending; errors without sign and their standard errors; processor time per true
        collision.
    """

    dt: Sequence[float]
    error: Sequence[float]
    noise: Sequence[float]
    seconds: Sequence[float]

    @property
    def seen(self) -> list[int]:
        """The points whose errors stand out of the noise, from the longest step to the first that does not."""
        chosen = []
        for k, (error, noise) in enumerate(zip(self.error, self.noise, strict=True)):
            if not error > SEEN * noise or error == 0.0:
                break
            chosen.append(k)
        return chosen

    @property
    def order(self) -> float:
        """The power of dt with which the error falls, see `_line`."""
        return self._line[0]

    @property
    def _line(self) -> tuple[float, float]:
        """Slope and intercept of the logarithms of small errors that are seen, the last four, weighted by how well."""
        chosen = [k for k in self.seen if self.error[k] < SMALL][-4:]
        if len(chosen) < 2:
            return math.nan, math.nan
        error, noise = np.array([(self.error[k], self.noise[k]) for k in chosen]).T
        weight = 1.0 / np.hypot(noise / error, MODEL)
        slope, intercept = np.polyfit(np.log([self.dt[k] for k in chosen]), np.log(error), 1, w=weight)
        return float(slope), float(intercept)

    def need(self, error: float) -> Need | None:
        """Return what an error no larger than this needs, None where too little is seen to tell.

        Between measured steps the logarithms are interpolated. Where the error drowns in noise, the longest
        step that is good enough for certain (to two standard errors) counts; beyond all of them the error
        follows `order` and the time 1/dt.
        """
        seen = self.seen
        for long, short in itertools.pairwise(seen):
            if self.error[long] >= error > self.error[short]:
                share = math.log(self.error[long] / error) / math.log(self.error[long] / self.error[short])
                return self._measured(self.dt[long] * (self.dt[short] / self.dt[long]) ** share)
        for k, dt in enumerate(self.dt):
            if self.error[k] + 2.0 * self.noise[k] <= error:
                return self._measured(dt)
        if not self.order > 0.1:
            return None
        slope, intercept = self._line
        dt = math.exp((math.log(error) - intercept) / slope)
        return Need(dt, self.seconds_at(dt), True)

    def _measured(self, dt: float) -> Need:
        return Need(dt, self.seconds_at(dt), False)

    def seconds_at(self, dt: float) -> float:
        """Return the processor time per true collision with this time step."""
        if dt < self.dt[-1]:
            return self.seconds[-1] * self.dt[-1] / dt
        x, y = np.log(self.dt[::-1]), np.log(self.seconds[::-1])
        return float(np.exp(np.interp(math.log(dt), x, y)))


def rounding_floor(error_per_dt: float, rounding_times_dt: float) -> tuple[float, float]:
    """Return the smallest of a dt + b/dt, and the dt where it is: each step more is a rounding more."""
    dt = math.sqrt(rounding_times_dt / error_per_dt)
    return 2.0 * error_per_dt * dt, dt
