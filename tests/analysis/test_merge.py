"""Two runs in one estimator: values of all data, errors of both, and what cannot be merged is refused."""

import copy
import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis.calibration import calibrate
from analysis.distributions import ComponentDistribution, EnergyDistribution, SpeedDistribution
from analysis.free_path import FreePath
from analysis.order import BondOrder
from analysis.pressure import Pressure
from analysis.relaxation import RelaxationCurve
from analysis.series import estimate_from_runs, estimate_from_series
from analysis.statistics import Estimate, ReplicaWarning, pool_replicas
from analysis.structure import PairDistribution
from analysis.structure_factor import StructureFactor
from analysis.transport import Diffusion
from analysis.velocities import FourthCumulant, HFunction, KolmogorovSmirnov
from studies.running.encoding import decode, encode


def correlated(rng, count, length):
    """Series with mean 1 whose neighbours are correlated by 0.8: 9 samples are worth one independent one."""
    noise = rng.standard_normal((count, length))
    series = np.empty_like(noise)
    series[:, 0] = noise[:, 0] / 0.6
    for k in range(1, length):
        series[:, k] = 0.8 * series[:, k - 1] + noise[:, k]
    return 1.0 + series


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
@pytest.mark.parametrize("lengths", [(1000, 1000), (2000, 800), (1200, 800, 800)])
def test_pooled_errors_of_runs_follow_students_t(lengths):
    """200 times runs of known mean; false alarm 1e-3 and 3 standard errors of the spread.

    Siblings: the error of a single run, which is not reduced, and all runs with equal weights.
    """
    rng = np.random.default_rng(1)
    runs = [correlated(rng, 200, length) for length in lengths]
    pooled = [estimate_from_runs(several) for several in zip(*runs, strict=True)]
    assert calibrate(pooled, 1.0).passed
    first = [
        Estimate(whole.value, estimate_from_series(run).standard_error, 0.0, whole.degrees_of_freedom)
        for whole, run in zip(pooled, runs[-1], strict=True)
    ]
    assert not calibrate(first, 1.0).passed
    if len(set(lengths)) > 1:  # the longer run counts more: closer to the truth than equal weights
        equal = [
            pool_replicas([estimate_from_series(run) for run in r]).value for r in zip(*runs, strict=True)
        ]
        assert np.std([e.value for e in pooled]) < np.std(equal)
    errors = [e.standard_error for e in pooled]
    assert np.median(errors) == pytest.approx(
        3.0 * 1.667 * math.sqrt(0.36) / 0.6 / math.sqrt(sum(lengths)), rel=0.1
    )


def test_short_runs_are_joined():
    """Runs of 5 samples have no errors of their own; 40 of them together have. Sibling: one of them."""
    rng = np.random.default_rng(2)
    estimates = [estimate_from_runs(list(rng.normal(size=(40, 5)))) for _ in range(200)]
    assert calibrate(estimates, 0.0).passed
    assert np.median([e.standard_error for e in estimates]) == pytest.approx(1 / math.sqrt(200), rel=0.1)
    with_long = [rng.normal(size=200), rng.normal(size=1)]
    assert math.isfinite(estimate_from_runs(with_long).standard_error)


def test_runs_that_disagree_warn_and_have_the_error_of_their_spread():
    rng = np.random.default_rng(3)
    runs = [rng.normal(size=400), 2.0 + rng.normal(size=400)]
    with pytest.warns(ReplicaWarning, match="2 replicas spread"):
        estimate = estimate_from_runs(runs)
    assert estimate.standard_error == pytest.approx(1.0, abs=0.1) and estimate.degrees_of_freedom == 1
    with pytest.warns(ReplicaWarning, match="2 replicas spread"):
        estimate = estimate_from_runs([runs[0], np.tile(runs[1], 2)])
    assert estimate.value == pytest.approx(4 / 3, abs=0.2)


