"""Hexatic order: exact for crystals and for clusters that point anywhere, beside oracles of N^2, and its errors."""

import copy
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import gas as random_gas
from scipy.spatial import Delaunay

import hardspheres as hs
from analysis.hexatic import CELL, FIRST, HexaticOrder, _bins, _geometry, local_order
from analysis.series import autocorrelation_time, complex_autocorrelation_time

HALF, HIGH, APART = 4, 6, 5.0  # flowers of seven discs, at places of a grid
BOX = np.array([2 * HALF * APART, HIGH * APART])
FLOWER = np.append(0.0, np.exp(1j * np.pi / 3.0 * np.arange(6)))
# Sum of psi over a flower: of 21 pairs 6 spokes, 6 edges and 3 long diagonals are at multiples of 60 degrees, 6
# short diagonals at 30 degrees from them; a pair is in two means of six.
OF_FLOWER = 2 * (6 + 6 + 3 - 6) / 6


def scene_of(n, box):
    """So many discs anywhere in a box: what a frame says besides where they are."""
    columns = math.ceil(math.sqrt(n * box[0] / box[1]))
    rows = math.ceil(n / columns)
    places = (
        (np.stack(np.divmod(np.arange(n), columns)[::-1], axis=1) + 0.5) * np.array(box) / (columns, rows)
    )
    return hs.Scene(places, np.ones((n, 2)), radii=0.5, box=box)


def at(scene, positions, s=0.0):
    return SimpleNamespace(scene=scene, positions=positions, collisions_per_particle=s)


def flowers(angles):
    """Flowers, each turned by its angle: all neighbours of a disc are in its own."""
    x, y = np.meshgrid(np.arange(2 * HALF), np.arange(HIGH), indexing="ij")
    places = APART * (x + 1j * y + 0.5 + 0.5j).reshape(-1, 1) + FLOWER * np.exp(
        1j * np.reshape(angles, (-1, 1))
    )
    return np.stack([places.real.ravel(), places.imag.ravel()], axis=1)


def crystal(n=480, eta=0.7):
    return hs.lattice_gas(n=n, packing_fraction=eta, dim=2, seed=1)


def test_a_crystal_is_1_at_all_distances_and_minus_1_when_it_lies_on_its_side():
    """To rounding. Siblings: one that is stretched by 10 %, and one whose discs are displaced."""
    scene = crystal()
    order = HexaticOrder().add(at(scene, scene.positions))
    assert order.order.value == pytest.approx(1.0, abs=1e-12) and order.values[0] == pytest.approx(
        1.0, abs=1e-12
    )
    g6 = order.correlation
    assert np.nanmax(np.abs(g6 - 1.0)) < 1e-12 and np.isfinite(g6).sum() > 15
    assert math.isnan(order.order.standard_error) and np.isnan(order.correlation_error).all()
    assert local_order(scene.positions[:, ::-1], scene.box[::-1]) == pytest.approx(-1.0, abs=1e-12)
    rng = np.random.default_rng(1)
    for wrong, box in (
        (scene.positions * [1.1, 1.0], scene.box * [1.1, 1.0]),
        (np.mod(scene.positions + rng.normal(0.0, 0.05, (480, 2)), scene.box), scene.box),
    ):
        assert abs(local_order(wrong, box).mean()) < 0.99


def test_inside_a_grain_the_argument_is_six_times_its_angle():
    """Grains of a crystal at 0, 17 and 30 degrees in an empty box: exp(6 i angle) wherever six touch six."""
    row, column = np.divmod(np.arange(15 * 15), 15)
    grain = 1.1 * (column + 0.5 * (row % 2) + 1j * row * math.sqrt(0.75))
    grain -= grain.mean()
    inside = np.abs(grain) < 5.0
    for degrees in (0.0, 17.0, 30.0):
        turned = grain * np.exp(1j * np.radians(degrees)) + 20.0 + 20.0j
        psi = local_order(np.stack([turned.real, turned.imag], axis=1), np.array([40.0, 40.0]))
        assert inside.sum() > 50
        assert psi[inside] == pytest.approx(np.exp(6j * np.radians(degrees)), abs=1e-12)
    assert np.abs(psi[~inside] - np.exp(6j * np.radians(30.0))).max() > 0.5  # sibling: at the edge


