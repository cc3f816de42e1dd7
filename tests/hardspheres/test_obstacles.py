"""Obstacles: particles of infinite mass, which nothing moves and which nothing but their contacts tells of."""

import copy
import itertools
import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import hardspheres as hs
from hardspheres.cells import worst_overlap
from hardspheres.collision import elastic_collision, reduced_mass
from hardspheres.falling import falling_contact_time
from hardspheres.reference import ReferenceSimulation
from tests.oracle import follow

INF = math.inf


def maze(seed, n=20, obstacles=30, edge=20.0, dim=2, boundary="wall", largest=2.0):
    """Discs of two sizes and masses among obstacles of many sizes that overlap each other and the walls."""
    rng = np.random.default_rng(seed)
    box = np.full(dim, edge)
    periodic = np.array(
        [word == "periodic" for word in ([boundary] * dim if isinstance(boundary, str) else boundary)]
    )
    places = list(rng.uniform(0.0, edge, (obstacles, dim)))
    radii = list(rng.uniform(0.5, largest, obstacles))
    while len(places) < n + obstacles:
        radius = (0.3, 0.5)[len(places) % 2]
        place = rng.uniform(np.where(periodic, 0.0, radius), np.where(periodic, box, box - radius))
        apart = np.array(places) - place
        apart -= np.where(periodic, box * np.rint(apart / box), 0.0)
        if np.all(np.linalg.norm(apart, axis=1) > np.array(radii) + radius):
            places.append(place)
            radii.append(radius)
    masses = np.r_[np.full(obstacles, INF), np.where(np.arange(n) % 2, 1.0, 7.0)]
    velocities = np.r_[np.zeros((obstacles, dim)), rng.standard_normal((n, dim))]
    mixed = rng.permutation(n + obstacles)
    return hs.Scene(
        np.array(places)[mixed], velocities[mixed], np.array(radii)[mixed], masses[mixed], box, boundary
    )


def billiard(radius=0.3, small=0.01, seed=3):
    """Sinai's billiard, a quarter of it unfolded by its walls: a small disc round an obstacle in the middle."""
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi)
    return hs.Scene(
        [[0.5, 0.5], [0.1, 0.13]],
        [[0.0, 0.0], [math.cos(angle), math.sin(angle)]],
        [radius, small],
        [INF, 3.0],
        (1.0, 1.0),
        "wall",
    )


def bits(sim):
    a = sim._engine.arrays
    arrays = a.row.tobytes(), a.total.tobytes(), a.image_counts.tobytes()
    return *arrays, sim.collisions, sim.obstacle_collisions, sim.wall_collisions


# The rule.


def test_the_rule_is_the_limit_of_a_heavy_partner():
    """In exact arithmetic the error of a finite mass M is of order m / M, and an infinite mass has none."""
    one, other, apart = (
        [Fraction(3), Fraction(-2)],
        [Fraction(0), Fraction(0)],
        [Fraction(-1), Fraction(2, 3)],
    )
    mass = Fraction(7, 5)
    limit, still = elastic_collision(mass, one, INF, other, apart)
    assert [float(v) for v in still] == [0.0, 0.0]
    b, rr = sum(r * v for r, v in zip(apart, one, strict=True)), sum(r * r for r in apart)
    mirrored = [v - 2 * b / rr * r for v, r in zip(one, apart, strict=True)]
    assert limit == mirrored and sum(v * v for v in limit) == sum(v * v for v in one)
    for power in (3, 6, 9):
        heavy, _ = elastic_collision(mass, one, Fraction(10) ** power, other, apart)
        off = max(abs(a - b) for a, b in zip(heavy, mirrored, strict=True))
        assert 1e-1 < off * 10**power < 1e2


def test_the_reduced_mass_with_an_obstacle_is_the_other_mass():
    assert reduced_mass(2.0, INF) == 2.0 == reduced_mass(INF, 2.0)
    assert reduced_mass(2.0, 2.0) == 1.0


# The dynamics.


def test_the_mean_free_path_in_a_billiard_is_santalos():
    """pi A / P of the free area A and the obstacle's edge P, exact; a radius 1 % larger is told apart.

    64 blocks of 16 000 collisions. Two-sided at 3.5 standard errors of 63 degrees of freedom: false alarm 9e-4.
    """
    scene = billiard()
    reach, side = 0.31, 1.0 - 2 * 0.01

    def exact(radius):
        return math.pi * (side * side - math.pi * radius * radius) / (2.0 * math.pi * radius)

    sim = hs.Simulation(scene)
    paths, before = [], 0.0
    for _ in range(64):
        sim.run(collisions=16_000)
        paths.append((sim.time - before) / 16_000)
        before = sim.time
    mean, error = np.mean(paths), np.std(paths, ddof=1) / 8.0
    assert abs(mean - exact(reach)) < 3.5 * error
    assert abs(mean - exact(1.01 * reach)) > 5.0 * error
    assert sim.collisions == sim.obstacle_collisions == sim.collisions_per_particle
    assert abs(sim.energy_drift) < 2e-12  # a random walk of a million roundings
    assert np.all(np.abs(sim.momentum_drift) < 1e-9)
    sim.check()


