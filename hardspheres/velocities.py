"""Initial velocities: Maxwell, equal speeds, two temperatures, two beams; momentum removed, exact energy."""

import math
import operator
from collections.abc import Callable
from functools import partial
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from hardspheres.errors import SceneError
from hardspheres.scene import Scene, degrees_of_freedom, drift, squared_lengths, thermal_energy

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Seed = int | np.random.SeedSequence

POSITIONS, VELOCITIES = 0x706F7369, 0x76656C6F  # names of the two streams drawn from one seed


_PLASTIC, _GOLDEN = 1.324717957244746, 1.618033988749895  # x^3 = x + 1, x^2 = x + 1
_UNEVEN = {3: np.array([1.0, 1 / _PLASTIC, 1 / (_PLASTIC * _PLASTIC)]), 2: np.array([1.0, 1 / _GOLDEN])}
BEAM_DIRECTION = {dim: uneven / math.sqrt(float(np.sum(uneven * uneven))) for dim, uneven in _UNEVEN.items()}
"""Unit vectors, by dimension, along which beams start: (0.726, 0.548, 0.414) and (0.851, 0.526).

Ratios of their components are powers of the plastic number or of the golden ratio, which are badly
approximable by rational numbers: in a cubic periodic box a line along them returns close to itself only after
a long way.
"""


def stream(seed: Seed, name: int) -> np.random.Generator:
    """Return an independent stream of random numbers for each name, the same for the same seed and name.

    Raises
    ------
    SceneError
        When the seed is no integer >= 0 and no SeedSequence.
    """
    if not isinstance(seed, np.random.SeedSequence):
        try:
            number = -1 if isinstance(seed, bool) else operator.index(seed)
        except TypeError:
            number = -1
        if number < 0:
            raise SceneError(f"seed is {seed!r}; it must be an integer >= 0 or a numpy.random.SeedSequence")
        seed = np.random.SeedSequence(number)
    # Not seed.spawn, which changes its argument: a second call with the same object would give other numbers.
    return np.random.default_rng(
        np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, name), pool_size=seed.pool_size)
    )


def draw_velocities(
    scene: Scene,
    velocities: str = "maxwell",
    *,
    temperature: float = 1.0,
    temperature_ratio: float = 3.0,
    seed: Seed,
) -> Floats:
    """Draw velocities for the particles of a scene.

    The momentum along periodic axes, where the dynamics conserves it, is removed; then all velocities are
    scaled so that ``scene.replace(velocities=v).temperature`` equals `temperature` to rounding. Along walls
    momentum is not conserved and is left as drawn. A single particle keeps its momentum.

    Parameters
    ----------
    scene : Scene
        Gives masses, species, dimension and boundaries. Its own velocities and positions are not used.
    velocities : str
        ``"maxwell"``: each component normal with variance kT/m.

        ``"equal-speeds"``: random directions, and for all particles of one mass one speed, sqrt(d kT/m) but
        for the correction of the degrees of freedom. Particles of one mass move in opposite pairs drawn at
        random, an odd one out in a trio at 120 degrees in a random plane, so that the momentum is zero to
        rounding and nothing has to be removed. A mass that only one particle has cannot be paired: then the
        momentum is removed along periodic axes, which spoils the equality of speeds by that much.

        ``"two-temperatures"``: a hot and a cold gas, each Maxwell, T_hot / T_cold = `temperature_ratio`
        exactly, each at rest along periodic axes (except a single particle, which shifts the ratio slightly).
        In a mixture the first species is hot and the others are cold; particles all alike are divided at
        random into halves.

        ``"beams"``: half of the particles, drawn at random (mass by mass), move along `BEAM_DIRECTION` and
        half against it, all with one speed. Ratios of its components are irrational: along an axis of a
        periodic box, a particle that has missed all others once would sweep the same cylinder again and never
        collide.
    temperature : float
        kT of the whole, in units of energy, >= 0. Zero puts everything at rest.
    temperature_ratio : float
        T_hot / T_cold of ``"two-temperatures"``, positive.
    seed : int or numpy.random.SeedSequence
        Source of all random choices. The velocities are those that `lattice_gas` and `random_gas` draw from
        this seed.

    Returns
    -------
    (N, d) float64 array
        Velocities.

    Raises
    ------
    SceneError
        When an argument is not one of those above.
    """
    if isinstance(temperature, bool) or not (isinstance(temperature, Real) and 0 <= temperature < math.inf):
        raise SceneError(f"temperature is {temperature!r}; it must be a finite number >= 0")
    if isinstance(temperature_ratio, bool) or not (
        isinstance(temperature_ratio, Real) and 0 < temperature_ratio < math.inf
    ):
        raise SceneError(f"temperature_ratio is {temperature_ratio!r}; it must be a positive finite number")
    distributions: dict[str, Callable[[np.random.Generator, Scene], Floats]] = {
        "maxwell": _maxwell,
        "equal-speeds": _equal_speeds,
        "two-temperatures": partial(_two_temperatures, ratio=float(temperature_ratio)),
        "beams": _beams,
    }
    if not isinstance(velocities, str) or velocities not in distributions:
        words = ", ".join(f'"{word}"' for word in distributions)
        raise SceneError(f"velocities is {velocities!r}; it must be one of {words}")
    drawn = distributions[velocities](stream(seed, VELOCITIES), scene)
    for _ in range(2):  # the second pass removes the rounding of the first
        drawn = drawn - drift(drawn, scene.masses, scene.periodic)
        drawn = _scaled_to(drawn, scene, float(temperature))
    return drawn