@pytest.mark.parametrize("degrees", [0.0, 10.0, 15.0, 30.0])
def test_two_halves_at_an_angle(degrees):
    """|Psi6| = 3/7 |cos 3 angle| of flowers, half of which are turned: exactly 0 at 30 degrees."""
    angles = np.repeat([0.2, 0.2 + np.radians(degrees)], HALF * HIGH)
    psi = local_order(flowers(angles), BOX)
    assert abs(psi.mean()) == pytest.approx(
        OF_FLOWER / 7.0 * abs(math.cos(3.0 * np.radians(degrees))), abs=1e-12
    )
    whole = np.abs(psi.reshape(-1, 7).sum(axis=1))
    assert whole == pytest.approx(OF_FLOWER, abs=1e-12)  # of each flower, however it lies


def test_clusters_that_point_anywhere_have_an_order_of_1_over_root_n():
    """N <|Psi6|^2> = 9/7 exactly, <|Psi6|> sqrt(pi/4) of its root for many: false alarm 1e-4 each.

    Siblings: all of them turned together, which keep 9 N/49, and the local order, which does not know.
    """
    rng, scene = np.random.default_rng(2), scene_of(7 * 2 * HALF * HIGH, BOX)
    free, together = HexaticOrder(), HexaticOrder()
    for k in range(600):
        angles = rng.uniform(0.0, 2.0 * np.pi, 2 * HALF * HIGH)
        free.add(at(scene, np.mod(flowers(angles), BOX), 10.0 * k))
        if k < 20:
            together.add(at(scene, np.mod(flowers(angles[:1] + 0.0 * angles), BOX), 10.0 * k))
    n = scene.n
    square = OF_FLOWER**2 / 7.0 / n
    assert abs(free.mean_square_order.deviation(square)) < 3.9
    assert abs(free.order.deviation(math.sqrt(np.pi / 4.0 * square))) < 3.9
    assert abs(free.susceptibility.deviation((1.0 - np.pi / 4.0) * n * square)) < 3.9
    assert abs(free.correlation_time.deviation(5.0)) < 3.9  # half of what is between two frames
    assert together.mean_square_order.value == pytest.approx(OF_FLOWER**2 / 49.0, abs=1e-12)
    assert together.mean_square_order.value > 20.0 * free.mean_square_order.value
    assert together.local_order.value == pytest.approx(free.local_order.value, rel=1e-9)


def test_points_at_random_have_six_bonds_that_point_anywhere():
    """Mean |psi|^2 = 1/6, and g6 = 0 beyond common neighbours; 3.9 standard errors each.

    Sibling: a crystal whose discs are displaced by as much as makes them overlap.
    """
    rng, box = np.random.default_rng(3), np.array([25.0, 22.0])
    scene, points = scene_of(300, box), HexaticOrder()
    for k in range(200):
        points.add(at(scene, rng.random((300, 2)) * box, float(k)))
    assert abs(points.local_order.deviation(1.0 / 6.0)) < 3.9
    far = points.r > 7.0
    z = points.correlation[far] / points.correlation_error[far]
    assert far.sum() >= 5 and np.abs(z).max() < 4.2 and 0.4 < np.sqrt(np.mean(z**2)) < 1.8
    crowded, lattice = HexaticOrder(), crystal(300)
    for k in range(20):
        displaced = lattice.positions + rng.normal(0.0, 0.15, (lattice.n, 2))
        crowded.add(at(lattice, np.mod(displaced, lattice.box), float(k)))
    assert crowded.local_order.deviation(1.0 / 6.0) > 20.0


