"""Figure of melting discs: where their bonds point, pressures, and how the order lasts and falls off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from analysis import theory
from analysis.hexatic import KOSTERLITZ_THOULESS
from studies.figures.style import COLOURS, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure", "order_colours"]

FloatArray = NDArray[np.float64]

WIDTH, LOWER = 11.6, 4.0  # inches: of the figure, height of its lower half
MOST_SHOWN = 4  # gases that are drawn
PIXELS = 520  # of the longer edge
FINE = 0.1  # diameters: pixels that show the gaps between discs,
GAP = 0.08  # whose colour is this grey
FULL = 0.8  # local order, from which on the colour is full
SMOOTHED = 80  # points of a smoothed curve
WORDS = {"fluid": "from a fluid", "crystal": "from a crystal"}
LINES: dict[str, dict[str, Any]] = {
    "fluid": {"ls": "-", "marker": "o"},
    "crystal": {"ls": "--", "marker": "D"},
}


def order_colours(psi: NDArray[np.complexfloating[Any]]) -> FloatArray:
    """Return the colour of each local order, (..., 3), red, green and blue from 0 to 1.

    The hue turns once while the bonds turn by 60 degrees; without order it is dark. Lightness does not depend
    on the direction: a circle in OKLab (Ottosson 2020, https://bottosson.github.io/posts/oklab).
    """
    size, angle = np.clip(np.abs(psi) / FULL, 0.0, 1.0), np.angle(psi)
    lightness, chroma = 0.28 + 0.46 * size, 0.125 * size
    a, b = chroma * np.cos(angle), chroma * np.sin(angle)
    cone = np.stack(
        [
            lightness + 0.3963377774 * a + 0.2158037573 * b,
            lightness - 0.1055613458 * a - 0.0638541728 * b,
            lightness - 0.0894841775 * a - 1.2914855480 * b,
        ],
        axis=-1,
    )
    to_linear = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear = np.clip(cone**3 @ to_linear.T, 0.0, 1.0)
    curved = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.asarray(np.where(linear <= 0.0031308, 12.92 * linear, curved), dtype=np.float64)


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw the discs of a run by the direction of their bonds, pressures, |Psi6| along the runs, and g6(r).

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.melting`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    shades = colormaps["viridis"](np.linspace(0.1, 0.8, max(len(answers), 2)))
    starts, ratio = list(answers[0].hidden["starts"]), answers[0].gas.ratio
    drawn_starts = starts if len(answers) * len(starts) <= MOST_SHOWN else starts[:1]
    count = min(MOST_SHOWN // len(drawn_starts), len(answers))
    picked = np.unique(np.linspace(0, len(answers) - 1, count).round().astype(int))
    shown = [(answers[which], start) for which in picked for start in drawn_starts]
    with figure_style():
        high = min(WIDTH / len(shown) / ratio, 4.4) + 1.0
        drawn = Figure(figsize=(WIDTH, high + LOWER), layout="constrained")
        upper, lower = cast(Any, drawn.subfigures(2, 1, height_ratios=[high, LOWER]))
        panels = np.atleast_1d(upper.subplots(1, len(shown)))
        for axes, (answer, start) in zip(panels, shown, strict=True):
            _draw_discs(axes, answer, start)
        _explain_colours(upper, panels)
        left, middle, right = lower.subplots(1, 3)
        _draw_pressures(left, answers, starts)
        for answer, shade in zip(answers, shades, strict=False):
            _draw_order(middle, answer, starts, shade)
            _draw_correlation(right, answer, starts, shade)
        _finish_order(middle, answers[0], starts)
        _finish_correlation(right, answers)
    return drawn


def _draw_discs(axes: Axes, answer: Answer, start: str) -> None:
    """Draw the last moment of a run."""
    from scipy.spatial import cKDTree

    gas, last = answer.gas, answer.hidden["last"][start].astype(np.float64)
    places, colours = last[:, :2], order_colours(last[:, 2] + 1j * last[:, 3])
    width, height = gas.box.tolist()
    edge = max(width, height) / PIXELS
    x, y = np.arange(0.5 * edge, width, edge), np.arange(0.5 * edge, height, edge)
    tree = cKDTree(np.mod(places, gas.box), boxsize=gas.box)
    distance, nearest = tree.query(np.stack(np.meshgrid(x, y), axis=-1))
    image = colours[nearest]
    if edge < FINE:  # else all of a disc is in few pixels
        inside = np.clip((0.5 - distance) / edge + 0.5, 0.0, 1.0)[..., None]
        image = inside * image + (1.0 - inside) * GAP
    axes.imshow(image, origin="lower", extent=(0.0, width, 0.0, height))
    axes.set_xlim(0.0, width)
    axes.set_ylim(0.0, height)
    axes.set_aspect("equal")
    axes.tick_params(length=2.0, labelsize=7.5)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.set_title(f"{gas.packing_fraction:.4g}, {WORDS[start]}")


def _explain_colours(figure: Any, panels: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    circle = ListedColormap(order_colours(np.exp(2j * np.pi * np.linspace(0.0, 1.0, 181))))
    scale = ScalarMappable(Normalize(0.0, 60.0), circle)
    bar = figure.colorbar(scale, ax=list(panels), location="bottom", aspect=60, shrink=0.5, pad=0.02)
    bar.set_ticks([0, 15, 30, 45, 60], labels=["0\u00b0", "15\u00b0", "30\u00b0", "45\u00b0", "60\u00b0"])
    bar.outline.set_visible(False)
    bar.set_label(
        "direction of the bonds to six neighbours, at the end (lengths in diameters); dark: no order",
        fontsize=9,
    )


def _draw_pressures(axes: Axes, answers: Sequence[Answer], starts: Sequence[str]) -> None:
    """Draw pressures of each start beside those of Monte Carlo, and where large boxes hold two phases."""
    low, high = theory.COEXISTENCE
    large = {"alpha": 0.22, "lw": 0}
    axes.axvspan(high, theory.HEXATIC_UP_TO, color=COLOURS["other"], **large, label="large box: hexatic")
    axes.axvspan(low, high, color=COLOURS["band"], **large, label="large box: liquid and hexatic")
    pressure = float(theory.COEXISTENCE_PRESSURE.value)
    looks: dict[str, Any] = {"color": COLOURS["words"], "lw": 1.2, "ls": (0, (4, 2))}
    axes.plot([low, high], [pressure] * 2, **looks, label=f"... at {pressure:g}")
    gas = answers[0].gas
    count = gas.n if len(theory.disc_pressures(gas.n)[0]) else 1024**2
    places, known = theory.disc_pressures(count, gas.ratio)
    axes.plot(places, known, color=COLOURS["theory"], lw=1.2, label=f"Monte Carlo, {count} discs", zorder=2)
    eta = np.array([answer.gas.packing_fraction for answer in answers])
    step = 0.0004 * (len(starts) > 1)
    for k, name in enumerate(starts):
        found = [answer.hidden["starts"][name][0] for answer in answers]
        axes.errorbar(
            eta + step * (2 * k - 1),
            [each.value for each in found],
            [each.standard_error for each in found],
            fmt=LINES[name]["marker"],
            ms=5,
            lw=1.2,
            color=COLOURS["simulation" if name == "fluid" else "warm"],
            label=WORDS[name],
            zorder=3,
        )
    edge = 0.15 * max(float(np.ptp(eta)), 0.02)
    axes.set_xlim(eta[0] - edge, eta[-1] + edge)
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    values = [found.value for answer in answers for found, _ in answer.hidden["starts"].values()]
    inside = known[(places >= eta[0] - edge) & (places <= eta[-1] + edge)]
    least, most = min([*values, *inside]), max([*values, *inside])
    room = 0.12 * (most - least) + 0.005
    axes.set_ylim(least - room, most + 6.0 * room)  # for the legend
    axes.set_xlabel("packing fraction")
    axes.set_ylabel(r"pressure $\beta P (2r)^2$")
    axes.set_title("Pressure")
    axes.legend(fontsize=8)


def _draw_order(axes: Axes, answer: Answer, starts: Sequence[str], shade: Any) -> None:
    """Draw |Psi6| along the runs from each start."""
    found = answer.curves["order"].flat()
    s = found["collisions_per_particle"] / 1000.0
    joined = max(len(s) // SMOOTHED, 1)
    cut = len(s) // joined * joined
    for name in starts:
        axes.plot(s, found[name], color=shade, lw=0.5, alpha=0.3)
        axes.plot(
            s[:cut].reshape(-1, joined).mean(axis=1),
            found[name][:cut].reshape(-1, joined).mean(axis=1),
            color=shade,
            lw=1.5,
            ls=LINES[name]["ls"],
            label=f"{answer.gas.packing_fraction:.4g}" if name == starts[0] else None,
        )


def _finish_order(axes: Axes, answer: Answer, starts: Sequence[str]) -> None:
    n, discarded = answer.gas.n, answer.details["equilibration"]
    axes.axvline(
        discarded / 1000.0, ymax=1.0 / 1.45, color=COLOURS["words"], lw=1.0, label="measured from here"
    )
    axes.axhline(1.0 / math.sqrt(n), color=COLOURS["words"], lw=1.0, ls=(0, (1, 2)), label=r"$1/\sqrt{N}$")
    if len(starts) > 1:
        for name in starts:
            axes.plot([], [], color=COLOURS["words"], lw=1.2, ls=LINES[name]["ls"], label=WORDS[name])
    axes.set_ylim(0.0, 1.45)  # with room for the legend
    axes.set_yticks(np.linspace(0.0, 1.0, 6))
    axes.set_xlim(left=0.0)
    axes.set_xlabel("thousands of collisions per particle")
    axes.set_ylabel(r"global order $|\Psi_6|$")
    axes.set_title("Order along the runs")
    axes.legend(fontsize=8, ncols=2, loc="upper left")


def _draw_correlation(axes: Axes, answer: Answer, starts: Sequence[str], shade: Any) -> None:
    """Draw g6 of each start, as far as it is seen."""
    found = answer.curves["g6"].flat()
    for name in starts:
        column = f"g6_{name}" if len(starts) > 1 else "g6"
        g6, error = found[column], np.nan_to_num(found[f"{column}_error"])
        lost = np.flatnonzero(~(g6 > 2.0 * error) & np.isfinite(g6))
        seen = (np.arange(len(g6)) < (lost[0] if len(lost) else len(g6))) & (g6 > 0.0)
        axes.errorbar(
            found["r"][seen],
            g6[seen],
            np.minimum(error[seen], 0.9 * g6[seen]),
            color=shade,
            lw=1.0,
            ls=LINES[name]["ls"],
            elinewidth=0.8,
            label=f"{answer.gas.packing_fraction:.4g}" if name == starts[0] else None,
        )


def _finish_correlation(axes: Axes, answers: Sequence[Answer]) -> None:
    found = answers[-1].curves["g6"].flat()
    r, g6 = found["r"], found["g6"]
    place = min(int(np.searchsorted(r, 2.5)), len(r) - 1)
    line = g6[place] * (r[place:] / r[place]) ** -KOSTERLITZ_THOULESS
    axes.plot(r[place:], line, color=COLOURS["theory"], lw=1.4, label=r"$r^{-1/4}$: end of the hexatic")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(1.0, 1.1 * r[-1])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("distance r in diameters")
    axes.set_ylabel("$g_6(r)$")
    axes.set_title("Correlation of the order")
    axes.legend(fontsize=8)
