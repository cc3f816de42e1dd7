"""Loschmidt's reversal: run, reverse every velocity, run back, and compare with the initial state.

In exact arithmetic the gas returns exactly. Every rounding grows by exp(lambda) per collision per particle,
lambda the largest Lyapunov exponent, so that the logarithm of the error is a straight line of slope lambda:
no engine in float64 can do better, and one with a defect would lie above the line. The exponent is also
measured in tangent space.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import hardspheres as hs
from analysis.lyapunov import lyapunov_exponent
from hardspheres.scene import to_nearest_image
from studies.validation.hard_cases.case import Case, Size, kept, pick

TITLE = "Reversal and Lyapunov growth"
REFERENCE = 0.974
"""lambda per collision per particle of spheres at packing fraction 0.2; another engine, to 2 %."""


def gas(n: int, seed: int) -> hs.Scene:
    """Return spheres at packing fraction 0.2, some collisions after a random start."""
    simulation = hs.Simulation(hs.random_gas(n=n, packing_fraction=0.2, seed=seed))
    simulation.run(collisions=20 * n)
    return simulation.to_scene()


def return_error(scene: hs.Scene, s: float) -> float:
    """Return the distance from the start, in diameters, after s collisions per particle and back."""
    there = hs.Simulation(scene)
    there.run(collisions=round(s * scene.n / 2))
    back = hs.Simulation(there.to_scene().replace(velocities=-there.velocities))
    back.run(time=there.time)
    dx = to_nearest_image(back.positions - scene.positions, scene)
    return float(np.sqrt(np.sum(dx * dx)))


@kept
def growth(n: int, gases: int, stops: list[float]) -> tuple[float, float, float]:
    """Return the slope of the mean log error against s, its standard error, and the first mean error."""
    logs = np.array(
        [[math.log(return_error(scene, s)) for s in stops] for scene in (gas(n, k) for k in range(gases))]
    )
    slopes = np.polyfit(stops, logs.T, 1)[0]
    return (
        float(slopes.mean()),
        float(slopes.std(ddof=1) / math.sqrt(gases)),
        float(np.exp(logs[:, 0].mean())),
    )


@kept
def largest_exponent(n: int, collisions_per_particle: float) -> tuple[float, float]:
    """Return the exponent per collision per particle in tangent space, and its standard error."""
    found = lyapunov_exponent(gas(n, 1), collisions_per_particle, settle=10.0).per_collision
    return found.value, found.standard_error


def cases(size: Size) -> Iterator[Case]:
    """Yield the return, its error growth beside tangent space, and the latter beside a known value."""
    n, gases = pick(size, (32, 108, 256)), pick(size, (6, 12, 24))
    measured, error, first = growth(n, gases, [4.0, 8.0, 12.0, 16.0, 20.0, 24.0])
    yield Case(
        f"{n} spheres, 4 collisions per particle and back",
        "the start; e^4 roundings away allowed for",
        f"{first:.1e} diameters from it",
        first,
        1e-11,
    )
    exponent, spread = largest_exponent(n, pick(size, (60.0, 200.0, 1000.0)))
    yield Case(
        f"{n} spheres, growth of the error with s",
        f"tangent space: exp({exponent:.3f}({1000 * spread:.0f}) s)",
        f"exp({measured:.3f}({1000 * error:.0f}) s) for s = 4 to 24",
        abs(measured - exponent) / exponent,
        max(0.1, 4.5 * math.hypot(error, spread) / exponent),
    )
    yield Case(
        f"{n} spheres, exponent in tangent space",
        f"{REFERENCE} (2 %) by another engine, N not known",
        f"{exponent:.3f}({1000 * spread:.0f})",
        abs(exponent / REFERENCE - 1.0),
        pick(size, (0.2, 0.1, 0.1)),
    )
