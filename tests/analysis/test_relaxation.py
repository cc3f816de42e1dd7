"""The relaxation curve: bookkeeping of replicas, and the physics of a Boltzmann gas of known fate."""

import math
import pickle

import numpy as np
import pytest
from scenes import gas as random_gas

import hardspheres as hs
from analysis import theory
from analysis.estimator import NoDataError
from analysis.relaxation import RelaxationCurve
from analysis.statistics import Estimate
from analysis.temperatures import AnisotropyDecay
from analysis.velocities import FourthCumulant, ks_distance, reduced_velocities
from hardspheres.velocities import BEAM_DIRECTION

S = [0.0, 1.0, 2.0, 5.0]


@pytest.fixture(scope="module")
def curve(boltzmann, gas):
    rng = np.random.default_rng(1)
    curve = RelaxationCurve()
    for replica in range(20):
        for frame in boltzmann(gas.equal_speeds(rng, 4000, 3), S, seed=replica):
            curve.add(frame)
    return curve


def test_replicas_are_told_apart_by_s(curve):
    assert (curve.n_replicas, curve.n_per_replica, curve.dim, curve.labels) == (20, 4000, 3, ["all"])
    np.testing.assert_allclose(curve.s, S)
    assert curve.a2_samples.shape == (20, 4)
    assert curve.a2_covariance.shape == (4, 4)
    np.testing.assert_allclose(np.sqrt(np.diag(curve.a2_covariance)), curve.a2_error)


def test_moments_are_those_of_the_frames(gas):
    rng = np.random.default_rng(2)
    masses = np.repeat([1.0, 4.0], [300, 500])
    frames = [gas.frame(gas.maxwell(rng, 800, 3, masses), masses, s=0.0) for _ in range(3)]
    curve = RelaxationCurve()
    for frame in frames:
        curve.add(frame)
    assert curve.n_replicas == 3
    for row, frame in zip(curve.a2_samples, frames, strict=True):
        assert row[0] == pytest.approx(FourthCumulant().add(frame).a2.value, rel=1e-12)
    speeds = np.concatenate([np.linalg.norm(reduced_velocities(frame)[0], axis=1) for frame in frames])
    assert curve.ks[0] == pytest.approx(ks_distance(speeds, 3), abs=1.1 / len(speeds) + 1e-3)
    assert curve.temperature_by_species.shape == (1, 2)
    share = curve.temperature_by_species[0] @ [300, 500] / 800
    assert share == pytest.approx(curve.degrees_of_freedom / 2400, rel=1e-12)
    assert curve.temperature_by_axis[0].sum() == pytest.approx(3 * share, rel=1e-12)
    edges, density, error = curve.speed_histogram(0, bins=32)
    assert density.shape == error.shape == (2, 32)
    np.testing.assert_allclose((density * np.diff(edges)).sum(axis=1), 1.0)
    with pytest.raises(ValueError, match="bins = 33"):
        curve.speed_histogram(0, bins=33)


def test_merging_and_pickling_change_nothing(curve, boltzmann, gas):
    rng = np.random.default_rng(1)
    merged = RelaxationCurve()
    for replica in range(20):
        part = RelaxationCurve()
        for frame in boltzmann(gas.equal_speeds(rng, 4000, 3), S, seed=replica):
            part.add(frame)
        merged.merge(pickle.loads(pickle.dumps(part)))
    for name in ("s", "a2", "a2_error", "a3", "ks", "ks_error", "h", "h_error"):
        np.testing.assert_array_equal(getattr(merged, name), getattr(curve, name), err_msg=name)
    assert len(pickle.dumps(part)) < 40_000  # 6 kB for each frame of 4000 particles, which has 192 kB


def test_what_was_found_of_all_replicas_is_that_of_what_was_added_so_far(gas):
    """After more was added or merged, and whatever became of the arrays. Control: it changes each time."""
    rng = np.random.default_rng(4)
    drawn = [gas.maxwell(rng, 200, 3) for _ in range(3)]
    peculiar = [v - v.mean(axis=0) for v in drawn]
    frames = [gas.frame(v / np.sqrt((v**2).mean()), np.ones(200), s=0.0) for v in peculiar]  # one temperature
    curve, found = RelaxationCurve(), []
    for k, more in enumerate((curve.add, curve.add, lambda frame: curve.merge(RelaxationCurve().add(frame)))):
        more(frames[k])
        afresh = RelaxationCurve()
        for frame in frames[: k + 1]:
            afresh.add(frame)
        curve.ks.fill(7.0)
        found.append((curve.ks[0], curve.h[0]))
        assert found[-1] == (afresh.ks[0], afresh.h[0])
        np.testing.assert_array_equal([curve.ks_error, curve.h_error], [afresh.ks_error, afresh.h_error])
    assert len(set(found)) == 3


