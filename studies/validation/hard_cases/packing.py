"""Crystals next to close packing, clusters that touch, and packings in which time cannot advance."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import hardspheres as hs
from studies.validation.hard_cases.case import EPS, Case, Size, kept, pick

TITLE = "Close packing"
CLOSE_PACKED = {2: math.pi / math.sqrt(12.0), 3: math.pi / math.sqrt(18.0)}
PARTICLES = {2: 120, 3: 108}
ROUNDINGS = 1e-12


def crystal(dim: int, gap: float) -> hs.Scene:
    """Return a periodic crystal, triangular or face-centred cubic, at 1 - gap of its close packing."""
    return hs.lattice_gas(
        n=PARTICLES[dim],
        packing_fraction=CLOSE_PACKED[dim] * (1.0 - gap),
        dim=dim,
        velocities="maxwell",
        seed=1,
    )


def jammed_ring() -> hs.Scene:
    """Return six touching discs on a closed ring: velocities circulate for ever, and no time passes."""
    positions = np.column_stack([np.arange(6) + 0.5, np.full(6, 2.0)])
    velocities = np.column_stack([[1.0, -1.0, 0.5, 0.25, -0.5, -0.25], np.zeros(6)])
    return hs.Scene(positions, velocities, box=(6.0, 4.0))


def cluster(dim: int) -> hs.Scene:
    """Return touching spheres in open space, each moving: 4 on a side of a cubic (square) lattice."""
    places = np.stack(np.meshgrid(*[np.arange(4.0)] * dim, indexing="ij"), -1).reshape(-1, dim) + 8.0
    return hs.Scene(places, np.random.default_rng(6).normal(size=places.shape), box=[20.0] * dim)


@kept
def pressed(dim: int, gap: float, collisions: int) -> Case:
    """Measure Z of a crystal against its limit at close packing.

    There the free volume is a polytope that shrinks with the gap, so that Z_MD (1 - eta/eta_cp) -> d, for any
    N (Salsburg and Wood 1962, doi:10.1063/1.1733163). The run is long enough for about 1 %.

    Where contact directions hardly change, some roundings repeat: discs near close packing lose energy
    steadily, 0.08 roundings / N per collision, instead of a random walk. The bounds of
    `hardspheres.Simulation.check` are therefore used.
    """
    simulation = hs.Simulation(crystal(dim, gap))
    simulation.run(collisions=collisions // 4)
    simulation.reset_tallies()
    simulation.run(collisions=collisions)
    late = int(simulation.status()["late_events"])
    broken = max(
        abs(simulation.energy_drift), simulation.worst_overlap, float(np.abs(simulation.momentum_drift).max())
    )
    off = abs(simulation.compressibility_factor * gap / dim - 1.0)
    return Case(
        f"crystal at 1 - {gap:.0e} of close packing, {dim}D",
        f"Z (1 - eta/eta_cp) = {dim}, to {max(gap, 4.0 / math.sqrt(collisions)):.1g}",
        f"{simulation.compressibility_factor * gap:.4f}; conserved to {broken:.0e}, {late} late",
        off if late == 0 and broken < max(ROUNDINGS, 0.5 * EPS * collisions / simulation.scene.n) else 1.0,
        3.0 * gap + 4.0 / math.sqrt(collisions),
    )


def cases(size: Size) -> Iterator[Case]:
    """Yield crystals, clusters and the jammed ring."""
    collisions = pick(size, (20_000, 200_000, 10_000_000))
    for dim in (2, 3):
        for gap in pick(size, ((1e-9,), (1e-3, 1e-6, 1e-9, 1e-12), (1e-3, 1e-6, 1e-9, 1e-12))):
            yield pressed(dim, gap, collisions)
        simulation = hs.Simulation(cluster(dim))
        simulation.run(time=2.0)
        broken = max(
            abs(simulation.energy_drift),
            simulation.worst_overlap,
            float(np.abs(simulation.momentum_drift).max()),
        )
        yield Case(
            f"{4**dim} touching spheres in open space, {dim}D",
            "energy, momentum, no overlap",
            f"{simulation.collisions} collisions, to {broken:.0e}",
            broken if simulation.collisions > 4**dim // 2 else 1.0,
            1e-14,
        )
    try:
        hs.Simulation(jammed_ring()).run(time=1.0)
        said = "no error"
    except hs.SimulationError as error:
        said = str(error).split(":")[0]
    yield Case(
        "six touching discs on a full ring",
        "time cannot advance",
        f'"{said}"',
        float("stands still" not in said),
    )
