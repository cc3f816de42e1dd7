"""What holds for every estimator: one shape, words for what is missing, memory that does not grow with the frames."""

import copy
import importlib
import inspect
import pickle
import pkgutil
import re
from dataclasses import fields, is_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import gas as random_gas
from scipy import stats

import analysis
import hardspheres as hs
from analysis.barometer import HeightProfile
from analysis.distributions import ComponentDistribution, EnergyDistribution, SpeedDistribution
from analysis.estimator import Estimator, NoDataError
from analysis.expansion import Spreading
from analysis.free_path import FreePath
from analysis.helfand import HeatConductivity, MutualDiffusion, Viscosity
from analysis.hexatic import HexaticOrder
from analysis.maxwell_test import MaxwellTest
from analysis.moments import VelocityMoments
from analysis.order import BondOrder
from analysis.pressure import Pressure
from analysis.profile import DensityProfile
from analysis.relaxation import RelaxationCurve
from analysis.statistics import TheoryCheck
from analysis.structure import PairDistribution
from analysis.structure_factor import StructureFactor
from analysis.temperatures import AnisotropyDecay, TemperatureEquilibration
from analysis.transport import Diffusion
from analysis.velocities import FourthCumulant, HFunction, KolmogorovSmirnov
from hardspheres.frame import Tallies
from studies.running.encoding import decode, encode

STREAMING = [
    SpeedDistribution,
    ComponentDistribution,
    EnergyDistribution,
    FourthCumulant,
    KolmogorovSmirnov,
    HFunction,
    VelocityMoments,
    MaxwellTest,
    BondOrder,
    PairDistribution,
    StructureFactor,
    Diffusion,
]
MOMENTS = [Viscosity, HeatConductivity, MutualDiffusion]
REPLICAS = [RelaxationCurve, TemperatureEquilibration, AnisotropyDecay]
WALLED = [Spreading, DensityProfile]
FALLING = [HeightProfile]
PLANAR = [HexaticOrder]
EVERY = [*STREAMING, *MOMENTS, *REPLICAS, *WALLED, *FALLING, *PLANAR, Pressure, FreePath]
# true before anything is added
WITHOUT_DATA = {"n_replicas", "n_blocks", "discarded_rows", "predictions", "flights"}
WITH_SCENE = {"gas", "scene", "labels"}  # where the constructor takes the scene


def new(kind):
    if kind is DensityProfile:
        return kind(axis=0)
    return kind(random_gas("3d", 32, 0.1)) if kind in (Pressure, FreePath) else kind()


def walled(n):
    """A gas between walls along x, whose halves mix."""
    return random_gas("3d_walls", n, 0.1, boundary=("wall", "periodic", "periodic"))


def frames(kind):
    """31 frames (of moments, 91) of a small gas that this kind of estimator can measure."""
    if kind in WALLED:
        return list(hs.Simulation(walled(64)).frames(every=1.0, count=31))
    if kind in FALLING:
        scene = random_gas("2d_mixture_walls", 64, 0.05).replace(gravity=(0.0, -0.1))
        return list(hs.Simulation(scene).frames(every=1.0, count=31))
    species = "3d_mixture" if kind in (TemperatureEquilibration, MutualDiffusion) else "3d"
    scene = random_gas("2d" if kind in PLANAR else species, 64, 0.1)
    if kind in REPLICAS:
        faster = np.where(scene.species == 0, 1.5, 1.0)[:, None] if scene.species.any() else (1.5, 1.0, 1.0)
        scene = scene.replace(velocities=scene.velocities * faster)
    sim = hs.Simulation(scene, free_paths=kind is FreePath, heat=kind is HeatConductivity)
    if kind not in REPLICAS:
        sim.run(collisions=640)
    return list(sim.frames(every=0.3 if kind in REPLICAS else 2.0, count=91 if kind in MOMENTS else 31))


def measured(kind, given):
    """Return an estimator that has seen these frames."""
    estimator = kind(given[0].scene) if kind in (Pressure, FreePath) else new(kind)
    for frame in given:
        estimator.add(frame)
    return estimator


def test_every_estimator_is_tested_here():
    for module in pkgutil.walk_packages(analysis.__path__, "analysis."):
        importlib.import_module(module.name)

    def below(kind):
        return {kind, *(one for own in kind.__subclasses__() for one in below(own))}

    found = {kind for kind in below(Estimator) if kind.__module__.startswith("analysis.")}
    assert {kind for kind in found if not inspect.isabstract(kind)} == set(EVERY)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", EVERY)