def test_equal_speeds_relax_as_the_boltzmann_equation_says(curve):
    assert curve.starts_from_equal_speeds
    comparison = curve.compare()
    assert comparison.chi_square.p_value > 1e-3
    assert comparison.chi_square.degrees_of_freedom == 3
    assert np.isnan(comparison.a2_z[0])
    rate = curve.fit_rate((2, 5))
    assert abs(rate.deviation(theory.equal_speeds_decay_rate(3).value)) < 4
    assert rate.standard_error < 0.05


def test_the_rate_of_the_table_is_the_stated_one():
    """The estimator's definition of the rate, applied to the table itself, gives 0.4355 and 0.3797."""
    for dim, expected in ((3, 0.4355), (2, 0.3797)):
        table = theory.boltzmann_equal_speeds([2.0, 5.0], dim)
        assert np.log(table.a2[0] / table.a2[1]) / 3 == pytest.approx(expected, abs=5e-5)


def test_a_wrong_collision_rule_is_rejected(gas):
    """Every collision exchanges the velocities: energy and momentum are kept, speeds are not touched, nothing relaxes."""
    rng = np.random.default_rng(3)
    curve = RelaxationCurve()
    for _ in range(10):
        v = gas.equal_speeds(rng, 1000, 3)
        for s in S:
            curve.add(gas.frame(rng.permutation(v), s=s))
    comparison = curve.compare()
    assert np.abs(comparison.a2_z[1:]).min() > 20  # of 10 replicas
    assert comparison.chi_square.p_value < 1e-6


def test_a_subtly_wrong_collision_rule_is_rejected(boltzmann, gas):
    """Discs deflected by every angle alike: all is conserved, equilibrium is the same, only the way there is not."""
    curves = []
    for even in (False, True):
        rng = np.random.default_rng(7)
        curve = RelaxationCurve()
        for replica in range(20):
            for frame in boltzmann(gas.equal_speeds(rng, 10000, 2), S, seed=replica, even=even):
                curve.add(frame)
        curves.append(curve)
    right, wrong = (curve.compare().chi_square.p_value for curve in curves)
    assert right > 1e-3
    assert wrong < 1e-6
    assert np.abs(curves[1].ks[-1] - curves[0].ks[-1]) < 0.02


def test_fewer_than_two_replicas(curve, boltzmann, gas):
    one = RelaxationCurve()
    for frame in boltzmann(gas.equal_speeds(np.random.default_rng(4), 4000, 3), S, seed=99):
        one.add(frame)
    np.testing.assert_allclose(one.a2_error, theory.cumulant_noise(4000, 3))
    assert np.isnan(one.ks_error).all() and np.isnan(one.fit_rate().standard_error)
    assert one.compare().chi_square is None
    with pytest.raises(NoDataError, match="second replica"):
        _ = one.a2_covariance


def test_equilibrium_has_no_rate(gas):
    rng = np.random.default_rng(5)
    curve = RelaxationCurve()
    for _ in range(10):
        for s in S:
            curve.add(gas.frame(gas.maxwell(rng, 1000, 3), s=s))
    assert not curve.starts_from_equal_speeds
    with pytest.raises(ValueError, match="lost in the noise"):
        curve.fit_rate()
    assert np.abs(curve.a2 / curve.a2_error).max() < 4
    assert np.abs(curve.h / curve.h_error).max() < 5


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.7, 0.6, 0.4]])
def test_beams_are_not_taken_for_random_directions(gas, direction):
    unit = np.array(direction) / np.linalg.norm(direction)
    v = np.outer(np.repeat([1.0, -1.0], 500), unit)
    curve = RelaxationCurve().add(gas.frame(v))
    assert not curve.starts_from_equal_speeds
    assert curve.preferred_direction == pytest.approx(unit)
    value, error = curve.temperature_along(unit)
    assert value[0] == pytest.approx(3) and 0 < error[0] < 0.1
    assert curve.temperature_by_axis[0] == pytest.approx(3 * unit**2, rel=2e-3)
    calm = RelaxationCurve().add(gas.frame(gas.maxwell(np.random.default_rng(8), 1000, 3)))
    assert calm.preferred_direction is None
    pair = RelaxationCurve().add(gas.frame(np.outer([1.0, -1.0], unit)))
    assert pair.preferred_direction is None  # two always fly along one line


