"""Figures of the thermalisation study: speed histograms, relaxation, and the moving gas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, patheffects
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from analysis import theory
from analysis.relaxation import Comparison, RelaxationCurve
from studies.figures.style import COLOURS, deviations, falling, figure_style, species_look

if TYPE_CHECKING:
    from hardspheres import Scene
    from studies.answer import Answer
    from studies.recording import Film

__all__ = ["animation", "distributions", "relaxation"]

FloatArray = NDArray[np.float64]


def distributions(answer: Answer, moments: Sequence[float] = (0.0, 0.5, 1.0, 2.0, 4.0, 10.0)) -> Figure:
    """Draw histograms of speeds at several s over the equilibrium curve, one row per species.

    Parameters
    ----------
    answer : Answer
        Of `studies.thermalisation`.
    moments : sequence of float
        Where; the nearest sampled s are taken, each once, and the last one always.

    Returns
    -------
    Figure
    """
    curve: RelaxationCurve = answer.hidden["curve"]
    s = curve.s
    chosen = sorted({int(np.argmin(np.abs(s - moment))) for moment in moments} | {len(s) - 1})
    colours = colormaps["viridis"](np.linspace(0.12, 0.82, len(chosen)))
    rows, thermal = len(curve.labels), curve.thermal_speeds / curve.thermal_speeds[0]
    with figure_style():
        figure = Figure(figsize=(1.0 + 1.85 * len(chosen), 0.85 + 1.9 * rows), layout="constrained")
        panels = figure.subplots(rows, len(chosen), sharey="row", sharex="row", squeeze=False)
        bins = _bins(curve)
        for row, (label, unit) in enumerate(zip(curve.labels, thermal, strict=True)):
            limit = 4.2 * unit
            v = np.linspace(0.0, limit, 300)
            law = theory.speed_pdf(v, curve.dim, mass=1.0 / unit**2)
            for column, (index, colour) in enumerate(zip(chosen, colours, strict=True)):
                axes = panels[row, column]
                edges, density, _ = curve.speed_histogram(index, bins)
                axes.stairs(density[row] / unit, edges * unit, fill=True, color=colour, alpha=0.75, lw=0)
                axes.plot(v, law, color=COLOURS["theory"], lw=1.4)
                axes.set_xlim(0.0, limit)
                axes.set_ylim(0.0, 1.75 * law.max())
                axes.yaxis.set_major_locator(MaxNLocator(4))
                if row == 0:
                    axes.set_title(f"s = {s[index]:.3g}", color=COLOURS["theory"])
                if row == rows - 1:
                    axes.set_xlabel(r"$v \,/\, \sqrt{kT/m_1}$" if rows > 1 else r"$v \,/\, \sqrt{kT/m}$")
                if (density[row] / unit).max() > 1.75 * law.max():
                    _mark_spike(axes, edges * unit, density[row])
            panels[row, 0].set_ylabel(
                "probability density" if label == "all" else f"{label}\nprobability density", fontsize=9
            )
        line = Line2D([], [], color=COLOURS["theory"], lw=1.4, label="Maxwell\u2013Boltzmann")
        figure.legend(handles=[line], loc="outside upper right")
    return figure


def _bins(curve: RelaxationCurve) -> int:
    """Return the number of histogram bins, for some 30 particles in each."""
    fewest = curve.n_replicas * curve.n_per_replica / max(len(curve.labels), 1)
    return 80 if fewest > 20000 else 40 if fewest > 1000 else 20


def _mark_spike(axes: Axes, edges: FloatArray, density: FloatArray) -> None:
    """Label a truncated bar with its share of the gas."""
    peak = int(np.argmax(density))
    share = density[peak] / density.sum()
    axes.annotate(
        f"{100 * share:.0f} % in\nthis bar",
        ((edges[peak] + edges[peak + 1]) / 2, 0.985),
        xycoords=("data", "axes fraction"),
        xytext=(5, 0),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color="#4a5562",
    )


def relaxation(answer: Answer) -> Figure:
    """Draw a2(s) and H(s) with their standard errors over the theory, and the deviations below.

    Parameters
    ----------
    answer : Answer
        Of `studies.thermalisation`; without a theory of its start, the approach is drawn alone.

    Returns
    -------
    Figure
    """
    curve: RelaxationCurve = answer.hidden["curve"]
    reference: Comparison | None = answer.hidden["reference"]
    s = curve.s
    with figure_style():
        directed = curve.preferred_direction
        width = 9.4 if directed is None else 13.2
        figure = Figure(figsize=(width, 4.6 if reference is not None else 3.6), layout="constrained")
        if reference is not None:
            panels = figure.subplots(2, 2, sharex=True, height_ratios=[3.2, 1])
            upper, lower = panels[0], panels[1]
        elif directed is None:
            upper, lower = figure.subplots(1, 2, sharex=True), []
        else:  # there is no theory for an anisotropic start
            first, *upper = figure.subplots(1, 3, sharex=True)
            lower = []
            _draw_parallel(first, curve, directed)
        _draw_a2(upper[0], curve, reference)
        _draw_h(upper[1], curve, reference)
        for axes, z in zip(
            lower, (reference.a2_z, reference.h_z) if reference is not None else (), strict=True
        ):
            deviations(axes, (s, z, {}))
            if np.isnan(z).all():
                text = "no reference for the wide bins of so few particles"
                axes.text(
                    0.5, 0.62, text, transform=axes.transAxes, ha="center", fontsize=8.5, color="#4a5562"
                )
        for axes in lower if len(lower) else figure.axes:
            axes.set_xlabel("collisions per particle s")
    return figure


def _fine(curve: RelaxationCurve) -> FloatArray:
    return np.linspace(0.0, min(float(curve.s.max()), 10.0), 500)


def _draw_a2(axes: Axes, curve: RelaxationCurve, reference: Comparison | None) -> None:
    if reference is not None and curve.starts_from_equal_speeds:
        s = _fine(curve)
        table = theory.boltzmann_equal_speeds(s, curve.dim)
        axes.plot(s, table.a2, color=COLOURS["theory"], label="Boltzmann equation", zorder=2)
        near = -2.0 / (curve.dim + 2) * np.exp(-theory.sonine_rate(curve.dim) * s)
        rate = "8s/15" if curve.dim == 3 else "s/2"
        axes.plot(
            s,
            near,
            color=COLOURS["band"],
            lw=1.2,
            ls=(0, (4, 2)),
            label=f"exp(\u2212{rate}), first Sonine approximation",
        )
    elif curve.starts_from_beams:
        s = _fine(curve)
        s = s[s <= 7.0]
        axes.plot(
            s, theory.boltzmann_beams(s, curve.dim).a2, color=COLOURS["theory"], label="Boltzmann equation"
        )
    else:
        axes.axhline(0.0, color=COLOURS["theory"], lw=1.2, label="equilibrium")
    if len(curve.labels) == 1:
        _points(axes, curve.s, curve.a2, curve.a2_error, COLOURS["simulation"], "simulation")
    else:
        _points(axes, curve.s, curve.a2, curve.a2_error, COLOURS["words"], "all species")
        for kind, (label, a2) in enumerate(zip(curve.labels, curve.a2_by_species.T, strict=True)):
            axes.plot(curve.s, a2, ls="", ms=4.5, mfc="none", label=label, **species_look(kind))
    axes.set_ylabel("fourth cumulant $a_2$")
    axes.set_title("Deviation of the speeds from Maxwell\u2013Boltzmann")
    axes.legend(loc="best")


def _draw_parallel(axes: Axes, curve: RelaxationCurve, direction: FloatArray) -> None:
    if curve.starts_from_beams:
        s = _fine(curve)
        s = s[s <= 7.0]
        axes.plot(
            s,
            1.0 + theory.boltzmann_beams(s, curve.dim).anisotropy,
            color=COLOURS["theory"],
            label="Boltzmann equation",
        )
    else:
        axes.axhline(1.0, color=COLOURS["theory"], lw=1.2, label="equilibrium")
    value, error = curve.temperature_along(direction)
    _points(axes, curve.s, value, error, COLOURS["simulation"], "simulation")
    axes.set_ylabel(r"$T_\parallel / T$")
    axes.set_title("Decay of the initial anisotropy")
    axes.legend(loc="upper right")


def _draw_h(axes: Axes, curve: RelaxationCurve, reference: Comparison | None) -> None:
    h, error = curve.h, curve.h_error
    floor = math.sqrt(curve.h_bins / 2) / (curve.n_replicas * curve.n_per_replica)
    if reference is not None and curve.starts_from_equal_speeds and curve.h_bins == theory.H_BINS:
        s = _fine(curve)
        table = theory.boltzmann_equal_speeds(s, curve.dim)
        axes.plot(s, table.h, color=COLOURS["theory"], label="Boltzmann equation", zorder=2)
    falling(axes, curve.s, h, error, floor, color=COLOURS["simulation"], label="simulation")
    bottom = floor / 3
    axes.set_yscale("log")
    axes.axhspan(bottom, floor, color=COLOURS["band"], alpha=0.25, lw=0, label="noise of $H$ at equilibrium")
    axes.set_ylim(bottom, max(float(h.max()), 10 * floor) * 2.5)
    axes.set_xlim(-0.02 * curve.s.max(), 1.02 * curve.s.max())
    axes.set_ylabel(r"$H - H_\mathrm{eq}$")
    axes.set_title("Decay of Boltzmann\u2019s H")
    axes.legend(loc="upper right")


def _points(axes: Axes, x: FloatArray, y: FloatArray, error: FloatArray, colour: str, label: str) -> None:
    axes.fill_between(x, y - 2 * error, y + 2 * error, color=colour, alpha=0.18, lw=0, label="2 std. errors")
    axes.errorbar(x, y, error, fmt="o", ms=4, lw=1.2, color=colour, label=label, zorder=3)


_DARK, _PALE, _GROUND = "#10161f", "#c9d3de", "#0b1017"
_SPEEDS = LinearSegmentedColormap.from_list("speeds", ["#5f8ce0", "#d072b4", "#ff9a5c", "#ffe76e"])
"""Colours of speeds from 0 to `_TOP` thermal speeds, from dark to light on a darker background."""
_TOP = 3.0
_FARTHEST = 0.75  # opacity of the sphere farthest away
_OUTLINES = ("none", "#ffffff", "#7fc8d8", "#e8b23a", "#c8403f")  # of species
_CROWD = 300  # particles that can be distinguished
_LEAST = 0.006  # radius of a sphere that can be seen, over the width of the view


@dataclass(frozen=True)
class View:
    """The part of a gas that a film shows.

    Attributes
    ----------
    window : (d,) array
        Edges of what is shown, from the origin of the box.
    scale : float
        How much larger spheres are drawn than they are.
    words : str
        Both in words, for the caption.
    """

    window: FloatArray
    scale: float
    words: str

    @classmethod
    def of(cls, scene: Scene) -> View:
        """Return a view of the whole box, or of a corner with some 300 particles, with visible spheres."""
        share = min(1.0, (_CROWD / scene.n) ** (1 / scene.dim))
        window = np.asarray(scene.box) * share
        scale = max(1.0, _LEAST * float(window.max()) / float(scene.radii.min()))
        part = "the whole box" if share == 1.0 else f"a corner with {100 * share**scene.dim:.2g} % of the box"
        size = "drawn to scale" if scale == 1.0 else f"drawn {scale:.2g} times too large"
        if scene.dim == 3:
            part += ", seen along z"
        return cls(window, scale, f"{part}; {'spheres' if scene.dim == 3 else 'discs'} {size}")


def animation(film: Film, scene: Scene, answer: Answer, path: Path, gas: str) -> None:
    """Write the first replica as an animated GIF, coloured by speed, beside the histogram of its speeds.

    Parameters
    ----------
    film : Film
        Recorded positions and speeds.
    scene : Scene
        Its start: radii and box.
    answer : Answer
        For names of species.
    path : Path
        Where to write.
    gas : str
        Its name.

    Notes
    -----
    The caption describes the view, see `View`. In 3D, spheres farther away are slightly darker, and nearer
    ones cover them. The second species and further ones have outlines. The histogram is of the whole replica.
    """
    dim, n = scene.dim, scene.n
    view_of = View.of(scene)
    with figure_style():
        figure = Figure(figsize=(8.0, 4.6), facecolor=_DARK)
        FigureCanvasAgg(figure)
        figure.text(0.02, 0.955, gas, color=_PALE, fontsize=9)
        figure.text(0.02, 0.03, view_of.words, color=_PALE, fontsize=9)
        view = figure.add_axes((0.02, 0.1, 0.46, 0.82))
        graph = figure.add_axes((0.57, 0.25, 0.4, 0.55))
        view.set(
            xlim=(0.0, view_of.window[0]),
            ylim=(0.0, view_of.window[1]),
            aspect="equal",
            xticks=[],
            yticks=[],
            facecolor=_GROUND,
        )
        for spine in view.spines.values():
            spine.set(visible=True, color="#33404f")
        bins = np.linspace(0.0, 4.2, 43 if n >= 1000 else 22)
        middle = (bins[1:] + bins[:-1]) / 2
        bars = graph.bar(
            middle,
            np.zeros_like(middle),
            np.diff(bins),
            color=_SPEEDS(np.clip(middle / _TOP, 0, 1)),
            lw=0,
        )
        v = np.linspace(0.0, 4.2, 300)
        law = theory.speed_pdf(v, dim)
        graph.plot(v, law, color=_PALE, lw=1.8)
        graph.text(
            v[np.argmax(law)] + 0.75, law.max() * 0.93, "Maxwell\u2013Boltzmann", color=_PALE, fontsize=9
        )
        graph.set(xlim=(0.0, 4.2), ylim=(0.0, 1.9 * law.max()), facecolor=_DARK)
        graph.yaxis.set_major_locator(MaxNLocator(4))
        graph.set_xlabel(r"colour: speed $v \,/\, \sqrt{kT/m}$", color=_PALE)
        graph.set_ylabel("probability density, all particles", color=_PALE, fontsize=9)
        graph.tick_params(colors=_PALE)
        for side in ("left", "bottom"):
            graph.spines[side].set_color("#55626f")
        labels = answer.details["species"]
        if len(labels) > 1:
            _name_species(figure, labels)
        clock = graph.text(0.0, 1.08, "", transform=graph.transAxes, color="white", fontsize=12)
        clock.set_path_effects([patheffects.withStroke(linewidth=2, foreground=_DARK)])
        writer = PillowWriter(fps=16)
        writer.setup(figure, str(path), dpi=80)
        spheres: Any = None
        for s, positions, speeds in zip(film.s, film.positions, film.speeds, strict=True):
            if spheres is not None:
                spheres.remove()
            spheres = _spheres(view, positions, speeds, scene, view_of)
            heights = np.histogram(speeds, bins=bins)[0] / n / np.diff(bins)
            for bar, height in zip(bars, heights, strict=True):
                bar.set_height(height)
            clock.set_text(f"{s:.1f} of {film.s[-1]:.4g} collisions per particle")
            writer.grab_frame(facecolor=_DARK)
        for _ in range(16):  # rest a second on the last frame
            writer.grab_frame(facecolor=_DARK)
        writer.finish()


def _name_species(figure: Figure, labels: Sequence[str]) -> None:
    """Add a legend of outlines and species."""
    handles = [
        Line2D([], [], ls="", marker="o", ms=7, mfc="#d072b4", mec=outline, mew=1.2, label=label)
        for label, outline in zip(labels, _OUTLINES, strict=False)
    ]
    legend = figure.legend(
        handles=handles, loc="lower right", bbox_to_anchor=(0.98, 0.0), ncols=2, labelcolor=_PALE
    )
    legend.set_frame_on(False)


def _spheres(
    axes: Axes, positions: NDArray[np.float32], speeds: NDArray[np.float32], scene: Scene, view: View
) -> EllipseCollection:
    """Draw the spheres within the window, far ones first, as discs in units of the axes."""
    radii = view.scale * scene.radii
    shown = np.flatnonzero(np.all(positions < view.window + radii[:, None], axis=1))
    opacity = np.ones(len(shown))
    if positions.shape[1] == 3:
        depth = positions[shown, 2] / view.window[2]
        order = np.argsort(depth)
        shown, depth = shown[order], depth[order]
        opacity = _FARTHEST + (1.0 - _FARTHEST) * np.clip(depth, 0.0, 1.0)
    face = _SPEEDS(np.clip(speeds[shown] / _TOP, 0.0, 1.0))
    face[:, 3] = opacity
    diameters = 2 * radii[shown]
    kinds = scene.species[shown] % len(_OUTLINES)
    spheres = EllipseCollection(
        diameters,
        diameters,
        np.zeros(len(shown)),
        units="xy",
        offsets=positions[shown, :2],
        offset_transform=axes.transData,
        facecolors=face,
        edgecolors=[_OUTLINES[kind] for kind in kinds],
        linewidths=0.8,
    )
    axes.add_collection(spheres)
    return spheres
