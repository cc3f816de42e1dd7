"""How one gas is divided among several threads: blocks of columns of cells (`kernel.threads`)."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hardspheres.scene import Scene
from hardspheres.tuning import collision_frequency, power_of_two_below

__all__ = ["Domains", "divided", "too_small"]

LAYERS = 3  # of cells in a tile along an axis that is divided, at least: then each is inside in some round
COLLISIONS_IN_BUCKET = 0.02  # per particle, at least; windows are no longer than a bucket
EVENTS_IN_TICK = 32  # of a domain: then what they need comes into the cache in time
LEAST_TICKS, MOST_TICKS = 8, 256  # in a bucket
MOST_TICKS_OF_WINDOWS = 8192
CYCLE = 512  # buckets in a cycle of the calendars
AXES = 2  # that may be divided: columns of cells are left whole


class Domains:
    """The tiles of a box, and which of them make a domain in each round.

    Parameters
    ----------
    cells : list of int
        Cells along each axis.
    threads : int
        How many threads are at work.
    across : (int, int)
        Domains along the first two axes; 1: the axis is not divided. A domain has two tiles of at least
        LAYERS layers along an axis that is.
    """

    def __init__(self, cells: list[int], threads: int, across: tuple[int, int]) -> None:
        assert _fits(cells, across), "some pairs of neighbours would never be inside one domain"
        self.cells, self.threads, self.across = cells, threads, across
        self.tiles = [2 * domains if domains > 1 else 1 for domains in across]
        self.shifts = [
            (x, y) for y in range(min(across[1], 2)) for x in range(min(across[0], 2))
        ]  # by a tile along each axis

    def plan(self, scene: Scene, at: Any, number: Any, count: Any) -> None:
        """Write what the kernels need to know to the numbers and counters; the epoch is there already."""
        n, length = scene.n, float(number[at.EPOCH_LENGTH])
        tiles = math.prod(self.tiles)
        frequency = collision_frequency(scene)
        buckets = length * frequency / COLLISIONS_IN_BUCKET
        count[at.EPOCH_BUCKETS] = int(power_of_two_below(min(max(buckets, 1.0), 2.0**40)))
        number[at.INVERSE_WIDTH] = count[at.EPOCH_BUCKETS] / length
        in_bucket = n * frequency * length / float(count[at.EPOCH_BUCKETS])  # entries, stale ones with them
        ticks = int(power_of_two_below(max(in_bucket / math.prod(self.across) / EVENTS_IN_TICK, 1.0)))
        count[at.BUCKET_TICKS] = min(max(ticks, LEAST_TICKS), MOST_TICKS)
        number[at.TICKS] = number[at.INVERSE_WIDTH] * count[at.BUCKET_TICKS]
        count[at.BUCKETS] = CYCLE
        count[at.BLOCKS] = CYCLE + n // tiles + 64
        self._share(n, at, count)
        count[at.WINDOW_TICKS] = count[at.BUCKET_TICKS] // 2

    def plan_windows(self, scene: Scene, length: float, at: Any, number: Any, count: Any) -> None:
        """Write what the kernels need to know of windows of time of this length; the rest is there already.

        A bucket is then a whole window of time, and its ticks are what one thread calls its buckets.
        """
        n, tiles, domains = scene.n, math.prod(self.tiles), math.prod(self.across)
        collisions = collision_frequency(scene) * length  # of a particle
        ticks = int(power_of_two_below(max(0.5 * n * collisions / domains / EVENTS_IN_TICK, 1.0)))
        count[at.BUCKET_TICKS] = min(max(ticks, LEAST_TICKS), MOST_TICKS_OF_WINDOWS)
        count[at.WINDOW_BUCKETS] = 1
        count[at.EPOCH_BUCKETS] = round(float(number[at.EPOCH_LENGTH]) / length)
        number[at.INVERSE_WIDTH] = 1.0 / length
        number[at.TICKS] = float(count[at.BUCKET_TICKS]) / length
        count[at.BUCKETS] = count[at.BUCKET_TICKS]
        count[at.CONTACT_ROOM] = n // tiles + 1024
        count[at.BLOCKS] = count[at.BUCKETS] + n // (4 * tiles) + 256
        count[at.OVERFLOW_ROOM] += 1024 * self.threads
        ticks = int(power_of_two_below(max(COLLISIONS_IN_BUCKET / max(collisions, 1e-300) * ticks, 1.0)))
        self._share(n, at, count)
        count[at.WINDOW_TICKS] = min(max(ticks // 2, 1), count[at.BUCKET_TICKS])

    def _share(self, n: int, at: Any, count: Any) -> None:
        count[at.HEAP_ROOM] = 1024 + n // 8
        count[at.UNDO_ROOM] = 1024 + n // (6 * self.threads)
        count[at.THREAD_COUNT], count[at.TILES] = self.threads, math.prod(self.tiles)
        count[at.DOMAINS], count[at.SHIFTS] = math.prod(self.across), len(self.shifts)

    def fill(self, at: Any, arrays: dict[str, Any]) -> None:
        """Fill the tables of tiles."""
        nx, ny = self.cells[:AXES]
        edges = [
            [cells * k // tiles for k in range(tiles + 1)]
            for cells, tiles in zip(self.cells, self.tiles, strict=False)
        ]
        tile_x, tile_y = (
            np.searchsorted(edge, np.arange(cells), "right") - 1
            for edge, cells in zip(edges, (nx, ny), strict=True)
        )
        arrays["tile_of_column"][: nx * ny] = (tile_x[:, None] * self.tiles[1] + tile_y).ravel()
        inside: NDArray[np.int32] = np.full((nx, ny), 1 << at.ALL_TILES, dtype=np.int32)
        domain = arrays["domain_of"].reshape(at.ALL_TILES + 1, *self.tiles)
        for number, shift in enumerate(self.shifts):
            along = [
                _inside(edge, tiles, by) for edge, tiles, by in zip(edges, self.tiles, shift, strict=True)
            ]
            inside |= (along[0][:, None] & along[1]).astype(np.int32) << number
            x, y = (_domains(tiles, by) for tiles, by in zip(self.tiles, shift, strict=True))
            domain[number] = x[:, None] * self.across[1] + y
        arrays["inside_in"][: nx * ny] = inside.ravel()


def _fits(cells: list[int], across: tuple[int, int]) -> bool:
    """Whether all tiles are wide enough."""
    return all(
        domains == 1 or layers // (2 * domains) >= LAYERS
        for domains, layers in zip(across, cells, strict=False)
    )


def _domains(tiles: int, shift: int) -> NDArray[np.int64]:
    """Domain of each tile along an axis."""
    return (np.arange(tiles) - shift) % tiles // 2


def _inside(edges: list[int], tiles: int, shift: int) -> NDArray[np.bool_]:
    """Whether each layer of cells along an axis is inside its domain: not the first or last one in it."""
    inside = np.ones(edges[-1], dtype=np.bool_)
    for first in range(shift, tiles, 2) if tiles > 1 else ():
        inside[edges[first]] = False
        inside[edges[(first + 1) % tiles + 1] - 1] = False
    return inside


def divided(cells: list[int], threads: int) -> Domains | None:
    """Return the domains for as many of these threads as there is room for; None where that is one."""
    for count in range(threads, 1, -1):
        best, most = None, -1.0
        for x in range(1, count + 1):
            across = (x, count // x)
            if count % x or not _fits(cells, across):
                continue
            within = math.prod(
                1.0 - 2.0 * domains / layers
                for domains, layers in zip(across, cells, strict=False)
                if domains > 1
            )
            if within > most:
                best, most = across, within
        if best:
            return Domains(cells, count, best)
    return None


def too_small(n: int, asked: int, threads: int) -> str:
    """Return why a gas of n particles runs on so few threads."""
    many = "thread" if threads == 1 else "threads"
    return (
        f"threads={asked}: this gas of {n} particles runs on {threads} {many}, as each needs a part of the "
        f"box at least {2 * LAYERS} cells wide"
    )