def test_one_shape(kind):
    """`add` returns the estimator, parameters and results are read-only, checks, merge, plot into given Axes."""
    *first, last = frames(kind)
    estimator = measured(kind, first)
    assert list(inspect.signature(kind.add).parameters) == ["self", "frame"]
    assert estimator.add(last) is estimator
    assert estimator.gas.n == 64
    names = {name for name in dir(kind) if isinstance(getattr(kind, name), property)} | set(vars(estimator))
    for name in names:
        if not name.startswith("_"):
            with pytest.raises(AttributeError):
                setattr(estimator, name, 1)
    checks = estimator.checks
    assert all(type(check) is TheoryCheck for check in checks)
    assert (checks == []) == (kind in (BondOrder, HexaticOrder))
    assert not any(check.p_value < 1e-4 for check in checks if kind is not RelaxationCurve)
    assert kind.merge is Estimator.merge
    axes = Figure().subplots()
    assert estimator.plot(axes) is axes and estimator.plot(ax=axes) is axes
    assert axes.get_xlabel() and axes.get_ylabel() and axes.get_legend() is not None


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", EVERY)
def test_merged_into_an_empty_one_it_has_the_same_results(kind):
    """And an empty one merged into it changes nothing. Sibling: a second run does."""
    given = frames(kind)
    estimator = measured(kind, given)
    empty = kind(given[0].scene) if kind in (Pressure, FreePath) else new(kind)
    before = encode(estimator)["data"].tobytes()
    assert encode(estimator.merge(empty))["data"].tobytes() == before
    assert same(results(empty.merge(estimator)), results(estimator))
    assert empty.plot(Figure().subplots()).get_xlabel()
    assert not same(results(copy.deepcopy(empty).merge(estimator)), results(estimator))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_checks_see_a_gas_that_is_not_at_equilibrium(gas):
    """Equal speeds, sampled as if independent; sibling: Maxwell's speeds of the same gas."""
    rng = np.random.default_rng(1)
    for kind in (SpeedDistribution, EnergyDistribution, FourthCumulant, KolmogorovSmirnov, HFunction):
        wrong, right = new(kind), new(kind)
        first = gas.frame(gas.maxwell(rng, 64, 3))
        for k in range(60):
            v = gas.maxwell(rng, 64, 3)
            v -= v.mean(axis=0)
            right.add(replace(first, velocities=v, collisions_per_particle=20.0 * k))
            v = gas.equal_speeds(rng, 64, 3) + 0.3 * v
            wrong.add(replace(first, velocities=v, collisions_per_particle=20.0 * k))
        assert right.checks[0].p_value > 1e-3 and wrong.checks[0].p_value < 1e-6


@pytest.mark.parametrize("kind", EVERY)
def test_asked_too_early_it_says_what_to_call(kind):
    results = [
        name
        for name in dir(kind)
        if not name.startswith("_") and isinstance(getattr(kind, name), property) and name not in WITHOUT_DATA
        if not (kind in (Pressure, FreePath) and name in WITH_SCENE)
    ]
    assert results
    for name in results:
        with pytest.raises(NoDataError, match=r"has no .* yet; call .* first"):
            getattr(new(kind), name)
    with pytest.raises(NoDataError, match=r"has no .* yet; call .* first"):
        new(kind).plot()


def sizes(estimator, samples, add):
    """Bytes of the pickled estimator after 1536 and 3072 samples, when block series are equally full."""
    found = []
    for index in range(3072):
        add(estimator, samples(index))
        if index + 1 in (1536, 3072):
            found.append(len(pickle.dumps(estimator)))
    return found


@pytest.mark.parametrize("kind", [*STREAMING, *MOMENTS])
def test_memory_does_not_grow_with_the_frames(kind):
    """One number kept of each of 1536 more frames would be 12 000 bytes."""
    rng = np.random.default_rng(1)
    scene = random_gas("3d_mixture" if kind is MutualDiffusion else "3d", 16, 0.02)
    positions = rng.random((16, 3)) * scene.box

    def frame(index):
        return SimpleNamespace(
            time=float(index),
            collisions_per_particle=float(index),
            positions=positions,
            unwrapped_positions=positions,
            velocities=rng.standard_normal((16, 3)),
            scene=scene,
            tallies=Tallies(
                float(index), 0, 0, *rng.standard_normal((4, 3, 3)), *rng.standard_normal((2, 3))
            ),
        )

    by_levels = kind in (Diffusion, *MOMENTS)
    estimator = kind(points=4) if by_levels else new(kind)
    first, last = sizes(estimator, frame, lambda estimator, frame: estimator.add(frame))
    # those with levels keep one more, of 4 snapshots and up to 256 rows: the logarithm of the number of frames
    assert last - first < (40_000 if by_levels else 1000)


@pytest.mark.parametrize("kind", [*STREAMING[:6], *REPLICAS])
def test_what_is_kept_does_not_grow_with_the_particles(kind, gas):
    """Sibling: the frame itself, of 9 numbers for each of 3000 more particles."""
    rng, found, whole = np.random.default_rng(1), [], []
    for n in (1000, 4000):
        masses = np.where(np.arange(n) % 2, 1.0, 7.0)
        frame = gas.frame(gas.maxwell(rng, n, 3, masses), masses)
        found.append(len(pickle.dumps(new(kind).add(frame))))
        whole.append(len(pickle.dumps(frame)))
    assert found[1] - found[0] < 1000 < whole[1] - whole[0]