def test_an_obstacle_keeps_every_bit_and_the_speed_is_kept_to_rounding():
    scene = maze(1)
    sim = hs.Simulation(scene)
    before = sim._engine.rows[scene.obstacles].tobytes()
    for _ in range(4):
        sim.run(collisions=3000)
        sim.check()
    assert sim._engine.rows[scene.obstacles].tobytes() == before
    assert np.array_equal(sim.positions[scene.obstacles], scene.positions[scene.obstacles])
    assert not sim.velocities[scene.obstacles].any()
    assert abs(sim.energy_drift) < 1e-13
    assert 0 < sim.obstacle_collisions < sim.collisions


def test_an_event_at_an_obstacle_leaves_what_others_know_of_it():
    """Only the particle that moves gets a new version: one row changes."""
    scene = billiard()
    sim = hs.Simulation(scene)
    sim.run(collisions=100)
    assert sim._engine.arrays.version.tolist() == [0, 100 + sim.wall_collisions]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_both_searches_give_the_same_bits(seed):
    scene = maze(seed)
    sims = [hs.Simulation(scene, search=search) for search in ("lists", "windows")]
    for sim in sims:
        for _ in range(3):
            sim.run(collisions=2000)
            sim.check()
    assert bits(sims[0]) == bits(sims[1])


def test_large_obstacles_among_small_discs_have_a_grid_of_their_own():
    """Obstacles ten times as large, three of them overlapping: two grids, and the same bits."""
    big = [[15.0, 15.0], [19.0, 15.0], [17.0, 18.0], [32.0, 30.0]]
    rng, small = np.random.default_rng(5), []
    while len(small) < 300:
        place = rng.uniform(0.5, 39.5, 2)
        if np.all(np.hypot(*(np.array(big) - place).T) > 5.5) and all(
            math.dist(place, q) > 1.0 for q in small
        ):
            small.append(place)
    scene = hs.Scene(
        np.r_[small, big],
        np.r_[rng.standard_normal((300, 2)), np.zeros((4, 2))],
        np.r_[np.full(300, 0.5), np.full(4, 5.0)],
        np.r_[np.ones(300), np.full(4, INF)],
        (40.0, 40.0),
        "wall",
    )
    sims = [hs.Simulation(scene, search=search) for search in ("lists", "windows")]
    for sim in sims:
        sim.run(collisions=5000)
        sim.check()
    assert "two grids" in sims[1].status()["method"]
    assert bits(sims[0]) == bits(sims[1])


def test_the_engine_does_what_the_all_pairs_solver_does():
    assert follow(maze(4), 60) >= 15


def test_many_obstacles_on_one_spot_are_handled():
    """Hundreds in one cell: rooms grow, and lists of obstacles stay empty."""
    places = np.c_[np.full(400, 5.0), np.linspace(0.0, 10.0, 400)]
    scene = hs.Scene(
        np.r_[places, [[2.0, 5.0], [8.0, 5.0], [8.0, 2.0]]],
        np.r_[np.zeros((400, 2)), [[1.0, 0.3], [-1.0, 0.7], [0.2, 1.1]]],
        np.r_[np.full(400, 0.3), [0.4, 0.4, 0.4]],
        np.r_[np.full(400, INF), [1.0, 2.0, 1.0]],
        (10.0, 10.0),
        "wall",
    )
    sims = [hs.Simulation(scene, search=search) for search in ("lists", "windows")]
    for sim in sims:
        sim.run(collisions=2000)
        sim.check()
    assert bits(sims[0]) == bits(sims[1])
    at, arrays = sims[0]._at, sims[0]._engine.arrays
    lists = arrays.neighbours[: scene.n * int(arrays.counter[at.LIST_ROOM])].reshape(scene.n, -1)
    assert np.all(lists[scene.obstacles] == scene.n)
    assert sims[0].positions[400, 0] < 5.0 < sims[0].positions[401, 0]  # the wall has no hole


def test_reversed_velocities_lead_back():
    """A few collisions at a Lyapunov exponent of two per collision; ten more lose all digits."""

    def way_back(collisions):
        sim = hs.Simulation(billiard(seed=8))
        sim.run(collisions=collisions)
        there = sim.to_scene()
        back = hs.Simulation(there.replace(velocities=-there.velocities))
        back.run(time=sim.time)
        return np.abs(back.positions - sim.scene.positions).max()

    assert way_back(5) < 1e-9
    assert way_back(60) > 1e-3


