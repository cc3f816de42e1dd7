"""Lattices, random placement and velocities: exact where they promise it, distributed as they should be.

Statistical tests are seeded. Each states its false-alarm rate: how often a new seed would fail it by chance.
"""

import hashlib
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.stats import chi2, kstest

import hardspheres as hs
from hardspheres import placement
from hardspheres.scene import drift, thermal_energy

FCC, TRIANGULAR = math.pi / math.sqrt(18), math.pi / math.sqrt(12)
KINDS = ["maxwell", "equal-speeds", "two-temperatures", "beams"]


# Lattices.


@pytest.mark.parametrize(
    ("dim", "lattice", "n", "neighbours"),
    [(3, "fcc", 256, 12), (3, "cubic", 216, 6), (2, "triangular", 120, 6), (2, "square", 100, 4)],
)
def test_a_full_lattice_has_its_coordination_number(dim, lattice, n, neighbours):
    scene = hs.lattice_gas(n, 0.3, dim=dim, lattice=lattice, seed=1)
    tree = cKDTree(scene.positions, boxsize=scene.box)
    nearest = tree.query(scene.positions, k=2)[0][:, 1]
    assert np.ptp(nearest) < 1e-14 * scene.box.max()
    shell = tree.query_ball_point(scene.positions, nearest[0] * 1.01, return_length=True) - 1
    assert set(shell) == {neighbours}
    assert (
        np.ptp(scene.box) == 0
        if lattice != "triangular"
        else scene.box[0] / scene.box[1] == pytest.approx(1, abs=0.2)
    )


@pytest.mark.parametrize(
    ("dim", "lattice", "n", "most"),
    [
        (3, None, 4000, FCC),
        (3, "cubic", 1000, math.pi / 6),
        (2, None, 4080, TRIANGULAR),
        (2, "square", 900, math.pi / 4),
    ],
)
def test_close_packing_is_reached_and_not_passed(dim, lattice, n, most):
    scene = hs.lattice_gas(n, most, dim=dim, lattice=lattice, seed=1)
    assert scene.packing_fraction == pytest.approx(most, rel=1e-14)
    with pytest.raises(hs.SceneError, match=f"above close packing of the .* lattice, {most:.6f}"):
        hs.lattice_gas(n, most + 1e-6, dim=dim, lattice=lattice, seed=1)


@settings(max_examples=150)
@given(
    n=st.integers(1, 300),
    eta=st.floats(1e-9, 0.9),
    dim=st.sampled_from([2, 3]),
    words=st.lists(st.sampled_from(["periodic", "wall"]), min_size=3, max_size=3),
    which=st.integers(0, 1),
    scale=st.sampled_from([1e-3, 0.5, 7.0]),
)
def test_a_lattice_fits_or_says_what_would(n, eta, dim, words, which, scale):
    lattice = [["triangular", "square"], ["fcc", "cubic"]][dim - 2][which]
    more = {"dim": dim, "lattice": lattice, "boundary": words[:dim], "radii": scale, "seed": 5}
    try:
        scene = hs.lattice_gas(n, eta, **more)
    except hs.SceneError as error:
        found = re.search(r"with this number of particles (0\.\d+) is the most", str(error))
        if not found:
            assert "above close packing" in str(error)
            return
        reach = float(found[1])
        assert reach < eta
        if reach > 1e-5:
            hs.lattice_gas(n, reach * (1 - 1e-5), **more)
            with pytest.raises(hs.SceneError):
                hs.lattice_gas(n, reach + 2e-6, **more)
    else:  # a Scene is legal by construction
        assert scene.n == n
        assert scene.packing_fraction == pytest.approx(eta, rel=1e-14)
        if "wall" in words[:dim] or lattice != "triangular":
            assert np.ptp(scene.box) == 0