def _maxwell(rng: np.random.Generator, scene: Scene) -> Floats:
    return rng.standard_normal((scene.n, scene.dim)) / np.sqrt(scene.masses)[:, None]


def _equal_speeds(rng: np.random.Generator, scene: Scene) -> Floats:
    directions = np.empty((scene.n, scene.dim))
    for members in _shuffled_by_mass(rng, scene):
        trio = 3 if len(members) % 2 and len(members) > 1 else 0
        if trio:
            directions[members[:3]] = _trio(rng, scene.dim)
        pairs = (len(members) - trio) // 2
        half = _unit_vectors(rng, pairs, scene.dim)
        directions[members[trio : trio + pairs]] = half
        directions[members[trio + pairs : trio + 2 * pairs]] = -half
        if len(members) == 1:
            directions[members] = _unit_vectors(rng, 1, scene.dim)
    return directions / np.sqrt(scene.masses)[:, None]


def _two_temperatures(rng: np.random.Generator, scene: Scene, ratio: float) -> Floats:
    drawn = _maxwell(rng, scene)
    shuffled = rng.permutation(scene.n)
    if scene.species.any():
        hot, cold = np.flatnonzero(scene.species == 0), np.flatnonzero(scene.species)
    else:
        hot, cold = shuffled[: (scene.n + 1) // 2], shuffled[(scene.n + 1) // 2 :]
    for members, kT in ((hot, ratio), (cold, 1.0)):
        if not len(members):
            continue
        masses = scene.masses[members]
        part = drawn[members] - drift(drawn[members], masses, scene.periodic)
        energy = thermal_energy(part, masses, scene.periodic)
        freedom = degrees_of_freedom(len(members), scene.periodic)
        drawn[members] = part * math.sqrt(freedom * kT / (2 * energy))
    return drawn


def _beams(rng: np.random.Generator, scene: Scene) -> Floats:
    signs = np.empty(scene.n)
    sign = 1.0  # unpaired particles take alternating signs
    for members in _shuffled_by_mass(rng, scene):
        half = (len(members) + 1) // 2
        signs[members[:half]] = sign
        signs[members[half:]] = -sign
        sign = -sign if len(members) % 2 else sign
    return signs[:, None] * BEAM_DIRECTION[scene.dim]


def _shuffled_by_mass(rng: np.random.Generator, scene: Scene) -> list[Ints]:
    """Group the particles by mass, each group in random order: partners are not neighbours on a lattice."""
    shuffled = rng.permutation(scene.n)
    if scene.masses.min() == scene.masses.max():
        return [shuffled]
    by_mass = shuffled[np.argsort(scene.masses[shuffled], kind="stable")]
    return np.split(by_mass, np.flatnonzero(np.diff(scene.masses[by_mass])) + 1)


def _unit_vectors(rng: np.random.Generator, n: int, dim: int) -> Floats:
    """Directions distributed evenly over the sphere: normal vectors over their lengths."""
    vectors = rng.standard_normal((n, dim))
    unit: Floats = vectors / np.sqrt(squared_lengths(vectors))[:, None]
    return unit


def _trio(rng: np.random.Generator, dim: int) -> Floats:
    """Three unit vectors at 120 degrees in a random plane."""
    first, other = _unit_vectors(rng, 2, dim)
    second = other - first * np.sum(first * other)
    second /= math.sqrt(np.sum(second * second))
    across = math.sqrt(0.75) * second
    return np.array([first, -0.5 * first + across, -0.5 * first - across])


def _scaled_to(velocities: Floats, scene: Scene, temperature: float) -> Floats:
    if temperature == 0:
        return np.zeros_like(velocities)
    energy = thermal_energy(velocities, scene.masses, scene.periodic)
    wanted = 0.5 * degrees_of_freedom(scene.n, scene.periodic) * temperature
    return velocities * math.sqrt(wanted / energy)