def test_a_grazing_contact_is_a_number():
    """An obstacle hit tangentially, or just missed: nothing becomes 0 times infinity."""
    for offset in np.concatenate([[0.0], 2.0 ** -np.arange(30, 56)]):
        scene = hs.Scene(
            [[5.0, 5.0], [2.0, 6.0 - offset]],
            [[0.0, 0.0], [1.0, 0.0]],
            [0.75, 0.25],
            [INF, 3.0],
            (10.0, 10.0),
            "wall",
        )
        sim = hs.Simulation(scene)
        sim.run(time=7.0)
        assert np.isfinite(sim.velocities).all() and abs(sim.energy_drift) < 1e-15
        sim.check()


# Gravity: obstacles do not fall.


def falls_onto(x, v, a, sigma2, horizon):
    """Return the first root of the quartic at which the ball approaches, from all four in 60 digits; None: a double one."""
    with mpmath.workdps(60):
        r, u, g = ([mpmath.mpf(c) for c in part] for part in (x, v, a))

        def dot(one, other):
            return sum(c * d for c, d in zip(one, other, strict=True))

        quartic = [
            dot(g, g) / 4,
            dot(g, u),
            dot(u, u) + dot(g, r),
            2 * dot(r, u),
            dot(r, r) - mpmath.mpf(sigma2),
        ]
        slope = [4 * quartic[0], 3 * quartic[1], 2 * quartic[2], quartic[3]]
        roots = mpmath.polyroots(quartic[::-1], maxsteps=500, extraprec=300, asc=True)
        real = [mpmath.re(t) for t in roots if abs(mpmath.im(t)) < 1e-40]
        first = [t for t in real if 0 < t <= horizon and mpmath.polyval(slope[::-1], t, asc=True) < 0]
        return float(min(first, default=INF))


def test_the_contact_of_a_falling_ball_is_the_first_root():
    """Far and near, fast and slow, weak and strong gravity; the contact distance is exact to a rounding of the way."""
    rng, met = np.random.default_rng(3), 0
    for k in range(150):
        dim = 2 + k % 2
        x, v, a = (np.zeros(3) for _ in range(3))
        normal = rng.normal(size=dim)
        x[:dim] = normal / np.linalg.norm(normal) * (1.0 + 10.0 ** rng.uniform(-9, 1))
        v[:dim] = rng.normal(size=dim) * 10.0 ** rng.uniform(-3, 1)
        a[:dim] = rng.normal(size=dim) * 10.0 ** rng.uniform(-3, 1)
        found, exact = falling_contact_time(*x, *v, *a, 1.0, 100.0), falls_onto(x, v, a, 1.0, 100.0)
        assert math.isinf(found) == math.isinf(exact)
        if math.isinf(found):
            continue
        met += 1
        way = np.linalg.norm(x) + np.linalg.norm(v) * found + np.linalg.norm(a) * found**2 / 2
        there = x + v * found + a * found**2 / 2
        assert abs(np.linalg.norm(there) - 1.0) < 8e-16 * way
        assert abs(there @ (v + a * found)) * abs(found - exact) < 1e-14 * way**2
    assert met > 50


def test_a_ball_leaves_and_comes_back():
    """A bounce of any height lasts 2 u / g, also where it starts too deep by a rounding, and that is no contact."""
    for u in (1.0, 1e-3, 1e-6, 3e-8):
        for depth in (0.0, 1e-16, -1e-16):
            again = falling_contact_time(0.0, 1.0 - depth, 0.0, 0.0, u, 0.0, 0.0, -1.0, 0.0, 1.0, 10.0)
            assert again == pytest.approx(2.0 * u, rel=max(1e-15, 8.0 * abs(depth) / u**2), abs=0.0)
    down = (0.0, -1.0, 0.0)
    assert (
        falling_contact_time(0.0, 1.0, 0.0, 0.0, -1.0, 0.0, *down, 1.0, 10.0) == 0.0
    )  # approaching, and there
    assert (
        falling_contact_time(0.0, -1.0, 0.0, 0.0, -1.0, 0.0, *down, 1.0, 10.0) == INF
    )  # falls away from below
    assert (
        falling_contact_time(0.0, 1.0, 0.0, 5.0, 0.0, 0.0, *down, 1.0, 10.0) == INF
    )  # too fast to touch it again
    # Thrown up so as to graze it from below: 1e-9 more meets it, 1e-9 less does not.
    for factor, meets in ((1.0 + 1e-9, True), (1.0 - 1e-9, False)):
        up = factor * math.sqrt(2.0)
        assert (falling_contact_time(0.0, -2.0, 0.0, 0.0, up, 0.0, *down, 1.0, 10.0) < INF) == meets


def pinned(seed, gravity=(0.0, -1.0), **more):
    return maze(seed, **more).replace(gravity=gravity)


