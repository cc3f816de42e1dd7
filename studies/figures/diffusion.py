"""Figure of self-diffusion: displacements, velocity autocorrelation, and D against packing fraction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis import theory
from studies.figures.style import COLOURS, falling, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

LATEST = 12.0  # mean free times, of the velocity autocorrelation


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw mean square displacement, velocity autocorrelation and D over Enskog's theory.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.diffusion`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    colours = colormaps["viridis"](np.linspace(0.1, 0.75, max(len(answers), 2)))
    with figure_style():
        result = Figure(figsize=(11.6, 4.0), layout="constrained")
        left, middle, right = result.subplots(1, 3)
        for k, (answer, colour) in enumerate(zip(answers, colours, strict=False)):
            _draw_displacement(left, answer, colour)
            window = answer.details["window_in_mean_free_times"]
            left.plot(window, [0.03 + 0.02 * k] * 2, color=colour, lw=3.0, solid_capstyle="butt")
            _draw_velocities(middle, answer, colour)
        _finish_displacement(left)
        _finish_velocities(middle, answers[0].gas.dim)
        _draw_diffusion(right, answers)
    return result


def _draw_displacement(axes: Axes, answer: Answer, colour: Any) -> None:
    """Draw MSD over 2 d D_E t, which Enskog's diffusion makes 1, against mean free times."""
    gas, curves = answer.gas, answer.curves["correlations"]
    lags, s = curves.axes["time"], curves.axes["mean_free_times"]
    column, enskog = curves.columns["mean_square_displacement"], _enskog(answer)
    scale = 2 * gas.dim * enskog * lags
    axes.errorbar(
        s,
        column.value / scale,
        column.error / scale,
        fmt="o",
        ms=3.5,
        lw=1.2,
        color=colour,
        label=f"packing fraction {gas.packing_fraction:.4g}",
        zorder=3,
    )
    x = np.geomspace(s[0], 1.2, 30)  # free flight: <v^2> t^2
    square = gas.units["temperature"] / gas.units["mass"]
    axes.plot(x, x * (lags[0] / s[0]) * square / (2 * enskog), color=colour, lw=1.0, ls=(0, (4, 2)))


def _finish_displacement(axes: Axes) -> None:
    axes.axhline(1.0, color=COLOURS["theory"], lw=1.2, label="Enskog")
    axes.plot([], [], color=COLOURS["band"], lw=1.0, ls=(0, (4, 2)), label="free flight")
    axes.plot([], [], color=COLOURS["band"], lw=3.0, label="slope taken here")
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.3))
    axes.set_xscale("log")
    axes.set_xlabel("mean free times")
    axes.set_ylabel(r"$\langle |x(t) - x(0)|^2 \rangle \,/\, 2 d D_\mathrm{E} t$")
    axes.set_title("Mean square displacement")
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.1), "alignment": "left"}
    axes.legend(fontsize=8, **place)


def _draw_velocities(axes: Axes, answer: Answer, colour: Any) -> None:
    curves = answer.curves["correlations"]
    s, column = curves.axes["mean_free_times"], curves.columns["velocity_autocorrelation"]
    axes.set_yscale("log")
    shown = s <= LATEST
    falling(axes, s[shown], column.value[shown], column.error[shown], ms=3.5, color=colour)


def _enskog(answer: Answer) -> float:
    """Return D in Enskog's theory; all units of a real gas are such that nm^2/ps are mm^2/s."""
    gas = answer.gas
    return float(theory.enskog_diffusion(gas.packing_fraction, gas.dim, **gas.units).value)


def _finish_velocities(axes: Axes, dim: int) -> None:
    axes.set_yscale("log")
    s = np.linspace(0.0, LATEST, 100)
    axes.plot(s, np.exp(-2 / dim * s), color=COLOURS["theory"], lw=1.2, label="Enskog")
    axes.set_xlim(0.0, 1.02 * LATEST)
    axes.set_ylim(5e-4, 1.2)
    axes.set_xlabel("mean free times")
    axes.set_ylabel(r"$\langle v(0) \cdot v(t) \rangle \,/\, \langle v^2 \rangle$")
    axes.set_title("Velocity autocorrelation")
    axes.legend(loc="upper right")


def _draw_diffusion(axes: Axes, answers: Sequence[Answer]) -> None:
    dim = answers[0].gas.dim
    eta = np.array([answer.gas.packing_fraction for answer in answers])
    enskog = np.array([_enskog(answer) for answer in answers])
    fine = np.linspace(min(0.5 * eta[0], 0.02), max(1.1 * eta[-1], eta[-1] + 0.02), 100)
    limit = 0.494 if dim == 3 else 0.66
    fine = fine[fine <= limit]
    band = theory.enskog_diffusion(fine, dim)
    uncertainty = band.uncertainty / band.value
    axes.fill_between(
        fine,
        1 - uncertainty,
        1 + uncertainty,
        color=COLOURS["band"],
        alpha=0.35,
        lw=0,
        label="its uncertainty",
    )
    axes.axhline(1.0, color=COLOURS["theory"], lw=1.2, label="Enskog")
    here = [answer[answer.gas.named("D of this box")].measured for answer in answers]
    axes.errorbar(
        eta,
        np.array([found.value for found in here]) / enskog,
        np.array([found.standard_error for found in here]) / enskog,
        fmt="s",
        ms=5,
        mfc="none",
        color=COLOURS["other"],
        label="in this box",
    )
    if dim == 3:
        infinite = [answer[answer.gas.named("D")].measured for answer in answers]
        axes.errorbar(
            eta,
            np.array([found.value for found in infinite]) / enskog,
            np.array([found.standard_error for found in infinite]) / enskog,
            fmt="o",
            ms=5,
            color=COLOURS["simulation"],
            label="infinite fluid",
        )
    axes.set_xlabel("packing fraction")
    axes.set_ylabel(r"$D \,/\, D_\mathrm{E}$")
    axes.set_title("Self-diffusion")
    axes.legend(loc="lower left", fontsize=8)
