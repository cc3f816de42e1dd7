"""A scene is checked once: what it refuses, what it keeps, and the numbers that follow from it."""

import math
import pickle
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hardspheres as hs
from hardspheres import Scene, SceneError, cells
from hardspheres.cells import worst_overlap
from hardspheres.checks import contact_tolerance
from hardspheres.scene import column_sums, returned_to_box, squared_lengths

TWO = [[1.0, 1.0, 1.0], [4.0, 4.0, 4.0]]
REST = np.zeros((2, 3))


def pair(distance, axis=0, dim=3, start=1.0, **more):
    """Two particles this far apart along one axis, at rest."""
    places = np.full((2, dim), start)
    places[1, axis] += distance
    return Scene(places, np.zeros((2, dim)), **{"box": (10.0,) * dim} | more)


def test_arrays_are_read_only_copies_and_the_input_stays():
    places, speeds = np.array([[-1.0, 5.0, 12.0], [4.0, 4.0, 4.0]]), np.ones((2, 3), dtype=np.float32)
    scene = Scene(places, speeds, radii=[0.5, 0.25], masses=2, box=[10, 10, 10])
    assert places[0, 0] == -1.0 and places[0, 2] == 12.0
    assert scene.positions[0].tolist() == [9.0, 5.0, 2.0]
    for name in ("positions", "velocities", "radii", "masses", "box", "periodic", "species"):
        array = getattr(scene, name)
        assert not array.flags.writeable and array.flags.c_contiguous
    with pytest.raises(AttributeError):
        scene.box = np.ones(3)
    assert scene.velocities.dtype == scene.masses.dtype == scene.box.dtype == np.float64


def test_pickling_keeps_bits_and_read_only():
    scene = Scene(np.asarray(TWO) / 3, REST + 0.1, radii=[0.3, 0.1], boundary=("wall", "periodic", "wall"))
    again = pickle.loads(pickle.dumps(scene))
    for name in scene.__dataclass_fields__:
        assert np.array_equal(getattr(again, name), getattr(scene, name))
    assert not again.positions.flags.writeable


def test_numbers_by_hand():
    scene = Scene(TWO, [[1, 0, 2], [3, 4, 0]], radii=[0.5, 1.0], masses=[1, 3], box=(8, 9, 10))
    assert (scene.n, scene.dim, scene.volume, scene.number_density) == (2, 3, 720.0, 2 / 720)
    assert scene.packing_fraction == pytest.approx(4 / 3 * math.pi * (0.125 + 1) / 720, rel=1e-15)
    assert scene.momentum.tolist() == [10, 12, 2]
    assert scene.kinetic_energy == 2.5 + 37.5
    assert scene.thermal_energy == pytest.approx(40 - (100 + 144 + 4) / 8, rel=1e-15)
    assert scene.degrees_of_freedom == 3
    assert scene.temperature == pytest.approx(6.0, rel=1e-15)
    assert scene.boundary == ("periodic",) * 3


@pytest.mark.parametrize(
    ("boundary", "freedom", "thermal"),
    [
        ("periodic", 2, 38 - (100 + 144) / 8),
        ("wall", 4, 38.0),
        (("periodic", "wall"), 3, 38 - 100 / 8),
        (["wall", "periodic"], 3, 38 - 144 / 8),
    ],
)
def test_only_periodic_axes_lose_a_degree_of_freedom(boundary, freedom, thermal):
    scene = Scene([[1, 1], [4, 4]], [[1, 0], [3, 4]], masses=[1, 3], box=(9, 9), boundary=boundary)
    assert scene.degrees_of_freedom == freedom
    assert scene.thermal_energy == pytest.approx(thermal, rel=1e-15)


def test_a_single_particle_keeps_all_its_motion():
    scene = Scene([[1.0, 1.0]], [[3.0, 4.0]], masses=2.0, box=(5, 5))
    assert scene.degrees_of_freedom == 2
    assert scene.thermal_energy == scene.kinetic_energy == 25.0
    assert scene.temperature == 25.0


