"""How many collisions per second: of an equilibrated gas, the event loop alone, in many short windows, beside a peer.

What is timed is `Simulation.run(collisions=...)` and nothing else, after the kernels are compiled and loaded, after the
gas is in equilibrium, and after at least ten collisions per particle (neighbour lists run up to three times too
fast until they begin to expire). Times are of the processor and of the wall; on a machine that does other things the
first are the ones to compare. A peer runs in turn with us, window by window, in the same process on the same core.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.statistics import Estimate
from studies.bench_gas import STARTS, Gas
from studies.bench_peer import Spheropack, fastest_published, require_peer, yardstick
from studies.report import OutputFolder, Screen

__all__ = ["Bench", "Timing", "Windows", "bench", "measure"]

FloatArray = NDArray[np.float64]

WINDOWS = 20
WINDOW_SECONDS = 0.2  # of processor time, where the number of collisions is not given
WARM = 20_000  # collisions of start-up at least, however small the gas
PEER_DISCARDED = 2.0  # collisions per particle; spheropack's rate shows no start-up
MEMORY_FROM = 30_000  # particles from which the growth of resident memory says something


@dataclass(frozen=True)
class Bench:
    """Options of the study, as on the command line (`hardspheres bench --help`)."""

    gas: Gas
    collisions: int | None = None
    discard: float | None = None
    against: str | None = None
    seed: int = 1
    window_seconds: float = WINDOW_SECONDS


@dataclass
class Windows:
    """Short stretches of a run with the time each took.

    Attributes
    ----------
    collisions : list of int
        Pair collisions in each.
    wall, cpu : list of float
        Seconds on the wall, and of the processor.
    """

    collisions: list[int] = field(default_factory=list)
    wall: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def time(self, runner: Runner, collisions: int) -> None:
        """Run for so many collisions, or about so many, and note what it took."""
        before = runner.collisions
        cpu, wall = time.process_time(), time.perf_counter()
        runner.run(collisions)
        took = time.perf_counter() - wall, time.process_time() - cpu
        self.collisions.append(runner.collisions - before)
        self.wall.append(took[0])
        self.cpu.append(took[1])

    @property
    def cpu_rates(self) -> FloatArray:
        """Collisions per second of processor time, one per window."""
        return np.array(self.collisions) / np.maximum(self.cpu, 1e-9)

    @property
    def wall_rates(self) -> FloatArray:
        """Collisions per second on the wall, one per window."""
        return np.array(self.collisions) / np.maximum(self.wall, 1e-9)


class Runner(Protocol):
    """What can be timed: our simulation, or a peer."""

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""

    def run(self, collisions: int) -> None:
        """Advance by so many pair collisions, or about so many."""


class Ours:
    """Our simulation as a `Runner`."""

    def __init__(self, simulation: hs.Simulation) -> None:
        self.simulation = simulation

    @property
    def collisions(self) -> int:
        """Pair collisions since the start."""
        return self.simulation.collisions

    def run(self, collisions: int) -> None:
        """Advance by so many pair collisions."""
        self.simulation.run(collisions=collisions)


@dataclass(frozen=True)
class Timing:
    """What a set of windows says, in collisions per second.

    Attributes
    ----------
    median, best, lower_quartile, upper_quartile : float
        Over the windows.
    standard_error : float
        Of the mean over the windows.
    """

    median: float
    best: float
    lower_quartile: float
    upper_quartile: float
    standard_error: float

    @classmethod
    def of(cls, rates: FloatArray) -> Timing:
        """Return the timing of windows with these rates."""
        low, middle, high = np.quantile(rates, [0.25, 0.5, 0.75])
        error = np.std(rates, ddof=1) / np.sqrt(len(rates)) if len(rates) > 1 else np.nan
        return cls(float(middle), float(np.max(rates)), float(low), float(high), float(error))


def bench(study: Bench, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Time one gas, print the result and write summary.json and windows.csv.

    Parameters
    ----------
    study : Bench
        What to do.
    out : OutputFolder
        Where the files go; made only after the gas has run.
    screen : Screen
        Where results and progress are shown.

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
    out.check()
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
    _check(study)
    clock = [time.process_time()]
    load_kernels(gas)
    clock.append(time.process_time())
    memory = Memory()
    scene = gas.scene(study.seed)
    clock.append(time.process_time())
    memory.forget_peak()
    simulation = hs.Simulation(scene)
    clock.append(time.process_time())
    discarded, rate = start_up(simulation, gas.discarded if study.discard is None else study.discard)
    clock.append(time.process_time())
    bytes_grown = memory.peak_growth()

    opponents = _opponents(study, simulation)
    window = study.collisions or max(WINDOWS, round(WINDOWS * study.window_seconds * rate))
    sizes = [part for part in _split(window, WINDOWS) if part]
    simulation.reset_tallies()
    ours, z = Windows(), []
    for size in sizes:
        ours.time(Ours(simulation), size)
        z.append(_virial(simulation))
        for opponent in opponents:
            opponent.windows.time(
                opponent.runner, max(1, round(opponent.rate * sum(ours.cpu) / len(ours.cpu)))
            )

    status = simulation.status()
    pressure = _pressure(simulation, z)
    theory = gas.theory(scene)
    timing = Timing.of(ours.cpu_rates)
    names = ("kernels", "scene", "engine", "start_up")
    result: dict[str, Any] = {
        "n": scene.n,
        "dim": scene.dim,
        "packing_fraction": scene.packing_fraction,
        "boundary": list(scene.boundary),
        "diameter_ratio": gas.diameter_ratio,
        "fraction": gas.fraction if gas.diameter_ratio != 1.0 else None,
        "start": gas.describe_start(),
        "method": status["method"],
        "discarded_collisions": discarded,
        "discarded_collisions_per_particle": 2.0 * discarded / scene.n,
        "collisions": sum(ours.collisions),
        "windows": len(sizes),
        "seconds": sum(ours.wall),
        "cpu_seconds": sum(ours.cpu),
        "collisions_per_second": sum(ours.collisions) / sum(ours.wall),
        "cpu": asdict(timing),
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
        "checks": _checks(simulation),
        "setup_cpu_seconds": dict(zip(names, np.diff(clock).tolist(), strict=True)),
        "against": None,
        "engine": status,
    }
    columns = {"collisions": ours.collisions, "seconds": ours.wall, "cpu_seconds": ours.cpu}
    if opponents:
        result["against"] = _compare(study, timing, ours, opponents)
        rows = opponents[0].windows
        columns |= {
            "peer_collisions": rows.collisions,
            "peer_seconds": rows.wall,
            "peer_cpu_seconds": rows.cpu,
        }
    return result, {name: np.array(column) for name, column in columns.items()}


def _check(study: Bench) -> None:
    if study.gas.start not in STARTS:
        raise hs.SceneError(f"--start {study.gas.start} is not known; it can be {', '.join(STARTS)}")
    if study.collisions is not None and study.collisions < 1:
        raise hs.SceneError(f"--collisions {study.collisions} must be at least 1")
    if study.discard is not None and study.discard < 0:
        raise hs.SceneError(f"--discard {study.discard:g} must be at least 0")
    if not study.gas.diameter_ratio > 0:
        raise hs.SceneError(f"--diameter-ratio {study.gas.diameter_ratio:g} must be positive")
    if study.against is not None:
        require_peer(study.against)


def load_kernels(gas: Gas) -> None:
    """Compile or load what this kind of gas needs, by running a small one."""
    limit = {2: 0.4, 3: 0.25}.get(gas.dim, 1.0)  # of the same kind, quickly placed at random
    density = min(gas.packing_fraction, limit)
    small = Gas(2000, gas.dim, density, gas.boundary, gas.diameter_ratio, gas.fraction)
    hs.Simulation(small.scene(1)).run(collisions=1)


def start_up(simulation: hs.Simulation, collisions_per_particle: float) -> tuple[int, float]:
    """Run and forget.

    Returns
    -------
    discarded : int
        Pair collisions run.
    rate : float
        Collisions per second of processor time towards the end.
    """
    first = max(round(collisions_per_particle * simulation.scene.n / 4), WARM // 2)
    last = Windows()
    simulation.run(collisions=first)
    last.time(Ours(simulation), first)
    return 2 * first, float(last.cpu_rates[0])


class Memory:
    """Growth of this process's resident memory since the object was made; known on Linux only."""

    def __init__(self) -> None:
        self.before = self._read("VmRSS")

    @staticmethod
    def _read(name: str) -> int | None:
        try:
            lines = Path("/proc/self/status").read_text().splitlines()
        except OSError:
            return None
        return next((1024 * int(line.split()[1]) for line in lines if line.startswith(name + ":")), None)

    @staticmethod
    def forget_peak() -> None:
        """Let the peak begin anew at what is resident now: what made the scene is freed again."""
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:
            return

    def peak_growth(self) -> int | None:
        """Return by how many bytes the peak lies above what was resident in the beginning."""
        peak = self._read("VmHWM")
        return None if peak is None or self.before is None else peak - self.before


