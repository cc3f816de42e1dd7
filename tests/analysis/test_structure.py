"""Pair distribution: exact for ideal and tabulated gases, calibrated contact values, crystals told from fluids."""

import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scenes import gas as random_gas

import hardspheres as hs
from analysis import theory
from analysis.calibration import calibrate
from analysis.estimator import NoDataError
from analysis.order import BondOrder
from analysis.pressure import Pressure
from analysis.series import SeriesWarning, estimate_from_series
from analysis.structure import ContactSamplingWarning, PairDistribution
from hardspheres.compression import order_of_crystal


def frames(scene, count, equilibration=40.0, apart=3.0):
    """Frames at equal times, about so many collisions per particle apart."""
    sim = hs.Simulation(scene)
    sim.run(collisions=int(equilibration * scene.n / 2))
    yield from sim.frames(every=apart * sim.time / equilibration, count=count)


@pytest.mark.parametrize("kind", ["3d", "2d"])
def test_points_without_correlation_have_g_of_one(kind):
    """Points placed at random, with particles too small to matter: g = 1 - 1/N in every bin."""
    rng = np.random.default_rng(1)
    scene = random_gas(kind, 60, 1e-6)
    depth = 0.4 * float(scene.box[0]) / float(2 * scene.radii[0]) - 1.0
    pairs = PairDistribution(depth=depth, bins=40, window=depth)
    for _ in range(400):
        pairs.add(SimpleNamespace(scene=scene, positions=rng.random((60, scene.dim)) * scene.box))
    z = (pairs.g - (1 - 1 / 60)) / np.where(pairs.g_error > 0, pairs.g_error, np.inf)
    assert np.abs(z).max() < 4.5
    assert np.abs(z[0, 10:].std() - 1) < 0.5
    assert pairs.r.shape == pairs.g.shape == (1, 40)


@pytest.mark.parametrize("dim", [2, 3])
def test_extrapolation_is_exact_for_polynomials(dim):
    """g averaged over shells of a cubic in r: the contact value comes back to round-off, not that of the first bin."""
    scene = random_gas(f"{dim}d", 200, 0.1)
    pairs = PairDistribution()
    pairs._begin(scene)
    edges = pairs.edges
    nodes, weights = np.polynomial.legendre.leggauss(8)
    x = (edges[:-1] + edges[1:])[:, None] / 2 + np.diff(edges)[:, None] / 2 * nodes
    measure = weights * (1 + x) ** (dim - 1)
    g = ((3 - 5 * x + 4 * x**2 - x**3) * measure).sum(axis=1) / measure.sum(axis=1)
    assert g @ pairs._extrapolation(3) == pytest.approx(3.0, rel=1e-9)
    assert abs(g[0] - 3.0) > 0.01 and abs(g @ pairs._extrapolation(1) - 3.0) > 0.01


@pytest.mark.parametrize(("kind", "n", "eta"), [("3d", 500, 0.3), ("2d", 400, 0.4)])
def test_contact_value_beside_theory(kind, n, eta):
    pairs = PairDistribution(depth=1.0 if kind == "3d" else 2.0, bins=100 if kind == "3d" else 200)
    for frame in frames(random_gas(kind, n, eta), 150):
        pairs.add(frame)
    check = pairs.check
    assert abs(check.z) < 3.5
    assert check.measured.standard_error / check.measured.value < 0.02
    dim = int(kind[0])
    contact = pairs.contact[(0, 0)]
    finite = theory.finite_size_compressibility(eta, dim, n, "canonical")
    assert (
        abs(contact.deviation((finite.value - 1) / (2 ** (dim - 1) * eta))) < 3.5 + pairs.extrapolation_bias
    )
    # sibling: g = 1 at contact, as in the dilute gas, and a gas 5 % denser
    assert abs(contact.deviation(1.0)) > 10
    denser = theory.finite_size_compressibility(1.05 * eta, dim, n).value
    assert abs(check.measured.deviation(denser, check.uncertainty)) > 3
    axes = Figure().subplots()
    assert pairs.plot(axes) is axes