def test_thermal_energy_is_exact_in_a_fast_common_wind():
    rng = np.random.default_rng(1)
    v = rng.standard_normal((50, 2)) + 1e6
    m = rng.uniform(0.5, 2, 50)
    places = np.stack(np.meshgrid(np.arange(10.0), np.arange(5.0)), -1).reshape(-1, 2) * 2
    scene = Scene(places, v, masses=m, box=(20, 10))
    exact_m = [Fraction(x) for x in m]
    exact = Fraction(0)
    for axis in range(2):
        u = [Fraction(x) for x in v[:, axis]]
        wind = sum(a * b for a, b in zip(exact_m, u, strict=True)) / sum(exact_m)
        exact += sum(a * (b - wind) ** 2 for a, b in zip(exact_m, u, strict=True)) / 2
    assert scene.thermal_energy == pytest.approx(float(exact), rel=1e-8)  # the wind is rounded at 1e-10
    naive = scene.kinetic_energy - float(np.sum(scene.momentum**2)) / (2 * float(np.sum(m)))
    assert abs(naive / float(exact) - 1) > 1e-6  # what the textbook form would have made of it


@given(st.floats(-1e6, 1e6, allow_subnormal=True), st.floats(2.0, 1e4))
def test_periodic_positions_end_inside_once_and_for_all(x, edge):
    scene = Scene([[x, 1.0]], [[0.0, 0.0]], box=(edge, 3.0))
    folded = float(scene.positions[0, 0])
    assert 0 <= folded < edge
    turns = (x - folded) / edge
    assert abs(turns - round(turns)) * edge <= 4 * np.spacing(max(abs(x), edge))
    if 0 <= x < edge:
        assert folded == x
    assert scene.replace().positions[0, 0] == folded


@pytest.mark.parametrize("x", [-1e-20, -5e-324, 10.0, -10.0, 20.0, np.nextafter(10.0, 11), -0.0])
def test_folding_at_the_edge(x):
    folded = Scene([[x, 1.0]], [[0.0, 0.0]], box=(10, 10)).positions[0, 0]
    assert 0 <= folded < 10 and min(folded, 10 - folded) < 1e-14


