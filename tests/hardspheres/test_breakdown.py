"""Where the time of the event loop goes: each part is seen, and looking changes nothing."""

import copy
from collections import Counter

import pytest
from scenes import SEARCHES, gas, state

import hardspheres as hs
from hardspheres.breakdown import PARTS, Breakdown

LONGEST = (
    200  # runs of 0.02 s; each part takes 5 % of the time at least, so that all are seen in two or three
)


@pytest.mark.parametrize("search", SEARCHES)
def test_each_part_of_the_loop_is_seen(search):
    simulation = hs.Simulation(gas("3d", 500, 0.2), search=search)
    simulation.run(collisions=1)
    with Breakdown(simulation) as breakdown:
        for _ in range(LONGEST):
            simulation.run(collisions=20_000)
            if all(breakdown.looks[part] for part in PARTS):
                break
    assert min(breakdown.shares.values()) > 0.0
    assert sum(breakdown.shares.values()) == pytest.approx(1.0)


def test_between_runs_the_loop_is_at_its_calendar():
    simulation = hs.Simulation(gas("3d", 100, 0.2), search="lists")
    counter, at = simulation._engine.arrays.counter, simulation._engine.layout
    counter[at.PART] = at.RENEWAL  # a mark that was forgotten would stay
    simulation.run(collisions=50)
    assert counter[at.PART] == at.CALENDAR


def test_looking_moves_nothing():
    seen = hs.Simulation(gas("3d", 200, 0.3))
    unseen = copy.deepcopy(seen)
    with Breakdown(seen):
        seen.run(collisions=5000)
    unseen.run(collisions=5000)
    assert state(seen) == state(unseen)


def test_what_is_counted_is_that_of_the_block():
    simulation = hs.Simulation(gas("3d", 200, 0.3), search="lists")
    simulation.run(collisions=1000)
    before = simulation.status()
    with Breakdown(simulation) as breakdown:
        simulation.run(collisions=2000)
    after = simulation.status()
    for name in ("stale_events", "list_renewals"):
        assert breakdown.per_collision[name] == (after[name] - before[name]) / 2000
    assert 0.0 < breakdown.per_collision["renewals_of_all_lists"] < 0.1


def test_shares_are_of_all_looks_and_none_without_any():
    breakdown = Breakdown(hs.Simulation(gas("3d", 100, 0.2)))
    assert set(breakdown.shares.values()) == {0.0}
    breakdown.looks = Counter(prediction=3, calendar=1)
    assert breakdown.shares == {"prediction": 0.75, "renewal": 0.0, "calendar": 0.25, "execution": 0.0}


def test_the_second_thread_ends_with_the_block_also_on_an_error():
    breakdown = Breakdown(hs.Simulation(gas("3d", 100, 0.2)))
    with pytest.raises(ZeroDivisionError), breakdown:
        1 / 0  # noqa: B018
    assert not breakdown._thread.is_alive()
