"""Figure of the benchmark: collisions per second against the number of particles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from studies.figures.style import COLOURS, figure_style

__all__ = ["rates"]

SAME = 1e-6  # packing fractions closer than this are one curve


def rates(states: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw median rates against N, one curve per packing fraction, with quartiles; the peer's hollow.

    Parameters
    ----------
    states : sequence of mappings
        Results of `studies.benchmarks.bench.measure`.

    Returns
    -------
    Figure
    """
    densities = sorted({round(state["packing_fraction"] / SAME) for state in states})
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(densities)))
    with figure_style():
        figure = Figure(figsize=(7.2, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        for density, colour in zip(densities, colours, strict=True):
            here = [state for state in states if round(state["packing_fraction"] / SAME) == density]
            here.sort(key=lambda state: int(state["n"]))
            _curve(axes, [(s["n"], s["cpu"]) for s in here], colour, "o-", f"{density * SAME:.3g}")
            theirs = [(s["n"], s["against"]["cpu"]) for s in here if s["against"]]
            _curve(axes, theirs, colour, "s:", None)
        axes.set(xscale="log", yscale="log")
        axes.set_xlabel("number of particles $N$")
        axes.set_ylabel("collisions per second of processor time")
        axes.set_title(
            "Speed of the event loop on one core, gas in equilibrium:\nmedians of windows, bars between "
            "quartiles"
        )
        axes.grid(which="major", color="#e3e7ec", lw=0.7)
        axes.set_axisbelow(True)
        handles, labels = axes.get_legend_handles_labels()
        legend = axes.legend(
            handles[::-1],
            labels[::-1],
            title="packing fraction",
            loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
            alignment="left",
        )
        peer = next((s["against"] for s in states if s["against"]), None)
        if peer is not None:
            axes.add_artist(legend)
            style = {"color": COLOURS["theory"], "ms": 4.5}
            keys = [
                Line2D([], [], marker="o", ls="-", label="hardspheres", **style),  # type: ignore[arg-type]
                Line2D(
                    [],
                    [],
                    marker="s",
                    ls=":",
                    mfc="white",
                    lw=1.1,
                    label=peer["name"],
                    **style,  # type: ignore[arg-type]
                ),
            ]
            axes.legend(handles=keys, loc="lower left", bbox_to_anchor=(1.01, 0.0))
    return figure


def _curve(
    axes: Any, points: Sequence[tuple[int, Mapping[str, float]]], colour: Any, style: str, label: str | None
) -> None:
    """Draw medians with bars between the quartiles."""
    if not points:
        return
    n = np.array([point[0] for point in points])
    middle, low, high = (
        np.array([point[1][name] for point in points])
        for name in ("median", "lower_quartile", "upper_quartile")
    )
    hollow = style[0] == "s"
    axes.errorbar(
        n,
        middle,
        np.maximum([middle - low, high - middle], 0.0),
        fmt=style,
        color=colour,
        mfc="white" if hollow else colour,
        ms=4.0 if hollow else 5.0,
        lw=1.1 if hollow else 1.6,
        elinewidth=1.0,
        label=label,
        zorder=2 if hollow else 3,
    )