BAD = [
    ({"positions": []}, r"positions have shape \(0,\)"),
    ({"positions": np.zeros((0, 3)), "velocities": np.zeros((0, 3))}, "at least one particle"),
    ({"positions": [1.0, 2.0, 3.0]}, "2 or 3 columns"),
    ({"positions": np.zeros((2, 4))}, "2 or 3 columns"),
    ({"positions": [[1, 2, 3], [4, 5]]}, "positions cannot be made an array"),
    ({"positions": [[1j, 2, 3], [4, 5, 6]]}, "positions hold complex numbers"),
    ({"positions": [["a", "b", "c"], ["d", "e", "f"]]}, "positions hold text"),
    ({"positions": np.array(TWO, dtype=object)}, "positions hold object"),
    ({"positions": [[True, True, True], [False, False, False]]}, "positions hold truth values"),
    ({"positions": [[1, 1, 1], [4, math.nan, 4]]}, "the position of particle 1 along y is nan"),
    ({"positions": [[1, 1, math.inf], [4, 4, 4]]}, "the position of particle 0 along z is inf"),
    ({"velocities": np.zeros((3, 3))}, r"velocities have shape \(3, 3\)"),
    ({"velocities": np.zeros((2, 2))}, r"velocities have shape \(2, 2\)"),
    ({"velocities": [[0, 0, 0], [0, -math.inf, 0]]}, "the velocity of particle 1 along y is -inf"),
    ({"velocities": None}, "velocities hold object"),
    ({"velocities": np.full((2, 3), 1e200)}, "kinetic energy leaves the range"),
    ({"radii": 0.0}, "the radius of particle 0 is 0.0"),
    ({"radii": [0.5, -0.5]}, "the radius of particle 1 is -0.5"),
    ({"radii": [0.5, math.nan]}, "the radius of particle 1 is nan"),
    ({"radii": [0.5, 0.5, 0.5]}, r"radii have shape \(3,\)"),
    ({"radii": [[0.5], [0.5]]}, r"radii have shape \(2, 1\)"),
    ({"radii": "big"}, "radii hold text"),
    ({"radii": 1e-200}, "choose another unit of length"),
    ({"masses": 0}, "the mass of particle 0 is 0.0"),
    ({"masses": [1, -1]}, "the mass of particle 1 is -1.0"),
    ({"masses": math.inf}, "all particles have infinite mass; at least one must have a finite mass, to move"),
    ({"masses": [1, 2, 3]}, r"masses have shape \(3,\)"),
    ({"masses": 1e308}, "masses from 1e[+]308 to 1e[+]308 leave the range .* or their sum does"),
    ({"masses": [1e-320, 1]}, "masses from 1e-320 to 1 leave the range"),
    ({"masses": np.ma.array([1.0, 2.0], mask=[True, False])}, "masses are a masked array, .* fill them in"),
    ({"positions": [np.ma.array(row, mask=[0, 0, 1]) for row in TWO]}, "positions are a masked array"),
    ({"radii": np.ma.masked}, "radii are a masked array"),
    ({"radii": b"1"}, "radii hold text"),
    ({"radii": True}, "radii hold truth values"),
    ({"box": np.array([10, 10, 10], "m8[s]")}, "box edges hold timedelta"),
    ({"box": (10, 10)}, r"box has shape \(2,\), but the positions are 3-dimensional"),
    ({"box": 10}, r"box has shape \(\)"),
    ({"box": (10, 0, 10)}, "the box edge along y is 0.0"),
    ({"box": (10, 10, -1)}, "the box edge along z is -1.0"),
    ({"box": (10, 10, math.inf)}, "the box edge along z is inf"),
    ({"box": (10, 10, math.nan)}, "the box edge along z is nan"),
    ({"box": (1e200, 1e200, 1e200)}, "choose another unit of length"),
    (
        {"box": (10, 10, 1.9)},
        "edge along z is 1.9, but a periodic axis must .* two largest diameters long, 2",
    ),
    ({"box": (10, 0.9, 10), "boundary": "wall"}, "edge along y is 0.9, but a wall axis must .* one largest"),
    ({"boundary": "open"}, "boundary is 'open'"),
    ({"boundary": None}, "boundary is None"),
    ({"boundary": 3}, "boundary is 3"),
    ({"boundary": ("periodic", "wall")}, "boundary has 2 words for 3 axes"),
    ({"boundary": ("periodic", "wall", 1)}, "boundary is"),
    (
        {"positions": [[1, 0.25, 1], [4, 4, 4]], "boundary": "wall"},
        "particle 0 reaches 0.25 beyond a wall along y: its coordinate is 0.25, .* from 0.5 to 9.5",
    ),
    (
        {"positions": [[1, 1, 1], [4, 4, 11]], "boundary": ("periodic", "periodic", "wall")},
        "particle 1 reaches 1.5 beyond a wall along z",
    ),
    ({"positions": [[1, 1, 1], [1.5, 1, 1]]}, "particles 0 and 1 overlap by 0.5 diameters"),
    ({"positions": [[0.2, 1, 1], [9.7, 1, 1]]}, "particles 0 and 1 overlap by 0.5 diameters"),
    ({"positions": [[1, 1, 1], [1, 1, 1]]}, "overlap by 1 diameters .*: they are 0.0 apart and touch at 1.0"),
]


