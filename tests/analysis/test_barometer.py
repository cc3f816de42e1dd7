"""Fluids under gravity: the barometric law of few particles, hydrostatics, adsorption, the balance of forces."""

import itertools
import math

import numpy as np
import pytest
from scenes import gas as random_gas
from scipy import integrate

import hardspheres as hs
from analysis import theory
from analysis.barometer import HeightProfile
from analysis.statistics import deviates
from analysis.theory import Barometer


def points(n, height=30.0, area=1e9):
    """N points of weight 1 in a box so high that hardly any meets the lid."""
    return Barometer((n,), (1.0,), area, height, 1e-3, 3, 3.0 * n)


def column(**other):
    """A column of spheres that is dense at the floor, eta = 0.3."""
    given = {"counts": (4000,), "weights": (0.1,), "area": 400.0, "height": 60.0, "diameter": 1.0, "dim": 3}
    return Barometer(**{**given, "freedom": 12000.0} | other)


EDGES = np.linspace(0.0, 30.0, 31)


def test_points_at_fixed_energy_have_the_exact_law():
    """To order 1/N: the deviation falls by four where N doubles. Sibling: that of fixed temperature, by two."""
    off, canonical, warm = [], [], []
    for n in (40, 80):
        found = points(n).profile(EDGES).value[0] * 1e9 / n
        exact = [
            integrate.quad(lambda z, n=n: theory.barometric_density(z, n, 3 * n, 1.0, 1.0), *pair)[0]
            for pair in itertools.pairwise(EDGES[:6])
        ]
        off.append(np.abs(found[:5] / exact - 1.0).max())
        canonical.append(np.abs(-np.diff(np.exp(-EDGES[:6])) / exact - 1.0).max())
        middle = (EDGES[1:] + EDGES[:-1])[:5] / 2
        expected = theory.barometric_temperature(middle, n, 3 * n, 1.0, 1.0)
        # within a slice those below are warmer and more
        warm.append(np.abs(points(n).temperatures(EDGES)[0, :5] - expected).max())
    assert off[1] < 0.3 * off[0] and off[1] < 3e-3
    assert 0.4 < canonical[1] / canonical[0] < 0.6 and canonical[1] > 4.0 * off[1]
    assert warm[1] < 2e-3 and warm[1] < 0.6 * warm[0]


def test_the_exact_law_is_one():
    """Normalised, its mean height and its temperature those of physics: <m g z> = kT, and kT the mean of all."""
    n, f = 7, 18
    p = [
        integrate.quad(lambda z, k=k: z**k * theory.barometric_density(z, n, f, 2.0, 1.5), 0, 12.0)[0]
        for k in (0, 1)
    ]
    assert p == pytest.approx([1.0, 0.75], rel=1e-9)
    mean = integrate.quad(
        lambda z: (
            theory.barometric_density(z, n, f, 2.0, 1.5) * theory.barometric_temperature(z, n, f, 2.0, 1.5)
        ),
        0,
        12.0,
    )[0]
    assert mean == pytest.approx(1.5, rel=1e-9)
    many = theory.barometric_density(1.3, 10**9, 3e9, 2.0, 1.5)
    assert many == pytest.approx(2.0 / 1.5 * math.exp(-2.6 / 1.5), rel=1e-7)


def test_hydrostatics():
    """dP/dz = -m g rho in every slice, and all particles are somewhere. Sibling: the barometric law does not."""
    one = column()
    edges = np.linspace(0.0, 60.0, 61)
    density, pressure = one.bulk(edges)
    for values, fits in ((density, True), (density[0] * np.exp(-0.1 * (edges[1:] + edges[:-1]) / 2), False)):
        eta = theory.packing_fraction(values, 1.0, 3)
        p = values * theory.compressibility_factor(eta, 3).value if not fits else pressure
        slope = (p[2:] - p[:-2]) / 2.0
        assert np.allclose(slope, -0.1 * values[1:-1], rtol=5e-3, atol=0) == fits
    assert theory.packing_fraction(density[0], 1.0, 3) > 0.2
    layers = theory.adsorption(one.floor(), 3).value * 400.0
    assert 400.0 * density.sum() == pytest.approx(4000 - layers, rel=1e-3)
    assert layers > 30
    assert one.temperature(one.energy(1.3)) == pytest.approx(1.3, rel=1e-9)
    (mean,) = one.mean_heights(edges)
    assert one.energy() - 6000.0 == pytest.approx(0.1 * 4000 * mean.value, rel=1e-3)


def test_masses_of_one_diameter():
    """Each species falls off by its own weight; two species that are the same are one."""
    edges = np.linspace(0.0, 60.0, 31)
    whole = column().profile(edges).value[0]
    halves = column(counts=(1000, 3000), weights=(0.1, 0.1)).profile(edges).value
    assert halves[0] == pytest.approx(0.25 * whole, rel=1e-9)
    assert halves.sum(axis=0) == pytest.approx(whole, rel=1e-9)
    light, heavy = column(counts=(2000, 2000), weights=(0.05, 0.15)).bulk(edges), None
    mixed = column(counts=(2000, 2000), weights=(0.05, 0.15)).profile(edges).value
    ratio = np.log(mixed[1] / mixed[0])
    assert np.diff(ratio) == pytest.approx(np.full(29, -0.1 * 2.0), abs=3e-3)
    assert light[0] == pytest.approx(mixed.sum(axis=0), rel=5e-3) and heavy is None