def test_vacancies_are_drawn_from_the_seed():
    one, two, again = (hs.lattice_gas(3999, 0.3, seed=seed) for seed in (1, 2, 1))
    assert np.array_equal(one.positions, again.positions)
    assert not np.array_equal(one.positions, two.positions)
    cut = hs.lattice_gas(3000, 0.3, seed=1)  # 1000 of 4000 sites empty, evenly over the box
    left = np.count_nonzero(cut.positions < cut.box / 2, axis=0)
    error = math.sqrt(3000 * 0.25 * 1000 / 3999)  # hypergeometric
    assert np.all(np.abs(left - 1500) < 4 * error)  # false alarm 2e-4


@pytest.mark.parametrize("make", [hs.lattice_gas, hs.random_gas])
def test_kinds_are_dealt_to_places_at_random(make):
    masses = np.repeat([1.0, 100.0], 500)
    scene = make(1000, 0.1, masses=masses, radii=np.repeat([0.5, 0.4], 500), seed=3)
    assert np.array_equal(scene.masses, masses)
    light, heavy = scene.positions[:500].mean(axis=0), scene.positions[500:].mean(axis=0)
    error = scene.box[0] / math.sqrt(12) * math.sqrt(2 / 500)
    assert np.all(np.abs(light - heavy) < 4.5 * error)  # false alarm 2e-5


def test_polydisperse_particles_fit_by_the_largest_or_are_sent_elsewhere():
    radii = np.linspace(0.1, 0.5, 256)
    scene = hs.lattice_gas(256, 0.15, radii=radii, seed=1)
    assert scene.packing_fraction == pytest.approx(0.15, rel=1e-14)
    assert np.array_equal(scene.radii, radii)
    with pytest.raises(hs.SceneError, match="does not fit on the fcc lattice; .* or use random_gas"):
        hs.lattice_gas(256, 0.5, radii=radii, seed=1)


# Random placement.


@pytest.mark.parametrize("make", [hs.lattice_gas, hs.random_gas])
@pytest.mark.parametrize("dim", [2, 3])
def test_one_seed_one_scene_and_velocities_leave_positions(make, dim):
    gases = {kind: make(150, 0.1, dim=dim, velocities=kind, seed=11) for kind in KINDS}
    first = gases["maxwell"]
    for kind, gas in gases.items():
        assert np.array_equal(gas.positions, first.positions)
        assert np.array_equal(gas.velocities, hs.draw_velocities(first, kind, seed=11))
    other = make(150, 0.1, dim=dim, seed=12)
    assert not np.array_equal(other.velocities, first.velocities)


def test_a_seed_sequence_gives_the_same_scene_each_time():
    sequence = np.random.SeedSequence(4)
    one, two = hs.random_gas(50, 0.1, seed=sequence), hs.random_gas(50, 0.1, seed=sequence)
    assert np.array_equal(one.positions, two.positions)
    assert np.array_equal(one.positions, hs.random_gas(50, 0.1, seed=4).positions)
    assert sequence.n_children_spawned == 0
    child = hs.random_gas(50, 0.1, seed=sequence.spawn(1)[0])
    assert not np.array_equal(child.positions, one.positions)


@settings(max_examples=60)
@given(
    n=st.integers(1, 200),
    dim=st.sampled_from([2, 3]),
    words=st.lists(st.sampled_from(["periodic", "wall"]), min_size=3, max_size=3),
    ratio=st.sampled_from([1.0, 3.0, 30.0]),
    seed=st.integers(0, 2**40),
)
def test_random_placement_is_legal_between_walls_and_in_mixtures(n, dim, words, ratio, seed):
    rng = np.random.default_rng(seed)
    radii = 0.5 * ratio ** -rng.random(n) if ratio > 1 else 0.5
    try:
        scene = hs.random_gas(n, 0.2, dim=dim, boundary=words[:dim], radii=radii, seed=seed)
    except hs.SceneError as error:
        assert "too short for the largest" in str(error) or "jammed at packing fraction" in str(error)
    else:
        assert scene.packing_fraction == pytest.approx(0.2, rel=1e-14)
        scene.replace()  # which looks for overlaps: `random_gas` relies on its placement