def moving(length=1.0, time=1.0, mass=1.0, ratio=1.0):
    """Arguments of two spheres that meet, in some units; the second has a mass of its own."""
    return {
        "positions": np.array(TWO) * length,
        "velocities": np.array([[1.0, 1, 1], [0.0, 0, 0]]) * (length / time),
        "radii": 0.5 * length,
        "masses": [mass, mass * ratio],
        "box": np.full(3, 10.0 * length),
    }


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ({"mass": 1e-320}, "masses from .* leave the range"),
        ({"mass": 8e307, "ratio": 1.5}, "masses from .* leave the range"),
        ({"time": 1e-155}, "kinetic energy leaves the range"),
        ({"time": 1e160}, "kinetic energy leaves the range"),
        ({"time": 1e160, "mass": 1e100}, "squares of speeds that it allows do"),
        ({"mass": 1e100, "ratio": 1e-300, "time": 1e-60}, "squares of speeds that it allows do"),
        ({"length": 1e-90}, "products of the box's edges"),
        ({"length": 1e90, "time": 1e10}, "products of the box's edges"),
        ({"length": 1e-60, "time": 1e-60, "mass": 1e260}, "products of the box's edges"),
    ],
)
def test_units_in_which_products_leave_the_range_are_refused(units, message):
    with pytest.raises(SceneError, match=message) as caught:
        Scene(**moving(**units))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "units",
    [
        {},
        {"length": 2.0**-200, "time": 2.0**-200},
        {"length": 2.0**200, "time": 2.0**200},
        {"mass": 2.0**-900},
        {"mass": 2.0**900},
        {"time": 2.0**-400},
        {"time": 2.0**400},
        {"length": 2.0**-33, "time": 2.0**-40, "mass": 2.0**-86},  # SI
    ],
    ids=str,
)
def test_whatever_units_are_taken_give_the_same_numbers(units):
    """Powers of two far from 1, short of what is refused: the same bits in these units."""
    usual, sim = (hs.Simulation(Scene(**moving(**given))) for given in ({}, units))
    for each in (usual, sim):
        each.run(collisions=20)
        each.check()
    length, time, mass = (units.get(name, 1.0) for name in ("length", "time", "mass"))
    assert sim.time == usual.time * time
    assert np.array_equal(sim.positions, usual.positions * length)
    assert sim.temperature == usual.temperature * mass * (length / time) * (length / time)
    assert sim.compressibility_factor == usual.compressibility_factor


def test_units_that_are_refused_would_lose_collisions(monkeypatch):
    """Sibling: with lengths of 1e-90 squares of speed times radius are zero, and two that meet pass through each other."""
    monkeypatch.setattr("hardspheres.scene._in_range", lambda values: True)
    for units, met in (({}, True), ({"length": 1e-90}, False)):
        sim = hs.Simulation(Scene(**moving(**units)))
        sim.run(time=30.0)
        assert (sim.collisions > 0) is met


def test_a_state_is_checked_too():
    """All but overlaps, which the engine leaves by its rounding; a NaN made it search for ever."""
    scene = Scene(TWO, REST, box=(10, 10, 10))
    x, v = scene.positions, np.ones((2, 3))
    for change, message in (
        ({"positions": x * [np.nan, 1, 1]}, "the position of particle 0 along x is nan"),
        ({"velocities": v * [1, np.inf, 1]}, "the velocity of particle 0 along y is inf"),
        ({"velocities": v * 1e200}, "kinetic energy leaves the range"),
        ({"velocities": v * 1j}, "velocities hold complex"),
        ({"positions": x + [0, 0, 7]}, "the position of particle 1 along z is 11.0; .* from 0 to 10.0"),
        ({"positions": np.ma.array(x, mask=True)}, "positions are a masked array"),
        ({"radii": [0.5]}, r"radii have shape \(1,\)"),
        ({"radii": [0.5, -1]}, "the radius of particle 1 is -1.0"),
    ):
        with pytest.raises(SceneError, match=message):
            scene.with_state(**({"positions": x, "velocities": v} | change))
    later = scene.with_state(x, v, [0.4, 0.4])
    assert np.array_equal(later.velocities, v)
    assert scene.with_state([[1, 1, 1], [1.5, 1, 1]], v).n == 2


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_scenes_get_one_clear_sentence(change, message):
    arguments = {"positions": TWO, "velocities": REST}
    Scene(**arguments)  # it is the change that is refused
    with pytest.raises(SceneError, match=message) as caught:
        Scene(**arguments | change)
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("boundary", ["periodic", "wall"])
def test_touching_is_legal_and_a_trillionth_of_overlap_is_not(dim, boundary):
    for axis in range(dim):
        for start in (0.5, 1.1, 8.3):
            pair(1.0, axis, dim, start, boundary=boundary)
            with pytest.raises(SceneError, match="particles 0 and 1 overlap"):
                pair(1.0 - 1e-12, axis, dim, start, boundary=boundary)


