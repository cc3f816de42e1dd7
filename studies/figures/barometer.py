"""Figure of fluids under gravity: density, temperature and equation of state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import theory
from studies.figures.style import COLOURS, figure_style, species_look

if TYPE_CHECKING:
    from analysis.barometer import HeightProfile
    from studies.answer import Answer

__all__ = ["figure"]

FloatArray = NDArray[np.float64]
HEIGHT = "height above the floor / diameter"


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw a row for each gas: density and temperature against height, and the equation of state.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.barometer`.

    Returns
    -------
    Figure
    """
    with figure_style():
        drawn = Figure(figsize=(11.6, 3.5 * len(answers)), layout="constrained")
        rows = drawn.subplots(len(answers), 3, squeeze=False)
        for answer, (density, temperature, state) in zip(answers, rows, strict=True):
            profile: HeightProfile = answer.hidden["profile"]
            where = f", {answer.label}" if len(answers) > 1 else ""
            _draw_densities(density, profile, where)
            _draw_temperatures(temperature, profile)
            _draw_state(state, profile)
    return drawn


def _names(profile: HeightProfile) -> list[str]:
    labels = profile.gas.labels
    return ["simulation"] if len(labels) == 1 else labels


def _draw_densities(axes: Axes, profile: HeightProfile, where: str) -> None:
    (value, error), expected, clear = profile.densities, profile.expected, profile.clear
    for k, name in enumerate(_names(profile)):
        z, look = profile.heights[k], species_look(k)
        left = "not compared: layers at walls" if k == 0 and not clear.all() else None
        axes.errorbar(z, value[k], error[k], ls="", ms=4, lw=1.2, label=name, zorder=3, **look)
        axes.plot(z[~clear], value[k][~clear], ls="", ms=4, mfc="white", zorder=4, label=left, **look)
        axes.plot(
            z, expected.value[k], color=COLOURS["theory"], lw=1.2, label="hydrostatics" if k == 0 else None
        )
        decay = profile.weights[k] * z / (1.0 if np.isnan(profile.temperature) else profile.temperature)
        law = np.exp(-decay) * value[k].sum() / np.exp(-decay).sum()
        axes.plot(
            z, law, ls=(0, (4, 2)), lw=1.0, color=COLOURS["band"], label="barometric law" if k == 0 else None
        )
    axes.set_yscale("log")
    axes.set_xlabel(HEIGHT)
    axes.set_ylabel("number density")
    axes.set_title(f"Density{where}")
    axes.legend(loc="lower left", fontsize=8)


def _draw_temperatures(axes: Axes, profile: HeightProfile) -> None:
    value, error = profile.temperatures
    expected = profile.expected_temperatures
    for k in range(len(value)):
        z = profile.heights[k]
        axes.errorbar(z, value[k], error[k], ls="", ms=4, lw=1.2, zorder=3, **species_look(k))
        label = "theory, fixed energy" if k == 0 else None
        axes.plot(z, expected[k], color=COLOURS["theory"], lw=1.2, label=label)
    axes.set_xlabel(HEIGHT)
    axes.set_ylabel("kT")
    axes.set_title("Temperature of those at each height")
    axes.legend(loc="best", fontsize=8)


def _draw_state(axes: Axes, profile: HeightProfile) -> None:
    """Draw Z of each slice against its packing fraction; of unequal diameters the pressure against height."""
    clear, gas = profile.clear, profile.gas
    if profile.theory is None or len(gas.sizes) > 1:
        pressure, error = profile.pressures
        axes.errorbar(profile.heights[0], pressure, error, fmt="o", ms=4, color=COLOURS["simulation"])
        axes.set_xlabel(HEIGHT)
        axes.set_ylabel("pressure")
        axes.set_title("Weight above, and force on the lid")
        return
    eta = theory.packing_fraction(profile.densities[0].sum(axis=0), gas.diameters[0], gas.dim)
    value, error, _ = profile.state
    fine = np.linspace(0.0, min(1.05 * float(eta[clear].max(initial=1e-3)), 0.494), 200)
    law = theory.compressibility_factor(fine, gas.dim).value
    axes.plot(fine, law, color=COLOURS["theory"], lw=1.2, label="equation of state")
    look: dict[str, Any] = {
        "ls": "",
        "marker": "o",
        "ms": 4,
        "lw": 1.2,
        "zorder": 3,
        "color": COLOURS["simulation"],
    }
    axes.errorbar(eta[clear], value[clear], error[clear], label="weight above / (n kT)", **look)
    axes.set_xlabel("packing fraction of the slice")
    axes.set_ylabel("Z")
    axes.set_title("Equation of state from one column")
    axes.legend(loc="upper left", fontsize=8)