def by_hand(positions, box):
    """psi, and displacements of all pairs by their nearest images, from all N^2 of them."""
    apart = positions[None] - positions[:, None]
    apart -= box * np.rint(apart / box)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    psi = np.empty(len(positions), dtype=complex)
    for j, row in enumerate(distance):
        near = [k for k in np.argsort(row, kind="stable") if k != j][:6]
        psi[j] = np.mean([np.exp(6j * math.atan2(apart[j, k, 1], apart[j, k, 0])) for k in near])
    return psi, distance


def test_the_oracle_of_all_pairs_gives_the_same():
    """psi and Psi6 to rounding; g6 to rounding with distances of cells, and within 0.01 with those of discs.

    Siblings: without periodic images, and g6 of a crystal with the same places but for a shift of half of them.
    """
    scene = hs.compressed_gas(n=400, packing_fraction=0.69, dim=2, seed=3)
    x, box = scene.positions, scene.box
    psi, distance = by_hand(x, box)
    assert local_order(x, box) == pytest.approx(psi, abs=1e-10)
    assert np.abs(by_hand(x, 1e9 * box)[0] - psi).max() > 0.1
    order = HexaticOrder().add(at(scene, x))
    assert order.values[0] == pytest.approx(psi.mean(), abs=1e-12)
    assert order.local_order.value == pytest.approx(np.mean(np.abs(psi) ** 2), abs=1e-12)
    products = np.real(psi[:, None] * np.conj(psi))
    cells, edges = _geometry(order.gas)
    own = np.floor(x / np.array(edges)).astype(int)
    steps = np.abs(own[:, None] - own)
    steps = np.minimum(steps, cells - steps) * edges
    in_cells = np.hypot(steps[..., 0], steps[..., 1])
    limits = [FIRST]
    while limits[-1] < 0.5 * box.min():
        limits.append(max(limits[-1] + CELL, 1.1 * limits[-1]))
    limits[-1] = 0.5 * box.min()
    pairs = ~np.eye(len(x), dtype=bool)
    exact = []
    for low, high in itertools.pairwise(limits):
        exact.append(
            [products[pairs & (each >= low) & (each < high)].mean() for each in (in_cells, distance)]
        )
    exact = np.array(exact)
    assert order.correlation == pytest.approx(exact[:, 0], abs=1e-10)
    far = order.r > 3.0
    assert np.abs(order.correlation - exact[:, 1])[far].max() < 0.03
    assert len(_bins(cells, edges)[1]) == len(exact) and np.all(np.diff(order.r) > 0.0)


def test_neighbours_of_voronoi_give_nearly_the_same_order_of_a_dense_fluid():
    """Within 0.02 of Psi6. Sibling: five neighbours instead of six are further away."""
    scene = hs.compressed_gas(n=400, packing_fraction=0.70, dim=2, seed=5)
    x, box, n = scene.positions, scene.box, scene.n
    shifts = np.array([(i, j) for i in (0, -1, 1) for j in (0, -1, 1)]) * box
    every = (x + shifts[:, None]).reshape(-1, 2)
    first, partners = Delaunay(every).vertex_neighbor_vertices
    voronoi = [
        np.mean(
            [np.exp(6j * np.arctan2(*(every[k] - x[j])[::-1])) for k in partners[first[j] : first[j + 1]]]
        )
        for j in range(n)
    ]
    apart = x[None] - x[:, None]
    apart -= box * np.rint(apart / box)
    along = apart[..., 0] + 1j * apart[..., 1]
    near = np.argsort(np.abs(along), axis=1)[:, 1:6]
    five = np.exp(6j * np.angle(np.take_along_axis(along, near, axis=1))).mean(axis=1)
    psi = local_order(x, box)
    assert abs(psi.mean() - np.mean(voronoi)) < 0.02
    assert np.mean(np.abs(psi - five)) > np.mean(np.abs(psi - voronoi))