def test_the_tolerance_is_rounding_of_coordinates_in_this_box():
    assert contact_tolerance(np.array([10.0, 3.0])) == 4 * 2.0**-52 * 10
    rng = np.random.default_rng(2)
    for scale in (1.0, 1e3, 1e6):  # touching pairs in any direction, anywhere, rounded to doubles
        for _ in range(100):
            n = rng.standard_normal(3)
            a = rng.random(3) * 10 * scale
            Scene([a, a + n / np.linalg.norm(n)], REST, box=(10 * scale,) * 3)


def test_touching_a_wall_is_legal_and_beyond_it_is_not():
    Scene([[0.5, 9.5]], [[0, 0]], box=(10, 10), boundary="wall")
    Scene([[0.3, 0.7]], [[0, 0]], radii=0.3, box=(1, 1), boundary="wall")
    with pytest.raises(SceneError, match="beyond a wall along x"):
        Scene([[0.5 - 1e-12, 9.5]], [[0, 0]], box=(10, 10), boundary="wall")


def test_a_periodic_axis_of_exactly_two_diameters():
    Scene([[0.0, 0.0], [1.0, 0.0]], np.zeros((2, 2)), box=(2, 2))
    Scene([[0.3, 0.1], [1.3, 0.1]], np.zeros((2, 2)), box=(2, 4))
    with pytest.raises(SceneError, match="overlap by 0.25 diameters"):
        Scene([[0.0, 0.0], [1.25, 0.0]], np.zeros((2, 2)), box=(2, 2))


def brute_force(positions, radii, box, periodic):
    step = np.abs(positions[:, None] - positions[None])
    step = np.where(periodic, np.minimum(step, box - step), step)
    depth = radii[:, None] + radii[None] - np.sqrt(np.sum(step**2, axis=2))
    np.fill_diagonal(depth, -np.inf)
    return depth


