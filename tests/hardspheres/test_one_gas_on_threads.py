"""One gas on several threads has the bits of one: rows, clock, counts, tallies, free paths and log.

Threads are more than there are cores here, and domains are more than threads, which changes when each of them
comes to what; nothing of that may be seen.
"""

import threading
import warnings

import numpy as np
import pytest
from scenes import everything, gas, one_to_ten

import hardspheres as hs
from hardspheres import domains, engine, lists, windows
from hardspheres.domains import Domains
from hardspheres.tuning import epoch_length

LAYOUTS = [(2, None), (1, (2, 1)), (2, (2, 2)), (3, (1, 2))]


@pytest.fixture(autouse=True)
def _cores(monkeypatch):
    """Take any number of threads."""
    monkeypatch.setattr(engine, "idle_cores", lambda: 99)


def shared(monkeypatch, scene, threads, across=None, search="lists", **options):
    """A simulation by so many threads, with so many domains along both axes, or as many as threads."""
    if across is not None:
        for each in (lists, windows):
            monkeypatch.setattr(each, "divided", lambda cells, _: Domains(cells, threads, across))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that one thread has several domains
        sim = hs.Simulation(scene, threads=max(threads, 2), search=search, **options)
    for each in (lists, windows):
        monkeypatch.setattr(each, "divided", domains.divided)
    assert sim.threads == threads
    assert sim._engine.search.domains is not None
    return sim


def redone(sim):
    """How many windows were undone."""
    return int(sim._engine.arrays.counter[sim._at.REDONE])


def lattice(counts, spacing):
    """Places of a square or cubic lattice, and its box."""
    sites = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, len(counts))
    return (sites + 0.5) * spacing, np.array(counts) * spacing


def ties(dim=3, n_axis=19, spacing=1.25, seed=4):
    """A lattice whose particles all have one speed, each along an axis: their collisions come all at once."""
    rng = np.random.default_rng(seed)
    places, box = lattice([n_axis] * dim, spacing)
    n = len(places)
    velocities = np.zeros((n, dim))
    velocities[np.arange(n), rng.integers(dim, size=n)] = rng.choice([-1.0, 1.0], size=n)
    return hs.Scene(positions=places, velocities=velocities, radii=0.5, box=box)


def on_a_lattice(counts, spacing, seed):
    """Particles of diameter 1 on a lattice, with velocities at random."""
    places, box = lattice(counts, spacing)
    velocities = np.random.default_rng(seed).normal(size=places.shape)
    return hs.Scene(positions=places, velocities=velocities, radii=0.5, box=box)


def seeing_and_blind(monkeypatch, scene, across, collisions, search):
    """Whether bits are those of one thread, and how many windows were undone; then the same for blind threads.

    All events of a bucket are executed before threads agree, so that some come in a wrong order.
    """
    one = hs.Simulation(scene, search=search)
    one.run(collisions=collisions)
    for blind in (0, 1):
        many = shared(monkeypatch, scene, 2, across, search)
        at, counter = many._at, many._engine.arrays.counter
        counter[at.BLIND] = blind
        counter[at.WINDOW_TICKS] = counter[at.BUCKET_TICKS]
        many.run(collisions=collisions)
        yield everything(many) == everything(one), redone(many)


