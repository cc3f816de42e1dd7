"""Times of contact as the kernels predict them: to the last bit, at ties, in any image. Also as plain Python, in little time."""

import pytest
from scenes import KINDS, SEARCHES, gas

import hardspheres as hs


@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize("kind", KINDS)
def test_every_stored_event_is_what_the_rows_say(kind, search):
    """`check` solves for all contacts and walls anew, of all pairs at once, without the kernels."""
    sim = hs.Simulation(gas(kind, 12, 0.03, seed=3), search=search)
    for _ in range(4):
        sim.check()
        sim.run(collisions=3)
    sim.check()
