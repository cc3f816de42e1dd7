"""Gravity: balls that fall, bounce and collide in flight, against closed forms, the oracle, and conservation laws.

The default tests compile one kind of scene, with both searches: discs of two masses and radii between walls.
"""

import math
import pickle
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from oracle import follow
from scenes import SEARCHES, everything, gas, one_to_ten, state

import hardspheres as hs
from hardspheres.gravity import climbed_speed, impact_square, impact_time
from hardspheres.kernel import specialise
from hardspheres.reference import ReferenceSimulation
from hardspheres.tuning import epoch_length

PULLS = [(0.0, -1.0), (0.7, -3.0), (0.0, 20.0)]  # down, towards a corner, and strong, to the upper wall
MIXTURE = {"radii": [0.5, 0.3], "masses": [2.0, 0.25]}


def falling(n=16, packing_fraction=0.1, gravity=(0.0, -1.0), seed=7):
    return gas("2d_mixture_walls", n, packing_fraction, seed=seed).replace(gravity=gravity)


def bouncers(heights, g, velocities=((0.0, 0.0), (0.0, 0.0)), box=(4.0, 6.0)):
    """Two discs in columns of their own, which never meet, dropped from these heights above the floor."""
    positions = [[1.0, 0.5 + heights[0]], [3.0, 0.3 + heights[1]]]
    return hs.Scene(positions, velocities, box=box, boundary="wall", gravity=(0.0, -g), **MIXTURE)


def alone_by_rows(radius, height, g, epoch, bounces):
    """Relative error of the energy of a ball whose speed at the floor is always that of its row."""
    x, v, t = radius + height, 0.0, 0.0
    for _ in range(bounces):
        while True:
            square = impact_square(-v, max(x - radius, 0.0), g)
            wait = impact_time(-v, max(x - radius, 0.0), g, math.sqrt(square))
            if t + wait < epoch:
                break
            dt = epoch - t
            x, v, t = x + (v - 0.5 * g * dt) * dt, v - g * dt, 0.0
        x, v, t = radius, math.sqrt(square), t + wait
    return abs(v * v / (2.0 * g * height) - 1.0)


@pytest.mark.parametrize("search", SEARCHES)
def test_a_dropped_ball_comes_back_to_its_height(search):
    """Period 2 sqrt(2 h / g), and the height of all apexes the same."""
    h, g = (2.0, 1.3), 0.7
    sim = hs.Simulation(bouncers(h, g), search=search)
    for k, height in enumerate(h):
        period = 2.0 * math.sqrt(2.0 * height / g)
        for bounces in (1, 2, 1000):
            alone = pickle.loads(pickle.dumps(sim))
            alone.run(time=bounces * period)
            assert alone.positions[k, 1] - alone.scene.radii[k] == pytest.approx(height, rel=1e-14 * bounces)
            assert abs(alone.velocities[k, 1]) < 1e-13 * bounces
            alone.run(time=period / 4)  # half way down in time, three quarters in height
            fallen = g * (period / 4) ** 2 / 2
            there = alone.positions[k, 1] - alone.scene.radii[k]
            assert there == pytest.approx(height - fallen, rel=1e-13 * bounces)
            alone.check()


def test_many_bounces_keep_the_energy_and_the_time():
    """After 7e4 bounces the energy is the same to two roundings, and the place to 1e-9 of the exact one."""
    h, g = (1.3, 2.0), 1.0
    sim = hs.Simulation(bouncers(h, g), search="windows")
    sim.run(time=123456.7)
    assert sim.wall_collisions > 5e4
    assert abs(sim.energy_drift) < 5e-16
    sim.check()
    # Sibling: by their rows alone, which epochs round, the bounces lose energy.
    assert alone_by_rows(0.3, h[1], g, 2.0, 10000) > 1e-13
    with mpmath.workdps(40):
        for k, (height, radius) in enumerate(zip(h, MIXTURE["radii"], strict=True)):
            drop = mpmath.mpf(0.5 + h[0] if k == 0 else 0.3 + h[1]) - mpmath.mpf(radius)
            half = mpmath.sqrt(2 * drop / mpmath.mpf(g))
            phase = mpmath.mpf(sim.time) % (2 * half)
            since_apex = min(phase, 2 * half - phase)
            there = drop - mpmath.mpf(g) * since_apex**2 / 2 + mpmath.mpf(radius)
            assert abs(sim.positions[k, 1] - float(there)) < 1e-9, height


