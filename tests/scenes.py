"""Scenes that several tests share."""

import numpy as np

import hardspheres as hs

KINDS = {  # one compiled specialisation each; the default tests compile no others
    "3d": {"dim": 3, "boundary": "periodic"},
    "2d": {"dim": 2, "boundary": "periodic"},
    "3d_walls": {"dim": 3, "boundary": ("periodic", "wall", "periodic")},
    "2d_mixture_walls": {"dim": 2, "boundary": "wall", "mixture": True},
    "3d_mixture": {"dim": 3, "boundary": "periodic", "mixture": True},
}


def gas(kind, n, packing_fraction, seed=1, **more):
    """A gas of one of the kinds, placed at random with Maxwell velocities."""
    options = dict(KINDS[kind])
    if options.pop("mixture", False):
        odd = np.arange(n) % 2
        options |= {"radii": np.where(odd, 0.3, 0.5), "masses": np.where(odd, 1.0, 7.0)}
    return hs.random_gas(n=n, packing_fraction=packing_fraction, seed=seed, **(options | more))


def one_to_ten(kind, n=1500, large=15, **more):
    """Diameters 1:10, one particle in a hundred large, masses 1:5."""
    is_large = np.arange(n) % (n // large) == 0
    kind = {key: value for key, value in KINDS[kind].items() if key != "mixture"}
    sizes = {"radii": np.where(is_large, 5.0, 0.5), "masses": np.where(is_large, 5.0, 1.0)}
    return hs.random_gas(n=n, seed=11, **(kind | sizes | more))


def state(sim):
    """Every bit of the canonical state and of the counters that physics sees."""
    at, a = sim._at, sim._engine.arrays
    return (
        np.ascontiguousarray(sim._engine.state()["row"]).tobytes(),
        a.total.tobytes(),
        a.integral.tobytes(),
        a.image_counts.tobytes(),
        sim.collisions,
        sim.wall_collisions,
        int(a.counter[at.EPOCH]),
    )


SEARCHES = ("lists", "windows")
# Kinds and searches that the default tests compile with tallies of flights.
WITH_FLIGHTS = [("3d", "windows"), ("3d_mixture", "lists")]

WITH_HEAT = [("3d", "lists"), ("3d", "windows")]  # the same for tallies of the heat flux


def state_without_flights(sim):
    """Every bit that the tallies of flights must not change."""
    at, a = sim._at, sim._engine.arrays
    sums = a.total[: at.FLIGHT_SUMS].tobytes() + a.integral.tobytes()
    return a.row.tobytes(), sums, a.image_counts.tobytes(), sim.collisions, sim.wall_collisions, sim.time


def flight_bits(tallies):
    """Every bit of the tallies of flights."""
    return b"".join(np.ascontiguousarray(part).tobytes() for part in vars(tallies).values())


def tallied_bits(t):
    """Every bit of tallies."""
    arrays = (t.virial, t.kinetic, t.wall_impulses, t.wall_radius_impulses)
    return t.time, t.collisions, t.wall_collisions, *(a.tobytes() for a in arrays)


def everything(sim):
    """All that a user can see of a simulation, to the last bit, but what the search for events alone decides, and the clock."""
    t, frame = sim.tallies, sim.frame()
    paths = None if frame.free_paths is None else flight_bits(frame.free_paths)
    own = ("stale_events", "list_renewals", "bytes_per_particle", "collisions_per_second")
    own += ("threads", "fewer_threads", "thread_windows", "thread_windows_undone", "thread_events_put_off")
    return (
        state(sim),
        sim.time,
        sim.positions.tobytes(),
        sim.unwrapped_positions.tobytes(),
        tallied_bits(t),
        tallied_bits(frame.tallies),
        paths,
        repr({name: value for name, value in sim.status().items() if name not in own}),
    )


def run_alone(seed):
    """Run a small gas, and return everything about it; for pools of processes, which need a name to import."""
    sim = hs.Simulation(gas("3d_walls" if seed % 2 else "3d", 200, 0.1, seed=seed))
    sim.run(collisions=2000)
    return everything(sim)
