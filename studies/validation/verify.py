"""`hardspheres verify`: whether numbers from this machine are those of this version, to the last bit.

Four kinds of checks, from the strictest to the widest: digests of twenty gases (`golden`), small gases beside
the all-pairs solver and beside fifty digits, what every trajectory keeps, and error bars of the estimators.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import binding
from numpy.typing import NDArray
from scipy import stats

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation
from hardspheres.scene import to_nearest_image
from studies.options import option
from studies.program import Program
from studies.report import OutputFolder, Screen, machine
from studies.running.ensemble import replica_seeds
from studies.running.ownership import SUMMARY
from studies.validation import calibration_runs
from studies.validation.golden import COLLISIONS, GOLDEN, Golden, end_digest, start_digest
from studies.validation.hard_cases import reversal
from studies.validation.hard_cases.case import Case
from studies.validation.oracle import DIGITS, Oracle
from studies.validation.processor import compiled_for, vectors_of

__all__ = ["Found", "Verify", "digests_of", "verdict"]

SAME, STARTS = "ours", "THE START DIFFERS"
RUNS = 24
FALSE_ALARM = 1e-4
"""Probability that a right program on other seeds fails the calibration, all estimators together."""
SLACK = 1.1  # factor within which standard errors must be right: some are so only to first order
PARTED = 1e-7  # a larger deviation means that another event has happened


def _two_species(n: int) -> dict[str, Any]:
    odd = np.arange(n) % 2
    return {"radii": np.where(odd, 0.3, 0.5), "masses": np.where(odd, 1.0, 7.0)}


N = 20
# Packing fraction and collisions per particle: a third of those after which a rounding has grown to 1 %.
ORACLES: dict[str, tuple[float, float, dict[str, Any]]] = {
    "spheres": (0.1, 5.0, {}),
    "discs": (0.1, 3.0, {"dim": 2}),
    "slab of spheres": (0.1, 5.0, {"boundary": ("periodic", "wall", "periodic")}),
    "mixture of spheres": (0.02, 1.5, _two_species(N)),
    "mixture of discs between walls": (0.1, 3.0, {"dim": 2, "boundary": "wall"} | _two_species(N)),
}
QUICK_ORACLES = ("spheres", "mixture of discs between walls")


@dataclass(frozen=True)
class Found:
    """What a golden gas gave here.

    Attributes
    ----------
    name : str
        The gas.
    start : str
        Digest of its start.
    ends : dict
        Digest of its end by the search that was used; "none" where it did not get there.
    verdict : str
        "ours", or what differs.
    """

    name: str
    start: str
    ends: Mapping[str, str]
    verdict: str


def digests_of(golden: Golden) -> Found:
    """Run a golden gas with every search that it has, and compare."""
    scene = golden.make()
    start = start_digest(scene)
    ends, broken = {}, []
    for search in golden.searches:
        try:
            simulation = hs.Simulation(scene, search=search)
            simulation.run(collisions=COLLISIONS)
            ends[search] = end_digest(simulation)
            simulation.check()
        except hs.HardSpheresError as error:
            ends.setdefault(search, "none")
            broken.append(f"{search}: {error}")
    if broken:
        verdict = f"BROKEN, {'; '.join(broken)}"
    elif len({*ends.values()}) > 1:
        verdict = "THE SEARCHES DIFFER: lists and windows give other bits"
    elif start != golden.start:
        verdict = STARTS
    else:
        verdict = SAME if {*ends.values()} == {golden.end} else "THE DYNAMICS DIFFERS"
    return Found(golden.name, start, ends, verdict)


def _names(found: Sequence[Found]) -> str:
    return "; ".join(each.name for each in found)


def verdict(found: Sequence[Found], failures: Sequence[str]) -> str:
    """Return in one sentence what digests and failed checks say of this machine."""
    version, count = f"hardspheres {hs.__version__}", len(found)
    other = [each for each in found if each.verdict != SAME]
    started = [each for each in other if each.verdict == STARTS]
    moved = [each for each in other if each not in started]
    if moved:
        told = (
            f"{len(moved)} of {count} digests are not those of {version} ({_names(moved)}): the dynamics "
            "differs, so do not trust numbers from this machine"
        )
    elif started:
        told = (
            f"{len(started)} of {count} gases start elsewhere than those of {version} ({_names(started)}): "
            f"NumPy {np.__version__} draws other random numbers; the dynamics of the other "
            f"{count - len(started)} is ours to the last bit"
        )
    else:
        told = (
            f"All {count} digests are those of {version}: numbers from this machine are ours to the last bit"
        )
    if failures:
        which, checks = "; ".join(failures), "check" if len(failures) == 1 else "checks"
        told += f"{', but' if not other else ', and'} {len(failures)} other {checks} failed ({which})"
    return f"{told}."


@dataclass(frozen=True, kw_only=True)
class Verify(Program):
    """The checks of a machine."""

    name = "verify"
    question = "Are numbers from this machine those of this package, to the last bit?"
    explanation = f"""
    Runs twenty gases for {COLLISIONS} collisions with both searches and compares their digests with those
    kept in the package; follows small gases beside the all-pairs solver and beside {DIGITS} digits; tests
    what every trajectory keeps, and error bars against Student's t. Prints machine, processor and versions,
    and ends with exit code 1 where something differs. Nothing is written unless --out names a folder.
    """
    files = ()
    resumable = False
    only_if_asked = True

    quick: bool = option(False, "Eight gases, in fewer kinds: less to compile.")
    seed: int = option(
        1, "Of the gases behind invariants and error bars; digests have their own.", at_least=0
    )

    def folder(
        self, out: Path | None, checkpoint_every: float = 60.0, resume: bool = False, force: bool = False
    ) -> OutputFolder:
        """Return the folder of summary.json; none is made where it was not named."""
        return OutputFolder(out, force=force) if out else _Nowhere(Path())

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run all checks, print them and the verdict."""
        written = not isinstance(out, _Nowhere)
        if written:
            out.check(self, resumable=False)
        began = time.perf_counter()
        about = _machine()
        for name, value in about.items():
            screen.say(f"{name:11s} {value}")
        golden = [each for each in GOLDEN if each.quick or not self.quick]
        with screen.compiling("the gases to be compared"):
            _load(golden, self.quick)
        ready = time.perf_counter()
        with screen.working(f"{len(golden)} gases"):
            found = [digests_of(each) for each in golden]
        _print_digests(screen, found)
        with screen.working("checks of the engine and of the error bars"):
            cases = [*_oracles(self.quick), *_invariants(self.seed), *_calibration(self.quick, self.seed)]
        lines = [(c.name, c.exact, c.engine, "" if c.passed else "FAILED") for c in cases]
        screen.say()
        screen.table("", ("check", "what is right", "here", ""), lines, wrap=True)
        failures = [f"{case.name}: {case.engine}" for case in cases if not case.passed]
        told = verdict(found, failures)
        ended = time.perf_counter()
        screen.say()
        screen.say(f"{ended - ready:.0f} s, and {ready - began:.0f} s to compile and load the engine")
        screen.say(told)
        differing = [f"{each.name}: {each.verdict}" for each in found if each.verdict != SAME]
        summary: dict[str, Any] = {
            **self.made(),
            "seed": self.seed,
            "machine": machine() | about,
            "digests": [vars(each) for each in found],
            "cases": [{**vars(case), "passed": case.passed} for case in cases],
            "verdict": told,
            "checks": {"passed": not (differing or failures), "failures": differing + failures},
            "seconds": {"compilation": ready - began, "checks": ended - ready},
            "files": [SUMMARY] if written else [],
        }
        if written:
            out.create()
            out.write_json(SUMMARY, summary)
            screen.say(f"written to {out.path}: {SUMMARY}")
        return summary, not (differing or failures)


