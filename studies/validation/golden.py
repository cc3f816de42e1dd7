"""Golden digests: twenty gases after 20 000 collisions, to the last bit.

The same scene follows the same trajectory on every machine, with every search and every version of Python,
NumPy, Numba and LLVM, as long as CHANGELOG names no "Changed bits". Here stand the digests that prove it.
Most starts are drawn by NumPy's random generators, whose streams may change with NumPy: so the digest of the
start stands beside that of the end, and three starts are made without random numbers.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs

__all__ = ["COLLISIONS", "GOLDEN", "Golden", "end_digest", "start_digest"]

COLLISIONS = 20_000


@dataclass(frozen=True)
class Golden:
    """One gas and its digests.

    Attributes
    ----------
    name : str
        The gas in words.
    make : callable
        Returns its start, by public functions alone.
    start, end : str
        What `start_digest` and `end_digest` give.
    searches : tuple of str
        With which it is run: windows need a box of several diameters.
    quick : bool
        Whether it is one of the few that `hardspheres verify --quick` runs.
    """

    name: str
    make: Callable[[], hs.Scene]
    start: str
    end: str
    searches: tuple[str, ...] = ("lists", "windows")
    quick: bool = False


def start_digest(scene: hs.Scene) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of every number of a scene."""
    arrays = (scene.positions, scene.velocities, scene.radii, scene.masses, scene.box)
    return _digest(*arrays, scene.boundary)


def end_digest(simulation: hs.Simulation) -> str:
    """Return the same of where a gas is, how it got there and what was tallied on the way."""
    tallies = simulation.tallies
    return _digest(
        simulation.positions,
        simulation.velocities,
        simulation.unwrapped_positions,
        tallies.virial,
        tallies.wall_impulses,
        (simulation.time, simulation.collisions, simulation.wall_collisions),
    )


def _digest(*parts: Any) -> str:
    digest = hashlib.sha256()
    for part in parts:
        is_array = isinstance(part, np.ndarray)
        digest.update(np.ascontiguousarray(part, "<f8").tobytes() if is_array else repr(part).encode())
    return digest.hexdigest()[:16]


def _species(n: int, radius: float, mass: float, every: int = 2) -> dict[str, Any]:
    """Return radii and masses of a mixture in which every so many-th particle is another one."""
    other = np.arange(n) % every == every - 1
    return {"radii": np.where(other, radius, 0.5), "masses": np.where(other, mass, 1.0)}


def _numbers(count: int) -> NDArray[np.float64]:
    """Return numbers between -1/2 and 1/2 by a linear congruential generator: integers alone."""
    found, state = [], 1
    for _ in range(count):
        state = (1664525 * state + 1013904223) % 2**32
        found.append(state / 2**32 - 0.5)
    return np.array(found)


def _without_random_numbers(side: int, dim: int, spacing: float, **more: Any) -> hs.Scene:
    """Return a gas on a simple lattice."""
    n = side**dim
    places = np.stack(np.unravel_index(np.arange(n), (side,) * dim), axis=1)
    velocities = _numbers(n * dim).reshape(n, dim)
    return hs.Scene(spacing * (places + 0.5), velocities, box=(side * spacing,) * dim, **more)


# _random(n=..., seed=...) is that call of `hardspheres.random_gas`, to be made later
_random, _lattice, _grown = (
    functools.partial(functools.partial, make) for make in (hs.random_gas, hs.lattice_gas, hs.compressed_gas)
)
_slab = ("periodic", "wall", "periodic")

