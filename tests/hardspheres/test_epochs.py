"""Where heavy particles hurry light ones, epochs change their length: contacts stay exact, and all that is promised holds."""

import math
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import SEARCHES, everything, gas

import hardspheres as hs
from hardspheres import tuning
from hardspheres.clock import recounted
from hardspheres.engine import Engine
from hardspheres.free_paths import FlightTallies

KINDS = ("3d_mixture", "2d_mixture_walls")
COLLISIONS = 3600


def cold(kind, ratio=1e10, unit=1.0):
    """Eight particles of which every other one is lighter by a ratio and at rest: its speed grows with every meeting."""
    heavy = np.arange(8) % 2 == 0
    scene = gas(kind, 8, 0.02, masses=np.where(heavy, ratio, 1.0))
    velocities = scene.velocities * np.where(heavy, math.sqrt(ratio), 0.0)[:, None] * unit
    return hs.Scene(
        scene.positions * unit, velocities, scene.radii * unit, scene.masses, scene.box * unit, scene.boundary
    )


def uneasy(kind, unit=1.0):
    """Masses 1:100: where epochs of half and of twice the length are changed, they change all the time, both ways."""
    return cold(kind, 100.0, unit)


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(tuning, "OUT_OF_PACE", 2.0)


def lengths(sim, collisions=COLLISIONS, steps=60):
    """Run, and return the lengths of epochs seen on the way."""
    seen = []
    for _ in range(steps):
        sim.run(collisions=collisions // steps)
        seen.append(sim.status()["epoch_length"])
    return seen


def test_epochs_shorten_by_powers_of_two(kind):
    sim = hs.Simulation(cold(kind))
    first = tuning.epoch_length(sim.scene)
    seen = lengths(sim)
    assert seen[-1] <= first / 16 and math.frexp(first / seen[-1])[0] == 0.5
    sim.check()
    assert sim.status()["late_events"] == 0


def test_they_change_both_ways(kind, impatient):
    sim = hs.Simulation(uneasy(kind))
    first = tuning.epoch_length(sim.scene)
    steps = np.diff(np.log2(lengths(sim)))
    assert (steps < 0).any() and (steps > 0).any() and max(lengths(sim)) <= first
    sim.check()


def test_equal_masses_never_change_them():
    assert tuning.pace(gas("3d", 20, 0.1), 1.0) == (0.0, math.inf)
    lower, upper = tuning.pace(gas("3d_mixture", 20, 0.1), 2.0**-9)
    assert 0.0 < lower < upper < math.inf


def test_the_search_does_not_matter(kind, impatient):
    seen = [hs.Simulation(uneasy(kind), search=search) for search in SEARCHES]
    for sim in seen:
        sim.run(collisions=COLLISIONS)
    assert len({sim.status()["method"].split(",")[0] for sim in seen}) == 2
    assert seen[0].positions.tobytes() == seen[1].positions.tobytes() and seen[0].time == seen[1].time


def test_stops_and_checkpoints_do_not_matter(kind, impatient, tmp_path):
    whole, sim, seen = hs.Simulation(uneasy(kind)), hs.Simulation(uneasy(kind)), []
    whole.run(collisions=COLLISIONS)
    for k in range(24):
        seen += lengths(sim, COLLISIONS // 24, 10)
        if k % 3 == 0:
            sim.save(tmp_path / "checkpoint.npz")
            sim = hs.Simulation.load(tmp_path / "checkpoint.npz")
    assert len(set(seen)) > 2
    assert everything(sim) == everything(whole)


def test_a_time_that_was_asked_for_is_reached(kind):
    """Epochs shorten on the way to a time, and it is that time all the same, counted in either."""
    sim = hs.Simulation(cold(kind))
    sim.run(collisions=COLLISIONS)
    end = sim.time
    again = hs.Simulation(cold(kind))
    again.run(time=end)
    assert again.status()["epoch_length"] < tuning.epoch_length(again.scene)
    assert again.time == end and again.tallies.time == end
    assert again.collisions >= COLLISIONS - 1  # the last one is at this time, to a rounding of it


def test_units_do_not_matter(kind, impatient):
    one, other = hs.Simulation(uneasy(kind)), hs.Simulation(uneasy(kind, unit=2.0**-7))
    one.run(collisions=COLLISIONS)
    other.run(collisions=COLLISIONS)
    assert np.array_equal(one.positions * 2.0**-7, other.positions) and one.time == other.time


def test_tallies_go_on(kind, impatient):
    """The kinetic part of the pressure is an integral over time: its trace is that of a constant, to rounding."""
    sim = hs.Simulation(uneasy(kind))
    sim.run(collisions=1000)
    sim.reset_tallies()
    lengths(sim)
    t = sim.tallies
    assert float(np.trace(t.kinetic)) == pytest.approx(2.0 * sim.scene.kinetic_energy * t.time, rel=1e-11)


def integrals():
    """Kinetic tensor since a moment in an epoch, from tallies and from frames; from sum m v v, step by step."""
    sim = hs.Simulation(uneasy("3d_mixture"))
    sim.run(collisions=301)
    before, then = sim.frame().tallies.kinetic, sim.time
    sim.reset_tallies()
    assert sim._engine.since[1] > 0.0
    right, seen = np.zeros((3, 3)), []
    for _ in range(300):
        flux = np.einsum("i,ia,ib", sim.scene.masses, sim.velocities, sim.velocities)
        sim.run(collisions=1)
        right += flux * (sim.time - then)
        then = sim.time
        seen.append(sim.status()["epoch_length"])
    assert (np.diff(seen) < 0.0).any() and (np.diff(seen) > 0.0).any()
    return sim.tallies.kinetic, sim.frame().tallies.kinetic - before, right


def test_tallies_that_began_in_an_epoch_of_another_length(impatient, monkeypatch):
    """Each component is that of the steps, to rounding. Sibling: what stood in the sums then has to be converted."""
    since, between, right = integrals()
    rounding = 1e-12 * np.trace(right)
    assert since == pytest.approx(right, abs=rounding) and between == pytest.approx(right, abs=rounding)
    monkeypatch.setattr(Engine, "_then", lambda self, _: (self.total_then, self.integral_then))
    since, between, _ = integrals()
    assert between == pytest.approx(right, abs=rounding) and np.abs(since - right).max() > 1e6 * rounding


def deepest(scene):
    """Worst overlap seen right after collisions."""
    sim, worst = hs.Simulation(scene), 0.0
    for _ in range(100):
        sim.run(collisions=COLLISIONS // 100)
        worst = max(worst, sim.worst_overlap)
    return worst


def test_contacts_stay_exact(kind, monkeypatch):
    """Sibling: with epochs as long as at the start, contacts are off by as much as the light ones are faster."""
    exact = deepest(cold(kind))
    assert exact < 1e-13
    monkeypatch.setattr(tuning, "OUT_OF_PACE", 2.0**60)
    assert deepest(cold(kind)) > 4 * exact


def test_an_interrupt_there_costs_nothing(impatient, monkeypatch):
    whole, with_epochs = hs.Simulation(uneasy("3d_mixture")), Engine.with_epochs
    whole.run(collisions=COLLISIONS)
    left = [KeyboardInterrupt] * 3

    def disturbed(self, length):
        if left:
            raise left.pop()
        return with_epochs(self, length)

    monkeypatch.setattr(Engine, "with_epochs", disturbed)
    sim = hs.Simulation(uneasy("3d_mixture"))
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            sim.run(collisions=COLLISIONS)
        sim.check()
    sim.run(collisions=COLLISIONS - sim.collisions)
    assert everything(sim) == everything(whole)


@pytest.mark.parametrize("length", [0.5, 4.0, 32.0])
def test_a_flight_began_when_it_began(length):
    """Flights counted in other epochs: the same moments, exactly; those from before the start stay marked."""
    layout = hs.Simulation(gas("3d_mixture", 6, 0.1))._at
    layout = SimpleNamespace(**{**vars(layout), "FLIGHT": 4})
    tallies = FlightTallies(gas("3d_mixture", 6, 0.1), layout)
    flight = np.array([[4.0, -1, 0, 0], [0.0, 0, 0, 0], [3.75, 5, 0, 0], [0.5, 23, 0, 0]])
    before = flight.copy()
    tallies.recount(flight, 4.0, length)
    assert np.array_equal(
        flight[:, 1] * length + flight[:, 0], np.where(before[:, 1] < 0, 0, before[:, 1] * 4 + before[:, 0])
    )
    assert flight[0, 1] == -1 and np.all((flight[:, 0] >= 0) & (flight[:, 0] <= length))


@given(
    epoch=st.integers(0, 2**40),
    share=st.floats(0, 1, exclude_max=True),
    power=st.integers(-20, 20),
)
def test_a_time_stays_the_same_time(epoch, share, power):
    """Counted in other epochs: exactly in shorter ones, to a rounding within longer ones."""
    length = 2.0**power
    again, moment = recounted(epoch, share, 1.0, length)
    off = Fraction(again) * Fraction(length) + Fraction(moment) - epoch - Fraction(share)
    assert 0 <= moment <= length and abs(off) <= (0 if power <= 0 else math.ulp(length))


def test_time_that_cannot_be_counted_any_more_is_refused():
    sim = hs.Simulation(cold("3d_mixture"))
    at, arrays = sim._at, sim._engine.arrays
    arrays.number[at.MEAN_SQUARE] = 2.0**20 * arrays.number[at.UPPER_MEAN_SQUARE]
    arrays.counter[at.EPOCH] = 2**60
    with pytest.raises(hs.SimulationError, match="no longer be counted"):
        sim.run(collisions=1)
