"""Figure of the suite: deviation of each measured Z from its theory, with both uncertainties."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.figures.pressure import MARKS, WORDS, best, measured
from studies.figures.style import COLOURS, figure_style
from studies.fluid import Fluid

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

TITLES = {
    "spheres": "spheres, over Kolafa\u2013Labik\u2013Malijevsky",
    "discs": "discs, over resummed virials",
}


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw relative residuals of all states: spheres, discs and mixtures in panels of their own.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.pressure`.

    Returns
    -------
    Figure
    """
    groups: dict[str, list[Answer]] = {}
    for answer in answers:
        kind = "spheres" if answer.gas.dim == 3 else "discs"
        groups.setdefault("mixtures" if answer.gas.mixed else kind, []).append(answer)
    with figure_style():
        result = Figure(figsize=(6.8, 2.5 * len(groups) + 0.4), layout="constrained")
        for axes, (name, states) in zip(
            np.atleast_1d(result.subplots(len(groups), 1)), groups.items(), strict=True
        ):
            _draw(axes, states, by_name=name == "mixtures")
            axes.set_title(TITLES.get(name, "mixtures, each over its theory"))
    return result


def _words(fluid: Fluid) -> str:
    kind = "spheres" if fluid.dim == 3 else "discs"
    parts = [f"{kind} at {fluid.packing_fraction:g}"]
    if fluid.diameter_ratio != 1.0:
        parts.append(f"diameters 1:{fluid.diameter_ratio:g}")
    if fluid.mass_ratio != 1.0:
        parts.append(f"masses 1:{fluid.mass_ratio:g}")
    return "\n".join(parts)


def _draw(axes: Axes, states: Sequence[Answer], by_name: bool) -> None:
    places = (
        np.arange(len(states), dtype=np.float64)
        if by_name
        else np.array([state.gas.packing_fraction for state in states])
    )
    expected, own = best(states)
    uncertainty = 1e4 * own / expected
    width = 0.03 * (float(np.ptp(places)) if len(states) > 1 else 1.0)
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.2)
    axes.bar(
        places,
        2 * uncertainty,
        2 * width,
        -uncertainty,
        color=COLOURS["band"],
        alpha=0.4,
        label="uncertainty of theory",
    )
    largest = float(uncertainty.max())
    for way, side in (("Z from the virial", -0.35), ("Z from the rate", 0.35)):
        z, error = measured(states, way)
        residual, error = 1e4 * (z / expected - 1.0), 1e4 * error / expected
        largest = max(largest, float((np.abs(residual) + error).max()))
        mark, colour = MARKS[way]
        axes.errorbar(
            places + side * width,
            residual,
            error,
            fmt=mark,
            ms=4,
            lw=1.2,
            color=COLOURS[colour],
            label=WORDS[way],
            zorder=3,
        )
    if by_name:
        axes.set_xticks(places, [_words(state.gas) for state in states])
        axes.set_xlim(-0.5, len(states) - 0.5)
    else:
        axes.set_xlabel("packing fraction")
    axes.set_ylim(-1.2 * largest, (2.2 if by_name else 1.6) * largest)  # room for the legend
    axes.set_ylabel("$Z$ / theory \u2212 1\nin 1e-4", fontsize=8.5)
    axes.legend(loc="upper center", ncols=3, fontsize=7.5)