GOLDEN = (
    Golden(
        "spheres, 0.001, equal speeds",
        _random(n=500, packing_fraction=0.001, velocities="equal-speeds", seed=1),
        "0e4739477a88230f",
        "11957f255f5157e2",
    ),
    Golden(
        "spheres, 0.01",
        _random(n=1000, packing_fraction=0.01, seed=2),
        "ead6c14c6e32ee12",
        "699b84b457b7ca20",
        quick=True,
    ),
    Golden(
        "spheres, 0.1, two temperatures",
        _random(n=1000, packing_fraction=0.1, velocities="two-temperatures", seed=3),
        "d6943850d028ad9b",
        "0ead2c46865708f6",
        quick=True,
    ),
    Golden(
        "spheres, 0.3, lattice with vacancies, beams",
        _lattice(n=800, packing_fraction=0.3, velocities="beams", seed=4),
        "034132e3911e6438",
        "1e37dc33ce323f3a",
        quick=True,
    ),
    Golden(
        "spheres, 0.49, grown",
        _grown(n=400, packing_fraction=0.49, seed=5),
        "bc0a152313d7ebc9",
        "37454f7b0204830e",
    ),
    Golden(
        "crystal of spheres, 0.7",
        _lattice(n=500, packing_fraction=0.7, seed=6),
        "946072faf714934b",
        "7f110c691bf4c515",
    ),
    Golden(
        "32 spheres in a small box, 0.4",
        _lattice(n=32, packing_fraction=0.4, seed=7),
        "f6dc14850e05d003",
        "7dd5471f9ae677a0",
        quick=True,
    ),
    Golden(
        "2 spheres in a box of two diameters",
        lambda: hs.Scene(
            [[0.5, 0.5, 0.5], [1.5, 1.5, 1.5]], [[1.0, 0.3, 0.2], [-0.1, 0.2, 0.5]], box=(2, 2, 2)
        ),
        "3aa638ffe864011a",
        "5be0c70704ceee8f",
        searches=("lists",),
        quick=True,
    ),
    Golden(
        "spheres without random numbers, 0.1",
        lambda: _without_random_numbers(8, 3, 1.75),
        "42f81ac1b01e3952",
        "78b11d40bf33db95",
        quick=True,
    ),
    Golden(
        "discs, 0.01, beams",
        _random(n=600, dim=2, packing_fraction=0.01, velocities="beams", seed=8),
        "dcda07fd77c24430",
        "a20dbe5d26a2a1a4",
    ),
    Golden(
        "discs, 0.4",
        _random(n=600, dim=2, packing_fraction=0.4, seed=9),
        "66b619a0c1b96200",
        "23ba9cef439edc46",
    ),
    Golden(
        "discs, 0.7, lattice",
        _lattice(n=480, dim=2, packing_fraction=0.7, seed=10),
        "eb19eb90a9211f0b",
        "1f0c9d0f4d7eb77b",
    ),
    Golden(
        "spheres between walls, 0.05",
        _random(n=500, packing_fraction=0.05, boundary="wall", seed=11),
        "4c471fcfe24d2ad7",
        "21921567090213ea",
    ),
    Golden(
        "slab of spheres, 0.3",
        _lattice(n=500, packing_fraction=0.3, boundary=_slab, seed=12),
        "a24c8d9eeb7304fd",
        "109de0e02c878b55",
    ),
    Golden(
        "mixture of discs between walls, 0.2",
        _random(n=400, dim=2, packing_fraction=0.2, boundary="wall", seed=13, **_species(400, 0.3, 7.0)),
        "9bb0e88c1fd2a2a5",
        "fecc2d41e7edfd33",
        quick=True,
    ),
    Golden(
        "mixture of discs between walls without random numbers",
        lambda: _without_random_numbers(20, 2, 4.0, boundary="wall", **_species(400, 0.3, 7.0)),
        "1c8435628c142cfa",
        "8d6ae8adbeeaba9d",
        quick=True,
    ),
    Golden(
        "mixture of spheres, 0.05",
        _random(n=600, packing_fraction=0.05, seed=14, **_species(600, 0.3, 7.0)),
        "45bad629336d2261",
        "7718d129b32c0c55",
    ),
    Golden(
        "mixture of spheres, 0.35, grown",
        _grown(n=400, packing_fraction=0.35, seed=15, **_species(400, 0.3, 7.0)),
        "7f5733506338c477",
        "b2bb8b532bf1f06f",
    ),
    Golden(
        "masses 1:1e4, 0.01",
        _random(n=400, packing_fraction=0.01, seed=16, **_species(400, 0.49, 1e4)),
        "5228c405bc93cb0f",
        "c6c641a7367e2f0e",
    ),
    Golden(
        "few large spheres, diameters 1:6, 0.02",
        _random(n=600, packing_fraction=0.02, seed=17, **_species(600, 3.0, 20.0, every=100)),
        "92abe1c1ae389741",
        "4ceae6291d021732",
    ),
)
