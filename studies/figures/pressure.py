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
    from studies.pressure import State

__all__ = ["figure"]

FloatArray = NDArray[np.float64]

MARKS = {"virial": ("o", "simulation"), "rate": ("s", "other"), "walls": ("^", "warm")}
WORDS = {"virial": "from the virial", "rate": "from the collision rate", "walls": "from the walls"}
SHORT = {"Kolafa-Labik-Malijevsky": "KLM", "virial series resummed": "theory"}


def figure(states: Sequence[State]) -> Figure:
    """Draw Z over the theory, its relative residual, and the deviation in standard errors.

    Parameters
    ----------
    states : sequence of State
        By ascending packing fraction.

    Returns
    -------
    Figure
    """
    known = [state for state in states if state.theories]
    with figure_style():
        result = Figure(figsize=(6.8, 7.4 if known else 4.2), layout="constrained")
        if known:
            upper, middle, lower = result.subplots(3, 1, sharex=True, height_ratios=[2.6, 1.5, 1.2])
        else:
            upper = result.subplots()
        _draw_z(upper, states)
        if known:
            _draw_residuals(middle, known)
            _draw_deviations(lower, known)
            lower.set_xlabel("packing fraction")
        else:
            upper.set_xlabel("packing fraction")
    return result


def _range(states: Sequence[State]) -> FloatArray:
    eta = [state.fluid.packing_fraction for state in states]
    limit = THEORY_UP_TO[states[0].fluid.dim]
    return np.linspace(min(0.5 * eta[0], 0.01), min(eta[-1] + 0.01, limit), 300)


def _spread(states: Sequence[State]) -> dict[str, float]:
    """Return the horizontal offsets of the points of each method, so that none hides another."""
    eta = [state.fluid.packing_fraction for state in states]
    names = list(states[0].measured)
    step = 0.012 * (eta[-1] - eta[0]) if len(eta) > 1 else 0.004
    return {name: step * (k - (len(names) - 1) / 2) for k, name in enumerate(names)}


def _draw_z(axes: Axes, states: Sequence[State]) -> None:
    fluid = states[0].fluid
    known = [state for state in states if state.theories]
    if known:
        eta = _range(known)
        if fluid.diameter_ratio == 1.0:
            curve = theory.compressibility_factor(eta, fluid.dim).value
        else:
            curve = np.array([_mixture(float(e), known[0]) for e in eta])
        axes.plot(eta, curve, color=COLOURS["theory"], label=next(iter(known[0].theories)), zorder=2)
    for name, (mark, colour) in MARKS.items():
        if name in states[0].measured:
            axes.errorbar(
                [state.fluid.packing_fraction for state in states],
                [state.measured[name].value for state in states],
                [state.measured[name].standard_error for state in states],
                fmt=mark,
                ms={"virial": 5.0, "rate": 8.0, "walls": 6.5}[name],
                mfc=COLOURS[colour] if name == "virial" else "none",
                color=COLOURS[colour],
                label=WORDS[name],
                zorder=3,
            )
    axes.set_ylabel("compressibility factor $PV/NkT$")
    axes.set_title("Equation of state")
    axes.legend(loc="upper left")


def _mixture(eta: float, state: State) -> float:
    fluid = state.fluid
    shares = np.array([1.0 - fluid.fraction, fluid.fraction])
    diameters = np.array([1.0, fluid.diameter_ratio])
    per_number = math.pi / (2 * fluid.dim) * float(shares @ diameters**fluid.dim)
    return float(theory.mixture_compressibility(shares * eta / per_number, diameters, fluid.dim).value)


def _draw_residuals(axes: Axes, states: Sequence[State]) -> None:
    """Draw relative residuals, the theory's uncertainty as a band, and the classic formula as a line."""
    eta = np.array([state.fluid.packing_fraction for state in states])
    best = np.array([float(state.best.value) for state in states])
    uncertainty = 1e3 * np.array([float(state.best.uncertainty) for state in states]) / best
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    name = next(iter(states[0].theories))
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
    shift = _spread(states)
    for way, (mark, colour) in MARKS.items():
        if way in shift:
            residual = 1e3 * (np.array([state.measured[way].value for state in states]) / best - 1.0)
            error = 1e3 * np.array([state.measured[way].standard_error for state in states]) / best
            axes.errorbar(
                eta + shift[way], residual, error, fmt=mark, ms=4, lw=1.2, color=COLOURS[colour], zorder=3
            )
            largest = max(largest, float((np.abs(residual) + error).max()))
    fluid = states[0].fluid
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
    axes.legend(loc="upper center", ncols=2, fontsize=8)


def _draw_deviations(axes: Axes, states: Sequence[State]) -> None:
    eta = np.array([state.fluid.packing_fraction for state in states])
    series = []
    for way, shift in _spread(states).items():
        mark, colour = MARKS[way]
        z = [state.deviation(way) for state in states]
        series.append((eta + shift, z, {"marker": mark, "color": COLOURS[colour], "ms": 4}))
    deviations(axes, *series)