def test_a_bounce_comes_back_with_the_same_bits():
    """The speed at the wall follows from the energy: a ball that leaves the floor returns with what it had."""
    rng = np.random.default_rng(1)
    for u, g in rng.uniform(1e-3, 1e3, (1000, 2)).tolist():
        assert math.sqrt(impact_square(-u, 0.0, g)) == u
        assert impact_time(-u, 0.0, g, u) == 2.0 * u / g
    # Sibling: the velocity after the time of flight is not always that.
    assert any(-u + g * (2.0 * u / g) != u for u, g in rng.uniform(1e-3, 1e3, (1000, 2)).tolist())


@pytest.mark.parametrize("pull, height", [(0.173, 27.02), (0.3, 10.1), (1.3, 7.7)])
def test_a_climb_to_the_lid_takes_the_same_energy_on_average(pull, height):
    """Over 2000 climbs the rounding has no sign: 5 standard errors (false alarms 2e-6); sibling: a plain root's has."""
    squares = 2.0 * pull * height * np.random.default_rng(3).uniform(1.1, 6.0, 2000)
    lost = 2 * Fraction(pull) * Fraction(height)

    def bias(speed):
        gains = [
            float(Fraction(speed(square)) ** 2 - (Fraction(square) - lost)) for square in squares.tolist()
        ]
        return abs(np.mean(gains)) / (np.std(gains) / math.sqrt(len(gains)))

    assert bias(lambda square: climbed_speed(square, height, pull)) < 5.0
    assert bias(lambda square: math.sqrt(impact_square(math.sqrt(square), height, -pull))) > 5.0
    assert climbed_speed(2.0 * pull * height * (1.0 - 1e-15), height, pull) == 0.0


def test_the_time_to_a_wall_is_exact():
    """Against 50 digits, relative to the time, where nothing is known less exactly than its arguments."""
    rng = np.random.default_rng(2)
    for _ in range(300):
        u, c, p = rng.normal(), rng.exponential() * 10.0 ** rng.uniform(-12, 3), 10.0 ** rng.uniform(-9, 6)
        square = impact_square(u, c, p)
        with mpmath.workdps(50):
            exact = (-mpmath.mpf(u) + mpmath.sqrt(mpmath.mpf(u) ** 2 + 2 * mpmath.mpf(p) * mpmath.mpf(c))) / p
        assert impact_time(u, c, p, math.sqrt(square)) == pytest.approx(float(exact), rel=1e-15)
        if u > 0.0:  # the second root of the textbook cancels; ours does not
            assert impact_time(u, c, 1e-30, u) == pytest.approx(c / u, rel=1e-15)
    assert impact_time(1.0, 0.5, -1.0, 0.0) == math.inf  # D = 0: it turns round right at the ceiling
    assert impact_time(1.0, 0.5 - 1e-16, -1.0, math.sqrt(impact_square(1.0, 0.5 - 1e-16, -1.0))) <= 1.0
    assert impact_time(1.0, 0.6, -1.0, 0.0) == math.inf
    assert impact_time(-1.0, 0.0, -1.0, 1.0) == math.inf
    assert impact_time(1.0, 0.0, 1.0, 1.0) == 0.0


