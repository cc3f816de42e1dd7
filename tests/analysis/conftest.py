"""Synthetic gases, and the Boltzmann equation solved by Monte Carlo as an oracle for the reference tables."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numba import njit

import hardspheres as hs


@dataclass(frozen=True)
class FakeFrame:
    """What an estimator reads of a frame."""

    velocities: Any
    scene: Any
    collisions_per_particle: float = 0.0
    time: float = 0.0


def make_frame(velocities, masses=1.0, radii=0.1, boundary="periodic", s=0.0):
    """A frame with these velocities; the particles sit on a coarse grid, where none overlaps another."""
    velocities = np.asarray(velocities, dtype=float)
    n, dim = velocities.shape
    side = math.ceil(n ** (1 / dim))
    places = np.stack(np.unravel_index(np.arange(n), (side,) * dim), axis=1) + 0.5
    scene = hs.Scene(
        places, velocities, radii=radii, masses=masses, box=(float(max(side, 2)),) * dim, boundary=boundary
    )
    return FakeFrame(velocities, scene, s, s)


def maxwell(rng, n, dim, masses=1.0, temperature=1.0):
    return rng.standard_normal((n, dim)) * np.sqrt(temperature / np.broadcast_to(masses, n))[:, None]


def equal_speeds(rng, n, dim):
    half = rng.standard_normal((n // 2, dim))
    half *= math.sqrt(dim) / np.linalg.norm(half, axis=1, keepdims=True)
    return np.concatenate([half, -half])


@njit
def collide_at_random(v, collisions, fastest, even):
    """Hard-sphere collisions of random partners with random impact: homogeneous Boltzmann dynamics, no time step."""
    n, dim = v.shape
    done = 0
    while done < collisions:
        i, j = np.random.randint(n), np.random.randint(n)
        g = math.sqrt(((v[i] - v[j]) ** 2).sum())
        fastest = max(fastest, g)
        if i == j or np.random.random() * fastest > g:
            continue
        k = np.empty(dim)
        if dim == 3:  # the deflected direction is even over the sphere
            k[2] = 2 * np.random.random() - 1
            angle = 2 * math.pi * np.random.random()
            k[0], k[1] = (
                math.sqrt(1 - k[2] ** 2) * math.cos(angle),
                math.sqrt(1 - k[2] ** 2) * math.sin(angle),
            )
        elif even:  # not what discs do
            angle = 2 * math.pi * np.random.random()
            k[0], k[1] = math.cos(angle), math.sin(angle)
        else:  # impact parameter even over the diameter: deflection by pi - 2 asin b
            b = 2 * np.random.random() - 1
            cosine, sine = 2 * b * b - 1, 2 * b * math.sqrt(1 - b * b)
            x, y = (v[i] - v[j]) / g
            k[0], k[1] = cosine * x - sine * y, sine * x + cosine * y
        centre = (v[i] + v[j]) / 2
        v[i] = centre + g / 2 * k
        v[j] = centre - g / 2 * k
        done += 1
    return fastest


@njit
def seed_numba(seed):
    np.random.seed(seed)


@pytest.fixture(scope="session")
def boltzmann():
    """Frames of a Boltzmann gas from given velocities at given s: boltzmann(velocities, s_values, seed).

    With even=True discs are deflected by every angle alike: wrong, and conserving all the same.
    """

    def frames(velocities, s_values, seed, even=False):
        seed_numba(seed)
        v = np.array(velocities, dtype=float)
        first = make_frame(v)
        fastest, done = 4.0, 0
        for s in s_values:
            goal = math.ceil(s * len(v) / 2)
            fastest = collide_at_random(v, goal - done, fastest, even)
            done = goal
            yield FakeFrame(v.copy(), first.scene, s, s)

    return frames


@pytest.fixture(scope="session")
def gas():
    """The helpers of this file."""

    class Gas:
        frame = staticmethod(make_frame)
        maxwell = staticmethod(maxwell)
        equal_speeds = staticmethod(equal_speeds)

    return Gas
