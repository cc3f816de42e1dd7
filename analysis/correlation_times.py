"""Correlation times that short blocks do not show: virial of dense fluids, velocities of heavy particles.

The autocorrelation of the virial has a weak part that decays with the structure around a particle, over tens
of collisions per particle near freezing. It is a few per cent of the variance of a block of two collisions
per particle and cannot be detected in a short run, yet it almost doubles the variance of the mean at packing
fraction 0.49: error bars from short blocks are then a quarter too small. The velocities of particles much
heavier than those they collide with change slowly: the number of collisions needed grows as the mass ratio.
In a shorter run, quantities that depend on them keep their initial values, however many frames are taken.
"""

from __future__ import annotations

import math
import warnings
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.brief import brief
from analysis.reduced import Gas
from hardspheres.scene import drift

if TYPE_CHECKING:
    from hardspheres import Frame, Scene

__all__ = [
    "FrameWeights",
    "FrozenWarning",
    "MeasuredCollisions",
    "variance_growth",
    "velocity_correlation_times",
    "virial_block_length",
    "warn_if_frozen",
]

INDEPENDENT = 4.0  # correlation times between two frames that count as independent in tests of distributions
LONG_RUN = 8.0  # least length of a run, in correlation times, for an error from its blocks


class FrozenWarning(UserWarning):
    """Velocities of a species hardly changed in a run: results that depend on them are those of its start."""


# packing fraction; length of block, in collisions per particle, whose variance of the mean is 5 % too small;
# variance of the mean over that from blocks of two collisions per particle; measured with 500 particles over
# 30 000 to 60 000 collisions per particle (errors of the last column: 15 %), 3D at 0.49 with 4000 as well
_MEASURED = {
    3: ([0.35, 0.40, 0.45, 0.47, 0.49], [1.0, 10.0, 60.0, 110.0, 300.0], [1.05, 1.05, 1.25, 1.4, 1.85]),
    2: ([0.55, 0.60, 0.65, 0.69], [1.0, 10.0, 100.0, 2000.0], [1.05, 1.05, 1.45, 15.0]),
}


def virial_block_length(eta: float, dim: int) -> float:
    """Return the length of blocks of the virial needed for a correct error bar, in collisions per particle.

    Parameters
    ----------
    eta : float
        Packing fraction of the fluid. The logarithm of the length is interpolated between measured values.
        Below 0.35 (3D) or 0.55 (2D) no effect was found, and the result is 0.
    dim : {2, 3}
        Dimension d.
    """
    place, length, _ = _MEASURED[dim]
    if eta < place[0]:
        return 0.0
    return float(np.exp(np.interp(eta, place, np.log(length))))


def variance_growth(eta: float, dim: int) -> float:
    """Return the variance of a mean virial over its estimate from blocks of two collisions per particle.

    Parameters
    ----------
    eta, dim
        As in `virial_block_length`.
    """
    place, _, growth = _MEASURED[dim]
    return float(np.exp(np.interp(eta, place, np.log(growth))))


def velocity_correlation_times(scene: Scene) -> NDArray[np.float64]:
    """Return the velocity correlation time of each species in collisions per particle of the whole gas, (k,).

    The inverse of the initial decay rate of <v(0).v(t)>, rate_i = (4/d) sum over j of m_j/(m_i + m_j) nu_ij.
    The rate is exact. For one species it is `theory.velocity_correlation_rate`, and the time 3/2 in 3D and 1
    in 2D; for a heavy particle among light ones it is the friction coefficient of kinetic theory over the
    mass. Collisions within a species do not change its energy. For a species of at most half of the particles
    the result is therefore at least the time of temperature equilibration, 1/sum over j of (8/d) m_i m_j/(m_i
    + m_j)^2 (nu_ij + nu_ji), j another species. nu_ij is that of the dilute gas: only ratios matter.

    Parameters
    ----------
    scene : Scene
        The gas; its velocities and positions are not used.
    """
    return _times(scene)[1]