def test_a_ball_thrown_just_to_the_ceiling():
    """A little too slow: it falls back. A little too fast: it is reflected there."""
    hits = []
    for factor in (1.0 - 1e-9, 1.0 + 1e-9):
        up = factor * math.sqrt(2.0 * 5.0)  # 5 is the way from floor to ceiling of the first disc
        scene = bouncers((0.0, 2.0), 1.0, ((0.0, up), (0.0, 0.0)))
        sim = hs.Simulation(scene)
        sim.run(time=up * 1.5)
        hits.append(float(sim.tallies.wall_impulses[1, 1]))
        assert sim.worst_overlap < 1e-15
        sim.check()
    assert hits[0] == 0.0
    # Twice the momentum at the ceiling, m sqrt(u^2 - 2 g H).
    assert hits[1] == pytest.approx(2 * 2.0 * math.sqrt((1 + 1e-9) ** 2 * 10.0 - 10.0), rel=1e-6)


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("g", [1e-3, 1.0, 5.0])
def test_two_meet_in_flight_when_they_would_without_gravity(g, search):
    positions, velocities = [[1.5, 4.5], [4.5, 4.7]], [[1.0, 0.3], [-1.0, 0.3]]
    still = hs.Scene(positions, velocities, box=(8, 6), boundary="wall", **MIXTURE)
    gap = math.sqrt(0.8**2 - 0.2**2)  # of the centres along x, when they touch
    sim = hs.Simulation(still.replace(gravity=(0.0, -g)), search=search)
    sim.run(collisions=1)
    assert sim.wall_collisions == 0
    t = sim.time
    assert t == pytest.approx((3.0 - gap) / 2.0, rel=1e-15)
    assert np.linalg.norm(sim.positions[0] - sim.positions[1]) == pytest.approx(0.8, rel=1e-15)
    assert sim.positions[0] == pytest.approx([1.5 + t, 4.5 + 0.3 * t - g * t * t / 2], rel=1e-14)
    # The collision itself is the one without gravity, seen from a frame that has fallen.
    without = ReferenceSimulation(still)
    without.step()
    assert np.allclose(sim.velocities, np.array(without.velocities) - [0.0, g * t], atol=1e-14)


@pytest.mark.parametrize("gravity", PULLS)
@pytest.mark.parametrize("eta", [0.02, 0.3])
def test_same_events_as_the_oracle(gravity, eta):
    needed = {0.02: 8, 0.3: 40}[eta]
    assert follow(falling(16, eta, gravity), needed) == needed


def test_against_fifty_digits():
    with mpmath.workdps(50):
        assert follow(falling(10, 0.2, (0.3, -2.0)), 15, mpmath.mpf, mpmath.sqrt) == 15


def test_the_comparison_sees_a_wrong_gravity(monkeypatch):
    """Sibling: an oracle whose gravity is off by a millionth is told apart."""
    begin = ReferenceSimulation.__init__

    def wrong(self, scene, *args, **options):
        begin(self, scene, *args, **options)
        self.gravity = [(1.0 + 1e-6) * pull for pull in self.gravity]

    monkeypatch.setattr(ReferenceSimulation, "__init__", wrong)
    assert follow(falling(16, 0.3), 40) < 5


@pytest.mark.parametrize("gravity", PULLS)
@pytest.mark.parametrize("eta", [0.02, 0.35])
def test_both_searches_give_the_same_bits_and_all_that_must_hold(gravity, eta):
    ends = []
    for search in SEARCHES:
        sim = hs.Simulation(falling(24, eta, gravity), search=search)
        for _ in range(5):
            sim.run(time=0.37)
            sim.check()  # every stored event is what the rows say, and none is missing
        sim.run(collisions=1500)
        sim.check()
        assert sim.status()["late_events"] == 0
        assert abs(sim.energy_drift) < 1e-14
        ends.append((state(sim), sim.positions.tobytes(), sim.velocities.tobytes()))
    assert ends[0] == ends[1]


def test_check_sees_what_gravity_makes_wrong():
    """Sibling: a contact stored for another gravity, or a row that has fallen too fast, does not pass."""
    for slot in range(2):
        sim = hs.Simulation(falling(24, 0.3), search="lists")
        sim.run(time=1.0)
        sim.check()
        at, arrays = sim._at, sim._engine.arrays
        if slot:
            arrays.row[at.V + 1] *= 1.01
        else:
            arrays.event_float[at.TIME] *= 1.0 + 1e-15
        with pytest.raises(hs.HardSpheresError):
            sim.check()


@pytest.mark.parametrize("search", SEARCHES)
def test_looking_saving_and_loading_change_no_bit(search, tmp_path):
    whole, pieces = (hs.Simulation(falling(), search=search) for _ in range(2))
    whole.run(time=7.0)
    for k in range(7):
        pieces.run(time=1.0)
        _ = pieces.positions, pieces.tallies, pieces.energy_drift, pieces.frame()
        if k % 2:
            pieces.save(tmp_path / "falling.npz")
            pieces = hs.Simulation.load(tmp_path / "falling.npz", search=search)
            assert pieces.scene.gravity.tolist() == [0.0, -1.0]
    assert everything(pieces) == everything(whole)


