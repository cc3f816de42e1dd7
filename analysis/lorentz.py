"""Lorentz gas: what one particle does among fixed obstacles, from the events of its flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.lyapunov import Tangent
from hardspheres.event_log import event_dtype

__all__ = ["LAGS", "PLACES", "SURVIVAL_AT", "LorentzWalk"]

FloatArray = NDArray[np.float64]

PLACES = 512  # of the particle in a block, equally spaced in time
LAGS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128])
"""Between two places that are compared, in spacings."""
SURVIVAL_AT = np.geomspace(0.125, 128.0, 41)
"""Lengths of flights whose share of longer ones is counted, in the unit of the walk."""
SETTLE, STRETCH, PIECE = 24, 64, 8
"""Collisions of every second block in which a deviation turns to the direction that grows fastest, in which
its growth is measured, and between two normalisations."""


@dataclass
class LorentzWalk:
    """What one particle has done, in blocks of PLACES spacings of time; all others are obstacles.

    Each block is added with the frame at its start and the events in it, as a log has them: the path follows
    from both to a rounding.

    Attributes
    ----------
    spacing : float
        Time between two places.
    unit : float
        Unit of the lengths of flights.
    blocks : int
        How many were added.
    time, collisions : float and int
        Their length, and collisions in them.
    squares : (LAGS,) array
        Sums over blocks of the mean square displacement at each of LAGS.
    flights : (SURVIVAL_AT + 1,) array
        Flights between two collisions, between these lengths.
    growth, stretched : float and int
        Growth of the logarithm of a deviation in tangent space, and in how many collisions.
    """

    spacing: float
    unit: float
    blocks: int = 0
    time: float = 0.0
    collisions: int = 0
    squares: FloatArray = field(default_factory=lambda: np.zeros(len(LAGS)))
    flights: NDArray[np.int64] = field(default_factory=lambda: np.zeros(len(SURVIVAL_AT) + 1, dtype=np.int64))
    growth: float = 0.0
    stretched: int = 0

    def __repr__(self) -> str:
        """Return how far the particle was followed."""
        return f"<LorentzWalk: {self.collisions} collisions, time {self.time:.6g}, {self.blocks} blocks>"

    @property
    def block(self) -> float:
        """Time of a block."""
        return PLACES * self.spacing

    def add(self, start: hs.Frame, chunks: Sequence[NDArray[np.void]]) -> None:
        """Take in a block.

        Parameters
        ----------
        start : Frame
            Its start, of a scene without walls in which one particle moves.
        chunks : sequence of structured arrays
            All events in it, see `hardspheres.event_log.event_dtype`.
        """
        events, first = _hits(start, chunks)
        places = self.places(start, chunks)
        for k, lag in enumerate(LAGS):
            self.squares[k] += float(((places[lag:] - places[:-lag]) ** 2).sum(axis=1).mean())
        paths = np.where(first, events["free_path"][:, 0], events["free_path"][:, 1])
        where = np.searchsorted(SURVIVAL_AT * self.unit, paths[np.isfinite(paths)])
        self.flights += np.bincount(where, minlength=len(self.flights))
        if self.blocks % 2 == 0:
            self._stretch(start, events)
        self.blocks += 1
        self.time += self.block
        self.collisions += len(events)

    def places(self, start: hs.Frame, chunks: Sequence[NDArray[np.void]]) -> FloatArray:
        """Return places at the start of a block and after each spacing, (PLACES + 1, d), unwrapped.

        Parameters
        ----------
        start, chunks
            As in `add`.
        """
        events, first = _hits(start, chunks)
        own = int(np.argmin(start.scene.obstacles))
        assert start.unwrapped_positions is not None
        impulses = np.where(first, 1.0, -1.0) * events["impulse"] / start.scene.masses[own]
        kicks = impulses[:, None] * events["normal"]
        velocities = np.cumsum(np.concatenate([start.velocities[own][None], kicks]), axis=0)
        times = np.concatenate([[0.0], events["time"] - start.time])
        flown = velocities[:-1] * np.diff(times)[:, None]
        turns = np.cumsum(np.concatenate([start.unwrapped_positions[own][None], flown]), axis=0)
        at = self.spacing * np.arange(PLACES + 1)
        leg = np.searchsorted(times, at, side="right") - 1
        return np.asarray(turns[leg] + velocities[leg] * (at - times[leg])[:, None])

    def _stretch(self, start: hs.Frame, events: NDArray[np.void]) -> None:
        """Carry a deviation through the first collisions of a block."""
        count = (min(len(events) - SETTLE, STRETCH) // PIECE) * PIECE
        if count <= 0:
            return
        scene = start.scene.with_state(start.positions, start.velocities)
        shape = (2, *scene.positions.shape)
        tangent = Tangent(scene, *np.random.default_rng(self.blocks).normal(size=shape))
        tangent.clocks[:] = start.time
        tangent.take(events[:SETTLE])
        tangent.normalise(float(events["time"][SETTLE - 1]))
        for place in range(SETTLE, SETTLE + count, PIECE):
            tangent.take(events[place : place + PIECE])
            self.growth += tangent.normalise(float(events["time"][place + PIECE - 1]))
        self.stretched += count

    @property
    def mean_square_displacement(self) -> FloatArray:
        """Mean square displacement at each of LAGS, (LAGS,)."""
        return self.squares / self.blocks


def _hits(start: hs.Frame, chunks: Sequence[NDArray[np.void]]) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
    """Return all events, and in which of them the particle is the first of the two partners."""
    events = np.concatenate([np.zeros(0, event_dtype(start.scene.dim)), *chunks])
    return events, events["i"] == int(np.argmin(start.scene.obstacles))
