import math

"""Sums that take their terms in any order: exact, with the same bits in every order and division, and never wrapping."""

import copy
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import KINDS, SEARCHES, WITH_FLIGHTS, flight_bits, gas, state, tallied_bits

import hardspheres as hs
from hardspheres import sums

GRAIN = 2**sums.FRACTION_BITS


def summed(terms):
    """The sum of terms, as an array of shape (2, 1)."""
    found = np.zeros(2)
    for term in terms:
        sums.add_to(found, 0, 1, [term])
    return found.reshape(2, 1)


def exact(found):
    return Fraction(float(found[0, 0])) + Fraction(float(found[1, 0]))


def rounded(term):
    """A term to the nearest multiple of 2^-47, ties to even, as an exact number."""
    return Fraction(round(Fraction(float(term)) * GRAIN), GRAIN)


def terms_of_all_sizes(seed, n=3000):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * 2.0 ** rng.integers(-50, 38, n)


@pytest.mark.parametrize("seed", range(3))
def test_any_order_and_division_gives_the_bits_of_the_exact_sum(seed):
    """Of terms from 2^-50 to 2^38 units, shuffled, and in four parts. Sibling: sums of float64 differ."""
    terms, rng = terms_of_all_sizes(seed), np.random.default_rng(seed + 100)
    whole = summed(terms)
    assert exact(whole) == sum(map(rounded, terms))
    plain = set()
    for _ in range(3):
        rng.shuffle(terms)
        parts = [summed(part) for part in np.split(terms, [10, 700, 1900])]
        rng.shuffle(parts)
        together = np.zeros((2, 1))
        for part in parts:
            sums.add_sums(together, part)
        assert summed(terms).tobytes() == together.tobytes() == whole.tobytes()
        plain.add(sum(terms.tolist()))
    assert len(plain) > 1


halves = st.integers(-(2**20), 2**20).map(lambda k: k / 2)
grains = st.integers(-3, 3).map(lambda k: k / GRAIN)
sizes = st.floats(-(2.0**50), 2.0**50)


@given(st.lists(st.one_of(halves, grains, sizes), max_size=12), st.randoms())
def test_where_rounding_is_a_tie(terms, random):
    """Halves and grains, which end in the middle between two whole numbers: only one form for each value."""
    found = summed(terms)
    random.shuffle(terms)
    assert summed(terms).tobytes() == found.tobytes() and exact(found) == sum(map(rounded, terms))
    assert sums.are_sums(found) and -0.5 <= found[1, 0] < 0.5
    assert not np.signbit(summed([*terms, -exact_float(found)])[found == 0.0]).any()


def exact_float(found):
    return float(found.sum())


def test_what_is_no_sum():
    for whole, fraction in ((0.5, 0.0), (0.0, 0.5), (0.0, 2.0**-48), (1.0, -0.75)):
        assert not sums.are_sums(np.array([[whole], [fraction]]))
    assert sums.are_sums(np.array([[2.0**60, -3.0], [0.25, -0.5]]))


def test_too_much_is_rounded_and_does_not_wrap():
    """From 2^53 units on a sum is one of float64. Sibling: integers of 64 bits would have wrapped."""
    terms = np.full(1000, 2.0**61 * 1.25)
    assert summed(terms).sum() == pytest.approx(1000 * 2.0**61 * 1.25, rel=1e-12)
    assert summed(np.append(terms, -terms)).sum() == pytest.approx(0.0, abs=2.0**20)
    assert terms[:5].astype(np.int64).sum() < 0