def test_a_checkpoint_of_another_gravity_is_refused(tmp_path):
    sim = hs.Simulation(falling())
    sim.run(time=2.0)
    arrays = sim._copied_arrays()
    hs.Simulation._from_arrays(arrays)
    with pytest.raises(hs.CheckpointError, match="its energy is .*, that of its scene"):
        hs.Simulation._from_arrays(arrays | {"gravity": np.array([0.0, -2.0])})


def test_gravity_goes_with_copies_and_states():
    scene = falling()
    for other in (pickle.loads(pickle.dumps(scene)), scene.replace(labels=np.arange(scene.n))):
        assert other.gravity.tolist() == [0.0, -1.0]
    sim = hs.Simulation(scene)
    sim.run(time=0.5)
    assert sim.to_scene().gravity.tolist() == [0.0, -1.0]
    assert "gravity 0 -1" in repr(scene)
    assert not scene.replace(gravity=None).falls
    assert not scene.replace(gravity=(0, 0)).falls


def test_no_gravity_is_no_gravity():
    """A scene with gravity zero is compiled without it, and has the bits of one that never heard of it."""
    scene = gas("2d_mixture_walls", 16, 0.1)
    one, other = hs.Simulation(scene), hs.Simulation(scene.replace(gravity=(0.0, 0.0)))
    assert other._engine.kernels is one._engine.kernels
    assert one._at.PULL == one._at.WEIGHT == one._at.PER_IMPULSE
    one.run(time=3.0)
    other.run(time=3.0)
    assert state(one) == state(other)
    assert other.scene.potential_energy == 0.0


def test_scaling_by_powers_of_two_gives_the_same_bits():
    scene = falling(16, 0.2, (0.7, -3.0))
    wide = hs.Scene(
        scene.positions * 4,
        scene.velocities * 8,
        scene.radii * 4,
        scene.masses,
        scene.box * 4,
        "wall",
        gravity=scene.gravity * 16,
    )  # lengths 4, times 1/2
    assert epoch_length(wide) == epoch_length(scene) / 2
    one, other = hs.Simulation(scene), hs.Simulation(wide)
    one.run(time=5.0)
    other.run(time=2.5)
    assert (one.positions * 4).tobytes() == other.positions.tobytes()
    assert (one.velocities * 8).tobytes() == other.velocities.tobytes()


@pytest.mark.parametrize("gravity", PULLS)
def test_walls_carry_the_weight(gravity):
    """Impulses on floor less lid: the weight times the time, less the change of momentum; to a rounding."""
    sim = hs.Simulation(falling(24, 0.1, gravity))
    sim.run(time=1.1)
    sim.reset_tallies()
    before = sim.momentum.copy()
    sim.run(time=31.7)
    lower, upper = sim.tallies.wall_impulses.T
    weight = sim.scene.masses.sum() * np.array(gravity) * 31.7
    assert np.allclose(
        upper - lower, weight - (sim.momentum - before), rtol=0, atol=1e-12 * np.abs(weight).max()
    )
    assert np.all(np.abs(sim.momentum_drift) < 1e-14)


def test_the_kinetic_tensor_is_the_integral_of_the_momentum_flux():
    """Against sums over 4000 moments: they miss an event by half a step, which is independent from one to the next."""
    sim = hs.Simulation(falling(16, 0.1, (0.7, -3.0)))
    sim.run(time=0.71)
    start = sim.frame()
    sim.reset_tallies()
    step, sums = 1e-3, np.zeros((2, 2))
    for _ in range(4000):
        sim.run(time=step / 2)
        v = sim.velocities
        sums += step * (v * sim.scene.masses[:, None]).T @ v
        sim.run(time=step / 2)
    kinetic = sim.tallies.kinetic
    assert np.allclose(kinetic, sums, atol=2e-3 * np.trace(sums))
    assert np.allclose(sim.frame().tallies.kinetic - start.tallies.kinetic, kinetic, rtol=1e-12)
    # Sibling: with the velocities that the last events left, which is exact without gravity, it is not even near.
    at, rows = sim._at, sim._engine.rows
    left = rows[:, at.V : at.V + 2]
    assert not np.allclose(
        4.0 * (left * sim.scene.masses[:, None]).T @ left, sums, atol=2e-3 * np.trace(sums)
    )