@st.composite
def gases(draw):
    dim = draw(st.sampled_from([2, 3]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n = draw(st.integers(2, 60))
    ratio = draw(st.sampled_from([1.0, 1.5, 10.0, 1000.0]))
    radii = 0.5 * ratio ** -rng.random(n) if ratio > 1 else np.full(n, 0.5)
    periodic = np.array(draw(st.lists(st.booleans(), min_size=dim, max_size=dim)))
    edges = [draw(st.sampled_from([2.0, 2.5, 4.0, 6.3, 20.0, 1e5])) for _ in range(dim)]
    box = np.array(edges)
    spread = np.minimum(box, draw(st.sampled_from([1e-3, 3.0, 1e5])))
    return rng.random((n, dim)) * spread, radii, box, periodic


@given(gases())
def test_the_worst_overlap_is_that_of_all_pairs(gas):
    depth = brute_force(*gas)
    i, j, found = worst_overlap(*gas)
    if depth.max() > 0:
        assert i < j
        assert found == pytest.approx(depth.max(), abs=1e-12 * gas[2].max())
        assert depth[i, j] == pytest.approx(depth.max(), abs=1e-12 * gas[2].max())
    else:
        assert found <= 0


@given(gases())
def test_an_overlap_is_found_also_where_particles_are_heaped(gas):
    depth = brute_force(*gas)
    usual, cells.MOST_PAIRS = cells.MOST_PAIRS, -1.0
    try:
        i, j, found = worst_overlap(*gas)
    finally:
        cells.MOST_PAIRS = usual
    assert (found > 0) == (depth.max() > 0)
    if found > 0:
        assert found == pytest.approx(depth[i, j], abs=1e-12 * gas[2].max())


def test_the_search_does_not_compare_all_pairs():
    n = 200_000  # 2e10 pairs: this would take minutes and terabytes
    side = np.arange(60.0) * 1.01
    lattice = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)[:n]
    for box in (60.6, 1e6):  # a full box, and a drop of liquid in an enormous one
        Scene(lattice, np.zeros_like(lattice), box=(box,) * 3)
    with pytest.raises(SceneError, match="particles 0 and 1 overlap by 1 diameters"):
        Scene(np.ones((n, 3)), np.zeros((n, 3)))


def test_worst_overlap_is_the_one_named():
    places = [[1.0, 1.0], [1.95, 1.0], [5.0, 5.0], [5.0, 5.7], [8.0, 8.0]]
    with pytest.raises(SceneError, match="particles 2 and 3 overlap by 0.3 diameters"):
        Scene(places, np.zeros((5, 2)), box=(10, 10))


def test_species_are_numbered_by_first_appearance():
    places = np.arange(10).reshape(5, 2) * 2.0
    scene = Scene(places, np.zeros((5, 2)), [0.5, 0.2, 0.5, 0.2, 0.2], [4, 1, 4, 1, 4], box=(30, 30))
    assert scene.species.tolist() == [0, 1, 0, 1, 2]
    assert scene.replace(radii=0.5, masses=1.0).species.tolist() == [0] * 5


def test_replace_checks_and_with_state_shares():
    scene = pair(1.0)
    with pytest.raises(SceneError, match="overlap by 0.5"):
        scene.replace(radii=1.0, box=(20, 20, 20))
    with pytest.raises(TypeError):
        scene.replace(colour="red")
    moved = scene.with_state(scene.positions + 1, scene.velocities + 2)
    assert moved.radii is scene.radii and moved.positions[0, 0] == 2.0 and not moved.positions.flags.writeable
    with pytest.raises(SceneError, match="shape"):
        scene.with_state(scene.positions[:1], scene.velocities)


def test_repr_is_short_and_says_what_it_is():
    text = repr(pair(2.0, boundary=("periodic", "periodic", "wall"), radii=[0.5, 0.25]))
    assert "2 particles in 3D, 2 species, box 10 x 10 x 10 (periodic, periodic, wall)" in text
    assert len(text) < 160


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 4000, 8193])
def test_sums_over_particles_keep_their_order(n, dim):
    """To the last bit from the first row, or axis, on. Sibling: another order gives other bits."""
    rng = np.random.default_rng(1)
    rows = rng.standard_normal((n, dim)) * 10.0 ** rng.uniform(-5, 5, (n, dim))
    assert np.array_equal(column_sums(rows), np.cumsum(rows, axis=0)[-1])
    assert np.array_equal(column_sums(np.asfortranarray(rows)), column_sums(rows))
    in_order = [sum((x * x for x in row), 0.0) for row in rows.tolist()]
    assert squared_lengths(rows).tolist() == in_order
    if n == 4000:
        assert not np.array_equal(column_sums(rows[::-1]), column_sums(rows))
        assert dim == 2 or squared_lengths(rows[:, ::-1]).tolist() != in_order


@pytest.mark.parametrize("periodic", [(True, True), (True, False), (False, False)])
def test_a_flight_ends_in_the_box(periodic):
    """Along periodic axes in [0, L), to the rounding of numbers far outside; walls leave numbers as they are."""
    edges = np.array([3.0, 7.0])
    steps = np.random.default_rng(2).integers(-40, 40, (500, 2)) / 8.0
    steps[:2] = [[-1e-300, -1e-300], [3.0, 7.0]]
    there = returned_to_box(steps, edges, np.array(periodic))
    for axis, wraps in enumerate(periodic):
        expected = [x % edges[axis] for x in steps[:, axis]] if wraps else steps[:, axis].tolist()
        expected[0] = 0.0 if wraps else -1e-300  # not the edge itself
        assert there[:, axis].tolist() == expected
    assert there is not steps and not np.shares_memory(there, steps)
