"""Engine and all-pairs solver side by side."""

import numpy as np

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation

PARTED = 1e-7  # deviation from which on the sequences are no longer compared


def pairs_and_times(scene, events):
    """Engine's event sequence: after each pair collision its time, the partners, and how many wall hits came before."""
    sim = hs.Simulation(scene)
    versions = sim._engine.arrays.version
    for _ in range(events):
        before, walls = versions.copy(), sim.wall_collisions
        sim.run(collisions=1)
        yield sim, np.flatnonzero(versions - before), sim.wall_collisions - walls


def deviation(sim, ref):
    """Largest difference of positions and velocities."""
    x = np.array([[float(a) for a in row] for row in ref.positions])
    v = np.array([[float(a) for a in row] for row in ref.velocities])
    box, periodic = sim.scene.box, sim.scene.periodic
    dx = sim.positions - x
    dx -= np.where(periodic, box * np.rint(dx / box), 0.0)
    return max(np.abs(dx).max(), np.abs(sim.velocities - v).max())


def follow(scene, events, number=float, sqrt=np.sqrt, **options):
    """Run both side by side; asserts the sequence of events until they part, returns how many collisions that took."""
    ref = ReferenceSimulation(scene, number, sqrt, **options)
    fixed = set(np.flatnonzero(scene.obstacles).tolist())
    for agreed, (sim, changed, walls) in enumerate(pairs_and_times(scene, events)):
        hits = []
        while (event := ref.step()).second >= scene.n:
            hits.append(event.first)
        assert len(hits) == walls
        partners = {event.first, event.second} - fixed  # the row of an obstacle never changes
        assert partners | set(hits) == set(changed.tolist())
        assert abs(sim.time - float(event.time)) < 10 * PARTED * (1 + sim.time)
        if deviation(sim, ref) > PARTED:
            return agreed
    return events