def test_a_ball_has_the_kinetic_tensor_of_its_parabola():
    """Over whole periods the mean of v^2 is a third of its largest value; exact."""
    scene = bouncers((2.0, 0.5), 1.0)
    sim = hs.Simulation(scene)
    sim.run(time=4.0 * 25)  # 25 periods of the first, 50 of the second
    mean = (2.0 * 4.0 + 0.25 * 1.0) / 3.0
    assert sim.tallies.kinetic[1, 1] / sim.time == pytest.approx(mean, rel=1e-13)
    assert sim.compressibility_factor == 1.0  # no pair has collided


def test_a_heavy_ball_on_light_ones_neither_sinks_nor_heats():
    """A disc of mass 100 let fall on light ones: all stay apart and in the box, the energy is kept to a rounding."""
    places = np.stack(np.meshgrid(np.arange(12) * 0.8 + 0.6, np.arange(3) * 0.7 + 0.4), -1).reshape(-1, 2)
    rng = np.random.default_rng(3)
    scene = hs.Scene(
        np.vstack([[5.0, 5.0], places]),
        np.vstack([[0.0, 0.0], rng.normal(size=places.shape) * 0.1]),
        radii=np.append(1.5, np.full(len(places), 0.3)),
        masses=np.append(100.0, np.ones(len(places))),
        box=(10.0, 12.0),
        boundary="wall",
        gravity=(0.0, -1.0),
    )
    sim = hs.Simulation(scene)
    lowest = math.inf
    for frame in sim.frames(every=0.5, count=60):
        lowest = min(lowest, frame.positions[0, 1] - 1.5)
        assert sim.worst_overlap < 1e-13
        assert abs(sim.energy_drift) < 1e-13
    sim.check()
    assert sim.collisions > 1000
    assert lowest > 0.0  # never on the floor itself: light ones hold it up


def test_a_column_of_balls():
    """Let fall touching one another, in a shaft too narrow to pass: their order and their energy stay."""
    radii = np.array([0.5, 0.3, 0.5, 0.3, 0.5, 0.3])
    edges = np.cumsum(2.0 * radii)
    scene = hs.Scene(
        np.column_stack([np.full(6, 0.55), 1.0 + edges - radii]),
        np.zeros((6, 2)),
        radii=radii,
        masses=[2.0, 0.25, 1.0, 0.5, 3.0, 0.1],
        box=(1.1, 12.0),
        boundary="wall",
        gravity=(0.0, -1.0),
    )
    sim = hs.Simulation(scene)
    for frame in sim.frames(every=1.0, count=40):
        assert np.all(np.diff(frame.positions[:, 1]) > 0.0)
        assert np.all(frame.positions[:, 0] == 0.55)
        assert abs(sim.energy_drift) < 1e-13
    sim.check()
    assert sim.collisions > 100


def test_what_comes_to_rest_is_told():
    """Two touching balls of masses 3:1 dropped: the lower one stops dead on the floor (Galilean cannon)."""
    scene = hs.Scene(
        [[1.0, 1.5], [1.0, 2.3]], np.zeros((2, 2)), radii=MIXTURE["radii"], masses=[3.0, 1.0],
        box=(2.0, 9.0), boundary="wall", gravity=(0.0, -1.0),
    )  # fmt: skip
    sim = hs.Simulation(scene)
    with pytest.raises(
        hs.SimulationError, match="particle 0 has come to rest on a wall that gravity pulls it to"
    ):
        sim.run(time=10.0)
    # Sibling: at another ratio it goes on.
    sim = hs.Simulation(scene.replace(masses=[3.1, 1.0]))
    sim.run(time=10.0)
    sim.check()


def test_a_gas_let_fall_from_rest_moves():
    """No particle moves at first: epochs, windows and patience go by what gravity will make of it."""
    scene = falling(24, 0.1)
    still = scene.replace(velocities=np.zeros((24, 2)))
    for search in SEARCHES:
        sim = hs.Simulation(still, search=search)
        sim.run(collisions=500)
        sim.check()
    assert sim.temperature > 0.0


def test_gravity_between_periodic_sides_of_a_mixture_of_sizes():
    """A few large discs among small ones have a grid of their own; it falls with the rest."""
    ends = []
    for search in SEARCHES:
        scene = one_to_ten("2d_mixture_walls", n=300, large=3, packing_fraction=0.05).replace(
            gravity=(0.0, -0.05)
        )
        sim = hs.Simulation(scene, search=search)
        sim.run(time=3.0)
        sim.check()
        ends.append((state(sim), sim._engine.search.method))
    assert ends[0][0] == ends[1][0]
    assert "two grids" in ends[1][1]