@pytest.mark.parametrize("gravity", [(0.0, -1.0), (0.3, 20.0)])
def test_falling_discs_among_obstacles_do_what_the_all_pairs_solver_does(gravity):
    """Every stored event is what the rows say and none is missing, energy is kept, and the oracle agrees."""
    scene = pinned(4, gravity)
    assert follow(scene, 40) == 40
    sim = hs.Simulation(scene)
    for _ in range(4):
        sim.run(collisions=700)
        sim.check()
    assert sim.status()["late_events"] == 0 and sim.obstacle_collisions > 1000
    assert abs(sim.energy_drift) < 3e-14 and np.all(np.abs(sim.momentum_drift) < 1e-13)
    assert np.array_equal(sim.positions[scene.obstacles], scene.positions[scene.obstacles])
    assert not sim.velocities[scene.obstacles].any()


def test_the_comparison_sees_obstacles_that_fall(monkeypatch):
    """Sibling: an oracle whose obstacles fall too is told apart, at their first collision."""
    monkeypatch.setattr(ReferenceSimulation, "pulls", property(lambda self: [self.gravity] * self.scene.n))
    with pytest.raises(AssertionError):
        follow(pinned(4), 40)


def test_potential_energy_and_weight_leave_obstacles_out():
    scene = pinned(2)
    moves = ~scene.obstacles
    assert scene.potential_energy == pytest.approx(
        float(np.sum(scene.masses[moves] * (scene.positions[moves, 1] - scene.radii[moves])))
    )
    sim = hs.Simulation(scene)
    sim.run(time=30.0)
    at = sim._at
    assert sim._engine.arrays.number[at.WEIGHT + 1] == -scene.masses[moves].sum()
    assert np.isfinite(sim.tallies.kinetic).all() and math.isfinite(sim.compressibility_factor)


def test_a_bounce_on_an_obstacle_keeps_its_height():
    """On top of it, exactly: 5000 bounces of 2 sqrt(2 h / g), whatever h; a ball that only lies there is refused."""
    for h in (1e-12, 1e-8, 0.5):
        scene = hs.Scene(
            [[5.0, 3.0], [5.0, 4.0 + h]], [[0, 0], [0, 0]], [0.75, 0.25], [INF, 3.0], (10.0, 10.0), "wall",
            gravity=(0, -1),
        )  # fmt: skip
        sim = hs.Simulation(scene)
        sim.run(collisions=5000)
        sim.check()
        drop = scene.positions[1, 1] - 4.0
        assert sim.time == pytest.approx(
            2.0 * math.sqrt(2.0 * drop) * 4999.5, rel=1e-4 if h < 1e-10 else 1e-8
        )
        assert abs(sim.energy_drift) < 2e-14 and sim.positions[1, 0] == 5.0
    sim = hs.Simulation(scene.replace(positions=[[5.0, 3.0], [5.0, 4.0]]))
    with pytest.raises(hs.SimulationError, match="particle 1 has come to rest on a wall or an obstacle that"):
        sim.run(time=1.0)


def test_a_ball_rolls_off_an_obstacle():
    """From a millionth above its side, in ever faster bounces; it ends with the energy that it began with."""
    scene = hs.Scene(
        [[5.0, 3.0], [5.1, 3.0 + math.sqrt(1.0 - 0.01) + 1e-6]], [[0, 0], [0, 0]], [0.75, 0.25], [INF, 3.0],
        (10.0, 10.0), "wall", gravity=(0, -1),
    )  # fmt: skip
    sim = hs.Simulation(scene)
    sim.run(time=5.0)
    sim.check()
    assert sim.collisions > 100 and sim.positions[1, 0] > 5.8 and abs(sim.energy_drift) < 2e-14


def test_windows_cannot_be_used_with_obstacles_under_gravity():
    with pytest.raises(
        hs.SimulationError, match="towards obstacles are curved, and windows compare straight"
    ):
        hs.Simulation(pinned(2), search="windows")
    assert "neighbour lists" in hs.Simulation(pinned(2)).status()["method"]


def test_falling_among_obstacles_goes_on_with_the_same_bits(tmp_path):
    sim = hs.Simulation(pinned(2))
    sim.run(collisions=700)
    sim.save(tmp_path / "pins.npz")
    twins = [hs.Simulation.load(tmp_path / "pins.npz"), copy.deepcopy(sim)]
    for each in (sim, *twins):
        each.run(collisions=2000)
    assert bits(sim) == bits(twins[0]) == bits(twins[1])
    assert hs.Simulation(sim.to_scene()).scene.falls