@given(st.lists(st.tuples(sizes, st.floats(-0.5, 0.5)), min_size=1, max_size=20))
def test_integrals_keep_twice_the_digits(pairs):
    """Twenty additions to 2^-98 of all that was added. Sibling: float64 alone does not, where it can be seen."""
    value, rest, right, scale = 0.0, 0.0, Fraction(0), Fraction(0)
    for more, part in pairs:
        more_rest = part * math.ulp(more)
        value, rest = sums.accumulated(value, rest, more, more_rest)
        right += Fraction(more) + Fraction(more_rest)
        scale += abs(Fraction(more)) + Fraction(1, 2**900)
    assert abs(Fraction(value) + Fraction(rest) - right) <= scale / 2**98
    assert sums.accumulated(1.0, 0.0, 2.0**-80, 0.0) == (1.0, 2.0**-80)


PLAIN_PYTHON = """
import sys
sys.path.insert(0, {tests!r})
from fractions import Fraction
import numpy as np
from scenes import KINDS, gas
import hardspheres as hs
from hardspheres import sums
from hardspheres.kernel.simd import vectors

def check(scene, **more):
    sim = hs.Simulation(scene, **more)
    engine, at, noted = sim._engine, sim._at, []
    package = engine.kernels.__package__
    for name in ("tallies", "flights"):
        module = sys.modules[f"{{package}}.common.{{name}}"]
        add = vectors.add_terms
        def note(array, first, gap, terms):
            noted.append((first, gap, terms))
            add(array, first, gap, terms)
        module.add_terms = note
    sim.run(time=0.999 * engine.length)  # in the first epoch, where the sums are of all terms
    assert sim.collisions > 5
    rng = np.random.default_rng(1)
    one = [(first + k, gap, term) for first, gap, terms in noted for k, term in enumerate(terms)]
    together, exact = np.zeros_like(engine.arrays.total), {{}}
    plain = [np.zeros_like(together) for _ in range(2)]
    for n in range(2):
        rng.shuffle(one)
        for k, gap, term in one:
            plain[n][int(k)] += float(term)
    parts = [np.zeros_like(together) for _ in range(4)]
    for n, (k, gap, term) in enumerate(one):
        k, gap = int(k), int(gap)
        sums.add_to(parts[n % 4], k, gap, [float(term)])
        grain = 2**sums.FRACTION_BITS
        exact[k, gap] = exact.get((k, gap), 0) + Fraction(round(Fraction(float(term)) * grain), grain)
    for part in parts:
        for whole, more in zip(engine.blocks(together), engine.blocks(part)):
            sums.add_sums(whole, more)
    assert together.tobytes() == engine.arrays.total.tobytes()
    total = engine.arrays.total
    assert all(value == Fraction(total[k]) + Fraction(total[k + gap]) for (k, gap), value in exact.items())
    sizes = [abs(float(term)) for _, _, term in one if term]
    assert max(sizes) < 2.0**20 and np.median(sizes) > 2.0**-3
    return plain[0].tobytes() != plain[1].tobytes()

differ = []
for kind in KINDS:
    walls = KINDS[kind]["boundary"] != "periodic"
    differ.append(check(gas(kind, 40, 0.3, seed=3), free_paths=True))
    differ.append(check(gas(kind, 40, 0.05, seed=3), heat=True))
    if walls:
        pull = [0.0] * KINDS[kind]["dim"]
        pull[1] = -0.5
        differ.append(check(gas(kind, 40, 0.2, seed=3).replace(gravity=pull)))
mixed = gas("3d_mixture", 40, 0.2, seed=3)
fixed = np.arange(40) % 5 == 0
masses, velocities = np.where(fixed, np.inf, 1.0), np.where(fixed[:, None], 0.0, mixed.velocities)
differ.append(check(mixed.replace(masses=masses, velocities=velocities), free_paths=True))
print(sum(differ), len(differ))
"""


def test_the_terms_of_events_in_any_order_give_the_bits_of_the_kernels():
    """Each term that the kernels add, shuffled and in four parts, and exactly. Sibling: in float64 the order matters."""
    program = PLAIN_PYTHON.format(tests=str(Path(__file__).parent.parent))
    child = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert child.returncode == 0, child.stderr[-2000:]
    differ, all_of_them = map(int, child.stdout.split())
    assert differ == all_of_them > 10