MEANS = {  # a main result of each, with its error
    SpeedDistribution: lambda e: (e.density[0, 10], e.density_error[0, 10]),
    ComponentDistribution: lambda e: (e.density[0, 25], e.density_error[0, 25]),
    EnergyDistribution: lambda e: (e.density[0, 5], e.density_error[0, 5]),
    FourthCumulant: lambda e: (e.a2.value, e.a2.standard_error),
    KolmogorovSmirnov: lambda e: (e.distance.value, e.distance.standard_error),
    HFunction: lambda e: (e.excess.value, e.excess.standard_error),
    BondOrder: lambda e: (e.order.value, e.order.standard_error),
    PairDistribution: lambda e: (
        e.compressibility_factor.value,
        e.compressibility_factor.standard_error,
    ),
    StructureFactor: lambda e: (e.structure_factor[2], e.structure_factor_error[2]),
    Diffusion: lambda e: (e.mean_square_displacement[3], e.mean_square_displacement_error[3]),
    Pressure: lambda e: (e.virial.value, e.virial.standard_error),
    FreePath: lambda e: (e.mean_free_path[0].value, e.mean_free_path[0].standard_error),
}


@pytest.fixture(scope="module")
def runs():
    """Each estimator of four independent runs of one gas, 160 frames each."""
    found = []
    for seed in range(4):
        sim = hs.Simulation(random_gas("3d", 64, 0.1, seed=seed), free_paths=True)
        sim.run(collisions=640)
        own = {
            kind: kind(sim.scene) if kind in (Pressure, FreePath) else kind()
            for kind in MEANS
            if kind is not PairDistribution
        }
        own[PairDistribution] = PairDistribution(depth=0.5, bins=30, window=0.5, degree=2)
        for frame in sim.frames(every=1.5, count=160):
            for estimator in own.values():
                estimator.add(frame)
        found.append(own)
    return found


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
@pytest.mark.parametrize("kind", MEANS)
def test_four_runs_halve_the_error_and_give_the_mean(kind, runs):
    """Sibling: the mean of the errors, which are not reduced, is twice as large."""
    parts = [MEANS[kind](run[kind]) for run in runs]
    whole = copy.deepcopy(runs[0][kind])
    for run in runs[1:]:
        assert whole.merge(run[kind]) is whole
    value, error = MEANS[kind](whole)
    assert value == pytest.approx(np.mean([part[0] for part in parts]), abs=0.15 * error)
    unreduced = math.sqrt(np.mean([part[1] ** 2 for part in parts]))
    assert error == pytest.approx(unreduced / 2, rel=0.02) and error < 0.6 * unreduced
    assert [MEANS[kind](run[kind]) for run in runs] == parts  # what was merged stays as it was
    assert MEANS[kind](decode(encode(whole))) == (value, error)
    for check in whole.checks:
        assert check.p_value > 1e-4
    pair = copy.deepcopy(runs[0][kind]).merge(
        copy.deepcopy(runs[1][kind]).merge(runs[2][kind]).merge(runs[3][kind])
    )
    assert MEANS[kind](pair) == pytest.approx((value, error))  # in any order


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_merged_pressure_between_walls_has_the_ends_of_each_run():
    """Forces on walls: the ends of two runs are independent, so that their error falls as 1/sqrt(2) as well."""
    parts = []
    for seed in range(2):
        sim = hs.Simulation(random_gas("3d_walls", 64, 0.05, seed=seed))
        sim.run(collisions=640)
        pressure = Pressure(sim.scene)
        for frame in sim.frames(every=0.5, count=40):
            pressure.add(frame)
        parts.append(pressure)
    whole = copy.deepcopy(parts[0]).merge(parts[1])
    own = [part.walls for part in parts]
    expected = math.hypot(*(e.standard_error for e in own)) / 2
    assert whole.walls.standard_error == pytest.approx(expected, rel=0.01)
    assert whole.walls.value == pytest.approx(np.mean([e.value for e in own]))
    assert whole.wall_forces["y low"].value == pytest.approx(
        np.mean([part.wall_forces["y low"].value for part in parts])
    )


def test_uncertainty_of_theory_is_not_reduced_by_runs(runs):
    """D of the infinite fluid: the correction for the box is the same in all runs."""
    whole = copy.deepcopy(runs[0][Diffusion])
    for run in runs[1:]:
        whole.merge(run[Diffusion])
    window = whole.lags[3], whole.lags[15]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        here, infinite = whole.diffusion(window), whole.infinite_diffusion(window)
        lone = runs[0][Diffusion].infinite_diffusion(window).standard_error ** 2
        own = runs[0][Diffusion].diffusion(window).standard_error ** 2
    assert infinite.standard_error**2 - here.standard_error**2 == pytest.approx(lone - own)
    assert infinite.value - here.value == pytest.approx(
        runs[0][Diffusion].infinite_diffusion(window).value - runs[0][Diffusion].diffusion(window).value
    )