def sparse(rng, count, depth=8.0):
    """Pairs from so many frames of 30 points without correlation: g = 1 - 1/N. Some 2 pairs in 25 frames are within 8."""
    scene = random_gas("3d", 30, 1e-6)
    pairs = PairDistribution(depth=depth, bins=30, window=depth, degree=2)
    for _ in range(count):
        pairs.add(SimpleNamespace(scene=scene, positions=rng.random((30, 3)) * scene.box))
    return pairs


def test_no_pair_near_contact_is_no_certainty():
    """Of 16 frames none has a pair near contact: Z = 1 was quoted without error, and far from any theory."""
    pairs = sparse(np.random.default_rng(3), 16, 0.5)
    assert pairs.g.max() == 0.0
    z = pairs.compressibility_factor
    assert z.value == 1.0 and z.standard_error > 0.0
    assert abs(pairs.check.z) < 1 and abs(pairs.contact[(0, 0)].z(1.0)) < 1
    assert np.all(np.abs(pairs.g - 1) / pairs.g_error < 1)
    # sibling: blocks of what was seen leave nothing over
    assert pairs._blocks.rows.std() == 0.0


@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_sparse_pairs_cover():
    """200 runs that see some 4 pairs each: 2 standard errors hold in 95 % of them, with blocks alone (sibling) they do not."""
    rng, truth = np.random.default_rng(4), 1 - 1 / 30
    missed, errors, blocks = [], [], []
    for _ in range(200):
        pairs = sparse(rng, 50)
        contact = pairs.contact[(0, 0)]
        missed.append(abs(contact.value - truth))
        errors.append(contact.standard_error)
        blocks.append(estimate_from_series(pairs._contact_rows()[0][:, 0]).standard_error)
    beyond = [np.mean(np.array(missed) > 2 * np.array(error)) for error in (errors, blocks)]
    assert beyond[0] < 0.1 < beyond[1]  # chance: 5 +- 1.5 %
    assert np.square(errors).mean() < 2.5 * np.square(missed).mean()  # and they are not far too large


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::analysis.series.SeriesWarning")
def test_errors_of_the_contact_value_follow_students_t():
    truth = theory.finite_size_compressibility(0.1, 3, 50)
    estimates = []
    for seed in range(80):
        pairs = PairDistribution(depth=0.5, bins=30, window=0.5, degree=2)
        for frame in frames(random_gas("3d", 50, 0.1, seed=seed), 60, equilibration=15, apart=1.5):
            pairs.add(frame)
        estimates.append(pairs.compressibility_factor)
    assert calibrate(estimates, truth.value).passed


def test_frames_taken_at_collisions_are_told():
    """One pair in contact in every frame: in a small dilute gas that is most of what is near contact."""
    sim = hs.Simulation(random_gas("3d", 50, 0.02))
    pairs = PairDistribution(depth=0.5, bins=30, window=0.5, degree=2)
    for frame in sim.frames(collisions_per_particle=np.arange(20, 80)):
        pairs.add(frame)
    with pytest.warns(ContactSamplingWarning, match="in contact in 60 of 60 frames"):
        assert pairs.contact[(0, 0)].value > 1.5  # truth: 1.05


def test_a_mixture_has_three_pair_distributions():
    scene = random_gas("3d_mixture", 300, 0.2)
    pairs, pressure = PairDistribution(), Pressure(scene)
    sim = hs.Simulation(scene)
    sim.run(collisions=6000)
    step = sim.time * 450 / 6000
    pressure.add(sim.frame())
    for _ in range(150):
        sim.run(time=step)
        pressure.add(sim.frame())
        pairs.add(sim.frame())
    assert pairs.pairs == [(0, 0), (0, 1), (1, 1)]
    expected = theory.mixture_contact_values(
        np.bincount(scene.species) / scene.volume, 2 * scene.radii[:2], 3
    )
    for (i, j), contact in pairs.contact.items():
        assert abs(contact.deviation(expected[i, j], 0.02 * expected[i, j])) < 4
    virial, here = pressure.virial, pairs.compressibility_factor
    assert abs(here.deviation(virial.value, math.hypot(virial.standard_error, pairs.extrapolation_bias))) < 4
    # sibling: species told apart by the wrong name
    assert abs(pairs.contact[(0, 0)].deviation(expected[1, 1])) > 4


