"""The oracle itself: against results that are known in closed form."""

import math

import mpmath
import numpy as np
import pytest

from hardspheres.errors import SimulationError
from hardspheres.reference import ReferenceSimulation
from hardspheres.scene import Scene


def on_a_line(x, v, masses, length=1e3):
    """Discs on the middle line of a wide box between walls."""
    positions = np.column_stack([np.array(x) + length / 2, np.full(len(x), length / 2)])
    return Scene(positions, np.column_stack([v, np.zeros(len(v))]), 0.5, masses, (length, length), "wall")


def test_head_on_collision_of_two_masses():
    ref = ReferenceSimulation(on_a_line([-2.0, 2.0], [1.0, -1.0], [1.0, 3.0]))
    event = ref.step()
    assert (event.first, event.second) == (0, 1)
    assert event.time == 1.5
    assert ref.velocities[0][0] == -2.0 and ref.velocities[1][0] == 0.0


@pytest.mark.parametrize(("masses", "collisions"), [((1, 1, 1), 3), ((1, 0.1, 1), 8)])
def test_three_balls_on_a_line(masses, collisions):
    """At most ceil(pi / arccos sqrt(m1 m3 / ((m1+m2)(m2+m3)))) collisions; random starts reach it and never pass it."""
    m1, m2, m3 = masses
    most = math.ceil(math.pi / math.acos(math.sqrt(m1 * m3 / ((m1 + m2) * (m2 + m3)))))
    assert most == collisions
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(300):
        gaps = rng.uniform(1.0001, 1.5, 2)
        v = [1.0, rng.uniform(-1, 1), -rng.uniform(0.5, 1)]
        ref = ReferenceSimulation(on_a_line([-gaps[0], 0.0, gaps[1]], v, masses, 1e4))
        seen.add(sum(1 for _ in iter(lambda ref=ref: ref.step().second < 3, False)))
    assert max(seen) == most


def test_walls_reflect_and_count_as_ids_after_the_particles():
    scene = Scene([[1.0, 2.0]], [[-1.0, 0.5]], 0.5, 1.0, (4, 4), "wall")
    ref = ReferenceSimulation(scene)
    events = list(ref.events(4))
    assert [(e.first, e.second) for e in events] == [(0, 1), (0, 4), (0, 2), (0, 1)]
    assert [e.time for e in events] == [0.5, 3.0, 3.5, 6.5]


def test_particles_that_never_meet_are_reported():
    scene = Scene([[1.0, 1.0], [2.0, 3.0]], [[1.0, 0.0], [-1.0, 0.0]], 0.5, 1.0, (4, 4))
    with pytest.raises(SimulationError, match="never meet"):
        ReferenceSimulation(scene).step()


def test_fifty_digits_conserve_energy_to_fifty_digits():
    rng = np.random.default_rng(3)
    positions = np.array([[1.0, 1.0], [3.0, 1.2], [1.1, 3.0], [3.1, 3.3]])
    scene = Scene(
        positions, rng.normal(size=(4, 2)), 0.5, [1.0, 2.0, 3.0, 4.0], (4.5, 4.5), ("periodic", "wall")
    )
    with mpmath.workdps(50):
        ref = ReferenceSimulation(scene, mpmath.mpf, mpmath.sqrt)

        def energy():
            return sum(m * sum(u * u for u in v) for m, v in zip(ref.masses, ref.velocities, strict=True))

        before = energy()
        list(ref.events(60))
        assert ref.collisions > 10
        assert abs(energy() / before - 1) < mpmath.mpf(10) ** -45