@pytest.mark.parametrize(
    ("gravity", "sentence"),
    [
        (
            (0.0, 0.0, -1.0),
            "gravity has shape (3,), but the positions are 2-dimensional; give an acceleration of 2",
        ),
        (
            -9.81,
            "gravity has shape (), but the positions are 2-dimensional; give an acceleration of 2 components",
        ),
        ((0.0, math.nan), "gravity along y is nan; it must be finite"),
        ((math.inf, 0.0), "gravity along x is inf; it must be finite"),
        (("0", "-1"), "gravity's components hold text; they must be real numbers"),
        ((0.0, 1e307), "leaves the range of double precision"),
    ],
)
def test_bad_gravity(gravity, sentence):
    with pytest.raises(hs.SceneError) as refusal:
        gas("2d_mixture_walls", 4, 0.1).replace(gravity=gravity)
    assert sentence in str(refusal.value)


def test_gravity_round_a_periodic_axis_is_refused():
    with pytest.raises(hs.SceneError, match="gravity along x is -1.0, but that axis is periodic"):
        gas("3d_walls", 4, 0.01).replace(gravity=(-1.0, 0.0, 0.0))


@pytest.mark.parametrize("gravity", [(0.0, -2.0), (2.0, 0.0)])
def test_a_ball_at_rest_on_the_floor_is_refused(gravity):
    """Sibling: a little above the floor, on the wall opposite, or on its way up, it is not."""
    lying = {"box": (4.0, 4.0), "boundary": "wall", "gravity": gravity, "radii": 0.5}
    floor, ceiling = ([2.0, 0.5], [2.0, 3.5]) if gravity[1] else ([3.5, 2.0], [0.5, 2.0])
    with pytest.raises(hs.SceneError, match="particle 0 rests on the wall that gravity pulls it to along"):
        hs.Scene([floor], [[0.0, 0.0]], **lying)
    hs.Scene([ceiling], [[0.0, 0.0]], **lying)
    hs.Scene([floor], [-np.array(gravity) * 1e-6], **lying)
    hs.Scene([np.array(floor) - np.array(gravity) * 1e-6], [[0.0, 0.0]], **lying)


def test_free_paths_are_refused_and_the_log_has_none():
    with pytest.raises(hs.SimulationError, match="under gravity none is straight"):
        hs.Simulation(falling(), free_paths=True)


def test_the_kind_of_scene_says_gravity():
    assert (
        specialise(2, True, True, True, True, gravity=True).at.PULL
        < specialise(2, True, True, True, True, gravity=True).at.NUMBERS
    )


def heights_and_share(n, samples):
    """Heights m g z / E, and the kinetic share of the energy E, of tiny discs at moments 20 apart."""
    rng = np.random.default_rng(4)
    radii = 0.01 * rng.uniform(0.99, 1.01, n)
    masses = np.full(n, 1.0)
    masses[0] += 1e-9  # the kind of scene that the other tests compile
    positions = np.column_stack([(np.arange(n) + 0.5) / n, rng.uniform(0.1, 2.0, n)])
    velocities = rng.normal(size=(n, 2))
    scene = hs.Scene(positions, velocities, radii, masses, (1.0, 40.0), "wall", gravity=(0.0, -1.0))
    sim = hs.Simulation(scene)
    energy = scene.kinetic_energy + scene.potential_energy
    z, share = [], []
    for frame in sim.frames(times=1000.0 + 20.0 * np.arange(samples)):
        z.append((frame.positions[:, 1] - radii) / energy)
        share.append(0.5 * np.sum(masses * np.sum(frame.velocities**2, axis=1)) / energy)
    assert np.max(z) < 1.0
    return np.array(z), np.array(share)