def test_only_placed_scenes_are_not_searched_for_overlaps():
    """Control of the test above: what overlaps is found as soon as a scene is made of it."""
    places, box = np.array([[1.0, 1.0], [1.9, 1.0]]), np.full(2, 5.0)
    scene = hs.Scene.as_placed(places, np.full(2, 0.5), np.ones(2), box, ("periodic",) * 2)
    with pytest.raises(hs.SceneError, match="particles 0 and 1 overlap by 0.1 diameters"):
        scene.replace()


def in_plain_python(covered, places, radii, placed, box, periodic):
    """One round of trials, each beside all spheres: how many are free, and which stay."""

    def apart(place, radius, others):
        step = np.abs(place - np.array([centre for centre, _ in others]).reshape(-1, len(box)))
        step = np.where(periodic, np.minimum(step, np.abs(box - step)), step)
        square = np.zeros(len(others))
        for axis in step.T:
            square += axis * axis
        return not np.any(np.sqrt(square) < radius + np.array([size for _, size in others]))

    free, new, stay, decided = 0, [], [], set()
    for trial in np.flatnonzero(~covered):
        particle = trial % len(radii)
        if not apart(places[trial], radii[particle], placed):
            continue
        free += 1
        if particle not in decided and apart(places[trial], radii[particle], new):
            new.append((places[trial], radii[particle]))
            stay.append(trial)
        decided.add(particle)
    return free, stay, new


@pytest.mark.parametrize("few", [10_000, 0], ids=["exact", "single precision first"])
@pytest.mark.parametrize("counted", [True, False], ids=["all", "those that may count"])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("words", [(True, True, True), (False, False, False), (True, False, True)])
@pytest.mark.parametrize("edge", [2.0, 3.1, 9.0], ids=["one cell", "three cells", "many cells"])
def test_trials_beside_cells_are_decided_as_beside_all_spheres(monkeypatch, dim, words, edge, counted, few):
    """Round by round, to the last bit, in cells of any number."""
    monkeypatch.setattr(placement, "FEW", few)
    rng = np.random.default_rng(7)
    box, periodic = np.full(dim, edge) * [1.0, 1.3, 1.1][:dim], np.array(words[:dim])
    n = int(0.3 * np.prod(box)) + 2
    ours, there = placement._Placed(np.linspace(0.3, 0.5, n), box, periodic), []
    for found, right in rounds_of_trials(ours, there, n, rng, box, periodic, counted):
        assert found[1:] == right[1:] and (found[0] == right[0] or not counted)
        assert len(ours) == len(there)
    assert len(there) > 0.5 * n
    assert len(ours._settled) > 0.5 * n or few > 0
    voxels, edges = rng.random((400, dim)) * box, np.full(dim, 0.2)
    covered = np.zeros(400, dtype=bool)
    ours.cover(covered, voxels, np.array([0.3]), edges)
    assert np.array_equal(covered, without_room(voxels, edges, 0.3, there, box, periodic))
    assert 0 < covered.sum() < 400
    low, counts = np.where(periodic, 0.0, 0.3), np.array([7, 9, 8][:dim])
    covered, edges = np.zeros(counts, dtype=bool), (box - 2 * low) / counts
    ours.cover_all(covered, low, edges, 0.3)
    voxels = low + (np.stack(np.unravel_index(np.arange(covered.size), counts), axis=1) + 0.5) * edges
    assert np.array_equal(covered.ravel(), without_room(voxels, edges, 0.3, there, box, periodic))
    assert covered.any() or edge == 9.0


def test_single_precision_alone_would_decide_wrongly(monkeypatch):
    """Control of the test above: some of its places are so near to contact that exact ones have to decide."""
    monkeypatch.setattr(placement, "FEW", 0)
    monkeypatch.setattr(placement, "SINGLE", 0.0)
    rng, box, periodic = np.random.default_rng(7), np.array([9.0, 11.7, 9.9]), np.full(3, True)
    ours = placement._Placed(np.linspace(0.3, 0.5, 300), box, periodic)
    assert any(found != right for found, right in rounds_of_trials(ours, [], 300, rng, box, periodic, True))


