"""`Simulation.check` after every kind of operation, and what it must see; room that grows; counters that do not end."""

import numpy as np
import pytest
from scenes import KINDS, SEARCHES, everything, gas, state

import hardspheres as hs
from hardspheres import lists
from hardspheres.engine import Engine


@pytest.fixture(params=SEARCHES)
def search(request):
    return request.param


def running(search, kind="3d_walls", n=200, collisions=500):
    sim = hs.Simulation(gas(kind, n, 0.1, seed=5), search=search)
    sim.run(collisions=collisions)
    return sim


@pytest.mark.parametrize("kind", KINDS)
def test_check_holds_after_every_operation_and_changes_nothing(kind, search, tmp_path):
    scene = gas(kind, 200, 0.1, seed=5)
    sim, unwatched = (hs.Simulation(scene, search=search) for _ in range(2))
    sim.check()
    for step in ({"collisions": 300}, {"time": 0.37}, {"collisions": 1}, {"time": 0.0}, {"time": 9.1}):
        sim.run(**step)
        unwatched.run(**step)
        before = everything(sim), sim._engine.state()
        sim.check()
        assert everything(sim) == before[0]
        assert not sim._engine._afresh
    for frame in sim.frames(every=0.21, count=5):
        assert frame.scene is scene
        sim.check()
    for _ in unwatched.frames(every=0.21, count=5):
        pass
    for each in (sim, unwatched):
        each.reset_tallies()
    sim.check()
    sim.save(tmp_path / "checkpoint")
    sim.check()
    loaded = hs.Simulation.load(tmp_path / "checkpoint", search=search)
    loaded.check()
    for each in (sim, loaded, unwatched):
        each.run(collisions=100)
        each.check()
    assert everything(sim) == everything(loaded) == everything(unwatched)
    hs.Simulation(sim.to_scene(), search=search).check()


@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("goal", [{"collisions": 4000}, {"time": 20.0}])
def test_an_interrupted_run_goes_on(goal, when, search, monkeypatch):
    """Ctrl-C just before or just after any call of the kernels: sound at once, and the same bits in the end."""
    whole = running(search)
    calls, run = [], Engine.run

    def interrupted(engine, *arguments):
        calls.append(1)
        if len(calls) % 2:
            if when == "after":
                run(engine, *arguments)
            raise KeyboardInterrupt
        return run(engine, *arguments)

    sim = running(search)
    monkeypatch.setattr(Engine, "run", interrupted)
    for each in (sim, whole):
        each._slices.budget = 3000
        if each is whole:
            monkeypatch.undo()
        end = each.collisions + goal["collisions"] if "collisions" in goal else each.time + goal["time"]
        while True:
            try:
                if "collisions" in goal:
                    each.run(collisions=end - each.collisions)
                else:
                    for _ in each.frames(times=[end]):
                        pass
                break
            except KeyboardInterrupt:
                each.check()
    assert len(calls) > 2
    assert everything(sim) == everything(whole)


def test_a_second_interrupt_before_the_clock_is_set(monkeypatch):
    """Even if not one line of cleaning up is run, the next run sets the clock right."""
    sim, whole = running("auto"), running("auto")
    run, keep = Engine.run, Engine.keep_clock

    def interrupted(engine, *arguments):
        run(engine, *arguments)
        raise KeyboardInterrupt

    monkeypatch.setattr(Engine, "run", interrupted)
    monkeypatch.setattr(Engine, "keep_clock", lambda engine: None)
    with pytest.raises(KeyboardInterrupt):
        sim.run(time=7.0)
    monkeypatch.setattr(Engine, "run", run)
    monkeypatch.setattr(Engine, "keep_clock", keep)
    sim.run(collisions=0)
    whole.run(time=7.0)
    goal = max(sim.collisions, whole.collisions) + 100
    for each in (sim, whole):
        each.run(collisions=goal - each.collisions)
        each.check()
    assert state(sim) == state(whole)


# Siblings: what check must see.


def after(sim):
    """First particle whose next event is a contact that counts."""
    at, a = sim._at, sim._engine.arrays
    events = a.event[: sim.scene.n * at.EVENT].reshape(-1, at.EVENT)
    partner = events[:, at.PARTNER]
    known = np.clip(partner, 0, sim.scene.n - 1)
    counts = (partner >= 0) & (partner < sim.scene.n) & (a.version[known] == events[:, at.PARTNER_VERSION])
    return int(np.flatnonzero(counts)[0])


def corrupt_list(sim, at, a):
    a.neighbours[a.neighbours == a.neighbours[0]] = sim.scene.n


def list_beyond_the_last(sim, at, a):
    a.neighbours[3] = sim.scene.n + 1


def event_one_rounding_late(sim, at, a):
    k = after(sim) * at.EVENT + at.TIME
    a.event_float[k] = np.nextafter(a.event_float[k], np.inf)


