"""The picture of two temperatures that become one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.mixture import Result
from studies.report import COLOURS, figure_style

__all__ = ["figure"]


def figure(result: Result) -> Figure:
    """Draw both temperatures and the logarithm of their difference over theory, and the deviation below.

    Parameters
    ----------
    result : Result
        All replicas.

    Returns
    -------
    Figure
    """
    with figure_style():
        drawn = Figure(figsize=(9.4, 4.4), layout="constrained")
        panels = drawn.subplot_mosaic([["left", "right"], ["left", "below"]], height_ratios=[3.0, 1.0])
        panels["below"].sharex(panels["right"])
        _draw_temperatures(panels["left"], result)
        _draw_difference(panels["right"], result)
        _draw_deviations(panels["below"], result)
    return drawn


def _draw_temperatures(axes: Axes, result: Result) -> None:
    time, values, errors = result.time, result.decay.temperatures, result.decay.temperatures_error
    expected = result.expected
    for kind, colour in enumerate((COLOURS["warm"], COLOURS["simulation"])):
        low, high = (expected.value[:, kind] + sign * expected.uncertainty[:, kind] for sign in (-1, 1))
        axes.fill_between(time, low, high, color=COLOURS["band"], alpha=0.4, lw=0)
        axes.errorbar(
            time,
            values[:, kind],
            errors[:, kind],
            fmt="o",
            ms=4,
            color=colour,
            label=result.labels[kind],
            zorder=3,
        )
    fine = np.linspace(0.0, float(time[-1]), 300)
    for line in result.theory_at(fine).value.T:
        axes.plot(fine, line, color=COLOURS["theory"], zorder=2)
    axes.plot([], [], color=COLOURS["theory"], label="two Maxwellians")
    axes.set_xlabel("time")
    axes.set_ylabel("temperature $kT$")
    axes.set_title("Two temperatures become one")
    axes.legend(loc="best")


def _draw_difference(axes: Axes, result: Result) -> None:
    time, start = result.time, result.difference[0]
    share, error = result.difference / start, result.difference_error / abs(start)
    expected, doubt = result.theory_difference / start, result.theory_difference_error / abs(start)
    seen = share > 2.0 * error
    axes.fill_between(
        time,
        expected - doubt,
        expected + doubt,
        color=COLOURS["band"],
        alpha=0.4,
        lw=0,
        label="its known deviation",
    )
    fine = np.linspace(0.0, float(time[-1]), 300)
    curve = result.theory_at(fine).value
    axes.plot(
        fine, (curve[:, 0] - curve[:, 1]) / start, color=COLOURS["theory"], label="two Maxwellians", zorder=2
    )
    axes.errorbar(
        time[seen],
        share[seen],
        error[seen],
        fmt="o",
        ms=4,
        color=COLOURS["simulation"],
        label="simulation",
        zorder=3,
    )
    axes.set_yscale("log")
    axes.set_ylim(0.6 * float(min(share[seen].min(), expected[-1])), 1.4)
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("$(T_1 - T_2)$ / at the start")
    axes.set_title("How fast the difference goes")
    axes.legend(loc="lower left")


def _draw_deviations(axes: Axes, result: Result) -> None:
    z = result.deviations
    axes.axhspan(-2, 2, color=COLOURS["band"], alpha=0.25, lw=0)
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.0)
    axes.plot(result.time, z, "o", ms=3.5, color=COLOURS["simulation"])
    extent = max(3.5, 1.15 * float(np.nanmax(np.abs(z), initial=0.0)))
    axes.set_ylim(-extent, extent)
    axes.set_xlabel("time")
    axes.set_ylabel("deviation\nin std. errors", fontsize=8.5)
