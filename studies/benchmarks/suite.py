"""The table of speeds: many states in sequence, with a row of bench.csv after each, then a figure."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import hardspheres as hs
from analysis.statistics import Estimate
from hardspheres.memory import require_room_for
from studies.answer import Section, Table
from studies.benchmarks.bench import Bench, check, measure
from studies.page import Report, write_page
from studies.report import OutputFolder, Screen, machine, today
from studies.running.ownership import REPORT, SUMMARY

__all__ = ["QUESTION", "SUITES", "Suite", "run_suite", "suite_named"]

QUESTION = "How many collisions per second?"


@dataclass(frozen=True)
class Suite:
    """Which states to measure.

    Attributes
    ----------
    name : str
        As on the command line.
    sizes : tuple of int
        Numbers of particles N.
    packing_fractions : tuple of float
        Each with every N.
    window_seconds : float
        Processor time of each of the 20 windows, roughly.
    peer_up_to : int
        Particles up to which spheropack runs.
    """

    name: str
    sizes: tuple[int, ...]
    packing_fractions: tuple[float, ...]
    window_seconds: float
    peer_up_to: int
    files: ClassVar[tuple[str, ...]] = ("bench.csv", "bench.png")
    reports: ClassVar[bool] = True


SUITES = {
    "quick": Suite("quick", (100, 500, 4000, 32_000, 256_000), (0.01, 0.1, 0.3, 0.49), 0.05, 4000),
    "full": Suite(
        "full", (100, 500, 4000, 32_000, 256_000, 1_048_576), (0.001, 0.01, 0.1, 0.3, 0.49), 0.2, 32_000
    ),
}


def suite_named(
    name: str, sizes: Sequence[int] | None = None, packing_fractions: Sequence[float] | None = None
) -> Suite:
    """Return a suite, with other sizes or packing fractions where some are given.

    Raises
    ------
    HardSpheresError
        If there is none of this name, or a number of particles is invalid, or too large for the memory.
    """
    if name not in SUITES:
        raise hs.HardSpheresError(f"--suite {name} is not known; it can be {', '.join(SUITES)} or prices")
    suite = SUITES[name]
    for n in sizes or ():
        if n < 2:
            raise hs.HardSpheresError(f"--n {n}: a collision takes two particles; ask for at least 2")
        require_room_for(n)
    sizes = tuple(sorted(sizes or suite.sizes))
    return replace(
        suite, sizes=sizes, packing_fractions=tuple(sorted(packing_fractions or suite.packing_fractions))
    )


def run_suite(
    suite: Suite, study: Bench, out: OutputFolder, screen: Screen, made: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], bool]:
    """Measure all states of a suite, print them, write bench.csv, bench.png, report.html and summary.json.

    Parameters
    ----------
    suite : Suite
        Which states.
    study : Bench
        Everything else: dimension, boundary, mixture, start, peer, seed.
    out : OutputFolder
        Where the files go; made when the first state is done. bench.csv is whole after every state.
    screen : Screen
        Where results and progress are shown.
    made : mapping, optional
        What else made it, of `Program.made`.

    Returns
    -------
    summary : dict
        The content of summary.json; `states` has one entry for each.
    sound : bool
        Whether energy, momentum and non-overlap held in all of them.

    Raises
    ------
    HardSpheresError
        If no state can be made, or the peer is missing, or the folder cannot be written.
    """
    check(study)
    out.check(suite, resumable=False)
    began = time.perf_counter()
    states: list[dict[str, Any]] = []
    refused: list[hs.HardSpheresError] = []
    for packing_fraction in suite.packing_fractions:
        for n in suite.sizes:
            gas = replace(study.gas, n=n, packing_fraction=packing_fraction)
            state = replace(study, gas=gas, window_seconds=suite.window_seconds, peer_up_to=suite.peer_up_to)
            try:
                with screen.working(f"{n} particles at packing fraction {packing_fraction:g}"):
                    result, _ = measure(state)
            except hs.HardSpheresError as error:
                refused.append(error)
                continue
            if not states:
                out.create()
            states.append(result)
            out.write_csv("bench.csv", _columns(states))
            screen.note(
                f"{n} particles at packing fraction {packing_fraction:g}: {result['cpu']['median']:,.0f} /s"
            )
    if not states:
        raise refused[0]
    from studies.benchmarks.figure import rates

    drawn = rates(states)
    out.save_figure("bench.png", drawn, str(study.gas))
    passed = all(state["checks"]["passed"] for state in states)
    summary: dict[str, Any] = {
        "study": "bench",
        "date": today(),
        "version": hs.__version__,
        "seed": study.seed,
        "suite": suite.name,
        "states": states,
        "checks": {"passed": passed, "failures": [text for s in states for text in s["checks"]["failures"]]},
        "machine": machine(),
        **(made or {}),
        "seconds": time.perf_counter() - began,
        "files": sorted({*out.files, REPORT, SUMMARY}),
    }
    table, legend = Table(_HEADER, [_cells(state) for state in states], keys=2), _legend(states)
    fastest = max(states, key=lambda state: state["cpu"]["median"])
    page = Report(
        name="bench",
        subject=str(study.gas),
        question=QUESTION,
        answer=[
            (
                f"Up to {fastest['cpu']['median']:,.0f} collisions per second of processor time on one core: "
                f"{fastest['n']} particles at packing fraction {fastest['packing_fraction']:g}."
            )
        ],
        notes=[f"left out: {reason}" for reason in refused],
        figures={"bench": drawn},
        sections=[Section(f"{len(states)} states", [table])],
        legend=legend,
        summary=summary,
    )
    write_page(out, page)
    out.write_json(SUMMARY, summary)
    screen.table("", table.header, table.rows, keys=table.keys)
    screen.say()
    for sentence in legend:
        screen.say(sentence)
    for failure in summary["checks"]["failures"]:
        screen.say(f"CHECK FAILED, {failure}")
    screen.say(f"{len(states)} states in {summary['seconds']:.0f} s")
    for reason in refused:
        screen.note(f"left out: {reason}")
    screen.say(f"written to {out.path}: {', '.join(summary['files'])}")
    return summary, passed


def _columns(states: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns of bench.csv, empty where not measured; rates are per second of processor time."""
    rows = [_row(state) for state in states]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _row(state: Mapping[str, Any]) -> dict[str, Any]:
    theory, peer = state["theory"] or {}, state["against"] or {}
    their = peer.get("cpu", {})
    low, high = peer.get("ratio_quartiles", (None, None))
    plain = (
        "n",
        "dim",
        "packing_fraction",
        "start",
        "method",
        "discarded_collisions",
        "collisions",
        "seconds",
    )
    row = {name: state[name] for name in plain}
    row |= {"cpu_seconds": state["cpu_seconds"]}
    row |= {f"rate_{name}": state["cpu"][name] for name in state["cpu"]}
    row |= {f"wall_rate_{name}": state["wall"][name] for name in ("median", "best")}
    after = ("bytes_per_particle", "resident_bytes_per_particle", "compressibility_factor")
    row |= {name: state[name] for name in (*after, "compressibility_factor_error")}
    row |= {"compressibility_factor_theory": theory.get("value"), "energy_drift": state["energy_drift"]}
    row |= {f"peer_rate_{name}": their.get(name) for name in state["cpu"]}
    row |= {"peer_compressibility_factor": peer.get("compressibility_factor")}
    row |= {f"peer_{name}": peer.get(name) for name in ("ratio_of_medians", "ratio_of_bests")}
    row |= {"peer_ratio_lower_quartile": low, "peer_ratio_upper_quartile": high}
    return row


