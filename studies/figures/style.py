"""One style for all figures: colours for any colour vision, names of gases, deviations, limits, files."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Iterator
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from analysis.estimator import PALETTE
from studies.formats import FORMATS

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

__all__ = [
    "COLOURS",
    "MARKS",
    "SPECIES",
    "deviations",
    "falling",
    "figure_style",
    "name_gas",
    "save",
    "species_look",
]

COLOURS = {
    "theory": "#1d2733",
    "simulation": PALETTE[0],
    "band": "#9aa7b5",
    "warm": PALETTE[1],
    "other": PALETTE[2],
    "dark": PALETTE[3],
    "words": "#4a5562",
}
"""Colours of all figures: theory as a dark line, simulation as blue points."""

SPECIES, MARKS = PALETTE, ("o", "s", "^", "D", "v")
"""Colours and marks of species, the same in all figures."""

SEEN = 2.0  # standard errors below which a decaying quantity counts as lost in noise

LIMIT = "upper limit (2 std. errors)"

_STYLE: Any = {
    "figure.dpi": 100,
    "figure.autolayout": False,
    "figure.constrained_layout.use": False,  # where a figure does not ask for it
    "savefig.dpi": 160,
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10,
    "axes.labelcolor": "#1d2733",
    "axes.edgecolor": "#6b7785",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": f"cycler('color', {list(PALETTE)})",
    "xtick.color": "#4a5562",
    "ytick.color": "#4a5562",
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.6,
    "errorbar.capsize": 0,
    "mathtext.fontset": "dejavusans",
    "svg.fonttype": "path",  # looks the same everywhere
    "svg.hashsalt": "hardspheres",  # the same figure, the same bytes
}


@contextlib.contextmanager
def figure_style() -> Iterator[None]:
    """Draw and save figures in the style of the package while the context lasts."""
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def species_look(kind: int) -> dict[str, Any]:
    """Return colour and mark of the species with this index."""
    return {"color": SPECIES[kind % len(SPECIES)], "marker": MARKS[kind % len(MARKS)]}


def name_gas(figure: Figure, gas: str) -> None:
    """Write the name of the gas above a figure, and make it higher accordingly."""
    width, height = figure.get_size_inches()
    text = textwrap.fill(gas, int(14 * width))
    figure.set_size_inches(width, height + 0.1 + 0.17 * (1 + text.count("\n")))
    figure.suptitle(text, x=0.01, ha="left", fontsize=9.5, color=COLOURS["words"])


def save(figure: Figure, where: Path | IO[bytes], form: str) -> None:
    """Write a figure in one of the `FORMATS`; the same figure gives the same bytes.

    It is laid out once: what is written later has everything in the same place.
    """
    with figure_style():
        figure.savefig(where, format=form, metadata=FORMATS[form])
        figure.set_layout_engine(None)  # "none" leaves a place holder, for which all is drawn twice


def deviations(axes: Axes, *series: tuple[ArrayLike, ArrayLike, dict[str, Any]]) -> None:
    """Draw deviations in standard errors around 0, over the band that holds 95 % of them.

    Parameters
    ----------
    axes : Axes
        Where.
    *series : triples
        Abscissae, deviations, and further arguments of `Axes.plot`.
    """
    axes.axhspan(-2, 2, color=COLOURS["band"], alpha=0.25, lw=0)
    axes.axhline(0.0, color=COLOURS["theory"], lw=1.0)
    extent = 3.5
    plain: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3.5, "color": COLOURS["simulation"]}
    for x, z, look in series:
        axes.plot(x, z, **(plain | look))
        extent = max(extent, 1.15 * float(np.nanmax(np.abs(z), initial=0.0)))
    axes.set_ylim(-extent, extent)
    axes.set_ylabel("deviation in\nstd. errors\n(band: \u00b12)", fontsize=8.5)


def falling(
    axes: Axes,
    x: ArrayLike,
    y: ArrayLike,
    error: ArrayLike,
    noise: float = 0.0,
    **look: Any,
) -> None:
    """Draw a decaying quantity on a logarithmic axis: points, then upper limits of two standard errors.

    From the first point that is lost in noise on, all are limits: dropping only the low ones would make the
    rest appear to rise.

    Parameters
    ----------
    axes : Axes
        Where.
    x, y, error : (n,) array_like
        Points and their standard errors.
    noise : float, default 0
        Standard error of a quantity that is 0, where `error` can be smaller by chance.
    **look
        Of `Axes.errorbar`.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    scale = np.maximum(np.nan_to_num(np.asarray(error, dtype=np.float64)), noise)
    lost = np.flatnonzero(~(y > SEEN * scale))
    seen = np.arange(len(y)) < (lost[0] if len(lost) else len(y))
    common: dict[str, Any] = {"ms": 4, "lw": 1.2, "zorder": 3} | look
    low = np.minimum(scale, 0.9 * y)
    if seen.any():
        axes.errorbar(x[seen], y[seen], [low[seen], scale[seen]], **({"fmt": "o"} | common))
    limit = np.maximum(y, 0.0) + SEEN * scale
    shown = ~seen & (limit > 0.0)
    if shown.any():
        unlabelled = common | {"fmt": "_", "label": None}
        axes.errorbar(x[shown], limit[shown], 0.4 * limit[shown], uplims=True, capsize=2.0, **unlabelled)
        if LIMIT not in axes.get_legend_handles_labels()[1]:
            axes.plot([], [], ls="", marker=r"$\downarrow$", ms=8, color=COLOURS["words"], label=LIMIT)
