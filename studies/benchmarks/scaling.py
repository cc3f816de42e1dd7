"""One gas on several threads: its rate beside that of one, and whether the bits are the same.

Wall time is compared, since that is what threads are for: on a busy machine they wait for each other. All
numbers of threads start from one state, in equilibrium, and run for as many collisions.
"""

from __future__ import annotations

import hashlib
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import hardspheres as hs
from studies.benchmarks.summary import write_summary
from studies.report import OutputFolder, Screen

__all__ = ["Scaling", "run_scaling"]

START_UP = 10.0  # collisions per particle
LEAST = 2_000_000  # collisions that are timed, in a small gas: a second or so
HEADER = ("N", "threads", "10^6 collisions/s", "speed-up", "windows", "undone", "put off", "same bits")


@dataclass(frozen=True)
class Scaling:
    """What to measure.

    Attributes
    ----------
    n : tuple of int
        Particles of each gas.
    threads : tuple of int
        Numbers of threads; 1 comes first, whether it is among them or not.
    packing_fraction : float
        Of spheres in 3D.
    collisions_per_particle : float
        In what is timed; more in a small gas.
    seed : int
        Of the start.
    """

    n: tuple[int, ...]
    threads: tuple[int, ...]
    packing_fraction: float = 0.3
    collisions_per_particle: float = 5.0
    seed: int = 1
    files: ClassVar[tuple[str, ...]] = ("scaling.csv",)
    reports: ClassVar[bool] = False


def run_scaling(
    study: Scaling, out: OutputFolder, screen: Screen, made: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], bool]:
    """Measure the speed-up, print it, write scaling.csv and summary.json.

    Parameters
    ----------
    study : Scaling
        What to measure.
    out : OutputFolder
        Where the files go.
    screen : Screen
        Where results and progress are shown.
    made : mapping, optional
        What else made it, of `Program.made`.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        Whether all numbers of threads gave the same bits.
    """
    out.check(study, resumable=False)
    began = time.perf_counter()
    entries = [entry for n in study.n for entry in _entries(study, n, screen)]
    rows = [
        [
            str(entry["n"]),
            str(entry["threads"]),
            f"{entry['collisions_per_second'] / 1e6:.3f}",
            f"{entry['speed_up']:.2f}",
            *(str(entry[name]) if entry["threads"] > 1 else "-" for name in ("windows", "undone", "put_off")),
            "yes" if entry["same_bits"] else "NO",
        ]
        for entry in entries
    ]
    screen.table(f"One gas on several threads, packing fraction {study.packing_fraction:g}", HEADER, rows)
    failures = [
        f"{entry['n']} particles on {entry['threads']} threads have other bits"
        for entry in entries
        if not entry["same_bits"]
    ]
    out.create()
    out.write_csv("scaling.csv", {name: [entry[name] for entry in entries] for name in entries[0]})
    summary = write_summary(
        out,
        screen,
        {
            "seed": study.seed,
            "packing_fraction": study.packing_fraction,
            "collisions_per_particle": study.collisions_per_particle,
            "scaling": entries,
            "seconds": time.perf_counter() - began,
        },
        made,
        failures,
    )
    return summary, not failures


def _entries(study: Scaling, n: int, screen: Screen) -> list[dict[str, Any]]:
    """Return the entries of the gas of n particles: of one thread, then of all other numbers of them."""
    collisions = max(round(study.collisions_per_particle * n / 2), LEAST)
    with screen.working(f"{n} particles: equilibrium"):
        start = hs.Simulation(hs.random_gas(n, study.packing_fraction, seed=study.seed))
        start.run(collisions=round(START_UP * n / 2))
    entries: list[dict[str, Any]] = []
    for threads in (1, *(count for count in sorted(set(study.threads)) if count > 1)):
        with screen.working(f"{n} particles on {threads} threads"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            simulation = start.on_threads(threads)
            if simulation.threads < threads:
                screen.note(f"{n} particles, {simulation.status()['fewer_threads']}")
                continue
            simulation.run(collisions=2 * n)  # kernels are compiled, lists begin to expire
            began = time.perf_counter()
            simulation.run(collisions=collisions)
            rate = collisions / (time.perf_counter() - began)
        status = simulation.status()
        entries.append(
            {
                "n": n,
                "threads": threads,
                "collisions_per_second": rate,
                "speed_up": rate / entries[0]["collisions_per_second"] if entries else 1.0,
                "windows": status["thread_windows"],
                "undone": status["thread_windows_undone"],
                "put_off": status["thread_events_put_off"],
                "digest": _digest(simulation),
            }
        )
    for entry in entries:
        entry["same_bits"] = entry["digest"] == entries[0]["digest"]
    return entries


def _digest(simulation: hs.Simulation) -> str:
    """Return a digest of positions, velocities, time and tallies, to the last bit."""
    tallies = simulation.tallies
    parts = (
        *(simulation.positions, simulation.velocities, np.array(simulation.time)),
        *(tallies.virial, tallies.kinetic),
    )
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()[:16]