def event_with_somebody_else(sim, at, a):
    event = after(sim) * at.EVENT
    other = (a.event[event + at.PARTNER] + 1) % sim.scene.n
    a.event[event + at.PARTNER] = other
    a.event[event + at.PARTNER_VERSION] = a.version[other]


def event_forgotten(sim, at, a):
    i = after(sim)
    j = a.event[i * at.EVENT + at.PARTNER]
    for k in (i, j):
        a.event_float[k * at.EVENT + at.TIME] = np.inf
        a.event[k * at.EVENT + at.PARTNER] = at.NOTHING


def event_not_in_the_calendar(sim, at, a):
    a.event[after(sim) * at.EVENT + at.STAMP] += 1


def walls_forgotten(sim, at, a):
    events = a.event[: sim.scene.n * at.EVENT].reshape(-1, at.EVENT)
    i = int(np.flatnonzero(events[:, at.PARTNER] >= sim.scene.n)[0])
    a.event_float[i * at.EVENT + at.TIME] = np.inf


def centre_astray(sim, at, a):
    far = 2.5 * a.number[at.DISPLACEMENT_THRESHOLD]  # now it is beyond its threshold
    a.event_float[7 * at.EVENT + at.REFERENCE] += far


def pending(sim, at, a):
    count = a.counter
    size = int(count[at.WINDOW_BUCKETS])
    return [slot for slot in range((int(count[at.BUCKET]) & (size - 1)) + 1, size) if a.buckets[slot] >= 0]


def contacts_forgotten(sim, at, a):
    a.buckets[:] = -1
    a.counter[at.HEAP_LENGTH] = 0


def contact_one_rounding_late(sim, at, a):
    when = a.contacts[: int(a.counter[at.CONTACTS]) * at.CONTACT : at.CONTACT].view(np.float64)
    when[:] = np.nextafter(when, np.inf)


def rows_nudged(sim, at, a):
    sim._engine.rows[:, 0] += 1e-13 * np.arange(sim.scene.n)


def clock_behind(sim, at, a):
    epoch, moment = sim._engine.now
    sim._engine.now = epoch, moment - 1.0


def row_ahead(sim, at, a):
    a.row[5 * at.ROW + at.T] = a.number[at.NOW] + 0.1


def row_nan(sim, at, a):
    a.row[5 * at.ROW] = np.nan


def counter_negative(sim, at, a):
    a.counter[at.STALE] = -1


@pytest.mark.parametrize(
    ("search", "harm", "sentence"),
    [
        ("lists", corrupt_list, "but not in its neighbour list"),
        ("lists", list_beyond_the_last, "names a particle that does not exist"),
        ("lists", event_one_rounding_late, "rows say otherwise"),
        ("lists", event_with_somebody_else, "rows say otherwise"),
        ("lists", event_forgotten, "but neither has an event"),
        ("lists", event_not_in_the_calendar, "not in the calendar"),
        ("lists", walls_forgotten, "rows say otherwise"),
        ("lists", centre_astray, "not in its neighbour list|exceeds the displacement threshold"),
        ("windows", contacts_forgotten, "within this window, but that contact is not stored"),
        ("windows", contact_one_rounding_late, "rows say otherwise"),
        ("lists", rows_nudged, "rows say otherwise|neither has an event"),
        ("windows", rows_nudged, "rows say otherwise|not stored"),
        ("windows", clock_behind, "lies after the simulation's time"),
        ("windows", row_ahead, "row 5 is of time"),
        ("windows", row_nan, "not finite"),
        ("windows", counter_negative, "counter STALE is -1"),
    ],
)
def test_check_sees(search, harm, sentence):
    sim = running(search)
    sim.check()
    harm(sim, sim._at, sim._engine.arrays)
    with pytest.raises(hs.InvariantError, match=sentence):
        sim.check()


def test_lists_are_checked_at_any_size():
    sim = running("lists", "3d", 3000, 100)
    sim.check()
    corrupt_list(sim, sim._at, sim._engine.arrays)
    with pytest.raises(hs.InvariantError, match="neighbour list"):
        sim.check()


def test_a_box_of_a_hundred_million_diameters():
    """Contacts are as exact as coordinates there; the check knows how exact that is."""
    x = [[1e8, 5.0, 5.0], [1e8 + 3.3, 5.0, 5.0]]
    sim = hs.Simulation(hs.Scene(x, [[0.1, 0, 0], [-0.1, 1e-9, 0]], box=(3e8, 10, 10), boundary="wall"))
    sim.run(collisions=1)
    sim.check()


# Room.


