"""Figure of a Lorentz gas: a track among obstacles, displacements, and lengths of flights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from studies.figures.style import COLOURS, MARKS, figure_style

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]


def figure(answers: Sequence[Answer]) -> Figure:
    """Draw a track, mean square displacements over 2 d t, and the share of longer flights.

    Parameters
    ----------
    answers : sequence of Answer
        Of `studies.lorentz`, by ascending packing fraction.

    Returns
    -------
    Figure
    """
    shades = colormaps["viridis"](np.linspace(0.1, 0.75, max(len(answers), 2)))
    with figure_style():
        drawn = Figure(figsize=(12.4, 4.0), layout="constrained")
        left, middle, right = drawn.subplots(1, 3)
        _draw_track(left, answers[0])
        for k, (answer, shade) in enumerate(zip(answers, shades, strict=False)):
            look = {"color": shade, "fmt": MARKS[k % len(MARKS)], "ms": 4, "lw": 1.0}
            _draw(middle, answer, "displacement", "mean_free_times", "diffusion", look)
            _draw(right, answer, "free_path_survival", "mean_free_paths", "survival", look)
            if answer.gas.finite_horizon and np.isfinite(answer["diffusion coefficient"].expected):
                found = answer["diffusion coefficient"]
                label = found.theory if k == 0 else None
                middle.axhline(found.expected, color=shade, lw=1.0, ls=(0, (4, 2)), label=label)
        x = np.geomspace(0.125, 12.0, 100)
        right.plot(x, np.exp(-x), color=COLOURS["theory"], lw=1.2, label="exponential")
        middle.set_xscale("log")
        middle.set_yscale("log")
        middle.set_xlabel("t / mean free time")
        middle.set_ylabel(r"$\langle |x(t) - x(0)|^2 \rangle \,/\, 2dt$")
        middle.set_title("How far it gets")
        middle.legend(fontsize=8)
        right.set_xscale("log")
        right.set_yscale("log")
        right.set_ylim(1e-6, 1.5)
        right.set_xlabel("x / mean free path")
        right.set_ylabel("fraction of the flights")
        right.set_title("Flights longer than x")
        right.legend(fontsize=8)
    return drawn


def _draw(axes: Axes, answer: Answer, name: str, x: str, y: str, look: dict[str, object]) -> None:
    found = answer.curves[name].flat()
    there = found[y] > 0.0
    axes.errorbar(
        found[x][there],
        found[y][there],
        found[f"{y}_error"][there],
        label=answer.label,
        **look,  # type: ignore[arg-type]
    )


def _draw_track(axes: Axes, answer: Answer) -> None:
    """Draw the path of the centre among discs of the radius that it cannot enter, or its shadow in 3D."""
    scene, track = answer.hidden["track"]
    box, reach = scene.box[:2], answer.gas.reach
    low, high = track[:, :2].min(axis=0), track[:, :2].max(axis=0)
    middle, half = 0.5 * (low + high), 0.5 * float((high - low).max()) + 0.5 * reach
    low, high = middle - half, middle + half
    if scene.dim == 2:
        first, last = np.floor(low / box).astype(int) - 1, np.floor(high / box).astype(int) + 1
        images = [(i, j) for i in range(first[0], last[0] + 1) for j in range(first[1], last[1] + 1)]
        places = np.concatenate(
            [scene.positions[scene.obstacles] + np.array(image) * box for image in images]
        )
        near = np.all((places > low - reach) & (places < high + reach), axis=1)
        size = np.full(int(near.sum()), 2.0 * reach)
        axes.add_collection(
            EllipseCollection(
                size,
                size,
                np.zeros(len(size)),
                units="xy",
                offsets=places[near],
                transOffset=axes.transData,
                facecolors=COLOURS["band"],
                edgecolors="none",
            )
        )
    axes.plot(track[:, 0], track[:, 1], color=COLOURS["simulation"], lw=0.9)
    axes.plot(*track[0, :2], "o", ms=4, color=COLOURS["warm"])
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x")
    axes.set_ylabel("y")
    axes.set_title(f"Track of the centre, {answer.label}", fontsize=10)
