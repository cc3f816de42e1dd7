"""The cost of exactness: the time step needed for a given error, and the errors that no step reaches."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Curve", "Need", "rounding_floor"]

SEEN = 3.0  # standard errors from which on an error is significant
SMALL = 0.2  # errors below follow a power of dt,
MODEL = 0.05  # to this relative accuracy


@dataclass(frozen=True)
class Need:
    """The time step and cost that a method needs for a given error.

    Attributes
    ----------
    dt : float
        The time step.
    seconds : float
        Processor time per true collision.
    extrapolated : bool
        Whether the error of so short a step was not measured, or not significant.
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
        """The points with significant errors, from the longest step to the first that is not significant."""
        chosen = []
        for k, (error, noise) in enumerate(zip(self.error, self.noise, strict=True)):
            if not error > SEEN * noise or error == 0.0:
                break
            chosen.append(k)
        return chosen

    @property
    def order(self) -> float:
        """The order of convergence, the power of dt of the error; see `_line`."""
        return self._line[0]

    @property
    def _line(self) -> tuple[float, float]:
        """Slope and intercept of the logarithms of the last four small significant errors, weighted."""
        chosen = [k for k in self.seen if self.error[k] < SMALL][-4:]
        if len(chosen) < 2:
            return math.nan, math.nan
        error, noise = np.array([(self.error[k], self.noise[k]) for k in chosen]).T
        weight = 1.0 / np.hypot(noise / error, MODEL)
        slope, intercept = np.polyfit(np.log([self.dt[k] for k in chosen]), np.log(error), 1, w=weight)
        return float(slope), float(intercept)

    def need(self, error: float) -> Need | None:
        """Return the need for an error no larger than this; None where too few errors are significant.

        Between measured steps the logarithms are interpolated. Where the error is not significant, the
        longest step that certainly suffices (to two standard errors) is taken; below the shortest measured
        step, the error follows `order` and the time 1/dt.
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
    """Return the smallest of a dt + b/dt, and the dt where it is: each further step adds a rounding."""
    dt = math.sqrt(rounding_times_dt / error_per_dt)
    return 2.0 * error_per_dt * dt, dt
