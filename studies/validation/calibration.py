"""Calibration of error bars: every estimator over many independent short runs, beside the true value.

(value - truth) / standard error should follow Student's t with the degrees of freedom that the estimator
quotes. The true value is exact, or from a theory much more precise than a single run; otherwise it is the
mean of all runs, which tests spread and shape but not the value.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.calibration import Calibration, calibrate
from analysis.statistics import Estimate
from studies.answer import Section, Table, say_sections
from studies.options import MANY, executor, option, seed, workers
from studies.page import Report, write_page
from studies.program import Program
from studies.report import OutputFolder, Screen, seconds_taken
from studies.running.ensemble import replica_seeds, run_replicas
from studies.running.executors import executor_of, number_of_workers
from studies.running.ownership import REPORT, SUMMARY
from studies.validation import calibration_runs

__all__ = ["Calibrations", "Row", "rows_of"]

FloatArray = NDArray[np.float64]

FEWEST_RUNS = 20


@dataclass(frozen=True, kw_only=True)
class Calibrations(Program):
    """Every estimator over many short runs.

    Attributes
    ----------
    families : tuple of str
        Which kinds of runs, of `studies.validation.calibration_runs.FAMILIES`; all by default.
    """

    name = "calibration"
    question = "Are the error bars right?"
    explanation = """
    It should follow Student's t with the degrees of freedom that the estimator quotes. Writes a summary, a
    table and a picture.
    """
    files = ("calibration.csv", "calibration.png")
    reports = True

    runs: int = option(200, "Independent short runs of each estimator.", at_most=MANY)
    seed: int = seed()
    workers: int | None = workers()
    executor: str | Executor | None = executor()
    families: tuple[str, ...] = tuple(calibration_runs.FAMILIES)

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run it; sound where every estimator is calibrated, see `Calibration.passed`."""
        return _calibrate(self, out, screen)

    def check(self) -> None:
        """Raise SceneError for options that make no sense."""
        if self.runs < FEWEST_RUNS:
            raise hs.SceneError(
                f"--runs {self.runs} are too few to detect a wrong error bar; ask for at least {FEWEST_RUNS}"
            )


@dataclass(frozen=True)
class Row:
    """One estimator.

    Attributes
    ----------
    family, name : str
        In which runs, and what was estimated.
    truth : float
        What it should have measured.
    source : str
        Where the truth is from: "exact", "theory" or "mean of runs".
    degrees_of_freedom : float
        Median over runs.
    relative_error : float
        Mean standard error over |truth|; NaN where the truth is 0.
    pulls : (R,) array
        (value - truth) / standard error.
    result : Calibration
        The test of these pulls.
    """

    family: str
    name: str
    truth: float
    source: str
    degrees_of_freedom: float
    relative_error: float
    pulls: FloatArray
    result: Calibration


def rows_of(family: str, estimates: Sequence[Mapping[str, Estimate]]) -> list[Row]:
    """Return the calibration of every estimator of one family of runs.

    Parameters
    ----------
    family : str
        One of `studies.validation.calibration_runs.FAMILIES`.
    estimates : sequence of dict of Estimate
        What each run measured.
    """
    known = calibration_runs.FAMILIES[family].truths
    rows = []
    for name in estimates[0]:
        own = [run[name] for run in estimates]
        truth, source = known.get(name, (float(np.mean([e.value for e in own])), "mean of runs"))
        errors = np.array([e.standard_error for e in own])
        rows.append(
            Row(
                family,
                name,
                truth,
                source,
                float(np.median([e.degrees_of_freedom for e in own])),
                float(errors.mean() / abs(truth)) if truth else float("nan"),
                np.array([e.deviation(truth) for e in own]),
                calibrate(own, truth),
            )
        )
    return rows


