"""Figure of a drop: temperatures, heights and the fourth cumulant against time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.figures.style import COLOURS, figure_style, species_look

if TYPE_CHECKING:
    from studies.answer import Answer

__all__ = ["figure"]

TIME = "time / time of a fall from lid to floor"


def figure(answer: Answer) -> Figure:
    """Draw kinetic temperatures, mean heights and a2.

    Parameters
    ----------
    answer : Answer
        Of `studies.drop`.

    Returns
    -------
    Figure
    """
    labels = answer.details["species"]
    tails = [f"_{k + 1}" for k in range(len(labels))] if len(labels) > 1 else [""]
    with figure_style():
        drawn = Figure(figsize=(11.6, 3.8), layout="constrained")
        left, middle, right = drawn.subplots(1, 3)
        _draw(left, answer, "along", "along gravity", {"color": COLOURS["simulation"], "marker": "o"})
        _draw(left, answer, "across", "across", {"color": COLOURS["warm"], "marker": "s"})
        for k, tail in enumerate(tails):
            name = labels[k] if tail else "all"
            if tail:
                _draw(
                    left,
                    answer,
                    f"temperature{tail}",
                    name,
                    {"color": species_look(k + 2)["color"], "ls": "--"},
                )
            _draw(middle, answer, f"height{tail}", name, species_look(k))
        left.axhline(1.0, color=COLOURS["theory"], lw=1.0)
        left.set_ylabel("kT / kT of that energy in theory")
        left.set_title("Temperatures")
        left.legend(fontsize=8)
        middle.set_ylim(bottom=0.0)
        middle.set_ylabel("mean height / diameter")
        middle.set_title("Heights")
        middle.legend(fontsize=8)
        _draw(right, answer, "a2", "simulation", {"color": COLOURS["simulation"], "marker": "o"})
        thermal = answer["a2 at the end"].expected
        right.axhline(thermal, color=COLOURS["theory"], lw=1.0, label="Maxwell-Boltzmann")
        right.set_ylabel("a2")
        right.set_title("Fourth cumulant of the velocities")
        right.legend(fontsize=8)
    return drawn


def _draw(axes: Axes, answer: Answer, name: str, label: str, look: dict[str, str]) -> None:
    found = answer.curves["fall"].flat()
    t = found["t"]
    moved = t > 0.0
    line: dict[str, Any] = {"lw": 1.0, "ms": 3.5} | look
    axes.errorbar(
        t[moved], found[name][moved], found[f"{name}_error"][moved], elinewidth=0.8, label=label, **line
    )
    axes.set_xscale("log")
    axes.set_xlabel(TIME)
