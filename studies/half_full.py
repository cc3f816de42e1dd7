"""A gas in half of a box, the other half of which is opened; or in a whole box whose two halves mix."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.expansion import started_below
from analysis.theory import Prediction, TheoryRangeWarning
from studies.fluid import Fluid

__all__ = ["AXIS", "HalfFull"]

AXIS = 0  # along which it expands
SETTLING = 4.0  # transit times in which a dilute gas, placed at random, has mixed


@dataclass(frozen=True)
class HalfFull:
    """A gas in half of a box between walls along x, or in a whole box whose two halves are told apart.

    Attributes
    ----------
    start : Fluid
        The gas in equilibrium before.
    mix : bool
        Whether it fills the whole box, and its halves mix.
    """

    start: Fluid
    mix: bool = False

    @property
    def n(self) -> int:
        """Number of particles."""
        return self.start.n

    @property
    def dim(self) -> int:
        """Dimension."""
        return self.start.dim

    @property
    def packing_fraction(self) -> float:
        """Packing fraction at the start, in what the gas fills then."""
        return self.start.packing_fraction

    @property
    def kind(self) -> str:
        """What the engine is compiled for, in words."""
        return self.start.kind

    @property
    def spread(self) -> float:
        """Packing fraction in the whole box."""
        return self.packing_fraction * (1.0 if self.mix else 0.5)

    @cached_property
    def edge(self) -> float:
        """Edge of the box that the start fills, in diameters."""
        volume = self.n * math.pi / (2 * self.dim) / self.packing_fraction
        return float(volume ** (1.0 / self.dim))

    @property
    def half(self) -> float:
        """Half of the whole box along x: also the transit time, as kT and m are 1."""
        return self.edge * (0.5 if self.mix else 1.0)

    @property
    def knudsen(self) -> float:
        """Mean free path at the start over half of the box."""
        return float(theory.mean_free_path(self.packing_fraction, self.dim)) / self.half

    @property
    def rate(self) -> float:
        """Collisions per particle and time in the whole box."""
        return float(theory.collision_rate(self.spread, self.dim))

    @property
    def decay(self) -> float:
        """Decay of the slowest mode per transit time: a wave between the walls, or cos(pi x/L) of mixing."""
        q, dim = math.pi / (2.0 * self.half), self.dim
        if self.mix:
            s = theory.tracer_displacement([self.half, 2.0 * self.half], self.spread, dim).value
            return float(0.5 * q * q * (s[1] ** 2 - s[0] ** 2))
        with np.errstate(all="ignore"):  # of a density so low that the engine refuses the box
            damping = float(theory.sound_damping(self.spread, dim).value)
        return min(damping * q * q, float(theory.sound_speed(self.spread, dim).value) * q) * self.half

    @property
    def rounding(self) -> float:
        """One unit in the last place of the box."""
        return 2.0 * self.half * float(np.finfo(np.float64).eps)

    @cached_property
    def horizon(self) -> Prediction:
        """Collisions per particle that are retraced on the way back; NaN where that is not known."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", TheoryRangeWarning)
            return theory.reversal_horizon(self.spread, self.dim, 2.0 * self.half)

    @property
    def settled(self) -> int:
        """Pair collisions after which a run from `scene` is in equilibrium."""
        if self.start.dense:
            return self.start.settled
        rate = float(theory.collision_rate(self.packing_fraction, self.dim))
        return min(self.start.settled, math.ceil(SETTLING * self.half * rate * self.n / 2))

    def scene(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return the gas before, not yet in equilibrium."""
        return self.start.scene(seed)

    def opened(self, scene: hs.Scene) -> hs.Scene:
        """Return the same particles in the whole box; of halves that mix, 0 labels the lower, 1 the upper."""
        box = scene.box.copy()
        box[AXIS] *= 1.0 if self.mix else 2.0
        labels = np.where(started_below(scene, AXIS), 0, 1) if self.mix else None
        same = (scene.positions, scene.velocities, scene.radii, scene.masses)
        return hs.Scene.as_left(*same, box, scene.boundary, labels)

    def __str__(self) -> str:
        """Return the gas in words."""
        kind = "spheres" if self.dim == 3 else "discs"
        what = "two halves of a box that mix" if self.mix else "let out of half of a box"
        return f"{self.n} hard {kind}, {what}"