def _calibrate(study: Calibrations, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
    began = time.perf_counter()
    study.check()
    out.check(study)
    with screen.compiling("the gases of all estimators"):
        for name in study.families:
            calibration_runs.FAMILIES[name].load()
    ready = time.perf_counter()
    with executor_of(study.executor, study.workers, screen.note) as pool, out.running(study) as shelf:
        seeds = replica_seeds(study.seed, study.runs * len(study.families))
        items = [
            (name, seeds[k * study.runs + r])
            for k, name in enumerate(study.families)
            for r in range(study.runs)
        ]
        with screen.progress("runs", len(items)) as advance:
            results = run_replicas(
                calibration_runs.measure,
                items,
                workers=study.workers,
                executor=pool,
                done=advance,
                shelf=shelf,
            )
        ran, count = time.perf_counter(), number_of_workers(pool, study.workers)
        rows = [
            row
            for k, name in enumerate(study.families)
            for row in rows_of(name, results[k * study.runs : (k + 1) * study.runs])
        ]
        out.write_csv("calibration.csv", _columns(rows))
        from studies.validation.calibration_figure import figure

        with screen.working("drawing"):
            drawn = figure(rows)
            out.save_figure("calibration.png", drawn, _in_words(study))
        failures = [f"{row.family}, {row.name}: {row.result}" for row in rows if not row.result.passed]
        summary: dict[str, Any] = {
            **study.made(),
            "seed": study.seed,
            "workers": count,
            "families": {name: calibration_runs.FAMILIES[name].text for name in study.families},
            "rows": [_row_summary(row) for row in rows],
            "checks": {"passed": not failures, "failures": failures},
            "files": sorted({*out.files, REPORT, SUMMARY}),
            "seconds": seconds_taken(began, ready, ran, work="runs"),
        }
        tables, legend = _tables(study, rows), _legend(rows)
        page = Report(
            name=study.name,
            subject=f"{len(rows)} estimators, {study.runs} runs of each",
            question=study.asked,
            answer=[f"{len(rows) - len(failures)} of {len(rows)} estimators are calibrated."],
            figures={"calibration": drawn},
            sections=tables,
            legend=legend,
            summary=summary,
        )
        write_page(out, page)
        out.write_json(SUMMARY, summary)
    say_sections(screen, tables)
    for sentence in legend:
        screen.say(sentence)
    for failure in failures:
        screen.say(f"CHECK FAILED, {failure}")
    screen.say(
        f"{len(rows)} estimators in {summary['seconds']['total']:.0f} s; written to {out.path}: "
        f"{', '.join(summary['files'])}"
    )
    return summary, not failures


def _columns(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the columns of calibration.csv."""
    results = [row.result for row in rows]
    return {
        "runs_of": [row.family for row in rows],
        "estimator": [row.name for row in rows],
        "truth": [row.truth for row in rows],
        "source": [row.source for row in rows],
        "runs": [result.n_runs for result in results],
        "degrees_of_freedom": [row.degrees_of_freedom for row in rows],
        "relative_error": [row.relative_error for row in rows],
        "mean": [result.mean for result in results],
        "mean_error": [result.mean_error for result in results],
        "spread": [result.spread for result in results],
        "spread_expected": [result.expected_spread for result in results],
        "spread_error": [result.spread_error for result in results],
        "p_value": [result.p_value for result in results],
        "calibrated": [result.passed for result in results],
    }


def _row_summary(row: Row) -> dict[str, Any]:
    columns = _columns([row])
    return {name: values[0] for name, values in columns.items()}


def _in_words(study: Calibrations) -> str:
    return "; ".join(f"{study.runs} x {calibration_runs.FAMILIES[name].text}" for name in study.families)


def _tables(study: Calibrations, rows: Sequence[Row]) -> list[Section]:
    """Return a table for each kind of runs."""
    header = ["estimator", "truth", "error", "d.o.f.", "mean", "spread", "Student's t", "z", "KS p", ""]
    return [
        Section(
            f"{study.runs} x {calibration_runs.FAMILIES[name].text}",
            [Table(header, [_cells(row) for row in rows if row.family == name])],
        )
        for name in study.families
    ]


def _cells(row: Row) -> list[str]:
    result = row.result
    z = (result.spread - result.expected_spread) / result.spread_error
    return [
        row.name,
        row.source,
        f"{100 * row.relative_error:.2g} %" if np.isfinite(row.relative_error) else "",
        f"{row.degrees_of_freedom:.0f}" if np.isfinite(row.degrees_of_freedom) else "inf",
        f"{result.mean:+.2f}({100 * result.mean_error:.0f})",
        f"{result.spread:.3f}",
        f"{result.expected_spread:.3f}({1000 * result.spread_error:.0f})",
        f"{z:+.1f}",
        f"{result.p_value:.2g}",
        "" if result.passed else "NO",
    ]


def _legend(rows: Sequence[Row]) -> list[str]:
    """Return what the columns are, and when an estimator is calibrated."""
    chance = 1.0 - (1.0 - 0.0037) ** len(rows)
    return [
        (
            "error: mean standard error of one run over the truth; mean, spread: of (value - truth) / "
            "standard error over the runs"
        ),
        (
            "Student's t: its standard deviation with the quoted degrees of freedom, in brackets the "
            "standard error of the difference; z: difference in these"
        ),
        "mean of runs: no theory is good enough, so that only spread and shape are tested",
        (
            f"calibrated: KS p > 0.001 and |z| < 3; by chance one of {len(rows)} right estimators fails in "
            f"{100 * chance:.0f} % of all seeds"
        ),
    ]