@dataclass
class _Opponent:
    """A peer's runner, its rough rate, and its windows."""

    runner: Spheropack
    rate: float
    windows: Windows = field(default_factory=Windows)


def _opponents(study: Bench, simulation: hs.Simulation) -> list[_Opponent]:
    """Return the peer on the same gas and, where another is needed, on the gas that is the yardstick."""
    if study.against is None:
        return []
    opponents = [_opponent(simulation)]
    stick = yardstick(study.gas.n, study.gas.packing_fraction)
    if stick is not None and (study.gas.n, stick.packing_fraction) != (4000, study.gas.packing_fraction):
        other = hs.Simulation(Gas(packing_fraction=stick.packing_fraction).scene(study.seed))
        start_up(other, Gas(packing_fraction=stick.packing_fraction).discarded)
        opponents.append(_opponent(other))
    return opponents


def _opponent(simulation: hs.Simulation) -> _Opponent:
    tallies = simulation.tallies
    runner = Spheropack(simulation.to_scene(), tallies.collisions / tallies.time)
    first = Windows()
    runner.run(max(round(PEER_DISCARDED * simulation.scene.n / 4), WARM // 8))
    first.time(runner, max(round(PEER_DISCARDED * simulation.scene.n / 4), WARM // 8))
    runner.reset()
    return _Opponent(runner, float(first.cpu_rates[0]))


def _compare(study: Bench, timing: Timing, ours: Windows, opponents: Sequence[_Opponent]) -> dict[str, Any]:
    """Return the ratio of our rates to the peer's, by processor time, and the estimate for the fastest code."""
    peer, last = opponents[0], opponents[-1]
    rates = peer.windows.cpu_rates
    theirs = Timing.of(rates)
    result: dict[str, Any] = {
        "name": peer.runner.name,
        "version": peer.runner.version,
        "collisions": sum(peer.windows.collisions),
        "cpu": asdict(theirs),
        "wall": asdict(Timing.of(peer.windows.wall_rates)),
        "compressibility_factor": peer.runner.compressibility_factor,
        "ratio_of_medians": timing.median / theirs.median,
        "ratio_of_bests": timing.best / theirs.best,
        "ratio_quartiles": np.quantile(ours.cpu_rates / rates, [0.25, 0.75]).tolist(),
        "fastest_published": None,
    }
    stick = yardstick(study.gas.n, study.gas.packing_fraction)
    if stick is not None:
        at = Timing.of(last.windows.cpu_rates)
        result["fastest_published"] = {
            "estimated": True,
            "doi": "10.1140/epje/s10189-022-00180-8",
            "yardstick_packing_fraction": stick.packing_fraction,
            "factor": stick.factor,
            "collisions_per_second": fastest_published(stick, at.median),
            "ratio_of_medians": timing.median / fastest_published(stick, at.median),
            "ratio_of_bests": timing.best / fastest_published(stick, at.best),
        }
    return result


def _split(total: int, parts: int) -> list[int]:
    """Return whole numbers that add up to the total, as equal as can be."""
    return [total // parts + (k < total % parts) for k in range(parts)]


def _virial(simulation: hs.Simulation) -> tuple[float, float]:
    """Return time and virial since the tallies began."""
    tallies = simulation.tallies
    return tallies.time, float(np.trace(tallies.virial))


def _pressure(simulation: hs.Simulation, cumulative: Sequence[tuple[float, float]]) -> Estimate:
    """Return the compressibility factor over the timed run, its error from the spread of four stretches or more.

    Windows of a large gas are too short to be independent, so neighbours are taken together.
    """
    times, virials = np.array([(0.0, 0.0), *cumulative]).T
    stretches = min(5, len(cumulative))
    edges = np.linspace(0, len(cumulative), stretches + 1).round().astype(int)
    rates = np.diff(virials[edges]) / np.diff(times[edges]) / (2.0 * simulation.thermal_energy)
    error = np.std(rates, ddof=1) / np.sqrt(stretches) if stretches > 1 else np.nan
    return Estimate(simulation.compressibility_factor, float(error), stretches)


def _agree(measured: float, expected: float, collisions: int) -> bool:
    """Whether a compressibility factor is the fluid's to 3 % of Z - 1, and the noise of so many collisions."""
    return abs(measured - expected) < (0.03 + 5.0 / np.sqrt(collisions)) * (expected - 1.0)


def _checks(simulation: hs.Simulation) -> dict[str, Any]:
    try:
        simulation.check()
    except hs.InvariantError as error:
        return {"passed": False, "failures": [str(error)]}
    return {"passed": True, "failures": []}


def machine() -> dict[str, Any]:
    """Return what the figures were measured on."""
    import numba

    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), model)
    except OSError:
        pass
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
    }


def _print(screen: Screen, summary: Mapping[str, Any]) -> None:
    kind = "spheres" if summary["dim"] == 3 else "discs"
    words = summary["boundary"]
    box = words[0] if len(set(words)) == 1 else ", ".join(words)
    mixture = f", diameters 1:{summary['diameter_ratio']:g}" if summary["diameter_ratio"] != 1.0 else ""
    screen.say(
        f"{summary['n']} hard {kind}{mixture}, packing fraction {summary['packing_fraction']:.4g}, {box} box, "
        f"start: {summary['start']}"
    )
    screen.say(
        f"method: {summary['method']}; discarded {summary['discarded_collisions']} collisions "
        f"({summary['discarded_collisions_per_particle']:.3g} per particle), then timed {summary['collisions']} in "
        f"{summary['windows']} windows: {summary['cpu_seconds']:.2f} s of the processor, {summary['seconds']:.2f} s on the wall"
    )
    screen.say()
    rows = [_row("hardspheres, processor", summary["cpu"]), _row("hardspheres, wall", summary["wall"])]
    against = summary["against"]
    if against is not None:
        name = f"{against['name']} {against['version']}"
        rows += [_row(f"{name}, processor", against["cpu"]), _row(f"{name}, wall", against["wall"])]
    screen.table("", ["collisions per second", "median", "best", "quartiles", "error of mean"], rows)
    screen.say()
    if against is not None:
        _print_ratio(screen, against)
    _print_pressure(screen, summary)
    resident = summary["resident_bytes_per_particle"]
    grown = "" if resident is None else f" in the engine's arrays; resident memory grew by {resident:.0f}"
    setup = summary["setup_cpu_seconds"]
    screen.say(f"{summary['bytes_per_particle']:.0f} bytes per particle{grown}")
    screen.say(
        "processor time of setting up: "
        + ", ".join(f"{name.replace('_', '-')} {seconds:.2f} s" for name, seconds in setup.items())
    )
    screen.say(f"energy drift {summary['energy_drift']:.1e}, late events {summary['late_events']}")
    for failure in summary["checks"]["failures"]:
        screen.say(f"CHECK FAILED, {failure}")
    if summary["seconds"] > 1.15 * summary["cpu_seconds"]:
        screen.note("the machine did other things meanwhile: compare processor times, or measure again")


def _row(name: str, timing: Mapping[str, float]) -> list[str]:
    low, high = timing["lower_quartile"], timing["upper_quartile"]
    values = [_rate(timing["median"]), _rate(timing["best"]), f"{_rate(low)} to {_rate(high)}"]
    return [name, *values, _rate(timing["standard_error"])]


def _rate(rate: float) -> str:
    return f"{rate:,.0f}"


def _print_ratio(screen: Screen, against: Mapping[str, Any]) -> None:
    low, high = against["ratio_quartiles"]
    screen.say(
        f"{against['ratio_of_medians']:.2f} times {against['name']} by medians, {against['ratio_of_bests']:.2f} by best "
        f"windows; quartiles of neighbouring windows {low:.2f} to {high:.2f} (processor time, in turn)"
    )
    best = against["fastest_published"]
    if best is None:
        screen.say("no estimate for the fastest published C code: it was not measured at this state")
    else:
        screen.say(
            f"estimate: {best['ratio_of_medians']:.2f} times the fastest published C code (doi {best['doi']}), taken as "
            f"{best['factor']:.3g} times {against['name']} at N = 4000 and packing fraction "
            f"{best['yardstick_packing_fraction']:g}; good to 15-20 %"
        )


def _print_pressure(screen: Screen, summary: Mapping[str, Any]) -> None:
    z = Estimate(summary["compressibility_factor"], summary["compressibility_factor_error"])
    text = f"compressibility factor {z}"
    if summary["theory"] is None:
        text += ", no theory for this gas"
    else:
        expected, uncertainty = summary["theory"]["value"], summary["theory"]["uncertainty"]
        text += f", fluid in theory {expected:.4f} (z = {z.deviation(expected, uncertainty):+.1f})"
        if not summary["is_fluid"]:
            text += ": THIS GAS IS NOT THE EQUILIBRIUM FLUID"
    if summary["against"] is not None:
        text += f"; {summary['against']['name']} {summary['against']['compressibility_factor']:.4f}"
    screen.say(text)