def test_the_barometric_law_of_a_few_particles():
    """At fixed energy m g z / E of one of N points has the distribution Beta(1, N - 1 + f/2), f = d N; exact.

    So the kinetic share is f/2 / (N + f/2). Standard errors from 20 blocks; false alarm 3e-4 each. Discs of a
    hundredth of the width change the means by less than half a per cent.
    """
    n, f = 5, 10
    z, share = heights_and_share(n, 2000)
    a, b = 1.0, n - 1 + f / 2
    mean, square = a / (a + b), a * (a + 1.0) / ((a + b) * (a + b + 1.0))
    for measured, exact in ((z, mean), (z * z, square), (share[:, None], (f / 2) / (n + f / 2))):
        blocks = measured.mean(axis=1).reshape(20, -1).mean(axis=1)
        error = blocks.std(ddof=1) / math.sqrt(20)
        assert error < 0.03 * exact
        assert abs(blocks.mean() - exact) < 4.5 * error + 0.005 * exact
    # Sibling: the barometric law of many, exp(-mgz/kT), has another mean square.
    assert abs(2.0 * mean**2 - square) > 0.1 * square


@pytest.mark.parametrize(
    "search", [pytest.param("lists", marks=pytest.mark.long), pytest.param("windows", marks=pytest.mark.slow)]
)
def test_energy_over_ten_million_events(search):
    """A random walk of roundings: below ten of them times the root of the events, over N. Both searches give the same bits."""
    n = 100
    scene = gas("3d_walls", n, 0.1, seed=3).replace(gravity=(0.0, -0.5, 0.0))
    sim = hs.Simulation(scene, search=search)
    for _ in range(5):
        sim.run(collisions=1_500_000)
        events = sim.collisions + sim.wall_collisions
        assert abs(sim.energy_drift) < 10 * np.finfo(float).eps * math.sqrt(events) / n
        sim.check()
    assert events > 1e7 * 0.75
    assert sim.status()["late_events"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["3d_walls", "3d_all_walls"])
def test_spheres_with_both_searches_and_the_oracle(kind):
    scene = hs.random_gas(
        n=20,
        packing_fraction=0.1,
        seed=5,
        boundary="wall" if "all" in kind else ("periodic", "wall", "periodic"),
    ).replace(gravity=(0.4, -2.0, -1.0) if "all" in kind else (0.0, -2.0, 0.0))
    assert follow(scene, 40) == 40
    ends = []
    for search in SEARCHES:
        sim = hs.Simulation(scene, search=search)
        for _ in range(20):
            sim.run(time=0.3)
            sim.check()
        ends.append(state(sim))
    assert ends[0] == ends[1]


@pytest.mark.slow
def test_the_log_has_every_event_and_no_paths():
    events = []
    scene = gas("2d_mixture_walls", 16, 0.1).replace(gravity=(0.0, -1.0))
    sim, plain = hs.Simulation(scene, log=events.append), hs.Simulation(scene)
    sim.run(time=10.0)
    plain.run(time=10.0)
    logged = np.concatenate(events)
    assert len(logged) == sim.collisions + sim.wall_collisions
    assert np.isnan(logged["free_path"]).all()
    assert sim.positions.tobytes() == plain.positions.tobytes()
    # Impulses add up to the change of momentum that gravity does not explain.
    up = np.sum(np.where(logged["j"] >= 16, logged["impulse"], 0.0) * logged["normal"][:, 1])
    weight = scene.masses.sum() * 10.0
    assert up == pytest.approx(weight + (sim.momentum - scene.momentum)[1], rel=1e-12)
    with pytest.raises(hs.SimulationError, match="under gravity none is straight"):
        _ = sim.free_paths
    assert sim.frame().free_paths is None


@pytest.mark.parametrize("suffix", [".xyz", ".traj"])
def test_files_hold_the_particles_and_not_gravity(suffix, tmp_path):
    sim = hs.Simulation(falling())
    with hs.TrajectoryWriter(tmp_path / f"falling{suffix}") as trajectory:
        for frame in sim.frames(every=0.3, count=3):
            trajectory.write(frame)
    *_, last = hs.read_trajectory(tmp_path / f"falling{suffix}")
    assert np.allclose(last.positions, sim.positions, rtol=0, atol=1e-14)
    assert np.allclose(last.velocities, sim.velocities, rtol=1e-14)
    assert not last.falls
    again = hs.Simulation(last.replace(gravity=sim.scene.gravity))
    again.run(time=0.5)
    sim.run(time=0.5)
    assert np.allclose(again.positions, sim.positions, rtol=0, atol=1e-9)


def test_two_that_never_meet_are_given_up():
    """Each bounces in a column of its own."""
    with pytest.raises(hs.SimulationError, match="these particles may never meet"):
        hs.Simulation(bouncers((2.0, 1.3), 0.7)).run(collisions=1)