def rounds_of_trials(ours, there, n, rng, box, periodic, counted):
    """Yield how many trials were free and which stay, and the same in plain Python, for up to 12 rounds."""
    sizes, rounds = 0.3 + 0.2 * rng.random(n), 0
    while len(there) < n and rounds < 12:
        radii, rounds = sizes[len(there) :], rounds + 1
        places = rng.random((3 * len(radii) + 5, len(box))) * box
        places[::7] = np.rint(4 * places[::7]) / 4  # at edges of cells too
        places[3::7] = beside(there, places[3::7], radii, rng, box, periodic)
        places = np.minimum(places, np.nextafter(box, 0.0))
        covered = rng.random(len(places)) < 0.1
        free, stay, new = in_plain_python(covered, places, radii, there, box, periodic)
        found, stays = ours.add(covered, places, radii, counted)
        there += new
        yield (found, stays.tolist()), (free, stay)


def beside(placed, places, radii, rng, box, periodic):
    """Places that a rounding decides about: at the distance of contact from spheres, or a few units off."""
    if not placed:
        return places
    to = rng.standard_normal(places.shape)
    to /= np.linalg.norm(to, axis=1)[:, None]
    which = rng.integers(len(placed), size=len(places))
    size = radii[(3 + 7 * np.arange(len(places))) % len(radii)]
    for k, one in enumerate(which):
        centre, radius = placed[one]
        there = centre + to[k] * (radius + size[k]) * (1.0 + rng.choice([-1e-7, -1e-15, 0.0, 1e-15, 1e-7]))
        places[k] = np.where(periodic, there % box, np.clip(there, 0.0, box))
    return places


def without_room(voxels, edges, radius, placed, box, periodic):
    """Voxels whose farthest corner is within contact of one sphere."""
    corners = np.abs(voxels[:, None] - np.array([place for place, _ in placed]))
    corners = np.where(periodic, np.minimum(corners, np.abs(box - corners)), corners) + 0.5 * edges
    reach = np.sqrt(np.sum(corners**2, axis=2)) - np.array([size for _, size in placed])
    return np.any(reach <= radius, axis=1)


HALVES, SIXTHS = np.full(1000, 0.5), np.where(np.arange(600) % 20 == 0, 1.5, 0.4)


@pytest.mark.parametrize(
    ("radii", "box", "periodic", "digest"),
    [
        (HALVES, (12, 12, 12), (True, True, True), "a0bc2b8325b0a8c9"),  # packing fraction 0.30
        (HALVES[:600], (31, 30), (True, False), "0990c6f244eb870a"),  # 0.51
        (SIXTHS, (12, 12, 12), (False, True, True), "ce7d17e0b67cf4dc"),  # 0.33
    ],
    ids=["spheres", "discs", "mixture"],
)
def test_a_seed_is_a_contract_near_saturation_too(radii, box, periodic, digest):
    """Digests of the placement in NumPy alone, which the compiled one took over; each divides its voxels."""
    rng = np.random.default_rng(1)
    placed = placement.place_at_random(radii, np.array(box, dtype=float), np.array(periodic), rng)
    assert hashlib.sha256(placed.tobytes()).hexdigest()[:16] == digest


def test_random_places_are_even_and_independent_where_spheres_are_rare():
    scene = hs.random_gas(20_000, 1e-6, seed=8)
    counts = np.histogramdd(scene.positions / scene.box, bins=(10, 10, 10), range=[(0, 1)] * 3)[0]
    statistic = np.sum((counts - 20) ** 2 / 20)
    assert 1e-4 < chi2.sf(statistic, 999) < 1 - 1e-4  # false alarm 2e-4


