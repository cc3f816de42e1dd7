"""Figure of the analysis of a trajectory."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import theory
from studies.figures.style import COLOURS, figure_style, species_look

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

FloatArray = NDArray[np.float64]

STEADY = 1e-6  # relative changes of kT below which the axis does not show them
AXES = (":", "--", "-.")


def figure(answer: Answer) -> Figure:
    """Draw speeds, components, g(r) and temperatures, as far as there are any.

    Parameters
    ----------
    answer : Answer
        Of `studies.analyse`.

    Returns
    -------
    Figure
    """
    found = answer.hidden["found"]
    draw: list[Any] = [_speeds, _components] if found.gas.moving else []
    draw += [_pairs] if found.pairs is not None else []
    draw += [_temperatures] if found.gas.moving and found.gas.n_frames > 1 else []
    columns = 2 if len(draw) > 1 else 1
    rows = math.ceil(len(draw) / columns)
    with figure_style():
        drawn = Figure(figsize=(4.7 * columns, 3.5 * rows), layout="constrained")
        for place, panel in enumerate(draw):
            panel(drawn.add_subplot(rows, columns, place + 1), answer)
    return drawn


def _labels(found: Any) -> list[str]:
    kinds = found.speeds.labels
    return ["file"] if len(kinds) == 1 else [f"species {k}: {label}" for k, label in enumerate(kinds, 1)]


def _speeds(axes: Axes, answer: Answer) -> None:
    found = answer.hidden["found"]
    measured = found.speeds
    middle = (measured.edges[1:] + measured.edges[:-1]) / 2
    fine = np.linspace(0.0, 4.5, 300)
    axes.plot(
        fine,
        theory.speed_pdf(fine, found.gas.dim),
        color=COLOURS["theory"],
        label="Maxwell\u2013Boltzmann",
        zorder=2,
    )
    for kind, label in enumerate(_labels(found)):
        _points(axes, middle, measured.density[kind], measured.density_error[kind], label, kind)
    axes.set_xlim(0.0, 4.5)
    axes.set_xlabel(r"speed / $\sqrt{kT/m}$")
    axes.set_ylabel("probability density")
    axes.set_title("Speeds")
    axes.legend(loc="upper right")


def _points(axes: Axes, x: FloatArray, y: FloatArray, error: FloatArray, label: str, kind: int) -> None:
    """Draw a histogram as points, without empty bins."""
    seen = y > 0.0
    axes.errorbar(
        x[seen], y[seen], error[seen], ls="", ms=3, lw=1.0, label=label, zorder=3, **species_look(kind)
    )


def _components(axes: Axes, answer: Answer) -> None:
    """Draw the components along all axes on a logarithmic scale, species together where there is one."""
    found = answer.hidden["found"]
    fine = np.linspace(-4.2, 4.2, 300)
    axes.plot(
        fine, theory.component_pdf(fine), color=COLOURS["theory"], label="Maxwell\u2013Boltzmann", zorder=2
    )
    for axis, measured in enumerate(found.components):
        middle = (measured.edges[1:] + measured.edges[:-1]) / 2
        sizes = measured.gas.sizes / measured.gas.n
        density = sizes @ measured.density
        error = np.sqrt(sizes**2 @ measured.density_error**2)
        _points(axes, middle, density, error, f"along {'xyz'[axis]}", axis)
    axes.set_yscale("log")
    axes.set_ylim(1e-4, 3.0)
    axes.set_xlabel(r"velocity component / $\sqrt{kT/m}$")
    axes.set_ylabel("probability density")
    axes.set_title("Velocity components")
    axes.legend(loc="upper right", ncols=2, fontsize=8)


def _pairs(axes: Axes, answer: Answer) -> None:
    found = answer.hidden["found"]
    pairs, sized = found.pairs, found.gas.sized
    r, g, error = pairs.r, pairs.g, pairs.g_error
    for index, (i, j) in enumerate(pairs.pairs):
        label = "file" if len(r) == 1 else f"species {i + 1}, {j + 1}"
        scale = float(pairs.gas.diameters[i] + pairs.gas.diameters[j]) / 2.0 if sized else 1.0
        look = species_look(index)
        axes.errorbar(
            r[index] / scale, g[index], error[index], ls="", ms=3, lw=1.0, label=label, zorder=3, **look
        )
        name = "g at contact" if len(r) == 1 else f"g at contact, species {i + 1} and {j + 1}"
        if sized and np.isfinite(answer[name].expected):
            axes.plot(1.0, answer[name].expected, "D", ms=7, mfc="none", color=look["color"], zorder=4)
    if sized:
        axes.plot([], [], "D", ms=7, mfc="none", color=COLOURS["words"], label="theory at contact")
    axes.axhline(1.0, color=COLOURS["band"], lw=1.0, zorder=1)
    axes.set_ylim(bottom=max(axes.get_ylim()[0], -0.2))
    axes.set_xlabel("distance / diameter" if sized else "distance")
    if len(r) > 1:
        axes.set_xlabel("distance / distance at contact")
    axes.set_ylabel("g(r)")
    axes.set_title("Pair distribution")
    axes.legend(loc="best")


def _temperatures(axes: Axes, answer: Answer) -> None:
    """Draw kT, that of each axis and of each species over the mean, against time."""
    found = answer.hidden["found"]
    rows, mean = found.moments.table, float(found.moments.temperature)
    curves = answer.curves["frames"]
    (name, when), *_ = curves.axes.items()
    kT = rows["kT"] / mean
    flat = float(np.ptp(kT)) < STEADY
    axes.plot(when, np.ones_like(kT) if flat else kT, color=COLOURS["theory"], lw=2.0, label="all", zorder=2)
    for axis in range(found.gas.dim):
        axes.plot(
            when,
            kT * rows[f"kT_{'xyz'[axis]}_over_kT"],
            AXES[axis],
            color=COLOURS["words"],
            lw=1.0,
            label=f"along {'xyz'[axis]}",
            zorder=1,
        )
    kinds = len(found.moments.gas.sizes)
    for kind in range(kinds if kinds > 1 else 0):
        look = species_look(kind) | {"ms": 3, "lw": 1.0}
        axes.plot(when, kT * rows[f"kT_{kind + 1}_over_kT"], label=f"species {kind + 1}", zorder=3, **look)
    axes.set_xlabel(name)
    axes.set_ylabel("kT / its mean")
    axes.set_title("Temperature and drift")
    axes.legend(loc="best", ncols=2, fontsize=8)