@pytest.mark.parametrize("kind", KINDS)
def test_searches_tally_the_same_bits(kind):
    """Also after the tallies began anew in the middle of an epoch. Sibling: another moment gives others."""
    seen = [hs.Simulation(gas(kind, 200, 0.1, seed=4), search=search) for search in SEARCHES]
    for sim in seen:
        sim.run(collisions=1000)
        sim.reset_tallies()
        sim.run(collisions=1500)
    one, other = seen
    assert tallied_bits(one.tallies) == tallied_bits(other.tallies)
    assert tallied_bits(one.frame().tallies) == tallied_bits(other.frame().tallies) and state(one) == state(
        other
    )
    before = tallied_bits(one.tallies)
    one.reset_tallies()
    assert tallied_bits(one.tallies) != before and one.tallies.virial.tobytes() == bytes(8 * one.scene.dim**2)


@pytest.mark.parametrize(("kind", "search"), WITH_FLIGHTS)
def test_short_stretches_late_in_a_long_run_keep_their_digits(kind, search):
    """Sums of 2^40 times a term, and the next tallies are the same to the last bit. Sibling: float64 would lose 40 bits."""
    sim = hs.Simulation(gas(kind, 200, 0.1, seed=4), free_paths=True, search=search)
    sim.run(collisions=500)
    sim.reset_tallies()
    late = copy.deepcopy(sim)
    engine, at = late._engine, late._at
    stress = slice(at.STRESS, at.WALL_IMPULSE)  # bounded by the energy
    for total in (engine.arrays.total, engine.total_then):
        for block in engine.blocks(total):
            kept = block[..., stress].copy()
            block[..., 0, :] += 2.0**49
            if block.ndim == 2:
                block[..., stress] = kept
    for one in (sim, late):
        one.run(collisions=500)
    assert tallied_bits(late.tallies) == tallied_bits(sim.tallies)
    assert flight_bits(late.free_paths) == flight_bits(sim.free_paths)
    trace = np.trace(sim.tallies.virial)
    assert (2.0**40 * trace + trace) - 2.0**40 * trace != trace


@pytest.mark.parametrize(("kind", "search"), WITH_FLIGHTS)
@pytest.mark.parametrize("packing_fraction", [0.001, 0.1, 0.3])
def test_a_million_million_collisions_fit(kind, search, packing_fraction):
    """No sum would reach 2^53 units, and typical terms are far above the grain, in thin and dense gases."""
    if search == "windows" and packing_fraction > 0.2:
        search = "auto" if kind == "3d_mixture" else search
    sim = hs.Simulation(gas(kind, 200, packing_fraction, seed=4), free_paths=True, search=search)
    sim.run(collisions=2000)
    of_events, of_flights = (
        np.abs(block[..., 0, :]).ravel() for block in sim._engine.blocks(sim._engine.arrays.total)
    )
    for found in (of_events, of_flights):
        assert found.max() / sim.collisions * 1e12 < 2.0**53
    trace = of_events[sim._at.VIRIAL : sim._at.VIRIAL + 3].sum() / sim.collisions
    assert trace > 2.0**4


@pytest.mark.parametrize("kind", ["3d_mixture", "2d_mixture_walls"])
def test_units_scale_with_the_scene(kind):
    """Other units by powers of two: the same bits in all sums. Sibling: units by 3 give others."""
    scene = gas(kind, 100, 0.1, seed=4)
    found = []
    for length, time, mass in ((1.0, 1.0, 1.0), (2.0**-3, 2.0**5, 2.0**7), (3.0, 1.0, 1.0)):
        other = hs.Scene(
            scene.positions * length,
            scene.velocities * (length / time),
            scene.radii * length,
            scene.masses * mass,
            scene.box * length,
            scene.boundary,
        )
        sim = hs.Simulation(other)
        sim.run(collisions=500)
        found.append(sim._engine.arrays.total.tobytes())
    assert found[0] == found[1] != found[2]
