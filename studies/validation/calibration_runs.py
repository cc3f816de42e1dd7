"""Short runs for the calibration: each family makes one gas, or series, for all estimators that fit it.

They are small, so that hundreds are cheap.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

import hardspheres as hs
from analysis import theory
from analysis.free_path import FreePath
from analysis.pressure import Pressure
from analysis.relaxation import RelaxationCurve
from analysis.series import SeriesWarning, autocorrelation_time, estimate_from_series
from analysis.statistics import (
    Estimate,
    ReplicaWarning,
    combine_replicas,
    estimate_from_blocks,
    estimate_from_jackknife,
    estimate_from_replicas,
    pool_replicas,
)
from analysis.structure import PairDistribution
from analysis.temperatures import AnisotropyDecay, TemperatureEquilibration
from analysis.transport import Diffusion
from analysis.velocities import FourthCumulant, HFunction, KolmogorovSmirnov, SpeedDistribution

__all__ = ["FAMILIES", "Family", "measure"]

Seed = np.random.SeedSequence
FloatArray = NDArray[np.float64]

SPHERES, ETA = 32, 0.15
REPLICAS = 12  # gases behind one fit of a rate
PHI, LENGTH = 0.8, 1200  # of the autoregressive series


@dataclass(frozen=True)
class Family:
    """One kind of short run.

    Attributes
    ----------
    text : str
        What runs.
    run : callable
        Maps a seed to what every estimator measured.
    load : callable
        Compiles what the run needs.
    truths : dict
        What is measured, and where that is known from, for those estimators that have a truth.
    """

    text: str
    run: Callable[[Seed], dict[str, Estimate]]
    load: Callable[[], None]
    truths: Mapping[str, tuple[float, str]]


def measure(item: tuple[str, Seed]) -> dict[str, Estimate]:
    """Run one family once; warnings of short series are expected here."""
    name, seed = item
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeriesWarning)
        warnings.simplefilter("ignore", ReplicaWarning)
        return FAMILIES[name].run(seed)


# Spheres in equilibrium -------------------------------------------------------------------------------------


def _spheres(seed: Seed, steps: int = 640) -> dict[str, Estimate]:
    """Everything that is measured in a periodic box at equilibrium, every half collision per particle."""
    simulation = hs.Simulation(hs.random_gas(n=SPHERES, packing_fraction=ETA, seed=seed), free_paths=True)
    simulation.run(collisions=10 * SPHERES)
    scene = simulation.to_scene()
    pressure, paths, diffusion = Pressure(scene), FreePath(scene), Diffusion(points=4)
    pairs = PairDistribution(depth=0.5, bins=30, window=0.5, degree=2)
    cumulants, ks, h = FourthCumulant(), KolmogorovSmirnov(), HFunction(bins=12, maximum=3.0)
    speeds = SpeedDistribution(bins=10, maximum=4.0)
    step = 0.5 / float(theory.finite_size_collision_rate(ETA, 3, SPHERES).value)
    for counting in (pressure, paths):
        counting.add(simulation.frame())
    for k in range(steps):
        simulation.run(time=step)
        diffusion.add(simulation)
        if k % 2:
            frame = simulation.frame()
            for estimator in (pressure, paths, pairs, cumulants, ks, h):
                estimator.add(frame)
            if k % 8 == 7:
                speeds.add(frame)
    tensor, window = pressure.tensor, (2.0 * step, 4.0 * step)
    third = 2  # a bin near the most probable speed
    return {
        "Z, virial": pressure.virial,
        "Z, collision rate": pressure.rate,
        "Z, virial - rate": pressure.virial_minus_rate,
        "collision rate": pressure.collision_rate,
        "mean free path": paths.mean_free_path[0],
        "mean free time": paths.mean_free_time[0],
        "paths, second moment": paths.moment(2),
        "paths beyond their mean": paths.survival(1.0)[0],
        "pressure, xx": tensor.component(0, 0),
        "pressure, xy": tensor.component(0, 1),
        "kinetic pressure, xx": tensor.component(0, 0, "kinetic"),
        "collisional pressure, xy": tensor.component(0, 1, "collisional"),
        "g at contact": pairs.contact[(0, 0)],
        "Z, g at contact": pairs.compressibility_factor,
        "D, displacements": diffusion.diffusion(window),
        "D, velocities": diffusion.diffusion_from_velocities(4.0 * step),
        "a2": cumulants.a2,
        "a3": cumulants.a3,
        "KS distance": ks.distance,
        "H": h.excess,
        "speed histogram": Estimate(
            float(speeds.density[0, third]), float(speeds.density_error[0, third]), float(speeds.counts.sum())
        ),
    }


def _sphere_truths() -> dict[str, tuple[float, str]]:
    z = float(theory.finite_size_compressibility(ETA, 3, SPHERES).value)
    rate = float(theory.finite_size_collision_rate(ETA, 3, SPHERES).value)
    density = SPHERES / (SPHERES * math.pi / 6.0 / ETA)
    ideal = density * (SPHERES - 1) / SPHERES  # kT = 1 over N - 1 degrees of freedom along each axis
    freedom = 3 * (SPHERES - 1)
    law = theory.finite_energy_law(freedom, 3, 1.0 / SPHERES)
    low, high = 0.8, 1.2
    share = float(law.cdf(high**2 / 2) - law.cdf(low**2 / 2))
    return {
        "Z, virial": (z, "theory"),
        "Z, collision rate": (z, "theory"),
        "Z, virial - rate": (0.0, "exact"),
        "collision rate": (rate, "theory"),
        "mean free path": (float(theory.finite_size_mean_free_path(ETA, 3, SPHERES).value), "theory"),
        "mean free time": (1.0 / rate, "theory"),
        "pressure, xx": (ideal * z, "theory"),
        "pressure, xy": (0.0, "exact"),
        "kinetic pressure, xx": (ideal, "exact"),
        "collisional pressure, xy": (0.0, "exact"),
        "a2": (float(theory.equilibrium_a2(freedom)), "exact"),
        "a3": (float(theory.equilibrium_a3(freedom)), "exact"),
        "speed histogram": (share / (high - low), "exact"),
    }


def _load_spheres() -> None:
    hs.Simulation(hs.random_gas(n=SPHERES, packing_fraction=ETA, seed=1), free_paths=True).run(collisions=1)


# A mixture in equilibrium -----------------------------------------------------------------------------------


def _mixture_start(seed: Seed) -> hs.Simulation:
    """Return light and small spheres, and half as many heavy and large ones."""
    second = np.arange(48) >= 32
    radii, masses = np.where(second, 1.0, 0.5), np.where(second, 10.0, 1.0)
    scene = hs.random_gas(n=48, packing_fraction=0.1, radii=radii, masses=masses, seed=seed)
    return hs.Simulation(scene, free_paths=True)


def _mixture(seed: Seed, blocks: int = 256) -> dict[str, Estimate]:
    """Return collision rates between species, and the pressure from them."""
    simulation = _mixture_start(seed)
    simulation.run(collisions=1000)
    scene = simulation.to_scene()
    pressure, paths = Pressure(scene), FreePath(scene)
    start = simulation.collisions_per_particle
    for frame in simulation.frames(collisions_per_particle=start + np.arange(blocks + 1)):
        pressure.add(frame)
        paths.add(frame)
    rates = paths.collision_rates
    return {
        "Z of a mixture, virial": pressure.virial,
        "Z of a mixture, rates": pressure.rate,
        "Z of a mixture, virial - rates": pressure.virial_minus_rate,
        "rate 1-1": rates[0][0],
        "rate 1-2": rates[0][1],
        "rate 2-2": rates[1][1],
        "mean free path of species 2": paths.mean_free_path[1],
    }


def _load_mixture() -> None:
    _mixture_start(Seed(1)).run(collisions=1)


# Discs between walls ----------------------------------------------------------------------------------------


def _walls(seed: Seed, blocks: int = 128) -> dict[str, Estimate]:
    """Return pressures on the walls from 24 discs between them."""
    simulation = hs.Simulation(hs.random_gas(n=24, packing_fraction=0.2, dim=2, boundary="wall", seed=seed))
    simulation.run(collisions=240)
    pressure = Pressure(simulation.to_scene())
    start = simulation.collisions_per_particle
    for frame in simulation.frames(collisions_per_particle=start + 2.0 * np.arange(blocks + 1)):
        pressure.add(frame)
    return {
        "Z, virial": pressure.virial,
        "Z, collision rate": pressure.rate,
        "Z, walls": pressure.walls,
        "force on a wall": pressure.wall_forces["x high"],
        "pressure on a wall": pressure.wall_pressures["y low"],
    }


def _load_walls() -> None:
    hs.Simulation(hs.random_gas(n=24, packing_fraction=0.2, dim=2, boundary="wall", seed=1)).run(collisions=1)


def _sound_start(seed: Seed) -> hs.Simulation:
    return hs.Simulation(hs.random_gas(n=400, packing_fraction=0.2, dim=2, boundary="wall", seed=seed))


def _sound(seed: Seed) -> dict[str, Estimate]:
    """Return pressures on walls over half a period of the sound wave between them, and over a whole one."""
    simulation = _sound_start(seed)
    simulation.run(collisions=20 * 200)
    pressure = Pressure(simulation.to_scene())
    start = simulation.collisions_per_particle
    for k, frame in enumerate(simulation.frames(collisions_per_particle=start + 0.5 * np.arange(45))):
        pressure.add(frame)
        if k == 20:
            walls = pressure.walls
    return {"Z, walls, half a wave": walls, "force on a wall, one wave": pressure.wall_forces["x high"]}


def _load_sound() -> None:
    _sound_start(Seed(1)).run(collisions=1)


# Gases that relax -------------------------------------------------------------------------------------------


def _relaxation(seed: Seed) -> dict[str, Estimate]:
    """Rates from a few gases each: equal speeds, and one axis warmer than the others."""
    curve, decay = RelaxationCurve(), AnisotropyDecay()
    for own in seed.spawn(REPLICAS):
        scene = hs.random_gas(n=200, packing_fraction=0.005, velocities="equal-speeds", seed=own)
        for frame in hs.Simulation(scene).frames(collisions_per_particle=[0.0, 0.5, 1.5]):
            curve.add(frame)
        maxwell = np.random.default_rng(own.spawn(1)[0]).standard_normal((200, 3))
        warm = scene.replace(velocities=maxwell * [1.5, 1.0, 1.0])
        for frame in hs.Simulation(warm).frames(collisions_per_particle=[0.0, 1.0]):
            decay.add(frame)
    last = REPLICAS - 1.0
    return {
        "a2 of a curve": Estimate(curve.a2[1], curve.a2_error[1], REPLICAS, last),
        "H of a curve": Estimate(curve.h[1], curve.h_error[1], REPLICAS, last),
        "KS of a curve": Estimate(curve.ks[1], curve.ks_error[1], REPLICAS, last),
        "rate of a2": curve.fit_rate((0.5, 1.5)),
        "anisotropy": Estimate(decay.anisotropy[1], decay.anisotropy_error[1], REPLICAS, last),
        "rate of anisotropy": decay.fit_rate((0.0, 1.0)),
    }


def _load_relaxation() -> None:
    hs.Simulation(hs.random_gas(n=200, packing_fraction=0.005, seed=1)).run(collisions=1)


def _two_species(seed: Seed) -> hs.Scene:
    """Return as many light and small spheres as heavy and large ones, of two temperatures."""
    second = np.arange(120) >= 60
    return hs.random_gas(
        n=120,
        packing_fraction=0.01,
        velocities="two-temperatures",
        radii=np.where(second, 1.0, 0.5),
        masses=np.where(second, 4.0, 1.0),
        seed=seed,
    )


def _temperatures(seed: Seed) -> dict[str, Estimate]:
    """Return the rate of temperature equilibration, from a few gases."""
    decay = TemperatureEquilibration()
    for own in seed.spawn(REPLICAS):
        for frame in hs.Simulation(_two_species(own)).frames(times=[0.0, 8.0]):
            decay.add(frame)
    one = Estimate(decay.temperatures[1, 0], decay.temperatures_error[1, 0], REPLICAS, REPLICAS - 1.0)
    return {"temperature of a species": one, "rate of equilibration": decay.fit_rate((0.0, 8.0))}


def _load_temperatures() -> None:
    hs.Simulation(_two_species(Seed(1))).run(collisions=1)


# Series of known correlation --------------------------------------------------------------------------------


def _autoregressive(rng: np.random.Generator, length: int) -> FloatArray:
    """Return a stationary series x_k = PHI x_(k-1) + noise of variance 1: tau = (1 + PHI)/(1 - PHI)/2."""
    noise = rng.standard_normal(length) * math.sqrt(1.0 - PHI**2)
    noise[0] /= math.sqrt(1.0 - PHI**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -PHI], noise))


def _series(seed: Seed) -> dict[str, Estimate]:
    """Return estimates from series and samples with known true values."""
    rng = np.random.default_rng(seed)
    one, other = _autoregressive(rng, LENGTH), _autoregressive(rng, LENGTH)
    below = 1.0 + 0.2 * one
    pair = np.stack([3.0 * below + 0.3 * other, below], axis=1)
    normal = rng.standard_normal((8, 12))
    parts = [estimate_from_replicas(row) for row in normal]
    long = _autoregressive(rng, 20 * LENGTH)
    return {
        "mean, automatic blocks": estimate_from_series(one),
        "mean, 16 blocks": estimate_from_blocks(other, 16),
        "ratio of means": estimate_from_series(pair, lambda mean: mean[..., 0] / mean[..., 1]),
        "autocorrelation time": autocorrelation_time(long),
        "replicas combined": combine_replicas(parts),
        "replicas pooled": pool_replicas(parts),
        "jackknife of a logarithm": estimate_from_jackknife(
            np.exp(0.2 * normal[:, :1]), lambda m: float(math.log(m[0]))
        ),
    }


_SERIES_TRUTHS = {
    "mean, automatic blocks": (0.0, "exact"),
    "mean, 16 blocks": (0.0, "exact"),
    "ratio of means": (3.0, "exact"),
    "autocorrelation time": ((1.0 + PHI) / (1.0 - PHI) / 2.0, "exact"),
    "replicas combined": (0.0, "exact"),
    "replicas pooled": (0.0, "exact"),
    "jackknife of a logarithm": (0.02, "exact"),
}


def _nothing() -> None:
    pass


FAMILIES: dict[str, Family] = {
    "spheres": Family(
        f"{SPHERES} spheres in equilibrium, packing fraction {ETA:g}, periodic box, 320 collisions per "
        "particle",
        _spheres,
        _load_spheres,
        _sphere_truths(),
    ),
    "mixture": Family(
        "48 spheres in equilibrium, masses 1:10, diameters 1:2, packing fraction 0.1, 256 collisions per "
        "particle",
        _mixture,
        _load_mixture,
        {"Z of a mixture, virial - rates": (0.0, "exact")},
    ),
    "walls": Family(
        "24 discs in equilibrium, packing fraction 0.2, between walls, 256 collisions per particle",
        _walls,
        _load_walls,
        {},
    ),
    "sound": Family(
        "400 discs in equilibrium, packing fraction 0.2, between walls, 10 and 22 collisions per particle",
        _sound,
        _load_sound,
        {},
    ),
    "relaxation": Family(
        f"{REPLICAS} gases of 200 spheres, packing fraction 0.005, from equal speeds or with one warmer axis",
        _relaxation,
        _load_relaxation,
        {},
    ),
    "temperatures": Family(
        f"{REPLICAS} gases of 120 spheres, masses 1:4, diameters 1:2, temperatures 3:1, packing fraction "
        "0.01",
        _temperatures,
        _load_temperatures,
        {},
    ),
    "series": Family(
        f"series of {LENGTH} samples with a correlation time of 4.5, samples of 12 values",
        _series,
        _nothing,
        _SERIES_TRUTHS,
    ),
}
