"""Figure of free paths: their mean against packing fraction, their distribution, and lambda(v)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.theory import FreeFlights
from studies.figures.style import COLOURS, MARKS, SPECIES, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer
    from studies.fluid import Fluid

__all__ = ["figure"]

FloatArray = NDArray[np.float64]


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw mean free path with residuals, survival function with residuals, and mean path by speed.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.free_path`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    shades = colormaps["viridis"](np.linspace(0.1, 0.75, max(len(answers), 2)))
    with figure_style():
        result = Figure(figsize=(12.4, 5.6), layout="constrained")
        grid = result.subplots(2, 3, height_ratios=[2.2, 1.0])
        _draw_means(grid[0, 0], answers)
        _draw_mean_residuals(grid[1, 0], answers)
        _draw_survival(grid[0, 1], grid[1, 1], answers, shades)
        _draw_speeds(grid[0, 2], grid[1, 2], answers, shades)
        for upper, lower in grid.T:
            upper.tick_params(labelbottom=False)
            lower.sharex(upper)
    return result


def _law(fluid: Fluid, eta: float, species: int) -> FreeFlights:
    """Return the theory of a species of a fluid at a packing fraction."""
    densities, diameters, masses = replace(fluid, packing_fraction=eta).species
    return FreeFlights(densities, diameters, masses, fluid.dim, species, fluid.units["temperature"])


def _curve(answer: Answer, name: str, species: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return abscissae, values, errors and theory of the curve of a species."""
    curves = answer.curves[name]
    *kinds, x = curves.axes.values()
    (column,) = curves.columns.values()
    own = kinds[0] == species + 1 if kinds else np.ones(len(x), dtype=bool)
    assert column.theory is not None
    return x[own], column.value[own], column.error[own], column.theory[own]


def _mean_of(answer: Answer, species: int) -> Any:
    name = "mean free path" + (f" of species {species + 1}" if len(answer.details["species"]) > 1 else "")
    return answer[answer.gas.named(name)]


