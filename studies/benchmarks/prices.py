"""The price list: what a collision costs in a gas that has more, beside the plain gas, timed in turn.

Walls, a second mass, a second radius, gravity, obstacles, tallies and the log each have kernels of their own,
so a gas that lacks them does not pay. Processor time is compared, round by round on the same core: a busy
machine slows both.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import hardspheres as hs
from studies.benchmarks.clock import Ours, Windows
from studies.benchmarks.summary import write_summary
from studies.report import OutputFolder, Screen

__all__ = ["FEATURES", "Prices", "run_prices"]

START_UP = 10.0  # collisions per particle
PULL = 1.0  # of gravity: m g L / kT
FIXED = 0.02  # fraction of obstacles

FEATURES: dict[str, tuple[str, dict[str, Any]]] = {
    "walls": ("plain", {}),
    "second mass, 1:2": ("plain", {}),
    "second radius, 1:1.2": ("plain", {}),
    "gravity": ("walls", {}),
    "obstacles, 2 %": ("plain", {}),
    "gravity and obstacles": ("walls", {}),
    "free_paths=True": ("plain", {"free_paths": True}),
    "heat=True": ("plain", {"heat": True}),
    "log=...": ("plain", {"log": lambda events: None}),
}
"""What is measured, beside which gas, and the options of the simulation."""


@dataclass(frozen=True)
class Prices:
    """Where to measure.

    Attributes
    ----------
    n : int
        Particles.
    packing_fractions : tuple of float
        Of spheres.
    rounds : int
        Windows of each gas; the ratio is their median.
    seed : int
        Of the start.
    window : float
        Collisions per window and particle.
    """

    n: int = 4000
    packing_fractions: tuple[float, ...] = (0.01, 0.3)
    rounds: int = 20
    seed: int = 1
    window: float = 5.0
    files: ClassVar[tuple[str, ...]] = ("prices.csv",)
    reports: ClassVar[bool] = False


def gas_with(name: str, n: int, packing_fraction: float, seed: int) -> hs.Scene:
    """Return the gas of an entry of the list: spheres in 3D, of mean diameter and mass about 1, kT = 1."""
    odd = np.arange(n) % 2 == 1
    gravity = name.startswith("gravity")
    options: dict[str, Any] = {"boundary": "wall" if gravity or name == "walls" else "periodic"}
    if name.startswith("second mass"):
        options["masses"] = np.where(odd, 2.0, 1.0)
    if name.startswith("second radius"):
        options["radii"] = np.where(odd, 0.6, 0.5)
    scene = hs.random_gas(n=n, packing_fraction=packing_fraction, seed=seed, **options)
    if "obstacles" in name:
        fixed = np.random.default_rng(seed).permutation(n) < FIXED * n
        scene = scene.replace(
            masses=np.where(fixed, np.inf, 1.0), velocities=np.where(fixed[:, None], 0.0, scene.velocities)
        )
    return scene.replace(gravity=(0.0, 0.0, -PULL / scene.box[2])) if gravity else scene


def run_prices(
    study: Prices, out: OutputFolder, screen: Screen, made: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], bool]:
    """Measure the price list, print it, write prices.csv and summary.json.

    Parameters
    ----------
    study : Prices
        Where to measure.
    out : OutputFolder
        Where the files go.
    screen : Screen
        Where results and progress are shown.
    made : mapping, optional
        What else made it, of `Program.made`.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        True.
    """
    out.check(study, resumable=False)
    began = time.perf_counter()
    ratios = np.array([_column(study, eta, screen) for eta in study.packing_fractions])
    header = ("a gas with", "beside", *(f"{eta:g}" for eta in study.packing_fractions))
    rows = [
        [name, FEATURES[name][0], *(f"{ratio:.2f}" for ratio in ratios[:, k])]
        for k, name in enumerate(FEATURES)
    ]
    screen.table(f"Processor time of a collision, N = {study.n}", header, rows)
    columns = {
        "packing_fraction": np.repeat(study.packing_fractions, len(FEATURES)).tolist(),
        "feature": list(FEATURES) * len(study.packing_fractions),
        "beside": [beside for beside, _ in FEATURES.values()] * len(study.packing_fractions),
        "ratio": ratios.ravel().tolist(),
    }
    out.create()
    out.write_csv("prices.csv", columns)
    summary = write_summary(
        out,
        screen,
        {
            "seed": study.seed,
            "suite": "prices",
            "n": study.n,
            "prices": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
            "seconds": time.perf_counter() - began,
        },
        made,
    )
    return summary, True


def _column(study: Prices, packing_fraction: float, screen: Screen) -> list[float]:
    """Return the ratios at one packing fraction, medians over the rounds."""
    runners: dict[str, Ours] = {}
    for name in ("plain", *FEATURES):
        with screen.working(f"{name} at packing fraction {packing_fraction:g}"):
            scene = gas_with(name, study.n, packing_fraction, study.seed)
            runners[name] = Ours(hs.Simulation(scene, **FEATURES.get(name, ("", {}))[1]))
            runners[name].run(round(START_UP * study.n / 2))
    windows = {name: Windows() for name in runners}
    for _ in range(study.rounds):
        for name, runner in runners.items():
            windows[name].time(runner, max(1, round(study.window * study.n / 2)))
    rates = {name: each.cpu_rates for name, each in windows.items()}
    return [float(np.median(rates[beside] / rates[name])) for name, (beside, _) in FEATURES.items()]