def _times(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the decay times of velocities, and the longer ones with the exchange of energy, both (k,)."""
    gas = Gas.of(scene)
    if gas.n < 2:
        return np.full(len(gas.sizes), np.inf), np.full(len(gas.sizes), np.inf)
    mass, share = gas.masses, gas.sizes / gas.n
    dilute = share * 1e-9 / float(gas.diameters.max() / 2.0) ** gas.dim
    nu = theory.mixture_collision_rates(dilute, gas.diameters, mass, gas.dim)
    loses = 4.0 / gas.dim * (nu * (mass / np.add.outer(mass, mass))).sum(axis=1)
    exchanged = theory.temperature_equilibration_rate(
        np.ones(len(share)), dilute, gas.diameters, mass, gas.dim
    )
    minor = (share <= 0.5) & (len(share) > 1)
    forgets = np.where(minor, np.minimum(loses, (exchanged + exchanged.T).sum(axis=1)), loses)
    collisions = float(share @ nu.sum(axis=1))
    return np.asarray(collisions / loses), np.asarray(collisions / forgets)


@dataclass(eq=False)
class FrameWeights:
    """The effective number of independent frames in a series, from the collisions between frames.

    A frame that does not advance in collisions per particle belongs to another gas and counts as independent.

    Attributes
    ----------
    effective : (k,) array
        Effective number of independent frames for each species: 1 for the first, and tanh(ds/2 tau) for each
        later one, ds after the frame before it. This is the reduction of the variance of a mean if frames are
        correlated as exp(-ds/tau).
    """

    effective: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    _times: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    _last: float = np.inf
    _tested: float = np.inf
    _span: float = 0.0  # collisions per particle between frames

    __repr__ = brief

    def add(self, frame: Frame) -> bool:
        """Add a frame; return whether it is `INDEPENDENT` correlation times after the last one tested."""
        s = float(frame.collisions_per_particle)
        if not len(self._times):
            self._times = velocity_correlation_times(frame.scene)
            self.effective = np.zeros_like(self._times)
        if s <= self._last:
            self.effective = self.effective + 1.0
            self._tested = -np.inf
        else:
            self._span += s - self._last
            self.effective = self.effective + np.tanh((s - self._last) / (2.0 * self._times))
        self._last = s
        if s < self._tested + INDEPENDENT * float(self._times.max()):
            return False
        self._tested = s
        return True

    def merge(self, other: FrameWeights) -> None:
        """Take in the frames of another, independent run."""
        if not len(self._times):
            self._times = other._times
            self.effective = np.zeros_like(self._times)
        self.effective = self.effective + other.effective
        self._span += other._span

    def warn_if_frozen(self) -> None:
        """Warn, as the function of this name, if fewer than `LONG_RUN` frames count as independent."""
        if self._span > 0.0 and float(self.effective.min()) < LONG_RUN:
            warn_if_frozen(self._times, self._span)


class MeasuredCollisions:
    """Collisions per particle between frames that come without, from how far velocities have decorrelated.

    ds = -tau ln C, with C the correlation of the velocities of a species in successive frames, and tau the
    decay time of its velocities: of the species with the longest tau whose C is not lost in noise. C is that
    of the last few pairs of frames, so many that its noise is at most 0.03; below 0.03, or twice its noise,
    it counts as 0, and where that is so for all species frames count as independent. Walls turn a velocity
    without changing a temperature: C is that of the components along periodic axes, and where there is none
    that of the speeds less their mean, which in a gas of one species decays at the same rate.
    Only ds / tau matters for error bars, and that is right for any interaction whose velocity correlation
    decays exponentially.

    Attributes
    ----------
    s : float
        Collisions per particle since the first frame.
    """

    UNRELATED = 8.0  # correlation times between frames whose velocities show no correlation
    LEAST = 0.03  # correlation that counts

    def __init__(self) -> None:
        self.s = 0.0
        self._before: NDArray[np.float64] | None = None

    def _begin(self, scene: Scene) -> None:
        self._taus, longest = _times(scene)
        self._longest = float(longest.max())
        self._order = np.argsort(-self._taus)
        self._numbers = max(int(scene.periodic.sum()), 1) * np.bincount(scene.species)
        self._pairs: list[deque[tuple[float, float]]] = [
            deque(maxlen=math.ceil(1.0 / (self.LEAST**2 * count))) for count in self._numbers
        ]
        self._sums = np.zeros((len(self._taus), 2))

    def __repr__(self) -> str:
        """Return how many collisions have passed."""
        return f"<MeasuredCollisions: {self.s:.4g} per particle>"

    @property
    def correlation(self) -> float:
        """C of all pairs of frames, of the species whose velocities decay most slowly; NaN without a pair."""
        if self._before is None or not self._sums.any():
            return math.nan
        product, square = self._sums[self._order[0]]
        return float(product / square)

    def add(self, scene: Scene, velocities: NDArray[np.float64]) -> float:
        """Take in the velocities, (N, d), of the next frame; return its `s`."""
        if self._before is None:
            self._begin(scene)
        if scene.periodic.any():
            now = (velocities - drift(velocities, scene.masses, scene.periodic))[:, scene.periodic]
        else:
            now = np.sqrt((velocities**2).sum(axis=1, keepdims=True))
            sizes = np.bincount(scene.species)
            now -= (np.bincount(scene.species, now[:, 0]) / sizes)[scene.species, None]
        if self._before is not None:
            parts = [now * self._before, now**2, self._before**2]
            kinds = len(self._taus)
            product, one, other = (
                np.bincount(scene.species, part.sum(axis=1), minlength=kinds) for part in parts
            )
            found = np.stack([product, np.sqrt(one * other)], axis=1)
            self._sums += found
            for pairs, own in zip(self._pairs, found.tolist(), strict=True):
                pairs.append((own[0], own[1]))
            self.s += max(self._apart(), 1e-9 * self._longest)  # s of a later frame is always larger
        self._before = now
        return self.s

    def _apart(self) -> float:
        """Return ds of the last two frames."""
        for kind in self._order:
            product, square = np.sum(self._pairs[kind], axis=0)
            least = max(2.0 / math.sqrt(self._numbers[kind] * len(self._pairs[kind])), self.LEAST)
            if product > least * square:
                return float(-self._taus[kind] * math.log(min(product / square, 1.0)))
        return self.UNRELATED * self._longest


def warn_if_frozen(scene: Scene | NDArray[np.float64], collisions_per_particle: float) -> None:
    """Warn if a run is shorter than `LONG_RUN` velocity correlation times of a species.

    Parameters
    ----------
    scene : Scene or (k,) array
        The gas, or its `velocity_correlation_times`.
    collisions_per_particle : float
        How long it was measured.

    Warns
    -----
    FrozenWarning
        Naming the species with the longest correlation time. Not given for a single species, whose
        correlation is short enough for blocks to show it.
    """
    times = scene if isinstance(scene, np.ndarray) else velocity_correlation_times(scene)
    worst = int(np.argmax(times))
    if len(times) > 1 and collisions_per_particle < LONG_RUN * times[worst]:
        warnings.warn(
            FrozenWarning(
                f"the velocity correlation time of species {worst + 1} is {_text(times[worst])} collisions "
                f"per particle, and the run has {_text(collisions_per_particle)}: results depend on its "
                "start, and their error bars are lower bounds; measure for "
                f"{_text(LONG_RUN * times[worst])}, or take the spread of many starts"
            ),
            stacklevel=3,
        )


def _text(number: float) -> str:
    return f"{float(f'{number:.2g}'):.10g}"