def _draw_means(axes: Axes, answers: Sequence[Answer]) -> None:
    eta = np.array([answer.gas.packing_fraction for answer in answers])
    fine = np.geomspace(eta[0] / 1.5, min(1.2 * eta[-1], max(0.49, eta[-1])), 60)
    labels = answers[0].details["species"]
    for k, label in enumerate(labels):
        curve = [_law(answers[0].gas, float(e), k).mean_path for e in fine]
        axes.plot(fine, curve, color=COLOURS["theory"], lw=1.3, label="Enskog" if k == 0 else None)
        means = [_mean_of(answer, k) for answer in answers]
        axes.errorbar(
            eta,
            [mean.measured.value for mean in means],
            [mean.measured.standard_error for mean in means],
            fmt=MARKS[k % len(MARKS)],
            ms=5,
            color=SPECIES[k % len(SPECIES)],
            label="simulation" if len(labels) == 1 else label,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    if len(eta) == 1:
        axes.set_xlim(eta[0] / 2, 2 * eta[0])
    name = answers[0].gas.named("mean free path")  # with its unit, where it has one
    unit = "" if "[" in name else " / diameter" + " of the first" * (len(labels) > 1)
    axes.set_ylabel(name + unit)
    axes.set_title("Mean free path")
    axes.legend(fontsize=8)


def _draw_mean_residuals(axes: Axes, answers: Sequence[Answer]) -> None:
    """Draw measured over expected mean free path, less 1, with the theory's uncertainty as bars."""
    eta = np.array([answer.gas.packing_fraction for answer in answers])
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    largest, kinds = 0.0, len(answers[0].details["species"])
    for k in range(kinds):
        shifted = eta * (1.0 + 0.08 * (k - (kinds - 1) / 2))
        means = [_mean_of(answer, k) for answer in answers]
        expected = np.array([mean.expected for mean in means])
        uncertainty = 1e3 * np.array([mean.uncertainty for mean in means]) / expected
        residual = 1e3 * (np.array([mean.measured.value for mean in means]) / expected - 1.0)
        error = 1e3 * np.array([mean.measured.standard_error for mean in means]) / expected
        axes.bar(
            shifted,
            2 * uncertainty,
            0.07 * shifted,
            -uncertainty,
            color=COLOURS["band"],
            alpha=0.45,
            lw=0,
            label="uncertainty of theory" if k == 0 else None,
        )
        axes.errorbar(
            shifted,
            residual,
            error,
            fmt=MARKS[k % len(MARKS)],
            ms=4,
            lw=1.2,
            color=SPECIES[k % len(SPECIES)],
            zorder=3,
        )
        largest = max(largest, float(np.max(np.abs(residual) + error)), float(uncertainty.max()))
    axes.set_xscale("log")
    axes.set_ylim(-1.3 * largest, 1.8 * largest)
    axes.set_xlabel("packing fraction")
    axes.set_ylabel("ratio to theory \u2212 1\nin parts per 1000", fontsize=8.5)
    axes.legend(fontsize=7.5, loc="upper left")


def _draw_survival(axes: Axes, below: Axes, answers: Sequence[Answer], shades: FloatArray) -> None:
    """Draw the survival function of free paths over that of a dilute gas."""
    x = np.linspace(0.0, 5.4, 120)
    axes.plot(x, np.exp(-x), color=COLOURS["band"], lw=1.0, ls=(0, (4, 2)), label="exponential")
    below.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    styles: tuple[Any, ...] = ("-", (0, (5, 1.5)))
    for k in range(len(answers[0].details["species"])):
        law = _law(answers[0].gas, answers[0].gas.packing_fraction, k).path_survival(x).value
        name = "Boltzmann" + (f", species {k + 1}" if len(answers[0].details["species"]) > 1 else "")
        axes.plot(x, law, color=COLOURS["theory"], lw=1.2, ls=styles[k % 2], label=name)
    for answer, shade in zip(answers, shades, strict=False):
        for k in range(len(answer.details["species"])):
            at, values, errors, expected = _curve(answer, "free_path_survival", k)
            marks: Any = {"fmt": MARKS[k % len(MARKS)], "ms": 4, "lw": 1.2, "color": shade, "zorder": 3}
            label = f"packing fraction {answer.gas.packing_fraction:.4g}" if k == 0 else None
            axes.errorbar(at, values, errors, label=label, **marks)
            below.errorbar(at, 100 * (values / expected - 1), 100 * errors / expected, **marks)
    axes.set_yscale("log")
    axes.set_title("Free paths longer than x")
    axes.set_ylabel("fraction of the flights")
    axes.legend(fontsize=7.5)
    below.set_xlabel("x / mean free path")
    below.set_ylabel("ratio to theory \u2212 1\nin per cent", fontsize=8.5)


def _draw_speeds(axes: Axes, below: Axes, answers: Sequence[Answer], shades: FloatArray) -> None:
    """Draw the mean path of flights at a speed in units of the mean free path."""
    v = np.linspace(0.01, 5.0, 100)
    below.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    fluid = answers[0].gas
    largest = 1.0
    for k in range(len(answers[0].details["species"])):
        law = _law(fluid, fluid.packing_fraction, k)
        thermal = (1.0 if k == 0 else fluid.mass_ratio**-0.5) * math.sqrt(
            fluid.units["temperature"] / fluid.units["mass"]
        )
        curve = v * thermal / law.rates(v * thermal).sum(axis=-1) / law.mean_path
        axes.plot(v, curve, color=COLOURS["theory"], lw=1.2, ls=("-", (0, (5, 1.5)))[k % 2])
    for answer, shade in zip(answers, shades, strict=False):
        for k in range(len(answer.details["species"])):
            at, values, errors, expected = _curve(answer, "free_path_by_speed", k)
            marks: Any = {"fmt": MARKS[k % len(MARKS)], "ms": 3.5, "lw": 1.1, "color": shade, "zorder": 3}
            axes.errorbar(at, values, errors, **marks)
            residual, error = 100 * (values / expected - 1), 100 * errors / expected
            sharp = error < 3.0
            below.errorbar(at[sharp], residual[sharp], error[sharp], **marks)
            largest = max(largest, float(np.max(np.abs(residual[sharp]) + error[sharp], initial=0.0)))
    axes.set_title("Mean free path at a speed v")
    axes.set_ylabel("path at v / mean free path")
    axes.set_ylim(bottom=0.0)
    below.set_ylim(-1.2 * largest, 1.2 * largest)
    below.set_xlabel(r"$v \,/\, \sqrt{kT/m}$")
    below.set_ylabel("ratio to theory \u2212 1\nin per cent", fontsize=8.5)