def test_replicas_go_on_after_a_merge():
    """A frame goes on with the own replica, not with that which was merged last."""

    def frame(s, seed):
        scene = random_gas("3d", 32, 0.02, seed=seed)
        return SimpleNamespace(scene=scene, velocities=scene.velocities, time=s, collisions_per_particle=s)

    curve = (
        RelaxationCurve().add(frame(0.0, 1)).merge(RelaxationCurve().add(frame(0.0, 2)).add(frame(1.0, 3)))
    )
    curve.add(frame(1.0, 4))
    assert curve.n_replicas == 2 and list(curve.s) == [0.0, 1.0]
    other = RelaxationCurve().merge(curve)
    other.add(frame(2.0, 5))  # it has no own replica yet
    assert other.n_replicas == 3 and curve.n_replicas == 2


@pytest.mark.parametrize("kind", [RelaxationCurve, FourthCumulant, SpeedDistribution, BondOrder, Diffusion])
def test_a_run_that_goes_on_after_it_was_merged_changes_nothing_there(kind):
    """Sibling: merged again, it does."""
    first, second = kind(), kind()
    sims = [hs.Simulation(random_gas("3d", 32, 0.1, seed=seed)) for seed in (1, 2)]
    for estimator, sim in zip((first, second), sims, strict=True):
        for frame in sim.frames(every=0.5, count=40):
            estimator.add(frame)
    first.merge(second)
    before = encode(first)["data"].tobytes()
    sims[1].run(time=0.5)
    second.add(sims[1].frame())
    assert encode(first)["data"].tobytes() == before
    assert encode(first.merge(second))["data"].tobytes() != before


@pytest.mark.parametrize(
    ("one", "other", "sentence"),
    [
        (FourthCumulant(), HFunction(), "a FourthCumulant cannot be merged with a HFunction"),
        (HFunction(60), HFunction(30), "two HFunctions of different edges cannot be merged"),
        (Diffusion(8), Diffusion(16), r"two Diffusions of different points \(8 and 16\) cannot be merged"),
        (
            Diffusion(8),
            Diffusion(8, species=1),
            r"two Diffusions of different species \(None and 1\) cannot be merged",
        ),
    ],
)
def test_other_parameters_are_refused(one, other, sentence):
    with pytest.raises(ValueError, match=sentence):
        one.merge(other)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"n": 40}, r"particles of each species \[40\]; expected \[32\]"),
        ({"packing_fraction": 0.03}, "box .*; expected"),
        ({"temperature": 2.0}, "temperature 2; expected 1"),
        ({"boundary": "wall"}, "boundary .*wall.*; expected .*periodic"),
        ({"radii": 0.6}, "box .*; expected"),
        ({"masses": 2.0}, "masses .*; expected"),
    ],
)
def test_another_gas_is_refused_and_nothing_is_merged(change, sentence):
    """Sibling: another start of the same gas."""
    given = {"n": 32, "packing_fraction": 0.02}
    scene, other, again = (hs.random_gas(**o, seed=k) for k, o in enumerate([given, given | change, given]))
    for kind in (RelaxationCurve, FourthCumulant, SpeedDistribution):
        estimator = kind().add(hs.Simulation(scene).frame())
        with pytest.raises(
            ValueError, match=f"a {kind.__name__} of another gas cannot be merged: {sentence}"
        ):
            estimator.merge(kind().add(hs.Simulation(other).frame()))
        before = repr(estimator)
        estimator.merge(kind().add(hs.Simulation(again).frame()))
        assert repr(estimator) != before or kind is SpeedDistribution
        with pytest.raises(ValueError, match="with itself: its data would count twice"):
            estimator.merge(estimator)


def test_other_spacing_and_lack_of_free_paths_are_refused():
    scene = random_gas("3d_mixture", 32, 0.02)
    one, other, with_paths = Diffusion(4), Diffusion(4), Pressure(scene)
    sim = hs.Simulation(scene, free_paths=True, search="lists")
    for frame in sim.frames(every=0.5, count=9):
        one.add(frame)
        with_paths.add(frame)
    sim, without = hs.Simulation(scene), Pressure(scene)
    for frame in sim.frames(every=0.25, count=9):
        other.add(frame)
        without.add(frame)
    with pytest.raises(ValueError, match=r"samples 0.5 and 0.25 apart in time cannot be merged"):
        one.merge(other)
    with pytest.raises(ValueError, match="one of the runs has free paths and one has none"):
        with_paths.merge(without)
