"""Figure of temperature equilibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.figures.style import COLOURS, deviations, falling, figure_style, species_look

if TYPE_CHECKING:
    from studies.mixture import Result

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
    for kind in range(2):
        look = species_look(kind)
        low, high = (expected.value[:, kind] + sign * expected.uncertainty[:, kind] for sign in (-1, 1))
        band = "its known deviation" if kind == 0 else None
        axes.fill_between(time, low, high, color=COLOURS["band"], alpha=0.4, lw=0, label=band)
        axes.errorbar(
            time,
            values[:, kind],
            errors[:, kind],
            ls="",
            ms=4,
            label=result.labels[kind],
            zorder=3,
            **look,
        )
    fine = np.linspace(0.0, float(time[-1]), 300)
    for line in result.theory_at(fine).value.T:
        axes.plot(fine, line, color=COLOURS["theory"], zorder=2)
    axes.plot([], [], color=COLOURS["theory"], label="two Maxwellians")
    axes.set_xlabel(r"time / $\sigma_1 \sqrt{m_1/kT}$")
    axes.set_ylabel("temperature $kT$")
    axes.set_title("Temperature equilibration")
    axes.legend(loc="best")


def _draw_difference(axes: Axes, result: Result) -> None:
    time, start = result.time, result.difference[0]
    share, error = result.difference / start, result.difference_error / abs(start)
    expected, uncertainty = result.theory_difference / start, result.theory_difference_error / abs(start)
    axes.fill_between(
        time,
        expected - uncertainty,
        expected + uncertainty,
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
    axes.set_yscale("log")
    falling(axes, time, share, error, color=COLOURS["simulation"], label="simulation")
    axes.set_ylim(0.3 * float(min(share[share > 0.0].min(), expected[-1])), 1.4)
    axes.tick_params(labelbottom=False)
    axes.set_ylabel("$(T_1 - T_2)$ / at the start")
    axes.set_title("Decay of the difference")
    axes.legend(loc="lower left")


def _draw_deviations(axes: Axes, result: Result) -> None:
    deviations(axes, (result.time, result.deviations, {}))
    axes.set_xlabel(r"time / $\sigma_1 \sqrt{m_1/kT}$")