def saturation(dim, n, seeds):
    """Packing fractions at which placement finds no room left: mean and standard error."""
    found = []
    for seed in seeds:
        with pytest.raises(hs.SceneError, match="random placement jammed") as caught:
            hs.random_gas(n, 0.6 if dim == 2 else 0.45, dim=dim, seed=seed)
        found.append(float(re.search(r"fraction (0\.\d+),", str(caught.value))[1]))
    return np.mean(found), np.std(found, ddof=1) / math.sqrt(len(found))


# Zhang, Torquato 2013 (doi 10.1103/PhysRevE.88.053312).
SATURATION = {2: 0.5470735, 3: 0.3841307}


@pytest.mark.parametrize(("dim", "n"), [(2, 2000), (3, 1000)])
def test_placement_jams_at_the_saturation_of_the_literature(dim, n):
    mean, error = saturation(dim, n, range(8))
    assert error < 0.002
    assert (
        abs(mean - SATURATION[dim]) < 5.4 * error
    )  # Student's t with 7 degrees of freedom: false alarm 1e-3


def test_discs_in_a_channel_park_like_cars():
    """With hardly any room across they are on a line: Renyi's constant; variance 0.03816 for each diameter of street.

    False alarm 1e-4. Voxels there divide one axis alone.
    """
    length, places = 2000, []
    for seed in range(4):
        rng, box = np.random.default_rng(seed), np.array([length, 1.0 + 1e-9])
        with pytest.raises(hs.SceneError, match="random placement jammed") as caught:
            placement.place_at_random(np.full(length, 0.5), box, np.array([True, False]), rng)
        places.append(int(re.search(r"with (\d+) of", str(caught.value))[1]))
    assert abs(np.mean(places) / length - 0.7475979) < 3.9 * math.sqrt(0.03816 / length / len(places))


def test_a_placement_that_drops_room_too_early_is_caught(monkeypatch):
    exact = placement._Placed.cover

    def careless(placed, covered, places, radii, edges=None):
        return exact(placed, covered, places, radii, edges if edges is None else 0 * edges)  # centres alone

    monkeypatch.setattr(placement._Placed, "cover", careless)
    mean, error = saturation(2, 2000, range(8))
    assert mean < SATURATION[2] - 5.4 * error


def test_a_placement_that_does_not_jam_is_quick_and_dense():
    assert hs.random_gas(1000, 0.37, seed=2).packing_fraction == pytest.approx(0.37, rel=1e-14)
    assert hs.random_gas(1000, 0.53, dim=2, seed=2).packing_fraction == pytest.approx(0.53, rel=1e-14)


# Arguments.


@pytest.mark.parametrize("make", [hs.lattice_gas, hs.random_gas])
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"n": 0}, "n is 0"),
        ({"n": -3}, "n is -3"),
        ({"n": 2.5}, "n is 2.5"),
        ({"packing_fraction": 0}, "packing_fraction is 0"),
        ({"packing_fraction": 1.0}, "packing_fraction is 1.0"),
        ({"packing_fraction": math.nan}, "packing_fraction is nan"),
        ({"packing_fraction": "0.3"}, "packing_fraction is '0.3'"),
        ({"packing_fraction": 0.75}, "above close packing"),
        ({"dim": 4}, "dim is 4"),
        ({"boundary": "open"}, "boundary is 'open'"),
        ({"velocities": "fast"}, "velocities is 'fast'; it must be one of \"maxwell\""),
        ({"temperature": -1}, "temperature is -1"),
        ({"temperature": math.inf}, "temperature is inf"),
        ({"radii": [0.5, 0.5]}, r"radii have shape \(2,\)"),
        ({"masses": -1}, "mass of particle 0 is -1.0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": None}, "seed is None"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"n": 1, "packing_fraction": 0.3}, "n = 1 at packing fraction 0.3"),
    ],
)
def test_bad_arguments_get_one_clear_sentence(make, change, message):
    with pytest.raises(hs.SceneError, match=message) as caught:
        make(**{"n": 10, "packing_fraction": 0.1, "seed": 1} | change)
    assert "\n" not in str(caught.value)


