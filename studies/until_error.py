"""A study with a target precision: a pilot determines the number of replicas, and all of them are run.

A run that stops as soon as its own error is small enough is biased: it stops too early where the error
happens to be underestimated. Here only the pilot decides; its gases are not those of the study, and its
measurements are not part of the result.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import gammaincinv

import hardspheres as hs
from studies.report import OutputFolder, Screen
from studies.study import conduct

__all__ = ["MOST", "Plan", "Quiet", "check_target", "main_numbers", "until_error"]

MOST = 1000
"""A study is not made longer than this many times the pilot."""
PILOT = 20  # replicas at most
LEAST = 4  # replicas at least: errors come from their spread
CONFIDENCE = 0.9  # that the true spread is no larger than its bound from the pilot

Run = Callable[..., tuple[dict[str, Any], bool]]


@dataclass(frozen=True)
class Number:
    """A main number of a study: its name, relative standard error, and degrees of freedom of that error."""

    name: str
    relative_error: float
    degrees_of_freedom: float


def main_numbers(summary: Mapping[str, Any]) -> list[Number]:
    """Return the main numbers of a study, by which its precision is measured: those that its answers name.

    Parameters
    ----------
    summary : dict
        The content of summary.json.

    Raises
    ------
    SceneError
        If there is none.
    """
    found, states = [], summary["states"]
    for state in states:
        if isinstance(state["main"], str):
            raise hs.SceneError(f"--until-error needs {state['main']}")
        where = f" at packing fraction {state['packing_fraction']:g}" if len(states) > 1 else ""
        found += [
            _number(each["quantity"] + where, each)
            for each in state["measured"]
            if each["quantity"] in state["main"]
        ]
    return found


def _number(name: str, found: Mapping[str, float]) -> Number:
    return Number(name, abs(found["standard_error"] / found["value"]), found["degrees_of_freedom"])


@dataclass(frozen=True)
class Plan:
    """The number of replicas for a precision.

    Attributes
    ----------
    number : Number
        Of the pilot, the one that takes most.
    needed : int
        Replicas.
    allowed : int
        How many of them are run.
    """

    number: Number
    needed: int
    allowed: int

    @classmethod
    def of(cls, numbers: list[Number], replicas: int, target: float) -> Plan:
        """Return the plan that follows from a pilot of so many replicas.

        The error falls as the root of their number. The pilot's own error s is uncertain: f s^2 / sigma^2
        follows chi-square with its f degrees of freedom, and the upper bound of sigma at `CONFIDENCE` is used
        in place of s.
        """

        def careful(number: Number) -> float:
            freedom = min(number.degrees_of_freedom, 1e6)
            quantile = 2.0 * float(gammaincinv(0.5 * freedom, 1.0 - CONFIDENCE))  # of chi-square
            return number.relative_error * math.sqrt(freedom / quantile)

        worst = max(numbers, key=careful)
        error = careful(worst)
        if not math.isfinite(error):
            raise hs.SceneError(
                f"--until-error: the pilot gave {worst.name} no error bar; ask for more --replicas"
            )
        needed = max(LEAST, math.ceil(replicas * (error / target) ** 2))
        return cls(worst, needed, min(needed, MOST * replicas))


class Quiet(Screen):
    """A screen that shows the progress of a part of what another one is about, and prints no results."""

    def __init__(self, screen: Screen) -> None:
        super().__init__(screen.json_output)
        self.told = screen.told

    def say(self, text: str = "") -> None:
        """Print nothing."""

    def table(self, *_: Any, **__: Any) -> None:
        """Show nothing."""


def check_target(target: float) -> None:
    """Raise SceneError where a target is no relative standard error."""
    if not 0.0 < target < 1.0:
        raise hs.SceneError(
            f"--until-error {target:g} must be between 0 and 1: a relative standard error, such as 1e-3"
        )


def until_error(
    study: Any, target: float, out: OutputFolder, screen: Screen, run: Run = conduct
) -> tuple[dict[str, Any], bool]:
    """Run a study with as many replicas as its main number needs for a relative standard error.

    Parameters
    ----------
    study : Study
        What to do. Its `replicas`, but at most 20, are those of the pilot.
    target : float
        Relative standard error asked for.
    out : OutputFolder
        Where the files go.
    screen : Screen
        Where results and progress are shown.
    run : callable
        What runs a study: `studies.study.conduct`.

    Returns
    -------
    summary : dict
        The content of summary.json, with "until_error" added.
    sound : bool
        What the study says; a precision that was not reached does not count.

    Raises
    ------
    HardSpheresError
        As the study does; if it has no main number; if the target is not between 0 and 1.
    """
    check_target(target)
    itself = study.to_precision(target)
    if itself is not None:
        return run(itself, out, screen)
    out.check(study, replicas=False)
    seed = int(np.random.SeedSequence([study.seed, 1]).generate_state(1)[0])
    pilot = replace(study, replicas=min(study.replicas, PILOT), seed=seed)
    with _scratch() as folder:
        tried, _ = run(pilot, folder, Quiet(screen), record=False)
    plan = Plan.of(main_numbers(tried), pilot.replicas, target)
    times = plan.allowed / pilot.replicas
    screen.note(
        f"pilot: {pilot.replicas} replicas give {plan.number.name} to {plan.number.relative_error:.2g}; "
        f"running {plan.allowed}, about {_core_seconds(tried) * times:.0f} s of processor time"
    )

    def conclude(summary: dict[str, Any]) -> str:
        worst = max(main_numbers(summary), key=lambda number: number.relative_error)
        summary["until_error"] = {
            "asked": target,
            "number": worst.name,
            "relative_error": worst.relative_error,
            "reached": worst.relative_error <= target,
            "pilot_relative_error": plan.number.relative_error,
            "pilot_replicas": pilot.replicas,
            "replicas_needed": plan.needed,
            "replicas": plan.allowed,
            "core_seconds": {"pilot": _core_seconds(tried), "study": _core_seconds(summary)},
            "collisions": {"pilot": tried["collisions"], "study": summary["collisions"]},
        }
        return _verdict(summary["until_error"], plan)

    return run(replace(study, replicas=plan.allowed), out, screen, conclude=conclude)


@contextmanager
def _scratch() -> Iterator[OutputFolder]:
    with tempfile.TemporaryDirectory() as folder:
        try:
            yield OutputFolder(Path(folder) / "pilot", keep=False)
        except BaseException as error:
            if hasattr(error, "__notes__"):  # a pilot cannot be resumed
                error.__notes__ = [note for note in error.__notes__ if folder not in note]
            raise


def _core_seconds(summary: Mapping[str, Any]) -> float:
    """Processor time of the replicas, estimated from wall time."""
    return float(summary["collisions"] / summary["collisions_per_second_and_core"])


def _verdict(found: Mapping[str, Any], plan: Plan) -> str:
    spent, collisions = found["core_seconds"], found["collisions"]
    cost = (
        f"{found['replicas']} replicas, {collisions['study']:.3g} collisions, {spent['study']:.0f} s on one "
        f"core; the pilot took {spent['pilot']:.0f} s, chose that number, and is not in the result"
    )
    text = (
        f"{found['number']}: relative standard error {found['relative_error']:.2g}, "
        f"asked for {found['asked']:.2g}"
    )
    if found["reached"]:
        return f"{text}: reached with {cost}"
    if plan.needed > plan.allowed:
        return (
            f"{text}: NOT reached: that needs about {plan.needed} replicas, and no more than {plan.allowed} "
            f"({MOST} times the pilot) are run; ask for more --replicas or longer ones. Spent: {cost}"
        )
    return f"{text}: just missed, as expected now and then since the error is itself uncertain; {cost}"
