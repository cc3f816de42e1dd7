"""Figure of the calibration: the pulls of every estimator over its Student's t."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from studies.figures.style import COLOURS, figure_style

if TYPE_CHECKING:
    from studies.validation.calibration import Row

__all__ = ["figure"]

COLUMNS = 5


def figure(rows: Sequence[Row]) -> Figure:
    """Draw one small histogram of (value - truth)/standard error per estimator.

    Parameters
    ----------
    rows : sequence of Row
        As in the table.

    Returns
    -------
    Figure
    """
    lines = math.ceil(len(rows) / COLUMNS)
    edges = np.linspace(-4.5, 4.5, 19)
    x = np.linspace(-4.5, 4.5, 200)
    with figure_style():
        result = Figure(figsize=(11.0, 1.75 * lines + 0.6), layout="constrained")
        grid = np.atleast_2d(result.subplots(lines, COLUMNS, sharex=True, sharey=True))
        for axes, row in zip(grid.flat, rows, strict=False):
            counts = np.histogram(np.clip(row.pulls, -4.49, 4.49), edges)[0]
            density = counts / len(row.pulls) / np.diff(edges)
            colour = COLOURS["simulation" if row.result.passed else "warm"]
            axes.stairs(density, edges, fill=True, color=colour, alpha=0.45)
            axes.plot(x, stats.t.pdf(x, min(row.degrees_of_freedom, 1e9)), color=COLOURS["theory"], lw=1.2)
            axes.set_title(f"{row.name}\n{row.family}, KS p = {row.result.p_value:.2g}", fontsize=7.5)
            axes.yaxis.set_major_locator(MaxNLocator(3))
            axes.tick_params(labelsize=7)
        for axes in grid.flat[len(rows) :]:
            axes.set_visible(False)
        for axes in grid.flat[max(len(rows) - COLUMNS, 0) : len(rows)]:  # the lowest of each column
            axes.tick_params(labelbottom=True)
        result.supylabel("probability density", fontsize=9)
        result.supxlabel(
            "(value \u2212 truth) / standard error; line: Student's t with the degrees of freedom quoted",
            fontsize=9,
        )
    return result