@pytest.mark.parametrize("gravity", [0.01, 30.0])
@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"boundary": ("periodic", "wall")}, marks=pytest.mark.slow),
        pytest.param(
            {"boundary": ("periodic", "wall"), "edge": 7.0, "n": 5, "obstacles": 4, "largest": 0.6},
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"dim": 3, "edge": 9.0, "boundary": ("wall", "periodic", "wall")}, marks=pytest.mark.slow
        ),
        pytest.param({"dim": 3, "edge": 10.0}, marks=pytest.mark.long),
    ],
)
def test_falling_among_obstacles_in_other_boxes(options, gravity):
    """Periodic axes, lists that name the image, spheres, two directions at once."""
    dim = options.get("dim", 2)
    pull = np.zeros(dim)
    pull[-1], pull[0] = -gravity, 0.3 * gravity * (dim == 3)
    scene = pinned(5, pull, **options)
    sim = hs.Simulation(scene)
    for _ in range(6):
        sim.run(collisions=500)
        sim.check()
    assert abs(sim.energy_drift) < 3e-14 and sim.status()["late_events"] == 0
    assert follow(scene, 40) >= 10


# What counts, and what does not.


def test_quantities_leave_obstacles_out():
    scene = maze(2)
    moves = ~scene.obstacles
    alone = hs.Scene(
        scene.positions[moves],
        scene.velocities[moves],
        scene.radii[moves],
        scene.masses[moves],
        scene.box,
        scene.boundary,
    )
    assert (scene.n, scene.n_moving, alone.n) == (50, 20, 20)
    for name in ("kinetic_energy", "thermal_energy", "temperature", "degrees_of_freedom"):
        assert getattr(scene, name) == pytest.approx(getattr(alone, name), rel=1e-14)
    for name in ("packing_fraction", "number_density"):
        assert getattr(scene, name) == pytest.approx(getattr(alone, name), rel=1e-14)
    assert np.allclose(scene.momentum, alone.momentum, rtol=1e-13)
    assert "20 particles in 2D, 2 species, 30 obstacles" in repr(scene)
    sim = hs.Simulation(scene)
    sim.run(collisions=500)
    assert sim.temperature == pytest.approx(scene.temperature, rel=1e-13)
    assert np.isfinite(sim.tallies.kinetic).all() and np.isfinite(sim.pressure_tensor).all()
    assert math.isfinite(sim.compressibility_factor)


def test_in_a_periodic_box_no_motion_is_common_where_there_are_obstacles():
    """d degrees of freedom for each that moves: obstacles take up momentum."""
    free = hs.Scene([[2, 2], [5, 5], [8, 8]], [[1, 0], [1, 0], [0, 0]], box=(10, 10))
    fixed = free.replace(masses=[1.0, 1.0, INF])
    assert (free.degrees_of_freedom, fixed.degrees_of_freedom) == (4, 4)
    assert fixed.thermal_energy == fixed.kinetic_energy == 1.0 and fixed.temperature == 0.5
    assert free.thermal_energy < free.kinetic_energy


def test_collisions_per_particle_count_for_those_that_move():
    sim = hs.Simulation(maze(3))
    s = [frame.collisions_per_particle for frame in sim.frames(collisions_per_particle=[0, 1, 2.5, 40])]
    assert s[0] == 0.0 and all(0 <= a - b <= 0.05 + 1e-12 for a, b in zip(s, (0, 1, 2.5, 40), strict=True))
    partners = 2 * sim.collisions - sim.obstacle_collisions
    assert sim.collisions_per_particle == partners / 20
    assert sim.status()["obstacle_collisions"] == sim.obstacle_collisions > 0


def test_the_momentum_given_to_obstacles_is_accounted_for():
    sim = hs.Simulation(maze(6))
    sim.run(collisions=5000)
    assert np.all(np.abs(sim.momentum_drift) < 1e-12)
    change = sim.momentum - sim.scene.momentum
    assert np.abs(change).max() > 0.1  # and momentum itself is not kept


@pytest.mark.slow
def test_free_paths_and_the_log_leave_obstacles_out():
    """Obstacles are one species without flights; all that they have in the log is the collision.

    In small: `test_bounds.test_nor_among_obstacles`.
    """
    scene, chunks = maze(1), []
    sim = hs.Simulation(scene, free_paths=True, log=chunks.append, search="lists")
    sim.run(collisions=3000)
    events, paths = np.concatenate(chunks), sim.free_paths
    kind = int(scene.species[np.argmax(scene.obstacles)])
    assert int(scene.species.max()) == 2 and np.all((scene.species == kind) == scene.obstacles)
    assert paths.flights[kind] == paths.first_flights[kind] == 0 and paths.path_flown[kind] == 0.0
    partners = 2 * sim.collisions - sim.obstacle_collisions
    assert int(np.sum(paths.flights + paths.first_flights)) == partners
    pairs = events[events["j"] < scene.n]
    for k, name in enumerate(("i", "j")):
        fixed = scene.obstacles[pairs[name]]
        assert np.isnan(pairs["free_path"][fixed, k]).all() and fixed.any()
    hits = scene.obstacles[pairs["i"]] | scene.obstacles[pairs["j"]]
    assert np.count_nonzero(hits) == sim.obstacle_collisions
    assert np.all(pairs["impulse"] > 0.0)


