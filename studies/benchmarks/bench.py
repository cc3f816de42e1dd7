"""Collisions per second of an equilibrated gas: the event loop alone, in many short windows, beside a peer.

What is timed is `Simulation.run(collisions=...)` less a call that follows a single collision, after the
kernels are compiled and loaded, after the gas is in equilibrium, and after at least ten collisions per
particle (neighbour lists are up to three times too fast until the first rebuilds). Both processor time and
wall time are measured; on a busy machine compare processor times. A peer runs in turn with our engine, window
by window, in the same process on the same core.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.statistics import Estimate
from hardspheres.breakdown import PARTS, Breakdown
from hardspheres.memory import require_room_for
from studies.benchmarks.clock import Memory, Ours, Timing, Windows
from studies.benchmarks.gas import STARTS, Gas
from studies.benchmarks.rivals import Rival, require_peer
from studies.fluid import LONGEST
from studies.report import OutputFolder, Screen, machine

__all__ = ["Bench", "bench", "check", "measure"]

FloatArray = NDArray[np.float64]

WINDOWS = 20
WINDOW_SECONDS = 0.2  # of processor time, where the number of collisions is not given
IDLE_SHARE = 5.0  # windows are this many times as long as a call that does nothing
WARM = 20_000  # least number of collisions of start-up, for any gas
BREAKDOWN_WINDOWS = 5  # so many windows' worth of collisions more, to see where the time goes
LEAST_LOOKS = 100  # below this nothing is said about it
MEMORY_FROM = 30_000  # particles from which on the growth of resident memory is significant


@dataclass(frozen=True)
class Bench:
    """What to time, and how.

    Attributes
    ----------
    gas : Gas
        What to time.
    collisions : int, optional
        How many to time; by default as many as `window_seconds` allow.
    discard : float, optional
        Collisions per particle to discard first; by default `Gas.discarded`.
    against : str, optional
        The peer: "spheropack" on the same gas, or "plain", our own engine on `Gas.plain`.
    seed : int
        Of the start.
    window_seconds : float
        Processor time of each window, roughly.
    peer_up_to : int
        Particles up to which spheropack runs; a million take it minutes.
    """

    gas: Gas
    collisions: int | None = None
    discard: float | None = None
    against: str | None = None
    seed: int = 1
    window_seconds: float = WINDOW_SECONDS
    peer_up_to: int = 2**40
    files: ClassVar[tuple[str, ...]] = ("windows.csv",)


def bench(
    study: Bench, out: OutputFolder, screen: Screen, made: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], bool]:
    """Time one gas, print the result and write summary.json and windows.csv.

    Parameters
    ----------
    study : Bench
        What to do.
    out : OutputFolder
        Where the files go; made only after the gas has run.
    screen : Screen
        Where results and progress are shown.
    made : mapping, optional
        What else made it, of `Program.made`.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        Whether energy, momentum and non-overlap held.

    Raises
    ------
    HardSpheresError
        If the gas cannot be made or never collides, the peer is missing, or the folder cannot be written.
    """
    out.check(study, resumable=False)
    with screen.working("timing"):
        summary, columns = measure(study)
    out.create()
    out.write_csv("windows.csv", columns)
    summary = {
        "study": "bench",
        "version": hs.__version__,
        "seed": study.seed,
        **summary,
        "machine": machine(),
        **(made or {}),
    }
    summary["files"] = sorted({*out.files, "summary.json"})
    out.write_json("summary.json", summary)
    _print(screen, summary)
    screen.say(f"written to {out.path}: {', '.join(summary['files'])}")
    return summary, bool(summary["checks"]["passed"])


def measure(study: Bench) -> tuple[dict[str, Any], dict[str, FloatArray]]:
    """Make, equilibrate and time a gas.

    Parameters
    ----------
    study : Bench
        What to do.

    Returns
    -------
    result : dict
        Rates, memory, pressure beside theory, checks.
    windows : dict of arrays
        Collisions and times of each window.

    Raises
    ------
    HardSpheresError
        If the gas cannot be made or never collides, or the peer cannot run it.
    """
    gas = study.gas
    check(study)
    clock = [time.process_time()]
    load_kernels(replace(gas, n=0))
    clock.append(time.process_time())
    memory = Memory()
    scene = gas.scene(study.seed)
    clock.append(time.process_time())
    memory.forget_peak()
    simulation = hs.Simulation(scene)
    clock.append(time.process_time())
    discarded, last = start_up(simulation, gas.discarded if study.discard is None else study.discard)
    clock.append(time.process_time())
    bytes_grown = memory.peak_growth()

    rival = None
    if study.against == "plain" or (study.against and gas.n <= study.peer_up_to):
        rival = Rival(study.against, gas, simulation, study.seed)
    runner = Ours(simulation)
    seconds = max(study.window_seconds, IDLE_SHARE * last.idle[0])
    total = study.collisions or max(WINDOWS, round(WINDOWS * seconds * float(last.cpu_rates[0])))
    simulation.reset_tallies()
    ours, virial = Windows(), []
    for size in _split(total, min(WINDOWS, total)):
        if rival is not None:
            runner.run(size // 4)  # the peer has replaced the content of the caches
        ours.time(runner, size)
        virial.append(_virial(simulation))
        if rival is not None:
            rival.window(sum(ours.cpu) / len(ours.cpu))

    status = simulation.status()
    pressure = _pressure(simulation, virial)
    theory = gas.theory(scene)
    names = ("kernels", "scene", "engine", "start_up")
    result: dict[str, Any] = {
        "n": scene.n,
        "dim": scene.dim,
        "packing_fraction": scene.packing_fraction,
        "boundary": list(scene.boundary),
        "diameter_ratio": gas.diameter_ratio,
        "mass_ratio": gas.mass_ratio,
        "fraction": gas.fraction if (gas.diameter_ratio, gas.mass_ratio) != (1.0, 1.0) else None,
        "start": gas.describe_start(),
        "method": status["method"],
        "discarded_collisions": discarded,
        "discarded_collisions_per_particle": 2.0 * discarded / scene.n,
        "collisions": sum(ours.collisions),
        "windows": len(ours.cpu),
        "seconds": sum(ours.wall),
        "cpu_seconds": sum(ours.cpu),
        "idle_cpu_seconds_per_call": float(np.median(ours.idle)),
        "collisions_per_second": sum(ours.collisions) / sum(ours.wall),
        "cpu": asdict(Timing.of(ours.cpu_rates)),
        "wall": asdict(Timing.of(ours.wall_rates)),
        "bytes_per_particle": status["bytes_per_particle"],
        "resident_bytes_per_particle": None
        if bytes_grown is None or scene.n < MEMORY_FROM
        else bytes_grown / scene.n,
        "compressibility_factor": pressure.value,
        "compressibility_factor_error": pressure.standard_error,
        "theory": None if theory is None else {"value": theory.value, "uncertainty": theory.uncertainty},
        "is_fluid": None
        if theory is None
        else _agree(pressure.value, float(theory.value), sum(ours.collisions)),
        "energy_drift": status["energy_drift"],
        "late_events": status["late_events"],
        "breakdown": _breakdown(simulation, total, float(np.median(ours.cpu_rates))),
        "checks": _checks(simulation),
        "setup_cpu_seconds": dict(zip(names, np.diff(clock).tolist(), strict=True)),
        "against": None,
        "engine": status,
    }
    columns = {"collisions": ours.collisions, "seconds": ours.wall, "cpu_seconds": ours.cpu}
    if rival is not None:
        result["against"] = rival.compare(ours)
        columns |= rival.columns()
    return result, {name: np.array(column) for name, column in columns.items()}


def check(study: Bench) -> None:
    """Raise HardSpheresError for invalid options, too many particles, or a missing peer."""
    require_room_for(study.gas.n)
    if study.gas.start not in STARTS:
        raise hs.SceneError(f"--start {study.gas.start} is not known; it can be {', '.join(STARTS)}")
    if study.collisions is not None and study.collisions < 1:
        raise hs.SceneError(f"--collisions {study.collisions} must be at least 1")
    if study.discard is not None and not 0 <= study.discard <= LONGEST:
        raise hs.SceneError(f"--discard {study.discard:g} must be at least 0, and at most {LONGEST:g}")
    if study.against is not None:
        require_peer(study.against, study.gas)


@lru_cache
def load_kernels(gas: Gas) -> None:
    """Compile or load what this kind of gas needs, with small runs: a dilute one, and a growth if dense.

    Raises
    ------
    HardSpheresError
        If there is no such gas.
    """
    small = replace(gas, n=2000, start="auto")
    limit = {2: 0.4, 3: 0.25}.get(gas.dim, 1.0)  # the method of all denser gases
    hs.Simulation(replace(small, packing_fraction=min(gas.packing_fraction, limit)).scene(1)).run(
        collisions=1
    )
    if gas.dense and not gas.on_lattice:
        small.scene(1)


def start_up(simulation: hs.Simulation, collisions_per_particle: float) -> tuple[int, Windows]:
    """Run the collisions that are discarded.

    Returns
    -------
    discarded : int
        Pair collisions run.
    last : Windows
        Timing of the second half, as one window.
    """
    half = max(round(collisions_per_particle * simulation.scene.n / 4), WARM // 2)
    last = Windows()
    simulation.run(collisions=half)
    last.time(Ours(simulation), half)
    return simulation.collisions, last


def _breakdown(simulation: hs.Simulation, total: int, rate: float) -> dict[str, Any] | None:
    """Where the time of a collision goes, by looks at the loop in a further run; None if it is too short."""
    with Breakdown(simulation) as breakdown:
        simulation.run(collisions=math.ceil(total * BREAKDOWN_WINDOWS / WINDOWS))
    looks = breakdown.looks.total()
    if looks < LEAST_LOOKS:
        return None
    parts = {
        part: {
            "share": share,
            "standard_error": math.sqrt(share * (1.0 - share) / looks),
            "nanoseconds_per_collision": share * 1e9 / rate,
        }
        for part, share in breakdown.shares.items()
    }
    return {"looks": looks, "parts": parts, "per_collision": breakdown.per_collision}


def _split(total: int, parts: int) -> list[int]:
    """Return integers that add up to the total and differ by at most one."""
    return [total // parts + (k < total % parts) for k in range(parts)]


def _virial(simulation: hs.Simulation) -> tuple[float, float]:
    """Return time and virial since the last reset of the tallies."""
    tallies = simulation.tallies
    return tallies.time, float(np.trace(tallies.virial))


def _pressure(simulation: hs.Simulation, cumulative: Sequence[tuple[float, float]]) -> Estimate:
    """Return the compressibility factor over the timed run, its error from the spread over stretches of it.

    Windows of a large gas are too short to be independent, so adjacent ones are joined: two collisions per
    particle where possible, at least four stretches.
    """
    passed = 2.0 * simulation.tallies.collisions / simulation.scene.n
    times, virials = np.array([(0.0, 0.0), *cumulative]).T
    stretches = min(max(4, int(passed / 2.0)), len(cumulative))
    edges = np.linspace(0, len(cumulative), stretches + 1).round().astype(int)
    rates = np.diff(virials[edges]) / np.diff(times[edges]) / (2.0 * simulation.thermal_energy)
    error = np.std(rates, ddof=1) / np.sqrt(stretches) if stretches > 1 else np.nan
    return Estimate(simulation.compressibility_factor, float(error), stretches)


def _agree(measured: float, expected: float, collisions: int) -> bool:
    """Whether Z agrees with that of the fluid to 3 % of Z - 1 plus the noise of so many collisions."""
    return abs(measured - expected) < (0.03 + 5.0 / math.sqrt(collisions)) * (expected - 1.0)


def _checks(simulation: hs.Simulation) -> dict[str, Any]:
    try:
        simulation.check()
    except hs.InvariantError as error:
        return {"passed": False, "failures": [str(error)]}
    return {"passed": True, "failures": []}


def _print(screen: Screen, summary: Mapping[str, Any]) -> None:
    kind = "spheres" if summary["dim"] == 3 else "discs"
    words = summary["boundary"]
    box = words[0] if len(set(words)) == 1 else ", ".join(words)
    mixture = ""
    for name in ("diameter", "mass"):
        ratio = summary[f"{name}_ratio"]
        mixture += f", {name}{'es' if name == 'mass' else 's'} 1:{ratio:g}" if ratio != 1.0 else ""
    screen.say(
        f"{summary['n']} hard {kind}{mixture}, packing fraction {summary['packing_fraction']:.4g}, {box} "
        "box, "
        f"start: {summary['start']}"
    )
    screen.say(
        f"method: {summary['method']}; discarded {summary['discarded_collisions']} collisions "
        f"({summary['discarded_collisions_per_particle']:.3g} per particle), then timed "
        f"{summary['collisions']} in "
        f"{summary['windows']} windows: {summary['cpu_seconds']:.2f} s of the processor, "
        f"{summary['seconds']:.2f} s on the wall"
    )
    screen.say()
    rows = [_row("hardspheres, processor", summary["cpu"]), _row("hardspheres, wall", summary["wall"])]
    against = summary["against"]
    if against is not None:
        name = against["name"]
        rows += [_row(f"{name}, processor", against["cpu"]), _row(f"{name}, wall", against["wall"])]
    screen.table("", ["collisions per second", "median", "best", "quartiles", "error of mean"], rows)
    screen.say()
    if against is not None:
        _print_ratio(screen, against)
    if summary["breakdown"] is not None:
        _print_breakdown(screen, summary["breakdown"], windows=summary["engine"]["window"] > 0.0)
    _print_pressure(screen, summary)
    resident = summary["resident_bytes_per_particle"]
    grown = "" if resident is None else f" in the engine's arrays; resident memory grew by {resident:.0f}"
    setup = summary["setup_cpu_seconds"]
    screen.say(f"{summary['bytes_per_particle']:.0f} bytes per particle{grown}")
    screen.say(
        "processor time of setting up: "
        + ", ".join(f"{name.replace('_', '-')} {seconds:.2f} s" for name, seconds in setup.items())
    )
    screen.say(f"energy drift {summary['energy_drift']:.1e}, events out of order {summary['late_events']}")
    for failure in summary["checks"]["failures"]:
        screen.say(f"CHECK FAILED, {failure}")
    if summary["seconds"] > 1.15 * summary["cpu_seconds"]:
        screen.note("the machine was busy with other work: compare processor times, or measure again")


def _row(name: str, timing: Mapping[str, float]) -> list[str]:
    low, high = timing["lower_quartile"], timing["upper_quartile"]
    values = [_rate(timing["median"]), _rate(timing["best"]), f"{_rate(low)} to {_rate(high)}"]
    return [name, *values, _rate(timing["standard_error"])]


def _rate(rate: float) -> str:
    return f"{rate:,.0f}"


def _print_ratio(screen: Screen, against: Mapping[str, Any]) -> None:
    low, high = against["ratio_quartiles"]
    screen.say(
        f"{against['ratio_of_medians']:.2f} times {against['name']} by medians, "
        f"{against['ratio_of_bests']:.2f} by best windows; quartiles of neighbouring windows {low:.2f} to "
        f"{high:.2f} (processor time, in turn)"
    )


def _print_breakdown(screen: Screen, breakdown: Mapping[str, Any], windows: bool) -> None:
    rows = [
        [
            PARTS[name][windows],
            f"{100 * part['share']:.0f}({max(100 * part['standard_error'], 1.0):.0f}) %",
            f"{part['nanoseconds_per_collision']:.0f} ns",
        ]
        for name, part in breakdown["parts"].items()
    ]
    screen.table("", ["where the time goes", "share", "a collision"], rows)
    often = breakdown["per_collision"]
    text = f"{often['stale_events']:.3g} stale events a collision"
    if not windows:
        text += (
            f", {often['list_renewals']:.3g} lists renewed singly, and all at once "
            f"{often['renewals_of_all_lists'] * 1e6:.3g} times in a million collisions"
        )
    screen.say(f"{text}; {breakdown['looks']} looks at what the loop is at")
    screen.say()


def _print_pressure(screen: Screen, summary: Mapping[str, Any]) -> None:
    z = Estimate(summary["compressibility_factor"], summary["compressibility_factor_error"])
    text = f"compressibility factor {z}"
    if summary["theory"] is None:
        text += ", no theory for this gas"
    else:
        expected, uncertainty = summary["theory"]["value"], summary["theory"]["uncertainty"]
        text += f", fluid in theory {expected:.4f} (z = {z.z(expected, uncertainty):+.1f})"
        if not summary["is_fluid"]:
            text += ": THIS GAS IS NOT THE EQUILIBRIUM FLUID"
    if summary["against"] is not None:
        text += f"; {summary['against']['name']} {summary['against']['compressibility_factor']:.4f}"
    screen.say(text)
