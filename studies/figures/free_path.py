"""Figure of free paths: their mean against packing fraction, their distribution, and lambda(v)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.theory import FreeFlights
from studies.figures.style import COLOURS, MARKS, SPECIES, figure_style
from studies.fluid import Fluid

if TYPE_CHECKING:
    from studies.free_path import FreePathState

__all__ = ["figure"]

FloatArray = NDArray[np.float64]


def figure(states: Sequence[FreePathState]) -> Figure:
    """Draw mean free path with residuals, survival function with residuals, and mean path by speed.

    Parameters
    ----------
    states : sequence of FreePathState
        By ascending packing fraction.

    Returns
    -------
    Figure
    """
    shades = colormaps["viridis"](np.linspace(0.1, 0.75, max(len(states), 2)))
    with figure_style():
        result = Figure(figsize=(12.4, 5.6), layout="constrained")
        grid = result.subplots(2, 3, height_ratios=[2.2, 1.0])
        _draw_means(grid[0, 0], states)
        _draw_mean_residuals(grid[1, 0], states)
        _draw_survival(grid[0, 1], grid[1, 1], states, shades)
        _draw_speeds(grid[0, 2], grid[1, 2], states, shades)
        for upper, lower in grid.T:
            upper.tick_params(labelbottom=False)
            lower.sharex(upper)
    return result


def _law(fluid: Fluid, eta: float, species: int) -> FreeFlights:
    """Return the theory of a species of a fluid at a packing fraction, kT = 1."""
    shares = np.array([1.0 - fluid.fraction, fluid.fraction]) if fluid.mixed else np.ones(1)
    diameters, masses = np.array([1.0, fluid.diameter_ratio]), np.array([1.0, fluid.mass_ratio])
    kinds = len(shares)
    volume = np.pi / (2 * fluid.dim) * float(shares @ diameters[:kinds] ** fluid.dim)
    return FreeFlights(shares * eta / volume, diameters[:kinds], masses[:kinds], fluid.dim, species)


def _mean_of(state: FreePathState, species: int) -> Any:
    name = "mean free path" + (f" of species {species + 1}" if len(state.labels) > 1 else "")
    return state.check(name)


def _draw_means(axes: Axes, states: Sequence[FreePathState]) -> None:
    eta = np.array([state.fluid.packing_fraction for state in states])
    fine = np.geomspace(eta[0] / 1.5, min(1.2 * eta[-1], max(0.49, eta[-1])), 60)
    labels = states[0].labels
    for k, label in enumerate(labels):
        curve = [_law(states[0].fluid, float(e), k).mean_path for e in fine]
        axes.plot(fine, curve, color=COLOURS["theory"], lw=1.3, label="Enskog" if k == 0 else None)
        means = [_mean_of(state, k) for state in states]
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
    axes.set_ylabel("mean free path / diameter" + " of the first" * (len(labels) > 1))
    axes.set_title("Mean free path")
    axes.legend(fontsize=8)


def _draw_mean_residuals(axes: Axes, states: Sequence[FreePathState]) -> None:
    """Draw measured over expected mean free path, less 1, with the theory's uncertainty as bars."""
    eta = np.array([state.fluid.packing_fraction for state in states])
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    largest, kinds = 0.0, len(states[0].labels)
    for k in range(kinds):
        shifted = eta * (1.0 + 0.08 * (k - (kinds - 1) / 2))
        means = [_mean_of(state, k) for state in states]
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


def _draw_survival(axes: Axes, below: Axes, states: Sequence[FreePathState], shades: FloatArray) -> None:
    """Draw the survival function of free paths over that of a dilute gas."""
    x = np.linspace(0.0, 5.4, 120)
    axes.plot(x, np.exp(-x), color=COLOURS["band"], lw=1.0, ls=(0, (4, 2)), label="exponential")
    below.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    styles: tuple[Any, ...] = ("-", (0, (5, 1.5)))
    for k in range(len(states[0].labels)):
        law = _law(states[0].fluid, states[0].fluid.packing_fraction, k).path_survival(x).value
        name = "Boltzmann" + (f", species {k + 1}" if len(states[0].labels) > 1 else "")
        axes.plot(x, law, color=COLOURS["theory"], lw=1.2, ls=styles[k % 2], label=name)
    for state, shade in zip(states, shades, strict=False):
        for k, curve in enumerate(state.curves["path"]):
            values = np.array([point.value for point in curve.measured])
            errors = np.array([point.standard_error for point in curve.measured])
            marks: Any = {"fmt": MARKS[k % len(MARKS)], "ms": 4, "lw": 1.2, "color": shade, "zorder": 3}
            label = f"packing fraction {state.fluid.packing_fraction:.4g}" if k == 0 else None
            axes.errorbar(curve.x, values, errors, label=label, **marks)
            below.errorbar(
                curve.x, 100 * (values / curve.expected - 1), 100 * errors / curve.expected, **marks
            )
    axes.set_yscale("log")
    axes.set_title("Free paths longer than x")
    axes.set_ylabel("fraction of the flights")
    axes.legend(fontsize=7.5)
    below.set_xlabel("x / mean free path")
    below.set_ylabel("ratio to theory \u2212 1\nin per cent", fontsize=8.5)


def _draw_speeds(axes: Axes, below: Axes, states: Sequence[FreePathState], shades: FloatArray) -> None:
    """Draw the mean path of flights at a speed in units of the mean free path."""
    v = np.linspace(0.01, 5.0, 100)
    below.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    fluid = states[0].fluid
    largest = 1.0
    for k in range(len(states[0].labels)):
        law = _law(fluid, fluid.packing_fraction, k)
        thermal = 1.0 if k == 0 else fluid.mass_ratio**-0.5
        curve = v * thermal / law.rates(v * thermal).sum(axis=-1) / law.mean_path
        axes.plot(v, curve, color=COLOURS["theory"], lw=1.2, ls=("-", (0, (5, 1.5)))[k % 2])
    for state, shade in zip(states, shades, strict=False):
        for k, found in enumerate(state.curves["speed"]):
            values = np.array([point.value for point in found.measured])
            errors = np.array([point.standard_error for point in found.measured])
            marks: Any = {"fmt": MARKS[k % len(MARKS)], "ms": 3.5, "lw": 1.1, "color": shade, "zorder": 3}
            axes.errorbar(found.x, values, errors, **marks)
            residual, error = 100 * (values / found.expected - 1), 100 * errors / found.expected
            sharp = error < 3.0
            below.errorbar(found.x[sharp], residual[sharp], error[sharp], **marks)
            largest = max(largest, float(np.max(np.abs(residual[sharp]) + error[sharp], initial=0.0)))
    axes.set_title("Mean free path at a speed v")
    axes.set_ylabel("path at v / mean free path")
    axes.set_ylim(bottom=0.0)
    below.set_ylim(-1.2 * largest, 1.2 * largest)
    below.set_xlabel(r"$v \,/\, \sqrt{kT/m}$")
    below.set_ylabel("ratio to theory \u2212 1\nin per cent", fontsize=8.5)