# Effusion.


@pytest.mark.slow
def test_effusion_through_a_hole_in_a_wall_of_obstacles():
    """Crossings of a gap at equilibrium: n <|v_x|> (gap - diameter) a time, both ways together; exact.

    The free area is that of centres; <|v_x|> is that of a sphere in the 2N velocity components. The gap of the
    whole wall is closed: with the obstacles' radii in place of the reach of centres the rate is excluded. Two-sided
    at 3.5 standard errors of 40 blocks: false alarm 1.2e-3.
    """
    radius, small, edge, n = 0.25, 0.05, 6.0, 12
    heights = np.arange(0.0, edge + 0.01, 0.1)
    heights = heights[np.abs(heights - 3.0) > 0.45]
    gap = float(np.min(heights[heights > 3.0]) - np.max(heights[heights < 3.0]))
    rng, places = np.random.default_rng(2), []
    wall = np.c_[np.full(len(heights), 3.0), heights]
    while len(places) < n:
        place = rng.uniform(small, edge - small, 2)
        if all(math.dist(place, q) > radius + small for q in wall) and all(
            math.dist(place, q) > 2 * small for q in places
        ):
            places.append(place)
    m = len(wall)
    scene = hs.Scene(
        np.r_[wall, places],
        np.r_[np.zeros((m, 2)), rng.standard_normal((n, 2))],
        np.r_[np.full(m, radius), np.full(n, small)],
        np.r_[np.full(m, INF), np.ones(n)],
        (edge, edge),
        "wall",
    )
    chunks = []
    sim = hs.Simulation(scene, log=chunks.append, search="lists")
    x, v, began = scene.positions[:, 0].copy(), scene.velocities.copy(), np.zeros(scene.n)
    crossed, times = [], []
    for _ in range(40):
        before, count = sim.time, 0
        sim.run(collisions=400)
        for event in np.concatenate(chunks):
            for who, sign in ((int(event["i"]), 1.0), (int(event["j"]), -1.0)):
                if who >= m and who < scene.n:
                    there = x[who] + v[who, 0] * (event["time"] - began[who])
                    count += (x[who] < 3.0) != (there < 3.0)
                    x[who], began[who] = there, event["time"]
                    v[who] += sign * event["impulse"] * event["normal"]
        chunks.clear()
        crossed.append(count)
        times.append(sim.time - before)
    # Area that centres can reach: the box less the wall, whose two edges are arcs of the reach.
    reach = radius + small
    grid = (np.arange(3000) + 0.5) / 3000 * (edge - 2 * small) + small
    off = np.abs(grid[:, None] - heights[None, :]).min(axis=1)  # along y: the nearest obstacle
    covered = np.mean(2.0 * np.sqrt(np.maximum(reach**2 - off**2, 0.0))) * (edge - 2 * small)
    area = (edge - 2 * small) ** 2 - covered
    speed = math.sqrt(2.0 * scene.kinetic_energy) * math.gamma(n) / (math.sqrt(math.pi) * math.gamma(n + 0.5))
    rates = np.array(crossed) / np.array(times)
    mean, error = float(np.sum(crossed) / np.sum(times)), float(np.std(rates, ddof=1) / math.sqrt(40))
    assert abs(mean - n / area * speed * (gap - 2 * reach)) < 3.5 * error
    assert abs(mean - n / area * speed * (gap - 2 * radius)) > 5.0 * error


# Going on, and files.


def test_copies_and_checkpoints_go_on_with_the_same_bits(tmp_path):
    sim = hs.Simulation(maze(2))
    sim.run(collisions=700)
    sim.save(tmp_path / "obstacles.npz")
    twins = [hs.Simulation.load(tmp_path / "obstacles.npz", search="windows"), copy.deepcopy(sim)]
    for each in (sim, *twins):
        each.run(collisions=3000)
    assert bits(sim) == bits(twins[0]) == bits(twins[1])
    assert hs.Simulation(sim.to_scene()).scene.n_moving == 20


def test_a_checkpoint_whose_obstacle_has_moved_is_refused():
    sim = hs.Simulation(maze(2))
    arrays = sim._copied_arrays()
    arrays["row"][np.argmax(sim.scene.obstacles), 0] += 0.125
    with pytest.raises(hs.CheckpointError, match="an obstacle is not where its scene has it"):
        hs.Simulation._from_arrays(arrays)


def test_check_sees_an_obstacle_that_moved():
    sim = hs.Simulation(maze(2))
    sim.run(collisions=10)
    sim._engine.rows[np.argmax(sim.scene.obstacles), 0] += 1e-9
    with pytest.raises(hs.InvariantError, match="an obstacle has moved"):
        sim.check()