def test_a_column_that_would_freeze_has_no_theory():
    assert np.isnan(column(weights=(1.5,)).profile(np.linspace(0, 60, 5)).value).all()
    assert np.isfinite(column().profile(np.linspace(0, 60, 5)).value).all()


@pytest.mark.parametrize(("dim", "exact"), [(3, 9 / math.pi), (2, 32 / (3 * math.pi**2))])
def test_adsorption_at_low_density(dim, exact):
    """rho^2 times the integral of what a wall takes of the excluded volume; the second dimension within its u."""
    eta = 1e-5
    found = theory.adsorption(eta, dim)
    assert abs(found.value / eta**2 - exact) < (1e-3 if dim == 3 else found.uncertainty / eta**2)
    assert theory.adsorption(0.2, dim).value > 0.0


@pytest.mark.parametrize("g", [-0.3, 0.3])
def test_floor_and_lid_carry_the_weight(g):
    """Exactly, with the change of momentum; sibling: without it they do not."""
    sim = hs.Simulation(random_gas("2d_mixture_walls", 24, 0.05, seed=3).replace(gravity=(0.0, g)))
    profile = HeightProfile(4)
    for frame in sim.frames(times=[1.3, 4.0, 9.1]):
        profile.add(frame)
    assert abs(profile.support[0]) < 1e-13
    assert abs(profile.checks[-2].measured.value - 1.0) > 1e-3
    above = profile.mean_heights[0].value
    assert 0.0 < above < 0.5 * profile.edges[0, -1]  # it falls to where gravity pulls
    volume = profile._area()[:, None] * np.diff(profile.edges, axis=1)
    assert (profile.densities[0] * volume).sum(axis=1) == pytest.approx([12.0, 12.0])
    assert profile.theory is None and all(math.isnan(each.expected) for each in profile.checks[:2])


def few(n, seed):
    """Tiny discs between walls, of the kind of scene that all tests compile."""
    rng = np.random.default_rng(seed)
    off = 1.0 + 1e-9 * (np.arange(n) % 2)
    positions = np.column_stack([(np.arange(n) + 0.5) / n, rng.uniform(0.1, 2.0, n)])
    velocities = rng.normal(size=(n, 2))
    scene = hs.Scene(positions, velocities, 0.01 * off, off, (1.0, 13.0), "wall", gravity=(0.0, -1.0))
    speeds = velocities * math.sqrt(2.0 * (2.0 * n - scene.potential_energy) / (velocities**2).sum())
    return scene.replace(velocities=speeds)


def test_a_few_discs_at_all_heights():
    """Six discs, 16 gases of 300 moments: the exact law and temperature, G2. False alarm 1e-3 each.

    Sibling: a temperature that is the same at all heights, and the law of fixed temperature.
    """
    n, profile = 6, HeightProfile(26)
    for seed in range(16):
        for frame in hs.Simulation(few(n, seed)).frames(times=100.0 + 25.0 * np.arange(300)):
            profile.add(frame)
    z, edges = profile.heights[0][:6], profile.edges[0]
    kt = 2.0 * n / (2 * n)  # E = 2 n = kT (n + f/2)
    density, error = (each[:, :6] for each in profile.densities)
    exact = np.diff(
        [integrate.quad(theory.barometric_density, 0, x, (n, 2 * n, 1.0, kt))[0] for x in edges[:7]]
    )
    law = n / 2 * exact / np.diff(edges)[:6] / profile._area()[0]

    def squares(off, error):
        return float((deviates(off, error, 0.0, 15.0) ** 2).sum())  # of 12: 33 in 1e-3

    assert squares(density - law, error) < 33.0
    warm, spread = (each[:, :6] for each in profile.temperatures)
    expected = theory.barometric_temperature(z, n, 2 * n, 1.0, kt)
    assert squares(warm - expected, spread) < 33.0
    assert squares(warm - kt, spread) > 80.0
    canonical = n / 2 * -np.diff(np.exp(-edges[:7] / kt)) / np.diff(edges)[:6] / profile._area()[0]
    assert squares(density - canonical, error) > 40.0
    assert all(abs(each.z) < 4.0 for each in profile.checks)


BAD = [
    ((0.0, 0.0), "the gas needs gravity along one axis, towards one wall"),
    ((0.1, -0.1), "the gas needs gravity along one axis, towards one wall"),
]


@pytest.mark.parametrize(("gravity", "sentence"), BAD)
def test_gases_that_have_no_floor(gravity, sentence):
    frame = hs.Simulation(random_gas("2d_mixture_walls", 8, 0.01).replace(gravity=gravity)).frame()
    with pytest.raises(ValueError, match=sentence):
        HeightProfile().add(frame)


def test_frames_of_another_gas():
    scene = random_gas("2d_mixture_walls", 8, 0.01).replace(gravity=(0.0, -0.1))
    profile = HeightProfile(3).add(hs.Simulation(scene).frame())
    faster = hs.Simulation(scene.replace(velocities=2.0 * scene.velocities)).frame()
    with pytest.raises(ValueError, match=r"of another gas: energy per degree of freedom .*; expected"):
        profile.add(faster)
    with pytest.raises(ValueError, match="cells = 1; a profile has at least 2"):
        HeightProfile(1)