def test_a_crystal_is_told_from_a_fluid_and_seen_to_melt():
    for dim, perfect in ((3, 0.575), (2, 1.0)):
        n = 108 if dim == 3 else 480
        scene = hs.lattice_gas(n=n, packing_fraction=0.45, dim=dim, seed=1)
        order = BondOrder()
        for frame in hs.Simulation(scene).frames(collisions_per_particle=[0, 400]):
            order.add(frame)
        assert order.values[0] == pytest.approx(perfect, abs=0.15)
        assert order.values[0] > 2.5 * order.values[1] and not order.crystalline
        first = BondOrder().add(hs.Simulation(scene).frame())
        assert first.crystalline
        axes = Figure().subplots()
        assert order.plot(axes) is axes
        assert list(order.collisions_per_particle) == pytest.approx([0, 400])
    with pytest.raises(NoDataError, match=r"call add\(frame\) first"):
        _ = BondOrder().crystalline
    with pytest.raises(ValueError, match="bonds need at least two"):
        BondOrder().add(hs.Simulation(random_gas("3d", 1, 0.01)).frame())


@pytest.mark.parametrize("n", [30, 108])
@pytest.mark.parametrize("lattice", [True, False])
def test_crystalline_says_what_growth_says_of_the_last_frame(n, lattice):
    """Too few particles to judge and a mixture are no crystals; the order of the last frame is kept."""
    fluid, crystal = random_gas("3d", n, 0.1), hs.lattice_gas(n=n, packing_fraction=0.5, seed=1)
    first, last = (fluid, crystal) if lattice else (crystal, fluid)
    order = BondOrder().add(hs.Simulation(first).frame()).add(hs.Simulation(last).frame())
    assert order.crystalline is (order_of_crystal(last) is not None) is (lattice and n == 108)
    assert order.last == hs.bond_order(last).value == order.values[-1]
    mixed = crystal.replace(radii=crystal.radii * np.linspace(0.9, 1.0, n))
    assert BondOrder().add(hs.Simulation(mixed).frame()).crystalline is False


def test_a_crystal_fails_the_check_of_a_fluid():
    scene = hs.lattice_gas(n=500, packing_fraction=0.3, seed=3)
    pairs = PairDistribution()
    for frame in hs.Simulation(scene).frames(collisions_per_particle=np.linspace(0, 0.5, 30)):
        pairs.add(frame)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SeriesWarning)
        warnings.simplefilter("ignore", ContactSamplingWarning)
        check = pairs.check
        assert abs(check.measured.value - check.expected) > 0.1 * check.expected


def test_misuse_is_named():
    with pytest.raises(NoDataError, match=r"no frames yet; call add\(frame\) first"):
        _ = PairDistribution().contact
    with pytest.raises(ValueError, match="window = 0.01"):
        PairDistribution(window=0.01)
    with pytest.raises(ValueError, match="walls"):
        PairDistribution().add(hs.Simulation(random_gas("3d_walls", 50, 0.1)).frame())
    with pytest.raises(ValueError, match="beyond half of the shortest edge"):
        PairDistribution(depth=4.0, bins=200).add(hs.Simulation(random_gas("3d", 50, 0.1)).frame())
    pairs = PairDistribution().add(hs.Simulation(random_gas("3d", 100, 0.1)).frame())
    with pytest.raises(ValueError, match="expected 100"):
        pairs.add(hs.Simulation(random_gas("3d", 90, 0.1)).frame())


def test_the_error_bar_of_one_frame_holds():
    """Poisson's, of pairs: the spread of z over 100 frames is 1 within 3 of its standard errors, 0.07 each.

    Sibling: as an error of their mean, a tenth, it is far too large.
    """
    sim = hs.Simulation(random_gas("3d", 200, 0.2))
    sim.run(collisions=2000)
    sim.run(time=1.0)  # away from a contact
    found = [PairDistribution().add(frame).contact[0, 0] for frame in sim.frames(every=3.0, count=100)]
    value = np.mean([each.value for each in found])
    z = np.array([(each.value - value) / each.standard_error for each in found])
    assert abs(z.std(ddof=1) - 1.0) < 0.21
    assert abs(value - (theory.finite_size_compressibility(0.2, 3, 200, "canonical").value - 1) / 0.8) < 4 * (
        np.std([each.value for each in found]) / 10
    )
    assert np.std([each.value for each in found]) / 10 < 0.2 * found[0].standard_error