@pytest.mark.parametrize("suffix", ["xyz", "traj", "gsd"])
def test_files_have_obstacles_of_mass_zero(tmp_path, suffix, caplog):
    sim = hs.Simulation(maze(1))
    sim.run(collisions=100)
    with hs.TrajectoryWriter(tmp_path / f"maze.{suffix}") as out:
        out.write(sim.frame())
    (back,) = hs.read_trajectory(tmp_path / f"maze.{suffix}")
    assert np.array_equal(back.masses, sim.scene.masses) and np.array_equal(back.positions, sim.positions)
    assert np.allclose(back.velocities, sim.velocities, rtol=1e-15, atol=0.0)
    assert "30 particles of mass 0 are obstacles, which nothing moves" in caplog.text
    atoms = sim.to_atoms()
    assert np.all(atoms.get_masses()[sim.scene.obstacles] == 0.0) and np.isfinite(atoms.get_momenta()).all()
    symbols = np.array(atoms.get_chemical_symbols())
    assert len(set(symbols[sim.scene.obstacles])) == 1
    assert not set(symbols[sim.scene.obstacles]) & set(symbols[~sim.scene.obstacles])


def test_a_moving_obstacle_in_a_file_is_refused():
    atoms = maze(1).to_atoms()
    momenta = atoms.get_momenta()
    momenta[np.argmax(maze(1).obstacles)] = [1.0, 0.0, 0.0]
    atoms.arrays["momenta"] = momenta
    with pytest.raises(hs.SceneError, match="an obstacle never moves"):
        hs.Scene.from_atoms(atoms)


# Bad input.

PLACES = np.array([[2.0, 2.0], [5.0, 5.0], [8.0, 8.0]])
AT_REST = np.zeros((3, 2))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"velocities": [[0, 0], [0.5, 0], [0, 0]], "masses": [1, INF, 1]},
            "has infinite mass and the velocity 0.5 0; an obstacle never moves: give it the velocity 0, or a",
        ),
        (
            {"positions": [[2, 2], [5, 5], [5.6, 5]], "masses": [1, INF, 1]},
            "obstacle 1 overlaps particle 2 by 0.4 of their contact distance",
        ),
        ({"masses": INF}, "all particles have infinite mass; at least one must have a finite mass, to move"),
        ({"masses": [1, -INF, 1]}, "the mass of particle 1 is -inf; it must be positive"),
        ({"masses": [1, math.nan, 1]}, "the mass of particle 1 is nan; it must be positive"),
        (
            {"positions": [[2, 2], [5, 11], [8, 8]], "masses": [1, INF, 1], "boundary": "wall"},
            "the centre of obstacle 1 lies 1 beyond a wall along y",
        ),
    ],
)
def test_impossible_obstacles_are_refused_in_one_sentence(changes, sentence):
    arguments = {"positions": PLACES, "velocities": AT_REST, "box": (10, 10)} | changes
    with pytest.raises(hs.SceneError) as refused:
        hs.Scene(**arguments)
    assert sentence in str(refused.value)


def test_gases_and_estimators_refuse_obstacles():
    from analysis.pressure import Pressure

    with pytest.raises(
        ValueError, match=r"this scene has 30 obstacles \(infinite mass\), and estimators measure"
    ):
        Pressure(maze(1)).add(hs.Simulation(maze(1)).frame())
    with pytest.raises(hs.SceneError, match="mass of particle 0 is inf; it must be positive and finite"):
        hs.random_gas(n=10, packing_fraction=0.1, dim=2, masses=INF, seed=1)


def test_obstacles_may_overlap_each_other_and_walls_and_nothing_else():
    """Of all pairs but those of two obstacles the worst overlap is found, whatever the sizes."""
    rng = np.random.default_rng(7)
    box, periodic = np.array([12.0, 12.0]), np.array([True, False])
    for _ in range(20):
        places, radii = rng.uniform(0.0, 12.0, (60, 2)), rng.choice([0.05, 0.3, 1.0, 2.0], 60)
        fixed = rng.random(60) < 0.6
        worst = -INF
        for a, b in itertools.combinations(range(60), 2):
            apart = places[a] - places[b]
            apart[0] -= 12.0 * np.rint(apart[0] / 12.0)
            if not (fixed[a] and fixed[b]):
                worst = max(worst, radii[a] + radii[b] - math.hypot(*apart))
        i, j, depth = worst_overlap(places, radii, box, periodic, fixed)
        assert depth == pytest.approx(worst, abs=1e-14) and not (fixed[i] and fixed[j])


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"dim": 3, "boundary": ("wall", "periodic", "wall")}, marks=pytest.mark.slow),
        pytest.param({"boundary": "periodic"}, marks=pytest.mark.slow),
        pytest.param({"dim": 3}, marks=pytest.mark.long),
        pytest.param({"dim": 3, "boundary": "periodic"}, marks=pytest.mark.long),
    ],
)
def test_both_searches_and_the_oracle_in_other_boxes(options):
    """Spheres, walls and periodic axes; spheres in a periodic box also in test_lorentz.test_in_3d."""
    scene = maze(9, **{"edge": 14.0 if "dim" in options else 24.0, **options})
    sims = [hs.Simulation(scene, search=search) for search in ("lists", "windows")]
    for sim in sims:
        sim.run(collisions=5000)
        sim.check()
    assert bits(sims[0]) == bits(sims[1])
    assert follow(scene, 40) >= 10


