"""Figure of the equation of state: Z against packing fraction, and its deviation from theory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import theory
from studies.figures.style import COLOURS, deviations, figure_style
from studies.fluid import THEORY_UP_TO

if TYPE_CHECKING:
    from studies.answer import Answer
    from studies.fluid import Fluid

__all__ = ["MARKS", "WORDS", "best", "figure", "measured"]

FloatArray = NDArray[np.float64]

VIRIAL = "Z from the virial"
MARKS = {
    VIRIAL: ("o", "simulation"),
    "Z from the rate": ("s", "other"),
    "Z from the walls": ("^", "warm"),
}
WORDS = {
    VIRIAL: "from the virial",
    "Z from the rate": "from the collision rate",
    "Z from the walls": "from the walls",
}
SHORT = {"Kolafa-Labik-Malijevsky": "KLM", "virial series resummed": "theory"}


def measured(states: Sequence[Answer], way: str) -> tuple[FloatArray, FloatArray]:
    """Return Z of one way and its standard errors."""
    found = [state[way].measured for state in states]
    return np.array([z.value for z in found]), np.array([z.standard_error for z in found])


def best(states: Sequence[Answer]) -> tuple[FloatArray, FloatArray]:
    """Return Z of the best theory and its uncertainty."""
    found = [state[VIRIAL] for state in states]
    return np.array([z.expected for z in found]), np.array([z.uncertainty for z in found])


def _eta(states: Sequence[Answer]) -> FloatArray:
    return np.array([state.gas.packing_fraction for state in states])


def _ways(states: Sequence[Answer]) -> list[str]:
    return [found.quantity for found in states[0].numbers if found.quantity in MARKS]


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw Z over the theory, its relative residual, and the deviation in standard errors.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.pressure`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    known = [answer for answer in answers if answer.details["theories"]]
    with figure_style():
        result = Figure(figsize=(6.8, 7.4 if known else 4.2), layout="constrained")
        if known:
            upper, middle, lower = result.subplots(3, 1, sharex=True, height_ratios=[2.6, 1.5, 1.2])
        else:
            upper = result.subplots()
        _draw_z(upper, answers)
        if known:
            _draw_residuals(middle, known)
            _draw_deviations(lower, known)
            lower.set_xlabel("packing fraction")
        else:
            upper.set_xlabel("packing fraction")
    return result


def _range(states: Sequence[Answer]) -> FloatArray:
    eta = _eta(states)
    limit = THEORY_UP_TO[states[0].gas.dim]
    return np.linspace(min(0.5 * eta[0], 0.01), min(eta[-1] + 0.01, limit), 300)


def _spread(states: Sequence[Answer]) -> dict[str, float]:
    """Return the horizontal offsets of the points of each method, so that none hides another."""
    eta, names = _eta(states), _ways(states)
    step = 0.012 * (eta[-1] - eta[0]) if len(eta) > 1 else 0.004
    return {name: step * (k - (len(names) - 1) / 2) for k, name in enumerate(names)}


def _draw_z(axes: Axes, states: Sequence[Answer]) -> None:
    fluid = states[0].gas
    known = [state for state in states if state.details["theories"]]
    if known:
        eta = _range(known)
        if fluid.diameter_ratio == 1.0:
            curve = theory.compressibility_factor(eta, fluid.dim).value
        else:
            curve = np.array([_mixture(float(e), fluid) for e in eta])
        axes.plot(eta, curve, color=COLOURS["theory"], label=known[0][VIRIAL].theory, zorder=2)
    for way, size in zip(_ways(states), (5.0, 8.0, 6.5), strict=False):
        mark, colour = MARKS[way]
        axes.errorbar(
            _eta(states),
            *measured(states, way),
            fmt=mark,
            ms=size,
            mfc=COLOURS[colour] if way == VIRIAL else "none",
            color=COLOURS[colour],
            label=WORDS[way],
            zorder=3,
        )
    axes.set_ylabel("compressibility factor $PV/NkT$")
    axes.set_title("Equation of state")
    axes.legend(loc="upper left")


def _mixture(eta: float, fluid: Fluid) -> float:
    shares = np.array([1.0 - fluid.fraction, fluid.fraction])
    diameters = np.array([1.0, fluid.diameter_ratio])
    per_number = math.pi / (2 * fluid.dim) * float(shares @ diameters**fluid.dim)
    return float(theory.mixture_compressibility(shares * eta / per_number, diameters, fluid.dim).value)


def _draw_residuals(axes: Axes, states: Sequence[Answer]) -> None:
    """Draw relative residuals, the theory's uncertainty as a band, and the classic formula as a line."""
    eta, (expected, own) = _eta(states), best(states)
    uncertainty = 1e3 * own / expected
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    name = states[0][VIRIAL].theory
    if len(eta) > 1:
        axes.fill_between(
            eta,
            -uncertainty,
            uncertainty,
            color=COLOURS["band"],
            alpha=0.35,
            lw=0,
            label="uncertainty of theory",
        )
    largest = float(uncertainty.max())
    for way, shift in _spread(states).items():
        z, error = measured(states, way)
        residual, error = 1e3 * (z / expected - 1.0), 1e3 * error / expected
        mark, colour = MARKS[way]
        axes.errorbar(eta + shift, residual, error, fmt=mark, ms=4, lw=1.2, color=COLOURS[colour], zorder=3)
        largest = max(largest, float((np.abs(residual) + error).max()))
    fluid = states[0].gas
    if fluid.diameter_ratio == 1.0:
        fine = _range(states)
        reference = theory.compressibility_factor(fine, fluid.dim).value
        classic = theory.carnahan_starling(fine) if fluid.dim == 3 else theory.henderson(fine)
        label = "Carnahan\u2013Starling" if fluid.dim == 3 else "Henderson"
        axes.plot(
            fine,
            1e3 * (classic / reference - 1.0),
            color=COLOURS["warm"],
            lw=1.2,
            ls=(0, (4, 2)),
            label=label,
        )
    axes.set_ylim(-1.15 * largest, 2.0 * largest)  # room for the legend
    axes.set_ylabel(f"$Z$ / {SHORT.get(name, 'theory')} \u2212 1\nin parts per 1000", fontsize=8.5)
    if axes.get_legend_handles_labels()[1]:  # a single mixture has none
        axes.legend(loc="upper center", ncols=2, fontsize=8)


def _draw_deviations(axes: Axes, states: Sequence[Answer]) -> None:
    eta = _eta(states)
    series = []
    for way, shift in _spread(states).items():
        mark, colour = MARKS[way]
        z = [state[way].z for state in states]
        series.append((eta + shift, z, {"marker": mark, "color": COLOURS[colour], "ms": 4}))
    deviations(axes, *series)