@pytest.mark.parametrize(
    ("search", "room", "least"),
    [
        ("lists", "LIST_ROOM", 16),
        ("lists", "CELL_ROOM", 16),
        ("lists", "HEAP_ROOM", 1),
        ("lists", "BLOCKS", 1),
        ("windows", "SEGMENT_ROOM", 1),
        ("windows", "OVERFLOW_ROOM", 1),
        ("windows", "CONTACT_ROOM", 1),
        ("windows", "NEAR_ROOM", 1),
        ("windows", "HEAP_ROOM", 1),
        ("windows", "BLOCKS", 1),
    ],
)
def test_any_room_may_run_out(search, room, least, monkeypatch):
    """Each capacity alone begins at next to nothing, grows by itself, and the bits stay."""
    if room == "CELL_ROOM":
        monkeypatch.setattr(lists, "NEIGHBOURS_WANTED", {2: 60.0, 3: 60.0})  # few large cells
    scene = gas("3d", 500, 0.2, seed=5)
    usual, sim = (hs.Simulation(scene, search=search) for _ in range(2))
    at, engine = sim._at, sim._engine
    engine.arrays.counter[getattr(at, room)] = least
    engine.arrays = engine.arrays._replace(**engine._searching_arrays(engine.arrays.counter))
    for each in (usual, sim):
        each.run(collisions=1500)
        each.check()
    assert state(sim) == state(usual)
    if room != "OVERFLOW_ROOM":  # where this runs out a new search clears it
        assert engine.arrays.counter[getattr(at, room)] > least


# Counters past 2^32, by presetting them.


def test_clock_and_counters_past_2_to_the_32(search, tmp_path):
    """A gas that has been running for 2^40 epochs does what a fresh one does."""
    scene = gas("3d_walls", 200, 0.1, seed=5)
    fresh, old = (hs.Simulation(scene, search=search) for _ in range(2))
    at, count, total = old._at, old._engine.arrays.counter, 2**40 + 7
    old._engine.now = total, 0.0
    for name in ("EPOCH", "PAIRS", "WALL_HITS", "STALE", "REBUILDS", "OUT_OF_ORDER", "LAST_PAIR_EPOCH"):
        count[getattr(at, name)] = total
    old._engine.arrays.image_counts[:] = total
    old.reset_tallies()
    for sim in (fresh, old):
        sim.run(collisions=800)
        sim.run(time=3.25)
        sim.check()
    assert np.array_equal(old._engine.rows, fresh._engine.rows)
    assert old.collisions - total == fresh.collisions
    assert old.wall_collisions - total == fresh.wall_collisions
    assert old.status()["late_events"] == total
    assert old.tallies.collisions == fresh.tallies.collisions
    assert np.array_equal(old.tallies.virial, fresh.tallies.virial)
    assert old.tallies.time == fresh.tallies.time
    turns = [sim._engine.arrays.image_counts for sim in (old, fresh)]
    assert np.array_equal(turns[0] - total, turns[1])
    old.save(tmp_path / "old")
    loaded = hs.Simulation.load(tmp_path / "old", search=search)
    assert loaded.collisions == old.collisions > 2**40
    for sim in (loaded, old, fresh):
        sim.run(collisions=200)
    assert state(loaded) == state(old)
    assert np.array_equal(old._engine.rows, fresh._engine.rows)


def test_buckets_past_2_to_the_32():
    """The calendar's bucket is far beyond 32 bits when an epoch is divided that finely; nothing else changes."""
    sim, usual = (running("lists", "3d", 500, 1000) for _ in range(2))
    at, engine = sim._at, sim._engine
    number, count = engine.arrays.number, engine.arrays.counter
    while number[at.NOW] < 0.25 * engine.length:  # away from the beginning of an epoch
        for each in (sim, usual):
            each.run(collisions=20)
    while int(number[at.NOW] * number[at.INVERSE_WIDTH]) < 2**32:
        number[at.INVERSE_WIDTH] *= 2.0
        count[at.EPOCH_BUCKETS] *= 2
    engine._afresh = True
    engine.run(int(count[at.EPOCH]), -1.0, 0, 0)  # the search alone, from bucket 0
    engine._afresh = False
    cycle = int(count[at.BUCKETS])
    # As if it had opened every bucket up to the last event.
    count[at.BUCKET] = int(number[at.NOW] * number[at.INVERSE_WIDTH]) // cycle * cycle - 1
    for each in (sim, usual):
        each.run(collisions=3)
    assert count[at.BUCKET] > 2**32
    assert state(sim) == state(usual)


def test_a_version_that_wraps_around(search):
    """Versions are compared for equality only, so the 2^31st event of a particle is like any other."""
    sim, usual = running(search), running(search)
    sim._engine.arrays.version[:] = 2**31 - 3
    sim._engine._afresh = True
    for each in (sim, usual):
        each.run(collisions=2000)
        each.check()
    assert sim._engine.arrays.version.min() < 0
    assert state(sim) == state(usual)


def test_a_stamp_that_wraps_around():
    """Stamps have 32 bits of an entry; they too are compared for equality only."""
    sim, usual = running("lists"), running("lists")
    at = sim._at
    sim._engine.arrays.event[at.STAMP : 200 * at.EVENT : at.EVENT] = at.STAMP_BITS - 2
    sim._engine._afresh = True
    for each in (sim, usual):
        each.run(collisions=2000)
        each.check()
    assert sim._engine.arrays.event[at.STAMP : 200 * at.EVENT : at.EVENT].min() < 1000
    assert state(sim) == state(usual)
