"""Figure of speed against error: processor time per true collision over each kind of error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from studies.figures.style import COLOURS, figure_style
from studies.validation.accuracy_few import ENGINE, METHODS, REFERENCE
from studies.validation.time_stepping import BACK_UP, BOUNCE

if TYPE_CHECKING:
    from studies.validation.accuracy import Compared

__all__ = ["figure"]

LOOKS = {
    ENGINE: ("*", COLOURS["simulation"], 13.0),
    REFERENCE: ("D", COLOURS["other"], 5.5),
    BOUNCE: ("o", COLOURS["warm"], 4.5),
    BACK_UP: ("s", COLOURS["dark"], 4.5),
}
DASHES = ["-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (5, 1.5, 1, 1.5))]
LEAST = 2e-17  # where an error of exactly 0 is drawn
SEEN = 2.0  # standard errors below which an error is drawn as an upper limit

Point = tuple[float, float, float, float, bool]  # error, its range, seconds, whether it is an upper limit


def figure(compared: Sequence[Compared]) -> Figure:
    """Draw six kinds of error against what they cost, one panel each.

    Parameters
    ----------
    compared : sequence of Compared
        By ascending packing fraction: filled marks and full lines for the last, open ones and dashes for the
        others.

    Returns
    -------
    Figure
    """
    with figure_style():
        result = Figure(figsize=(10.4, 7.0), layout="constrained")
        panels = result.subplots(2, 3).ravel()
        for index, state in enumerate(compared):
            last = len(compared) - 1
            look = (index == last, DASHES[(last - index) % len(DASHES)])
            for method in METHODS:
                _draw(panels[0], method, _trajectory(state, method), look)
                _draw(panels[1], method, _missed(state, method), look)
                _draw(panels[2], method, _of_run(state, method, "overlap"), look)
                _draw(panels[3], method, _biases(state, method, "pressure"), look)
                _draw(panels[4], method, _biases(state, method, "free_path"), look)
                _draw(panels[5], method, _of_run(state, method, "energy"), look)
        titles = {
            "trajectory": "distance from the true one, diameters",
            "missed collisions": "per true collision",
            "overlap": "deepest, diameters",
            "pressure": "relative error of $Z - 1$",
            "mean free path": "relative error",
            "energy": "relative drift",
        }
        for axes, (title, label) in zip(panels, titles.items(), strict=True):
            axes.set(xscale="log", yscale="log", title=title, xlabel=label)
        for axes in panels:
            _scale(axes)
        for axes in (panels[0], panels[3]):
            axes.set_ylabel("processor time per\ntrue collision, \u00b5s")
        _legend(result, compared)
    return result


def _draw(axes: Axes, method: str, points: Sequence[Point], look: tuple[bool, object]) -> None:
    """Draw one method at one packing fraction; upper limits point to the left."""
    mark, colour, size = LOOKS[method]
    filled, dashes = look
    face = colour if filled else "white"
    seen = [(error, 1e6 * seconds) for error, _, _, seconds, limit in points if not limit]
    if len(seen) > 1:
        axes.plot(*zip(*seen, strict=True), color=colour, ls=dashes, lw=1.1, zorder=2)
    for error, low, high, seconds, limit in points:
        if high > low:
            axes.plot([low, high], [1e6 * seconds] * 2, color=colour, lw=0.8, alpha=0.5, zorder=2)
        if limit:
            axes.plot([0.6 * error, error], [1e6 * seconds] * 2, color=colour, lw=0.9, zorder=3)
            axes.plot(0.6 * error, 1e6 * seconds, "<", ms=3.5, color=colour, mew=0.0, zorder=3)
        axes.plot(error, 1e6 * seconds, mark, ms=size, color=colour, mfc=face, mew=1.1, zorder=4)


def _scale(axes: Axes) -> None:
    """Let both axes show whole decades."""
    for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        low, high = (math.log10(limit) for limit in limits)
        axis.set_view_interval(10.0 ** math.floor(low), 10.0 ** math.ceil(high), ignore=True)
        axis.set_major_locator(LogLocator(numticks=8))
        axis.set_minor_formatter(NullFormatter())


def _trajectory(state: Compared, method: str) -> list[Point]:
    points = []
    for (name, _), few in state.few.items():
        if name == method:
            middle, worst = float(np.median(few.trajectory)), max(few.trajectory)
            points.append((middle, middle, worst, float(np.median(few.seconds)), False))
    return points


def _missed(state: Compared, method: str) -> list[Point]:
    """Missed collisions; where there was none, the upper limit is one in all that were tested."""
    points = []
    for (name, _), long in state.long.items():
        if name == method:
            error = max(long.missed, 1.0 / long.audited)
            points.append((error, error, error, long.seconds, long.missed == 0.0))
    return points


def _of_run(state: Compared, method: str, name: str) -> list[Point]:
    """Overlap or energy drift of the long run; of few particles for the reference solver; None: no point."""
    if method == REFERENCE:
        few = next(few for (own, _), few in state.few.items() if own == method)
        found = [(max(getattr(few, name)), float(np.median(few.seconds)))]
    else:
        found = [
            (getattr(long, name), long.seconds) for (own, _), long in state.long.items() if own == method
        ]
    return [(max(error, LEAST), LEAST, LEAST, seconds, error == 0.0) for error, seconds in found]


def _biases(state: Compared, method: str, name: str) -> list[Point]:
    points = []
    for (own, _), long in state.long.items():
        if own == method:
            estimate = getattr(long, name)
            error, noise = abs(estimate.value), estimate.standard_error
            limit = error < SEEN * noise
            middle = SEEN * noise if limit else error
            low, high = (middle, middle) if limit else (max(error - noise, 0.1 * error), error + noise)
            points.append((middle, low, high, long.seconds, limit))
    return points


def _legend(result: Figure, compared: Sequence[Compared]) -> None:
    handles = [
        Line2D(
            [],
            [],
            color=colour,
            marker=mark,
            ms=size,
            ls="-" if name in (BOUNCE, BACK_UP) else "",
            label=METHODS[name],
        )
        for name, (mark, colour, size) in LOOKS.items()
    ]
    last = len(compared) - 1
    for index, state in enumerate(compared):
        face = COLOURS["theory"] if index == last else "white"
        label = f"packing fraction {state.fluid.packing_fraction:g}"
        style = DASHES[(last - index) % len(DASHES)]
        handles.append(
            Line2D(
                [], [], color=COLOURS["theory"], marker="o", ms=4.5, mfc=face, ls=style, lw=1.1, label=label
            )
        )
    handles.append(
        Line2D([], [], color=COLOURS["theory"], marker="<", ms=3.5, ls="-", lw=0.9, label="at most")
    )
    result.legend(handles=handles, loc="outside lower center", ncols=math.ceil(len(handles) / 2))
