"""Finished runs of one study with different seeds, as one run of all their replicas."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from analysis.estimator import counted
from studies.options import OptionError, option
from studies.program import Program
from studies.report import OutputFolder, Screen
from studies.running.journal import difference
from studies.running.kept import REPLICAS, SEED, Finished, finished_run
from studies.study import results, show_results

__all__ = ["Combine"]


@dataclass(frozen=True, kw_only=True)
class Combine(Program):
    """What the replicas of several runs say together."""

    name = "combine"
    explanation = """
    Merges finished runs of one study that differ only in --seed and --replicas, perhaps from several
    machines: the answer is that of all their replicas together. Each DIR is the --out of a run whose replicas
    were kept, as they are while they are small. Writes what the study writes, but for what is recorded of a
    single run. To add replicas of the same seed, run the study again with more --replicas.
    """
    files = ()
    reports = True
    resumable = False

    runs: tuple[str, ...] = option(
        (), "Folders of finished runs.", argument=True, several=True, metavar="DIR"
    )

    @property
    def which(self) -> str:
        """The names of the folders, where they are few."""
        names = "-".join(Path(each).resolve().name for each in self.runs)
        return names if len(names) <= 60 else f"{len(self.runs)}-runs"

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Read all replicas, print what they say together, and write it."""
        began = time.perf_counter()
        if any(Path(each).resolve() == out.path.resolve() for each in self.runs):
            raise OptionError(f"--out {out.path} is one of the runs to be combined; give another folder")
        with screen.working("reading the replicas of all runs"):
            runs = sorted((finished_run(Path(each)) for each in self.runs), key=lambda run: run.study.seed)
        _check(runs)
        total = sum(run.study.replicas for run in runs)
        study = replace(runs[0].study, replicas=total)
        out.check(study, resumable=False)
        out.create()
        gases = zip(*(run.replicas for run in runs), strict=True)
        replicas = [[one for own in of_gas for one in own] for of_gas in gases]

        def conclude(summary: dict[str, Any]) -> str:
            each_own = ("seed", "replicas")
            same = {name: value for name, value in summary["options"].items() if name not in each_own}
            summary |= {"of": summary["study"], "of_options": same, **self.made()}
            summary |= {"seed": [run.study.seed for run in runs], "options": {"runs": self.runs}}
            summary["combined"] = [
                {"run": run.path, "seed": run.study.seed, "replicas": run.study.replicas} for run in runs
            ]
            each = [
                f"{run.path} (seed {run.study.seed}, {counted(run.study.replicas, 'replica')})"
                for run in runs
            ]
            return f"combined from {', '.join(each)}"

        ready = time.perf_counter()
        found = results(study, replicas, out, screen, (began, ready, ready), conclude=conclude)
        show_results(study, found, out, screen, earlier=True)
        return found.summary, bool(found.summary["checks"]["passed"])


def _check(runs: Sequence[Finished]) -> None:
    """Raise OptionError unless these are several runs of one study, with as many seeds."""
    if len(runs) < 2:
        raise OptionError(f"{runs[0].path} alone is nothing to combine; name the folders of two or more runs")
    first = runs[0]
    if first.study.not_extendable:
        raise OptionError(f"{first.path} holds a run {first.study.not_extendable}; it cannot be combined")
    for before, run in itertools.pairwise(runs):
        if other := difference(_about(run), _about(first)):
            raise OptionError(
                f"{run.path} holds a run {other} as {first.path}; combine runs that differ in {SEED} only"
            )
        both = f"{before.path} and {run.path}"
        if before.path.resolve() == run.path.resolve():
            raise OptionError(f"{run.path} is named twice, and would count twice; name each run once")
        if before.study.seed == run.study.seed:
            raise OptionError(
                f"{both} both have {SEED} {run.study.seed}, so that the same replicas would count twice; "
                f"extend one of them by more {REPLICAS} instead"
            )
    seen: dict[str, Finished] = {}
    for run in runs:
        for replica in itertools.chain.from_iterable(run.replicas):
            other_run = seen.setdefault(replica.digest, run)
            if other_run is not run:
                raise OptionError(
                    f"{other_run.path} and {run.path} hold the same replica, bit for bit, which would count "
                    "twice; combine independent runs"
                )


def _about(run: Finished) -> dict[str, Any]:
    """Return what must be the same in all runs."""
    options = {name: value for name, value in run.about["options"].items() if name != SEED}
    return {**run.about, "options": options}