def test_a_lattice_of_the_other_dimension_is_refused():
    with pytest.raises(hs.SceneError, match='in 2D it must be "triangular" or "square"'):
        hs.lattice_gas(10, 0.1, dim=2, lattice="fcc", seed=1)


# Velocities.

MIXTURES = {
    "equal": 1.0,
    "two masses": np.repeat([1.0, 25.0], [61, 40]),
    "all different": np.linspace(0.5, 3.0, 101),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("boundary", [("periodic",) * 3, ("wall", "periodic", "wall"), ("wall",) * 3])
@pytest.mark.parametrize("masses", MIXTURES.values(), ids=MIXTURES)
def test_energy_is_exact_and_momentum_removed_where_it_is_conserved(kind, dim, boundary, masses):
    scene = hs.lattice_gas(
        101, 0.1, dim=dim, boundary=boundary[:dim], velocities=kind, temperature=2.5, masses=masses, seed=9
    )
    assert scene.temperature == pytest.approx(2.5, rel=1e-14)
    size = np.sum(scene.masses[:, None] * np.abs(scene.velocities))
    assert np.all(np.abs(scene.momentum[scene.periodic]) < 1e-15 * size)
    if kind == "maxwell" and not scene.periodic.all():
        assert np.all(np.abs(scene.momentum[~scene.periodic]) > 1e-6 * size)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dim", [2, 3])
def test_one_two_three_particles_and_no_motion(kind, dim):
    for n in (1, 2, 3):
        scene = hs.lattice_gas(n, 0.01, dim=dim, velocities=kind, temperature=3.0, seed=2)
        assert scene.temperature == pytest.approx(3.0, rel=1e-14)
        rest = hs.lattice_gas(n, 0.01, dim=dim, velocities=kind, temperature=0, seed=2)
        assert not rest.velocities.any() and rest.temperature == 0


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [2, 3, 4, 5, 1000, 1001])
def test_equal_speeds_are_equal_and_sum_to_nothing(dim, n):
    scene = hs.lattice_gas(n, 0.01, dim=dim, velocities="equal-speeds", seed=6)
    speed = np.sqrt(np.sum(scene.velocities**2, axis=1))
    expected = math.sqrt(scene.degrees_of_freedom / n)  # sqrt(D kT / (N m))
    assert np.allclose(speed, expected, rtol=4e-15, atol=0)
    assert np.all(np.abs(scene.momentum) < 1e-14 * max(1, math.sqrt(n)))


