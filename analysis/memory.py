"""How long a gas remembers what a short series of blocks cannot show: a dense fluid its virial, heavy particles their speed.

The autocorrelation of the virial has a weak part that lives as long as the structure around a particle, near freezing
tens of collisions per particle. It is a few per cent of the variance of a block of two collisions per particle, hidden in the
noise of any one short run, and yet almost doubles the variance of the mean at packing fraction 0.49: error bars from short blocks
are then a quarter too small. Particles much heavier than those they collide with keep their velocities for as many collisions as
their mass is times larger: whatever follows from these is that of the start, in any number of frames.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis import theory

if TYPE_CHECKING:
    from hardspheres import Frame, Scene

__all__ = [
    "FrameWeights",
    "FrozenWarning",
    "remembered",
    "variance_growth",
    "velocity_memory",
    "warn_if_frozen",
]

INDEPENDENT = (
    4.0  # memories between two frames, from which on they count as independent in a test of a distribution
)
FORGOTTEN = 8.0  # memories in a run, from which on its blocks can tell an error


class FrozenWarning(UserWarning):
    """Velocities of a species hardly changed in a run: what follows from them is that of the start."""


# packing fraction, block that underrates the variance of the mean by 5 %, in collisions per particle, and
# variance of the mean over that from blocks of two collisions per particle; measured with 500 particles over
# 30 000 to 60 000 collisions per particle (errors of the last column: 15 %), 3D at 0.49 with 4000 as well
_MEASURED = {
    3: ([0.35, 0.40, 0.45, 0.47, 0.49], [1.0, 10.0, 60.0, 110.0, 300.0], [1.05, 1.05, 1.25, 1.4, 1.85]),
    2: ([0.55, 0.60, 0.65, 0.69], [1.0, 10.0, 100.0, 2000.0], [1.05, 1.05, 1.45, 15.0]),
}


def remembered(eta: float, dim: int) -> float:
    """Return how long blocks of the virial must be for a right error bar, in collisions per particle.

    Parameters
    ----------
    eta : float
        Packing fraction of the fluid; between the measured ones the logarithm is interpolated. Below 0.35 (3D)
        or 0.55 (2D) nothing was found, and it is 0.
    dim : {2, 3}
        Dimension d.
    """
    place, length, _ = _MEASURED[dim]
    if eta < place[0]:
        return 0.0
    return float(np.exp(np.interp(eta, place, np.log(length))))


def variance_growth(eta: float, dim: int) -> float:
    """Return the variance of a mean virial over what blocks of two collisions per particle say of it.

    Parameters
    ----------
    eta, dim
        As in `remembered`.
    """
    place, _, growth = _MEASURED[dim]
    return float(np.exp(np.interp(eta, place, np.log(growth))))


def velocity_memory(scene: Scene) -> NDArray[np.float64]:
    """Return over how many collisions per particle of the whole gas each species forgets its velocities, (k,).

    1/rate of the initial decay of <v(0).v(t)>, rate_i = (4/d) sum over j of m_j/(m_i + m_j) nu_ij: exact as
    `theory.velocity_correlation_rate`, which it is for one species, 3/2 in 3D and 1 in 2D; for a heavy particle among light ones
    the friction of kinetic theory over its mass. Collisions between the heavy ones leave their energy among themselves:
    species of no more than half of the particles remember, if longer, until temperatures would have become equal, 1/sum over
    j of (8/d) m_i m_j/(m_i + m_j)^2 (nu_ij + nu_ji), j another species. nu_ij of the dilute gas: only ratios matter here.

    Parameters
    ----------
    scene : Scene
        The gas, of which velocities and positions do not matter.
    """
    kinds, first, sizes = np.unique(scene.species, return_index=True, return_counts=True)
    if scene.n < 2:
        return np.full(len(kinds), np.inf)
    mass, share = scene.masses[first], sizes / scene.n
    dilute = share * 1e-9 / float(scene.radii.max()) ** scene.dim
    nu = theory.mixture_collision_rates(dilute, 2.0 * scene.radii[first], mass, scene.dim)
    loses = 4.0 / scene.dim * (nu * (mass / np.add.outer(mass, mass))).sum(axis=1)
    exchanged = theory.temperature_equilibration_rate(
        np.ones(len(kinds)), dilute, 2.0 * scene.radii[first], mass, scene.dim
    )
    minor = (share <= 0.5) & (len(kinds) > 1)
    forgets = np.where(minor, np.minimum(loses, (exchanged + exchanged.T).sum(axis=1)), loses)
    return np.asarray(float(share @ nu.sum(axis=1)) / forgets)


class FrameWeights:
    """How much each frame of a series tells that those before did not, from the collisions between them.

    A frame that does not advance in collisions per particle belongs to another gas, and is new.

    Attributes
    ----------
    effective : (k,) array
        Frames as good as independent, for each species: the sum of tanh(ds/2 memory), ds since the frame before, and 1 for
        the first. That is how much of the variance of a mean is left with a correlation exp(-ds/memory) between frames.
    """

    def __init__(self) -> None:
        self.effective: NDArray[np.float64] = np.zeros(0)
        self._memory: NDArray[np.float64] = np.zeros(0)
        self._last = self._tested = np.inf
        self._scene: Scene | None = None
        self._span = 0.0  # collisions per particle between frames

    def add(self, frame: Frame) -> bool:
        """Take in a frame, and return whether it is `INDEPENDENT` memories of every species from the last that was."""
        s = float(frame.collisions_per_particle)
        if not len(self._memory):
            self._scene, self._memory = frame.scene, velocity_memory(frame.scene)
            self.effective = np.zeros_like(self._memory)
        if s <= self._last:
            self.effective = self.effective + 1.0
            self._tested = -np.inf
        else:
            self._span += s - self._last
            self.effective = self.effective + np.tanh((s - self._last) / (2.0 * self._memory))
        self._last = s
        if s < self._tested + INDEPENDENT * float(self._memory.max()):
            return False
        self._tested = s
        return True

    def warn_if_frozen(self) -> None:
        """Warn as `warn_if_frozen` of frames of one gas that lie too close together, fewer than 8 of them independent."""
        if self._scene is not None and self._span > 0.0 and float(self.effective.min()) < FORGOTTEN:
            warn_if_frozen(self._scene, self._span)


def warn_if_frozen(scene: Scene, collisions_per_particle: float) -> None:
    """Warn where a run is too short for a species to forget its velocities `FORGOTTEN` times.

    Parameters
    ----------
    scene : Scene
        The gas.
    collisions_per_particle : float
        How long it was measured.

    Warns
    -----
    FrozenWarning
        Naming the species that remembers longest. Not of a single species: blocks see what it remembers.
    """
    memory = velocity_memory(scene)
    worst = int(np.argmax(memory))
    if len(memory) > 1 and collisions_per_particle < FORGOTTEN * memory[worst]:
        warnings.warn(
            FrozenWarning(
                f"species {worst + 1} forgets its velocities in {_text(memory[worst])} collisions per particle, and was "
                f"measured for {_text(collisions_per_particle)}: what depends on them is that of this start, and its error a lower bound; "
                f"measure for {_text(FORGOTTEN * memory[worst])}, or take the spread of many starts"
            ),
            stacklevel=3,
        )


def _text(number: float) -> str:
    return f"{float(f'{number:.2g}'):.10g}"