def wave_fronts(radius, copies=2000, steps=600, seed=1):
    """Growth of a wave front per collision in Sinai's billiard, and its standard error, by a program that is not ours.

    Between collisions its curvature B becomes B / (1 + B t) and its length grows 1 + B t times; a disc adds
    2 / (R cos phi) (Sinai 1970, doi 10.1070/RM1970v025n02ABEH003794).
    """
    rng = np.random.default_rng(seed)
    q = rng.uniform(-0.5, 0.5, (4 * copies, 2))  # from the disc, which lies in the middle of each cell
    q = q[np.hypot(*q.T) > radius][:copies]
    angle = rng.uniform(0.0, 2.0 * math.pi, copies)
    v = np.c_[np.cos(angle), np.sin(angle)]
    flown, bent, found = np.zeros(copies), np.full(copies, 1.0 / radius), np.zeros((2, copies))
    for step in range(steps):
        b = (q * v).sum(axis=1)
        square = b * b - (q * q).sum(axis=1) + radius * radius
        hits = (b < 0.0) & (square > 0.0)
        out = (0.5 * np.sign(v) - q) / v
        time = np.where(hits, -b - np.sqrt(np.abs(square)), out.min(axis=1))
        q += time[:, None] * v
        flown += time
        leaves, axis = ~hits, out.argmin(axis=1)
        q[leaves, axis[leaves]] = -0.5 * np.sign(v[leaves, axis[leaves]])
        normal = q[hits] / radius
        cosine = -(normal * v[hits]).sum(axis=1)
        v[hits] += 2.0 * cosine[:, None] * normal
        v[hits] /= np.hypot(*v[hits].T)[:, None]
        longer = 1.0 + flown[hits] * bent[hits]
        if step >= 30:  # the first curvature is forgotten
            found[:, hits] += [np.ones(len(cosine)), np.log(longer)]
        bent[hits] = bent[hits] / longer + 2.0 / (radius * cosine)
        flown[hits] = 0.0
    count, growth = found
    mean = growth.sum() / count.sum()
    return mean, float(np.std(growth - mean * count, ddof=1) / count.mean() / math.sqrt(copies))


@pytest.mark.slow
def test_sinais_billiard_on_a_torus():
    """Free path (1 - pi R^2) / (2R), exact; Lyapunov exponents beside the growth of wave fronts.

    Three numbers at 4 standard errors of 23 degrees of freedom or more: false alarm 1.5e-3. Sibling: a radius
    that is 5 % larger.
    """
    from analysis.lyapunov import lyapunov_exponent

    reach = 0.4
    scene = hs.Scene(
        [[0.5, 0.5], [0.05, 0.02]], [[0, 0], [0.6, 0.8]], reach / 2, [INF, 1.0], (1.0, 1.0), "periodic"
    )
    sim, paths, before = hs.Simulation(scene), [], 0.0
    for _ in range(64):
        sim.run(collisions=10_000)
        paths.append((sim.time - before) / 10_000)
        before = sim.time
    mean, error = np.mean(paths), np.std(paths, ddof=1) / 8.0
    found = lyapunov_exponent(scene, collisions_per_particle=20_000, settle=50)
    for radius, right in ((reach, True), (1.05 * reach, False)):
        path, (growth, uncertainty) = (1.0 - math.pi * radius**2) / (2.0 * radius), wave_fronts(radius)
        assert uncertainty < 0.3 * found.per_collision.standard_error
        off = (
            abs(mean - path) / error,
            abs(found.per_collision.deviation(growth, uncertainty)),
            abs(found.per_time.deviation(growth / path, uncertainty / path)),
        )
        assert max(off) < 4.0 if right else min(off) > 5.0, off


def test_few_particles_among_many_obstacles_are_searched_by_lists():
    """Each window costs time for each obstacle: lists are 4 to 12 times as fast. Sibling: as dilute, more that move."""
    for n, obstacles, search in ((1, 80, "neighbour lists"), (4, 80, "windows of time")):
        sim = hs.Simulation(maze(1, n, obstacles, edge=60.0, largest=0.6))
        assert search in sim.status()["method"]