def test_equal_speeds_pair_particles_of_one_mass():
    masses = np.repeat([1.0, 4.0], [301, 200])
    scene = hs.lattice_gas(501, 0.01, masses=masses, velocities="equal-speeds", seed=6)
    energy = masses * np.sum(scene.velocities**2, axis=1)
    assert np.ptp(energy) < 1e-14 * energy.mean()
    for mass in (1.0, 4.0):
        assert np.all(np.abs(scene.velocities[masses == mass].sum(axis=0)) < 1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_directions_are_even_and_partners_not_neighbours(dim):
    n = 20_000
    v = hs.lattice_gas(n, 0.01, dim=dim, velocities="equal-speeds", seed=6).velocities
    v = v / np.sqrt(np.mean(np.sum(v**2, axis=1)))
    second = v.T @ v / n  # pairs: only n / 2 directions are independent
    variance = 2 * (dim - 1) / (dim**2 * (dim + 2)) / (n / 2)  # of cos^2
    assert np.all(np.abs(np.diag(second) - 1 / dim) < 4.5 * math.sqrt(variance))  # false alarm 2e-5
    along = np.sum(v[1:] * v[:-1], axis=1)
    assert abs(along.mean()) < 4.5 / math.sqrt(dim * n / 2)  # false alarm 7e-6


@pytest.mark.parametrize("dim", [2, 3])
def test_maxwell_components_and_speeds(dim):
    n = 50_000
    masses = np.repeat([1.0, 9.0], n // 2)
    scene = hs.lattice_gas(n, 0.01, dim=dim, masses=masses, temperature=2.0, seed=10)
    for mass in (1.0, 9.0):
        scaled = scene.velocities[masses == mass] * math.sqrt(mass / 2.0)
        assert kstest(scaled.ravel(), "norm").pvalue > 1e-4  # false alarm 1e-4
        assert kstest(np.sum(scaled**2, axis=1), chi2(dim).cdf).pvalue > 1e-4
        assert kstest(1.05 * scaled.ravel(), "norm").pvalue < 1e-4  # five per cent faster is seen


@pytest.mark.parametrize("masses", [1.0, np.repeat([1.0, 7.0], [30, 70])], ids=["halves", "species"])
@pytest.mark.parametrize("boundary", ["periodic", "wall"])
def test_two_temperatures_have_exactly_their_ratio(masses, boundary):
    scene = hs.random_gas(100, 0.05, masses=masses, boundary=boundary, seed=1)
    v = hs.draw_velocities(scene, "two-temperatures", temperature=1.5, temperature_ratio=4.0, seed=7)
    both = scene.replace(velocities=v)
    assert both.temperature == pytest.approx(1.5, rel=1e-14)
    if np.ndim(masses):
        hot = scene.masses == 1.0
    else:  # which half is hot is drawn: the hot one is that which makes the numbers work
        rng = hs.velocities.stream(7, hs.velocities.VELOCITIES)
        rng.standard_normal((100, 3))
        hot = np.isin(np.arange(100), rng.permutation(100)[:50])
    kT = []
    for part in (hot, ~hot):
        freedom = 3 * np.count_nonzero(part) - (3 if boundary == "periodic" else 0)
        kT.append(2 * thermal_energy(v[part], scene.masses[part], scene.periodic) / freedom)
        assert np.all(np.abs(drift(v[part], scene.masses[part], scene.periodic)) < 1e-14)
    assert kT[0] / kT[1] == pytest.approx(4.0, rel=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_beams_are_two_and_opposite(dim):
    direction = hs.velocities.BEAM_DIRECTION[dim]
    assert direction @ direction == pytest.approx(1.0, abs=1e-15)
    for n in (100, 101):
        scene = hs.random_gas(n, 0.05, dim=dim, velocities="beams", seed=1)
        along = scene.velocities @ direction
        assert np.abs(scene.velocities - np.outer(along, direction)).max() < 1e-15
        assert np.count_nonzero(along > 0) in (n // 2, n - n // 2)
        assert len(np.unique(np.round(along, 12))) == 2
        assert np.abs(scene.momentum).max() < 1e-13
        assert scene.temperature == pytest.approx(1.0, rel=1e-15)
    # not the first half of the box against the second
    assert not np.array_equal(np.sort(along[:50]), along[:50])


@pytest.mark.parametrize("dim", [2, 3])
def test_a_beam_in_a_periodic_box_stays_away_from_itself(dim):
    """200 boxes on, a line is nowhere near where it was; along an axis (sibling) it is there after one."""

    def nearest(direction):
        k = np.arange(1, 200)[:, None]
        after = k * direction / direction[0]  # when it has crossed the box k times along x
        return np.linalg.norm(after - np.rint(after), axis=1).min()

    assert nearest(hs.velocities.BEAM_DIRECTION[dim]) * 200 ** (1 / (dim - 1)) > 0.3
    assert nearest(np.eye(dim)[0]) == 0.0


@pytest.mark.parametrize("ratio", [0, -1, math.nan, "3"])
def test_a_ratio_of_temperatures_is_positive(ratio):
    scene = hs.lattice_gas(10, 0.1, seed=1)
    with pytest.raises(hs.SceneError, match="temperature_ratio is"):
        hs.draw_velocities(scene, "two-temperatures", temperature_ratio=ratio, seed=1)