@pytest.mark.parametrize("kind", [Pressure, FreePath])
def test_memory_does_not_grow_with_the_blocks(kind):
    sim = hs.Simulation(random_gas("3d", 32, 0.1), free_paths=True)
    sim.run(collisions=200)  # without the first flights, of which a warning would be

    def frame(index):
        sim.run(collisions=1)
        return sim.frame()

    first, last = sizes(kind(sim.scene), frame, lambda estimator, frame: estimator.add(frame))
    assert last - first < 1000


@pytest.mark.parametrize("kind", EVERY)
def test_repr_tells_results_or_that_there_are_none(kind):
    """Sibling: an estimator that has seen nothing; what cannot be told yet raises nothing."""
    name = kind.__name__
    assert repr(new(kind)) == f"<{name}: nothing added yet>"
    special = {
        TemperatureEquilibration: random_gas("3d_mixture", 60, 0.02),
        MutualDiffusion: random_gas("3d_mixture", 60, 0.2),
        Spreading: walled(32),
        DensityProfile: walled(64),
        StructureFactor: random_gas("3d", 60, 0.1),
        HexaticOrder: random_gas("2d", 60, 0.1),
        HeightProfile: random_gas("2d_mixture_walls", 32, 0.05).replace(gravity=(0.0, -0.1)),
    }
    scene = special.get(kind, random_gas("3d", 32, 0.1))
    estimator = kind(scene) if kind in (Pressure, FreePath) else new(kind)
    sim = hs.Simulation(scene, free_paths=kind is FreePath, heat=kind is HeatConductivity)
    sim.run(collisions=0 if kind is Spreading else 400)
    for frame in sim.frames(every=3.0, count=91 if kind in MOMENTS else 21):
        estimator.add(frame)
    text = repr(estimator)
    assert text.startswith(f"<{name} of {scene.n} particles") and "\n" not in text
    assert ("no result yet" in text) == (kind is AnisotropyDecay)  # in an isotropic gas
    assert len(text) < 300 and re.search(
        r"D at packing fraction 0\.\d+, (91|21|20|1) (frames|moments|blocks|replica):", text
    )
    if kind is Pressure:
        assert f"virial {estimator.virial}" in text and "20 blocks" in text


def same(a, b):
    """Whether two results are equal, to the last bit of each number."""
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, part.name), getattr(b, part.name)) for part in fields(a)
        )
    return np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")


def results(estimator):
    """All results by name, or what was raised instead."""
    found = {}
    for name in dir(type(estimator)):
        if not name.startswith("_") and isinstance(getattr(type(estimator), name), property):
            try:
                found[name] = getattr(estimator, name)
            except (hs.HardSpheresError, ValueError) as error:
                found[name] = str(error)
    return found


@pytest.mark.filterwarnings(
    "ignore::analysis.series.SeriesWarning", "ignore::analysis.theory.TheoryRangeWarning"
)
@pytest.mark.parametrize("kind", EVERY)
def test_stored_and_read_again_it_has_the_same_results_and_goes_on(kind):
    """Sibling: other results after another frame."""
    *first, last = frames(kind)
    estimator = measured(kind, first)
    again = decode(encode(estimator))
    assert same(results(estimator), results(again))
    before = results(estimator)
    again.add(last)
    assert not same(before, results(again))
    assert same(results(estimator.add(last)), results(again))


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_checks_of_a_gas_at_equilibrium_are_standard_normal(gas):
    """60 gases of 32 particles at fixed energy, 30 frames each; false alarm 1e-3 for each of the five.

    Siblings: H and a2 beside 0, which is right for N -> infinity only.
    """
    rng, z, wrong = np.random.default_rng(5), {}, {}
    first = gas.frame(gas.maxwell(rng, 32, 3))
    for _ in range(60):
        several = [k() for k in (SpeedDistribution, ComponentDistribution, FourthCumulant, KolmogorovSmirnov)]
        several.append(HFunction(bins=20))
        for index in range(30):
            v = gas.maxwell(rng, 32, 3)
            frame = replace(first, velocities=v - v.mean(axis=0), collisions_per_particle=20.0 * index)
            for estimator in several:
                estimator.add(frame)
        for estimator in several:
            (check,) = estimator.checks
            z.setdefault(type(estimator), []).append(check.z)
            wrong.setdefault(type(estimator), []).append(check.measured.z(0.0))
    for kind, found in z.items():
        assert stats.kstest(found, "norm").pvalue > 1e-3, kind
    for kind in (FourthCumulant, HFunction):
        assert stats.kstest(wrong[kind], "norm").pvalue < 1e-3, kind
