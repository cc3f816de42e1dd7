"""Figure of a sweep: what was measured over the swept option, beside theory, and the deviations from it."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from studies.figures.style import COLOURS, deviations, figure_style, species_look

if TYPE_CHECKING:
    from analysis.statistics import TheoryCheck
    from studies.sweep import Swept

__all__ = ["figure"]

FloatArray = NDArray[np.float64]

DECADE = 10.0  # spanned by values: from here on their axis is logarithmic
STEEP = 30.0  # spanned by a quantity: the same
MANY_TICKS = 7
NEAREST = 1.4  # ratio of two values that can both have a label on a logarithmic axis
UNITS = {"temperature": "K", "pressure": "Pa", "diameter": "nm"}  # of options beside --gas
LABELS = {"n": "number of particles n", "dim": "dimension"}
STEPS = ("dim",)  # options between whose values there is nothing


def figure(found: Swept) -> Figure:
    """Draw the quantities of a sweep: points with error bars, theory as a line, deviations below.

    Parameters
    ----------
    found : Swept
        Of `studies.sweep`.

    Returns
    -------
    Figure
    """
    quantities = found.quantities
    compared = [any(math.isfinite(each.z) for _, each in found.numbers(name)) for name in quantities]
    wide = min(len(quantities), 2)
    rows = [range(k, min(k + wide, len(quantities))) for k in range(0, len(quantities), wide)]
    cells: list[list[str]] = []
    for row in rows:  # a quantity without a theory has the room of its deviations, too
        empty = [""] * (wide - len(row))
        cells.append([f"{k}" for k in row] + empty)
        cells.append([f"{k}z" if compared[k] else f"{k}" for k in row] + empty)
    with figure_style():
        drawn = Figure(figsize=(6.0 if wide == 1 else 9.4, 4.4 * len(rows)), layout="constrained")
        heights = [3.0, 1.0] * len(rows)
        panels: Any = drawn.subplot_mosaic(cells, height_ratios=heights, empty_sentinel="")  # type: ignore[arg-type]
        for k, quantity in enumerate(quantities):
            _draw(panels[f"{k}"], panels.get(f"{k}z"), found, quantity)
        if found.several:
            handles = dict(zip(*reversed(panels["0"].get_legend_handles_labels()), strict=True))
            drawn.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3)
    return drawn


def _places(found: Swept) -> tuple[FloatArray, bool]:
    """Return where the values stand on the axis, and whether they are numbers on it or one beside another."""
    values = [point.value for point in found.points]
    numeric = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    if numeric and found.name not in STEPS:
        return np.array(values, dtype=np.float64), True
    return np.arange(len(values), dtype=np.float64), False


def _draw(above: Axes, below: Axes | None, found: Swept, quantity: str) -> None:
    """Draw one quantity, and its deviations from theory where there is one."""
    x, numeric = _places(found)
    lows, series = [], []
    for k in range(max(map(len, found.alike))):
        mine = [_of(own[k].numbers if k < len(own) else (), quantity) for own in found.alike]
        known = [each for each in mine if each is not None]
        if not known:
            continue
        there = x[[each is not None for each in mine]]
        look: dict[str, Any] = {"color": COLOURS["simulation"], "marker": "o"}
        label = "simulation"
        if found.several:
            look, label = species_look(k), found.gases[k]
        value = np.array([each.measured.value for each in known])
        error = np.nan_to_num(np.array([each.measured.standard_error for each in known]))
        above.errorbar(there, value, error, ls="", ms=5, zorder=3, label=label, **look)
        _draw_theory(above, there, known, numeric, label=k == 0)
        lows.append(value - error)
        series.append((there, np.array([each.z for each in known]), {**look, "ms": 4}))
    above.set_ylabel(textwrap.fill(quantity, 34))
    _scale_of_quantity(above, lows)
    lowest = above
    if below is not None:
        deviations(below, *series)
        _axis(below, x, numeric, found)
        lowest = below
    _axis(above, x, numeric, found)
    above.tick_params(labelbottom=below is None)
    unit = UNITS.get(found.name) if getattr(found.study, "gas", None) is not None else None
    name = LABELS.get(found.name, found.name.replace("-", " "))
    lowest.set_xlabel(name + (f" [{unit}]" if unit else ""))
    if not found.several:  # above the panel: bars of errors may be anywhere in it
        above.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)


def _of(numbers: Sequence[TheoryCheck], quantity: str) -> TheoryCheck | None:
    found = next((each for each in numbers if each.quantity == quantity), None)
    return found if found is not None and math.isfinite(found.measured.value) else None


def _draw_theory(axes: Axes, x: FloatArray, known: Sequence[TheoryCheck], numeric: bool, label: bool) -> None:
    """Draw theory as a line with its uncertainty as a band, or as a mark at each value."""
    expected = np.array([each.expected for each in known])
    if not np.isfinite(expected).any():
        return
    names = dict.fromkeys(each.theory for each in known if each.theory)
    name = textwrap.shorten(", ".join(names) or "expected", 44, placeholder=" ...") if label else None
    uncertainty = np.nan_to_num(np.array([each.uncertainty for each in known]))
    if not numeric or len(known) == 1:
        axes.errorbar(x, expected, uncertainty, ls="", marker="_", ms=22, color=COLOURS["theory"], label=name)
        return
    order = np.argsort(x)
    axes.plot(x[order], expected[order], color=COLOURS["theory"], lw=1.4, zorder=2, label=name)
    low, high = (expected - uncertainty)[order], (expected + uncertainty)[order]
    axes.fill_between(x[order], low, high, color=COLOURS["band"], alpha=0.4, lw=0)


def _scale_of_quantity(axes: Axes, lows: Sequence[FloatArray]) -> None:
    """Make the axis of a quantity logarithmic where it spans much, and no error bar reaches 0."""
    every = np.concatenate([each[np.isfinite(each)] for each in lows]) if lows else np.zeros(0)
    if every.size and every.min() > 0.0 and every.max() > STEEP * every.min():
        axes.set_yscale("log")


def _axis(axes: Axes, x: FloatArray, numeric: bool, found: Swept) -> None:
    """Set scale, limits and labels of the axis of the values."""
    if not numeric:
        axes.set_xticks(x, [textwrap.shorten(point.text, 24, placeholder=" ...") for point in found.points])
        axes.set_xlim(-0.5, len(x) - 0.5)
        return
    low, high = float(x.min()), float(x.max())
    if low > 0.0 and high > DECADE * low:
        axes.set_xscale("log")
        margin = (high / low) ** 0.06
        axes.set_xlim(low / margin, high * margin)
        apart = np.diff(np.log(np.sort(x))).min() > math.log(NEAREST)
        if len(x) <= MANY_TICKS and apart:
            axes.set_xticks(x, [point.text for point in found.points])
            axes.xaxis.set_minor_locator(NullLocator())
        return
    margin = 0.06 * (high - low)
    axes.set_xlim(low - margin, high + margin)