class _Nowhere(OutputFolder):
    """In place of a folder, where none was named."""


def _machine() -> dict[str, str]:
    known, target = machine(), compiled_for()
    llvm = ".".join(map(str, binding.llvm_version_info))
    return {
        "machine": f"{known['processor']}, {known['cores']} cores, {known['system']}",
        "compiled": f"for {target[1]}, vectors: {vectors_of(*target)}",
        "versions": f"Python {known['python']}, NumPy {np.__version__}, Numba {numba.__version__}, "
        f"LLVM {llvm}, hardspheres {hs.__version__}",
    }


def _load(golden: Sequence[Golden], quick: bool) -> None:
    """Compile all kernels; what fails is told later, when it fails again."""
    for each in golden:
        with contextlib.suppress(hs.HardSpheresError):
            scene = each.make()
            for search in each.searches:
                hs.Simulation(scene, search=search).run(collisions=1)
    if not quick:
        calibration_runs.FAMILIES["spheres"].load()


def _print_digests(screen: Screen, found: Sequence[Found]) -> None:
    rows = [
        (
            each.name,
            each.start,
            " ".join(dict.fromkeys(each.ends.values())),
            " ".join(each.ends),
            each.verdict,
        )
        for each in found
    ]
    screen.say()
    title = f"Digests of the start and after {COLLISIONS} collisions"
    screen.table(title, ("gas, packing fraction", "start", "end", "searches", "whose"), rows)


