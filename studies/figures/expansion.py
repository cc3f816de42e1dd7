"""Figure of a free expansion: densities, shares and entropy, then the way back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import theory
from analysis.expansion import Spreading, in_upper_half
from analysis.theory.lyapunov import LOST
from studies.figures.style import COLOURS, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

FloatArray = NDArray[np.float64]

PROFILES = (0.0, 0.5, 1.0, 2.0)  # transit times whose densities are drawn
TIME = "time / transit time"


def figure(answer: Answer) -> Figure:
    """Draw densities, shares of both halves and entropy over theory; below the ways back.

    Parameters
    ----------
    answer : Answer
        Of `studies.expansion`.

    Returns
    -------
    Figure
    """
    with figure_style():
        drawn = Figure(figsize=(11.6, 7.4), layout="constrained")
        panels = drawn.subplot_mosaic([["density", "share", "entropy"], ["back", "back", "off"]])
        _draw_densities(panels["density"], answer)
        _draw_shares(panels["share"], answer)
        _draw_entropy(panels["entropy"], answer)
        _draw_way_back(panels["back"], answer)
        _draw_distance(panels["off"], answer)
    return drawn


def _part(answer: Answer, curves: str, name: str) -> FloatArray:
    return answer.curves[curves].flat()[name]


def _theory(answer: Answer) -> tuple[FloatArray, FloatArray]:
    """Return close times, in transit times, and the shares of all cells in theory there."""
    there: Spreading = answer.hidden["there"]
    fine = np.linspace(0.0, float(there.time[-1]), 400)
    return fine / answer.gas.half, there.expected(fine)


def _draw_densities(axes: Axes, answer: Answer) -> None:
    t, x = _part(answer, "profiles", "t"), _part(answer, "profiles", "x") / answer.gas.half
    colours = colormaps["viridis"](np.linspace(0.0, 0.8, len(PROFILES)))
    for wanted, colour in zip(PROFILES, colours, strict=True):
        here = t == t[np.argmin(np.abs(t - wanted))]
        value, error = (
            _part(answer, "profiles", "density")[here],
            _part(answer, "profiles", "density_error")[here],
        )
        axes.errorbar(
            x[here], value, error, fmt="o", ms=3.5, lw=1.2, color=colour, label=f"t = {t[here][0]:g}"
        )
        axes.step(
            x[here], _part(answer, "profiles", "density_theory")[here], where="mid", color=colour, lw=1.0
        )
    axes.set_ylim(0.0, 2.9)
    axes.set_xlabel("x / half of the box")
    axes.set_ylabel("density / density at the end")
    axes.set_title("Density of those from the left" if answer.gas.mix else "Density")
    axes.legend(loc="upper right", ncols=2, fontsize=8)


def _draw_shares(axes: Axes, answer: Answer) -> None:
    t, right = (_part(answer, "spreading", name) for name in ("t", "right"))
    error = _part(answer, "spreading", "right_error")
    fine, shares = _theory(answer)
    crossed = in_upper_half(shares)
    for name, value, line, mark, colour in (
        ("left", 1.0 - right, 1.0 - crossed, "s", COLOURS["warm"]),
        ("right", right, crossed, "o", COLOURS["simulation"]),
    ):
        axes.plot(fine, line, color=COLOURS["theory"], lw=1.2)
        axes.errorbar(t, value, error, fmt=mark, ms=4, lw=1.2, color=colour, label=f"{name} half", zorder=3)
    axes.plot([], [], color=COLOURS["theory"], lw=1.2, label=answer.details["theory"])
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel(TIME)
    axes.set_ylabel("share of the particles")
    axes.set_title("In each half, of those from the left" if answer.gas.mix else "In each half")
    axes.legend(loc="upper right")


def _draw_entropy(axes: Axes, answer: Answer) -> None:
    t, value, error = (_part(answer, "spreading", name) for name in ("t", "entropy", "entropy_error"))
    fine, shares = _theory(answer)
    axes.axhline(np.log(2.0), color=COLOURS["band"], lw=1.0, ls=(0, (4, 2)), label="ln 2")
    axes.plot(
        fine, theory.spread_entropy(shares), color=COLOURS["theory"], lw=1.2, label=answer.details["theory"]
    )
    axes.errorbar(
        t, value, error, fmt="o", ms=4, lw=1.2, color=COLOURS["simulation"], label="simulation", zorder=3
    )
    axes.set_xlabel(TIME)
    axes.set_ylabel(r"entropy per particle / $k_\mathrm{B}$")
    axes.set_title("Coarse-grained entropy of positions")
    axes.legend(loc="lower right")


def _reversed(answer: Answer) -> list[tuple[float, NDArray[np.bool_], Any]]:
    """Return each reversal: collisions per particle, its rows in the file of the ways back, colour."""
    rows = _part(answer, "way_back", "reversed")
    found = list(dict.fromkeys(rows.tolist()))
    colours = colormaps["plasma"](np.linspace(0.0, 0.85, len(found)))
    return [(s, rows == s, colour) for s, colour in zip(found, colours, strict=True)]


def _draw_way_back(axes: Axes, answer: Answer) -> None:
    """Draw the share in the left half against the time since the opening, there and back."""
    retraced, right, error = (
        _part(answer, "way_back", name) for name in ("t_retraced", "right", "right_error")
    )
    turned = dict(zip(_part(answer, "returns", "reversed"), _part(answer, "returns", "t"), strict=True))
    fine, shares = _theory(answer)
    last = 2.0 * max(turned.values())
    shown = fine <= last
    crossed = in_upper_half(shares)
    axes.plot(
        fine[shown],
        1.0 - crossed[shown],
        color=COLOURS["theory"],
        lw=1.2,
        label=f"{answer.details['theory']}, not reversed",
    )
    t = _part(answer, "spreading", "t")
    axes.errorbar(
        t[t <= last],
        1.0 - _part(answer, "spreading", "right")[t <= last],
        _part(answer, "spreading", "right_error")[t <= last],
        fmt="o",
        ms=4,
        lw=1.2,
        color=COLOURS["band"],
        label="not reversed",
    )
    for s, rows, colour in _reversed(answer):
        time = 2.0 * turned[s] - retraced[rows]
        axes.errorbar(
            time,
            1.0 - right[rows],
            error[rows],
            fmt="-",
            lw=1.4,
            elinewidth=0.8,
            color=colour,
            label=f"reversed at s = {s:.3g}",
        )
    axes.set_ylim(0.4, 1.03)
    axes.set_xlabel(TIME)
    axes.set_ylabel("share in the left half")
    axes.set_title("The way back, after all velocities were reversed")
    axes.legend(loc="upper right", fontsize=8)


def _draw_distance(axes: Axes, answer: Answer) -> None:
    since, off = _part(answer, "way_back", "s_since"), _part(answer, "way_back", "off")
    for _, rows, colour in _reversed(answer):
        axes.plot(since[rows], off[rows], "-o", ms=2.5, lw=1.2, color=colour)
    horizon = float(answer.gas.horizon.value)
    if np.isfinite(horizon):
        axes.plot(
            [0.0, horizon],
            [answer.gas.rounding, LOST],
            color=COLOURS["theory"],
            lw=1.2,
            label="Lyapunov exponent",
        )
        axes.legend(loc="lower right")
    axes.set_yscale("log")
    axes.set_xlabel("collisions per particle on the way back")
    axes.set_ylabel("rms distance from the way there / diameter")
    axes.set_title("Memory of the way there")