def test_psi6_lasts_as_long_as_its_direction():
    """A phase that walks: tau = 1/2 + 1/(exp(D) - 1), in standard errors, false alarm 1e-3 over ten walks.

    Siblings: a constant lasts for half of the series, and what subtracts the mean does not see that.
    """
    rng, spread = np.random.default_rng(4), 0.05
    expected = 0.5 + 1.0 / math.expm1(spread)
    z = []
    for _ in range(10):
        phase = np.cumsum(rng.normal(0.0, math.sqrt(2.0 * spread), 8000))
        z.append(complex_autocorrelation_time(np.exp(1j * phase)).deviation(expected))
    assert abs(np.mean(z)) < 1.1 and np.abs(z).max() < 4.5
    still = np.full(400, 0.7 + 0.1j)
    assert complex_autocorrelation_time(still).value == pytest.approx(200.0, abs=0.6)
    assert autocorrelation_time(still.real).value == 0.5
    phase = phase[:400]  # the same through an estimator, every ten collisions per particle
    scene, order = scene_of(7 * 2 * HALF * HIGH, BOX), HexaticOrder()
    for k, angle in enumerate(phase):
        order.add(at(scene, np.mod(flowers(np.full(2 * HALF * HIGH, angle / 6.0)), BOX), 10.0 * k))
    directly = complex_autocorrelation_time(np.exp(1j * phase))
    assert order.correlation_time.value == pytest.approx(10.0 * directly.value, rel=1e-6)
    assert order.order.standard_error < 1e-9  # its modulus never changed


def test_two_runs_have_the_mean_and_half_of_the_variance():
    """Sibling: the errors of the runs, which are not reduced."""
    rng, box = np.random.default_rng(5), np.array([25.0, 22.0])
    scene, runs = scene_of(300, box), [HexaticOrder(), HexaticOrder()]
    for run in runs:
        for k in range(64):
            run.add(at(scene, rng.random((300, 2)) * box, float(k)))
    both = copy.deepcopy(runs[0]).merge(runs[1])
    for name in ("order", "mean_square_order", "local_order"):
        parts, whole = [getattr(run, name) for run in runs], getattr(both, name)
        assert whole.value == pytest.approx(np.mean([part.value for part in parts]), rel=1e-9)
        error = math.sqrt(sum(part.standard_error**2 for part in parts)) / 2.0
        assert whole.standard_error == pytest.approx(error) and error < 0.9 * parts[0].standard_error
    assert len(both.values) == len(both.moduli) == 128
    ratio = both.correlation_error / np.mean([run.correlation_error for run in runs], axis=0)
    assert np.median(ratio) == pytest.approx(math.sqrt(0.5), rel=0.15)


REFUSED = {
    "spheres": (lambda: random_gas("3d", 30, 0.1), "this scene is in 3D"),
    "walls": (lambda: hs.random_gas(n=30, packing_fraction=0.1, dim=2, boundary="wall", seed=1), "has walls"),
    "sizes": (
        lambda: random_gas("2d", 30, 0.1, radii=np.where(np.arange(30) % 2, 0.3, 0.5)),
        "differ in their radii",
    ),
    "few": (lambda: random_gas("2d", 6, 0.1), "6 discs have no six neighbours each"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_has_no_hexatic_order_is_refused(what):
    """Sibling: seven equal discs."""
    make, why = REFUSED[what]
    scene = make()
    with pytest.raises(ValueError, match=why):
        HexaticOrder().add(at(scene, scene.positions))
    scene = random_gas("2d", 7, 0.1)
    assert HexaticOrder().add(at(scene, scene.positions)).order.value > 0.0
    with pytest.raises(ValueError, match="expected 7"):
        HexaticOrder().add(at(scene, scene.positions)).add(at(scene, scene.positions[:6]))