def _oracles(quick: bool) -> Iterator[Case]:
    for name, (fraction, s, more) in ORACLES.items():
        if name in QUICK_ORACLES or not quick:
            scene = hs.random_gas(n=N, packing_fraction=fraction, seed=7, **more)
            needed = round(s * N / 2)
            agreed = _same_events(scene, needed)
            exact = f"the {needed} collisions of the all-pairs solver"
            yield Case(f"{name}, {fraction:g}", exact, f"{agreed} agree", float(needed - agreed))
    scene = hs.random_gas(n=32, packing_fraction=0.2, seed=3)
    oracle, simulation = Oracle(scene), hs.Simulation(scene)
    oracle.advance(32)
    simulation.run(time=oracle.between())
    off = _deviation(simulation, *oracle.at(simulation.time)) if simulation.collisions == 32 else math.inf
    exact = f"the trajectory to {DIGITS} digits, after 32 collisions"
    yield Case("32 spheres, 0.2", exact, f"off by {off:.1e} diameters", off, 1e-12)


def _same_events(scene: hs.Scene, collisions: int) -> int:
    """Return for how many collisions a gas does what the all-pairs solver does."""
    simulation, reference = hs.Simulation(scene), ReferenceSimulation(scene)
    for agreed in range(collisions):
        walls, hits = simulation.wall_collisions, 0
        simulation.run(collisions=1)
        while reference.step().second >= scene.n:
            hits += 1
        late = abs(simulation.time - reference.time)
        off = _deviation(simulation, np.array(reference.positions), np.array(reference.velocities))
        if simulation.wall_collisions - walls != hits or not max(late, off) < PARTED:
            return agreed
    return collisions


def _deviation(
    simulation: hs.Simulation, positions: NDArray[np.float64], velocities: NDArray[np.float64]
) -> float:
    """Return the largest difference of positions, to the nearest image, and velocities."""
    dx = to_nearest_image(simulation.positions - positions, simulation.scene)
    return float(max(np.abs(dx).max(), np.abs(simulation.velocities - velocities).max()))


def _invariants(root: int) -> Iterator[Case]:
    simulation = hs.Simulation(hs.random_gas(n=500, packing_fraction=0.2, seed=root))
    simulation.run(collisions=200_000)
    status = simulation.status()
    for what in ("energy", "momentum"):
        drift = abs(status[f"{what}_drift"])
        yield Case(f"500 spheres, 0.2: {what}", "as at the start", f"changed by {drift:.1e}", drift, 1e-13)
    late = status["late_events"]
    yield Case("500 spheres, 0.2: order of events", "none out of order", f"{late}", float(late))
    off = reversal.return_error(reversal.gas(32, root), 4.0)
    yield Case("32 spheres, reversed after s = 4", "the start", f"{off:.1e} diameters from it", off, 1e-11)


def _calibration(quick: bool, root: int) -> Iterator[Case]:
    """Chi-square tests of deviations in standard errors, false alarms shared out evenly."""
    found = {}
    for family in ("series",) if quick else ("series", "spheres"):
        runs = [calibration_runs.measure((family, each)) for each in replica_seeds(root, RUNS)]
        for name, (truth, _) in calibration_runs.FAMILIES[family].truths.items():
            square = sum(run[name].z(truth) ** 2 for run in runs)
            low, high = stats.chi2.cdf(square * SLACK**2, RUNS), stats.chi2.sf(square / SLACK**2, RUNS)
            found[name] = 2.0 * float(min(low, high))
    least, worst = FALSE_ALARM / len(found), min(found, key=lambda name: found[name])
    yield Case(
        f"{len(found)} estimators, {RUNS} runs of each",
        f"errors as Student's t, to {SLACK - 1:.0%}: least p above {least:.0e} (false alarms: "
        f"{FALSE_ALARM:g} of all seeds)",
        f"least p {found[worst]:.2g} ({worst})",
        least / max(found[worst], 1e-300),
        1.0,
    )