@pytest.mark.parametrize(("dim", "eta"), [(3, 0.001), (2, 2e-5)])
def test_beams_relax_as_the_boltzmann_equation_says(dim, eta, boltzmann):
    """T_par/T - 1 and a2 of two beams at s = 1, against direct simulation; 3D: .875(1) and -.3279(2) elsewhere.

    Sibling: along x of the periodic box, where those who met nobody fly through the same cylinder again.
    """
    direction, n = BEAM_DIRECTION[dim], 4000

    def measured(frames_of, replicas, along):
        decay, curve = AnisotropyDecay(along), RelaxationCurve()
        for seed in range(replicas):
            for frame in frames_of(seed):
                decay.add(frame)
                curve.add(frame)
        return [(decay.anisotropy[-1], decay.anisotropy_error[-1]), (curve.a2[-1], curve.a2_error[-1])]

    def simulated(replicas, along):
        def frames_of(seed):
            scene = random_gas(f"{dim}d", n, eta, seed=seed, velocities="beams")
            scene = scene.replace(velocities=np.outer(scene.velocities @ direction, along))
            return hs.Simulation(scene).frames(collisions_per_particle=[0, 1])

        return measured(frames_of, replicas, along)

    start = math.sqrt(dim) * np.outer(np.repeat([1.0, -1.0], 20_000), np.eye(dim)[0])
    known = measured(lambda seed: boltzmann(start, [0.0, 1.0], seed), 8, 0)
    if dim == 3:
        assert abs(known[0][0] - 0.875) < 3 * math.hypot(known[0][1], 0.001)
        assert abs(known[1][0] + 0.3279) < 3 * math.hypot(known[1][1], 0.0002)
    table = theory.boltzmann_beams([0.0, 1.0], dim)
    for (value, error), column, own in zip(
        known, (table.anisotropy, table.a2), (table.anisotropy_error, table.a2_error), strict=True
    ):
        assert abs(Estimate(value, error, 8, 7).z(column[1], own[1])) < 3.5
    assert (table.anisotropy[0], table.a2[0]) == pytest.approx((dim - 1, -2 / (dim + 2)))
    generic, along_x = simulated(4, direction), simulated(1, np.eye(dim)[0])
    for (value, error), (other, its_error) in zip(generic, known, strict=True):
        assert abs(Estimate(value, error, 4, 3).z(other, its_error)) < 3.5  # false alarm 5e-4
    assert abs(along_x[0][0] - known[0][0]) > 4 * max(math.hypot(generic[0][1], known[0][1]), 0.01)


def test_a_mixture_is_thermal_when_its_species_are(gas):
    """T1/T = 1.05: a2 of all together is noise, and the gas is not thermal; at one temperature (sibling) it is."""
    rng, masses = np.random.default_rng(9), np.repeat([1.0, 10.0], 1000)
    for ratio, late in ((1.1, ["T1/T", "T2/T"]), (1.0, [])):
        curve = RelaxationCurve()
        for _ in range(10):
            v = gas.maxwell(rng, 2000, 3, masses)
            v[:1000] *= math.sqrt(ratio)
            curve.add(gas.frame(v, masses))
        checks = {check.quantity: check for check in curve.equilibrium_checks}
        assert list(checks) == ["a2", "T1/T", "T2/T"]
        assert abs(checks["a2"].z) < 4
        assert [check.quantity for check in curve.not_thermal] == late
        assert checks["T1/T"].measured.value == pytest.approx(2 * ratio / (1 + ratio), abs=0.02)
    # few particles of unequal mass and no momentum: not T itself, but what theory says
    few, masses = RelaxationCurve(), np.array([1.0, 1.0, 9.0, 9.0])
    for _ in range(2000):
        few.add(gas.frame(gas.maxwell(rng, 4, 3, masses), masses))
    assert few.not_thermal == []
    assert abs(few.equilibrium_checks[2].measured.z(1.0)) > 10


def test_two_replicas_make_no_discovery(boltzmann, gas):
    """z of two replicas is a normal deviate: within 4.5 at every point of 30 curves; in standard errors (sibling) it is not."""
    rng, worst, naive = np.random.default_rng(10), [], []
    for seed in range(0, 60, 2):
        curve = RelaxationCurve()
        for replica in (seed, seed + 1):
            for frame in boltzmann(gas.equal_speeds(rng, 400, 3), [0.0, 0.5, 1.0, 2.0], seed=replica):
                curve.add(frame)
        comparison = curve.compare()
        worst.append(np.abs(comparison.a2_z[1:]).max())
        naive.append(np.abs((curve.a2 - comparison.a2)[1:] / curve.a2_error[1:]).max())
    assert max(worst) < 4.5 and max(naive) > 9


def test_misuse_is_named(curve, gas):
    empty = RelaxationCurve()
    with pytest.raises(NoDataError, match=r"no replicas yet; call add\(frame\) first"):
        _ = empty.a2
    with pytest.raises(ValueError, match="not sampled at s = 3"):
        curve.fit_rate((3, 5))
    rng = np.random.default_rng(6)
    uneven = RelaxationCurve().add(gas.frame(gas.maxwell(rng, 100, 3), s=0.0))
    uneven.add(gas.frame(gas.maxwell(rng, 100, 3), s=1.0)).add(gas.frame(gas.maxwell(rng, 100, 3), s=0.0))
    with pytest.raises(ValueError, match="replica 1 was sampled at 1 values of s"):
        _ = uneven.a2
    with pytest.raises(ValueError, match="frame has 2 dimensions"):
        uneven.add(gas.frame(gas.maxwell(rng, 100, 2), s=1.0))
    with pytest.raises(ValueError, match="of another gas cannot be merged: dimension 2; expected 3"):
        uneven.merge(RelaxationCurve().add(gas.frame(gas.maxwell(rng, 100, 2))))


def test_plot(curve):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert curve.plot(axes) is axes
    assert "Boltzmann equation" in axes.get_legend_handles_labels()[1]
