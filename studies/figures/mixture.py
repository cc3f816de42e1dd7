"""Figure of temperature equilibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import theory
from studies.figures.style import COLOURS, deviations, falling, figure_style, species_look

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

FloatArray = NDArray[np.float64]


def figure(answer: Answer) -> Figure:
    """Draw both temperatures and the logarithm of their difference over theory, and the deviation below.

    Parameters
    ----------
    answer : Answer
        Of `studies.mixture`.

    Returns
    -------
    Figure
    """
    with figure_style():
        drawn = Figure(figsize=(9.4, 4.4), layout="constrained")
        panels = drawn.subplot_mosaic([["left", "right"], ["left", "below"]], height_ratios=[3.0, 1.0])
        panels["below"].sharex(panels["right"])
        _draw_temperatures(panels["left"], answer)
        _draw_difference(panels["right"], answer)
        _draw_deviations(panels["below"], answer)
    return drawn


def _part(answer: Answer, name: str) -> FloatArray:
    """Return a column of the file of temperatures."""
    return answer.curves["temperatures"].flat()[name]


def _theory(answer: Answer) -> tuple[FloatArray, FloatArray]:
    """Return close times, and both temperatures in theory there, (300, 2)."""
    fine = np.linspace(0.0, float(_part(answer, "time")[-1]), 300)
    start = np.array([_part(answer, f"temperature_{kind}")[0] for kind in (1, 2)])
    densities, diameters, masses = answer.gas.species
    dim = answer.gas.dim
    return fine, theory.temperature_equilibration(fine, start, densities, diameters, masses, dim).value


def _draw_band(
    axes: Axes, time: FloatArray, expected: FloatArray, uncertainty: FloatArray, label: str | None
) -> None:
    """Draw how far theory may be off."""
    low, high = expected - uncertainty, expected + uncertainty
    axes.fill_between(time, low, high, color=COLOURS["band"], alpha=0.4, lw=0, label=label)


def _draw_temperatures(axes: Axes, answer: Answer) -> None:
    time = _part(answer, "time")
    for kind in range(2):
        name, look = f"temperature_{kind + 1}", species_look(kind)
        expected, uncertainty = _part(answer, f"{name}_theory"), _part(answer, f"{name}_uncertainty")
        band = "its known deviation" if kind == 0 else None
        _draw_band(axes, time, expected, uncertainty, band)
        axes.errorbar(
            time,
            _part(answer, name),
            _part(answer, f"{name}_error"),
            ls="",
            ms=4,
            label=answer.details["species"][kind],
            zorder=3,
            **look,
        )
    fine, curves = _theory(answer)
    for line in curves.T:
        axes.plot(fine, line, color=COLOURS["theory"], zorder=2)
    axes.plot([], [], color=COLOURS["theory"], label="two Maxwellians")
    axes.set_xlabel(r"time / $\sigma_1 \sqrt{m_1/kT}$")
    axes.set_ylabel("temperature $kT$")
    axes.set_title("Temperature equilibration")
    axes.legend(loc="best")


def _draw_difference(axes: Axes, answer: Answer) -> None:
    time, start = _part(answer, "time"), _part(answer, "difference")[0]
    share, error = _part(answer, "difference") / start, _part(answer, "difference_error") / abs(start)
    expected = _part(answer, "difference_theory") / start
    uncertainty = _part(answer, "difference_uncertainty") / abs(start)
    _draw_band(axes, time, expected, uncertainty, "its known deviation")
    fine, curve = _theory(answer)
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


def _draw_deviations(axes: Axes, answer: Answer) -> None:
    deviations(axes, (_part(answer, "time"), _part(answer, "difference_z"), {}))
    axes.set_xlabel(r"time / $\sigma_1 \sqrt{m_1/kT}$")