_HEADER = (
    "packing",
    "N",
    "median/s",
    "best/s",
    "quartiles",
    "bytes",
    "Z",
    "theory",
    "peer",
    "ratio",
)


def _cells(state: Mapping[str, Any]) -> tuple[str, ...]:
    cpu, peer = state["cpu"], state["against"] or {}
    z = Estimate(state["compressibility_factor"], state["compressibility_factor_error"])
    theory = "" if state["theory"] is None else f"{state['theory']['value']:.4f}"
    return (
        f"{state['packing_fraction']:.4g}",
        f"{state['n']}",
        f"{cpu['median']:,.0f}",
        f"{cpu['best']:,.0f}",
        f"{cpu['lower_quartile']:,.0f}-{cpu['upper_quartile']:,.0f}",
        f"{state['bytes_per_particle']:.0f}",
        str(z),
        theory + ("" if state["is_fluid"] is not False else " !"),
        f"{peer['cpu']['median']:,.0f}" if peer else "",
        f"{peer['ratio_of_medians']:.2f}" if peer else "",
    )


def _legend(states: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the columns are."""
    told = [
        (
            "collisions per second of processor time, medians of 20 windows, event loop alone, in "
            "equilibrium, one core"
        )
    ]
    peer = next((state["against"] for state in states if state["against"]), None)
    if peer is not None:
        told.append(f"peer: {peer['name']}, in turn; ratio: ours over the peer's")
    if any(state["is_fluid"] is False for state in states):
        told.append("!: the compressibility factor is not that of the equilibrium fluid")
    return told