def in_parts(sim, collisions):
    """Run in uneven parts, to times and to numbers of collisions."""
    sim.run(collisions=collisions // 3)
    sim.run(time=0.37 * sim.time)
    sim.run(collisions=7)
    sim.run(collisions=collisions // 3)
    sim.run(time=0.0)
    sim.run(time=0.11 * sim.time)


@pytest.mark.parametrize(("threads", "across"), LAYOUTS)
def test_any_layout_gives_the_bits_of_one_thread(monkeypatch, threads, across):
    """In uneven parts, over some epochs."""
    scene = gas("3d", 6000, 0.3)
    one = hs.Simulation(scene, search="lists")
    many = shared(monkeypatch, scene, threads, across)
    for sim in (one, many):
        in_parts(sim, 9000)
    assert everything(many) == everything(one)
    for sim in (one, many):
        sim.run(collisions=6000)
    assert everything(many) == everything(one)


def tube(spacing=2.2):
    """5184 spheres in a long box, at a packing fraction of 0.05: wide enough for five domains of windows."""
    return on_a_lattice([64, 9, 9], spacing, seed=1)


@pytest.mark.parametrize(("threads", "across"), [(2, None), (1, (2, 1)), (3, (5, 1))])
def test_windows_have_the_bits_of_one_thread(monkeypatch, threads, across):
    """The same for a dilute gas; all contacts are what the rows say, none is missing."""
    one = hs.Simulation(tube(), search="windows")
    many = shared(monkeypatch, tube(), threads, across, search="windows")
    for sim in (one, many):
        in_parts(sim, 9000)
        sim.check()
    assert everything(many) == everything(one)
    assert many.status()["thread_events_put_off"] > 0


def test_windows_for_other_epochs_have_domains_too(monkeypatch):
    """One at least, where cells have become too wide for more; with the bits of one thread."""
    one, many = (
        hs.Simulation(tube(), search="windows"),
        shared(monkeypatch, tube(), 2, search="windows"),
    )
    across = []
    for power in (-3, 3, 2):
        if power == 2:
            monkeypatch.setattr(windows, "divided", lambda cells, threads: None)
        for sim in (one, many):
            sim._engine = sim._engine.with_epochs(sim._engine.length * 2.0**power)
            sim.run(time=sim._engine.length)  # to the end of an epoch
        across.append(many._engine.search.domains.across)
        assert everything(many) == everything(one)
    assert across == [(2, 1), (2, 1), (1, 1)]


def test_windows_with_little_room_make_more(monkeypatch):
    """Whatever runs out, in the middle of a round or not: the same bits."""
    one, many = hs.Simulation(tube(), search="windows"), shared(monkeypatch, tube(), 2, search="windows")
    at, engine = many._at, many._engine
    small = {at.HEAP_ROOM: 64, at.SEGMENT_ROOM: 100, at.CONTACT_ROOM: 8, at.OVERFLOW_ROOM: 16}
    small |= {at.NEAR_ROOM: 1, at.BLOCKS: 16, at.UNDO_ROOM: 40}
    for slot, room in small.items():
        engine.arrays.counter[slot] = room
    engine.arrays = engine.arrays._replace(**engine._searching_arrays(engine.arrays.counter))
    for sim in (one, many):
        sim.run(collisions=2000)
    assert everything(many) == everything(one)
    assert all(engine.arrays.counter[slot] > room for slot, room in small.items() if slot != at.UNDO_ROOM)
    assert redone(many) > 0  # of what can be undone there was too little


def test_what_went_wrong_in_windows_is_seen_and_undone(monkeypatch):
    """As with lists, where all events of a window of time are executed before threads agree."""
    seeing, blind = seeing_and_blind(monkeypatch, tube(spacing=1.8), (4, 1), 9000, "windows")
    assert seeing[0]
    assert seeing[1] > 0
    assert not blind[0]


def column():
    """500 spheres in a box four times as long as wide: few enough to check all events, lists name images."""
    return on_a_lattice([5, 20, 5], 1.25, seed=2)


def test_every_event_is_what_the_rows_say_and_in_the_calendar_of_its_tile(monkeypatch):
    """As `check` says; an event in another tile's calendar is not where the engine looks for it."""
    one, many = hs.Simulation(column(), search="lists"), shared(monkeypatch, column(), 2, (1, 2))
    for sim in (one, many):
        sim.run(collisions=3000)
        sim.check()
    assert everything(many) == everything(one)
    at, arrays = many._at, many._engine.arrays
    soon = np.argmin(arrays.event_float[at.TIME :: at.EVENT])
    arrays.event[soon * at.EVENT + at.TILE_WORD] ^= 1 << 8
    with pytest.raises(hs.InvariantError, match="is not in the calendar"):
        many.check()


def test_ties_come_in_the_order_of_one_thread(monkeypatch):
    """Thousands of collisions at the same moments, many of them of three spheres at once."""
    scene = ties()
    one, many = hs.Simulation(scene, search="lists"), shared(monkeypatch, scene, 2, (2, 2))
    for sim in (one, many):
        sim.run(collisions=4000)
    assert everything(many) == everything(one)


def test_what_went_wrong_is_seen_and_undone(monkeypatch):
    """In windows that are much too long some events come in a wrong order; blind to that, bits differ."""
    monkeypatch.setattr(domains, "COLLISIONS_IN_BUCKET", 0.2)
    scene = hs.lattice_gas(n=6912, packing_fraction=0.3, seed=1)
    seeing, blind = seeing_and_blind(monkeypatch, scene, (2, 2), 20000, "lists")
    assert seeing[0]
    assert seeing[1] > 0
    assert not blind[0]


def test_an_interrupt_loses_nothing(monkeypatch):
    """Ctrl-C in every slice: what had been executed counts, and the run goes on with the bits of one thread."""
    scene = gas("3d", 6000, 0.3)
    one, many = hs.Simulation(scene, search="lists"), shared(monkeypatch, scene, 2)
    one.run(collisions=15_000)
    join, seen = threading.Thread.join, set()

    def interrupted(thread, timeout=None):
        if threading.current_thread() is threading.main_thread() and thread not in seen:
            seen.add(thread)
            raise KeyboardInterrupt
        join(thread, timeout)

    monkeypatch.setattr(threading.Thread, "join", interrupted)
    many._slices.budget = 1500
    while many.collisions < 15_000:
        try:
            many.run(collisions=15_000 - many.collisions)
        except KeyboardInterrupt:
            many._slices.budget = 1500
    assert len(seen) > 5
    assert everything(many) == everything(one)


def test_a_gas_that_threads_cannot_share_says_why():
    """In a sentence, and runs on one."""
    small = gas("3d", 200, 0.3)
    with pytest.warns(UserWarning, match="threads=2: this gas of 200 particles runs on 1 thread, as each"):
        assert hs.Simulation(small, threads=2).threads == 1
    uneven = one_to_ten("3d_mixture", packing_fraction=0.05)
    with pytest.warns(UserWarning, match="its large particles, among many small ones, are in a grid of"):
        assert hs.Simulation(uneven, threads=2).threads == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert hs.Simulation(small).threads == 1


def test_no_more_threads_than_idle_cores(monkeypatch):
    """A busy machine has fewer."""
    monkeypatch.setattr(engine, "idle_cores", lambda: 1)
    with pytest.warns(
        UserWarning, match="runs on 1 thread, as 1 of the .* cores that this process may use is"
    ):
        assert hs.Simulation(gas("3d", 6000, 0.3), threads=4).threads == 1


@pytest.mark.parametrize("threads", [0, -1, 1.5, "two"])
def test_an_impossible_number_of_threads_is_refused(threads):
    """One clear sentence."""
    with pytest.raises(hs.SimulationError, match="threads"):
        hs.Simulation(gas("3d", 20, 0.1), threads=threads)


def discs():
    """A lattice of discs, wide enough for 5 x 5 domains."""
    return on_a_lattice([64, 64], 1.3, seed=3)


def falling():
    """Spheres that fall on a floor."""
    return hs.random_gas(
        n=9000, packing_fraction=0.28, boundary=("periodic", "periodic", "wall"), seed=5
    ).replace(gravity=(0.0, 0.0, -0.02))


def among_obstacles(scene):
    """One particle in ten is an obstacle."""
    masses = np.where(np.arange(scene.n) % 10 == 0, np.inf, 1.0)
    velocities = np.where(np.isinf(masses)[:, None], 0.0, scene.velocities)
    return scene.replace(masses=masses, velocities=velocities)


def falling_among_obstacles():
    """Discs on a floor, one in ten of them an obstacle."""
    still = hs.random_gas(n=6000, dim=2, packing_fraction=0.4, seed=3, boundary=("periodic", "wall"))
    return among_obstacles(still).replace(**FALLS)


def dilute_discs(**more):
    """Wide enough for three domains of windows side by side."""
    return hs.random_gas(n=4000, dim=2, packing_fraction=0.1, seed=3, **more)


FALLS = {"gravity": (0.0, -0.2)}
FLIGHTS = {"free_paths": True}
SCENES = {
    "discs": ("lists", discs, {}),
    "mixture between walls": ("lists", lambda: gas("2d_mixture_walls", 4000, 0.4), FLIGHTS),
    "heat": ("lists", lambda: gas("3d", 6000, 0.3), {"heat": True, "free_paths": True}),
    "gravity": ("lists", falling, {}),
    "obstacles": ("lists", lambda: among_obstacles(discs()), {}),
    "gravity and obstacles": ("lists", falling_among_obstacles, {}),
    "dilute spheres": ("windows", lambda: gas("3d", 40_000, 0.1), FLIGHTS),
    "dilute mixture between walls": ("windows", lambda: gas("2d_mixture_walls", 4000, 0.1), FLIGHTS),
    "dilute, heat": ("windows", dilute_discs, {"heat": True}),
    "dilute, gravity": (
        "windows",
        lambda: dilute_discs(boundary=("periodic", "wall")).replace(**FALLS),
        {},
    ),
    "dilute, obstacles": ("windows", lambda: among_obstacles(dilute_discs()), {}),
    "dilute, ties": ("windows", lambda: ties(2, 64, 3.0, seed=1), {}),
}


def layouts_of(scene, search):
    """Numbers of threads, and of domains along both axes, up to as many as there is room for."""
    if search == "lists":
        most = min(lists.Lists(scene).cells[:2]) // 6
        return [(2, (1, 2)), (3, (2, 2)), (4, (most, 1)), (9, (most, most))]
    cells = windows.windows_for(scene, epoch_length(scene), search).cells
    most = int(cells[0]) // 6
    return [(2, (2, 2)), (9, (1, 2))] if scene.dim == 3 else [(2, (2, 1)), (3, (most, 1)), (9, (most, 1))]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_any_scene_has_the_bits_of_one_thread(monkeypatch, tmp_path, name):
    """Up to 9 threads and 25 domains; with a log where flights are tallied; saved and loaded on the way."""
    search, make, options = SCENES[name]
    # Too long: some windows are undone.
    monkeypatch.setattr(domains, "COLLISIONS_IN_BUCKET", 0.8 if search == "lists" else 4.0)
    scene = make()
    undone = 0
    layouts = layouts_of(scene, search)
    logs = [[] for _ in range(len(layouts) + 1)]
    sink = [{"log": chunks.append} if "free_paths" in options else {} for chunks in logs]
    one = hs.Simulation(scene, search=search, **options, **sink[0])
    in_parts(one, 9000)
    for (threads, across), logged, into in zip(layouts, logs[1:], sink[1:], strict=True):
        many = shared(monkeypatch, scene, threads, across, search, **options, **into)
        in_parts(many, 9000)
        assert everything(many) == everything(one)
        if into:
            assert np.concatenate(logged).tobytes() == np.concatenate(logs[0]).tobytes()
        many.save(tmp_path / "state.npz")
        again = hs.Simulation.load(tmp_path / "state.npz", search=search, threads=threads)
        straight = hs.Simulation.load(tmp_path / "state.npz", search=search)
        for sim in (again, straight, many):
            sim.run(collisions=2000)
        assert everything(again) == everything(straight)
        assert many.positions.tobytes() == straight.positions.tobytes()
        undone += redone(many)
    assert undone > 0


@pytest.mark.slow
def test_a_lattice_that_has_not_melted_has_the_bits_of_one_thread(monkeypatch):
    """At 0.49 its lists hardly ever expire, and all cells are alike."""
    scene = hs.lattice_gas(n=13500, packing_fraction=0.49, seed=2)
    one = hs.Simulation(scene, search="lists")
    one.run(collisions=200_000)
    for threads, across in ((2, (2, 1)), (4, (2, 2))):
        many = shared(monkeypatch, scene, threads, across)
        many.run(collisions=200_000)
        assert everything(many) == everything(one)
