"""Figure of transport coefficients: integrals against time, and the coefficients against packing fraction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.figures.style import COLOURS, MARKS, SPECIES, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

LATEST = 2.0  # ends of the longest window, of the integrals


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw Green and Kubo's integrals of each coefficient, and all coefficients, over their theory.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.transport`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    names = [found.quantity for found in answers[0].numbers[::2]]
    colours = colormaps["viridis"](np.linspace(0.1, 0.75, max(len(answers), 2)))
    with figure_style():
        result = Figure(figsize=(4.0 * (len(names) + 1), 4.0), layout="constrained")
        *left, right = result.subplots(1, len(names) + 1)
        for axes, name in zip(left, names, strict=True):
            for answer, colour in zip(answers, colours, strict=False):
                _draw_integral(axes, answer, name, colour)
            _finish_integral(axes, name, answers)
        _draw_coefficients(right, answers, names)
    return result


def _scale(answer: Answer, name: str) -> float:
    """Return what a coefficient is divided by: theory, or where there is none itself."""
    found = answer[name]
    return found.expected if np.isfinite(found.expected) else found.measured.value


def _draw_integral(axes: Axes, answer: Answer, name: str, colour: object) -> None:
    curves = answer.curves["integrals"]
    s, column = curves.axes["mean_free_times"], curves.columns[name.replace(" ", "_")]
    shown = s <= LATEST * max(end for _, end in answer.details["windows_in_mean_free_times"])
    scale = _scale(answer, name)
    axes.errorbar(
        s[shown],
        column.value[shown] / scale,
        column.error[shown] / scale,
        fmt="o",
        ms=3.5,
        lw=1.2,
        color=colour,
        label=f"packing fraction {answer.gas.packing_fraction:.4g}",
    )


def _finish_integral(axes: Axes, name: str, answers: Sequence[Answer]) -> None:
    known = np.isfinite(answers[0][name].expected)
    windows = answers[0].details["windows_in_mean_free_times"]
    begin, end = windows[0] if "viscosity" in name else windows[1]
    axes.axvspan(begin, end, color=COLOURS["band"], alpha=0.35, lw=0, label="slope taken here")
    axes.axhline(1.0, color=COLOURS["theory"], lw=1.2, label="Enskog" if known else "slope")
    axes.set_xscale("log")
    axes.set_ylim(0.0, 1.6)
    axes.set_xlabel("mean free times")
    axes.set_ylabel("Green-Kubo integral over " + ("Enskog's value" if known else "the slope"))
    axes.set_title(name.capitalize())
    axes.legend(loc="lower right", fontsize=8)


def _draw_coefficients(axes: Axes, answers: Sequence[Answer], names: Sequence[str]) -> None:
    eta = np.array([answer.gas.packing_fraction for answer in answers])
    step = 0.06 * max(float(np.ptp(eta)), 0.1)
    for k, name in enumerate(names):
        found = [answer[name] for answer in answers]
        if not np.isfinite(found[0].expected):
            continue
        expected = np.array([each.expected for each in found])
        axes.errorbar(
            eta + (k - (len(names) - 1) / 2) * step / 2,
            np.array([each.measured.value for each in found]) / expected,
            np.array([each.measured.standard_error for each in found]) / expected,
            fmt=MARKS[k],
            ms=5,
            color=SPECIES[k],
            label=name,
        )
    first = max(
        (answer[names[-1]].uncertainty / answer[names[-1]].expected for answer in answers), default=0.0
    )
    axes.axhspan(1 - first, 1 + first, color=COLOURS["band"], alpha=0.35, lw=0, label="its uncertainty")
    axes.axhline(1.0, color=COLOURS["theory"], lw=1.2, label="Enskog")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, 0.85), max(high, 1.15) + 0.15)  # room for the legend
    axes.set_xlabel("packing fraction")
    axes.set_ylabel("coefficient over Enskog's value")
    axes.set_title("Transport coefficients")
    axes.legend(loc="upper left", fontsize=8, ncols=2)
