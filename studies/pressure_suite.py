"""Equations of state of spheres, discs and mixtures in one run, to one precision: the reference figures.

`hardspheres pressure --suite --until-error 1e-3` takes a minute or two, with 1e-4 an hour or more.
"""

from __future__ import annotations

import datetime
import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import hardspheres as hs
from studies.benchmarks.clock import machine
from studies.fluid import Fluid, load_kernels, run_fluids
from studies.pressure import (
    EquationOfState,
    State,
    States,
    columns,
    combine,
    print_states,
    say_notes,
    state_summary,
)
from studies.report import ALARM, OutputFolder, Screen, checks_of, engine_rate, say_checks, seconds_taken
from studies.running.ensemble import available_cores
from studies.running.journal import Shelf

__all__ = ["GROUPS", "Suite", "run_suite", "states_of"]

SPHERES = tuple(Fluid(packing_fraction=eta) for eta in np.linspace(0.01, 0.49, 9).round(12).tolist())
DISCS = tuple(Fluid(dim=2, packing_fraction=eta) for eta in (0.1, 0.25, 0.4, 0.55, 0.65))
MIXTURES = (
    Fluid(
        packing_fraction=0.3, mass_ratio=10.0
    ),  # Z does not depend on masses: the theory is that of one species
    Fluid(packing_fraction=0.3, diameter_ratio=2.0, mass_ratio=10.0),
    Fluid(dim=2, packing_fraction=0.5, diameter_ratio=1.4),
)
GROUPS = {"spheres": SPHERES, "discs": DISCS, "mixtures": MIXTURES}


@dataclass(frozen=True)
class Suite:
    """Options of the suite, as on the command line (`hardspheres pressure --suite`).

    Attributes
    ----------
    study : EquationOfState
        Precision, replicas, seed and workers; its packing fractions and fluid are not used.
    groups : dict of tuple of Fluid
        What to measure.
    """

    study: EquationOfState
    groups: dict[str, tuple[Fluid, ...]] = field(default_factory=lambda: dict(GROUPS))


def states_of(suite: Suite, screen: Screen, shelf: Shelf) -> tuple[dict[str, list[State]], list[Any]]:
    """Measure all fluids.

    Returns
    -------
    states : dict of list of State
        By group.
    runs : list
        All replicas of all fluids.
    """
    study = suite.study
    fluids = [fluid for group in suite.groups.values() for fluid in group]
    results = run_fluids(
        States(study),
        fluids,
        seed=study.seed,
        replicas=study.replicas,
        workers=study.workers,
        screen=screen,
        shelf=shelf,
    )
    states = [combine(fluid, own) for fluid, own in zip(fluids, results, strict=True)]
    grouped, first = {}, 0
    for name, group in suite.groups.items():
        grouped[name] = states[first : first + len(group)]
        first += len(group)
    return grouped, [run for own in results for run in own]


def load_all(suite: Suite) -> None:
    """Compile or load every kernel that the suite needs."""
    kinds: dict[Fluid, list[Fluid]] = {}
    for group in suite.groups.values():
        for fluid in group:
            kinds.setdefault(replace(fluid, packing_fraction=0.1), []).append(fluid)
    for fluids in kinds.values():
        load_kernels(fluids, free_paths=fluids[0].mixed)


def _in_words(suite: Suite) -> str:
    sizes = {fluid.n for group in suite.groups.values() for fluid in group}
    return (
        f"{suite.study.replicas} x {' or '.join(str(n) for n in sorted(sizes))} particles each, periodic box"
    )


def run_suite(suite: Suite, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    """Run the suite, print its tables and write its files.

    Parameters
    ----------
    suite : Suite
        What to do.
    out : OutputFolder
        Where the files go.
    screen : Screen
        Where results and progress are shown.

    Returns
    -------
    summary : dict
        The content of summary.json.
    sound : bool
        Whether every state is a fluid that agrees with theory to 5 standard errors, and conserves energy and
        momentum.

    Raises
    ------
    HardSpheresError
        If a gas cannot be made, or the folder cannot be written.
    """
    began = time.perf_counter()
    study = suite.study
    study.check()
    out.check(suite)
    with screen.compiling("spheres, discs and mixtures"):
        load_all(suite)
    ready = time.perf_counter()
    with out.running(suite) as shelf:
        groups, runs = states_of(suite, screen, shelf)
        ran = time.perf_counter()
        states = [state for group in groups.values() for state in group]
        out.write_csv("equation_of_state.csv", columns(states))
        from studies.figures.pressure_suite import figure

        with screen.working("drawing"):
            out.save_figure("equation_of_state.png", figure(groups), _in_words(suite))
        failures = [
            f"{state.fluid}, packing fraction {state.fluid.packing_fraction:g}: {failure}"
            for state in states
            for failure in state.failures
        ]
        statuses = [run.status for run in runs]
        collisions = sum(state.collisions for state in states)
        summary = {
            "study": "pressure",
            "version": hs.__version__,
            "seed": study.seed,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "machine": machine(),
            "options": {
                "suite": True,
                "precision": study.precision,
                "collisions_per_particle": study.collisions_per_particle,
                "replicas": study.replicas,
            },
            "workers": available_cores() if study.workers is None else study.workers,
            "states": {
                name: [{"fluid": str(state.fluid)} | state_summary(state) for state in group]
                for name, group in groups.items()
            },
            "collisions": collisions,
            "collisions_per_second_and_core": collisions / sum(run.seconds for run in runs),
            "engine_collisions_per_second": engine_rate(statuses),
            "checks": checks_of(statuses, failures) | {"alarm_in_standard_errors": ALARM},
            "files": sorted({*out.files, "summary.json"}),
            "seconds": seconds_taken(began, ready, ran, work="runs"),
        }
        out.write_json("summary.json", summary)
    for name, group in groups.items():
        for kind in [group] if name != "mixtures" else [[state] for state in group]:
            print_states(screen, f"{study.replicas} x {kind[0].fluid}", kind)
    say_notes(screen, states)
    if study.precision is not None:
        worst = max(z.standard_error / z.value for state in states for z in state.measured.values())
        screen.say(f"relative standard error of Z: {worst:.2g} at most, asked for {study.precision:.2g}")
    say_checks(screen, summary, out)
    return summary, not failures
